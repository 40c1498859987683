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
 */
#include <math.h>
#include <string.h>

#include "restore/internal.h"

typedef struct fuse_job {
    restore_view *views;
    size_t count, reference;
    const restore_picture *pilot;
    restore_picture *out, *precision;
    uint8_t *doubt;
    v4 *rows;          /* for each worker and view: gains, and light without them */
    double *row_share; /* height*count */
} fuse_job;

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
            v4 noise[BRACE_BRACKET_MAX];
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
            v4 value, precision;
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
            }
            doubt = sqrtf(doubt) / RESTORE_DOUBT;
            job->doubt[k] = (uint8_t)(doubt < 255 ? doubt : 255);
            job->out->at[k] = value;
            job->precision->at[k] = precision;
        }
        memcpy(job->row_share + y * count, share, count * sizeof(double));
    }
}

brace_status restore_fuse(restore_view *views, size_t count, size_t reference, const restore_picture *pilot,
                          restore_picture *out, restore_picture *precision, uint8_t *doubt, core_pool *pool,
                          brace_error *error) {
    const size_t width = out->width, height = out->height;
    size_t workers = (size_t)core_pool_threads(pool);
    fuse_job job = {views,
                    count,
                    reference,
                    pilot,
                    out,
                    precision,
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
