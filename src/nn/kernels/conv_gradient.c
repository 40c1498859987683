/* SPDX-License-Identifier: Apache-2.0 */
/*
 * conv_gradient.c: what backward needs before the products: the gradient at the
 * sums (dz = dy act'(y)), and its sums over the pixels, which are the bias's.
 *
 * The pixels are cut into a fixed number of slots, each summed by itself and the
 * slots in order: the same bytes for any number of threads.
 */
#include <string.h>

#include "nn/kernels/kernels.h"
#include "nn/node.h"

enum { SLOTS = 32, LINE = 64 };

static size_t slots_of(size_t pixels) {
    size_t slots = (pixels + 255) / 256;
    return slots < 1 ? 1 : slots > SLOTS ? SLOTS : slots;
}

size_t nn_gradient_scratch(size_t pixels, int channels) {
    return slots_of(pixels) * (((size_t)channels + 7) / 8 * 8) * sizeof(double);
}

static inline double derivative(double y, nn_activation activation) {
    switch (activation) {
    case NN_LINEAR:
        break;
    case NN_RELU:
        return y > 0 ? 1 : 0;
    case NN_LEAKY_RELU:
        return y > 0 ? 1 : 0.1;
    case NN_SIGMOID:
        return y * (1 - y);
    case NN_TANH:
        return 1 - y * y;
    }
    return 1;
}

static inline void load(float *to, const void *from, size_t at, size_t count, nn_type type) {
    if (type == NN_BF16) {
        const uint16_t *v = (const uint16_t *)from + at;
        for (size_t i = 0; i < count; i++) {
            to[i] = nn_from_bf16(v[i]);
        }
    } else {
        memcpy(to, (const float *)from + at, count * sizeof *to);
    }
}

static inline void store(void *to, size_t at, const float *from, size_t count, nn_type type, bool add) {
    if (type == NN_BF16) {
        uint16_t *v = (uint16_t *)to + at;
        for (size_t i = 0; i < count; i++) {
            v[i] = nn_to_bf16(add ? from[i] + nn_from_bf16(v[i]) : from[i]);
        }
    } else {
        float *v = (float *)to + at;
        for (size_t i = 0; i < count; i++) {
            v[i] = add ? v[i] + from[i] : from[i];
        }
    }
}

/* One pixel in pieces of at most LINE channels. */
static void pixel_f32(const nn_gradient *g, size_t at, double *sums) {
    float dz[LINE], y[LINE];
    for (size_t c = 0; c < (size_t)g->channels; c += LINE) {
        size_t count = (size_t)g->channels - c < LINE ? (size_t)g->channels - c : LINE;
        load(dz, g->dy, at + c, count, g->types.result);
        if (g->activation == NN_RELU) {
            load(y, g->y, at + c, count, g->types.result);
            for (size_t i = 0; i < count; i++) {
                dz[i] = y[i] > 0 ? dz[i] : 0;
            }
        } else if (g->activation == NN_LEAKY_RELU) {
            load(y, g->y, at + c, count, g->types.result);
            for (size_t i = 0; i < count; i++) {
                dz[i] = y[i] > 0 ? dz[i] : 0.1f * dz[i];
            }
        } else if (g->activation != NN_LINEAR) {
            load(y, g->y, at + c, count, g->types.result);
            for (size_t i = 0; i < count; i++) {
                dz[i] = (float)((double)dz[i] * derivative((double)y[i], g->activation));
            }
        }
        if (g->dz != NULL) {
            store(g->dz, at + c, dz, count, g->types.in, false);
        }
        if (g->residual != NULL) {
            store(g->residual, at + c, dz, count, g->types.result, g->add_residual);
        }
        if (g->dbias != NULL) {
            for (size_t i = 0; i < count; i++) {
                sums[c + i] += (double)dz[i];
            }
        }
    }
}

static void pixel_f64(const nn_gradient *g, size_t at, double *sums) {
    const double *dy = (const double *)g->dy + at, *y = (const double *)g->y;
    double *dz = g->dz, *residual = g->residual;
    for (size_t c = 0; c < (size_t)g->channels; c++) {
        double v = g->activation == NN_LINEAR ? dy[c] : dy[c] * derivative(y[at + c], g->activation);
        if (dz != NULL) {
            dz[at + c] = v;
        }
        if (residual != NULL) {
            residual[at + c] = g->add_residual ? residual[at + c] + v : v;
        }
        sums[c] += v;
    }
}

static void run_slots(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const nn_gradient *g = arg;
    size_t slots = slots_of(g->pixels), line = ((size_t)g->channels + 7) / 8 * 8;
    for (size_t slot = begin; slot < end; slot++) {
        double *sums = (double *)g->scratch + slot * line;
        memset(sums, 0, line * sizeof *sums);
        size_t last = (slot + 1) * g->pixels / slots;
        for (size_t p = slot * g->pixels / slots; p < last; p++) {
            if (g->types.in == NN_F64) {
                pixel_f64(g, p * (size_t)g->channels, sums);
            } else {
                pixel_f32(g, p * (size_t)g->channels, sums);
            }
        }
    }
}

void nn_gradient_run(const nn_gradient *g) {
    nn_gradient copy = *g;
    size_t slots = slots_of(g->pixels), line = ((size_t)g->channels + 7) / 8 * 8;
    core_parallel(g->pool, slots, 1, run_slots, &copy);
    for (size_t c = 0; c < (size_t)g->channels && g->dbias != NULL; c++) {
        double sum = 0;
        for (size_t slot = 0; slot < slots; slot++) {
            sum += ((const double *)g->scratch)[slot * line + c];
        }
        if (g->types.in == NN_F64) {
            ((double *)g->dbias)[c] += sum;
        } else {
            ((float *)g->dbias)[c] += (float)sum;
        }
    }
}
