/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_optimizer.c: AdamW against PyTorch's numbers (make_adamw.py), the same bytes with any number of threads and any
 * instruction set, runs that are stopped and go on, damaged states, and learning rates.
 */
#include "nn_test.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "adamw_vectors.h"
#include "core/safetensors.h"
#include "nn/kernels/adamw.h"
#include "nn/optimizer.h"

static char folder[] = "/tmp/brace-optimizer-XXXXXX";
static char path[64];

static int setup(void **state) {
    (void)state;
    if (mkdtemp(folder) == NULL) {
        return -1;
    }
    snprintf(path, sizeof path, "%s/state.safetensors", folder);
    return 0;
}

static int teardown(void **state) {
    (void)state;
    unlink(path);
    return rmdir(folder);
}

/* The same as in make_adamw.py; exact in f32. */
static float number(int step, int i) {
    return (float)((7919 * (i + 31 * step) + 13) % 101) / 128 - 0.375f;
}

/* ---- a weight and a bias as a graph plans them ---- */

typedef struct model {
    nn_weights *weights;
    nn_graph *g;
    nn_parameter *weight, *bias;
    nn_optimizer *optimizer;
} model;

static model make(int rows, int columns, const nn_adamw *how, int threads) {
    model m = {0};
    brace_error error = {0};
    const brace_job job = {.threads = threads};
    test_ok(nn_weights_create(&m.weights, 1, &error), &error);
    test_ok(nn_graph_create(&m.g, m.weights, &(nn_graph_params){.job = &job}, &error), &error);
    nn_value w = nn_param(m.g, "w", (nn_shape){1, 1, rows, columns}, 2, (const int[]){rows, columns}, NN_INIT_ONE);
    const int biases = BIASES;
    nn_value b = nn_param(m.g, "b", (nn_shape){1, 1, 1, BIASES}, 1, &biases, NN_INIT_ONE);
    nn_value loss = nn_add(m.g, nn_sum(m.g, w, true, true, true, true), nn_sum(m.g, b, true, true, true, true));
    test_ok(nn_graph_plan(m.g, &(nn_plan_params){.loss = loss}, &error), &error);
    m.weight = nn_weights_find(m.weights, "w");
    m.bias = nn_weights_find(m.weights, "b");
    for (int i = 0; i < rows * columns; i++) {
        m.weight->value[i] = number(0, i);
    }
    for (int i = 0; i < BIASES; i++) {
        m.bias->value[i] = number(0, rows * columns + i);
    }
    test_ok(nn_optimizer_create(&m.optimizer, m.weights, how, &job, &error), &error);
    return m;
}

static void destroy(model *m) {
    nn_optimizer_destroy(m->optimizer);
    nn_graph_destroy(m->g);
    nn_weights_destroy(m->weights);
}

static void set_gradients(model *m, int step, float scale) {
    const int weights = (int)m->weight->count;
    for (int i = 0; i < weights; i++) {
        m->weight->grad[i] = scale * number(step + 1, i);
    }
    for (int i = 0; i < BIASES; i++) {
        m->bias->grad[i] = scale * number(step + 1, weights + i);
    }
}

static const nn_adamw how_all = {.beta1 = 0.9,
                                 .beta2 = 0.99,
                                 .epsilon = 1e-6,
                                 .weight_decay = 0.1,
                                 .spare_vectors = true,
                                 .clip = 1,
                                 .average = 0.75};

static double value_at(const model *m, int i) {
    return (double)(i < WEIGHTS ? m->weight->value[i] : m->bias->value[i - WEIGHTS]);
}

