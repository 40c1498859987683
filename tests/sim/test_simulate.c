/* SPDX-License-Identifier: Apache-2.0 */
/* test_simulate.c: captures against what physics says of them. */
// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>
// clang-format on
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "brace/restore.h"
#include "brace/simulate.h"
#include "sim/data_path.h"
#include "sim/quantities.h"
#include "sim/simulate.h"

static brace_image *screen(uint32_t width, uint32_t height, uint8_t grey) {
    brace_image *image;
    brace_error error;
    assert_int_equal(brace_image_create(&image, width, height, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, &error),
                     BRACE_OK);
    for (uint32_t y = 0; y < height; y++)
        memset((char *)image->data + y * image->stride, grey, 3 * (size_t)width);
    return image;
}

/* Close enough for the screen to fill the frame. */
static sim_scene plain_scene(void) {
    sim_scene s;
    sim_scene_default(&s);
    s.width = 192, s.height = 128, s.pose.translation[2] = 0.5, s.reference_time = 1.0 / 640, s.level = 0.5, s.seed = 3;
    return s;
}

static sim_capture capture(const brace_image *image, const char *display_json, const sim_scene *scene, int threads) {
    sim_display *display;
    sim_camera camera;
    sim_capture out;
    brace_error error = {BRACE_OK, ""};
    brace_job job = {.threads = threads};
    if (sim_display_parse(&display, display_json, "test", &error) || sim_camera_load(&camera, "phone_median", &error) ||
        sim_capture_create(&out, image, display, &camera, scene, &job, &error))
        fail_msg("%s", error.message);
    sim_display_destroy(display);
    return out;
}

static double signal(const brace_frame *f, uint32_t x, uint32_t y) {
    double black = (double)f->black[(y & 1) * 2 + (x & 1)];
    return (f->data[(size_t)y * f->width + x] - black) / ((double)f->white - black);
}

static const char steady[] = "{\"driver\": \"dc\"}";

static void test_steady_light_is_exact(void **state) {
    (void)state;
    brace_image *image = screen(64, 48, 188); /* linear 0.503 */
    sim_scene s = plain_scene();
    s.noise = false;
    sim_capture c = capture(image, steady, &s, 0);
    double level = pow((188 / 255.0 + 0.055) / 1.055, 2.4);
    for (int i = 0; i <= 5; i++) {
        const brace_frame *f = i < 5 ? c.frame[i] : c.truth;
        double want = s.level * level * (i < 5 ? pow(4, i - 2) : 1);
        for (uint32_t y = 40; y < 80; y++)
            for (uint32_t x = 60; x < 120; x++) {
                double w =
                    want * f->as_shot_neutral[brace_cfa_color(f->cfa, x, y)]; /* grey through the camera's eyes */
                double v = signal(f, x, y);
                assert_true(fabs(v - fmin(w, 1)) < 0.6 / 3839 + 2e-3 * w);
            }
    }
    sim_capture_free(&c);
    brace_image_destroy(image);
}

static void test_threads_do_not_matter(void **state) {
    (void)state;
    brace_image *image = screen(40, 30, 200);
    sim_scene s;
    sim_scene_sample(&s, 99, 4, true);
    s.width = 150, s.height = 100;
    const char wall[] = "{\"driver\": \"led_spwm\", \"refresh\": 60, \"subperiods\": 32, \"bits\": 14, \"scan\": 8}";
    sim_capture one = capture(image, wall, &s, 1), two = capture(image, wall, &s, 2);
    for (int i = 0; i < 5; i++)
        assert_memory_equal(one.frame[i]->data, two.frame[i]->data, 150 * 100 * sizeof(uint16_t));
    assert_memory_equal(one.truth->data, two.truth->data, 150 * 100 * sizeof(uint16_t));
    /* Another sample of the same seed is another capture. */
    s.sample = 5;
    sim_capture other = capture(image, wall, &s, 1);
    assert_true(memcmp(one.frame[2]->data, other.frame[2]->data, 150 * 100 * sizeof(uint16_t)) != 0);
    sim_capture_free(&one), sim_capture_free(&two), sim_capture_free(&other);
    brace_image_destroy(image);
}

/* The loops over pixels give the same bytes whatever they are compiled for: here under steady light, as the displays'
 * own kernels agree to 1e-5 only. Odd sizes leave odd ends. */
