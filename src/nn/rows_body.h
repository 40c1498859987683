/* SPDX-License-Identifier: Apache-2.0 */
/* rows_body.h: the three tables of an instruction set, named NN_ROWS by the file that includes this. */
#include <math.h>
#include <string.h>

#include "nn/rows.h"

/* Each number is read before its place is written, and no place is read again: vectors may be used although the result
 * may be the input. */
#if defined(__clang__)
#pragma clang diagnostic ignored "-Wpass-failed" /* some call the mathematics library, and cannot be vectors */
#define NN_LOOP _Pragma("clang loop vectorize(assume_safety)")
#else
#define NN_LOOP _Pragma("GCC ivdep")
#endif

/* exp(x) = 2^k (1 + e(r)), x = k ln 2 + r, |r| <= ln 2/2, e by its power series: less than two units in the last place.
 * Selects instead of branches, so that it becomes vectors. */
typedef struct exp_parts {
    float e, a, b; /* exp(x) = a b (1 + e): 2^k in two halves, since 2^128 is no float */
} exp_parts;

static inline exp_parts split_exp(float x) {
    const float top = x < 88.7228f ? x : 88.7228f, clamped = top > -87.3f ? top : -87.3f;
    const float shifted = clamped * 1.44269504f + 12582912.0f; /* 1.5 2^23: rounds to a whole number */
    const float k = shifted - 12582912.0f;
    const float r = (clamped - k * 0.693359375f) + k * 2.12194440e-4f; /* ln 2 in two parts, the first of ten bits */
    float e = 1.0f / 5040;
    e = e * r + 1.0f / 720;
    e = e * r + 1.0f / 120;
    e = e * r + 1.0f / 24;
    e = e * r + 1.0f / 6;
    e = e * r + 0.5f;
    e = e * r * r + r;
    const int whole = (int)k, half = whole / 2;
    union {
        int32_t i;
        float f;
    } a = {(half + 127) * 8388608}, b = {(whole - half + 127) * 8388608};
    return (exp_parts){e, a.f, b.f};
}

static inline float exp_float(float x) {
    const exp_parts p = split_exp(x);
    const float y = (p.a + p.a * p.e) * p.b;
    return x != x ? x : x > 88.7228f ? INFINITY : x < -87.3f ? 0 : y;
}

/* For |x| <= 87; accurate near 0, where exp(x) - 1 is not. */
static inline float expm1_float(float x) {
    const exp_parts p = split_exp(x);
    return (p.a * p.e) * p.b + (p.a * p.b - 1);
}

static inline float tanh_float(float x) {
    const float e = expm1_float(2 * (x > 10 ? 10 : x < -10 ? -10 : x));
    return x != x ? x : e / (e + 2);
}

static inline float sigmoid_float(float x) {
    const float e = expm1_float(-(x > 87 ? 87 : x < -87 ? -87 : x));
    return x != x ? x : 1 / (e + 2);
}

static inline double sigmoid_double(double x) {
    return 1 / (1 + exp(-x));
}

static inline float same_float(float x) {
    return x;
}
static inline double same_double(double x) {
    return x;
}

#define S float
#define T float
#define NAME(x) x##_f32
#define LOAD same_float
#define STORE same_float
#define EXP exp_float
#define TANH tanh_float
#define SIGMOID sigmoid_float
#define M(x) x##f
#include "nn/rows_typed.h"
#undef S
#undef NAME
#undef LOAD
#undef STORE

#define S uint16_t
#define NAME(x) x##_bf16
#define LOAD nn_from_bf16
#define STORE nn_to_bf16
#define NN_SAME_T f32 /* what depends on T alone is there already */
#include "nn/rows_typed.h"
#undef NN_SAME_T
#undef S
#undef T
#undef NAME
#undef LOAD
#undef STORE
#undef EXP
#undef TANH
#undef SIGMOID
#undef M

#define S double
#define T double
#define NAME(x) x##_f64
#define LOAD same_double
#define STORE same_double
#define EXP exp
#define TANH tanh
#define SIGMOID sigmoid_double
#define M(x) x
#include "nn/rows_typed.h"

#define TABLE(s, t, name, tname)                                                                                       \
    {                                                                                                                  \
        .s_size = sizeof(s), .t_size = sizeof(t), .load = load_##name, .store = store_##name,                          \
        .store_add = store_add_##name, .add_s = add_s_##name, .binary = binary_##tname,                                \
        .binary_grad = binary_grad_##tname, .unary = unary_##tname, .unary_grad = unary_grad_##tname,                  \
        .sum = sum_##tname, .sum_to = sum_to_##tname, .product = product_##tname, .blend = blend_##name,               \
        .blend_t = blend_t_##name, .add_weighted = add_weighted_##name, .add_weighted_t = add_weighted_t_##tname,      \
        .dot = dot_##name, .dot_t = dot_t_##name, .maximum = maximum_##name, .taps_sample = taps_sample_##name,        \
        .taps_back = taps_back_##name                                                                                  \
    }

const nn_rows NN_ROWS[3] = {
    [NN_F32] = TABLE(float, float, f32, f32),
    [NN_BF16] = TABLE(uint16_t, float, bf16, f32),
    [NN_F64] = TABLE(double, double, f64, f64),
};
