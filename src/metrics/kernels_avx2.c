/* SPDX-License-Identifier: Apache-2.0 */
/* kernels_avx2.c: the inner loops of the metrics, compiled with AVX2 and FMA. */
#define METRICS_KERNELS metrics_kernels_avx2
#define LANES 8
#define WIDE 3
#define PIXELS 6
#include "metrics/kernels_body.h"
