/* SPDX-License-Identifier: Apache-2.0 */
/*
 * nn.h: networks as static graphs: what a model is built with. Internal.
 *
 * A model is a function that calls the operations below, once. Each call checks
 * shapes and adds a node; nothing is computed. The graph is then planned (which
 * buffer lives when, which kernel runs where) and run as often as wanted:
 *
 *     nn_weights *weights;                       // parameters, shared by graphs
 *     nn_graph *g;
 *     nn_weights_create(&weights, seed, error);
 *     nn_graph_create(&g, weights, NULL, error);
 *     nn_value x = nn_input(g, "x", (nn_shape){1, 128, 128, 8});
 *     nn_value y = nn_conv2d(g, x, &(nn_conv){.name = "conv", .out = 64, .kernel = 3, .pad = 1,
 *                                             .activation = NN_RELU});
 *     nn_output(g, "y", y);
 *     status = nn_graph_plan(g, NULL, error);    // also reports what was wrong above
 *     memcpy(nn_data(g, x), ..., nn_bytes(g, x));
 *     status = nn_forward(g, error);
 *     ... nn_data(g, y) ...
 *
 * Tensors are dense, four-dimensional and channels last: {n, h, w, c}. A bracket
 * keeps its frames in n. Tokens are {n, 1, tokens, features}. Scalars are {1,1,1,1}.
 *
 * Errors while building are sticky: the first one is kept with the scope that it
 * happened in ("backbone.backward.main.2: conv1: ..."), later calls return 0,
 * and nn_graph_plan reports it. So models read as formulas.
 *
 * Types: a graph computes in NN_F32 (the truth), NN_F64 (to check gradients) or
 * NN_BF16 (storage of activations; sums, parameters and their gradients stay
 * f32). nn_cast changes the type of one value; an operation's result has the type
 * of its first input unless it says otherwise. Losses, flows and offsets stay f32.
 *
 * Determinism: the same weights, input and thread count give the same bytes.
 *
 * Thread safety: a graph is for one thread at a time and runs on its own workers;
 * graphs that share weights may run forward at the same time, not backward.
 */
#ifndef NN_NN_H
#define NN_NN_H

#include "core/core.h"

typedef enum nn_type { NN_F32, NN_BF16, NN_F64 } nn_type;

typedef struct nn_shape {
    int n, h, w, c;
} nn_shape;

typedef int nn_value; /* 0: none */
typedef struct nn_graph nn_graph;

/* ---- weights (weights.c) ---- */

/* Parameters have PyTorch's names, shapes and order of elements ([out, in, kh, kw] for a convolution), so that
 * published checkpoints load unchanged; kernels repack them for themselves. */
enum { NN_RANK_MAX = 5 };
typedef struct nn_parameter {
    char *name;
    int rank, shape[NN_RANK_MAX];
    size_t count;
    float *value, *grad; /* grad: NULL until a graph is planned for training */
    double *value64, *grad64; /* of NN_F64 graphs, NULL otherwise; value follows `value` when planned */
    unsigned version;    /* goes up when value changes: packed copies are made anew */
    bool frozen;         /* no gradient is computed */
} nn_parameter;

typedef struct nn_weights nn_weights;

typedef enum nn_init {
    NN_INIT_ZERO,
    NN_INIT_ONE,
    NN_INIT_UNIFORM_FAN_IN, /* U(-1/sqrt(fan_in), 1/sqrt(fan_in)): PyTorch's default of weights and biases */
    NN_INIT_HE_FAN_IN,      /* N(0, 2/fan_in) */
    NN_INIT_HE_FAN_IN_TENTH /* the same times 0.1: residual blocks */
} nn_init;

