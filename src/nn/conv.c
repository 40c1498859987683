/* SPDX-License-Identifier: Apache-2.0 */
/*
 * conv.c: convolution with its bias, residual and activation as one node. The
 * products are kernels/; here is what is around them: parameters, and backward as
 *
 *     dz = dy act'(y),  dresidual = dz,  dbias = sum dz,  dx = W^T dz,  dW = x dz
 */
#include "nn/conv.h"

#include <string.h>

typedef struct conv_kernel {
    const nn_method *method;
    void *state;
} conv_kernel;

static size_t round_up(size_t bytes) {
    return (bytes + 63) / 64 * 64;
}

/* ---- backward's gradient at the sums: a copy only where it differs from dout ---- */

static bool needs_dz(const conv_attributes *a) {
    return a->types.activation != NN_LINEAR || a->types.in != a->types.result;
}

static size_t scratch_bytes(const nn_call *call, bool backward, int threads) {
    const conv_attributes *a = call->attributes;
    const conv_kernel *kernel = call->kernel;
    if (!backward) {
        return kernel->method->scratch(kernel->state, NN_PRODUCT_FORWARD, threads);
    }
    size_t count = nn_count(call->out.shape), dz = needs_dz(a) ? round_up(count * nn_type_size(a->types.in)) : 0;
    size_t data = kernel->method->scratch(kernel->state, NN_PRODUCT_DATA, threads);
    size_t weights = kernel->method->scratch(kernel->state, NN_PRODUCT_WEIGHTS, threads);
    size_t gradient = nn_gradient_scratch(count / (size_t)a->shape.out, a->shape.out);
    size_t most = data > weights ? data : weights;
    return dz + (most > gradient ? most : gradient);
}

static const void *value_of(const nn_parameter *p, nn_type type) {
    return p == NULL ? NULL : type == NN_F64 ? (const void *)p->value64 : (const void *)p->value;
}

static void *grad_of(const nn_parameter *p, nn_type type) {
    return p == NULL || p->frozen ? NULL : type == NN_F64 ? (void *)p->grad64 : (void *)p->grad;
}

static void forward(nn_call *call) {
    const conv_attributes *a = call->attributes;
    const conv_kernel *kernel = call->kernel;
    kernel->method->forward(kernel->state, &(nn_conv_pass){
                                               .x = call->in[0].data,
                                               .weight = value_of(call->parameter[0], a->types.in),
                                               .version = call->parameter[0]->version,
                                               .bias = value_of(call->parameter[1], a->types.in),
                                               .residual = a->types.residual ? call->in[1].data : NULL,
                                               .activation = a->types.activation,
                                               .y = call->out.data,
                                               .scratch = call->scratch,
                                               .pool = call->pool,
                                           });
}

static void backward(nn_call *call) {
    const conv_attributes *a = call->attributes;
    const conv_kernel *kernel = call->kernel;
    void *dw = grad_of(call->parameter[0], a->types.in), *dbias = grad_of(call->parameter[1], a->types.in);
    void *dresidual = a->types.residual ? call->din[1].data : NULL;
    bool products = call->din[0].data != NULL || dw != NULL;
    bool same = dresidual != NULL && dresidual == call->din[0].data; /* x is its own residual, which is served first */
    const void *dz = call->dout.data;
    unsigned char *scratch = call->scratch;
    nn_gradient gradient = {.pixels = nn_count(call->out.shape) / (size_t)a->shape.out,
                            .channels = a->shape.out,
                            .types = a->types,
                            .activation = a->types.activation,
                            .dy = call->dout.data,
                            .y = call->out.data,
                            .residual = dresidual,
                            .add_residual = same ? call->add[0] : call->add[1],
                            .dbias = dbias,
                            .pool = call->pool};
    if (needs_dz(a) && products) {
        gradient.dz = scratch;
        dz = gradient.dz;
        scratch += round_up(nn_count(call->out.shape) * nn_type_size(a->types.in));
    }
    if (dresidual == call->dout.data && !needs_dz(a)) {
        gradient.residual = NULL; /* in place, and the same */
    }
    gradient.scratch = scratch;
    if (gradient.dz != NULL || gradient.residual != NULL || dbias != NULL) {
        nn_gradient_run(&gradient);
    }
    nn_conv_pass pass = {.x = call->in[0].data,
                         .weight = value_of(call->parameter[0], a->types.in),
                         .version = call->parameter[0]->version,
                         .dz = dz,
                         .dx = call->din[0].data,
                         .add = same || call->add[0],
                         .dw = dw,
                         .scratch = scratch,
                         .pool = call->pool};
    if (dw != NULL) {
        kernel->method->backward_weights(kernel->state, &pass);
    }
    if (pass.dx != NULL) {
        kernel->method->backward_data(kernel->state, &pass);
    }
}

static void release(void *p) {
    conv_kernel *kernel = p;
    if (kernel != NULL) {
        kernel->method->destroy(kernel->state);
        core_free(kernel);
    }
}

static brace_status prepare(nn_call *call, nn_backend backend, bool training, void **out, const char **name,
                            brace_error *error) {
    const conv_attributes *a = call->attributes;
    conv_kernel *kernel = core_calloc(1, sizeof *kernel);
    if (kernel == NULL) {
        return core_fail_memory(error, sizeof *kernel, "a convolution");
    }
    kernel->method = nn_method_choose(backend, a->types, &a->shape);
    brace_status status = kernel->method->create(&kernel->state, kernel->method, &a->shape, a->types, training,
                                                 core_pool_threads(call->pool), error);
    if (status != BRACE_OK) {
        core_free(kernel);
        return status;
    }
    *out = kernel;
    *name = kernel->method->name;
    return BRACE_OK;
}