static void test_pytorch(void **state) {
    (void)state;
    model m = make(3, 5, &how_all, 2);
    const nn_schedule schedule = {.kind = NN_RATE_COSINE, .rate = 0.01, .floor = 1e-3, .steps = 10};
    for (int step = 0; step < STEPS; step++) {
        nn_step_report report;
        const double rate = nn_schedule_rate(&schedule, nn_optimizer_steps(m.optimizer));
        const unsigned version = m.weight->version;
        assert_true(fabs(rate - torch_rates[step]) < 1e-9);
        set_gradients(&m, step, 1);
        nn_optimizer_step(m.optimizer, rate, step % 2 ? 4 : 0.25, &report);
        assert_true(fabs(report.norm / torch_norms[step] - 1) < 1e-6);
        assert_false(report.skipped);
        assert_int_not_equal(m.weight->version, version);
        for (int i = 0; i < WEIGHTS + BIASES; i++) {
            assert_true(fabs(value_at(&m, i) - torch_values[step][i]) < 3e-7);
        }
        for (size_t i = 0; i < m.weight->count; i++) {
            assert_true(m.weight->grad[i] == 0);
        }
    }
    nn_optimizer_swap(m.optimizer);
    for (int i = 0; i < WEIGHTS + BIASES; i++) {
        assert_true(fabs(value_at(&m, i) - torch_average[0][i]) < 3e-7);
    }
    nn_optimizer_swap(m.optimizer);
    assert_true(fabs(value_at(&m, 3) - torch_values[STEPS - 1][3]) < 3e-7);
    destroy(&m);
}

/* Several stretches and odd ends. */
static void test_threads(void **state) {
    (void)state;
    model a = make(211, 317, &how_all, 1), b = make(211, 317, &how_all, 3);
    for (int step = 0; step < 3; step++) {
        set_gradients(&a, step, 3);
        set_gradients(&b, step, 3);
        nn_optimizer_step(a.optimizer, 0.01, 1, NULL);
        nn_optimizer_step(b.optimizer, 0.01, 1, NULL);
    }
    assert_memory_equal(a.weight->value, b.weight->value, a.weight->count * sizeof(float));
    destroy(&a);
    destroy(&b);
}

static void test_instruction_sets(void **state) {
    (void)state;
#if defined(__x86_64__)
    enum { N = 37 };
    float v[3][5][N];
    const core_cpu cpu = core_cpu_features();
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < N; i++) {
            v[k][0][i] = number(1, i), v[k][1][i] = number(2, i), v[k][2][i] = number(3, i);
            v[k][3][i] = fabsf(number(4, i)), v[k][4][i] = number(5, i);
        }
        const nn_adamw_row row = {v[k][0], v[k][1], v[k][2],  v[k][3], v[k][4],  0.7f,  0.999f, 0.9f,
                                  0.1f,    0.99f,   0.01f,    0.3f,    1e-8f,    0.02f, 0.9f,   0.1f};
        if (k == 0 || (k == 1 && cpu.avx2) || (k == 2 && cpu.avx512)) {
            (k == 0 ? nn_adamw_plain : k == 1 ? nn_adamw_avx2 : nn_adamw_avx512)(&row, N);
            assert_memory_equal(v[k], v[0], sizeof v[0]);
        }
    }
#endif
}

static void test_not_finite(void **state) {
    (void)state;
    model m = make(3, 5, &how_all, 1);
    nn_step_report report;
    const float bad[] = {NAN, INFINITY, -INFINITY};
    for (int i = 0; i < 3; i++) {
        set_gradients(&m, 0, 1);
        m.bias->grad[i] = bad[i];
        nn_optimizer_step(m.optimizer, 0.01, 1, &report);
        assert_true(report.skipped);
        assert_true(m.bias->grad[i] == 0 && m.weight->grad[2] == 0);
        assert_true(m.weight->value[4] == number(0, 4));
    }
    assert_int_equal(nn_optimizer_skipped(m.optimizer), 3);
    assert_int_equal(nn_optimizer_steps(m.optimizer), 0);
    set_gradients(&m, 0, 1e38f); /* finite, if very long: clipped, not skipped */
    nn_optimizer_step(m.optimizer, 0.01, 1, &report);
    assert_false(report.skipped);
    assert_true(isfinite(m.weight->value[4]) && m.weight->value[4] != number(0, 4));
    destroy(&m);
}

