/* SPDX-License-Identifier: Apache-2.0 */
/*
 * network_input.c: what a network is shown of a bracket, tile by tile, the same way as it was in training
 * (train/sample.c): packed RGGB at the reference's exposure, linear and under the gamma curve, the reference first.
 *
 * Frames are moved by whole blocks first, as far as the tile's middle moved, and the flow is what remains: content that
 * wandered into the tile from outside is then there, and no flow is longer than what networks have learned from.
 *
 * The banding prior is measured on a square of the size that training's crops have, in the middle of the tile. Its
 * descriptors depend on that size (a ring of bins, the share of one bin's power in it), and its phase is that at the
 * centre of what was measured, which so is also that of the tile. Where the picture is smaller than the square, all of
 * it is measured. It is measured where the frame lies on the sensor: stripes don't move with the hand.
 */
#include <math.h>
#include <string.h>

#include "brace/banding.h"
#include "brace/develop.h"
#include "raw/isp.h"
#include "restore/network.h"

enum { WHOLE = 4 }; /* blocks that frames are moved by: networks join up to 4x4 */

int restore_red_column(brace_cfa cfa) {
    return cfa == BRACE_CFA_GRBG || cfa == BRACE_CFA_BGGR ? -1 : 0;
}

int restore_red_row(brace_cfa cfa) {
    return cfa == BRACE_CFA_GBRG || cfa == BRACE_CFA_BGGR ? -1 : 0;
}

size_t restore_network_frame(const brace_bracket *b, int i) {
    const size_t at = (size_t)i;
    return i == 0 ? b->reference : at <= b->reference ? at - 1 : at;
}

/* A frame's numbers at the reference's exposure. */
typedef struct view {
    const brace_frame *frame;
    const float *light; /* the guide's, of the frame's size; NULL: the frame's own samples */
    float scale[4];
    int column, row; /* of the mosaic, where packed (0, 0) begins */
} view;

static view view_of(const restore_tile *tile, int i) {
    const brace_bracket *b = tile->bracket;
    const bool guide = (size_t)i == b->count;
    const size_t index = guide ? b->reference : restore_network_frame(b, i);
    const brace_frame *f = b->frames[index];
    view v = {.frame = f, .light = guide ? tile->guide : NULL, .column = restore_red_column(f->cfa), .row = restore_red_row(f->cfa)};
    for (int k = 0; k < 4; k++) {
        v.scale[k] = (float)(1 / b->exposure[index]) / (f->white - f->black[k]);
    }
    return v;
}

/* `count` blocks of packed row y from x on, mirrored outside: R, G, G, B each. */
static void read_row(float *out, const view *v, int64_t x, int64_t y, int count) {
    const brace_frame *f = v->frame;
    for (int64_t dy = 0; dy < 2; dy++) {
        const int64_t sy = raw_mirror(2 * y + dy + v->row, f->height);
        const uint16_t *row = f->data + (size_t)sy * f->width;
        for (int64_t i = 0; i < 2 * (int64_t)count; i++) {
            int64_t sx = 2 * x + i + v->column;
            sx = sx >= 0 && sx < f->width ? sx : raw_mirror(sx, f->width);
            const size_t site = (size_t)((sy & 1) * 2 + (sx & 1));
            if (v->light != NULL) {
                out[4 * (i / 2) + 2 * dy + (i & 1)] = v->light[(size_t)sy * f->width + (size_t)sx];
                continue;
            }
            out[4 * (i / 2) + 2 * dy + (i & 1)] = ((float)row[sx] - f->black[site]) * v->scale[site];
        }
    }
}

typedef struct shown {
    const restore_tile *tile;
    const restore_motion *motion;
    view v;
    int width, height;     /* of the tile */
    int shift_x, shift_y;  /* of the frame, whole blocks */
    float *frames, *flow;  /* of this frame */
    float *rows;           /* a packed row for each worker */
} shown;

/* The displacement at a pixel of the tile. */
static void motion_at(const shown *s, int x, int y, double *dx, double *dy) {
    const brace_frame *f = s->v.frame;
    /* The centre of the block, in the packed pixels of align.c, which begin at the frame's corner. */
    restore_motion_at(s->motion, s->tile->x + x + 0.5 * s->v.column, s->tile->y + y + 0.5 * s->v.row,
                      ((size_t)f->width + 1) / 2, ((size_t)f->height + 1) / 2, dx, dy);
}

static void show_rows(void *arg, size_t begin, size_t end, int worker) {
    const shown *s = arg;
    const size_t width = (size_t)s->width;
    float *packed = s->rows + 4 * width * (size_t)worker;
    for (size_t y = begin; y < end; y++) {
        read_row(packed, &s->v, s->tile->x + s->shift_x, s->tile->y + (int64_t)y + s->shift_y, s->width);
        float *to = s->frames + 8 * width * y;
        for (size_t k = 0; k < 4 * width; k++) {
            to[2 * k] = packed[k];
            to[2 * k + 1] = packed[k] > 0 ? powf(packed[k], 1 / 2.2f) : 0;
        }
        float *flow = s->flow + 2 * width * y;
        for (size_t x = 0; x < width; x++) {
            double dx, dy;
            motion_at(s, (int)x, (int)y, &dx, &dy);
            flow[2 * x] = (float)(dx - s->shift_x);
            flow[2 * x + 1] = (float)(dy - s->shift_y);
        }
    }
}

