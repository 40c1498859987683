/* SPDX-License-Identifier: Apache-2.0 */
/*
 * normalize.c: softmax and L2 normalisation of each pixel's channels, in double.
 */
#include <math.h>

#include "nn/chunks.h"

typedef struct normalize {
    double epsilon;
} normalize;

typedef struct row_job {
    nn_call *call;
    size_t c;
    void (*row)(double epsilon, size_t c, const double *a, const double *g, double *out);
    nn_view a, g, to; /* a: input or, for softmax backward, result */
    bool add;
} row_job;

/* Room of each worker: three rows. */
static size_t room(size_t c) {
    return (3 * c * sizeof(double) + 63) / 64 * 64;
}

static void each_row(void *arg, size_t begin, size_t end, int worker) {
    const row_job *job = arg;
    const size_t c = job->c;
    double *a = (double *)(void *)((unsigned char *)job->call->scratch + (size_t)worker * room(c));
    double *g = a + c, *out = g + c;
    const normalize *n = job->call->attributes;
    for (size_t i = begin; i < end; i++) {
        nn_load_double(job->a.type, (const unsigned char *)job->a.data + i * c * nn_type_size(job->a.type), a, c);
        if (job->g.data != NULL) {
            nn_load_double(job->g.type, (const unsigned char *)job->g.data + i * c * nn_type_size(job->g.type), g, c);
        }
        job->row(n->epsilon, c, a, g, out);
        nn_store_double(job->to.type, out, (unsigned char *)job->to.data + i * c * nn_type_size(job->to.type), c,
                        job->add);
    }
}

static void run(row_job *job) {
    job->c = (size_t)job->to.shape.c;
    core_parallel(job->call->pool, nn_count(job->to.shape) / job->c, 8192 / job->c + 1, each_row, job);
}

static size_t scratch_bytes(const nn_call *call, bool backward, int threads) {
    (void)backward;
    return (size_t)threads * room((size_t)call->in[0].shape.c);
}

static nn_value add_rows(nn_graph *g, const nn_op *op, nn_value x, double epsilon) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    return nn_node_add(g, &(nn_node_params){.op = op,
                                            .inputs = 1,
                                            .in = &x,
                                            .shape = nn_shape_of(g, x),
                                            .type = nn_type_of(g, x),
                                            .attributes = &(normalize){epsilon},
                                            .attributes_size = sizeof(normalize)});
}

/* ---- softmax ---- */

static void softmax_row(double epsilon, size_t c, const double *x, const double *g, double *out) {
    double most = -INFINITY, sum = 0;
    (void)epsilon, (void)g;
    for (size_t i = 0; i < c; i++) {
        most = x[i] > most ? x[i] : most;
    }
    for (size_t i = 0; i < c; i++) {
        sum += out[i] = exp(x[i] - most);
    }
    for (size_t i = 0; i < c; i++) {
        out[i] /= sum;
    }
}

static void softmax_back_row(double epsilon, size_t c, const double *y, const double *g, double *out) {
    double sum = 0;
    (void)epsilon;
    for (size_t i = 0; i < c; i++) {
        sum += g[i] * y[i];
    }
    for (size_t i = 0; i < c; i++) {
        out[i] = y[i] * (g[i] - sum);
    }
}

static void softmax_forward(nn_call *call) {
    row_job job = {.call = call, .row = softmax_row, .a = call->in[0], .to = call->out};
    run(&job);
}

static void softmax_backward(nn_call *call) {
    if (call->din[0].data != NULL) {
        row_job job = {.call = call,
                       .row = softmax_back_row,
                       .a = call->out,
                       .g = call->dout,
                       .to = call->din[0],
                       .add = call->add[0]};
        run(&job);
    }
}

static const nn_op softmax_op = {.name = "softmax",
                                 .keeps = NN_KEEP_OUT,
                                 .in_place = true,
                                 .grad_in_place = 1,
                                 .forward = softmax_forward,
                                 .backward = softmax_backward,
                                 .scratch_bytes = scratch_bytes};

nn_value nn_softmax(nn_graph *g, nn_value x) {
    return add_rows(g, &softmax_op, x, 0);
}

/* ---- x/(|x| + epsilon) ---- */

static double length(const double *x, size_t c) {
    double sum = 0;
    for (size_t i = 0; i < c; i++) {
        sum += x[i] * x[i];
    }
    return sqrt(sum);
}

static void l2_row(double epsilon, size_t c, const double *x, const double *g, double *out) {
    const double r = length(x, c), scale = r != 0 ? 1 / (r + epsilon) : 0;
    (void)g;
    for (size_t i = 0; i < c; i++) {
        out[i] = x[i] * scale;
    }
}

/* d = g/(r + e) - x (x.g)/(r (r + e)^2), r = |x| */
static void l2_back_row(double epsilon, size_t c, const double *x, const double *g, double *out) {
    const double r = length(x, c), scale = r != 0 ? 1 / (r + epsilon) : 0;
    double dot = 0;
    for (size_t i = 0; i < c; i++) {
        dot += x[i] * g[i];
    }
    const double along = r != 0 ? dot * scale * scale / r : 0;
    for (size_t i = 0; i < c; i++) {
        out[i] = g[i] * scale - x[i] * along;
    }
}

static void l2_forward(nn_call *call) {
    row_job job = {.call = call, .row = l2_row, .a = call->in[0], .to = call->out};
    run(&job);
}

static void l2_backward(nn_call *call) {
    if (call->din[0].data != NULL) {
        row_job job = {.call = call,
                       .row = l2_back_row,
                       .a = call->in[0],
                       .g = call->dout,
                       .to = call->din[0],
                       .add = call->add[0]};
        run(&job);
    }
}

static const nn_op l2_op = {.name = "l2_normalize",
                            .keeps = NN_KEEP_IN0,
                            .in_place = true,
                            .grad_in_place = 1,
                            .forward = l2_forward,
                            .backward = l2_backward,
                            .scratch_bytes = scratch_bytes};

nn_value nn_l2_normalize(nn_graph *g, nn_value x, double epsilon) {
    return epsilon >= 0 ? add_rows(g, &l2_op, x, epsilon) : nn_reject(g, "l2_normalize: epsilon is %g", epsilon);
}
