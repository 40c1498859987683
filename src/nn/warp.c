/* SPDX-License-Identifier: Apache-2.0 */
/*
 * warp.c: reads x at each pixel moved by a flow (dx, dy), as PyTorch's grid_sample
 * with aligned corners. Beyond the border: zero, or the nearest pixel; there the
 * gradient of the flow is zero.
 *
 * Backward to x is a scatter: each worker takes some channels of one picture and
 * goes through its pixels in order, so that no two write to one place and sums are
 * always made in the same order.
 */
#include <string.h>

#include "nn/chunks.h"
#include "nn/move.h"
#include "nn/sample.h"

typedef struct warp {
    nn_border border;
} warp;

typedef struct warp_job {
    nn_call *call;
    nn_shape s; /* of x and of the result */
    nn_border border;
    const nn_rows *rows;
    nn_view flow, x, g;
    size_t channels;     /* of a block, in backward */
    unsigned char *sums; /* T */
} warp_job;

enum { BLOCK = 32 /* channels */ };

static nn_corners corners_at(const warp_job *job, size_t pixel, bool *moves_x, bool *moves_y) {
    double f[2];
    nn_load_double(job->flow.type, (const unsigned char *)job->flow.data + 2 * pixel * nn_type_size(job->flow.type), f,
                   2);
    const size_t w = (size_t)job->s.w, h = (size_t)job->s.h;
    double x = (double)(pixel % w) + f[0], y = (double)(pixel / w % h) + f[1];
    *moves_x = *moves_y = true;
    if (job->border == NN_REPLICATE) {
        const double right = job->s.w - 1, bottom = job->s.h - 1;
        *moves_x = x > 0 && x < right;
        *moves_y = y > 0 && y < bottom;
        x = x > 0 ? (x < right ? x : right) : 0; /* NaN: 0 */
        y = y > 0 ? (y < bottom ? y : bottom) : 0;
    }
    return nn_corners_of(y, x, job->s.h, job->s.w);
}

static void forward_pixels(void *arg, size_t begin, size_t end, int worker) {
    const warp_job *job = arg;
    const size_t picture = (size_t)job->s.h * (size_t)job->s.w, c = (size_t)job->s.c, bytes = c * job->rows->s_size;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        bool unused[2];
        const nn_corners k = corners_at(job, i, &unused[0], &unused[1]);
        const unsigned char *from = (const unsigned char *)job->x.data + i / picture * picture * bytes;
        const void *rows[4];
        for (int j = 0; j < k.count; j++) {
            rows[j] = from + k.pixel[j] * bytes;
        }
        job->rows->blend(rows, k.weight, k.count, (unsigned char *)job->call->out.data + i * bytes, c, false);
    }
}

static warp_job job_of(nn_call *call) {
    return (warp_job){.call = call,
                      .s = call->in[0].shape,
                      .border = ((const warp *)call->attributes)->border,
                      .rows = nn_rows_of(call->in[0].type),
                      .flow = call->in[1],
                      .x = call->in[0],
                      .g = call->dout};
}

static void forward(nn_call *call) {
    warp_job job = job_of(call);
    core_parallel(call->pool, nn_count(job.s) / (size_t)job.s.c, 512, forward_pixels, &job);
}

/* d loss/d flow = sum over channels of g times the slope of x between the corners. */
static void flow_pixels(void *arg, size_t begin, size_t end, int worker) {
    const warp_job *job = arg;
    const size_t picture = (size_t)job->s.h * (size_t)job->s.w, c = (size_t)job->s.c, bytes = c * job->rows->s_size;
    const nn_view d = job->call->din[1];
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        bool moves_x, moves_y;
        const nn_corners k = corners_at(job, i, &moves_x, &moves_y);
        const unsigned char *from = (const unsigned char *)job->x.data + i / picture * picture * bytes;
        double sum[2] = {0, 0};
        for (int j = 0; j < k.count; j++) {
            const double dot =
                job->rows->dot((const unsigned char *)job->g.data + i * bytes, from + k.pixel[j] * bytes, c);
            sum[0] += k.dx[j] * dot;
            sum[1] += k.dy[j] * dot;
        }
        sum[0] = moves_x ? sum[0] : 0;
        sum[1] = moves_y ? sum[1] : 0;
        nn_store_double(d.type, sum, (unsigned char *)d.data + 2 * i * nn_type_size(d.type), 2, job->call->add[1]);
    }
}

