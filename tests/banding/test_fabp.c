/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_fabp.c: the banding prior against NumPy's numbers, against stripes of
 * known frequency, direction and phase, and at its edges.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "banding/banding.h"
#include "brace/develop.h"
#include "planes.h"
#include "vectors.h"

static void near(const char *what, size_t i, double got, double wanted) {
    if (!(fabs(got - wanted) <= 1e-4 * fabs(wanted) + 1e-9))
        fail_msg("vector %zu, %s: %.9g instead of %.9g", i, what, got, wanted);
}

/* The transform of any length against the sum that defines it, in double. */
static void test_lengths(void **state) {
    (void)state;
    static const size_t lengths[] = {1, 2, 3, 4, 5, 7, 8, 14, 29, 31, 37, 49, 60, 77, 97, 120, 121, 127, 251, 343, 504};
    for (size_t l = 0; l < sizeof lengths / sizeof *lengths; l++) {
        const size_t n = lengths[l];
        banding_fft *fft = NULL;
        assert_int_equal(banding_fft_create(&fft, n, NULL), BRACE_OK);
        banding_complex *in = core_alloc(n, sizeof *in), *out = core_alloc(n, sizeof *out);
        banding_complex *scratch = core_alloc(banding_fft_scratch(fft), sizeof *scratch);
        for (size_t i = 0; i < n; i++)
            in[i] = (banding_complex){(float)((i * 7919 + 13) % 101) / 50 - 1, (float)((i * 104729 + 5) % 89) / 44 - 1};
        banding_fft_run(fft, in, out, scratch);
        for (size_t k = 0; k < n; k++) {
            double re = 0, im = 0;
            for (size_t i = 0; i < n; i++) {
                double a = -2 * M_PI * (double)(i * k % n) / (double)n;
                re += in[i].re * cos(a) - in[i].im * sin(a), im += in[i].re * sin(a) + in[i].im * cos(a);
            }
            double off = hypot(out[k].re - re, out[k].im - im);
            if (!(off < 3e-6 * sqrt((double)n) * 2))
                fail_msg("length %zu, frequency %zu: off by %g", n, k, off);
        }
        core_free(in), core_free(out), core_free(scratch);
        banding_fft_destroy(fft);
    }
    brace_error error;
    banding_fft *none = NULL;
    assert_int_equal(banding_fft_create(&none, 0, &error), BRACE_ERROR_ARGUMENT);
}

static void test_vectors(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof vectors / sizeof *vectors; i++) {
        const uint32_t w = vectors[i].width, h = vectors[i].height;
        const double *wanted = vectors[i].fabp;
        float *plane = planes_make(w, h, 1, vectors[i].fx, vectors[i].fy, vectors[i].phase, 0.25);
        brace_fabp first;
        for (int threads = 1; threads <= 3; threads += 2) {
            brace_job job = {.threads = threads};
            brace_fabp f;
            assert_int_equal(brace_fabp_plane(&f, plane, w, h, NULL, &job, NULL), BRACE_OK);
            if (threads == 1)
                memcpy(&first, &f, sizeof f);
            assert_memory_equal(&first, &f, sizeof f);
            assert_int_equal(f.u, (int)wanted[0]);
            assert_int_equal(f.v, (int)wanted[1]);
            near("fx", i, f.fx, wanted[2]), near("fy", i, f.fy, wanted[3]), near("theta", i, f.theta, wanted[4]);
            near("f", i, f.f, hypot(wanted[2], wanted[3]));
            near("rho", i, f.rho, wanted[5]), near("peak", i, f.peak_power, wanted[6]);
            near("ring", i, f.ring_power, wanted[7]);
            near("refined fx", i, f.refined_fx, wanted[8]), near("refined fy", i, f.refined_fy, wanted[9]);
            near("refined theta", i, f.refined_theta, wanted[10]), near("amplitude", i, f.amplitude, wanted[11]);
            near("phase", i, f.phase, wanted[12]);
            const double s[8] = {hypot(wanted[8], wanted[9]), cos(2 * wanted[10]), sin(2 * wanted[10]), wanted[13],
                                 wanted[14],                  wanted[5],           cos(wanted[12]),     sin(wanted[12])};
            for (int k = 0; k < 8; k++)
                near("descriptor", i, f.descriptor[k], s[k]);
        }
        free(plane);
    }
}

