/* SPDX-License-Identifier: Apache-2.0 */
/*
 * binary.c: sum, difference, product and quotient of two tensors, either of which may
 * be broadcast. The gradient of a broadcast input is summed over where it was used.
 */
#include "nn/chunks.h"

typedef struct binary {
    nn_binary_kind kind;
} binary;

static const char *const names[] = {[NN_ADD] = "add", [NN_SUB] = "sub", [NN_MUL] = "mul", [NN_DIV] = "div"};

typedef struct binary_job {
    const nn_call *call;
    nn_binary_kind kind;
    int which; /* backward: of which input */
    nn_fetch a, b, g;
    const nn_rows *rows, *to; /* of what is computed; of what is written */
} binary_job;

static void forward_chunk(const void *context, size_t offset, size_t n) {
    const binary_job *job = context;
    const nn_view out = job->call->out;
    nn_chunk a, b, c;
    const void *pa = nn_fetch_get(&job->a, offset, n, &a), *pb = nn_fetch_get(&job->b, offset, n, &b);
    void *to = out.type == NN_BF16 ? (void *)&c : (unsigned char *)out.data + offset * job->rows->t_size;
    job->rows->binary(job->kind, pa, pb, to, n);
    nn_put(job->rows, out, offset, n, to, false);
}

static void forward(nn_call *call) {
    const nn_shape full = call->out.shape;
    const binary_job job = {.call = call,
                            .kind = ((const binary *)call->attributes)->kind,
                            .a = nn_fetch_create(call->in[0], full),
                            .b = nn_fetch_create(call->in[1], full),
                            .rows = nn_rows_of(call->out.type)};
    nn_each_chunk(call->pool, nn_count(full), forward_chunk, &job);
}

/* d loss/d out times d out/d input, of the full shape. */
static const void *term(const void *context, size_t offset, size_t n, nn_chunk *room) {
    const binary_job *job = context;
    nn_chunk a, b, g;
    const void *pa = job->a.data != NULL ? nn_fetch_get(&job->a, offset, n, &a) : NULL;
    const void *pb = job->b.data != NULL ? nn_fetch_get(&job->b, offset, n, &b) : NULL;
    job->rows->binary_grad(job->kind, job->which, nn_fetch_get(&job->g, offset, n, &g), pa, pb, room, n);
    return room;
}

static void backward_chunk(const void *context, size_t offset, size_t n) {
    const binary_job *job = context;
    const nn_view to = job->call->din[job->which];
    nn_chunk room;
    nn_put(job->to, to, offset, n, term(job, offset, n, &room), job->call->add[job->which]);
}

static void backward(nn_call *call) {
    const nn_shape full = call->dout.shape;
    binary_job job = {.call = call,
                      .kind = ((const binary *)call->attributes)->kind,
                      .a = nn_fetch_create(call->in[0], full),
                      .b = nn_fetch_create(call->in[1], full),
                      .g = nn_fetch_create(call->dout, full),
                      .rows = nn_rows_of(call->dout.type)};
    const bool same = call->din[0].data != NULL && call->din[0].data == call->dout.data; /* written last */
    for (int i = 0; i < 2; i++) {
        job.which = same ? 1 - i : i;
        const nn_view to = call->din[job.which];
        if (to.data == NULL) {
            continue;
        }
        job.to = nn_rows_of(to.type);
        if (!nn_shapes_equal(to.shape, full)) {
            nn_sum_terms(call->pool, full, call->dout.type, term, &job, to, 1, call->add[job.which], call->scratch);
        } else if (to.data != call->dout.data || job.kind != NN_ADD) {
            nn_each_chunk(call->pool, nn_count(full), backward_chunk, &job);
        }
    }
}

static size_t scratch_bytes(const nn_call *call, bool backward_pass, int threads) {
    (void)threads;
    const size_t a = nn_sum_scratch(call->out.shape, call->in[0].shape),
                 b = nn_sum_scratch(call->out.shape, call->in[1].shape);
    return !backward_pass ? 0 : a > b ? a : b;
}

static double flops(const nn_call *call) {
    return (double)nn_count(call->out.shape);
}

#define BINARY_OP(text, what)                                                                                          \
    {                                                                                                                  \
        .name = text, .keeps = what, .in_place = true, .grad_in_place = 1, .forward = forward, .backward = backward,   \
        .scratch_bytes = scratch_bytes, .flops = flops                                                                 \
    }

static const nn_op ops[] = {
    [NN_ADD] = BINARY_OP("add", 0),
    [NN_SUB] = BINARY_OP("sub", 0),
    [NN_MUL] = BINARY_OP("mul", NN_KEEP_IN0 | NN_KEEP_IN1),
    [NN_DIV] = BINARY_OP("div", NN_KEEP_IN0 | NN_KEEP_IN1),
};

static nn_value add_binary(nn_graph *g, nn_binary_kind kind, nn_value a, nn_value b) {
    if (!nn_usable(g, a) || !nn_usable(g, b)) {
        return 0;
    }
    const nn_shape full = nn_broadcast(nn_shape_of(g, a), nn_shape_of(g, b));
    const nn_type type = nn_type_of(g, a);
    if (full.n == 0) {
        return nn_reject(g, "%s: tensors of %s and %s do not fit", names[kind], nn_text_of(nn_shape_of(g, a)).text,
                         nn_text_of(nn_shape_of(g, b)).text);
    }
    if ((type == NN_F64) != (nn_type_of(g, b) == NN_F64)) {
        return nn_reject(g, "%s: f64 goes with f64 only", names[kind]);
    }
    return nn_node_add(g, &(nn_node_params){.op = &ops[kind],
                                            .inputs = 2,
                                            .in = (const nn_value[]){a, b},
                                            .shape = full,
                                            .type = type,
                                            .attributes = &(binary){kind},
                                            .attributes_size = sizeof(binary)});
}

nn_value nn_add(nn_graph *g, nn_value a, nn_value b) {
    return add_binary(g, NN_ADD, a, b);
}

nn_value nn_sub(nn_graph *g, nn_value a, nn_value b) {
    return add_binary(g, NN_SUB, a, b);
}

nn_value nn_mul(nn_graph *g, nn_value a, nn_value b) {
    return add_binary(g, NN_MUL, a, b);
}

nn_value nn_div(nn_graph *g, nn_value a, nn_value b) {
    return add_binary(g, NN_DIV, a, b);
}
