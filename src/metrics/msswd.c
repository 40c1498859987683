/* SPDX-License-Identifier: Apache-2.0 */
/*
 * msswd.c: how far apart the colours of two pictures lie, wherever they are in
 * them (He et al., "Multiscale Sliced Wasserstein Distances as Perceptual Color
 * Difference Measures", ECCV 2024). At five scales, all 11x11 patches in CIELAB
 * are projected onto 128 random directions; the distance is the mean over them
 * of the difference of the sorted projections.
 *
 * A few projections at a time: memory is two numbers a pixel for each of them,
 * however many there are.
 */
#include <math.h>
#include <string.h>

#include "image/color.h"
#include "image/image.h"
#include "metrics/kernels.h"
#include "metrics/metrics.h"
#include "metrics/swd.h"

enum { PAD = METRICS_PATCH / 2, SCALES = 5, PROJECTIONS = 128, SCALES_MOST = 12, PROJECTIONS_MOST = 4096 };
#define WORK ((size_t)256 << 20) /* bytes of projections at a time, unless four need more */

typedef struct swd_run {
    const brace_job *job;
    core_pool *pool;
    const metrics_kernels *kernels;
    brace_image *picture[2]; /* of this scale, sRGB-encoded */
    brace_image *smaller[2]; /* the next */
    float *lab[2];           /* three planes with a border */
    size_t stride, plane;    /* floats of their rows and planes */
    size_t columns, rows, count;
    float *weights;    /* [group of four][tap][4] */
    float *projected;  /* [projection][picture][count] */
    float *scratch;    /* [workers][count] */
    size_t workers;    /* that compare at a time */
    size_t groups;     /* of four projections at a time */
    size_t first;      /* projection of these */
    double *distances; /* of all projections */
    int bad;           /* a pixel is no number */
} swd_run;

/* Mirrored at the first and the last: -1 is 1, n is n-2; repeated for pictures smaller than the border. */
static size_t mirrored(ptrdiff_t i, size_t n) {
    if (n == 1) {
        return 0;
    }
    const ptrdiff_t period = 2 * ((ptrdiff_t)n - 1);
    i = (i % period + period) % period;
    return (size_t)(i < (ptrdiff_t)n ? i : period - i);
}

/* ---- colour ---- */

/* f of CIE 1976 L*a*b*. */
static inline float lab_f(float t) {
    const float delta = 6.0f / 29;
    return t > delta * delta * delta ? cbrtf(t) : t / (3 * delta * delta) + 4.0f / 29;
}

/* Linear sRGB to XYZ over the white point D65; each row sums to 1. */
static void lab_of(float out[3], const float rgb[3]) {
    static const float m[3][3] = {
        {(float)(10135552 / 23359437.0), (float)(8788810 / 23359437.0), (float)(4435075 / 23359437.0)},
        {(float)(2613072 / 12288897.0), (float)(8788810 / 12288897.0), (float)(887015 / 12288897.0)},
        {(float)(1425312 / 80288307.0), (float)(8788810 / 80288307.0), (float)(70074185 / 80288307.0)}};
    float r = image_srgb_decode(rgb[0]), g = image_srgb_decode(rgb[1]), b = image_srgb_decode(rgb[2]), f[3];
    for (int i = 0; i < 3; i++) {
        f[i] = lab_f(m[i][0] * r + m[i][1] * g + m[i][2] * b);
    }
    out[0] = 116 * f[1] - 16;
    out[1] = 500 * (f[0] - f[1]);
    out[2] = 200 * (f[1] - f[2]);
}

