/* SPDX-License-Identifier: Apache-2.0 */
/*
 * perceptual.h: LPIPS and DISTS: two pictures go through the same network, and
 * their features are compared at some of its layers. Internal.
 *
 * Thread safety: a metric that was created is only read.
 */
#ifndef METRICS_PERCEPTUAL_H
#define METRICS_PERCEPTUAL_H

#include "brace/metrics.h"
#include "core/core.h"
#include "metrics/kernels.h"

/* ---- feature maps and what is done to them (conv.c) ---- */

/* Channels of a pixel together, rows first, with a border of zeros. */
typedef struct metrics_map {
    size_t width, height, channels, border;
    float *memory;
} metrics_map;

/* Its border is zero, the rest is not set. False: no memory. */
bool metrics_map_create(metrics_map *map, size_t width, size_t height, size_t channels, size_t border);
void metrics_map_free(metrics_map *map);

static inline float *metrics_map_at(const metrics_map *map, size_t x, size_t y) {
    return map->memory + ((y + map->border) * (map->width + 2 * map->border) + x + map->border) * map->channels;
}

typedef struct metrics_weights {
    float *values, *bias; /* packed for the kernels of this processor */
    size_t kernel, stride, pad, in, out;
} metrics_weights;

/* From PyTorch's order, [out][in][ky][kx]. False: no memory. */
bool metrics_weights_pack(metrics_weights *packed, const metrics_kernels *kernels, const float *values,
                          const float *bias);
void metrics_weights_free(metrics_weights *weights);

/* Convolution and ReLU into the channels of `out` from `channel` on; `out` has metrics_convolved(...) pixels a side. */
void metrics_convolve(const metrics_map *out, size_t channel, const metrics_map *in, const metrics_weights *weights,
                      const metrics_kernels *kernels, core_pool *pool);
size_t metrics_convolved(size_t size, const metrics_weights *weights);

/* Maximum of kernel x kernel pixels, every `stride`; windows that reach over the end only with `ceil`. */
void metrics_max_pool(const metrics_map *out, const metrics_map *in, size_t kernel, size_t stride, core_pool *pool);
size_t metrics_max_pooled(size_t size, size_t kernel, size_t stride, bool ceil);

/* sqrt(1e-12 + [1 2 1] x [1 2 1] / 16 filtered squares), every second pixel. */
void metrics_l2_pool(const metrics_map *out, const metrics_map *in, core_pool *pool);

/* ---- networks and their weights (network.c) ---- */

enum { METRICS_TAPS = 7, METRICS_CHANNELS = 512, METRICS_LAYERS = 20 }; /* of a network, at most */

typedef enum metrics_layer_kind {
    METRICS_LAYER_END = 0,
    METRICS_LAYER_CONV,
    METRICS_LAYER_FIRE,
    METRICS_LAYER_MAX,
    METRICS_LAYER_L2
} metrics_layer_kind;

typedef struct metrics_layer {
    metrics_layer_kind kind;
    int number; /* of the layer in torchvision's `features` */
    size_t kernel, stride, pad, in, out;
    size_t squeeze; /* channels of a fire module between its convolutions; `out` is both halves */
    bool tap;
} metrics_layer;

typedef struct metrics_network {
    const char *name;
    const metrics_layer *layers; /* ends with METRICS_LAYER_END */
    size_t border;               /* the widest padding */
    bool ceil;                   /* of the pools */
} metrics_network;

typedef struct metrics_layer_weights {
    metrics_weights conv; /* or a fire module's 3x3 half */
    metrics_weights squeeze, expand;
} metrics_layer_weights;

struct brace_perceptual {
    brace_perceptual_kind kind;
    const metrics_network *network;
    const metrics_kernels *kernels;
    metrics_layer_weights weights[METRICS_LAYERS];
    float *head[METRICS_TAPS];         /* LPIPS */
    float *alpha, *beta;               /* DISTS: one after another for all stages */
    size_t channels[METRICS_TAPS + 1]; /* of the taps; DISTS begins with the picture's 3 */
    size_t taps;
};

/* Gives `count` numbers of the tensor `name` of the shape out, in, kernel, kernel (0: rank 1). */
typedef brace_status metrics_tensor_fn(void *arg, float *values, const char *name, const size_t shape[4],
                                       brace_error *error);
brace_status metrics_perceptual_create(brace_perceptual **out, brace_perceptual_kind kind, metrics_tensor_fn *tensor,
                                       void *arg, brace_error *error);

/* ---- the metrics (perceptual.c) ---- */

/* As brace_perceptual_distance, in tiles of this size (a multiple of 16; 0: as large as memory should be). */
brace_status metrics_perceptual_distance(double *out, const brace_perceptual *metric, const brace_image *a,
                                         const brace_image *b, size_t tile, const brace_job *job, brace_error *error);

#endif
