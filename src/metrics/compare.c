/* SPDX-License-Identifier: Apache-2.0 */
/*
 * compare.c: any two pictures as the metrics want them.
 */
#include "image/image.h"
#include "metrics/metrics.h"

brace_status metrics_take(brace_image *out[2], const brace_image *a, const brace_image *b, brace_error *error) {
    out[0] = out[1] = NULL;
    brace_status status = image_check(a, error);
    if (status == BRACE_OK) {
        status = image_check(b, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    if (a->width != b->width || a->height != b->height) {
        return core_fail(error, BRACE_ERROR_MISMATCH,
                         "the pictures cannot be compared: one has %u x %u pixels, the other %u x %u", a->width,
                         a->height, b->width, b->height);
    }
    for (int k = 0; k < 2 && status == BRACE_OK; k++) {
        status = brace_image_convert(&out[k], k == 0 ? a : b, 3, BRACE_SAMPLE_F32, BRACE_TRANSFER_SRGB, error);
    }
    if (status != BRACE_OK) {
        brace_image_destroy(out[0]);
        brace_image_destroy(out[1]);
        out[0] = out[1] = NULL;
    }
    return status;
}

typedef brace_status compare_fn(double *out, const brace_image *a, const brace_image *b, const brace_job *job,
                                brace_error *error);

static brace_status taken(compare_fn *fn, double *out, const brace_image *a, const brace_image *b, const brace_job *job,
                          brace_error *error) {
    brace_image *picture[2];
    brace_status status = metrics_take(picture, a, b, error);
    if (status == BRACE_OK) {
        status = fn(out, picture[0], picture[1], job, error);
    }
    brace_image_destroy(picture[0]);
    brace_image_destroy(picture[1]);
    return status;
}

brace_status brace_psnr(double *out, const brace_image *a, const brace_image *b, const brace_job *job,
                        brace_error *error) {
    return taken(metrics_psnr, out, a, b, job, error);
}

brace_status brace_ssim(double *out, const brace_image *a, const brace_image *b, const brace_job *job,
                        brace_error *error) {
    return taken(metrics_ssim, out, a, b, job, error);
}
