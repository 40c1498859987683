/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_metrics.c: PSNR and SSIM against scikit-image's numbers, MS-SWD against PyTorch's, and their edges.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "core/core.h"
#include "metrics/metrics.h"
#include "metrics/swd.h"
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

/* ---- MS-SWD ---- */

static void test_swd_vectors(void **state) {
    (void)state;
    static const char *const sets[] = {"plain", "avx2", "avx512"};
    for (size_t i = 0; i < sizeof swd_vectors / sizeof *swd_vectors; i++) {
        uint32_t w = swd_vectors[i].width, h = swd_vectors[i].height, c = swd_vectors[i].channels;
        brace_image *a = picture(w, h, c, c, 1, swd_vectors[i].noise),
                    *b = picture(w, h, c, c, 2, swd_vectors[i].noise);
        const brace_ms_swd_params params = {
            swd_vectors[i].scales, swd_vectors[i].projections, swd_vectors[i].seed, {0}};
        for (size_t s = 0; s < sizeof sets / sizeof *sets; s++) {
            assert_int_equal(setenv("BRACE_CPU", sets[s], 1), 0);
            double first = 0;
            for (int threads = 1; threads <= (s == 2 ? 5 : 1); threads += 4) { /* s 2: the fastest that there is */
                brace_job job = {.threads = threads};
                double distance = -1;
                assert_int_equal(brace_ms_swd(&distance, a, b, &params, &job, NULL), BRACE_OK);
                assert_true(fabs(distance - swd_vectors[i].distance) < 1e-5 * swd_vectors[i].distance);
                if (threads == 1) {
                    first = distance;
                }
                assert_memory_equal(&distance, &first, sizeof first);
            }
        }
        unsetenv("BRACE_CPU");
        brace_image_destroy(a);
        brace_image_destroy(b);
    }
}

static int by_value(const void *a, const void *b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* The bins against plain sorting: spread and bunched numbers, ties, sets that cross often. */
static void test_wasserstein(void **state) {
    (void)state;
    enum { MOST = 20000 };
    static float x[MOST], y[MOST], u[MOST], v[MOST], scratch[MOST];
    core_random r = core_random_create(5, 0, 0, 0);
    for (int i = 0; i < 120; i++) {
        size_t n = i < 20 ? (size_t)(1 + i) : 1 + core_random_below(&r, MOST);
        double shift = i % 3 == 0 ? 0 : core_random_range(&r, -1, 1), spread = i % 5 == 0 ? 0 : pow(10, i % 7 - 4);
        for (size_t k = 0; k < n; k++) {
            double p = core_random_normal(&r), q = core_random_normal(&r);
            if (i % 4 == 1) { /* few different values */
                p = floor(2 * p), q = floor(2 * q);
            } else if (i % 4 == 2 && k % 3 == 0) { /* a third far away */
                p += 1000;
                q += 1000;
            }
            x[k] = (float)(spread * p - 7);
            y[k] = (float)(spread * (q + shift) - 7);
            u[k] = x[k];
            v[k] = y[k];
        }
        double got = metrics_wasserstein(x, y, n, scratch), sum = 0;
        qsort(u, n, sizeof *u, by_value);
        qsort(v, n, sizeof *v, by_value);
        for (size_t k = 0; k < n; k++) {
            sum += fabs((double)u[k] - (double)v[k]);
        }
        double most = fabs((double)u[0]) + fabs((double)u[n - 1]);
        assert_true(fabs(got - sum / (double)n) <= 1e-6 * sum / (double)n + 2e-8 * most);
    }
    x[0] = y[0] = 1;
    assert_true(metrics_wasserstein(x, y, 1, scratch) == 0);
    x[0] = 0, y[0] = 1e-45f; /* nothing to divide by */
    assert_true(metrics_wasserstein(x, y, 1, scratch) < 1e-40);
}

static void test_swd_edges(void **state) {
    (void)state;
    brace_image *a = picture(60, 40, 3, 3, 1, 30), *b = picture(40, 60, 3, 3, 2, 30), *grey = NULL, *rgba = NULL;
    double v = -7, w = -7;
    brace_error error;
    assert_int_equal(brace_ms_swd(&v, a, a, NULL, NULL, &error), BRACE_OK);
    assert_true(v == 0);
    /* Where things are does not matter, but for what the borders repeat. */
    brace_image *still = picture(60, 40, 3, 3, 2, 30);
    assert_int_equal(brace_ms_swd(&v, a, still, NULL, NULL, &error), BRACE_OK);
    assert_true(v > 0.1);
    assert_int_equal(brace_ms_swd(&w, still, a, NULL, NULL, &error), BRACE_OK);
    assert_true(fabs(v - w) < 1e-6 * v);
    /* Constant pictures: black and white differ by 100 in L; a direction adds up to sum of its L taps times that. */
    memset(a->data, 0, a->stride * a->height);
    assert_int_equal(brace_ms_swd(&v, a, a, NULL, NULL, &error), BRACE_OK);
    assert_true(v == 0);
    for (size_t i = 0; i < still->stride / 4 * still->height; i++) {
        ((float *)still->data)[i] = 1;
    }
    assert_int_equal(brace_ms_swd(&v, a, still, NULL, NULL, &error), BRACE_OK);
    assert_true(v > 35 && v < 60); /* 100 times the mean of |N(0, 1/3)|: 46 */
    assert_int_equal(brace_image_convert(&grey, a, 1, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, NULL), BRACE_OK);
    assert_int_equal(brace_image_convert(&rgba, a, 4, BRACE_SAMPLE_U16, BRACE_TRANSFER_LINEAR, NULL), BRACE_OK);
    assert_int_equal(brace_ms_swd(&v, grey, rgba, NULL, NULL, &error), BRACE_OK);
    assert_true(v == 0);
    v = -7;
    assert_int_equal(brace_ms_swd(&v, a, b, NULL, NULL, &error), BRACE_ERROR_MISMATCH);
    assert_non_null(strstr(error.message, "60 x 40"));
    const brace_ms_swd_params many = {.scales = 13}, few = {.projections = -1};
    assert_int_equal(brace_ms_swd(&v, a, a, &many, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(brace_ms_swd(&v, a, a, &few, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(brace_ms_swd(&v, a, NULL, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    const int cancel = 1;
    brace_job job = {.cancel = &cancel};
    assert_int_equal(brace_ms_swd(&v, a, a, NULL, &job, &error), BRACE_ERROR_CANCELLED);
    ((float *)a->data)[100] = NAN;
    assert_int_equal(brace_ms_swd(&v, a, still, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(brace_ms_swd(&v, still, a, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    ((float *)a->data)[100] = INFINITY;
    assert_int_equal(brace_ms_swd(&v, a, still, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    for (long n = 1; n <= 16; n++) {
        core_alloc_fail_after(n);
        brace_status status = brace_ms_swd(&v, b, b, NULL, NULL, &error);
        core_alloc_fail_after(0);
        assert_int_equal(status, BRACE_ERROR_MEMORY);
    }
    assert_true(v == -7);
    brace_image_destroy(a);
    brace_image_destroy(b);
    brace_image_destroy(still);
    brace_image_destroy(grey);
    brace_image_destroy(rgba);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_swd_vectors), cmocka_unit_test(test_wasserstein), cmocka_unit_test(test_swd_edges),
        cmocka_unit_test(test_vectors),     cmocka_unit_test(test_equal),       cmocka_unit_test(test_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
