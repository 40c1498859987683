/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_shapes.c: the networks by name and by JSON; what cannot be built is refused with a sentence; every lack of
 * memory gives an error and no leak.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "models_test.h"

/* ---- names and JSON ---- */

static void test_names(void **state) {
    (void)state;
    static const char *const names[] = {"brace", "brace-s", "tmrnet", "tmrnet-s"};
    models_shape shapes[4], untouched;
    for (int i = 0; i < 4; i++) {
        assert_true(models_shape_named(&shapes[i], names[i]));
        assert_non_null(strstr(models_names, names[i]));
        for (int k = 0; k < i; k++) {
            assert_false(models_shape_equal(&shapes[i], &shapes[k]));
        }
    }
    for (int i = 0; i < 4; i += 2) { /* TMRNet is the same without MSCAM */
        models_shape bare = shapes[i % 2 + i / 2];
        const models_shape *tmrnet = &shapes[2 + i / 2];
        assert_true(bare.mscam && bare.prior);
        bare.mscam = bare.prior = false;
        bare.guide = bare.sigma = bare.gate = false;
        assert_true(bare.balance && tmrnet->balance == (i > 0)); /* published weights know none */
        bare.balance = tmrnet->balance;
        assert_true(models_shape_equal(&bare, tmrnet));
    }
    memset(&untouched, 0x11, sizeof untouched);
    models_shape copy;
    memcpy(&copy, &untouched, sizeof copy);
    static const char *const others[] = {"", "brace-", "Brace", "brace-ss", "tmrnet ", "s"};
    for (int i = 0; i < 6; i++) {
        assert_false(models_shape_named(&copy, others[i]));
    }
    assert_memory_equal(&copy, &untouched, sizeof copy);
}

static const models_shape every = {.frames = 7, .channels = 24, .unshuffle = 4, .extract = 11, .global = 12,
                                   .frame = 13, .reconstruct = 14, .offset = 15, .groups = 6, .strip = 17};

static void test_round_trip(void **state) {
    (void)state;
    for (int i = 0; i < 256; i++) { /* switches in every combination */
        models_shape shape = every, back = {0};
        brace_error error = {0};
        shape.spynet = i & 1, shape.blend = i & 2, shape.mscam = i & 4, shape.prior = i & 8, shape.guide = i & 16,
        shape.balance = i & 32, shape.sigma = i & 64, shape.gate = i & 128;
        json_t *json = models_shape_json(&shape);
        assert_int_equal(json_object_size(json), 18);
        char *text = json_dumps(json, 0);
        test_ok(models_shape_parse(&back, text, "network.json", &error), &error);
        assert_true(models_shape_equal(&shape, &back));
        free(text);
        json_decref(json);
    }
    models_shape shape = every; /* keys that are not there leave what is */
    brace_error error = {0};
    test_ok(models_shape_parse(&shape, "{\"frame\": 2}", "network.json", &error), &error);
    assert_int_equal(shape.frame, 2);
    shape.frame = every.frame;
    assert_true(models_shape_equal(&shape, &every));
}

static void test_every_difference_counts(void **state) {
    (void)state;
    json_t *json = models_shape_json(&every);
    const char *key;
    json_t *value;
    json_object_foreach(json, key, value) {
        char text[64];
        models_shape other = every;
        brace_error error = {0};
        if (json_is_boolean(value)) {
            snprintf(text, sizeof text, "{\"%s\": true}", key);
        } else {
            snprintf(text, sizeof text, "{\"%s\": %d}", key, strcmp(key, "channels") == 0 ? 48 : 2);
        }
        test_ok(models_shape_parse(&other, text, "network.json", &error), &error);
        assert_false(models_shape_equal(&every, &other));
    }
    json_decref(json);
}

static void refused(const char *text, const char *sentence) {
    models_shape shape = test_shape();
    brace_error error = {0};
    assert_int_not_equal(models_shape_parse(&shape, text, "network.json", &error), BRACE_OK);
    if (strstr(error.message, "network.json") == NULL || strstr(error.message, sentence) == NULL) {
        fail_msg("%s: \"%s\" does not say \"%s\"", text, error.message, sentence);
    }
}

