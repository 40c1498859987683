/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_displays.c: the light of every driver: exact integrals, means, windows
 * without banding; presets; and what is said about wrong files.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "sim/data_path.h"
#include "tests_sim.h"

/* Gauss-Legendre, 5 points: exact for lines, near exact for short pieces of exponentials. */
static double gauss(const sim_panel *p, uint32_t x, uint32_t y, int c, double level, double a, double b) {
    static const double at[] = {-0.9061798459386640, -0.5384693101056831, 0, 0.5384693101056831, 0.9061798459386640};
    static const double weight[] = {0.2369268850561891, 0.4786286704993665, 0.5688888888888889, 0.4786286704993665,
                                    0.2369268850561891};
    double sum = 0, middle = 0.5 * (a + b), half = 0.5 * (b - a);
    for (int i = 0; i < 5; i++)
        sum += weight[i] * sim_panel_emission(p, x, y, c, level, middle + half * at[i]);
    return sum * half;
}

static double adaptive(const sim_panel *p, uint32_t x, uint32_t y, int c, double level, double a, double b, int depth) {
    double middle = 0.5 * (a + b);
    double whole = gauss(p, x, y, c, level, a, b);
    double parts = gauss(p, x, y, c, level, a, middle) + gauss(p, x, y, c, level, middle, b);
    if (depth <= 0 || fabs(whole - parts) < 1e-9 * sim_panel_period(p))
        return parts;
    return adaptive(p, x, y, c, level, a, middle, depth - 1) + adaptive(p, x, y, c, level, middle, b, depth - 1);
}

/* Integral of the emission from a to b, piece by piece between the corners of the light. */
static double brute_force(const sim_panel *p, uint32_t x, uint32_t y, int c, double level, double a, double b) {
    static double edges[4096];
    size_t n = sim_panel_edges(p, x, y, c, level, edges, 4096);
    double period = sim_panel_period(p), sum = 0, from = a;
    for (double k = floor(a / period); k * period <= b; k++)
        for (size_t i = 0; i <= n; i++) {
            double to = i < n ? k * period + edges[i] : (k + 1) * period;
            to = fmin(to, b);
            if (to <= from)
                continue;
            /* Short pieces first: exponentials far shorter than the piece would slip through. */
            for (double step = 1e-6; from < to; step *= 2) {
                double next = fmin(to, from + step);
                sum += adaptive(p, x, y, c, level, from, next, 12);
                from = next;
            }
        }
    return sum;
}

static void check_panel(const sim_panel *p, core_random *r, int rounds) {
    double period = sim_panel_period(p);
    for (int i = 0; i < rounds; i++) {
        uint32_t x = core_random_below(r, p->width), y = core_random_below(r, p->height);
        int c = (int)core_random_below(r, 3);
        double level = i % 4 == 0 ? core_random_range(r, 1e-5, 0.01) : core_random_uniform(r);
        double a = core_random_range(r, -3, 20) * period;
        double b = a + core_random_range(r, 0, 2.5) * period;
        double exact = sim_panel_cumulative(p, x, y, c, level, b) - sim_panel_cumulative(p, x, y, c, level, a);
        double brute = brute_force(p, x, y, c, level, a, b);
        if (fabs(exact - brute) > 1e-6 * level * period)
            fail_msg("%s: x %u y %u channel %d level %.9g from %.12g to %.12g: %.12g, by brute force %.12g (period %g)",
                     sim_display_name(p->display), x, y, c, level, a, b, exact / period, brute / period, period);
        /* E(0) = 0, E grows, and a whole number of periods has the level's light wherever it starts. */
        assert_true(fabs(sim_panel_cumulative(p, x, y, c, level, 0)) < 1e-12 * period);
        assert_true(exact >= -1e-12 * period);
        int whole = 1 + (int)core_random_below(r, 5);
        double mean =
            (sim_panel_cumulative(p, x, y, c, level, a + whole * period) - sim_panel_cumulative(p, x, y, c, level, a)) /
            (whole * period);
        assert_true(fabs(mean - level) < 1e-7 * level + 1e-12);
        /* Far from zero too. */
        mean = sim_panel_cumulative(p, x, y, c, level, 1000 * period) / (1000 * period);
        assert_true(fabs(mean - level) < 1e-9 + 1e-12);
    }
}

