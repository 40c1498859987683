/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_weights.c: parameters: the same first values in any order, and files of all three types, whole, damaged or of
 * another network.
 */
#include "nn_test.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/safetensors.h"

typedef struct fixture {
    nn_weights *weights;
    nn_graph *g;
} fixture;

static fixture make(uint64_t seed) {
    fixture f = {NULL, NULL};
    brace_error error = {0};
    const brace_job job = {.threads = 1};
    test_ok(nn_weights_create(&f.weights, seed, &error), &error);
    test_ok(nn_graph_create(&f.g, f.weights, &(nn_graph_params){.job = &job}, &error), &error);
    return f;
}

static void destroy(fixture *f) {
    nn_graph_destroy(f->g);
    nn_weights_destroy(f->weights);
}

static nn_parameter *get(fixture *f, const char *name, int a, int b, nn_init init) {
    nn_push(f->g, "layer");
    nn_parameter *p = nn_parameter_get(f->g, name, 2, (const int[]){a, b}, init, b);
    nn_pop(f->g);
    return p;
}

static char folder[] = "/tmp/brace-weights-XXXXXX";
static char path[64];

static int setup(void **state) {
    (void)state;
    if (mkdtemp(folder) == NULL) {
        return -1;
    }
    snprintf(path, sizeof path, "%s/w.safetensors", folder);
    return 0;
}

static int teardown(void **state) {
    (void)state;
    unlink(path);
    return rmdir(folder);
}

static void test_first_values(void **state) {
    (void)state;
    fixture a = make(5), b = make(5), c = make(6);
    const nn_parameter *p = get(&a, "p.weight", 100, 50, NN_INIT_HE_FAN_IN);
    const nn_parameter *q = get(&a, "q.weight", 100, 50, NN_INIT_UNIFORM_FAN_IN);
    const nn_parameter *q2 = get(&b, "q.weight", 100, 50, NN_INIT_UNIFORM_FAN_IN); /* the other order */
    const nn_parameter *p2 = get(&b, "p.weight", 100, 50, NN_INIT_HE_FAN_IN);
    const nn_parameter *p3 = get(&c, "p.weight", 100, 50, NN_INIT_HE_FAN_IN); /* another seed */
    assert_memory_equal(p->value, p2->value, p->count * sizeof(float));
    assert_memory_equal(q->value, q2->value, q->count * sizeof(float));
    assert_memory_not_equal(p->value, p3->value, p->count * sizeof(float));
    assert_string_equal(p->name, "layer.p.weight");
    assert_ptr_equal(get(&a, "p.weight", 100, 50, NN_INIT_ZERO), p); /* shared */
    double sum = 0, squares = 0, most = 0;
    for (size_t i = 0; i < p->count; i++) {
        sum += (double)p->value[i];
        squares += (double)p->value[i] * (double)p->value[i];
        most = fmax(most, fabs((double)q->value[i]));
    }
    assert_true(fabs(sum / 5000) < 4 * sqrt(2.0 / 50 / 5000));
    assert_true(fabs(squares / 5000 / (2.0 / 50) - 1) < 0.1);
    assert_true(most <= 1 / sqrt(50) && most > 0.99 / sqrt(50));
    const nn_parameter *tenth = get(&a, "t.weight", 100, 50, NN_INIT_HE_FAN_IN_TENTH);
    squares = 0;
    for (size_t i = 0; i < tenth->count; i++) {
        squares += (double)tenth->value[i] * (double)tenth->value[i];
    }
    assert_true(fabs(squares / 5000 / (2.0 / 50 / 100) - 1) < 0.1);
    assert_float_equal(get(&a, "one", 1, 1, NN_INIT_ONE)->value[0], 1, 0);
    assert_int_equal(nn_weights_count(a.weights), 4);
    destroy(&a);
    destroy(&b);
    destroy(&c);
}

static void save(fixture *f, const char *dtype) {
    brace_error error = {0};
    test_ok(nn_weights_save(f->weights, path, dtype, (const char *const[]){"step", "12", NULL}, &error), &error);
}

static void test_files(void **state) {
    (void)state;
    const char *const types[] = {"f32", "bf16", "f16"};
    const double bounds[] = {0, 0x1p-8, 0x1p-11};
    for (int t = 0; t < 3; t++) {
        brace_error error = {0};
        fixture a = make(1), b = make(2), c = make(3);
        nn_parameter *p = get(&a, "w", 7, 30, NN_INIT_HE_FAN_IN);
        get(&a, "bias", 1, 3, NN_INIT_ONE);
        const float special[] = {0, -0.0f, 65504, -1e-7f, 6e-8f, 1e-10f, INFINITY, -2.5f, 3.1e-5f, 65519};
        memcpy(p->value, special, sizeof special);
        save(&a, types[t]);
        /* After the network is built, and before. */
        nn_parameter *q = get(&b, "w", 7, 30, NN_INIT_ZERO);
        const unsigned old = q->version;
        test_ok(nn_weights_load(b.weights, path, true, &error), &error);
        assert_true(q->version > old);
        test_ok(nn_weights_load(c.weights, path, false, &error), &error);
        const nn_parameter *r = get(&c, "w", 7, 30, NN_INIT_ZERO);
        assert_non_null(r);
        for (size_t i = 0; i < p->count; i++) {
            const double v = (double)p->value[i], error_of = fabs((double)q->value[i] - v);
            assert_true(q->value[i] == p->value[i] ||
                        error_of <=
                            fabs(v) * bounds[t] + (t == 2 ? 0x1p-25 : 0)); /* halves of f16 have steps of 2^-24 */
            assert_true(q->value[i] == r->value[i]);
        }
        assert_true(isinf(q->value[6]) && q->value[7] == -2.5f && signbit(q->value[1]));
        /* A parameter that the file has not. */
        assert_null(get(&c, "more", 1, 1, NN_INIT_ZERO));
        assert_int_equal(nn_graph_error(c.g, &error), BRACE_ERROR_MISMATCH);
        assert_non_null(strstr(error.message, "layer: more is not in"));
        destroy(&a);
        destroy(&b);
        destroy(&c);
    }
}

