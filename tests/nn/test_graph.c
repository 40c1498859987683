/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_graph.c: the plan: random graphs give the same bytes whether buffers share
 * memory or not, whether segments are recomputed or kept, and on any number of
 * threads; building and planning survive every lack of memory; errors name the layer.
 */
#include "nn_test.h"

#include <math.h>
#include <string.h>

/* ---- random graphs ---- */

typedef struct variant {
    bool separate, recompute, training;
    int threads;
    nn_type type;
} variant;

typedef struct result {
    unsigned char *bytes; /* outputs, gradients */
    size_t size, memory;
} result;

enum { STEPS = 24, CONVOLUTIONS = 3 };

static void keep(result *r, const void *data, size_t size) {
    unsigned char *bytes = core_alloc(r->size + size, 1);
    assert_non_null(bytes);
    if (r->bytes != NULL) {
        memcpy(bytes, r->bytes, r->size);
    }
    memcpy(bytes + r->size, data, size);
    core_free(r->bytes);
    r->bytes = bytes;
    r->size += size;
}

static const nn_shape common = {2, 6, 8, 4};

/* Each step makes one more value of the common shape from those before. */
static nn_value random_step(nn_graph *g, core_random *r, const nn_value *v, int count, int step) {
    const int recent = count < 5 ? count : 5; /* long chains rather than many short ones */
    const nn_value a = v[count - 1 - (int)core_random_below(r, (uint32_t)recent)],
                   b = v[core_random_below(r, (uint32_t)count)];
    const nn_shape flat = {1, 4, 16, 6};
    nn_value parts[2];
    switch (core_random_below(r, 17)) {
    case 0:
        return nn_add(g, a, b);
    case 1:
        return nn_sub(g, a, nn_affine(g, b, 0.5, 0));
    case 2:
        return nn_mul(g, a, nn_activate(g, b, NN_SIGMOID));
    case 3:
        return nn_activate(g, a, NN_TANH);
    case 4:
        return nn_activate(g, a, NN_RELU);
    case 5:
        return nn_activate(g, nn_activate(g, a, NN_LEAKY_RELU), NN_TANH);
    case 6:
        return nn_softmax(g, a);
    case 7:
        return nn_reshape(g, nn_activate(g, nn_reshape(g, a, flat), NN_SIGMOID), common);
    case 8:
        return nn_add(g, nn_reshape(g, nn_reshape(g, a, flat), common), nn_reshape(g, nn_reshape(g, b, flat), common));
    case 9:
        parts[0] = nn_slice(g, a, NN_AXIS_C, 0, 4, 2);
        parts[1] = nn_slice(g, b, NN_AXIS_C, 1, 4, 2);
        return nn_concat(g, NN_AXIS_C, 2, parts);
    case 10:
        return nn_sub(g, a, nn_mean(g, a, false, true, true, false));
    case 11:
        return nn_mul(g, nn_var(g, a, true, false, false, false), b);
    case 12:
        return nn_sort(g, nn_flip(g, a, NN_AXIS_H), NN_AXIS_W);
    case 13:
        return nn_resize(g, nn_max_pool(g, a, 3, 2, true), 6, 8, false);
    case 14:
        return nn_mul(g, a, nn_param(g, "scale", (nn_shape){1, 1, 1, 4}, 1, (const int[]){4}, NN_INIT_ONE));
    case 15:
        return nn_warp(g, a,
                       nn_cast(g, nn_slice(g, b, NN_AXIS_C, 0, 2, 1), nn_type_of(g, a) == NN_F64 ? NN_F64 : NN_F32),
                       NN_ZERO);
    default:
        (void)step;
        return nn_conv2d(g, a,
                         &(nn_conv){.name = "conv",
                                    .out = 4,
                                    .kernel = 3,
                                    .pad = 1,
                                    .residual = b,
                                    .activation = NN_LEAKY_RELU,
                                    .init = NN_INIT_HE_FAN_IN_TENTH});
    }
}

