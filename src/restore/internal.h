/* SPDX-License-Identifier: Apache-2.0 */
/*
 * internal.h: what the steps of a restoration hand to each other.
 *
 * All of it works on packed pictures: one pixel for each 2x2 block of the
 * mosaic, its four samples (top left, top right, bottom left, bottom right)
 * side by side, so that a pixel is one 4-float vector whatever the CFA.
 * Coordinates and motions here are in packed pixels.
 */
#ifndef RESTORE_INTERNAL_H
#define RESTORE_INTERNAL_H

#include <stddef.h>
#include <stdint.h>

#include "brace/restore.h"
#include "core/core.h"

typedef float v4 __attribute__((vector_size(16)));

/* Packed samples, row-major. Value 1 is the white level of the frame it came from. */
typedef struct restore_picture {
    size_t width, height;
    v4 *at; /* width*height */
} restore_picture;

/* Signal above which a sample counts as clipped, and from which on it is
 * trusted less and less: sensors bend before they clip. */
#define RESTORE_CLIP_HARD 0.975f
#define RESTORE_CLIP_SOFT 0.90f

/* Displacements on a regular grid of nodes over the picture, bilinear between. */
#define RESTORE_GRID 16

/* Where a reference pixel is found in another frame:
 *   x' = x + a[0] + a[1] u + a[2] v,  y' = y + a[3] + a[4] u + a[5] v,
 * with u, v in [-1, 1] across the width (of both axes, so that rotations stay
 * rotations), plus the local displacement at (x, y). */
typedef struct restore_motion {
    double a[6];
    int columns, rows; /* nodes; 0: no local part */
    float dx[RESTORE_GRID * RESTORE_GRID], dy[RESTORE_GRID * RESTORE_GRID];
    double confidence; /* correlation of the flicker-free features, 0 to 1 */
} restore_motion;

/* pack.c */
brace_status restore_picture_create(restore_picture *out, size_t width, size_t height, const char *what,
                                    brace_error *error);
void restore_picture_free(restore_picture *picture);
/* Black 0, white 1; the missing half of odd sizes repeats its neighbour of the same colour. */
void restore_pack(restore_picture *out, const brace_frame *frame, core_pool *pool);
void restore_unpack(float *mosaic, const brace_frame *frame, const restore_picture *picture, core_pool *pool);

/* align.c */
typedef struct restore_pyramid restore_pyramid;
brace_status restore_pyramid_create(restore_pyramid **out, const restore_picture *picture, const brace_frame *frame,
                                    core_pool *pool, brace_error *error);
void restore_pyramid_destroy(restore_pyramid *pyramid);
void restore_align(restore_motion *out, const restore_pyramid *reference, const restore_pyramid *moved,
                   core_pool *pool);

/* motion.c: the displacement at (x, y) of a picture of that size: its local part alone (there must be one), and all. */
void restore_motion_local(const restore_motion *motion, double x, double y, size_t width, size_t height, double *dx,
                          double *dy);
void restore_motion_at(const restore_motion *motion, double x, double y, size_t width, size_t height, double *dx,
                       double *dy);
/* As it is reported: pixels of the mosaic, of a picture `width` packed pixels wide. */
brace_motion restore_motion_report(const restore_motion *motion, size_t width);
/* The motions of all frames of a bracket, which have one size; none for the reference and for those that are not
 * found: whose confidence is less than this. */
#define RESTORE_FOUND 0.3
brace_status restore_motions(restore_motion *out, const brace_frame *const *frames, size_t count, size_t reference,
                             core_pool *pool, const brace_job *job, brace_error *error);

/* warp.c: one frame as seen from the reference's pose, in units of the
 * reference's exposure, with a trust in [0, 255] a sample that falls to 0
 * where the samples it is interpolated from clip or lie outside. */
