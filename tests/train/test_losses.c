/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_losses.c: the losses' values against plain computations of the same
 * formulas, and their gradients against central differences in double precision.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "brace/metrics.h"
#include "image/color.h"
#include "nn/node.h"
#include "train/loss.h"

static void ok(brace_status status, const brace_error *error) {
    if (status != BRACE_OK) {
        fail_msg("%s", error->message);
    }
}

static double number(uint32_t stream, size_t i, double low, double high) {
    core_random r = core_random_create(7, stream, (uint32_t)i, 0);
    return core_random_range(&r, low, high);
}

typedef struct built {
    nn_weights *weights;
    nn_graph *g;
    nn_value raw, y, gains, matrix;
    train_loss loss;
} built;

static void begin(built *b, nn_type type, nn_shape shape) {
    brace_error error = {0};
    *b = (built){0};
    ok(nn_weights_create(&b->weights, 1, &error), &error);
    const brace_job job = {.threads = 1};
    ok(nn_graph_create(&b->g, b->weights, &(nn_graph_params){.type = type, .job = &job, .poison = true}, &error),
       &error);
    b->raw = nn_input_grad(b->g, "raw", shape);
}

static void plan(built *b, nn_value loss) {
    brace_error error = {0};
    nn_output(b->g, "y", b->y);
    ok(nn_graph_plan(b->g, &(nn_plan_params){.loss = loss}, &error), &error);
}

static void forward(built *b) {
    brace_error error = {0};
    ok(nn_forward(b->g, &error), &error);
}

static void end(built *b) {
    nn_graph_destroy(b->g);
    nn_weights_destroy(b->weights);
}

static void fill(built *b, nn_value v, uint32_t stream, double low, double high) {
    const size_t count = nn_count(nn_shape_of(b->g, v));
    for (size_t i = 0; i < count; i++) {
        const double x = number(stream, i, low, high);
        if (nn_type_of(b->g, v) == NN_F64) {
            ((double *)nn_data(b->g, v))[i] = x;
        } else {
            ((float *)nn_data(b->g, v))[i] = (float)x;
        }
    }
}

/* ---- values ---- */

static void test_encoding(void **state) {
    (void)state;
    static const double x[8] = {-0.02, -1e-4, 0, 1e-5, 0.01, 0.2, 1, 3};
    for (int kind = 0; kind < 2; kind++) {
        built b;
        begin(&b, NN_F64, (nn_shape){1, 1, 2, 4});
        b.y = train_encode(b.g, b.raw, kind == 0 ? TRAIN_GAMMA : TRAIN_MU_LAW, 5000);
        plan(&b, 0);
        memcpy(nn_data(b.g, b.raw), x, sizeof x);
        forward(&b);
        const double *y = nn_data(b.g, b.y);
        for (int i = 0; i < 8; i++) {
            const double zero = pow(0.001, 1 / 2.2), one = pow(1.001, 1 / 2.2);
            const double slope = kind == 0 ? pow(0.001, 1 / 2.2 - 1) / 2.2 / (one - zero) : 5000 / log(5001);
            const double curve =
                kind == 0 ? (pow(x[i] + 0.001, 1 / 2.2) - zero) / (one - zero) : log(1 + 5000 * x[i]) / log(5001);
            assert_true(fabs(y[i] - (x[i] < 0 ? slope * x[i] : curve)) < 1e-9);
            assert_true(i == 0 || y[i] > y[i - 1]);
        }
        assert_true(fabs(y[6] - 1) < 1e-12 && fabs(y[2]) < 1e-12);
        end(&b);
    }
}

enum { SIDE = 16 };

/* A band of a level is a sum over blocks with a sign: no transform of a transform. */
static void test_wavelet(void **state) {
    (void)state;
    built b;
    begin(&b, NN_F32, (nn_shape){1, SIDE, SIDE, 4});
    b.y = train_loss_wavelet(b.g, b.raw, train_wavelet_weights);
    plan(&b, 0);
    fill(&b, b.raw, 1, -1, 1);
    forward(&b);
    const float *x = nn_data(b.g, b.raw);
    double expected = 0, weights = 0;
    for (int level = 1; level <= 3; level++) {
        const int block = 1 << level, half = block / 2;
        for (int band = 0; band < 4; band++) {
            if (band == 0 && level < 3) {
                continue;
            }
            double sum = 0;
            for (int by = 0; by < SIDE; by += block) {
                for (int bx = 0; bx < SIDE; bx += block) {
                    for (int c = 0; c < 4; c++) {
                        double s = 0;
                        for (int y = 0; y < block; y++) {
                            for (int k = 0; k < block; k++) {
                                const bool minus = ((band & 1) && y >= half) != ((band & 2) && k >= half);
                                s += (minus ? -1 : 1) * (double)x[((by + y) * SIDE + bx + k) * 4 + c];
                            }
                        }
                        sum += fabs(s) / (block * block); /* Haar's 2^-level, and the gain of 2^level divided out */
                    }
                }
            }
            const double weight = train_wavelet_weights[band == 0 ? 9 : 3 * (level - 1) + band - 1];
            weights += weight;
            expected += weight * sum / (4.0 * SIDE * SIDE / (block * block));
        }
    }
    assert_true(fabs(weights - 1) < 1e-12);
    assert_true(fabs((double)*(float *)nn_data(b.g, b.y) - expected) < 1e-6);
    /* A constant difference is in LL alone. */
    for (int i = 0; i < SIDE * SIDE * 4; i++) {
        ((float *)nn_data(b.g, b.raw))[i] = 0.25f;
    }
    forward(&b);
    assert_true(fabs((double)*(float *)nn_data(b.g, b.y) - 0.25 * train_wavelet_weights[9]) < 1e-7);
    end(&b);
}