static void test_other_networks(void **state) {
    (void)state;
    brace_error error = {0};
    fixture a = make(1), b = make(2), c = make(3);
    get(&a, "v", 2, 2, NN_INIT_ONE);
    get(&a, "w", 3, 2, NN_INIT_ONE);
    save(&a, "f32");
    nn_parameter *v = get(&b, "v", 2, 2, NN_INIT_ZERO);
    get(&b, "w", 2, 3, NN_INIT_ZERO); /* the same numbers, another shape */
    assert_int_equal(nn_weights_load(b.weights, path, true, &error), BRACE_ERROR_MISMATCH);
    assert_non_null(strstr(error.message, "3 x 2"));
    assert_float_equal(v->value[0], 0, 0); /* nothing was changed */
    get(&c, "v", 2, 2, NN_INIT_ZERO);
    get(&c, "x", 2, 2, NN_INIT_ZERO);
    assert_int_equal(nn_weights_load(c.weights, path, false, &error), BRACE_ERROR_MISMATCH);
    assert_non_null(strstr(error.message, "layer.x"));
    assert_float_equal(nn_weights_find(c.weights, "layer.v")->value[0], 0, 0);
    test_ok(nn_weights_load(c.weights, path, true, &error), &error);
    assert_float_equal(nn_weights_find(c.weights, "layer.v")->value[0], 1, 0);
    assert_int_equal(nn_weights_load(c.weights, "/nonexistent/w", true, &error), BRACE_ERROR_IO);
    assert_int_equal(nn_weights_save(c.weights, path, "f64", NULL, &error), BRACE_ERROR_ARGUMENT);
    destroy(&a);
    destroy(&b);
    destroy(&c);
}

/* Files of others: whole numbers and five dimensions are passed over; a file that was cut off is refused. */
static void test_strange_files(void **state) {
    (void)state;
    brace_error error = {0};
    core_safetensors_writer *writer = NULL;
    const int64_t steps = 7;
    const double wide[2] = {0.5, 0.25};
    const float five = 1;
    test_ok(core_safetensors_create(&writer, path, 0, &error), &error);
    test_ok(core_safetensors_add(
                writer,
                &(core_tensor){.name = "layer.steps", .dtype = CORE_I64, .rank = 1, .shape = {1}, .data = &steps},
                &error),
            &error);
    test_ok(core_safetensors_add(
                writer, &(core_tensor){.name = "layer.w", .dtype = CORE_F64, .rank = 2, .shape = {1, 2}, .data = wide},
                &error),
            &error);
    test_ok(
        core_safetensors_add(
            writer,
            &(core_tensor){.name = "layer.five", .dtype = CORE_F32, .rank = 5, .shape = {1, 1, 1, 1, 1}, .data = &five},
            &error),
        &error);
    test_ok(core_safetensors_commit(writer, &error), &error);
    fixture a = make(1);
    test_ok(nn_weights_load(a.weights, path, true, &error), &error);
    assert_float_equal(get(&a, "w", 1, 2, NN_INIT_ONE)->value[1], 0.25, 0);
    assert_float_equal(get(&a, "steps", 1, 1, NN_INIT_ONE)->value[0], 1, 0);
    destroy(&a);
    fixture b = make(1);
    test_ok(nn_weights_load(b.weights, path, false, &error), &error);
    assert_null(get(&b, "w", 2, 1, NN_INIT_ONE)); /* the shape of a kept array is checked too */
    assert_int_equal(nn_graph_error(b.g, &error), BRACE_ERROR_MISMATCH);
    destroy(&b);
    assert_int_equal(truncate(path, (off_t)((size_t)1 << 20)), 0);
    fixture c = make(1);
    assert_int_equal(nn_weights_load(c.weights, path, true, &error), BRACE_ERROR_FORMAT);
    destroy(&c);
}

static void test_out_of_memory(void **state) {
    (void)state;
    fixture a = make(1);
    get(&a, "v", 2, 2, NN_INIT_ONE);
    save(&a, "bf16");
    destroy(&a);
    for (long n = 1;; n++) {
        brace_error error = {0};
        fixture b = make(2);
        if (n % 2 == 0) {
            get(&b, "v", 2, 2, NN_INIT_ONE);
        }
        core_alloc_fail_after(n / 2 + 1);
        brace_status status = nn_weights_load(b.weights, path, false, &error);
        if (status == BRACE_OK) {
            status = nn_weights_save(b.weights, path, "f16", NULL, &error);
        }
        core_alloc_fail_after(0);
        destroy(&b);
        if (status == BRACE_OK && n > 60) {
            break;
        }
        assert_true(status == BRACE_OK || status == BRACE_ERROR_MEMORY);
        a = make(1); /* the file may be without its array now */
        get(&a, "v", 2, 2, NN_INIT_ONE);
        save(&a, "bf16");
        destroy(&a);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_first_values),   cmocka_unit_test(test_files),
        cmocka_unit_test(test_other_networks), cmocka_unit_test(test_strange_files),
        cmocka_unit_test(test_out_of_memory),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
