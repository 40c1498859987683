/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tmrnet.c: temporally modulated recurrent aggregation of a bracket (Zhang et al., BracketIRE), and BRACE, which is the
 * same with MSCAM (mscam.c).
 *
 *   f_i = extract(frame i)                                               i = 0: the reference
 *   f_i = deform(f_i; offsets(warp(f_i), f_0, flow_i) + flow_i, mask)    i > 0
 *   f   = MSCAM(f)                                                       BRACE
 *   h   = h + B(f_0, f_i, h);  h = h + R_i(f_0, f_i, h) gate_i           one frame after another, h = 0 at first
 *   result = tail(f_0, h, reference)
 *
 * Small networks work at half the packed resolution (unshuffle), take the flow as an input, may move the frames by it
 * before anything else instead of deforming features (no groups), and end in a blend:
 *
 *   y = a_0 v_0 + sum_i m_i a_i (v_i - v_0) + b,  result = sign(y) |y|^2.2
 *
 * where v are the frames under the gamma curve, moved by the flow, m_i falls to 0 where frame i clips, and a and b are
 * maps of the last convolution, which begin as a_0 = 1 and 0 else: the network begins as the reference, and steady
 * light needs nothing else. With a guide, which is the last v, its a begins as 1, too: the network begins as merging.
 *
 * With sigma, what merging expects its errors to be, the guide is what is blended into, and frames are listened to as
 * far as merging doubts:
 *
 *   d_i = v_i - v_g,  u_i = d_i / sqrt((8 sigma)^2 + d_i^2)
 *   y = v_g + 8 sigma (a_0 + sum_i m_i a_i u_i) + c_0 + sum_i m_i c_i d_i,  i > 0
 *
 * Small steps are as large as the doubt is; large ones leave a guide that is sure and wrong. u_i and sigma^(1/4) are
 * shown to the network beside frame i. The reference is not listened to: where it is right the guide is the reference
 * already, and its stripes are what is to be removed.
 *
 * With a gate, there are two answers, and a map t, 0 at first, that leaves the first for the second where merging failed:
 *
 *   y_g = v_g + 8 sigma (a_0 + sum_i m_i a_i u_i)
 *   y_f = the blend of the frames without guide, as above
 *   y = y_g + t (y_f - y_g)
 *
 * That is how it is trained. Restoring is cautious with both, since no training set has every screen and every lens: half
 * of the small steps is taken, and openings count from 0.4 on,
 *
 *   y = y'_g + t' (y_f - y'_g),  y'_g = v_g + 4 sigma (...),  t' = min(max((t - 0.4)/0.6, 0), 1)
 */
#include "models/models.h"

static const double gamma_curve = 2.2;

/* The mean of unshuffle x unshuffle flows, in feature pixels. */
static nn_value coarser(nn_graph *g, nn_value flow, int by) {
    return by == 1 ? flow : nn_affine(g, nn_average_pool(g, flow, by, by), 1.0 / by, 0);
}

static nn_value unshuffle(nn_graph *g, nn_value x, int by) {
    return by == 1 ? x : nn_pixel_unshuffle(g, x, by);
}

/* {n, h, w, 8} to R, mean G, B under the gamma curve, as SPyNet is shown them. */
static nn_value look(nn_graph *g, nn_value frames) {
    nn_value c[4];
    for (int i = 0; i < 4; i++) {
        c[i] = nn_slice(g, frames, NN_AXIS_C, 2 * i, 2 * i + 1, 1);
    }
    const nn_value green = nn_affine(g, nn_add(g, c[1], c[2]), 0.5, 0);
    const nn_value rgb = nn_concat(g, NN_AXIS_C, 3, (nn_value[]){c[0], green, c[3]});
    return nn_pow(g, nn_clamp(g, rgb, 0, 1), 1 / gamma_curve);
}

static nn_value balanced(nn_graph *g, const models_shape *shape, const models_inputs *in, nn_value frames) {
    return shape->balance ? nn_mul(g, frames, in->balance) : frames;
}

static nn_value others(nn_graph *g, nn_value x) {
    return nn_slice(g, x, NN_AXIS_N, 1, nn_shape_of(g, x).n, 1);
}

static nn_value repeat_first(nn_graph *g, nn_value x) {
    return nn_repeat(g, nn_slice(g, x, NN_AXIS_N, 0, 1, 1), NN_AXIS_N, nn_shape_of(g, x).n - 1);
}

/* All frames at the reference's pose, by the flow alone. */
static nn_value move(nn_graph *g, nn_value frames, nn_value flow) {
    const nn_value moved = nn_warp(g, others(g, frames), flow, NN_REPLICATE);
    return nn_concat(g, NN_AXIS_N, 2, (nn_value[]){nn_slice(g, frames, NN_AXIS_N, 0, 1, 1), moved});
}

/* Features of all frames at the reference's pose. */
static nn_value align(nn_graph *g, const models_shape *shape, nn_value features, nn_value flow) {
    const nn_value moved = others(g, features), reference = repeat_first(g, features);
    const nn_type type = nn_type_of(g, features), exact = nn_type_of(g, flow);
    const int taps = 9 * shape->groups;
    nn_value x = nn_concat(g, NN_AXIS_C, 3,
                           (nn_value[]){nn_warp(g, moved, flow, NN_ZERO), reference, nn_cast(g, flow, type)});
    nn_push(g, "dcn_alignment");
    for (int i = 0; i <= shape->offset; i++) {
        char name[32];
        const bool last = i == shape->offset;
        snprintf(name, sizeof name, "conv_offset.%d", 2 * i);
        x = nn_conv2d(g, x, &(nn_conv){.name = name, .out = last ? 3 * taps : shape->channels, .kernel = 3, .pad = 1,
                                       .activation = last ? NN_LINEAR : NN_LEAKY_RELU, .f32_result = last,
                                       .init = last ? NN_INIT_ZERO : NN_INIT_UNIFORM_FAN_IN});
    }
    const nn_value residual = nn_activate(g, nn_slice(g, x, NN_AXIS_C, 0, 2 * taps, 1), NN_TANH);
    const nn_value mask = nn_activate(g, nn_slice(g, x, NN_AXIS_C, 2 * taps, 3 * taps, 1), NN_SIGMOID);
    const nn_value there = nn_repeat(g, nn_flip(g, flow, NN_AXIS_C), NN_AXIS_C, taps); /* (dy, dx) of each tap */
    const nn_value offset = nn_add(g, nn_affine(g, residual, 10, 0), there);
    const nn_value aligned =
        nn_deform_conv2d(g, moved, nn_cast(g, offset, exact), nn_cast(g, mask, exact),
                         &(nn_deform){.name = "deform_conv", .out = shape->channels, .pad = 1, .dilation = 1,
                                      .offset_groups = shape->groups, .weight_groups = shape->groups,
                                      .init = NN_INIT_UNIFORM_FAN_IN});
    nn_pop(g);
    return nn_concat(g, NN_AXIS_N, 2, (nn_value[]){nn_slice(g, features, NN_AXIS_N, 0, 1, 1), aligned});
}

static nn_value aggregate(nn_graph *g, const models_shape *shape, nn_value features) {
    const int c = shape->channels;
    const nn_value base = nn_slice(g, features, NN_AXIS_N, 0, 1, 1);
    const int views = models_views(shape);
    const nn_value gates =
        nn_param(g, "learn_para", (nn_shape){views, 1, 1, c}, 5, (const int[]){1, views, c, 1, 1}, NN_INIT_ZERO);
    nn_value h = nn_affine(g, base, 0, 0);
    for (int i = 0; i < views; i++) {
        char name[32];
        const nn_value f = nn_slice(g, features, NN_AXIS_N, i, i + 1, 1);
        nn_value x = nn_concat(g, NN_AXIS_C, 3, (nn_value[]){base, f, h});
        h = nn_add(g, h, models_residual_blocks(g, "backbone.backward", x, c, shape->global));
        x = nn_concat(g, NN_AXIS_C, 3, (nn_value[]){base, f, h});
        snprintf(name, sizeof name, "backbone.backward_rec_%d", i + 1);
        x = models_residual_blocks(g, name, x, c, shape->frame);
        h = nn_add(g, h, nn_mul(g, x, nn_slice(g, gates, NN_AXIS_N, i, i + 1, 1)));
    }
    return nn_concat(g, NN_AXIS_C, 2, (nn_value[]){base, h});
}

/* How many sigma a small step can move the guide by. */
static const double reach = 8;

/* d_i of the header, all frames under the gamma curve, moved by the flow, and the guide the last of them; 0 for the
 * guide and for what was moved into the picture from outside. */
static nn_value unlike(nn_graph *g, nn_value curved, nn_value flow) {
    const int views = nn_shape_of(g, curved).n;
    const nn_value ones = nn_affine(g, nn_slice(g, curved, NN_AXIS_C, 0, 1, 1), 0, 1);
    const nn_value first = nn_slice(g, ones, NN_AXIS_N, 0, 1, 1), inside = nn_warp(g, others(g, ones), flow, NN_ZERO);
    const nn_value d = nn_sub(g, curved, nn_slice(g, curved, NN_AXIS_N, views - 1, views, 1));
    return nn_mul(g, d, nn_concat(g, NN_AXIS_N, 2, (nn_value[]){first, inside}));
}

/* u_i of the header. */
static nn_value in_sigmas(nn_graph *g, nn_value d, nn_value sigma) {
    const nn_value limit = nn_affine(g, nn_mul(g, sigma, sigma), reach * reach, 1e-10);
    return nn_div(g, d, nn_sqrt(g, nn_add(g, nn_mul(g, d, d), limit)));
}

/* 1 up to 0.8 of white, in the gamma curve, 0 from 0.95 on. */
static nn_value unclipped(nn_graph *g, nn_value curved, nn_value white) {
    const nn_value level = nn_div(g, curved, nn_pow(g, white, 1 / gamma_curve));
    return nn_clamp(g, nn_affine(g, level, -1 / 0.15, 0.95 / 0.15), 0, 1);
}

static nn_value uncurved(nn_graph *g, nn_value y) {
    return nn_mul(g, y, nn_pow(g, nn_abs(g, y), gamma_curve - 1));
}

/* What a network adds of its own, as the camera's RAW. */
static nn_value unbalanced(nn_graph *g, const models_shape *shape, const models_inputs *in, nn_value rest) {
    return shape->balance ? nn_div(g, rest, nn_slice(g, in->balance, NN_AXIS_C, 1, 8, 2)) : rest;
}

/* sum_i map_i x_i over the frames between reference and guide, from maps {1, h, w, 4 (views - 1)} of which the first is
 * not a frame's. */
static nn_value mixture(nn_graph *g, nn_value maps, nn_value x) {
    nn_value sum = 0;
    for (int i = 1; i < nn_shape_of(g, x).n - 1; i++) {
        const nn_value map = nn_slice(g, maps, NN_AXIS_C, 4 * i, 4 * i + 4, 1);
        const nn_value part = nn_mul(g, nn_slice(g, x, NN_AXIS_N, i, i + 1, 1), map);
        sum = i == 1 ? part : nn_add(g, sum, part);
    }
    return sum;
}

/* Small steps away from the guide, 8 sigma (a_0 + sum_i m_i a_i u_i), from maps a. */
static nn_value small_steps(nn_graph *g, nn_value a, nn_value m, nn_value u, nn_value sigma) {
    const nn_value sum = nn_add(g, nn_slice(g, a, NN_AXIS_C, 0, 4, 1), mixture(g, a, nn_mul(g, m, u)));
    return nn_mul(g, sum, nn_affine(g, sigma, reach, 0));
}

/* y of the header with sigma, from maps {1, h, w, 8 (views - 1)}: a_0, a_i, c_0, c_i. */
static nn_value blend_doubt(nn_graph *g, const models_shape *shape, nn_value maps, nn_value frames, nn_value d,
                            nn_value u, const models_inputs *in) {
    const nn_value all = nn_slice(g, frames, NN_AXIS_C, 1, 8, 2), m = unclipped(g, all, in->white);
    const int views = models_views(shape), half = 4 * views - 4;
    const nn_value a = nn_slice(g, maps, NN_AXIS_C, 0, half, 1), c = nn_slice(g, maps, NN_AXIS_C, half, 2 * half, 1);
    const nn_value c_0 = unbalanced(g, shape, in, nn_slice(g, c, NN_AXIS_C, 0, 4, 1));
    const nn_value large = nn_add(g, c_0, mixture(g, c, nn_mul(g, m, d)));
    const nn_value guide = nn_slice(g, all, NN_AXIS_N, views - 1, views, 1);
    return uncurved(g, nn_add(g, guide, nn_add(g, small_steps(g, a, m, u, in->sigma), large)));
}

/* y of the header without sigma, under the gamma curve, from maps {1, h, w, 4 n + 4} of the first n views and m of all of
 * these but the reference. */
static nn_value mix_views(nn_graph *g, const models_shape *shape, nn_value maps, nn_value views, nn_value m,
                          const models_inputs *in) {
    const nn_value first = nn_slice(g, views, NN_AXIS_N, 0, 1, 1);
    const nn_value more = nn_mul(g, nn_sub(g, others(g, views), first), m);
    nn_value y = nn_mul(g, first, nn_affine(g, nn_slice(g, maps, NN_AXIS_C, 0, 4, 1), 1, 1));
    const int n = nn_shape_of(g, views).n;
    for (int i = 1; i < n; i++) {
        const bool guide = shape->guide && i == models_views(shape) - 1;
        const nn_value map = nn_slice(g, maps, NN_AXIS_C, 4 * i, 4 * i + 4, 1), share = guide ? nn_affine(g, map, 1, 1) : map;
        y = nn_add(g, y, nn_mul(g, nn_slice(g, more, NN_AXIS_N, i - 1, i, 1), share));
    }
    return nn_add(g, y, unbalanced(g, shape, in, nn_slice(g, maps, NN_AXIS_C, 4 * n, 4 * n + 4, 1)));
}

static nn_value blend(nn_graph *g, const models_shape *shape, nn_value maps, nn_value frames, const models_inputs *in) {
    const nn_value all = nn_slice(g, frames, NN_AXIS_C, 1, 8, 2), m = unclipped(g, others(g, all), others(g, in->white));
    return uncurved(g, mix_views(g, shape, maps, all, m, in));
}

/* Which part of small steps a restoration takes, and from where on a gate's opening counts (docs/model.md, "Caution"). */
static const double cautious_step = 0.5, cautious_opening = 0.4;

/* y of the header with a gate, from maps {1, h, w, 8 views}: a_0, a_i; those of the frames' own blend; t. `alone`: as it
 * is trained; NULL: cautious. */
static nn_value blend_gate(nn_graph *g, const models_shape *shape, nn_value maps, nn_value frames, nn_value u,
                           const models_inputs *in, nn_value *alone) {
    const nn_value all = nn_slice(g, frames, NN_AXIS_C, 1, 8, 2), m = unclipped(g, all, in->white);
    const int views = models_views(shape), n = views - 1;
    const nn_value a = nn_slice(g, maps, NN_AXIS_C, 0, 4 * n, 1), b = nn_slice(g, maps, NN_AXIS_C, 4 * n, 8 * n + 4, 1);
    nn_value t = nn_slice(g, maps, NN_AXIS_C, 8 * n + 4, 8 * views, 1), step = small_steps(g, a, m, u, in->sigma);
    if (alone == NULL) {
        const double rest = 1 - cautious_opening;
        t = nn_clamp(g, nn_affine(g, t, 1 / rest, -cautious_opening / rest), 0, 1);
        step = nn_affine(g, step, cautious_step, 0);
    }
    const nn_value guide = nn_slice(g, all, NN_AXIS_N, n, views, 1), merged = nn_add(g, guide, step);
    const nn_value own = mix_views(g, shape, b, nn_slice(g, all, NN_AXIS_N, 0, n, 1), nn_slice(g, m, NN_AXIS_N, 1, n, 1), in);
    if (alone != NULL) {
        *alone = uncurved(g, own);
    }
    return uncurved(g, nn_add(g, merged, nn_mul(g, t, nn_sub(g, own, merged))));
}

/* What would otherwise be noticed somewhere inside, or not at all. */
static bool fits(nn_graph *g, const models_shape *shape, const models_inputs *in) {
    const nn_shape s = nn_shape_of(g, in->frames), flow = nn_shape_of(g, in->flow);
    const int by = shape->unshuffle;
    if (s.n != models_views(shape) || s.c != 8) {
        nn_reject(g, "%d frames of %d channels; the network takes %d of 8", s.n, s.c, models_views(shape));
    } else if (s.h % by != 0 || s.w % by != 0) {
        nn_reject(g, "a picture of %d x %d; the network takes multiples of %d", s.w, s.h, by);
    } else if (shape->balance && in->balance == 0) {
        nn_reject(g, "no white balance, which the network takes");
    } else if (shape->sigma && !(shape->guide && shape->blend && shape->groups == 0 && in->sigma != 0)) {
        nn_reject(g, "sigma without a guide, or without a blend, or with groups; it is of the guide that is blended into");
    } else if (shape->gate && !shape->sigma) {
        nn_reject(g, "a gate without sigma; it is between the guide's answer and the frames'");
    } else if (!shape->spynet && (flow.n != s.n || flow.h != s.h || flow.w != s.w || flow.c != 2)) {
        nn_reject(g, "a flow of %d x %d x %d x %d for %d frames of %d x %d", flow.n, flow.h, flow.w, flow.c, s.n, s.w,
                  s.h);
    }
    return nn_graph_error(g, NULL) == BRACE_OK;
}

static nn_value build(nn_graph *g, const models_shape *shape, const models_inputs *in, nn_value *alone) {
    if (!fits(g, shape, in)) {
        return 0;
    }
    const int by = shape->unshuffle, c = shape->channels;
    const nn_type exact = nn_type_of(g, in->frames);
    nn_value flow = in->flow;
    if (shape->spynet) {
        const nn_value seen = look(g, balanced(g, shape, in, in->frames));
        flow = models_spynet(g, repeat_first(g, seen), others(g, seen));
    }
    const nn_value flow_others = shape->spynet ? flow : others(g, flow);
    const nn_value moved = shape->groups > 0 ? in->frames : move(g, in->frames, flow_others);
    nn_value shown = balanced(g, shape, in, moved);
    nn_value d = 0, u = 0;
    if (shape->sigma) {
        nn_value doubt = in->sigma;
        doubt = shape->balance ? nn_mul(g, doubt, nn_slice(g, in->balance, NN_AXIS_C, 1, 8, 2)) : doubt;
        doubt = nn_repeat(g, nn_pow(g, doubt, 0.25), NN_AXIS_N, models_views(shape));
        d = unlike(g, nn_slice(g, moved, NN_AXIS_C, 1, 8, 2), flow_others);
        u = in_sigmas(g, d, in->sigma);
        shown = nn_concat(g, NN_AXIS_C, 3, (nn_value[]){shown, doubt, u});
    }
    const nn_value packed = unshuffle(g, shown, by);
    /* Linear as published; blends are made under the gamma curve. */
    const nn_value reference = balanced(g, shape, in, nn_slice(g, in->frames, NN_AXIS_N, 0, 1, 1));
    const nn_value first = nn_slice(g, reference, NN_AXIS_C, shape->blend ? 1 : 0, 8, 2);
    nn_value f = models_residual_blocks(g, "feat_extract", nn_cast(g, packed, nn_graph_type(g)), c, shape->extract);
    f = shape->groups > 0 ? align(g, shape, f, coarser(g, flow_others, by)) : f;
    f = shape->mscam ? models_mscam(g, shape, f, in) : f;
    f = models_residual_blocks(g, "reconstruction", aggregate(g, shape, f), c, shape->reconstruct);

    const int views = models_views(shape);
    const int result = !shape->blend ? 4 : shape->gate ? 8 * views : shape->sigma ? 8 * views - 8 : 4 * views + 4;
    f = nn_conv2d(g, nn_cast(g, unshuffle(g, first, by), nn_graph_type(g)),
                  &(nn_conv){.name = "skipup1.upsample_conv", .out = c, .kernel = 3, .pad = 1, .residual = f,
                             .init = NN_INIT_HE_FAN_IN});
    f = nn_conv2d(g, f, &(nn_conv){.name = "conv_hr", .out = c, .kernel = 3, .pad = 1, .activation = NN_LEAKY_RELU,
                                   .init = NN_INIT_UNIFORM_FAN_IN});
    f = nn_conv2d(g, f, &(nn_conv){.name = "conv_last", .out = result * by * by, .kernel = 3, .pad = 1,
                                   .f32_result = true, .zero_bias = shape->blend,
                                   .init = shape->blend ? NN_INIT_ZERO : NN_INIT_UNIFORM_FAN_IN});
    f = nn_cast(g, by == 1 ? f : nn_pixel_shuffle(g, f, by), exact);
    if (!shape->blend) {
        return shape->balance ? nn_div(g, f, nn_slice(g, in->balance, NN_AXIS_C, 0, 8, 2)) : f;
    }
    if (shape->gate) {
        return blend_gate(g, shape, f, moved, u, in, alone);
    }
    if (shape->sigma) {
        return blend_doubt(g, shape, f, moved, d, u, in);
    }
    return blend(g, shape, f, shape->groups > 0 ? move(g, in->frames, flow_others) : moved, in);
}

nn_value models_build_trained(nn_graph *g, const models_shape *shape, const models_inputs *in, nn_value *alone) {
    *alone = 0;
    return build(g, shape, in, alone);
}

nn_value models_build(nn_graph *g, const models_shape *shape, const models_inputs *in) {
    return build(g, shape, in, NULL);
}