static void test_random_parameters(void **state) {
    (void)state;
    core_random r = core_random_create(1, 2, 3, 4);
    float *rgb = test_screen(64, 48, 1);
    for (int kind = SIM_DC; kind <= SIM_RASTER; kind++)
        for (int i = 0; i < 150; i++) {
            sim_display *display = test_random_display((sim_driver_kind)kind, &r);
            sim_panel *panel = NULL;
            assert_int_equal(sim_panel_create(&panel, display, rgb, 64, 48, NULL), BRACE_OK);
            check_panel(panel, &r, 6);
            sim_panel_destroy(panel);
            sim_display_destroy(display);
        }
    free(rgb);
}

static void test_presets(void **state) {
    (void)state;
    json_t *names = sim_data_names("displays");
    assert_true(json_array_size(names) >= 25);
    bool seen[6] = {false};
    core_random r = core_random_create(5, 0, 0, 0);
    float *rgb = test_screen(320, 200, 2);
    for (size_t i = 0; i < json_array_size(names); i++) {
        const char *name = json_string_value(json_array_get(names, i));
        brace_error error = {BRACE_OK, ""};
        sim_display *display = NULL;
        if (sim_display_load(&display, name, &error) != BRACE_OK)
            fail_msg("%s", error.message);
        assert_string_equal(sim_display_name(display), name);
        assert_string_not_equal(sim_display_family(display), "other");
        seen[sim_display_kind(display)] = true;
        sim_panel *panel = NULL;
        assert_int_equal(sim_panel_create(&panel, display, rgb, 320, 200, &error), BRACE_OK);
        check_panel(panel, &r, 4);
        sim_panel_destroy(panel);
        /* What is written can be read, and means the same. */
        json_t *json = sim_display_json(display);
        char *text = json_dumps(json, 0);
        sim_display *again = NULL;
        if (sim_display_parse(&again, text, "again.json", &error) != BRACE_OK)
            fail_msg("%s", error.message);
        json_t *json_again = sim_display_json(again);
        assert_true(json_equal(json, json_again));
        json_decref(json);
        json_decref(json_again);
        free(text);
        sim_display_destroy(again);
        sim_display_destroy(display);
    }
    for (int k = 0; k < 6; k++)
        assert_true(seen[k]);
    json_decref(names);
    free(rgb);
}

/* Fourier component of a window's light against its start: for a raised sinusoid it falls as |sinc(f T)|. */
static void test_sinc(void **state) {
    (void)state;
    /* A pulse through a slow filter is close to a sinusoid. */
    sim_display *display = NULL;
    assert_int_equal(sim_display_parse(&display,
                                       "{\"driver\": \"lcd_pwm\", \"frequency\": 250, \"duty\": 0.5,"
                                       " \"decay\": [0.002, 0.002, 0.002]}",
                                       "sine.json", NULL),
                     BRACE_OK);
    sim_panel *p = NULL;
    const float white[3] = {1, 1, 1};
    assert_int_equal(sim_panel_create(&p, display, white, 1, 1, NULL), BRACE_OK);
    double first[2] = {0, 0};
    for (double t = 0.00001; t < 0.0150; t += 0.00037) {
        double cosine = 0, sine = 0;
        enum { N = 4096 };
        for (int i = 0; i < N; i++) {
            double a = i * 0.004 / N;
            double light = (sim_panel_cumulative(p, 0, 0, 0, 1, a + t) - sim_panel_cumulative(p, 0, 0, 0, 1, a)) / t;
            cosine += light * cos(2 * 3.14159265358979323846 * i / N);
            sine += light * sin(2 * 3.14159265358979323846 * i / N);
        }
        double amplitude = hypot(cosine, sine) / N * 2, x = 3.14159265358979323846 * 250 * t;
        if (first[0] == 0) {
            first[0] = amplitude * x / sin(x);
            /* The fundamental of a square wave of mean 1, behind the low pass. */
            double expected = 4 / 3.14159265358979323846 / sqrt(1 + pow(2 * 3.14159265358979323846 * 250 * 0.002, 2));
            assert_true(fabs(first[0] - expected) < 1e-3 * expected);
        }
        assert_true(fabs(amplitude - first[0] * fabs(sin(x) / x)) < 1e-5);
    }
    sim_panel_destroy(p);
    sim_display_destroy(display);
}

