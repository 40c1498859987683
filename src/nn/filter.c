/* SPDX-License-Identifier: Apache-2.0 */
/* filter.c: each channel with the same fixed filter, zeros around the picture. */
#include <string.h>

#include "nn/node.h"

enum { MAX_KERNEL = 15, STRIP = 64 /* channels at a time */ };

typedef struct filter_attributes {
    int kernel, stride, pad;
    float taps[MAX_KERNEL * MAX_KERNEL];
} filter_attributes;

typedef struct filter_run {
    const nn_call *call;
    nn_view from, to;
    bool backward, add;
} filter_run;

static void add_line(double *sum, const nn_view *from, size_t at, size_t count, double tap) {
    switch (from->type) {
    case NN_F32:
        for (size_t i = 0; i < count; i++) {
            sum[i] += tap * (double)((const float *)from->data)[at + i];
        }
        break;
    case NN_F64:
        for (size_t i = 0; i < count; i++) {
            sum[i] += tap * ((const double *)from->data)[at + i];
        }
        break;
    case NN_BF16:
        for (size_t i = 0; i < count; i++) {
            sum[i] += tap * (double)nn_from_bf16(((const uint16_t *)from->data)[at + i]);
        }
        break;
    }
}

static void put_line(const nn_view *to, size_t at, const double *sum, size_t count) {
    switch (to->type) {
    case NN_F32:
        for (size_t i = 0; i < count; i++) {
            ((float *)to->data)[at + i] = (float)sum[i];
        }
        break;
    case NN_F64:
        memcpy((double *)to->data + at, sum, count * sizeof *sum);
        break;
    case NN_BF16:
        for (size_t i = 0; i < count; i++) {
            ((uint16_t *)to->data)[at + i] = nn_to_bf16((float)sum[i]);
        }
        break;
    }
}

/* Where tap i of target t comes from along one axis: forward s t + i - p; backward (t + p - i) / s where that is whole.
 * -1: from nowhere. */
static int source(const filter_attributes *a, bool backward, int t, int i, int size) {
    int at = backward ? t + a->pad - i : t * a->stride + i - a->pad;
    if (at < 0 || (backward && at % a->stride != 0)) {
        return -1;
    }
    at = backward ? at / a->stride : at;
    return at < size ? at : -1;
}

static void rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const filter_run *r = arg;
    const filter_attributes *a = r->call->attributes;
    nn_shape from = r->from.shape, to = r->to.shape;
    size_t channels = (size_t)to.c;
    for (size_t row = begin; row < end; row++) {
        size_t n = row / (size_t)to.h;
        int y = (int)(row % (size_t)to.h);
        for (int x = 0; x < to.w; x++) {
            size_t pixel = (row * (size_t)to.w + (size_t)x) * channels;
            for (size_t c = 0; c < channels; c += STRIP) {
                size_t count = channels - c < STRIP ? channels - c : STRIP;
                double sum[STRIP] = {0};
                if (r->add) {
                    add_line(sum, &r->to, pixel + c, count, 1);
                }
                for (int i = 0; i < a->kernel; i++) {
                    int fy = source(a, r->backward, y, i, from.h);
                    for (int j = 0; j < a->kernel && fy >= 0; j++) {
                        int fx = source(a, r->backward, x, j, from.w);
                        if (fx >= 0) {
                            size_t at = ((n * (size_t)from.h + (size_t)fy) * (size_t)from.w + (size_t)fx) * channels + c;
                            add_line(sum, &r->from, at, count, (double)a->taps[i * a->kernel + j]);
                        }
                    }
                }
                put_line(&r->to, pixel + c, sum, count);
            }
        }
    }
}

static void forward(nn_call *call) {
    filter_run r = {call, call->in[0], call->out, false, false};
    core_parallel(call->pool, (size_t)r.to.shape.n * (size_t)r.to.shape.h, 1, rows, &r);
}

static void backward(nn_call *call) {
    filter_run r = {call, call->dout, call->din[0], true, call->add[0]};
    core_parallel(call->pool, (size_t)r.to.shape.n * (size_t)r.to.shape.h, 1, rows, &r);
}

static double flops(const nn_call *call) {
    const filter_attributes *a = call->attributes;
    return 2.0 * (double)nn_count(call->out.shape) * a->kernel * a->kernel;
}

static const nn_op op_filter = {.name = "filter", .forward = forward, .backward = backward, .flops = flops};

nn_value nn_filter(nn_graph *g, nn_value x, int kernel, int stride, int pad, const float *taps) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    nn_shape in = nn_shape_of(g, x);
    if (kernel < 1 || kernel > MAX_KERNEL || stride < 1 || stride > 64 || pad < 0 || pad >= kernel ||
        in.h > INT32_MAX - 2 * pad || in.w > INT32_MAX - 2 * pad || in.h + 2 * pad < kernel || in.w + 2 * pad < kernel) {
        return nn_reject(g, "a filter of %d x %d taps with stride %d and padding %d does not fit %d x %d pixels", kernel,
                         kernel, stride, pad, in.w, in.h);
    }
    filter_attributes a = {.kernel = kernel, .stride = stride, .pad = pad};
    memcpy(a.taps, taps, (size_t)(kernel * kernel) * sizeof *taps);
    return nn_node_add(g, &(nn_node_params){
                              .op = &op_filter,
                              .inputs = 1,
                              .in = &x,
                              .shape = {in.n, (in.h + 2 * pad - kernel) / stride + 1,
                                        (in.w + 2 * pad - kernel) / stride + 1, in.c},
                              .type = nn_type_of(g, x),
                              .attributes = &a,
                              .attributes_size = sizeof a,
                          });
}