typedef struct restore_view {
    restore_picture light;
    uint8_t *trust;      /* 4 a pixel */
    float exposure;      /* relative to the reference */
    v4 noise_s, noise_o; /* variance of `light` x: noise_s x + noise_o */
    float blur;          /* what a sample may be off by, in packed pixels of gradient */
    float banding;       /* relative deviation of its light that the gains do not explain */
    /* Light of this frame against steady light: one gain a row, zone and
     * sample, linear between zone centres (light.c). */
    int zones;
    v4 *gain;         /* height*zones; NULL: 1 */
    double weight;    /* share in the result, filled by fuse.c */
    double deviation; /* of the gains from 1 */
} restore_view;
brace_status restore_view_create(restore_view *out, const restore_picture *picture, const brace_frame *frame,
                                 double exposure, const restore_motion *motion, core_pool *pool, brace_error *error);
void restore_view_free(restore_view *view);
/* What gains leave unexplained grows with what they explain: squared relative
 * deviation of the light at a sample of this gain. */
static inline v4 restore_view_unexplained(const restore_view *view, v4 gain) {
    float scale = view->deviation > 1e-3 ? (float)(1 / view->deviation) : 0;
    v4 off = (gain - (v4){1, 1, 1, 1}) * (v4){scale, scale, scale, scale};
    float b = 0.5f * view->banding * view->banding;
    return (v4){b, b, b, b} * ((v4){1, 1, 1, 1} + off * off);
}
/* Gains along one row, interpolated across it. */
void restore_view_gain_row(const restore_view *view, size_t y, v4 *row);

/* contradict.c: takes from the longer frames the trust of what three shorter ones contradict. Views from short to long. */
void restore_contradict(restore_view *views, size_t count, core_pool *pool);

/* light.c: measures the gains of every view, longest exposure first. `sum` and
 * `weight` are scratch of the picture's size. */
brace_status restore_light(restore_view *views, size_t count, restore_picture *sum, restore_picture *weight,
                           core_pool *pool, brace_error *error);

/* fuse.c: the weighted mean of all views. `precision` receives the sum of the weights; `sigma`, which may be NULL, the
 * error that is to be expected under the curve x^(1/2.2), RESTORE_SIGMA_LEAST to 1; `doubt`, one byte a pixel, the
 * relative deviation that unexplained banding leaves in it, in units of RESTORE_DOUBT. */
#define RESTORE_DOUBT (1.0f / 256.0f)
#define RESTORE_SIGMA_LEAST 0.0005f
brace_status restore_fuse(restore_view *views, size_t count, size_t reference, const restore_picture *pilot,
                          restore_picture *out, restore_picture *precision, restore_picture *sigma,
                          uint8_t *doubt, core_pool *pool, brace_error *error);

/* smooth.c: where doubt is large, borrows from pixels nearby that agree within
 * their errors. In place; `scratch` is overwritten. */
void restore_smooth(restore_picture *picture, restore_picture *scratch, const restore_picture *precision,
                    const uint8_t *doubt, core_pool *pool);

/* restore.c: merging, into a mosaic normalised to the reference's [black, white]. `motion` of each frame; NULL: the camera
 * stood still. `sigma`: the error that is to be expected of each sample, as of restore_fuse, in
 * the mosaic's order; may be NULL. Adds to the report what it measured. */
brace_status restore_merge(float *mosaic, float *sigma, brace_restore_report *report, const brace_bracket *bracket,
                           const restore_motion *motion, const brace_job *job, core_pool *pool, brace_error *error);

static inline v4 v4_set(float x) {
    return (v4){x, x, x, x};
}
static inline v4 v4_max(v4 a, v4 b) {
    return (v4){a[0] > b[0] ? a[0] : b[0], a[1] > b[1] ? a[1] : b[1], a[2] > b[2] ? a[2] : b[2],
                a[3] > b[3] ? a[3] : b[3]};
}
static inline v4 v4_min(v4 a, v4 b) {
    return (v4){a[0] < b[0] ? a[0] : b[0], a[1] < b[1] ? a[1] : b[1], a[2] < b[2] ? a[2] : b[2],
                a[3] < b[3] ? a[3] : b[3]};
}
static inline v4 v4_abs(v4 a) {
    return v4_max(a, -a);
}
static inline float v4_sum(v4 a) {
    return (a[0] + a[1]) + (a[2] + a[3]);
}
static inline v4 v4_trust(const uint8_t *trust) {
    return (v4){(float)trust[0], (float)trust[1], (float)trust[2], (float)trust[3]} * v4_set(1.0f / 255.0f);
}

#endif
