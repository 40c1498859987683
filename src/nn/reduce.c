/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reduce.c: sums, means, variances over any of the dimensions, and the mean
 * absolute difference.
 */
#include "nn/chunks.h"

#include <math.h>

typedef struct reduce {
    double scale; /* 1, or 1/number of terms */
} reduce;

typedef struct reduce_job {
    const nn_call *call;
    nn_fetch x, y, g; /* y: the mean, or the second input */
    const nn_rows *rows, *to;
    double scale;
    int which;
} reduce_job;

/* ---- sum, mean ---- */

static const void *plain_term(const void *context, size_t offset, size_t n, nn_chunk *room) {
    return nn_fetch_get(&((const reduce_job *)context)->x, offset, n, room);
}

static void sum_forward(nn_call *call) {
    const reduce_job job = {.x = nn_fetch_create(call->in[0], call->in[0].shape)};
    nn_sum_terms(call->pool, call->in[0].shape, call->in[0].type, plain_term, &job, call->out,
                 ((const reduce *)call->attributes)->scale, false, call->scratch);
}

static void spread_chunk(const void *context, size_t offset, size_t n) {
    const reduce_job *job = context;
    nn_chunk g, d;
    job->rows->unary(NN_AFFINE, job->scale, 0, nn_fetch_get(&job->g, offset, n, &g), &d, n);
    nn_put(job->rows, job->call->din[0], offset, n, &d, job->call->add[0]);
}

static void sum_backward(nn_call *call) {
    if (call->din[0].data == NULL) {
        return;
    }
    const reduce_job job = {.call = call,
                            .g = nn_fetch_create(call->dout, call->din[0].shape),
                            .rows = nn_rows_of(call->din[0].type),
                            .scale = ((const reduce *)call->attributes)->scale};
    nn_each_chunk(call->pool, nn_count(call->din[0].shape), spread_chunk, &job);
}

static size_t sum_scratch(const nn_call *call, bool backward, int threads) {
    (void)threads;
    return backward ? 0 : nn_sum_scratch(call->in[0].shape, call->out.shape);
}

static const nn_op sum_op = {
    .name = "sum", .forward = sum_forward, .backward = sum_backward, .scratch_bytes = sum_scratch};

/* ---- variance: mean (x - mean)^2, in two passes ---- */

static const void *square_term(const void *context, size_t offset, size_t n, nn_chunk *room) {
    const reduce_job *job = context;
    nn_chunk x, m;
    job->rows->binary(NN_SUB, nn_fetch_get(&job->x, offset, n, &x), nn_fetch_get(&job->y, offset, n, &m), room, n);
    job->rows->binary(NN_MUL, room, room, room, n);
    return room;
}

static nn_type wide_type(nn_type type) {
    return type == NN_F64 ? NN_F64 : NN_F32;
}

static size_t mean_bytes(const nn_call *call) {
    return (nn_count(call->out.shape) * nn_type_size(wide_type(call->in[0].type)) + 63) / 64 * 64;
}

static void var_forward(nn_call *call) {
    const nn_shape full = call->in[0].shape;
    const double scale = ((const reduce *)call->attributes)->scale;
    unsigned char *scratch = call->scratch;
    const nn_view mean = {call->saved != NULL ? call->saved : scratch, call->out.shape, wide_type(call->in[0].type)};
    reduce_job job = {.x = nn_fetch_create(call->in[0], full), .rows = nn_rows_of(call->in[0].type)};
    scratch += mean_bytes(call);
    nn_sum_terms(call->pool, full, call->in[0].type, plain_term, &job, mean, scale, false, scratch);
    job.y = nn_fetch_create(mean, full);
    nn_sum_terms(call->pool, full, call->in[0].type, square_term, &job, call->out, scale, false, scratch);
}

static void var_backward_chunk(const void *context, size_t offset, size_t n) {
    const reduce_job *job = context;
    nn_chunk x, m, g, d;
    job->rows->binary(NN_SUB, nn_fetch_get(&job->x, offset, n, &x), nn_fetch_get(&job->y, offset, n, &m), &d, n);
    job->rows->binary(NN_MUL, &d, nn_fetch_get(&job->g, offset, n, &g), &d, n);
    job->rows->unary(NN_AFFINE, 2 * job->scale, 0, &d, &d, n);
    nn_put(job->rows, job->call->din[0], offset, n, &d, job->call->add[0]);
}

static void var_backward(nn_call *call) {
    if (call->din[0].data == NULL) {
        return;
    }
    const nn_shape full = call->in[0].shape;
    const nn_view mean = {call->saved, call->dout.shape, wide_type(call->in[0].type)};
    const reduce_job job = {.call = call,
                            .x = nn_fetch_create(call->in[0], full),
                            .y = nn_fetch_create(mean, full),
                            .g = nn_fetch_create(call->dout, full),
                            .rows = nn_rows_of(call->in[0].type),
                            .scale = ((const reduce *)call->attributes)->scale};
    nn_each_chunk(call->pool, nn_count(full), var_backward_chunk, &job);
}

static size_t var_scratch(const nn_call *call, bool backward, int threads) {
    (void)threads;
    return backward ? 0 : mean_bytes(call) + nn_sum_scratch(call->in[0].shape, call->out.shape);
}

