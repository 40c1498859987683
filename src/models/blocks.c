/* SPDX-License-Identifier: Apache-2.0 */
/* blocks.c: residual blocks, which these networks mostly consist of. */
#include "models/models.h"

nn_value models_residual_blocks(nn_graph *g, const char *name, nn_value x, int channels, int blocks) {
    nn_push(g, "%s.main", name);
    x = nn_conv2d(g, x, &(nn_conv){.name = "0", .out = channels, .kernel = 3, .pad = 1, .activation = NN_LEAKY_RELU,
                                   .init = NN_INIT_UNIFORM_FAN_IN});
    for (int i = 0; i < blocks; i++) { /* x + conv2(ReLU(conv1(x))) */
        nn_push(g, "2.%d", i);
        nn_conv conv = {.name = "conv1", .out = channels, .kernel = 3, .pad = 1, .activation = NN_RELU,
                        .init = NN_INIT_HE_FAN_IN_TENTH};
        const nn_value inner = nn_conv2d(g, x, &conv);
        conv.name = "conv2";
        conv.activation = NN_LINEAR;
        conv.residual = x;
        x = nn_conv2d(g, inner, &conv);
        nn_pop(g);
    }
    nn_pop(g);
    return x;
}
