/* SPDX-License-Identifier: Apache-2.0 */
/*
 * deform.c: modulated deformable convolution (X. Zhu, H. Hu, S. Lin, J. Dai,
 * "Deformable ConvNets v2", CVPR 2019, eq. 2), 3 x 3, stride 1:
 *     y(p) = b + sum over taps t of W_t m_t(p) x(p + t dilation - pad + o_t(p)),
 * x read bilinearly, zero outside. Offset group g, tap t: dy is channel 18 g + 2 t, dx
 * the next; the mask 9 g + t.
 *
 * As columns and products: blocks of pixels are sampled into rows of 9 c numbers, which
 * a matrix product takes to the result; backward, a product gives the columns'
 * gradient, from which come those of x, offsets and masks.
 *
 * Channels are cut into parts that lie in one offset group and one weight group. Columns
 * are ordered weight group, tap, channel.
 */
#include <string.h>

#include "nn/chunks.h"
#include "nn/move.h"

enum { TAPS = 9, BLOCK = 64 /* pixels */, PARTIAL = 8 /* sums of weight gradients, side by side */ };

typedef struct deform {
    int pad, dilation;
    size_t c, out, offset_groups, weight_groups;
} deform;

typedef struct deform_job {
    nn_call *call;
    deform d;
    size_t h, w, pixels; /* pixels: of one picture */
    size_t oh, ow, results;
    size_t k; /* of a weight group: 9 c/groups */
    const nn_rows *rows, *offset_rows, *mask_rows;
    nn_type wide;
    size_t t;       /* bytes of a number that is computed with */
    size_t picture; /* backward: which */
    nn_view x, offset, mask;
    unsigned char *weights, *turned; /* T: {group, k, out/group} and {group, out/group, k} */
    unsigned char *columns;          /* T: a block for each worker, or a picture's */
    unsigned char *results_t;        /* T: a block for each worker */
    unsigned char *weight_sums, *sums;
} deform_job;

static size_t padded(size_t bytes) {
    return (bytes + 63) / 64 * 64;
}

static deform_job job_of(nn_call *call) {
    const deform *d = call->attributes;
    const nn_shape s = call->in[0].shape, o = call->in[1].shape;
    const nn_type type = call->in[0].type;
    return (deform_job){.call = call,
                        .d = *d,
                        .h = (size_t)s.h,
                        .w = (size_t)s.w,
                        .pixels = (size_t)s.h * (size_t)s.w,
                        .oh = (size_t)o.h,
                        .ow = (size_t)o.w,
                        .results = (size_t)o.h * (size_t)o.w,
                        .k = TAPS * d->c / d->weight_groups,
                        .rows = nn_rows_of(type),
                        .offset_rows = nn_rows_of(call->in[1].type),
                        .mask_rows = nn_rows_of(call->in[2].type),
                        .wide = type == NN_F64 ? NN_F64 : NN_F32,
                        .t = type == NN_F64 ? 8 : 4,
                        .x = call->in[0],
                        .offset = call->in[1],
                        .mask = call->in[2]};
}

/* Parts of the channels: each in one offset group and one weight group. */
static size_t parts(const deform_job *job) {
    return job->d.offset_groups > job->d.weight_groups ? job->d.offset_groups : job->d.weight_groups;
}

static nn_taps taps_of(const deform_job *job, size_t group) {
    const size_t count = parts(job);
    return (nn_taps){.h = (int)job->h,
                     .w = (int)job->w,
                     .dilation = job->d.dilation,
                     .channels = job->d.c,
                     .c = job->d.c / count,
                     .first = group * count / job->d.offset_groups,
                     .parts = count / job->d.offset_groups,
                     .wide = job->d.c / job->d.weight_groups,
                     .k = job->k};
}

/* Offsets and masks of a group at a pixel of the result (counted over all pictures), and where its first tap is. */
typedef struct taps_at {
    union {
        float f[27];
        double d[27];
    } room;
    const void *offset, *mask;
    double y, x;
} taps_at;

static const void *wide_numbers(nn_view v, size_t at, size_t n, void *room) {
    const unsigned char *p = (const unsigned char *)v.data + at * nn_type_size(v.type);
    if (v.type != NN_BF16) {
        return p;
    }
    nn_rows_of(NN_BF16)->load(p, room, n);
    return room;
}

