/* SPDX-License-Identifier: Apache-2.0 */
/*
 * isp.h: the inside of the image signal processor: raw units to [0, 1] and
 * back, and the demosaicing of one tile. Internal; the public half is
 * include/brace/develop.h, the description docs/isp.md.
 */
#ifndef RAW_ISP_H
#define RAW_ISP_H

#include <stddef.h>
#include <stdint.h>

#include "brace/develop.h"
#include "brace/frame.h"
#include "core/core.h"

/* ---- raw units (develop.c) ---- */

/* BRACE_OK if the frame has data, a sane size, a known CFA and finite levels with
 * white above every black. */
brace_status raw_check_frame(const brace_frame *frame, brace_error *error);

/* (sample - black) / (white - black), each CFA position with its own black:
 * width*height floats, neither clipped above nor below. The frame must pass
 * raw_check_frame. `pool` may be NULL. */
void raw_normalise(const brace_frame *frame, float *mosaic, core_pool *pool);

/* The inverse into out->data: rounded to nearest and clipped to [0, white]. Values
 * below 0, which noise makes, stay below black. NaN becomes black. */
void raw_quantise(brace_frame *out, const float *mosaic, core_pool *pool);

/* brace_develop and brace_develop_linear with the caller's threads: `mosaic`
 * NULL develops frame->data. */
brace_status raw_develop(brace_image **out, const float *mosaic, const brace_frame *frame,
                         const brace_develop_params *params, const brace_job *job, core_pool *pool, brace_error *error);

/* ---- demosaicing of a tile (demosaic.c, demosaic_directional.c) ---- */

/* Pixels are made tile by tile so that all the intermediate planes of one tile stay in
 * the cache. A tile carries RAW_HALO mosaic pixels more on each side, enough for
 * the widest method; beyond the picture they are mirrored about the outermost
 * pixel, which keeps the CFA in phase. All three numbers are even, so that every tile starts
 * with the same CFA phase. */
enum {
    RAW_TILE_WIDTH = 232,
    RAW_TILE_HEIGHT = 64,
    RAW_HALO = 12,
    RAW_TILE_STRIDE = RAW_TILE_WIDTH + 2 * RAW_HALO,
    RAW_TILE_ROWS = RAW_TILE_HEIGHT + 2 * RAW_HALO,
    RAW_TILE_SAMPLES = RAW_TILE_STRIDE * RAW_TILE_ROWS
};

typedef struct raw_tile {
    int width, height; /* of the pixels wanted, without halo */
    brace_cfa cfa;
    float mosaic[RAW_TILE_SAMPLES]; /* white-balanced, with halo */
    float rgb[3][RAW_TILE_SAMPLES]; /* the result, valid inside the halo only */
    float work[6][RAW_TILE_SAMPLES];
} raw_tile;

/* Fills tile->rgb. A recorded sample comes out bit for bit in its own channel. */
void raw_demosaic_tile(raw_tile *tile, brace_demosaic method);

/* The default method; see demosaic_directional.c. */
void raw_demosaic_directional(raw_tile *tile);

/* Where row y of a tile (counted with halo) has green: first column, 0 or 1; and which of
 * red (0) and blue (2) its other samples are. */
static inline int raw_green_phase(brace_cfa cfa, int y) {
    const int first = cfa == BRACE_CFA_GRBG || cfa == BRACE_CFA_GBRG ? 0 : 1;
    return first ^ (y & 1);
}

static inline int raw_row_color(brace_cfa cfa, int y) {
    const int first = cfa == BRACE_CFA_RGGB || cfa == BRACE_CFA_GRBG ? 0 : 2;
    return y & 1 ? 2 - first : first;
}

/* i mirrored into [0, n) about the first and the last element, which are not repeated. */
static inline int64_t raw_mirror(int64_t i, int64_t n) {
    const int64_t period = 2 * (n - 1);
    i %= period;
    if (i < 0) {
        i += period;
    }
    return i < n ? i : period - i;
}

#endif
