/* SPDX-License-Identifier: Apache-2.0 */
/*
 * image.h: what the picture formats share. Internal; the public half is
 * brace/image.h.
 */
#ifndef IMAGE_IMAGE_H
#define IMAGE_IMAGE_H

#include <stddef.h>
#include <stdint.h>

#include "brace/image.h"
#include "core/core.h"

/* ---- rasters (image.c) ---- */

/* As brace_image_create, without clearing: for readers that fill every row or fail. */
brace_status image_create_raw(brace_image **out, uint32_t width, uint32_t height, uint32_t channels,
                              brace_sample sample, brace_transfer transfer, brace_error *error);

/* BRACE_OK if `image` can be worked on: its fields are in range and its rows do not overlap. */
brace_status image_check(const brace_image *image, brace_error *error);

/* Size limits, before anything is allocated; `name` begins the sentence. `max_pixels` at most BRACE_MAX_PIXELS. */
brace_status image_check_size(const char *name, uint64_t width, uint64_t height, uint64_t max_pixels,
                              brace_error *error);

size_t image_sample_size(brace_sample sample);

static inline unsigned char *image_row(const brace_image *image, uint32_t y) {
    return (unsigned char *)image->data + (size_t)y * image->stride;
}

/* What a row is turned into: another number of channels, sample type or transfer. */
typedef struct image_layout {
    uint32_t channels;
    brace_sample sample;
    brace_transfer transfer;
} image_layout;

/* Bytes of a row of `width` pixels. */
size_t image_row_bytes(image_layout layout, uint32_t width);

/* Row `y` of `image` in another layout into `out`, as brace_image_convert does it.
 * `scratch` has 4*width floats. */
void image_convert_row(void *out, image_layout layout, const brace_image *image, uint32_t y, float *scratch);

/* Row `y` as floats in linear light, with the image's channels. */
void image_unpack_linear(float *out, const brace_image *image, uint32_t y);

/* ---- sRGB profile (icc.c) ---- */

/* A complete ICC profile (version 4, display, matrix and parametric curve) of sRGB. */
#define IMAGE_ICC_SIZE 500u
void image_icc_srgb(unsigned char out[IMAGE_ICC_SIZE]);

/* Whether a profile says that it is sRGB. */
bool image_icc_is_srgb(const unsigned char *profile, size_t size);

/* EXIF orientation 1..8 from a TIFF-structured EXIF block; 1 when it does not say. */
int image_exif_orientation(const unsigned char *exif, size_t size);

/* ---- compressing in strips (strips.c) ---- */

/* Turns rows [y, y + rows) into the bytes to be deflated at `out`; `scratch` as in image_convert_row. */
typedef struct image_strips image_strips;
typedef void image_prepare_fn(const image_strips *strips, unsigned char *out, uint32_t y, uint32_t rows,
                              unsigned char *row_scratch, float *scratch);
/* Takes the compressed strips in order. */
typedef brace_status image_emit_fn(void *arg, uint32_t index, unsigned char *data, size_t size, brace_error *error);

struct image_strips {
    const brace_image *image;
    image_layout layout;
    uint32_t rows;        /* in a strip; the last may have fewer */
    size_t bytes_per_row; /* that `prepare` makes */
    bool one_stream;      /* true: the strips make up one zlib stream (PNG); false: each is one (TIFF) */
    int level;            /* of zlib */
    int strategy;
    const char *name; /* file, for messages */
    image_prepare_fn *prepare;
    image_emit_fn *emit;
    void *arg; /* handed to emit */
};

/* zlib's strategy that suits samples after prediction. */
int image_strips_strategy(brace_sample sample, int compression);

/* Prepares and deflates strips on the job's threads and emits them in order.
 * The bytes do not depend on the number of threads. */
brace_status image_strips_run(const image_strips *strips, const brace_job *job, brace_error *error);

/* ---- formats ---- */

typedef struct image_source {
    const unsigned char *data;
    size_t size;
    const char *name; /* begins every error sentence */
    uint64_t max_pixels;
    const brace_job *job;
} image_source;

typedef struct image_sink {
    core_file *file;
    const char *name;
    int bits, quality, compression; /* resolved: no zeros */
    const brace_job *job;
} image_sink;

brace_status image_read_png(brace_image **out, const image_source *source, brace_error *error);
brace_status image_read_tiff(brace_image **out, const image_source *source, brace_error *error);
brace_status image_read_jpeg(brace_image **out, const image_source *source, brace_error *error);
brace_status image_read_webp(brace_image **out, const image_source *source, brace_error *error);
brace_status image_write_png(const brace_image *image, const image_sink *sink, brace_error *error);
brace_status image_write_tiff(const brace_image *image, const image_sink *sink, brace_error *error);
brace_status image_write_jpeg(const brace_image *image, const image_sink *sink, brace_error *error);
brace_status image_write_webp(const brace_image *image, const image_sink *sink, brace_error *error);

/* A picture of any of the formats, from memory (picture.c). */
brace_status image_read_memory(brace_image **out, const image_source *source, brace_error *error);

/* Replaces *image by its upright copy, where the orientation asks for it (orient.c). */
brace_status image_turn(brace_image **image, int orientation, brace_error *error);

#endif
