/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pooling.c: means and maxima over windows. Backward gathers: each pixel of the
 * input asks the windows that it is in, so that no two workers write to one place.
 */
#include <math.h>
#include <string.h>

#include "nn/chunks.h"

typedef struct pool {
    int kernel, stride; /* 0: adaptive */
} pool;

/* Window o of `count` over `size` pixels: begin <= i < end. */
typedef struct window {
    int begin, end;
} window;

static window window_of(const pool *p, int o, int size, int count) {
    if (p->kernel == 0) { /* floor(o size/count) to ceil((o + 1) size/count) */
        return (window){(int)((int64_t)o * size / count), (int)((((int64_t)o + 1) * size + count - 1) / count)};
    }
    const int begin = o * p->stride, end = begin + p->kernel;
    return (window){begin, end < size ? end : size};
}

/* The first window that ends behind pixel i: those that contain it follow from there. */
static int first_window(const pool *p, int i, int size, int count) {
    int low = 0, high = count;
    while (low < high) {
        const int middle = low + (high - low) / 2;
        if (window_of(p, middle, size, count).end > i) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    return low;
}

typedef struct pool_job {
    nn_call *call;
    const pool *p;
    nn_shape in, out;
    const nn_rows *rows;
} pool_job;

static const unsigned char *at(const void *data, nn_shape s, size_t bytes, size_t n, int y, int x, size_t c) {
    return (const unsigned char *)data +
           (((n * (size_t)s.h + (size_t)y) * (size_t)s.w + (size_t)x) * (size_t)s.c + c) * bytes;
}

static size_t piece_at(size_t c, size_t start) {
    return c - start < NN_CHUNK ? c - start : NN_CHUNK;
}

/* ---- means ---- */

static void average_rows(void *arg, size_t begin, size_t end, int worker) {
    const pool_job *job = arg;
    const nn_shape in = job->in, out = job->out;
    const size_t size = job->rows->s_size, c = (size_t)in.c;
    nn_chunk sums;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const size_t n = i / (size_t)out.h;
        const window v = window_of(job->p, (int)(i % (size_t)out.h), in.h, out.h);
        for (int ox = 0; ox < out.w; ox++) {
            const window u = window_of(job->p, ox, in.w, out.w);
            const double weight = 1 / ((double)(v.end - v.begin) * (u.end - u.begin));
            for (size_t start = 0; start < c; start += NN_CHUNK) {
                const size_t piece = piece_at(c, start);
                memset(&sums, 0, piece * job->rows->t_size);
                for (int y = v.begin; y < v.end; y++) {
                    for (int x = u.begin; x < u.end; x++) {
                        job->rows->add_weighted(weight, at(job->call->in[0].data, in, size, n, y, x, start), &sums,
                                                piece);
                    }
                }
                nn_put(job->rows, job->call->out, (i * (size_t)out.w + (size_t)ox) * c + start, piece, &sums, false);
            }
        }
    }
}

static void average_back_rows(void *arg, size_t begin, size_t end, int worker) {
    const pool_job *job = arg;
    const nn_shape in = job->in, out = job->out;
    const size_t size = job->rows->s_size, c = (size_t)in.c;
    nn_chunk sums;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const size_t n = i / (size_t)in.h;
        const int y = (int)(i % (size_t)in.h), first_y = first_window(job->p, y, in.h, out.h);
        for (int x = 0; x < in.w; x++) {
            const int first_x = first_window(job->p, x, in.w, out.w);
            for (size_t start = 0; start < c; start += NN_CHUNK) {
                const size_t piece = piece_at(c, start);
                memset(&sums, 0, piece * job->rows->t_size);
                for (int oy = first_y; oy < out.h && window_of(job->p, oy, in.h, out.h).begin <= y; oy++) {
                    const window v = window_of(job->p, oy, in.h, out.h);
                    for (int ox = first_x; ox < out.w && window_of(job->p, ox, in.w, out.w).begin <= x; ox++) {
                        const window u = window_of(job->p, ox, in.w, out.w);
                        job->rows->add_weighted(1 / ((double)(v.end - v.begin) * (u.end - u.begin)),
                                                at(job->call->dout.data, out, size, n, oy, ox, start), &sums, piece);
                    }
                }
                nn_put(job->rows, job->call->din[0], (i * (size_t)in.w + (size_t)x) * c + start, piece, &sums,
                       job->call->add[0]);
            }
        }
    }
}

/* ---- maxima: the place of each is kept as y w + x ---- */

static void max_rows(void *arg, size_t begin, size_t end, int worker) {
    const pool_job *job = arg;
    const nn_shape in = job->in, out = job->out;
    const size_t size = job->rows->s_size, c = (size_t)in.c;
    nn_chunk most;
    int32_t unused[NN_CHUNK];
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const size_t n = i / (size_t)out.h;
        const window v = window_of(job->p, (int)(i % (size_t)out.h), in.h, out.h);
        for (int ox = 0; ox < out.w; ox++) {
            const window u = window_of(job->p, ox, in.w, out.w);
            for (size_t start = 0; start < c; start += NN_CHUNK) {
                const size_t piece = piece_at(c, start), to = (i * (size_t)out.w + (size_t)ox) * c + start;
                int32_t *where = job->call->saved != NULL ? (int32_t *)job->call->saved + to : unused;
                for (int y = v.begin; y < v.end; y++) {
                    for (int x = u.begin; x < u.end; x++) {
                        const unsigned char *from = at(job->call->in[0].data, in, size, n, y, x, start);
                        const int32_t place = y * in.w + x;
                        if (y == v.begin && x == u.begin) {
                            job->rows->load(from, &most, piece);
                            for (size_t k = 0; k < piece; k++) {
                                where[k] = place;
                            }
                        } else {
                            job->rows->maximum(from, &most, where, place, piece);
                        }
                    }
                }
                nn_put(job->rows, job->call->out, to, piece, &most, false);
            }
        }
    }
}

