/* SPDX-License-Identifier: Apache-2.0 */
/* test_merge.c: what merging must gain, must not lose, and must survive. */
// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>
// clang-format on
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "restore/internal.h"
#include "scene.h"

static brace_restored *restore(const brace_bracket *bracket, brace_method method, int threads) {
    brace_restored *restored;
    brace_error error;
    brace_restore_params params = {.method = method};
    brace_job job = {.threads = threads};
    if (brace_restore(&restored, bracket, &params, &job, &error))
        fail_msg("%s", error.message);
    return restored;
}

/* PSNR of merge over that of the reference frame. */
static double gain_of_merge(const scene *s) {
    brace_bracket *bracket = scene_bracket(s);
    brace_restored *reference = restore(bracket, BRACE_METHOD_REFERENCE, 0);
    brace_restored *merged = restore(bracket, BRACE_METHOD_MERGE, 0);
    double gain = scene_psnr(s, merged->mosaic) - scene_psnr(s, reference->mosaic);
    print_message("reference %.2f dB, merge %.2f dB\n", scene_psnr(s, reference->mosaic),
                  scene_psnr(s, merged->mosaic));
    double share = 0;
    for (int i = 0; i < 5; i++)
        share += merged->report.weight[i];
    assert_true(fabs(share - 1) < 1e-6);
    brace_restored_destroy(reference);
    brace_restored_destroy(merged);
    brace_bracket_destroy(bracket);
    return gain;
}

static void test_steady_light(void **state) {
    (void)state;
    for (int cfa = 0; cfa < 4; cfa++)
        assert_true(gain_of_merge(&(scene){
                        .width = 256, .height = 192, .cfa = (brace_cfa)cfa, .level = 0.4, .shift = 0.6, .seed = 5}) >
                    0);
}

static void test_backlight(void **state) {
    (void)state;
    for (int cfa = 0; cfa < 4; cfa++)
        assert_true(gain_of_merge(&(scene){.width = 256,
                                           .height = 192,
                                           .cfa = (brace_cfa)cfa,
                                           .level = 0.3,
                                           .shift = 0.6,
                                           .pulses = 8.3,
                                           .duty = 0.45,
                                           .reference = 0.625,
                                           .seed = 6}) > 6);
}

static void test_white_page(void **state) {
    (void)state;
    /* Both longer frames clip all over the page: only the period of the light is left to go by. */
    assert_true(gain_of_merge(&(scene){.width = 384,
                                       .height = 320,
                                       .level = 0.6,
                                       .paper = true,
                                       .pulses = 9.4,
                                       .duty = 0.6,
                                       .reference = 1.4,
                                       .shift = 0.3,
                                       .seed = 7}) > 6);
}

static void test_steady_white_page(void **state) {
    (void)state;
    /* Lines of text are periodic too, but their light is not. */
    assert_true(gain_of_merge(&(scene){
                    .width = 384, .height = 320, .level = 0.6, .paper = true, .shift = 0.3, .seed = 8}) > -0.05);
}

static void test_smeared_long_frames(void **state) {
    (void)state;
    /* Steady text, the longer frames blurred by the hand: they must not blur the result. */
    assert_true(gain_of_merge(&(scene){.width = 384,
                                       .height = 320,
                                       .level = 0.06,
                                       .paper = true,
                                       .shift = 0.3,
                                       .smear = 3,
                                       .seed = 12}) > 0);
}

static void test_slipped_long_frame(void **state) {
    (void)state;
    /* Where the longest frame lies cannot be seen: it clips but for a bezel that looks the same all along. Its bezel on the
     * page of the others is not light that flickers. */
    assert_true(gain_of_merge(&(scene){
                    .width = 372, .height = 320, .level = 0.6, .bezel = true, .slip = -14, .seed = 13}) > 0);
}

static void test_lamp_on_a_terminal(void **state) {
    (void)state;
    /* Bright text on a steady display: all that is dark enough for the longest frames is the black around it, which mirrors
     * a lamp. Its flicker is not the text's. */
    assert_true(gain_of_merge(&(scene){.width = 256, .height = 192, .level = 0.5, .lamp = 0.01, .pulses = 1.7,
                                       .duty = 0.8, .reference = 0.3, .seed = 14}) > 0);
}

