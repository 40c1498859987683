/* SPDX-License-Identifier: Apache-2.0 */
/*
 * undevelop.c: picture to mosaic, the inverse of develop.c: curve, sRGB to camera
 * RGB, white balance, and the one channel that each CFA position keeps.
 *
 * Interpolated channels need no inverse: the two that a pixel did not record
 * only have to be the ones that went through the matrix together with the third.
 */

#include "image/image.h"
#include "raw/isp.h"

brace_status brace_undevelop(float *mosaic, const brace_image *image, const brace_frame *frame, brace_error *error) {
    if (mosaic == NULL || frame == NULL) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "brace_undevelop: mosaic and frame must not be NULL");
    }
    if (image == NULL) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "there is no picture to make a mosaic of");
    }
    brace_status status = image_check(image, error);
    if (status != BRACE_OK) {
        return status;
    }
    if (image->width != frame->width || image->height != frame->height) {
        return core_fail(error, BRACE_ERROR_MISMATCH, "the picture has %u x %u pixels, the RAW frame %u x %u",
                         image->width, image->height, frame->width, frame->height);
    }
    if ((int)frame->cfa < BRACE_CFA_RGGB || (int)frame->cfa > BRACE_CFA_BGGR) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "unknown colour filter order %d", (int)frame->cfa);
    }
    brace_color color;
    status = brace_color_init(&color, frame, error);
    if (status != BRACE_OK) {
        return status;
    }
    float from_red[3], from_blue[3], unbalance[3];
    for (int c = 0; c < 3; c++) {
        from_red[c] = (float)color.srgb_to_camera[3 * c];
        from_blue[c] = (float)color.srgb_to_camera[3 * c + 2];
        unbalance[c] = (float)(1.0 / color.wb[c]);
    }

    const size_t width = frame->width, channels = image->channels;
    float *line = core_alloc(width * channels, sizeof(float));
    if (line == NULL) {
        return core_fail_memory(error, width * channels * sizeof(float), "the inverse of developing");
    }
    for (size_t y = 0; y < frame->height; y++) {
        image_unpack_linear(line, image, (uint32_t)y);
        float *out = mosaic + y * width;
        const int kind = raw_row_color(frame->cfa, (int)(y & 1)), phase = raw_green_phase(frame->cfa, (int)(y & 1));
        for (size_t x = 0; x < width; x++) {
            const int c = ((int)(x & 1) ^ phase) == 0 ? 1 : kind;
            const float *p = line + x * channels;
            const float g = channels == 1 ? p[0] : p[1];
            const float dr = p[0] - g, db = channels == 1 ? 0.0f : p[2] - g;
            out[x] = (g + (from_red[c] * dr + from_blue[c] * db)) * unbalance[c];
        }
    }
    core_free(line);
    return BRACE_OK;
}
