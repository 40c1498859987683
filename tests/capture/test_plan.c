/* SPDX-License-Identifier: Apache-2.0 */
/* test_plan.c: which exposures are planned, with any device and with real ones. */
#include "capture_test.h"

static void the_papers_plan(void **state) {
    (void)state;
    static const double times[] = {16, 4, 1, 0.25, 0.0625, 8}, evs[] = {4, 2, 0, -2, -4, 0};
    static const char *const names[] = {"frame_5", "frame_4", "frame_3", "frame_2", "frame_1", "gt"};
    capture_plan plan;
    brace_error error;
    test_good(capture_plan_create(&plan, &(capture_plan_params){.time = 1.0 / 320, .iso = 400}, NULL, NULL, &error),
              &error);
    assert_int_equal(plan.count, 6);
    assert_int_equal(plan.reference, 2);
    for (size_t i = 0; i < 6; i++) {
        char name[32];
        assert_string_equal(capture_step_name(name, &plan.steps[i]), names[i]);
        test_near(plan.steps[i].exposure * 320, times[i], 1e-12);
        test_near(plan.steps[i].iso, i == 5 ? 50 : 400, 1e-9);
        test_near(capture_step_ev(&plan, i), evs[i], 1e-12);
        assert_int_equal(plan.steps[i].truth, i == 5);
        assert_int_equal(plan.steps[i].shots, 1);
    }
    /* Six exposures, six readouts, five gaps. */
    const capture_limits slow = {.readout = 0.01, .interval = 0.5};
    test_near(capture_plan_seconds(&plan, &slow), 29.3125 / 320 + 0.06 + 2.5, 1e-9);
}

