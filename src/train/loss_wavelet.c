/* SPDX-License-Identifier: Apache-2.0 */
/*
 * loss_wavelet.c: the multi-level wavelet loss: differences sorted by scale and
 * orientation. Banding is smooth along one direction and slow across it, so it
 * lies in the coarse LH and HL bands, where a pixel-wise loss sees it least:
 * a stripe of half a per cent disappears among the noise of single pixels.
 */
#include <math.h>

#include "train/loss.h"

/* Twice as much a level as stripes get wider; HH, where no stripe of a single direction lies, half of LH and HL; LL,
 * the brightness of blocks of 8 pixels, as much as one of the coarsest. In 43rds, their sum. */
const double train_wavelet_weights[TRAIN_WAVELET_BANDS] = {2.0 / 43, 2.0 / 43, 1.0 / 43, 4.0 / 43, 4.0 / 43,
                                                           2.0 / 43, 8.0 / 43, 8.0 / 43, 4.0 / 43, 8.0 / 43};

nn_value train_loss_wavelet(nn_graph *g, nn_value difference, const double weights[TRAIN_WAVELET_BANDS]) {
    const nn_shape s = nn_shape_of(g, difference);
    nn_value low = difference, sum = 0;
    for (int level = 0; level < TRAIN_WAVELET_LEVELS; level++) {
        const nn_value bands = nn_haar(g, low);
        low = nn_slice(g, bands, NN_AXIS_C, 0, s.c, 1);
        for (int band = 0; band < 4; band++) {
            const bool is_low = band == 0, last = level == TRAIN_WAVELET_LEVELS - 1;
            const double weight = is_low ? weights[TRAIN_WAVELET_BANDS - 1] : weights[3 * level + band - 1];
            if ((is_low && !last) || weight == 0) {
                continue;
            }
            const nn_value part = nn_slice(g, bands, NN_AXIS_C, band * s.c, (band + 1) * s.c, 1);
            const nn_value mean = nn_mean(g, nn_abs(g, part), true, true, true, true);
            const nn_value term = nn_affine(g, mean, ldexp(weight, -(level + 1)), 0);
            sum = sum != 0 ? nn_add(g, sum, term) : term;
        }
    }
    return sum;
}
