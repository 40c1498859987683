/* SPDX-License-Identifier: Apache-2.0 */
/*
 * spectrum.c: the 2-D spectrum of a windowed plane: all rows, then all columns.
 *
 * Two real rows go through one complex transform (a + ib, separated afterwards by
 * symmetry), which holds for odd widths as well; columns are gathered a few at
 * a time so that memory is read in whole cache lines.
 */
#include <math.h>

#include "banding/banding.h"

enum { COLUMNS = 16 };

typedef struct spectrum_job {
    banding_spectrum *out;
    const float *plane;
    const float *window_x, *window_y;
    double *row; /* sums, then largest deviations, of the rows */
    float mean;
    const banding_fft *fft;
    banding_complex *work; /* `per_worker` for each worker */
    size_t per_worker;
} spectrum_job;

static void sum_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const spectrum_job *job = arg;
    const size_t width = job->out->width;
    for (size_t y = begin; y < end; y++) {
        double sum = 0;
        for (size_t x = 0; x < width; x++)
            sum += job->plane[y * width + x];
        job->row[y] = sum;
    }
}

static void deviation_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const spectrum_job *job = arg;
    const size_t width = job->out->width;
    for (size_t y = begin; y < end; y++) {
        float most = 0;
        for (size_t x = 0; x < width; x++)
            most = fmaxf(most, fabsf(job->plane[y * width + x] - job->mean));
        job->row[y] = most;
    }
}

/* `begin` and `end` count pairs of rows. */
static void transform_rows(void *arg, size_t begin, size_t end, int worker) {
    const spectrum_job *job = arg;
    const banding_spectrum *s = job->out;
    const size_t width = s->width, half = s->half;
    banding_complex *in = job->work + (size_t)worker * job->per_worker, *out = in + width, *scratch = out + width;
    for (size_t pair = begin; pair < end; pair++) {
        const size_t y = 2 * pair;
        const bool two = y + 1 < s->height;
        const float *a = job->plane + y * width, *b = two ? a + width : a;
        const float wa = job->window_y[y], wb = two ? job->window_y[y + 1] : 0;
        for (size_t x = 0; x < width; x++)
            in[x] = (banding_complex){(a[x] - job->mean) * wa * job->window_x[x],
                                      (b[x] - job->mean) * wb * job->window_x[x]};
        banding_fft_run(job->fft, in, out, scratch);
        banding_complex *to = s->at + y * half;
        for (size_t k = 0; k < half; k++) {
            banding_complex p = out[k], q = out[k ? width - k : 0];
            to[k] = (banding_complex){0.5f * (p.re + q.re), 0.5f * (p.im - q.im)};
            if (two)
                to[half + k] = (banding_complex){0.5f * (p.im + q.im), 0.5f * (q.re - p.re)};
        }
    }
}

/* `begin` and `end` count groups of COLUMNS columns. */
static void transform_columns(void *arg, size_t begin, size_t end, int worker) {
    const spectrum_job *job = arg;
    const banding_spectrum *s = job->out;
    const size_t height = s->height, half = s->half;
    banding_complex *in = job->work + (size_t)worker * job->per_worker, *out = in + COLUMNS * height;
    banding_complex *scratch = out + height;
    for (size_t group = begin; group < end; group++) {
        const size_t first = group * COLUMNS, count = half - first < COLUMNS ? half - first : COLUMNS;
        for (size_t y = 0; y < height; y++)
            for (size_t i = 0; i < count; i++)
                in[i * height + y] = s->at[y * half + first + i];
        for (size_t i = 0; i < count; i++) {
            banding_fft_run(job->fft, in + i * height, out, scratch);
            for (size_t y = 0; y < height; y++)
                in[i * height + y] = out[y];
        }
        for (size_t y = 0; y < height; y++)
            for (size_t i = 0; i < count; i++)
                s->at[y * half + first + i] = in[i * height + y];
    }
}