static result run_random(uint64_t seed, const variant *v) {
    brace_error error = {0};
    const brace_job job = {.threads = v->threads};
    core_random r = core_random_create(seed, 1, 2, 3);
    nn_weights *weights = NULL;
    nn_graph *g = NULL;
    result out = {NULL, 0, 0};
    test_ok(nn_weights_create(&weights, 1, &error), &error);
    test_ok(nn_graph_create(
                &g, weights,
                &(nn_graph_params){
                    .type = v->type, .backend = NN_REF, .job = &job, .separate = v->separate, .poison = !v->separate},
                &error),
            &error);
    const nn_value x = nn_input_grad(g, "x", common), z = nn_input(g, "z", common);
    nn_value values[STEPS + 2] = {nn_cast(g, x, v->type), nn_cast(g, z, v->type)};
    int count = 2, from = 0; /* inside a segment values before it are used too */
    bool inside = false;
    for (int i = 0; i < STEPS; i++) {
        if (core_random_below(&r, 5) == 0) {
            if (v->recompute && inside) {
                nn_recompute_end(g);
            } else if (v->recompute) {
                nn_recompute_begin(g);
            }
            inside = !inside;
        }
        nn_push(g, "step%d", i);
        values[count] = random_step(g, &r, values + from, count - from, i);
        count++;
        nn_pop(g);
    }
    if (inside && v->recompute) {
        nn_recompute_end(g);
    }
    const nn_value y = values[count - 1], second = values[count / 2];
    nn_output(g, "y", y);
    nn_output(g, "second", second);
    const nn_value both = nn_cast(g, nn_add(g, nn_add(g, y, second), values[0]), v->type == NN_F64 ? NN_F64 : NN_F32);
    const nn_value loss = nn_mean(g, nn_mul(g, both, both), true, true, true, true);
    nn_output(g, "loss", loss);
    test_ok(nn_graph_plan(g, v->training ? &(nn_plan_params){.loss = loss} : NULL, &error), &error);
    test_fill(g, x, seed, 1, -1, 1);
    test_fill(g, z, seed, 2, -1, 1);
    for (int again = 0; again < 2; again++) { /* inputs stay, and nothing is left over from the first time */
        test_ok(nn_forward(g, &error), &error);
        keep(&out, nn_data(g, y), nn_bytes(g, y));
        keep(&out, nn_data(g, second), nn_bytes(g, second));
        keep(&out, nn_data(g, loss), nn_bytes(g, loss));
        if (v->training) {
            test_ok(nn_backward(g, 1, &error), &error);
            keep(&out, nn_data(g, y), nn_bytes(g, y)); /* outputs stay too */
            if (nn_grad(g, x) != NULL) {
                keep(&out, nn_grad(g, x), nn_bytes(g, x));
            }
        }
    }
    for (size_t i = 0; i < nn_weights_count(weights) && v->training; i++) {
        const nn_parameter *p = nn_weights_at(weights, i);
        if (p->grad != NULL) {
            keep(&out, p->grad, p->count * sizeof *p->grad);
        }
    }
    for (size_t i = 0; i < nn_count(common); i++) {
        assert_true(isfinite(test_get(nn_data(g, y), nn_type_of(g, y), i)));
    }
    out.memory = nn_graph_memory(g);
    nn_graph_destroy(g);
    nn_weights_destroy(weights);
    return out;
}

static void compare(uint64_t seed, const variant *a, const variant *b, const char *what) {
    result x = run_random(seed, a), y = run_random(seed, b);
    if (x.size != y.size || memcmp(x.bytes, y.bytes, x.size) != 0) {
        fail_msg("random graph %llu: %s changes the result", (unsigned long long)seed, what);
    }
    core_free(x.bytes);
    core_free(y.bytes);
}

static void test_sharing_memory(void **state) {
    (void)state;
    size_t shared = 0, apart = 0;
    for (uint64_t seed = 0; seed < 150; seed++) {
        const nn_type type = seed % 3 == 2 ? NN_BF16 : NN_F32;
        const variant a = {false, seed % 2 == 1, true, 1, type}, b = {true, seed % 2 == 1, true, 1, type};
        result x = run_random(seed, &a), y = run_random(seed, &b);
        if (x.size != y.size || memcmp(x.bytes, y.bytes, x.size) != 0) {
            fail_msg("random graph %llu: sharing memory changes the result", (unsigned long long)seed);
        }
        shared += x.memory;
        apart += y.memory;
        core_free(x.bytes);
        core_free(y.bytes);
        const variant c = {false, false, false, 1, type}, d = {true, false, false, 1, type};
        compare(seed, &c, &d, "sharing memory without training");
    }
    assert_true(shared * 2 < apart);
}

