/* SPDX-License-Identifier: Apache-2.0 */
/* native.c: forward convolution as products of overlapping rows (see native.h), tile by tile. */
#include <limits.h>
#include <string.h>

#include "nn/kernels/native.h"

enum {
    TILE_BYTES = 160 << 10, /* of staged rows: a good part of them and a block of weights fit a 1 MiB cache */
    TILE_WIDTH = 160,
    NARROW = 64,
    GOOD_ROWS = 5, /* or more, less one */
    FINISH_COLS = 32,
    PART_BYTES = 36 << 10, /* of weights, used again and again from the first-level cache */
    PART_PIXELS = 160      /* or more use them before the next ones */
};

/* A forward convolution, or the one that backward_data is. */
typedef struct native_run {
    const nn_isa *isa;
    native_source x;
    int oh, ow, out, kernel, stride, pad;
    const void *packed;
    const float *bias;
    const void *residual;
    void *y;
    nn_type result;
    nn_activation activation;
    unsigned char *scratch;
    /* Tiles. */
    int rows, cols;       /* of a tile, at most */
    int tiles_h, tiles_w; /* a picture */
    int steps;            /* of a run of taps */
    size_t line;          /* elements of a staged row */
    /* Parts: so many rows of taps, and steps of each, are added to the sums of so many rows of a tile. */
    int part_groups, part_steps, part_rows;
    size_t stage_bytes, worker_bytes;
} native_run;

void native_copy_row(void *out, nn_type to, const native_source *from, int n, int y, int x, int pixels,
                     size_t elements) {
    size_t c = (size_t)from->c, size = nn_type_size(to), done = 0;
    unsigned char *p = out;
    bool inside = y >= 0 && y % from->dilate == 0 && y / from->dilate < from->h;
    if (inside && from->dilate == 1) {
        int begin = x < 0 ? -x : 0, end = from->w - x < pixels ? from->w - x : pixels;
        if (begin < end) {
            memset(p, 0, (size_t)begin * c * size);
            size_t at = (((size_t)n * (size_t)from->h + (size_t)y) * (size_t)from->w + (size_t)(x + begin)) * c;
            size_t count = (size_t)(end - begin) * c;
            unsigned char *q = p + (size_t)begin * c * size;
            if (to == from->type) {
                memcpy(q, (const unsigned char *)from->data + at * size, count * size);
            } else { /* bf16 for an f32 kernel */
                const uint16_t *v = (const uint16_t *)from->data + at;
                float *f = (float *)(void *)q;
                for (size_t i = 0; i < count; i++) {
                    f[i] = nn_from_bf16(v[i]);
                }
            }
            done = (size_t)end * c;
        }
    } else if (inside) {
        native_source line = *from;
        line.dilate = 1;
        for (int i = 0; i < pixels; i++) {
            int at = x + i;
            bool there = at >= 0 && at % from->dilate == 0;
            native_copy_row(p + (size_t)i * c * size, to, &line, n, y / from->dilate, there ? at / from->dilate : -1, 1,
                            c);
        }
        done = (size_t)pixels * c;
    }
    memset(p + done * size, 0, (elements - done) * size);
}

/* Weights that the first-level cache does not hold are used in parts, each for many pixels. Not with AMX, whose sums
 * would be stored and loaded too often. */
static void plan_parts(native_run *r) {
    const nn_isa *isa = r->isa;
    int room = PART_BYTES / (int)((size_t)(isa->step * isa->cols) * native_element(isa));
    r->part_groups = r->kernel;
    r->part_steps = r->steps;
    r->part_rows = 1;
    if (isa->row_multiple == 1 && (long)r->steps * r->kernel > room) {
        r->part_groups = room / r->steps > 1 ? room / r->steps : 1;
        r->part_steps = native_ceil(r->steps, native_ceil(r->steps, room));
        r->part_rows = r->cols < PART_PIXELS ? PART_PIXELS / r->cols : 1;
        r->part_rows = r->part_rows < r->rows ? r->part_rows : r->rows;
    }
}

