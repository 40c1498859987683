/* SPDX-License-Identifier: Apache-2.0 */
/* test_sfc.c: stripe frequency consistency against NumPy's numbers, what it says of damage, and its edges. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "banding/banding.h"
#include "planes.h"
#include "vectors.h"

static void near(const char *what, size_t i, double got, double wanted) {
    if (!(fabs(got - wanted) <= 1e-4 * fabs(wanted) + 1e-9))
        fail_msg("vector %zu, %s: %.9g instead of %.9g", i, what, got, wanted);
}

static void test_vectors(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof vectors / sizeof *vectors; i++) {
        const uint32_t w = vectors[i].width, h = vectors[i].height;
        const double *wanted = vectors[i].sfc;
        float *pred = planes_make(w, h, 3, vectors[i].fx, vectors[i].fy, vectors[i].phase, 0.04);
        float *gt = planes_make(w, h, 2, vectors[i].fx, vectors[i].fy, vectors[i].phase, 0);
        brace_sfc s;
        const double direction = atan2(vectors[i].fabp[9], vectors[i].fabp[8]);
        assert_int_equal(brace_sfc_plane(&s, pred, gt, w, h, direction, NULL, NULL, NULL), BRACE_OK);
        near("SFC", i, s.sfc, wanted[0]), near("D_ratio", i, s.d_ratio, wanted[1]);
        near("D_profile", i, s.d_profile, wanted[2]), near("delta ratio", i, s.delta_ratio, wanted[3]);
        near("delta profile", i, s.delta_profile, wanted[4]);
        near("rho pred", i, s.rho_pred, wanted[5]), near("rho gt", i, s.rho_gt, wanted[6]);
        assert_true(s.gate == fmax(s.rho_pred, s.rho_gt));
        /* A wave vector has no sign. */
        brace_sfc other;
        assert_int_equal(brace_sfc_plane(&other, pred, gt, w, h, direction - M_PI, NULL, NULL, NULL), BRACE_OK);
        near("SFC, turned by 180 degrees", i, other.sfc, s.sfc);
        free(pred), free(gt);
    }
}

/* More banding left means a larger SFC; the truth itself has 0; brightness does not count. */
static void test_order(void **state) {
    (void)state;
    const uint32_t w = 160, h = 120;
    const double fx = 0.01, fy = -0.1, direction = atan2(fy, fx);
    float *gt = planes_make(w, h, 1, fx, fy, 0, 0);
    double before = -1;
    for (int i = 0; i <= 5; i++) {
        float *pred = planes_make(w, h, 1, fx, fy, 0, 0.01 * i);
        brace_sfc s, brighter;
        assert_int_equal(brace_sfc_plane(&s, pred, gt, w, h, direction, NULL, NULL, NULL), BRACE_OK);
        assert_true(s.sfc > before && (i > 0 || s.sfc == 0));
        assert_true(i == 0 || (s.delta_ratio > 0 && s.delta_profile > 0));
        before = s.sfc;
        for (uint32_t k = 0; k < w * h; k++)
            pred[k] *= 4;
        assert_int_equal(brace_sfc_plane(&brighter, pred, gt, w, h, direction, NULL, NULL, NULL), BRACE_OK);
        assert_true(fabs(brighter.sfc - s.sfc) < 1e-3 * s.sfc + 1e-3);
        free(pred);
    }
    free(gt);
}

/* Of a RAW frame each block's mean in linear light counts, whatever its black, white and colours. */
static brace_frame *frame_of(const float *plane, uint32_t w, uint32_t h, float black) {
    brace_frame *f = NULL;
    assert_int_equal(brace_frame_create(&f, 2 * w, 2 * h, BRACE_CFA_GRBG, NULL), BRACE_OK);
    f->white = 60000;
    for (int c = 0; c < 4; c++)
        f->black[c] = black + (float)(100 * c);
    for (uint32_t y = 0; y < 2 * h; y++)
        for (uint32_t x = 0; x < 2 * w; x++) {
            const unsigned place = (y & 1) * 2 + (x & 1);
            const double sample = 0.4 * (0.7 + 0.2 * place) * (double)plane[(size_t)(y / 2) * w + x / 2];
            f->data[(size_t)y * f->width + x] = (uint16_t)lround((double)f->black[place] + sample * (60000 - (double)f->black[place]));
        }
    return f;
}