static const double some_gains[3] = {1.9, 1, 1.6};
static const double some_matrix[9] = {/* rows camera, columns sRGB */
                                      1.7, -0.2, 0.05, -0.6, 1.5, -0.55, -0.1, -0.3, 1.5};

static void set_color(built *b) {
    for (int i = 0; i < 9; i++) {
        if (nn_type_of(b->g, b->gains) == NN_F64) {
            ((double *)nn_data(b->g, b->matrix))[i] = some_matrix[i];
            ((double *)nn_data(b->g, b->gains))[i % 3] = some_gains[i % 3];
        } else {
            ((float *)nn_data(b->g, b->matrix))[i] = (float)some_matrix[i];
            ((float *)nn_data(b->g, b->gains))[i % 3] = (float)some_gains[i % 3];
        }
    }
}

static void test_isp(void **state) {
    (void)state;
    built b;
    begin(&b, NN_F64, (nn_shape){1, SIDE, SIDE, 4});
    b.gains = nn_input(b.g, "gains", (nn_shape){1, 1, 1, 3});
    b.matrix = nn_input(b.g, "matrix", (nn_shape){1, 1, 3, 3});
    b.y = train_isp(b.g, b.raw, b.gains, b.matrix);
    plan(&b, 0);
    fill(&b, b.raw, 2, 0, 1.2);
    set_color(&b);
    forward(&b);
    const double *raw = nn_data(b.g, b.raw), *y = nn_data(b.g, b.y);
    int inside = 0;
    for (int i = 0; i < SIDE * SIDE; i++) {
        const double camera[3] = {fmin(1, raw[4 * i] * some_gains[0]),
                                  fmin(1, (raw[4 * i + 1] + raw[4 * i + 2]) / 2 * some_gains[1]),
                                  fmin(1, raw[4 * i + 3] * some_gains[2])};
        for (int c = 0; c < 3; c++) {
            const double l =
                camera[0] * some_matrix[c] + camera[1] * some_matrix[3 + c] + camera[2] * some_matrix[6 + c];
            if (l >= 0 && l <= 1) {
                inside++;
                assert_true(fabs(y[3 * i + c] - image_srgb_encode_exact(l)) < 1e-6);
            } else if (l < 0) {
                assert_true(fabs(y[3 * i + c] - 12.92 * l) < 1e-9);
            }
        }
    }
    assert_true(inside > SIDE * SIDE);
    end(&b);
}

/* Against the metric, which shares the directions but neither code nor method with the graph. */
static void test_msswd(void **state) {
    (void)state;
    enum { W = 52, H = 45, P = 24, SCALES = 3 };
    const train_msswd params = {SCALES, P};
    brace_error error = {0};
    built b;
    begin(&b, NN_F32, (nn_shape){1, H, W, 3});
    const nn_value other = nn_input(b.g, "other", (nn_shape){1, H, W, 3});
    ok(train_msswd_draw(b.weights, "", &params, 5, &error), &error);
    b.y = train_loss_msswd(b.g, b.weights, b.raw, other, &params);
    plan(&b, b.y);
    assert_int_equal(nn_weights_count(b.weights), SCALES);
    fill(&b, b.raw, 3, 0, 1);
    fill(&b, other, 4, 0.1, 0.7);
    brace_image *image[2];
    for (int k = 0; k < 2; k++) {
        ok(brace_image_create(&image[k], W, H, 3, BRACE_SAMPLE_F32, BRACE_TRANSFER_SRGB, &error), &error);
        memcpy(image[k]->data, nn_data(b.g, k == 0 ? b.raw : other), (size_t)W * H * 3 * sizeof(float));
    }
    for (uint64_t seed = 5; seed < 7; seed++) { /* drawn before and after the graph was planned */
        ok(train_msswd_draw(b.weights, "", &params, seed, &error), &error);
        double expected = 0;
        ok(brace_ms_swd(&expected, image[0], image[1],
                        &(brace_ms_swd_params){.scales = SCALES, .projections = P, .seed = seed}, NULL, &error),
           &error);
        forward(&b);
        const double got = (double)*(float *)nn_data(b.g, b.y);
        if (!(fabs(got - expected) < 1e-4 * expected)) {
            fail_msg("%.8g, but the metric says %.8g", got, expected);
        }
    }
    brace_image_destroy(image[0]);
    brace_image_destroy(image[1]);
    end(&b);
}

/* ---- gradients ---- */

