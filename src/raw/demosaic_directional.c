/* SPDX-License-Identifier: Apache-2.0 */
/*
 * demosaic_directional.c: the default demosaicing.
 *
 * Colour differences (green minus red or blue) change slowly where the channels
 * themselves have edges. So: estimate them along rows and along columns with
 * the interpolator of Hamilton and Adams (US patent 5,629,734, 1997, expired),
 * average them toward north, south, west and east with weights that fall with
 * the square of how much the differences vary on that side (the gradient of colour
 * differences of Pekkucuksen and Altunbasak, "Gradient based
 * threshold free color filter array interpolation", ICIP 2010), and fill in the
 * missing ones of the other colour from the diagonals and then from the four sides,
 * weighted by the same gradients. No thresholds, no iteration.
 *
 * All of it works on the square root of light, where shot noise is the same at every
 * brightness (Anscombe 1948) and steps have about the size that they have to the
 * eye: in linear light the differences on the bright side of an edge swamp the dark
 * side. Worth 3 dB on the pictures of docs/isp.md.
 */
#include <math.h>
#include <string.h>

#include "raw/isp.h"

enum { STRIDE = RAW_TILE_STRIDE };

/* Added before the root. It bounds the root's slope at black, and so the bias: the mean of
 * roots is less than the root of the mean, by about variance/(4*(light + offset)) in light. */
static const float offset = 0.02f;

/* Keeps weights finite in flat regions and even where differences are below any sensor's noise. */
static const float flat = 1e-4f;

/* Shares of the four colour differences from the pixel itself outward on one side. They sum to 1. */
static const float side[4] = {0.56f, 0.35f, 0.08f, 0.01f};

static void to_root(const float *restrict m, float *restrict u, int end) {
    for (int x = 0; x < end; x++) {
        const float v = m[x] + offset;
        u[x] = sqrtf(v > 0.0f ? v : 0.0f);
    }
}

static inline float from_root(float u) {
    return (u > 0.0f ? u * u : 0.0f) - offset;
}

/* Green minus own colour at every pixel, as rows and as columns see it: at green pixels the
 * other colour is interpolated, elsewhere green is. */
static void differences(const float *restrict m, float *restrict across, float *restrict down, int begin, int end,
                        int green_phase) {
    const float sign[2] = {green_phase ? -1.0f : 1.0f, green_phase ? 1.0f : -1.0f};
    for (int x = begin; x < end; x++) {
        const float s = sign[x & 1];
        const float h = 0.5f * (m[x - 1] + m[x + 1]) + 0.25f * ((m[x] - m[x - 2]) + (m[x] - m[x + 2]));
        const float v =
            0.5f * (m[x - STRIDE] + m[x + STRIDE]) + 0.25f * ((m[x] - m[x - 2 * STRIDE]) + (m[x] - m[x + 2 * STRIDE]));
        across[x] = s * (m[x] - h);
        down[x] = s * (m[x] - v);
    }
}

/* How much the differences vary along their own direction, summed over five columns. */
static void variation(const float *restrict across, const float *restrict down, float *restrict out_across,
                      float *restrict out_down, int begin, int end) {
    float h[STRIDE], v[STRIDE];
    for (int x = begin - 2; x < end + 2; x++) {
        h[x] = fabsf(across[x - 1] - across[x + 1]);
        v[x] = fabsf(down[x - STRIDE] - down[x + STRIDE]);
    }
    for (int x = begin; x < end; x++) {
        out_across[x] = (h[x - 2] + h[x + 2]) + (h[x - 1] + h[x + 1]) + h[x];
        out_down[x] = (v[x - 2] + v[x + 2]) + (v[x - 1] + v[x + 1]) + v[x];
    }
}

/* The sum of five rows. */
static void sum_rows(const float *restrict in, float *restrict out, int begin, int end) {
    for (int x = begin; x < end; x++) {
        out[x] = (in[x - 2 * STRIDE] + in[x + 2 * STRIDE]) + (in[x - STRIDE] + in[x + STRIDE]) + in[x];
    }
}

/* The colour difference of the pixel's own colour: the four sides weighted. */
static void combine(const float *restrict across, const float *restrict down, const float *restrict vary_across,
                    const float *restrict vary_down, float *restrict own, int begin, int end) {
    for (int x = begin; x < end; x++) {
        const float bn = vary_down[x - 2 * STRIDE] + flat, bs = vary_down[x + 2 * STRIDE] + flat;
        const float bw = vary_across[x - 2] + flat, be = vary_across[x + 2] + flat;
        const float wn = 1.0f / (bn * bn), ws = 1.0f / (bs * bs), ww = 1.0f / (bw * bw), we = 1.0f / (be * be);
        const float n = side[1] * down[x - STRIDE] + side[2] * down[x - 2 * STRIDE] + side[3] * down[x - 3 * STRIDE];
        const float s = side[1] * down[x + STRIDE] + side[2] * down[x + 2 * STRIDE] + side[3] * down[x + 3 * STRIDE];
        const float w = side[1] * across[x - 1] + side[2] * across[x - 2] + side[3] * across[x - 3];
        const float e = side[1] * across[x + 1] + side[2] * across[x + 2] + side[3] * across[x + 3];
        const float sum =
            (wn * n + ws * s) + (ww * w + we * e) + side[0] * ((wn + ws) * down[x] + (ww + we) * across[x]);
        own[x] = sum / ((wn + ws) + (ww + we));
    }
}