/* 0.5 - 0.5 cos(2 pi i/(n-1)), as numpy.hanning. */
static void hann(float *window, size_t n, double *sum, double *squares) {
    *sum = *squares = 0;
    for (size_t i = 0; i < n; i++) {
        double w = n > 1 ? 0.5 - 0.5 * cos(2 * M_PI * (double)i / (double)(n - 1)) : 1;
        window[i] = (float)w;
        *sum += w, *squares += w * w;
    }
}

static brace_status run_pass(spectrum_job *job, size_t length, bool columns, core_pool *pool, brace_error *error) {
    banding_fft *fft = NULL;
    brace_status status = banding_fft_create(&fft, length, error);
    if (status != BRACE_OK)
        return status;
    job->per_worker = (columns ? COLUMNS + 1 : 2) * length + banding_fft_scratch(fft);
    job->work = core_alloc((size_t)core_pool_threads(pool) * job->per_worker, sizeof *job->work);
    job->fft = fft;
    if (!job->work)
        status = core_fail_memory(error, job->per_worker * sizeof *job->work, "a spectrum");
    else if (columns)
        core_parallel(pool, (job->out->half + COLUMNS - 1) / COLUMNS, 1, transform_columns, job);
    else
        core_parallel(pool, (job->out->height + 1) / 2, 8, transform_rows, job);
    core_free(job->work);
    banding_fft_destroy(fft);
    return status;
}

brace_status banding_spectrum_create(banding_spectrum *out, const float *plane, uint32_t width, uint32_t height,
                                     core_pool *pool, const brace_job *job, brace_error *error) {
    const size_t pixels = (size_t)width * height, half = width / 2 + 1;
    *out = (banding_spectrum){.width = width, .height = height, .half = half};
    out->at = core_alloc(half * height, sizeof *out->at);
    float *windows = core_alloc((size_t)width + height, sizeof *windows);
    double *row = core_alloc(height, sizeof *row);
    brace_status status = BRACE_OK;
    if (!out->at || !windows || !row) {
        status = core_fail_memory(error, half * height * sizeof *out->at, "a spectrum");
    } else {
        double sx, sy, sx2, sy2;
        hann(windows, width, &sx, &sx2), hann(windows + width, height, &sy, &sy2);
        out->window = sx * sy, out->window2 = sx2 * sy2;
        spectrum_job task = {.out = out, .plane = plane, .window_x = windows, .window_y = windows + width, .row = row};
        core_parallel(pool, height, 64, sum_rows, &task);
        double sum = 0, most = 0;
        for (size_t y = 0; y < height; y++)
            sum += row[y];
        out->mean = sum / (double)pixels;
        task.mean = (float)out->mean;
        core_parallel(pool, height, 64, deviation_rows, &task);
        for (size_t y = 0; y < height; y++)
            most = fmax(most, row[y]);
        out->flat = most <= 1e-6 * fabs(out->mean) || most == 0;
        status = run_pass(&task, width, false, pool, error);
        if (status == BRACE_OK)
            status = core_check_cancel(job, error);
        if (status == BRACE_OK)
            status = run_pass(&task, height, true, pool, error);
    }
    core_free(windows), core_free(row);
    if (status != BRACE_OK)
        banding_spectrum_free(out);
    return status;
}

void banding_spectrum_free(banding_spectrum *spectrum) {
    core_free(spectrum->at);
    spectrum->at = NULL;
}

brace_status banding_ring(double *r_min, double *r_max, uint32_t width, uint32_t height, double wanted_min,
                          double wanted_max, brace_error *error) {
    const double shorter = width < height ? width : height;
    const double low = wanted_min > 0 ? wanted_min : 3;
    const double high = wanted_max > 0 ? wanted_max : fmax(floor(shorter / 4), low);
    if (!(wanted_min >= 0 && wanted_max >= 0 && wanted_min <= 1e6 && wanted_max <= 1e6 && low <= high))
        return core_fail(error, BRACE_ERROR_ARGUMENT, "a ring from %g to %g bins makes no sense", low, high);
    *r_min = low, *r_max = high;
    return BRACE_OK;
}
