/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_picture.c: the physics of banding, measured in whole pictures.
 *
 * A flat screen straight ahead of a camera of 16 bits that sees the screen's own
 * primaries, without lens, noise or tremor. Row r starts at t + r tau, tau =
 * readout/height; a screen row that is driven l seconds after the one above it
 * adds -l m for each row of the picture, which sees m rows of the screen. So a
 * display of frequency f shows stripes of f (tau - m l) cycles a row.
 */
// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>
// clang-format on
#include <complex.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "brace/develop.h"
#include "sim/data_path.h"
#include "sim/display.h"
#include "sim/simulate.h"

#define TURN 6.283185307179586
enum { ROWS = 512, COLUMNS = 64, SIDE = 512 }; /* of the picture; of the screen */

static brace_image *flat(uint32_t side, double red, double green, double blue) {
    brace_image *image;
    assert_int_equal(brace_image_create(&image, side, side, 3, BRACE_SAMPLE_F32, BRACE_TRANSFER_LINEAR, NULL),
                     BRACE_OK);
    for (uint32_t y = 0; y < side; y++)
        for (uint32_t x = 0; x < side; x++) {
            float *p = (float *)((char *)image->data + y * image->stride) + 3 * (size_t)x;
            p[0] = (float)red, p[1] = (float)green, p[2] = (float)blue;
        }
    return image;
}

/* XYZ to linear sRGB (IEC 61966-2-1): what such a camera sees is what the screen shows. */
static sim_camera plain_camera(double readout) {
    static const double primaries[9] = {3.2404542, -1.5371385, -0.4985314, -0.9692660, 1.8760108,
                                        0.0415560, 0.0556434,  -0.2040259, 1.0572252};
    sim_camera c;
    assert_int_equal(sim_camera_load(&c, "phone_median", NULL), BRACE_OK);
    c.readout = readout, c.bits = 16, c.white = 65535;
    for (int i = 0; i < 4; i++)
        c.black[i] = 4096;
    for (int i = 0; i < 3; i++)
        c.neutral[i] = 1;
    memcpy(c.matrix, primaries, sizeof primaries);
    return c;
}

static sim_scene plain_scene(double exposure, double level) {
    sim_scene s;
    sim_scene_default(&s);
    s.width = COLUMNS, s.height = ROWS, s.pose.translation[2] = 0.1, s.seed = 11;
    s.frames = 3, s.reference_time = exposure, s.level = level, s.noise = false;
    return s;
}

static double rows_of_screen(const sim_scene *s) { /* m: that one row of the picture sees */
    return s->pose.translation[2] * SIDE / s->width;
}

static sim_display *display_of(const char *json) {
    sim_display *display;
    brace_error error = {BRACE_OK, ""};
    if (sim_display_parse(&display, json, "test", &error) != BRACE_OK)
        fail_msg("%s", error.message);
    return display;
}

static sim_capture capture(const brace_image *image, const sim_display *display, const sim_camera *camera,
                           const sim_scene *scene) {
    sim_capture out;
    brace_error error = {BRACE_OK, ""};
    brace_job job = {.threads = 2};
    if (sim_capture_create(&out, image, display, camera, scene, &job, &error) != BRACE_OK)
        fail_msg("%s", error.message);
    return out;
}

static double signal(const brace_frame *f, uint32_t x, uint32_t y) {
    double black = (double)f->black[(y & 1) * 2 + (x & 1)];
    return (f->data[(size_t)y * f->width + x] - black) / ((double)f->white - black);
}

static const double code = 1.0 / (65535 - 4096);

/* ---- stripes ---- */

typedef struct stripes {
    size_t n;
    double y[ROWS], v[ROWS];
} stripes;

