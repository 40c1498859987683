/* SPDX-License-Identifier: Apache-2.0 */
/*
 * perceptual.c: LPIPS and DISTS.
 *
 * LPIPS: features of every tapped layer, scaled to length 1 at each position; the
 * squared differences weighted by channel and averaged over positions; summed over layers.
 * DISTS: of every channel of every layer, the means (S1, texture) and the covariance
 * (S2, structure) of both pictures over all positions; 1 - sum(alpha S1 + beta S2).
 *
 * Both are sums over positions, so that large pictures are worked on in tiles: each is
 * computed with as many pixels around it as the network looks at, and its own positions
 * are added up.
 */
#include "metrics/perceptual.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "image/image.h"
#include "metrics/metrics.h"

enum {
    TAPS = METRICS_TAPS,
    CHANNELS = METRICS_CHANNELS,
    HALO = 112,          /* pixels: half of what the last layer of any of the networks looks at, and to spare */
    TILE = 800,          /* own pixels of a tile, which has 1024 with its halo */
    STRIDE = 16,         /* pixels between two positions of the last layer: tiles begin at multiples */
    WHOLE = 1024 * 1024, /* pixels of a picture that is one tile */
    SMALLEST = 32,
    ROWS = 16 /* summed as one piece */
};

/* ---- sums over positions ---- */

/* What DISTS sums up for a channel. */
enum { SUM_X, SUM_Y, SUM_XX, SUM_YY, SUM_XY, SUMS };

typedef struct perceptual_run {
    const brace_perceptual *metric;
    core_pool *pool;
    const brace_job *job;
    brace_image *picture[2];
    metrics_map map[2];
    size_t x0, y0, x1, y1;           /* this tile's own pixels */
    size_t left, top;                /* where its halo begins */
    double (*sums)[SUMS * CHANNELS]; /* of each piece of rows, while a layer is looked at */
    size_t piece_room;
    /* Results: LPIPS in the first of SUMS, and of the channels. */
    double total[TAPS][SUMS][CHANNELS];
    double positions[TAPS];
    int bad;
    /* Of the layer that is looked at: */
    size_t tap, begin_x, end_x, begin_y, end_y;
} perceptual_run;

static double lpips_position(const float *a, const float *b, const float *weight, size_t channels) {
    double aa = 0, bb = 0, sum = 0;
    for (size_t c = 0; c < channels; c++) {
        aa += (double)a[c] * (double)a[c];
        bb += (double)b[c] * (double)b[c];
    }
    const double ia = 1 / (sqrt(aa) + 1e-10), ib = 1 / (sqrt(bb) + 1e-10);
    for (size_t c = 0; c < channels; c++) {
        double d = (double)a[c] * ia - (double)b[c] * ib;
        sum += (double)weight[c] * d * d;
    }
    return sum;
}

static void sum_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const perceptual_run *run = arg;
    const size_t channels = run->metric->channels[run->tap];
    for (size_t piece = begin; piece < end; piece++) {
        double *s = run->sums[piece];
        memset(s, 0, SUMS * CHANNELS * sizeof *s);
        const size_t first = run->begin_y + piece * ROWS;
        for (size_t y = first; y < first + ROWS && y < run->end_y; y++) {
            for (size_t x = run->begin_x; x < run->end_x; x++) {
                const float *a = metrics_map_at(&run->map[0], x, y), *b = metrics_map_at(&run->map[1], x, y);
                if (run->metric->kind != BRACE_DISTS) {
                    s[0] += lpips_position(a, b, run->metric->head[run->tap], channels);
                    continue;
                }
                for (size_t c = 0; c < channels; c++) {
                    const double u = (double)a[c], v = (double)b[c];
                    s[SUM_X * CHANNELS + c] += u;
                    s[SUM_Y * CHANNELS + c] += v;
                    s[SUM_XX * CHANNELS + c] += u * u;
                    s[SUM_YY * CHANNELS + c] += v * v;
                    s[SUM_XY * CHANNELS + c] += u * v;
                }
            }
        }
    }
}

