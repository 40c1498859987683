/* SPDX-License-Identifier: Apache-2.0 */
/* kernels.c: the inner loops of the metrics, wherever there is nothing better. */
#define METRICS_KERNELS metrics_kernels_plain
#define LANES 4
#define WIDE 3
#define PIXELS 6
#include "metrics/kernels_body.h"
