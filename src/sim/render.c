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

#include "sim/simulate.h"

typedef struct render_row {
    int32_t *x, *y;
    float *level[3], *cover, *light;
    double *start;
    void *memory;
} render_row;

typedef struct render_job {
    sim_light *out;
    const sim_scene *scene;
    const sim_texture *texture;
    const sim_panel *panel;
    sim_light_fn *kernel;
    double start, exposure, row_time, reference_middle;
    double scale; /* of light to signal */
    bool steady;  /* the time mean, no flicker */
    float matrix[9];
    render_row *rows; /* one a worker */
} render_job;

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

static void texel(float out[3], const sim_texture *t, int l, float x, float y) {
    const uint32_t w = t->level[l].width, h = t->level[l].height;
    x = fminf(fmaxf(x - 0.5f, 0), (float)(w - 1)), y = fminf(fmaxf(y - 0.5f, 0), (float)(h - 1));
    const uint32_t i = (uint32_t)x, j = (uint32_t)y, i1 = i + 1 < w ? i + 1 : i, j1 = j + 1 < h ? j + 1 : j;
    const float fx = x - (float)i, fy = y - (float)j, *p = t->level[l].rgb;
    const float *a = p + 3 * ((size_t)j * w + i), *b = p + 3 * ((size_t)j * w + i1), *c = p + 3 * ((size_t)j1 * w + i),
                *d = p + 3 * ((size_t)j1 * w + i1);
    for (int k = 0; k < 3; k++)
        out[k] = (1 - fy) * (a[k] + fx * (b[k] - a[k])) + fy * (c[k] + fx * (d[k] - c[k]));
}

/* What the pixels of a row see at one pose: subpixel, level and how much of the pixel is screen. */
static void look(const render_job *job, const render_row *row, const double map[9], double py) {
    const sim_texture *t = job->texture;
    const size_t n = job->out->width;
    const double inv = 1 / (double)n, sw = t->width, sh = t->height;
    const double k1 = job->scene->distortion[0], k2 = job->scene->distortion[1];
    /* The footprint in the middle of the row chooses the mip levels. */
    double z = map[7] * py + map[8], fx = inv * (map[0] * z - map[6] * (map[1] * py + map[2])) / (z * z) * sw;
    double fy = inv * (map[4] * z - map[7] * (map[4] * py + map[5])) / (z * z) * sw;
    double foot = sqrt(fmax(fabs(fx * fy), 1e-12)), lod = log2(foot);
    lod = !(lod > 0) ? 0 : lod > t->levels - 1 ? t->levels - 1 : lod;
    const int l0 = (int)lod, l1 = l0 + 1 < t->levels ? l0 + 1 : l0;
    const float blend = (float)(lod - l0), s0 = ldexpf(1, -l0), s1 = ldexpf(1, -l1);
    foot = fmax(foot, 1e-3);
    for (size_t x = 0; x < n; x++) {
        double px = ((double)x + 0.5 - 0.5 * (double)n) * inv, r2 = px * px + py * py;
        double bend = 1 + r2 * (k1 + r2 * k2), qx = px * bend, qy = py * bend;
        double d = 1 / (map[6] * qx + map[7] * qy + map[8]);
        double sx = ((map[0] * qx + map[1] * qy + map[2]) * d + 0.5) * sw;
        double sy = (map[3] * qx + map[4] * qy + map[5]) * d * sw + 0.5 * sh;
        double edge = fmin(fmin(sx, sw - sx), fmin(sy, sh - sy)) / foot + 0.5;
        row->cover[x] = !(edge > 0) || !(d > 0) ? 0 : edge < 1 ? (float)edge : 1;
        sx = !(sx > 0) ? 0 : sx < sw - 1 ? sx : sw - 1, sy = !(sy > 0) ? 0 : sy < sh - 1 ? sy : sh - 1;
        row->x[x] = (int32_t)sx, row->y[x] = (int32_t)sy;
        float a[3], b[3];
        texel(a, t, l0, (float)sx * s0, (float)sy * s0);
        if (l1 != l0 && blend > 0) {
            texel(b, t, l1, (float)sx * s1, (float)sy * s1);
            for (int c = 0; c < 3; c++)
                a[c] += blend * (b[c] - a[c]);
        }
        for (int c = 0; c < 3; c++)
            row->level[c][x] = a[c];
    }
}

/* Mean of room light over [a, a+t]: lamps on the mains go as 1 + cos. */
static double room(const sim_scene *s, double a, double t) {
    double w = 6.283185307179586 * s->ambient_hz;
    return w > 0 ? 1 + (sin(w * (a + t)) - sin(w * a)) / (w * t) : 1;
}

