/* SPDX-License-Identifier: Apache-2.0 */
/* linear.c: products over the last dimension: layers (a 1x1 convolution to the kernels) and batches of two tensors. */
#include <limits.h>
#include <string.h>

#include "nn/conv.h"

nn_value nn_linear(nn_graph *g, nn_value x, const char *name, int out, bool bias, nn_init init) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    nn_shape in = nn_shape_of(g, x), result = {in.n, in.h, in.w, out};
    nn_type type = nn_type_of(g, x);
    if (out < 1 || out > 1 << 20 || (double)out * in.c > (double)(1 << 30)) {
        return nn_reject(g, "%s: a layer from %d to %d features; 1 to 1048576 are possible", name, in.c, out);
    }
    conv_attributes a = {.shape = {in.n, in.h, in.w, in.c, in.h, in.w, out, 1, 1, 0}, .types = {.in = type, .result = type, .bias = bias}};
    nn_parameter *w = nn_conv_parameter(g, name, "weight", 2, (int[]){out, in.c}, init, in.c), *b = NULL;
    if (w == NULL ||
        (bias && (b = nn_conv_parameter(g, name, "bias", 1, &out, NN_INIT_UNIFORM_FAN_IN, in.c)) == NULL)) {
        return 0;
    }
    return nn_conv_node(g, x, 0, result, w, b, &a);
}

/* ---- a b, batched: tokens are few, so plain loops ---- */

typedef struct matmul_attributes {
    bool transpose_b;
    double scale;
} matmul_attributes;

/* A matrix in a batch: element (i, j) is i row + j column, matrices are `batch` apart. */
typedef struct matrix {
    void *data;
    size_t row, column, batch;
} matrix;

/* C (+)= scale A B for each matrix of the batch: C is m x n, A is m x k. */
typedef struct product {
    matrix a, b, c;
    int m, n, k;
    double scale;
    bool add;
    nn_type type;
} product;

enum { STRIP = 64 }; /* columns of C at a time */

#define ROWS_OF(name, T, A, GET, PUT)                                                                                  \
    static void name(const product *p, size_t batch, size_t i) {                                                       \
        const T *a = (const T *)p->a.data + batch * p->a.batch + i * p->a.row;                                         \
        const T *b = (const T *)p->b.data + batch * p->b.batch;                                                        \
        T *c = (T *)p->c.data + batch * p->c.batch + i * p->c.row;                                                     \
        for (int j = 0; j < p->n; j += STRIP) {                                                                        \
            A sum[STRIP] = {0};                                                                                        \
            size_t count = p->n - j < STRIP ? (size_t)(p->n - j) : STRIP;                                              \
            for (size_t t = 0; t < (size_t)p->k; t++) {                                                                \
                A v = GET(a[t * p->a.column]);                                                                         \
                const T *line = b + t * p->b.row + (size_t)j * p->b.column;                                            \
                for (size_t o = 0; o < count; o++) {                                                                   \
                    sum[o] += v * GET(line[o * p->b.column]);                                                          \
                }                                                                                                      \
            }                                                                                                          \
            for (size_t o = 0; o < count; o++) {                                                                       \
                T *to = c + ((size_t)j + o) * p->c.column;                                                             \
                A v = (A)p->scale * sum[o];                                                                            \
                *to = PUT(p->add ? GET(*to) + v : v);                                                                  \
            }                                                                                                          \
        }                                                                                                              \
    }
#define SAME(v) (v)
ROWS_OF(row_f32, float, float, SAME, SAME)
ROWS_OF(row_f64, double, double, SAME, SAME)
ROWS_OF(row_bf16, uint16_t, float, nn_from_bf16, nn_to_bf16)

static void product_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const product *p = arg;
    for (size_t row = begin; row < end; row++) {
        size_t batch = row / (size_t)p->m, i = row % (size_t)p->m;
        switch (p->type) {
        case NN_F32:
            row_f32(p, batch, i);
            break;
        case NN_F64:
            row_f64(p, batch, i);
            break;
        case NN_BF16:
            row_bf16(p, batch, i);
            break;
        }
    }
}

