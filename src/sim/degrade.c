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
    float *scratch, *lines; /* a line for each worker */
    const float *kernel;
    int reach;
    float share, vignetting;
    float *means;      /* where one of them goes */
    const float *wide; /* the glare's three small planes */
    size_t columns, rows;
    int plane;
} degrade_job;

/* Both passes add the two neighbours at equal distance, weighted once. */
static void blur_rows(void *arg, size_t begin, size_t end, int worker) {
    const degrade_job *job = arg;
    const size_t width = job->light->width, reach = (size_t)job->reach;
    const float *kernel = job->kernel + reach;
    float *wide = job->lines + (size_t)worker * (width + 2 * REACH), *row = wide + reach;
    for (size_t y = begin; y < end; y++) {
        const float *in = job->light->plane[job->plane] + y * width;
        float *restrict out = job->scratch + y * width;
        memcpy(row, in, width * sizeof *row);
        for (size_t k = 0; k < reach; k++)
            wide[k] = in[0], row[width + k] = in[width - 1];
        for (size_t x = 0; x < width; x++)
            out[x] = kernel[0] * row[x];
        for (size_t k = 1; k <= reach; k++) {
            const float *restrict before = row - k, *restrict after = row + k;
            const float w = kernel[k];
            for (size_t x = 0; x < width; x++)
                out[x] += w * (before[x] + after[x]);
        }
    }
}

static void blur_columns(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const degrade_job *job = arg;
    const size_t width = job->light->width, height = job->light->height, reach = (size_t)job->reach;
    const float *kernel = job->kernel + reach;
    for (size_t y = begin; y < end; y++) {
        float *restrict out = job->light->plane[job->plane] + y * width;
        const float *restrict middle = job->scratch + y * width;
        for (size_t x = 0; x < width; x++)
            out[x] = kernel[0] * middle[x];
        for (size_t k = 1; k <= reach; k++) {
            const float *restrict above = job->scratch + (y > k ? y - k : 0) * width;
            const float *restrict below = job->scratch + (y + k < height ? y + k : height - 1) * width;
            const float w = kernel[k];
            for (size_t x = 0; x < width; x++)
                out[x] += w * (above[x] + below[x]);
        }
    }
}

/* The small planes' values along row y of plane c, linear between the centres of blocks and level beyond
 * the outermost. */
static void glare_line(float *restrict line, const degrade_job *job, size_t c, size_t y) {
    const size_t width = job->light->width, columns = job->columns;
    const float at = fminf(fmaxf(((float)y + 0.5f) / BLOCK - 0.5f, 0), (float)(job->rows - 1));
    const size_t j = (size_t)at, j1 = j + 1 < job->rows ? j + 1 : j;
    const float down = at - (float)j;
    const float *a = job->wide + (c * job->rows + j) * columns, *b = job->wide + (c * job->rows + j1) * columns;
    float left = a[0] + down * (b[0] - a[0]);
    size_t x = 0;
    for (; x < BLOCK / 2 && x < width; x++)
        line[x] = left;
    for (size_t i = 1; i < columns; i++) {
        const float right = a[i] + down * (b[i] - a[i]), slope = (right - left) / BLOCK;
        const size_t n = width - x < BLOCK ? width - x : BLOCK;
        for (size_t k = 0; k < n; k++)
            line[x + k] = left + slope * ((float)(int32_t)k + 0.5f);
        x += n;
        left = right;
    }
    for (; x < width; x++)
        line[x] = left;
}

static void finish_rows(void *arg, size_t begin, size_t end, int worker) {
    const degrade_job *job = arg;
    const size_t width = job->light->width, height = job->light->height;
    float *line = job->lines + (size_t)worker * (width + 2 * REACH);
    const float share = job->share, fall = 0.5f * job->vignetting, step = 2 / (float)width;
    for (size_t y = begin; y < end; y++) {
        const float v = 2 * ((float)y + 0.5f) / (float)height - 1, most = 1 - fall * v * v;
        for (size_t c = 0; c < 3; c++) {
            float *restrict p = job->light->plane[c] + y * width;
            if (share > 0) {
                glare_line(line, job, c, y);
                for (size_t x = 0; x < width; x++)
                    p[x] += share * (line[x] - p[x]);
            }
            for (size_t x = 0; x < width; x++) {
                const float u = ((float)(int32_t)x + 0.5f) * step - 1;
                p[x] *= most - fall * u * u;
            }
        }
    }
}

/* Means over blocks of one plane. */
static void average_blocks(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const degrade_job *job = arg;
    const size_t width = job->light->width, height = job->light->height;
    for (size_t j = begin; j < end; j++) {
        float *out = job->means + j * job->columns;
        const size_t last = (j + 1) * BLOCK < height ? (j + 1) * BLOCK : height;
        memset(out, 0, job->columns * sizeof *out);
        for (size_t y = j * BLOCK; y < last; y++) {
            const float *in = job->light->plane[job->plane] + y * width;
            for (size_t i = 0; i < job->columns; i++) {
                const size_t n = width - i * BLOCK < BLOCK ? width - i * BLOCK : BLOCK;
                float part[4] = {0}; /* four sums side by side */
                size_t x = 0;
                for (; x + 4 <= n; x += 4)
                    for (size_t k = 0; k < 4; k++)
                        part[k] += in[i * BLOCK + x + k];
                for (; x < n; x++)
                    part[0] += in[i * BLOCK + x];
                out[i] += (part[0] + part[1] + part[2] + part[3]) / (float)(n * (last - j * BLOCK));
            }
        }
    }
}

/* Spread by three box filters, close to a Gaussian. */
static void spread_wide(float *out, float *scratch, size_t columns, size_t rows) {
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
    float *lines = core_alloc((size_t)core_pool_threads(pool) * (width + 2 * REACH), sizeof(float));
    brace_status status = BRACE_OK;
    if (!scratch || !wide || !lines) {
        status = core_fail_memory(error, width * height * sizeof(float), "the lens");
        goto done;
    }
    float kernel[2 * REACH + 1];
    degrade_job job = {.light = light,
                       .scratch = scratch,
                       .lines = lines,
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
        for (job.plane = 0; job.plane < 3 && scene->glare > 0; job.plane++) {
            job.means = wide + (size_t)job.plane * columns * rows;
            core_parallel(pool, rows, 2, average_blocks, &job);
        }
        for (size_t c = 0; c < 3 && scene->glare > 0; c++)
            spread_wide(wide + c * columns * rows, wide + 3 * columns * rows, columns, rows);
        core_parallel(pool, height, 16, finish_rows, &job);
    }
done:
    core_free(scratch), core_free(wide), core_free(lines);
    return status;
}
