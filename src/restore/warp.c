/* SPDX-License-Identifier: Apache-2.0 */
/*
 * warp.c: one frame as seen from the reference's pose and exposure.
 *
 * Catmull-Rom interpolation (Keys 1981, a = -1/2) of the packed picture: four
 * samples at once, each on its own lattice of period two, so nothing is
 * demosaiced. A result is trusted only as far as the brightest sample under
 * its 4x4 kernel is below clipping: one clipped sample poisons all that is
 * interpolated from it.
 */
#include <math.h>
#include <string.h>

#include "restore/internal.h"

typedef struct warp_job {
    restore_view *view;
    const restore_picture *in;
    const restore_motion *motion; /* NULL: identity */
} warp_job;

static uint8_t warp_trust(float brightest) {
    float t = (RESTORE_CLIP_HARD - brightest) * (255.0f / (RESTORE_CLIP_HARD - RESTORE_CLIP_SOFT));
    return (uint8_t)(t < 0.0f ? 0.0f : t > 255.0f ? 255.0f : t);
}

static void warp_store(restore_view *view, size_t index, v4 value, v4 brightest) {
    view->light.at[index] = value * v4_set(1.0f / view->exposure);
    for (int c = 0; c < 4; c++)
        view->trust[4 * index + (size_t)c] = warp_trust(brightest[c]);
}

static void warp_weights(float t, float w[4]) {
    float t2 = t * t, t3 = t2 * t;
    w[0] = 0.5f * (-t3 + 2 * t2 - t);
    w[1] = 0.5f * (3 * t3 - 5 * t2 + 2);
    w[2] = 0.5f * (-3 * t3 + 4 * t2 + t);
    w[3] = 0.5f * (t3 - t2);
}

static void warp_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const warp_job *job = arg;
    restore_view *view = job->view;
    const restore_motion *m = job->motion;
    const size_t width = job->in->width, height = job->in->height;
    const double half_w = 0.5 * (double)width, half_h = 0.5 * (double)height;
    for (size_t y = begin; y < end; y++) {
        double v = ((double)y - half_h) / half_w;
        double local_x = 0, local_y = 0, step_x = 0, step_y = 0;
        for (size_t x = 0; x < width; x++) {
            /* The local part is smooth: exact every 16 pixels, linear between. */
            if (m->columns > 0 && (x & 15) == 0) {
                double next_x, next_y;
                restore_motion_local(m, (double)x, (double)y, width, height, &local_x, &local_y);
                restore_motion_local(m, (double)x + 16, (double)y, width, height, &next_x, &next_y);
                step_x = (next_x - local_x) / 16;
                step_y = (next_y - local_y) / 16;
            }
            double u = ((double)x - half_w) / half_w;
            double sx = (double)x + m->a[0] + m->a[1] * u + m->a[2] * v + local_x;
            double sy = (double)y + m->a[3] + m->a[4] * u + m->a[5] * v + local_y;
            local_x += step_x;
            local_y += step_y;
            size_t index = y * width + x;
            if (!(sx > -1 && sx < (double)width && sy > -1 && sy < (double)height)) {
                view->light.at[index] = v4_set(0);
                memset(view->trust + 4 * index, 0, 4);
                continue;
            }
            double fx = floor(sx), fy = floor(sy);
            float wx[4], wy[4];
            warp_weights((float)(sx - fx), wx);
            warp_weights((float)(sy - fy), wy);
            ptrdiff_t x0 = (ptrdiff_t)fx - 1, y0 = (ptrdiff_t)fy - 1;
            v4 sum = v4_set(0), brightest = v4_set(-1);
            bool inside = x0 >= 0 && x0 + 3 < (ptrdiff_t)width;
            for (int j = 0; j < 4; j++) {
                ptrdiff_t yy = y0 + j;
                yy = yy < 0 ? 0 : yy >= (ptrdiff_t)height ? (ptrdiff_t)height - 1 : yy;
                const v4 *row = job->in->at + (size_t)yy * width;
                v4 tap[4];
                for (int i = 0; i < 4; i++) {
                    ptrdiff_t xx = x0 + i;
                    if (!inside)
                        xx = xx < 0 ? 0 : xx >= (ptrdiff_t)width ? (ptrdiff_t)width - 1 : xx;
                    tap[i] = row[xx];
                }
                sum += v4_set(wy[j]) * (v4_set(wx[0]) * tap[0] + v4_set(wx[1]) * tap[1] + v4_set(wx[2]) * tap[2] +
                                        v4_set(wx[3]) * tap[3]);
                brightest = v4_max(brightest, v4_max(v4_max(tap[0], tap[1]), v4_max(tap[2], tap[3])));
            }
            warp_store(view, index, sum, brightest);
        }
    }
}

/* The reference itself: no interpolation, so every sample stands for itself. */
static void copy_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const warp_job *job = arg;
    const size_t width = job->in->width;
    for (size_t i = begin * width; i < end * width; i++)
        warp_store(job->view, i, job->in->at[i], job->in->at[i]);
}

brace_status restore_view_create(restore_view *out, const restore_picture *picture, const brace_frame *frame,
                                 double exposure, const restore_motion *motion, core_pool *pool, brace_error *error) {
    *out = (restore_view){.exposure = (float)exposure};
    size_t count = picture->width * picture->height;
    brace_status status =
        restore_picture_create(&out->light, picture->width, picture->height, "an aligned frame", error);
    if (status)
        return status;
    out->trust = core_alloc(count, 4);
    if (!out->trust) {
        restore_view_free(out);
        return core_fail_memory(error, count * 4, "the trust of an aligned frame");
    }
    /* x = signal/exposure: var(x) = (S e x + O)/e^2. */
    for (uint32_t c = 0; c < 4; c++) {
        int color = brace_cfa_color(frame->cfa, c & 1, c >> 1);
        /* No sensor is that noisy: a file that says so must not make infinities. */
        double s = fmin(fmax(frame->noise[color][0], 0), 1), o = fmin(fmax(frame->noise[color][1], 0), 1);
        out->noise_s[c] = (float)(s / exposure);
        out->noise_o[c] = (float)(o / (exposure * exposure));
    }
    warp_job job = {out, picture, motion};
    core_parallel(pool, picture->height, 16, motion ? warp_rows : copy_rows, &job);
    return BRACE_OK;
}

void restore_view_free(restore_view *view) {
    restore_picture_free(&view->light);
    core_free(view->trust);
    core_free(view->gain);
    view->trust = NULL;
    view->gain = NULL;
}

void restore_view_gain_row(const restore_view *view, size_t y, v4 *row) {
    size_t width = view->light.width;
    if (!view->gain) {
        for (size_t x = 0; x < width; x++)
            row[x] = v4_set(1);
        return;
    }
    const v4 *gain = view->gain + y * (size_t)view->zones;
    float scale = (float)view->zones / (float)width;
    for (size_t x = 0; x < width; x++) {
        float g = ((float)x + 0.5f) * scale - 0.5f;
        g = g < 0 ? 0 : g > (float)(view->zones - 1) ? (float)(view->zones - 1) : g;
        int i = (int)g;
        int j = i + 1 < view->zones ? i + 1 : i;
        row[x] = gain[i] + v4_set(g - (float)i) * (gain[j] - gain[i]);
    }
}