brace_status nn_weights_create(nn_weights **out, uint64_t seed, brace_error *error);
void nn_weights_destroy(nn_weights *weights); /* NULL is allowed */
size_t nn_weights_count(const nn_weights *weights);
nn_parameter *nn_weights_at(nn_weights *weights, size_t index);
nn_parameter *nn_weights_find(nn_weights *weights, const char *name); /* NULL: none */
void nn_weights_changed(nn_weights *weights);                         /* after values were written from outside */
void nn_weights_zero_grad(nn_weights *weights);

/* safetensors (f32, f16, bf16) by name; PyTorch's .pth can be loaded, too, with the parameters at its top or under
 * "state_dict". Loading before a graph is built keeps the arrays for when it asks for them;
 * after, all parameters must be there with their shapes, unless `partial`. Saving writes f32, bf16 or f16, atomically. */
brace_status nn_weights_give(nn_weights *weights, const char *name, int rank, const int *shape, const float *values,
                             brace_error *error); /* one array, copied: now if the parameter is there, else kept */
brace_status nn_weights_load(nn_weights *weights, const char *path, bool partial, brace_error *error);
brace_status nn_weights_save(const nn_weights *weights, const char *path, const char *dtype,
                             const char *const *metadata /* key, text, ..., NULL */, brace_error *error);

/* ---- graph (graph.c, plan.c, run.c) ---- */

typedef enum nn_backend {
    NN_AUTO,   /* the fastest that the CPU has; BRACE_NN=ref|onednn|avx2|avx512|avx512bf16|amx overrides */
    NN_REF,    /* plain C for everything: the oracle */
    NN_ONEDNN, /* f32 convolutions and products by oneDNN */
    NN_NATIVE  /* our own kernels only */
} nn_backend;

/* Whether this CPU has instructions for bf16, and BRACE_NN does not forbid them: without, f32 is faster. */
bool nn_bf16_is_fast(void);

typedef struct nn_graph_params {
    nn_type type; /* of computation */
    nn_backend backend;
    const brace_job *job; /* threads, cancelling; copied */
    /* For tests of the plan: no two buffers share memory; buffers are filled with NaN as soon as they are dead. */
    bool separate, poison;
} nn_graph_params;

brace_status nn_graph_create(nn_graph **out, nn_weights *weights, const nn_graph_params *params, brace_error *error);
void nn_graph_destroy(nn_graph *graph); /* NULL is allowed */

/* Names of what follows: parameters are "scope.scope.name.weight". printf-like. */
void nn_push(nn_graph *g, const char *format, ...) __attribute__((format(printf, 2, 3)));
void nn_pop(nn_graph *g);

nn_value nn_input(nn_graph *g, const char *name, nn_shape shape);       /* filled before each run; f32 (f64) */
nn_value nn_input_grad(nn_graph *g, const char *name, nn_shape shape);  /* the same, and its gradient is wanted */
nn_value nn_constant(nn_graph *g, nn_shape shape, const float *values); /* copied; f32 (f64) */
/* A parameter of any use, named in the scope, as a value of the given shape, f32 (f64). */
nn_value nn_param(nn_graph *g, const char *name, nn_shape shape, int rank, const int *torch_shape, nn_init init);
void nn_output(nn_graph *g, const char *name, nn_value v); /* kept after a run */

/* What is computed between these is not kept for the backward pass but computed again: less memory, a third more
 * time. Segments do not nest. What is used outside of them is kept, which should be their last value only. */
void nn_recompute_begin(nn_graph *g);
void nn_recompute_end(nn_graph *g);

/* Plans once: nothing can be added afterwards. Parameters to be frozen are frozen before. */
typedef struct nn_plan_params {
    nn_value loss; /* a scalar to differentiate; 0: forward only */
} nn_plan_params;
brace_status nn_graph_plan(nn_graph *g, const nn_plan_params *params, brace_error *error);

brace_status nn_forward(nn_graph *g, brace_error *error);
/* After nn_forward, once: adds d loss/d parameter to each parameter's grad. `scale` multiplies the loss. */
brace_status nn_backward(nn_graph *g, double scale, brace_error *error);

