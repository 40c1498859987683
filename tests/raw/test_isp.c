/* SPDX-License-Identifier: Apache-2.0 */
/* Developing and its inverse: colour, levels, orientation, exactness, threads, bad input. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "image/color.h"
#include "image/image.h"
#include "raw/isp.h"

#include "color_vectors.h"

#define COUNT(a) (sizeof(a) / sizeof((a)[0]))

static const double daylight[9] = {0.866441824,  -0.2886881335, -0.1083037529, -0.2489553136, 1.1252066,
                                   0.1023190319, 0.04067551885, 0.06844417815, 0.4000428158};

static brace_frame make_frame(uint32_t width, uint32_t height, brace_cfa cfa, uint32_t seed) {
    brace_frame frame = {.width = width, .height = height, .cfa = cfa, .orientation = 1};
    frame.black[0] = 500.0f;
    frame.black[1] = 512.0f;
    frame.black[2] = 520.0f;
    frame.black[3] = 508.0f;
    frame.white = 16000.0f;
    frame.as_shot_neutral[0] = 0.42;
    frame.as_shot_neutral[1] = 1.0;
    frame.as_shot_neutral[2] = 0.57;
    memcpy(frame.color_matrix[0], daylight, sizeof(daylight));
    frame.illuminant[0] = 21;
    frame.path = (char *)(uintptr_t) "test.dng";
    frame.data = malloc((size_t)width * height * sizeof(uint16_t));
    assert_non_null(frame.data);
    core_random random = core_random_create(seed, width, height, 0);
    for (size_t i = 0; i < (size_t)width * height; i++) { /* below the level at which a channel clips */
        frame.data[i] = (uint16_t)(480 + core_random_below(&random, 5500));
    }
    return frame;
}

static float *make_mosaic(const brace_frame *frame) {
    float *mosaic = malloc((size_t)frame->width * frame->height * sizeof(float));
    assert_non_null(mosaic);
    return mosaic;
}

static size_t image_bytes(const brace_image *image) {
    return image->stride * image->height;
}

static brace_image *develop(const brace_frame *frame, brace_develop_params params, int threads) {
    brace_job job = {.threads = threads};
    brace_error error;
    brace_image *image = NULL;
    assert_int_equal(brace_develop(&image, frame, &params, &job, &error), BRACE_OK);
    return image;
}

static void colors_agree_with_numpy(void **state) {
    (void)state;
    for (size_t i = 0; i < COUNT(color_vectors); i++) {
        brace_frame frame = make_frame(4, 4, BRACE_CFA_RGGB, 1);
        memcpy(frame.color_matrix, color_vectors[i].matrix, sizeof(frame.color_matrix));
        memcpy(frame.illuminant, color_vectors[i].illuminant, sizeof(frame.illuminant));
        memcpy(frame.as_shot_neutral, color_vectors[i].neutral, sizeof(frame.as_shot_neutral));
        brace_color color;
        assert_int_equal(brace_color_init(&color, &frame, NULL), BRACE_OK);
        double smallest = 1e9;
        for (int c = 0; c < 3; c++) {
            assert_true(fabs(color.wb[c] * frame.as_shot_neutral[c] - color.wb[1] * frame.as_shot_neutral[1]) < 1e-12);
            smallest = fmin(smallest, color.wb[c]);
        }
        assert_true(smallest == 1.0);
        for (int k = 0; k < 9; k++) {
            if (fabs(color.camera_to_srgb[k] - color_vectors[i].expected[k]) > 5e-4) {
                fail_msg("vector %zu, entry %d: %.6f, expected %.6f", i, k, color.camera_to_srgb[k],
                         color_vectors[i].expected[k]);
            }
            double product = 0.0;
            for (int j = 0; j < 3; j++) {
                product += color.camera_to_srgb[k / 3 * 3 + j] * color.srgb_to_camera[3 * j + k % 3];
            }
            assert_true(fabs(product - (k % 4 == 0 ? 1.0 : 0.0)) < 1e-12);
        }
        /* The order of the two matrices in the file does not matter. */
        if (frame.illuminant[1] != 0) {
            brace_frame swapped = frame;
            memcpy(swapped.color_matrix[0], frame.color_matrix[1], sizeof(daylight));
            memcpy(swapped.color_matrix[1], frame.color_matrix[0], sizeof(daylight));
            swapped.illuminant[0] = frame.illuminant[1];
            swapped.illuminant[1] = frame.illuminant[0];
            brace_color other;
            assert_int_equal(brace_color_init(&other, &swapped, NULL), BRACE_OK);
            for (int k = 0; k < 9; k++) {
                assert_true(fabs(color.camera_to_srgb[k] - other.camera_to_srgb[k]) < 1e-7);
            }
        }
        free(frame.data);
    }
}

