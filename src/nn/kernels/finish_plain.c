/* SPDX-License-Identifier: Apache-2.0 */
/* finish_plain.c: from sums to results in plain C: for activations that are seldom, and for emulated kernels. */
#include <math.h>

#include "nn/kernels/kernels.h"
#include "nn/node.h"

static float activate(float v, nn_activation activation) {
    switch (activation) {
    case NN_LINEAR:
        break;
    case NN_RELU:
        return v < 0 ? 0 : v;
    case NN_LEAKY_RELU:
        return v < 0 ? 0.1f * v : v;
    case NN_SIGMOID:
        return 1 / (1 + expf(-v));
    case NN_TANH:
        return tanhf(v);
    }
    return v;
}

void nn_finish_plain(const nn_finish *f) {
    for (int i = 0; i < f->rows; i++) {
        for (int o = 0; o < f->cols; o++) {
            ptrdiff_t at = i * f->y_row + o;
            float v = f->c[i * 32 + o] + (f->bias != NULL ? f->bias[o] : 0);
            if (f->residual != NULL) {
                v += f->result == NN_BF16 ? nn_from_bf16(((const uint16_t *)f->residual)[at])
                                          : ((const float *)f->residual)[at];
            }
            v = activate(v, f->activation);
            if (f->result == NN_BF16) {
                ((uint16_t *)f->y)[at] = nn_to_bf16(v);
            } else {
                ((float *)f->y)[at] = v;
            }
        }
    }
}
