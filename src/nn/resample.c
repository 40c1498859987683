/* SPDX-License-Identifier: Apache-2.0 */
/*
 * resample.c: bilinear resizing as PyTorch's interpolate does it: pixel i of the
 * result lies at i (in - 1)/(out - 1) with aligned corners, else at
 * max((i + 1/2) in/out - 1/2, 0), and the last pixel goes on beyond the edge.
 */
#include <string.h>

#include "nn/chunks.h"

typedef struct resize {
    bool align_corners;
} resize;

/* (1 - f) of pixel i and f of pixel j. */
typedef struct tap {
    int i, j;
    double f;
} tap;

static tap tap_of(const resize *r, int o, int in, int out) {
    double at;
    if (r->align_corners) {
        at = out > 1 ? (double)o * (in - 1) / (out - 1) : 0;
    } else {
        at = (o + 0.5) * in / out - 0.5;
        at = at > 0 ? at : 0;
    }
    int i = (int)at;
    i = i < in - 1 ? i : in - 1;
    return (tap){i, i + 1 < in ? i + 1 : i, at - i};
}

typedef struct resize_job {
    nn_call *call;
    const resize *r;
    nn_shape in, out;
    const nn_rows *rows;
} resize_job;

static void forward_rows(void *arg, size_t begin, size_t end, int worker) {
    const resize_job *job = arg;
    const size_t c = (size_t)job->in.c, pixel = c * job->rows->s_size, row = pixel * (size_t)job->in.w;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const tap v = tap_of(job->r, (int)(i % (size_t)job->out.h), job->in.h, job->out.h);
        const unsigned char *picture =
            (const unsigned char *)job->call->in[0].data + i / (size_t)job->out.h * (size_t)job->in.h * row;
        const unsigned char *top = picture + (size_t)v.i * row, *bottom = picture + (size_t)v.j * row;
        unsigned char *to = (unsigned char *)job->call->out.data + i * (size_t)job->out.w * pixel;
        for (int x = 0; x < job->out.w; x++) {
            const tap u = tap_of(job->r, x, job->in.w, job->out.w);
            const void *from[4] = {top + (size_t)u.i * pixel, top + (size_t)u.j * pixel, bottom + (size_t)u.i * pixel,
                                   bottom + (size_t)u.j * pixel};
            const double weights[4] = {(1 - v.f) * (1 - u.f), (1 - v.f) * u.f, v.f * (1 - u.f), v.f * u.f};
            job->rows->blend(from, weights, 4, to + (size_t)x * pixel, c, false);
        }
    }
}

static void forward(nn_call *call) {
    resize_job job = {call, call->attributes, call->in[0].shape, call->out.shape, nn_rows_of(call->out.type)};
    core_parallel(call->pool, (size_t)job.out.n * (size_t)job.out.h, 4, forward_rows, &job);
}

static size_t room(nn_shape in) {
    return ((size_t)in.w * (size_t)in.c * 8 + 63) / 64 * 64;
}

/* A row of the input gathers from the rows of the result that it has a part in. */
static void backward_rows(void *arg, size_t begin, size_t end, int worker) {
    const resize_job *job = arg;
    const size_t c = (size_t)job->in.c, pixel = c * job->rows->s_size, wide = c * job->rows->t_size;
    unsigned char *sums = (unsigned char *)job->call->scratch + (size_t)worker * room(job->in);
    for (size_t i = begin; i < end; i++) {
        const int y = (int)(i % (size_t)job->in.h);
        int low = 0, high = job->out.h; /* the first row whose first tap is y - 1 or later */
        while (low < high) {
            const int middle = low + (high - low) / 2;
            if (tap_of(job->r, middle, job->in.h, job->out.h).i >= y - 1) {
                high = middle;
            } else {
                low = middle + 1;
            }
        }
        memset(sums, 0, (size_t)job->in.w * wide);
        for (int oy = low; oy < job->out.h; oy++) {
            const tap v = tap_of(job->r, oy, job->in.h, job->out.h);
            const double weight = (v.i == y ? 1 - v.f : 0) + (v.j == y ? v.f : 0);
            if (v.i > y) {
                break;
            }
            if (weight == 0) {
                continue;
            }
            const unsigned char *g =
                (const unsigned char *)job->call->dout.data +
                (i / (size_t)job->in.h * (size_t)job->out.h + (size_t)oy) * (size_t)job->out.w * pixel;
            for (int x = 0; x < job->out.w; x++) {
                const tap u = tap_of(job->r, x, job->in.w, job->out.w);
                job->rows->add_weighted(weight * (1 - u.f), g + (size_t)x * pixel, sums + (size_t)u.i * wide, c);
                job->rows->add_weighted(weight * u.f, g + (size_t)x * pixel, sums + (size_t)u.j * wide, c);
            }
        }
        const size_t width = (size_t)job->in.w * c;
        nn_put(job->rows, job->call->din[0], i * width, width, sums, job->call->add[0]);
    }
}

static void backward(nn_call *call) {
    if (call->din[0].data != NULL) {
        resize_job job = {call, call->attributes, call->din[0].shape, call->dout.shape, nn_rows_of(call->dout.type)};
        core_parallel(call->pool, (size_t)job.in.n * (size_t)job.in.h, 2, backward_rows, &job);
    }
}

static size_t scratch_bytes(const nn_call *call, bool backward_pass, int threads) {
    return backward_pass ? (size_t)threads * room(call->in[0].shape) : 0;
}

static double flops(const nn_call *call) {
    return 8 * (double)nn_count(call->out.shape);
}

static const nn_op resize_op = {
    .name = "resize", .forward = forward, .backward = backward, .scratch_bytes = scratch_bytes, .flops = flops};

nn_value nn_resize(nn_graph *g, nn_value x, int h, int w, bool align_corners) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    const nn_shape s = nn_shape_of(g, x);
    return nn_node_add(g, &(nn_node_params){.op = &resize_op,
                                            .inputs = 1,
                                            .in = &x,
                                            .shape = {s.n, h, w, s.c},
                                            .type = nn_type_of(g, x),
                                            .attributes = &(resize){align_corners},
                                            .attributes_size = sizeof(resize)});
}
