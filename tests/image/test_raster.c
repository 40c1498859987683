/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_raster.c: pictures in memory: limits, conversion, the sRGB curve, turning, resizing.
 */
#include "brace/develop.h"
#include "image/color.h"
#include "make.h"

static void test_create(void **state) {
    (void)state;
    brace_image *image = NULL;
    brace_error error;
    assert_int_equal(brace_image_create(&image, 5, 3, 3, BRACE_SAMPLE_U16, BRACE_TRANSFER_LINEAR, &error), BRACE_OK);
    assert_int_equal(image->stride, 30);
    for (size_t i = 0; i < 45; i++) {
        assert_int_equal(((uint16_t *)image->data)[i], 0);
    }
    brace_image_destroy(image);
    brace_image_destroy(NULL);
    static const uint32_t bad[][3] = {{0, 1, 3},         {1, 0, 3}, {65536, 1, 3}, {1, 65536, 1}, {65535, 65535, 1},
                                      {20001, 20000, 1}, {1, 1, 0}, {1, 1, 2},     {1, 1, 5},     {0xffffffff, 2, 3}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(
            brace_image_create(&image, bad[i][0], bad[i][1], bad[i][2], BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, &error),
            BRACE_ERROR_ARGUMENT);
        assert_null(image);
    }
    assert_int_equal(brace_image_create(&image, 1, 1, 1, (brace_sample)3, BRACE_TRANSFER_SRGB, &error),
                     BRACE_ERROR_ARGUMENT);
    for (long n = 1; n <= 2; n++) {
        core_alloc_fail_after(n);
        brace_status status = brace_image_create(&image, 9, 9, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, &error);
        core_alloc_fail_after(0);
        assert_int_equal(status, BRACE_ERROR_MEMORY);
    }
}

static void check_codes(const float *x, size_t n) {
    static uint8_t out8[4096];
    static uint16_t out16[4096];
    image_srgb_encode_row_u8(out8, x, n);
    image_srgb_encode_row_u16(out16, x, n);
    for (size_t i = 0; i < n; i++) {
        double v = (double)x[i];
        v = v > 0 ? (v < 1 ? v : 1) : 0;
        double e = image_srgb_encode_exact(v);
        /* Rounded to nearest, but for what double precision cannot tell. */
        assert_true(fabs(e * 255 - out8[i]) <= 0.5 + 1e-9);
        assert_true(fabs(e * 65535 - out16[i]) <= 0.5 + 1e-9);
    }
}

static void test_curve(void **state) {
    (void)state;
    static float x[4096];
    size_t n = 0;
    static const float special[] = {0,          -0.0f,       -1,          1,           2,          1e-30f, 1e30f,
                                    0.0031308f, 0.00195312f, 0.00195313f, 0.99999994f, 1.0000001f, 0.5f,   1e-45f};
    memcpy(x, special, sizeof special);
    check_codes(x, sizeof special / sizeof *special);
    core_random r = core_random_create(1, 2, 3, 4);
    for (int pass = 0; pass < 100; pass++) {
        for (n = 0; n < 4096; n++) {
            double u = core_random_uniform(&r);
            x[n] = (float)(pass % 2 == 0 ? u : exp2(-16 * u));
        }
        check_codes(x, n);
    }
    /* Around every boundary between two 16-bit codes. */
    for (int k = 0; k < 65535; k += 1365) {
        for (n = 0; n < 4095 && n < 1365 * 3; n += 3) {
            int code = k + (int)(n / 3);
            float b = (float)image_srgb_decode_exact((code + 0.5) / 65535);
            x[n] = nextafterf(b, 0);
            x[n + 1] = b;
            x[n + 2] = nextafterf(b, 2);
        }
        check_codes(x, n);
    }
    float bad[3] = {NAN, INFINITY, -INFINITY};
    uint8_t out8[3];
    uint16_t out16[3];
    image_srgb_encode_row_u8(out8, bad, 3);
    image_srgb_encode_row_u16(out16, bad, 3);
    assert_true(out8[0] == 0 && out8[1] == 255 && out8[2] == 0);
    assert_true(out16[0] == 0 && out16[1] == 65535 && out16[2] == 0);
    image_quantize_row_u8(out8, bad, 3);
    assert_true(out8[0] == 0 && out8[1] == 255 && out8[2] == 0);
    for (int i = 0; i < 65536; i++) {
        float d = image_srgb_decode_u16()[i];
        image_srgb_encode_row_u16(out16, &d, 1);
        assert_int_equal(out16[0], i);
        assert_true(fabsf(image_srgb_encode(image_srgb_decode((float)i / 65535.0f)) - (float)i / 65535.0f) < 1e-6f);
    }
    assert_true(image_srgb_encode(-0.5f) == -image_srgb_encode(0.5f));
}

