/* SPDX-License-Identifier: Apache-2.0 */
/* cases.c: the operations on small tensors of awkward sizes. */
#include "nn_test.h"

#include <math.h>

double test_number(uint64_t seed, uint32_t tensor, size_t index, double low, double high) {
    core_random r = core_random_create(seed, tensor, (uint32_t)index, 7);
    return core_random_range(&r, low, high);
}

void test_ok(brace_status status, const brace_error *error) {
    if (status != BRACE_OK) {
        fail_msg("%s", error->message);
    }
}

double test_get(const void *data, nn_type type, size_t i) {
    return type == NN_F64    ? ((const double *)data)[i]
           : type == NN_BF16 ? (double)nn_from_bf16(((const uint16_t *)data)[i])
                             : (double)((const float *)data)[i];
}

void test_set(void *data, nn_type type, size_t i, double value) {
    if (type == NN_F64) {
        ((double *)data)[i] = value;
    } else if (type == NN_BF16) {
        ((uint16_t *)data)[i] = nn_to_bf16((float)value);
    } else {
        ((float *)data)[i] = (float)value;
    }
}

void test_fill(nn_graph *g, nn_value v, uint64_t seed, uint32_t tensor, double low, double high) {
    for (size_t i = 0; i < nn_count(nn_shape_of(g, v)); i++) {
        test_set(nn_data(g, v), nn_type_of(g, v), i, test_number(seed, tensor, i, low, high));
    }
}

