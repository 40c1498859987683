/* SPDX-License-Identifier: Apache-2.0 */
/*
 * kernels_body.h: the loops of kernels.h, included by a file for each instruction
 * set, which says how many floats a register holds (LANES) and how many registers
 * of sums to keep (project: WIDE for each of four projections; convolve: two for
 * each of PIXELS pixels).
 */
#include <string.h>

#include "metrics/kernels.h"

typedef float vec __attribute__((vector_size(4 * LANES)));

static inline vec load(const float *p) {
    vec v;
    memcpy(&v, p, sizeof v);
    return v;
}

static inline void store(float *p, vec v) {
    memcpy(p, &v, sizeof v);
}

/* ---- MS-SWD: patches times projections ---- */

/* WIDE*LANES neighbouring patches: a row of 11 taps at a time, its weights broadcast. */
static inline void project_block(float out[METRICS_TOGETHER][WIDE * LANES], const float *in, size_t stride,
                                 size_t plane, const float *weights) {
    vec sum[METRICS_TOGETHER][WIDE];
#pragma GCC unroll 8
    for (int p = 0; p < METRICS_TOGETHER; p++) {
#pragma GCC unroll 8
        for (int v = 0; v < WIDE; v++) {
            sum[p][v] = (vec){0};
        }
    }
    for (int c = 0; c < 3; c++) {
        for (int dy = 0; dy < METRICS_PATCH; dy++) {
            const float *row = in + (size_t)c * plane + (size_t)dy * stride;
            for (int dx = 0; dx < METRICS_PATCH; dx++, weights += METRICS_TOGETHER) {
                vec x[WIDE];
#pragma GCC unroll 8
                for (int v = 0; v < WIDE; v++) {
                    x[v] = load(row + dx + v * LANES);
                }
#pragma GCC unroll 8
                for (int p = 0; p < METRICS_TOGETHER; p++) {
                    const vec w = weights[p] - (vec){0};
#pragma GCC unroll 8
                    for (int v = 0; v < WIDE; v++) {
                        sum[p][v] += w * x[v];
                    }
                }
            }
        }
    }
#pragma GCC unroll 8
    for (int p = 0; p < METRICS_TOGETHER; p++) {
#pragma GCC unroll 8
        for (int v = 0; v < WIDE; v++) {
            store(&out[p][v * LANES], sum[p][v]);
        }
    }
}

static void project(float *const out[METRICS_TOGETHER], size_t count, const float *in, size_t stride, size_t plane,
                    const float *weights) {
    enum { BLOCK = WIDE * LANES };
    _Static_assert((int)BLOCK <= (int)METRICS_PROJECT_MOST, "rows have this many floats to spare");
    float block[METRICS_TOGETHER][BLOCK];
    for (size_t x = 0; x < count; x += BLOCK) {
        size_t n = count - x < BLOCK ? count - x : BLOCK;
        project_block(block, in + x, stride, plane, weights);
        for (int p = 0; p < METRICS_TOGETHER; p++) {
            memcpy(out[p] + x, block[p], n * sizeof(float));
        }
    }
}

/* ---- convolution ---- */

/* PIXELS neighbouring pixels of two registers of channels: every input value is broadcast. Pixels are reached from
 * every third one, which leaves registers for the addresses. */
static inline void convolve_block(float out[PIXELS][2 * LANES], const metrics_convolution *c, const float *in,
                                  const float *weights, const float *bias) {
    const size_t step = c->stride * c->in, run = c->kernel * c->in;
    vec sum[PIXELS][2];
#pragma GCC unroll 12
    for (int p = 0; p < PIXELS; p++) {
        sum[p][0] = load(bias);
        sum[p][1] = load(bias + LANES);
    }
    /* The taps of a kernel's row lie one after another, as do their channels. */
    for (size_t ky = 0; ky < c->kernel; ky++) {
        const float *base[PIXELS / 3];
#pragma GCC unroll 4
        for (int b = 0; b < PIXELS / 3; b++) {
            base[b] = in + ky * c->in_row + 3 * (size_t)b * step;
        }
        for (size_t i = 0; i < run; i++, weights += 2 * LANES) {
            const vec w0 = load(weights), w1 = load(weights + LANES);
#pragma GCC unroll 4
            for (int b = 0; b < PIXELS / 3; b++) {
#pragma GCC unroll 3
                for (int k = 0; k < 3; k++) {
                    const vec x = base[b][(size_t)k * step] - (vec){0};
                    sum[3 * b + k][0] += x * w0;
                    sum[3 * b + k][1] += x * w1;
                }
                base[b]++;
            }
        }
    }
#pragma GCC unroll 12
    for (int p = 0; p < PIXELS; p++) {
        store(out[p], sum[p][0]);
        store(out[p] + LANES, sum[p][1]);
    }
}

static void convolve(const metrics_convolution *c, float *out, const float *in, size_t count, size_t block) {
    enum { CHANNELS = 2 * LANES };
    _Static_assert(PIXELS <= METRICS_PIXELS_MOST && (int)CHANNELS <= (int)METRICS_CHANNELS_MOST, "buffer sizes");
    const float *weights = c->weights + block * c->kernel * c->kernel * c->in * CHANNELS;
    const size_t first = block * CHANNELS, channels = c->out - first < CHANNELS ? c->out - first : CHANNELS;
    float sums[PIXELS][CHANNELS];
    for (size_t x = 0; x < count; x += PIXELS) {
        convolve_block(sums, c, in + x * c->stride * c->in, weights, c->bias + first);
        for (size_t p = 0; p < PIXELS && x + p < count; p++) {
            float *to = out + (x + p) * c->out_pixel + first;
            for (size_t k = 0; k < channels; k++) {
                to[k] = c->relu && !(sums[p][k] > 0) ? 0 : sums[p][k];
            }
        }
    }
}

const metrics_kernels METRICS_KERNELS = {project, convolve, 2 * LANES};
