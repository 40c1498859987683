/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_vectors.c: operations and a small network, forward and backward, against what PyTorch computed
 * (make_vectors.py): f32 to 1e-5, and bf16 to the bounds stated below.
 */
#include "nn_test.h"

#include <math.h>
#include <string.h>

#include "core/safetensors.h"

static core_safetensors *file;

static const core_tensor *find(const char *name, const char *part) {
    char text[128];
    snprintf(text, sizeof text, "%s/%s", name, part);
    return core_safetensors_find(file, text);
}

/* Largest difference in units of 1 + the largest value. */
static void compare(const char *name, const char *part, const void *data, nn_type type, double bound) {
    const core_tensor *t = find(name, part);
    assert_non_null(t);
    const float *expected = t->data;
    double most = 0, largest = 0;
    for (size_t i = 0; i < t->size / 4; i++) {
        const double d = fabs(test_get(data, type, i) - (double)expected[i]);
        most = d > most || isnan(d) ? d : most; /* NaN stays */
        largest = fmax(largest, fabs((double)expected[i]));
    }
    if (!(most <= bound * (1 + largest))) {
        fail_msg("%s: %s differs by %g; the largest number is %g", name, part, most, largest);
    }
}

/* Parameters "CASE/p.NAME". */
static void give_parameters(nn_weights *weights, const char *name) {
    brace_error error = {0};
    for (size_t i = 0; i < core_safetensors_count(file); i++) {
        const core_tensor *t = core_safetensors_at(file, i);
        const size_t n = strlen(name);
        if (strncmp(t->name, name, n) == 0 && strncmp(t->name + n, "/p.", 3) == 0) {
            int shape[4] = {0};
            for (int k = 0; k < t->rank; k++) {
                shape[k] = (int)t->shape[k];
            }
            test_ok(nn_weights_give(weights, t->name + n + 3, t->rank, shape, t->data, &error), &error);
        }
    }
}

static bool starts(const char *text, const char *prefix) {
    return strncmp(text, prefix, strlen(prefix)) == 0;
}

static void test_case(const op_case *c, nn_type type, double bound, double gradient_bound) {
    if (find(c->name, "y") == NULL) {
        return;
    }
    brace_error error = {0};
    const brace_job job = {.threads = 2};
    nn_weights *weights = NULL;
    nn_graph *g = NULL;
    nn_value x[MOST_INPUTS], used[MOST_INPUTS];
    int inputs = 0;
    test_ok(nn_weights_create(&weights, 1, &error), &error);
    give_parameters(weights, c->name);
    test_ok(nn_graph_create(&g, weights, &(nn_graph_params){.type = type, .job = &job, .poison = true}, &error),
            &error);
    const bool first_only = starts(c->name, "warp") || starts(c->name, "deform") || starts(c->name, "network");
    for (; inputs < MOST_INPUTS && c->shape[inputs].n > 0; inputs++) {
        x[inputs] = nn_input_grad(g, "x", c->shape[inputs]);
        used[inputs] = inputs > 0 && first_only ? x[inputs] : nn_cast(g, x[inputs], type); /* flows, offsets stay f32 */
    }
    const nn_value y = c->build(g, used);
    nn_output(g, "y", y);
    const nn_shape s = nn_shape_of(g, y);
    float *r = core_alloc(nn_count(s), sizeof *r);
    for (size_t i = 0; i < nn_count(s); i++) {
        r[i] = (float)((double)((7919 * i + 13) % 101) / 101 - 0.3);
    }
    const nn_value loss = nn_sum(g, nn_mul(g, nn_cast(g, y, NN_F32), nn_constant(g, s, r)), true, true, true, true);
    core_free(r);
    test_ok(nn_graph_plan(g, &(nn_plan_params){.loss = loss}, &error), &error);
    for (int k = 0; k < inputs; k++) {
        char part[8];
        snprintf(part, sizeof part, "x%d", k);
        const core_tensor *t = find(c->name, part);
        assert_int_equal(t->size, nn_bytes(g, x[k]));
        memcpy(nn_data(g, x[k]), t->data, t->size);
    }
    test_ok(nn_forward(g, &error), &error);
    test_ok(nn_backward(g, 1, &error), &error);
    assert_int_equal(find(c->name, "y")->size / 4, nn_count(s));
    compare(c->name, "y", nn_data(g, y), nn_type_of(g, y), bound);
    for (int k = 0; k < inputs && gradient_bound > 0; k++) {
        char part[8];
        snprintf(part, sizeof part, "d%d", k);
        compare(c->name, part, nn_grad(g, x[k]), NN_F32, gradient_bound);
    }
    for (size_t i = 0; i < nn_weights_count(weights) && gradient_bound > 0; i++) {
        const nn_parameter *p = nn_weights_at(weights, i);
        char part[96];
        snprintf(part, sizeof part, "g.%s", p->name);
        compare(c->name, part, p->grad, NN_F32, gradient_bound);
    }
    nn_graph_destroy(g);
    nn_weights_destroy(weights);
}

static void test_f32(void **state) {
    (void)state;
    size_t compared = 0;
    for (size_t i = 0; i < op_case_count; i++) {
        test_case(&op_cases[i], NN_F32, 1e-5, 1e-5);
        compared += find(op_cases[i].name, "y") != NULL;
    }
    assert_int_equal(compared, 72);
}

/* bf16 has eight bits: a number is off by 2^-9 at most, a sum or function of some rounded numbers by a few times that.
 * Where rounding changes an order or a sign (sort, maximum, |x|, clamp, the leaky one of conv_3), single gradients go
 * elsewhere; not compared. Results to 0.012 of 1 + the largest number, gradients, which meet the kinks of activations,
 * to 0.03; the network 0.04. */
static void test_bf16(void **state) {
    (void)state;
    const char *const jumps[] = {"sort", "max_pool", "l1", "abs", "clamp", "conv_3"};
    for (size_t i = 0; i < op_case_count; i++) {
        bool jump = false;
        for (size_t k = 0; k < sizeof jumps / sizeof jumps[0]; k++) {
            jump |= starts(op_cases[i].name, jumps[k]);
        }
        const double bound = starts(op_cases[i].name, "network") ? 0.04 : 0.012;
        test_case(&op_cases[i], NN_BF16, bound, jump ? 0 : fmax(bound, 0.03));
    }
}

static int setup(void **state) {
    (void)state;
    brace_error error = {0};
    return core_safetensors_open(&file, NN_VECTORS, &error) == BRACE_OK ? 0 : -1;
}

static int teardown(void **state) {
    (void)state;
    core_safetensors_close(file);
    return 0;
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_f32), cmocka_unit_test(test_bf16)};
    return cmocka_run_group_tests(tests, setup, teardown);
}
