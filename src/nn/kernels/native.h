/* SPDX-License-Identifier: Apache-2.0 */
/*
 * native.h: what the two halves of the native convolution share: native.c
 * (forward, and backward_data as a forward one) and native_weights.c.
 *
 * Channels last makes the taps of a row one run: the k c elements from pixel x on
 * are all that row i of the kernel needs there, and the next pixel's run begins
 * s c elements further. So a convolution is k products of matrices, one for each
 * row of taps, whose rows overlap in memory:
 *
 *     y[x, o] = sum_i sum_{t < k c} row_i[x s c + t] W_i[t, o]
 *
 * Nothing is unfolded, any k and s will do, and channels that do not fill a vector
 * cost nothing, because it is k c that is cut in steps. Where zeros are needed
 * around the picture, rows are first copied to a tile with a border, a tile being
 * so small that it stays in the second-level cache.
 */
#ifndef NN_KERNELS_NATIVE_H
#define NN_KERNELS_NATIVE_H

#include "nn/kernels/kernels.h"
#include "nn/node.h"

/* What a tile is cut from. */
typedef struct native_source {
    const void *data;
    nn_type type;
    int n, h, w, c;
    int dilate; /* pixel (y, x) stands at (dilate y, dilate x), with zeros between: backward of a stride */
} native_source;

typedef struct native_state {
    const nn_isa *isa;
    nn_conv_shape shape;
    nn_conv_types types;
    struct {
        void *weights;       /* NULL: not wanted */
        unsigned version;
        const void *made_of; /* NULL: not yet packed */
    } packed[2];             /* forward, backward_data */
} native_state;

static inline size_t native_round_up(size_t v, size_t multiple) {
    return (v + multiple - 1) / multiple * multiple;
}
static inline int native_ceil(int a, int b) {
    return (a + b - 1) / b;
}
static inline size_t native_element(const nn_isa *isa) {
    return isa->in == NN_BF16 ? 2 : 4;
}

/* Copies pixels x .. x + pixels of row y of picture n, which may lie outside (zeros), and fills up to `elements` with
 * zeros. `out` is of isa->in type, one of f32 and bf16; the source too. */
void native_copy_row(void *out, nn_type to, const native_source *from, int n, int y, int x, int pixels,
                     size_t elements);

#endif
