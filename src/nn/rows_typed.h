/* SPDX-License-Identifier: Apache-2.0 */
/* rows_typed.h: the loops of rows.h for one storage type S and computing type T; included by rows_body.h only. */

static void NAME(load)(const void *from, void *to, size_t n) {
    const S *s = from;
    T *t = to;
    NN_LOOP for (size_t i = 0; i < n; i++) {
        t[i] = LOAD(s[i]);
    }
}

static void NAME(store)(const void *from, void *to, size_t n) {
    const T *t = from;
    S *s = to;
    NN_LOOP for (size_t i = 0; i < n; i++) {
        s[i] = STORE(t[i]);
    }
}

static void NAME(store_add)(const void *from, void *to, size_t n) {
    const T *t = from;
    S *s = to;
    NN_LOOP for (size_t i = 0; i < n; i++) {
        s[i] = STORE(LOAD(s[i]) + t[i]);
    }
}

static void NAME(add_s)(const void *from, void *to, size_t n) {
    const S *a = from;
    S *s = to;
    NN_LOOP for (size_t i = 0; i < n; i++) {
        s[i] = STORE(LOAD(s[i]) + LOAD(a[i]));
    }
}

/* Up to four rows at a time; more are added in turns. */
static inline void NAME(blend_four)(const void *const *rows, const double *weights, int count, T *t, size_t n,
                                    bool add) {
    const S *a = rows[0], *b = count > 1 ? rows[1] : a, *c = count > 2 ? rows[2] : a, *d = count > 3 ? rows[3] : a;
    const T wa = (T)weights[0], wb = count > 1 ? (T)weights[1] : 0, wc = count > 2 ? (T)weights[2] : 0,
            wd = count > 3 ? (T)weights[3] : 0;
    if (add) {
        NN_LOOP for (size_t i = 0; i < n; i++) {
            t[i] += (wa * LOAD(a[i]) + wb * LOAD(b[i])) + (wc * LOAD(c[i]) + wd * LOAD(d[i]));
        }
    } else {
        NN_LOOP for (size_t i = 0; i < n; i++) {
            t[i] = (wa * LOAD(a[i]) + wb * LOAD(b[i])) + (wc * LOAD(c[i]) + wd * LOAD(d[i]));
        }
    }
}

static void NAME(blend_t)(const void *const *rows, const double *weights, int count, void *t, size_t n) {
    if (count == 0) {
        memset(t, 0, n * sizeof(T));
    }
    for (int i = 0; i < count; i += 4) {
        NAME(blend_four)(rows + i, weights + i, count - i, t, n, i > 0);
    }
}

static void NAME(blend)(const void *const *rows, const double *weights, int count, void *out, size_t n, bool add) {
    T t[256];
    const void *at[64];
    S *s = out;
    for (size_t i = 0; i < n; i += 256) {
        const size_t piece = n - i < 256 ? n - i : 256;
        memset(t, 0, piece * sizeof *t);
        for (int k = 0; k < count; k += 64) {
            const int few = count - k < 64 ? count - k : 64;
            for (int j = 0; j < few; j++) {
                at[j] = (const S *)rows[k + j] + i;
            }
            for (int j = 0; j < few; j += 4) {
                NAME(blend_four)(at + j, weights + k + j, few - j, t, piece, k + j > 0);
            }
        }
        if (add) {
            NAME(store_add)(t, s + i, piece);
        } else {
            NAME(store)(t, s + i, piece);
        }
    }
}

static void NAME(add_weighted)(double weight, const void *from, void *to, size_t n) {
    const S *s = from;
    T *t = to, w = (T)weight;
    NN_LOOP for (size_t i = 0; i < n; i++) {
        t[i] += w * LOAD(s[i]);
    }
}

/* Sixteen sums side by side: a fixed order, and vectors. */
static double NAME(dot)(const void *x, const void *y, size_t n) {
    const S *a = x, *b = y;
    T part[16] = {0}, rest = 0;
    size_t i = 0;
    for (; i + 16 <= n; i += 16) {
        for (size_t j = 0; j < 16; j++) {
            part[j] += LOAD(a[i + j]) * LOAD(b[i + j]);
        }
    }
    for (; i < n; i++) {
        rest += LOAD(a[i]) * LOAD(b[i]);
    }
    for (size_t j = 0; j < 16; j++) {
        rest += part[j];
    }
    return (double)rest;
}

static double NAME(dot_t)(const void *x, const void *y, size_t n) {
    const T *a = x;
    const S *b = y;
    T part[16] = {0}, rest = 0;
    size_t i = 0;
    for (; i + 16 <= n; i += 16) {
        for (size_t j = 0; j < 16; j++) {
            part[j] += a[i + j] * LOAD(b[i + j]);
        }
    }
    for (; i < n; i++) {
        rest += a[i] * LOAD(b[i]);
    }
    for (size_t j = 0; j < 16; j++) {
        rest += part[j];
    }
    return (double)rest;
}