static void find_taps(const deform_job *job, size_t pixel, size_t group, taps_at *t) {
    const size_t at = pixel * job->d.offset_groups + group;
    t->offset = wide_numbers(job->offset, 18 * at, 18, t->room.f);
    t->mask = wide_numbers(job->mask, 9 * at, 9, t->room.f + 18);
    t->y = (double)(pixel / job->ow % job->oh) - job->d.pad;
    t->x = (double)(pixel % job->ow) - job->d.pad;
}

/* Rows of columns for some pixels. */
static void sample_columns(const deform_job *job, size_t begin, size_t end, unsigned char *columns) {
    for (size_t g = 0; g < job->d.offset_groups; g++) {
        const nn_taps taps = taps_of(job, g);
        for (size_t p = begin; p < end; p++) {
            const unsigned char *picture =
                (const unsigned char *)job->x.data + p / job->results * job->pixels * job->d.c * job->rows->s_size;
            taps_at t;
            find_taps(job, p, g, &t);
            job->rows->taps_sample(&taps, picture, t.offset, t.mask, t.y, t.x,
                                   columns + (p - begin) * TAPS * job->d.c * job->t);
        }
    }
}

/* The weights {out, c/groups, 3, 3} as the products want them. */
static void order_weights(const deform_job *job) {
    const size_t wide = job->d.c / job->d.weight_groups, few = job->d.out / job->d.weight_groups;
    const nn_parameter *w = job->call->parameter[0];
    for (size_t o = 0; o < job->d.out; o++) {
        for (size_t i = 0; i < wide * TAPS; i++) {
            const size_t from = o * wide * TAPS + i, group = o / few, k = i % TAPS * wide + i / TAPS;
            const size_t there = (group * job->k + k) * few + o % few, back = o * job->k + k;
            if (job->wide == NN_F64) {
                ((double *)(void *)job->weights)[there] = w->value64[from];
                ((double *)(void *)job->turned)[back] = w->value64[from];
            } else {
                ((float *)(void *)job->weights)[there] = w->value[from];
                ((float *)(void *)job->turned)[back] = w->value[from];
            }
        }
    }
}

static size_t weight_bytes(const deform_job *job) {
    return padded(job->d.out * job->k * job->t);
}

/* ---- forward ---- */

static void forward_blocks(void *arg, size_t begin, size_t end, int worker) {
    const deform_job *job = arg;
    const size_t row = TAPS * job->d.c, out = job->d.out, few = out / job->d.weight_groups;
    unsigned char *columns = job->columns + (size_t)worker * padded(BLOCK * row * job->t),
                  *results = job->results_t + (size_t)worker * padded(BLOCK * out * job->t);
    const nn_parameter *b = job->call->parameter[1];
    for (size_t p = begin; p < end; p += BLOCK) {
        const size_t n = end - p < BLOCK ? end - p : BLOCK;
        sample_columns(job, p, p + n, columns);
        for (size_t i = 0; i < n; i++) {
            memcpy(results + i * out * job->t, job->wide == NN_F64 ? (const void *)b->value64 : (const void *)b->value,
                   out * job->t);
        }
        for (size_t g = 0; g < job->d.weight_groups; g++) {
            job->rows->product(n, few, job->k, columns + g * job->k * job->t, row, 1,
                               job->weights + g * job->k * few * job->t, few, results + g * few * job->t, out, true);
        }
        nn_put(job->rows, job->call->out, p * out, n * out, results, false);
    }
}

static void forward(nn_call *call) {
    deform_job job = job_of(call);
    const size_t threads = (size_t)core_pool_threads(call->pool);
    job.weights = call->scratch;
    job.turned = job.weights + weight_bytes(&job);
    job.columns = job.turned + weight_bytes(&job);
    job.results_t = job.columns + threads * padded(BLOCK * TAPS * job.d.c * job.t);
    order_weights(&job);
    core_parallel(call->pool, (size_t)call->in[0].shape.n * job.results, BLOCK, forward_blocks, &job);
}

/* ---- backward, a picture at a time ---- */

