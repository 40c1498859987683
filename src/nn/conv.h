/* SPDX-License-Identifier: Apache-2.0 */
/* conv.h: the node behind nn_conv2d and nn_linear: both are convolutions to the kernels. */
#ifndef NN_CONV_H
#define NN_CONV_H

#include "nn/kernels/kernels.h"
#include "nn/node.h"

typedef struct conv_attributes {
    nn_conv_shape shape;
    nn_conv_types types;
} conv_attributes;

/* The parameter "name.part", or "part" alone where name is empty. */
nn_parameter *nn_conv_parameter(nn_graph *g, const char *name, const char *part, int rank, const int *shape,
                                nn_init init, int fan_in);
nn_value nn_conv_node(nn_graph *g, nn_value x, nn_value residual, nn_shape result, nn_parameter *weight,
                      nn_parameter *bias, const conv_attributes *attributes);

#endif