static void NAME(maximum)(const void *from, void *to, int32_t *where, int32_t place, size_t n) {
    const S *s = from;
    T *t = to;
    NN_LOOP for (size_t i = 0; i < n; i++) {
        const T v = LOAD(s[i]);
        const bool larger = !(v <= t[i]) && t[i] == t[i];
        t[i] = larger ? v : t[i];
        where[i] = larger ? place : where[i];
    }
}

#include "nn/rows_taps.h"

#ifndef NN_SAME_T

static void NAME(binary)(nn_binary_kind kind, const void *x, const void *y, void *z, size_t n) {
    const T *a = x, *b = y;
    T *out = z;
    switch (kind) {
    case NN_ADD:
        NN_LOOP for (size_t i = 0; i < n; i++) {
            out[i] = a[i] + b[i];
        }
        break;
    case NN_SUB:
        NN_LOOP for (size_t i = 0; i < n; i++) {
            out[i] = a[i] - b[i];
        }
        break;
    case NN_MUL:
        NN_LOOP for (size_t i = 0; i < n; i++) {
            out[i] = a[i] * b[i];
        }
        break;
    case NN_DIV:
        NN_LOOP for (size_t i = 0; i < n; i++) {
            out[i] = a[i] / b[i];
        }
        break;
    }
}

static void NAME(binary_grad)(nn_binary_kind kind, int which, const void *dz, const void *x, const void *y, void *d,
                              size_t n) {
    const T *g = dz, *a = x, *b = y;
    T *out = d;
    if (kind == NN_ADD || (kind == NN_SUB && which == 0)) {
        if (g != out) {
            memcpy(out, g, n * sizeof *out);
        }
    } else if (kind == NN_SUB) {
        NN_LOOP for (size_t i = 0; i < n; i++) {
            out[i] = -g[i];
        }
    } else if (kind == NN_MUL) {
        const T *other = which == 0 ? b : a;
        NN_LOOP for (size_t i = 0; i < n; i++) {
            out[i] = g[i] * other[i];
        }
    } else if (which == 0) {
        NN_LOOP for (size_t i = 0; i < n; i++) {
            out[i] = g[i] / b[i];
        }
    } else {
        NN_LOOP for (size_t i = 0; i < n; i++) {
            out[i] = -g[i] * (a[i] / b[i]) / b[i];
        }
    }
}

#define EACH(value)                                                                                                    \
    NN_LOOP for (size_t i = 0; i < n; i++) {                                                                           \
        const T v = x[i];                                                                                              \
        y[i] = (value);                                                                                                \
    }                                                                                                                  \
    break

static void NAME(unary)(nn_unary_kind kind, double first, double second, const void *from, void *to, size_t n) {
    const T *x = from, p = (T)first, q = (T)second;
    T *y = to;
    switch (kind) {
    case NN_AFFINE:
        EACH(v * p + q);
    case NN_CLAMP:
        EACH(v < p ? p : v > q ? q : v);
    case NN_POW:
        EACH(M(pow)(v, p));
    case NN_SQRT:
        EACH(M(sqrt)(v));
    case NN_LOG:
        EACH(M(log)(v));
    case NN_EXP:
        EACH(EXP(v));
    case NN_ABS:
        EACH(M(fabs)(v));
    case NN_UNARY_RELU:
        EACH(v < 0 ? 0 : v);
    case NN_UNARY_LEAKY:
        EACH(v < 0 ? (T)0.1 * v : v);
    case NN_UNARY_SIGMOID:
        EACH(SIGMOID(v));
    case NN_UNARY_TANH:
        EACH(TANH(v));
    case NN_COPY:
        EACH(v);
    }
}
#undef EACH

/* v: the operation's input, r: its result; one of both may be missing, as unary.c says. */
#define EACH_OF_INPUT(value)                                                                                           \
    NN_LOOP for (size_t i = 0; i < n; i++) {                                                                           \
        const T v = x[i];                                                                                              \
        d[i] = (value);                                                                                                \
    }                                                                                                                  \
    break
#define EACH_OF_RESULT(value)                                                                                          \
    NN_LOOP for (size_t i = 0; i < n; i++) {                                                                           \
        const T r = y[i];                                                                                              \
        d[i] = (value);                                                                                                \
    }                                                                                                                  \
    break