/* Rows of both pictures, and their border left and right. */
static void lab_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    swd_run *run = arg;
    for (size_t i = begin; i < end; i++) {
        const brace_image *in = run->picture[i % 2];
        const float *p = (const float *)(const void *)image_row(in, (uint32_t)(i / 2));
        float *row = run->lab[i % 2] + (i / 2 + PAD) * run->stride;
        for (size_t x = 0; x < run->columns; x++, p += 3) {
            float lab[3];
            lab_of(lab, p);
            if (!isfinite(lab[0] + lab[1] + lab[2])) {
                __atomic_store_n(&run->bad, 1, __ATOMIC_RELAXED);
                return;
            }
            for (size_t c = 0; c < 3; c++) {
                row[c * run->plane + PAD + x] = lab[c];
            }
        }
        for (size_t c = 0; c < 3; c++) {
            float *line = row + c * run->plane + PAD;
            for (ptrdiff_t x = 1; x <= PAD; x++) {
                line[-x] = line[mirrored(-x, run->columns)];
                const ptrdiff_t right = (ptrdiff_t)run->columns - 1 + x;
                line[right] = line[mirrored(right, run->columns)];
            }
        }
    }
}

static void lab_border(const swd_run *run) {
    for (size_t i = 0; i < 6; i++) {
        float *plane = run->lab[i / 3] + i % 3 * run->plane + PAD * run->stride;
        for (ptrdiff_t y = 1; y <= PAD; y++) {
            const ptrdiff_t below = (ptrdiff_t)run->rows - 1 + y, stride = (ptrdiff_t)run->stride;
            memcpy(plane - y * stride, plane + mirrored(-y, run->rows) * run->stride, run->stride * sizeof *plane);
            memcpy(plane + below * stride, plane + mirrored(below, run->rows) * run->stride,
                   run->stride * sizeof *plane);
        }
    }
}

/* ---- the pyramid ---- */

/* Every second pixel of the picture filtered with [1 4 6 4 1]/16 in both directions, on encoded values. */
static void shrink_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    static const float tap[5] = {1.0f / 16, 4.0f / 16, 6.0f / 16, 4.0f / 16, 1.0f / 16};
    const swd_run *run = arg;
    for (size_t i = begin; i < end; i++) {
        const brace_image *in = run->picture[i % 2], *out = run->smaller[i % 2];
        const float *row[5];
        for (ptrdiff_t k = 0; k < 5; k++) {
            row[k] = (const float *)(const void *)image_row(
                in, (uint32_t)mirrored(2 * (ptrdiff_t)(i / 2) + k - 2, in->height));
        }
        float *to = (float *)(void *)image_row(out, (uint32_t)(i / 2));
        for (size_t x = 0; x < out->width; x++, to += 3) {
            size_t at[5];
            for (ptrdiff_t k = 0; k < 5; k++) {
                at[k] = 3 * mirrored(2 * (ptrdiff_t)x + k - 2, in->width);
            }
            for (size_t c = 0; c < 3; c++) {
                float sum = 0;
                for (int y = 0; y < 5; y++) {
                    const float *p = row[y] + c;
                    sum +=
                        tap[y] * (tap[0] * (p[at[0]] + p[at[4]]) + tap[1] * (p[at[1]] + p[at[3]]) + tap[2] * p[at[2]]);
                }
                to[c] = sum;
            }
        }
    }
}

/* ---- projections ---- */

void metrics_swd_projection(float out[METRICS_SWD_TAPS], uint64_t seed, uint32_t scale, uint32_t index) {
    core_random random = core_random_create(seed, scale, index, 0);
    double value[METRICS_SWD_TAPS], length = 0;
    for (int i = 0; i < METRICS_SWD_TAPS; i++) {
        value[i] = core_random_normal(&random);
        length += value[i] * value[i];
    }
    for (int i = 0; i < METRICS_SWD_TAPS; i++) {
        out[i] = (float)(value[i] / sqrt(length));
    }
}

/* A piece is a row of one picture and all groups of this turn, while the row is in the cache. */
static void project_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const swd_run *run = arg;
    for (size_t i = begin; i < end && !core_cancelled(run->job); i++) {
        const size_t y = i / 2;
        for (size_t g = 0; g < run->groups; g++) {
            float *out[METRICS_TOGETHER];
            for (size_t p = 0; p < METRICS_TOGETHER; p++) {
                out[p] = run->projected + (2 * (METRICS_TOGETHER * g + p) + i % 2) * run->count + y * run->columns;
            }
            run->kernels->project(out, run->columns, run->lab[i % 2] + y * run->stride, run->stride, run->plane,
                                  run->weights + g * METRICS_SWD_TAPS * METRICS_TOGETHER);
        }
    }
}