/* Means of a colour's pixels in columns [x0, x1) of every row that has any. */
static stripes stripes_of(const brace_frame *f, int color, uint32_t x0, uint32_t x1) {
    stripes s = {0};
    for (uint32_t y = 0; y < f->height; y++) {
        double sum = 0, n = 0;
        for (uint32_t x = x0; x < x1; x++)
            if (brace_cfa_color(f->cfa, x, y) == color)
                sum += signal(f, x, y), n++;
        if (n > 0)
            s.y[s.n] = y, s.v[s.n++] = sum / n;
    }
    return s;
}

/* Amplitude and phase (at row 0) at `rate` cycles a row, of rows [from, to), through a window whose side lobes are
 * below 1e-4 (Blackman and Harris). */
static double complex at_rate(const stripes *s, double rate, double from, double to) {
    double complex sum = 0;
    double mean = 0, weight = 0;
    for (int pass = 0; pass < 2; pass++) {
        for (size_t i = 0; i < s->n; i++) {
            double u = (s->y[i] + 0.5 - from) / (to - from);
            if (u <= 0 || u >= 1)
                continue;
            double w = 0.35875 - 0.48829 * cos(TURN * u) + 0.14128 * cos(2 * TURN * u) - 0.01168 * cos(3 * TURN * u);
            if (pass == 0)
                mean += w * s->v[i], weight += w;
            else
                sum += w * (s->v[i] - mean / weight) * cexp(-I * TURN * rate * s->y[i]);
        }
    }
    return 2 * sum / weight;
}

/* Cycles a row of the strongest stripes: a search, then the turn of the phase between both halves. */
static double rate_of(const stripes *s) {
    double best = 0, rate = 0;
    for (double k = 6; k < 0.24 * ROWS; k += 0.5) { /* red and blue are on every second row only */
        double a = cabs(at_rate(s, k / ROWS, 0, ROWS));
        if (a > best)
            best = a, rate = k / ROWS;
    }
    for (int i = 0; i < 3; i++) {
        double complex top = at_rate(s, rate, 0, ROWS / 2), bottom = at_rate(s, rate, ROWS / 2, ROWS);
        rate += carg(bottom * conj(top)) / TURN / (ROWS / 2);
    }
    return rate;
}

static double green_rate(const char *json, const sim_camera *camera, const sim_scene *scene, double level) {
    brace_image *image = flat(SIDE, level, level, level);
    sim_display *display = display_of(json);
    sim_capture c = capture(image, display, camera, scene);
    stripes s = stripes_of(c.frame[1], 1, 0, COLUMNS);
    double rate = rate_of(&s);
    sim_capture_free(&c);
    sim_display_destroy(display);
    brace_image_destroy(image);
    return rate;
}

static void expect_rate(const char *what, double rate, double expected, double within) {
    if (!(fabs(rate / expected - 1) < within))
        fail_msg("%s: %.9f cycles a row, %.9f expected", what, rate, expected);
}

/* f tau, where all rows of the display are driven at once. */
static void test_frequency(void **state) {
    (void)state;
    static const struct {
        const char *json;
        double frequency, readout, exposure, level;
    } cases[] = {
        {"{\"driver\": \"lcd_pwm\", \"frequency\": 1000, \"duty\": 0.5}", 1000, 0.0145, 1e-4, 1},
        {"{\"driver\": \"lcd_pwm\", \"frequency\": 240, \"duty\": 0.1}", 240, 0.0676, 1e-3, 0.7},
        {"{\"driver\": \"lcd_pwm\", \"frequency\": 7311.3, \"duty\": 0.8, \"decay\": [3e-4, 2e-5, 1e-6]}", 7311.3,
         0.005, 3e-5, 0.4},
        {"{\"driver\": \"lcd_pwm\", \"frequency\": 480, \"duty\": 0.4, \"zone_columns\": 16, \"zone_rows\": 9}", 480,
         0.05, 3e-4, 0.5},
        {"{\"driver\": \"oled_pwm\", \"refresh\": 60, \"pulses\": 8, \"brightness\": 0.3, \"scan\": 0}", 480, 0.03,
         2e-4, 1},
        {"{\"driver\": \"led_spwm\", \"refresh\": 60, \"subperiods\": 32, \"bits\": 14, \"scan\": 1, \"blanking\": 0}",
         1920, 0.012, 2e-5, 2048.0 / 16383},
        {"{\"driver\": \"bcm\", \"refresh\": 600, \"bits\": 8, \"order\": [0,1,2,3,4,5,6,7]}", 600, 0.031, 1e-4, 0.502},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        sim_camera camera = plain_camera(cases[i].readout);
        sim_scene scene = plain_scene(cases[i].exposure, 0.05);
        expect_rate(cases[i].json, green_rate(cases[i].json, &camera, &scene, cases[i].level),
                    cases[i].frequency * cases[i].readout / ROWS,
                    1e-4); /* harmonics beyond half a cycle a row fold back */
    }
}

