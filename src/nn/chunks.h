/* SPDX-License-Identifier: Apache-2.0 */
/*
 * chunks.h: tensors in pieces that fit into the first-level cache. Elementwise
 * operations and sums work on pieces of a "full" shape, in memory's order; tensors
 * that are broadcast to it are spread out, and bf16 is widened, as pieces are fetched.
 */
#ifndef NN_CHUNKS_H
#define NN_CHUNKS_H

#include "nn/rows.h"

enum { NN_CHUNK = 1024, NN_GRAIN = 16 /* chunks at a time for a worker */ };

/* Room for a chunk of either computing type. */
typedef union nn_chunk {
    float f[NN_CHUNK];
    double d[NN_CHUNK];
} nn_chunk;

/* A tensor as it is read at offsets in the full shape. */
typedef struct nn_fetch {
    const unsigned char *data;
    const nn_rows *rows;
    nn_type type;
    bool linear; /* has the full shape */
    int dims;
    size_t size[4], stride[4]; /* of the full shape, neighbours put together; strides in elements, 0: broadcast */
} nn_fetch;

nn_fetch nn_fetch_create(nn_view view, nn_shape full);
/* n <= NN_CHUNK numbers from an offset, as float (double where the type is NN_F64): perhaps in `room`, perhaps in
 * place. */
const void *nn_fetch_get(const nn_fetch *f, size_t offset, size_t n, nn_chunk *room);

/* The same the other way: values of the full shape. */
void nn_put(const nn_rows *rows, nn_view to, size_t offset, size_t n, const void *values, bool add);

static inline bool nn_shapes_equal(nn_shape a, nn_shape b) {
    return a.n == b.n && a.h == b.h && a.w == b.w && a.c == b.c;
}
/* Each dimension equal, or 1 in one of them; n = 0: they don't fit. */
nn_shape nn_broadcast(nn_shape a, nn_shape b);
/* "1 x 64 x 64 x 3" for errors. */
typedef struct nn_text {
    char text[64];
} nn_text;
nn_text nn_text_of(nn_shape s);

/*
 * Sums over the dimensions in which `to` is 1 and `full` is not, made in double, in an order that depends on
 * the shapes only; times scale. `term` gives n <= NN_CHUNK numbers at an offset of the full shape, of the type that
 * `compute` has (NN_F64: double, else float), in `room` or elsewhere. scratch: nn_sum_scratch bytes.
 */
typedef const void *nn_term(const void *context, size_t offset, size_t n, nn_chunk *room);
size_t nn_sum_scratch(nn_shape full, nn_shape to);
void nn_sum_terms(core_pool *pool, nn_shape full, nn_type compute, nn_term *term, const void *context, nn_view to,
                  double scale, bool add, void *scratch);

/* Calls fn for each chunk of `count` numbers. */
typedef void nn_chunk_fn(const void *context, size_t offset, size_t n);
void nn_each_chunk(core_pool *pool, size_t count, nn_chunk_fn *fn, const void *context);

#endif
