/* SPDX-License-Identifier: Apache-2.0 */
/* rows_avx2.c: the loops over pixels, compiled with AVX2. */
#define SIM_ROWS sim_rows_avx2
#include "sim/rows_body.h"
