/* SPDX-License-Identifier: Apache-2.0 */
/*
 * render.c: the light that every pixel of a frame collects.
 *
 * Row r of a frame that starts at t is exposed over [a, a+T], a = t + r tau.
 * For each of its sub-exposures the hand has another pose; every pixel's ray is
 * followed to the screen, the content there is averaged over the pixel's
 * footprint, and the display's driver integrates its light over that interval.
 * The sum of the three subpixels' light through the camera's matrix is the
 * pixel's signal. A row is computed by one thread; nothing depends on which.
 */
#include <math.h>
#include <string.h>

#include "sim/rows.h"

brace_status sim_light_create(sim_light *out, uint32_t width, uint32_t height, brace_error *error) {
    *out = (sim_light){width, height, {NULL, NULL, NULL}};
    for (int c = 0; c < 3; c++)
        if (!(out->plane[c] = core_alloc((size_t)width * height, sizeof(float)))) {
            sim_light_free(out);
            return core_fail_memory(error, (size_t)width * height * 12, "a rendered frame");
        }
    return BRACE_OK;
}

void sim_light_free(sim_light *light) {
    for (int c = 0; c < 3; c++) {
        core_free(light->plane[c]);
        light->plane[c] = NULL;
    }
}

double sim_room(const sim_render_job *job, double a, double t) {
    double w = job->steady ? 0 : 6.283185307179586 * job->scene->ambient_hz;
    return w > 0 ? 1 + (sin(w * (a + t)) - sin(w * a)) / (w * t) : 1;
}

static void render_rows(void *arg, size_t begin, size_t end, int worker) {
    const sim_render_job *job = arg;
    sim_row *row = &job->rows[worker];
    const sim_scene *s = job->scene;
    const size_t n = job->out->width;
    const int parts = job->parts, grid = s->supersample;
    const double share = 1.0 / (parts * grid * grid), part = job->exposure / parts;
    for (size_t y = begin; y < end; y++) {
        const double begun = job->start + (double)y * job->row_time;
        for (int p = 0; p < parts; p++) {
            double a = begun + p * part, map[9];
            sim_scene_map(map, s, a + 0.5 * part, job->reference_middle);
            const float room = (float)sim_room(job, a, part);
            for (size_t x = 0; x < n; x++)
                row->start[x] = a;
            for (int g = 0; g < grid * grid; g++) {
                /* In x all rays of the row are shifted. */
                const double *ray = job->blur.ray[g], u = ray[0] / (double)n, v = (double)y + 0.5 + ray[1];
                double shifted[9];
                memcpy(shifted, map, sizeof map);
                for (int i = 0; i < 3; i++)
                    shifted[3 * i + 2] += shifted[3 * i] * u;
                job->loops->look(job, row, shifted, (v - 0.5 * job->out->height) / (double)n);
                const float *light[3];
                for (int ch = 0; ch < 3; ch++) {
                    light[ch] = row->level[ch];
                    if (!job->steady) {
                        job->kernel(job->panel, n, row->x, row->y, row->level[ch], ch, row->start, part,
                                    row->light[ch]);
                        light[ch] = row->light[ch];
                    }
                }
                job->loops->collect(job, row, light, room, (float)(job->scale * share), y, p + g == 0);
            }
        }
        if (job->glare.share > 0)
            sim_glare_row(job, row, y, begun);
        if (job->glare.share > 0 || s->vignetting > 0)
            job->loops->finish(job, row, y);
    }
}

/* How many sub-exposures show the motion within this frame: enough for steps of half a pixel, as many
 * as the scene allows at most. The path of five points, sampled ten times for the quickest swing. */
static int parts_needed(const sim_render_job *job) {
    const sim_scene *s = job->scene;
    if (job->steady || s->subexposures <= 1 || !(s->tremor_position > 0 || s->tremor_angle > 0))
        return 1;
    static const double at[5][2] = {{0, 0}, {-0.5, -0.5}, {0.5, -0.5}, {-0.5, 0.5}, {0.5, 0.5}};
    const double tall = (double)s->height / (double)s->width;
    double longest = 0, path[5] = {0}, last[5][2] = {{0}};
    const int steps = (int)fmin(4 + 110 * job->exposure, 1000);
    for (int i = 0; i <= steps; i++) {
        double map[9];
        sim_scene_map(map, s, job->start + job->exposure * i / steps, job->reference_middle);
        for (int k = 0; k < 5; k++) {
            const double x = at[k][0], y = at[k][1] * tall, d = 1 / (map[6] * x + map[7] * y + map[8]);
            const double u = (map[0] * x + map[1] * y + map[2]) * d, v = (map[3] * x + map[4] * y + map[5]) * d;
            /* A pixel covers about 1/(width d) of the screen there. */
            path[k] += i > 0 ? hypot(u - last[k][0], v - last[k][1]) * fabs(d) * s->width : 0;
            last[k][0] = u, last[k][1] = v;
            longest = fmax(longest, path[k]);
        }
    }
    const double parts = ceil(longest / 0.5);
    return parts >= s->subexposures ? s->subexposures : parts > 1 ? (int)parts : 1;
}

