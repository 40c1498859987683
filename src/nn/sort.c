/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sort.c: sorts along one dimension, rising, equal numbers in their old order, NaN
 * last. The permutation is kept for the way back. Floats and their places are sorted
 * together, as numbers of 64 bits: radix sort of eleven bits at a time; digits that are
 * the same in all numbers cost nothing more. Doubles are for tests, and take qsort.
 */
#include <stdlib.h>

#include "nn/chunks.h"
#include "nn/move.h"

typedef struct sort {
    nn_axis axis;
} sort;

typedef struct item {
    uint64_t key;
    uint32_t index;
} item;

/* Unsigned numbers in the order of the doubles. */
static uint64_t key_of(double x) {
    union {
        double d;
        uint64_t u;
    } v = {x == 0 ? 0 : x}; /* -0 is 0 */
    if (x != x) {
        return UINT64_MAX;
    }
    return v.u >> 63 != 0 ? ~v.u : v.u | (uint64_t)1 << 63;
}

static double number_of(uint64_t key) {
    union {
        uint64_t u;
        double d;
    } v = {key >> 63 != 0 ? key & ~((uint64_t)1 << 63) : ~key};
    return v.d;
}

static int by_key(const void *x, const void *y) {
    const item *a = x, *b = y;
    if (a->key != b->key) {
        return a->key < b->key ? -1 : 1;
    }
    return a->index < b->index ? -1 : a->index > b->index;
}

/* ---- floats ---- */

enum { BITS = 11, DIGITS = 1 << BITS, FLOAT_DIGITS = 3 }; /* of 11, 11 and 10 bits, above the 32 of the place */

static uint64_t float_item(float x, uint32_t index) {
    union {
        float f;
        uint32_t u;
    } v = {x == 0 ? 0 : x}; /* -0 is 0 */
    const uint32_t key = x != x ? UINT32_MAX : v.u >> 31 != 0 ? ~v.u : v.u | (uint32_t)1 << 31;
    return (uint64_t)key << 32 | index;
}

static float float_of(uint64_t sorted) {
    const uint32_t key = (uint32_t)(sorted >> 32);
    union {
        uint32_t u;
        float f;
    } v = {key >> 31 != 0 ? key & ~((uint32_t)1 << 31) : ~key};
    return v.f;
}

static size_t float_digit(uint64_t key, int digit) {
    return key >> (32 + digit * BITS) & (DIGITS - 1);
}

/* Sorted items are in the place that is returned. */
static uint64_t *radix_sort(uint64_t *a, uint64_t *b, size_t n) {
    uint32_t count[FLOAT_DIGITS][DIGITS] = {{0}};
    for (size_t i = 0; i < n; i++) {
        for (int d = 0; d < FLOAT_DIGITS; d++) {
            count[d][float_digit(a[i], d)]++;
        }
    }
    for (int d = 0; d < FLOAT_DIGITS; d++) {
        if (count[d][float_digit(a[0], d)] == n) {
            continue;
        }
        uint32_t sum = 0;
        for (size_t i = 0; i < DIGITS; i++) {
            const uint32_t c = count[d][i];
            count[d][i] = sum;
            sum += c;
        }
        for (size_t i = 0; i < n; i++) {
            b[count[d][float_digit(a[i], d)]++] = a[i];
        }
        uint64_t *swap = a;
        a = b;
        b = swap;
    }
    return a;
}

/* ---- lines ---- */

typedef struct sort_job {
    nn_call *call;
    size_t n, stride; /* of a line */
} sort_job;

static size_t line_start(const sort_job *job, size_t line) {
    return line / job->stride * job->n * job->stride + line % job->stride;
}

static size_t room(size_t n) {
    return (n * sizeof(item) + 63) / 64 * 64; /* as large as two floats and their places */
}

static void sort_line(const sort_job *job, size_t start, void *scratch) {
    const nn_view x = job->call->in[0], y = job->call->out;
    const double *from = (const double *)x.data + start;
    double *to = (double *)y.data + start;
    uint32_t *order = job->call->saved;
    item *sorted = scratch;
    for (size_t i = 0; i < job->n; i++) {
        sorted[i] = (item){key_of(from[i * job->stride]), (uint32_t)i};
    }
    qsort(sorted, job->n, sizeof *sorted, by_key);
    for (size_t i = 0; i < job->n; i++) {
        const size_t at = i * job->stride;
        to[at] = number_of(sorted[i].key);
        if (order != NULL) {
            order[start + at] = sorted[i].index;
        }
    }
}

