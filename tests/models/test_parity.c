/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_parity.c: small networks against an implementation in PyTorch (networks.py, make_parity.py), forward and
 * backward, in f32 to 1e-4: SPyNet; TMRNet; and BRACE's parts in several combinations. TMRNet also as loaded from a
 * PyTorch file.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <zlib.h>

#include "core/safetensors.h"
#include "models_test.h"

static core_safetensors *file;
static const double bound = 1e-4, bf16_bound = 0.03; /* eight bits, through some twenty layers */
static char pth[] = "/tmp/brace-tmrnet-XXXXXX";

static const core_tensor *find(const char *name, const char *part) {
    char text[256];
    snprintf(text, sizeof text, "%s/%s", name, part);
    const core_tensor *t = core_safetensors_find(file, text);
    if (t == NULL) {
        fail_msg("%s is not in the file", text);
    }
    return t;
}

/* Differences in units of the largest value. */
static void compare_part(const char *name, const char *part, const float *y, size_t count, double limit) {
    const core_tensor *t = find(name, part);
    assert_int_equal(t->size, count * sizeof *y);
    const float *expected = t->data;
    double most = 0, largest = 0;
    for (size_t i = 0; i < count; i++) {
        const double d = fabs((double)(y[i] - expected[i]));
        most = d > most || isnan(d) ? d : most; /* NaN stays */
        largest = fmax(largest, fabs((double)expected[i]));
    }
    if (!(most <= limit * largest)) {
        fail_msg("%s: the result differs by %g; its largest number is %g", name, most, largest);
    }
}

static void compare_result(const char *name, const float *y, size_t count, double limit) {
    compare_part(name, "y", y, count, limit);
}

/* Its length, its product with random numbers, and single numbers. */
static void compare_gradient(const char *name, const nn_parameter *p) {
    char part[192];
    enum { SAMPLES = 8 };
    snprintf(part, sizeof part, "g.%s", p->name);
    const core_tensor *t = find(name, part);
    assert_int_equal(t->size, (2 + SAMPLES) * sizeof(float));
    const float *expected = t->data;
    double square = 0, product = 0, largest = 0;
    for (size_t i = 0; i < p->count; i++) {
        const double g = (double)p->grad[i];
        square += g * g;
        product += g * test_number("r", i);
        largest = fmax(largest, fabs(g));
    }
    const double length = (double)expected[0];
    if (!(fabs(sqrt(square) - length) <= bound * length && fabs(product - (double)expected[1]) <= bound * length)) {
        fail_msg("%s: the gradient of %s has length %g, not %g, and product %g, not %g", name, p->name, sqrt(square),
                 length, product, (double)expected[1]);
    }
    for (size_t k = 0; k < SAMPLES; k++) {
        const size_t i = k * p->count / SAMPLES;
        if (!(fabs((double)(p->grad[i] - expected[2 + k])) <= bound * largest)) {
            fail_msg("%s: number %zu of the gradient of %s is %g, not %g", name, i, p->name, (double)p->grad[i],
                     (double)expected[2 + k]);
        }
    }
}

/* Every parameter's, and as many as the file has. */
static void compare_gradients(const char *name, nn_weights *weights) {
    size_t there = 0;
    char prefix[64];
    snprintf(prefix, sizeof prefix, "%s/g.", name);
    for (size_t i = 0; i < core_safetensors_count(file); i++) {
        there += strncmp(core_safetensors_at(file, i)->name, prefix, strlen(prefix)) == 0;
    }
    assert_int_equal(nn_weights_count(weights), there);
    for (size_t i = 0; i < nn_weights_count(weights); i++) {
        compare_gradient(name, nn_weights_at(weights, i));
    }
}

