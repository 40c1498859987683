/* SPDX-License-Identifier: Apache-2.0 */
/* pairs_plain.h: pairs_avx512.h in plain C, for the emulated AMX kernel. */

static void interleave(uint16_t *out, const uint16_t *a, const uint16_t *b, int count) {
    for (int c = 0; c < (count + 15) / 16 * 16; c++) {
        out[2 * c] = c < count ? a[c] : 0;
        out[2 * c + 1] = c < count ? b[c] : 0;
    }
}

static void transpose(uint16_t *out, ptrdiff_t out_row, const uint16_t *in, ptrdiff_t in_row, int count) {
    for (int c = 0; c < count; c++) {
        for (int p = 0; p < 32; p++) {
            out[c * out_row + p] = in[p * in_row + c];
        }
    }
}