static void hostile_colors_become_identity(void **state) {
    (void)state;
    brace_frame frame = make_frame(4, 4, BRACE_CFA_RGGB, 1);
    static const double bad[] = {NAN, INFINITY, -INFINITY, 0.0, 1e300, -1e300, 1e-300};
    for (size_t i = 0; i < COUNT(bad); i++) {
        for (int k = 0; k < 12; k++) {
            brace_frame damaged = frame;
            *(k < 9 ? &damaged.color_matrix[0][k] : &damaged.as_shot_neutral[k - 9]) = bad[i];
            brace_color color;
            assert_int_equal(brace_color_init(&color, &damaged, NULL), BRACE_OK);
            for (int j = 0; j < 9; j++) {
                assert_true(fabs(color.camera_to_srgb[j]) < 1e3 && fabs(color.srgb_to_camera[j]) < 1e8);
            }
            for (int c = 0; c < 3; c++) {
                assert_true(color.wb[c] >= 1.0 && color.wb[c] < 1001.0);
            }
        }
    }
    for (int k = 0; k < 9; k++) {
        frame.color_matrix[0][k] = 1.0; /* singular */
    }
    brace_color color;
    assert_int_equal(brace_color_init(&color, &frame, NULL), BRACE_OK);
    for (int k = 0; k < 9; k++) {
        assert_true(color.camera_to_srgb[k] == (k % 4 == 0 ? 1.0 : 0.0));
    }
    assert_int_equal(brace_color_init(NULL, &frame, NULL), BRACE_ERROR_ARGUMENT);
    assert_int_equal(brace_color_init(&color, NULL, NULL), BRACE_ERROR_ARGUMENT);
    free(frame.data);
}

static void levels_round_trip(void **state) {
    (void)state;
    brace_frame frame = make_frame(256, 256, BRACE_CFA_GBRG, 2);
    frame.white = 16383.5f;
    for (size_t i = 0; i < 65536; i++) {
        frame.data[i] = (uint16_t)(i * 40503u);
    }
    float *mosaic = make_mosaic(&frame);
    raw_normalise(&frame, mosaic, NULL);
    assert_true(fabsf(mosaic[256 + 1] - ((float)frame.data[257] - 508.0f) / (16383.5f - 508.0f)) < 1e-6f);
    brace_frame back = frame;
    back.data = calloc(65536, sizeof(uint16_t));
    raw_quantise(&back, mosaic, NULL);
    for (size_t i = 0; i < 65536; i++) { /* also below black; above white is clipped */
        assert_int_equal(back.data[i], frame.data[i] > 16383 ? 16384 : frame.data[i]);
    }
    mosaic[0] = NAN;
    mosaic[1] = INFINITY;
    mosaic[2] = -INFINITY;
    mosaic[3] = 1.2f / (16383.5f - 512.0f);
    mosaic[256] = -0.4f / (16383.5f - 520.0f);
    raw_quantise(&back, mosaic, NULL);
    assert_int_equal(back.data[0], 500);
    assert_int_equal(back.data[1], 16384);
    assert_int_equal(back.data[2], 0);
    assert_int_equal(back.data[3], 513);
    assert_int_equal(back.data[256], 520);
    free(back.data);
    free(mosaic);
    free(frame.data);
}