static void test_wrong_json(void **state) {
    (void)state;
    static const struct {
        const char *key;
        int low, high;
    } numbers[] = {{"frames", 2, 9},      {"channels", 8, 1024}, {"unshuffle", 1, 4},   {"extract", 0, 1000},
                   {"global", 0, 1000},   {"frame", 0, 1000},    {"reconstruct", 0, 1000}, {"offset", 0, 100},
                   {"groups", 0, 64},     {"strip", 0, 4096}};
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        char text[96], sentence[96];
        const int wrong[2] = {numbers[i].low - 1, numbers[i].high + 1};
        for (int k = 0; k < 2; k++) {
            snprintf(text, sizeof text, "{\"%s\": %d}", numbers[i].key, wrong[k]);
            snprintf(sentence, sizeof sentence, "%s: %d is out of range %d to %d", numbers[i].key, wrong[k],
                     numbers[i].low, numbers[i].high);
            refused(text, sentence);
        }
        snprintf(text, sizeof text, "{\"%s\": 2.5}", numbers[i].key);
        snprintf(sentence, sizeof sentence, "%s: a whole number is expected", numbers[i].key);
        refused(text, sentence);
        snprintf(text, sizeof text, "{\"%s\": \"8\"}", numbers[i].key);
        refused(text, sentence);
        snprintf(text, sizeof text, "{\"%s\": 99999999999999}", numbers[i].key);
        refused(text, "out of range");
    }
    static const char *const switches[] = {"spynet", "blend", "mscam", "prior"};
    for (int i = 0; i < 4; i++) {
        char text[96], sentence[96];
        snprintf(text, sizeof text, "{\"%s\": 1}", switches[i]);
        snprintf(sentence, sizeof sentence, "%s: true or false is expected", switches[i]);
        refused(text, sentence);
    }
    refused("{\"unshuffle\": 3}", "unshuffle: 3 is none of 1, 2 and 4");
    refused("{\"groups\": 3}", "groups: 3 do not divide 16 channels");
    refused("{\"channels\": 20, \"groups\": 8}", "groups: 8 do not divide 20 channels");
    refused("{\"heads\": 3}", "heads");
}

/* ---- paper size ---- */

static size_t count_parameters(const char *name) {
    brace_error error = {0};
    const brace_job job = {.threads = 1};
    models_shape shape;
    test_network n;
    size_t count = 0;
    assert_true(models_shape_named(&shape, name));
    test_ok(test_network_build(&n, &shape, 8, 8, &(nn_graph_params){.job = &job}, false, &error), &error);
    for (size_t i = 0; i < nn_weights_count(n.weights); i++) {
        count += nn_weights_at(n.weights, i)->count;
    }
    const nn_shape y = nn_shape_of(n.g, n.y);
    assert_true(y.n == 1 && y.h == 8 && y.w == 8 && y.c == 4);
    test_network_destroy(&n);
    return count;
}

/* Those of the published TMRNet, SPyNet's 1,440,300 among them; and MSCAM's: 16x64+64 and 64x64+64 of the prior,
 * 64x64+64 and 64x64 of the tokens, 64x64+64 and 64x128+128 of gamma and beta. */
static void test_paper_size(void **state) {
    (void)state;
    assert_int_equal(count_parameters("tmrnet"), 13285704);
    assert_int_equal(count_parameters("brace"), 13285704 + 1088 + 4160 + 4160 + 4096 + 4160 + 8320);
}

/* ---- what cannot be built ---- */

static void cannot(const models_shape *shape, nn_shape frames, nn_shape flow, const char *sentence) {
    brace_error error = {0};
    const brace_job job = {.threads = 1};
    nn_weights *weights = NULL;
    nn_graph *g = NULL;
    test_ok(nn_weights_create(&weights, 1, &error), &error);
    test_ok(nn_graph_create(&g, weights, &(nn_graph_params){.job = &job}, &error), &error);
    const models_inputs in = {.frames = nn_input(g, "frames", frames),
                              .flow = flow.n > 0 ? nn_input(g, "flow", flow) : 0};
    assert_int_equal(models_build(g, shape, &in), 0);
    assert_int_equal(nn_graph_plan(g, NULL, &error), BRACE_ERROR_ARGUMENT);
    if (strstr(error.message, sentence) == NULL) {
        fail_msg("\"%s\" does not say \"%s\"", error.message, sentence);
    }
    nn_graph_destroy(g);
    nn_weights_destroy(weights);
}