/* One number of a view that is not of doubles. */
static inline float get(const nn_view *v, size_t at) {
    return v->type == NN_F32 ? ((const float *)v->data)[at] : nn_from_bf16(((const uint16_t *)v->data)[at]);
}

static inline void put(const nn_view *v, size_t at, float x) {
    if (v->type == NN_F32) {
        ((float *)v->data)[at] = x;
    } else {
        ((uint16_t *)v->data)[at] = nn_to_bf16(x);
    }
}

static void sort_line_floats(const sort_job *job, size_t start, void *scratch) {
    const nn_view x = job->call->in[0], y = job->call->out;
    uint32_t *order = job->call->saved;
    uint64_t *a = scratch, *b = a + job->n;
    for (size_t i = 0; i < job->n; i++) {
        a[i] = float_item(get(&x, start + i * job->stride), (uint32_t)i);
    }
    const uint64_t *sorted = radix_sort(a, b, job->n);
    for (size_t i = 0; i < job->n; i++) {
        const size_t at = start + i * job->stride;
        put(&y, at, float_of(sorted[i]));
        if (order != NULL) {
            order[at] = (uint32_t)sorted[i];
        }
    }
}

static void forward_lines(void *arg, size_t begin, size_t end, int worker) {
    const sort_job *job = arg;
    void *scratch = (unsigned char *)job->call->scratch + (size_t)worker * room(job->n);
    for (size_t l = begin; l < end; l++) {
        if (job->call->in[0].type == NN_F64) {
            sort_line(job, line_start(job, l), scratch);
        } else {
            sort_line_floats(job, line_start(job, l), scratch);
        }
    }
}

static void backward_lines(void *arg, size_t begin, size_t end, int worker) {
    const sort_job *job = arg;
    const nn_view g = job->call->dout, d = job->call->din[0];
    const uint32_t *order = job->call->saved;
    const bool add = job->call->add[0];
    (void)worker;
    for (size_t l = begin; l < end; l++) {
        const size_t start = line_start(job, l);
        for (size_t i = 0; i < job->n; i++) {
            const size_t from = start + i * job->stride, to = start + order[from] * job->stride;
            if (g.type == NN_F64) {
                double *sum = (double *)d.data + to;
                *sum = (add ? *sum : 0) + ((const double *)g.data)[from];
            } else {
                put(&d, to, (add ? get(&d, to) : 0) + get(&g, from));
            }
        }
    }
}

static sort_job job_of(nn_call *call) {
    nn_shape s = call->in[0].shape;
    const nn_axis axis = ((const sort *)call->attributes)->axis;
    return (sort_job){call, (size_t)*nn_dimension(&s, axis), (size_t)nn_strides_of(s).at[axis]};
}

static void forward(nn_call *call) {
    sort_job job = job_of(call);
    core_parallel(call->pool, nn_count(call->in[0].shape) / job.n, 16384 / job.n + 1, forward_lines, &job);
}

static void backward(nn_call *call) {
    sort_job job = job_of(call);
    if (call->din[0].data != NULL) {
        core_parallel(call->pool, nn_count(call->dout.shape) / job.n, 16384 / job.n + 1, backward_lines, &job);
    }
}

static size_t saved_bytes(const nn_call *call) {
    return nn_count(call->out.shape) * sizeof(uint32_t);
}

static size_t scratch_bytes(const nn_call *call, bool backward_pass, int threads) {
    nn_shape s = call->in[0].shape;
    const nn_axis axis = ((const sort *)call->attributes)->axis;
    return backward_pass ? 0 : (size_t)threads * room((size_t)*nn_dimension(&s, axis));
}

static const nn_op sort_op = {.name = "sort",
                              .forward = forward,
                              .backward = backward,
                              .saved_bytes = saved_bytes,
                              .scratch_bytes = scratch_bytes};

nn_value nn_sort(nn_graph *g, nn_value x, nn_axis axis) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    return nn_node_add(g, &(nn_node_params){.op = &sort_op,
                                            .inputs = 1,
                                            .in = &x,
                                            .shape = nn_shape_of(g, x),
                                            .type = nn_type_of(g, x),
                                            .attributes = &(sort){axis},
                                            .attributes_size = sizeof(sort)});
}
