/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ssim.c: structural similarity. The five windowed means (of a, b, aa, bb and
 * ab) are filtered along the row, kept for the last 11 rows, and filtered down
 * the column: scratch is a few rows a thread, whatever the picture's size.
 */
#include <math.h>
#include <string.h>

#include "image/image.h"
#include "metrics/metrics.h"

#define RADIUS 5
#define TAPS (2 * RADIUS + 1)
#define MEANS 5
#define GRAIN 64 /* rows a piece: each filters 10 rows more than it gives */

typedef struct ssim_run {
    const brace_image *a, *b;
    const brace_job *job;
    double window[TAPS];
    size_t valid; /* positions of the window along a row */
    double *scratch;
    size_t scratch_size; /* doubles a worker */
    double *rows;        /* [channel][window position] sum of SSIM along a row */
} ssim_run;

/* The windowed means along row y of channel c: MEANS rows of `valid` doubles at `out`. `line` has 5*width. */
static void filter_row(const ssim_run *run, uint32_t y, uint32_t c, double *out, double *line) {
    size_t width = run->a->width, valid = run->valid;
    const float *a = (const float *)(const void *)image_row(run->a, y) + c;
    const float *b = (const float *)(const void *)image_row(run->b, y) + c;
    for (size_t x = 0; x < width; x++) {
        double u = (double)a[x * run->a->channels], v = (double)b[x * run->a->channels];
        line[x] = u;
        line[width + x] = v;
        line[2 * width + x] = u * u;
        line[3 * width + x] = v * v;
        line[4 * width + x] = u * v;
    }
    for (int m = 0; m < MEANS; m++) {
        const double *in = line + (size_t)m * width;
        double *to = out + (size_t)m * valid;
        for (size_t x = 0; x < valid; x++) {
            double sum = run->window[RADIUS] * in[x + RADIUS];
            for (int k = 0; k < RADIUS; k++) {
                sum += run->window[k] * (in[x + (size_t)k] + in[x + TAPS - 1 - (size_t)k]);
            }
            to[x] = sum;
        }
    }
}

static double row_ssim(const double *means, size_t valid) {
    const double c1 = 0.01 * 0.01, c2 = 0.03 * 0.03;
    const double *ma = means, *mb = means + valid, *aa = means + 2 * valid, *bb = means + 3 * valid,
                 *ab = means + 4 * valid;
    double sum = 0;
    for (size_t x = 0; x < valid; x++) {
        double pa = ma[x] * ma[x], pb = mb[x] * mb[x], pab = ma[x] * mb[x];
        sum += (2 * pab + c1) * (2 * (ab[x] - pab) + c2) / ((pa + pb + c1) * (aa[x] - pa + bb[x] - pb + c2));
    }
    return sum;
}

static void work(void *arg, size_t begin, size_t end, int worker) {
    const ssim_run *run = arg;
    uint32_t channels = run->a->channels, colors = channels == 4 ? 3 : channels;
    size_t valid = run->valid, row = MEANS * valid;
    size_t positions = run->a->height - TAPS + 1;
    double *ring = run->scratch + (size_t)worker * run->scratch_size;
    double *means = ring + TAPS * row, *line = means + row;
    for (uint32_t c = 0; c < colors; c++) {
        for (size_t y = begin; y < begin + TAPS - 1; y++) {
            filter_row(run, (uint32_t)y, c, ring + y % TAPS * row, line);
        }
        for (size_t y = begin; y < end && !core_cancelled(run->job); y++) {
            size_t last = y + TAPS - 1;
            filter_row(run, (uint32_t)last, c, ring + last % TAPS * row, line);
            memset(means, 0, row * sizeof *means);
            for (size_t k = 0; k < TAPS; k++) {
                const double *in = ring + (y + k) % TAPS * row;
                double w = run->window[k];
                for (size_t i = 0; i < row; i++) {
                    means[i] += w * in[i];
                }
            }
            run->rows[c * positions + y] = row_ssim(means, valid);
        }
    }
}

brace_status metrics_ssim(double *out, const brace_image *a, const brace_image *b, const brace_job *job,
                          brace_error *error) {
    brace_status status = metrics_check(a, b, TAPS, error);
    if (status != BRACE_OK) {
        return status;
    }
    core_pool *pool = NULL;
    status = core_pool_create(&pool, job, error);
    if (status != BRACE_OK) {
        return status;
    }
    ssim_run run = {.a = a, .b = b, .job = job, .valid = a->width - TAPS + 1};
    double total = 0;
    for (int k = 0; k < TAPS; k++) {
        run.window[k] = exp(-(k - RADIUS) * (k - RADIUS) / (2 * 1.5 * 1.5));
        total += run.window[k];
    }
    for (int k = 0; k < TAPS; k++) {
        run.window[k] /= total;
    }
    size_t colors = a->channels == 1 ? 1 : 3, positions = a->height - TAPS + 1;
    run.scratch_size = (TAPS + 1) * MEANS * run.valid + MEANS * (size_t)a->width;
    run.scratch = core_alloc((size_t)core_pool_threads(pool), run.scratch_size * sizeof *run.scratch);
    run.rows = core_calloc(colors * positions, sizeof *run.rows);
    if (run.scratch == NULL || run.rows == NULL) {
        status = core_fail_memory(error, run.scratch_size * sizeof *run.scratch, "comparing pictures");
    } else {
        core_parallel(pool, positions, GRAIN, work, &run);
        status = core_check_cancel(job, error);
    }
    if (status == BRACE_OK) {
        double sum = 0;
        for (size_t i = 0; i < colors * positions; i++) {
            sum += run.rows[i];
        }
        double mean = sum / ((double)run.valid * (double)positions * (double)colors);
        if (isfinite(mean)) {
            *out = mean;
        } else {
            status = core_fail(error, BRACE_ERROR_ARGUMENT, "a picture to be compared holds infinite values or NaN");
        }
    }
    core_free(run.rows);
    core_free(run.scratch);
    core_pool_destroy(pool);
    return status;
}
