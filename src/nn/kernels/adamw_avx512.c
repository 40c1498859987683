/* SPDX-License-Identifier: Apache-2.0 */
/* adamw_avx512.c: steps of AdamW with AVX-512. */
#define ADAMW nn_adamw_avx512
#include "nn/kernels/adamw_body.h"