static bool in_parts(const native_run *r) {
    return r->part_groups < r->kernel || r->part_steps < r->steps;
}

/* Cuts the result in tiles, so many that `threads` have work and so small that they stay in the cache. */
static void plan_tiles(native_run *r, int threads) {
    const nn_isa *isa = r->isa;
    size_t c = (size_t)r->x.c, s = (size_t)r->stride, k = (size_t)r->kernel;
    r->steps = native_ceil(r->kernel * r->x.c, isa->step);
    int multiple = isa->row_multiple > 1 ? isa->rows : 1;
    /* Rows above and below are staged for several tiles: narrower ones if so few rows would fit. */
    for (int across = native_ceil(r->ow, TILE_WIDTH);; across++) {
        r->cols = (int)native_round_up((size_t)native_ceil(r->ow, across), (size_t)multiple);
        r->cols = r->cols < r->ow ? r->cols : r->ow;
        r->tiles_w = native_ceil(r->ow, r->cols);
        size_t read = native_round_up((size_t)r->cols, (size_t)isa->row_multiple);
        /* Longer than what is read by a line or two, so that rows do not fall on the same places of the cache. */
        r->line = native_round_up(((read - 1) * s + k) * c + (size_t)(r->steps * isa->step), 64) + 64;
        if (r->cols <= NARROW || (GOOD_ROWS * s + k) * r->line * native_element(isa) <= TILE_BYTES) {
            break;
        }
    }
    r->rows = 1;
    while (r->rows < r->oh && r->rows < 16 && ((size_t)r->rows * s + k) * r->line * native_element(isa) <= TILE_BYTES) {
        r->rows++;
    }
    while (r->rows > 1 && (long)r->x.n * native_ceil(r->oh, r->rows) * r->tiles_w < 4L * threads) {
        r->rows--;
    }
    r->tiles_h = native_ceil(r->oh, r->rows);
    r->rows = native_ceil(r->oh, r->tiles_h);
    plan_parts(r);
    size_t sums = in_parts(r) ? (size_t)r->part_rows * (size_t)r->cols : (size_t)isa->rows;
    r->stage_bytes = native_round_up((((size_t)r->rows - 1) * s + k) * r->line * native_element(isa), 64);
    r->worker_bytes = r->stage_bytes + sums * FINISH_COLS * sizeof(float);
}

/* A tile, and where its pixels are read: rows `line` elements apart, the first tap of its first result at `base`. */
typedef struct native_tile {
    int n, y, x, rows, cols;
    const unsigned char *base;
    size_t line;
    float *sums;
} native_tile;

static void stage_tile(const native_run *r, native_tile *t, unsigned char *stage) {
    const nn_isa *isa = r->isa;
    int k = r->kernel, s = r->stride, c = r->x.c, run = k * c;
    size_t size = native_element(isa);

    /* Read in place what has no zeros around it, if no step reads on past the end. */
    int top = t->y * s - r->pad, left = t->x * s - r->pad;
    if (r->x.type == isa->in && r->x.dilate == 1 && top >= 0 && left >= 0 && top + (t->rows - 1) * s + k <= r->x.h &&
        left + (t->cols - 1) * s + k <= r->x.w && run % isa->step == 0) {
        size_t first = (((size_t)t->n * (size_t)r->x.h + (size_t)top) * (size_t)r->x.w + (size_t)left) * (size_t)c;
        size_t line = (size_t)r->x.w * (size_t)c, read = native_round_up((size_t)t->cols, (size_t)isa->row_multiple);
        size_t last = first + (size_t)((t->rows - 1) * s + k - 1) * line + (read - 1) * (size_t)(s * c) + (size_t)run;
        if (last <= (size_t)r->x.n * (size_t)r->x.h * line) {
            t->base = (const unsigned char *)r->x.data + first * size;
            t->line = line;
            return;
        }
    }
    t->base = stage;
    t->line = r->line;
    for (int i = 0; i < (t->rows - 1) * s + k; i++) {
        native_copy_row(stage + (size_t)i * t->line * size, isa->in, &r->x, t->n, top + i, left, (t->cols - 1) * s + k,
                        t->line);
    }
}