/* Rows driven one after another, downwards as the shutter runs or upwards against it. */
static void test_scanned_rows(void **state) {
    (void)state;
    char json[300];
    const double readout = 0.014, tau = readout / ROWS;
    sim_camera camera = plain_camera(readout);
    sim_scene scene = plain_scene(1e-4, 0.05);
    const double m = rows_of_screen(&scene);
    for (int up = 0; up < 2; up++) {
        double scan = up ? -0.95 : 0.95, l = scan / 120 / SIDE;
        snprintf(json, sizeof json,
                 "{\"driver\": \"oled_pwm\", \"refresh\": 120, \"pulses\": 16, \"brightness\": 0.4, \"scan\": %g}",
                 scan);
        double expected = fabs(1920 * (tau - m * l));
        assert_true(up ? expected > 1.4 * 1920 * tau : expected < 0.6 * 1920 * tau);
        expect_rate(json, green_rate(json, &camera, &scene, 1), expected, 5e-4);
        /* The screen upside down: the scan turns round. */
        scene.pose.rotation[2] = TURN / 2;
        expect_rate(json, green_rate(json, &camera, &scene, 1), fabs(1920 * (tau + m * l)), 5e-4);
        scene.pose.rotation[2] = 0;
    }
    /* A beam draws line after line. */
    camera.readout = 0.15;
    expect_rate("raster",
                green_rate("{\"driver\": \"raster\", \"refresh\": 85, \"decay\": [1e-3, 1e-3, 1e-3], \"active\": 0.92}",
                           &camera, &scene, 1),
                85 * (0.15 / ROWS - m * 0.92 / 85 / SIDE), 5e-4);
    /* A wall of scan 1/S lights row y at slot y mod S of an inner cycle: y/S of a cycle later. */
    camera.readout = 0.03;
    expect_rate("scanned wall",
                green_rate("{\"driver\": \"led_spwm\", \"refresh\": 60, \"subperiods\": 32, \"bits\": 14, \"scan\": 16,"
                           " \"blanking\": 0, \"line_switch\": 0}",
                           &camera, &scene, 8192.0 / 16383),
                fabs(1920 * 0.03 / ROWS - m / 16), 5e-4);
}

