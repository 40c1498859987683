/* SPDX-License-Identifier: Apache-2.0 */
/*
 * develop.h: the image signal processor: RAW frame to sRGB picture, and back.
 *
 *   mosaic -> (x - black)/(white - black) -> white balance -> demosaic
 *          -> camera RGB to linear sRGB (ColorMatrix, XYZ D50) -> sRGB curve
 *
 * No tone curve, no sharpening, no denoising, no automatic brightness, no
 * BaselineExposure: equal light gives equal numbers in every frame, which is
 * what merging and measuring need. Colour follows chapter 6 of the DNG specification.
 *
 * Thread safety: all functions are pure but for their outputs.
 */
#ifndef BRACE_DEVELOP_H
#define BRACE_DEVELOP_H

#include "frame.h"
#include "image.h"
#include "job.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* How the two colours that a pixel did not record are filled in. All keep the
 * recorded samples exactly. Measured in docs/isp.md. */
typedef enum brace_demosaic {
    BRACE_DEMOSAIC_DEFAULT = 0,    /* BRACE_DEMOSAIC_DIRECTIONAL: the sharpest, the least false colour */
    BRACE_DEMOSAIC_BILINEAR = 1,   /* means of neighbours: soft, coloured edges; the yardstick */
    BRACE_DEMOSAIC_MALVAR = 2,     /* Malvar, He and Cutler 2004: 5x5 linear, gradient-corrected */
    BRACE_DEMOSAIC_DIRECTIONAL = 3 /* colour differences along edges, weighted by their gradients */
} brace_demosaic;

/* How camera RGB becomes linear sRGB for one frame. */
typedef struct brace_color {
    double wb[3];                 /* multipliers for R, G, B, smallest 1 */
    double camera_to_srgb[9];     /* applied after wb; rows R G B; maps (1,1,1) to (1,1,1) */
    double srgb_to_camera[9];     /* its inverse */
} brace_color;

/* All zeros mean the defaults. */
typedef struct brace_develop_params {
    brace_demosaic demosaic;
    double exposure;         /* EV added in linear light; 0: as recorded */
    brace_sample sample;     /* of the result */
    brace_transfer transfer; /* of the result */
    /* brace_develop_linear only: up to which value the mosaic holds light. A merge
     * finds more than white (1) in the shorter frames: 1/exposure of the shortest.
     * Float results keep all of it, others what a negative `exposure` brings
     * below white. 0: 1, where the sensor clips. */
    double highlights;
    bool as_stored;          /* true: do not turn the picture upright */
    uint32_t reserved[8];
} brace_develop_params;

/* Colour transform of a frame. With two matrices they are interpolated by the
 * correlated colour temperature of AsShotNeutral (DNG spec, chapter 6). With no
 * usable matrix, camera RGB is taken as sRGB. */
BRACE_API brace_status brace_color_init(brace_color *out, const brace_frame *frame, brace_error *error);

/* Develops a frame. Clipped highlights stay neutral: each white-balanced channel is
 * clipped at the level where the first channel clips. `params` may be NULL. */
BRACE_API brace_status brace_develop(brace_image **out, const brace_frame *frame,
                                     const brace_develop_params *params, const brace_job *job, brace_error *error);

/* The same from a mosaic already normalised to [0, 1] (width*height floats,
 * values above 1 clipped): what restoration produces before it is quantised. */
BRACE_API brace_status brace_develop_linear(brace_image **out, const float *mosaic, const brace_frame *frame,
                                            const brace_develop_params *params, const brace_job *job,
                                            brace_error *error);

/* The inverse: picture to mosaic, in [0, 1] on the sensor's scale, sampled at
 * `frame`'s CFA with its colour; no noise, no quantisation. `image` is the
 * picture as stored (not turned) and of the frame's size; `mosaic` has
 * width*height floats. Not clipped: a colour that the camera cannot see comes out
 * negative, a bright one of a weak channel above 1. brace_develop_linear gives the picture back exactly (to
 * float precision) at every sample that the mosaic holds, wherever nothing clips. */
BRACE_API brace_status brace_undevelop(float *mosaic, const brace_image *image, const brace_frame *frame,
                                       brace_error *error);

/* A copy turned or mirrored as EXIF orientation 1 to 8 says. */
BRACE_API brace_status brace_image_orient(brace_image **out, const brace_image *image, int orientation,
                                          brace_error *error);

#ifdef __cplusplus
}
#endif
#endif
