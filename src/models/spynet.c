/* SPDX-License-Identifier: Apache-2.0 */
/*
 * spynet.c: optical flow from coarse to fine (Ranjan and Black, "Optical Flow Estimation using a Spatial Pyramid
 * Network", CVPR 2017). Six levels; each warps the other frame by the flow so far and adds what five 7x7 convolutions
 * find missing.
 */
#include "models/models.h"

enum { LEVELS = 6, STEP = 1 << (LEVELS - 1) };

static nn_value normalize(nn_graph *g, nn_value x) { /* ImageNet's mean and deviation */
    static const float mean[3] = {0.485f, 0.456f, 0.406f}, deviation[3] = {0.229f, 0.224f, 0.225f};
    const nn_shape shape = {1, 1, 1, 3};
    return nn_div(g, nn_sub(g, x, nn_constant(g, shape, mean)), nn_constant(g, shape, deviation));
}

static nn_value level_flow(nn_graph *g, int level, nn_value reference, nn_value other, nn_value flow) {
    static const int out[5] = {32, 64, 32, 16, 2};
    nn_value x =
        nn_concat(g, NN_AXIS_C, 3, (nn_value[]){reference, nn_warp(g, other, flow, NN_REPLICATE), flow});
    x = nn_cast(g, x, nn_graph_type(g)); /* the flow itself stays exact; what is added to it is small */
    nn_push(g, "basic_module.%d.basic_module", level);
    for (int i = 0; i < 5; i++) {
        static const char *const names[5] = {"0", "2", "4", "6", "8"};
        x = nn_conv2d(g, x, &(nn_conv){.name = names[i], .out = out[i], .kernel = 7, .pad = 3, .f32_result = i == 4,
                                       .activation = i < 4 ? NN_RELU : NN_LINEAR, .init = NN_INIT_UNIFORM_FAN_IN});
    }
    nn_pop(g);
    return nn_add(g, flow, x);
}

static int round_up(int n) {
    return (n + STEP - 1) / STEP * STEP;
}

nn_value models_spynet(nn_graph *g, nn_value reference, nn_value other) {
    const nn_shape s = nn_shape_of(g, reference);
    const int h = round_up(s.h), w = round_up(s.w);
    nn_value a[LEVELS], b[LEVELS];
    nn_push(g, "spynet");
    a[0] = normalize(g, nn_resize(g, reference, h, w, false));
    b[0] = normalize(g, nn_resize(g, other, h, w, false));
    for (int i = 1; i < LEVELS; i++) {
        a[i] = nn_average_pool(g, a[i - 1], 2, 2);
        b[i] = nn_average_pool(g, b[i - 1], 2, 2);
    }
    /* Nothing is known at first: zeros of the coarsest size. */
    nn_value flow = nn_affine(g, nn_slice(g, a[LEVELS - 1], NN_AXIS_C, 0, 2, 1), 0, 0);
    for (int i = LEVELS - 1; i >= 0; i--) {
        if (i < LEVELS - 1) {
            flow = nn_affine(g, nn_resize(g, flow, h >> i, w >> i, true), 2, 0);
        }
        flow = level_flow(g, LEVELS - 1 - i, a[i], b[i], flow);
    }
    const float scale[2] = {(float)s.w / (float)w, (float)s.h / (float)h};
    flow = nn_mul(g, nn_resize(g, flow, s.h, s.w, false), nn_constant(g, (nn_shape){1, 1, 1, 2}, scale));
    nn_pop(g);
    return flow;
}
