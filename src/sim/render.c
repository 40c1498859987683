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
    float *level[3], *light[3], *cover, *sx, *sy;
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
    int parts;     /* sub-exposures */
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

/* Four floats, of which three are a texel's colours: one load, one multiplication for all of them. */
typedef float quad __attribute__((vector_size(16)));

static inline quad load(const float *p) {
    quad q;
    memcpy(&q, p, sizeof q); /* levels end with a float to spare */
    return q;
}

/* One level of the pyramid, and the way from the screen's pixels to its own. */
typedef struct sampler {
    const float *rgb;
    float sx, sy, last_x, last_y;
    size_t stride;
    size_t right, down; /* to the neighbours, 0 where a side has one texel only */
    float most_x, most_y;
} sampler;

static sampler sampler_of(const sim_texture *t, int l) {
    const uint32_t w = t->level[l].width, h = t->level[l].height;
    return (sampler){.rgb = t->level[l].rgb, .sx = (float)w / (float)t->width, .sy = (float)h / (float)t->height,
                     .last_x = (float)(w - 1), .last_y = (float)(h - 1), .stride = 3 * (size_t)w,
                     .right = w > 1 ? 3 : 0, .down = h > 1 ? 3 * (size_t)w : 0,
                     .most_x = (float)(w > 1 ? w - 2 : 0), .most_y = (float)(h > 1 ? h - 2 : 0)};
}

static inline float smaller(float a, float b) {
    return a < b ? a : b;
}

static inline float larger(float a, float b) {
    return a > b ? a : b;
}

/* Bilinear: the last texel is reached with a weight of 1 from the one before it. */
static inline quad sample(const sampler *s, float x, float y) {
    x = larger(smaller(x * s->sx - 0.5f, s->last_x), 0), y = larger(smaller(y * s->sy - 0.5f, s->last_y), 0);
    const int i = (int)smaller(x, s->most_x), j = (int)smaller(y, s->most_y);
    const float fx = x - (float)i, fy = y - (float)j;
    const float *p = s->rgb + (size_t)j * s->stride + 3 * (size_t)i, *q = p + s->down;
    quad a = load(p), b = load(p + s->right), c = load(q), d = load(q + s->right);
    a += fx * (b - a), c += fx * (d - c);
    return a + fy * (c - a);
}

/* What the pixels of a row see at one pose: subpixel, level and how much of the pixel is screen. */
static void look(const render_job *job, const render_row *row, const double map[9], double py) {
    const sim_texture *t = job->texture;
    const size_t n = job->out->width;
    const double inv = 1 / (double)n, sw = t->width, sh = t->height;
    const float k1 = (float)job->scene->distortion[0], k2 = (float)job->scene->distortion[1];
    /* The footprint in the middle of the row, the root of its area, chooses the mip levels. */
    const double z = map[7] * py + map[8], u = map[1] * py + map[2], v = map[4] * py + map[5];
    const double area = ((map[0] * z - map[6] * u) * (map[4] * z - map[7] * v) -
                         (map[1] * z - map[7] * u) * (map[3] * z - map[6] * v)) /
                        (z * z * z * z) * inv * inv * sw * sw;
    const double foot = sqrt(fmin(fmax(fabs(area), 1e-6), 1e12)), most = t->levels - 1;
    const double lod = fmin(fmax(log2(foot), 0), most);
    const int l0 = (int)lod, l1 = l0 + 1 < t->levels ? l0 + 1 : l0;
    const float blend = (float)(lod - l0), per_foot = (float)(1 / foot);
    /* Screen pixels are (A + B qx + C qy)/(D + E qx + F qy), in single precision 1/1000 pixel. */
    float m[9];
    for (int i = 0; i < 3; i++) {
        m[i] = (float)((map[i] + 0.5 * map[6 + i]) * sw);
        m[3 + i] = (float)(map[3 + i] * sw + 0.5 * map[6 + i] * sh);
        m[6 + i] = (float)map[6 + i];
    }
    const float width = (float)sw, height = (float)sh, step = (float)inv, first = (float)(0.5 * inv - 0.5);
    const float ry = (float)py, ry2 = ry * ry;
    /* Just below the last pixel's far side. */
    const float last_x = nextafterf(width, 0), last_y = nextafterf(height, 0);
    float *restrict sx = row->sx, *restrict sy = row->sy, *restrict cover = row->cover;
    int32_t *restrict ix = row->x, *restrict iy = row->y;
    for (size_t x = 0; x < n; x++) {
        const float px = first + step * (float)(int32_t)x, r2 = px * px + ry2;
        const float bend = 1 + r2 * (k1 + r2 * k2), qx = px * bend, qy = ry * bend;
        const float w = m[6] * qx + m[7] * qy + m[8], d = 1 / w;
        float a = (m[0] * qx + m[1] * qy + m[2]) * d, b = (m[3] * qx + m[4] * qy + m[5]) * d;
        float edge = smaller(smaller(a, width - a), smaller(b, height - b)) * per_foot + 0.5f;
        edge = w > 0 ? edge : 0; /* behind the camera */
        cover[x] = smaller(larger(edge, 0), 1);
        a = larger(smaller(a, last_x), 0), b = larger(smaller(b, last_y), 0);
        sx[x] = a, sy[x] = b;
        ix[x] = (int32_t)a, iy[x] = (int32_t)b;
    }
    const sampler near = sampler_of(t, l0), far = sampler_of(t, l1);
    float *restrict red = row->level[0], *restrict green = row->level[1], *restrict blue = row->level[2];
    for (size_t x = 0; x < n; x++) {
        quad c = sample(&near, sx[x], sy[x]);
        if (blend > 0)
            c += blend * (sample(&far, sx[x], sy[x]) - c);
        red[x] = c[0], green[x] = c[1], blue[x] = c[2];
    }
}