static void test_wrong_inputs(void **state) {
    (void)state;
    models_shape s = test_shape();
    s.unshuffle = 2;
    cannot(&s, (nn_shape){5, 15, 16, 8}, (nn_shape){5, 15, 16, 2},
           "a picture of 16 x 15; the network takes multiples of 2");
    cannot(&s, (nn_shape){5, 16, 13, 8}, (nn_shape){5, 16, 13, 2},
           "a picture of 13 x 16; the network takes multiples of 2");
    s.unshuffle = 4;
    s.groups = 0;
    cannot(&s, (nn_shape){5, 16, 14, 8}, (nn_shape){5, 16, 14, 2}, "multiples of 4");
    cannot(&s, (nn_shape){4, 16, 16, 8}, (nn_shape){4, 16, 16, 2}, "4 frames of 8 channels; the network takes 5 of 8");
    cannot(&s, (nn_shape){5, 16, 16, 4}, (nn_shape){5, 16, 16, 2}, "5 frames of 4 channels; the network takes 5 of 8");
    cannot(&s, (nn_shape){5, 16, 16, 8}, (nn_shape){4, 16, 16, 2}, "a flow of 4 x 16 x 16 x 2 for 5 frames of 16 x 16");
    cannot(&s, (nn_shape){5, 16, 16, 8}, (nn_shape){0}, "a flow of 0 x 0 x 0 x 0");
    s = test_shape();
    s.blend = true;
    cannot(&s, (nn_shape){5, 16, 16, 8}, (nn_shape){5, 16, 16, 2}, "missing"); /* white */
    s.guide = s.sigma = true, s.groups = 0;
    cannot(&s, (nn_shape){6, 16, 16, 8}, (nn_shape){6, 16, 16, 2}, "sigma"); /* is not there */
    s.guide = s.sigma = false, s.gate = true;
    cannot(&s, (nn_shape){5, 16, 16, 8}, (nn_shape){5, 16, 16, 2}, "a gate without sigma");
    s = test_shape();
    s.blend = s.balance = true;
    cannot(&s, (nn_shape){5, 16, 16, 8}, (nn_shape){5, 16, 16, 2}, "no white balance");
}

/* ---- white balance ---- */

static void test_gains(void **state) {
    (void)state;
    float balance[8];
    models_balance(balance, (const double[3]){4, 2, 3});
    for (int i = 0; i < 4; i++) {
        const double want = i == 0 ? 2 : i == 3 ? 1.5 : 1;
        assert_true(fabs((double)balance[2 * i] - want) < 1e-6);
        assert_true(fabs(pow((double)balance[2 * i + 1], 2.2) - want) < 1e-6);
    }
    models_balance(balance, (const double[3]){NAN, 1, 1e9});
    for (int i = 0; i < 8; i++) {
        assert_true(balance[i] == 1);
    }
}

