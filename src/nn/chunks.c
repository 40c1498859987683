/* SPDX-License-Identifier: Apache-2.0 */
/*
 * chunks.c: fetching pieces of tensors, broadcasting on the way, and sums of them.
 */
#include "nn/chunks.h"

#include <string.h>

/* ---- shapes ---- */

static void dims_of(nn_shape s, size_t d[4]) {
    d[0] = (size_t)s.n, d[1] = (size_t)s.h, d[2] = (size_t)s.w, d[3] = (size_t)s.c;
}

nn_shape nn_broadcast(nn_shape a, nn_shape b) {
    if ((a.n != b.n && a.n != 1 && b.n != 1) || (a.h != b.h && a.h != 1 && b.h != 1) ||
        (a.w != b.w && a.w != 1 && b.w != 1) || (a.c != b.c && a.c != 1 && b.c != 1)) {
        return (nn_shape){0, 0, 0, 0};
    }
    return (nn_shape){a.n > b.n ? a.n : b.n, a.h > b.h ? a.h : b.h, a.w > b.w ? a.w : b.w, a.c > b.c ? a.c : b.c};
}

nn_text nn_text_of(nn_shape s) {
    nn_text t;
    snprintf(t.text, sizeof t.text, "%d x %d x %d x %d", s.n, s.h, s.w, s.c);
    return t;
}

/* ---- fetching ---- */

nn_fetch nn_fetch_create(nn_view view, nn_shape full) {
    nn_fetch f = {.data = view.data, .rows = nn_rows_of(view.type), .type = view.type};
    size_t size[4], own[4], stride[4], step = 1;
    dims_of(full, size);
    dims_of(view.shape, own);
    f.linear = nn_shapes_equal(view.shape, full);
    for (int i = 3; i >= 0; i--) {
        stride[i] = own[i] == 1 ? 0 : step;
        step *= own[i];
    }
    for (int i = 0; i < 4; i++) {
        if (size[i] == 1) {
            continue;
        }
        if (f.dims > 0 && f.stride[f.dims - 1] == stride[i] * size[i]) {
            f.size[f.dims - 1] *= size[i];
            f.stride[f.dims - 1] = stride[i];
        } else {
            f.size[f.dims] = size[i];
            f.stride[f.dims++] = stride[i];
        }
    }
    if (f.dims == 0) {
        f.size[0] = 1;
        f.stride[0] = 0;
        f.dims = 1;
    }
    return f;
}

static void fill(nn_chunk *room, bool wide, size_t at, size_t n) {
    if (wide) {
        for (size_t i = 1; i < n; i++) {
            room->d[at + i] = room->d[at];
        }
    } else {
        for (size_t i = 1; i < n; i++) {
            room->f[at + i] = room->f[at];
        }
    }
}

const void *nn_fetch_get(const nn_fetch *f, size_t offset, size_t n, nn_chunk *room) {
    const size_t s = f->rows->s_size;
    const bool wide = f->type == NN_F64;
    if (f->linear) {
        if (f->type != NN_BF16) {
            return f->data + offset * s;
        }
        f->rows->load(f->data + offset * s, room, n);
        return room;
    }
    size_t index[4] = {0}, rest = offset, from = 0;
    for (int i = f->dims - 1; i >= 0; i--) {
        index[i] = rest % f->size[i];
        rest /= f->size[i];
        from += index[i] * f->stride[i];
    }
    const int last = f->dims - 1;
    for (size_t at = 0; at < n;) {
        const size_t left = f->size[last] - index[last], run = left < n - at ? left : n - at;
        unsigned char *to = (unsigned char *)room + at * f->rows->t_size;
        if (f->stride[last] == 0) {
            f->rows->load(f->data + from * s, to, 1);
            fill(room, wide, at, run);
        } else {
            f->rows->load(f->data + from * s, to, run);
        }
        at += run;
        from += run * f->stride[last];
        index[last] += run;
        for (int i = last; i > 0 && index[i] == f->size[i]; i--) {
            from -= index[i] * f->stride[i];
            index[i] = 0;
            index[i - 1]++;
            from += f->stride[i - 1];
        }
    }
    return room;
}

