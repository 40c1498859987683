/* SPDX-License-Identifier: Apache-2.0 */
/* light_avx512.c: the light kernels, 8 samples at a time. Compiled with AVX-512 F, BW, DQ and VL. */
#include <immintrin.h>

#include "sim/display.h"

enum { LANES = 8 };
typedef __m512d vd;  /* lanes of double */
typedef __m256i vi;  /* as many of int32 */
typedef __mmask8 vm; /* a choice for each lane */

static inline vd vd_set(double a) {
    return _mm512_set1_pd(a);
}
static inline vd vd_load(const double *p) {
    return _mm512_loadu_pd(p);
}
static inline vd vd_load_int(const int32_t *p) {
    return _mm512_cvtepi32_pd(_mm256_loadu_si256((const __m256i *)(const void *)p));
}
static inline vd vd_load_float(const float *p) {
    return _mm512_cvtps_pd(_mm256_loadu_ps(p));
}
static inline void vd_store_float(float *p, vd a) {
    _mm256_storeu_ps(p, _mm512_cvtpd_ps(a));
}
static inline vd vd_floor(vd a) {
    return _mm512_roundscale_pd(a, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC);
}
static inline vd vd_round(vd a) {
    return _mm512_roundscale_pd(a, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC);
}
static inline vd vd_max(vd a, vd b) {
    return _mm512_max_pd(a, b);
}
static inline vd vd_min(vd a, vd b) {
    return _mm512_min_pd(a, b);
}
static inline vd vd_fma(vd a, vd b, vd c) { /* a*b + c */
    return _mm512_fmadd_pd(a, b, c);
}
static inline vd vd_fnma(vd a, vd b, vd c) { /* c - a*b */
    return _mm512_fnmadd_pd(a, b, c);
}
static inline vm vd_less(vd a, vd b) {
    return _mm512_cmp_pd_mask(a, b, _CMP_LT_OQ);
}
static inline vd vd_if(vm m, vd yes, vd no) {
    return _mm512_mask_blend_pd(m, no, yes);
}
static inline vi vd_int(vd a) {
    return _mm512_cvttpd_epi32(a);
}
static inline vd vi_double(vi a) {
    return _mm512_cvtepi32_pd(a);
}
static inline vi vi_field(vi a, int shift, int mask) {
    return _mm256_and_si256(_mm256_srl_epi32(a, _mm_cvtsi32_si128(shift)), _mm256_set1_epi32(mask));
}
static inline vd vd_gather(const double *base, vi index) {
    return _mm512_i32gather_pd(index, base, 8);
}
static inline vi vi_gather_short(const uint16_t *base, vi index) { /* the upper half is the next entry */
    return _mm256_i32gather_epi32((const int *)(const void *)base, index, 2);
}
static inline vd vd_if_bit(vi a, int bit, vd yes) { /* else 0 */
    return _mm512_maskz_mov_pd(_mm256_test_epi32_mask(a, _mm256_set1_epi32(1 << bit)), yes);
}
static inline vd vd_power_of_two(vd n) { /* 2^n for whole n from -1022 to 1023 */
    __m512i e = _mm512_cvtepi32_epi64(_mm512_cvtpd_epi32(n));
    return _mm512_castsi512_pd(_mm512_slli_epi64(_mm512_add_epi64(e, _mm512_set1_epi64(1023)), 52));
}
static inline bool vi_same(vi a, vi b) {
    return _mm256_cmpeq_epi32_mask(a, b) == 0xff;
}
static inline bool vd_same(vd a, vd b) { /* NaN: never */
    return _mm512_cmp_pd_mask(a, b, _CMP_EQ_OQ) == 0xff;
}
static inline vi vi_last(vi a) { /* the last lane, in all lanes */
    return _mm256_permutevar8x32_epi32(a, _mm256_set1_epi32(7));
}
static inline vd vd_last(vd a) {
    return _mm512_permutexvar_pd(_mm512_set1_epi64(7), a);
}

#include "sim/light_vector.h"

sim_light_fn *sim_light_avx512(const sim_panel *panel) {
    return vector_kernel(panel);
}