static void finish_block(const native_run *r, const native_tile *t, int y, int x, int rows, int o, const float *sums) {
    size_t at =
        (((size_t)t->n * (size_t)r->oh + (size_t)(t->y + y)) * (size_t)r->ow + (size_t)(t->x + x)) * (size_t)r->out +
        (size_t)o;
    size_t size = nn_type_size(r->result);
    r->isa->finish(&(nn_finish){
        .c = sums,
        .rows = rows,
        .cols = r->out - o < r->isa->cols ? r->out - o : r->isa->cols,
        .bias = r->bias != NULL ? r->bias + o : NULL,
        .residual = r->residual != NULL ? (const unsigned char *)r->residual + at * size : NULL,
        .y = (unsigned char *)r->y + at * size,
        .y_row = r->out,
        .activation = r->activation,
        .result = r->result,
    });
}

/* Adds the products with steps `step` and on of rows of taps `group` and on, for output channels from `o` and rows
 * `begin` to `end` of the tile. */
static void add_part(const native_run *r, const native_tile *t, int o, int begin, int end, int group, int step) {
    const nn_isa *isa = r->isa;
    size_t size = native_element(isa), width = (size_t)isa->cols * (size_t)isa->step;
    size_t weights = (size_t)r->steps * width, pixel = (size_t)(r->stride * r->x.c);
    bool parts = in_parts(r), first = group == 0 && step == 0;
    bool last = group + r->part_groups >= r->kernel && step + r->part_steps >= r->steps;
    nn_block b = {
        .b = (const unsigned char *)r->packed +
             (((size_t)(o / isa->cols) * (size_t)r->kernel + (size_t)group) * weights + (size_t)step * width) * size,
        .a_row = (ptrdiff_t)pixel,
        .a_step = isa->step,
        .a_group = (ptrdiff_t)t->line,
        .b_step = (ptrdiff_t)isa->cols * (isa->in == NN_BF16 ? 2 : 1),
        .b_group = (ptrdiff_t)weights,
        .groups = r->kernel - group < r->part_groups ? r->kernel - group : r->part_groups,
        .steps = r->steps - step < r->part_steps ? r->steps - step : r->part_steps,
        .c_row = FINISH_COLS,
        .add = !first,
    };
    int cols = r->out - o < isa->cols ? r->out - o : isa->cols, blocks = native_ceil(t->cols, isa->rows);
    for (int y = begin; y < end; y++) {
        const unsigned char *row =
            t->base + ((size_t)(y * r->stride + group) * t->line + (size_t)(step * isa->step)) * size;
        for (int i = 0; i < blocks; i++) {
            /* Blocks of nearly the same size, or of whole tiles and a rest. */
            int x = isa->row_multiple > 1 ? i * isa->rows : t->cols * i / blocks;
            int x_end = isa->row_multiple > 1 ? x + isa->rows : t->cols * (i + 1) / blocks;
            x_end = x_end < t->cols ? x_end : t->cols;
            b.a = row + (size_t)x * pixel * size;
            b.c = t->sums + (parts ? ((size_t)(y - begin) * (size_t)t->cols + (size_t)x) * FINISH_COLS : 0);
            isa->block(&b, x_end - x, cols);
            if (last) {
                finish_block(r, t, y, x, x_end - x, o, b.c);
            }
        }
    }
}

static void tile(const native_run *r, int n, int y, int x, unsigned char *scratch) {
    native_tile t = {.n = n,
                     .y = y,
                     .x = x,
                     .rows = r->oh - y < r->rows ? r->oh - y : r->rows,
                     .cols = r->ow - x < r->cols ? r->ow - x : r->cols,
                     .sums = (float *)(void *)(scratch + r->stage_bytes)};
    stage_tile(r, &t, scratch);
    for (int o = 0; o < r->out; o += r->isa->cols) {
        for (int begin = 0; begin < t.rows; begin += r->part_rows) {
            int end = t.rows - begin < r->part_rows ? t.rows : begin + r->part_rows;
            for (int group = 0; group < r->kernel; group += r->part_groups) {
                for (int step = 0; step < r->steps; step += r->part_steps) {
                    add_part(r, &t, o, begin, end, group, step);
                }
            }
        }
    }
}