static void test_spynet(void **state) {
    (void)state;
    brace_error error = {0};
    const brace_job job = {.threads = 2};
    nn_weights *weights = NULL;
    nn_graph *g = NULL;
    test_ok(nn_weights_create(&weights, 1, &error), &error);
    test_ok(nn_graph_create(&g, weights, &(nn_graph_params){.job = &job, .poison = true}, &error), &error);
    const nn_shape s = {2, 24, 20, 3};
    const nn_value a = nn_input(g, "reference", s), b = nn_input(g, "other", s), y = models_spynet(g, a, b);
    nn_output(g, "y", y);
    test_ok(nn_graph_plan(g, &(nn_plan_params){.loss = test_loss(g, y)}, &error), &error);
    test_fill_weights(weights);
    test_fill_value(g, a, "reference", 0, 1);
    test_fill_value(g, b, "other", 0, 1);
    test_ok(nn_forward(g, &error), &error);
    test_ok(nn_backward(g, 1, &error), &error);
    compare_result("spynet", nn_data(g, y), nn_count(nn_shape_of(g, y)), bound);
    compare_gradients("spynet", weights);
    nn_graph_destroy(g);
    nn_weights_destroy(weights);
}

typedef struct described {
    models_shape shape;
    int h, w;
} described;

/* The file says which shape each network has. */
static described describe(const char *name) {
    brace_error error = {0};
    json_check *doc = NULL;
    json_at shape;
    described d = {.shape = {0}};
    test_ok(json_check_parse(&doc, core_safetensors_metadata(file, name), name, &error), &error);
    const json_at root = json_check_root(doc);
    d.h = (int)json_check_integer(&root, "h", 1, 1000, JSON_CHECK_REQUIRED_INTEGER);
    d.w = (int)json_check_integer(&root, "w", 1, 1000, JSON_CHECK_REQUIRED_INTEGER);
    assert_true(json_check_object(&root, "shape", &shape));
    models_shape_read(&d.shape, &shape);
    test_ok(json_check_status(doc, &error), &error);
    json_check_destroy(doc);
    return d;
}

/* bf16: the result only. Gradients meet other bends of activations. */
static void test_one(const char *name, nn_type type) {
    brace_error error = {0};
    const brace_job job = {.threads = 2};
    const nn_graph_params params = {.type = type, .job = &job, .poison = true};
    const described d = describe(name);
    test_network n;
    test_ok(test_network_build(&n, &d.shape, d.h, d.w, &params, true, &error), &error);
    test_ok(nn_graph_plan(n.g, &(nn_plan_params){.loss = n.loss}, &error), &error);
    test_fill_weights(n.weights);
    test_fill_inputs(&n);
    test_ok(nn_forward(n.g, &error), &error);
    test_ok(nn_backward(n.g, 1, &error), &error);
    const float *y = nn_data(n.g, n.y);
    const size_t count = nn_count(nn_shape_of(n.g, n.y));
    assert_int_equal(nn_type_of(n.g, n.y), NN_F32);
    if (type == NN_F32) {
        compare_result(name, y, count, bound);
        compare_gradients(name, n.weights);
    } else {
        compare_result(name, y, count, bf16_bound);
    }
    test_network_destroy(&n);
}

/* What a restoration makes of the same numbers is another picture, half of whose gate's openings are shut. */
static void test_caution(void **state) {
    (void)state;
    brace_error error = {0};
    const brace_job job = {.threads = 2};
    const described d = describe("gate");
    test_network n;
    test_ok(test_network_build(&n, &d.shape, d.h, d.w, &(nn_graph_params){.job = &job, .poison = true}, false, &error), &error);
    test_ok(nn_graph_plan(n.g, NULL, &error), &error);
    test_fill_weights(n.weights);
    test_fill_inputs(&n);
    test_ok(nn_forward(n.g, &error), &error);
    const float *y = nn_data(n.g, n.y), *trained = find("gate", "y")->data;
    const size_t count = nn_count(nn_shape_of(n.g, n.y));
    compare_part("gate", "cautious", y, count, bound);
    size_t others = 0;
    for (size_t i = 0; i < count; i++) {
        others += fabsf(y[i] - trained[i]) > 0.01f;
    }
    assert_true(others > count / 4);
    test_network_destroy(&n);
}