static void test_instruction_sets_do_not_matter(void **state) {
    (void)state;
    brace_image *image = screen(61, 47, 90);
    for (uint32_t y = 0; y < 47; y++)
        for (uint32_t x = 0; x < 61; x++)
            ((uint8_t *)image->data)[y * image->stride + 3 * x + (x + y) % 3] = (uint8_t)(x * 37 + y * 11);
    sim_scene s;
    sim_scene_sample(&s, 7, 1, true);
    s.width = 211, s.height = 131, s.defocus = 2.5, s.supersample = 2, s.tremor_position = 0.01;
    static const char *const sets[] = {"plain", "avx2", "avx512"}; /* those that the machine has not are lowered */
    sim_capture first = {0};
    for (int k = 0; k < 3; k++) {
        setenv("BRACE_CPU", sets[k], 1);
        sim_capture c = capture(image, steady, &s, 2);
        for (int i = 0; k > 0 && i < 5; i++)
            assert_memory_equal(first.frame[i]->data, c.frame[i]->data, 211 * 131 * sizeof(uint16_t));
        if (k == 0)
            first = c;
        else
            sim_capture_free(&c);
    }
    unsetenv("BRACE_CPU");
    sim_capture_free(&first);
    brace_image_destroy(image);
}

/* Every normal number of the noise, not only its variance: a steady grey, its skew, tails and neighbours. */
static void test_noise_is_normal_and_white(void **state) {
    (void)state;
    brace_image *image = screen(16, 16, 188);
    sim_scene s = plain_scene();
    s.width = 1024, s.height = 1024, s.iso = 800, s.pose.translation[2] = 0.3;
    sim_capture c = capture(image, steady, &s, 0);
    const brace_frame *f = c.frame[2];
    double n = 0, m = 0, v = 0, skew = 0, tails = 0, right = 0, below = 0, other = 0, beyond = 0;
    for (int pass = 0; pass < 2; pass++)
        for (uint32_t y = 0; y + 2 < s.height; y++)
            for (uint32_t x = 0; x + 2 < s.width; x++) {
                if (brace_cfa_color(f->cfa, x, y) != 1)
                    continue;
                double a = signal(f, x, y) - (pass ? m / n : 0);
                if (pass == 0) {
                    m += a, n++;
                    continue;
                }
                v += a * a, skew += a * a * a, tails += a * a * a * a;
                right += a * (signal(f, x + 2, y) - m / n), below += a * (signal(f, x, y + 2) - m / n);
                other += a * (signal(f, x + 1, y + 1) - m / n);
                beyond += fabs(a) > 3 * sqrt(f->noise[1][0] * m / n + f->noise[1][1]);
            }
    v /= n;
    assert_true(fabs(skew / n / pow(v, 1.5)) < 0.02);
    assert_true(fabs(tails / n / (v * v) - 3) < 0.04);
    assert_true(fabs(right / n / v) < 0.006 && fabs(below / n / v) < 0.006 && fabs(other / n / v) < 0.006);
    assert_true(fabs(beyond / n - 0.0027) < 0.0004);
    sim_capture_free(&c);
    brace_image_destroy(image);
}

/* A fine checkerboard from afar is grey, however the screen is rolled: no moire of a filter that is too narrow. */
static void test_far_screens_are_averaged(void **state) {
    (void)state;
    brace_image *image = screen(1024, 1024, 0);
    for (uint32_t y = 0; y < 1024; y++)
        for (uint32_t x = 0; x < 1024; x++)
            if ((x + y) % 2)
                memset((char *)image->data + y * image->stride + 3 * x, 255, 3);
    for (int turn = 0; turn < 4; turn++) {
        sim_scene s = plain_scene();
        s.noise = false, s.pose.translation[2] = 0.5, s.pose.rotation[2] = turn * 0.5235987755982988;
        sim_capture c = capture(image, steady, &s, 1);
        for (uint32_t y = 0; y < s.height; y++)
            for (uint32_t x = 0; x < s.width; x++)
                if (brace_cfa_color(c.truth->cfa, x, y) == 1)
                    assert_true(fabs(signal(c.truth, x, y) / s.level - 0.5) < 0.02);
        sim_capture_free(&c);
    }
    brace_image_destroy(image);
}

/* Motion blur: more sub-exposures than needed change nothing that matters, and a tripod needs one. */
static void test_motion_is_followed(void **state) {
    (void)state;
    brace_image *image = screen(160, 120, 40);
    for (uint32_t y = 0; y < 120; y++)
        memset((char *)image->data + y * image->stride + 3 * 60, 220, 3 * 40);
    sim_scene s = plain_scene();
    s.noise = false, s.level = 0.04, s.reference_time = 1.0 / 60, s.tremor_position = 0.02, s.psf = 0.7;
    sim_capture c[3];
    static const int parts[3] = {1, 32, 256};
    for (int i = 0; i < 3; i++) {
        s.subexposures = parts[i];
        c[i] = capture(image, steady, &s, 2);
    }
    double sharp = 0, blurred = 0;
    for (uint32_t y = 4; y < s.height - 4; y++)
        for (uint32_t x = 4; x < s.width - 4; x++) {
            sharp += fabs(signal(c[0].frame[4], x, y) - signal(c[2].frame[4], x, y));
            blurred += fabs(signal(c[1].frame[4], x, y) - signal(c[2].frame[4], x, y));
        }
    if (!(blurred < sharp / 10))
        fail_msg("one part is off by %g, enough parts by %g", sharp, blurred);
    for (int i = 0; i < 3; i++)
        sim_capture_free(&c[i]);
    brace_image_destroy(image);
}