static void NAME(unary_grad)(nn_unary_kind kind, double first, double second, const void *dy, const void *from,
                             const void *result, void *to, size_t n) {
    const T *g = dy, *x = from, *y = result, p = (T)first, q = (T)second;
    T *d = to;
    switch (kind) {
    case NN_AFFINE:
        NN_LOOP for (size_t i = 0; i < n; i++) {
            d[i] = g[i] * p;
        }
        break;
    case NN_CLAMP:
        EACH_OF_INPUT(v < p || v > q ? 0 : g[i]);
    case NN_POW:
        EACH_OF_INPUT(g[i] * p * M(pow)(v, p - 1));
    case NN_SQRT:
        EACH_OF_RESULT(g[i] / (2 * r));
    case NN_LOG:
        EACH_OF_INPUT(g[i] / v);
    case NN_EXP:
        EACH_OF_RESULT(g[i] * r);
    case NN_ABS:
        EACH_OF_INPUT(v > 0 ? g[i] : v < 0 ? -g[i] : 0);
    case NN_UNARY_RELU:
        EACH_OF_RESULT(r > 0 ? g[i] : 0);
    case NN_UNARY_LEAKY:
        EACH_OF_RESULT(r > 0 ? g[i] : (T)0.1 * g[i]); /* the slope at 0 too */
    case NN_UNARY_SIGMOID:
        EACH_OF_RESULT(g[i] * r * (1 - r));
    case NN_UNARY_TANH:
        EACH_OF_RESULT(g[i] * (1 - r * r));
    case NN_COPY:
        NN_LOOP for (size_t i = 0; i < n; i++) {
            d[i] = g[i];
        }
        break;
    }
}
#undef EACH_OF_INPUT
#undef EACH_OF_RESULT

static double NAME(sum)(const void *from, size_t n) {
    const T *x = from;
    double part[16] = {0}, rest = 0;
    size_t i = 0;
    for (; i + 16 <= n; i += 16) {
        for (size_t j = 0; j < 16; j++) {
            part[j] += (double)x[i + j];
        }
    }
    for (; i < n; i++) {
        rest += (double)x[i];
    }
    for (size_t j = 0; j < 16; j++) {
        rest += part[j];
    }
    return rest;
}

static void NAME(sum_to)(double *sums, const void *from, size_t n) {
    const T *x = from;
    NN_LOOP for (size_t i = 0; i < n; i++) {
        sums[i] += (double)x[i];
    }
}

static void NAME(add_weighted_t)(double weight, const void *from, void *to, size_t n) {
    const T *s = from;
    T *t = to, w = (T)weight;
    NN_LOOP for (size_t i = 0; i < n; i++) {
        t[i] += w * s[i];
    }
}

/* Four rows by up to 32 columns in registers; inlined by force, since it is fast only where the sizes are constants. */
__attribute__((always_inline)) static inline void NAME(tile)(size_t rows, size_t columns, size_t k, const T *a,
                                                             size_t a_row, size_t a_column, const T *b, size_t b_row,
                                                             T *c, size_t c_row, bool add) {
    T sum[4][32];
    for (size_t i = 0; i < rows; i++) {
        for (size_t j = 0; j < columns; j++) {
            sum[i][j] = add ? c[i * c_row + j] : 0;
        }
    }
    for (size_t l = 0; l < k; l++) {
        for (size_t i = 0; i < rows; i++) {
            const T v = a[i * a_row + l * a_column];
            for (size_t j = 0; j < columns; j++) {
                sum[i][j] += v * b[l * b_row + j];
            }
        }
    }
    for (size_t i = 0; i < rows; i++) {
        for (size_t j = 0; j < columns; j++) {
            c[i * c_row + j] = sum[i][j];
        }
    }
}

static void NAME(product)(size_t m, size_t n, size_t k, const void *first, size_t a_row, size_t a_column,
                          const void *second, size_t b_row, void *result, size_t c_row, bool add) {
    const T *a = first, *b = second;
    T *c = result;
    for (size_t j = 0; j < n;) {
        const size_t wide = n - j >= 32 ? 32 : n - j >= 16 ? 16 : n - j >= 8 ? 8 : n - j;
        for (size_t i = 0; i < m; i += 4) {
            const size_t high = m - i < 4 ? m - i : 4;
            const T *ai = a + i * a_row;
            T *ci = c + i * c_row + j;
            /* Constants, so that the loops over the tile become registers. */
            if (high == 4 && wide == 32) {
                NAME(tile)(4, 32, k, ai, a_row, a_column, b + j, b_row, ci, c_row, add);
            } else if (high == 4 && wide == 16) {
                NAME(tile)(4, 16, k, ai, a_row, a_column, b + j, b_row, ci, c_row, add);
            } else if (high == 4 && wide == 8) {
                NAME(tile)(4, 8, k, ai, a_row, a_column, b + j, b_row, ci, c_row, add);
            } else {
                NAME(tile)(high, wide, k, ai, a_row, a_column, b + j, b_row, ci, c_row, add);
            }
        }
        j += wide;
    }
}

#endif