static void test_networks(void **state) {
    (void)state;
    size_t count = 0;
    const char *name;
    for (; (name = core_safetensors_metadata_key(file, count)) != NULL; count++) {
        test_one(name, NN_F32);
        test_one(name, NN_BF16);
    }
    assert_int_equal(count, 9);
}

/* torch.save({"state_dict": network.state_dict()}), as TMRNet's authors do it, with SPyNet's two constants. */
static void test_published_file(void **state) {
    (void)state;
    for (int after = 0; after < 2; after++) { /* loaded before the network is built, and after */
        brace_error error = {0};
        const brace_job job = {.threads = 2};
        const described d = describe("tmrnet");
        test_network n, other;
        test_ok(test_network_build(&n, &d.shape, d.h, d.w, &(nn_graph_params){.job = &job}, false, &error), &error);
        if (after) {
            test_ok(nn_weights_load(n.weights, pth, false, &error), &error);
            test_ok(nn_graph_plan(n.g, NULL, &error), &error);
        } else {
            nn_weights *weights = NULL;
            test_ok(nn_weights_create(&weights, 9, &error), &error);
            test_ok(nn_weights_load(weights, pth, false, &error), &error);
            test_network_destroy(&n);
            n.weights = weights;
            test_ok(nn_graph_create(&n.g, weights, &(nn_graph_params){.job = &job}, &error), &error);
            n.in = (models_inputs){.frames = nn_input(n.g, "frames", (nn_shape){5, d.h, d.w, 8})};
            n.y = models_build(n.g, &d.shape, &n.in);
            nn_output(n.g, "y", n.y);
            test_ok(nn_graph_plan(n.g, NULL, &error), &error);
        }
        test_fill_value(n.g, n.in.frames, "frames", -0.1, 1.1);
        test_ok(nn_forward(n.g, &error), &error);
        compare_result("tmrnet", nn_data(n.g, n.y), nn_count(nn_shape_of(n.g, n.y)), bound);
        test_network_destroy(&n);

        models_shape more = d.shape; /* another network says what it misses, and what does not fit */
        more.mscam = true;
        test_ok(test_network_build(&other, &more, d.h, d.w, &(nn_graph_params){.job = &job}, false, &error), &error);
        assert_int_equal(nn_weights_load(other.weights, pth, false, &error), BRACE_ERROR_MISMATCH);
        assert_non_null(strstr(error.message, "mscam.feature.weight"));
        test_network_destroy(&other);
        more = d.shape;
        more.groups = 4;
        test_ok(test_network_build(&other, &more, d.h, d.w, &(nn_graph_params){.job = &job}, false, &error), &error);
        assert_int_equal(nn_weights_load(other.weights, pth, false, &error), BRACE_ERROR_MISMATCH);
        assert_non_null(strstr(error.message, "dcn_alignment.conv_offset.2.weight' are 54 x 16 x 3 x 3"));
        test_network_destroy(&other);
    }
}

/* Unpacks the file, as torch.save wrote it, to `pth`. */
static int unpack(void) {
    static unsigned char room[1 << 16];
    gzFile from = gzopen(TEST_DATA "/tmrnet.pth.gz", "rb");
    const int to = mkstemp(pth);
    int n = -1;
    while (from != NULL && to >= 0 && (n = gzread(from, room, sizeof room)) > 0 && write(to, room, (size_t)n) == n) {
    }
    gzclose(from);
    close(to);
    return n;
}

static int setup(void **state) {
    (void)state;
    return unpack() == 0 && core_safetensors_open(&file, TEST_DATA "/parity.safetensors", NULL) == BRACE_OK ? 0 : -1;
}

static int teardown(void **state) {
    (void)state;
    unlink(pth);
    core_safetensors_close(file);
    return 0;
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_spynet), cmocka_unit_test(test_networks), cmocka_unit_test(test_caution),
                                       cmocka_unit_test(test_published_file)};
    return cmocka_run_group_tests(tests, setup, teardown);
}
