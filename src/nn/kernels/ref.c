/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ref.c: convolution in plain C for every type, kernel, stride and padding: what
 * the other methods are checked against, and what runs where there are none.
 */
#include <math.h>
#include <string.h>

#include "nn/kernels/kernels.h"
#include "nn/node.h"

typedef struct ref_state {
    nn_conv_shape shape;
    nn_conv_types types;
    void *packed;
} ref_state;

static size_t ref_line(const nn_conv_shape *s) { /* sums of a worker, in whole cache lines */
    return ((size_t)(s->c > s->out ? s->c : s->out) + 15) / 16 * 16;
}

static double ref_activate(double v, nn_activation activation) {
    switch (activation) {
    case NN_LINEAR:
        break;
    case NN_RELU:
        return v < 0 ? 0 : v;
    case NN_LEAKY_RELU:
        return v < 0 ? 0.1 * v : v;
    case NN_SIGMOID:
        return 1 / (1 + exp(-v));
    case NN_TANH:
        return tanh(v);
    }
    return v;
}

#define REF(name) f32_##name
#define REF_T float
#define REF_A float
#define REF_GET(v) (v)
#define REF_PUT(v) (v)
#define REF_ROUND(v) (v)
#include "nn/kernels/ref_body.h"

#define REF(name) f64_##name
#define REF_T double
#define REF_A double
#define REF_GET(v) (v)
#define REF_PUT(v) (v)
#define REF_ROUND(v) (v)
#include "nn/kernels/ref_body.h"

/* Weights are rounded to bf16 here too: that is the number that the fast kernels multiply with. */
#define REF(name) bf16_##name
#define REF_T uint16_t
#define REF_A float
#define REF_GET(v) nn_from_bf16(v)
#define REF_PUT(v) nn_to_bf16(v)
#define REF_ROUND(v) nn_from_bf16(nn_to_bf16(v))
#include "nn/kernels/ref_body.h"

static void ref_destroy(void *state) {
    if (state != NULL) {
        core_free(((ref_state *)state)->packed);
        core_free(state);
    }
}

static brace_status ref_create(void **out, const nn_method *method, const nn_conv_shape *shape, nn_conv_types types,
                               bool training, int threads, brace_error *error) {
    (void)method;
    (void)training;
    (void)threads;
    size_t taps = (size_t)shape->kernel * (size_t)shape->kernel, pairs = (size_t)shape->c * (size_t)shape->out;
    ref_state *state = core_calloc(1, sizeof *state);
    void *packed = core_alloc(taps * pairs, types.in == NN_F64 ? sizeof(double) : sizeof(float));
    if (state == NULL || packed == NULL) {
        core_free(state);
        core_free(packed);
        return core_fail_memory(error, taps * pairs * sizeof(double), "the weights of a convolution");
    }
    *state = (ref_state){*shape, types, packed};
    *out = state;
    return BRACE_OK;
}

static size_t ref_scratch(const void *state, nn_product product, int threads) {
    (void)product;
    return (size_t)threads * ref_line(&((const ref_state *)state)->shape) * sizeof(double);
}

static void run(ref_state *state, const nn_conv_pass *pass, nn_product which) {
    switch (state->types.in) {
    case NN_F32:
        f32_pass(state, pass, which);
        break;
    case NN_F64:
        f64_pass(state, pass, which);
        break;
    case NN_BF16:
        bf16_pass(state, pass, which);
        break;
    }
}

static void ref_forward(void *state, const nn_conv_pass *pass) {
    run(state, pass, NN_PRODUCT_FORWARD);
}

static void ref_backward_data(void *state, const nn_conv_pass *pass) {
    run(state, pass, NN_PRODUCT_DATA);
}

static void ref_backward_weights(void *state, const nn_conv_pass *pass) {
    run(state, pass, NN_PRODUCT_WEIGHTS);
}

const nn_method nn_method_ref = {"ref",       ref_create,        ref_destroy,          ref_scratch,
                                 ref_forward, ref_backward_data, ref_backward_weights, NULL};
