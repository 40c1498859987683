/* SPDX-License-Identifier: Apache-2.0 */
/* adamw_plain.c: steps of AdamW in plain C. */
#define ADAMW nn_adamw_plain
#include "nn/kernels/adamw_body.h"