static void compare(void *arg, size_t begin, size_t end, int worker) {
    const swd_run *run = arg;
    for (size_t p = begin; p < end && !core_cancelled(run->job); p++) {
        /* With more workers than projections, each of these has its own scratch. */
        const size_t own = run->workers < (size_t)core_pool_threads(run->pool) ? p : (size_t)worker;
        float *x = run->projected + 2 * p * run->count;
        run->distances[run->first + p] =
            metrics_wasserstein(x, x + run->count, run->count, run->scratch + own * run->count);
    }
}

static brace_status one_scale(double *out, swd_run *run, const brace_ms_swd_params *params, uint32_t scale,
                              uint64_t *done, uint64_t total, brace_error *error) {
    const size_t projections = (size_t)params->projections;
    run->columns = run->picture[0]->width;
    run->rows = run->picture[0]->height;
    run->count = run->columns * run->rows;
    run->stride = run->columns + 2 * PAD;
    run->plane = run->stride * (run->rows + 2 * PAD);
    const size_t wanted = (projections + METRICS_TOGETHER - 1) / METRICS_TOGETHER;
    size_t groups = WORK / (run->count * sizeof(float) * 3 * METRICS_TOGETHER),
           workers = (size_t)core_pool_threads(run->pool);
    groups = groups < 1 ? 1 : groups < wanted ? groups : wanted;
    run->workers = workers < groups * METRICS_TOGETHER ? workers : groups * METRICS_TOGETHER;
    run->weights = core_alloc(groups * METRICS_TOGETHER * METRICS_SWD_TAPS, sizeof *run->weights);
    run->projected = core_alloc(groups * METRICS_TOGETHER * 2, run->count * sizeof *run->projected);
    run->scratch = core_alloc(run->workers, run->count * sizeof *run->scratch);
    run->lab[0] = core_calloc(3 * run->plane + METRICS_PROJECT_MOST, sizeof **run->lab);
    run->lab[1] = core_calloc(3 * run->plane + METRICS_PROJECT_MOST, sizeof **run->lab);
    if (run->weights == NULL || run->projected == NULL || run->scratch == NULL || run->lab[0] == NULL ||
        run->lab[1] == NULL) {
        return core_fail_memory(error, groups * METRICS_TOGETHER * 2 * run->count * sizeof(float), "comparing colours");
    }
    core_parallel(run->pool, 2 * run->rows, 16, lab_rows, run);
    if (run->bad) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "a picture to be compared holds infinite values or NaN");
    }
    lab_border(run);
    brace_status status = core_check_cancel(run->job, error);
    for (run->first = 0; status == BRACE_OK && run->first < projections;) {
        size_t n = projections - run->first;
        n = n < groups * METRICS_TOGETHER ? n : groups * METRICS_TOGETHER;
        run->groups = (n + METRICS_TOGETHER - 1) / METRICS_TOGETHER;
        memset(run->weights, 0, run->groups * METRICS_TOGETHER * METRICS_SWD_TAPS * sizeof *run->weights);
        for (size_t p = 0; p < n; p++) {
            float direction[METRICS_SWD_TAPS];
            metrics_swd_projection(direction, params->seed, scale, (uint32_t)(run->first + p));
            float *to =
                run->weights + p / METRICS_TOGETHER * METRICS_TOGETHER * METRICS_SWD_TAPS + p % METRICS_TOGETHER;
            for (size_t i = 0; i < METRICS_SWD_TAPS; i++) {
                to[i * METRICS_TOGETHER] = direction[i];
            }
        }
        core_parallel(run->pool, 2 * run->rows, 4, project_rows, run);
        core_parallel(run->pool, n, 1, compare, run);
        run->first += n;
        *done += (uint64_t)run->count * n;
        status = core_check_cancel(run->job, error);
        core_progress(run->job, "MS-SWD", *done, total);
    }
    double sum = 0;
    for (size_t p = 0; p < projections; p++) {
        sum += run->distances[p];
    }
    *out = sum / (double)projections;
    return status;
}

