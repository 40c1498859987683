/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuse.c: the mean of all frames, each sample weighed by what is known of its
 * error (minimum variance for independent errors):
 *
 *   w_i = trust_i / (noise_i + (banding_i L)^2 + (blur_i |dL|)^2 + excess_i)
 *
 * noise from the NoiseProfile, divided by the square of the gain of the light;
 * banding what the gains left unexplained; blur what misalignment and motion
 * blur do where L changes by dL from pixel to pixel, where the reference, which has neither, is the authority;
 * excess by how far a frame disagrees with the reference along a few pixels of
 * the row, on the whole or pixel by pixel, beyond what the errors of both allow:
 * something moved, the frame was not aligned, or it is blurred.
 *
 * A sample of the reference that clips still says where the light is to be looked
 * for: at the clipping level, give or take half of it. Shorter frames that measured
 * it better overrule that at once; those that flicker wildly, and may have seen
 * nothing at all or a flash, don't.
 *
 * A sample of a longer frame that clips says how bright the light is at least. Where
 * all that shorter ones recorded, and all that lies around it, is darker, they were
 * exposed while the display was dark, and know nothing.
 *
 * The error that is to be expected of the result is that of the mean, and how far the
 * frames disagree beyond their own errors.
 */
#include <math.h>
#include <string.h>

#include "restore/internal.h"

/* How far around a sample light is looked for that may have been misplaced or smeared into it: packed pixels. */
enum { REACH_X = 8, REACH_Y = 2 };
/* Less than this share of what a clipped sample says at least contradicts it. */
static const float missed = 0.8f;

/* Under which networks see light, and errors of it. */
static const float curve = 1 / 2.2f;

typedef struct fuse_job {
    restore_view *views;
    size_t count, reference;
    const restore_picture *pilot;
    restore_picture *out, *precision, *sigma; /* sigma: may be NULL */
    uint8_t *doubt;
    v4 *rows;          /* for each worker and view: gains, and light without them */
    double *row_share; /* height*count */
} fuse_job;

/* The brightest light of the pilot around a pixel. */
static v4 brightest_near(const restore_picture *pilot, size_t x, size_t y) {
    const ptrdiff_t width = (ptrdiff_t)pilot->width, height = (ptrdiff_t)pilot->height;
    v4 most = v4_set(0);
    for (ptrdiff_t j = (ptrdiff_t)y - REACH_Y; j <= (ptrdiff_t)y + REACH_Y; j++)
        for (ptrdiff_t i = (ptrdiff_t)x - REACH_X; i <= (ptrdiff_t)x + REACH_X; i++)
            if (i >= 0 && i < width && j >= 0 && j < height)
                most = v4_max(most, pilot->at[j * width + i]);
    return most;
}

