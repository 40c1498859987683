/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_rows.c: the inner loops of every instruction set that this processor has: functions against libm, products
 * against plain sums at awkward sizes, large sums, and broadcasting against indices.
 */
#include "nn_test.h"

#include <math.h>
#include <string.h>

#include "nn/chunks.h"

static const nn_rows *tables[3];
static int table_count;

static int setup(void **state) {
    (void)state;
    tables[table_count++] = nn_rows_plain;
#if defined(__x86_64__)
    const core_cpu cpu = core_cpu_features();
    if (cpu.avx2) {
        tables[table_count++] = nn_rows_avx2;
    }
    if (cpu.avx512) {
        tables[table_count++] = nn_rows_avx512;
    }
#endif
    return 0;
}

static double reference(nn_unary_kind kind, double x) {
    return kind == NN_EXP ? exp(x) : kind == NN_UNARY_TANH ? tanh(x) : 1 / (1 + exp(-x));
}

static void test_functions(void **state) {
    (void)state;
    const nn_unary_kind kinds[] = {NN_EXP, NN_UNARY_TANH, NN_UNARY_SIGMOID};
    enum { COUNT = 40001 };
    static float x[COUNT], y[COUNT];
    for (int i = 0; i < COUNT; i++) {
        const double u = (i - COUNT / 2) / (double)(COUNT / 2);
        x[i] = (float)(i % 2 == 0 ? 87 * u : 3 * u * u * u); /* near 0 as well */
    }
    for (int t = 0; t < table_count; t++) {
        for (int k = 0; k < 3; k++) {
            tables[t][NN_F32].unary(kinds[k], 0, 0, x, y, COUNT);
            for (int i = 0; i < COUNT; i++) {
                const double expected = reference(kinds[k], (double)x[i]);
                if (!(fabs((double)y[i] - expected) <= 5e-7 * fabs(expected) + 1e-37)) {
                    fail_msg("table %d, function %d: of %.9g is %.9g, not %.9g", t, k, (double)x[i], (double)y[i],
                             expected);
                }
            }
            const float special[] = {NAN, INFINITY, -INFINITY, 200, -200, 0};
            tables[t][NN_F32].unary(kinds[k], 0, 0, special, y, 6);
            assert_true(isnan(y[0]));
            for (int i = 1; i < 6; i++) {
                const float expected = (float)reference(kinds[k], (double)special[i]);
                assert_true(y[i] == expected || fabsf(y[i] - expected) < 1e-30f);
            }
        }
    }
}

static void test_product(void **state) {
    (void)state;
    const size_t sizes[][3] = {{1, 1, 1}, {4, 32, 5}, {7, 45, 3}, {5, 8, 72}, {72, 8, 9}, {9, 61, 1}, {3, 31, 17}};
    for (int t = 0; t < table_count; t++) {
        for (size_t s = 0; s < sizeof sizes / sizeof sizes[0]; s++) {
            const size_t m = sizes[s][0], n = sizes[s][1], k = sizes[s][2], row = n + 3;
            for (int form = 0; form < 4; form++) {
                const bool add = form % 2 == 1, turned = form / 2 == 1;
                float *a = core_alloc(m * k, 4), *b = core_alloc(k * n, 4), *c = core_alloc(m * row, 4);
                for (size_t i = 0; i < m * k; i++) {
                    a[i] = (float)test_number(1, 1, i, -1, 1);
                }
                for (size_t i = 0; i < k * n; i++) {
                    b[i] = (float)test_number(1, 2, i, -1, 1);
                }
                for (size_t i = 0; i < m * row; i++) {
                    c[i] = 0.5f;
                }
                tables[t][NN_F32].product(m, n, k, a, turned ? 1 : k, turned ? m : 1, b, n, c, row, add);
                for (size_t i = 0; i < m; i++) {
                    for (size_t j = 0; j < row; j++) {
                        double sum = add || j >= n ? 0.5 : 0; /* between the rows nothing changes */
                        for (size_t l = 0; l < k && j < n; l++) {
                            sum += (double)(turned ? a[l * m + i] : a[i * k + l]) * (double)b[l * n + j];
                        }
                        assert_true(fabs((double)c[i * row + j] - sum) <= 1e-5);
                    }
                }
                core_free(a);
                core_free(b);
                core_free(c);
            }
        }
    }
}