/* A scan along the picture's rows tilts the stripes: phase f tau a row and -f m l a column. */
static void test_tilted_stripes(void **state) {
    (void)state;
    sim_camera camera = plain_camera(0.02);
    sim_scene scene = plain_scene(2e-4, 0.2);
    scene.pose.translation[2] = 0.12;
    const double m = rows_of_screen(&scene), tau = 0.02 / ROWS;
    brace_image *image = flat(SIDE, 1, 1, 1);
    for (int left = 0; left < 2; left++) {
        double l = (left ? -0.8 : 0.8) / 60 / SIDE;
        sim_display *display =
            display_of(left ? "{\"driver\": \"oled_pwm\", \"refresh\": 60, \"pulses\": 16, \"brightness\": 0.5,"
                              "\"scan\": -0.8, \"scan_axis\": \"x\"}"
                            : "{\"driver\": \"oled_pwm\", \"refresh\": 60, \"pulses\": 16, \"brightness\": 0.5,"
                              "\"scan\": 0.8, \"scan_axis\": \"x\"}");
        sim_capture c = capture(image, display, &camera, &scene);
        const double rate = 960 * tau;
        stripes s = stripes_of(c.frame[1], 1, 0, 2);
        expect_rate("down", rate_of(&s), rate, 1e-4);
        /* A screen pixel's own time is that of its left side: blocks of 50 whole pixels have no bias. */
        stripes a = stripes_of(c.frame[1], 1, 0, 2), b = stripes_of(c.frame[1], 1, 50, 52);
        double across = carg(at_rate(&b, rate, 0, ROWS) * conj(at_rate(&a, rate, 0, ROWS))) / TURN;
        double expected = -960 * 50 * m * l;
        expected -= rint(expected);
        assert_true(fabs(across - expected) < 2e-3);
        sim_capture_free(&c);
        sim_display_destroy(display);
    }
    brace_image_destroy(image);
}

/* ---- contrast ---- */

/* Exposures of whole periods: no banding, whatever the driver. Before the sensor rounds. */
static void test_whole_periods(void **state) {
    (void)state;
    static const struct {
        const char *json;
        double period;
    } cases[] = {
        {"{\"driver\": \"lcd_pwm\", \"frequency\": 310, \"duty\": 0.3, \"decay\": [1e-3, 1e-4, 0]}", 1.0 / 310},
        {"{\"driver\": \"oled_pwm\", \"refresh\": 90, \"pulses\": 4, \"brightness\": 0.1, \"dip_depth\": 0.6,"
         " \"dip_width\": 0.1}",
         1.0 / 90},
        {"{\"driver\": \"led_spwm\", \"refresh\": 60, \"subperiods\": 16, \"bits\": 14, \"scan\": 8, \"tile\": [64, "
         "64],"
         " \"tile_phase\": 1}",
         1.0 / 60},
        {"{\"driver\": \"bcm\", \"refresh\": 300, \"bits\": 6, \"order\": [0,1,2,3,4,5], \"scan\": 8}", 1.0 / 300},
        {"{\"driver\": \"raster\", \"refresh\": 85, \"decay\": [1e-3, 6e-5, 5e-5]}", 1.0 / 85},
    };
    const double level[3] = {0.61, 0.34, 0.052};
    brace_image *image = flat(SIDE, level[0], level[1], level[2]);
    sim_texture texture;
    sim_light light;
    core_pool *pool;
    const brace_job job = {.threads = 2};
    assert_int_equal(core_pool_create(&pool, &job, NULL), BRACE_OK);
    assert_int_equal(sim_texture_create(&texture, image, NULL), BRACE_OK);
    assert_int_equal(sim_light_create(&light, COLUMNS, ROWS, NULL), BRACE_OK);
    sim_camera camera = plain_camera(0.0145);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        sim_display *display = display_of(cases[i].json);
        sim_panel *panel;
        assert_int_equal(sim_panel_create(&panel, display, texture.level[0].rgb, SIDE, SIDE, NULL), BRACE_OK);
        static const double periods[] = {1, 2, 5, 1.5};
        for (int k = 0; k < 4; k++) {
            sim_scene scene = plain_scene(periods[k] * cases[i].period, 1);
            const sim_stage stage = {&scene, &camera, &texture, NULL, panel, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
            assert_int_equal(sim_render(&light, &stage, 1, pool, NULL), BRACE_OK);
            double worst = 0;
            for (int c = 0; c < 3; c++)
                for (size_t p = 0; p < ROWS * COLUMNS; p++)
                    worst = fmax(worst, fabs((double)light.plane[c][p] / level[c] - 1));
            if (k < 3 ? worst > 3e-6 : worst < 0.02) /* and one and a half do band */
                fail_msg("%s: %g periods band by %g", cases[i].json, periods[k], worst);
        }
        sim_panel_destroy(panel);
        sim_display_destroy(display);
    }
    sim_light_free(&light);
    sim_texture_free(&texture);
    core_pool_destroy(pool);
    brace_image_destroy(image);
}

