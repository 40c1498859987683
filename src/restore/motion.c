/* SPDX-License-Identifier: Apache-2.0 */
/* motion.c: where the pixels of a bracket's reference are found in its other frames. */
#include <math.h>

#include "restore/internal.h"

void restore_motion_local(const restore_motion *m, double x, double y, size_t width, size_t height, double *dx,
                          double *dy) {
    double gx = x / (double)width * m->columns - 0.5, gy = y / (double)height * m->rows - 0.5;
    gx = gx < 0 ? 0 : gx > m->columns - 1 ? m->columns - 1 : gx;
    gy = gy < 0 ? 0 : gy > m->rows - 1 ? m->rows - 1 : gy;
    const int ix = (int)gx, iy = (int)gy;
    const int jx = ix + 1 < m->columns ? ix + 1 : ix, jy = iy + 1 < m->rows ? iy + 1 : iy;
    const double fx = gx - ix, fy = gy - iy;
    const double w00 = (1 - fx) * (1 - fy), w01 = fx * (1 - fy), w10 = (1 - fx) * fy, w11 = fx * fy;
    const int a = iy * m->columns + ix, b = iy * m->columns + jx, c = jy * m->columns + ix, d = jy * m->columns + jx;
    *dx = w00 * (double)m->dx[a] + w01 * (double)m->dx[b] + w10 * (double)m->dx[c] + w11 * (double)m->dx[d];
    *dy = w00 * (double)m->dy[a] + w01 * (double)m->dy[b] + w10 * (double)m->dy[c] + w11 * (double)m->dy[d];
}

void restore_motion_at(const restore_motion *m, double x, double y, size_t width, size_t height, double *dx,
                       double *dy) {
    const double half_w = 0.5 * (double)width, half_h = 0.5 * (double)height;
    const double u = (x - half_w) / half_w, v = (y - half_h) / half_w;
    *dx = *dy = 0;
    if (m->columns > 0) {
        restore_motion_local(m, x, y, width, height, dx, dy);
    }
    *dx += m->a[0] + m->a[1] * u + m->a[2] * v;
    *dy += m->a[3] + m->a[4] * u + m->a[5] * v;
}

brace_motion restore_motion_report(const restore_motion *m, size_t width) {
    double farthest = 0;
    for (int i = 0; i < m->columns * m->rows; i++) {
        farthest = fmax(farthest, hypot((double)m->dx[i], (double)m->dy[i]));
    }
    const double half = 0.5 * (double)width; /* by which u and v were normalised */
    const double xx = 1 + m->a[1] / half, xy = m->a[2] / half, yx = m->a[4] / half, yy = 1 + m->a[5] / half;
    return (brace_motion){.dx = 2 * m->a[0],
                          .dy = 2 * m->a[3],
                          .rotation = atan2(xy - yx, xx + yy) * (180 / 3.14159265358979323846),
                          .scale = sqrt(fabs(xx * yy - xy * yx)),
                          .local = 2 * farthest,
                          .confidence = m->confidence};
}

/* Of two small motions one after the other: their sum. The confidence is the lesser one. */
static restore_motion joined(const restore_motion *first, const restore_motion *then) {
    restore_motion out = first->columns > 0 ? *first : *then;
    for (int k = 0; k < 6; k++) {
        out.a[k] = first->a[k] + then->a[k];
    }
    for (int k = 0; first->columns > 0 && then->columns > 0 && k < out.columns * out.rows; k++) {
        out.dx[k] += then->dx[k], out.dy[k] += then->dy[k]; /* frames have one size, and so one grid */
    }
    out.confidence = fmin(first->confidence, then->confidence);
    return out;
}

typedef struct motions_run {
    const brace_frame *const *frames;
    restore_picture packed;
    restore_pyramid *first; /* the reference's */
    restore_motion *out;
    core_pool *pool;
} motions_run;

/* Frame i on the reference or, if it is not found there, on the frame before it, which lies between the two in exposure
 * and is left in *before: a reference with little light may share hardly anything but noise with a long frame. */
static brace_status find(motions_run *r, size_t i, restore_pyramid **before, const restore_motion *its,
                         brace_error *error) {
    restore_pyramid *moved = NULL;
    restore_pack(&r->packed, r->frames[i], r->pool);
    brace_status status = restore_pyramid_create(&moved, &r->packed, r->frames[i], r->pool, error);
    if (status != BRACE_OK) {
        return status;
    }
    restore_align(&r->out[i], r->first, moved, r->pool);
    if (r->out[i].confidence < RESTORE_FOUND && *before != NULL) {
        restore_motion then;
        restore_align(&then, *before, moved, r->pool);
        then = joined(its, &then);
        if (then.confidence > r->out[i].confidence) {
            r->out[i] = then;
        }
    }
    if (r->out[i].confidence < RESTORE_FOUND) {
        r->out[i] = (restore_motion){.confidence = r->out[i].confidence};
    }
    restore_pyramid_destroy(*before);
    *before = moved;
    return BRACE_OK;
}

brace_status restore_motions(restore_motion *out, const brace_frame *const *frames, size_t count, size_t reference,
                             core_pool *pool, const brace_job *job, brace_error *error) {
    motions_run r = {.frames = frames, .out = out, .pool = pool};
    restore_pyramid *before = NULL;
    brace_status status = restore_picture_create(&r.packed, (frames[0]->width + 1) / 2, (frames[0]->height + 1) / 2,
                                                 "aligning the frames", error);
    if (status == BRACE_OK) {
        restore_pack(&r.packed, frames[reference], pool);
        status = restore_pyramid_create(&r.first, &r.packed, frames[reference], pool, error);
    }
    out[reference] = (restore_motion){.confidence = 1};
    for (size_t done = 1; done < count && status == BRACE_OK; done++) {
        /* Longer and longer ones, then shorter and shorter ones. */
        const bool longer = reference + done < count;
        const size_t i = longer ? reference + done : count - 1 - done;
        if (i + 1 == reference) {
            restore_pyramid_destroy(before);
            before = NULL;
        }
        status = core_check_cancel(job, error);
        if (status == BRACE_OK) {
            core_progress(job, "aligning", done - 1, count - 1);
            status = find(&r, i, &before, &out[longer ? i - 1 : i + 1], error);
        }
    }
    if (status == BRACE_OK) {
        core_progress(job, "aligning", count - 1, count - 1);
    }
    restore_pyramid_destroy(before);
    restore_pyramid_destroy(r.first);
    restore_picture_free(&r.packed);
    return status;
}
