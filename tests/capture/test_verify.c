/* SPDX-License-Identifier: Apache-2.0 */
/* test_verify.c: honest and lying frames, means of frames, and motion. */
#include "capture_test.h"

enum { WIDTH = 192, HEIGHT = 144 };

static double scene(double x, double y) {
    return 0.5 + 0.25 * sin(0.21 * x) * cos(0.17 * y) + 0.2 * sin(0.05 * x + 0.09 * y);
}

/* A smooth scene with noise, at an exposure. */
static brace_frame *photograph(double exposure, double iso, double light, uint32_t seed, int shift) {
    brace_frame *f;
    brace_error error;
    test_good(brace_frame_create(&f, WIDTH, HEIGHT, BRACE_CFA_RGGB, &error), &error);
    for (int i = 0; i < 4; i++)
        f->black[i] = 64;
    f->white = 1023;
    f->exposure_time = exposure, f->iso = iso, f->f_number = 1.8;
    snprintf(f->model, sizeof f->model, "Test");
    core_random r = core_random_create(seed, 1, 2, 3);
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            const double s = light * exposure * iso * scene(x + shift, y);
            const double v = s + 0.01 * sqrt(fmax(s, 0) + 0.01) * core_random_normal(&r);
            f->data[(size_t)y * WIDTH + (size_t)x] = (uint16_t)fmin(fmax(round(64 + 959 * v), 0), 1023);
        }
    return f;
}

#define LIGHT (0.3 / (0.003 * 400)) /* the reference's mean is 0.15 */

static void make(capture_probe *p, const char *name, double exposure, double says, uint32_t seed) {
    brace_error error;
    brace_frame *f = photograph(exposure, 400, LIGHT, seed, 0);
    f->exposure_time = says;
    test_good(capture_probe_create(p, f, name, says, 400, &error), &error);
    p->tries = 1;
    brace_frame_destroy(f);
}

static void metadata_against_the_plan(void **state) {
    (void)state;
    brace_error error;
    brace_frame *f = photograph(1.0 / 64, 400, LIGHT, 1, 0);
    test_good(capture_verify_metadata(f, "frame_1", 1.0 / 60, 400, NULL, &error), &error);
    assert_int_equal(capture_verify_metadata(f, "frame_1", 1.0 / 80, 400, NULL, &error), BRACE_ERROR_MISMATCH);
    assert_string_equal(error.message, "frame_1 says 1/64 s, 1/80 s was asked for");
    assert_int_equal(capture_verify_metadata(f, "frame_1", 1.0 / 60, 500, NULL, &error), BRACE_ERROR_MISMATCH);
    f->exposure_time = 0, f->iso = 0; /* what a file does not say is not wrong */
    test_good(capture_verify_metadata(f, "frame_1", 1.0 / 80, 100, NULL, &error), &error);
    f->exposure_time = (double)NAN;
    test_good(capture_verify_metadata(f, "frame_1", 1.0 / 80, 100, NULL, &error), &error);
    brace_frame_destroy(f);
}

static void who_lies(void **state) {
    (void)state;
    static const double times[] = {0.012, 0.006, 0.003, 0.0015, 0.00075};
    static const char *const names[] = {"a", "b", "c", "d", "e"};
    char why[512];
    bool doubtful;
    capture_probe p[5];
    /* Nobody, then each in turn: two stops too dark, two too bright. */
    for (int liar = -1; liar < 5; liar++)
        for (int way = -1; way <= 1; way += 2) {
            for (int i = 0; i < 5; i++)
                make(&p[i], names[i], times[i] * (i == liar ? exp2(2 * way) : 1), times[i], (uint32_t)i + 7);
            const int found = capture_find_liar(p, 5, &doubtful, why, sizeof why);
            if (found != liar && !(liar == 0 && way > 0)) /* clipped and clipped more are the same */
                fail_msg("%d was found for %d, %s: %s", found, liar, way < 0 ? "dark" : "bright",
                         found >= 0 ? why : "");
            if (found >= 0) {
                assert_int_equal(why[0], names[liar][0]);
                assert_false(doubtful);
            }
            for (int i = 0; i < 5; i++)
                capture_probe_free(&p[i]);
        }
}

static void locked_and_identical(void **state) {
    (void)state;
    char why[512];
    bool doubtful;
    capture_probe p[3];
    make(&p[0], "a", 0.012, 0.012, 1);
    make(&p[1], "b", 0.003, 0.003, 2);
    make(&p[2], "c", 0.003, 0.00075, 3); /* the exposure of b */
    assert_int_equal(capture_find_liar(p, 3, &doubtful, why, sizeof why), 2);
    assert_non_null(strstr(why, "as bright as b"));
    assert_non_null(strstr(why, "locked"));
    capture_probe_free(&p[2]);
    make(&p[2], "c", 0.003, 0.00075, 2); /* its very file */
    assert_int_equal(capture_compare(&p[1], &p[2]).verdict, CAPTURE_IDENTICAL);
    assert_int_equal(capture_find_liar(p, 3, &doubtful, why, sizeof why), 2);
    assert_non_null(strstr(why, "sample for sample"));
    /* Two alone: the later, unless it was tried more often. */
    assert_int_equal(capture_find_liar(p + 1, 2, &doubtful, why, sizeof why), 1);
    p[2].tries = 2;
    assert_int_equal(capture_find_liar(p + 1, 2, &doubtful, why, sizeof why), 0);
    /* Two photographs of one exposure are no copies. */
    capture_probe twin;
    make(&twin, "t", 0.003, 0.003, 9);
    assert_int_equal(capture_compare(&p[1], &twin).verdict, CAPTURE_AGREE);
    capture_probe_free(&twin);
    for (int i = 0; i < 3; i++)
        capture_probe_free(&p[i]);
}

