/* SPDX-License-Identifier: Apache-2.0 */
/*
 * smooth.c: evens out what is still uncertain.
 *
 * Where only short frames don't clip and their light is not shared by rows
 * (LED walls), the fused picture keeps stripes, and its error is known to be
 * large. There each pixel becomes the mean of those nearby, mostly above and
 * below (across the stripes), that agree with it within both errors: a
 * bilateral filter whose range is not set by hand but by the variance of each
 * sample, so that a colour which a long frame still holds keeps its edges and
 * steers the colours that it doesn't. Pixels that are certain stay as they are.
 */
#include <math.h>
#include <string.h>

#include "restore/internal.h"

/* Relative deviation by banding from which a pixel is worth helping, and from which it is helped all the way. */
static const float worth = 0.04f, fully = 0.08f;

typedef struct smooth_job {
    const restore_picture *in, *variance;
    const uint8_t *doubt;
    restore_picture *out;
    ptrdiff_t reach_x, reach_y, step;
    float tolerance;
} smooth_job;

static void smooth_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const smooth_job *job = arg;
    const float inverse = 1 / job->tolerance;
    const ptrdiff_t width = (ptrdiff_t)job->in->width, height = (ptrdiff_t)job->in->height;
    for (ptrdiff_t y = (ptrdiff_t)begin; y < (ptrdiff_t)end; y++)
        for (ptrdiff_t x = 0; x < width; x++) {
            const ptrdiff_t i = y * width + x;
            const v4 here = job->in->at[i], error = job->variance->at[i];
            float doubt = ((float)job->doubt[i] * RESTORE_DOUBT - worth) / (fully - worth);
            if (!(doubt > 0)) {
                job->out->at[i] = here;
                continue;
            }
            v4 sum = v4_set(0), weight = v4_set(0);
            for (ptrdiff_t dy = -job->reach_y; dy <= job->reach_y; dy += job->step) {
                if (y + dy < 0 || y + dy >= height)
                    continue;
                for (ptrdiff_t dx = -job->reach_x; dx <= job->reach_x; dx += job->step) {
                    if (x + dx < 0 || x + dx >= width)
                        continue;
                    ptrdiff_t j = i + dy * width + dx;
                    v4 there = job->in->at[j], its = job->variance->at[j], d = there - here;
                    float far = 0.25f * v4_sum(d * d / (error + its + v4_set(1e-12f)));
                    float like = far * inverse; /* two equal pixels differ by far = 1 */
                    like = 1 / (1 + like * like * like * like);
                    v4 w = v4_set(like) / (its + v4_set(1e-12f));
                    sum += w * there, weight += w;
                }
            }
            v4 smooth = sum / weight;
            job->out->at[i] = here + v4_set(doubt < 1 ? doubt : 1) * (smooth - here);
        }
}

void restore_smooth(restore_picture *out, const restore_picture *in, const restore_picture *variance,
                    const uint8_t *doubt, float tolerance, core_pool *pool) {
    /* Stripes are as wide as the readout makes them: a share of the height. */
    ptrdiff_t step = (ptrdiff_t)(in->height / 720) + 1;
    smooth_job job = {in, variance, doubt, out, 3 * step, 20 * step, step, tolerance};
    core_parallel(pool, in->height, 4, smooth_rows, &job);
}
