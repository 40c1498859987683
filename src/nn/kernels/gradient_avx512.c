/* SPDX-License-Identifier: Apache-2.0 */
/* gradient_avx512.c: the gradient at the sums, compiled with AVX-512. */
#include "nn/kernels/kernels.h"
#include "nn/node.h"

#define GRADIENT nn_gradient_avx512
#include "nn/kernels/gradient_body.h"
