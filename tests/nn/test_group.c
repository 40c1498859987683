/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_group.c: processes that train together. Alone: nothing changes. With MPI (the argument "mpi", started by
 * mpirun): sums in the order of the ranks, bit by bit; what rank 0 has is sent to all; and a network trained by n
 * processes on one sample each becomes what one process makes of it with n samples at once.
 */
#include "nn_test.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "nn/group.h"
#include "nn/optimizer.h"

static nn_group *group;
enum { SIZE = 12 };

/* ---- sums ---- */

static float term(int rank, size_t i) {
    return (float)test_number(9, (uint32_t)rank, i, -1, 1) * (i % 3 == 0 ? 1e6f : 1);
}

static void test_sums(void **state) {
    (void)state;
    brace_error error = {0};
    const size_t counts[] = {0, 1, 2, 1000, NN_GROUP_CHUNK + 3};
    for (size_t k = 0; k < sizeof counts / sizeof *counts; k++) {
        float *v = core_alloc(counts[k] + 1, sizeof *v);
        assert_non_null(v);
        for (size_t i = 0; i <= counts[k]; i++) {
            v[i] = term(nn_group_rank(group), i);
        }
        test_ok(nn_group_sum(group, v, counts[k], &error), &error);
        for (size_t i = 0; i < counts[k]; i++) {
            float sum = term(0, i);
            for (int r = 1; r < nn_group_size(group); r++) {
                sum += term(r, i);
            }
            assert_true(v[i] == sum);
        }
        assert_true(v[counts[k]] == term(nn_group_rank(group), counts[k]));
        core_free(v);
    }
}

static void test_share(void **state) {
    (void)state;
    brace_error error = {0};
    char text[16];
    snprintf(text, sizeof text, "from %d", nn_group_rank(group));
    test_ok(nn_group_share(group, text, sizeof text, &error), &error);
    assert_string_equal(text, "from 0");
    test_ok(nn_group_wait(group, &error), &error);
}

/* ---- a network ---- */

typedef struct model {
    nn_weights *weights;
    nn_graph *g;
    nn_value x, target, loss;
    nn_optimizer *optimizer;
} model;

static model make(int batch, uint64_t seed, int channels) {
    model m = {0};
    brace_error error = {0};
    const brace_job job = {.threads = 1};
    nn_adamw how = nn_adamw_defaults();
    how.epsilon = 1e-3; /* tames the quotient of two gradients that are both next to nothing */
    how.clip = 0.5;
    test_ok(nn_weights_create(&m.weights, seed, &error), &error);
    test_ok(nn_graph_create(&m.g, m.weights, &(nn_graph_params){.job = &job}, &error), &error);
    m.x = nn_input(m.g, "x", (nn_shape){batch, SIZE, SIZE, 3});
    m.target = nn_input(m.g, "target", (nn_shape){batch, SIZE, SIZE, 3});
    nn_value y = nn_conv2d(m.g, m.x, &(nn_conv){.name = "a", .out = channels, .kernel = 3, .pad = 1,
                                                .activation = NN_LEAKY_RELU});
    y = nn_conv2d(m.g, y, &(nn_conv){.name = "b", .out = 3, .kernel = 3, .pad = 1, .residual = m.x});
    m.loss = nn_l1(m.g, y, m.target);
    test_ok(nn_graph_plan(m.g, &(nn_plan_params){.loss = m.loss}, &error), &error);
    test_ok(nn_optimizer_create(&m.optimizer, m.weights, &how, &job, &error), &error);
    return m;
}

static void destroy(model *m) {
    nn_optimizer_destroy(m->optimizer);
    nn_graph_destroy(m->g);
    nn_weights_destroy(m->weights);
}

/* Samples first, first + 1, ... of a step. */
static void run(model *m, int step, int first, int batch) {
    brace_error error = {0};
    const size_t count = (size_t)SIZE * SIZE * 3;
    for (int i = 0; i < batch; i++) {
        for (size_t k = 0; k < count; k++) {
            const uint32_t sample = (uint32_t)(100 * step + first + i);
            ((float *)nn_data(m->g, m->x))[(size_t)i * count + k] = (float)test_number(1, sample, k, 0, 1);
            ((float *)nn_data(m->g, m->target))[(size_t)i * count + k] = (float)test_number(2, sample, k, 0, 1);
        }
    }
    test_ok(nn_forward(m->g, &error), &error);
    test_ok(nn_backward(m->g, 1, &error), &error);
}

static void test_training(void **state) {
    (void)state;
    brace_error error = {0};
    const int n = nn_group_size(group), rank = nn_group_rank(group);
    /* Every rank begins elsewhere, and gets rank 0's weights; `one` is what a single process does. */
    model mine = make(1, 50 + (uint64_t)rank, 8), one = make(n, 50, 8);
    test_ok(nn_group_share_weights(group, mine.weights, &error), &error);
    for (int step = 0; step < 4; step++) {
        run(&mine, step, rank, 1);
        run(&one, step, 0, n);
        test_ok(nn_group_sum_gradients(group, mine.weights, &error), &error);
        nn_optimizer_step(mine.optimizer, 0.01, 1.0 / n, NULL);
        nn_optimizer_step(one.optimizer, 0.01, 1, NULL);
    }
    for (size_t i = 0; i < nn_weights_count(mine.weights); i++) {
        const nn_parameter *p = nn_weights_at(mine.weights, i), *q = nn_weights_find(one.weights, p->name);
        assert_non_null(q);
        float *first = core_alloc(p->count, sizeof *first);
        assert_non_null(first);
        memcpy(first, p->value, p->count * sizeof *first);
        test_ok(nn_group_share(group, first, p->count * sizeof *first, &error), &error);
        assert_memory_equal(first, p->value, p->count * sizeof *first); /* the ranks do not drift apart */
        for (size_t k = 0; k < p->count; k++) {
            assert_true(fabsf(p->value[k] - q->value[k]) < 1e-5f);
        }
        core_free(first);
    }
    destroy(&mine);
    destroy(&one);
}

static void test_other_network(void **state) {
    (void)state;
    brace_error error = {0};
    const int n = nn_group_size(group);
    model m = make(1, 1, nn_group_rank(group) == n - 1 ? 9 : 8); /* the last rank's is larger */
    run(&m, 0, 0, 1);
    const brace_status expected = n > 1 ? BRACE_ERROR_MISMATCH : BRACE_OK;
    assert_int_equal(nn_group_share_weights(group, m.weights, &error), expected);
    assert_int_equal(nn_group_sum_gradients(group, m.weights, &error), expected);
    assert_true(n == 1 || strstr(error.message, "same network") != NULL);
    destroy(&m);
}

int main(int argc, char **argv) {
    brace_error error = {0};
    brace_status status = BRACE_OK;
    if (argc > 1 && strcmp(argv[1], "mpi") == 0) {
#ifdef NN_HAVE_MPI
        status = nn_group_mpi(&group, &error);
        if (status == BRACE_OK && (argc < 3 || nn_group_size(group) != atoi(argv[2]))) {
            fprintf(stderr, "the group has %d processes\n", nn_group_size(group));
            return 1;
        }
#else
        return 77;
#endif
    } else {
        status = nn_group_alone(&group, &error);
    }
    if (status != BRACE_OK) {
        fprintf(stderr, "%s\n", error.message);
        return 1;
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sums),
        cmocka_unit_test(test_share),
        cmocka_unit_test(test_training),
        cmocka_unit_test(test_other_network),
    };
    int failures = cmocka_run_group_tests(tests, NULL, NULL);
    nn_group_destroy(group);
    return failures;
}
