/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sensor.c: light to raw numbers: the mosaic picks one colour a pixel, photons
 * and electronics add noise of variance S x + O (DNG NoiseProfile), the well
 * clips at 1, and the converter rounds between black and white.
 *
 * Rows are done in pieces, each step one loop over a piece without branches or
 * calls, which compilers turn into vector instructions. Only operations that
 * IEEE 754 defines exactly: the same bytes on every machine.
 */
#include <math.h>
#include <string.h>

#include "sim/rows.h"

void sim_expose(brace_frame *out, const sim_light *light, const sim_scene *scene, int frame, core_pool *pool) {
    sim_sensor_job job = {out, light, scene, frame, {(uint32_t)scene->seed, (uint32_t)(scene->seed >> 32)}};
    core_parallel(pool, out->height, 16, sim_rows_for(core_cpu_features())->expose_rows, &job);
}
