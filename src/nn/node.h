/* SPDX-License-Identifier: Apache-2.0 */
/*
 * node.h: what an operation is to the graph. Each file of operations defines
 * builders (nn.h), which check shapes and call nn_node_add, and an nn_op for each
 * kind of node: how it runs forward, how backward, and what it must be kept for it.
 *
 * Backward: dout is d loss/d out; the operation writes d loss/d in[i] into din[i],
 * or adds to it when add[i]; din[i] is NULL where no gradient is wanted. Gradients
 * of values have the value's type. Gradients of parameters are always added, to
 * parameter[i]->grad (f32; grad64 in an NN_F64 graph).
 */
#ifndef NN_NODE_H
#define NN_NODE_H

#include "nn/nn.h"

enum { NN_MAX_IN = 16, NN_MAX_PARAMETERS = 2 };

typedef struct nn_node nn_node;

/* A tensor at run time. */
typedef struct nn_view {
    void *data;
    nn_shape shape;
    nn_type type;
} nn_view;

typedef struct nn_call {
    const nn_node *node;
    const void *attributes; /* the builder's struct */
    int inputs;
    nn_view in[NN_MAX_IN];  /* in backward: data is NULL unless op->keeps says so */
    nn_view out;            /* likewise */
    nn_view dout;           /* backward only */
    nn_view din[NN_MAX_IN]; /* backward only; data NULL: not wanted */
    bool add[NN_MAX_IN];
    nn_parameter *parameter[NN_MAX_PARAMETERS];
    void *saved;   /* saved_bytes, from forward to backward; NULL in a forward pass that no backward will follow */
    void *scratch; /* scratch_bytes; nothing is kept in it */
    void *kernel;  /* what prepare made: packed weights, oneDNN primitives */
    core_pool *pool;
} nn_call;

enum {
    NN_KEEP_OUT = 1u << 31, /* backward reads out */
    NN_KEEP_IN0 = 1u, NN_KEEP_IN1 = 2u, NN_KEEP_IN2 = 4u, /* 1u << i: backward reads in[i] */
};

typedef struct nn_op {
    const char *name;
    unsigned keeps;
    bool in_place; /* out may be the buffer of in[0] when nobody needs that any more */
    bool view;     /* out is in[0] under another shape: forward is not called */
    int grad_in_place; /* 1 + i: din[i] may be the buffer of dout, so it is written last; add[i] is not set then */
    void (*forward)(nn_call *call);
    void (*backward)(nn_call *call);
    /* Optional. Bytes from forward to backward, and of scratch (backward: which pass), for the pool's thread count. Asked
     * when planning: no data is there yet, so scratch is for all gradients that may be wanted. */
    size_t (*saved_bytes)(const nn_call *call);
    size_t (*scratch_bytes)(const nn_call *call, bool backward, int threads);
    /* Optional. At planning: chooses a kernel (*kernel_name is shown), makes what it needs; undone by release. */
    brace_status (*prepare)(nn_call *call, nn_backend backend, bool training, void **kernel, const char **kernel_name,
                            brace_error *error);
    void (*release)(void *kernel);
    double (*flops)(const nn_call *call);
} nn_op;

/* Adds a node and returns its value. `attributes` (size bytes, may be NULL) are copied. */
typedef struct nn_node_params {
    const nn_op *op;
    int inputs;
    const nn_value *in;
    nn_shape shape;
    nn_type type;
    const void *attributes;
    size_t attributes_size;
    nn_parameter *parameter[NN_MAX_PARAMETERS];
} nn_node_params;
nn_value nn_node_add(nn_graph *g, const nn_node_params *params);

/* The builders' checks, beside nn_reject (nn.h). */
bool nn_usable(nn_graph *g, nn_value v); /* v is a value of g and no error is there yet */
/* A parameter "scope.name", made or found; NULL after recording an error. fan_in is for the init. */
nn_parameter *nn_parameter_get(nn_graph *g, const char *name, int rank, const int *shape, nn_init init, int fan_in);

static inline size_t nn_count(nn_shape s) {
    return (size_t)s.n * (size_t)s.h * (size_t)s.w * (size_t)s.c;
}
static inline size_t nn_type_size(nn_type t) {
    return t == NN_F64 ? 8 : t == NN_BF16 ? 2 : 4;
}

/* bf16: the upper half of a float, rounded to nearest even; NaN stays NaN. */
static inline float nn_from_bf16(uint16_t v) {
    union { uint32_t u; float f; } x = {(uint32_t)v << 16};
    return x.f;
}
static inline uint16_t nn_to_bf16(float f) {
    union { float f; uint32_t u; } x = {f};
    if ((x.u & 0x7fffffffu) > 0x7f800000u)
        return (uint16_t)(x.u >> 16 | 0x40);
    return (uint16_t)((x.u + 0x7fff + (x.u >> 16 & 1)) >> 16);
}

#endif
