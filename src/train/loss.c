/* SPDX-License-Identifier: Apache-2.0 */
/* loss.c: the losses of both stages of training, put together. */
#include "train/loss.h"

train_loss train_loss_build(nn_graph *g, nn_weights *weights, nn_value prediction, const train_loss_params *params) {
    train_loss out = {0};
    nn_push(g, "loss");
    nn_value raw = prediction;
    if (nn_type_of(g, raw) == NN_BF16) {
        raw = nn_cast(g, raw, NN_F32);
    }
    const nn_shape s = nn_shape_of(g, raw);
    out.truth = nn_input(g, "truth", s);
    const nn_value difference = nn_sub(g, train_encode(g, raw, params->encoding, params->mu),
                                       train_encode(g, out.truth, params->encoding, params->mu));
    out.total = out.l1 = nn_mean(g, nn_abs(g, difference), true, true, true, true);
    nn_output(g, "l1", out.l1);
    if (params->no_l1) {
        out.total = nn_affine(g, out.l1, 0, 0); /* still told in the log */
    }
    if (params->wavelet > 0) {
        out.wavelet = train_loss_wavelet(g, difference, params->bands);
        nn_output(g, "wavelet", out.wavelet);
        out.total = nn_add(g, out.total, nn_affine(g, out.wavelet, params->wavelet, 0));
    }
    if (params->color > 0) {
        out.gains = nn_input(g, "gains", (nn_shape){1, 1, 1, 3});
        out.matrix = nn_input(g, "matrix", (nn_shape){1, 1, 3, 3});
        out.color = train_loss_msswd(g, weights, train_isp(g, raw, out.gains, out.matrix),
                                     train_isp(g, out.truth, out.gains, out.matrix), &params->msswd);
        nn_output(g, "color", out.color);
        out.total = nn_add(g, out.total, nn_affine(g, out.color, params->color, 0));
    }
    if (params->relative > 0) {
        const nn_value ratio = nn_affine(g, out.total, 1 / params->relative, 1);
        out.total = nn_affine(g, nn_log(g, ratio), params->relative, 0);
    }
    nn_output(g, "total", out.total);
    nn_pop(g);
    return out;
}