#define CASE(name) static nn_value name(nn_graph *g, const nn_value *x)
CASE(add) { return nn_add(g, x[0], x[1]); }
CASE(sub) { return nn_sub(g, x[0], x[1]); }
CASE(mul) { return nn_mul(g, x[0], x[1]); }
CASE(divide) { return nn_div(g, x[0], x[1]); }
CASE(square) { return nn_mul(g, x[0], x[0]); }
CASE(twice) { return nn_add(g, x[0], x[0]); }
CASE(zero) { return nn_sub(g, nn_mul(g, x[0], x[0]), x[0]); }
CASE(affine) { return nn_affine(g, x[0], -1.5, 0.25); }
CASE(clamp) { return nn_clamp(g, x[0], -0.4, 0.7); }
CASE(power) { return nn_pow(g, x[0], 1 / 2.2); }
CASE(root) { return nn_sqrt(g, x[0]); }
CASE(logarithm) { return nn_log(g, x[0]); }
CASE(exponential) { return nn_exp(g, x[0]); }
CASE(absolute) { return nn_abs(g, x[0]); }
CASE(relu) { return nn_activate(g, x[0], NN_RELU); }
CASE(leaky) { return nn_activate(g, x[0], NN_LEAKY_RELU); }
CASE(sigmoid) { return nn_activate(g, x[0], NN_SIGMOID); }
CASE(tangent) { return nn_activate(g, x[0], NN_TANH); }
CASE(softmax) { return nn_softmax(g, x[0]); }
CASE(l2_normalize) { return nn_l2_normalize(g, x[0], 1e-10); }
CASE(concat_c) { return nn_concat(g, NN_AXIS_C, 3, x); }
CASE(concat_h) { return nn_concat(g, NN_AXIS_H, 2, x); }
CASE(concat_same) { return nn_concat(g, NN_AXIS_W, 2, (const nn_value[]){x[0], x[0]}); }
CASE(slice_c) { return nn_slice(g, x[0], NN_AXIS_C, 1, 6, 2); }
CASE(slice_n) { return nn_slice(g, x[0], NN_AXIS_N, 1, 3, 1); }
CASE(slices) {
    return nn_mul(g, nn_slice(g, x[0], NN_AXIS_W, 0, 4, 1), nn_slice(g, x[0], NN_AXIS_W, 1, 5, 1));
}
CASE(repeat_n) { return nn_repeat(g, x[0], NN_AXIS_N, 3); }
CASE(repeat_c) { return nn_repeat(g, x[0], NN_AXIS_C, 2); }
CASE(flip_w) { return nn_flip(g, x[0], NN_AXIS_W); }
CASE(flip_c) { return nn_flip(g, x[0], NN_AXIS_C); }
CASE(roll_h) { return nn_roll(g, x[0], NN_AXIS_H, 2); }
CASE(roll_c) { return nn_roll(g, x[0], NN_AXIS_C, -1); }
CASE(permute) { return nn_permute(g, x[0], (const nn_axis[]){NN_AXIS_C, NN_AXIS_N, NN_AXIS_W, NN_AXIS_H}); }
CASE(reshape) { return nn_reshape(g, x[0], (nn_shape){5, 1, 6, 4}); }
CASE(reshape_used_twice) {
    const nn_shape flat = {1, 1, 24, 5};
    return nn_add(g, nn_reshape(g, x[0], flat), nn_reshape(g, nn_activate(g, x[0], NN_TANH), flat));
}
CASE(pad_zero) { return nn_pad(g, x[0], 1, 2, 0, 3, NN_ZERO); }
CASE(pad_reflect) { return nn_pad(g, x[0], 2, 1, 3, 2, NN_REFLECT); }
CASE(pad_replicate) { return nn_pad(g, x[0], 1, 3, 2, 4, NN_REPLICATE); }
CASE(shuffle) { return nn_pixel_shuffle(g, x[0], 2); }
CASE(unshuffle) { return nn_pixel_unshuffle(g, x[0], 2); }
CASE(average) { return nn_average_pool(g, x[0], 2, 2); }
CASE(average_3_2) { return nn_average_pool(g, x[0], 3, 2); }
CASE(adaptive) { return nn_adaptive_average_pool(g, x[0], 3, 2); }
CASE(adaptive_up) { return nn_adaptive_average_pool(g, x[0], 9, 4); }
CASE(max_2_2) { return nn_max_pool(g, x[0], 2, 2, false); }
CASE(max_3_2) { return nn_max_pool(g, x[0], 3, 2, false); }
CASE(max_3_2_ceil) { return nn_max_pool(g, x[0], 3, 2, true); }
CASE(resize_up) { return nn_resize(g, x[0], 9, 11, false); }
CASE(resize_up_aligned) { return nn_resize(g, x[0], 10, 12, true); }
CASE(resize_down) { return nn_resize(g, x[0], 3, 2, false); }
CASE(resize_one) { return nn_resize(g, x[0], 1, 1, true); }
CASE(haar) { return nn_haar(g, x[0]); }
CASE(warp_zero) { return nn_warp(g, x[0], nn_affine(g, x[1], 3, 0), NN_ZERO); }
CASE(warp_edge) { return nn_warp(g, x[0], nn_affine(g, x[1], 3, 0), NN_REPLICATE); }
static nn_value deform(nn_graph *g, const nn_value *x, int out, int pad, int dilation, int offset_groups, int groups) {
    return nn_deform_conv2d(g, x[0], nn_affine(g, x[1], 2, 0), x[2],
                            &(nn_deform){.name = "dcn",
                                         .out = out,
                                         .pad = pad,
                                         .dilation = dilation,
                                         .offset_groups = offset_groups,
                                         .weight_groups = groups,
                                         .init = NN_INIT_UNIFORM_FAN_IN});
}
CASE(deform_plain) { return deform(g, x, 3, 1, 1, 1, 1); }
CASE(deform_groups) { return deform(g, x, 6, 1, 1, 2, 2); }
CASE(deform_offsets) { return deform(g, x, 5, 2, 2, 4, 1); }
CASE(deform_weights) { return deform(g, x, 4, 0, 1, 1, 2); }
CASE(sum_all) { return nn_sum(g, x[0], true, true, true, true); }
CASE(sum_c) { return nn_sum(g, x[0], false, false, false, true); }
CASE(mean_hw) { return nn_mean(g, x[0], false, true, true, false); }
CASE(mean_n) { return nn_mean(g, x[0], true, false, false, false); }
CASE(mean_hc) { return nn_mean(g, x[0], false, true, false, true); }
CASE(mean_nw) { return nn_mean(g, x[0], true, false, true, false); }
CASE(variance_hw) { return nn_var(g, x[0], false, true, true, false); }
CASE(variance_n) { return nn_var(g, x[0], true, false, false, false); }
CASE(sort_w) { return nn_sort(g, x[0], NN_AXIS_W); }
CASE(sort_c) { return nn_sort(g, x[0], NN_AXIS_C); }
CASE(l1) { return nn_l1(g, x[0], x[1]); }
static nn_value conv(nn_graph *g, nn_value x, int out, int kernel, int stride, nn_value residual, nn_activation act) {
    return nn_conv2d(g, x, &(nn_conv){.name = "conv",
                                      .out = out,
                                      .kernel = kernel,
                                      .stride = stride,
                                      .pad = kernel / 2,
                                      .activation = act,
                                      .residual = residual,
                                      .init = NN_INIT_UNIFORM_FAN_IN});
}
CASE(conv_3) { return conv(g, x[0], 6, 3, 1, 0, NN_LEAKY_RELU); }
CASE(conv_1) { return conv(g, x[0], 3, 1, 1, 0, NN_SIGMOID); }
CASE(conv_7_2) { return conv(g, x[0], 2, 7, 2, 0, NN_LINEAR); }
CASE(conv_residual) { return conv(g, x[0], 4, 3, 1, x[1], NN_TANH); }
CASE(conv_residual_self) { return conv(g, x[0], 5, 3, 1, x[0], NN_LINEAR); }
CASE(filter) {
    const float taps[9] = {0.0625f, 0.125f, 0.0625f, 0.125f, 0.25f, 0.125f, 0.0625f, 0.125f, 0.0625f};
    return nn_filter(g, x[0], 3, 2, 1, taps);
}
CASE(linear) { return nn_linear(g, x[0], "fc", 3, true, NN_INIT_UNIFORM_FAN_IN); }
CASE(matmul) { return nn_matmul(g, x[0], x[1], false, 0.5); }
CASE(matmul_turned) { return nn_matmul(g, x[0], x[1], true, 2); }
CASE(parameter) {
    const nn_value p = nn_param(g, "scale", (nn_shape){1, 1, 1, 5}, 3, (const int[]){5, 1, 1}, NN_INIT_UNIFORM_FAN_IN);
    return nn_mul(g, x[0], p);
}