static void inverse_is_exact(void **state) {
    (void)state;
    static const uint32_t sizes[][2] = {{4, 4}, {5, 4}, {4, 7}, {13, 9}, {64, 66}, {247, 131}, {465, 70}};
    for (size_t s = 0; s < COUNT(sizes); s++) {
        for (int cfa = 0; cfa < 4; cfa++) {
            brace_frame frame = make_frame(sizes[s][0], sizes[s][1], (brace_cfa)cfa, 3);
            const size_t count = (size_t)frame.width * frame.height;
            float *mosaic = make_mosaic(&frame), *back = make_mosaic(&frame);
            raw_normalise(&frame, mosaic, NULL);
            for (int method = 0; method <= 3; method++) {
                for (int transfer = 0; transfer < 2; transfer++) {
                    brace_develop_params params = {.demosaic = (brace_demosaic)method,
                                                   .sample = BRACE_SAMPLE_F32,
                                                   .transfer = (brace_transfer)transfer,
                                                   .as_stored = true};
                    brace_image *image = NULL;
                    assert_int_equal(brace_develop_linear(&image, mosaic, &frame, &params, NULL, NULL), BRACE_OK);
                    assert_int_equal(brace_undevelop(back, image, &frame, NULL), BRACE_OK);
                    for (size_t i = 0; i < count; i++) {
                        if (!(fabsf(back[i] - mosaic[i]) < 2e-6f)) {
                            fail_msg("%u x %u, CFA %d, method %d: sample %zu is %.8f, was %.8f", frame.width,
                                     frame.height, cfa, method, i, (double)back[i], (double)mosaic[i]);
                        }
                    }
                    brace_image_destroy(image);
                }
            }
            /* The whole way: the same raw numbers come back. */
            brace_image *image = develop(&frame, (brace_develop_params){.sample = BRACE_SAMPLE_F32}, 1);
            assert_int_equal(brace_undevelop(back, image, &frame, NULL), BRACE_OK);
            brace_frame again = frame;
            again.data = malloc(count * sizeof(uint16_t));
            raw_quantise(&again, back, NULL);
            assert_memory_equal(again.data, frame.data, count * sizeof(uint16_t));
            free(again.data);
            brace_image_destroy(image);
            free(back);
            free(mosaic);
            free(frame.data);
        }
    }
}

/* undevelop(develop) keeps samples; develop(undevelop) must keep a picture that the mosaic determines. */
static void flat_pictures_come_back(void **state) {
    (void)state;
    static const float rgb[][3] = {{0.2f, 0.3f, 0.4f}, {0.02f, 0.5f, 0.1f}, {0.4f, 0.1f, 0.05f}, {0.5f, 0.5f, 0.5f}};
    for (int cfa = 0; cfa < 4; cfa++) {
        for (size_t k = 0; k < COUNT(rgb); k++) {
            brace_frame frame = make_frame(21, 18, (brace_cfa)cfa, 4);
            float *mosaic = make_mosaic(&frame);
            brace_image *image = NULL, *again = NULL;
            assert_int_equal(brace_image_create(&image, 21, 18, 3, BRACE_SAMPLE_F32, BRACE_TRANSFER_LINEAR, NULL),
                             BRACE_OK);
            float *p = image->data;
            for (size_t i = 0; i < 3 * 21 * 18; i++) {
                p[i] = rgb[k][i % 3];
            }
            assert_int_equal(brace_undevelop(mosaic, image, &frame, NULL), BRACE_OK);
            const brace_develop_params params = {.sample = BRACE_SAMPLE_F32, .transfer = BRACE_TRANSFER_LINEAR};
            assert_int_equal(brace_develop_linear(&again, mosaic, &frame, &params, NULL, NULL), BRACE_OK);
            const float *q = again->data;
            for (size_t i = 0; i < 3 * 21 * 18; i++) {
                assert_true(fabsf(p[i] - q[i]) < 2e-6f);
            }
            brace_image_destroy(again);
            brace_image_destroy(image);
            free(mosaic);
            free(frame.data);
        }
    }
}

static void grey_stays_grey(void **state) {
    (void)state;
    brace_frame frame = make_frame(40, 30, BRACE_CFA_GRBG, 5);
    float *mosaic = make_mosaic(&frame);
    for (uint32_t y = 0; y < 30; y++) {
        for (uint32_t x = 0; x < 40; x++) {
            const int c = raw_green_phase(frame.cfa, (int)y) == (int)(x & 1) ? 1 : raw_row_color(frame.cfa, (int)y);
            mosaic[y * 40 + x] = (float)(0.5 * frame.as_shot_neutral[c]);
        }
    }
    for (int method = 1; method <= 3; method++) {
        brace_develop_params params = {.demosaic = (brace_demosaic)method, .sample = BRACE_SAMPLE_U16};
        brace_image *image = NULL;
        assert_int_equal(brace_develop_linear(&image, mosaic, &frame, &params, NULL, NULL), BRACE_OK);
        const uint16_t *p = image->data, expected = (uint16_t)(65535.0f * image_srgb_encode(0.5f) + 0.5f);
        for (size_t i = 0; i < 3 * 40 * 30; i++) {
            assert_true(abs((int)p[i] - expected) <= 1);
        }
        brace_image_destroy(image);
    }
    free(mosaic);
    free(frame.data);
}