static void render_rows(void *arg, size_t begin, size_t end, int worker) {
    const render_job *job = arg;
    const render_row *row = &job->rows[worker];
    const sim_scene *s = job->scene;
    const size_t n = job->out->width;
    const int parts = job->steady ? 1 : s->subexposures, grid = s->supersample;
    const double share = 1.0 / (parts * grid * grid), part = job->exposure / parts;
    for (size_t y = begin; y < end; y++) {
        for (int c = 0; c < 3; c++)
            memset(job->out->plane[c] + y * n, 0, n * sizeof(float));
        for (int p = 0; p < parts; p++) {
            double a = job->start + (double)y * job->row_time + p * part, map[9];
            sim_scene_map(map, s, a + 0.5 * part, job->reference_middle);
            float lamp = (float)(s->ambient * (job->steady ? 1 : room(s, a, part)));
            for (size_t x = 0; x < n; x++)
                row->start[x] = a;
            for (int g = 0; g < grid * grid; g++) {
                double v = (double)y + (0.5 + g / grid) / grid, shifted[9];
                memcpy(shifted, map, sizeof map);
                double u = ((0.5 + g % grid) / grid - 0.5) / (double)n; /* a shift of all rays of the row in x */
                for (int i = 0; i < 3; i++)
                    shifted[3 * i + 2] += shifted[3 * i] * u;
                look(job, row, shifted, (v - 0.5 * job->out->height) / (double)n);
                for (int ch = 0; ch < 3; ch++) {
                    const float *light = row->level[ch];
                    if (!job->steady) {
                        job->kernel(job->panel, n, row->x, row->y, row->level[ch], ch, row->start, part, row->light);
                        light = row->light;
                    }
                    for (int c = 0; c < 3; c++) {
                        float k = (float)(job->scale * share) * job->matrix[3 * c + ch],
                              *out = job->out->plane[c] + y * n;
                        for (size_t x = 0; x < n; x++)
                            out[x] += k * (row->cover[x] * light[x] + (1 - row->cover[x]) * (float)s->clutter + lamp);
                    }
                }
            }
        }
    }
}

static brace_status row_create(render_row *row, size_t n, brace_error *error) {
    char *m = row->memory = core_alloc(n, 3 * sizeof(double) + 8 * sizeof(float));
    if (!m)
        return core_fail_memory(error, n * 56, "rendering");
    row->start = (double *)m;
    float *f = (float *)(m + n * sizeof(double));
    row->x = (int32_t *)f, row->y = (int32_t *)f + n;
    for (int c = 0; c < 3; c++)
        row->level[c] = f + (2 + (size_t)c) * n;
    row->cover = f + 5 * n, row->light = f + 6 * n;
    return BRACE_OK;
}

brace_status sim_render(sim_light *out, const sim_scene *scene, const sim_camera *camera, const sim_texture *texture,
                        const sim_panel *panel, int frame, const double to_camera[9], core_pool *pool,
                        brace_error *error) {
    const int middle = scene->frames / 2, workers = core_pool_threads(pool);
    const double reference_start = sim_frame_start(scene, camera->readout, middle);
    render_job job = {.out = out,
                      .scene = scene,
                      .texture = texture,
                      .panel = panel,
                      .kernel = sim_light_kernel(panel, core_cpu_features()),
                      .row_time = camera->readout / scene->height,
                      .reference_middle = reference_start + 0.5 * (camera->readout + scene->reference_time)};
    if (frame >= 0) {
        job.exposure = ldexp(scene->reference_time, 2 * (frame - middle));
        job.start = sim_frame_start(scene, camera->readout, frame);
        job.scale = scene->level * ldexp(1, 2 * (frame - middle));
    } else {
        /* In the field the truth is one more capture, after the shortest frame, eight times as long at an eighth of
         * the ISO; otherwise it is the mean light from where the reference stood, row by row. */
        job.steady = !scene->field;
        job.exposure = scene->field ? 8 * scene->reference_time : scene->reference_time;
        job.start = scene->field ? sim_frame_start(scene, camera->readout, -1) : reference_start;
        job.scale = scene->level;
    }
    for (int i = 0; i < 9; i++)
        job.matrix[i] = (float)to_camera[i];
    job.rows = core_calloc((size_t)workers, sizeof *job.rows);
    brace_status status = job.rows ? BRACE_OK : core_fail_memory(error, (size_t)workers * 64, "rendering");
    for (int i = 0; i < workers && status == BRACE_OK; i++)
        status = row_create(&job.rows[i], out->width, error);
    if (status == BRACE_OK)
        core_parallel(pool, out->height, 4, render_rows, &job);
    for (int i = 0; i < workers && job.rows; i++)
        core_free(job.rows[i].memory);
    core_free(job.rows);
    return status;
}