/* Contrast falls with the exposure as |sinc(f T)| times the drive's own first harmonic. */
static void test_sinc(void **state) {
    (void)state;
    /* 17 stripes in 512 rows: no harmonic below the 511th falls on the first. */
    sim_display *display =
        display_of("{\"driver\": \"lcd_pwm\", \"frequency\": 1000, \"duty\": 0.5, \"decay\": [4e-4, 4e-4, 4e-4]}");
    const double f = 1000;
    sim_camera camera = plain_camera(17 / f);
    brace_image *image = flat(SIDE, 1, 1, 1);
    sim_panel *panel;
    const float white[3] = {1, 1, 1};
    assert_int_equal(sim_panel_create(&panel, display, white, 1, 1, NULL), BRACE_OK);
    double complex own = 0;
    enum { STEPS = 20000 };
    for (int i = 0; i < STEPS; i++)
        own += 2.0 / STEPS * sim_panel_emission(panel, 0, 0, 1, 1, (i + 0.5) / f / STEPS) * cexp(-I * TURN * i / STEPS);
    sim_panel_destroy(panel);
    static const double turns[] = {0.01, 0.1, 0.25, 0.4, 0.5,  0.7, 0.9,  0.98,  1,   1.02, 1.25, 1.5,
                                   1.75, 1.9, 1.99, 2,   2.01, 2.5, 2.98, 3.001, 3.5, 4.5,  5.97, 10.5};
    for (size_t i = 0; i < sizeof turns / sizeof *turns; i++) {
        sim_scene scene = plain_scene(turns[i] / f, 0.5);
        sim_capture c = capture(image, display, &camera, &scene);
        stripes s = stripes_of(c.frame[1], 1, 0, COLUMNS);
        double complex sum = 0;
        double mean = 0, x = TURN / 2 * turns[i];
        for (size_t k = 0; k < s.n; k++)
            sum += s.v[k] * cexp(-I * TURN * 17 * s.y[k] / ROWS) * 2 / (double)s.n, mean += s.v[k] / (double)s.n;
        double expected = 0.5 * cabs(own) * fabs(sin(x) / x);
        if (!(fabs(cabs(sum) - expected) < 0.2 * code))
            fail_msg("fT = %g: amplitude %.8f, %.8f expected", turns[i], cabs(sum), expected);
        assert_true(fabs(mean - 0.5) < 0.6 * code);
        sim_capture_free(&c);
    }
    sim_display_destroy(display);
    brace_image_destroy(image);
}

/* ---- walls ---- */

static const char wall[] = "{\"driver\": \"led_spwm\", \"refresh\": 60, \"subperiods\": 32, \"bits\": 14, \"scan\": 1,"
                           " \"unit\": 16, \"line_switch\": 0, \"blanking\": 0}";

/* Colours of unequal level are lit for unequal parts of a cycle, from the same start: their stripes lie where the
 * middles of their pulses lie. The eye sees colour fringes, from a screen of one colour. */
static void test_color_shift(void **state) {
    (void)state;
    const double level[3] = {12288.0 / 16383, 6144.0 / 16383, 2048.0 / 16383};
    brace_image *image = flat(SIDE, level[0], level[1], level[2]);
    sim_display *display = display_of(wall);
    sim_camera camera = plain_camera(0.01);
    sim_scene scene = plain_scene(5e-5, 0.1);
    sim_capture c = capture(image, display, &camera, &scene);
    double complex wave[3];
    for (int color = 0; color < 3; color++) {
        stripes s = stripes_of(c.frame[1], color, 0, COLUMNS);
        expect_rate("a colour", rate_of(&s), 1920 * 0.01 / ROWS, 1e-4);
        wave[color] = at_rate(&s, 1920 * 0.01 / ROWS, 0, ROWS);
    }
    for (int color = 0; color < 3; color++) {
        int other = (color + 1) % 3;
        double shift = carg(wave[other] * conj(wave[color])) / TURN; /* of a cycle, later in time is negative */
        double expected = -0.5 * (level[other] - level[color]) * 16383 / 16384;
        assert_true(fabs(expected) > 0.1 && fabs(shift - expected) < 1e-3);
    }
    sim_capture_free(&c);
    sim_display_destroy(display);
    brace_image_destroy(image);
}