static const unsigned char *gradient_at(const deform_job *job, size_t pixel, size_t n, unsigned char *room) {
    const unsigned char *g = (const unsigned char *)job->call->dout.data + pixel * job->d.out * job->rows->s_size;
    if (job->call->dout.type != NN_BF16) {
        return g;
    }
    job->rows->load(g, room, n * job->d.out);
    return room;
}

/* Partial sum q takes blocks q, q + PARTIAL, ...: the same sums for any number of workers. */
static void weight_blocks(void *arg, size_t begin, size_t end, int worker) {
    const deform_job *job = arg;
    const size_t row = TAPS * job->d.c, out = job->d.out, few = out / job->d.weight_groups;
    unsigned char *columns = job->sums + (size_t)worker * padded(BLOCK * row * job->t),
                  *room = job->results_t + (size_t)worker * padded(BLOCK * out * job->t);
    for (size_t q = begin; q < end; q++) {
        unsigned char *sums = job->weight_sums + q * padded((job->d.out * job->k + job->d.out) * job->t);
        unsigned char *bias = sums + job->d.out * job->k * job->t;
        for (size_t b = q * BLOCK; b < job->results; b += PARTIAL * BLOCK) {
            const size_t p = job->picture * job->results + b, n = job->results - b < BLOCK ? job->results - b : BLOCK;
            const unsigned char *g = gradient_at(job, p, n, room);
            sample_columns(job, p, p + n, columns);
            for (size_t i = 0; i < job->d.weight_groups; i++) { /* k x out of a group: columns transposed times g */
                job->rows->product(job->k, few, n, columns + i * job->k * job->t, 1, row, g + i * few * job->t, out,
                                   sums + i * job->k * few * job->t, few, true);
            }
            for (size_t i = 0; i < n; i++) {
                job->rows->add_weighted_t(1, g + i * out * job->t, bias, out);
            }
        }
    }
}

static void column_blocks(void *arg, size_t begin, size_t end, int worker) {
    const deform_job *job = arg;
    const size_t row = TAPS * job->d.c, out = job->d.out, few = out / job->d.weight_groups;
    unsigned char *room = job->results_t + (size_t)worker * padded(BLOCK * out * job->t);
    for (size_t b = begin; b < end; b += BLOCK) {
        const size_t n = end - b < BLOCK ? end - b : BLOCK;
        const unsigned char *g = gradient_at(job, job->picture * job->results + b, n, room);
        for (size_t i = 0; i < job->d.weight_groups; i++) {
            job->rows->product(n, job->k, few, g + i * few * job->t, out, 1, job->turned + i * few * job->k * job->t,
                               job->k, job->columns + (b * row + i * job->k) * job->t, row, false);
        }
    }
}

/* From the columns' gradient those of x, offsets and masks. One worker does an offset group, whose channels are nobody
 * else's, in the order of the pixels. */
static void back_groups(void *arg, size_t begin, size_t end, int worker) {
    const deform_job *job = arg;
    const nn_view d_offset = job->call->din[1], d_mask = job->call->din[2];
    const unsigned char *picture =
        (const unsigned char *)job->x.data + job->picture * job->pixels * job->d.c * job->rows->s_size;
    (void)worker;
    for (size_t g = begin; g < end; g++) {
        const nn_taps taps = taps_of(job, g);
        for (size_t b = 0; b < job->results; b++) {
            const size_t p = job->picture * job->results + b, at = p * job->d.offset_groups + g;
            double offsets[18], masks[9]; /* room for T */
            taps_at t;
            find_taps(job, p, g, &t);
            job->rows->taps_back(&taps, picture, t.offset, t.mask, t.y, t.x,
                                 job->columns + b * TAPS * job->d.c * job->t,
                                 job->call->din[0].data != NULL ? job->sums : NULL, offsets, masks);
            if (d_offset.data != NULL) {
                nn_put(job->offset_rows, d_offset, 18 * at, 18, offsets, job->call->add[1]);
            }
            if (d_mask.data != NULL) {
                nn_put(job->mask_rows, d_mask, 9 * at, 9, masks, job->call->add[2]);
            }
        }
    }
}