static void test_merge_restores_a_capture(void **state) {
    (void)state;
    brace_image *image = screen(160, 120, 60);
    for (uint32_t y = 0; y < 120; y++)
        for (uint32_t x = 0; x < 160; x++)
            if ((x / 20 + y / 15) % 2)
                memset((char *)image->data + y * image->stride + 3 * x, 150, 3);
    sim_scene s = plain_scene();
    s.level = 0.3;
    sim_capture c = capture(image, "{\"driver\": \"lcd_pwm\", \"frequency\": 400, \"duty\": 0.45}", &s, 0);
    brace_bracket *bracket;
    brace_restored *merged;
    brace_error error = {BRACE_OK, ""};
    const brace_frame *truth = c.truth;
    brace_frame *frames[5];
    memcpy(frames, c.frame, sizeof frames);
    assert_int_equal(brace_bracket_create(&bracket, frames, 5, NULL, NULL, &error), BRACE_OK);
    c.count = 0; /* the bracket's now */
    assert_int_equal(brace_restore(&merged, bracket, NULL, NULL, &error), BRACE_OK);
    double before = 0, after = 0;
    for (uint32_t y = 8; y < s.height - 8; y++)
        for (uint32_t x = 8; x < s.width - 8; x++) {
            before += pow(signal(bracket->frames[2], x, y) - signal(truth, x, y), 2);
            after += pow(signal(merged->frame, x, y) - signal(truth, x, y), 2);
        }
    assert_true(after < before / 20);
    brace_restored_destroy(merged);
    brace_bracket_destroy(bracket);
    sim_capture_free(&c);
    brace_image_destroy(image);
}

static void test_impossible_values(void **state) {
    (void)state;
    brace_error error = {BRACE_OK, ""};
    sim_scene s = plain_scene();
    assert_int_equal(sim_scene_check(&s, &error), BRACE_OK);
    s.reference_time = NAN;
    assert_int_equal(sim_scene_check(&s, &error), BRACE_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "reference_time"));
    s = plain_scene(), s.frames = 4;
    assert_int_equal(sim_scene_check(&s, &error), BRACE_ERROR_ARGUMENT);
    s = plain_scene(), s.pose.translation[2] = -1;
    assert_int_equal(sim_scene_check(&s, &error), BRACE_ERROR_ARGUMENT);
    sim_camera camera;
    assert_true(sim_camera_load(&camera, "no_such_camera", &error) != BRACE_OK);
    /* A screen of one pixel is a lamp. */
    brace_image *one = screen(1, 1, 255);
    s = plain_scene(), s.pose.rotation[0] = 1.2;
    sim_capture c = capture(one, steady, &s, 1);
    assert_int_equal(c.count, 5);
    sim_capture_free(&c);
    brace_image_destroy(one);
}

/* ---- the lens ---- */

/* Contrast of rows around their mean, of one colour, where the screen is even. */
static double row_contrast(const brace_frame *f, uint32_t x) {
    double sum = 0, square = 0, n = 0;
    for (uint32_t y = 8; y + 8 < f->height; y++) {
        double v = 0.5 * (signal(f, x, y) / f->as_shot_neutral[brace_cfa_color(f->cfa, x, y)] +
                          signal(f, x + 1, y) / f->as_shot_neutral[brace_cfa_color(f->cfa, x + 1, y)]);
        sum += v, square += v * v, n++;
    }
    return sqrt(fmax(square / n - sum / n * (sum / n), 0)) / (sum / n);
}

/* Stripes four rows long: every row has its own time, and no lens changes that. */
static void test_fast_stripes_pass_the_lens(void **state) {
    (void)state;
    brace_image *image = screen(64, 48, 255);
    sim_scene s = plain_scene();
    s.noise = 0;
    const char light[] = "{\"driver\": \"lcd_pwm\", \"frequency\": 2207, \"duty\": 0.5}";
    sim_capture sharp = capture(image, light, &s, 0);
    s.psf = 2, s.defocus = 8;
    sim_capture soft = capture(image, light, &s, 0);
    double a = row_contrast(sharp.frame[0], 96), b = row_contrast(soft.frame[0], 96);
    assert_true(a > 0.6);
    if (fabs(b / a - 1) > 1e-3)
        fail_msg("contrast %g of sharp stripes, %g of blurred ones", a, b);
    sim_capture_free(&sharp), sim_capture_free(&soft);
    brace_image_destroy(image);
}