/* Below one unit for each cycle only some cycles are lit: the darker, the wider the stripes. */
static void test_brightness_dependent(void **state) {
    (void)state;
    sim_camera camera = plain_camera(0.04);
    sim_scene scene = plain_scene(2.5e-4, 0.2);
    for (int part = 1; part <= 8; part *= 2) {
        double level = 16.0 * 32 / part / 16383;
        expect_rate("dim wall", green_rate(wall, &camera, &scene, level), 1920.0 / part * 0.04 / ROWS, 5e-4);
    }
    /* Dynamic sub-periods do the same at once, below their threshold. */
    static const char dynamic[] =
        "{\"driver\": \"led_spwm\", \"refresh\": 60, \"subperiods\": 32, \"bits\": 14, \"scan\": 1, \"unit\": 16,"
        " \"line_switch\": 0, \"blanking\": 0, \"low_subperiods\": 8, \"low_below\": 2048}";
    expect_rate("above", green_rate(dynamic, &camera, &scene, 2048.0 / 16383), 1920 * 0.04 / ROWS, 5e-4);
    expect_rate("below", green_rate(dynamic, &camera, &scene, 1920.0 / 16383), 480 * 0.04 / ROWS, 5e-4);
}

/* Modules out of step: stripes jump at the seams, by the difference of their starts. */
static void test_jagged(void **state) {
    (void)state;
    static const char modules[] =
        "{\"driver\": \"led_spwm\", \"refresh\": 60, \"subperiods\": 32, \"bits\": 14, \"scan\": 1,"
        " \"line_switch\": 0, \"blanking\": 0, \"tile\": [256, 512], \"tile_phase\": 0.02, \"tile_seed\": 3}";
    const double f = 1920, level = 8192.0 / 16383;
    brace_image *image = flat(SIDE, level, level, level);
    sim_display *display = display_of(modules);
    sim_panel *panel;
    assert_int_equal(sim_panel_create(&panel, display, NULL, SIDE, SIDE, NULL), BRACE_OK);
    double step = sim_panel_start(panel, 256, 0, 1) - sim_panel_start(panel, 255, 0, 1);
    sim_panel_destroy(panel);
    double expected = -f * step;
    expected -= rint(expected);
    assert_true(fabs(expected) > 0.05);
    sim_camera camera = plain_camera(0.01);
    sim_scene scene = plain_scene(5e-5, 0.2);
    sim_capture c = capture(image, display, &camera, &scene);
    const double rate = f * 0.01 / ROWS;
    double complex before[2];
    for (int side = 0; side < 2; side++) {
        stripes a = stripes_of(c.frame[1], 1, side ? 34 : 0, side ? 48 : 16),
                b = stripes_of(c.frame[1], 1, side ? 48 : 16, side ? 64 : 30);
        expect_rate("a module", rate_of(&a), rate, 1e-4);
        before[side] = at_rate(&a, rate, 0, ROWS);
        assert_true(fabs(carg(at_rate(&b, rate, 0, ROWS) * conj(before[side]))) < 1e-4); /* straight within a module */
    }
    assert_true(fabs(carg(before[1] * conj(before[0])) / TURN - expected) < 1e-4);
    sim_capture_free(&c);
    sim_display_destroy(display);
    brace_image_destroy(image);
}

/* ---- the truth ---- */

