/* SPDX-License-Identifier: Apache-2.0 */
/*
 * move.c: strided copies. Dimensions that are neighbours on both sides are put
 * together first, so that whole images move by memcpy where they can.
 */
#include "nn/move.h"

#include <string.h>

#include "nn/chunks.h"

nn_strides nn_strides_of(nn_shape s) {
    return (nn_strides){{(ptrdiff_t)s.h * s.w * s.c, (ptrdiff_t)s.w * s.c, s.c, 1}};
}

nn_move nn_move_create(nn_shape size, nn_strides from, nn_strides to) {
    nn_move m = {.dims = 4, .size = {(size_t)size.n, (size_t)size.h, (size_t)size.w, (size_t)size.c}};
    for (int i = 0; i < 4; i++) {
        m.from[i] = from.at[i];
        m.to[i] = to.at[i];
    }
    return m;
}

typedef struct move_job {
    nn_move m; /* simplified; the last dimension is the inner one */
    const unsigned char *from;
    unsigned char *to;
    size_t element;
    const nn_rows *rows;
    bool add;
} move_job;

static void simplify(nn_move *m) {
    int dims = 0;
    for (int i = 0; i < m->dims; i++) {
        if (m->size[i] == 1) {
            continue;
        }
        if (dims > 0 && m->from[dims - 1] == m->from[i] * (ptrdiff_t)m->size[i] &&
            m->to[dims - 1] == m->to[i] * (ptrdiff_t)m->size[i]) {
            m->size[dims - 1] *= m->size[i];
        } else {
            m->size[dims++] = m->size[i];
        }
        m->from[dims - 1] = m->from[i];
        m->to[dims - 1] = m->to[i];
    }
    if (dims == 0) {
        m->size[0] = 1;
        m->from[0] = m->to[0] = 1;
        dims = 1;
    }
    m->dims = dims;
}

static void run_inner(const move_job *job, ptrdiff_t from, ptrdiff_t to, size_t begin, size_t n) {
    const int last = job->m.dims - 1;
    const ptrdiff_t a = job->m.from[last], b = job->m.to[last], e = (ptrdiff_t)job->element;
    const unsigned char *p = job->from + (from + (ptrdiff_t)begin * a) * e;
    unsigned char *q = job->to + (to + (ptrdiff_t)begin * b) * e;
    if (a == 1 && b == 1) {
        if (job->add) {
            job->rows->add_s(p, q, n);
        } else {
            memcpy(q, p, n * job->element);
        }
        return;
    }
    if (job->add) {
        for (size_t i = 0; i < n; i++) {
            job->rows->add_s(p + (ptrdiff_t)i * a * e, q + (ptrdiff_t)i * b * e, 1);
        }
    } else if (e == 4) {
        for (size_t i = 0; i < n; i++) {
            ((uint32_t *)(void *)q)[(ptrdiff_t)i * b] = ((const uint32_t *)(const void *)p)[(ptrdiff_t)i * a];
        }
    } else if (e == 2) {
        for (size_t i = 0; i < n; i++) {
            ((uint16_t *)(void *)q)[(ptrdiff_t)i * b] = ((const uint16_t *)(const void *)p)[(ptrdiff_t)i * a];
        }
    } else {
        for (size_t i = 0; i < n; i++) {
            ((uint64_t *)(void *)q)[(ptrdiff_t)i * b] = ((const uint64_t *)(const void *)p)[(ptrdiff_t)i * a];
        }
    }
}

/* Pieces: of the inner dimension, for each index of the others. */
enum { PIECE = 16384 };

static void move_range(void *arg, size_t begin, size_t end, int worker) {
    const move_job *job = arg;
    const nn_move *m = &job->m;
    const int last = m->dims - 1;
    const size_t pieces = (m->size[last] + PIECE - 1) / PIECE;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        size_t rest = i / pieces;
        const size_t start = i % pieces * PIECE;
        ptrdiff_t from = m->from_start, to = m->to_start;
        for (int d = last - 1; d >= 0; d--) {
            const ptrdiff_t index = (ptrdiff_t)(rest % m->size[d]);
            rest /= m->size[d];
            from += index * m->from[d];
            to += index * m->to[d];
        }
        run_inner(job, from, to, start, m->size[last] - start < PIECE ? m->size[last] - start : PIECE);
    }
}

void nn_move_run(core_pool *pool, nn_type type, const void *from, void *to, const nn_move *move, bool backwards,
                 bool add) {
    move_job job = {
        .m = *move, .from = from, .to = to, .element = nn_type_size(type), .rows = nn_rows_of(type), .add = add};
    if (backwards) {
        memcpy(job.m.from, move->to, sizeof move->to);
        memcpy(job.m.to, move->from, sizeof move->from);
        job.m.from_start = move->to_start;
        job.m.to_start = move->from_start;
    }
    simplify(&job.m);
    const int last = job.m.dims - 1;
    size_t count = (job.m.size[last] + PIECE - 1) / PIECE;
    for (int d = 0; d < last; d++) {
        count *= job.m.size[d];
    }
    const size_t inner = job.m.size[last] < PIECE ? job.m.size[last] : PIECE;
    core_parallel(pool, count, 32768 / inner + 1, move_range, &job);
}

typedef struct zero_job {
    unsigned char *p;
    size_t bytes;
} zero_job;

static void zero_range(void *arg, size_t begin, size_t end, int worker) {
    const zero_job *job = arg;
    (void)worker;
    memset(job->p + begin, 0, end - begin);
}

void nn_zero(core_pool *pool, void *p, size_t bytes) {
    zero_job job = {p, bytes};
    core_parallel(pool, bytes, (size_t)1 << 18, zero_range, &job);
}
