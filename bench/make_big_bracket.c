/* SPDX-License-Identifier: Apache-2.0 */
/*
 * make_big_bracket.c: tiles the frames of a bracket to the size of a camera's
 * (12 megapixels by default), mirrored at the seams so that the picture has no
 * edges that a photograph would not have.
 *
 *   make_big_bracket OUT_FOLDER FRAME... [WIDTHxHEIGHT]
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "brace/brace.h"

/* Where a coordinate of the large frame lies in the small one: back and forth.
 * Mirroring about a sample, and not between two, keeps the CFA's phase. */
static uint32_t mirrored(uint32_t i, uint32_t n) {
    uint32_t period = 2 * (n - 1);
    i %= period;
    return i < n ? i : period - i;
}

static int enlarge(const char *folder, const char *path, uint32_t width, uint32_t height) {
    brace_frame *f = NULL, *big = NULL;
    brace_error error = {0};
    brace_status status = brace_frame_read(&f, path, NULL, &error);
    if (status == BRACE_OK) {
        status = brace_frame_create(&big, width, height, f->cfa, &error);
    }
    if (status == BRACE_OK) {
        for (uint32_t y = 0; y < height; y++) {
            const uint16_t *from = f->data + (size_t)mirrored(y, f->height) * f->width;
            uint16_t *to = big->data + (size_t)y * width;
            for (uint32_t x = 0; x < width; x++) {
                to[x] = from[mirrored(x, f->width)];
            }
        }
        /* The small frame's metadata with the large one's pixels. */
        uint16_t *data = f->data;
        uint32_t w = f->width, h = f->height;
        f->data = big->data;
        f->width = width;
        f->height = height;
        const char *name = strrchr(path, '/');
        char out[4096];
        snprintf(out, sizeof out, "%s/%s", folder, name != NULL ? name + 1 : path);
        status = brace_frame_write_dng(f, out, NULL, NULL, &error);
        f->data = data;
        f->width = w;
        f->height = h;
    }
    if (status != BRACE_OK) {
        fprintf(stderr, "make_big_bracket: %s\n", error.message);
    }
    brace_frame_destroy(big);
    brace_frame_destroy(f);
    return status == BRACE_OK ? 0 : 1;
}

int main(int argc, char **argv) {
    uint32_t width = 4032, height = 3024;
    if (argc > 2 && sscanf(argv[argc - 1], "%ux%u", &width, &height) == 2) {
        argc--;
    }
    if (argc < 3) {
        fprintf(stderr, "usage: make_big_bracket OUT_FOLDER FRAME... [WIDTHxHEIGHT]\n");
        return 2;
    }
    for (int i = 2; i < argc; i++) {
        if (enlarge(argv[1], argv[i], width, height) != 0) {
            return 1;
        }
    }
    return 0;
}
