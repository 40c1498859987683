/* SPDX-License-Identifier: Apache-2.0 */
/*
 * color.h: the sRGB curve (IEC 61966-2-1), exactly and fast. Internal.
 *
 * Thread safety: every function is pure; tables are built once, by whoever comes first.
 */
#ifndef IMAGE_COLOR_H
#define IMAGE_COLOR_H

#include <stddef.h>
#include <stdint.h>

/* Linear light to sRGB-encoded and back; [0, 1] to [0, 1]. Values below 0 are
 * mirrored, values above 1 follow the same power law. */
float image_srgb_encode(float linear);
float image_srgb_decode(float encoded);
double image_srgb_encode_exact(double linear);
double image_srgb_decode_exact(double encoded);

/* Linear light of the sRGB codes 0..255 and 0..65535. */
const float *image_srgb_decode_u8(void);
const float *image_srgb_decode_u16(void);

/* A row of linear floats to sRGB codes: clipped to [0, 1] (NaN to 0) and rounded
 * to the nearest code of the exact curve, ties up. */
void image_srgb_encode_row_u8(uint8_t *out, const float *in, size_t count);
void image_srgb_encode_row_u16(uint16_t *out, const float *in, size_t count);

/* Rows of floats to integers without a curve: clipped, rounded to nearest. */
void image_quantize_row_u8(uint8_t *out, const float *in, size_t count);
void image_quantize_row_u16(uint16_t *out, const float *in, size_t count);

#endif
