/* SPDX-License-Identifier: Apache-2.0 */
/*
 * rows.h: the inner loops, over contiguous numbers, compiled for each instruction
 * set (rows.c, rows_avx2.c, rows_avx512.c) and for each type of storage.
 *
 * A "T" is a number as it is computed with: double for NN_F64, else float. An "S" is
 * one as it is stored: T, or bf16. Pointers are void where the type depends on the
 * table. Rows may be the same memory as the result where both are T.
 */
#ifndef NN_ROWS_H
#define NN_ROWS_H

#include "nn/node.h"

typedef enum nn_binary_kind { NN_ADD, NN_SUB, NN_MUL, NN_DIV } nn_binary_kind;

typedef enum nn_unary_kind {
    NN_AFFINE, /* p x + q */
    NN_CLAMP,  /* to [p, q] */
    NN_POW,    /* x^p */
    NN_SQRT,
    NN_LOG,
    NN_EXP,
    NN_ABS,
    NN_UNARY_RELU,
    NN_UNARY_LEAKY,
    NN_UNARY_SIGMOID,
    NN_UNARY_TANH,
    NN_COPY
} nn_unary_kind;

/* One offset group of a deformable convolution (deform.c): `parts` parts of c channels, from part `first`. */
typedef struct nn_taps {
    int h, w, dilation;
    size_t channels; /* of a pixel */
    size_t c, first, parts;
    size_t wide, k; /* channels, and numbers of a row of columns, of a weight group */
    size_t column;  /* where the first tap of the first part begins in a row of columns */
} nn_taps;

/* Where a tap of a part begins there. */
static inline size_t nn_taps_column(const nn_taps *p, size_t part, int tap) {
    if (part == 0) {
        return p->column + (size_t)tap * p->wide;
    }
    const size_t channel = (p->first + part) * p->c;
    return channel / p->wide * p->k + (size_t)tap * p->wide + channel % p->wide;
}

typedef struct nn_rows {
    size_t s_size, t_size;

    void (*load)(const void *s, void *t, size_t n);
    void (*store)(const void *t, void *s, size_t n);
    void (*store_add)(const void *t, void *s, size_t n); /* s += t */
    void (*add_s)(const void *from, void *to, size_t n); /* S: to += from */

    /* T. */
    void (*binary)(nn_binary_kind kind, const void *a, const void *b, void *out, size_t n);
    /* g times d out/d a (which = 0) or d out/d b (1). */
    void (*binary_grad)(nn_binary_kind kind, int which, const void *g, const void *a, const void *b, void *out,
                        size_t n);
    void (*unary)(nn_unary_kind kind, double p, double q, const void *x, void *y, size_t n);
    void (*unary_grad)(nn_unary_kind kind, double p, double q, const void *g, const void *x, const void *y, void *out,
                       size_t n);
    double (*sum)(const void *x, size_t n);
    void (*sum_to)(double *sums, const void *x, size_t n);
    /* c (m x n, T) = or += a (m x k; rows a_row, columns a_column apart) b (k x n; rows b_row apart). */
    void (*product)(size_t m, size_t n, size_t k, const void *a, size_t a_row, size_t a_column, const void *b,
                    size_t b_row, void *c, size_t c_row, bool add);

    /* S: out = or += the sum of rows by weights. */
    void (*blend)(const void *const *rows, const double *weights, int count, void *out, size_t n, bool add);
    /* The same, the result being T. */
    void (*blend_t)(const void *const *rows, const double *weights, int count, void *t, size_t n);
    /* T: to += weight from (S). */
    void (*add_weighted)(double weight, const void *s, void *t, size_t n);
    void (*add_weighted_t)(double weight, const void *from, void *t, size_t n); /* from: T */
    double (*dot)(const void *s, const void *s2, size_t n);
    double (*dot_t)(const void *t, const void *s, size_t n);
    /* The nine taps at (y, x), with offsets (18 T) and masks (9 T), of a picture (S): to columns (T); and backward. */
    void (*taps_sample)(const nn_taps *p, const void *picture, const void *offset, const void *mask, double y, double x,
                        void *columns);
    void (*taps_back)(const nn_taps *p, const void *picture, const void *offset, const void *mask, double y, double x,
                      const void *columns, void *sums, void *d_offset, void *d_mask);
    void (*maximum)(const void *s, void *t, int32_t *where, int32_t place, size_t n); /* keeps the larger; NaN wins */
} nn_rows;

extern const nn_rows nn_rows_plain[3], nn_rows_avx2[3], nn_rows_avx512[3]; /* by nn_type */
const nn_rows *nn_rows_of(nn_type type);

/* By double, for what is not worth more (rows.c). */
void nn_load_double(nn_type type, const void *from, double *to, size_t n);
void nn_store_double(nn_type type, const double *from, void *to, size_t n, bool add);

#endif
