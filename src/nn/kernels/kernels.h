/* SPDX-License-Identifier: Apache-2.0 */
/*
 * kernels.h: convolutions, each way of computing one behind the same table.
 *
 * A method computes the three passes of y = act(conv(x, W) + bias + residual) for
 * one shape, all tensors channels last:
 *
 *     forward           y[p, o]        = act(sum_{i,j,c} x[s p + (i, j) - pad, c] W[o, c, i, j] + bias[o] + r[p, o])
 *     backward_data     dx[q, c]       = sum_{o, i, j} dz[p, o] W[o, c, i, j],   q = s p + (i, j) - pad
 *     backward_weights  dW[o, c, i, j] += sum_p x[s p + (i, j) - pad, c] dz[p, o]
 *
 * where dz = dy act'(y) is the caller's business, and so are the gradients of the
 * bias and of the residual (conv_gradient.c). What no method does: groups, dilation.
 *
 * ref       plain C, any type: the oracle
 * native    register-blocked products of our own (native.c), the inner block of
 *           which is written for each instruction set (nn_isa)
 * onednn    oneDNN through its C API, f32
 *
 * All results are the same for any number of threads, but for oneDNN's.
 */
#ifndef NN_KERNELS_H
#define NN_KERNELS_H

#include "nn/nn.h"

typedef struct nn_conv_shape {
    int n, h, w, c;    /* of x */
    int oh, ow, out;   /* of y */
    int kernel, stride, pad;
} nn_conv_shape;

/* What a pass works on. Tensors of `in` type but y and residual, which are of `result` type. */
typedef struct nn_conv_pass {
    const void *x;        /* forward, backward_weights */
    const void *weight;   /* [out][c][kernel][kernel], float (NN_F64: double); forward, backward_data */
    unsigned version;     /* of the weights: packed copies are made anew when it changes */
    const void *bias;     /* out floats (doubles); forward, if it was said to have one; else NULL */
    const void *residual; /* likewise */
    nn_activation activation; /* as it was said */
    void *y;              /* forward */
    const void *dz;       /* backward */
    void *dx;             /* backward_data */
    bool add;             /* to dx instead of writing it */
    void *dw;             /* like weight, added to; backward_weights */
    void *scratch;        /* as many bytes as the method's scratch() said, aligned to 64 */
    core_pool *pool;
} nn_conv_pass;

typedef enum nn_product { NN_PRODUCT_FORWARD, NN_PRODUCT_DATA, NN_PRODUCT_WEIGHTS } nn_product;

/* What else stays the same from run to run. */
typedef struct nn_conv_types {
    nn_type in, result; /* result differs only as NN_F32 from NN_BF16 */
    nn_activation activation;
    bool bias, residual; /* of forward */
} nn_conv_types;

typedef struct nn_method {
    const char *name;
    /* Makes what one convolution needs: a place for packed weights, primitives. Not NULL on BRACE_OK. `training`:
     * backward passes will come. */
    brace_status (*create)(void **state, const struct nn_method *method, const nn_conv_shape *shape,
                           nn_conv_types types, bool training, int threads, brace_error *error);
    void (*destroy)(void *state);
    size_t (*scratch)(const void *state, nn_product product, int threads);
    void (*forward)(void *state, const nn_conv_pass *pass);
    void (*backward_data)(void *state, const nn_conv_pass *pass);
    void (*backward_weights)(void *state, const nn_conv_pass *pass);
    const struct nn_isa *isa; /* of native methods */
} nn_method;

/* The method for a convolution; never NULL. BRACE_NN overrides `backend`. */
const nn_method *nn_method_choose(nn_backend backend, nn_conv_types types, const nn_conv_shape *shape);
/* Of this CPU, those that can do `in` type; for tests and benchmarks. Returns how many. */
enum { NN_MAX_METHODS = 12 };
int nn_methods(nn_type in, const nn_method *methods[NN_MAX_METHODS]);
double nn_conv_flops(const nn_conv_shape *shape); /* of one pass */

extern const nn_method nn_method_ref;
extern const nn_method nn_method_onednn; /* only where NN_HAVE_ONEDNN */

/* ---- the inner blocks of native methods ---- */