/* Random stripes in texture and noise: frequency within 0.5 %, direction within 0.5 degrees. */
static void test_stripes(void **state) {
    (void)state;
    core_random r = core_random_create(4, 1, 0, 0);
    for (int n = 0; n < 120; n++) {
        const uint32_t w = 200 + core_random_below(&r, 200), h = 200 + core_random_below(&r, 200);
        const double cycles = core_random_range(&r, 8, 40), angle = core_random_range(&r, 0, M_PI);
        const double f = cycles / (w < h ? w : h), phase = core_random_range(&r, -M_PI, M_PI);
        const double amplitude = core_random_range(&r, 0.1, 0.3);
        /* The half-plane has fy <= 0. */
        const double fx = f * cos(angle), fy = -f * sin(angle);
        float *plane = planes_make(w, h, (uint32_t)n, fx, fy, phase, amplitude);
        brace_fabp got;
        assert_int_equal(brace_fabp_plane(&got, plane, w, h, NULL, NULL, NULL), BRACE_OK);
        free(plane);
        double turn = remainder(got.refined_theta - atan2(fy, fx) - M_PI / 2, M_PI) * 180 / M_PI;
        if (!(fabs(got.refined_f / f - 1) < 0.005) || !(fabs(turn) < 0.5))
            fail_msg("%u x %u, %.2f cycles at %.1f degrees, amplitude %.2f: %.4f %% and %.3f degrees off", w, h, cycles,
                     angle * 180 / M_PI, amplitude, 100 * (got.refined_f / f - 1), turn);
        assert_true(fabs(got.amplitude / amplitude - 1) < 0.1);
        double off = remainder(got.phase - phase, 2 * M_PI);
        /* A wave vector along a row may come out with the other sign. */
        if (got.refined_fx * fx + got.refined_fy * fy < 0)
            off = remainder(got.phase + phase, 2 * M_PI);
        assert_true(fabs(off) < 0.15);
    }
}

