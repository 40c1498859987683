/* SPDX-License-Identifier: Apache-2.0 */
/*
 * side_by_side.c: two pictures of one size beside each other, a thin white line
 * between them.
 *
 *   side_by_side LEFT RIGHT OUT [X,Y,WIDTH,HEIGHT]
 */
#include <stdio.h>
#include <string.h>

#include "brace/brace.h"

enum { GAP = 8 };

static int fail(const char *message) {
    fprintf(stderr, "side_by_side: %s\n", message);
    return 1;
}

int main(int argc, char **argv) {
    if (argc != 4 && argc != 5) {
        return fail("usage: side_by_side LEFT RIGHT OUT [X,Y,WIDTH,HEIGHT]");
    }
    brace_image *side[2] = {NULL, NULL}, *out = NULL;
    brace_error error = {0};
    for (int i = 0; i < 2; i++) {
        brace_image *read = NULL;
        if (brace_image_read(&read, argv[1 + i], NULL, &error) != BRACE_OK ||
            brace_image_convert(&side[i], read, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, &error) != BRACE_OK) {
            return fail(error.message);
        }
        brace_image_destroy(read);
    }
    uint32_t x = 0, y = 0, w = side[0]->width, h = side[0]->height;
    if (argc == 5 && sscanf(argv[4], "%u,%u,%u,%u", &x, &y, &w, &h) != 4) {
        return fail("the crop is X,Y,WIDTH,HEIGHT");
    }
    for (int i = 0; i < 2; i++) {
        if (w > side[i]->width || x > side[i]->width - w || h > side[i]->height || y > side[i]->height - h) {
            return fail("the pictures differ in size, or the crop lies outside");
        }
    }
    if (brace_image_create(&out, 2 * w + GAP, h, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, &error) != BRACE_OK) {
        return fail(error.message);
    }
    for (uint32_t r = 0; r < h; r++) {
        uint8_t *to = (uint8_t *)out->data + r * out->stride;
        memset(to, 255, 3 * (2 * (size_t)w + GAP));
        for (uint32_t i = 0; i < 2; i++) {
            const uint8_t *from = (const uint8_t *)side[i]->data + (y + r) * side[i]->stride + 3 * (size_t)x;
            memcpy(to + 3 * (size_t)i * (w + GAP), from, 3 * (size_t)w);
        }
    }
    brace_status status = brace_image_write(out, argv[3], NULL, NULL, &error);
    brace_image_destroy(out);
    brace_image_destroy(side[0]);
    brace_image_destroy(side[1]);
    return status == BRACE_OK ? 0 : fail(error.message);
}