/* Three million numbers of 0.1: f32 sums would be off in the third digit. */
static void test_large_sums(void **state) {
    (void)state;
    const nn_shape shapes[] = {{3, 1000, 1000, 1}, {1, 1, 1, 3000000}, {1000, 1, 1000, 3}, {2, 3, 500, 1000}};
    for (size_t i = 0; i < sizeof shapes / sizeof shapes[0]; i++) {
        for (int axes = 1; axes < 16; axes++) {
            brace_error error = {0};
            const brace_job job = {.threads = 2};
            nn_weights *weights = NULL;
            nn_graph *g = NULL;
            test_ok(nn_weights_create(&weights, 1, &error), &error);
            test_ok(nn_graph_create(&g, weights, &(nn_graph_params){.job = &job}, &error), &error);
            const nn_value x = nn_input(g, "x", shapes[i]),
                           y = nn_sum(g, x, (axes & 1) != 0, (axes & 2) != 0, (axes & 4) != 0, (axes & 8) != 0);
            nn_output(g, "y", y);
            test_ok(nn_graph_plan(g, NULL, &error), &error);
            float *numbers = nn_data(g, x);
            for (size_t k = 0; k < nn_count(shapes[i]); k++) {
                numbers[k] = 0.1f;
            }
            test_ok(nn_forward(g, &error), &error);
            const size_t results = nn_count(nn_shape_of(g, y));
            const float expected = (float)((double)0.1f * (double)(nn_count(shapes[i]) / results));
            for (size_t k = 0; k < results; k++) {
                assert_true(((float *)nn_data(g, y))[k] == expected);
            }
            nn_graph_destroy(g);
            nn_weights_destroy(weights);
        }
    }
}

static void test_broadcasting(void **state) {
    (void)state;
    const nn_shape full = {2, 3, 4, 5};
    float numbers[120];
    for (int i = 0; i < 120; i++) {
        numbers[i] = (float)i;
    }
    for (int axes = 0; axes < 16; axes++) {
        const nn_shape s = {axes & 1 ? 1 : 2, axes & 2 ? 1 : 3, axes & 4 ? 1 : 4, axes & 8 ? 1 : 5};
        const nn_fetch f = nn_fetch_create((nn_view){numbers, s, NN_F32}, full);
        for (size_t begin = 0; begin < 120; begin += 17) {
            const size_t n = 120 - begin < 50 ? 120 - begin : 50;
            nn_chunk room;
            const float *got = nn_fetch_get(&f, begin, n, &room);
            for (size_t i = 0; i < n; i++) {
                const int at = (int)(begin + i), c = at % 5 % s.c, w = at / 5 % 4 % s.w, h = at / 20 % 3 % s.h,
                          b = at / 60 % s.n;
                assert_int_equal((int)got[i], ((b * s.h + h) * s.w + w) * s.c + c);
            }
        }
    }
}

/* The largest position below a side that is a power of two: y + 1 rounds up there. What lies around the picture is neither
 * read nor written. */