/* A camera whose red is half as sensitive, and which says so, gets half the red, and all else alike. */
static void test_cameras(void **state) {
    (void)state;
    static const double sensitive[4] = {0.5, 1, 1, 1.3};
    models_shape s = test_shape();
    s.balance = s.mscam = s.prior = true, s.strip = 4;
    for (int kind = 0; kind < 3; kind++) {
        const bool blend = kind > 0;
        s.blend = blend, s.unshuffle = blend ? 2 : 1, s.groups = blend ? 0 : 2, s.guide = s.sigma = kind == 2;
        brace_error error = {0};
        const brace_job job = {.threads = 1};
        test_network n;
        test_ok(test_network_build(&n, &s, 16, 16, &(nn_graph_params){.job = &job}, false, &error), &error);
        test_ok(nn_graph_plan(n.g, NULL, &error), &error);
        test_fill_weights(n.weights);
        test_fill_inputs(&n);
        if (blend) {
            test_fill_value(n.g, n.in.white, "white", 1e6, 1e6); /* one clips at the same number of another scene */
        }
        test_ok(nn_forward(n.g, &error), &error);
        const float *y = nn_data(n.g, n.y);
        float first[16 * 16 * 4], *frames = nn_data(n.g, n.in.frames), *balance = nn_data(n.g, n.in.balance);
        memcpy(first, y, sizeof first);
        for (size_t i = 0; i < nn_count(nn_shape_of(n.g, n.in.frames)); i++) {
            frames[i] *= (float)pow(sensitive[i / 2 % 4], i % 2 == 0 ? 1 : 1 / 2.2);
        }
        for (size_t i = 0; i < 8; i++) {
            balance[i] /= (float)pow(sensitive[i / 2], i % 2 == 0 ? 1 : 1 / 2.2);
        }
        float *sigma = nn_data(n.g, n.in.sigma);
        for (size_t i = 0; sigma != NULL && i < 16 * 16 * 4; i++) {
            sigma[i] *= (float)pow(sensitive[i % 4], 1 / 2.2);
        }
        test_ok(nn_forward(n.g, &error), &error);
        double largest = 0;
        for (size_t i = 0; i < sizeof first / sizeof *first; i++) {
            const double want = (double)first[i] * sensitive[i % 4];
            assert_true(fabs((double)y[i] - want) < 1e-4 * (1 + fabs(want)));
            largest = fmax(largest, fabs(want));
        }
        assert_true(largest > 0.1);
        test_network_destroy(&n);
    }
}

/* ---- memory ---- */

static brace_status build_and_plan(const models_shape *shape, brace_error *error) {
    const brace_job job = {.threads = 1};
    test_network n;
    brace_status status = test_network_build(&n, shape, 8, 8, &(nn_graph_params){.job = &job}, true, error);
    if (status == BRACE_OK && n.loss == 0) { /* the test's own numbers */
        status = core_fail_memory(error, 1, "a loss");
    }
    if (status == BRACE_OK) {
        status = nn_graph_plan(n.g, &(nn_plan_params){.loss = n.loss}, error);
    }
    test_network_destroy(&n);
    return status;
}

static void test_out_of_memory(void **state) {
    (void)state;
    models_shape shape = test_shape();
    shape.frames = 2;
    shape.channels = 8;
    shape.global = 1;
    shape.unshuffle = 2;
    shape.mscam = shape.prior = shape.blend = true;
    shape.strip = 2;
    long n = 1;
    for (;; n++) {
        brace_error error = {0};
        core_alloc_fail_after(n);
        const brace_status status = build_and_plan(&shape, &error);
        core_alloc_fail_after(0);
        if (status == BRACE_OK) {
            break;
        }
        if (status != BRACE_ERROR_MEMORY || error.status != status || error.message[0] == '\0') {
            fail_msg("allocation %ld: status %d, \"%s\"", n, (int)status, error.message);
        }
    }
    assert_true(n > 200);
}

static long left; /* allocations until one fails */

static void *failing_malloc(size_t size) {
    return --left == 0 ? NULL : malloc(size);
}

static void test_out_of_memory_for_json(void **state) {
    (void)state;
    long n = 1;
    json_t *json = NULL;
    json_set_alloc_funcs(failing_malloc, free);
    for (; json == NULL; n++) {
        left = n;
        json = models_shape_json(&every);
        assert_true(json != NULL || n < 1000);
    }
    json_set_alloc_funcs(malloc, free);
    assert_true(n > 16);
    assert_int_equal(json_object_size(json), 18);
    json_decref(json);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_names),        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_wrong_json),   cmocka_unit_test(test_every_difference_counts),
        cmocka_unit_test(test_paper_size),   cmocka_unit_test(test_wrong_inputs),
        cmocka_unit_test(test_gains),        cmocka_unit_test(test_cameras),
        cmocka_unit_test(test_out_of_memory), cmocka_unit_test(test_out_of_memory_for_json),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