/* Two frames; the second is aligned to the first by warp and deformable convolution; attention; upsampling. As
 * `network` in make_vectors.py. */
static nn_value conv_named(nn_graph *g, nn_value x, const char *name, int out, nn_activation act, nn_value residual,
                           bool f32_result) {
    return nn_conv2d(g, x, &(nn_conv){.name = name,
                                      .out = out,
                                      .kernel = 3,
                                      .pad = 1,
                                      .activation = act,
                                      .residual = residual,
                                      .f32_result = f32_result,
                                      .init = NN_INIT_UNIFORM_FAN_IN});
}
CASE(network) {
    nn_value f = conv_named(g, x[0], "conv1", 8, NN_LEAKY_RELU, 0, false);
    nn_push(g, "block");
    nn_recompute_begin(g);
    f = conv_named(g, conv_named(g, f, "conv1", 8, NN_RELU, 0, false), "conv2", 8, NN_LINEAR, f, false);
    nn_recompute_end(g);
    nn_pop(g);
    const nn_value base = nn_slice(g, f, NN_AXIS_N, 0, 1, 1), other = nn_slice(g, f, NN_AXIS_N, 1, 2, 1);
    nn_value parts[2] = {base, nn_warp(g, other, x[1], NN_ZERO)};
    const nn_value o = conv_named(g, nn_concat(g, NN_AXIS_C, 2, parts), "offset", 54, NN_LINEAR, 0, true);
    const nn_value flow = nn_repeat(g, nn_flip(g, x[1], NN_AXIS_C), NN_AXIS_C, 18);
    const nn_value offset =
        nn_add(g, nn_affine(g, nn_activate(g, nn_slice(g, o, NN_AXIS_C, 0, 36, 1), NN_TANH), 2, 0), flow);
    const nn_value mask = nn_activate(g, nn_slice(g, o, NN_AXIS_C, 36, 54, 1), NN_SIGMOID);
    parts[1] = nn_deform_conv2d(g, other, offset, mask,
                                &(nn_deform){.name = "dcn",
                                             .out = 8,
                                             .pad = 1,
                                             .dilation = 1,
                                             .offset_groups = 2,
                                             .weight_groups = 2,
                                             .init = NN_INIT_UNIFORM_FAN_IN});
    const nn_value both = nn_concat(g, NN_AXIS_N, 2, parts);
    nn_push(g, "attention");
    const nn_value tokens =
        nn_reshape(g, nn_mean(g, nn_average_pool(g, both, 2, 2), false, true, true, false), (nn_shape){1, 1, 2, 8});
    const nn_value q = nn_linear(g, tokens, "q", 8, true, NN_INIT_UNIFORM_FAN_IN),
                   k = nn_linear(g, tokens, "k", 8, true, NN_INIT_UNIFORM_FAN_IN),
                   v = nn_linear(g, tokens, "v", 8, true, NN_INIT_UNIFORM_FAN_IN);
    const nn_value a = nn_matmul(g, nn_softmax(g, nn_matmul(g, q, k, true, 1 / sqrt(8))), v, false, 1);
    nn_pop(g);
    const nn_value weight = nn_activate(g, nn_reshape(g, a, (nn_shape){2, 1, 1, 8}), NN_SIGMOID);
    const nn_value fused = nn_mean(g, nn_mul(g, both, weight), true, false, false, false);
    nn_value up = nn_pixel_shuffle(g, conv_named(g, fused, "tail", 8, NN_LINEAR, 0, false), 2);
    const nn_value first = nn_slice(g, nn_slice(g, x[0], NN_AXIS_N, 0, 1, 1), NN_AXIS_C, 0, 2, 1);
    up = nn_add(g, up, nn_resize(g, first, 12, 16, false));
    return nn_affine(g, nn_log(g, nn_affine(g, nn_clamp(g, up, 0, 2), 50, 1)), 1 / log(51), 0);
}