static void tiles(void *arg, size_t begin, size_t end, int worker) {
    const native_run *r = arg;
    if (r->isa->enter != NULL) {
        r->isa->enter();
    }
    for (size_t i = begin; i < end; i++) {
        size_t row = i / (size_t)r->tiles_w;
        int x = (int)(i % (size_t)r->tiles_w), y = (int)(row % (size_t)r->tiles_h);
        tile(r, (int)(row / (size_t)r->tiles_h), y * r->rows, x * r->cols,
             r->scratch + (size_t)worker * r->worker_bytes);
    }
    if (r->isa->leave != NULL) {
        r->isa->leave();
    }
}

/* A 1x1 convolution knows no rows: all pixels are one. */
static void flatten(native_run *r) {
    size_t pixels = (size_t)r->x.n * (size_t)r->oh * (size_t)r->ow;
    if (r->kernel == 1 && r->stride == 1 && r->pad == 0 && r->x.dilate == 1 && pixels <= INT_MAX) {
        r->x.n = r->x.h = r->oh = 1;
        r->x.w = r->ow = (int)pixels;
    }
}

static native_run describe(const native_state *state, nn_product product, int threads) {
    const nn_conv_shape *s = &state->shape;
    native_run r = {.isa = state->isa, .kernel = s->kernel};
    if (product == NN_PRODUCT_FORWARD) {
        r.x = (native_source){NULL, state->types.in, s->n, s->h, s->w, s->c, 1};
        r.oh = s->oh, r.ow = s->ow, r.out = s->out, r.stride = s->stride, r.pad = s->pad;
        r.result = state->types.result;
    } else {
        /* dx is a convolution of dz, spread by the stride, with the kernel turned around. */
        r.x = (native_source){NULL, state->types.in, s->n, s->oh, s->ow, s->out, s->stride};
        r.oh = s->h, r.ow = s->w, r.out = s->c, r.stride = 1, r.pad = s->kernel - 1 - s->pad;
        r.result = state->types.in;
    }
    flatten(&r);
    plan_tiles(&r, threads);
    return r;
}

/* ---- weights ---- */

typedef struct native_packing {
    const native_state *state;
    const float *weight;
    void *out;
    bool turned; /* of backward_data: in and out swapped, taps reversed */
} native_packing;

static size_t packed_group(const native_state *state, bool turned) { /* elements of a row of taps of a block */
    int run = state->shape.kernel * (turned ? state->shape.out : state->shape.c);
    return (size_t)(native_ceil(run, state->isa->step) * state->isa->step) * (size_t)state->isa->cols;
}

/* [block of columns][row of taps][step][column][pair]; zeros where channels end. A piece is one row of taps. */
static void pack(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const native_packing *p = arg;
    const nn_conv_shape *s = &p->state->shape;
    const nn_isa *isa = p->state->isa;
    int k = s->kernel, in = p->turned ? s->out : s->c, out = p->turned ? s->c : s->out, cols = isa->cols;
    int kk = isa->in == NN_BF16 ? 2 : 1;
    size_t group = packed_group(p->state, p->turned), c = (size_t)s->c;
    for (size_t piece = begin; piece < end; piece++) {
        int first = (int)(piece / (size_t)k) * cols, i = (int)(piece % (size_t)k);
        int count = out - first < cols ? out - first : cols;
        unsigned char *to = (unsigned char *)p->out + piece * group * native_element(isa);
        memset(to, 0, group * native_element(isa));
        for (int t = 0; t < k * in; t++) {
            int j = t / in, channel = t % in, tap = p->turned ? (k - 1 - i) * k + k - 1 - j : i * k + j;
            size_t at = (size_t)(t / kk * cols * kk + t % kk);
            for (int o = 0; o < count; o++) {
                size_t a = (size_t)(p->turned ? channel : first + o), b = (size_t)(p->turned ? first + o : channel);
                float v = p->weight[(a * c + b) * (size_t)(k * k) + (size_t)tap];
                if (kk == 2) {
                    ((uint16_t *)(void *)to)[at + (size_t)(o * kk)] = nn_to_bf16(v);
                } else {
                    /* A bf16 graph rounds its weights whichever kernel computes it. */
                    ((float *)(void *)to)[at + (size_t)o] =
                        p->state->types.in == NN_BF16 ? nn_from_bf16(nn_to_bf16(v)) : v;
                }
            }
        }
    }
}