/* At red the difference of blue and the reverse: the flatter diagonal counts more. */
static void cross(const float *restrict own, float *restrict other, int begin, int end) {
    for (int x = begin; x < end; x++) {
        const float a = own[x - STRIDE - 1], b = own[x + STRIDE + 1];
        const float c = own[x - STRIDE + 1], d = own[x + STRIDE - 1];
        const float vary_fall = fabsf(a - b) + flat, vary_rise = fabsf(c - d) + flat;
        other[x] = 0.5f * (vary_rise * (a + b) + vary_fall * (c + d)) / (vary_fall + vary_rise);
    }
}

/* All three channels of one row: differences at green pixels from the four sides, then back to colours.
 * `m` is the mosaic, `u` its root: what was recorded is not sent through the root. */
static void finish(const float *restrict m, const float *restrict u, const float *restrict own,
                   const float *restrict other, const float *restrict vary_across, const float *restrict vary_down,
                   float *restrict green, float *restrict row_color, float *restrict column_color, int begin, int end,
                   int green_phase) {
    for (int x = begin; x < end; x++) {
        const float bh = vary_across[x] + flat, bv = vary_down[x] + flat;
        const float wh = bv * bv, wv = bh * bh, scale = 0.5f / (wh + wv);
        const float row = scale * (wh * (own[x - 1] + own[x + 1]) + wv * (other[x - STRIDE] + other[x + STRIDE]));
        const float column = scale * (wh * (other[x - 1] + other[x + 1]) + wv * (own[x - STRIDE] + own[x + STRIDE]));
        const bool is_green = ((x ^ green_phase) & 1) == 0;
        const float g = is_green ? u[x] : u[x] + own[x];
        green[x] = is_green ? m[x] : from_root(g);
        row_color[x] = is_green ? from_root(g - row) : m[x];
        column_color[x] = from_root(g - (is_green ? column : other[x]));
    }
}

void raw_demosaic_directional(raw_tile *tile) {
    const int rows = tile->height + 2 * RAW_HALO, columns = tile->width + 2 * RAW_HALO;
    float *across = tile->work[0], *down = tile->work[1], *vary_across = tile->work[2], *vary_down = tile->work[3];
    float *root = tile->work[5], *own = tile->work[4],
          *other = across; /* the row differences are not needed any more by then */
    /* Planes of the result serve as intermediates until finish() fills them. */
    float *five_across = tile->rgb[1], *five_down = tile->rgb[2];

    for (int y = 0; y < rows; y++) {
        to_root(tile->mosaic + (size_t)y * STRIDE, root + (size_t)y * STRIDE, columns);
    }
    /* Each step uses up some halo: 2 + 1 + 2 + 2 + 1 + 1 of RAW_HALO. */
    for (int y = 2; y < rows - 2; y++) {
        const size_t at = (size_t)y * STRIDE;
        differences(root + at, across + at, down + at, 2, columns - 2, raw_green_phase(tile->cfa, y));
    }
    for (int y = 3; y < rows - 3; y++) {
        const size_t at = (size_t)y * STRIDE;
        variation(across + at, down + at, five_across + at, five_down + at, 5, columns - 5);
    }
    for (int y = 5; y < rows - 5; y++) {
        const size_t at = (size_t)y * STRIDE;
        sum_rows(five_across + at, vary_across + at, 5, columns - 5);
        sum_rows(five_down + at, vary_down + at, 5, columns - 5);
    }
    for (int y = 7; y < rows - 7; y++) {
        const size_t at = (size_t)y * STRIDE;
        combine(across + at, down + at, vary_across + at, vary_down + at, own + at, 7, columns - 7);
    }
    for (int y = 8; y < rows - 8; y++) {
        const size_t at = (size_t)y * STRIDE;
        cross(own + at, other + at, 8, columns - 8);
    }
    for (int y = RAW_HALO; y < RAW_HALO + tile->height; y++) {
        const size_t at = (size_t)y * STRIDE;
        const int color = raw_row_color(tile->cfa, y);
        finish(tile->mosaic + at, root + at, own + at, other + at, vary_across + at, vary_down + at, tile->rgb[1] + at,
               tile->rgb[color] + at, tile->rgb[2 - color] + at, RAW_HALO, RAW_HALO + tile->width,
               raw_green_phase(tile->cfa, y));
    }
}