static void test_recomputing(void **state) {
    (void)state;
    for (uint64_t seed = 200; seed < 300; seed++) {
        const nn_type type = seed % 3 == 2 ? NN_BF16 : NN_F32;
        compare(seed, &(variant){false, true, true, 1, type}, &(variant){false, false, true, 1, type}, "recomputing");
    }
}

static void test_threads(void **state) {
    (void)state;
    for (uint64_t seed = 300; seed < 330; seed++) {
        const nn_type type = seed % 3 == 2 ? NN_BF16 : NN_F32;
        compare(seed, &(variant){false, true, true, 1, type}, &(variant){false, true, true, 3, type}, "threads");
        compare(seed, &(variant){false, true, true, 3, type}, &(variant){false, true, true, 3, type}, "a second run");
    }
}

/* ---- memory ---- */

static size_t stack_memory(bool training, bool recompute, int blocks) {
    brace_error error = {0};
    const brace_job job = {.threads = 1};
    nn_weights *weights = NULL;
    nn_graph *g = NULL;
    test_ok(nn_weights_create(&weights, 1, &error), &error);
    test_ok(nn_graph_create(&g, weights, &(nn_graph_params){.job = &job, .backend = NN_REF}, &error), &error);
    nn_value x = nn_input(g, "x", (nn_shape){1, 64, 64, 8});
    const nn_value scale = nn_param(g, "scale", (nn_shape){1, 1, 1, 8}, 1, (const int[]){8}, NN_INIT_ONE);
    for (int i = 0; i < blocks; i++) {
        if (recompute) {
            nn_recompute_begin(g);
        }
        for (int k = 0; k < 4; k++) {
            x = nn_activate(g, nn_mul(g, x, scale), NN_TANH);
        }
        if (recompute) {
            nn_recompute_end(g);
        }
    }
    const nn_value loss = nn_mean(g, x, true, true, true, true);
    nn_output(g, "loss", loss);
    test_ok(nn_graph_plan(g, &(nn_plan_params){.loss = training ? loss : 0}, &error), &error);
    const size_t memory = nn_graph_memory(g);
    nn_graph_destroy(g);
    nn_weights_destroy(weights);
    return memory;
}

static void test_memory(void **state) {
    (void)state;
    const size_t one = (size_t)64 * 64 * 8 * 4;
    /* In place: the input, which stays, one more, and the sum's partial sums. */
    assert_true(stack_memory(false, false, 8) < 2 * one + one / 4);
    /* Kept for the way back: 8 x 4 values (tanh in place); recomputed: one a block, those of one block, gradients. */
    assert_true(stack_memory(true, false, 8) > 32 * one);
    assert_true(stack_memory(true, true, 8) < (1 + 8 + 3 + 3) * one);
}

/* ---- out of memory ---- */

static brace_status build_and_plan(const op_case *c, nn_type type, brace_error *error) {
    const brace_job job = {.threads = 2};
    nn_weights *weights = NULL;
    nn_graph *g = NULL;
    brace_status status = nn_weights_create(&weights, 11, error);
    if (status != BRACE_OK) {
        return status;
    }
    status = nn_graph_create(&g, weights, &(nn_graph_params){.type = type, .job = &job}, error);
    if (status == BRACE_OK) {
        nn_value x[MOST_INPUTS];
        nn_push(g, "layer");
        const bool segments = strcmp(c->name, "network") == 0; /* has its own */
        if (!segments) {
            nn_recompute_begin(g);
        }
        for (int i = 0; i < MOST_INPUTS && c->shape[i].n > 0; i++) {
            x[i] = nn_input_grad(g, "x", c->shape[i]);
        }
        const nn_value y = c->build(g, x);
        if (!segments) {
            nn_recompute_end(g);
        }
        const nn_value loss = nn_mean(g, nn_mul(g, y, y), true, true, true, true);
        nn_output(g, "y", y);
        nn_pop(g);
        status = nn_graph_plan(g, &(nn_plan_params){.loss = loss}, error);
    }
    nn_graph_destroy(g);
    nn_weights_destroy(weights);
    return status;
}

