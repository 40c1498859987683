/* SPDX-License-Identifier: Apache-2.0 */
/*
 * color.c: the sRGB curve.
 *
 * The fast encoders guess the code from a table that is indexed by the leading
 * bits of the float (a piecewise linear curve, far closer than half a code) and
 * then compare with the exact boundary between that code and its neighbours. So
 * every result is the rounding of the exact curve, not of an approximation.
 */
#include "image/color.h"

#include <math.h>
#include <pthread.h>
#include <string.h>

double image_srgb_encode_exact(double x) {
    double a = fabs(x);
    double y = a <= 0.0031308 ? 12.92 * a : 1.055 * pow(a, 1.0 / 2.4) - 0.055;
    return x < 0 ? -y : y;
}

double image_srgb_decode_exact(double x) {
    double a = fabs(x);
    double y = a <= 0.04045 ? a / 12.92 : pow((a + 0.055) / 1.055, 2.4);
    return x < 0 ? -y : y;
}

float image_srgb_encode(float x) {
    float a = fabsf(x);
    float y = a <= 0.0031308f ? 12.92f * a : 1.055f * powf(a, 1.0f / 2.4f) - 0.055f;
    return x < 0 ? -y : y;
}

float image_srgb_decode(float x) {
    float a = fabsf(x);
    float y = a <= 0.04045f ? a / 12.92f : powf((a + 0.055f) / 1.055f, 2.4f);
    return x < 0 ? -y : y;
}

/* The guess table covers [2^-9, 1], nine octaves of 256 pieces; below 2^-9 the
 * curve is its straight part. Its error is below 0.04 of a 16-bit code. */
#define LOW_BITS 0x3b000000u /* 2^-9 as a float */
#define ONE_BITS 0x3f800000u
#define PIECE_SHIFT 15
#define PIECES ((ONE_BITS - LOW_BITS) >> PIECE_SHIFT)

static struct {
    float decode8[256], decode16[65536];
    /* boundary[k]: the smallest float that rounds to code k; [0] lets all pass, the last none */
    float boundary8[257], boundary16[65537];
    struct {
        float start, slope; /* encoded value, and its rise over the piece as 2^PIECE_SHIFT steps of the float */
    } guess[PIECES + 1];
} table;

static pthread_once_t once = PTHREAD_ONCE_INIT;

static float boundary(int code, double scale) {
    double exact = image_srgb_decode_exact((code - 0.5) / scale);
    float f = (float)exact;
    return (double)f < exact ? nextafterf(f, 2.0f) : f;
}

static float from_bits(uint32_t bits) {
    float f;
    memcpy(&f, &bits, sizeof f);
    return f;
}

static void build(void) {
    for (int i = 0; i < 256; i++) {
        table.decode8[i] = (float)image_srgb_decode_exact(i / 255.0);
        table.boundary8[i] = i == 0 ? -1.0f : boundary(i, 255.0);
    }
    table.boundary8[256] = 2.0f;
    for (int i = 0; i < 65536; i++) {
        table.decode16[i] = (float)image_srgb_decode_exact(i / 65535.0);
        table.boundary16[i] = i == 0 ? -1.0f : boundary(i, 65535.0);
    }
    table.boundary16[65536] = 2.0f;
    for (uint32_t i = 0; i <= PIECES; i++) {
        double low = image_srgb_encode_exact((double)from_bits(LOW_BITS + (i << PIECE_SHIFT)));
        double high = image_srgb_encode_exact((double)from_bits(LOW_BITS + ((i + 1) << PIECE_SHIFT)));
        table.guess[i].start = (float)low;
        table.guess[i].slope = (float)((high - low) / (double)(1u << PIECE_SHIFT));
    }
}

const float *image_srgb_decode_u8(void) {
    pthread_once(&once, build);
    return table.decode8;
}

const float *image_srgb_decode_u16(void) {
    pthread_once(&once, build);
    return table.decode16;
}

static inline float clip(float x) {
    return x > 0.0f ? (x < 1.0f ? x : 1.0f) : 0.0f; /* a NaN fails the first test */
}

static inline float guess(float x) {
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    if (bits < LOW_BITS) {
        return 12.92f * x;
    }
    uint32_t offset = bits - LOW_BITS;
    uint32_t i = offset >> PIECE_SHIFT;
    return table.guess[i].start + table.guess[i].slope * (float)(offset & ((1u << PIECE_SHIFT) - 1));
}

void image_srgb_encode_row_u8(uint8_t *out, const float *in, size_t count) {
    pthread_once(&once, build);
    for (size_t i = 0; i < count; i++) {
        float x = clip(in[i]);
        int k = (int)(guess(x) * 255.0f + 0.5f);
        k -= x < table.boundary8[k];
        k += x >= table.boundary8[k + 1];
        out[i] = (uint8_t)k;
    }
}

void image_srgb_encode_row_u16(uint16_t *out, const float *in, size_t count) {
    pthread_once(&once, build);
    for (size_t i = 0; i < count; i++) {
        float x = clip(in[i]);
        int k = (int)(guess(x) * 65535.0f + 0.5f);
        k -= x < table.boundary16[k];
        k += x >= table.boundary16[k + 1];
        out[i] = (uint16_t)k;
    }
}

void image_quantize_row_u8(uint8_t *out, const float *in, size_t count) {
    for (size_t i = 0; i < count; i++) {
        out[i] = (uint8_t)(clip(in[i]) * 255.0f + 0.5f);
    }
}

void image_quantize_row_u16(uint16_t *out, const float *in, size_t count) {
    for (size_t i = 0; i < count; i++) {
        out[i] = (uint16_t)(clip(in[i]) * 65535.0f + 0.5f);
    }
}
