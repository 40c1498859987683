/* SPDX-License-Identifier: Apache-2.0 */
/*
 * shape.c: operations that only move numbers; backward moves them back.
 */
#include <string.h>

#include "nn/chunks.h"
#include "nn/move.h"

/* ---- one to one: flip, roll, permute, pixel shuffle: one or two moves that cover both sides once ---- */

typedef struct moves {
    int count;
    nn_move move[2];
} moves;

static void moves_forward(nn_call *call) {
    const moves *m = call->attributes;
    for (int i = 0; i < m->count; i++) {
        nn_move_run(call->pool, call->out.type, call->in[0].data, call->out.data, &m->move[i], false, false);
    }
}

static void moves_backward(nn_call *call) {
    const moves *m = call->attributes;
    for (int i = 0; i < m->count && call->din[0].data != NULL; i++) {
        nn_move_run(call->pool, call->dout.type, call->dout.data, call->din[0].data, &m->move[i], true, call->add[0]);
    }
}

#define MOVES_OP(text)                                                                                                 \
    { .name = text, .forward = moves_forward, .backward = moves_backward }
static const nn_op flip_op = MOVES_OP("flip"), roll_op = MOVES_OP("roll"), permute_op = MOVES_OP("permute"),
                   shuffle_op = MOVES_OP("pixel_shuffle"), unshuffle_op = MOVES_OP("pixel_unshuffle");

static nn_value add_moves(nn_graph *g, const nn_op *op, nn_value x, nn_shape shape, const moves *m) {
    return nn_node_add(g, &(nn_node_params){.op = op,
                                            .inputs = 1,
                                            .in = &x,
                                            .shape = shape,
                                            .type = nn_type_of(g, x),
                                            .attributes = m,
                                            .attributes_size = sizeof *m});
}

nn_value nn_flip(nn_graph *g, nn_value x, nn_axis axis) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    nn_shape s = nn_shape_of(g, x);
    const nn_strides dense = nn_strides_of(s);
    moves m = {.count = 1, .move = {nn_move_create(s, dense, dense)}};
    m.move[0].from_start = dense.at[axis] * (*nn_dimension(&s, axis) - 1);
    m.move[0].from[axis] = -dense.at[axis];
    return add_moves(g, &flip_op, x, s, &m);
}

nn_value nn_roll(nn_graph *g, nn_value x, nn_axis axis, int by) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    nn_shape s = nn_shape_of(g, x), head = s, tail = s;
    const nn_strides dense = nn_strides_of(s);
    const int n = *nn_dimension(&s, axis), shift = (by % n + n) % n;
    if (shift == 0) {
        return x;
    }
    /* The first n - shift move on by shift; the last shift come first. */
    *nn_dimension(&head, axis) = n - shift;
    *nn_dimension(&tail, axis) = shift;
    moves m = {.count = 2, .move = {nn_move_create(head, dense, dense), nn_move_create(tail, dense, dense)}};
    m.move[0].to_start = shift * dense.at[axis];
    m.move[1].from_start = (n - shift) * dense.at[axis];
    return add_moves(g, &roll_op, x, s, &m);
}

nn_value nn_permute(nn_graph *g, nn_value x, const nn_axis order[4]) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    nn_shape s = nn_shape_of(g, x), to = s;
    const nn_strides dense = nn_strides_of(s);
    nn_strides from;
    unsigned seen = 0;
    for (int i = 0; i < 4; i++) {
        if ((unsigned)order[i] > 3) {
            return nn_reject(g, "permute: there is no dimension %d", (int)order[i]);
        }
        seen |= 1u << order[i];
        *nn_dimension(&to, (nn_axis)i) = *nn_dimension(&s, order[i]);
        from.at[i] = dense.at[order[i]];
    }
    if (seen != 15) {
        return nn_reject(g, "permute: a dimension is named twice");
    }
    moves m = {.count = 1, .move = {nn_move_create(to, from, nn_strides_of(to))}};
    return add_moves(g, &permute_op, x, to, &m);
}