static void max_back_rows(void *arg, size_t begin, size_t end, int worker) {
    const pool_job *job = arg;
    const nn_shape in = job->in, out = job->out;
    const nn_view d = job->call->din[0];
    const size_t size = job->rows->s_size, c = (size_t)in.c;
    double sums[NN_CHUNK], g[NN_CHUNK];
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const size_t n = i / (size_t)in.h;
        const int y = (int)(i % (size_t)in.h), first_y = first_window(job->p, y, in.h, out.h);
        for (int x = 0; x < in.w; x++) {
            const int first_x = first_window(job->p, x, in.w, out.w);
            const int32_t place = y * in.w + x;
            for (size_t start = 0; start < c; start += NN_CHUNK) {
                const size_t piece = piece_at(c, start);
                memset(sums, 0, piece * sizeof *sums);
                for (int oy = first_y; oy < out.h && window_of(job->p, oy, in.h, out.h).begin <= y; oy++) {
                    for (int ox = first_x; ox < out.w && window_of(job->p, ox, in.w, out.w).begin <= x; ox++) {
                        const int32_t *where =
                            (const int32_t *)(const void *)at(job->call->saved, out, 4, n, oy, ox, start);
                        nn_load_double(d.type, at(job->call->dout.data, out, size, n, oy, ox, start), g, piece);
                        for (size_t k = 0; k < piece; k++) {
                            sums[k] += where[k] == place ? g[k] : 0;
                        }
                    }
                }
                nn_store_double(d.type, sums,
                                (unsigned char *)d.data + ((i * (size_t)in.w + (size_t)x) * c + start) * size, piece,
                                job->call->add[0]);
            }
        }
    }
}

static void run(nn_call *call, core_range_fn *fn, bool backward) {
    pool_job job = {call, call->attributes, call->in[0].shape, backward ? call->dout.shape : call->out.shape,
                    nn_rows_of(call->in[0].type)};
    if (backward && call->din[0].data == NULL) {
        return;
    }
    const nn_shape s = backward ? job.in : job.out;
    core_parallel(call->pool, (size_t)s.n * (size_t)s.h, 2, fn, &job);
}

static void average_forward(nn_call *call) {
    run(call, average_rows, false);
}
static void average_backward(nn_call *call) {
    run(call, average_back_rows, true);
}
static void max_forward(nn_call *call) {
    run(call, max_rows, false);
}
static void max_backward(nn_call *call) {
    run(call, max_back_rows, true);
}

static size_t max_saved(const nn_call *call) {
    return nn_count(call->out.shape) * sizeof(int32_t);
}

static const nn_op average_op = {.name = "average_pool", .forward = average_forward, .backward = average_backward};
static const nn_op max_op = {
    .name = "max_pool", .forward = max_forward, .backward = max_backward, .saved_bytes = max_saved};

static nn_value add_pool(nn_graph *g, const nn_op *op, nn_value x, int h, int w, int kernel, int stride) {
    const nn_shape s = nn_shape_of(g, x);
    return nn_node_add(g, &(nn_node_params){.op = op,
                                            .inputs = 1,
                                            .in = &x,
                                            .shape = {s.n, h, w, s.c},
                                            .type = nn_type_of(g, x),
                                            .attributes = &(pool){kernel, stride},
                                            .attributes_size = sizeof(pool)});
}

static int windows(int size, int kernel, int stride, bool ceil_mode) {
    int count = (size - kernel + (ceil_mode ? stride - 1 : 0)) / stride + 1;
    return (int64_t)(count - 1) * stride >= size ? count - 1 : count; /* the last one begins inside */
}

static bool can_pool(nn_graph *g, const char *name, nn_value x, int kernel, int stride) {
    if (!nn_usable(g, x)) {
        return false;
    }
    const nn_shape s = nn_shape_of(g, x);
    if (kernel < 1 || stride < 1 || stride > 1 << 20 || kernel > s.h || kernel > s.w ||
        (int64_t)s.h * s.w > INT32_MAX) {
        nn_reject(g, "%s: windows of %d in steps of %d in %s", name, kernel, stride, nn_text_of(s).text);
        return false;
    }
    return true;
}

nn_value nn_average_pool(nn_graph *g, nn_value x, int kernel, int stride) {
    if (!can_pool(g, "average_pool", x, kernel, stride)) {
        return 0;
    }
    const nn_shape s = nn_shape_of(g, x);
    return add_pool(g, &average_op, x, windows(s.h, kernel, stride, false), windows(s.w, kernel, stride, false), kernel,
                    stride);
}

nn_value nn_adaptive_average_pool(nn_graph *g, nn_value x, int h, int w) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    if (h < 1 || w < 1) {
        return nn_reject(g, "adaptive_average_pool: to %d x %d", h, w);
    }
    return add_pool(g, &average_op, x, h, w, 0, 0);
}

nn_value nn_max_pool(nn_graph *g, nn_value x, int kernel, int stride, bool ceil_mode) {
    if (!can_pool(g, "max_pool", x, kernel, stride)) {
        return 0;
    }
    const nn_shape s = nn_shape_of(g, x);
    return add_pool(g, &max_op, x, windows(s.h, kernel, stride, ceil_mode), windows(s.w, kernel, stride, ceil_mode),
                    kernel, stride);
}
