/* SPDX-License-Identifier: Apache-2.0 */
/*
 * scene.c: where the screen stands in the picture, and how a hand moves it.
 *
 * A pinhole camera whose focal length is its picture's width in pixels looks
 * along z at a screen one unit wide. A screen point (X, Y, 0) lies at
 * R (X, Y, 0) + t in front of it, so that pixels and screen points are related
 * by the homography K [r1 r2 t], whose inverse the renderer uses. Tremor adds a
 * sum of sinusoids (1 to 11 Hz, where hands tremble) to each of the six
 * degrees of freedom, zero at the middle of the reference frame.
 */
#include <math.h>
#include <string.h>

#include "sim/simulate.h"

enum { TREMOR = 7, WAVES = 3 }; /* the purpose of a random stream; sinusoids for each degree of freedom */

void sim_scene_default(sim_scene *s) {
    *s = (sim_scene){.width = 1024,
                     .height = 768,
                     .frames = 5,
                     .reference_time = 1.0 / 320,
                     .iso = 100,
                     .level = 0.6,
                     .pose = {.translation = {0, 0, 1}},
                     .frame_gap = 0.05,
                     .subexposures = 1,
                     .supersample = 1,
                     .noise = 1};
}

void sim_scene_sample(sim_scene *s, uint64_t seed, uint32_t sample, bool field) {
    core_random r = core_random_create(seed, sample, 1, 0);
    sim_scene_default(s);
    s->seed = seed, s->sample = sample, s->field = field;
    s->reference_time = exp(core_random_range(&r, log(1.0 / 4000), log(1.0 / 30)));
    s->iso = exp(core_random_range(&r, log(50), log(1600)));
    s->level = exp(core_random_range(&r, log(0.25), log(1.6)));
    for (int i = 0; i < 2; i++)
        s->pose.rotation[i] = 0.12 * core_random_normal(&r);
    s->pose.rotation[2] = 0.05 * core_random_normal(&r);
    for (int i = 0; i < 2; i++)
        s->pose.translation[i] = core_random_range(&r, -0.08, 0.08);
    s->pose.translation[2] = core_random_range(&r, 0.6, 1.15);
    s->tremor_position = exp(core_random_range(&r, log(2e-4), log(3e-3)));
    s->tremor_angle = exp(core_random_range(&r, log(2e-4), log(3e-3)));
    s->frame_gap = core_random_range(&r, 0.03, 0.15);
    s->subexposures = 4;
    s->psf = core_random_range(&r, 0.3, 0.9);
    s->glare = exp(core_random_range(&r, log(0.002), log(0.04)));
    s->vignetting = core_random_range(&r, 0, 0.25);
    s->distortion[0] = core_random_range(&r, -0.03, 0.03);
    if (field) {
        s->ambient = exp(core_random_range(&r, log(5e-4), log(0.03)));
        s->ambient_hz = core_random_below(&r, 3) == 0 ? 0 : core_random_below(&r, 2) ? 100 : 120;
        s->sensor_nonuniformity = core_random_range(&r, 0, 0.02);
        s->defocus = core_random_range(&r, 0, 1.5);
        s->clutter = exp(core_random_range(&r, log(1e-3), log(0.1)));
        s->bezel = core_random_range(&r, 0, 0.03);
        s->panel_nonuniformity = core_random_range(&r, 0, 0.03);
    }
}

/* As the paper shoots: the longest frame first, the truth last. Time zero is where the seed says. */
double sim_frame_start(const sim_scene *s, double readout, int frame) {
    core_random r = core_random_create(s->seed, s->sample, 2, 0);
    double t = core_random_range(&r, 0, 10);
    for (int i = s->frames - 1; i > frame; i--)
        t += ldexp(s->reference_time, 2 * (i - s->frames / 2)) + readout + s->frame_gap;
    return t;
}

static double tremor(core_random *r, double amplitude, double t, double zero) {
    double sum = 0;
    for (int i = 0; i < WAVES; i++) {
        double rate = core_random_range(r, 1, 11), phase = core_random_range(r, 0, 6.283185307179586);
        double size = amplitude * sqrt(2.0 / WAVES) / sqrt(rate); /* slower is farther */
        sum += size * (sin(6.283185307179586 * rate * t + phase) - sin(6.283185307179586 * rate * zero + phase));
    }
    return sum;
}

static void invert(double out[9], const double m[9]) {
    double c[9] = {m[4] * m[8] - m[5] * m[7], m[2] * m[7] - m[1] * m[8], m[1] * m[5] - m[2] * m[4],
                   m[5] * m[6] - m[3] * m[8], m[0] * m[8] - m[2] * m[6], m[2] * m[3] - m[0] * m[5],
                   m[3] * m[7] - m[4] * m[6], m[1] * m[6] - m[0] * m[7], m[0] * m[4] - m[1] * m[3]};
    double det = m[0] * c[0] + m[1] * c[3] + m[2] * c[6];
    for (int i = 0; i < 9; i++)
        out[i] = c[i] / det;
}

void sim_scene_map(double map[9], const sim_scene *s, double t, double reference_time) {
    double angle[3], place[3];
    core_random r = core_random_create(s->seed, s->sample, TREMOR, 0);
    for (int i = 0; i < 3; i++) {
        angle[i] = s->pose.rotation[i] + tremor(&r, s->tremor_angle, t, reference_time);
        place[i] = s->pose.translation[i] + tremor(&r, s->tremor_position, t, reference_time);
    }
    double cx = cos(angle[0]), sx = sin(angle[0]), cy = cos(angle[1]), sy = sin(angle[1]), cz = cos(angle[2]),
           sz = sin(angle[2]);
    /* R = Rz Ry Rx; columns 1 and 2, and the translation. */
    double m[9] = {cz * cy, cz * sy * sx - sz * cx, place[0], sz * cy, sz * sy * sx + cz * cx, place[1], -sy, cy * sx,
                   place[2]};
    invert(map, m);
}
