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
                     .noise = true};
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
        s->nonuniformity = core_random_range(&r, 0, 0.02);
        s->defocus = core_random_range(&r, 0, 1.5);
        s->clutter = exp(core_random_range(&r, log(1e-3), log(0.1)));
    }
}

typedef struct scene_range {
    const char *name;
    size_t offset;
    double low, high;
} scene_range;

#define RANGE(field, low, high)                                                                                        \
    { #field, offsetof(sim_scene, field), low, high }
static const scene_range ranges[] = {
    RANGE(reference_time, 1e-6, 10), RANGE(iso, 10, 1e6),     RANGE(level, 1e-4, 100),    RANGE(tremor_position, 0, 1),
    RANGE(tremor_angle, 0, 1),       RANGE(frame_gap, 0, 10), RANGE(psf, 0, 10),          RANGE(glare, 0, 1),
    RANGE(vignetting, 0, 1),         RANGE(ambient, 0, 10),   RANGE(ambient_hz, 0, 1000), RANGE(nonuniformity, 0, 0.5),
    RANGE(defocus, 0, 20),           RANGE(clutter, 0, 10)};

brace_status sim_scene_check(const sim_scene *s, brace_error *error) {
    for (size_t i = 0; i < sizeof ranges / sizeof *ranges; i++) {
        double v = *(const double *)((const char *)s + ranges[i].offset);
        if (!(v >= ranges[i].low && v <= ranges[i].high))
            return core_fail(error, BRACE_ERROR_ARGUMENT, "%s: %g is out of range %g to %g", ranges[i].name, v,
                             ranges[i].low, ranges[i].high);
    }
    if (s->width < 32 || s->height < 32 || s->width > 16384 || s->height > 16384)
        return core_fail(error, BRACE_ERROR_ARGUMENT, "size: %ux%u is out of range 32x32 to 16384x16384", s->width,
                         s->height);
    if (s->frames < 3 || s->frames > 9 || s->frames % 2 == 0)
        return core_fail(error, BRACE_ERROR_ARGUMENT, "frames: %d is not 3, 5, 7 or 9", s->frames);
    if (s->subexposures < 1 || s->subexposures > 256)
        return core_fail(error, BRACE_ERROR_ARGUMENT, "subexposures: %d is out of range 1 to 256", s->subexposures);
    if (s->supersample != 1 && s->supersample != 2 && s->supersample != 4)
        return core_fail(error, BRACE_ERROR_ARGUMENT, "supersample: %d is not 1, 2 or 4", s->supersample);
    if (!(s->pose.translation[2] >= 0.05 && s->pose.translation[2] <= 100))
        return core_fail(error, BRACE_ERROR_ARGUMENT, "distance: %g is out of range 0.05 to 100 screen widths",
                         s->pose.translation[2]);
    for (int i = 0; i < 3; i++)
        if (!(fabs(s->pose.rotation[i]) <= 1.3 || i == 2) || !isfinite(s->pose.rotation[i]) ||
            !(fabs(s->pose.translation[i]) <= 100))
            return core_fail(error, BRACE_ERROR_ARGUMENT, "pose: the screen is turned or moved out of sight");
    for (int i = 0; i < 2; i++)
        if (!(fabs(s->distortion[i]) <= 0.5))
            return core_fail(error, BRACE_ERROR_ARGUMENT, "distortion: %g is out of range -0.5 to 0.5",
                             s->distortion[i]);
    return BRACE_OK;
}

json_t *sim_scene_json(const sim_scene *s) {
    json_t *out = json_object();
    char seed[24]; /* JSON's integers end at 2^63 */
    snprintf(seed, sizeof seed, "%llu", (unsigned long long)s->seed);
    json_object_set_new(out, "seed", s->seed <= INT64_MAX ? json_integer((json_int_t)s->seed) : json_string(seed));
    json_object_set_new(out, "sample", json_integer(s->sample));
    json_object_set_new(out, "size", json_pack("[i,i]", (int)s->width, (int)s->height));
    json_object_set_new(out, "frames", json_integer(s->frames));
    for (size_t i = 0; i < sizeof ranges / sizeof *ranges; i++)
        json_object_set_new(out, ranges[i].name, json_real(*(const double *)((const char *)s + ranges[i].offset)));
    json_object_set_new(out, "rotation",
                        json_pack("[f,f,f]", s->pose.rotation[0], s->pose.rotation[1], s->pose.rotation[2]));
    json_object_set_new(out, "translation",
                        json_pack("[f,f,f]", s->pose.translation[0], s->pose.translation[1], s->pose.translation[2]));
    json_object_set_new(out, "distortion", json_pack("[f,f]", s->distortion[0], s->distortion[1]));
    json_object_set_new(out, "subexposures", json_integer(s->subexposures));
    json_object_set_new(out, "supersample", json_integer(s->supersample));
    json_object_set_new(out, "noise", json_boolean(s->noise));
    json_object_set_new(out, "field", json_boolean(s->field));
    return out;
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