/* In whole blocks; a motion that is out of all bounds moves the frame by no more than the picture is wide. */
static int whole(double motion, uint32_t most) {
    return WHOLE * (int)lrint(fmax(-(double)most, fmin(motion, most)) / WHOLE);
}

static brace_status show_prior(restore_network *n, const restore_tile *tile, int i, brace_error *error) {
    const view v = view_of(tile, i);
    const nn_shape s = nn_shape_of(n->graph, n->inputs.frames);
    const int most_x = ((int)v.frame->width - v.column + 1) / 2, most_y = ((int)v.frame->height - v.row + 1) / 2;
    const int width = most_x < n->side ? most_x : n->side, height = most_y < n->side ? most_y : n->side;
    /* In the middle of the tile, but inside the picture: mirrored stripes have another phase. */
    int x = tile->x + (s.w - width) / 2, y = tile->y + (s.h - height) / 2;
    x = x < 0 ? 0 : x > most_x - width ? most_x - width : x;
    y = y < 0 ? 0 : y > most_y - height ? most_y - height : y;
    const size_t pixels = (size_t)width * (size_t)height;
    float *plane = core_alloc(pixels + 4 * (size_t)width, sizeof *plane), *row = plane != NULL ? plane + pixels : NULL;
    if (plane == NULL) {
        return core_fail_memory(error, pixels * sizeof *plane, "the banding prior");
    }
    for (int dy = 0; dy < height; dy++) {
        read_row(row, &v, x, y + dy, width);
        for (int dx = 0; dx < width; dx++) {
            plane[dy * width + dx] = 0.25f * (row[4 * dx] + row[4 * dx + 1] + row[4 * dx + 2] + row[4 * dx + 3]);
        }
    }
    const brace_job alone = {.threads = 1};
    brace_fabp prior;
    brace_status status =
        brace_fabp_plane(&prior, plane, (uint32_t)width, (uint32_t)height, NULL, &alone, error);
    core_free(plane);
    if (status == BRACE_OK) {
        memcpy((float *)nn_data(n->graph, n->inputs.descriptors) + 8 * i, prior.descriptor, sizeof prior.descriptor);
        ((float *)nn_data(n->graph, n->inputs.rho))[i] = (float)prior.rho;
    }
    return status;
}

static brace_status show_balance(restore_network *n, const restore_tile *tile, brace_error *error) {
    brace_color color;
    brace_status status = brace_color_init(&color, tile->bracket->frames[tile->bracket->reference], error);
    if (status == BRACE_OK) {
        models_balance(nn_data(n->graph, n->inputs.balance), color.wb);
    }
    return status;
}

typedef struct shown_sigma {
    const restore_tile *tile;
    view v;
    float *to;
    int width;
} shown_sigma;

static void sigma_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const shown_sigma *s = arg;
    for (size_t y = begin; y < end; y++) {
        read_row(s->to + 4 * (size_t)s->width * y, &s->v, s->tile->x, s->tile->y + (int64_t)y, s->width);
    }
}

static void show_sigma(restore_network *n, const restore_tile *tile, core_pool *pool) {
    const nn_shape shape = nn_shape_of(n->graph, n->inputs.sigma);
    shown_sigma s = {.tile = tile, .v = view_of(tile, 0), .to = nn_data(n->graph, n->inputs.sigma), .width = shape.w};
    s.v.light = tile->sigma;
    core_parallel(pool, (size_t)shape.h, 8, sigma_rows, &s);
}

brace_status restore_network_show(restore_network *n, const restore_tile *tile, core_pool *pool, brace_error *error) {
    const nn_shape shape = nn_shape_of(n->graph, n->inputs.frames);
    const size_t pixels = (size_t)shape.h * (size_t)shape.w;
    float *rows = core_alloc((size_t)core_pool_threads(pool) * (size_t)shape.w, 4 * sizeof *rows);
    if (rows == NULL) {
        return core_fail_memory(error, (size_t)shape.w * 16, "a tile");
    }
    brace_status status = n->shape.balance ? show_balance(n, tile, error) : BRACE_OK;
    if (n->shape.sigma) {
        show_sigma(n, tile, pool);
    }
    for (int i = 0; i < shape.n && status == BRACE_OK; i++) {
        static const restore_motion none = {.confidence = 1};
        const bool guide = (size_t)i == tile->bracket->count; /* lies as the reference does, as far as any frame reaches */
        const size_t index = guide ? 0 : restore_network_frame(tile->bracket, i);
        shown s = {.tile = tile, .motion = guide ? &none : &tile->motion[index], .v = view_of(tile, i), .rows = rows,
                   .width = shape.w, .height = shape.h,
                   .frames = (float *)nn_data(n->graph, n->inputs.frames) + 8 * pixels * (size_t)i,
                   .flow = (float *)nn_data(n->graph, n->inputs.flow) + 2 * pixels * (size_t)i};
        double dx, dy;
        motion_at(&s, shape.w / 2, shape.h / 2, &dx, &dy);
        s.shift_x = whole(dx, s.v.frame->width);
        s.shift_y = whole(dy, s.v.frame->height);
        core_parallel(pool, (size_t)shape.h, 8, show_rows, &s);
        ((float *)nn_data(n->graph, n->inputs.white))[i] = (float)(1 / tile->bracket->exposure[index]);
        status = show_prior(n, tile, i, error);
    }
    core_free(rows);
    return status;
}