/* The rule of the LED chips, by hand. */
static void test_led_pattern(void **state) {
    (void)state;
    sim_display *display = NULL;
    assert_int_equal(sim_display_parse(&display,
                                       "{\"driver\": \"led_spwm\", \"refresh\": 100, \"subperiods\": 8, \"bits\": 8,"
                                       " \"scan\": 2, \"line_switch\": 0, \"blanking\": 0.2}",
                                       "led.json", NULL),
                     BRACE_OK);
    sim_panel *p = NULL;
    const float white[6] = {1, 1, 1, 1, 1, 1};
    assert_int_equal(sim_panel_create(&p, display, white, 1, 2, NULL), BRACE_OK);
    /* 8 ms for 8 cycles of 1 ms: half for each of two rows, 32 clocks of 1/64 ms. Count 3: cycles of rank 0, 1, 2
     * are 0, 4, 2; each lit for one clock. */
    double level = 3 / 255.0, clock = 1e-3 / 64;
    for (uint32_t row = 0; row < 2; row++)
        for (int m = 0; m < 10; m++) {
            double start = m * 1e-3 + row * 0.5e-3;
            bool lit = m == 0 || m == 4 || m == 2;
            double e = lit ? level * 0.01 / (3 * clock) : 0;
            assert_true(fabs(sim_panel_emission(p, 0, row, 1, level, start + 0.5 * clock) - e) < 1e-9);
            assert_true(fabs(sim_panel_emission(p, 0, row, 1, level, start + 1.5 * clock)) < 1e-9);
            double light = sim_panel_cumulative(p, 0, row, 1, level, start + clock) -
                           sim_panel_cumulative(p, 0, row, 1, level, start);
            assert_true(fabs(light - e * clock) < 1e-12);
        }
    sim_panel_destroy(p);
    sim_display_destroy(display);
}

/* Rows of a scanned panel see the same light one line time apart. */
static void test_scan(void **state) {
    (void)state;
    sim_display *display = NULL;
    assert_int_equal(sim_display_load(&display, "phone_oled_120_480", NULL), BRACE_OK);
    float *rgb = test_screen(8, 100, 3);
    sim_panel *p = NULL;
    assert_int_equal(sim_panel_create(&p, display, rgb, 8, 100, NULL), BRACE_OK);
    double line = 0.95 / 120 / 100;
    for (int i = 0; i < 1000; i++) {
        double t = i * 3.1e-5;
        assert_true(fabs(sim_panel_emission(p, 3, 50, 0, 0.5, t + 50 * line + 1e-9) -
                         sim_panel_emission(p, 5, 0, 0, 0.5, t + 1e-9)) < 1e-3);
    }
    sim_panel_destroy(p);
    sim_display_destroy(display);
    free(rgb);
}

/* Local dimming: dark zones have shorter pulses, the mean stays. */
static void test_zones(void **state) {
    (void)state;
    sim_display *display = NULL;
    assert_int_equal(sim_display_load(&display, "monitor_miniled_480", NULL), BRACE_OK);
    enum { W = 320, H = 180 };
    float *rgb = calloc(W * H * 3, sizeof *rgb);
    assert_non_null(rgb);
    for (size_t i = 0; i < W * H; i++)
        rgb[3 * i] = rgb[3 * i + 1] = rgb[3 * i + 2] = i % W < W / 2 ? 0.1f : 1.0f;
    sim_panel *p = NULL;
    assert_int_equal(sim_panel_create(&p, display, rgb, W, H, NULL), BRACE_OK);
    const lcd_zone *z = p->d.lcd.zone[1];
    assert_true(z[sim_panel_tile(p, W - 1, 5)].width > 5 * z[sim_panel_tile(p, 0, 5)].width);
    assert_int_equal(p->tile_count, 32 * 18);
    assert_int_equal(sim_panel_tile(p, W - 1, H - 1), 32 * 18 - 1);
    /* Rows of zones are lit one after another: the last one 0.9 * 17/18 of a period after the first. */
    assert_true(fabs(sim_panel_start(p, 0, H - 1, 0) - sim_panel_start(p, W - 1, 0, 0) - 0.85 / 480) < 1e-12);
    sim_panel_destroy(p);
    /* More zones than pixels: a zone for each pixel, no more. */
    assert_int_equal(sim_panel_create(&p, display, rgb, 3, 2, NULL), BRACE_OK);
    assert_int_equal(p->tile_count, 6);
    sim_panel_destroy(p);
    sim_display_destroy(display);
    free(rgb);
}