/* Adds this tile's own positions of a layer whose positions are `stride` pixels apart. */
static brace_status add_positions(perceptual_run *run, size_t tap, size_t stride, brace_error *error) {
    const metrics_map *map = &run->map[0];
    run->tap = tap;
    run->begin_x = (run->x0 - run->left) / stride;
    run->begin_y = (run->y0 - run->top) / stride;
    /* The last tiles also have what rounding leaves over. Before a narrow last one a map may end early: positions at the
     * picture's edge are fewer than its pixels divided by the stride. */
    run->end_x = run->x1 == run->picture[0]->width ? map->width : (run->x1 - run->left) / stride;
    run->end_y = run->y1 == run->picture[0]->height ? map->height : (run->y1 - run->top) / stride;
    run->end_x = run->end_x < map->width ? run->end_x : map->width;
    run->end_y = run->end_y < map->height ? run->end_y : map->height;
    if (run->end_x <= run->begin_x || run->end_y <= run->begin_y) {
        return BRACE_OK;
    }
    const size_t pieces = (run->end_y - run->begin_y + ROWS - 1) / ROWS;
    if (pieces > run->piece_room) {
        core_free(run->sums);
        run->piece_room = 0;
        run->sums = core_alloc(pieces, sizeof *run->sums);
        if (run->sums == NULL) {
            return core_fail_memory(error, pieces * sizeof *run->sums, "comparing features");
        }
        run->piece_room = pieces;
    }
    core_parallel(run->pool, pieces, 1, sum_rows, run);
    for (size_t p = 0; p < pieces; p++) {
        for (size_t s = 0; s < SUMS; s++) {
            for (size_t c = 0; c < run->metric->channels[tap]; c++) {
                run->total[tap][s][c] += run->sums[p][s * CHANNELS + c];
            }
        }
    }
    run->positions[tap] += (double)(run->end_x - run->begin_x) * (double)(run->end_y - run->begin_y);
    return BRACE_OK;
}

/* ---- one tile through the network ---- */

/* The tile of one picture with its halo; normalised for the network unless `plain`. */
static bool take_tile(perceptual_run *run, int k, bool plain) {
    /* Both metrics subtract the mean and divide by the deviation of ImageNet's channels; LPIPS says so in rounded
     * numbers, for values from -1 to 1. */
    static const float mean[2][3] = {{0.485f, 0.456f, 0.406f}, {-0.030f, -0.088f, -0.188f}},
                       deviation[2][3] = {{0.229f, 0.224f, 0.225f}, {0.458f, 0.448f, 0.450f}};
    const int lpips = run->metric->kind != BRACE_DISTS;
    const brace_image *in = run->picture[k];
    const size_t right = run->x1 + HALO < in->width ? run->x1 + HALO : in->width;
    const size_t bottom = run->y1 + HALO < in->height ? run->y1 + HALO : in->height;
    metrics_map *map = &run->map[k];
    if (!metrics_map_create(map, right - run->left, bottom - run->top, 3, run->metric->network->border)) {
        return false;
    }
    for (size_t y = 0; y < map->height; y++) {
        const float *p = (const float *)(const void *)image_row(in, (uint32_t)(run->top + y)) + 3 * run->left;
        float *to = metrics_map_at(map, 0, y);
        for (size_t i = 0; i < 3 * map->width; i++) {
            if (!isfinite(p[i])) {
                run->bad = 1;
            }
            float v = lpips ? 2 * p[i] - 1 : p[i];
            to[i] = plain ? p[i] : (v - mean[lpips][i % 3]) / deviation[lpips][i % 3];
        }
    }
    return true;
}