static const nn_op var_op = {.name = "var",
                             .keeps = NN_KEEP_IN0,
                             .forward = var_forward,
                             .backward = var_backward,
                             .saved_bytes = mean_bytes,
                             .scratch_bytes = var_scratch};

static nn_value add_reduce(nn_graph *g, const nn_op *op, nn_value x, bool mean, bool n, bool h, bool w, bool c) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    const nn_shape s = nn_shape_of(g, x), to = {n ? 1 : s.n, h ? 1 : s.h, w ? 1 : s.w, c ? 1 : s.c};
    const double terms = (double)nn_count(s) / (double)nn_count(to);
    return nn_node_add(g, &(nn_node_params){.op = op,
                                            .inputs = 1,
                                            .in = &x,
                                            .shape = to,
                                            .type = nn_type_of(g, x),
                                            .attributes = &(reduce){mean ? 1 / terms : 1},
                                            .attributes_size = sizeof(reduce)});
}

nn_value nn_sum(nn_graph *g, nn_value x, bool n, bool h, bool w, bool c) {
    return add_reduce(g, &sum_op, x, false, n, h, w, c);
}

nn_value nn_mean(nn_graph *g, nn_value x, bool n, bool h, bool w, bool c) {
    return add_reduce(g, &sum_op, x, true, n, h, w, c);
}

nn_value nn_var(nn_graph *g, nn_value x, bool n, bool h, bool w, bool c) {
    return add_reduce(g, &var_op, x, true, n, h, w, c);
}

/* ---- mean |a - b|: f32 also of bf16, since a loss is ---- */

static const void *distance_term(const void *context, size_t offset, size_t n, nn_chunk *room) {
    const reduce_job *job = context;
    nn_chunk a, b;
    job->rows->binary(NN_SUB, nn_fetch_get(&job->x, offset, n, &a), nn_fetch_get(&job->y, offset, n, &b), room, n);
    job->rows->unary(NN_ABS, 0, 0, room, room, n);
    return room;
}

static void l1_forward(nn_call *call) {
    const nn_shape full = call->in[0].shape;
    const reduce_job job = {.x = nn_fetch_create(call->in[0], full),
                            .y = nn_fetch_create(call->in[1], full),
                            .rows = nn_rows_of(call->in[0].type)};
    nn_sum_terms(call->pool, full, call->in[0].type, distance_term, &job, call->out, 1 / (double)nn_count(full), false,
                 call->scratch);
}

static void l1_backward_chunk(const void *context, size_t offset, size_t n) {
    const reduce_job *job = context;
    const int i = job->which;
    nn_chunk a, b, g, d;
    job->rows->binary(NN_SUB, nn_fetch_get(&job->x, offset, n, &a), nn_fetch_get(&job->y, offset, n, &b), &d, n);
    job->rows->unary_grad(NN_ABS, 0, 0, nn_fetch_get(&job->g, offset, n, &g), &d, NULL, &d, n);
    job->rows->unary(NN_AFFINE, job->scale, 0, &d, &d, n);
    nn_put(job->to, job->call->din[i], offset, n, &d, job->call->add[i]);
}

static void l1_backward(nn_call *call) {
    const nn_shape full = call->in[0].shape;
    for (int i = 0; i < 2; i++) {
        if (call->din[i].data == NULL) {
            continue;
        }
        const reduce_job job = {.call = call,
                                .x = nn_fetch_create(call->in[0], full),
                                .y = nn_fetch_create(call->in[1], full),
                                .g = nn_fetch_create(call->dout, full),
                                .rows = nn_rows_of(call->in[0].type),
                                .to = nn_rows_of(call->din[i].type),
                                .scale = (i == 0 ? 1 : -1) / (double)nn_count(full),
                                .which = i};
        nn_each_chunk(call->pool, nn_count(full), l1_backward_chunk, &job);
    }
}

static size_t l1_scratch(const nn_call *call, bool backward, int threads) {
    (void)threads;
    return backward ? 0 : nn_sum_scratch(call->in[0].shape, call->out.shape);
}

static const nn_op l1_op = {.name = "l1",
                            .keeps = NN_KEEP_IN0 | NN_KEEP_IN1,
                            .forward = l1_forward,
                            .backward = l1_backward,
                            .scratch_bytes = l1_scratch};

nn_value nn_l1(nn_graph *g, nn_value a, nn_value b) {
    if (!nn_usable(g, a) || !nn_usable(g, b)) {
        return 0;
    }
    if (!nn_shapes_equal(nn_shape_of(g, a), nn_shape_of(g, b)) ||
        (nn_type_of(g, a) == NN_F64) != (nn_type_of(g, b) == NN_F64)) {
        return nn_reject(g, "l1: tensors of %s and %s differ", nn_text_of(nn_shape_of(g, a)).text,
                         nn_text_of(nn_shape_of(g, b)).text);
    }
    return nn_node_add(g, &(nn_node_params){.op = &l1_op,
                                            .inputs = 2,
                                            .in = (const nn_value[]){a, b},
                                            .shape = {1, 1, 1, 1},
                                            .type = wide_type(nn_type_of(g, a))});
}
