/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_gradients.c: every operation's gradients, of inputs and parameters, against
 * central differences in double precision, with buffers filled with NaN as soon as
 * they are dead.
 */
#include "nn_test.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct built {
    nn_weights *weights;
    nn_graph *g;
    nn_value x[MOST_INPUTS], y, loss;
    int inputs;
} built;

/* loss = sum of y times random numbers, so that no symmetry hides a mistake. */
static void build(built *b, const op_case *c, nn_type type) {
    brace_error error = {0};
    const brace_job job = {.threads = 2};
    test_ok(nn_weights_create(&b->weights, 11, &error), &error);
    test_ok(nn_graph_create(&b->g, b->weights, &(nn_graph_params){.type = type, .job = &job, .poison = true}, &error),
            &error);
    b->inputs = 0;
    for (int i = 0; i < MOST_INPUTS && c->shape[i].n > 0; i++) {
        char name[8];
        snprintf(name, sizeof name, "x%d", i);
        b->x[b->inputs++] = nn_input_grad(b->g, name, c->shape[i]);
    }
    b->y = c->build(b->g, b->x);
    test_ok(nn_graph_error(b->g, &error), &error);
    const nn_shape s = nn_shape_of(b->g, b->y);
    float *numbers = core_alloc(nn_count(s), sizeof *numbers);
    for (size_t i = 0; i < nn_count(s); i++) {
        numbers[i] = (float)test_number(3, 99, i, 0.5, 1.5) * (i % 3 == 0 ? -1.0f : 1.0f);
    }
    b->loss = nn_sum(b->g, nn_mul(b->g, b->y, nn_constant(b->g, s, numbers)), true, true, true, true);
    core_free(numbers);
    test_ok(nn_graph_plan(b->g, &(nn_plan_params){.loss = b->loss}, &error), &error);
    for (int i = 0; i < b->inputs; i++) {
        test_fill(b->g, b->x[i], 5, (uint32_t)i, c->low, c->high);
    }
}

static double loss_of(built *b) {
    brace_error error = {0};
    test_ok(nn_forward(b->g, &error), &error);
    return test_get(nn_data(b->g, b->loss), NN_F64, 0);
}

static void check(built *b, const op_case *c, const char *what, double *number, double gradient, size_t i) {
    const double step = 1e-5, old = *number;
    *number = old + step;
    const double above = loss_of(b);
    *number = old - step;
    const double below = loss_of(b);
    *number = old;
    const double expected = (above - below) / (2 * step);
    if (!(fabs(gradient - expected) <= 1e-6 * (1 + fabs(expected)))) {
        fail_msg("%s: d loss/d %s[%zu] is %.10g; differences say %.10g", c->name, what, i, gradient, expected);
    }
}

static void test_case(const op_case *c) {
    brace_error error = {0};
    built b;
    build(&b, c, NN_F64);
    assert_true(isfinite(loss_of(&b)));
    test_ok(nn_backward(b.g, 1, &error), &error);
    assert_int_equal(nn_backward(b.g, 1, &error), BRACE_ERROR_ARGUMENT); /* once a forward pass */
    double *gradient[MOST_INPUTS];
    for (int k = 0; k < b.inputs; k++) {
        const size_t bytes = nn_bytes(b.g, b.x[k]);
        assert_non_null(nn_grad(b.g, b.x[k]));
        gradient[k] = core_alloc(bytes, 1);
        memcpy(gradient[k], nn_grad(b.g, b.x[k]), bytes);
    }
    for (int k = 0; k < b.inputs; k++) {
        double *x = nn_data(b.g, b.x[k]);
        for (size_t i = 0; i < nn_count(c->shape[k]); i++) {
            check(&b, c, "input", &x[i], gradient[k][i], i);
        }
        core_free(gradient[k]);
    }
    for (size_t k = 0; k < nn_weights_count(b.weights); k++) {
        nn_parameter *p = nn_weights_at(b.weights, k);
        for (size_t i = 0; i < p->count; i += 1 + p->count / 100) {
            check(&b, c, p->name, &p->value64[i], p->grad64[i], i);
        }
    }
    nn_graph_destroy(b.g);
    nn_weights_destroy(b.weights);
}

static void test_every_operation(void **state) {
    (void)state;
    for (size_t i = 0; i < op_case_count; i++) {
        test_case(&op_cases[i]);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_every_operation)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
