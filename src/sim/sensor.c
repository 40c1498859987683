/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sensor.c: light to raw numbers: the mosaic picks one colour a pixel, photons
 * and electronics add noise of variance S x + O (DNG NoiseProfile), the well
 * clips at 1, and the converter rounds between black and white. Every pixel has
 * its own gain, the same in all frames of a capture.
 *
 * Rows are done in pieces, each step one loop over a piece without branches or
 * calls, which compilers turn into vector instructions. Only operations that
 * IEEE 754 defines exactly: the same bytes on every machine.
 */
#include <math.h>
#include <string.h>

#include "sim/rows.h"

brace_status sim_expose(brace_frame *out, const sim_light *light, const sim_scene *scene, int frame, core_pool *pool,
                        brace_error *error) {
    const sim_rows *loops = sim_rows_for(core_cpu_features());
    sim_sensor_job job = {.out = out,
                          .light = light,
                          .scene = scene,
                          .frame = frame,
                          .key = {(uint32_t)scene->seed, (uint32_t)(scene->seed >> 32)}};
    float *gains = NULL;
    if (scene->sensor_nonuniformity > 0) {
        /* Amplifiers of columns and rows deviate less than pixels do, but what they do is seen as lines. */
        const size_t columns = out->width, lines = out->height;
        if (!(gains = core_alloc(columns + lines, sizeof *gains)))
            return core_fail_memory(error, (columns + lines) * sizeof *gains, "a sensor");
        loops->normals(gains, columns, job.key, 0, scene->sample, LINE_GAINS);
        loops->normals(gains + columns, lines, job.key, 1, scene->sample, LINE_GAINS);
        for (size_t i = 0; i < columns + lines; i++)
            gains[i] *= 0.2f;
        job.columns = gains, job.lines = gains + columns;
    }
    core_parallel(pool, out->height, 16, loops->expose_rows, &job);
    core_free(gains);
    return BRACE_OK;
}
