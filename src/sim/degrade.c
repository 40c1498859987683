/* SPDX-License-Identifier: Apache-2.0 */
/*
 * degrade.c: what the lens does to light before it meets the sensor: blur
 * (Gaussian, of the point spread and of defocus together), glare (a share of the
 * light spread over a fifth of the picture) and vignetting.
 */
#include <math.h>
#include <string.h>

#include "sim/rows.h"

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
    const sim_rows *loops = sim_rows_for(core_cpu_features());
    brace_status status = BRACE_OK;
    if (!scratch || !wide || !lines) {
        status = core_fail_memory(error, width * height * sizeof(float), "the lens");
        goto done;
    }
    float kernel[2 * REACH + 1];
    sim_lens_job job = {.light = light,
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
            core_parallel(pool, height, 16, loops->blur_rows, &job);
            core_parallel(pool, height, 16, loops->blur_columns, &job);
        }
    }
    if (scene->glare > 0 || scene->vignetting > 0) {
        for (job.plane = 0; job.plane < 3 && scene->glare > 0; job.plane++) {
            job.means = wide + (size_t)job.plane * columns * rows;
            core_parallel(pool, rows, 2, loops->average_blocks, &job);
        }
        for (size_t c = 0; c < 3 && scene->glare > 0; c++)
            spread_wide(wide + c * columns * rows, wide + 3 * columns * rows, columns, rows);
        core_parallel(pool, height, 16, loops->finish_rows, &job);
    }
done:
    core_free(scratch), core_free(wide), core_free(lines);
    return status;
}
