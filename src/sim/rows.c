/* SPDX-License-Identifier: Apache-2.0 */
/* rows.c: the loops over pixels, wherever there is nothing better. */
#define SIM_ROWS sim_rows_plain
#include "sim/rows_body.h"
