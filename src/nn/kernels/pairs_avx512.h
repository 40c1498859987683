/* SPDX-License-Identifier: Apache-2.0 */
/* pairs_avx512.h: bf16 rearranged for products over pixels, with AVX-512: interleaved in pairs, and transposed. */

static void interleave(uint16_t *out, const uint16_t *a, const uint16_t *b, int count) {
    /* 16 channels of both give 16 pairs: word i of the lower half is a[i / 2] or b[i / 2]. */
    for (int c = 0; c < count; c += 16) {
        __mmask16 m = first(count - c < 16 ? count - c : 16);
        __m512i low = _mm512_cvtepu16_epi32(_mm256_maskz_loadu_epi16(m, a + c));
        __m512i high = _mm512_cvtepu16_epi32(_mm256_maskz_loadu_epi16(m, b + c));
        _mm512_storeu_si512(out + 2 * c, _mm512_or_si512(low, _mm512_slli_epi32(high, 16)));
    }
}

/* 16 x 16 words of 32 bits: four rounds that exchange halves, quarters, pairs and single words of ever closer rows. */
ALWAYS_INLINE void transpose_words(__m512i r[16]) {
    __m512i t[16];
#pragma GCC unroll 16
    for (int i = 0; i < 8; i++) {
        t[2 * i] = _mm512_unpacklo_epi32(r[2 * i], r[2 * i + 1]);
        t[2 * i + 1] = _mm512_unpackhi_epi32(r[2 * i], r[2 * i + 1]);
    }
#pragma GCC unroll 16
    for (int i = 0; i < 4; i++) {
        r[4 * i] = _mm512_unpacklo_epi64(t[4 * i], t[4 * i + 2]);
        r[4 * i + 1] = _mm512_unpackhi_epi64(t[4 * i], t[4 * i + 2]);
        r[4 * i + 2] = _mm512_unpacklo_epi64(t[4 * i + 1], t[4 * i + 3]);
        r[4 * i + 3] = _mm512_unpackhi_epi64(t[4 * i + 1], t[4 * i + 3]);
    }
    /* Now lane group q of r[4 i + j] holds column 4 q + j of rows 4 i .. 4 i + 3. */
#pragma GCC unroll 16
    for (int j = 0; j < 4; j++) {
        t[j] = _mm512_shuffle_i32x4(r[j], r[4 + j], 0x88);
        t[4 + j] = _mm512_shuffle_i32x4(r[8 + j], r[12 + j], 0x88);
        t[8 + j] = _mm512_shuffle_i32x4(r[j], r[4 + j], 0xdd);
        t[12 + j] = _mm512_shuffle_i32x4(r[8 + j], r[12 + j], 0xdd);
    }
#pragma GCC unroll 16
    for (int j = 0; j < 4; j++) {
        r[j] = _mm512_shuffle_i32x4(t[j], t[4 + j], 0x88);
        r[8 + j] = _mm512_shuffle_i32x4(t[j], t[4 + j], 0xdd);
        r[4 + j] = _mm512_shuffle_i32x4(t[8 + j], t[12 + j], 0x88);
        r[12 + j] = _mm512_shuffle_i32x4(t[8 + j], t[12 + j], 0xdd);
    }
}

static void transpose(uint16_t *out, ptrdiff_t out_row, const uint16_t *in, ptrdiff_t in_row, int count) {
    for (int c = 0; c < count; c += 16) {
        int n = count - c < 16 ? count - c : 16;
        __m512i r[16];
#pragma GCC unroll 16
        for (int i = 0; i < 16; i++) { /* pixels 2 i and 2 i + 1 as one word of each channel */
            const uint16_t *p = in + 2 * i * in_row + c;
            __m512i low = _mm512_cvtepu16_epi32(_mm256_maskz_loadu_epi16(first(n), p));
            __m512i high = _mm512_cvtepu16_epi32(_mm256_maskz_loadu_epi16(first(n), p + in_row));
            r[i] = _mm512_or_si512(low, _mm512_slli_epi32(high, 16));
        }
        transpose_words(r);
        for (int i = 0; i < n; i++) {
            _mm512_storeu_si512(out + (c + i) * out_row, r[i]);
        }
    }
}