static void test_frames(void **state) {
    (void)state;
    enum { W = 96, H = 70 };
    brace_sfc of_planes, of_frames;
    brace_error error;
    float *gt = planes_make(W, H, 1, 0.1, 0.1, 0, 0), *pred = planes_make(W, H, 1, 0, 0.11, 0.3, 0.1);
    brace_frame *a = frame_of(pred, W, H, 512), *b = frame_of(gt, W, H, 4000), *small = frame_of(gt, W, H - 1, 0);
    assert_int_equal(brace_sfc_plane(&of_planes, pred, gt, W, H, M_PI / 2, NULL, NULL, NULL), BRACE_OK);
    assert_int_equal(brace_sfc_frame(&of_frames, a, b, M_PI / 2, NULL, NULL, NULL), BRACE_OK);
    assert_true(of_planes.sfc > 1);
    near("sfc of frames", 0, of_frames.sfc / of_planes.sfc, 1);
    near("ratio of frames", 0, of_frames.d_ratio / of_planes.d_ratio, 1);
    assert_int_equal(brace_sfc_frame(&of_frames, a, small, 0, NULL, NULL, &error), BRACE_ERROR_MISMATCH);
    assert_non_null(strstr(error.message, "96 x 69"));
    a->white = 0;
    assert_int_not_equal(brace_sfc_frame(&of_frames, a, b, 0, NULL, NULL, &error), BRACE_OK);
    brace_frame_destroy(a), brace_frame_destroy(b), brace_frame_destroy(small);
    free(gt), free(pred);
}

static void test_edges(void **state) {
    (void)state;
    brace_sfc s, mean, deviation;
    brace_error error;
    float *textured = planes_make(40, 30, 1, 0.1, 0.1, 0, 0.2), *flat = calloc(1200, sizeof *flat);
    assert_int_equal(brace_sfc_plane(&s, flat, flat, 40, 30, 1, NULL, NULL, NULL), BRACE_OK);
    assert_true(s.sfc == 0 && s.rho_pred == 0 && s.rho_gt == 0);
    assert_int_equal(brace_sfc_plane(&s, flat, textured, 40, 30, 1, NULL, NULL, NULL), BRACE_OK);
    assert_true(isfinite(s.sfc) && s.rho_pred == 0 && s.delta_ratio <= 0);
    static const uint32_t sizes[][2] = {{1, 1}, {1, 9}, {2, 2}, {7, 3}};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        assert_int_equal(brace_sfc_plane(&s, textured, flat, sizes[i][0], sizes[i][1], 1, NULL, NULL, NULL), BRACE_OK);
        assert_true(isfinite(s.sfc) && isfinite(s.d_profile));
    }
    textured[45] = NAN;
    assert_int_equal(brace_sfc_plane(&s, flat, textured, 40, 30, 1, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "(5, 1)"));
    assert_int_equal(brace_sfc_plane(&s, flat, flat, 40, 30, NAN, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    const brace_sfc_params wide = {.half_width = 200};
    assert_int_equal(brace_sfc_plane(&s, flat, flat, 40, 30, 0, &wide, NULL, &error), BRACE_ERROR_ARGUMENT);
    for (int i = 1; i < 3; i++) { /* the ring would end before it begins, at 3 */
        const brace_sfc_params narrow = {.r_max = i};
        assert_int_equal(brace_sfc_plane(&s, flat, flat, 40, 30, 0, &narrow, NULL, &error), BRACE_ERROR_ARGUMENT);
        assert_non_null(strstr(error.message, "ring from 3"));
    }
    const brace_sfc_params huge = {.r_max = 1e6};
    assert_int_equal(brace_sfc_plane(&s, flat, flat, 40, 30, 0, &huge, NULL, &error), BRACE_OK);

    brace_image *a = NULL, *b = NULL;
    assert_int_equal(brace_image_create(&a, 8, 8, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, NULL), BRACE_OK);
    assert_int_equal(brace_image_create(&b, 8, 9, 1, BRACE_SAMPLE_U16, BRACE_TRANSFER_SRGB, NULL), BRACE_OK);
    assert_int_equal(brace_sfc_image(&s, a, b, 0, NULL, NULL, &error), BRACE_ERROR_MISMATCH);
    assert_non_null(strstr(error.message, "8 x 9"));
    brace_image_destroy(a), brace_image_destroy(b);

    const brace_sfc set[2] = {{.sfc = 1, .delta_ratio = -3, .gate = 0.5}, {.sfc = 3, .delta_ratio = 3, .gate = 0.5}};
    brace_sfc_summary(&mean, &deviation, set, 2);
    assert_true(mean.sfc == 2 && deviation.sfc == 1 && mean.delta_ratio == 0 && deviation.delta_ratio == 3);
    assert_true(mean.gate == 0.5 && deviation.gate == 0);
    brace_sfc_summary(&mean, &deviation, NULL, 0);
    assert_true(mean.sfc == 0 && deviation.sfc == 0);
    free(textured), free(flat);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_vectors), cmocka_unit_test(test_order),
                                       cmocka_unit_test(test_frames), cmocka_unit_test(test_edges)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