static void test_flashes(void **state) {
    (void)state;
    /* The reference clips in places, and the shorter frames met the light's pulses in few of their rows only: where
     * they saw nothing, the page is not dark. */
    scene s = {.width = 256, .height = 192, .level = 1.3, .flashes = true, .seed = 13};
    brace_bracket *bracket = scene_bracket(&s);
    brace_restored *merged = restore(bracket, BRACE_METHOD_MERGE, 0);
    size_t clipped = 0, dark = 0;
    for (uint32_t y = 8; y < s.height - 8; y++)
        for (uint32_t x = 8; x < s.width - 8; x++)
            if (scene_light(&s, x, y, brace_cfa_color(s.cfa, x, y)) > 1.05) {
                clipped++;
                dark += merged->mosaic[y * s.width + x] < 0.7f;
            }
    print_message("%zu of %zu clipped samples are dark\n", dark, clipped);
    assert_true(clipped > 200);
    assert_true(dark < clipped / 10);
    brace_restored_destroy(merged);
    brace_bracket_destroy(bracket);
}

static void test_highlights(void **state) {
    (void)state;
    /* Brighter than the reference can hold: told by the shorter frames. */
    scene s = {.width = 192, .height = 160, .level = 4, .shift = 0, .seed = 9};
    brace_bracket *bracket = scene_bracket(&s);
    brace_restored *merged = restore(bracket, BRACE_METHOD_MERGE, 0);
    double off = 0, n = 0;
    for (uint32_t y = 8; y < s.height - 8; y++)
        for (uint32_t x = 8; x < s.width - 8; x++) {
            double truth = scene_light(&s, x, y, brace_cfa_color(s.cfa, x, y));
            if (truth > 1.5)
                off += fabs((double)merged->mosaic[y * s.width + x] / truth - 1), n++;
        }
    assert_true(n > 100);
    print_message("highlights are off by %.2f %%\n", 100 * off / n);
    assert_true(off / n < 0.03);
    assert_true(merged->report.clipped > 0.1);
    for (uint32_t i = 0; i < s.width * s.height; i++)
        assert_true((float)merged->frame->data[i] <= merged->frame->white);
    brace_restored_destroy(merged);
    brace_bracket_destroy(bracket);
}

/* Merging and the errors that it expects; the share of samples that are off by more than `most` of these. */
static double unexpected(const scene *s, double most, float **mosaic, double *median) {
    brace_bracket *b = scene_bracket(s);
    const size_t count = (size_t)s->width * s->height;
    float *merged = malloc(count * sizeof *merged), *sigma = malloc(count * sizeof *sigma);
    restore_motion still[BRACE_BRACKET_MAX] = {{.confidence = 1}, {.confidence = 1}, {.confidence = 1},
                                               {.confidence = 1}, {.confidence = 1}};
    brace_restore_report report = {0};
    brace_error error;
    assert_int_equal(restore_merge(merged, sigma, &report, b, still, NULL, NULL, &error), BRACE_OK);
    size_t off = 0, histogram[1001] = {0}, at = 0;
    for (size_t i = 0; i < count; i++) {
        const double x = (double)(i % s->width), y = (double)(i / s->width);
        const double truth = scene_light(s, x, y, brace_cfa_color(s->cfa, (uint32_t)x, (uint32_t)y));
        const double error_here = pow(fmax((double)merged[i], 0), 1 / 2.2) - pow(truth, 1 / 2.2);
        assert_true(sigma[i] >= RESTORE_SIGMA_LEAST && sigma[i] <= 1);
        off += fabs(error_here) > most * (double)sigma[i];
        histogram[(size_t)(1000 * sigma[i])]++;
    }
    for (size_t n = histogram[0]; 2 * n < count; n += histogram[++at])
        ;
    *median = (double)at / 1000;
    *mosaic = merged;
    free(sigma);
    brace_bracket_destroy(b);
    return (double)off / (double)count;
}

/* Where light is steady errors are small and known; where the display was dark in all frames but one that clips,
 * that one tells how bright it is at least, and that no more is known. */