/* {n, h, w, c by by} and {n, h by, w by, c}: channel c by^2 + i by + j is row i, column j of a block. */
static nn_move shuffle_move(nn_shape small, int by) {
    const size_t r = (size_t)by, n = (size_t)small.n, h = (size_t)small.h, w = (size_t)small.w,
                 c = (size_t)small.c / (r * r);
    const ptrdiff_t sr = by, sc = (ptrdiff_t)c, row = (ptrdiff_t)(w * r * c), in_pixel = small.c;
    return (nn_move){.dims = 6,
                     .size = {n, h, r, w, r, c},
                     .from = {(ptrdiff_t)(h * w) * in_pixel, (ptrdiff_t)w * in_pixel, sr, in_pixel, 1, sr * sr},
                     .to = {(ptrdiff_t)(h * r) * row, sr * row, row, sr * sc, sc, 1}};
}

nn_value nn_pixel_shuffle(nn_graph *g, nn_value x, int by) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    const nn_shape s = nn_shape_of(g, x);
    if (by < 1 || by > 64 || s.c % (by * by) != 0 || s.h > INT32_MAX / by || s.w > INT32_MAX / by) {
        return nn_reject(g, "pixel_shuffle: %s cannot be shuffled by %d", nn_text_of(s).text, by);
    }
    const moves m = {.count = 1, .move = {shuffle_move(s, by)}};
    return add_moves(g, &shuffle_op, x, (nn_shape){s.n, s.h * by, s.w * by, s.c / (by * by)}, &m);
}

nn_value nn_pixel_unshuffle(nn_graph *g, nn_value x, int by) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    const nn_shape s = nn_shape_of(g, x);
    if (by < 1 || by > 64 || s.h % by != 0 || s.w % by != 0 || s.c > INT32_MAX / (by * by)) {
        return nn_reject(g, "pixel_unshuffle: %s cannot be divided by %d", nn_text_of(s).text, by);
    }
    const nn_shape small = {s.n, s.h / by, s.w / by, s.c * by * by};
    nn_move there = shuffle_move(small, by), back = there;
    memcpy(back.from, there.to, sizeof back.from);
    memcpy(back.to, there.from, sizeof back.to);
    const moves m = {.count = 1, .move = {back}};
    return add_moves(g, &unshuffle_op, x, small, &m);
}

/* ---- reshape: a view ---- */

static void reshape_backward(nn_call *call) {
    if (call->din[0].data == NULL || call->din[0].data == call->dout.data) {
        return;
    }
    const nn_move m = {.dims = 1, .size = {nn_count(call->dout.shape)}, .from = {1}, .to = {1}};
    nn_move_run(call->pool, call->dout.type, call->dout.data, call->din[0].data, &m, false, call->add[0]);
}

static const nn_op reshape_op = {.name = "reshape", .view = true, .grad_in_place = 1, .backward = reshape_backward};

nn_value nn_reshape(nn_graph *g, nn_value x, nn_shape shape) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    if (shape.n < 1 || shape.h < 1 || shape.w < 1 || shape.c < 1 || nn_count(shape) != nn_count(nn_shape_of(g, x))) {
        return nn_reject(g, "reshape: %s cannot be seen as %s", nn_text_of(nn_shape_of(g, x)).text,
                         nn_text_of(shape).text);
    }
    return nn_node_add(
        g, &(nn_node_params){.op = &reshape_op, .inputs = 1, .in = &x, .shape = shape, .type = nn_type_of(g, x)});
}

/* ---- concat ---- */

typedef struct concat {
    nn_axis axis;
} concat;

static void concat_run(nn_call *call, bool backward) {
    const nn_axis axis = ((const concat *)call->attributes)->axis;
    const nn_strides whole = nn_strides_of(backward ? call->dout.shape : call->out.shape);
    ptrdiff_t start = 0;
    for (int i = 0; i < call->inputs; i++) {
        nn_shape s = backward ? call->din[i].shape : call->in[i].shape;
        nn_move m = nn_move_create(s, nn_strides_of(s), whole);
        m.to_start = start;
        start += *nn_dimension(&s, axis) * whole.at[axis];
        if (!backward) {
            nn_move_run(call->pool, call->out.type, call->in[i].data, call->out.data, &m, false, false);
        } else if (call->din[i].data != NULL) {
            nn_move_run(call->pool, call->dout.type, call->dout.data, call->din[i].data, &m, true, call->add[i]);
        }
    }
}