static void test_taps_at_the_edge(void **state) {
    (void)state;
    enum { SIDE = 8, CHANNELS = 9, PIXELS = SIDE * SIDE, AROUND = 2 * SIDE };
    static float x[(PIXELS + 2 * AROUND) * CHANNELS], sums[(PIXELS + 2 * AROUND) * CHANNELS];
    const float edge = nextafterf(SIDE, 0), places[] = {edge, nextafterf(-1, 0), -1, -nextafterf(0, 1), 0, SIDE - 1, SIDE};
    enum { PLACES = sizeof places / sizeof *places };
    const nn_taps p = {.h = SIDE, .w = SIDE, .dilation = 1, .channels = CHANNELS, .c = CHANNELS, .parts = 1,
                       .wide = CHANNELS, .k = 9 * CHANNELS};
    float *picture = x + AROUND * CHANNELS, *gradient = sums + AROUND * CHANNELS;
    for (size_t i = 0; i < sizeof x / sizeof *x; i++) {
        x[i] = 1000;
    }
    for (size_t i = 0; i < PIXELS * CHANNELS; i++) {
        picture[i] = (float)test_number(5, 0, i, 0, 1);
    }
    for (int t = 0; t < table_count; t++) {
        for (int k = 0; k < PLACES * PLACES; k++) {
            const float at[2] = {places[k / PLACES], places[k % PLACES]};
            float offset[18], mask[9] = {1}, columns[9 * CHANNELS], d_offset[18], d_mask[9];
            for (int i = 0; i < 9; i++) { /* the first tap there, the others nowhere */
                offset[2 * i] = i == 0 ? at[0] : 1e9f, offset[2 * i + 1] = i == 0 ? at[1] : 1e9f;
            }
            tables[t][NN_F32].taps_sample(&p, picture, offset, mask, 0, 0, columns);
            for (int c = 0; c < CHANNELS; c++) {
                double want = 0;
                for (int y = 0; y < SIDE; y++) {
                    for (int z = 0; z < SIDE; z++) {
                        want += fmax(0, 1 - fabs((double)at[0] - y)) * fmax(0, 1 - fabs((double)at[1] - z)) *
                                (double)picture[(y * SIDE + z) * CHANNELS + c];
                    }
                }
                if (!(fabs((double)columns[c] - want) < 1e-5)) {
                    fail_msg("table %d at (%.9g, %.9g): %g, not %g", t, (double)at[0], (double)at[1], (double)columns[c], want);
                }
                columns[c] = 1;
            }
            memset(sums, 0, sizeof sums);
            memset(d_offset, 0, sizeof d_offset);
            memset(d_mask, 0, sizeof d_mask);
            tables[t][NN_F32].taps_back(&p, picture, offset, mask, 0, 0, columns, gradient, d_offset, d_mask);
            for (size_t i = 0; i < AROUND * CHANNELS; i++) {
                assert_true(sums[i] == 0 && gradient[PIXELS * CHANNELS + i] == 0);
            }
        }
    }
}

/* The largest number and where it was; no number stays none, whenever it came. */
static void test_maximum(void **state) {
    (void)state;
    static const float numbers[][3] = {{1, 3, 2}, {1, NAN, 0.5f}, {NAN, 1, 2}, {1, 2, NAN}, {-1, -2, -1}};
    static const int32_t places[] = {1, 1, 0, 2, 0};
    for (int t = 0; t < table_count; t++) {
        for (size_t k = 0; k < sizeof numbers / sizeof *numbers; k++) {
            float largest[19];
            int32_t where[19] = {0};
            for (int32_t i = 0; i < 3; i++) {
                float row[19];
                for (int j = 0; j < 19; j++) {
                    row[j] = numbers[k][i];
                    largest[j] = i == 0 ? row[j] : largest[j];
                }
                if (i > 0) {
                    tables[t][NN_F32].maximum(row, largest, where, i, 19);
                }
            }
            for (int j = 0; j < 19; j++) {
                const float want = numbers[k][places[k]];
                assert_true(where[j] == places[k] && (isnan(want) ? isnan(largest[j]) : largest[j] == want));
            }
        }
    }
}

/* Denormal numbers are zero while a network runs, and are there again afterwards. */
static void test_denormals(void **state) {
    (void)state;
#if defined(__x86_64__)
    brace_error error = {0};
    const brace_job job = {.threads = 1};
    nn_weights *weights = NULL;
    nn_graph *g = NULL;
    volatile float tiny = 1e-40f;
    test_ok(nn_weights_create(&weights, 1, &error), &error);
    test_ok(nn_graph_create(&g, weights, &(nn_graph_params){.job = &job}, &error), &error);
    const nn_value x = nn_input(g, "x", (nn_shape){1, 1, 1, 1}), y = nn_affine(g, x, 2, 0);
    nn_output(g, "y", y);
    test_ok(nn_graph_plan(g, NULL, &error), &error);
    *(float *)nn_data(g, x) = tiny;
    test_ok(nn_forward(g, &error), &error);
    assert_true(*(float *)nn_data(g, y) == 0);
    assert_true(tiny * 2 > 0);
    nn_graph_destroy(g);
    nn_weights_destroy(weights);
#endif
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_functions),    cmocka_unit_test(test_product),   cmocka_unit_test(test_large_sums),
        cmocka_unit_test(test_broadcasting), cmocka_unit_test(test_denormals), cmocka_unit_test(test_taps_at_the_edge),
        cmocka_unit_test(test_maximum),
    };
    return cmocka_run_group_tests(tests, setup, NULL);
}
