/* SPDX-License-Identifier: Apache-2.0 */
/* vector_avx512.h: what conv_vector.h and conv_finish.h call a vector, for the AVX-512 kernels. */
#include <immintrin.h>

#define ROWS 14
#define LANES 16
#define VECTOR_REGISTER "v"
typedef __m512 vf;
#define vf_zero _mm512_setzero_ps
#define vf_load _mm512_loadu_ps
#define vf_store _mm512_storeu_ps
#define vf_add _mm512_add_ps
#define vf_mul _mm512_mul_ps
#define vf_max _mm512_max_ps
#define vf_set _mm512_set1_ps
#ifndef ALWAYS_INLINE
#define ALWAYS_INLINE static inline __attribute__((always_inline))
#endif

ALWAYS_INLINE __mmask16 first(int n) {
    return (__mmask16)(0xffffu >> (LANES - n));
}

ALWAYS_INLINE vf vf_load_part(const float *p, int n) {
    return _mm512_maskz_loadu_ps(first(n), p);
}

ALWAYS_INLINE void vf_store_part(float *p, vf v, int n) {
    _mm512_mask_storeu_ps(p, first(n), v);
}

ALWAYS_INLINE vf vf_load_bf16(const uint16_t *p, int n) {
    __m512i wide = _mm512_cvtepu16_epi32(_mm256_maskz_loadu_epi16(first(n), p));
    return _mm512_castsi512_ps(_mm512_slli_epi32(wide, 16));
}

ALWAYS_INLINE void vf_store_bf16(uint16_t *p, vf v, int n) {
#ifdef __AVX512BF16__
    _mm256_mask_storeu_epi16(p, first(n), (__m256i)_mm512_cvtneps_pbh(v));
#else
    /* To nearest even, as nn_to_bf16. */
    __m512i u = _mm512_castps_si512(v), odd = _mm512_and_si512(_mm512_srli_epi32(u, 16), _mm512_set1_epi32(1));
    __m512i rounded = _mm512_srli_epi32(_mm512_add_epi32(u, _mm512_add_epi32(odd, _mm512_set1_epi32(0x7fff))), 16);
    __m512i nan = _mm512_or_si512(_mm512_srli_epi32(u, 16), _mm512_set1_epi32(0x40));
    rounded = _mm512_mask_mov_epi32(rounded, _mm512_cmp_ps_mask(v, v, _CMP_UNORD_Q), nan);
    _mm512_mask_cvtepi32_storeu_epi16(p, first(n), rounded);
#endif
}
