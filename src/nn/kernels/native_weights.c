/* SPDX-License-Identifier: Apache-2.0 */
/*
 * native_weights.c: the gradient of the weights as products of tiles, summed over
 * the pixels (see native.h).
 *
 * f32: for each row of taps, rows of A are the run of taps at a pixel, as in the
 * forward pass but read across; B is dz as it is. bf16 instructions sum over pairs
 * (or 32) of neighbours in memory, here pixels: A is dz transposed, [out][pixels],
 * and B pairs of pixels of x, [pixel pair][c][2], one copy for each phase in which
 * taps fall on pairs.
 *
 * The rows of the result are cut into a number of slots that depends only on the
 * shape; each is summed by itself in f32, and the slots in order: the same bytes
 * for any number of threads.
 */
#include <string.h>

#include "nn/kernels/native.h"

enum {
    SLOT_PIXELS = 2048, /* at least: emptying and adding up a slot must cost little */
    SLOTS = 32,
    SLOT_TOTAL = 48 << 20, /* bytes of all slots together */
    TILE_BYTES = 288 << 10,
    TILE_WIDTH = 64,
    F32_ROWS = 2 /* at a time: so much of x and dz stays in the first-level cache for a block */
};

typedef struct weights_run {
    const native_state *state;
    const nn_conv_pass *pass;
    native_source x, dz;
    int slots;
    int rows, cols, tiles_w; /* of a tile of dz, at most; tiles across */
    size_t pixels;           /* cols, rounded up to a step */
    size_t out, c;           /* channels, rounded up to what a block writes */
    /* f32: of a staged row of x and dz. bf16: a phase of x and their number; dz has out * dz_row elements a row. */
    size_t x_row, dz_row, phase;
    int phases;
    bool dz_direct;
    size_t x_bytes, dz_bytes, line_bytes, slot_floats, worker_bytes;
} weights_run;

static weights_run describe(const native_state *state) {
    const nn_conv_shape *s = &state->shape;
    const nn_isa *isa = state->isa;
    weights_run r = {.state = state};
    r.x = (native_source){NULL, state->types.in, s->n, s->h, s->w, s->c, 1};
    r.dz = (native_source){NULL, state->types.in, s->n, s->oh, s->ow, s->out, 1};
    r.tiles_w = s->ow <= TILE_WIDTH * 3 / 2 ? 1 : native_ceil(s->ow, TILE_WIDTH);
    r.cols = native_ceil(s->ow, r.tiles_w);
    size_t k = (size_t)s->kernel, stride = (size_t)s->stride, element = native_element(isa);
    if (isa->in == NN_BF16) {
        /* Tap j of pixels p, p + 1 is the pair at 2 s q + j mod 2 s, s apart. */
        r.cols = (int)native_round_up((size_t)r.cols, 32);
        r.tiles_w = native_ceil(s->ow, r.cols);
        r.pixels = native_round_up((size_t)(r.cols < s->ow ? r.cols : s->ow), 32);
        r.out = native_round_up((size_t)s->out, 16);
        r.c = native_round_up((size_t)s->c, 16);
        r.phases = (int)(k < 2 * stride ? k : 2 * stride);
        r.phase = (r.pixels / 2 + (k - 1) / (2 * stride)) * r.c * 2;
        r.x_row = (size_t)r.phases * r.phase;
        r.dz_row = r.pixels;
        r.slot_floats = k * k * r.out * r.c;
        /* A line of x before it is paired, or 32 pixels of dz that are not all there. */
        size_t line = (2 * stride * (r.pixels / 2 + (k - 1) / (2 * stride)) + stride) * (size_t)s->c;
        size_t rest = 32 * (size_t)s->out;
        r.line_bytes = native_round_up((line > rest ? line : rest) * element, 64);
    } else {
        r.pixels = (size_t)r.cols;
        r.out = native_round_up((size_t)s->out, (size_t)isa->lanes);
        r.c = (size_t)s->c;
        r.x_row = native_round_up((((size_t)r.cols - 1) * stride + k) * r.c, 16);
        r.dz_direct = r.out == (size_t)s->out && state->types.in == NN_F32;
        r.dz_row = r.dz_direct ? 0 : r.pixels * r.out;
        r.slot_floats = k * k * r.c * r.out;
    }
    size_t dz_line = isa->in == NN_BF16 ? r.out * r.dz_row : r.dz_row;
    r.rows = 1;
    while (r.rows < s->oh && r.rows < 16 &&
           (((size_t)r.rows * stride + k) * r.x_row + ((size_t)r.rows + 1) * dz_line) * element <= TILE_BYTES) {
        r.rows++;
    }
    r.x_bytes = native_round_up((((size_t)r.rows - 1) * stride + k) * r.x_row * element, 64);
    r.dz_bytes = native_round_up((size_t)r.rows * dz_line * element, 64);
    r.worker_bytes = r.x_bytes + r.dz_bytes + r.line_bytes;
    r.slot_floats = native_round_up(r.slot_floats, 16);

    size_t rows = (size_t)s->n * (size_t)s->oh, slots = rows * (size_t)s->ow / SLOT_PIXELS;
    size_t room = SLOT_TOTAL / sizeof(float) / r.slot_floats;
    slots = slots > SLOTS ? SLOTS : slots;
    slots = slots > room ? room : slots;
    slots = slots > rows ? rows : slots;
    r.slots = slots < 1 ? 1 : (int)slots;
    return r;
}

