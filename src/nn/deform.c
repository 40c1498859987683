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
 * gradient, from which come those of x, offsets and masks, while they are in the cache.
 *
 * Channels are cut into parts that lie in one offset group and one weight group. Columns
 * are ordered weight group, tap, channel. Units are whole groups of both kinds: what
 * belongs to one, x' gradient above all, is nobody else's.
 */
#include <string.h>

#include "nn/chunks.h"
#include "nn/move.h"

enum { TAPS = 9, BLOCK = 64 /* pixels */, PARTIAL = 8 /* sums of weight gradients, of a picture */ };

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
    nn_view x, offset, mask;
    unsigned char *weights, *turned; /* T: {group, k, out/group} and {group, out/group, k} */
    unsigned char *columns;          /* T: a block for each worker */
    unsigned char *results_t;        /* T: a block for each worker */
    /* Backward. */
    size_t units, shares; /* workers share a picture's units */
    bool train, data;     /* gradients of the parameters, and of what is put in */
    unsigned char *weight_sums, *sums; /* T; sums: x' gradient */
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
    const size_t count = parts(job), wide = job->d.c / job->d.weight_groups,
                 first = group * count / job->d.offset_groups * (job->d.c / count); /* channel */
    return (nn_taps){.h = (int)job->h,
                     .w = (int)job->w,
                     .dilation = job->d.dilation,
                     .channels = job->d.c,
                     .c = job->d.c / count,
                     .first = group * count / job->d.offset_groups,
                     .parts = count / job->d.offset_groups,
                     .wide = job->d.c / job->d.weight_groups,
                     .k = job->k,
                     .column = first / wide * job->k + first % wide};
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

