/* SPDX-License-Identifier: Apache-2.0 */
/* rows_avx2.c: the inner loops, compiled with AVX2. */
#define NN_ROWS nn_rows_avx2
#include "nn/rows_body.h"