static brace_status row_create(sim_row *row, size_t n, brace_error *error) {
    n = n > 64 ? n : 64; /* glare looks at the picture in 64 columns */
    char *m = row->memory = core_alloc(n, sizeof(double) + 21 * sizeof(float));
    if (!m)
        return core_fail_memory(error, n * 92, "rendering");
    row->start = (double *)m;
    float *f = (float *)(m + n * sizeof(double));
    row->x = (int32_t *)f, row->y = (int32_t *)f + n;
    for (size_t c = 0; c < 3; c++)
        row->level[c] = f + (2 + c) * n, row->light[c] = f + (5 + c) * n, row->around[c] = f + (8 + c) * n;
    row->cover = f + 11 * n, row->sx = f + 12 * n, row->sy = f + 13 * n;
    row->at = (int32_t *)(f + 14 * n), row->right = f + 15 * n, row->down = f + 16 * n, row->sum = f + 17 * n;
    return BRACE_OK;
}

brace_status sim_render_shot(sim_light *out, const sim_stage *stage, const sim_shot *shot, core_pool *pool,
                             brace_error *error) {
    const sim_scene *scene = stage->scene;
    const double readout = stage->camera->readout;
    const int workers = core_pool_threads(pool);
    sim_render_job job = {.out = out,
                          .scene = scene,
                          .texture = stage->texture,
                          .background = stage->background,
                          .panel = stage->panel,
                          .kernel = sim_light_kernel(stage->panel, core_cpu_features()),
                          .loops = sim_rows_for(core_cpu_features()),
                          .row_time = readout / scene->height,
                          .reference_middle = sim_frame_start(scene, readout, scene->frames / 2) +
                                              0.5 * (readout + scene->reference_time),
                          .blur = sim_blur_of(scene),
                          .exposure = shot->exposure,
                          .start = shot->start,
                          .scale = shot->scale,
                          .steady = shot->steady};
    for (int i = 0; i < 9; i++)
        job.matrix[i] = (float)stage->to_camera[i];
    job.parts = parts_needed(&job);
    job.rows = core_calloc((size_t)workers, sizeof *job.rows);
    brace_status status = job.rows ? BRACE_OK : core_fail_memory(error, (size_t)workers * 64, "rendering");
    for (int i = 0; i < workers && status == BRACE_OK; i++)
        status = row_create(&job.rows[i], out->width, error);
    if (status == BRACE_OK) {
        sim_glare_prepare(&job, &job.rows[0], job.start + 0.5 * (job.exposure + readout));
        core_parallel(pool, out->height, 4, render_rows, &job);
    }
    for (int i = 0; i < workers && job.rows; i++)
        core_free(job.rows[i].memory);
    core_free(job.rows);
    return status;
}

brace_status sim_render(sim_light *out, const sim_stage *stage, int frame, core_pool *pool, brace_error *error) {
    const sim_scene *s = stage->scene;
    const double readout = stage->camera->readout;
    const int middle = s->frames / 2;
    sim_shot shot = {.steady = frame == SIM_EXACT_TRUTH, .scale = s->level};
    if (frame >= 0) {
        shot.exposure = ldexp(s->reference_time, 2 * (frame - middle));
        shot.start = sim_frame_start(s, readout, frame);
        shot.scale = s->level * ldexp(1, 2 * (frame - middle));
    } else {
        /* In the field the truth is one more capture, after the shortest frame, eight times as long at an eighth of
         * the ISO; otherwise it is the mean light from where the reference stood, row by row. */
        shot.exposure = shot.steady ? s->reference_time : 8 * s->reference_time;
        shot.start = sim_frame_start(s, readout, shot.steady ? middle : -1);
    }
    return sim_render_shot(out, stage, &shot, pool, error);
}
