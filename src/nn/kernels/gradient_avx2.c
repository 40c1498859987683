/* SPDX-License-Identifier: Apache-2.0 */
/* gradient_avx2.c: the gradient at the sums, compiled with AVX2. */
#include "nn/kernels/kernels.h"
#include "nn/node.h"

#define GRADIENT nn_gradient_avx2
#include "nn/kernels/gradient_body.h"