/* A page with bars and a patch, before a backlight that all of it shares: light is a product of place and time. */
static brace_image *page(void) {
    brace_image *image = screen(256, 192, 30);
    for (uint32_t y = 0; y < 192; y++)
        for (uint32_t x = 0; x < 256; x++)
            if ((x > 60 && x < 120 && y > 30 && y < 90) || (x > 150 && (x / 12) % 2) || (y > 110 && (y / 9) % 2))
                memset((char *)image->data + y * image->stride + 3 * x, 230, 3);
    return image;
}

/* Steady: the blurred picture is the sharp one, sampled finely, averaged with the lens's weights. Flickering: every
 * row of it is dimmed as its time says, edges or not. */
static void blur_equals_brute_force(double psf, double defocus, int supersample, double allowed) {
    brace_image *image = page();
    sim_scene s = plain_scene();
    s.noise = 0, s.level = 0.9, s.pose.translation[2] = 0.9, s.pose.rotation[2] = 0.1;
    const char light[] = "{\"driver\": \"lcd_pwm\", \"frequency\": 1700, \"duty\": 0.4}";
    /* Three times as many pixels make the sharp picture; each still sees its own third. */
    sim_scene fine = s;
    fine.width *= 3, fine.height *= 3, fine.supersample = 4;
    sim_capture reference = capture(image, steady, &fine, 0);
    s.psf = psf, s.defocus = defocus, s.supersample = supersample;
    sim_capture blurred = capture(image, light, &s, 0);
    const brace_frame *sharp = reference.truth, *soft = blurred.truth, *stripes = blurred.frame[0];
    double off = 0, mixed = 0, n = 0, span = 0;
    for (uint32_t y = 24; y + 24 < s.height; y += 3) {
        /* How much this row's time lets through, from its brightest pixel. */
        double dim = 0, brightest = 0;
        for (uint32_t x = 40; x + 40 < s.width; x++)
            if (signal(soft, x, y) > brightest && brace_cfa_color(soft->cfa, x, y) == 1)
                brightest = signal(soft, x, y), dim = signal(stripes, x, y) / brightest;
        for (uint32_t x = 40; x + 40 < s.width; x++) {
            if (brace_cfa_color(soft->cfa, x, y) != 1)
                continue;
            double sum = 0, weight = 0;
            const int reach = (int)(3 * (3 * psf + defocus)) + 3;
            for (int j = -reach; j <= reach; j++)
                for (int i = -reach; i <= reach; i++) {
                    const uint32_t fx = (uint32_t)((int)(3 * x + 1) + i), fy = (uint32_t)((int)(3 * y + 1) + j);
                    if (fx >= sharp->width || fy >= sharp->height || brace_cfa_color(sharp->cfa, fx, fy) != 1)
                        continue;
                    /* The pixel and its lookup are a little wide themselves: a quarter of a pixel's square. */
                    const double d2 = (i * i + j * j) / 9.0, v = psf * psf + 0.25;
                    const double w = defocus > 0 ? d2 <= defocus * defocus : exp(-0.5 * d2 / v);
                    sum += w * signal(sharp, fx, fy), weight += w;
                }
            const double got = signal(soft, x, y), want = sum / weight;
            off += fabs(got - want), span = fmax(span, want), n++;
            mixed = fmax(mixed, fabs(signal(stripes, x, y) - dim * got));
        }
    }
    if (!(off / n < allowed * span))
        fail_msg("psf %g, defocus %g, %d rays: off by %g of %g", psf, defocus, supersample, off / n, span);
    if (mixed > 1.5 / 3839) /* two roundings */
        fail_msg("psf %g, defocus %g: rows are mixed, %g", psf, defocus, mixed);
    sim_capture_free(&reference), sim_capture_free(&blurred);
    brace_image_destroy(image);
}

static void test_blur_is_that_of_the_lens(void **state) {
    (void)state;
    blur_equals_brute_force(0.8, 0, 1, 0.025);
    blur_equals_brute_force(2.5, 0, 1, 0.04);
    blur_equals_brute_force(2.5, 0, 2, 0.02);
    blur_equals_brute_force(0, 5, 1, 0.02);
    blur_equals_brute_force(0, 5, 4, 0.02);
}