static void put_chunk(const void *context, size_t offset, size_t n) {
    const deform_job *job = context;
    nn_put(job->rows, job->call->din[0], job->picture * job->pixels * job->d.c + offset, n, job->sums + offset * job->t,
           job->call->add[0]);
}

static double number(const deform_job *job, const unsigned char *p, size_t i) {
    return job->wide == NN_F64 ? ((const double *)(const void *)p)[i] : (double)((const float *)(const void *)p)[i];
}

/* Adds the partial sums to the parameters' gradients, in the parameters' order. */
static void add_weights(const deform_job *job) {
    const size_t wide = job->d.c / job->d.weight_groups, few = job->d.out / job->d.weight_groups,
                 stride = padded((job->d.out * job->k + job->d.out) * job->t);
    nn_parameter *w = job->call->parameter[0], *b = job->call->parameter[1];
    for (size_t o = 0; o < job->d.out; o++) {
        for (size_t i = 0; i < wide * TAPS && !w->frozen; i++) {
            const size_t k = i % TAPS * wide + i / TAPS, at = (o / few * job->k + k) * few + o % few;
            double sum = 0;
            for (size_t q = 0; q < PARTIAL; q++) {
                sum += number(job, job->weight_sums + q * stride, at);
            }
            if (job->wide == NN_F64) {
                w->grad64[o * wide * TAPS + i] += sum;
            } else {
                w->grad[o * wide * TAPS + i] += (float)sum;
            }
        }
        double sum = 0;
        for (size_t q = 0; q < PARTIAL; q++) {
            sum += number(job, job->weight_sums + q * stride, job->d.out * job->k + o);
        }
        if (!b->frozen && job->wide == NN_F64) {
            b->grad64[o] += sum;
        } else if (!b->frozen) {
            b->grad[o] += (float)sum;
        }
    }
}

static size_t sums_bytes(const deform_job *job, size_t threads) {
    const size_t picture = padded(job->pixels * job->d.c * job->t),
                 blocks = threads * padded(BLOCK * TAPS * job->d.c * job->t);
    return picture > blocks ? picture : blocks; /* x' gradient, or workers' columns */
}

static void backward(nn_call *call) {
    deform_job job = job_of(call);
    const size_t threads = (size_t)core_pool_threads(call->pool);
    const bool data = call->din[0].data != NULL || call->din[1].data != NULL || call->din[2].data != NULL;
    const size_t partial = PARTIAL * padded((job.d.out * job.k + job.d.out) * job.t);
    job.weights = call->scratch;
    job.turned = job.weights + weight_bytes(&job);
    job.columns = job.turned + weight_bytes(&job);
    job.results_t = job.columns + padded(job.results * TAPS * job.d.c * job.t);
    job.weight_sums = job.results_t + threads * padded(BLOCK * job.d.out * job.t);
    job.sums = job.weight_sums + partial;
    order_weights(&job);
    const bool train = !call->parameter[0]->frozen || !call->parameter[1]->frozen;
    memset(job.weight_sums, 0, partial);
    for (; job.picture < (size_t)call->in[0].shape.n; job.picture++) {
        if (train) {
            core_parallel(call->pool, PARTIAL, 1, weight_blocks, &job);
        }
        if (data) {
            core_parallel(call->pool, job.results, BLOCK, column_blocks, &job);
            nn_zero(call->pool, job.sums, job.pixels * job.d.c * job.t);
            core_parallel(call->pool, job.d.offset_groups, 1, back_groups, &job);
        }
        if (call->din[0].data != NULL) {
            nn_each_chunk(call->pool, job.pixels * job.d.c, put_chunk, &job);
        }
    }
    if (train) {
        add_weights(&job);
    }
}

static size_t scratch_bytes(const nn_call *call, bool backward_pass, int threads) {
    nn_call copy = *call;
    const deform_job job = job_of(&copy);
    const size_t n = (size_t)threads, results = n * padded(BLOCK * job.d.out * job.t);
    if (!backward_pass) {
        return 2 * weight_bytes(&job) + n * padded(BLOCK * TAPS * job.d.c * job.t) + results;
    }
    return 2 * weight_bytes(&job) + padded(job.results * TAPS * job.d.c * job.t) + results +
           PARTIAL * padded((job.d.out * job.k + job.d.out) * job.t) + sums_bytes(&job, n);
}

