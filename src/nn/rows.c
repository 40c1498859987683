/* SPDX-License-Identifier: Apache-2.0 */
/* rows.c: the inner loops wherever there is nothing better, and the choice. */
#define NN_ROWS nn_rows_plain
#include "nn/rows_body.h"

const nn_rows *nn_rows_of(nn_type type) {
#if defined(__x86_64__)
    const core_cpu cpu = core_cpu_features();
    if (cpu.avx512) {
        return &nn_rows_avx512[type];
    }
    if (cpu.avx2) {
        return &nn_rows_avx2[type];
    }
#endif
    return &nn_rows_plain[type];
}

void nn_load_double(nn_type type, const void *from, double *to, size_t n) {
    for (size_t i = 0; i < n; i++) {
        to[i] = type == NN_F64    ? ((const double *)from)[i]
                : type == NN_BF16 ? (double)nn_from_bf16(((const uint16_t *)from)[i])
                                  : (double)((const float *)from)[i];
    }
}

void nn_store_double(nn_type type, const double *from, void *to, size_t n, bool add) {
    for (size_t i = 0; i < n; i++) {
        if (type == NN_F64) {
            double *d = (double *)to + i;
            *d = add ? *d + from[i] : from[i];
        } else if (type == NN_BF16) {
            uint16_t *h = (uint16_t *)to + i;
            *h = nn_to_bf16((float)(add ? (double)nn_from_bf16(*h) + from[i] : from[i]));
        } else {
            float *f = (float *)to + i;
            *f = (float)(add ? (double)*f + from[i] : from[i]);
        }
    }
}