/* Half of the screen is white: the lens carries its light onto the dark half, with the time of each row. */
static void test_glare_has_its_rows_time(void **state) {
    (void)state;
    brace_image *image = screen(64, 48, 0);
    for (uint32_t y = 0; y < 48; y++)
        memset((char *)image->data + y * image->stride, 255, 3 * 32);
    sim_scene s = plain_scene();
    s.noise = 0, s.level = 0.9, s.glare = 0.5;
    sim_capture c = capture(image, "{\"driver\": \"lcd_pwm\", \"frequency\": 2207, \"duty\": 0.5}", &s, 2);
    const double bright = row_contrast(c.frame[0], 40), dark = row_contrast(c.frame[0], 140);
    assert_true(bright > 0.2);
    if (fabs(dark / bright - 1) > 0.03)
        fail_msg("contrast %g of the light, %g of its glare", bright, dark);
    assert_true(row_contrast(c.truth, 140) < 0.06);
    sim_capture_free(&c);
    /* Energy: an even picture stays what it is. */
    brace_image *even = screen(64, 48, 188);
    sim_scene none = s;
    none.glare = 0;
    sim_capture with = capture(even, steady, &s, 1), without = capture(even, steady, &none, 1);
    for (uint32_t y = 0; y < s.height; y++)
        for (uint32_t x = 0; x < s.width; x++)
            assert_true(fabs(signal(with.truth, x, y) - signal(without.truth, x, y)) < 1.5 / 3839);
    sim_capture_free(&with), sim_capture_free(&without);
    brace_image_destroy(even);
    brace_image_destroy(image);
}

/* The wall behind a screen is lit by lamps on the mains; in the truth they are steady. */
static void test_clutter_flickers_with_the_room(void **state) {
    (void)state;
    brace_image *image = screen(64, 48, 255);
    sim_scene s = plain_scene();
    s.noise = 0, s.clutter = 0.5, s.bezel = 0.05, s.pose.translation[2] = 2, s.reference_time = 1.0 / 100;
    s.ambient_hz = 100;
    sim_capture lamp = capture(image, steady, &s, 1);
    s.ambient_hz = 0;
    sim_capture even = capture(image, steady, &s, 2);
    double least = 10, most = 0, bezel = 0, wall = 0;
    for (uint32_t y = 0; y < s.height; y++) {
        const double ratio = (signal(lamp.frame[0], 4, y) + signal(lamp.frame[0], 5, y)) /
                             (signal(even.frame[0], 4, y) + signal(even.frame[0], 5, y));
        least = fmin(least, ratio), most = fmax(most, ratio);
        wall += signal(even.truth, 30, y);
    }
    /* 1 + cos over 1/1600 s, seen for more than a period. */
    assert_true(least < 0.06 && most > 1.9 && most < 2.1);
    bezel = signal(even.truth, 46, 64); /* the screen reaches from 48 to 144 */
    assert_true(wall / s.height > 3 * bezel && bezel > 0);
    assert_memory_equal(lamp.truth->data, even.truth->data, s.width * s.height * sizeof(uint16_t));
    /* A period of the lamp is exposed as without it: the reference frame is of 1/100 s. */
    for (uint32_t y = 0; y < s.height; y++)
        assert_true(fabs(signal(lamp.frame[2], 4, y) - signal(even.frame[2], 4, y)) < 1.5 / 3839);
    sim_capture_free(&lamp), sim_capture_free(&even);
    brace_image_destroy(image);
}

/* Mean and deviation of green, relative to the mean. */
static double unevenness(const brace_frame *f, double *mean) {
    double sum = 0, square = 0, n = 0;
    for (uint32_t y = 0; y < f->height; y++)
        for (uint32_t x = 0; x < f->width; x++)
            if (brace_cfa_color(f->cfa, x, y) == 1) {
                const double v = signal(f, x, y);
                sum += v, square += v * v, n++;
            }
    *mean = sum / n;
    return sqrt(square / n - *mean * *mean) / *mean;
}