static void clipped_is_white(void **state) {
    (void)state;
    brace_frame frame = make_frame(30, 20, BRACE_CFA_BGGR, 6);
    for (size_t i = 0; i < 600; i++) {
        frame.data[i] = (uint16_t)(16000 + i); /* at and above white */
    }
    brace_image *image = develop(&frame, (brace_develop_params){.sample = BRACE_SAMPLE_U8}, 1);
    const uint8_t *p = image->data;
    for (size_t i = 0; i < 1800; i++) {
        assert_int_equal(p[i], 255);
    }
    brace_image_destroy(image);
    image = develop(
        &frame, (brace_develop_params){.sample = BRACE_SAMPLE_F32, .exposure = -1.0, .transfer = BRACE_TRANSFER_LINEAR},
        1);
    const float *q = image->data;
    for (size_t i = 0; i < 1800; i++) {
        assert_true(q[i] == 0.5f);
    }
    brace_image_destroy(image);
    free(frame.data);
}

static void exposure_scales_light(void **state) {
    (void)state;
    brace_frame frame = make_frame(50, 40, BRACE_CFA_RGGB, 7);
    brace_develop_params params = {.sample = BRACE_SAMPLE_F32, .transfer = BRACE_TRANSFER_LINEAR};
    brace_image *plain = develop(&frame, params, 2);
    params.exposure = 3.0;
    brace_image *bright = develop(&frame, params, 2);
    const float *p = plain->data, *q = bright->data;
    for (size_t i = 0; i < 6000; i++) {
        assert_true(q[i] == 8.0f * p[i]);
    }
    brace_image_destroy(bright);
    brace_image_destroy(plain);
    free(frame.data);
}

static void orientation_turns_the_stored_picture(void **state) {
    (void)state;
    for (int sample = 0; sample < 3; sample++) {
        brace_frame frame = make_frame(251, 77, BRACE_CFA_GBRG, 8);
        brace_image *stored = develop(&frame, (brace_develop_params){.sample = (brace_sample)sample}, 1);
        for (int o = 1; o <= 8; o++) {
            frame.orientation = o;
            brace_image *turned = develop(&frame, (brace_develop_params){.sample = (brace_sample)sample}, 2);
            brace_image *expected = NULL;
            assert_int_equal(brace_image_orient(&expected, stored, o, NULL), BRACE_OK);
            assert_int_equal(turned->width, o >= 5 ? 77 : 251);
            assert_int_equal(turned->height, o >= 5 ? 251 : 77);
            assert_int_equal(turned->stride, expected->stride);
            assert_memory_equal(turned->data, expected->data, image_bytes(expected));
            brace_image *as_stored =
                develop(&frame, (brace_develop_params){.sample = (brace_sample)sample, .as_stored = true}, 1);
            assert_memory_equal(as_stored->data, stored->data, image_bytes(stored));
            brace_image_destroy(as_stored);
            brace_image_destroy(expected);
            brace_image_destroy(turned);
        }
        frame.orientation = 9; /* unknown: as stored */
        brace_image *odd = develop(&frame, (brace_develop_params){.sample = (brace_sample)sample}, 1);
        assert_memory_equal(odd->data, stored->data, image_bytes(stored));
        brace_image_destroy(odd);
        brace_image_destroy(stored);
        free(frame.data);
    }
}

static void threads_and_entry_give_the_same_bytes(void **state) {
    (void)state;
    brace_frame frame = make_frame(701, 333, BRACE_CFA_BGGR, 9);
    float *mosaic = make_mosaic(&frame);
    raw_normalise(&frame, mosaic, NULL);
    for (int method = 1; method <= 3; method++) {
        brace_develop_params params = {.demosaic = (brace_demosaic)method, .sample = BRACE_SAMPLE_F32};
        brace_image *one = develop(&frame, params, 1), *many = develop(&frame, params, 7), *linear = NULL;
        assert_int_equal(brace_develop_linear(&linear, mosaic, &frame, &params, NULL, NULL), BRACE_OK);
        assert_memory_equal(one->data, many->data, image_bytes(one));
        assert_memory_equal(one->data, linear->data, image_bytes(one));
        brace_image_destroy(linear);
        brace_image_destroy(many);
        brace_image_destroy(one);
    }
    free(mosaic);
    free(frame.data);
}