static void scatter_blocks(void *arg, size_t begin, size_t end, int worker) {
    const warp_job *job = arg;
    const size_t picture = (size_t)job->s.h * (size_t)job->s.w, c = (size_t)job->s.c;
    const size_t blocks = (c + job->channels - 1) / job->channels;
    (void)worker;
    for (size_t b = begin; b < end; b++) {
        const size_t n = b / blocks, start = b % blocks * job->channels;
        const size_t few = c - start < job->channels ? c - start : job->channels;
        for (size_t i = n * picture; i < (n + 1) * picture; i++) {
            bool unused[2];
            const nn_corners k = corners_at(job, i, &unused[0], &unused[1]);
            const unsigned char *g = (const unsigned char *)job->g.data + (i * c + start) * job->rows->s_size;
            for (int j = 0; j < k.count; j++) {
                job->rows->add_weighted(k.weight[j], g,
                                        job->sums + ((n * picture + k.pixel[j]) * c + start) * job->rows->t_size, few);
            }
        }
    }
}

static void put_chunk(const void *context, size_t offset, size_t n) {
    const warp_job *job = context;
    nn_put(job->rows, job->call->din[0], offset, n, job->sums + offset * job->rows->t_size, job->call->add[0]);
}

static void backward(nn_call *call) {
    warp_job job = job_of(call);
    const nn_view d = call->din[0];
    if (call->din[0].data != NULL) {
        const size_t c = (size_t)job.s.c;
        const bool direct = d.type != NN_BF16;
        job.channels = c > BLOCK ? BLOCK : c > 4 ? (c + 1) / 2 : c;
        job.sums = direct ? d.data : call->scratch;
        if (!direct || !call->add[0]) {
            nn_zero(call->pool, job.sums, nn_count(job.s) * job.rows->t_size);
        }
        core_parallel(call->pool, (size_t)job.s.n * ((c + job.channels - 1) / job.channels), 1, scatter_blocks, &job);
        if (!direct) {
            nn_each_chunk(call->pool, nn_count(job.s), put_chunk, &job);
        }
    }
    if (call->din[1].data != NULL) {
        core_parallel(call->pool, nn_count(job.s) / (size_t)job.s.c, 512, flow_pixels, &job);
    }
}

static size_t scratch_bytes(const nn_call *call, bool backward_pass, int threads) {
    (void)threads;
    return backward_pass && call->in[0].type == NN_BF16 ? nn_count(call->in[0].shape) * sizeof(float) : 0;
}

static double flops(const nn_call *call) {
    return 8 * (double)nn_count(call->out.shape);
}

static const nn_op warp_op = {.name = "warp",
                              .keeps = NN_KEEP_IN0 | NN_KEEP_IN1,
                              .forward = forward,
                              .backward = backward,
                              .scratch_bytes = scratch_bytes,
                              .flops = flops};

nn_value nn_warp(nn_graph *g, nn_value x, nn_value flow, nn_border border) {
    if (!nn_usable(g, x) || !nn_usable(g, flow)) {
        return 0;
    }
    const nn_shape s = nn_shape_of(g, x), f = nn_shape_of(g, flow);
    if (f.n != s.n || f.h != s.h || f.w != s.w || f.c != 2 || nn_type_of(g, flow) == NN_BF16) {
        return nn_reject(g, "warp: a flow of %s (f32) for %s", nn_text_of(f).text, nn_text_of(s).text);
    }
    if (border != NN_ZERO && border != NN_REPLICATE) {
        return nn_reject(g, "warp: beyond the border is zero, or the edge");
    }
    return nn_node_add(g, &(nn_node_params){.op = &warp_op,
                                            .inputs = 2,
                                            .in = (const nn_value[]){x, flow},
                                            .shape = s,
                                            .type = nn_type_of(g, x),
                                            .attributes = &(warp){border},
                                            .attributes_size = sizeof(warp)});
}
