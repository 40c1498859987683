/* SPDX-License-Identifier: Apache-2.0 */
/*
 * kernels.h: the two inner loops in which the metrics spend their time, compiled
 * once for every instruction set (kernels_body.h).
 *
 * They multiply and add in one order everywhere; where there is a fused
 * multiply-add it is used, so that results differ between instruction sets in the
 * last bits of a float, but never with the number of threads.
 */
#ifndef METRICS_KERNELS_H
#define METRICS_KERNELS_H

#include "core/core.h"

enum {
    METRICS_PATCH = 11,        /* side of MS-SWD's patches */
    METRICS_TOGETHER = 4,      /* projections computed at once */
    METRICS_PROJECT_MOST = 96, /* floats behind a row that `project` may read */
    METRICS_PIXELS_MOST = 12,  /* pixels that `convolve` computes at once, at most */
    METRICS_CHANNELS_MOST = 32 /* channels that `convolve` computes at once, at most */
};

/* A convolution over pixels whose channels lie together. The input is padded already. */
typedef struct metrics_convolution {
    const float *weights; /* [block][ky][kx][in][channels of a block], 0 for channels that there aren't */
    const float *bias;    /* one for each channel of all blocks */
    size_t kernel, stride;
    size_t in, out;   /* channels */
    size_t in_row;    /* floats from one row to the next */
    size_t out_pixel; /* floats from one pixel to the next */
    bool relu;
} metrics_convolution;

typedef struct metrics_kernels {
    /* Four projections of the `count` patches that begin at in[0], in[1], ...: rows `stride` floats apart, three
     * planes `plane` floats apart. weights[c][dy][dx][4]. */
    void (*project)(float *const out[METRICS_TOGETHER], size_t count, const float *in, size_t stride, size_t plane,
                    const float *weights);
    /* The pixels of one row, `count` of them, and one block of channels. Reads METRICS_PIXELS_MOST pixels too far. */
    void (*convolve)(const metrics_convolution *c, float *out, const float *in, size_t count, size_t block);
    size_t channels; /* of a block */
} metrics_kernels;

extern const metrics_kernels metrics_kernels_plain, metrics_kernels_avx2, metrics_kernels_avx512;

static inline const metrics_kernels *metrics_kernels_for(core_cpu cpu) {
#if defined(__x86_64__)
    return cpu.avx512 ? &metrics_kernels_avx512 : cpu.avx2 ? &metrics_kernels_avx2 : &metrics_kernels_plain;
#else
    (void)cpu;
    return &metrics_kernels_plain;
#endif
}

#endif
