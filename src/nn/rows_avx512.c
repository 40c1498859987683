/* SPDX-License-Identifier: Apache-2.0 */
/* rows_avx512.c: the inner loops, compiled with AVX-512 F, BW, DQ and VL. */
#define NN_ROWS nn_rows_avx512
#include "nn/rows_body.h"