#define X {2, 3, 4, 5}
const op_case op_cases[] = {
    {"add", {X, X}, -1, 1, add},
    {"add_channels", {X, {1, 1, 1, 5}}, -1, 1, add},
    {"add_space", {X, {1, 3, 4, 1}}, -1, 1, add},
    {"add_frames", {{1, 3, 4, 5}, {2, 1, 1, 1}}, -1, 1, add},
    {"sub", {X, {2, 1, 4, 1}}, -1, 1, sub},
    {"sub_both_ways", {{1, 3, 1, 5}, {2, 1, 4, 1}}, -1, 1, sub},
    {"mul", {X, X}, -1, 1, mul},
    {"mul_channels", {X, {2, 1, 1, 5}}, -1, 1, mul},
    {"mul_frames", {X, {1, 3, 4, 5}}, -1, 1, mul},
    {"mul_number", {{1, 1, 1, 1}, X}, -1, 1, mul},
    {"div", {X, X}, 0.5, 2, divide},
    {"div_space", {X, {2, 3, 4, 1}}, 0.5, 2, divide},
    {"square", {X}, -1, 1, square},
    {"twice", {X}, -1, 1, twice},
    {"zero", {X}, -1, 1, zero},
    {"affine", {X}, -1, 1, affine},
    {"clamp", {X}, -1, 1, clamp},
    {"pow", {X}, 0.1, 2, power},
    {"sqrt", {X}, 0.1, 2, root},
    {"log", {X}, 0.1, 2, logarithm},
    {"exp", {X}, -2, 2, exponential},
    {"abs", {X}, -1, 1, absolute},
    {"relu", {X}, -1, 1, relu},
    {"leaky_relu", {X}, -1, 1, leaky},
    {"sigmoid", {X}, -4, 4, sigmoid},
    {"tanh", {X}, -2, 2, tangent},
    {"softmax", {X}, -3, 3, softmax},
    {"softmax_one", {{2, 3, 1, 1}}, -3, 3, softmax},
    {"l2_normalize", {X}, -1, 1, l2_normalize},
    {"concat_c", {{2, 3, 4, 1}, X, {2, 3, 4, 3}}, -1, 1, concat_c},
    {"concat_h", {X, {2, 1, 4, 5}}, -1, 1, concat_h},
    {"concat_same", {X}, -1, 1, concat_same},
    {"slice_c", {{2, 3, 2, 7}}, -1, 1, slice_c},
    {"slice_n", {{3, 2, 3, 2}}, -1, 1, slice_n},
    {"slices", {{2, 2, 5, 3}}, -1, 1, slices},
    {"repeat_n", {{1, 3, 4, 2}}, -1, 1, repeat_n},
    {"repeat_c", {{2, 2, 3, 3}}, -1, 1, repeat_c},
    {"flip_w", {X}, -1, 1, flip_w},
    {"flip_c", {X}, -1, 1, flip_c},
    {"roll_h", {X}, -1, 1, roll_h},
    {"roll_c", {X}, -1, 1, roll_c},
    {"permute", {X}, -1, 1, permute},
    {"reshape", {X}, -1, 1, reshape},
    {"reshape_used_twice", {X}, -1, 1, reshape_used_twice},
    {"pad_zero", {X}, -1, 1, pad_zero},
    {"pad_reflect", {{2, 3, 4, 2}}, -1, 1, pad_reflect},
    {"pad_replicate", {{2, 3, 1, 2}}, -1, 1, pad_replicate},
    {"pixel_shuffle", {{2, 3, 2, 8}}, -1, 1, shuffle},
    {"pixel_unshuffle", {{2, 2, 6, 3}}, -1, 1, unshuffle},
    {"average_pool", {{2, 5, 4, 3}}, -1, 1, average},
    {"average_pool_3_2", {{1, 7, 8, 2}}, -1, 1, average_3_2},
    {"adaptive_average_pool", {{2, 7, 5, 3}}, -1, 1, adaptive},
    {"adaptive_average_pool_up", {{1, 4, 3, 2}}, -1, 1, adaptive_up},
    {"max_pool_2_2", {{2, 5, 4, 3}}, -1, 1, max_2_2},
    {"max_pool_3_2", {{1, 7, 8, 3}}, -1, 1, max_3_2},
    {"max_pool_3_2_ceil", {{1, 8, 6, 3}}, -1, 1, max_3_2_ceil},
    {"resize_up", {{2, 4, 5, 3}}, -1, 1, resize_up},
    {"resize_up_aligned", {{1, 5, 6, 3}}, -1, 1, resize_up_aligned},
    {"resize_down", {{2, 7, 5, 2}}, -1, 1, resize_down},
    {"resize_one", {{1, 4, 3, 2}}, -1, 1, resize_one},
    {"haar", {{2, 4, 6, 3}}, -1, 1, haar},
    {"warp_zero", {{2, 5, 6, 5}, {2, 5, 6, 2}}, -1, 1, warp_zero},
    {"warp_edge", {{2, 5, 6, 5}, {2, 5, 6, 2}}, -1, 1, warp_edge},
    {"deform_plain", {{1, 4, 5, 2}, {1, 4, 5, 18}, {1, 4, 5, 9}}, -1, 1, deform_plain},
    {"deform_groups", {{2, 4, 3, 4}, {2, 4, 3, 36}, {2, 4, 3, 18}}, -1, 1, deform_groups},
    {"deform_offsets", {{1, 4, 4, 8}, {1, 4, 4, 72}, {1, 4, 4, 36}}, -1, 1, deform_offsets},
    {"deform_weights", {{1, 5, 4, 4}, {1, 3, 2, 18}, {1, 3, 2, 9}}, -1, 1, deform_weights},
    {"sum_all", {X}, -1, 1, sum_all},
    {"sum_c", {X}, -1, 1, sum_c},
    {"mean_hw", {X}, -1, 1, mean_hw},
    {"mean_n", {X}, -1, 1, mean_n},
    {"mean_hc", {X}, -1, 1, mean_hc},
    {"mean_nw", {X}, -1, 1, mean_nw},
    {"var_hw", {X}, -1, 1, variance_hw},
    {"var_n", {X}, -1, 1, variance_n},
    {"sort_w", {X}, -1, 1, sort_w},
    {"sort_c", {{2, 2, 3, 9}}, -1, 1, sort_c},
    {"l1", {X, X}, -1, 1, l1},
    {"conv_3", {{2, 4, 5, 3}}, -1, 1, conv_3},
    {"conv_1", {{1, 3, 4, 5}}, -1, 1, conv_1},
    {"conv_7_2", {{1, 7, 6, 2}}, -1, 1, conv_7_2},
    {"conv_residual", {{1, 4, 3, 2}, {1, 4, 3, 4}}, -1, 1, conv_residual},
    {"conv_residual_self", {X}, -1, 1, conv_residual_self},
    {"filter", {{2, 5, 6, 3}}, -1, 1, filter},
    {"linear", {X}, -1, 1, linear},
    {"matmul", {X, {2, 3, 5, 2}}, -1, 1, matmul},
    {"matmul_turned", {X, {2, 3, 2, 5}}, -1, 1, matmul_turned},
    {"param", {X}, -1, 1, parameter},
    {"network", {{2, 6, 8, 4}, {1, 6, 8, 2}}, 0, 1.3, network},
};
const size_t op_case_count = sizeof op_cases / sizeof op_cases[0];