static double flops(const nn_call *call) {
    return nn_conv_flops(&((const conv_attributes *)call->attributes)->shape);
}

#define CONV_OP(kept, in_dout)                                                                                         \
    {                                                                                                                  \
        .name = "conv", .keeps = (kept), .grad_in_place = (in_dout), .forward = forward, .backward = backward,         \
        .scratch_bytes = scratch_bytes, .prepare = prepare, .release = release, .flops = flops                         \
    }
/* [activation: its derivative is found from its result][residual: its gradient is dz, which may take dout's place] */
static const nn_op ops[2][2] = {{CONV_OP(NN_KEEP_IN0, 0), CONV_OP(NN_KEEP_IN0, 2)},
                                {CONV_OP(NN_KEEP_IN0 | NN_KEEP_OUT, 0), CONV_OP(NN_KEEP_IN0 | NN_KEEP_OUT, 2)}};

/* ---- builders ---- */

nn_parameter *nn_conv_parameter(nn_graph *g, const char *name, const char *part, int rank, const int *shape,
                                nn_init init, int fan_in) {
    char full[256];
    int length = snprintf(full, sizeof full, "%s%s%s", name, name[0] != '\0' ? "." : "", part);
    if (length < 0 || (size_t)length >= sizeof full) {
        nn_reject(g, "%.40s...: the name is longer than 255 letters", name);
        return NULL;
    }
    return nn_parameter_get(g, full, rank, shape, init, fan_in);
}

nn_value nn_conv_node(nn_graph *g, nn_value x, nn_value residual, nn_shape result, nn_parameter *weight,
                      nn_parameter *bias, const conv_attributes *attributes) {
    nn_value in[] = {x, residual};
    return nn_node_add(g, &(nn_node_params){
                              .op = &ops[attributes->types.activation != NN_LINEAR][residual != 0],
                              .inputs = residual != 0 ? 2 : 1,
                              .in = in,
                              .shape = result,
                              .type = attributes->types.result,
                              .attributes = attributes,
                              .attributes_size = sizeof *attributes,
                              .parameter = {weight, bias},
                          });
}

nn_value nn_conv2d(nn_graph *g, nn_value x, const nn_conv *conv) {
    if (!nn_usable(g, x) || (conv->residual != 0 && !nn_usable(g, conv->residual))) {
        return 0;
    }
    nn_shape in = nn_shape_of(g, x);
    nn_type type = nn_type_of(g, x);
    const char *name = conv->name != NULL ? conv->name : "";
    int k = conv->kernel, stride = conv->stride == 0 ? 1 : conv->stride;
    if (conv->out < 1 || conv->out > 1 << 20 || k < 1 || k > 64 || stride < 1 || stride > 64 || conv->pad < 0 ||
        conv->pad >= k) {
        return nn_reject(g,
                         "%s: a convolution to %d channels with kernel %d, stride %d and padding %d; possible are 1 to "
                         "1048576 channels, kernels and strides of 1 to 64, and padding less than the kernel",
                         name, conv->out, k, stride, conv->pad);
    }
    if (in.h > INT32_MAX - 128 || in.w > INT32_MAX - 128 || in.h + 2 * conv->pad < k || in.w + 2 * conv->pad < k) {
        return nn_reject(g, "%s: the input is %d x %d pixels, which a kernel of %d with padding %d does not fit into",
                         name, in.w, in.h, k, conv->pad);
    }
    if ((double)conv->out * in.c * k * k > (double)(1 << 30)) {
        return nn_reject(g, "%s: a kernel of %d x %d from %d to %d channels is too large", name, k, k, in.c, conv->out);
    }
    nn_shape out = {in.n, (in.h + 2 * conv->pad - k) / stride + 1, (in.w + 2 * conv->pad - k) / stride + 1, conv->out};
    conv_attributes a = {.shape = {in.n, in.h, in.w, in.c, out.h, out.w, out.c, k, stride, conv->pad},
                         .types = {.in = type,
                                   .result = conv->f32_result && type == NN_BF16 ? NN_F32 : type,
                                   .activation = conv->activation,
                                   .bias = !conv->no_bias,
                                   .residual = conv->residual != 0}};
    if (conv->residual != 0) {
        nn_shape r = nn_shape_of(g, conv->residual);
        if (memcmp(&r, &out, sizeof r) != 0 || nn_type_of(g, conv->residual) != a.types.result) {
            return nn_reject(g, "%s: the residual is {%d, %d, %d, %d} and the result {%d, %d, %d, %d}%s", name, r.n, r.h,
                             r.w, r.c, out.n, out.h, out.w, out.c,
                             memcmp(&r, &out, sizeof r) == 0 ? ", of another type" : "");
        }
    }
    int fan_in = in.c * k * k;
    nn_parameter *weight = nn_conv_parameter(g, name, "weight", 4, (int[]){conv->out, in.c, k, k}, conv->init, fan_in);
    nn_parameter *bias = NULL;
    if (weight == NULL) {
        return 0;
    }
    if (a.types.bias && (bias = nn_conv_parameter(g, name, "bias", 1, &conv->out,
                                            conv->zero_bias ? NN_INIT_ZERO : NN_INIT_UNIFORM_FAN_IN, fan_in)) == NULL) {
        return 0;
    }
    return nn_conv_node(g, x, conv->residual, out, weight, bias, &a);
}