/* Modules of a wall run out of step, each for itself, and the same in every run. */
static void test_modules(void **state) {
    (void)state;
    sim_display *display = NULL;
    assert_int_equal(sim_display_load(&display, "led_wall_3840_16", NULL), BRACE_OK);
    sim_panel *p = NULL, *q = NULL;
    assert_int_equal(sim_panel_create(&p, display, NULL, 500, 300, NULL), BRACE_OK);
    assert_int_equal(sim_panel_create(&q, display, NULL, 500, 300, NULL), BRACE_OK);
    assert_int_equal(p->tile_count, 4 * 3);
    double start = sim_panel_start(p, 128, 128, 0);
    assert_true(start == sim_panel_start(p, 255, 240, 0)); /* the same module and row group */
    assert_true(start == sim_panel_start(q, 128, 128, 0));
    for (uint32_t y = 0; y < 300; y += 128)
        for (uint32_t x = 0; x < 500; x += 128)
            assert_true((x == 128 && y == 128) == (sim_panel_start(p, x, y, 0) == start));
    sim_panel_destroy(p);
    sim_panel_destroy(q);
    sim_display_destroy(display);
}

static void expect(const char *json, const char *message) {
    brace_error error = {BRACE_OK, ""};
    sim_display *display = (void *)1;
    brace_status status = sim_display_parse(&display, json, "oled.json", &error);
    if (status != BRACE_ERROR_FORMAT || strstr(error.message, message) == NULL)
        fail_msg("%s: status %d, \"%s\" instead of \"%s\"", json, (int)status, error.message, message);
    assert_null(display);
}

