/* SPDX-License-Identifier: Apache-2.0 */
/*
 * orient.c: turning and mirroring as the EXIF tag Orientation says (EXIF 2.3,
 * 4.6.4): the value names where row 0 and column 0 of the stored picture lie.
 */
#include <string.h>

#include "brace/develop.h"
#include "image/image.h"

#define TILE 32u /* pixels; keeps both sides of a transposition in the first cache */

static void copy_pixels(unsigned char *out, const unsigned char *in, uint32_t count, ptrdiff_t step, size_t pixel) {
    switch (pixel) { /* constant sizes turn memcpy into single moves */
#define CASE(n)                                                                                                        \
    case n:                                                                                                            \
        for (uint32_t i = 0; i < count; i++, out += n, in += step) {                                                   \
            memcpy(out, in, n);                                                                                        \
        }                                                                                                              \
        break;
        CASE(1)
        CASE(2)
        CASE(3)
        CASE(4)
        CASE(6)
        CASE(8)
        CASE(12)
        CASE(16)
#undef CASE
    default:
        break;
    }
}

brace_status brace_image_orient(brace_image **out, const brace_image *image, int orientation, brace_error *error) {
    *out = NULL;
    brace_status status = image_check(image, error);
    if (status != BRACE_OK) {
        return status;
    }
    if (orientation < 1 || orientation > 8) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "orientation is %d; EXIF has 1 to 8", orientation);
    }
    bool transposed = orientation >= 5;
    uint32_t width = transposed ? image->height : image->width;
    uint32_t height = transposed ? image->width : image->height;
    status = image_create_raw(out, width, height, image->channels, image->sample, image->transfer, error);
    if (status != BRACE_OK) {
        return status;
    }
    /* Pixel (x, y) of the result lies at origin + x*right + y*down of the stored picture. */
    size_t pixel = image->channels * image_sample_size(image->sample);
    ptrdiff_t column = (ptrdiff_t)pixel, row = (ptrdiff_t)image->stride;
    ptrdiff_t last_column = (ptrdiff_t)(image->width - 1) * column, last_row = (ptrdiff_t)(image->height - 1) * row;
    bool from_right = orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
    bool from_bottom = orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
    const unsigned char *origin =
        (const unsigned char *)image->data + (from_right ? last_column : 0) + (from_bottom ? last_row : 0);
    ptrdiff_t along_x = from_right ? -column : column, along_y = from_bottom ? -row : row;
    ptrdiff_t right = transposed ? along_y : along_x, down = transposed ? along_x : along_y;

    uint32_t tile = transposed ? TILE : width;
    for (uint32_t y0 = 0; y0 < height; y0 += TILE) {
        uint32_t y1 = height - y0 > TILE ? y0 + TILE : height;
        for (uint32_t x0 = 0; x0 < width; x0 += tile) {
            uint32_t n = width - x0 > tile ? tile : width - x0;
            for (uint32_t y = y0; y < y1; y++) {
                copy_pixels(image_row(*out, y) + x0 * pixel, origin + (ptrdiff_t)x0 * right + (ptrdiff_t)y * down, n,
                            right, pixel);
            }
        }
    }
    return BRACE_OK;
}

brace_status image_turn(brace_image **image, int orientation, brace_error *error) {
    if (orientation < 2 || orientation > 8) {
        return BRACE_OK;
    }
    brace_image *turned = NULL;
    brace_status status = brace_image_orient(&turned, *image, orientation, error);
    brace_image_destroy(*image);
    *image = turned;
    return status;
}
