/* SPDX-License-Identifier: Apache-2.0 */
/*
 * unary.c: functions of one number, activations, and changes of type.
 */
#include "nn/chunks.h"

typedef struct unary {
    nn_unary_kind kind;
    double p, q;
} unary;

typedef struct unary_job {
    const nn_call *call;
    const unary *f;
    nn_fetch x, y, g;
    const nn_rows *rows;
} unary_job;

static void forward_chunk(const void *context, size_t offset, size_t n) {
    const unary_job *job = context;
    const nn_view out = job->call->out;
    nn_chunk x, y;
    const void *from = nn_fetch_get(&job->x, offset, n, &x);
    void *to = out.type == NN_BF16 ? (void *)&y : (unsigned char *)out.data + offset * job->rows->t_size;
    job->rows->unary(job->f->kind, job->f->p, job->f->q, from, to, n);
    nn_put(job->rows, out, offset, n, to, false);
}

static void forward(nn_call *call) {
    const unary_job job = {.call = call,
                           .f = call->attributes,
                           .x = nn_fetch_create(call->in[0], call->out.shape),
                           .rows = nn_rows_of(call->out.type)};
    nn_each_chunk(call->pool, nn_count(call->out.shape), forward_chunk, &job);
}

static void backward_chunk(const void *context, size_t offset, size_t n) {
    const unary_job *job = context;
    nn_chunk x, y, g, d;
    const void *px = job->x.data != NULL ? nn_fetch_get(&job->x, offset, n, &x) : NULL;
    const void *py = job->y.data != NULL ? nn_fetch_get(&job->y, offset, n, &y) : NULL;
    job->rows->unary_grad(job->f->kind, job->f->p, job->f->q, nn_fetch_get(&job->g, offset, n, &g), px, py, &d, n);
    nn_put(job->rows, job->call->din[0], offset, n, &d, job->call->add[0]);
}

static void backward(nn_call *call) {
    if (call->din[0].data == NULL) {
        return;
    }
    const unary_job job = {.call = call,
                           .f = call->attributes,
                           .x = nn_fetch_create(call->in[0], call->dout.shape),
                           .y = nn_fetch_create(call->out, call->dout.shape),
                           .g = nn_fetch_create(call->dout, call->dout.shape),
                           .rows = nn_rows_of(call->dout.type)};
    nn_each_chunk(call->pool, nn_count(call->dout.shape), backward_chunk, &job);
}

static double flops(const nn_call *call) {
    return (double)nn_count(call->out.shape);
}

#define UNARY_OP(text, what)                                                                                           \
    {                                                                                                                  \
        .name = text, .keeps = what, .in_place = true, .grad_in_place = 1, .forward = forward, .backward = backward,   \
        .flops = flops                                                                                                 \
    }

static const nn_op ops[] = {
    [NN_AFFINE] = UNARY_OP("affine", 0),
    [NN_CLAMP] = UNARY_OP("clamp", NN_KEEP_IN0),
    [NN_POW] = UNARY_OP("pow", NN_KEEP_IN0),
    [NN_SQRT] = UNARY_OP("sqrt", NN_KEEP_OUT),
    [NN_LOG] = UNARY_OP("log", NN_KEEP_IN0),
    [NN_EXP] = UNARY_OP("exp", NN_KEEP_OUT),
    [NN_ABS] = UNARY_OP("abs", NN_KEEP_IN0),
    [NN_UNARY_RELU] = UNARY_OP("relu", NN_KEEP_OUT),
    [NN_UNARY_LEAKY] = UNARY_OP("leaky_relu", NN_KEEP_OUT),
    [NN_UNARY_SIGMOID] = UNARY_OP("sigmoid", NN_KEEP_OUT),
    [NN_UNARY_TANH] = UNARY_OP("tanh", NN_KEEP_OUT),
};