static void test_expected_errors(void **state) {
    (void)state;
    float *mosaic;
    double median;
    const scene steady = {.width = 256, .height = 192, .level = 0.4, .seed = 21};
    double off = unexpected(&steady, 4, &mosaic, &median);
    print_message("steady: %.4f beyond 4 sigma, of which half are below %.3f\n", off, median);
    assert_true(off < 0.01 && median < 0.01);
    free(mosaic);
    const scene dark = {.width = 256, .height = 384, .level = 0.8, .paper = true, .pulses = 1.6, .duty = 0.2,
                        .reference = 0.08, .seed = 22};
    off = unexpected(&dark, 8, &mosaic, &median);
    size_t page = 0, black = 0;
    for (uint32_t y = 24; y < dark.height - 24; y++)
        for (uint32_t x = 24; x < dark.width - 24; x++) {
            if (scene_light(&dark, x, y, brace_cfa_color(dark.cfa, x, y)) > 0.5) {
                page++;
                black += mosaic[y * dark.width + x] < 0.9f / 16;
            }
        }
    print_message("dark: %.4f beyond 8 sigma, of which half are below %.3f; %zu of %zu are darker than can be\n", off,
                  median, black, page);
    assert_true(page > 5000 && 7 * black < page);
    assert_true(off < 0.08 && median > 0.02);
    free(mosaic);
}

static void test_reference_is_untouched(void **state) {
    (void)state;
    brace_bracket *bracket = scene_bracket(&(scene){.width = 101, .height = 77, .level = 0.4, .seed = 10});
    brace_restored *r = restore(bracket, BRACE_METHOD_REFERENCE, 0);
    assert_memory_equal(r->frame->data, bracket->frames[bracket->reference]->data, 101 * 77 * sizeof(uint16_t));
    brace_restored_destroy(r);
    brace_bracket_destroy(bracket);
}

static void test_threads_do_not_matter(void **state) {
    (void)state;
    brace_bracket *bracket = scene_bracket(&(scene){.width = 301,
                                                    .height = 223,
                                                    .level = 0.6,
                                                    .paper = true,
                                                    .shift = 0.7,
                                                    .pulses = 9,
                                                    .duty = 0.5,
                                                    .reference = 0.6,
                                                    .seed = 11});
    brace_restored *one = restore(bracket, BRACE_METHOD_MERGE, 1), *three = restore(bracket, BRACE_METHOD_MERGE, 3);
    assert_memory_equal(one->mosaic, three->mosaic, 301 * 223 * sizeof(float));
    assert_memory_equal(one->report.weight, three->report.weight, sizeof one->report.weight);
    brace_restored_destroy(one);
    brace_restored_destroy(three);
    brace_bracket_destroy(bracket);
}

static void test_odd_and_tiny_sizes(void **state) {
    (void)state;
    static const uint32_t sizes[][2] = {{4, 4},  {5, 4},  {4, 7},    {9, 5},    {33, 31},
                                        {64, 5}, {5, 64}, {131, 97}, {3000, 4}, {4, 3000}};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        scene s = {.width = sizes[i][0],
                   .height = sizes[i][1],
                   .level = 0.4,
                   .pulses = 3,
                   .duty = 0.5,
                   .reference = 2,
                   .cfa = (brace_cfa)(i % 4),
                   .seed = 12};
        brace_bracket *bracket = scene_bracket(&s);
        brace_restored *r = restore(bracket, BRACE_METHOD_MERGE, 2);
        for (uint32_t k = 0; k < s.width * s.height; k++)
            assert_true(isfinite(r->mosaic[k]));
        brace_restored_destroy(r);
        brace_bracket_destroy(bracket);
    }
}