static void test_edges(void **state) {
    (void)state;
    brace_fabp f;
    brace_error error;
    static const uint32_t sizes[][2] = {{1, 1}, {2, 1}, {1, 7}, {3, 3}, {5, 2}, {64, 1}, {8, 8}, {31, 17}};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        const uint32_t w = sizes[i][0], h = sizes[i][1];
        for (int kind = 0; kind < 3; kind++) {
            float *plane = planes_make(w, h, 1, 0.1, 0.2, 0, 0.2);
            for (uint32_t k = 0; kind < 2 && k < w * h; k++)
                plane[k] = kind == 0 ? 0 : 0.7f;
            assert_int_equal(brace_fabp_plane(&f, plane, w, h, NULL, NULL, &error), BRACE_OK);
            const double all[] = {f.f, f.theta, f.rho, f.refined_f, f.refined_theta, f.amplitude, f.phase};
            for (size_t k = 0; k < sizeof all / sizeof *all; k++)
                assert_true(isfinite(all[k]));
            for (int k = 0; k < 8; k++)
                assert_true(isfinite(f.descriptor[k]));
            if (kind < 2) {
                assert_true(f.peak_power == 0 && f.rho == 0 && f.descriptor[0] == 0);
                assert_true(fabsf(f.descriptor[3] - logf(1e-12f)) < 1e-3f);
            }
            free(plane);
        }
    }
    float bad[12] = {0};
    bad[7] = NAN;
    assert_int_equal(brace_fabp_plane(&f, bad, 4, 3, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "(3, 1)"));
    bad[7] = INFINITY;
    assert_int_equal(brace_fabp_plane(&f, bad, 4, 3, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(brace_fabp_plane(&f, bad, 0, 3, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(brace_fabp_plane(&f, NULL, 4, 3, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    bad[7] = 0;
    const brace_fabp_params nonsense = {.r_min = 5, .r_max = 2};
    assert_int_equal(brace_fabp_plane(&f, bad, 4, 3, &nonsense, NULL, &error), BRACE_ERROR_ARGUMENT);
    const brace_fabp_params nan_radius = {.r_min = NAN};
    assert_int_equal(brace_fabp_plane(&f, bad, 4, 3, &nan_radius, NULL, &error), BRACE_ERROR_ARGUMENT);
}

/* A frame is measured by its packed planes, whatever its black levels and its CFA. */
static void test_frame(void **state) {
    (void)state;
    const uint32_t w = 203, h = 160;
    const double fx = 0.031, fy = -0.11;
    brace_frame *frame = NULL;
    assert_int_equal(brace_frame_create(&frame, w, h, BRACE_CFA_GBRG, NULL), BRACE_OK);
    const float black[4] = {64, 80, 100, 72};
    memcpy(frame->black, black, sizeof black);
    frame->white = 4095;
    for (uint32_t y = 0; y < h; y++)
        for (uint32_t x = 0; x < w; x++) {
            /* 2 packed planes' steps in each mosaic step. */
            double px = x / 2 - (w / 2 - 1) / 2.0, py = y / 2 - (h / 2 - 1) / 2.0;
            double s = 0.4 + 0.2 * cos(2 * M_PI * (fx * px + fy * py) + 1), b = black[(y & 1) * 2 + (x & 1)];
            frame->data[y * w + x] = (uint16_t)lround(b + s * (4095 - b));
        }
    brace_fabp f;
    assert_int_equal(brace_fabp_frame(&f, frame, NULL, NULL, NULL), BRACE_OK);
    assert_int_equal(f.width, w / 2);
    assert_int_equal(f.height, h / 2);
    assert_true(fabs(f.refined_fx - fx) < 0.02 / (w / 2) && fabs(f.refined_fy - fy) < 0.02 / (h / 2));
    assert_true(fabs(f.amplitude - 0.2) < 0.003 && fabs(f.phase - 1) < 0.01);
    brace_frame_destroy(frame);
}

/* Directions under EXIF orientations: measured on the stored picture or on the turned one, all the same. */
static void test_orientation(void **state) {
    (void)state;
    const uint32_t w = 96, h = 80;
    float *plane = planes_make(w, h, 1, 0.05, -0.12, 0, 0.4);
    brace_image *image = NULL;
    assert_int_equal(brace_image_create(&image, w, h, 1, BRACE_SAMPLE_F32, BRACE_TRANSFER_SRGB, NULL), BRACE_OK);
    for (uint32_t y = 0; y < h; y++)
        memcpy((char *)image->data + y * image->stride, plane + y * w, w * sizeof *plane);
    brace_fabp stored, turned;
    assert_int_equal(brace_fabp_image(&stored, image, NULL, NULL, NULL), BRACE_OK);
    for (int orientation = 1; orientation <= 8; orientation++) {
        brace_image *upright = NULL;
        assert_int_equal(brace_image_orient(&upright, image, orientation, NULL), BRACE_OK);
        assert_int_equal(brace_fabp_image(&turned, upright, NULL, NULL, NULL), BRACE_OK);
        double off = remainder(brace_fabp_direction(&turned, 1) - brace_fabp_direction(&stored, orientation), M_PI);
        assert_true(fabs(off) < 1e-3);
        brace_image_destroy(upright);
    }
    brace_image_destroy(image);
    free(plane);
}

/* Whatever allocation fails, the failure is reported and nothing leaks. */
static void test_memory(void **state) {
    (void)state;
    float *plane = planes_make(74, 77, 1, 0.05, 0.1, 0, 0.3);
    brace_status status = BRACE_ERROR_MEMORY;
    const brace_job job = {.threads = 1};
    for (long n = 1; status != BRACE_OK && n < 100; n++) {
        brace_fabp f;
        core_alloc_fail_after(n);
        status = brace_fabp_plane(&f, plane, 74, 77, NULL, &job, NULL);
        core_alloc_fail_after(0);
        assert_true(status == BRACE_OK || status == BRACE_ERROR_MEMORY);
        assert_true(n > 3 || status == BRACE_ERROR_MEMORY);
    }
    assert_int_equal(status, BRACE_OK);
    free(plane);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lengths), cmocka_unit_test(test_vectors), cmocka_unit_test(test_stripes),
        cmocka_unit_test(test_edges),   cmocka_unit_test(test_frame),   cmocka_unit_test(test_orientation),
        cmocka_unit_test(test_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