static void without_light(void **state) {
    (void)state;
    char why[512];
    bool doubtful = true;
    capture_probe p[3];
    make(&p[0], "a", 1e-9, 0.048, 1); /* the lens cap, on the longest */
    make(&p[1], "b", 0.012, 0.012, 2);
    make(&p[2], "c", 0.003, 0.003, 3);
    assert_int_equal(capture_find_liar(p, 3, &doubtful, why, sizeof why), 0);
    assert_non_null(strstr(why, "hardly any light"));
    assert_false(doubtful);
    assert_true(capture_brightest(&p[0]) < 0.05);
    assert_true(capture_brightest(&p[1]) > 0.5);
    capture_probe_free(&p[0]);
    make(&p[0], "a", 1e-9, 0.0007, 1); /* on the shortest: it may have fallen between two pulses */
    assert_int_equal(capture_find_liar(p, 3, &doubtful, why, sizeof why), 0);
    assert_true(doubtful);
    for (int i = 0; i < 3; i++)
        capture_probe_free(&p[i]);
}

static void means_of_frames(void **state) {
    (void)state;
    brace_error error;
    capture_average *average = NULL;
    brace_frame *mean = NULL, *frames[4], *odd;
    double error_of_mean = 0, error_of_one = 0;
    for (uint32_t i = 0; i < 4; i++) {
        frames[i] = photograph(0.006, 100, 4 * LIGHT, 20 + i, 0);
        for (int c = 0; c < 3; c++)
            frames[i]->noise[c][0] = 4e-4, frames[i]->noise[c][1] = 4e-6;
        frames[i]->has_noise = true;
        test_good(capture_average_add(&average, frames[i], &error), &error);
    }
    test_good(capture_average_finish(&mean, average, &error), &error);
    test_near(mean->exposure_time, 0.024, 1e-12);
    test_near(mean->iso, 25, 1e-12);
    test_near(mean->noise[1][0], 1e-4, 1e-12);
    test_near(mean->black[3], 4 * 64, 0);
    test_near(mean->white, 4 * 1023, 0);
    for (size_t i = 0; i < (size_t)WIDTH * HEIGHT; i++) {
        /* Scaled by four: nothing is lost. */
        const int total = frames[0]->data[i] + frames[1]->data[i] + frames[2]->data[i] + frames[3]->data[i];
        assert_int_equal(mean->data[i], total);
    }
    /* Half the noise of a single frame. */
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            const double truth = 64 + 959 * 4 * LIGHT * 0.6 * scene(x, y);
            const size_t i = (size_t)y * WIDTH + (size_t)x;
            error_of_one += pow(frames[0]->data[i] - truth, 2);
            error_of_mean += pow(mean->data[i] / 4.0 - truth, 2);
        }
    test_near(sqrt(error_of_mean / error_of_one), 0.5, 0.02);
    /* Others are refused, by name or for their exposure. */
    odd = photograph(0.003, 100, LIGHT, 5, 0);
    assert_int_equal(capture_average_add(&average, odd, &error), BRACE_ERROR_MISMATCH);
    odd->exposure_time = 0;
    capture_average *none = NULL;
    assert_int_equal(capture_average_add(&none, odd, &error), BRACE_ERROR_MISMATCH);
    assert_null(none);
    brace_frame_destroy(odd);
    brace_frame_destroy(mean);
    for (int i = 0; i < 4; i++)
        brace_frame_destroy(frames[i]);
    capture_average_destroy(average);
}

static void a_full_range_average(void **state) {
    (void)state;
    /* White near 65535 leaves no room to scale: the mean is rounded, and clipped stays clipped. */
    brace_error error;
    brace_frame *f, *mean;
    capture_average *average = NULL;
    test_good(brace_frame_create(&f, 32, 24, BRACE_CFA_RGGB, &error), &error);
    f->exposure_time = 0.1, f->iso = 100;
    for (size_t i = 0; i < 32 * 24; i++)
        f->data[i] = i % 3 == 0 ? 65535 : 1001;
    for (int i = 0; i < 3; i++)
        test_good(capture_average_add(&average, f, &error), &error);
    test_good(capture_average_finish(&mean, average, &error), &error);
    assert_memory_equal(mean->data, f->data, 32 * 24 * 2);
    test_near(mean->white, 65535, 0);
    brace_frame_destroy(mean);
    brace_frame_destroy(f);
    capture_average_destroy(average);
}

static void motion_is_found(void **state) {
    (void)state;
    brace_error error;
    brace_motion m;
    brace_frame *a = photograph(0.003, 400, LIGHT, 1, 0), *b = photograph(0.003, 400, LIGHT, 2, 4);
    test_good(capture_motion(&m, a, b, NULL, &error), &error);
    test_near(m.dx, -4, 0.3); /* its content lies four pixels to the left */
    test_near(m.dy, 0, 0.3);
    assert_true(m.confidence > 0.5);
    brace_frame *other;
    test_good(brace_frame_create(&other, 64, 48, BRACE_CFA_RGGB, &error), &error);
    test_good(capture_motion(&m, a, other, NULL, &error), &error);
    assert_true(isnan(m.dx) && m.confidence == 0);
    brace_frame_destroy(other);
    brace_frame_destroy(a);
    brace_frame_destroy(b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(metadata_against_the_plan), cmocka_unit_test(who_lies),
        cmocka_unit_test(locked_and_identical),      cmocka_unit_test(without_light),
        cmocka_unit_test(means_of_frames),           cmocka_unit_test(a_full_range_average),
        cmocka_unit_test(motion_is_found),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