size_t native_weights_scratch(const native_state *state, int threads);

size_t native_weights_scratch(const native_state *state, int threads) {
    weights_run r = describe(state);
    return (size_t)r.slots * r.slot_floats * sizeof(float) + (size_t)threads * r.worker_bytes;
}

typedef struct weights_tile {
    int n, y, x, rows, cols;
    unsigned char *x_stage, *dz_stage, *line;
    float *sums;
    bool add; /* not the slot's first tile */
} weights_tile;

static void tile_f32(const weights_run *r, const weights_tile *t) {
    const nn_conv_shape *s = &r->state->shape;
    const nn_isa *isa = r->state->isa;
    float *x = (float *)(void *)t->x_stage, *dz = (float *)(void *)t->dz_stage;
    int k = s->kernel, stride = s->stride, taps = (t->cols - 1) * stride + k;
    for (int i = 0; i < (t->rows - 1) * stride + k; i++) {
        native_copy_row(x + (size_t)i * r->x_row, NN_F32, &r->x, t->n, t->y * stride - s->pad + i,
                        t->x * stride - s->pad, taps, (size_t)taps * r->c);
    }
    size_t dz_row = r->dz_row;
    if (r->dz_direct) {
        size_t row = (size_t)t->n * (size_t)s->oh + (size_t)t->y;
        dz = (float *)(uintptr_t)r->pass->dz + (row * (size_t)s->ow + (size_t)t->x) * r->out;
        dz_row = (size_t)s->ow * r->out;
    } else {
        for (int i = 0; i < t->rows; i++) {
            for (int j = 0; j < t->cols; j++) {
                native_copy_row(dz + (size_t)i * dz_row + (size_t)j * r->out, NN_F32, &r->dz, t->n, t->y + i, t->x + j,
                                1, r->out);
            }
        }
    }
    int run = k * s->c, blocks = native_ceil(run, isa->rows);
    for (int y = 0; y < t->rows; y += F32_ROWS) {
        int rows = t->rows - y < F32_ROWS ? t->rows - y : F32_ROWS;
        for (int i = 0; i < k; i++) {
            for (int block = 0; block < blocks; block++) {
                int begin = run * block / blocks, end = run * (block + 1) / blocks;
                for (int o = 0; o < s->out; o += isa->cols) {
                    nn_block b = {.a = x + (size_t)(y * stride + i) * r->x_row + begin,
                                  .a_row = 1,
                                  .a_step = (ptrdiff_t)stride * s->c,
                                  .a_group = (ptrdiff_t)((size_t)stride * r->x_row),
                                  .b = dz + (size_t)y * dz_row + o,
                                  .b_step = (ptrdiff_t)r->out,
                                  .b_group = (ptrdiff_t)dz_row,
                                  .groups = rows,
                                  .steps = t->cols,
                                  .c = t->sums + ((size_t)i * (size_t)run + (size_t)begin) * r->out + o,
                                  .c_row = (ptrdiff_t)r->out,
                                  .add = t->add || y > 0};
                    isa->block(&b, end - begin, s->out - o < isa->cols ? s->out - o : isa->cols);
                }
            }
        }
    }
}