/* Stopped after two of four steps, in the middle of nothing, and gone on: the same bytes. */
static void test_resume(void **state) {
    (void)state;
    brace_error error = {0};
    model a = make(20, 30, &how_all, 2), b = make(20, 30, &how_all, 1), c = make(20, 30, &how_all, 1);
    for (int step = 0; step < 4; step++) {
        set_gradients(&a, step, 1);
        nn_optimizer_step(a.optimizer, 0.01, 1, NULL);
    }
    for (int step = 0; step < 2; step++) {
        set_gradients(&b, step, 1);
        nn_optimizer_step(b.optimizer, 0.01, 1, NULL);
    }
    test_ok(nn_optimizer_save(b.optimizer, path, (const char *const[]){"epoch", "7", NULL}, &error), &error);
    core_safetensors *file;
    test_ok(core_safetensors_open(&file, path, &error), &error);
    assert_string_equal(core_safetensors_metadata(file, "epoch"), "7");
    core_safetensors_close(file);
    test_ok(nn_optimizer_load(c.optimizer, path, &error), &error);
    assert_int_equal(nn_optimizer_steps(c.optimizer), 2);
    for (int step = 2; step < 4; step++) {
        set_gradients(&c, step, 1);
        nn_optimizer_step(c.optimizer, 0.01, 1, NULL);
    }
    assert_memory_equal(a.weight->value, c.weight->value, a.weight->count * sizeof(float));
    nn_optimizer_swap(a.optimizer);
    nn_optimizer_swap(c.optimizer);
    assert_memory_equal(a.weight->value, c.weight->value, a.weight->count * sizeof(float));
    assert_memory_equal(a.bias->value, c.bias->value, sizeof(float) * BIASES);
    destroy(&a);
    destroy(&b);
    destroy(&c);
}

static void refuse(model *m, brace_status expected, const char *text) {
    brace_error error = {0};
    assert_int_equal(nn_optimizer_load(m->optimizer, path, &error), expected);
    assert_non_null(strstr(error.message, text));
    assert_int_equal(nn_optimizer_steps(m->optimizer), 0);
    assert_true(m->weight->value[4] == number(0, 4) && m->bias->value[0] == number(0, (int)m->weight->count));
}

static void test_refused_states(void **state) {
    (void)state;
    brace_error error = {0};
    nn_adamw plain = how_all;
    plain.average = 0;
    model a = make(4, 6, &plain, 1), larger = make(4, 7, &plain, 1), averaged = make(4, 6, &how_all, 1);
    set_gradients(&a, 0, 1);
    nn_optimizer_step(a.optimizer, 0.01, 1, NULL);
    test_ok(nn_optimizer_save(a.optimizer, path, NULL, &error), &error);
    refuse(&larger, BRACE_ERROR_MISMATCH, "weights.w");
    refuse(&averaged, BRACE_ERROR_MISMATCH, "average.");
    test_ok(nn_weights_save(a.weights, path, "f32", NULL, &error), &error);
    refuse(&averaged, BRACE_ERROR_FORMAT, "no training state");
    const char *const counts[] = {"", "-1", "1x", "99999999999999999999"};
    for (size_t i = 0; i < 4; i++) {
        const char *const metadata[] = {"brace_training_state", "1", "brace_steps", counts[i], "brace_skipped_steps",
                                        "0", NULL};
        test_ok(nn_weights_save(a.weights, path, "f32", metadata, &error), &error);
        refuse(&averaged, BRACE_ERROR_FORMAT, "no training state");
    }
    const float good = a.bias->value[3]; /* the last array that is looked at */
    a.bias->value[3] = NAN;
    test_ok(nn_optimizer_save(a.optimizer, path, NULL, &error), &error);
    a.bias->value[3] = good;
    model same = make(4, 6, &plain, 1);
    refuse(&same, BRACE_ERROR_FORMAT, "damaged");
    assert_int_equal(nn_optimizer_save(a.optimizer, "/nonexistent/x.safetensors", NULL, &error), BRACE_ERROR_IO);
    destroy(&a);
    destroy(&larger);
    destroy(&averaged);
    destroy(&same);
}