static void test_nonuniformity(void **state) {
    (void)state;
    brace_image *image = screen(400, 300, 255);
    sim_scene s = plain_scene();
    s.width = 512, s.height = 384, s.noise = 0, s.level = 0.5, s.pose.translation[2] = 0.4;
    double mean;
    s.sensor_nonuniformity = 0.02;
    sim_capture c = capture(image, steady, &s, 2);
    /* Pixels, columns and rows: sqrt(1 + 2*0.2^2) of it; in all frames the same. */
    assert_true(fabs(unevenness(c.truth, &mean) / (0.02 * sqrt(1.08)) - 1) < 0.05);
    assert_true(fabs(mean / 0.5 - 1) < 0.002);
    for (uint32_t x = 0; x < s.width; x += 7)
        assert_true(fabs(signal(c.truth, x, 99) - signal(c.frame[2], x, 99)) < 1.1 / 3839);
    sim_capture_free(&c);
    /* The panel's: no subpixel above white, two deviations below it on average. */
    s.sensor_nonuniformity = 0, s.panel_nonuniformity = 0.05;
    c = capture(image, steady, &s, 2);
    const double deviation = unevenness(c.truth, &mean);
    assert_true(deviation > 0.02 && deviation < 0.06);
    assert_true(fabs(mean / 0.5 - 0.9) < 0.03);
    for (uint32_t y = 0; y < s.height; y++)
        for (uint32_t x = 0; x < s.width; x++)
            if (brace_cfa_color(c.truth->cfa, x, y) == 1)
                assert_true(signal(c.truth, x, y) <= 0.5 + 1e-3);
    sim_capture_free(&c);
    brace_image_destroy(image);
}

/* ---- quantities ---- */

static bool alike(const sim_capture *a, const sim_capture *b) {
    const size_t size = (size_t)a->truth->width * a->truth->height * sizeof(uint16_t);
    bool same = memcmp(a->truth->data, b->truth->data, size) == 0;
    for (int i = 0; i < a->count; i++)
        same = same && memcmp(a->frame[i]->data, b->frame[i]->data, size) == 0;
    return same;
}

