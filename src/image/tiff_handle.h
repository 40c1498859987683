/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tiff_handle.h: a libtiff handle whose messages end in one place and not on the
 * user's terminal, and whose input or output is memory or a stream. Internal to
 * the image module.
 */
#ifndef IMAGE_TIFF_HANDLE_H
#define IMAGE_TIFF_HANDLE_H

#include <stddef.h>
#include <stdio.h>

#include <tiffio.h>

#include "brace/status.h"

typedef struct image_tiff {
    TIFF *tiff; /* closed by the user with TIFFClose */
    const char *name;
    const unsigned char *data; /* reading */
    size_t size, at;
    FILE *stream;      /* writing; borrowed */
    char message[256]; /* the first error */
} image_tiff;

/* Opens handle->data for reading; `handle` must outlive the TIFF. */
brace_status image_tiff_open_memory(image_tiff *handle, brace_error *error);

/* Opens handle->stream for writing; `big` for BigTIFF, above 4 GB. */
brace_status image_tiff_open_stream(image_tiff *handle, int big, brace_error *error);

#endif