nn_type nn_graph_type(const nn_graph *g);
nn_shape nn_shape_of(const nn_graph *g, nn_value v);
nn_type nn_type_of(const nn_graph *g, nn_value v);
void *nn_data(nn_graph *g, nn_value v); /* inputs and outputs; NULL for others, whose buffers are shared */
void *nn_grad(nn_graph *g, nn_value v); /* of an nn_input_grad, after nn_backward; NULL where the loss needs it not */
size_t nn_bytes(const nn_graph *g, nn_value v);
size_t nn_graph_memory(const nn_graph *g);      /* bytes of the plan: activations, gradients, scratch */
double nn_graph_flops(const nn_graph *g);       /* of a forward pass: multiply and add are two */
brace_status nn_graph_error(const nn_graph *g, brace_error *error); /* what building met so far */
/* For models, too, that cannot be built as asked: records the sticky error ("scope: text") and returns 0. */
nn_value nn_reject(nn_graph *g, const char *format, ...) __attribute__((format(printf, 2, 3)));
/* One line a node: name, shape, kernel, FLOPs, seconds of the last run. For `brace bench` and for debugging. */
void nn_graph_print(const nn_graph *g, FILE *out);

/* ---- convolution and products (conv.c, linear.c) ---- */

typedef enum nn_activation { NN_LINEAR, NN_RELU, NN_LEAKY_RELU /* slope 0.1 */, NN_SIGMOID, NN_TANH } nn_activation;

typedef struct nn_conv {
    const char *name; /* parameters NAME.weight and NAME.bias; "" : the scope's own weight and bias */
    int out, kernel;
    int stride;   /* 0: 1 */
    int pad;
    bool no_bias;
    nn_activation activation; /* applied after the residual is added */
    nn_value residual;        /* of the result's shape; 0: none */
    nn_init init;             /* of the weight; biases: NN_INIT_UNIFORM_FAN_IN */
    bool zero_bias;
    bool f32_result; /* in a bf16 graph; others have their own type */
} nn_conv;
nn_value nn_conv2d(nn_graph *g, nn_value x, const nn_conv *conv);
/* Each channel with the same fixed kernel x kernel filter (DISTS' L2 pooling, Gaussian pyramids). */
nn_value nn_filter(nn_graph *g, nn_value x, int kernel, int stride, int pad, const float *taps);
/* y = x W^T + b over the last dimension. */
nn_value nn_linear(nn_graph *g, nn_value x, const char *name, int out, bool bias, nn_init init);
/* Batched over n and h: a {.., w, c} times b {.., c, w2}, or with b transposed {.., w2, c}: {.., w, w2}, times scale. */
nn_value nn_matmul(nn_graph *g, nn_value a, nn_value b, bool transpose_b, double scale);

/* ---- elementwise (binary.c, unary.c): each dimension of b equals a's or is 1, and the other way round; the types may
 * differ ---- */
nn_value nn_add(nn_graph *g, nn_value a, nn_value b);
nn_value nn_sub(nn_graph *g, nn_value a, nn_value b);
nn_value nn_mul(nn_graph *g, nn_value a, nn_value b);
nn_value nn_div(nn_graph *g, nn_value a, nn_value b);
nn_value nn_affine(nn_graph *g, nn_value x, double scale, double shift); /* x scale + shift */
nn_value nn_clamp(nn_graph *g, nn_value x, double low, double high);     /* gradient passes at both bounds */
nn_value nn_pow(nn_graph *g, nn_value x, double exponent);
nn_value nn_sqrt(nn_graph *g, nn_value x);
nn_value nn_log(nn_graph *g, nn_value x);
nn_value nn_exp(nn_graph *g, nn_value x);
nn_value nn_abs(nn_graph *g, nn_value x); /* gradient 0 at 0 */
nn_value nn_activate(nn_graph *g, nn_value x, nn_activation kind);
nn_value nn_cast(nn_graph *g, nn_value x, nn_type type);
nn_value nn_softmax(nn_graph *g, nn_value x);                        /* over c */
nn_value nn_l2_normalize(nn_graph *g, nn_value x, double epsilon);   /* x/(|x| + epsilon) over c, 0 where |x| is 0 */