static bool run_layer(perceptual_run *run, int k, const metrics_layer *y, const metrics_layer_weights *w) {
    const brace_perceptual *m = run->metric;
    metrics_map in = run->map[k], out = {0}, narrow = {0};
    const size_t border = m->network->border;
    bool good = false;
    switch (y->kind) {
    case METRICS_LAYER_CONV:
        good = metrics_map_create(&out, metrics_convolved(in.width, &w->conv), metrics_convolved(in.height, &w->conv),
                                  y->out, border);
        if (good) {
            metrics_convolve(&out, 0, &in, &w->conv, m->kernels, run->pool);
        }
        break;
    case METRICS_LAYER_FIRE:
        good = metrics_map_create(&narrow, in.width, in.height, y->squeeze, border) &&
               metrics_map_create(&out, in.width, in.height, y->out, border);
        if (good) {
            metrics_convolve(&narrow, 0, &in, &w->squeeze, m->kernels, run->pool);
            metrics_convolve(&out, 0, &narrow, &w->expand, m->kernels, run->pool);
            metrics_convolve(&out, y->out / 2, &narrow, &w->conv, m->kernels, run->pool);
        }
        metrics_map_free(&narrow);
        break;
    case METRICS_LAYER_MAX:
        good = metrics_map_create(&out, metrics_max_pooled(in.width, y->kernel, y->stride, m->network->ceil),
                                  metrics_max_pooled(in.height, y->kernel, y->stride, m->network->ceil), in.channels,
                                  border);
        if (good) {
            metrics_max_pool(&out, &in, y->kernel, y->stride, run->pool);
        }
        break;
    case METRICS_LAYER_L2:
        good = metrics_map_create(&out, (in.width + 1) / 2, (in.height + 1) / 2, in.channels, border);
        if (good) {
            metrics_l2_pool(&out, &in, run->pool);
        }
        break;
    case METRICS_LAYER_END:
        break;
    }
    metrics_map_free(&in);
    run->map[k] = out;
    return good;
}

static brace_status run_tile(perceptual_run *run, brace_error *error) {
    const brace_perceptual *m = run->metric;
    const metrics_layer *layers = m->network->layers;
    size_t tap = 0, stride = 1;
    brace_status status = BRACE_OK;
    run->left = run->x0 > HALO ? run->x0 - HALO : 0;
    run->top = run->y0 > HALO ? run->y0 - HALO : 0;
    for (int plain = m->kind == BRACE_DISTS; plain >= 0 && status == BRACE_OK; plain--) {
        metrics_map_free(&run->map[0]);
        metrics_map_free(&run->map[1]);
        if (!take_tile(run, 0, plain) || !take_tile(run, 1, plain)) {
            status = core_fail_memory(error, TILE * TILE * sizeof(float), "comparing features");
        } else if (run->bad) {
            status = core_fail(error, BRACE_ERROR_ARGUMENT, "a picture to be compared holds infinite values or NaN");
        } else if (plain) {
            status = add_positions(run, tap++, 1, error);
        }
    }
    for (int i = 0; layers[i].kind != METRICS_LAYER_END && status == BRACE_OK; i++) {
        for (int k = 0; k < 2 && status == BRACE_OK; k++) {
            if (!run_layer(run, k, &layers[i], &m->weights[i])) {
                status = core_fail_memory(error, (size_t)1 << 28, "the features of a picture");
            }
        }
        stride *= layers[i].stride;
        if (layers[i].tap && status == BRACE_OK) {
            status = add_positions(run, tap++, stride, error);
        }
        if (status == BRACE_OK) {
            status = core_check_cancel(run->job, error);
        }
    }
    metrics_map_free(&run->map[0]);
    metrics_map_free(&run->map[1]);
    return status;
}

/* ---- the distances ---- */

static double lpips(const perceptual_run *run) {
    double sum = 0;
    for (size_t t = 0; t < run->metric->taps; t++) {
        sum += run->total[t][0][0] / run->positions[t];
    }
    return sum;
}

