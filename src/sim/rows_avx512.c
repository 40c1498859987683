/* SPDX-License-Identifier: Apache-2.0 */
/* rows_avx512.c: the loops over pixels, compiled with AVX-512 F, BW, DQ and VL. */
#define SIM_ROWS sim_rows_avx512
#include "sim/rows_body.h"