static brace_image *converted(const brace_image *image, uint32_t channels, brace_sample sample,
                              brace_transfer transfer) {
    brace_image *out = NULL;
    assert_int_equal(brace_image_convert(&out, image, channels, sample, transfer, NULL), BRACE_OK);
    return out;
}

/* Going to more precision and back changes nothing. */
static void test_convert_round_trips(void **state) {
    (void)state;
    static const uint32_t channels[] = {1, 3, 4};
    for (int c = 0; c < 3; c++) {
        for (int sample = 0; sample < 2; sample++) {
            for (int transfer = 0; transfer < 2; transfer++) {
                brace_image *a = make_picture(67, 5, channels[c], (brace_sample)sample, (brace_transfer)transfer, 1);
                for (int s2 = sample; s2 < 3; s2++) {
                    for (int t2 = 0; t2 < 2; t2++) {
                        if (t2 != transfer && s2 != BRACE_SAMPLE_F32 && !(sample == 0 && s2 == 1 && transfer == 0)) {
                            continue; /* another curve in the same bits loses codes; U8 in linear U16 keeps its own */
                        }
                        brace_image *b = converted(a, channels[c], (brace_sample)s2, (brace_transfer)t2);
                        brace_image *back = converted(b, channels[c], (brace_sample)sample, (brace_transfer)transfer);
                        assert_same(a, back);
                        brace_image_destroy(b);
                        brace_image_destroy(back);
                    }
                }
                brace_image_destroy(a);
            }
        }
    }
}

static void test_convert_rounding(void **state) {
    (void)state;
    brace_image *a = NULL;
    assert_int_equal(brace_image_create(&a, 65535, 1, 1, BRACE_SAMPLE_U16, BRACE_TRANSFER_SRGB, NULL), BRACE_OK);
    uint16_t *p = a->data;
    for (uint32_t i = 0; i < 65535; i++) {
        p[i] = (uint16_t)(i + 1);
    }
    brace_image *b = converted(a, 1, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB);
    for (uint32_t i = 0; i < 65535; i++) {
        assert_int_equal(((uint8_t *)b->data)[i], lround((i + 1) / 257.0));
    }
    brace_image_destroy(b);
    brace_image_destroy(a);
    a = make_picture(3, 2, 3, BRACE_SAMPLE_F32, BRACE_TRANSFER_LINEAR, 3);
    float *f = a->data;
    f[0] = -3;
    f[1] = 7;
    f[2] = NAN;
    f[3] = 0.5f;
    b = converted(a, 4, BRACE_SAMPLE_U16, BRACE_TRANSFER_LINEAR);
    const uint16_t *q = b->data;
    assert_int_equal(q[0], 0);
    assert_int_equal(q[1], 65535);
    assert_int_equal(q[2], 0);
    assert_int_equal(q[3], 65535); /* opaque */
    assert_int_equal(q[4], 32768);
    brace_image_destroy(b);
    brace_image_destroy(a);
}