/* Every effect is there, and its switch takes it away; all of them together leave the plain scene. */
static void test_every_effect_has_a_switch(void **state) {
    (void)state;
    brace_image *image = page();
    const char light[] = "{\"driver\": \"oled_pwm\", \"refresh\": 60, \"pulses\": 4, \"brightness\": 0.4}";
    brace_error error = {BRACE_OK, ""};
    sim_scene s;
    sim_scene_sample(&s, 11, 2, true);
    s.width = 96, s.height = 72, s.iso = 400, s.pose.translation[2] = 1, s.defocus = 1, s.clutter = 0.2,
    s.ambient = 0.05;
    s.reference_time = 1.0 / 60, s.level = 0.5, s.distortion[1] = 0.02,
    s.panel_nonuniformity = s.sensor_nonuniformity = 0.05;
    sim_capture all = capture(image, light, &s, 2);
    for (size_t i = 0; i < sim_quantity_count; i++) {
        const sim_quantity *q = &sim_quantities[i];
        if (q->effect == NULL)
            continue;
        sim_scene less = s;
        assert_int_equal(sim_scene_off(&less, q->name, &error), BRACE_OK);
        assert_true(sim_quantity_get(&s, q) != 0 && sim_quantity_get(&less, q) == 0);
        sim_capture c = capture(image, light, &less, 2);
        if (alike(&all, &c))
            fail_msg("%s: switched off, nothing changes", q->name);
        sim_capture_free(&c);
    }
    sim_scene off = s, plain;
    assert_int_equal(sim_scene_off(&off, "noise,pose,tremor,distortion,psf,defocus,glare,vignetting", &error),
                     BRACE_OK);
    assert_int_equal(sim_scene_off(&off, "ambient,clutter,nonuniformity", &error), BRACE_OK);
    sim_scene_default(&plain);
    plain.seed = s.seed, plain.sample = s.sample, plain.width = 96, plain.height = 72, plain.iso = 400, plain.noise = 0;
    plain.reference_time = s.reference_time, plain.level = s.level, plain.frame_gap = s.frame_gap, plain.field = true;
    sim_capture a = capture(image, light, &off, 2), b = capture(image, light, &plain, 1);
    assert_true(alike(&a, &b));
    off = s;
    assert_int_equal(sim_scene_off(&off, "all", &error), BRACE_OK);
    sim_capture c = capture(image, light, &off, 1);
    assert_true(alike(&a, &c));
    /* Beside a field's photograph lies the truth that there would be otherwise. */
    plain.field = false;
    sim_capture studio = capture(image, light, &plain, 1);
    assert_null(studio.exact);
    assert_memory_equal(studio.truth->data, a.exact->data, 96 * 72 * sizeof(uint16_t));
    sim_capture_free(&studio);
    assert_int_equal(sim_scene_off(&off, "noise,blur", &error), BRACE_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "\"blur\" is no effect; there are "));
    assert_non_null(strstr(error.message, "vignetting"));
    assert_int_equal(sim_scene_off(&off, "", &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(sim_scene_off(&off, "noise,", &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(sim_scene_off(&off, "iso", &error), BRACE_ERROR_ARGUMENT);
    sim_capture_free(&all), sim_capture_free(&a), sim_capture_free(&b), sim_capture_free(&c);
    brace_image_destroy(image);
}

static void test_settings(void **state) {
    (void)state;
    brace_error error = {BRACE_OK, ""};
    sim_scene s;
    sim_scene_default(&s);
    for (size_t i = 0; i < sim_quantity_count; i++) { /* the table reaches every number */
        const sim_quantity *q = &sim_quantities[i];
        const double value = q->choices != NULL ? q->choices[1] : q->low < 1 && q->high > 1 ? 1 : q->low;
        char text[80];
        snprintf(text, sizeof text, "%s=%.17g", q->name, value);
        if (sim_scene_set(&s, text, &error) != BRACE_OK)
            fail_msg("%s: %s", text, error.message);
        assert_true(sim_quantity_get(&s, q) == value);
    }
    assert_int_equal(sim_scene_set(&s, "reference_time=1/320", &error), BRACE_OK);
    assert_true(s.reference_time == 1.0 / 320);
    assert_int_equal(sim_scene_set(&s, "seed=18446744073709551615", &error), BRACE_OK);
    assert_true(s.seed == UINT64_MAX);
    static const struct {
        const char *setting, *says;
    } wrong[] = {
        {"psf=11", "psf: 11 is out of range 0 to 10 pixels"},
        {"psf=-1", "out of range"},
        {"psf=nan", "no number"},
        {"psf=0x1", "no number"},
        {"psf=", "no number"},
        {"psf=1/0", "no number"},
        {"psf=1 ", "no number"},
        {"psf", "no NAME=VALUE"},
        {"=3", "no NAME=VALUE"},
        {"blur=3", "blur is no quantity of a scene; there are seed"},
        {"frames=4", "frames: 4 is out of range 3, 5, 7 or 9 (whole numbers)"},
        {"supersample=3", "1, 2 or 4"},
        {"subexposures=1.5", "1 to 256 (whole numbers)"},
        {"width=1e99", "32 to 16384"},
        {"seed=-1", "2^64-1"},
        {"seed=18446744073709551616", "2^64-1"},
        {"field=2", "0 to 1"},
    };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        const sim_scene before = s;
        if (sim_scene_set(&s, wrong[i].setting, &error) != BRACE_ERROR_ARGUMENT ||
            strstr(error.message, wrong[i].says) == NULL)
            fail_msg("%s: %s", wrong[i].setting, error.message);
        assert_true(sim_quantity_get(&before, sim_quantity_find("psf")) == s.psf);
        s = before;
    }
}

/* What meta.json holds makes the same display, camera and scene again. */
static void test_descriptions_are_complete(void **state) {
    (void)state;
    brace_error error = {BRACE_OK, ""};
    size_t i;
    json_t *name, *names = sim_data_names("displays");
    assert_true(json_array_size(names) > 20);
    json_array_foreach(names, i, name) {
        sim_display *a, *b;
        if (sim_display_load(&a, json_string_value(name), &error) != BRACE_OK)
            fail_msg("%s", error.message);
        json_t *one = sim_display_json(a);
        char *text = json_dumps(one, 0);
        if (sim_display_parse(&b, text, "again", &error) != BRACE_OK)
            fail_msg("%s", error.message);
        json_t *two = sim_display_json(b);
        assert_true(json_equal(one, two));
        json_decref(one), json_decref(two), free(text);
        sim_display_destroy(a), sim_display_destroy(b);
    }
    json_decref(names), names = sim_data_names("cameras");
    assert_true(json_array_size(names) > 5);
    json_array_foreach(names, i, name) {
        sim_camera a, b;
        assert_int_equal(sim_camera_load(&a, json_string_value(name), &error), BRACE_OK);
        json_t *json = sim_camera_json(&a);
        char *text = json_dumps(json, 0);
        assert_int_equal(sim_camera_parse(&b, text, "again", &error), BRACE_OK);
        assert_memory_equal(&a, &b, sizeof a);
        json_decref(json), free(text);
    }
    json_decref(names);
    for (uint32_t k = 0; k < 20; k++) {
        sim_scene a, b;
        json_check *doc;
        sim_scene_sample(&a, UINT64_MAX - k * 999999999999999999u, k, k % 2);
        sim_scene_default(&b);
        json_t *one = sim_scene_json(&a);
        char *text = json_dumps(one, 0);
        assert_int_equal(json_check_parse(&doc, text, "scene", &error), BRACE_OK);
        json_at root = json_check_root(doc);
        sim_scene_read(&b, &root);
        assert_int_equal(json_check_status(doc, &error), BRACE_OK);
        json_t *two = sim_scene_json(&b);
        assert_true(json_equal(one, two));
        for (size_t q = 0; q < sim_quantity_count; q++)
            assert_true(sim_quantity_get(&a, &sim_quantities[q]) == sim_quantity_get(&b, &sim_quantities[q]));
        json_check_destroy(doc);
        json_decref(one), json_decref(two), free(text);
    }
}

static void test_public_door(void **state) {
    (void)state;
    brace_image *image = screen(50, 40, 120);
    brace_simulate_params p = {.display = "monitor_lcd_200", .width = 96, .height = 64, .seed = UINT64_MAX};
    brace_simulated *a, *b;
    brace_error error = {BRACE_OK, ""};
    assert_int_equal(brace_simulate(&a, image, &p, NULL, &error), BRACE_OK);
    assert_int_equal(brace_simulate(&b, image, &p, &(brace_job){.threads = 1}, &error), BRACE_OK);
    assert_int_equal(a->count, 5);
    assert_non_null(strstr(a->meta, "\"18446744073709551615\""));
    assert_string_equal(a->meta, b->meta);
    for (size_t i = 0; i < 5; i++) {
        assert_memory_equal(a->frames[i]->data, b->frames[i]->data, 96 * 64 * sizeof(uint16_t));
        assert_true(fabs(a->frames[i]->exposure_time / a->truth->exposure_time / pow(4, (double)i - 2) - 1) < 1e-12);
    }
    brace_bracket *bracket;
    assert_int_equal(brace_bracket_create(&bracket, a->frames, a->count, NULL, NULL, &error), BRACE_OK);
    memset(a->frames, 0, sizeof a->frames);
    brace_bracket_destroy(bracket);
    brace_simulated_destroy(a);
    brace_simulated_destroy(b);
    brace_simulated_destroy(NULL);
    p.reference_time = -1;
    assert_int_equal(brace_simulate(&a, image, &p, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_null(a);
    p.reference_time = 0, p.display = "nothing";
    assert_int_equal(brace_simulate(&a, image, &p, NULL, &error), BRACE_ERROR_IO);
    assert_int_equal(brace_simulate(&a, NULL, &p, NULL, &error), BRACE_ERROR_ARGUMENT);
    /* Settings, switches, and the field's two truths. */
    static const char *const settings[] = {"frames=3", "psf=1.5"};
    p = (brace_simulate_params){
        .width = 64, .height = 48, .set = settings, .set_count = 2, .off = "noise", .field = true};
    assert_int_equal(brace_simulate(&a, image, &p, NULL, &error), BRACE_OK);
    assert_int_equal(a->count, 3);
    assert_non_null(strstr(a->meta, "\"psf\": 1.5"));
    assert_non_null(strstr(a->meta, "\"noise\": 0.0"));
    assert_true(fabs(a->truth->exposure_time / a->exact->exposure_time - 8) < 1e-9);
    brace_simulated_destroy(a);
    p.off = "everything";
    assert_int_equal(brace_simulate(&a, image, &p, NULL, &error), BRACE_ERROR_ARGUMENT);
    p.off = NULL, p.scene = "/nowhere/meta.json";
    assert_int_equal(brace_simulate(&a, image, &p, NULL, &error), BRACE_ERROR_IO);
    /* When memory ends, at whatever point: an error, and nothing lost. */
    p = (brace_simulate_params){.display = "led_wall_1920_32", .width = 32, .height = 32, .field = true};
    brace_job one = {.threads = 1};
    for (long n = 1; n < 200; n++) {
        core_alloc_fail_after(n);
        brace_status status = brace_simulate(&a, image, &p, &one, &error);
        core_alloc_fail_after(0);
        if (status == BRACE_OK) {
            brace_simulated_destroy(a);
            assert_true(n > 20);
            break;
        }
    }
    brace_image_destroy(image);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_steady_light_is_exact),
        cmocka_unit_test(test_threads_do_not_matter),
        cmocka_unit_test(test_merge_restores_a_capture),
        cmocka_unit_test(test_impossible_values),
        cmocka_unit_test(test_instruction_sets_do_not_matter),
        cmocka_unit_test(test_noise_is_normal_and_white),
        cmocka_unit_test(test_far_screens_are_averaged),
        cmocka_unit_test(test_motion_is_followed),
        cmocka_unit_test(test_fast_stripes_pass_the_lens),
        cmocka_unit_test(test_blur_is_that_of_the_lens),
        cmocka_unit_test(test_glare_has_its_rows_time),
        cmocka_unit_test(test_clutter_flickers_with_the_room),
        cmocka_unit_test(test_nonuniformity),
        cmocka_unit_test(test_every_effect_has_a_switch),
        cmocka_unit_test(test_settings),
        cmocka_unit_test(test_descriptions_are_complete),
        cmocka_unit_test(test_public_door),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
