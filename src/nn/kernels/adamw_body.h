/* SPDX-License-Identifier: Apache-2.0 */
/* adamw_body.h: the loop of adamw.h under the name ADAMW. No multiplication is fused with an addition, so that all
 * instruction sets round alike. */
#include <math.h>

#include "nn/kernels/adamw.h"

void ADAMW(const nn_adamw_row *row, size_t n) {
    const nn_adamw_row r = *row;
    float *restrict value = r.value, *restrict grad = r.grad, *restrict m = r.moment1, *restrict v = r.moment2;
    for (size_t i = 0; i < n; i++) {
        const float g = grad[i] * r.scale;
        const float m1 = r.beta1 * m[i] + r.rest1 * g, v1 = r.beta2 * v[i] + r.rest2 * (g * g);
        m[i] = m1;
        v[i] = v1;
        value[i] = r.keep * value[i] - r.pace * (m1 / (sqrtf(v1) / r.root + r.epsilon));
        grad[i] = 0;
    }
    float *restrict average = r.average;
    for (size_t i = 0; average != NULL && i < n; i++) {
        average[i] = r.stay * average[i] + r.move * value[i];
    }
}
