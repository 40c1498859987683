/* SPDX-License-Identifier: Apache-2.0 */
/* inputs.c: what a network is shown, as inputs of its graph. */
#include <math.h>

#include "models/models.h"

models_inputs models_inputs_create(nn_graph *g, int n, int height, int width) {
    return (models_inputs){.frames = nn_input(g, "frames", (nn_shape){n, height, width, 8}),
                           .flow = nn_input(g, "flow", (nn_shape){n, height, width, 2}),
                           .white = nn_input(g, "white", (nn_shape){n, 1, 1, 1}),
                           .descriptors = nn_input(g, "descriptors", (nn_shape){n, 1, 1, 8}),
                           .rho = nn_input(g, "rho", (nn_shape){n, 1, 1, 1}),
                           .balance = nn_input(g, "balance", (nn_shape){1, 1, 1, 8}),
                           .sigma = nn_input(g, "sigma", (nn_shape){1, height, width, 4})};
}

void models_balance(float balance[8], const double gains[3]) {
    static const int channel[4] = {0, 1, 1, 2};
    for (int i = 0; i < 4; i++) {
        const double ratio = gains[channel[i]] / gains[1];
        const double gain = ratio >= 1.0 / 16 && ratio <= 16 ? ratio : 1;
        balance[2 * i] = (float)gain;
        balance[2 * i + 1] = (float)pow(gain, 1 / 2.2);
    }
}
