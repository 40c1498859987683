/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pad.c: rows and columns added around a picture: zeros, the mirrored inside (the
 * edge itself not twice), or the edge again.
 */
#include <string.h>

#include "nn/chunks.h"
#include "nn/move.h"

typedef struct pad {
    int top, left;
    nn_border border;
} pad;

typedef struct pad_job {
    nn_call *call;
    const pad *p;
    nn_shape in, out;
    const nn_rows *rows;
} pad_job;

/* Where the number at i comes from; i may be up to n - 1 outside. -1: from nowhere, it is zero. */
static int source(nn_border border, int i, int n) {
    if (i >= 0 && i < n) {
        return i;
    }
    if (border == NN_ZERO) {
        return -1;
    }
    if (border == NN_REPLICATE) {
        return i < 0 ? 0 : n - 1;
    }
    return i < 0 ? -i : 2 * n - 2 - i;
}

static void forward_rows(void *arg, size_t begin, size_t end, int worker) {
    const pad_job *job = arg;
    const size_t pixel = (size_t)job->in.c * job->rows->s_size, row = pixel * (size_t)job->in.w;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const size_t n = i / (size_t)job->out.h;
        const int y = source(job->p->border, (int)(i % (size_t)job->out.h) - job->p->top, job->in.h);
        unsigned char *to = (unsigned char *)job->call->out.data + i * pixel * (size_t)job->out.w;
        const unsigned char *from =
            (const unsigned char *)job->call->in[0].data + (n * (size_t)job->in.h + (size_t)(y < 0 ? 0 : y)) * row;
        for (int x = 0; x < job->out.w; x++) {
            const int sx = y < 0 ? -1 : source(job->p->border, x - job->p->left, job->in.w);
            if (sx < 0) {
                memset(to + (size_t)x * pixel, 0, pixel);
            } else if (x == job->p->left) {
                memcpy(to + (size_t)x * pixel, from, row);
                x += job->in.w - 1;
            } else {
                memcpy(to + (size_t)x * pixel, from + (size_t)sx * pixel, pixel);
            }
        }
    }
}

static void forward(nn_call *call) {
    pad_job job = {call, call->attributes, call->in[0].shape, call->out.shape, nn_rows_of(call->out.type)};
    core_parallel(call->pool, (size_t)job.out.n * (size_t)job.out.h, 8, forward_rows, &job);
}

/* A row of the input gathers from each row of the result that was made from it. */
static void backward_rows(void *arg, size_t begin, size_t end, int worker) {
    const pad_job *job = arg;
    const size_t c = (size_t)job->in.c, pixel = c * job->rows->s_size, width = (size_t)job->in.w * c;
    unsigned char *sums = (unsigned char *)job->call->scratch + (size_t)worker * ((width * 8 + 63) / 64 * 64);
    for (size_t i = begin; i < end; i++) {
        const size_t n = i / (size_t)job->in.h;
        const int y = (int)(i % (size_t)job->in.h);
        memset(sums, 0, width * job->rows->t_size);
        for (int oy = 0; oy < job->out.h; oy++) {
            if (source(job->p->border, oy - job->p->top, job->in.h) != y) {
                continue;
            }
            const unsigned char *g = (const unsigned char *)job->call->dout.data +
                                     (n * (size_t)job->out.h + (size_t)oy) * (size_t)job->out.w * pixel;
            for (int x = 0; x < job->out.w; x++) {
                const int sx = source(job->p->border, x - job->p->left, job->in.w);
                if (x == job->p->left) {
                    job->rows->add_weighted(1, g + (size_t)x * pixel, sums, width);
                    x += job->in.w - 1;
                } else if (sx >= 0) {
                    job->rows->add_weighted(1, g + (size_t)x * pixel, sums + (size_t)sx * c * job->rows->t_size, c);
                }
            }
        }
        nn_put(job->rows, job->call->din[0], i * width, width, sums, job->call->add[0]);
    }
}

static void backward(nn_call *call) {
    if (call->din[0].data != NULL) {
        pad_job job = {call, call->attributes, call->din[0].shape, call->dout.shape, nn_rows_of(call->dout.type)};
        core_parallel(call->pool, (size_t)job.in.n * (size_t)job.in.h, 8, backward_rows, &job);
    }
}

static size_t scratch_bytes(const nn_call *call, bool backward_pass, int threads) {
    const size_t width = (size_t)call->in[0].shape.w * (size_t)call->in[0].shape.c;
    return backward_pass ? (size_t)threads * ((width * 8 + 63) / 64 * 64) : 0;
}

static const nn_op pad_op = {.name = "pad", .forward = forward, .backward = backward, .scratch_bytes = scratch_bytes};

nn_value nn_pad(nn_graph *g, nn_value x, int top, int bottom, int left, int right, nn_border border) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    const nn_shape s = nn_shape_of(g, x);
    const int most_h = border == NN_REFLECT ? s.h - 1 : 1 << 20, most_w = border == NN_REFLECT ? s.w - 1 : 1 << 20;
    if (top < 0 || bottom < 0 || left < 0 || right < 0 || top > most_h || bottom > most_h || left > most_w ||
        right > most_w) {
        return nn_reject(g, "pad: %d, %d, %d, %d around %s", top, bottom, left, right, nn_text_of(s).text);
    }
    return nn_node_add(g, &(nn_node_params){.op = &pad_op,
                                            .inputs = 1,
                                            .in = &x,
                                            .shape = {s.n, s.h + top + bottom, s.w + left + right, s.c},
                                            .type = nn_type_of(g, x),
                                            .attributes = &(pad){top, left, border},
                                            .attributes_size = sizeof(pad)});
}
