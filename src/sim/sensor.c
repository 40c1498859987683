/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sensor.c: light to raw numbers: the mosaic picks one colour a pixel, photons
 * and electronics add noise of variance S x + O (DNG NoiseProfile), the well
 * clips at 1, and the converter rounds between black and white.
 */
#include <math.h>

#include "sim/simulate.h"

enum { NOISE = 3, GAINS = 4 }; /* purposes of random streams */

typedef struct expose_job {
    brace_frame *out;
    const sim_light *light;
    const sim_scene *scene;
    int frame;
    uint32_t key[2];
} expose_job;

/* Four numbers, mean 0 and deviation 1, for four pixels (Box and Muller 1958). */
static void normal4(float out[4], const uint32_t key[2], uint32_t sample, uint32_t purpose, uint32_t x, uint32_t y) {
    uint32_t counter[4] = {x, y, sample, purpose}, bits[4];
    core_philox(counter, key, bits);
    for (int i = 0; i < 4; i += 2) {
        float u = ((float)(bits[i] >> 8) + 1) * 0x1p-24f, a = (float)(bits[i + 1] >> 8) * (0x1p-24f * 6.2831853f);
        float r = sqrtf(-2 * logf(u));
        out[i] = r * cosf(a), out[i + 1] = r * sinf(a);
    }
}

static void expose_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const expose_job *job = arg;
    brace_frame *f = job->out;
    const bool noisy = job->frame >= 0 && job->scene->noise;
    const float uneven = (float)job->scene->nonuniformity;
    for (uint32_t y = (uint32_t)begin; y < (uint32_t)end; y++)
        for (uint32_t x0 = 0; x0 < f->width; x0 += 4) {
            float noise[4] = {0}, gain[4] = {0};
            if (noisy)
                normal4(noise, job->key, job->scene->sample, (uint32_t)(NOISE + 16 * job->frame), x0, y);
            if (uneven > 0) /* the same in every frame: it belongs to the sensor */
                normal4(gain, job->key, 0, GAINS, x0, y);
            for (uint32_t x = x0; x < x0 + 4 && x < f->width; x++) {
                int color = brace_cfa_color(f->cfa, x, y), place = (int)((y & 1) * 2 + (x & 1));
                float v = job->light->plane[color][(size_t)y * f->width + x] * (1 + uneven * gain[x - x0]);
                if (noisy) {
                    float variance = (float)f->noise[color][0] * fmaxf(v, 0) + (float)f->noise[color][1];
                    v += sqrtf(variance) * noise[x - x0];
                }
                float raw = v * (f->white - f->black[place]) + f->black[place];
                raw = raw < 0 ? 0 : raw > f->white ? f->white : raw;
                f->data[(size_t)y * f->width + x] = (uint16_t)(raw + 0.5f);
            }
        }
}

void sim_expose(brace_frame *out, const sim_light *light, const sim_scene *scene, int frame, core_pool *pool) {
    expose_job job = {out, light, scene, frame, {(uint32_t)scene->seed, (uint32_t)(scene->seed >> 32)}};
    core_parallel(pool, out->height, 16, expose_rows, &job);
}
