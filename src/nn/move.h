/* SPDX-License-Identifier: Apache-2.0 */
/* move.h: copying, or adding, from one set of strides to another: most operations on shapes, both ways. */
#ifndef NN_MOVE_H
#define NN_MOVE_H

#include "nn/rows.h"

enum { NN_MOVE_DIMS = 6 };

typedef struct nn_move {
    int dims;
    size_t size[NN_MOVE_DIMS];
    ptrdiff_t from[NN_MOVE_DIMS], to[NN_MOVE_DIMS]; /* strides in elements */
    ptrdiff_t from_start, to_start;
} nn_move;

/* to = from, or to += from; each element of `to` at most once. `backwards` swaps the two sides of `move`. */
void nn_move_run(core_pool *pool, nn_type type, const void *from, void *to, const nn_move *move, bool backwards,
                 bool add);
void nn_zero(core_pool *pool, void *p, size_t bytes);

/* Strides of a dense tensor, and a move over all of one shape whose sides have these. */
typedef struct nn_strides {
    ptrdiff_t at[4];
} nn_strides;
nn_strides nn_strides_of(nn_shape s);
nn_move nn_move_create(nn_shape size, nn_strides from, nn_strides to);

static inline int *nn_dimension(nn_shape *s, nn_axis axis) {
    return axis == NN_AXIS_N ? &s->n : axis == NN_AXIS_H ? &s->h : axis == NN_AXIS_W ? &s->w : &s->c;
}

#endif
