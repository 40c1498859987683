/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_picture.c: any bytes as a PNG, TIFF, JPEG or WebP picture: an error or a
 * picture that converts, never a crash, a leak or an endless run.
 */
#include "image/image.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    image_source source = {data, size, "input", 1u << 20, NULL};
    brace_image *image = NULL, *small = NULL;
    brace_error error;
    if (image_read_memory(&image, &source, &error) == BRACE_OK) {
        if (image->width <= 2048 && image->height <= 2048 &&
            brace_image_resize(&small, image, (image->width + 1) / 2, (image->height + 1) / 2, &error) == BRACE_OK) {
            brace_image_destroy(small);
        }
        brace_image_destroy(image);
    }
    return 0;
}
