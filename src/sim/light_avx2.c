/* SPDX-License-Identifier: Apache-2.0 */
/* light_avx2.c: the light kernels, 4 samples at a time. Compiled with AVX2 and FMA. */
#include <immintrin.h>

#include "sim/display.h"

enum { LANES = 4 };
typedef __m256d vd; /* lanes of double */
typedef __m128i vi; /* as many of int32 */
typedef __m256d vm; /* a choice for each lane */

static inline vd vd_set(double a) {
    return _mm256_set1_pd(a);
}
static inline vd vd_load(const double *p) {
    return _mm256_loadu_pd(p);
}
static inline vd vd_load_int(const int32_t *p) {
    return _mm256_cvtepi32_pd(_mm_loadu_si128((const __m128i *)(const void *)p));
}
static inline vd vd_load_float(const float *p) {
    return _mm256_cvtps_pd(_mm_loadu_ps(p));
}
static inline void vd_store_float(float *p, vd a) {
    _mm_storeu_ps(p, _mm256_cvtpd_ps(a));
}
static inline vd vd_floor(vd a) {
    return _mm256_floor_pd(a);
}
static inline vd vd_round(vd a) {
    return _mm256_round_pd(a, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC);
}
static inline vd vd_max(vd a, vd b) {
    return _mm256_max_pd(a, b);
}
static inline vd vd_min(vd a, vd b) {
    return _mm256_min_pd(a, b);
}
static inline vd vd_fma(vd a, vd b, vd c) { /* a*b + c */
    return _mm256_fmadd_pd(a, b, c);
}
static inline vd vd_fnma(vd a, vd b, vd c) { /* c - a*b */
    return _mm256_fnmadd_pd(a, b, c);
}
static inline vm vd_less(vd a, vd b) {
    return _mm256_cmp_pd(a, b, _CMP_LT_OQ);
}
static inline vd vd_if(vm m, vd yes, vd no) {
    return _mm256_blendv_pd(no, yes, m);
}
static inline vi vd_int(vd a) {
    return _mm256_cvttpd_epi32(a);
}
static inline vd vi_double(vi a) {
    return _mm256_cvtepi32_pd(a);
}
static inline vi vi_field(vi a, int shift, int mask) {
    return _mm_and_si128(_mm_srl_epi32(a, _mm_cvtsi32_si128(shift)), _mm_set1_epi32(mask));
}
static inline vd vd_gather(const double *base, vi index) {
    return _mm256_i32gather_pd(base, index, 8);
}
static inline vi vi_gather_short(const uint16_t *base, vi index) { /* the upper half is the next entry */
    return _mm_i32gather_epi32((const int *)(const void *)base, index, 2);
}
static inline vd vd_if_bit(vi a, int bit, vd yes) { /* else 0 */
    __m128i one = _mm_set1_epi32(1 << bit);
    __m256i all = _mm256_cvtepi32_epi64(_mm_cmpeq_epi32(_mm_and_si128(a, one), one));
    return _mm256_and_pd(_mm256_castsi256_pd(all), yes);
}
static inline vd vd_power_of_two(vd n) { /* 2^n for whole n from -1022 to 1023 */
    __m256i e = _mm256_cvtepi32_epi64(_mm256_cvtpd_epi32(n));
    return _mm256_castsi256_pd(_mm256_slli_epi64(_mm256_add_epi64(e, _mm256_set1_epi64x(1023)), 52));
}
static inline bool vi_same(vi a, vi b) {
    return _mm_movemask_epi8(_mm_cmpeq_epi32(a, b)) == 0xffff;
}
static inline bool vd_same(vd a, vd b) { /* NaN: never */
    return _mm256_movemask_pd(_mm256_cmp_pd(a, b, _CMP_EQ_OQ)) == 0xf;
}
static inline vi vi_last(vi a) { /* the last lane, in all lanes */
    return _mm_shuffle_epi32(a, 0xff);
}
static inline vd vd_last(vd a) {
    return _mm256_permute4x64_pd(a, 0xff);
}

#include "sim/light_vector.h"

sim_light_fn *sim_light_avx2(const sim_panel *panel) {
    return vector_kernel(panel);
}