static void keep_packed(native_state *state, const nn_conv_pass *pass, bool turned) {
    if (state->packed[turned].made_of == pass->weight && state->packed[turned].version == pass->version) {
        return;
    }
    native_packing p = {state, pass->weight, state->packed[turned].weights, turned};
    int out = turned ? state->shape.c : state->shape.out;
    core_parallel(pass->pool, (size_t)(native_ceil(out, state->isa->cols) * state->shape.kernel), 1, pack, &p);
    state->packed[turned].made_of = pass->weight;
    state->packed[turned].version = pass->version;
}

/* ---- the method ---- */

void nn_native_destroy(void *p) {
    native_state *state = p;
    if (state != NULL) {
        core_free(state->packed[0].weights);
        core_free(state->packed[1].weights);
        core_free(state);
    }
}

brace_status nn_native_create(void **out, const nn_method *method, const nn_conv_shape *shape, nn_conv_types types,
                              bool training, int threads, brace_error *error) {
    (void)threads;
    *out = NULL;
    native_state *state = core_calloc(1, sizeof *state);
    if (state == NULL) {
        return core_fail_memory(error, sizeof *state, "a convolution");
    }
    state->isa = method->isa;
    state->shape = *shape;
    state->types = types;
    for (int turned = 0; turned <= (training ? 1 : 0); turned++) {
        size_t blocks = (size_t)native_ceil(turned ? shape->c : shape->out, state->isa->cols) * (size_t)shape->kernel;
        size_t bytes = packed_group(state, turned) * native_element(state->isa);
        state->packed[turned].weights = core_alloc(blocks, bytes);
        if (state->packed[turned].weights == NULL) {
            nn_native_destroy(state);
            return core_fail_memory(error, blocks * bytes, "the packed weights of a convolution");
        }
    }
    *out = state;
    return BRACE_OK;
}

size_t native_weights_scratch(const native_state *state, int threads);

size_t nn_native_scratch(const void *state, nn_product product, int threads) {
    if (product == NN_PRODUCT_WEIGHTS) {
        return native_weights_scratch(state, threads);
    }
    return describe(state, product, threads).worker_bytes * (size_t)threads;
}

static void run(native_run *r, const nn_conv_pass *pass) {
    r->scratch = pass->scratch;
    core_parallel(pass->pool, (size_t)r->x.n * (size_t)r->tiles_h * (size_t)r->tiles_w, 1, tiles, r);
}

void nn_native_forward(void *p, const nn_conv_pass *pass) {
    native_state *state = p;
    keep_packed(state, pass, false);
    native_run r = describe(state, NN_PRODUCT_FORWARD, core_pool_threads(pass->pool));
    r.x.data = pass->x;
    r.y = pass->y;
    r.bias = pass->bias;
    r.residual = pass->residual;
    r.activation = pass->activation;
    r.packed = state->packed[0].weights;
    run(&r, pass);
}

void nn_native_backward_data(void *p, const nn_conv_pass *pass) {
    native_state *state = p;
    keep_packed(state, pass, true);
    native_run r = describe(state, NN_PRODUCT_DATA, core_pool_threads(pass->pool));
    r.x.data = pass->dz;
    r.y = pass->dx;
    r.residual = pass->add ? pass->dx : NULL; /* each element is read just before it is written */
    r.packed = state->packed[1].weights;
    run(&r, pass);
}