/* What a colour of the camera makes of the screen's. */
static double seen(const brace_frame *f, const double level[3], int color) {
    brace_color path;
    assert_int_equal(brace_color_init(&path, f, NULL), BRACE_OK);
    double sum = 0;
    for (int k = 0; k < 3; k++)
        sum += path.srgb_to_camera[3 * color + k] / path.wb[color] * level[k];
    return sum;
}

/* Of every preset: the screen's level, and what an endless exposure comes to. */
static void test_truth(void **state) {
    (void)state;
    json_t *names = sim_data_names("displays");
    static const double levels[][3] = {{0.43, 0.21, 0.77}, {0.013, 0.006, 0.021}, {1, 1, 1}};
    const sim_camera camera = plain_camera(0.0145);
    for (size_t i = 0; i < json_array_size(names); i++)
        for (int k = 0; k < 3; k++) {
            const double *level = levels[k];
            brace_image *image = flat(48, level[0], level[1], level[2]);
            sim_display *display;
            sim_panel *panel;
            assert_int_equal(sim_display_load(&display, json_string_value(json_array_get(names, i)), NULL), BRACE_OK);
            float rgb[3] = {(float)level[0], (float)level[1], (float)level[2]};
            assert_int_equal(sim_panel_create(&panel, display, rgb, 1, 1, NULL), BRACE_OK);
            /* The truth does not depend on the exposure; a long one comes near it: what is left of a period adds at
             * most that period's light. */
            static const double times[2] = {0.00037, 2.0137};
            for (int t = 0; t < 2; t++) {
                sim_scene scene = plain_scene(times[t], 0.9);
                scene.width = scene.height = 48, scene.pose.translation[2] = 0.5;
                sim_capture c = capture(image, display, &camera, &scene);
                const double expected[3] = {seen(c.truth, level, 0), seen(c.truth, level, 1), seen(c.truth, level, 2)};
                const double off = sim_panel_period(panel) / times[t];
                for (int color = 0; color < 3; color++) /* this camera hardly mixes them */
                    assert_true(fabs(expected[color] - level[color]) < 5e-4);
                for (uint32_t y = 0; y < 48; y++)
                    for (uint32_t x = 0; x < 48; x++) {
                        const double want = 0.9 * expected[brace_cfa_color(c.truth->cfa, x, y)];
                        const double truth = signal(c.truth, x, y), light = signal(c.frame[1], x, y);
                        if (!(fabs(truth - want) < 0.51 * code + 2e-6))
                            fail_msg("%s: truth %.8f, %.8f expected", sim_display_name(display), truth, want);
                        if (t == 1 && !(fabs(light - want) < 0.51 * code + 2e-6 + off * want))
                            fail_msg("%s: long exposure %.8f, %.8f expected", sim_display_name(display), light, want);
                    }
                sim_capture_free(&c);
            }
            sim_panel_destroy(panel);
            sim_display_destroy(display);
            brace_image_destroy(image);
        }
    json_decref(names);
}

/* ---- noise ---- */

enum { PATCHES = 12, PATCH = 128, TALL = 768 };

