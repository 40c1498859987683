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

brace_status restore_motions(restore_motion *out, const brace_frame *const *frames, size_t count, size_t reference,
                             core_pool *pool, const brace_job *job, brace_error *error) {
    restore_pyramid *first = NULL;
    restore_picture packed = {0};
    brace_status status = restore_picture_create(&packed, (frames[0]->width + 1) / 2, (frames[0]->height + 1) / 2,
                                                 "aligning the frames", error);
    if (status == BRACE_OK) {
        restore_pack(&packed, frames[reference], pool);
        status = restore_pyramid_create(&first, &packed, frames[reference], pool, error);
    }
    for (size_t i = 0; i < count && status == BRACE_OK; i++) {
        restore_pyramid *moved = NULL;
        out[i] = (restore_motion){.confidence = 1};
        status = core_check_cancel(job, error);
        if (i == reference || status != BRACE_OK) {
            continue;
        }
        core_progress(job, "aligning", i, count);
        restore_pack(&packed, frames[i], pool);
        status = restore_pyramid_create(&moved, &packed, frames[i], pool, error);
        if (status == BRACE_OK) {
            restore_align(&out[i], first, moved, pool);
            if (out[i].confidence < RESTORE_FOUND) {
                out[i] = (restore_motion){.confidence = out[i].confidence};
            }
        }
        restore_pyramid_destroy(moved);
    }
    if (status == BRACE_OK) {
        core_progress(job, "aligning", count, count);
    }
    restore_pyramid_destroy(first);
    restore_picture_free(&packed);
    return status;
}
