/* SPDX-License-Identifier: Apache-2.0 */
/*
 * mscam.c: the multi-scale spatial cross-attention modulator (BRACE paper, "Spatial Cross-Attention Fusion"): what is
 * known of the banding decides, channel by channel, how features are amplified.
 *
 *   z   = MLP([mu; sigma])                         statistics of the frames' banding descriptors, weighted with rho
 *   t_i = W_f h_i + W_g z                          a token for each frame and cell of an s x s grid, s = 1, 2, 4
 *   c   = Attention(t_reference, {t_i}, {t_i})     averaged over cells and scales
 *   [gamma, beta] = MLP(c)
 *   F'  = F (1 + 0.1 tanh gamma) + 0.1 beta
 *
 * What the paper leaves open: the perceptrons have one hidden layer of d with ReLU; the last layer begins with zeros,
 * so that the network begins as TMRNet; the two log powers among the descriptors are divided by ten, so that all are
 * of the order of 1.
 *
 * Strips are ours. A rolling shutter exposes a row at once, so what a row's readable pixels tell of the light holds for
 * its others, however far away; no small convolution sees that far. Each pixel of each frame is compared with the
 * reference's by a 1x1 convolution, the results are averaged along the row in cells, and attention over frames gives
 * each cell its own gamma and beta, interpolated between cells. docs/model.md has what it is worth.
 */
#include <math.h>

#include "models/models.h"

enum { TOKEN = 64, DESCRIPTORS = 8 };

static nn_value perceptron(nn_graph *g, const char *name, nn_value x, int hidden, int out, nn_init last) {
    nn_push(g, "%s", name);
    x = nn_activate(g, nn_linear(g, x, "0", hidden, true, NN_INIT_UNIFORM_FAN_IN), NN_RELU);
    x = nn_linear(g, x, "2", out, true, last);
    nn_pop(g);
    return x;
}

/* The prior token, {1, 1, 1, TOKEN}. */
static nn_value global_token(nn_graph *g, nn_value descriptors, nn_value rho) {
    static const float unit[DESCRIPTORS] = {1, 1, 1, 0.1f, 0.1f, 1, 1, 1};
    const nn_value s = nn_mul(g, descriptors, nn_constant(g, (nn_shape){1, 1, 1, DESCRIPTORS}, unit));
    const nn_value sum = nn_affine(g, nn_sum(g, rho, true, false, false, false), 1, 1e-6);
    const nn_value share = nn_div(g, rho, sum);
    const nn_value mean = nn_sum(g, nn_mul(g, share, s), true, false, false, false);
    const nn_value off = nn_sub(g, s, mean);
    const nn_value variance = nn_sum(g, nn_mul(g, share, nn_mul(g, off, off)), true, false, false, false);
    const nn_value deviation = nn_sqrt(g, nn_affine(g, variance, 1, 1e-6));
    return perceptron(g, "prior", nn_concat(g, NN_AXIS_C, 2, (nn_value[]){mean, deviation}), TOKEN, TOKEN,
                      NN_INIT_UNIFORM_FAN_IN);
}

/* W_f h + W_g z */
static nn_value tokens(nn_graph *g, nn_value pooled, nn_value prior) {
    const nn_value t = nn_linear(g, pooled, "feature", TOKEN, true, NN_INIT_UNIFORM_FAN_IN);
    return prior == 0 ? t : nn_add(g, t, nn_linear(g, prior, "global", TOKEN, false, NN_INIT_UNIFORM_FAN_IN));
}

/* Scaled dot-product attention over frames in each cell: {frames, y, x, TOKEN} to {1, y, x, TOKEN}. */
static nn_value attention(nn_graph *g, nn_value t) {
    const nn_value query = nn_slice(g, t, NN_AXIS_N, 0, 1, 1);
    const nn_value match = nn_sum(g, nn_mul(g, t, query), false, false, false, true);
    const nn_axis frames_last[4] = {NN_AXIS_C, NN_AXIS_H, NN_AXIS_W, NN_AXIS_N};
    nn_value share = nn_permute(g, nn_affine(g, match, 1 / sqrt((double)TOKEN), 0), frames_last);
    share = nn_permute(g, nn_softmax(g, share), frames_last);
    return nn_sum(g, nn_mul(g, t, share), true, false, false, false);
}

/* The paper's: [gamma, beta] of the whole picture. */
static nn_value whole(nn_graph *g, nn_value features, nn_value prior, int channels) {
    nn_value sum = 0;
    for (int s = 1; s <= 4; s *= 2) {
        const nn_value c = nn_mean(g, attention(g, tokens(g, nn_adaptive_average_pool(g, features, s, s), prior)), false,
                                   true, true, false);
        sum = sum == 0 ? c : nn_add(g, sum, c);
    }
    return perceptron(g, "film", nn_affine(g, sum, 1.0 / 3, 0), TOKEN, 2 * channels, NN_INIT_ZERO);
}

/* [gamma, beta] of each pixel, from cells of one row. */
static nn_value strips(nn_graph *g, const models_shape *shape, nn_value features, nn_value prior) {
    const nn_shape s = nn_shape_of(g, features);
    const int cells = s.w > shape->strip ? (s.w + shape->strip / 2) / shape->strip : 1;
    const nn_value reference = nn_repeat(g, nn_slice(g, features, NN_AXIS_N, 0, 1, 1), NN_AXIS_N, s.n);
    nn_push(g, "strip");
    nn_value x = nn_conv2d(g, nn_concat(g, NN_AXIS_C, 2, (nn_value[]){reference, features}),
                           &(nn_conv){.name = "compare", .out = shape->channels, .kernel = 1, .activation = NN_RELU,
                                      .f32_result = true, .init = NN_INIT_UNIFORM_FAN_IN});
    const nn_value t = tokens(g, nn_adaptive_average_pool(g, x, s.h, cells), prior);
    /* Attention averages; what it is compared with goes on beside it. */
    const nn_value both = nn_concat(g, NN_AXIS_C, 2, (nn_value[]){attention(g, t), nn_slice(g, t, NN_AXIS_N, 0, 1, 1)});
    x = perceptron(g, "film", both, TOKEN, 2 * shape->channels, NN_INIT_ZERO);
    nn_pop(g);
    return nn_resize(g, x, s.h, s.w, false);
}

static nn_value modulate(nn_graph *g, nn_value features, nn_value film, int channels, double strength, bool bounded) {
    nn_value gamma = nn_slice(g, film, NN_AXIS_C, 0, channels, 1);
    const nn_value beta = nn_slice(g, film, NN_AXIS_C, channels, 2 * channels, 1);
    gamma = bounded ? nn_activate(g, gamma, NN_TANH) : gamma;
    return nn_add(g, nn_mul(g, features, nn_affine(g, gamma, strength, 1)), nn_affine(g, beta, strength, 0));
}

nn_value models_mscam(nn_graph *g, const models_shape *shape, nn_value features, const models_inputs *inputs) {
    nn_push(g, "mscam");
    const nn_value exact = nn_cast(g, features, nn_type_of(g, inputs->descriptors));
    const nn_value prior = shape->prior ? global_token(g, inputs->descriptors, inputs->rho) : 0;
    nn_value out = modulate(g, features, whole(g, exact, prior, shape->channels), shape->channels, 0.1, true);
    if (shape->strip > 0) {
        out = modulate(g, out, strips(g, shape, features, prior), shape->channels, 1, false);
    }
    nn_pop(g);
    return out;
}