/* Mean-variance curve of the patches of a steady picture against the profile that the frame states. */
static void check_profile(const brace_frame *const *frames, int count) {
    double a[3] = {0}, b[2] = {0}, x[9 * PATCHES], v[9 * PATCHES], w[9 * PATCHES];
    size_t n = 0;
    const brace_frame *reference = frames[0];
    for (int k = 0; k < count; k++)
        for (uint32_t p = 0; p < PATCHES; p++) {
            const brace_frame *f = frames[k];
            double sum = 0, square = 0, pixels = 0;
            for (uint32_t y = 0; y < TALL; y++)
                for (uint32_t i = p * PATCH + 4; i < (p + 1) * PATCH - 4; i++) {
                    double s = signal(f, i, y);
                    sum += s, square += s * s, pixels++;
                }
            x[n] = sum / pixels, v[n] = (square - sum * sum / pixels) / (pixels - 1) - code * code / 12;
            double expected = reference->noise[1][0] * x[n] + reference->noise[1][1];
            if (x[n] + 6 * sqrt(expected) > 1)
                continue; /* clips */
            w[n] = pixels / (2 * expected * expected);
            a[0] += w[n] * x[n] * x[n], a[1] += w[n] * x[n], a[2] += w[n];
            b[0] += w[n] * x[n] * v[n], b[1] += w[n] * v[n];
            n++;
        }
    assert_true(n >= 8);
    double det = a[0] * a[2] - a[1] * a[1], s = (a[2] * b[0] - a[1] * b[1]) / det,
           o = (a[0] * b[1] - a[1] * b[0]) / det;
    double chi = 0;
    for (size_t i = 0; i < n; i++)
        chi += w[i] * pow(v[i] - s * x[i] - o, 2);
    if (!(fabs(s / reference->noise[1][0] - 1) < 0.01) || !(fabs(o / reference->noise[1][1] - 1) < 0.01))
        fail_msg("S %.5g O %.5g, the profile says %.5g %.5g", s, o, reference->noise[1][0], reference->noise[1][1]);
    assert_true(chi / (double)(n - 2) > 0.3 && chi / (double)(n - 2) < 2); /* it is a straight line */
}

static void test_noise(void **state) {
    (void)state;
    static const double levels[PATCHES] = {0, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1};
    brace_image *image;
    assert_int_equal(
        brace_image_create(&image, PATCHES * PATCH, TALL, 3, BRACE_SAMPLE_F32, BRACE_TRANSFER_LINEAR, NULL), BRACE_OK);
    for (uint32_t y = 0; y < TALL; y++)
        for (size_t i = 0; i < 3 * (size_t)image->width; i++)
            ((float *)((char *)image->data + y * image->stride))[i] = (float)levels[i / 3 / PATCH];
    sim_camera camera = plain_camera(0.0145);
    sim_scene scene = plain_scene(1.0 / 320, 0.6);
    scene.width = PATCHES * PATCH, scene.height = TALL, scene.pose.translation[2] = 1, scene.iso = 1600;
    scene.frames = 3, scene.noise = scene.field = true;
    sim_display *display = display_of("{\"driver\": \"dc\"}");
    sim_capture c = capture(image, display, &camera, &scene);
    check_profile((const brace_frame *const *)c.frame, 3);
    check_profile((const brace_frame *const *)&c.truth, 1);
    assert_true(fabs(c.truth->noise[1][0] / c.frame[0]->noise[1][0] - 1.0 / 8) < 1e-9);
    /* Without light: black is in the middle of the noise, not its end. */
    for (int k = 0; k <= 3; k++) {
        const brace_frame *f = k < 3 ? c.frame[k] : c.truth;
        double n = 0, below = 0, above = 0, mean = 0, skew = 0, lowest = 1;
        const double deviation = sqrt(f->noise[1][1]);
        for (uint32_t y = 0; y < TALL; y++)
            for (uint32_t x = 4; x < PATCH - 4; x++) {
                double s = signal(f, x, y) / deviation;
                n++, below += s<0, above += s> 0, mean += s, skew += s * s * s;
                lowest = fmin(lowest, s);
            }
        assert_true(fabs(below - above) < 4 * sqrt(n) && below + above > 0.97 * n);
        assert_true(fabs(mean / n) < 4 / sqrt(n) && fabs(skew / n) < 4 * sqrt(15 / n) && lowest < -3.5);
    }
    sim_capture_free(&c);
    sim_display_destroy(display);
    brace_image_destroy(image);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_frequency),
        cmocka_unit_test(test_scanned_rows),
        cmocka_unit_test(test_tilted_stripes),
        cmocka_unit_test(test_whole_periods),
        cmocka_unit_test(test_sinc),
        cmocka_unit_test(test_color_shift),
        cmocka_unit_test(test_brightness_dependent),
        cmocka_unit_test(test_jagged),
        cmocka_unit_test(test_truth),
        cmocka_unit_test(test_noise),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
