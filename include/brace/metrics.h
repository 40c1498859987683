/* SPDX-License-Identifier: Apache-2.0 */
/*
 * metrics.h: how far a picture is from its ground truth.
 *
 * Both pictures have the same width and height. Any sample type, transfer and number
 * of channels goes in: they are compared as RGB, encoded with the sRGB curve, with
 * values meant for [0, 1] that are not clipped; grey counts as three equal channels,
 * alpha is not looked at. Choices that the definitions leave open are stated and
 * reasoned in docs/metrics.md.
 *
 * Errors: BRACE_ERROR_MISMATCH for pictures of different sizes, BRACE_ERROR_ARGUMENT
 * for pictures that hold infinite values or NaN and for those too small for the metric.
 * After an error the result is untouched.
 *
 * Thread safety: pure but for the outputs; a brace_perceptual may be used from several
 * threads at once. Results do not depend on the number of threads. MS-SWD, LPIPS and
 * DISTS may differ in the sixth digit between processors with and without AVX2.
 */
#ifndef BRACE_METRICS_H
#define BRACE_METRICS_H

#include <stdint.h>

#include "image.h"
#include "job.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Peak signal-to-noise ratio in dB, 10 log10(1/MSE) over all samples; infinity for equal pictures. */
BRACE_API brace_status brace_psnr(double *out, const brace_image *a, const brace_image *b, const brace_job *job,
                                  brace_error *error);

/* Structural similarity, 1 for equal pictures (Wang, Bovik, Sheikh, Simoncelli: Image quality assessment: from
 * error visibility to structural similarity; IEEE TIP 13, 2004): 11x11 Gaussian window of sigma 1.5, K1 0.01, K2
 * 0.03, mean over the windows that lie inside the picture and over the channels. At least 11 pixels a side. */
BRACE_API brace_status brace_ssim(double *out, const brace_image *a, const brace_image *b, const brace_job *job,
                                  brace_error *error);

/* All zeros mean the defaults. */
typedef struct brace_ms_swd_params {
    int scales;      /* 1 to 12; 0: 5 */
    int projections; /* a scale, 1 to 4096; 0: 128 */
    uint64_t seed;   /* of the projections */
    uint32_t reserved[8];
} brace_ms_swd_params;

/* Multiscale sliced Wasserstein distance, 0 for equal pictures, in units of CIELAB (He, Wang, Wang, Liu, Fang, Sun,
 * Ma: Multiscale Sliced Wasserstein Distances as Perceptual Color Difference Measures; ECCV 2024). `params` may be
 * NULL. Needs about 85 bytes a pixel. */
BRACE_API brace_status brace_ms_swd(double *out, const brace_image *a, const brace_image *b,
                                    const brace_ms_swd_params *params, const brace_job *job, brace_error *error);

/* ---- metrics that compare features of a network ---- */

/* LPIPS: Zhang, Isola, Efros, Shechtman, Wang: The Unreasonable Effectiveness of Deep Features as a Perceptual
 * Metric; CVPR 2018, version 0.1 of its weights. DISTS: Ding, Ma, Wang, Simoncelli: Image Quality Assessment:
 * Unifying Structure and Texture Similarity; IEEE TPAMI 44, 2022. Both 0 for equal pictures. */
typedef enum brace_perceptual_kind {
    BRACE_LPIPS_ALEX = 0,
    BRACE_LPIPS_VGG = 1,
    BRACE_LPIPS_SQUEEZE = 2,
    BRACE_DISTS = 3
} brace_perceptual_kind;

/* "lpips-alex", "lpips-vgg", "lpips-squeeze", "dists"; never NULL. */
BRACE_API const char *brace_perceptual_name(brace_perceptual_kind kind);

typedef struct brace_perceptual brace_perceptual;

/* Reads a metric's weights from `folder`: the published .pth files under their published names, as they are; see
 * docs/metrics.md. NULL: the folder that the environment variable BRACE_WEIGHTS names. Nothing in the files is
 * executed. When one is missing, the error (BRACE_ERROR_IO) says where it is to be had and where to put it. Freed with
 * brace_perceptual_destroy. */
BRACE_API brace_status brace_perceptual_load(brace_perceptual **out, brace_perceptual_kind kind, const char *folder,
                                             brace_error *error);
BRACE_API void brace_perceptual_destroy(brace_perceptual *metric); /* NULL is allowed */

/* The distance of two pictures of at least 32 pixels a side. Pictures of more than a megapixel are worked on in
 * overlapping tiles, which gives the same result in bounded memory (about 1.2 GB with VGG). */
BRACE_API brace_status brace_perceptual_distance(double *out, const brace_perceptual *metric, const brace_image *a,
                                                 const brace_image *b, const brace_job *job, brace_error *error);

#ifdef __cplusplus
}
#endif
#endif
