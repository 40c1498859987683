/* SPDX-License-Identifier: Apache-2.0 */
/*
 * loss_isp.c: RAW to sRGB as docs/isp.md has it, but plane by plane: at the
 * resolution of the packed planes there is nothing to demosaic, and colour, which
 * is what the loss is about, is the same.
 */
#include <math.h>

#include "train/loss.h"

#define BOUND 1e30

/* 12.92 x up to t, 1.055 x^(1/2.4) - 0.055 above: IEC 61966-2-1. */
static nn_value encode_srgb(nn_graph *g, nn_value x) {
    const double t = 0.0031308;
    const nn_value straight = nn_affine(g, nn_clamp(g, x, -BOUND, t), 12.92, 0);
    const nn_value curve = nn_affine(g, nn_pow(g, nn_clamp(g, x, t, BOUND), 1 / 2.4), 1.055, -1.055 * pow(t, 1 / 2.4));
    return nn_add(g, straight, curve);
}

nn_value train_isp(nn_graph *g, nn_value raw, nn_value gains, nn_value matrix) {
    const nn_shape s = nn_shape_of(g, raw);
    const nn_value green =
        nn_affine(g, nn_add(g, nn_slice(g, raw, NN_AXIS_C, 1, 2, 1), nn_slice(g, raw, NN_AXIS_C, 2, 3, 1)), 0.5, 0);
    const nn_value planes[] = {nn_slice(g, raw, NN_AXIS_C, 0, 1, 1), green, nn_slice(g, raw, NN_AXIS_C, 3, 4, 1)};
    const nn_value camera = nn_clamp(g, nn_mul(g, nn_concat(g, NN_AXIS_C, 3, planes), gains), -BOUND, 1);
    const nn_value pixels = nn_reshape(g, camera, (nn_shape){1, 1, s.h * s.w, 3});
    const nn_value linear = nn_matmul(g, pixels, matrix, false, 1);
    return nn_reshape(g, encode_srgb(g, linear), (nn_shape){1, s.h, s.w, 3});
}