static double flops(const nn_call *call) {
    const deform_job job =
        job_of(&(nn_call){.attributes = call->attributes, .in = {call->in[0], call->in[1], call->in[2]}});
    return (double)call->in[0].shape.n * (double)job.results *
           (2 * (double)job.d.out * (double)job.k + 8 * TAPS * (double)job.d.c);
}

static const nn_op deform_op = {.name = "deform_conv2d",
                                .keeps = NN_KEEP_IN0 | NN_KEEP_IN1 | NN_KEEP_IN2,
                                .forward = forward,
                                .backward = backward,
                                .scratch_bytes = scratch_bytes,
                                .flops = flops};

static bool fits(nn_shape x, nn_shape offset, nn_shape mask, const nn_deform *p) {
    const int64_t h = (int64_t)x.h + 2 * (int64_t)p->pad - 2 * (int64_t)p->dilation,
                  w = (int64_t)x.w + 2 * (int64_t)p->pad - 2 * (int64_t)p->dilation;
    const bool nested = p->offset_groups > p->weight_groups ? p->offset_groups % p->weight_groups == 0
                                                            : p->weight_groups % p->offset_groups == 0;
    return nested && x.c % p->offset_groups == 0 && x.c % p->weight_groups == 0 && p->out % p->weight_groups == 0 &&
           offset.n == x.n && offset.h == h && offset.w == w && offset.c == 18 * p->offset_groups && mask.n == x.n &&
           mask.h == h && mask.w == w && mask.c == 9 * p->offset_groups;
}

nn_value nn_deform_conv2d(nn_graph *g, nn_value x, nn_value offset, nn_value mask, const nn_deform *p) {
    if (!nn_usable(g, x) || !nn_usable(g, offset) || !nn_usable(g, mask)) {
        return 0;
    }
    const nn_shape s = nn_shape_of(g, x), o = nn_shape_of(g, offset), m = nn_shape_of(g, mask);
    if (p->out < 1 || p->pad < 0 || p->pad > 1 << 16 || p->dilation < 1 || p->dilation > 1 << 16 ||
        p->offset_groups < 1 || p->offset_groups > 1 << 16 || p->weight_groups < 1 || !fits(s, o, m, p)) {
        return nn_reject(g, "%s: offsets %s and masks %s for %s (out %d, pad %d, dilation %d, groups %d, %d)", p->name,
                         nn_text_of(o).text, nn_text_of(m).text, nn_text_of(s).text, p->out, p->pad, p->dilation,
                         p->offset_groups, p->weight_groups);
    }
    const nn_type type = nn_type_of(g, x), wide = type == NN_F64 ? NN_F64 : NN_F32;
    if ((nn_type_of(g, offset) == NN_F64) != (wide == NN_F64) || (nn_type_of(g, mask) == NN_F64) != (wide == NN_F64)) {
        return nn_reject(g, "%s: f64 goes with f64 only", p->name);
    }
    char name[128];
    const char *dot = p->name[0] != '\0' ? "." : "";
    const int fan_in = TAPS * s.c / p->weight_groups;
    snprintf(name, sizeof name, "%s%sweight", p->name, dot);
    nn_parameter *weight =
        nn_parameter_get(g, name, 4, (const int[]){p->out, s.c / p->weight_groups, 3, 3}, p->init, fan_in);
    snprintf(name, sizeof name, "%s%sbias", p->name, dot);
    nn_parameter *bias = nn_parameter_get(g, name, 1, &p->out, NN_INIT_UNIFORM_FAN_IN, fan_in);
    if (weight == NULL || bias == NULL) {
        return 0;
    }
    const deform d = {
        p->pad, p->dilation, (size_t)s.c, (size_t)p->out, (size_t)p->offset_groups, (size_t)p->weight_groups};
    return nn_node_add(g, &(nn_node_params){.op = &deform_op,
                                            .inputs = 3,
                                            .in = (const nn_value[]){x, offset, mask},
                                            .shape = {s.n, o.h, o.w, p->out},
                                            .type = type,
                                            .attributes = &d,
                                            .attributes_size = sizeof d,
                                            .parameter = {weight, bias}});
}