void nn_put(const nn_rows *rows, nn_view to, size_t offset, size_t n, const void *values, bool add) {
    unsigned char *at = (unsigned char *)to.data + offset * rows->s_size;
    if (add) {
        rows->store_add(values, at, n);
    } else if (values != at) {
        rows->store(values, at, n);
    }
}

typedef struct each_job {
    nn_chunk_fn *fn;
    const void *context;
    size_t count;
} each_job;

static void each_range(void *arg, size_t begin, size_t end, int worker) {
    const each_job *job = arg;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const size_t left = job->count - i * NN_CHUNK;
        job->fn(job->context, i * NN_CHUNK, left < NN_CHUNK ? left : NN_CHUNK);
    }
}

void nn_each_chunk(core_pool *pool, size_t count, nn_chunk_fn *fn, const void *context) {
    each_job job = {fn, context, count};
    core_parallel(pool, (count + NN_CHUNK - 1) / NN_CHUNK, NN_GRAIN, each_range, &job);
}

/* ---- sums ---- */

/*
 * With neighbours put together, dimensions that are kept (K) and summed (S) alternate; the
 * last one is contiguous and `length` long. Two cases:
 *   ... K S K: sums of `length` numbers side by side; each is cut into pieces of a chunk;
 *   ... S K S: one sum for each row; `group` rows at once if they are short.
 * What is summed for one result is cut into blocks; their partial sums go to scratch
 * and are added in order.
 */
typedef struct layout {
    bool last_kept;
    size_t length;
    size_t near, far, farther; /* the dimensions before the last: alternately of the other kind, its kind, ... */
    size_t chunk;              /* numbers of a row at a time */
    size_t pieces;             /* of a row */
    size_t group;              /* rows at once */
    size_t results;            /* numbers of the result */
    size_t units;              /* K: (far, piece); S: (farther, group of near) */
    size_t items;              /* K: (farther, near); S: (far, piece) */
    size_t per_block, blocks;
} layout;

static size_t pieces_of(size_t n, size_t size) {
    return (n + size - 1) / size;
}

static layout layout_of(nn_shape full, nn_shape to) {
    size_t size[4], kept_size[4], merged[5] = {1, 1, 1, 1, 1};
    bool kept[5] = {false};
    int count = 0;
    dims_of(full, size);
    dims_of(to, kept_size);
    for (int i = 3; i >= 0; i--) { /* from the last */
        if (size[i] == 1) {
            continue;
        }
        const bool k = kept_size[i] == size[i];
        if (count > 0 && kept[count - 1] == k) {
            merged[count - 1] *= size[i];
        } else {
            kept[count] = k;
            merged[count++] = size[i];
        }
    }
    layout l = {.last_kept = count > 0 && kept[0],
                .length = merged[0],
                .near = merged[1],
                .far = merged[2],
                .farther = merged[3]};
    l.results = nn_count(to);
    l.chunk = l.length < NN_CHUNK ? l.length : NN_CHUNK;
    l.pieces = pieces_of(l.length, l.chunk);
    l.group = NN_CHUNK / l.chunk < l.near ? NN_CHUNK / l.chunk : l.near;
    if (l.pieces > 1) {
        l.group = 1;
    }
    if (l.last_kept) {
        l.units = l.far * l.pieces;
        l.items = l.farther * l.near;
        l.per_block = pieces_of(16 * NN_CHUNK, l.chunk);
    } else {
        l.units = l.farther * pieces_of(l.near, l.group);
        l.items = l.far * l.pieces;
        l.per_block = pieces_of(16 * NN_CHUNK, l.chunk * l.group);
    }
    l.blocks = pieces_of(l.items, l.per_block);
    return l;
}

size_t nn_sum_scratch(nn_shape full, nn_shape to) {
    const layout l = layout_of(full, to);
    return l.blocks > 1 ? l.blocks * l.results * sizeof(double) : 0;
}

typedef struct sum_job {
    layout l;
    const nn_rows *rows; /* of the computing type */
    nn_term *term;
    const void *context;
    nn_view to;
    double scale;
    bool add;
    double *scratch;
} sum_job;

static void finish(const sum_job *job, size_t result, double *sums, size_t n) {
    for (size_t i = 0; i < n; i++) {
        sums[i] *= job->scale;
    }
    nn_store_double(job->to.type, sums, (unsigned char *)job->to.data + result * nn_type_size(job->to.type), n,
                    job->add);
}

