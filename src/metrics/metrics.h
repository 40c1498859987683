/* SPDX-License-Identifier: Apache-2.0 */
/*
 * metrics.h: how far a picture is from its ground truth. Internal.
 *
 * Both pictures are float images of equal size and equally many channels, with
 * values meant for [0, 1] (the data range is 1; nothing is clipped). The curve
 * that they carry is the caller's choice; the paper measures sRGB-encoded
 * pictures. Alpha is not looked at.
 *
 * Thread safety: pure but for the outputs. Results do not depend on the number of threads.
 */
#ifndef METRICS_METRICS_H
#define METRICS_METRICS_H

#include "brace/image.h"
#include "brace/job.h"
#include "brace/metrics.h"
#include "brace/status.h"

/* Both as RGB floats with the sRGB curve, the caller's to free; BRACE_ERROR_MISMATCH if their sizes differ. On failure
 * both are NULL. */
brace_status metrics_take(brace_image *out[2], const brace_image *a, const brace_image *b, brace_error *error);

/* Checks that two images can be compared, and at least `side` pixels a side are there. */
brace_status metrics_check(const brace_image *a, const brace_image *b, uint32_t side, brace_error *error);

/* Peak signal-to-noise ratio, 10 log10(1/MSE) dB over all colour samples; infinity for equal pictures. */
brace_status metrics_psnr(double *out, const brace_image *a, const brace_image *b, const brace_job *job,
                          brace_error *error);

/* Mean structural similarity (Wang, Bovik, Sheikh, Simoncelli: Image quality assessment: from error
 * visibility to structural similarity; IEEE TIP 13, 2004): 11x11 Gaussian window of sigma 1.5, K1 0.01,
 * K2 0.03, mean over the positions whose window lies inside the picture, then over the colour channels.
 * The same number as scikit-image's structural_similarity with gaussian_weights=True, sigma=1.5,
 * use_sample_covariance=False, data_range=1. Pictures have at least 11 pixels a side. */
brace_status metrics_ssim(double *out, const brace_image *a, const brace_image *b, const brace_job *job,
                          brace_error *error);

#endif
