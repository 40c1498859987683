/* SPDX-License-Identifier: Apache-2.0 */
/* sample.h: bilinear reading of a picture anywhere, for warp.c: corners outside the picture count as 0. */
#ifndef NN_SAMPLE_H
#define NN_SAMPLE_H

#include "nn/node.h"

/* The corners around (y, x), in the order of y, x: 00, 01, 10, 11; those outside are left out. */
typedef struct nn_corners {
    int count;
    size_t pixel[4];                /* y w + x */
    double weight[4], dy[4], dx[4]; /* and its derivatives */
} nn_corners;

static inline nn_corners nn_corners_of(double y, double x, int h, int w) {
    nn_corners k = {.count = 0};
    if (!(y > -1 && y < h && x > -1 && x < w)) { /* NaN too */
        return k;
    }
    const int y0 = (int)(y + 1) - 1, x0 = (int)(x + 1) - 1; /* floor, from -1 */
    const double fy = y - y0, fx = x - x0;
    for (int i = 0; i < 4; i++) {
        const int yi = y0 + i / 2, xi = x0 + i % 2;
        if (yi < 0 || yi >= h || xi < 0 || xi >= w) {
            continue;
        }
        const double wy = i / 2 ? fy : 1 - fy, wx = i % 2 ? fx : 1 - fx;
        k.pixel[k.count] = (size_t)yi * (size_t)w + (size_t)xi;
        k.weight[k.count] = wy * wx;
        k.dy[k.count] = i / 2 ? wx : -wx;
        k.dx[k.count++] = i % 2 ? wy : -wy;
    }
    return k;
}

#endif
