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
        cmocka_unit_test(test_public_door),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