static void stage_bf16(const weights_run *r, const weights_tile *t) {
    const nn_conv_shape *s = &r->state->shape;
    const nn_isa *isa = r->state->isa;
    uint16_t *x = (uint16_t *)(void *)t->x_stage, *dz = (uint16_t *)(void *)t->dz_stage;
    uint16_t *line = (uint16_t *)(void *)t->line;
    int k = s->kernel, stride = s->stride;
    size_t c = (size_t)s->c, out = (size_t)s->out, pairs = r->phase / (2 * r->c);
    for (int i = 0; i < (t->rows - 1) * stride + k; i++) {
        native_copy_row(line, NN_BF16, &r->x, t->n, t->y * stride - s->pad + i, t->x * stride - s->pad,
                        (t->cols - 1) * stride + k, (2 * (size_t)stride * pairs + (size_t)stride) * c);
        for (int phase = 0; phase < r->phases; phase++) {
            uint16_t *to = x + (size_t)i * r->x_row + (size_t)phase * r->phase;
            for (size_t q = 0; q < pairs; q++) {
                const uint16_t *a = line + (2 * (size_t)stride * q + (size_t)phase) * c;
                isa->interleave(to + q * r->c * 2, a, a + (size_t)stride * c, s->c);
            }
        }
    }
    for (int i = 0; i < t->rows; i++) {
        size_t row = ((size_t)t->n * (size_t)s->oh + (size_t)(t->y + i)) * (size_t)s->ow + (size_t)t->x;
        const uint16_t *from = (const uint16_t *)r->pass->dz + row * out;
        uint16_t *to = dz + (size_t)i * r->out * r->dz_row;
        for (size_t p = 0; p < r->pixels; p += 32, from += 32 * out) {
            size_t there = (size_t)t->cols < p ? 0 : (size_t)t->cols - p;
            if (there < 32) { /* the rest is zeros, also what stands beside the tile */
                memset(line, 0, 32 * out * sizeof *line);
                memcpy(line, from, there * out * sizeof *line);
            }
            isa->transpose(to + p, (ptrdiff_t)r->dz_row, there < 32 ? line : from, (ptrdiff_t)out, s->out);
        }
    }
}

static void tile_bf16(const weights_run *r, const weights_tile *t) {
    const nn_conv_shape *s = &r->state->shape;
    const nn_isa *isa = r->state->isa;
    const uint16_t *x = (const uint16_t *)(const void *)t->x_stage, *dz = (const uint16_t *)(const void *)t->dz_stage;
    stage_bf16(r, t);
    int k = s->kernel, stride = s->stride, blocks = native_ceil(s->out, isa->rows);
    for (int i = 0; i < k; i++) {
        for (int j = 0; j < k; j++) {
            for (int c = 0; c < s->c; c += isa->cols) {
                for (int block = 0; block < blocks; block++) {
                    int begin = isa->row_multiple > 1 ? block * isa->rows : s->out * block / blocks;
                    int end = isa->row_multiple > 1 ? begin + isa->rows : s->out * (block + 1) / blocks;
                    end = end < s->out ? end : s->out;
                    size_t tap = (size_t)(j % (2 * stride)) * r->phase + (size_t)(j / (2 * stride)) * r->c * 2;
                    nn_block b = {.a = dz + (size_t)begin * r->dz_row,
                                  .a_row = (ptrdiff_t)r->dz_row,
                                  .a_step = isa->step,
                                  .a_group = (ptrdiff_t)(r->out * r->dz_row),
                                  .b = x + (size_t)i * r->x_row + tap + (size_t)c * 2,
                                  .b_step = (ptrdiff_t)r->c * 2,
                                  .b_group = (ptrdiff_t)((size_t)stride * r->x_row),
                                  .groups = t->rows,
                                  .steps = native_ceil(t->cols, isa->step),
                                  .c = t->sums + ((size_t)(i * k + j) * r->out + (size_t)begin) * r->c + c,
                                  .c_row = (ptrdiff_t)r->c,
                                  .add = t->add};
                    isa->block(&b, end - begin, s->c - c < isa->cols ? s->c - c : isa->cols);
                }
            }
        }
    }
}