static void test_extreme_frames(void **state) {
    (void)state;
    /* All black, all white, white black alternating: finite results, no crash. */
    for (int kind = 0; kind < 3; kind++) {
        brace_bracket *bracket = scene_bracket(&(scene){.width = 96, .height = 80, .level = 0.4, .seed = 13});
        for (size_t i = 0; i < 5; i++)
            for (size_t k = 0; k < 96 * 80; k++)
                bracket->frames[i]->data[k] = kind == 0 ? 0 : kind == 1 ? 65535 : (uint16_t)(k % 2 ? 65535 : 0);
        brace_restored *r = restore(bracket, BRACE_METHOD_MERGE, 2);
        for (size_t k = 0; k < 96 * 80; k++)
            assert_true(isfinite(r->mosaic[k]));
        if (kind == 1)
            for (size_t k = 0; k < 96 * 80; k++)
                assert_true((float)r->frame->data[k] == r->frame->white);
        brace_restored_destroy(r);
        brace_bracket_destroy(bracket);
    }
}

static void test_hostile_metadata(void **state) {
    (void)state;
    static const double wrong[] = {1e300, -1, 0, (double)NAN, (double)INFINITY};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        brace_bracket *bracket = scene_bracket(&(scene){.width = 70, .height = 66, .level = 0.4, .seed = 16});
        for (size_t k = 0; k < 5; k++)
            for (int c = 0; c < 3; c++)
                bracket->frames[k]->noise[c][0] = bracket->frames[k]->noise[c][1] = wrong[i];
        brace_restored *r = restore(bracket, BRACE_METHOD_MERGE, 1);
        for (size_t k = 0; k < 70 * 66; k++)
            assert_true(isfinite(r->mosaic[k]));
        brace_restored_destroy(r);
        r = NULL;
        brace_error error;
        bracket->exposure[0] = wrong[i];
        assert_int_equal(brace_restore(&r, bracket, NULL, NULL, &error), BRACE_ERROR_MISMATCH);
        assert_null(r);
        brace_bracket_destroy(bracket);
    }
}

static void test_memory_ends(void **state) {
    (void)state;
    brace_bracket *bracket = scene_bracket(&(scene){.width = 80,
                                                    .height = 72,
                                                    .level = 0.6,
                                                    .paper = true,
                                                    .pulses = 4,
                                                    .duty = 0.5,
                                                    .reference = 1.4,
                                                    .seed = 14});
    brace_job job = {.threads = 1};
    for (long n = 1;; n++) {
        brace_restored *r = NULL;
        brace_error error = {BRACE_OK, ""};
        core_alloc_fail_after(n);
        brace_status status = brace_restore(&r, bracket, NULL, &job, &error);
        core_alloc_fail_after(0);
        if (!status) {
            brace_restored_destroy(r);
            assert_true(n > 20);
            break;
        }
        assert_int_equal(status, BRACE_ERROR_MEMORY);
        assert_null(r);
        assert_true(strlen(error.message) > 0);
    }
    brace_bracket_destroy(bracket);
}

static void test_cancel_and_arguments(void **state) {
    (void)state;
    brace_bracket *bracket = scene_bracket(&(scene){.width = 64, .height = 64, .level = 0.4, .seed = 15});
    volatile int cancel = 1;
    brace_job job = {.cancel = &cancel};
    brace_restored *r = NULL;
    brace_error error;
    assert_int_equal(brace_restore(&r, bracket, NULL, &job, &error), BRACE_ERROR_CANCELLED);
    brace_restore_params params = {.method = (brace_method)77};
    assert_int_equal(brace_restore(&r, bracket, &params, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_null(r);
    brace_restored_destroy(NULL);
    brace_bracket_destroy(bracket);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_steady_light),
        cmocka_unit_test(test_backlight),
        cmocka_unit_test(test_white_page),
        cmocka_unit_test(test_steady_white_page),
        cmocka_unit_test(test_smeared_long_frames),
        cmocka_unit_test(test_slipped_long_frame),
        cmocka_unit_test(test_lamp_on_a_terminal),
        cmocka_unit_test(test_flashes),
        cmocka_unit_test(test_highlights),
        cmocka_unit_test(test_expected_errors),
        cmocka_unit_test(test_reference_is_untouched),
        cmocka_unit_test(test_threads_do_not_matter),
        cmocka_unit_test(test_odd_and_tiny_sizes),
        cmocka_unit_test(test_extreme_frames),
        cmocka_unit_test(test_hostile_metadata),
        cmocka_unit_test(test_memory_ends),
        cmocka_unit_test(test_cancel_and_arguments),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
