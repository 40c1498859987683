/* SPDX-License-Identifier: Apache-2.0 */
/*
 * conv.c: the few operations that LPIPS and DISTS need of a network, forward only:
 * convolution with ReLU, and two kinds of pooling. Rows are dealt out to the pool.
 */
#include <math.h>
#include <string.h>

#include "metrics/perceptual.h"

bool metrics_map_create(metrics_map *map, size_t width, size_t height, size_t channels, size_t border) {
    *map = (metrics_map){width, height, channels, border, NULL};
    /* The kernels read some pixels too far, up to four apart. */
    const size_t row = (width + 2 * border) * channels, slack = (size_t)METRICS_PIXELS_MOST * 4 * channels;
    map->memory = core_alloc(row * (height + 2 * border) + slack, sizeof *map->memory);
    if (map->memory == NULL) {
        return false;
    }
    memset(map->memory, 0, border * row * sizeof(float));
    memset(map->memory + (border + height) * row, 0, (border * row + slack) * sizeof(float));
    for (size_t y = 0; y < height && border > 0; y++) {
        float *begin = map->memory + (border + y) * row;
        memset(begin, 0, border * channels * sizeof(float));
        memset(begin + (border + width) * channels, 0, border * channels * sizeof(float));
    }
    return true;
}

void metrics_map_free(metrics_map *map) {
    core_free(map->memory);
    map->memory = NULL;
}

/* Rows a piece: some, so that weights are used more than once, but enough pieces for all workers. */
static size_t grain_for(size_t rows, const core_pool *pool) {
    size_t grain = rows / (4 * (size_t)core_pool_threads(pool));
    return grain < 1 ? 1 : grain > 8 ? 8 : grain;
}

/* ---- convolution ---- */

bool metrics_weights_pack(metrics_weights *packed, const metrics_kernels *kernels, const float *values,
                          const float *bias) {
    const size_t in = packed->in, out = packed->out, taps = packed->kernel * packed->kernel, lanes = kernels->channels;
    const size_t blocks = (out + lanes - 1) / lanes;
    packed->values = core_calloc(blocks * lanes * in * taps, sizeof(float));
    packed->bias = core_calloc(blocks * lanes, sizeof(float));
    if (packed->values == NULL || packed->bias == NULL) {
        return false;
    }
    for (size_t o = 0; o < out; o++) {
        float *to = packed->values + o / lanes * lanes * in * taps + o % lanes;
        packed->bias[o] = bias[o];
        for (size_t t = 0; t < taps; t++) {
            for (size_t i = 0; i < in; i++) {
                to[(t * in + i) * lanes] = values[(o * in + i) * taps + t];
            }
        }
    }
    return true;
}

void metrics_weights_free(metrics_weights *weights) {
    core_free(weights->values);
    core_free(weights->bias);
    weights->values = weights->bias = NULL;
}

size_t metrics_convolved(size_t size, const metrics_weights *w) {
    return size + 2 * w->pad < w->kernel ? 0 : (size + 2 * w->pad - w->kernel) / w->stride + 1;
}

typedef struct convolve_run {
    const metrics_map *out, *in;
    const metrics_kernels *kernels;
    metrics_convolution c;
    size_t channel, pad;
} convolve_run;

static void convolve_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const convolve_run *run = arg;
    const size_t blocks = (run->c.out + run->kernels->channels - 1) / run->kernels->channels;
    for (size_t b = 0; b < blocks; b++) {
        for (size_t y = begin; y < end; y++) {
            /* From the border's pixels that the padding takes; rows y and pixels x are `stride` apart. */
            const float *in = metrics_map_at(run->in, 0, 0) + y * run->c.stride * run->c.in_row -
                              run->pad * (run->c.in_row + run->c.in);
            run->kernels->convolve(&run->c, metrics_map_at(run->out, 0, y) + run->channel, in, run->out->width, b);
        }
    }
}

void metrics_convolve(const metrics_map *out, size_t channel, const metrics_map *in, const metrics_weights *w,
                      const metrics_kernels *kernels, core_pool *pool) {
    convolve_run run = {.out = out,
                        .in = in,
                        .kernels = kernels,
                        .channel = channel,
                        .pad = w->pad,
                        .c = {.weights = w->values,
                              .bias = w->bias,
                              .kernel = w->kernel,
                              .stride = w->stride,
                              .in = w->in,
                              .out = w->out,
                              .in_row = (in->width + 2 * in->border) * in->channels,
                              .out_pixel = out->channels,
                              .relu = true}};
    core_parallel(pool, out->height, grain_for(out->height, pool), convolve_rows, &run);
}

/* ---- pooling ---- */

typedef struct pool_run {
    const metrics_map *out, *in;
    size_t kernel, stride;
} pool_run;

size_t metrics_max_pooled(size_t size, size_t kernel, size_t stride, bool ceil) {
    if (size < kernel) {
        return ceil && size > 0 ? 1 : 0;
    }
    size_t n = (size - kernel + (ceil ? stride - 1 : 0)) / stride + 1;
    return (n - 1) * stride < size ? n : n - 1; /* windows begin inside */
}

static void max_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const pool_run *run = arg;
    const size_t channels = run->in->channels;
    for (size_t y = begin; y < end; y++) {
        for (size_t x = 0; x < run->out->width; x++) {
            float *to = metrics_map_at(run->out, x, y);
            memcpy(to, metrics_map_at(run->in, x * run->stride, y * run->stride), channels * sizeof *to);
            for (size_t j = y * run->stride; j < y * run->stride + run->kernel && j < run->in->height; j++) {
                for (size_t i = x * run->stride; i < x * run->stride + run->kernel && i < run->in->width; i++) {
                    const float *from = metrics_map_at(run->in, i, j);
                    for (size_t c = 0; c < channels; c++) {
                        to[c] = from[c] > to[c] ? from[c] : to[c];
                    }
                }
            }
        }
    }
}

void metrics_max_pool(const metrics_map *out, const metrics_map *in, size_t kernel, size_t stride, core_pool *pool) {
    pool_run run = {out, in, kernel, stride};
    core_parallel(pool, out->height, grain_for(out->height, pool), max_rows, &run);
}

static void l2_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const pool_run *run = arg;
    static const float tap[3] = {0.25f, 0.5f, 0.25f};
    const size_t channels = run->in->channels;
    for (size_t y = begin; y < end; y++) {
        for (size_t x = 0; x < run->out->width; x++) {
            float *to = metrics_map_at(run->out, x, y);
            for (size_t c = 0; c < channels; c++) {
                to[c] = 1e-12f;
            }
            for (size_t k = 0; k < 9; k++) { /* pixels -1 and n are zeros of the border */
                const float w = tap[k / 3] * tap[k % 3];
                const float *from = metrics_map_at(run->in, 2 * x + k % 3, 2 * y + k / 3) -
                                    (run->in->width + 2 * run->in->border + 1) * channels;
                for (size_t c = 0; c < channels; c++) {
                    to[c] += w * from[c] * from[c];
                }
            }
            for (size_t c = 0; c < channels; c++) {
                to[c] = sqrtf(to[c]);
            }
        }
    }
}

void metrics_l2_pool(const metrics_map *out, const metrics_map *in, core_pool *pool) {
    pool_run run = {out, in, 3, 2};
    core_parallel(pool, out->height, grain_for(out->height, pool), l2_rows, &run);
}