static void free_scale(swd_run *run) {
    core_free(run->weights);
    core_free(run->projected);
    core_free(run->scratch);
    core_free(run->lab[0]);
    core_free(run->lab[1]);
    run->weights = run->projected = run->scratch = run->lab[0] = run->lab[1] = NULL;
}

/* The pictures of the next scale in place of these. */
static brace_status shrink(swd_run *run, brace_error *error) {
    const uint32_t width = (run->picture[0]->width + 1) / 2, height = (run->picture[0]->height + 1) / 2;
    for (int k = 0; k < 2; k++) {
        brace_status status =
            image_create_raw(&run->smaller[k], width, height, 3, BRACE_SAMPLE_F32, BRACE_TRANSFER_SRGB, error);
        if (status != BRACE_OK) {
            return status;
        }
    }
    core_parallel(run->pool, 2 * (size_t)height, 16, shrink_rows, run);
    for (int k = 0; k < 2; k++) {
        brace_image_destroy(run->picture[k]);
        run->picture[k] = run->smaller[k];
        run->smaller[k] = NULL;
    }
    return BRACE_OK;
}

static brace_status all_scales(double *out, swd_run *run, const brace_ms_swd_params *params, brace_error *error) {
    uint64_t total = 0, done = 0;
    uint64_t w = run->picture[0]->width, h = run->picture[0]->height;
    for (int s = 0; s < params->scales; s++, w = (w + 1) / 2, h = (h + 1) / 2) {
        total += w * h * (uint64_t)params->projections;
    }
    double sum = 0;
    for (int s = 0; s < params->scales; s++) {
        double distance = 0;
        brace_status status = s > 0 ? shrink(run, error) : BRACE_OK;
        if (status == BRACE_OK) {
            status = one_scale(&distance, run, params, (uint32_t)s, &done, total, error);
        }
        free_scale(run);
        if (status != BRACE_OK) {
            return status;
        }
        sum += distance;
    }
    *out = sum / params->scales;
    return BRACE_OK;
}

brace_status brace_ms_swd(double *out, const brace_image *a, const brace_image *b, const brace_ms_swd_params *params,
                          const brace_job *job, brace_error *error) {
    brace_ms_swd_params p = params != NULL ? *params : (brace_ms_swd_params){0};
    p.scales = p.scales == 0 ? SCALES : p.scales;
    p.projections = p.projections == 0 ? PROJECTIONS : p.projections;
    if (p.scales < 1 || p.scales > SCALES_MOST || p.projections < 1 || p.projections > PROJECTIONS_MOST) {
        return core_fail(error, BRACE_ERROR_ARGUMENT,
                         "MS-SWD takes 1 to %d scales and 1 to %d projections, not %d and %d", SCALES_MOST,
                         PROJECTIONS_MOST, p.scales, p.projections);
    }
    swd_run run = {.job = job, .kernels = metrics_kernels_for(core_cpu_features())};
    brace_status status = metrics_take(run.picture, a, b, error);
    if (status == BRACE_OK) {
        status = core_pool_create(&run.pool, job, error);
    }
    if (status == BRACE_OK) {
        run.distances = core_calloc((size_t)p.projections, sizeof *run.distances);
        status = run.distances != NULL ? all_scales(out, &run, &p, error)
                                       : core_fail_memory(error, 8 * (size_t)p.projections, "comparing colours");
    }
    core_free(run.distances);
    core_pool_destroy(run.pool);
    for (int k = 0; k < 2; k++) {
        brace_image_destroy(run.picture[k]);
        brace_image_destroy(run.smaller[k]);
    }
    return status;
}
