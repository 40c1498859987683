/* SPDX-License-Identifier: Apache-2.0 */
/*
 * image.h: pictures in memory, and PNG, TIFF, JPEG and WebP files.
 *
 * A brace_image is an interleaved, row-major raster: sample (x, y, c) lies at
 * data + y*stride + (x*channels + c)*sample size. Integer samples are full
 * range. Colour is sRGB primaries (IEC 61966-2-1, D65); `transfer` says whether
 * samples carry the sRGB curve or are proportional to light.
 *
 * Ownership: *_create and *_read give the caller an image to be freed with
 * brace_image_destroy. Thread safety: different images may be used from
 * different threads; one image may be read from several.
 */
#ifndef BRACE_IMAGE_H
#define BRACE_IMAGE_H

#include <stddef.h>
#include <stdint.h>

#include "job.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum brace_sample {
    BRACE_SAMPLE_U8 = 0,
    BRACE_SAMPLE_U16 = 1,
    BRACE_SAMPLE_F32 = 2 /* 0 black, 1 white; other values allowed, NaN not */
} brace_sample;

typedef enum brace_transfer {
    BRACE_TRANSFER_SRGB = 0,  /* encoded with the sRGB curve */
    BRACE_TRANSFER_LINEAR = 1 /* proportional to light */
} brace_transfer;

/* No side longer than this, no picture with more pixels than that: what a
 * hostile file may make BRACE allocate is bounded by these. */
#define BRACE_MAX_SIDE 65535u
#define BRACE_MAX_PIXELS (400u * 1000u * 1000u)

typedef struct brace_image {
    uint32_t width, height; /* pixels, 1 to BRACE_MAX_SIDE */
    uint32_t channels;      /* 1 grey, 3 RGB, 4 RGB and straight alpha */
    brace_sample sample;
    brace_transfer transfer;
    size_t stride; /* bytes from one row to the next */
    void *data;
} brace_image;

typedef enum brace_picture_format {
    BRACE_PICTURE_AUTO = 0, /* by the file name's extension */
    BRACE_PICTURE_PNG = 1,  /* 8 or 16 bits */
    BRACE_PICTURE_TIFF = 2, /* 8 or 16 bits or float, deflate */
    BRACE_PICTURE_JPEG = 3, /* 8 bits */
    BRACE_PICTURE_WEBP = 4  /* 8 bits */
} brace_picture_format;

/* All zeros mean the defaults. */
typedef struct brace_image_write_params {
    brace_picture_format format;
    int bits;         /* 8, 16, or 32 (float, TIFF only); 0: the image's own, or the nearest the format has */
    int quality;      /* JPEG and WebP, 1 to 100; 0: 92. WebP 100 is lossless */
    int compression;  /* PNG and TIFF, 1 fast to 9 small; 0: 4, which suits photographs */
    uint32_t reserved[8];
} brace_image_write_params;

/* Makes an image of zeros. BRACE_ERROR_ARGUMENT for sizes outside the limits. */
BRACE_API brace_status brace_image_create(brace_image **out, uint32_t width, uint32_t height, uint32_t channels,
                                          brace_sample sample, brace_transfer transfer, brace_error *error);

/* Frees an image; NULL is allowed. */
BRACE_API void brace_image_destroy(brace_image *image);

/* A copy with another sample type, transfer or number of channels. Going to
 * fewer bits rounds to nearest and clips to [0, 1]; grey becomes RGB by
 * repetition, RGB becomes grey by Rec. 709 luminance in linear light; alpha is
 * dropped or set opaque. */
BRACE_API brace_status brace_image_convert(brace_image **out, const brace_image *image, uint32_t channels,
                                           brace_sample sample, brace_transfer transfer, brace_error *error);

/* A copy of another size, area-averaged when shrinking and Mitchell-Netravali
 * filtered when growing, computed in linear light. */
BRACE_API brace_status brace_image_resize(brace_image **out, const brace_image *image, uint32_t width, uint32_t height,
                                          brace_error *error);

/* Reads PNG, TIFF, JPEG or WebP, told apart by content and not by name.
 * Integer pictures come back as sRGB-encoded U8 or U16, float TIFF as linear
 * F32. Palettes and low bit depths are expanded, CMYK and YCbCr converted,
 * grey with alpha becomes RGB with alpha, and what EXIF or TIFF say about the
 * orientation is carried out: the picture is upright.
 * Embedded profiles other than sRGB are not applied; a note says so. */
BRACE_API brace_status brace_image_read(brace_image **out, const char *path, const brace_job *job, brace_error *error);

/* Writes a picture tagged as sRGB: into a temporary file beside `path`, synced,
 * then renamed, so that `path` is complete or untouched. `params` may be NULL.
 * A linear image is encoded with the sRGB curve, except into 32-bit TIFF, which
 * stays linear. */
BRACE_API brace_status brace_image_write(const brace_image *image, const char *path,
                                         const brace_image_write_params *params, const brace_job *job,
                                         brace_error *error);

#ifdef __cplusplus
}
#endif
#endif