static void test_convert_grey(void **state) {
    (void)state;
    brace_image *a = NULL;
    assert_int_equal(brace_image_create(&a, 2, 1, 4, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, NULL), BRACE_OK);
    const uint8_t pixels[8] = {90, 90, 90, 10, 255, 0, 0, 200};
    memcpy(a->data, pixels, 8);
    brace_image *grey = converted(a, 1, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB);
    assert_int_equal(((uint8_t *)grey->data)[0], 90);
    assert_int_equal(((uint8_t *)grey->data)[1], lround(255 * image_srgb_encode_exact(0.2126)));
    brace_image *rgb = converted(grey, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB);
    assert_int_equal(((uint8_t *)rgb->data)[2], 90);
    brace_image *no_alpha = converted(a, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB);
    assert_int_equal(((uint8_t *)no_alpha->data)[3], 255);
    brace_image *linear = converted(a, 4, BRACE_SAMPLE_F32, BRACE_TRANSFER_LINEAR);
    assert_true(fabsf(((float *)linear->data)[3] - 10 / 255.0f) < 1e-7f); /* alpha has no curve */
    brace_image_destroy(linear);
    brace_image_destroy(no_alpha);
    brace_image_destroy(rgb);
    brace_image_destroy(grey);
    brace_image bad = *a;
    bad.stride = 3;
    brace_error error;
    assert_int_equal(brace_image_convert(&grey, &bad, 1, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, &error),
                     BRACE_ERROR_ARGUMENT);
    assert_int_equal(brace_image_convert(&grey, NULL, 1, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, &error),
                     BRACE_ERROR_ARGUMENT);
    for (long n = 1; n <= 3; n++) {
        core_alloc_fail_after(n);
        brace_status status = brace_image_convert(&grey, a, 1, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, &error);
        core_alloc_fail_after(0);
        assert_int_equal(status, BRACE_ERROR_MEMORY);
        assert_null(grey);
    }
    brace_image_destroy(a);
}

static brace_image *turned(const brace_image *image, int orientation) {
    brace_image *out = NULL;
    assert_int_equal(brace_image_orient(&out, image, orientation, NULL), BRACE_OK);
    return out;
}

