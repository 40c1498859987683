/* SPDX-License-Identifier: Apache-2.0 */
/*
 * psnr.c: peak signal-to-noise ratio. Each row is summed by itself, and the rows
 * in order, so the result is the same for any number of threads.
 */
#include <math.h>

#include "image/image.h"
#include "metrics/metrics.h"

brace_status metrics_check(const brace_image *a, const brace_image *b, uint32_t side, brace_error *error) {
    brace_status status = image_check(a, error);
    if (status == BRACE_OK) {
        status = image_check(b, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    if (a->sample != BRACE_SAMPLE_F32 || b->sample != BRACE_SAMPLE_F32) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "pictures are compared as float images");
    }
    if (a->width != b->width || a->height != b->height || a->channels != b->channels) {
        return core_fail(error, BRACE_ERROR_MISMATCH,
                         "the pictures cannot be compared: one has %u x %u pixels and %u channels, the other %u x %u "
                         "and %u",
                         a->width, a->height, a->channels, b->width, b->height, b->channels);
    }
    if (a->transfer != b->transfer) {
        return core_fail(error, BRACE_ERROR_MISMATCH,
                         "the pictures cannot be compared: one is linear, the other sRGB-encoded");
    }
    if (a->width < side || a->height < side) {
        return core_fail(error, BRACE_ERROR_ARGUMENT,
                         "the pictures are too small to be compared: %u x %u pixels, at least %u a side are needed",
                         a->width, a->height, side);
    }
    return BRACE_OK;
}

typedef struct psnr_run {
    const brace_image *a, *b;
    const brace_job *job;
    double *rows; /* sum of squared differences of each */
} psnr_run;

static void work(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    psnr_run *run = arg;
    uint32_t channels = run->a->channels, colors = channels == 4 ? 3 : channels;
    for (size_t y = begin; y < end && !core_cancelled(run->job); y++) {
        const float *a = (const float *)(const void *)image_row(run->a, (uint32_t)y);
        const float *b = (const float *)(const void *)image_row(run->b, (uint32_t)y);
        double sum = 0;
        for (size_t x = 0; x < run->a->width; x++, a += channels, b += channels) {
            for (uint32_t c = 0; c < colors; c++) {
                double d = (double)a[c] - (double)b[c];
                sum += d * d;
            }
        }
        run->rows[y] = sum;
    }
}

brace_status metrics_psnr(double *out, const brace_image *a, const brace_image *b, const brace_job *job,
                          brace_error *error) {
    brace_status status = metrics_check(a, b, 1, error);
    if (status != BRACE_OK) {
        return status;
    }
    core_pool *pool = NULL;
    status = core_pool_create(&pool, job, error);
    if (status != BRACE_OK) {
        return status;
    }
    psnr_run run = {a, b, job, core_calloc(a->height, sizeof *run.rows)};
    if (run.rows == NULL) {
        status = core_fail_memory(error, a->height * sizeof *run.rows, "comparing pictures");
    } else {
        core_parallel(pool, a->height, 16, work, &run);
        status = core_check_cancel(job, error);
    }
    if (status == BRACE_OK) {
        double sum = 0;
        for (uint32_t y = 0; y < a->height; y++) {
            sum += run.rows[y];
        }
        double samples = (double)a->width * (double)a->height * (a->channels == 1 ? 1 : 3);
        if (isfinite(sum)) {
            *out = sum > 0 ? 10.0 * log10(samples / sum) : (double)INFINITY;
        } else {
            status = core_fail(error, BRACE_ERROR_ARGUMENT, "a picture to be compared holds infinite values or NaN");
        }
    }
    core_free(run.rows);
    core_pool_destroy(pool);
    return status;
}