/* C[i, j] (+)= sum_{g < groups} sum_{t < steps} A[g][i, t] B[g][t, j]. Strides in elements of `in`; a step is one
 * element (f32), a pair (dp) or a tile's 32 elements (AMX) of A and as many rows of B, which are `b_step` apart. */
typedef struct nn_block {
    const void *a, *b;
    ptrdiff_t a_row, a_step, a_group; /* a_step: bf16 kernels know it: their steps are contiguous */
    ptrdiff_t b_step, b_group;
    int groups, steps;
    float *c; /* rows c_row apart, aligned to 4 */
    ptrdiff_t c_row;
    bool add; /* to what is there */
} nn_block;

/* From a block of sums to the result: y = act(c + bias + residual). */
typedef struct nn_finish {
    const float *c; /* rows 32 floats apart, aligned to 64 */
    int rows, cols;
    const float *bias; /* of the first column, or NULL */
    const void *residual;
    void *y;
    ptrdiff_t y_row; /* of y and residual, in elements */
    nn_activation activation;
    nn_type result;
} nn_finish;

typedef struct nn_isa {
    const char *name;
    nn_type in;       /* what A and B are */
    int rows, cols;   /* of the largest block; cols is also the width of packed weights */
    int lanes;        /* cols of a block are rounded up to it: so much of B is read, and of C written */
    int step;         /* elements of A in a step */
    int row_multiple; /* rows of A that are read are rounded up to it */
    void (*block)(const nn_block *block, int rows, int cols);
    void (*finish)(const nn_finish *finish);
    void (*enter)(void); /* before the first block of a piece; NULL: nothing to do */
    void (*leave)(void);
    double (*peak)(long rounds); /* multiplies and adds in registers alone, for benchmarks; returns FLOPs done */
    /* bf16 kernels only. Interleaves: out[c][2] = a[c], b[c] for c < count; `out` is written up to a multiple of 32. */
    void (*interleave)(uint16_t *out, const uint16_t *a, const uint16_t *b, int count);
    /* Transposes: out[c][p] = in[p][c] for p < 32, c < count; rows of `in` and `out` at the given distances. */
    void (*transpose)(uint16_t *out, ptrdiff_t out_row, const uint16_t *in, ptrdiff_t in_row, int count);
} nn_isa;

void nn_finish_plain(const nn_finish *finish); /* any activation, in plain C (finish_plain.c) */

extern const nn_isa nn_isa_avx2, nn_isa_avx512, nn_isa_avx512bf16, nn_isa_amx;
extern const nn_isa nn_isa_amx_emulated; /* in the tests */
extern const nn_method nn_method_avx2, nn_method_avx512, nn_method_avx512bf16, nn_method_amx;

/* native.c, for the methods above. */
brace_status nn_native_create(void **state, const nn_method *method, const nn_conv_shape *shape, nn_conv_types types,
                              bool training, int threads, brace_error *error);
void nn_native_destroy(void *state);
size_t nn_native_scratch(const void *state, nn_product product, int threads);
void nn_native_forward(void *state, const nn_conv_pass *pass);
void nn_native_backward_data(void *state, const nn_conv_pass *pass);
void nn_native_backward_weights(void *state, const nn_conv_pass *pass);

/* ---- gradients beside the convolution (conv_gradient.c) ---- */

/* dz = dy act'(y), with dz of `in` type and dy, y of `result` type; dz may be NULL. The derivatives at 0 are 0
 * (ReLU) and the slope (leaky). If `residual` is not NULL it gets dz too, of `result` type, or has it added. If
 * dbias is not NULL, sums of dz over the pixels are added to it (float; NN_F64: double). */
typedef struct nn_gradient {
    size_t pixels;
    int channels;
    nn_conv_types types;
    nn_activation activation;
    const void *dy, *y; /* y: only read if there is an activation */
    void *dz, *residual;
    bool add_residual;
    void *dbias;
    void *scratch; /* nn_gradient_scratch bytes */
    core_pool *pool;
} nn_gradient;
size_t nn_gradient_scratch(size_t pixels, int channels);
void nn_gradient_run(const nn_gradient *gradient);

#endif