static void fuse_rows(void *arg, size_t begin, size_t end, int worker) {
    const fuse_job *job = arg;
    const size_t width = job->out->width, height = job->out->height, count = job->count;
    const size_t pitch = width + 4; /* two pixels more at either end */
    v4 *gains = job->rows + (size_t)worker * count * (width + pitch), *steady = gains + count * width;
    for (size_t y = begin; y < end; y++) {
        const v4 *pilot = job->pilot->at + y * width;
        const v4 *above = y ? pilot - width : pilot, *below = y + 1 < height ? pilot + width : pilot;
        double share[BRACE_BRACKET_MAX] = {0};
        for (size_t i = 0; i < count; i++) {
            const v4 *light = job->views[i].light.at + y * width;
            v4 *gain = gains + i * width, *row = steady + i * pitch;
            restore_view_gain_row(&job->views[i], y, gain);
            for (size_t x = 0; x < width; x++)
                row[x + 2] = light[x] / gain[x];
            row[0] = row[1] = row[2];
            row[width + 2] = row[width + 3] = row[width + 1];
        }
        for (size_t x = 0; x < width; x++) {
            size_t k = y * width + x, left = x ? x - 1 : x, right = x + 1 < width ? x + 1 : x;
            v4 light = pilot[x], high = light, low = light;
            const size_t column[3] = {left, x, right};
            for (int j = 0; j < 3; j++) {
                high = v4_max(v4_max(high, pilot[column[j]]), v4_max(above[column[j]], below[column[j]]));
                low = v4_min(v4_min(low, pilot[column[j]]), v4_min(above[column[j]], below[column[j]]));
            }
            v4 edge = (high - low) * (high - low) * v4_set(0.25f);
            v4 sum = v4_set(0), weight = v4_set(0), w[BRACE_BRACKET_MAX], off[BRACE_BRACKET_MAX];
            v4 noise[BRACE_BRACKET_MAX], own[BRACE_BRACKET_MAX], least = v4_set(0);
            for (size_t i = 0; i < count; i++) {
                const restore_view *view = &job->views[i];
                v4 inverse = v4_set(1) / gains[i * width + x], poor = v4_set(0.02f) * inverse;
                noise[i] = (view->noise_s * light / inverse + view->noise_o) * inverse * inverse + v4_set(1e-10f);
                off[i] = restore_view_unexplained(view, gains[i * width + x]);
                w[i] = (off[i] + poor * poor) * light * light; /* for now */
            }
            const v4 reference_trust = v4_trust(job->views[job->reference].trust + 4 * k);
            for (size_t i = 0; i < count; i++) {
                const restore_view *view = &job->views[i];
                v4 trust = v4_trust(view->trust + 4 * k);
                v4 variance = noise[i] + w[i] + v4_set(view->blur * view->blur) * edge;
                own[i] = variance;
                const uint8_t *t = view->trust + 4 * k;
                const bool clips = view->exposure > 1 && (t[0] == 0 || t[1] == 0 || t[2] == 0 || t[3] == 0);
                for (int c = 0; c < 4 && clips; c++)
                    if (trust[c] == 0 && view->light.at[k][c] * view->exposure > RESTORE_CLIP_HARD)
                        least[c] = fmaxf(least[c], steady[i * pitch + x + 2][c] / (1 + 3 * sqrtf(off[i][c])));
                if (i != job->reference) {
                    v4 d = v4_set(0), each = v4_set(0);
                    for (size_t j = 0; j < 5; j++) {
                        v4 e = steady[i * pitch + x + j] - steady[job->reference * pitch + x + j];
                        d += e, each += e * e;
                    }
                    d *= v4_set(0.2f), each *= v4_set(0.2f);
                    v4 random = noise[i] + noise[job->reference], common = w[i] + w[job->reference];
                    v4 excess = v4_max(d * d - v4_set(4) * (random * v4_set(0.2f) + common), v4_set(0));
                    /* The mean of five squares is seldom above 2.2 times what is expected. */
                    v4 unlike = v4_max(each - v4_set(2.2f) * (random + common), v4_set(0));
                    variance += (v4_set(4) * excess + unlike) * reference_trust;
                }
                w[i] = trust / variance;
                sum += w[i] * steady[i * pitch + x + 2];
                weight += w[i];
            }
            v4 value, precision, variance;
            float doubt = 0;
            for (int c = 0; c < 4; c++) {
                bool known = weight[c] > 0;
                /* Clipped in every frame: at least as bright as the shortest one can tell. */
                value[c] = known ? sum[c] / weight[c] : job->views[0].light.at[k][c];
                if (known && reference_trust[c] == 0) {
                    const float clipped = steady[job->reference * pitch + x + 2][c];
                    const float w_clipped = 4 / (clipped * clipped + 1e-6f);
                    value[c] = (weight[c] * value[c] + w_clipped * clipped) / (weight[c] + w_clipped);
                    weight[c] += w_clipped;
                }
                precision[c] = known ? weight[c] : 1 / (value[c] * value[c] + 1e-10f);
                float banding = 0;
                for (size_t i = 0; i < count && known; i++) {
                    float part = w[i][c] / weight[c];
                    share[i] += part;
                    banding += part * part * off[i][c];
                }
                doubt = fmaxf(doubt, known ? banding : 0);
                float unlike = 0, all = 0;
                for (size_t i = 0; i < count && known && job->sigma != NULL; i++) {
                    const float d = steady[i * pitch + x + 2][c] - value[c];
                    const float part = (float)job->views[i].trust[4 * k + (size_t)c] / own[i][c];
                    unlike += part * fmaxf(d * d - 2 * own[i][c], 0); /* 2: this frame's error and the mean's */
                    all += part;
                }
                variance[c] = 1 / precision[c] + (all > 0 ? unlike / all : 0);
            }
            bool dark = false;
            for (int c = 0; c < 4; c++)
                dark = dark || value[c] < missed * least[c];
            if (dark) {
                const v4 near = brightest_near(job->pilot, x, y);
                for (int c = 0; c < 4; c++)
                    if (near[c] < missed * least[c] && value[c] < least[c]) {
                        value[c] = least[c];
                        variance[c] = fmaxf(variance[c], least[c] * least[c]);
                        precision[c] = fminf(precision[c], 1 / (least[c] * least[c]));
                    }
            }
            doubt = sqrtf(doubt) / RESTORE_DOUBT;
            job->doubt[k] = (uint8_t)(doubt < 255 ? doubt : 255);
            job->out->at[k] = value;
            job->precision->at[k] = precision;
            for (int c = 0; c < 4 && job->sigma != NULL; c++) {
                const float v = fmaxf(value[c], 0);
                const float off_by = powf(v + sqrtf(variance[c]), curve) - powf(v, curve);
                job->sigma->at[k][c] = fmaxf(RESTORE_SIGMA_LEAST, fminf(off_by, 1));
            }
        }
        memcpy(job->row_share + y * count, share, count * sizeof(double));
    }
}

brace_status restore_fuse(restore_view *views, size_t count, size_t reference, const restore_picture *pilot,
                          restore_picture *out, restore_picture *precision, restore_picture *sigma,
                          uint8_t *doubt, core_pool *pool, brace_error *error) {
    const size_t width = out->width, height = out->height;
    size_t workers = (size_t)core_pool_threads(pool);
    fuse_job job = {views,
                    count,
                    reference,
                    pilot,
                    out,
                    precision,
                    sigma,
                    doubt,
                    core_alloc(workers * count * (2 * width + 4), sizeof(v4)),
                    core_alloc(height * count, sizeof(double))};
    brace_status status = BRACE_OK;
    if (!job.rows || !job.row_share) {
        status = core_fail_memory(error, workers * count * (2 * width + 4) * sizeof(v4), "fusing the frames");
    } else {
        core_parallel(pool, height, 8, fuse_rows, &job);
        double total = 0;
        for (size_t i = 0; i < count; i++) {
            views[i].weight = 0;
            for (size_t y = 0; y < height; y++)
                views[i].weight += job.row_share[y * count + i];
            total += views[i].weight;
        }
        for (size_t i = 0; i < count && total > 0; i++)
            views[i].weight /= total;
    }
    core_free(job.rows), core_free(job.row_share);
    return status;
}
