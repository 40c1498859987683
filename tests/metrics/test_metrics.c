/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_metrics.c: PSNR and SSIM against scikit-image's numbers, and their edges.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "core/core.h"
#include "metrics/metrics.h"
#include "vectors.h"

/* As in make_vectors.py. `out_channels` may be one more than `channels`: alpha. */
static brace_image *picture(uint32_t width, uint32_t height, uint32_t channels, uint32_t out_channels, uint32_t seed,
                            uint32_t noise) {
    brace_image *image = NULL;
    assert_int_equal(
        brace_image_create(&image, width, height, out_channels, BRACE_SAMPLE_F32, BRACE_TRANSFER_SRGB, NULL), BRACE_OK);
    float *p = image->data;
    for (uint32_t y = 0; y < height; y++) {
        for (uint32_t x = 0; x < width; x++) {
            for (uint32_t c = 0; c < out_channels; c++) {
                uint32_t base = (x * 5 + y * 3 + c * 40 + x * y / 7) % 256;
                uint32_t h = ((y * width + x) * channels + c + 1) * 2654435761u + seed * 40503u;
                h = (h ^ h >> 15) * 2246822519u;
                h = h >> 16 & 255;
                p[((size_t)y * width + x) * out_channels + c] =
                    (float)((base * (100 - noise) + h * noise) / 100) / 255.0f;
            }
        }
    }
    return image;
}

static void test_vectors(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof vectors / sizeof *vectors; i++) {
        uint32_t w = vectors[i].width, h = vectors[i].height, c = vectors[i].channels;
        for (uint32_t alpha = 0; alpha <= (c == 3 ? 1u : 0u); alpha++) {
            brace_image *a = picture(w, h, c, c + alpha, 1, vectors[i].noise);
            brace_image *b = picture(w, h, c, c + alpha, 2, vectors[i].noise);
            double first_psnr = 0, first_ssim = 0;
            for (int threads = 1; threads <= 5; threads += 2) {
                brace_job job = {.threads = threads};
                double psnr = 0, ssim = 0;
                assert_int_equal(metrics_psnr(&psnr, a, b, &job, NULL), BRACE_OK);
                assert_int_equal(metrics_ssim(&ssim, a, b, &job, NULL), BRACE_OK);
                assert_true(fabs(psnr - vectors[i].psnr) < 1e-5);
                assert_true(fabs(ssim - vectors[i].ssim) < 1e-6);
                if (threads == 1) {
                    first_psnr = psnr;
                    first_ssim = ssim;
                }
                assert_memory_equal(&psnr, &first_psnr, sizeof psnr);
                assert_memory_equal(&ssim, &first_ssim, sizeof ssim);
            }
            brace_image_destroy(a);
            brace_image_destroy(b);
        }
    }
}

static void test_equal(void **state) {
    (void)state;
    brace_image *a = picture(20, 30, 3, 3, 1, 30);
    double v = 0;
    assert_int_equal(metrics_psnr(&v, a, a, NULL, NULL), BRACE_OK);
    assert_true(isinf(v) && v > 0);
    assert_int_equal(metrics_ssim(&v, a, a, NULL, NULL), BRACE_OK);
    assert_true(fabs(v - 1) < 1e-12);
    brace_image_destroy(a);
}

static void test_refused(void **state) {
    (void)state;
    brace_image *a = picture(20, 30, 3, 3, 1, 30), *b = picture(30, 20, 3, 3, 1, 30),
                *small = picture(10, 40, 3, 3, 1, 9);
    brace_image *bytes = NULL;
    assert_int_equal(brace_image_create(&bytes, 20, 30, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, NULL), BRACE_OK);
    double v = -7;
    brace_error error;
    assert_int_equal(metrics_psnr(&v, a, b, NULL, &error), BRACE_ERROR_MISMATCH);
    assert_non_null(strstr(error.message, "20 x 30"));
    assert_int_equal(metrics_ssim(&v, a, b, NULL, &error), BRACE_ERROR_MISMATCH);
    assert_int_equal(metrics_ssim(&v, small, small, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(metrics_psnr(&v, a, bytes, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(metrics_psnr(&v, a, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    ((float *)a->data)[100] = NAN;
    assert_int_equal(metrics_psnr(&v, a, a, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(metrics_ssim(&v, a, a, NULL, &error), BRACE_ERROR_ARGUMENT);
    const int cancel = 1;
    brace_job job = {.cancel = &cancel};
    assert_int_equal(metrics_ssim(&v, small, small, &job, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(metrics_ssim(&v, b, b, &job, &error), BRACE_ERROR_CANCELLED);
    assert_true(v == -7);
    for (long n = 1; n <= 4; n++) {
        core_alloc_fail_after(n);
        brace_status status = metrics_ssim(&v, b, b, NULL, &error);
        core_alloc_fail_after(0);
        assert_int_equal(status, BRACE_ERROR_MEMORY);
    }
    brace_image_destroy(a);
    brace_image_destroy(b);
    brace_image_destroy(small);
    brace_image_destroy(bytes);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_vectors),
        cmocka_unit_test(test_equal),
        cmocka_unit_test(test_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