static nn_value add_unary(nn_graph *g, nn_value x, nn_unary_kind kind, double p, double q) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    return nn_node_add(g, &(nn_node_params){.op = &ops[kind],
                                            .inputs = 1,
                                            .in = &x,
                                            .shape = nn_shape_of(g, x),
                                            .type = nn_type_of(g, x),
                                            .attributes = &(unary){kind, p, q},
                                            .attributes_size = sizeof(unary)});
}

nn_value nn_affine(nn_graph *g, nn_value x, double scale, double shift) {
    return add_unary(g, x, NN_AFFINE, scale, shift);
}

nn_value nn_clamp(nn_graph *g, nn_value x, double low, double high) {
    return low <= high ? add_unary(g, x, NN_CLAMP, low, high) : nn_reject(g, "clamp: bounds %g and %g", low, high);
}

nn_value nn_pow(nn_graph *g, nn_value x, double exponent) {
    return add_unary(g, x, NN_POW, exponent, 0);
}

nn_value nn_sqrt(nn_graph *g, nn_value x) {
    return add_unary(g, x, NN_SQRT, 0, 0);
}

nn_value nn_log(nn_graph *g, nn_value x) {
    return add_unary(g, x, NN_LOG, 0, 0);
}

nn_value nn_exp(nn_graph *g, nn_value x) {
    return add_unary(g, x, NN_EXP, 0, 0);
}

nn_value nn_abs(nn_graph *g, nn_value x) {
    return add_unary(g, x, NN_ABS, 0, 0);
}

nn_value nn_activate(nn_graph *g, nn_value x, nn_activation kind) {
    switch (kind) {
    case NN_LINEAR:
        return nn_usable(g, x) ? x : 0;
    case NN_RELU:
        return add_unary(g, x, NN_UNARY_RELU, 0, 0);
    case NN_LEAKY_RELU:
        return add_unary(g, x, NN_UNARY_LEAKY, 0, 0);
    case NN_SIGMOID:
        return add_unary(g, x, NN_UNARY_SIGMOID, 0, 0);
    case NN_TANH:
        return add_unary(g, x, NN_UNARY_TANH, 0, 0);
    }
    return nn_reject(g, "activation: none has the number %d", (int)kind);
}

/* ---- types ---- */

typedef struct cast_job {
    nn_view from, to;
    bool add;
} cast_job;

static void cast_chunk(const void *context, size_t offset, size_t n) {
    const cast_job *job = context;
    const unsigned char *from = (const unsigned char *)job->from.data + offset * nn_type_size(job->from.type);
    unsigned char *to = (unsigned char *)job->to.data + offset * nn_type_size(job->to.type);
    if (job->from.type != NN_F64 && job->to.type != NN_F64) {
        nn_chunk room;
        nn_rows_of(job->from.type)->load(from, &room, n);
        nn_put(nn_rows_of(job->to.type), job->to, offset, n, &room, job->add);
    } else {
        double room[NN_CHUNK];
        nn_load_double(job->from.type, from, room, n);
        nn_store_double(job->to.type, room, to, n, job->add);
    }
}

static void cast_forward(nn_call *call) {
    const cast_job job = {call->in[0], call->out, false};
    nn_each_chunk(call->pool, nn_count(call->out.shape), cast_chunk, &job);
}

static void cast_backward(nn_call *call) {
    if (call->din[0].data != NULL) {
        const cast_job job = {call->dout, call->din[0], call->add[0]};
        nn_each_chunk(call->pool, nn_count(call->dout.shape), cast_chunk, &job);
    }
}

static const nn_op cast_op = {.name = "cast", .forward = cast_forward, .backward = cast_backward};

nn_value nn_cast(nn_graph *g, nn_value x, nn_type type) {
    if (!nn_usable(g, x) || nn_type_of(g, x) == type) {
        return nn_usable(g, x) ? x : 0;
    }
    return nn_node_add(
        g, &(nn_node_params){.op = &cast_op, .inputs = 1, .in = &x, .shape = nn_shape_of(g, x), .type = type});
}