static void check_gradient(train_loss_params params, const char *what) {
    brace_error error = {0};
    built b;
    begin(&b, NN_F64, (nn_shape){1, SIDE, SIDE, 4});
    ok(train_msswd_draw(b.weights, "loss.", &params.msswd, 1, &error), &error);
    b.loss = train_loss_build(b.g, b.weights, b.raw, nn_affine(b.g, b.raw, 0.7, 0.1), &params);
    b.y = b.loss.total;
    ok(nn_graph_error(b.g, &error), &error);
    plan(&b, b.loss.total);
    fill(&b, b.raw, 5, -0.05, 1);
    fill(&b, b.loss.truth, 6, 0, 1);
    if (b.loss.gains != 0) {
        b.gains = b.loss.gains, b.matrix = b.loss.matrix;
        set_color(&b);
    }
    forward(&b);
    ok(nn_backward(b.g, 1, &error), &error);
    double gradient[SIDE * SIDE * 4], *x = nn_data(b.g, b.raw), largest = 0;
    memcpy(gradient, nn_grad(b.g, b.raw), sizeof gradient);
    const double *loss = nn_data(b.g, b.loss.total), step = 1e-7;
    for (int i = 0; i < SIDE * SIDE * 4; i += 7) {
        const double old = x[i];
        x[i] = old + step;
        forward(&b);
        const double above = *loss;
        x[i] = old - step;
        forward(&b);
        const double expected = (above - *loss) / (2 * step);
        x[i] = old;
        largest = fmax(largest, fabs(expected));
        if (!(fabs(gradient[i] - expected) < 1e-6 * (1 + fabs(expected)))) {
            fail_msg("%s: d loss/d raw[%d] is %.10g; differences say %.10g", what, i, gradient[i], expected);
        }
    }
    assert_true(largest > 1e-4);
    end(&b);
}

static void test_gradients(void **state) {
    (void)state;
    train_loss_params p = {.mu = 5000, .msswd = {2, 4}};
    memcpy(p.bands, train_wavelet_weights, sizeof p.bands);
    check_gradient(p, "L1, gamma");
    p.encoding = TRAIN_MU_LAW;
    check_gradient(p, "L1, mu-law");
    p.encoding = TRAIN_GAMMA;
    p.wavelet = 50;
    check_gradient(p, "wavelet");
    p.wavelet = 0.5;
    p.color = 0.05;
    check_gradient(p, "both stages");
    p.relative = 0.5;
    check_gradient(p, "relative");
    p.alone = 0.3;
    check_gradient(p, "two answers");
}

/* The parts make up the total, of which the ratio may count, and equal pictures cost nothing. */
static void check_total(double relative, double alone, bool no_l1) {
    brace_error error = {0};
    train_loss_params p = {.mu = 5000, .wavelet = 0.5, .color = 0.05, .relative = relative, .alone = alone,
                           .no_l1 = no_l1, .msswd = {2, 8}};
    memcpy(p.bands, train_wavelet_weights, sizeof p.bands);
    built b;
    begin(&b, NN_BF16, (nn_shape){1, SIDE, SIDE, 4});
    ok(train_msswd_draw(b.weights, "loss.", &p.msswd, 1, &error), &error);
    const nn_value answer = nn_cast(b.g, b.raw, NN_BF16);
    b.loss = train_loss_build(b.g, b.weights, answer, answer, &p);
    b.y = b.loss.total;
    plan(&b, b.loss.total);
    fill(&b, b.raw, 8, 0, 1);
    fill(&b, b.loss.truth, 9, 0, 1);
    b.gains = b.loss.gains, b.matrix = b.loss.matrix;
    set_color(&b);
    forward(&b);
    const float *total = nn_data(b.g, b.loss.total), *l1 = nn_data(b.g, b.loss.l1),
                *wavelet = nn_data(b.g, b.loss.wavelet), *color = nn_data(b.g, b.loss.color);
    assert_true(*l1 > 0.05f && *wavelet > 0.005f && *color > 1);
    const double plain = (no_l1 ? 0 : (double)*l1) + 0.5 * (double)*wavelet, sum = plain + 0.05 * (double)*color;
    double want = relative > 0 ? relative * log(1 + sum / relative) : sum;
    want += alone * (relative > 0 ? relative * log(1 + plain / relative) : plain);
    assert_true(fabs((double)*total - want) < 1e-5);
    for (int i = 0; i < SIDE * SIDE * 4; i++) { /* numbers that bf16 holds */
        ((float *)nn_data(b.g, b.raw))[i] = ((float *)nn_data(b.g, b.loss.truth))[i] = (float)(i % 16) / 16;
    }
    forward(&b);
    assert_true(*total == 0);
    end(&b);
}

static void test_total(void **state) {
    (void)state;
    check_total(0, 0, false);
    check_total(0.01, 0, false);
    check_total(0.01, 0.5, false);
    check_total(0, 0.5, true);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_encoding), cmocka_unit_test(test_wavelet),   cmocka_unit_test(test_isp),
        cmocka_unit_test(test_msswd),    cmocka_unit_test(test_gradients), cmocka_unit_test(test_total),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
