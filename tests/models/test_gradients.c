/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_gradients.c: whole networks against central differences, in double: the slope of the loss when a parameter moves
 * along a random direction is its gradient times that direction. With parameters that are not zero where training
 * begins with zeros, and buffers filled with NaN as soon as they are dead.
 */
#include <math.h>
#include <string.h>

#include "models_test.h"

static double loss_of(test_network *n) {
    brace_error error = {0};
    test_ok(nn_forward(n->g, &error), &error);
    return *(const double *)nn_data(n->g, n->loss);
}

/* Parameters first to last move together. */
static double move_all(test_network *n, double **values, size_t first, size_t last, double step) {
    double slope = 0;
    for (size_t k = first; k < last; k++) {
        const nn_parameter *p = nn_weights_at(n->weights, k);
        for (size_t i = 0; i < p->count; i++) {
            const double along = test_number("direction", i + 97 * k);
            p->value64[i] = values[k][i] + step * along;
            slope += p->grad64[i] * along;
        }
    }
    return slope;
}

/* `together`: so many parameters at a time. */
static void check(const models_shape *shape, int h, int w, size_t together) {
    const double step = 1e-8; /* small, or activations bend on the way; sums are off by 1e-15 */
    brace_error error = {0};
    const brace_job job = {.threads = 2};
    test_network n;
    test_ok(test_network_build(&n, shape, h, w, &(nn_graph_params){.type = NN_F64, .job = &job, .poison = true}, true,
                               &error),
            &error);
    test_ok(nn_graph_plan(n.g, &(nn_plan_params){.loss = n.loss}, &error), &error);
    test_fill_weights(n.weights);
    test_fill_inputs(&n);
    assert_true(isfinite(loss_of(&n)));
    test_ok(nn_backward(n.g, 1, &error), &error);
    const size_t count = nn_weights_count(n.weights);
    double **values = core_calloc(count, sizeof *values);
    for (size_t k = 0; k < count; k++) {
        const nn_parameter *p = nn_weights_at(n.weights, k);
        values[k] = core_alloc(p->count, sizeof **values);
        memcpy(values[k], p->value64, p->count * sizeof **values);
    }
    for (size_t k = 0; k < count; k += together) {
        const size_t last = count - k < together ? count : k + together;
        const double slope = move_all(&n, values, k, last, step), above = loss_of(&n);
        move_all(&n, values, k, last, -step);
        const double difference = (above - loss_of(&n)) / (2 * step);
        move_all(&n, values, k, last, 0);
        if (!(fabs(slope - difference) <= 1e-5 * (0.1 + fabs(difference))) || slope == 0) {
            fail_msg("%s: the gradient says %.9g; differences say %.9g", nn_weights_at(n.weights, k)->name, slope,
                     difference);
        }
    }
    for (size_t k = 0; k < count; k++) {
        core_free(values[k]);
    }
    core_free((void *)values);
    test_network_destroy(&n);
}

static models_shape tiny(void) {
    models_shape s = test_shape();
    s.frames = 3;
    s.channels = 8;
    s.global = 1;
    return s;
}

static void test_spynet(void **state) {
    (void)state;
    models_shape s = tiny();
    s.frames = 2;
    s.spynet = true;
    check(&s, 6, 7, 20); /* two levels at a time */
}

static void test_tmrnet(void **state) {
    (void)state;
    models_shape s = tiny();
    check(&s, 5, 7, 1);
}

static void test_mscam(void **state) {
    (void)state;
    models_shape s = tiny();
    s.mscam = s.prior = true;
    s.strip = 3;
    check(&s, 5, 7, 1);
    s.prior = false;
    s.strip = 0;
    check(&s, 3, 4, 1);
}

static void test_blend(void **state) {
    (void)state;
    models_shape s = tiny();
    s.mscam = s.prior = s.blend = true;
    s.strip = 3;
    s.unshuffle = 2;
    s.groups = 0;
    check(&s, 8, 12, 1);
    s.guide = s.sigma = s.balance = true;
    check(&s, 8, 12, 1);
    s.gate = true;
    check(&s, 8, 12, 1);
    s = tiny();
    s.blend = true, s.unshuffle = 2;
    check(&s, 8, 6, 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_spynet), cmocka_unit_test(test_tmrnet),
                                       cmocka_unit_test(test_mscam), cmocka_unit_test(test_blend)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
