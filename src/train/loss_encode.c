/* SPDX-License-Identifier: Apache-2.0 */
/*
 * loss_encode.c: the curve under which differences are measured. Screens are
 * looked at through a gamma, and banding in the shadows is as visible as in the
 * lights, so linear differences would let the network neglect the dark half.
 *
 * x^(1/2.2) and the mu-law are both much steeper at 0 than elsewhere: infinitely,
 * and mu/ln(1 + mu) = 587 times. An offset bounds the former at 20.
 */
#include <math.h>

#include "train/loss.h"

#define GAMMA_OFFSET 1e-3
#define BOUND 1e30 /* where one side is not clamped */

nn_value train_encode(nn_graph *g, nn_value raw, train_encoding encoding, double mu) {
    const nn_value above = nn_clamp(g, raw, 0, BOUND), below = nn_clamp(g, raw, -BOUND, 0);
    nn_value curve;
    double slope;
    if (encoding == TRAIN_MU_LAW) {
        const double scale = 1 / log1p(mu);
        curve = nn_affine(g, nn_log(g, nn_affine(g, above, mu, 1)), scale, 0);
        slope = mu * scale;
    } else {
        const double power = 1 / 2.2, zero = pow(GAMMA_OFFSET, power),
                     scale = 1 / (pow(1 + GAMMA_OFFSET, power) - zero);
        curve = nn_affine(g, nn_pow(g, nn_affine(g, above, 1, GAMMA_OFFSET), power), scale, -zero * scale);
        slope = scale * power * pow(GAMMA_OFFSET, power - 1);
    }
    return nn_add(g, curve, nn_affine(g, below, slope, 0));
}