static void run_slots(void *arg, size_t begin, size_t end, int worker) {
    const weights_run *r = arg;
    const nn_conv_shape *s = &r->state->shape;
    const nn_isa *isa = r->state->isa;
    size_t rows = (size_t)s->n * (size_t)s->oh;
    weights_tile t;
    t.x_stage = (unsigned char *)r->pass->scratch + (size_t)r->slots * r->slot_floats * sizeof(float) +
                (size_t)worker * r->worker_bytes;
    t.dz_stage = t.x_stage + r->x_bytes;
    t.line = t.dz_stage + r->dz_bytes;
    if (isa->enter != NULL) {
        isa->enter();
    }
    for (size_t slot = begin; slot < end; slot++) {
        t.sums = (float *)r->pass->scratch + slot * r->slot_floats;
        t.add = false;
        size_t last = rows * (slot + 1) / (size_t)r->slots;
        for (size_t row = rows * slot / (size_t)r->slots; row < last;) {
            t.n = (int)(row / (size_t)s->oh);
            t.y = (int)(row % (size_t)s->oh);
            t.rows = s->oh - t.y < r->rows ? s->oh - t.y : r->rows;
            t.rows = last - row < (size_t)t.rows ? (int)(last - row) : t.rows;
            for (int i = 0; i < r->tiles_w; i++) {
                t.x = i * r->cols;
                t.cols = s->ow - t.x < r->cols ? s->ow - t.x : r->cols;
                if (isa->in == NN_BF16) {
                    tile_bf16(r, &t);
                } else {
                    tile_f32(r, &t);
                }
                t.add = true;
            }
            row += (size_t)t.rows;
        }
    }
    if (isa->leave != NULL) {
        isa->leave();
    }
}

/* Adds the slots up and to dw, which has PyTorch's order. A piece is 16 output channels: a line of f32 sums. */
static void add_up(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const weights_run *r = arg;
    const nn_conv_shape *s = &r->state->shape;
    const float *slots = r->pass->scratch;
    float *dw = r->pass->dw;
    size_t taps = (size_t)s->kernel * (size_t)s->kernel, c = (size_t)s->c;
    bool f32 = r->state->isa->in == NN_F32;
    for (size_t piece = begin; piece < end; piece++) {
        size_t first = piece * 16, count = (size_t)s->out - first < 16 ? (size_t)s->out - first : 16;
        for (size_t tap = 0; tap < taps; tap++) {
            for (size_t i = 0; i < c; i++) {
                float sum[16] = {0};
                size_t at = f32 ? (tap * c + i) * r->out + first : (tap * r->out + first) * r->c + i;
                size_t step = f32 ? 1 : r->c;
                for (int slot = 0; slot < r->slots; slot++) {
                    const float *v = slots + (size_t)slot * r->slot_floats + at;
                    for (size_t o = 0; o < count; o++) {
                        sum[o] += v[o * step];
                    }
                }
                for (size_t o = 0; o < count; o++) {
                    dw[((first + o) * c + i) * taps + tap] += sum[o];
                }
            }
        }
    }
}

void nn_native_backward_weights(void *state, const nn_conv_pass *pass) {
    weights_run r = describe(state);
    r.pass = pass;
    r.x.data = pass->x;
    r.dz.data = pass->dz;
    core_parallel(pass->pool, (size_t)r.slots, 1, run_slots, &r);
    core_parallel(pass->pool, (size_t)native_ceil(r.state->shape.out, 16), 1, add_up, &r);
}
