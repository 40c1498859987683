/* SPDX-License-Identifier: Apache-2.0 */
/*
 * demosaic.c: the two linear demosaicing methods, and the choice among the three.
 *
 * Each row is computed as if every pixel were of every kind and the right result
 * is then picked per pixel: twice the arithmetic, but free of branches and of
 * strided access, so that the compiler makes vector code of it.
 */
#include <string.h>

#include "raw/isp.h"

/* What a row needs to know: the mosaic around it and where its results go. */
typedef struct row {
    const float *m[5];          /* mosaic rows y-2 .. y+2 */
    float *green, *own, *other; /* own: the colour that the row holds besides green */
} row;

/* Puts the recorded samples into their own channels. */
static void keep_recorded(const row *r, int begin, int end, int green_phase) {
    const float *m = r->m[2];
    for (int x = begin + ((begin ^ green_phase) & 1); x < end; x += 2) {
        r->green[x] = m[x];
    }
    for (int x = begin + ((begin ^ green_phase ^ 1) & 1); x < end; x += 2) {
        r->own[x] = m[x];
    }
}

static void bilinear_row(const row *r, int begin, int end, int green_phase) {
    const float *n = r->m[1], *m = r->m[2], *s = r->m[3];
    float *restrict green = r->green, *restrict own = r->own, *restrict other = r->other;
    for (int x = begin; x < end; x++) {
        const float horizontal = 0.5f * (m[x - 1] + m[x + 1]);
        const float vertical = 0.5f * (n[x] + s[x]);
        const float diagonal = 0.25f * ((n[x - 1] + n[x + 1]) + (s[x - 1] + s[x + 1]));
        const bool is_green = ((x ^ green_phase) & 1) == 0;
        green[x] = 0.5f * (horizontal + vertical);
        own[x] = horizontal;
        other[x] = is_green ? vertical : diagonal;
    }
    keep_recorded(r, begin, end, green_phase);
}

/* Malvar, He and Cutler, "High-quality linear interpolation for demosaicing of
 * Bayer-patterned color images", ICASSP 2004: bilinear plus a multiple of the
 * Laplacian of the channel that the pixel does hold. Coefficients of figure 2. */
static void malvar_row(const row *r, int begin, int end, int green_phase) {
    const float *nn = r->m[0], *n = r->m[1], *m = r->m[2], *s = r->m[3], *ss = r->m[4];
    float *restrict green = r->green, *restrict own = r->own, *restrict other = r->other;
    for (int x = begin; x < end; x++) {
        const float horizontal = m[x - 1] + m[x + 1], vertical = n[x] + s[x];
        const float far_horizontal = m[x - 2] + m[x + 2], far_vertical = nn[x] + ss[x];
        const float diagonal = (n[x - 1] + n[x + 1]) + (s[x - 1] + s[x + 1]);
        const float far = far_horizontal + far_vertical;
        const bool is_green = ((x ^ green_phase) & 1) == 0;
        const float at_green = 0.625f * m[x] - 0.125f * diagonal;
        green[x] = 0.25f * (horizontal + vertical) + (0.5f * m[x] - 0.125f * far);
        own[x] = 0.5f * horizontal + at_green - 0.125f * far_horizontal + 0.0625f * far_vertical;
        other[x] = is_green ? 0.5f * vertical + at_green - 0.125f * far_vertical + 0.0625f * far_horizontal
                            : 0.25f * diagonal + 0.75f * m[x] - 0.1875f * far;
    }
    keep_recorded(r, begin, end, green_phase);
}

void raw_demosaic_tile(raw_tile *tile, brace_demosaic method) {
    if (method != BRACE_DEMOSAIC_BILINEAR && method != BRACE_DEMOSAIC_MALVAR) {
        raw_demosaic_directional(tile);
        return;
    }
    for (int y = RAW_HALO; y < RAW_HALO + tile->height; y++) {
        const int color = raw_row_color(tile->cfa, y);
        const size_t at = (size_t)y * RAW_TILE_STRIDE;
        row r = {.green = tile->rgb[1] + at, .own = tile->rgb[color] + at, .other = tile->rgb[2 - color] + at};
        for (int i = 0; i < 5; i++) {
            r.m[i] = tile->mosaic + (size_t)(y + i - 2) * RAW_TILE_STRIDE;
        }
        if (method == BRACE_DEMOSAIC_BILINEAR) {
            bilinear_row(&r, RAW_HALO, RAW_HALO + tile->width, raw_green_phase(tile->cfa, y));
        } else {
            malvar_row(&r, RAW_HALO, RAW_HALO + tile->width, raw_green_phase(tile->cfa, y));
        }
    }
}