static void bad_numbers_in_a_mosaic_stay_finite(void **state) {
    (void)state;
    brace_frame frame = make_frame(40, 40, BRACE_CFA_RGGB, 10);
    float *mosaic = make_mosaic(&frame);
    static const float bad[] = {NAN, INFINITY, -INFINITY, 3e38f, -3e38f, 1e-42f};
    for (size_t i = 0; i < 1600; i++) {
        mosaic[i] = bad[i * 7 / 3 % COUNT(bad)];
    }
    for (int method = 1; method <= 3; method++) {
        brace_develop_params params = {.demosaic = (brace_demosaic)method, .sample = BRACE_SAMPLE_F32};
        brace_image *image = NULL;
        assert_int_equal(brace_develop_linear(&image, mosaic, &frame, &params, NULL, NULL), BRACE_OK);
        const float *p = image->data;
        for (size_t i = 0; i < 4800; i++) {
            assert_true(isfinite(p[i]));
        }
        brace_image_destroy(image);
    }
    free(mosaic);
    free(frame.data);
}

static void bad_arguments_are_refused(void **state) {
    (void)state;
    brace_frame frame = make_frame(16, 16, BRACE_CFA_RGGB, 11);
    brace_image *image = NULL;
    brace_error error;
    float mosaic[256];
    const volatile int stop = 1;
    const brace_job cancelled = {.threads = 2, .cancel = &stop};
    assert_int_equal(brace_develop(&image, &frame, NULL, &cancelled, &error), BRACE_ERROR_CANCELLED);
    assert_null(image);
    assert_int_equal(brace_develop(NULL, &frame, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(brace_develop(&image, NULL, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(brace_develop_linear(&image, NULL, &frame, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    const brace_develop_params wrong[] = {
        {.demosaic = (brace_demosaic)4},
        {.sample = (brace_sample)3},
        {.transfer = (brace_transfer)2},
        {.exposure = NAN},
        {.exposure = 1e9},
        {.demosaic = (brace_demosaic)-1},
    };
    for (size_t i = 0; i < COUNT(wrong); i++) {
        assert_int_equal(brace_develop(&image, &frame, &wrong[i], NULL, &error), BRACE_ERROR_ARGUMENT);
        assert_true(strlen(error.message) > 10);
    }
    brace_frame damaged = frame;
    damaged.white = 508.0f; /* above one black, not above all */
    assert_int_equal(brace_develop(&image, &damaged, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "test.dng"));
    damaged = frame;
    damaged.black[2] = NAN;
    assert_int_equal(brace_develop(&image, &damaged, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    damaged = frame;
    damaged.height = 3;
    assert_int_equal(brace_develop(&image, &damaged, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    damaged = frame;
    damaged.cfa = (brace_cfa)7;
    assert_int_equal(brace_develop(&image, &damaged, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);

    assert_int_equal(brace_image_create(&image, 16, 15, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, NULL), BRACE_OK);
    assert_int_equal(brace_undevelop(mosaic, image, &frame, &error), BRACE_ERROR_MISMATCH);
    assert_int_equal(brace_undevelop(mosaic, NULL, &frame, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(brace_undevelop(NULL, image, &frame, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(brace_undevelop(mosaic, image, NULL, &error), BRACE_ERROR_ARGUMENT);
    brace_image_destroy(image);
    free(frame.data);
}

static void failed_allocations_are_reported(void **state) {
    (void)state;
    brace_frame frame = make_frame(16, 16, BRACE_CFA_RGGB, 12);
    const brace_job job = {.threads = 1};
    bool done = false;
    for (long n = 1; n < 50 && !done; n++) {
        brace_image *image = NULL;
        brace_error error;
        core_alloc_fail_after(n);
        const brace_status status = brace_develop(&image, &frame, NULL, &job, &error);
        core_alloc_fail_after(0);
        done = status == BRACE_OK;
        assert_true(done || (status == BRACE_ERROR_MEMORY && image == NULL));
        brace_image_destroy(image);
    }
    assert_true(done);
    free(frame.data);
}

static void every_layout_can_be_undeveloped(void **state) {
    (void)state;
    brace_frame frame = make_frame(32, 20, BRACE_CFA_GRBG, 13);
    float *mosaic = make_mosaic(&frame), *truth = make_mosaic(&frame);
    for (int i = 0; i < 640; i++) {
        frame.data[i] = (uint16_t)(2000 + i); /* smooth, so that no channel is out of gamut */
    }
    frame.as_shot_neutral[0] = frame.as_shot_neutral[2] = 1.0;
    raw_normalise(&frame, truth, NULL);
    for (int sample = 0; sample < 3; sample++) {
        for (int transfer = 0; transfer < 2; transfer++) {
            brace_image *image = develop(
                &frame, (brace_develop_params){.sample = (brace_sample)sample, .transfer = (brace_transfer)transfer},
                1);
            for (uint32_t channels = 3; channels <= 4; channels++) {
                brace_image *other = NULL;
                assert_int_equal(brace_image_convert(&other, image, channels, image->sample, image->transfer, NULL),
                                 BRACE_OK);
                assert_int_equal(brace_undevelop(mosaic, other, &frame, NULL), BRACE_OK);
                for (int i = 0; i < 640; i++) {
                    assert_true(fabsf(mosaic[i] - truth[i]) < (sample == 0 ? 0.02f : 1e-4f));
                }
                brace_image_destroy(other);
            }
            brace_image_destroy(image);
        }
    }
    brace_image *grey = NULL;
    assert_int_equal(brace_image_create(&grey, 32, 20, 1, BRACE_SAMPLE_F32, BRACE_TRANSFER_LINEAR, NULL), BRACE_OK);
    for (int i = 0; i < 640; i++) {
        ((float *)grey->data)[i] = 0.25f;
    }
    frame.as_shot_neutral[0] = 0.5;
    assert_int_equal(brace_undevelop(mosaic, grey, &frame, NULL), BRACE_OK);
    assert_true(fabsf(mosaic[0] - 0.25f) < 1e-7f && fabsf(mosaic[1] - 0.125f) < 1e-7f);
    brace_image_destroy(grey);
    free(truth);
    free(mosaic);
    free(frame.data);
}

static void test_highlights(void **state) {
    (void)state;
    /* Four times white, two stops down: back where the screen had it, if it is said to be light. */
    brace_frame *frame = NULL;
    brace_error error;
    assert_int_equal(brace_frame_create(&frame, 16, 12, BRACE_CFA_GRBG, &error), BRACE_OK);
    frame->as_shot_neutral[0] = 0.5, frame->as_shot_neutral[2] = 0.7;
    float mosaic[16 * 12];
    for (uint32_t y = 0; y < 12; y++)
        for (uint32_t x = 0; x < 16; x++)
            mosaic[y * 16 + x] = 3.2f * (float)frame->as_shot_neutral[brace_cfa_color(frame->cfa, x, y)];
    for (int kept = 0; kept < 2; kept++) {
        brace_develop_params params = {
            .sample = BRACE_SAMPLE_U16, .transfer = BRACE_TRANSFER_LINEAR, .exposure = -2, .highlights = kept ? 16 : 0};
        brace_image *image = NULL;
        assert_int_equal(brace_develop_linear(&image, mosaic, frame, &params, NULL, &error), BRACE_OK);
        const uint16_t *pixel = image->data;
        for (int i = 0; i < 16 * 12 * 3; i++)
            assert_true(abs(pixel[i] - (kept ? 52428 : 16384)) <= 2);
        brace_image_destroy(image);
    }
    brace_frame_destroy(frame);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_highlights),
        cmocka_unit_test(colors_agree_with_numpy),
        cmocka_unit_test(hostile_colors_become_identity),
        cmocka_unit_test(levels_round_trip),
        cmocka_unit_test(inverse_is_exact),
        cmocka_unit_test(flat_pictures_come_back),
        cmocka_unit_test(grey_stays_grey),
        cmocka_unit_test(clipped_is_white),
        cmocka_unit_test(exposure_scales_light),
        cmocka_unit_test(orientation_turns_the_stored_picture),
        cmocka_unit_test(threads_and_entry_give_the_same_bytes),
        cmocka_unit_test(bad_numbers_in_a_mosaic_stay_finite),
        cmocka_unit_test(bad_arguments_are_refused),
        cmocka_unit_test(failed_allocations_are_reported),
        cmocka_unit_test(every_layout_can_be_undeveloped),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
