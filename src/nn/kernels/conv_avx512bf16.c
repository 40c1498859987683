/* SPDX-License-Identifier: Apache-2.0 */
/* conv_avx512bf16.c: bf16 blocks of 14 x 32 sums by vdpbf16ps, which multiplies and adds pairs. */
#include <string.h>

#include "nn/kernels/kernels.h"
#include "nn/kernels/vector_avx512.h"

#define STEP 2
#define ELEMENT uint16_t
typedef __m512i vb;
#define vb_load(p) _mm512_loadu_si512(p)
#define vf_sum(c, a, b) _mm512_dpbf16_ps(c, (__m512bh)(a), (__m512bh)(b))

ALWAYS_INLINE vb vb_spread(const uint16_t *p) {
    int pair; /* p has the alignment of one element */
    memcpy(&pair, p, sizeof pair);
    return _mm512_set1_epi32(pair);
}

#include "nn/kernels/conv_vector.h"

#include "nn/kernels/conv_finish.h"

#include "nn/kernels/blocks_14.h"

#include "nn/kernels/pairs_avx512.h"

const nn_isa nn_isa_avx512bf16 = {.name = "avx512bf16",
                                  .in = NN_BF16,
                                  .rows = ROWS,
                                  .cols = 2 * LANES,
                                  .lanes = LANES,
                                  .step = 2,
                                  .row_multiple = 1,
                                  .block = block,
                                  .finish = finish,
                                  .peak = peak,
                                  .interleave = interleave,
                                  .transpose = transpose};
