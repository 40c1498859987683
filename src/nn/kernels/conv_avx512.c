/* SPDX-License-Identifier: Apache-2.0 */
/* conv_avx512.c: f32 blocks of 14 x 32 sums in the thirty-two registers of AVX-512. */
#include "nn/kernels/kernels.h"
#include "nn/kernels/vector_avx512.h"

#define STEP 1
#define ELEMENT float
typedef __m512 vb;
#define vb_load _mm512_loadu_ps
#define vb_spread(p) _mm512_set1_ps(*(p))
#define vf_sum(c, a, b) _mm512_fmadd_ps(a, b, c)
#include "nn/kernels/conv_vector.h"

#include "nn/kernels/conv_finish.h"

#include "nn/kernels/blocks_14.h"

const nn_isa nn_isa_avx512 = {.name = "avx512",
                              .in = NN_F32,
                              .rows = ROWS,
                              .cols = 2 * LANES,
                              .lanes = LANES,
                              .step = 1,
                              .row_multiple = 1,
                              .block = block,
                              .finish = finish,
                              .peak = peak};