static void concat_forward(nn_call *call) {
    concat_run(call, false);
}

static void concat_backward(nn_call *call) {
    concat_run(call, true);
}

static const nn_op concat_op = {.name = "concat", .forward = concat_forward, .backward = concat_backward};

nn_value nn_concat(nn_graph *g, nn_axis axis, int count, const nn_value *parts) {
    if (count < 1 || count > NN_MAX_IN) {
        return nn_reject(g, "concat: %d parts; 1 to %d can be joined", count, NN_MAX_IN);
    }
    nn_shape whole = {0, 0, 0, 0};
    int64_t length = 0;
    for (int i = 0; i < count; i++) {
        if (!nn_usable(g, parts[i])) {
            return 0;
        }
        nn_shape s = nn_shape_of(g, parts[i]), first = nn_shape_of(g, parts[0]);
        length += *nn_dimension(&s, axis);
        *nn_dimension(&s, axis) = *nn_dimension(&first, axis) = 0;
        if (!nn_shapes_equal(s, first) || nn_type_of(g, parts[i]) != nn_type_of(g, parts[0])) {
            return nn_reject(g, "concat: %s does not fit to %s", nn_text_of(nn_shape_of(g, parts[i])).text,
                             nn_text_of(nn_shape_of(g, parts[0])).text);
        }
        whole = first;
    }
    if (length > INT32_MAX) {
        return nn_reject(g, "concat: the result is too large");
    }
    *nn_dimension(&whole, axis) = (int)length;
    return nn_node_add(g, &(nn_node_params){.op = &concat_op,
                                            .inputs = count,
                                            .in = parts,
                                            .shape = whole,
                                            .type = nn_type_of(g, parts[0]),
                                            .attributes = &(concat){axis},
                                            .attributes_size = sizeof(concat)});
}

/* ---- slice ---- */

typedef struct slice {
    nn_move move;
} slice;

static void slice_forward(nn_call *call) {
    const slice *s = call->attributes;
    nn_move_run(call->pool, call->out.type, call->in[0].data, call->out.data, &s->move, false, false);
}

static void slice_backward(nn_call *call) {
    const slice *s = call->attributes;
    const nn_view d = call->din[0];
    if (d.data == NULL) {
        return;
    }
    if (!call->add[0]) {
        nn_zero(call->pool, d.data, nn_count(d.shape) * nn_type_size(d.type));
    }
    nn_move_run(call->pool, d.type, call->dout.data, d.data, &s->move, true, call->add[0]);
}

static const nn_op slice_op = {.name = "slice", .forward = slice_forward, .backward = slice_backward};

nn_value nn_slice(nn_graph *g, nn_value x, nn_axis axis, int begin, int end, int step) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    nn_shape s = nn_shape_of(g, x), to = s;
    if (begin < 0 || end > *nn_dimension(&s, axis) || begin >= end || step < 1) {
        return nn_reject(g, "slice: %d to %d in steps of %d of %s", begin, end, step, nn_text_of(s).text);
    }
    *nn_dimension(&to, axis) = (end - begin - 1) / step + 1;
    nn_strides from = nn_strides_of(s);
    const ptrdiff_t stride = from.at[axis];
    from.at[axis] *= step;
    slice a = {nn_move_create(to, from, nn_strides_of(to))};
    a.move.from_start = begin * stride;
    return nn_node_add(g, &(nn_node_params){.op = &slice_op,
                                            .inputs = 1,
                                            .in = &x,
                                            .shape = to,
                                            .type = nn_type_of(g, x),
                                            .attributes = &a,
                                            .attributes_size = sizeof a});
}

/* ---- repeat ---- */

typedef struct repeat {
    nn_move move; /* of one copy */
    ptrdiff_t step;
    int times;
} repeat;