static void test_orient(void **state) {
    (void)state;
    /* The six pixels of   0 1 2   in each orientation, as EXIF draws them. */
    /*                     3 4 5                                           */
    static const char expected[9][7] = {"",       "012345", "210543", "543210", "345012",
                                        "031425", "304152", "524130", "251403"};
    static const uint32_t channels[] = {1, 3, 4};
    for (int c = 0; c < 3; c++) {
        for (int sample = 0; sample < 3; sample++) {
            brace_image *a = make_picture(3, 2, channels[c], (brace_sample)sample, BRACE_TRANSFER_SRGB, 5);
            size_t pixel = channels[c] * image_sample_size((brace_sample)sample);
            for (int o = 1; o <= 8; o++) {
                brace_image *b = turned(a, o);
                assert_int_equal(b->width, o >= 5 ? 2 : 3);
                for (size_t i = 0; i < 6; i++) {
                    assert_memory_equal((unsigned char *)b->data + i * pixel,
                                        (unsigned char *)a->data + (size_t)(expected[o][i] - '0') * pixel, pixel);
                }
                brace_image_destroy(b);
            }
            brace_image_destroy(a);
        }
    }
    static const int inverse[9] = {0, 1, 2, 3, 4, 5, 8, 7, 6};
    brace_image *a = make_picture(101, 67, 3, BRACE_SAMPLE_U16, BRACE_TRANSFER_LINEAR, 6); /* not a multiple of tiles */
    for (int o = 1; o <= 8; o++) {
        brace_image *b = turned(a, o), *back = turned(b, inverse[o]);
        assert_same(a, back);
        brace_image_destroy(b);
        brace_image_destroy(back);
    }
    brace_image *none = NULL;
    brace_error error;
    assert_int_equal(brace_image_orient(&none, a, 0, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(brace_image_orient(&none, a, 9, &error), BRACE_ERROR_ARGUMENT);
    assert_null(none);
    brace_image_destroy(a);
}

static void means(const brace_image *image, double out[4]) {
    float *row = malloc((size_t)image->width * 4 * sizeof *row);
    assert_non_null(row);
    memset(out, 0, 4 * sizeof *out);
    for (uint32_t y = 0; y < image->height; y++) {
        image_unpack_linear(row, image, y);
        for (uint32_t x = 0; x < image->width; x++) {
            for (uint32_t c = 0; c < image->channels; c++) {
                out[c] += (double)row[x * image->channels + c] / image->width / image->height;
            }
        }
    }
    free(row);
}

static void test_resize(void **state) {
    (void)state;
    static const uint32_t sizes[][2] = {{64, 48}, {33, 21}, {1, 1}, {128, 5}, {7, 97}, {127, 95}, {300, 200}, {64, 1}};
    for (int transfer = 0; transfer < 2; transfer++) {
        brace_image *a = make_picture(127, 95, 3, BRACE_SAMPLE_F32, (brace_transfer)transfer, 7);
        double before[4], after[4];
        means(a, before);
        for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
            brace_image *b = NULL;
            assert_int_equal(brace_image_resize(&b, a, sizes[i][0], sizes[i][1], NULL), BRACE_OK);
            assert_int_equal(b->width, sizes[i][0]);
            assert_int_equal(b->height, sizes[i][1]);
            means(b, after);
            bool shrinks = sizes[i][0] <= 127 && sizes[i][1] <= 95; /* areas: exact; interpolation: nearly */
            for (int c = 0; c < 3; c++) {
                assert_true(fabs(before[c] - after[c]) < (shrinks ? 1e-5 : 5e-3));
            }
            if (sizes[i][0] == 127 && sizes[i][1] == 95 && transfer == BRACE_TRANSFER_LINEAR) {
                assert_same(a, b);
            }
            brace_image_destroy(b);
        }
        brace_image_destroy(a);
    }
    /* A flat picture stays flat to the last bit, at every size and in every type. */
    for (int sample = 0; sample < 3; sample++) {
        brace_image *a = NULL, *b = NULL;
        assert_int_equal(brace_image_create(&a, 19, 13, 4, (brace_sample)sample, BRACE_TRANSFER_SRGB, NULL), BRACE_OK);
        for (size_t i = 0; i < 19 * 13 * 4; i++) {
            if (sample == 0) {
                ((uint8_t *)a->data)[i] = 77;
            } else if (sample == 1) {
                ((uint16_t *)a->data)[i] = 33333;
            } else {
                ((float *)a->data)[i] = 0.25f;
            }
        }
        for (uint32_t w = 1; w < 60; w += 9) {
            assert_int_equal(brace_image_resize(&b, a, w, 61 - w, NULL), BRACE_OK);
            for (size_t i = 0; i < (size_t)w * (61 - w) * 4; i++) {
                if (sample == 0) {
                    assert_int_equal(((uint8_t *)b->data)[i], 77);
                } else if (sample == 1) {
                    assert_true(abs(((uint16_t *)b->data)[i] - 33333) <= 1);
                } else {
                    assert_true(fabsf(((float *)b->data)[i] - 0.25f) < 1e-6f);
                }
            }
            brace_image_destroy(b);
        }
        for (long n = 1; n <= 7; n++) {
            core_alloc_fail_after(n);
            brace_status status = brace_image_resize(&b, a, 9, 9, NULL);
            core_alloc_fail_after(0);
            assert_int_equal(status, BRACE_ERROR_MEMORY);
            assert_null(b);
        }
        assert_int_equal(brace_image_resize(&b, a, 0, 9, NULL), BRACE_ERROR_ARGUMENT);
        brace_image_destroy(a);
    }
}

static void test_profile(void **state) {
    (void)state;
    unsigned char icc[IMAGE_ICC_SIZE];
    image_icc_srgb(icc);
    assert_memory_equal(icc + 36, "acsp", 4);
    assert_int_equal((unsigned)icc[2] << 8 | icc[3], IMAGE_ICC_SIZE);
    assert_true(image_icc_is_srgb(icc, sizeof icc));
    assert_false(image_icc_is_srgb(icc, 100));
    memset(icc + 128, 0, sizeof icc - 128);
    assert_false(image_icc_is_srgb(icc, sizeof icc));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_create),           cmocka_unit_test(test_curve),
        cmocka_unit_test(test_convert_rounding), cmocka_unit_test(test_convert_round_trips),
        cmocka_unit_test(test_convert_grey),     cmocka_unit_test(test_orient),
        cmocka_unit_test(test_resize),           cmocka_unit_test(test_profile),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
