/* SPDX-License-Identifier: Apache-2.0 */
/* test_choices.c: the texts that cameras of many makers offer, and texts that are none. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "capture/choices.h"

static void near(double got, double want, const char *text) {
    if (!(fabs(got - want) <= 1e-9 * want))
        fail_msg("'%s' is %.12g, not %.12g", text, got, want);
}

static void exposures(void **state) {
    (void)state;
    static const struct {
        const char *text;
        double seconds;
    } good[] = {
        {"1/250", 1.0 / 250},
        {"0.5", 0.5},
        {"2s", 2},
        {"10/25", 0.4},
        {"1/1.3", 1 / 1.3},
        {"30", 30},
        {"1.3", 1.3},
        {"0.0040s", 0.004},
        {"1/8000s", 1 / 8e3},
        {"2.5s", 2.5},
        {"60m", 3600},
        {"2m", 120},
        {"1 1/3", 4.0 / 3},
        {"13/10", 1.3},
        {" 1/60 ", 1.0 / 60},
        {"4\"", 4},
        {"0,3", 0.3},
        {"1 / 15", 1.0 / 15},
        {"20 sec", 20},
        {"5 ms", 0.005},
        {"300/10", 30},
        {"1/32000", 1 / 32e3},
        {"1/2.5s", 0.4},
        {"1 min", 60},
    };
    static const char *const bad[] = {
        "",
        "bulb",
        "Bulb",
        "Time",
        "Auto",
        "auto",
        "x 200",
        "1/",
        "/250",
        "1/0",
        "0",
        "0.0000s",
        "-1",
        "1/-4",
        "1/250x",
        "1//2",
        "1e3",
        "0x10",
        "inf",
        "nan",
        "1/250/2",
        "1 2 3",
        "1.2.3",
        "s",
        "100000",
        "1 2/0",
        "1 2/",
        ".5",
        "1 2",
        "Composite",
        "unknown value 0x12",
        "1234567890123",
        "0.0000001",
        "99999999999999999999999999",
        "1/1000000000000",
    };
    double got;
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++) {
        got = -1;
        if (!capture_choice_exposure(good[i].text, &got))
            fail_msg("'%s' was not understood", good[i].text);
        near(got, good[i].seconds, good[i].text);
    }
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        if (capture_choice_exposure(bad[i], &got))
            fail_msg("'%s' was taken for %g s", bad[i], got);
}

static void speeds(void **state) {
    (void)state;
    double got;
    assert_true(capture_choice_iso("100", &got) && got >= 100 && got <= 100);
    assert_true(capture_choice_iso("ISO 6400", &got) && got >= 6400 && got <= 6400);
    assert_true(capture_choice_iso(" 25 ", &got) && got >= 25 && got <= 25);
    assert_true(capture_choice_iso("4000000", &got) && got >= 4e6 && got <= 4e6);
    static const char *const bad[] = {
        "",    "Auto",  "Auto ISO", "Hi 1", "Lo 0.3", "-1", "0", "100 Multi Frame Noise Reduction",
        "ISO", "1/100", "99999999", "100x", "0x64",   "Low"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        if (capture_choice_iso(bad[i], &got))
            fail_msg("'%s' was taken for ISO %g", bad[i], got);
    assert_true(capture_choice_aperture("f/5.6", &got));
    near(got, 5.6, "f/5.6");
    assert_true(capture_choice_aperture("f/4", &got) && capture_choice_aperture("8", &got));
    assert_true(capture_choice_aperture("F2.8", &got));
    near(got, 2.8, "F2.8");
    assert_false(capture_choice_aperture("implicit auto", &got));
    assert_false(capture_choice_aperture("0", &got));
    assert_false(capture_choice_aperture("f/", &got));
}

static void formats(void **state) {
    (void)state;
    static const struct {
        const char *text;
        int rank;
    } cases[] = {
        {"NEF (Raw)", 4},
        {"RAW", 4},
        {"Raw", 4},
        {"RAW + Large Fine JPEG", 1},
        {"NEF+Basic", 1},
        {"mRAW", 2},
        {"sRAW", 2},
        {"cRAW", 3},
        {"cRAW + Large Fine JPEG", 1},
        {"JPEG Fine", 0},
        {"Large Fine JPEG", 0},
        {"Extra Fine", 0},
        {"RAW (Small)", 2},
        {"RAW Compressed", 3},
        {"RAW Lossless Compressed", 4},
        {"RAW Uncompressed", 4},
        {"DNG", 4},
        {"RAW+JPEG (Std)", 1},
        {"", 0},
        {"Drawing", 0},
        {"straw", 0},
        {"rawhide", 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        if (capture_choice_raw(cases[i].text) != cases[i].rank)
            fail_msg("'%s' has rank %d, not %d", cases[i].text, capture_choice_raw(cases[i].text), cases[i].rank);
    char extension[8];
    assert_true(capture_name_is_raw("DSC_0001.NEF", extension));
    assert_string_equal(extension, "nef");
    assert_true(capture_name_is_raw("capt0000.cr3", extension));
    assert_false(capture_name_is_raw("DSC_0001.JPG", extension));
    assert_string_equal(extension, "jpg");
    assert_false(capture_name_is_raw("nef", extension));
    assert_false(capture_name_is_raw("a.n/f", extension));
    assert_string_equal(extension, "");
    assert_false(capture_name_is_raw("a.dngdngdng", extension));
    assert_string_equal(extension, "");
    assert_false(capture_name_is_raw("a.", extension));
}

static void stops(void **state) {
    (void)state;
    static capture_stops s;
    static const char *const offered[] = {
        "Bulb",  "1/4",  "30",
        "1/250", "0.25", "1/8000",
        "Auto",  "1",    "a text that is longer than any choice of a camera, and 1/2"};
    s.count = 0;
    for (size_t i = 0; i < sizeof offered / sizeof offered[0]; i++)
        capture_stops_add(&s, offered[i], capture_choice_exposure);
    assert_int_equal(s.count, 5);
    static const char *const want[] = {"1/8000", "1/250", "1/4", "1", "30"};
    for (size_t i = 0; i < 5; i++) {
        double value;
        assert_string_equal(s.texts[i], want[i]);
        assert_true(capture_choice_exposure(want[i], &value));
        near(s.values[i], value, want[i]);
    }
    assert_int_equal(capture_stops_nearest(&s, 0.005), 1);
    assert_int_equal(capture_stops_nearest(&s, 1e-9), 0);
    assert_int_equal(capture_stops_nearest(&s, 1e9), 4);
    for (int i = 0; i < 1000; i++) {
        char text[32];
        snprintf(text, sizeof text, "%d", 10000 - i);
        capture_stops_add(&s, text, capture_choice_iso);
    }
    assert_int_equal(s.count, CAPTURE_STOPS_MAX);
    for (size_t i = 1; i < s.count; i++)
        assert_true(s.values[i] > s.values[i - 1]);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(exposures),
        cmocka_unit_test(speeds),
        cmocka_unit_test(formats),
        cmocka_unit_test(stops),
    };
    return cmocka_run_group_tests_name("choices", tests, NULL, NULL);
}