/* ---- shapes (shape.c, resample.c, pooling.c) ---- */
typedef enum nn_axis { NN_AXIS_N, NN_AXIS_H, NN_AXIS_W, NN_AXIS_C } nn_axis;
nn_value nn_concat(nn_graph *g, nn_axis axis, int count, const nn_value *parts);
nn_value nn_slice(nn_graph *g, nn_value x, nn_axis axis, int begin, int end, int step); /* step >= 1 */
nn_value nn_repeat(nn_graph *g, nn_value x, nn_axis axis, int times);   /* whole copies after one another */
nn_value nn_flip(nn_graph *g, nn_value x, nn_axis axis);
nn_value nn_roll(nn_graph *g, nn_value x, nn_axis axis, int by);
nn_value nn_permute(nn_graph *g, nn_value x, const nn_axis order[4]); /* dimension i of the result is order[i] of x */
nn_value nn_reshape(nn_graph *g, nn_value x, nn_shape shape);         /* same elements in memory */
typedef enum nn_border { NN_ZERO, NN_REFLECT, NN_REPLICATE } nn_border;
nn_value nn_pad(nn_graph *g, nn_value x, int top, int bottom, int left, int right, nn_border border);
nn_value nn_pixel_shuffle(nn_graph *g, nn_value x, int by);   /* c -> c/by^2, PyTorch's order of channels */
nn_value nn_pixel_unshuffle(nn_graph *g, nn_value x, int by);
nn_value nn_average_pool(nn_graph *g, nn_value x, int kernel, int stride);
nn_value nn_adaptive_average_pool(nn_graph *g, nn_value x, int h, int w);
nn_value nn_max_pool(nn_graph *g, nn_value x, int kernel, int stride, bool ceil_mode);
nn_value nn_resize(nn_graph *g, nn_value x, int h, int w, bool align_corners); /* bilinear */
nn_value nn_haar(nn_graph *g, nn_value x); /* LL, LH, HL, HH after one another in c (OPS semantics) */

/* ---- sampling (warp.c, deform.c) ---- */
/* x at each pixel moved by `flow` (dx, dy in pixels, f32): grid_sample with align_corners. */
nn_value nn_warp(nn_graph *g, nn_value x, nn_value flow, nn_border border /* NN_ZERO or NN_REPLICATE */);
/* Modulated deformable convolution (DCNv2), 3x3, stride 1; offsets {.., 18 groups} as (dy, dx) a tap, masks {.., 9
 * groups}; `groups` divide the input channels; offset groups and, with weight_groups > 1, the weight groups. */
typedef struct nn_deform {
    const char *name;
    int out, pad, dilation, offset_groups, weight_groups;
    nn_init init;
} nn_deform;
nn_value nn_deform_conv2d(nn_graph *g, nn_value x, nn_value offset, nn_value mask, const nn_deform *deform);

/* ---- reductions and losses (reduce.c, sort.c) ---- */
/* Over the axes that are set, which become 1. Sums are made in double for f32. */
nn_value nn_sum(nn_graph *g, nn_value x, bool n, bool h, bool w, bool c);
nn_value nn_mean(nn_graph *g, nn_value x, bool n, bool h, bool w, bool c);
nn_value nn_var(nn_graph *g, nn_value x, bool n, bool h, bool w, bool c); /* biased */
nn_value nn_sort(nn_graph *g, nn_value x, nn_axis axis);                 /* rising; gradient through the permutation */
nn_value nn_l1(nn_graph *g, nn_value a, nn_value b);                     /* mean |a - b|, a scalar */

#endif
