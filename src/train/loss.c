/* SPDX-License-Identifier: Apache-2.0 */
/* loss.c: the losses of both stages of training, put together. */
#include "train/loss.h"

static nn_value exact(nn_graph *g, nn_value raw) {
    return nn_type_of(g, raw) == NN_BF16 ? nn_cast(g, raw, NN_F32) : raw;
}

/* r log(1 + x/r) */
static nn_value by_ratio(nn_graph *g, nn_value x, double r) {
    return r > 0 ? nn_affine(g, nn_log(g, nn_affine(g, x, 1 / r, 1)), r, 0) : x;
}

/* What both answers are told: L1 and wavelets of their difference from the truth, by itself and together. */
typedef struct plain_loss {
    nn_value l1, wavelet, total; /* wavelet 0: left out */
} plain_loss;

static plain_loss plain_loss_build(nn_graph *g, nn_value raw, nn_value truth, const train_loss_params *params) {
    plain_loss out = {0};
    const nn_value difference = nn_sub(g, train_encode(g, raw, params->encoding, params->mu),
                                       train_encode(g, truth, params->encoding, params->mu));
    out.total = out.l1 = nn_mean(g, nn_abs(g, difference), true, true, true, true);
    if (params->no_l1) {
        out.total = nn_affine(g, out.l1, 0, 0); /* still told in the log */
    }
    if (params->wavelet > 0) {
        out.wavelet = train_loss_wavelet(g, difference, params->bands);
        out.total = nn_add(g, out.total, nn_affine(g, out.wavelet, params->wavelet, 0));
    }
    return out;
}

train_loss train_loss_build(nn_graph *g, nn_weights *weights, nn_value prediction, nn_value alone,
                            const train_loss_params *params) {
    train_loss out = {0};
    nn_push(g, "loss");
    const nn_value raw = exact(g, prediction);
    out.truth = nn_input(g, "truth", nn_shape_of(g, raw));
    const plain_loss plain = plain_loss_build(g, raw, out.truth, params);
    out.l1 = plain.l1, out.wavelet = plain.wavelet, out.total = plain.total;
    nn_output(g, "l1", out.l1);
    if (out.wavelet != 0) {
        nn_output(g, "wavelet", out.wavelet);
    }
    if (params->color > 0) {
        out.gains = nn_input(g, "gains", (nn_shape){1, 1, 1, 3});
        out.matrix = nn_input(g, "matrix", (nn_shape){1, 1, 3, 3});
        out.color = train_loss_msswd(g, weights, train_isp(g, raw, out.gains, out.matrix),
                                     train_isp(g, out.truth, out.gains, out.matrix), &params->msswd);
        nn_output(g, "color", out.color);
        out.total = nn_add(g, out.total, nn_affine(g, out.color, params->color, 0));
    }
    out.total = by_ratio(g, out.total, params->relative);
    if (params->alone > 0 && alone != 0) {
        const plain_loss own = plain_loss_build(g, exact(g, alone), out.truth, params);
        out.alone = own.l1;
        nn_output(g, "alone", out.alone);
        out.total = nn_add(g, out.total, nn_affine(g, by_ratio(g, own.total, params->relative), params->alone, 0));
    }
    nn_output(g, "total", out.total);
    nn_pop(g);
    return out;
}