/* ... K S K. Offsets: ((farther * far + f) * near + n) * length; results: f * length. */
static size_t sum_columns(const sum_job *job, size_t unit, size_t block, double *sums, size_t *result) {
    const layout *l = &job->l;
    const size_t f = unit / l->pieces, start = unit % l->pieces * l->chunk;
    const size_t n = l->length - start < l->chunk ? l->length - start : l->chunk;
    const size_t begin = block * l->per_block, end = begin + l->per_block < l->items ? begin + l->per_block : l->items;
    nn_chunk room;
    memset(sums, 0, n * sizeof *sums);
    for (size_t i = begin; i < end;) {
        const size_t outer = i / l->near, near = i % l->near;
        size_t rows = l->near - near < end - i ? l->near - near : end - i;
        rows = rows < l->group ? rows : l->group;
        const size_t offset = ((outer * l->far + f) * l->near + near) * l->length + start;
        const unsigned char *t = job->term(job->context, offset, rows * n, &room);
        for (size_t r = 0; r < rows; r++) {
            job->rows->sum_to(sums, t + r * n * job->rows->t_size, n);
        }
        i += rows;
    }
    *result = f * l->length + start;
    return n;
}

/* ... S K S. Offsets: ((farther * far + f) * near + n) * length; results: farther * near + n. */
static size_t sum_rows(const sum_job *job, size_t unit, size_t block, double *sums, size_t *result) {
    const layout *l = &job->l;
    const size_t groups = pieces_of(l->near, l->group), outer = unit / groups, near = unit % groups * l->group;
    const size_t rows = l->near - near < l->group ? l->near - near : l->group;
    const size_t begin = block * l->per_block, end = begin + l->per_block < l->items ? begin + l->per_block : l->items;
    nn_chunk room;
    memset(sums, 0, rows * sizeof *sums);
    for (size_t i = begin; i < end; i++) {
        const size_t f = i / l->pieces, start = i % l->pieces * l->chunk;
        const size_t n = l->length - start < l->chunk ? l->length - start : l->chunk;
        const size_t offset = ((outer * l->far + f) * l->near + near) * l->length + start;
        const unsigned char *t = job->term(job->context, offset, rows * n, &room);
        for (size_t r = 0; r < rows; r++) {
            sums[r] += job->rows->sum(t + r * n * job->rows->t_size, n);
        }
    }
    *result = outer * l->near + near;
    return rows;
}

static void sum_range(void *arg, size_t begin, size_t end, int worker) {
    const sum_job *job = arg;
    double sums[NN_CHUNK];
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const size_t unit = i / job->l.blocks, block = i % job->l.blocks;
        size_t result = 0;
        const size_t n =
            job->l.last_kept ? sum_columns(job, unit, block, sums, &result) : sum_rows(job, unit, block, sums, &result);
        if (job->l.blocks > 1) {
            memcpy(job->scratch + block * job->l.results + result, sums, n * sizeof *sums);
        } else {
            finish(job, result, sums, n);
        }
    }
}

static void finish_range(void *arg, size_t begin, size_t end, int worker) {
    const sum_job *job = arg;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        double sum = 0;
        for (size_t b = 0; b < job->l.blocks; b++) {
            sum += job->scratch[b * job->l.results + i];
        }
        finish(job, i, &sum, 1);
    }
}

void nn_sum_terms(core_pool *pool, nn_shape full, nn_type compute, nn_term *term, const void *context, nn_view to,
                  double scale, bool add, void *scratch) {
    sum_job job = {.l = layout_of(full, to.shape),
                   .rows = nn_rows_of(compute),
                   .term = term,
                   .context = context,
                   .to = to,
                   .scale = scale,
                   .add = add,
                   .scratch = scratch};
    const size_t work = job.l.per_block * job.l.chunk * (job.l.last_kept ? 1 : job.l.group);
    core_parallel(pool, job.l.units * job.l.blocks, work < 8192 ? 8192 / work + 1 : 1, sum_range, &job);
    if (job.l.blocks > 1) {
        core_parallel(pool, job.l.results, 256, finish_range, &job);
    }
}