static double dists(const perceptual_run *run) {
    const brace_perceptual *m = run->metric;
    const double c1 = 1e-6, c2 = 1e-6;
    double weights = 0, sum = 0;
    size_t at = 0;
    for (size_t t = 0; t < m->taps; t++) {
        const double n = run->positions[t];
        for (size_t c = 0; c < m->channels[t]; c++, at++) {
            const double x = run->total[t][SUM_X][c] / n, y = run->total[t][SUM_Y][c] / n;
            const double xx = fmax(run->total[t][SUM_XX][c] / n - x * x, 0),
                         yy = fmax(run->total[t][SUM_YY][c] / n - y * y, 0), xy = run->total[t][SUM_XY][c] / n - x * y;
            sum += (double)m->alpha[at] * (2 * x * y + c1) / (x * x + y * y + c1);
            sum += (double)m->beta[at] * (2 * xy + c2) / (xx + yy + c2);
            weights += (double)m->alpha[at] + (double)m->beta[at];
        }
    }
    return 1 - sum / weights;
}

/* The side of a tile's own pixels along a side of the picture, when a tile has so many along the other. */
static size_t tile_side(size_t side, size_t other) {
    const size_t reach = other < 1024 ? other : 1024, most = WHOLE / reach;
    return side <= most ? side : (most - 2 * HALO) / STRIDE * STRIDE;
}

static brace_status run_tiles(perceptual_run *run, size_t tile, brace_error *error) {
    const size_t width = run->picture[0]->width, height = run->picture[0]->height;
    const size_t step_x = tile > 0 ? tile : tile_side(width, height),
                 step_y = tile > 0 ? tile : tile_side(height, width);
    const uint64_t total = (uint64_t)((width + step_x - 1) / step_x) * ((height + step_y - 1) / step_y);
    uint64_t done = 0;
    brace_status status = BRACE_OK;
    for (run->y0 = 0; run->y0 < height && status == BRACE_OK; run->y0 = run->y1) {
        run->y1 = height - run->y0 > step_y ? run->y0 + step_y : height;
        for (run->x0 = 0; run->x0 < width && status == BRACE_OK; run->x0 = run->x1) {
            run->x1 = width - run->x0 > step_x ? run->x0 + step_x : width;
            status = run_tile(run, error);
            core_progress(run->job, brace_perceptual_name(run->metric->kind), ++done, total);
        }
    }
    return status;
}

brace_status metrics_perceptual_distance(double *out, const brace_perceptual *metric, const brace_image *a,
                                         const brace_image *b, size_t tile, const brace_job *job, brace_error *error) {
    perceptual_run *run = core_calloc(1, sizeof *run);
    if (run == NULL) {
        return core_fail_memory(error, sizeof *run, "comparing features");
    }
    run->metric = metric;
    run->job = job;
    brace_status status = metrics_take(run->picture, a, b, error);
    if (status == BRACE_OK && (run->picture[0]->width < SMALLEST || run->picture[0]->height < SMALLEST)) {
        status =
            core_fail(error, BRACE_ERROR_ARGUMENT,
                      "the pictures are too small for %s: %u x %u pixels, at least %d a side are needed",
                      brace_perceptual_name(metric->kind), run->picture[0]->width, run->picture[0]->height, SMALLEST);
    }
    if (status == BRACE_OK) {
        status = core_pool_create(&run->pool, job, error);
    }
    if (status == BRACE_OK) {
        status = run_tiles(run, tile, error);
    }
    if (status == BRACE_OK) {
        double distance = metric->kind == BRACE_DISTS ? dists(run) : lpips(run);
        if (isfinite(distance)) {
            *out = distance;
        } else {
            status = core_fail(error, BRACE_ERROR_ARGUMENT,
                               "the weights of %s give no number for these pictures; are they the published ones?",
                               brace_perceptual_name(metric->kind));
        }
    }
    core_pool_destroy(run->pool);
    brace_image_destroy(run->picture[0]);
    brace_image_destroy(run->picture[1]);
    core_free(run->sums);
    core_free(run);
    return status;
}

brace_status brace_perceptual_distance(double *out, const brace_perceptual *metric, const brace_image *a,
                                       const brace_image *b, const brace_job *job, brace_error *error) {
    return metrics_perceptual_distance(out, metric, a, b, 0, job, error);
}
