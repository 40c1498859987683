/* SPDX-License-Identifier: Apache-2.0 */
/* kernels_avx512.c: the inner loops of the metrics, compiled with AVX-512 F, BW, DQ and VL. */
#define METRICS_KERNELS metrics_kernels_avx512
#define LANES 16
#define WIDE 6
#define PIXELS 12
#include "metrics/kernels_body.h"
