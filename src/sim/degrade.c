/* SPDX-License-Identifier: Apache-2.0 */
/*
 * degrade.c: what the lens does to light before it meets the sensor: blur
 * (Gaussian, of the point spread and of defocus together), glare (a share of the
 * light spread over a fifth of the picture) and vignetting.
 */
#include <math.h>
#include <string.h>

#include "sim/simulate.h"

enum { BLOCK = 16, REACH = 64 };

typedef struct degrade_job {
    sim_light *light;
    float *scratch;
    const float *kernel;
    int reach;
    float share, vignetting;
    const float *wide; /* the glare's three small planes */
    size_t columns, rows;
    int plane;
} degrade_job;

static void blur_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const degrade_job *job = arg;
    const ptrdiff_t width = job->light->width;
    for (size_t y = begin; y < end; y++) {
        const float *in = job->light->plane[job->plane] + y * (size_t)width;
        float *out = job->scratch + y * (size_t)width;
        for (ptrdiff_t x = 0; x < width; x++) {
            float sum = 0;
            for (int k = -job->reach; k <= job->reach; k++) {
                ptrdiff_t i = x + k;
                sum += job->kernel[k + job->reach] * in[i < 0 ? 0 : i >= width ? width - 1 : i];
            }
            out[x] = sum;
        }
    }
}

static void blur_columns(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const degrade_job *job = arg;
    const size_t width = job->light->width;
    const ptrdiff_t height = job->light->height;
    for (size_t y = begin; y < end; y++) {
        float *out = job->light->plane[job->plane] + y * width;
        memset(out, 0, width * sizeof *out);
        for (int k = -job->reach; k <= job->reach; k++) {
            ptrdiff_t i = (ptrdiff_t)y + k;
            const float *in = job->scratch + (size_t)(i < 0 ? 0 : i >= height ? height - 1 : i) * width;
            const float w = job->kernel[k + job->reach];
            for (size_t x = 0; x < width; x++)
                out[x] += w * in[x];
        }
    }
}

static void finish_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const degrade_job *job = arg;
    const size_t width = job->light->width, height = job->light->height;
    for (size_t y = begin; y < end; y++) {
        float v = 2 * ((float)y + 0.5f) / (float)height - 1, gy = ((float)y + 0.5f) / BLOCK - 0.5f;
        gy = fminf(fmaxf(gy, 0), (float)(job->rows - 1));
        size_t j = (size_t)gy, j1 = j + 1 < job->rows ? j + 1 : j;
        for (size_t x = 0; x < width; x++) {
            float u = 2 * ((float)x + 0.5f) / (float)width - 1, gx = ((float)x + 0.5f) / BLOCK - 0.5f;
            gx = fminf(fmaxf(gx, 0), (float)(job->columns - 1));
            size_t i = (size_t)gx, i1 = i + 1 < job->columns ? i + 1 : i;
            float fx = gx - (float)i, fy = gy - (float)j, fall = 1 - job->vignetting * 0.5f * (u * u + v * v);
            for (int c = 0; c < 3; c++) {
                const float *w = job->wide + (size_t)c * job->columns * job->rows;
                float glare = (1 - fy) * ((1 - fx) * w[j * job->columns + i] + fx * w[j * job->columns + i1]) +
                              fy * ((1 - fx) * w[j1 * job->columns + i] + fx * w[j1 * job->columns + i1]);
                float *p = &job->light->plane[c][y * width + x];
                *p = fall * ((1 - job->share) * *p + job->share * glare);
            }
        }
    }
}

/* One plane averaged over blocks, then spread by three box filters, close to a Gaussian. */
static void spread_wide(float *out, float *scratch, const float *plane, size_t width, size_t height, size_t columns,
                        size_t rows) {
    for (size_t j = 0; j < rows; j++)
        for (size_t i = 0; i < columns; i++) {
            double sum = 0, n = 0;
            for (size_t y = j * BLOCK; y < (j + 1) * BLOCK && y < height; y++)
                for (size_t x = i * BLOCK; x < (i + 1) * BLOCK && x < width; x++)
                    sum += plane[y * width + x], n++;
            out[j * columns + i] = (float)(sum / n);
        }
    const ptrdiff_t reach = (ptrdiff_t)(columns > rows ? columns : rows) / 10 + 1;
    for (int pass = 0; pass < 6; pass++) {
        bool across = pass % 2 == 0;
        for (size_t j = 0; j < rows; j++)
            for (size_t i = 0; i < columns; i++) {
                float sum = 0;
                for (ptrdiff_t k = -reach; k <= reach; k++) {
                    ptrdiff_t n = (ptrdiff_t)(across ? columns : rows), at = (ptrdiff_t)(across ? i : j) + k;
                    at = at < 0 ? 0 : at >= n ? n - 1 : at;
                    sum += out[across ? j * columns + (size_t)at : (size_t)at * columns + i];
                }
                scratch[j * columns + i] = sum / (float)(2 * reach + 1);
            }
        memcpy(out, scratch, columns * rows * sizeof *out);
    }
}

brace_status sim_degrade(sim_light *light, const sim_scene *scene, core_pool *pool, brace_error *error) {
    const size_t width = light->width, height = light->height;
    const size_t columns = (width + BLOCK - 1) / BLOCK, rows = (height + BLOCK - 1) / BLOCK;
    float *scratch = core_alloc(width * height, sizeof(float)), *wide = core_calloc(4 * columns * rows, sizeof(float));
    brace_status status = BRACE_OK;
    if (!scratch || !wide) {
        status = core_fail_memory(error, width * height * sizeof(float), "the lens");
        goto done;
    }
    float kernel[2 * REACH + 1];
    degrade_job job = {.light = light,
                       .scratch = scratch,
                       .kernel = kernel,
                       .share = (float)scene->glare,
                       .vignetting = (float)scene->vignetting,
                       .wide = wide,
                       .columns = columns,
                       .rows = rows};
    /* A disc of radius r has the deviation r/2. */
    double deviation = hypot(scene->psf, scene->defocus / 2);
    if (deviation > 0.1) {
        job.reach = (int)fmin(ceil(3 * deviation), REACH);
        double sum = 0;
        for (int k = -job.reach; k <= job.reach; k++)
            sum += exp(-0.5 * k * k / (deviation * deviation));
        for (int k = -job.reach; k <= job.reach; k++)
            kernel[k + job.reach] = (float)(exp(-0.5 * k * k / (deviation * deviation)) / sum);
        for (job.plane = 0; job.plane < 3; job.plane++) {
            core_parallel(pool, height, 16, blur_rows, &job);
            core_parallel(pool, height, 16, blur_columns, &job);
        }
    }
    if (scene->glare > 0 || scene->vignetting > 0) {
        for (size_t c = 0; c < 3 && scene->glare > 0; c++)
            spread_wide(wide + c * columns * rows, wide + 3 * columns * rows, light->plane[c], width, height, columns,
                        rows);
        core_parallel(pool, height, 16, finish_rows, &job);
    }
done:
    core_free(scratch), core_free(wide);
    return status;
}