/* Rows of columns for some pixels and offset groups. */
static void sample_columns(const deform_job *job, size_t first, size_t last, size_t begin, size_t end,
                           unsigned char *columns) {
    for (size_t g = first; g < last; g++) {
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
        sample_columns(job, 0, job->d.offset_groups, p, p + n, columns);
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

/* ---- backward ---- */

static const unsigned char *gradient_at(const deform_job *job, size_t pixel, size_t n, unsigned char *room) {
    const unsigned char *g = (const unsigned char *)job->call->dout.data + pixel * job->d.out * job->rows->s_size;
    if (job->call->dout.type != NN_BF16) {
        return g;
    }
    job->rows->load(g, room, n * job->d.out);
    return room;
}

static size_t partial_bytes(const deform_job *job) {
    return padded((job->d.out * job->k + job->d.out) * job->t);
}

/* A block of pixels, and the units that a worker has. */
typedef struct deform_block {
    size_t picture, at, n; /* at: of the picture */
    size_t offset_first, offset_last, weight_first, weight_last; /* groups */
    const unsigned char *g;
    unsigned char *columns;
} deform_block;

/* Columns transposed times g. Stretches of a picture have sums of their own, whoever makes them. */
static void back_weights(const deform_job *job, const deform_block *b) {
    const size_t row = TAPS * job->d.c, out = job->d.out, few = out / job->d.weight_groups;
    const size_t blocks = (job->results + BLOCK - 1) / BLOCK, p = b->picture * job->results + b->at;
    unsigned char *sums =
        job->weight_sums + (b->picture * PARTIAL + b->at / BLOCK * PARTIAL / blocks) * partial_bytes(job);
    unsigned char *bias = sums + out * job->k * job->t;
    sample_columns(job, b->offset_first, b->offset_last, p, p + b->n, b->columns);
    for (size_t i = b->weight_first; i < b->weight_last; i++) {
        job->rows->product(job->k, few, b->n, b->columns + i * job->k * job->t, 1, row, b->g + i * few * job->t, out,
                           sums + i * job->k * few * job->t, few, true);
        for (size_t q = 0; q < b->n; q++) {
            job->rows->add_weighted_t(1, b->g + (q * out + i * few) * job->t, bias + i * few * job->t, few);
        }
    }
}

/* From the columns' gradient those of x, offsets and masks. */
static void back_data(const deform_job *job, const deform_block *b) {
    const nn_view d_offset = job->call->din[1], d_mask = job->call->din[2];
    const size_t row = TAPS * job->d.c, out = job->d.out, few = out / job->d.weight_groups;
    const size_t first = b->picture * job->pixels * job->d.c;
    const unsigned char *picture = (const unsigned char *)job->x.data + first * job->rows->s_size;
    unsigned char *sums = job->call->din[0].data != NULL ? job->sums + first * job->t : NULL;
    for (size_t i = b->weight_first; i < b->weight_last; i++) {
        job->rows->product(b->n, job->k, few, b->g + i * few * job->t, out, 1, job->turned + i * few * job->k * job->t,
                           job->k, b->columns + i * job->k * job->t, row, false);
    }
    for (size_t q = 0; q < b->n; q++) {
        const size_t p = b->picture * job->results + b->at + q;
        for (size_t g = b->offset_first; g < b->offset_last; g++) {
            const nn_taps taps = taps_of(job, g);
            const size_t at = p * job->d.offset_groups + g;
            double offsets[18], masks[9]; /* room for T */
            taps_at t;
            find_taps(job, p, g, &t);
            job->rows->taps_back(&taps, picture, t.offset, t.mask, t.y, t.x, b->columns + q * row * job->t, sums,
                                 offsets, masks);
            if (d_offset.data != NULL) {
                nn_put(job->offset_rows, d_offset, 18 * at, 18, offsets, job->call->add[1]);
            }
            if (d_mask.data != NULL) {
                nn_put(job->mask_rows, d_mask, 9 * at, 9, masks, job->call->add[2]);
            }
        }
    }
}

/* A share of a picture's units each, in the order of the pixels. */
static void back_shares(void *arg, size_t begin, size_t end, int worker) {
    const deform_job *job = arg;
    const size_t offsets = job->d.offset_groups / job->units, weights = job->d.weight_groups / job->units;
    unsigned char *room = job->results_t + (size_t)worker * padded(BLOCK * job->d.out * job->t);
    for (size_t s = begin; s < end; s++) {
        const size_t share = s % job->shares, first = share * job->units / job->shares,
                     last = (share + 1) * job->units / job->shares;
        deform_block b = {.picture = s / job->shares,
                          .offset_first = first * offsets,
                          .offset_last = last * offsets,
                          .weight_first = first * weights,
                          .weight_last = last * weights,
                          .columns = job->columns + (size_t)worker * padded(BLOCK * TAPS * job->d.c * job->t)};
        for (; b.at < job->results; b.at += BLOCK) {
            b.n = job->results - b.at < BLOCK ? job->results - b.at : BLOCK;
            b.g = gradient_at(job, b.picture * job->results + b.at, b.n, room);
            if (job->train) {
                back_weights(job, &b);
            }
            if (job->data) {
                back_data(job, &b);
            }
        }
    }
}

static void put_chunk(const void *context, size_t offset, size_t n) {
    const deform_job *job = context;
    nn_put(job->rows, job->call->din[0], offset, n, job->sums + offset * job->t, job->call->add[0]);
}

static double number(const deform_job *job, const unsigned char *p, size_t i) {
    return job->wide == NN_F64 ? ((const double *)(const void *)p)[i] : (double)((const float *)(const void *)p)[i];
}

/* Adds the partial sums to the parameters' gradients, in the parameters' order. */
static void add_weights(const deform_job *job) {
    const size_t wide = job->d.c / job->d.weight_groups, few = job->d.out / job->d.weight_groups,
                 stride = partial_bytes(job), count = (size_t)job->call->in[0].shape.n * PARTIAL;
    nn_parameter *w = job->call->parameter[0], *b = job->call->parameter[1];
    for (size_t o = 0; o < job->d.out; o++) {
        for (size_t i = 0; i < wide * TAPS && !w->frozen; i++) {
            const size_t k = i % TAPS * wide + i / TAPS, at = (o / few * job->k + k) * few + o % few;
            double sum = 0;
            for (size_t q = 0; q < count; q++) {
                sum += number(job, job->weight_sums + q * stride, at);
            }
            if (job->wide == NN_F64) {
                w->grad64[o * wide * TAPS + i] += sum;
            } else {
                w->grad[o * wide * TAPS + i] += (float)sum;
            }
        }
        double sum = 0;
        for (size_t q = 0; q < count; q++) {
            sum += number(job, job->weight_sums + q * stride, job->d.out * job->k + o);
        }
        if (!b->frozen && job->wide == NN_F64) {
            b->grad64[o] += sum;
        } else if (!b->frozen) {
            b->grad[o] += (float)sum;
        }
    }
}

static void backward(nn_call *call) {
    deform_job job = job_of(call);
    const size_t threads = (size_t)core_pool_threads(call->pool), n = (size_t)call->in[0].shape.n;
    const size_t partial = n * PARTIAL * partial_bytes(&job), x = n * job.pixels * job.d.c;
    const nn_view dx = call->din[0];
    const bool direct = dx.type != NN_BF16;
    job.units = job.d.offset_groups < job.d.weight_groups ? job.d.offset_groups : job.d.weight_groups;
    job.shares = (threads + n - 1) / n < job.units ? (threads + n - 1) / n : job.units;
    job.train = !call->parameter[0]->frozen || !call->parameter[1]->frozen;
    job.data = dx.data != NULL || call->din[1].data != NULL || call->din[2].data != NULL;
    job.weights = call->scratch;
    job.turned = job.weights + weight_bytes(&job);
    job.columns = job.turned + weight_bytes(&job);
    job.results_t = job.columns + threads * padded(BLOCK * TAPS * job.d.c * job.t);
    job.weight_sums = job.results_t + threads * padded(BLOCK * job.d.out * job.t);
    job.sums = direct ? dx.data : job.weight_sums + partial;
    order_weights(&job);
    memset(job.weight_sums, 0, partial);
    if (dx.data != NULL && !(direct && call->add[0])) {
        nn_zero(call->pool, job.sums, x * job.t);
    }
    core_parallel(call->pool, n * job.shares, 1, back_shares, &job);
    if (dx.data != NULL && !direct) {
        nn_each_chunk(call->pool, x, put_chunk, &job);
    }
    if (job.train) {
        add_weights(&job);
    }
}

static size_t scratch_bytes(const nn_call *call, bool backward_pass, int threads) {
    nn_call copy = *call;
    const deform_job job = job_of(&copy);
    const size_t workers = (size_t)threads, n = (size_t)call->in[0].shape.n;
    const size_t both = 2 * weight_bytes(&job) + workers * (padded(BLOCK * TAPS * job.d.c * job.t) +
                                                            padded(BLOCK * job.d.out * job.t));
    if (!backward_pass) {
        return both;
    }
    return both + n * PARTIAL * partial_bytes(&job) +
           (call->in[0].type == NN_BF16 ? n * job.pixels * job.d.c * job.t : 0);
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