static void test_refused_params(void **state) {
    (void)state;
    brace_error error = {0};
    nn_optimizer *o;
    model m = make(3, 5, &how_all, 1);
    const nn_adamw good = nn_adamw_defaults();
    nn_adamw bad[] = {good, good, good, good, good, good};
    bad[0].beta1 = 1, bad[1].beta2 = -0.1, bad[2].epsilon = NAN, bad[3].weight_decay = -1, bad[4].average = 1;
    bad[5].clip = NAN;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(nn_optimizer_create(&o, m.weights, &bad[i], NULL, &error), BRACE_ERROR_ARGUMENT);
        assert_null(o);
    }
    m.weight->frozen = m.bias->frozen = true;
    assert_int_equal(nn_optimizer_create(&o, m.weights, &good, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "nothing to train"));
    destroy(&m);
}

static void test_frozen(void **state) {
    (void)state;
    brace_error error = {0};
    nn_optimizer *o;
    model m = make(3, 5, &how_all, 1);
    const nn_adamw how = nn_adamw_defaults();
    m.bias->frozen = true;
    test_ok(nn_optimizer_create(&o, m.weights, &how, NULL, &error), &error);
    set_gradients(&m, 0, 1);
    nn_optimizer_step(o, 0.01, 1, NULL);
    assert_true(m.bias->value[0] == number(0, WEIGHTS) && m.weight->value[0] != number(0, 0));
    nn_optimizer_destroy(o);
    destroy(&m);
}

static void test_out_of_memory(void **state) {
    (void)state;
    brace_error error = {0};
    model m = make(3, 5, &how_all, 1);
    const brace_job job = {.threads = 1};
    for (int what = 0; what < 3; what++) { /* create, save, load */
        brace_status status = BRACE_ERROR_MEMORY;
        long n = 1;
        for (; n < 200 && status != BRACE_OK; n++) {
            nn_optimizer *o = NULL;
            core_alloc_fail_after(n);
            status = what == 0   ? nn_optimizer_create(&o, m.weights, &how_all, &job, &error)
                     : what == 1 ? nn_optimizer_save(m.optimizer, path, NULL, &error)
                                 : nn_optimizer_load(m.optimizer, path, &error);
            core_alloc_fail_after(0);
            nn_optimizer_destroy(o);
            assert_true(status == BRACE_OK || status == BRACE_ERROR_MEMORY);
        }
        assert_true(n > 3 && n < 200);
    }
    destroy(&m);
}

static void test_rates(void **state) {
    (void)state;
    nn_schedule s = {.kind = NN_RATE_COSINE, .rate = 2, .floor = 1, .warmup = 4, .steps = 104};
    assert_true(nn_schedule_rate(&s, 0) == 0.5 && nn_schedule_rate(&s, 3) == 2 && nn_schedule_rate(&s, 4) == 2);
    assert_true(fabs(nn_schedule_rate(&s, 54) - 1.5) < 1e-12);
    assert_true(nn_schedule_rate(&s, 104) == 1 && nn_schedule_rate(&s, UINT64_MAX) == 1);
    s.steps = 2; /* shorter than the warm-up */
    assert_true(nn_schedule_rate(&s, 4) == 1);
    s = (nn_schedule){.kind = NN_RATE_STEPS, .rate = 8, .factor = 0.5, .period = 10, .warmup = 1};
    assert_true(nn_schedule_rate(&s, 10) == 8 && nn_schedule_rate(&s, 11) == 4 && nn_schedule_rate(&s, 31) == 1);
    s.period = 0;
    assert_true(nn_schedule_rate(&s, 1000) == 8);
    s.kind = NN_RATE_CONSTANT;
    assert_true(nn_schedule_rate(&s, 1000) == 8);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_pytorch),        cmocka_unit_test(test_threads),
        cmocka_unit_test(test_instruction_sets), cmocka_unit_test(test_not_finite),
        cmocka_unit_test(test_resume),         cmocka_unit_test(test_refused_states),
        cmocka_unit_test(test_refused_params), cmocka_unit_test(test_frozen),
        cmocka_unit_test(test_out_of_memory),  cmocka_unit_test(test_rates),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