/* Mean of room light over [a, a+t]: lamps on the mains go as 1 + cos. */
static double room(const sim_scene *s, double a, double t) {
    double w = 6.283185307179586 * s->ambient_hz;
    return w > 0 ? 1 + (sin(w * (a + t)) - sin(w * a)) / (w * t) : 1;
}

/* Adds what a row collected in one sub-exposure: what is around the screen is grey and steady, the
 * room's light lies over all. */
static void collect(const render_job *job, const render_row *row, const float *const light[3], float around, float lamp,
                    float scale, size_t y, bool first) {
    const size_t n = job->out->width;
    const float *restrict r = light[0], *restrict g = light[1], *restrict b = light[2], *restrict cover = row->cover;
    for (int c = 0; c < 3; c++) {
        float *restrict out = job->out->plane[c] + y * n;
        const float *k = job->matrix + 3 * c;
        const float kr = scale * k[0], kg = scale * k[1], kb = scale * k[2], sum = kr + kg + kb;
        const float base = sum * (around + lamp), less = sum * around;
        if (first)
            for (size_t x = 0; x < n; x++)
                out[x] = base + cover[x] * (kr * r[x] + kg * g[x] + kb * b[x] - less);
        else
            for (size_t x = 0; x < n; x++)
                out[x] += base + cover[x] * (kr * r[x] + kg * g[x] + kb * b[x] - less);
    }
}

static void render_rows(void *arg, size_t begin, size_t end, int worker) {
    const render_job *job = arg;
    const render_row *row = &job->rows[worker];
    const sim_scene *s = job->scene;
    const size_t n = job->out->width;
    const int parts = job->parts, grid = s->supersample;
    const double share = 1.0 / (parts * grid * grid), part = job->exposure / parts;
    for (size_t y = begin; y < end; y++) {
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
                const float *light[3];
                for (int ch = 0; ch < 3; ch++) {
                    light[ch] = row->level[ch];
                    if (!job->steady) {
                        job->kernel(job->panel, n, row->x, row->y, row->level[ch], ch, row->start, part, row->light[ch]);
                        light[ch] = row->light[ch];
                    }
                }
                collect(job, row, light, (float)s->clutter, lamp, (float)(job->scale * share), y, p + g == 0);
            }
        }
    }
}

/* How many sub-exposures show the motion within this frame: enough for steps of half a pixel, as many
 * as the scene allows at most. The path of five points, sampled ten times for the quickest swing. */
static int parts_needed(const render_job *job) {
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

static brace_status row_create(render_row *row, size_t n, brace_error *error) {
    char *m = row->memory = core_alloc(n, sizeof(double) + 11 * sizeof(float));
    if (!m)
        return core_fail_memory(error, n * 52, "rendering");
    row->start = (double *)m;
    float *f = (float *)(m + n * sizeof(double));
    row->x = (int32_t *)f, row->y = (int32_t *)f + n;
    for (size_t c = 0; c < 3; c++)
        row->level[c] = f + (2 + c) * n, row->light[c] = f + (5 + c) * n;
    row->cover = f + 8 * n, row->sx = f + 9 * n, row->sy = f + 10 * n;
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
    job.parts = parts_needed(&job);
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
