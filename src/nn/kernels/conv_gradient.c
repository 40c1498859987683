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

#define GRADIENT nn_gradient_plain
#include "nn/kernels/gradient_body.h"

enum { SLOTS = 32 };

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

/* The same numbers from each; chosen at the first call. */
static void pixels(const nn_gradient *g, size_t begin, size_t end, double *sums) {
#if defined(__x86_64__)
    static _Atomic int level = -1;
    if (level < 0) {
        core_cpu cpu = core_cpu_features();
        level = cpu.avx512 ? 2 : cpu.avx2 ? 1 : 0;
    }
    if (level > 0) {
        (level == 2 ? nn_gradient_avx512 : nn_gradient_avx2)(g, begin, end, sums);
        return;
    }
#endif
    nn_gradient_plain(g, begin, end, sums);
}

static void run_slots(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const nn_gradient *g = arg;
    size_t slots = slots_of(g->pixels), line = ((size_t)g->channels + 7) / 8 * 8;
    for (size_t slot = begin; slot < end; slot++) {
        double *sums = (double *)g->scratch + slot * line;
        memset(sums, 0, line * sizeof *sums);
        size_t first = slot * g->pixels / slots, last = (slot + 1) * g->pixels / slots;
        if (g->types.in != NN_F64) {
            pixels(g, first, last, sums);
            continue;
        }
        for (size_t p = first; p < last; p++) {
            pixel_f64(g, p * (size_t)g->channels, sums);
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
