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
    const restore_picture *in, *precision;
    const uint8_t *doubt;
    restore_picture *out;
    ptrdiff_t reach_x, step_x, reach_y, step;
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
            const v4 here = job->in->at[i], own = job->precision->at[i];
            float doubt = ((float)job->doubt[i] * RESTORE_DOUBT - worth) / (fully - worth);
            if (!(doubt > 0)) {
                job->out->at[i] = here;
                continue;
            }
            v4 sum = v4_set(0), weight = v4_set(0);
            for (ptrdiff_t dy = -job->reach_y; dy <= job->reach_y; dy += job->step) {
                if (y + dy < 0 || y + dy >= height)
                    continue;
                for (ptrdiff_t dx = -job->reach_x; dx <= job->reach_x; dx += job->step_x) {
                    if (x + dx < 0 || x + dx >= width)
                        continue;
                    ptrdiff_t j = i + dy * width + dx;
                    v4 there = job->in->at[j], its = job->precision->at[j], d = there - here;
                    float far = 0.25f * v4_sum(d * d * own * its / (own + its)); /* d^2 over the sum of variances */
                    float like = far * inverse; /* two equal pixels differ by far = 1 */
                    like = 1 / (1 + like * like * like * like);
                    v4 w = v4_set(like);
                    sum += w * there, weight += w;
                }
            }
            v4 smooth = sum / weight;
            job->out->at[i] = here + v4_set(doubt < 1 ? doubt : 1) * (smooth - here);
        }
}

void restore_smooth(restore_picture *picture, restore_picture *scratch, const restore_picture *precision,
                    const uint8_t *doubt, core_pool *pool) {
    /* Stripes are as wide as the readout makes them: a share of the height. */
    const ptrdiff_t step = (ptrdiff_t)(picture->height / 720) + 1;
    smooth_job job = {picture, precision, doubt, scratch, 3 * step, 3 * step, 20 * step, step, 6};
    core_parallel(pool, picture->height, 4, smooth_rows, &job);
    /* Again: what the first pass has agreed on bridges wider stripes in the second. */
    job.in = scratch, job.out = picture, job.tolerance = 4;
    core_parallel(pool, picture->height, 4, smooth_rows, &job);
}