static void test_errors(void **state) {
    (void)state;
    expect("", "oled.json:1: not valid JSON");
    expect("[1]", "oled.json:1: an object");
    expect("{\n \"driver\": \"dc\",\n}", "oled.json:3: not valid JSON");
    expect("{\n\"driver\": \"dc\",\n\"driver\": \"dc\"}", "oled.json:3: not valid JSON: duplicate");
    expect("{}", "oled.json:1: driver: is missing");
    expect("{\n\"driver\": \"lamp\"}", "oled.json:2: driver: \"lamp\" is not one of dc, lcd_pwm, oled_pwm");
    expect("{\n\"driver\": 3}", "oled.json:2: driver: one of dc");
    expect("{\"driver\": \"dc\",\n\n \"duty\" : 1}", "oled.json:3: duty: is not known here; known are name, family");
    expect("{\n\n\"driver\": \"oled_pwm\",\n\"name\": \"a } \\\" ] pulses\",\n\"refresh\": 60,\n\n\"pulses\": 0}",
           "oled.json:7: pulses: 0 is out of range 1 to 128");
    expect("{\"driver\": \"oled_pwm\", \"refresh\": 60}", "oled.json:1: pulses: is missing");
    expect("{\"driver\": \"oled_pwm\", \"refresh\": \"60\", \"pulses\": 1}",
           "oled.json:1: refresh: a number is expected, not a string");
    expect("{\"driver\": \"oled_pwm\", \"refresh\": 60,\n \"pulses\": 1.5}", "oled.json:2: pulses: a whole number");
    expect("{\"driver\": \"oled_pwm\", \"refresh\": 60, \"pulses\": 3,\n \"alternate\": 0.5}",
           "oled.json:2: alternate: pulses that alternate must be even");
    expect("{\"driver\": \"oled_pwm\", \"refresh\": 60, \"pulses\": 3,\n \"dip_start\": 0.9,\n\"dip_width\": 0.2}",
           "oled.json:3: dip_width: the dip ends after the refresh");
    expect("{\"driver\": \"lcd_pwm\", \"frequency\": 1e999, \"duty\": 0.5}", "oled.json:1: not valid JSON");
    expect("{\"driver\": \"lcd_pwm\", \"frequency\": 100, \"duty\": 0.5, \"decay\": [0,\n0]}",
           "oled.json:1: decay: 3 numbers are expected, not 2");
    expect("{\"driver\": \"lcd_pwm\", \"frequency\": 100, \"duty\": 0.5,\n \"decay\": [0,\n0, \n -1]}",
           "oled.json:4: decay[2]: -1 is out of range 0 to 0.02");
    expect("{\"driver\": \"led_spwm\", \"refresh\": 60, \"subperiods\": 48,\n\"bits\": 14, \"scan\": 8}",
           "oled.json:1: subperiods: 48 is not a power of two");
    expect(
        "{\"driver\": \"led_spwm\", \"refresh\": 60, \"subperiods\": 32,\n\"bits\": 14, \"scan\": 8, \"unit\": 1024}",
        "oled.json:2: unit: 1024 is not a power of two up to the 512 clocks");
    expect("{\"driver\": \"led_spwm\", \"refresh\": 60, \"subperiods\": 32, \"bits\": 14, \"scan\": 8,\n"
           "\"tile\": [\n4.5, 8]}",
           "oled.json:3: tile[0]: a whole number");
    expect("{\"driver\": \"bcm\", \"refresh\": 60, \"bits\": 3,\n \"order\": [0, 1, 1]}",
           "oled.json:2: order: bit plane 2 is missing");
    expect("{\"driver\": \"bcm\", \"refresh\": 60, \"bits\": 2, \"order\": [0, 0.5, 1]}", "is not a whole number");
    expect("{\"driver\": \"bcm\", \"refresh\": 60, \"bits\": 2, \"windows\": [0, 1, 0.5, 0.6, 0, 1]}", "colour 1");
    brace_error error;
    sim_display *display;
    assert_int_equal(sim_display_load(&display, "no_such", &error), BRACE_ERROR_IO);
    assert_non_null(strstr(error.message, "no_such: there is no such preset among the displays; there are crt_60"));
    assert_int_equal(sim_display_load(&display, "./no_such.json", &error), BRACE_ERROR_IO);
    assert_non_null(strstr(error.message, "./no_such.json"));
    assert_int_equal(sim_display_load(&display, "", &error), BRACE_ERROR_ARGUMENT);
    /* Sizes. */
    sim_panel *panel;
    assert_int_equal(sim_display_load(&display, "led_wall_3840_16", &error), BRACE_OK);
    assert_int_equal(sim_panel_create(&panel, display, NULL, 0, 10, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(sim_panel_create(&panel, display, NULL, 20000, 20000, &error), BRACE_OK);
    sim_panel_destroy(panel);
    sim_display_destroy(display);
}

/* Memory that ends at any point is an error, and nothing leaks. */
static void test_memory(void **state) {
    (void)state;
    float *rgb = test_screen(64, 48, 1);
    const char *names[] = {"monitor_miniled_480", "led_wall_3840_low"};
    for (int k = 0; k < 2; k++) {
        bool done = false;
        for (long n = 1; n < 40 && !done; n++) {
            core_alloc_fail_after(n);
            sim_display *display = NULL;
            sim_panel *panel = NULL;
            brace_status status = sim_display_load(&display, names[k], NULL);
            if (status == BRACE_OK)
                status = sim_panel_create(&panel, display, rgb, 64, 48, NULL);
            core_alloc_fail_after(0);
            assert_true(status == BRACE_OK || status == BRACE_ERROR_MEMORY);
            done = status == BRACE_OK;
            sim_panel_destroy(panel);
            sim_display_destroy(display);
        }
        assert_true(done);
    }
    free(rgb);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_random_parameters), cmocka_unit_test(test_presets), cmocka_unit_test(test_sinc),
        cmocka_unit_test(test_led_pattern),       cmocka_unit_test(test_scan),    cmocka_unit_test(test_zones),
        cmocka_unit_test(test_modules),           cmocka_unit_test(test_errors),  cmocka_unit_test(test_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