/* The numbers that are copied together lie together, and so do their copies. Short ones, such as a pixel's, are worth
 * loops of their own. */
typedef struct repeat_job {
    nn_call *call;
    const nn_rows *rows;
    size_t n, times; /* n numbers, so many times */
} repeat_job;

static bool is_short(const repeat *r) {
    return r->step * r->times <= NN_CHUNK;
}

static repeat_job short_job(nn_call *call, nn_type type) {
    const repeat *r = call->attributes;
    return (repeat_job){.call = call, .rows = nn_rows_of(type), .n = (size_t)r->step, .times = (size_t)r->times};
}

static void copy_short(void *arg, size_t begin, size_t end, int worker) {
    const repeat_job *job = arg;
    const size_t bytes = job->n * job->rows->s_size, all = job->times * bytes;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        unsigned char *to = (unsigned char *)job->call->out.data + i * all;
        memcpy(to, (const unsigned char *)job->call->in[0].data + i * bytes, bytes);
        for (size_t done = bytes; done < all;) {
            const size_t more = all - done < done ? all - done : done;
            memcpy(to + done, to, more);
            done += more;
        }
    }
}

/* The second half is added to the first, until one copy is left. */
static void add_short(void *arg, size_t begin, size_t end, int worker) {
    const repeat_job *job = arg;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        nn_chunk sums;
        unsigned char *room = (unsigned char *)&sums;
        job->rows->load((const unsigned char *)job->call->dout.data + i * job->n * job->times * job->rows->s_size, room,
                        job->n * job->times);
        for (size_t times = job->times; times > 1; times -= times / 2) {
            job->rows->add_weighted_t(1, room + (times - times / 2) * job->n * job->rows->t_size, room,
                                      times / 2 * job->n);
        }
        nn_put(job->rows, job->call->din[0], i * job->n, job->n, room, job->call->add[0]);
    }
}

static void repeat_forward(nn_call *call) {
    const repeat *r = call->attributes;
    if (is_short(r)) {
        repeat_job job = short_job(call, call->out.type);
        core_parallel(call->pool, nn_count(call->out.shape) / (job.n * job.times), 256, copy_short, &job);
        return;
    }
    for (int i = 0; i < r->times; i++) {
        nn_move m = r->move;
        m.to_start = i * r->step;
        nn_move_run(call->pool, call->out.type, call->in[0].data, call->out.data, &m, false, false);
    }
}

static void repeat_backward(nn_call *call) {
    const repeat *r = call->attributes;
    if (call->din[0].data != NULL && is_short(r)) {
        repeat_job job = short_job(call, call->dout.type);
        core_parallel(call->pool, nn_count(call->dout.shape) / (job.n * job.times), 256, add_short, &job);
        return;
    }
    for (int i = 0; i < r->times && call->din[0].data != NULL; i++) {
        nn_move m = r->move;
        m.to_start = i * r->step;
        nn_move_run(call->pool, call->dout.type, call->dout.data, call->din[0].data, &m, true, i > 0 || call->add[0]);
    }
}

static const nn_op repeat_op = {.name = "repeat", .forward = repeat_forward, .backward = repeat_backward};

nn_value nn_repeat(nn_graph *g, nn_value x, nn_axis axis, int times) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    nn_shape s = nn_shape_of(g, x), to = s;
    if (times < 1 || *nn_dimension(&s, axis) > INT32_MAX / times) {
        return nn_reject(g, "repeat: %s cannot be repeated %d times", nn_text_of(s).text, times);
    }
    *nn_dimension(&to, axis) *= times;
    const nn_strides dense = nn_strides_of(to);
    const repeat r = {nn_move_create(s, nn_strides_of(s), dense), *nn_dimension(&s, axis) * dense.at[axis], times};
    return nn_node_add(g, &(nn_node_params){.op = &repeat_op,
                                            .inputs = 1,
                                            .in = &x,
                                            .shape = to,
                                            .type = nn_type_of(g, x),
                                            .attributes = &r,
                                            .attributes_size = sizeof r});
}
