/* SPDX-License-Identifier: Apache-2.0 */
/*
 * loss_msswd.c: the multiscale sliced Wasserstein distance as a graph: what
 * brace_ms_swd computes, differentiably. The gradient goes through the sorting to
 * where each projection came from.
 *
 * The directions are weights of a convolution, frozen: drawn anew for every step,
 * few of them suffice.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "metrics/swd.h"
#include "train/loss.h"

#define BOUND 1e30

enum { PATCH = 11, BORDER = PATCH / 2, LEAST = BORDER + 1 };

static nn_value decode_srgb(nn_graph *g, nn_value x) {
    const double t = 0.04045, at = (t + 0.055) / 1.055;
    const nn_value straight = nn_affine(g, nn_clamp(g, x, -BOUND, t), 1 / 12.92, 0);
    const nn_value curve = nn_pow(g, nn_affine(g, nn_clamp(g, x, t, BOUND), 1 / 1.055, 0.055 / 1.055), 2.4);
    return nn_affine(g, nn_add(g, straight, curve), 1, -pow(at, 2.4));
}

/* sRGB-encoded to CIELAB, the constants of src/metrics/msswd.c. */
static nn_value lab_of(nn_graph *g, nn_value srgb) {
    static const float to_xyz[9] = {
        /* transposed: rows R G B */
        (float)(10135552 / 23359437.0), (float)(2613072 / 12288897.0), (float)(1425312 / 80288307.0),
        (float)(8788810 / 23359437.0),  (float)(8788810 / 12288897.0), (float)(8788810 / 80288307.0),
        (float)(4435075 / 23359437.0),  (float)(887015 / 12288897.0),  (float)(70074185 / 80288307.0)};
    /* f(X), f(Y), f(Z) to L, a, b */
    static const float to_lab[9] = {0, 500, 0, 116, -500, 200, 0, 0, -200};
    const double delta = 6.0 / 29, t = delta * delta * delta;
    const nn_shape s = nn_shape_of(g, srgb), flat = {1, 1, s.n * s.h * s.w, 3}, square = {1, 1, 3, 3};
    const nn_value linear = nn_reshape(g, decode_srgb(g, srgb), flat);
    const nn_value xyz = nn_matmul(g, linear, nn_constant(g, square, to_xyz), false, 1);
    const nn_value straight = nn_affine(g, nn_clamp(g, xyz, -BOUND, t), 1 / (3 * delta * delta), 4.0 / 29 - delta);
    const nn_value f = nn_add(g, straight, nn_pow(g, nn_clamp(g, xyz, t, BOUND), 1.0 / 3));
    const nn_value lab = nn_matmul(g, f, nn_constant(g, square, to_lab), false, 1);
    return nn_reshape(g, lab, s); /* without L's -16: it cancels in every difference */
}

static nn_value smaller(nn_graph *g, nn_value x) {
    static const float line[5] = {1, 4, 6, 4, 1};
    float taps[25];
    for (int i = 0; i < 25; i++) {
        taps[i] = line[i / 5] * line[i % 5] / 256;
    }
    return nn_filter(g, nn_pad(g, x, 2, 2, 2, 2, NN_REFLECT), 5, 2, 0, taps);
}

nn_value train_loss_msswd(nn_graph *g, nn_weights *weights, nn_value a, nn_value b, const train_msswd *params) {
    const nn_value both[] = {a, b};
    nn_value pair = nn_concat(g, NN_AXIS_N, 2, both), sum = 0;
    int scales = 0;
    for (; scales < params->scales; scales++) {
        if (scales > 0) {
            pair = smaller(g, pair);
        }
        const nn_shape s = nn_shape_of(g, pair);
        if (nn_graph_error(g, NULL) != BRACE_OK || s.h < LEAST || s.w < LEAST) {
            break;
        }
        char name[32];
        snprintf(name, sizeof name, "msswd.%d", scales);
        const nn_value padded = nn_pad(g, lab_of(g, pair), BORDER, BORDER, BORDER, BORDER, NN_REFLECT);
        const nn_value projected = nn_conv2d(
            g, padded, &(nn_conv){.name = name, .out = params->projections, .kernel = PATCH, .no_bias = true});
        const nn_value sorted =
            nn_sort(g, nn_reshape(g, projected, (nn_shape){2, 1, s.h * s.w, params->projections}), NN_AXIS_W);
        const nn_value distance =
            nn_l1(g, nn_slice(g, sorted, NN_AXIS_N, 0, 1, 1), nn_slice(g, sorted, NN_AXIS_N, 1, 2, 1));
        sum = sum != 0 ? nn_add(g, sum, distance) : distance;
    }
    for (size_t i = 0; i < nn_weights_count(weights); i++) {
        nn_parameter *p = nn_weights_at(weights, i);
        if (strstr(p->name, "msswd.") != NULL) {
            p->frozen = true;
        }
    }
    return nn_affine(g, sum, 1.0 / (scales > 0 ? scales : 1), 0);
}

brace_status train_msswd_draw(nn_weights *weights, const char *scope, const train_msswd *params, uint64_t seed,
                              brace_error *error) {
    const int shape[4] = {params->projections, 3, PATCH, PATCH};
    float *values = core_alloc((size_t)params->projections * METRICS_SWD_TAPS, sizeof *values);
    if (values == NULL) {
        return core_fail_memory(error, (size_t)params->projections * METRICS_SWD_TAPS * sizeof *values, "projections");
    }
    brace_status status = BRACE_OK;
    for (int scale = 0; scale < params->scales && status == BRACE_OK; scale++) {
        char name[64];
        snprintf(name, sizeof name, "%smsswd.%d.weight", scope, scale);
        for (int i = 0; i < params->projections; i++) {
            metrics_swd_projection(values + i * METRICS_SWD_TAPS, seed, (uint32_t)scale, (uint32_t)i);
        }
        status = nn_weights_give(weights, name, 4, shape, values, error);
    }
    core_free(values);
    return status;
}