static void test_out_of_memory(void **state) {
    (void)state;
    for (size_t i = 0; i < op_case_count; i++) {
        long n = 1;
        for (;; n++) {
            brace_error error = {0};
            core_alloc_fail_after(n);
            const brace_status status = build_and_plan(&op_cases[i], NN_F32, &error);
            core_alloc_fail_after(0);
            if (status == BRACE_OK) {
                break;
            }
            if (status != BRACE_ERROR_MEMORY || error.status != status || error.message[0] == '\0') {
                fail_msg("%s, allocation %ld: status %d, \"%s\"", op_cases[i].name, n, (int)status, error.message);
            }
        }
        assert_true(n > 8);
    }
}

/* ---- errors ---- */

typedef struct fixture {
    nn_weights *weights;
    nn_graph *g;
} fixture;

static fixture make(void) {
    fixture f = {NULL, NULL};
    brace_error error = {0};
    const brace_job job = {.threads = 1};
    test_ok(nn_weights_create(&f.weights, 1, &error), &error);
    test_ok(nn_graph_create(&f.g, f.weights, &(nn_graph_params){.job = &job}, &error), &error);
    return f;
}

static void expect_error(fixture *f, nn_value loss, const char *text) {
    brace_error error = {0};
    assert_int_equal(nn_graph_plan(f->g, &(nn_plan_params){.loss = loss}, &error), BRACE_ERROR_ARGUMENT);
    if (strstr(error.message, text) == NULL) {
        fail_msg("\"%s\" does not say \"%s\"", error.message, text);
    }
    assert_int_equal(nn_forward(f->g, &error), BRACE_ERROR_ARGUMENT); /* and nothing crashes afterwards */
    assert_int_equal(nn_backward(f->g, 1, &error), BRACE_ERROR_ARGUMENT);
    nn_graph_destroy(f->g);
    nn_weights_destroy(f->weights);
}

static void test_errors_name_the_layer(void **state) {
    (void)state;
    fixture f = make();
    const nn_value x = nn_input(f.g, "x", (nn_shape){1, 4, 4, 3}), z = nn_input(f.g, "z", (nn_shape){1, 4, 5, 3});
    nn_push(f.g, "backbone");
    nn_push(f.g, "main.%d", 2);
    assert_int_equal(nn_add(f.g, x, z), 0);
    nn_pop(f.g);
    nn_push(f.g, "later");
    assert_int_equal(nn_activate(f.g, x, NN_RELU), 0); /* sticky */
    assert_int_equal(nn_reshape(f.g, x, (nn_shape){7, 1, 1, 1}), 0);
    expect_error(&f, 0, "backbone.main.2: add: tensors of 1 x 4 x 4 x 3 and 1 x 4 x 5 x 3 do not fit");
}