static matrix rows_of(const nn_view *v) {
    return (matrix){v->data, (size_t)v->shape.c, 1, (size_t)v->shape.w * (size_t)v->shape.c};
}

static matrix turned(matrix m) {
    return (matrix){m.data, m.column, m.row, m.batch};
}

static void multiply(const nn_call *call, matrix a, matrix b, matrix c, int m, int n, int k, bool add) {
    const matmul_attributes *attributes = call->attributes;
    product p = {a, b, c, m, n, k, attributes->scale, add, call->in[0].type};
    size_t rows = (size_t)call->in[0].shape.n * (size_t)call->in[0].shape.h * (size_t)m;
    core_parallel(call->pool, rows, 1 + 4096 / ((size_t)n * (size_t)k), product_rows, &p);
}

static void matmul_forward(nn_call *call) {
    const matmul_attributes *attributes = call->attributes;
    matrix b = rows_of(&call->in[1]);
    multiply(call, rows_of(&call->in[0]), attributes->transpose_b ? turned(b) : b, rows_of(&call->out),
             call->out.shape.w, call->out.shape.c, call->in[0].shape.c, false);
}

/* da = dc b^T, db = a^T dc; where b came transposed, so does its gradient: dc^T a. */
static void matmul_backward(nn_call *call) {
    const matmul_attributes *attributes = call->attributes;
    int m = call->dout.shape.w, n = call->dout.shape.c, k = call->in[0].shape.c;
    matrix a = rows_of(&call->in[0]), b = rows_of(&call->in[1]), dc = rows_of(&call->dout);
    if (call->din[0].data != NULL) {
        multiply(call, dc, attributes->transpose_b ? b : turned(b), rows_of(&call->din[0]), m, k, n, call->add[0]);
    }
    if (call->din[1].data != NULL && attributes->transpose_b) {
        multiply(call, turned(dc), a, rows_of(&call->din[1]), n, k, m, call->add[1]);
    } else if (call->din[1].data != NULL) {
        multiply(call, turned(a), dc, rows_of(&call->din[1]), k, n, m, call->add[1]);
    }
}

static double matmul_flops(const nn_call *call) {
    return 2.0 * (double)nn_count(call->out.shape) * call->in[0].shape.c;
}

static const nn_op op_matmul = {.name = "matmul",
                                .keeps = NN_KEEP_IN0 | NN_KEEP_IN1,
                                .forward = matmul_forward,
                                .backward = matmul_backward,
                                .flops = matmul_flops};

nn_value nn_matmul(nn_graph *g, nn_value a, nn_value b, bool transpose_b, double scale) {
    if (!nn_usable(g, a) || !nn_usable(g, b)) {
        return 0;
    }
    nn_shape x = nn_shape_of(g, a), y = nn_shape_of(g, b);
    int inner = transpose_b ? y.c : y.w, out = transpose_b ? y.w : y.c;
    if (x.n != y.n || x.h != y.h || x.c != inner || nn_type_of(g, a) != nn_type_of(g, b)) {
        return nn_reject(g, "product of {%d, %d, %d, %d} and %s{%d, %d, %d, %d}%s", x.n, x.h, x.w, x.c,
                         transpose_b ? "transposed " : "", y.n, y.h, y.w, y.c,
                         nn_type_of(g, a) != nn_type_of(g, b) ? " of another type" : ": the shapes do not fit");
    }
    matmul_attributes attributes = {transpose_b, scale};
    return nn_node_add(g, &(nn_node_params){
                              .op = &op_matmul,
                              .inputs = 2,
                              .in = (nn_value[]){a, b},
                              .shape = {x.n, x.h, x.w, out},
                              .type = nn_type_of(g, a),
                              .attributes = &attributes,
                              .attributes_size = sizeof attributes,
                          });
}
