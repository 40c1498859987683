/* SPDX-License-Identifier: Apache-2.0 */
/*
 * swd.h: the parts of MS-SWD that tests look at. Internal.
 *
 * Thread safety: pure but for the outputs.
 */
#ifndef METRICS_SWD_H
#define METRICS_SWD_H

#include "brace/metrics.h"
#include "core/core.h"

enum { METRICS_SWD_TAPS = 3 * 11 * 11 };

/* Mean of |x_(i) - y_(i)| over both sorted. Shuffles x and y; `scratch` has n floats; 1 <= n < 2^32. */
double metrics_wasserstein(float *x, float *y, size_t n, float *scratch);

/* Projection `index` of scale `scale`: a direction of length 1, [L a b][dy][dx]. */
void metrics_swd_projection(float out[METRICS_SWD_TAPS], uint64_t seed, uint32_t scale, uint32_t index);

#endif
