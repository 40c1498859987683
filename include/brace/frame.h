/* SPDX-License-Identifier: Apache-2.0 */
/*
 * frame.h: one RAW photograph: its Bayer mosaic and what is known about it.
 *
 * A brace_frame holds the active area of the sensor, unprocessed, and the
 * metadata that turns numbers into light and colour (DNG specification 1.6,
 * chapters 4 to 6). It also carries, opaquely, every other tag of the file it
 * came from (Artist, Copyright, lens, MakerNote, ...), so that a frame written
 * as DNG keeps them.
 *
 * Ownership: frames are made by brace_frame_create, _read and _clone and freed
 * by brace_frame_destroy. Thread safety: different frames may be used from
 * different threads; one frame may be read from several.
 */
#ifndef BRACE_FRAME_H
#define BRACE_FRAME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "image.h"
#include "job.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The colours of the top left 2x2 block of the active area, row by row. */
typedef enum brace_cfa {
    BRACE_CFA_RGGB = 0,
    BRACE_CFA_GRBG = 1,
    BRACE_CFA_GBRG = 2,
    BRACE_CFA_BGGR = 3
} brace_cfa;

typedef struct brace_tags brace_tags; /* opaque: the file's other metadata */

typedef struct brace_frame {
    uint32_t width, height; /* of the active area, pixels, at least 4 each */
    uint16_t *data;         /* width*height samples, row-major, as recorded */
    brace_cfa cfa;
    float black[4]; /* black level at (y&1)*2 + (x&1), in raw units */
    float white;    /* raw value at which the sensor clips; above every black */

    double exposure_time; /* seconds; 0 if the file does not say */
    double iso;           /* 0 if the file does not say */
    double f_number;      /* 0 if the file does not say (a manual lens) */
    double focal_length;  /* millimetres; 0 if the file does not say */
    double baseline_exposure; /* EV, DNG BaselineExposure; 0 by default */

    /* Camera response to a neutral patch under the shot's light, green 1 (DNG
     * AsShotNeutral); R, G, B. All 1 if unknown. */
    double as_shot_neutral[3];

    /* XYZ to camera RGB, rows R G B (DNG ColorMatrix1 and 2), and the EXIF
     * LightSource code of the illuminant of each (17 = A, 21 = D65); 0: none. */
    double color_matrix[2][9];
    uint16_t illuminant[2];

    /* Noise of R, G, B: variance = noise[c][0]*x + noise[c][1] for a signal x
     * on [0, 1] (DNG NoiseProfile). */
    double noise[3][2];
    bool has_noise; /* false: the two numbers were estimated from the ISO */

    int orientation; /* EXIF: 1 as stored, 2 mirrored, ... 6 turn 90 degrees clockwise, ... 8 */

    char make[64], model[64];
    char unique_model[128]; /* DNG UniqueCameraModel */
    char datetime[32];      /* "YYYY:MM:DD HH:MM:SS", EXIF DateTimeOriginal; "" if unknown */
    char subsec[16];        /* digits after the second; "" if unknown */

    char *path;       /* where it was read from; "" if made in memory. Owned. */
    brace_tags *tags; /* owned; may be NULL */
} brace_frame;

/* A frame of zeros with black 0, white 65535, neutral 1 and no colour matrix. */
BRACE_API brace_status brace_frame_create(brace_frame **out, uint32_t width, uint32_t height, brace_cfa cfa,
                                          brace_error *error);

/* A deep copy, tags included. */
BRACE_API brace_status brace_frame_clone(brace_frame **out, const brace_frame *frame, brace_error *error);

/* Frees a frame; NULL is allowed. */
BRACE_API void brace_frame_destroy(brace_frame *frame);

/* Colour of the mosaic at (x, y): 0 red, 1 green, 2 blue. Pure. */
BRACE_API int brace_cfa_color(brace_cfa cfa, uint32_t x, uint32_t y);

/* "RGGB", "GRBG", ...; never NULL. */
BRACE_API const char *brace_cfa_name(brace_cfa cfa);

/* Reads a Bayer RAW file of any format that LibRaw decodes: DNG, CR2, CR3, NEF,
 * ARW, RAF, ORF, RW2 and others, of at least 22x22 pixels. X-Trans, Foveon and linear RGB files, float
 * and deflated DNGs are refused with BRACE_ERROR_UNSUPPORTED and a sentence
 * that names the kind. Missing metadata gets the neutral values given above
 * and a note through the job. */
BRACE_API brace_status brace_frame_read(brace_frame **out, const char *path, const brace_job *job,
                                        brace_error *error);

/* All zeros mean the defaults. */
typedef struct brace_dng_params {
    /* RGB picture to derive the preview from, already turned upright or not as
     * the frame is stored (not turned); NULL: the frame is developed for it. */
    const brace_image *preview;
    bool no_preview;
    bool no_sync; /* the caller sees to it that the file reaches the disk: many are written, then synced at once */
    const char *software; /* EXIF Software; NULL: "BRACE <version>" */
    uint32_t reserved[8];
} brace_dng_params;

/* Writes the frame as DNG 1.4: uncompressed 16-bit CFA with the frame's
 * metadata, the tags it came with, and a small JPEG preview. Written to a
 * temporary file beside `path`, synced and renamed. `params` may be NULL. */
BRACE_API brace_status brace_frame_write_dng(const brace_frame *frame, const char *path,
                                             const brace_dng_params *params, const brace_job *job,
                                             brace_error *error);

#ifdef __cplusplus
}
#endif
#endif