static nn_value make_bad(nn_graph *g, nn_value x, int which) {
    const nn_shape s = {1, 4, 6, 3};
    switch (which) {
    case 0:
        return nn_reshape(g, x, (nn_shape){1, 4, 6, 4});
    case 1:
        return nn_slice(g, x, NN_AXIS_C, 1, 4, 1);
    case 2:
        return nn_slice(g, x, NN_AXIS_C, 1, 1, 1);
    case 3:
        return nn_concat(g, NN_AXIS_C, 0, &x);
    case 4:
        return nn_concat(g, NN_AXIS_C, 2, (const nn_value[]){x, nn_input(g, "y", (nn_shape){1, 4, 5, 3})});
    case 5:
        return nn_permute(g, x, (const nn_axis[]){NN_AXIS_C, NN_AXIS_C, NN_AXIS_W, NN_AXIS_H});
    case 6:
        return nn_pad(g, x, 4, 0, 0, 0, NN_REFLECT);
    case 7:
        return nn_pixel_shuffle(g, x, 2);
    case 8:
        return nn_pixel_unshuffle(g, x, 4);
    case 9:
        return nn_average_pool(g, x, 5, 2);
    case 10:
        return nn_max_pool(g, x, 2, 0, false);
    case 11:
        return nn_resize(g, x, 0, 3, false);
    case 12:
        return nn_warp(g, x, x, NN_ZERO);
    case 13:
        return nn_warp(g, x, nn_input(g, "f", (nn_shape){1, 4, 6, 2}), NN_REFLECT);
    case 14:
        return nn_l1(g, x, nn_input(g, "f", (nn_shape){1, 4, 6, 2}));
    case 15:
        return nn_haar(g, nn_input(g, "f", (nn_shape){1, 3, 6, 2}));
    case 16:
        return nn_add(g, x, 99);
    case 17:
        return nn_add(g, x, 0);
    case 18:
        return nn_repeat(g, x, NN_AXIS_N, 0);
    case 19:
        return nn_input(g, "huge", (nn_shape){1 << 30, 1 << 30, 1 << 30, 1 << 30});
    case 20:
        return nn_clamp(g, x, 1, 0);
    case 21:
        return nn_repeat(g, nn_input(g, "large", (nn_shape){1, 1 << 20, 1 << 20, 1}), NN_AXIS_N, 1 << 30);
    case 22:
        return nn_constant(g, (nn_shape){0, 1, 1, 1}, NULL);
    case 23:
        return nn_param(g, "p", s, 1, (const int[]){71}, NN_INIT_ZERO);
    case 24:
        return nn_deform_conv2d(
            g, x, x, x,
            &(nn_deform){.name = "d", .out = 3, .pad = 1, .dilation = 1, .offset_groups = 1, .weight_groups = 1});
    case 25:
        return nn_conv2d(g, x, &(nn_conv){.name = "c", .out = 0, .kernel = 3});
    default:
        return nn_matmul(g, x, x, false, 1);
    }
}

static void test_bad_shapes(void **state) {
    (void)state;
    for (int i = 0; i <= 26; i++) {
        fixture f = make();
        nn_push(f.g, "layer%d", i);
        char scope[32];
        snprintf(scope, sizeof scope, "layer%d: ", i);
        const nn_value x = nn_input(f.g, "x", (nn_shape){1, 4, 6, 3});
        if (make_bad(f.g, x, i) != 0) {
            fail_msg("bad case %d was accepted", i);
        }
        expect_error(&f, 0, scope);
    }
}

static void test_bad_plans(void **state) {
    (void)state;
    fixture f = make();
    nn_input(f.g, "x", (nn_shape){1, 1, 1, 1});
    expect_error(&f, 0, "no output");

    f = make();
    nn_value x = nn_input(f.g, "x", (nn_shape){1, 1, 2, 1});
    expect_error(&f, nn_activate(f.g, x, NN_TANH), "one number");

    f = make();
    x = nn_input(f.g, "x", (nn_shape){1, 1, 2, 1});
    expect_error(&f, nn_sum(f.g, x, true, true, true, true), "no parameter");

    f = make();
    nn_push(f.g, "left");
    x = nn_input(f.g, "x", (nn_shape){1, 1, 2, 1});
    expect_error(&f, 0, "not left");

    f = make();
    nn_pop(f.g);
    expect_error(&f, 0, "not entered");

    f = make();
    nn_recompute_begin(f.g);
    nn_recompute_begin(f.g);
    expect_error(&f, 0, "nested");

    f = make();
    for (int i = 0; i < 100; i++) {
        nn_push(f.g, "deep%d", i);
    }
    for (int i = 0; i < 100; i++) {
        nn_pop(f.g);
    }
    expect_error(&f, 0, "too deep");

    f = make();
    nn_param(f.g, "w", (nn_shape){1, 1, 1, 2}, 1, (const int[]){2}, NN_INIT_ONE);
    nn_param(f.g, "w", (nn_shape){1, 1, 1, 3}, 1, (const int[]){3}, NN_INIT_ONE);
    expect_error(&f, 0, "w is 2 already, and 3 here");
}

