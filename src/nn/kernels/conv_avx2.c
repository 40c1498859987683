/* SPDX-License-Identifier: Apache-2.0 */
/* conv_avx2.c: f32 blocks of 6 x 16 sums in the sixteen registers of AVX2. */
#include <immintrin.h>

#include "nn/kernels/kernels.h"

#define ROWS 6
#define LANES 8
#define STEP 1
#define VECTOR_REGISTER "x"
#define ELEMENT float
typedef __m256 vf, vb;
#define vf_zero _mm256_setzero_ps
#define vf_load _mm256_loadu_ps
#define vf_store _mm256_storeu_ps
#define vf_add _mm256_add_ps
#define vf_mul _mm256_mul_ps
#define vf_max _mm256_max_ps
#define vf_set _mm256_set1_ps
#define vb_load _mm256_loadu_ps
#define vb_spread _mm256_broadcast_ss
#define vf_sum(c, a, b) _mm256_fmadd_ps(a, b, c)
#include "nn/kernels/conv_vector.h"

ALWAYS_INLINE __m256i first(int n) {
    return _mm256_cmpgt_epi32(_mm256_set1_epi32(n), _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
}

ALWAYS_INLINE vf vf_load_part(const float *p, int n) {
    return n == LANES ? _mm256_loadu_ps(p) : _mm256_maskload_ps(p, first(n));
}

ALWAYS_INLINE void vf_store_part(float *p, vf v, int n) {
    if (n == LANES) {
        _mm256_storeu_ps(p, v);
    } else {
        _mm256_maskstore_ps(p, first(n), v);
    }
}

ALWAYS_INLINE vf vf_load_bf16(const uint16_t *p, int n) {
    uint16_t part[LANES] = {0};
    if (n < LANES) {
        for (int i = 0; i < n; i++) {
            part[i] = p[i];
        }
        p = part;
    }
    __m256i wide = _mm256_cvtepu16_epi32(_mm_loadu_si128((const __m128i *)(const void *)p));
    return _mm256_castsi256_ps(_mm256_slli_epi32(wide, 16));
}

ALWAYS_INLINE void vf_store_bf16(uint16_t *p, vf v, int n) {
    /* To nearest even, as nn_to_bf16. */
    __m256i u = _mm256_castps_si256(v), odd = _mm256_and_si256(_mm256_srli_epi32(u, 16), _mm256_set1_epi32(1));
    __m256i rounded = _mm256_srli_epi32(_mm256_add_epi32(u, _mm256_add_epi32(odd, _mm256_set1_epi32(0x7fff))), 16);
    __m256i nan = _mm256_or_si256(_mm256_srli_epi32(u, 16), _mm256_set1_epi32(0x40));
    __m256i is_nan = _mm256_castps_si256(_mm256_cmp_ps(v, v, _CMP_UNORD_Q));
    rounded = _mm256_blendv_epi8(rounded, nan, is_nan);
    __m128i narrow = _mm_packus_epi32(_mm256_castsi256_si128(rounded), _mm256_extracti128_si256(rounded, 1));
    if (n == LANES) {
        _mm_storeu_si128((__m128i *)(void *)p, narrow);
    } else {
        uint16_t part[LANES];
        _mm_storeu_si128((__m128i *)(void *)part, narrow);
        for (int i = 0; i < n; i++) {
            p[i] = part[i];
        }
    }
}

#include "nn/kernels/conv_finish.h"

BLOCKS(1) BLOCKS(2) BLOCKS(3) BLOCKS(4) BLOCKS(5) BLOCKS(6)

static void block(const nn_block *b, int rows, int cols) {
    static void (*const blocks[ROWS][2])(const nn_block *) = {
        BLOCK_ENTRY(1) BLOCK_ENTRY(2) BLOCK_ENTRY(3) BLOCK_ENTRY(4) BLOCK_ENTRY(5) BLOCK_ENTRY(6)};
    blocks[rows - 1][cols > LANES](b);
}

const nn_isa nn_isa_avx2 = {.name = "avx2",
                            .in = NN_F32,
                            .rows = ROWS,
                            .cols = 2 * LANES,
                            .lanes = LANES,
                            .step = 1,
                            .row_multiple = 1,
                            .block = block,
                            .finish = finish,
                            .peak = peak};
