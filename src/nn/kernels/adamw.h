/* SPDX-License-Identifier: Apache-2.0 */
/* adamw.h: one step over a row of parameters, compiled for each instruction set. See optimizer.h for the formula. */
#ifndef NN_ADAMW_H
#define NN_ADAMW_H

#include <stddef.h>

typedef struct nn_adamw_row {
    float *value, *grad, *moment1, *moment2, *average; /* average: NULL where none is kept; grad becomes zero */
    float scale;                                       /* of the gradient */
    float keep;                                        /* 1 - rate decay */
    float beta1, rest1, beta2, rest2;                  /* rest = 1 - beta, rounded once */
    float root;                                        /* sqrt(1 - beta2^t) */
    float epsilon, pace;                               /* pace = rate/(1 - beta1^t) */
    float stay, move;                                  /* of the averages */
} nn_adamw_row;

void nn_adamw_plain(const nn_adamw_row *row, size_t n);
void nn_adamw_avx2(const nn_adamw_row *row, size_t n);
void nn_adamw_avx512(const nn_adamw_row *row, size_t n);

#endif
