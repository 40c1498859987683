/* SPDX-License-Identifier: Apache-2.0 */
/* adamw_avx2.c: steps of AdamW with AVX2. */
#define ADAMW nn_adamw_avx2
#include "nn/kernels/adamw_body.h"