static void test_cancel(void **state) {
    (void)state;
    brace_error error = {0};
    volatile int cancel = 0;
    const brace_job job = {.threads = 1, .cancel = &cancel};
    nn_weights *weights = NULL;
    nn_graph *g = NULL;
    test_ok(nn_weights_create(&weights, 1, &error), &error);
    test_ok(nn_graph_create(&g, weights, &(nn_graph_params){.job = &job}, &error), &error);
    const nn_value x = nn_input(g, "x", (nn_shape){1, 1, 4, 1}), y = nn_affine(g, x, 2, 1);
    nn_output(g, "y", y);
    assert_null(nn_data(g, y));
    test_ok(nn_graph_plan(g, NULL, &error), &error);
    test_fill(g, x, 1, 1, 0, 1);
    cancel = 1;
    assert_int_equal(nn_forward(g, &error), BRACE_ERROR_CANCELLED);
    assert_int_equal(nn_backward(g, 1, &error), BRACE_ERROR_ARGUMENT);
    cancel = 0;
    test_ok(nn_forward(g, &error), &error);
    assert_float_equal(((float *)nn_data(g, y))[1], 2 * ((float *)nn_data(g, x))[1] + 1, 0);
    assert_int_equal(nn_affine(g, x, 1, 0), 0); /* planned: nothing more */
    FILE *out = tmpfile();
    assert_non_null(out);
    nn_graph_print(g, out);
    rewind(out);
    char line[256];
    bool found = false;
    while (fgets(line, sizeof line, out) != NULL) {
        found |= strstr(line, "affine") != NULL && strstr(line, "1x1x4x1 f32") != NULL;
    }
    fclose(out);
    assert_true(found);
    nn_graph_destroy(g);
    nn_weights_destroy(weights);
}

/* What is only in the way is not computed, and a frozen parameter gets no gradient. */
static void test_frozen(void **state) {
    (void)state;
    fixture f = make();
    brace_error error = {0};
    const nn_value x = nn_input(f.g, "x", (nn_shape){1, 1, 1, 2});
    const nn_value a = nn_param(f.g, "a", (nn_shape){1, 1, 1, 2}, 1, (const int[]){2}, NN_INIT_ONE),
                   b = nn_param(f.g, "b", (nn_shape){1, 1, 1, 2}, 1, (const int[]){2}, NN_INIT_ONE);
    const nn_value loss = nn_sum(f.g, nn_mul(f.g, nn_mul(f.g, x, a), b), true, true, true, true);
    nn_weights_find(f.weights, "a")->frozen = true;
    test_ok(nn_graph_plan(f.g, &(nn_plan_params){.loss = loss}, &error), &error);
    ((float *)nn_data(f.g, x))[0] = 2;
    ((float *)nn_data(f.g, x))[1] = 3;
    for (int i = 0; i < 2; i++) { /* gradients add up */
        test_ok(nn_forward(f.g, &error), &error);
        test_ok(nn_backward(f.g, 0.5, &error), &error);
    }
    assert_null(nn_weights_find(f.weights, "a")->grad);
    assert_float_equal(nn_weights_find(f.weights, "b")->grad[0], 2, 0);
    assert_float_equal(nn_weights_find(f.weights, "b")->grad[1], 3, 0);
    nn_weights_zero_grad(f.weights);
    assert_float_equal(nn_weights_find(f.weights, "b")->grad[1], 0, 0);
    nn_graph_destroy(f.g);
    nn_weights_destroy(f.weights);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sharing_memory), cmocka_unit_test(test_recomputing),
        cmocka_unit_test(test_threads),        cmocka_unit_test(test_memory),
        cmocka_unit_test(test_out_of_memory),  cmocka_unit_test(test_errors_name_the_layer),
        cmocka_unit_test(test_bad_shapes),     cmocka_unit_test(test_bad_plans),
        cmocka_unit_test(test_cancel),         cmocka_unit_test(test_frozen),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