static void any_bracket(void **state) {
    (void)state;
    brace_error error;
    capture_plan plan;
    for (int n = 3; n <= 9; n++) {
        const capture_plan_params p = {.time = 0.01, .iso = 100, .frames = n, .step = 2, .no_truth = true};
        test_good(capture_plan_create(&plan, &p, NULL, NULL, &error), &error);
        assert_int_equal(plan.count, n);
        assert_int_equal(plan.steps[plan.reference].number, (n - 1) / 2 + 1);
        for (size_t i = 1; i < plan.count; i++) {
            test_near(plan.steps[i - 1].exposure / plan.steps[i].exposure, 2, 1e-9);
            assert_int_equal(plan.steps[i].number, n - (int)i);
        }
    }
    static const capture_plan_params wrong[] = {{.frames = 2}, {.frames = 10}, {.step = 1},  {.step = 65},
                                                {.time = -1},  {.time = 61},   {.iso = 0.5}, {.list = ""},
                                                {.list = "1"}, {.list = "1,2"}};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        assert_int_equal(capture_plan_create(&plan, &wrong[i], NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
}

static void any_list(void **state) {
    (void)state;
    brace_error error;
    capture_plan plan;
    const capture_plan_params p = {.time = 0.01, .iso = 400, .list = "1/4,1/50s@iso800,2.5@1/2,1,gt:4@1/4"};
    test_good(capture_plan_create(&plan, &p, NULL, NULL, &error), &error);
    assert_int_equal(plan.count, 5);
    const double time[] = {0.0025, 0.02, 0.025, 0.01, 0.04}, iso[] = {400, 800, 200, 400, 100};
    const int number[] = {1, 4, 3, 2, 0}; /* by time x ISO: 1, 16, 5, 4 */
    for (size_t i = 0; i < 5; i++) {
        test_near(plan.steps[i].exposure, time[i], 1e-12);
        test_near(plan.steps[i].iso, iso[i], 1e-9);
        assert_int_equal(plan.steps[i].number, number[i]);
    }
    assert_int_equal(plan.reference, 3); /* the shorter of the middle two, as a bracket has it */
    static const char *const wrong[] = {",",
                                        "1,2,",
                                        "1,2,x",
                                        "1,2,-3",
                                        "1,2,1/0",
                                        "1,2,3@",
                                        "1,2,3@iso",
                                        "1,2,3@0",
                                        "1,2,gt:",
                                        "1,2,3s4",
                                        "1,2,nan",
                                        "1,2,inf",
                                        "1,2,0x10s",
                                        "1,2,1e400",
                                        "1,2,3@1@2",
                                        "1, 2,4",
                                        "s,s,s",
                                        "1,2,4,gt:8,gt:8",
                                        "1,2,3601s",
                                        "1,1,1",
                                        "gt:1,2,3",
                                        "1,2,4@iso0.1",
                                        "1,2,3,4,5,6,7,8,9,10",
                                        "1,2,3,4,5,6,7,8,9,10,gt:11"};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        if (capture_plan_create(&plan, &(capture_plan_params){.time = 2, .iso = 400, .list = wrong[i]}, NULL, NULL,
                                &error) == BRACE_OK)
            fail_msg("'%s' was taken", wrong[i]);
}

static void the_nearest_stop(void **state) {
    (void)state;
    static const double stops[] = {0.001, 0.002, 0.004, 0.008};
    test_near(capture_nearest(0.0025, stops, 4, 0.001, 0.008), 0.002, 0);
    test_near(capture_nearest(0.0029, stops, 4, 0.001, 0.008), 0.004, 0); /* nearer by ratio */
    test_near(capture_nearest(1e-6, stops, 4, 0.001, 0.008), 0.001, 0);
    test_near(capture_nearest(9, stops, 4, 0.001, 0.008), 0.008, 0);
    test_near(capture_nearest(9, NULL, 0, 0.001, 0.008), 0.008, 0);
    test_near(capture_nearest(0.003, NULL, 0, 0.001, 0.008), 0.003, 0);
}

typedef struct notes {
    int count;
    char last[1024];
} notes;

static void on_note(void *user, const char *message) {
    notes *n = user;
    n->count++;
    snprintf(n->last, sizeof n->last, "%s", message);
}

/* ISO/8 is not there: as few shots as collect the same light. */
static void truths_are_averaged(void **state) {
    (void)state;
    brace_error error;
    capture_plan plan;
    notes n = {0};
    const brace_job job = {.note = on_note, .user = &n};
    static const struct {
        double lowest;
        int shots;
    } cases[] = {{50, 1}, {100, 2}, {160, 3}, {200, 4}, {400, 8}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const capture_limits limits = {
            .exposure_min = 1e-5, .exposure_max = 1, .iso_min = cases[i].lowest, .iso_max = 6400};
        n.count = 0;
        test_good(capture_plan_create(&plan, &(capture_plan_params){.time = 0.005, .iso = 400}, &limits, &job, &error),
                  &error);
        const capture_step *t = &plan.steps[5];
        assert_true(t->truth);
        assert_int_equal(t->shots, cases[i].shots);
        assert_int_equal(n.count, cases[i].shots > 1);
        test_near(t->exposure * t->iso, 0.005 * 400, 1e-6); /* each as bright as the reference */
        assert_true(fabs(log2(t->exposure * t->shots / 0.04)) < 0.25);
        assert_int_equal(capture_plan_shots(&plan), 5 + cases[i].shots);
    }
    assert_non_null(strstr(n.last, "mean of 8 shots"));
    /* A shutter that ends at 1/100: the same with the times. */
    const capture_limits fast = {.exposure_min = 1e-5, .exposure_max = 0.01, .iso_min = 50, .iso_max = 6400};
    test_good(
        capture_plan_create(&plan, &(capture_plan_params){.time = 0.0006, .iso = 400, .step = 2}, &fast, NULL, &error),
        &error);
    assert_int_equal(plan.steps[5].shots, 1);
    test_good(
        capture_plan_create(&plan, &(capture_plan_params){.time = 0.0025, .iso = 400, .step = 2}, &fast, NULL, &error),
        &error);
    assert_int_equal(plan.steps[5].shots, 2);
}

static void what_a_device_cannot(void **state) {
    (void)state;
    brace_error error;
    capture_plan plan;
    notes n = {0};
    const brace_job job = {.note = on_note, .user = &n};
    /* Two of the five are below its shortest: one of them stays. */
    const capture_limits slow = {.exposure_min = 1.0 / 320, .exposure_max = 1, .iso_min = 50, .iso_max = 6400};
    test_good(capture_plan_create(&plan, &(capture_plan_params){.time = 1.0 / 320, .iso = 400}, &slow, &job, &error),
              &error);
    assert_int_equal(plan.count, 4);
    assert_int_equal(n.count, 2);
    assert_non_null(strstr(n.last, "left out"));
    assert_int_equal(plan.reference, 1);
    /* All the same. */
    const capture_limits fixed = {.exposure_min = 0.01, .exposure_max = 0.01, .iso_min = 100, .iso_max = 100};
    assert_int_equal(capture_plan_create(&plan, NULL, &fixed, NULL, &error), BRACE_ERROR_UNSUPPORTED);
    assert_non_null(strstr(error.message, "1 different exposures"));
    /* The dial of a camera, and what it says of it. */
    capture_limits dial = {.exposure_min = 1.0 / 4000,
                           .exposure_max = 2,
                           .iso_min = 100,
                           .iso_max = 400,
                           .exposure_count = 4,
                           .exposures = {1.0 / 4000, 1.0 / 500, 1.0 / 60, 0.5},
                           .iso_count = 3,
                           .isos = {100, 200, 400}};
    n.count = 0;
    test_good(capture_plan_create(&plan, &(capture_plan_params){.time = 1.0 / 60, .iso = 400, .frames = 3, .step = 30},
                                  &dial, &job, &error),
              &error);
    test_near(plan.steps[0].exposure, 0.5, 0);
    test_near(plan.steps[1].exposure, 1.0 / 60, 0);
    test_near(plan.steps[2].exposure, 1.0 / 4000, 0);
    assert_true(n.count >= 1);
}

static void faults_are_read(void **state) {
    (void)state;
    brace_error error;
    const capture_backend *backend;
    const char *port;
    capture_sequence *q = calloc(1, sizeof *q);
    assert_non_null(q);
    static const char *const wrong[] = {"busy",  "busy:",   "busy:0",   "busy:2-1",        "busy:1-", "busy:x",
                                        "bus:1", "busy:1,", "busy:1+2", "busy:9999999999", ":1",      "busy:1;drop:2"};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        assert_int_equal(test_shoot(q, "w", NULL, wrong[i], NULL, (capture_run_params){0}, &error),
                         BRACE_ERROR_ARGUMENT);
        capture_sequence_free(q);
        assert_int_equal(test_count("."), 0);
    }
    free(q);
    assert_int_equal(capture_backend_find(&backend, &port, "polaroid", &error), BRACE_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "sim"));
    test_good(capture_backend_find(&backend, &port, "sim:canon_r5", &error), &error);
    assert_string_equal(port, "canon_r5");
    const char *const given[] = {"a=1", "b=2", "a=3"}, *const known[] = {"a", "b", NULL}, *const few[] = {"a", NULL};
    const capture_address address = {.options = given, .option_count = 3};
    assert_string_equal(capture_option(&address, "a"), "3");
    assert_null(capture_option(&address, "c"));
    test_good(capture_option_unknown(&address, "test", known, &error), &error);
    assert_int_equal(capture_option_unknown(&address, "test", few, &error), BRACE_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "b=2"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_papers_plan),
        cmocka_unit_test(any_bracket),
        cmocka_unit_test(any_list),
        cmocka_unit_test(the_nearest_stop),
        cmocka_unit_test(truths_are_averaged),
        cmocka_unit_test(what_a_device_cannot),
        cmocka_unit_test_setup_teardown(faults_are_read, test_folder_make, test_folder_remove),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
