/* SPDX-License-Identifier: Apache-2.0 */
/*
 * onednn.c: f32 convolutions by oneDNN. All that BRACE calls of it is here, and
 * builds with its versions 2 (Debian 12) and 3, whose C API makes primitive
 * descriptors without descriptors of operations.
 *
 * Activations stay plain channels last; oneDNN chooses its own order of weights,
 * which are reordered when they change. Its bf16 is not used: slower than ours, and
 * version 2.6 crashes where there is AMX.
 *
 * Debian's oneDNN brings OpenMP threads of its own. It is called while ours wait,
 * with as many as we have. What it needs of memory while it runs is our scratch, so
 * that graphs can run side by side. A call that fails leaves NaN, not old numbers.
 */
#include <math.h>
#include <string.h>

#include <oneapi/dnnl/dnnl.h>

#if defined(__SSE2__)
#include <immintrin.h>
#endif

#include "nn/kernels/kernels.h"
#include "nn/node.h"

/* From OpenMP's run-time library; its header is the compiler's, and clang's is a package of its own. */
int omp_get_max_threads(void);
void omp_set_num_threads(int threads);

#if DNNL_VERSION_MAJOR >= 3
typedef const_dnnl_memory_desc_t layout; /* of a tensor */
typedef dnnl_memory_desc_t own_layout;
#define LAYOUT(own) (own)
#else
typedef const dnnl_memory_desc_t *layout;
typedef dnnl_memory_desc_t own_layout;
#define LAYOUT(own) (&(own))
#endif

/* One of the three passes. */
typedef struct dnn_pass {
    dnnl_primitive_desc_t description;
    dnnl_primitive_t primitive;
    layout weights; /* the order oneDNN wants them in; owned by `description` */
    size_t weight_bytes, scratch_bytes;
} dnn_pass;

typedef struct dnn_state {
    nn_conv_shape shape;
    nn_conv_types types;
    int threads;
    dnnl_engine_t engine;
    dnnl_stream_t stream;
    own_layout x, y, weights_any, weights_plain, bias;
    int layouts; /* how many of them were made */
    dnn_pass pass[3]; /* by nn_product */
    struct {
        void *weights; /* NULL: not yet */
        const void *made_of;
        unsigned version;
    } packed[2]; /* forward, backward_data */
} dnn_state;

/* ---- where the two versions differ ---- */

#if DNNL_VERSION_MAJOR >= 3

static dnnl_status_t make_layout(own_layout *out, const dnnl_dims_t dims, int rank, dnnl_format_tag_t tag) {
    return dnnl_memory_desc_create_with_tag(out, rank, dims, dnnl_f32, tag);
}

static void free_layout(own_layout *l) {
    dnnl_memory_desc_destroy(*l);
}

static dnnl_status_t describe(dnnl_primitive_desc_t *out, const dnn_state *s, nn_product product,
                              const_dnnl_primitive_attr_t attr, const_dnnl_primitive_desc_t hint) {
    const dnnl_dims_t strides = {s->shape.stride, s->shape.stride}, dilates = {0, 0}, pad = {s->shape.pad, s->shape.pad};
    const dnnl_dims_t end = {(s->shape.oh - 1) * s->shape.stride + s->shape.kernel - s->shape.h - s->shape.pad,
                             (s->shape.ow - 1) * s->shape.stride + s->shape.kernel - s->shape.w - s->shape.pad};
    switch (product) {
    case NN_PRODUCT_FORWARD:
        return dnnl_convolution_forward_primitive_desc_create(out, s->engine, dnnl_forward_training,
                                                              dnnl_convolution_direct, s->x, s->weights_any,
                                                              s->types.bias ? s->bias : NULL, s->y, strides, dilates, pad, end,
                                                              attr);
    case NN_PRODUCT_DATA:
        return dnnl_convolution_backward_data_primitive_desc_create(out, s->engine, dnnl_convolution_direct, s->x,
                                                                    s->weights_any, s->y, strides, dilates, pad, end,
                                                                    hint, attr);
    case NN_PRODUCT_WEIGHTS:
        break;
    }
    return dnnl_convolution_backward_weights_primitive_desc_create(out, s->engine, dnnl_convolution_direct, s->x,
                                                                   s->weights_any, NULL, s->y, strides, dilates, pad,
                                                                   end, hint, attr);
}

static dnnl_status_t follow_with(dnnl_post_ops_t ops, dnnl_alg_kind_t kind, float alpha) {
    return dnnl_post_ops_append_eltwise(ops, kind, alpha, 0);
}

static dnnl_status_t follow_with_sum(dnnl_post_ops_t ops) {
    return dnnl_post_ops_append_sum(ops, 1, 0, dnnl_data_type_undef);
}

#else

static dnnl_status_t make_layout(own_layout *out, const dnnl_dims_t dims, int rank, dnnl_format_tag_t tag) {
    return dnnl_memory_desc_init_by_tag(out, rank, dims, dnnl_f32, tag);
}

static void free_layout(own_layout *l) {
    (void)l;
}

static dnnl_status_t describe(dnnl_primitive_desc_t *out, const dnn_state *s, nn_product product,
                              const_dnnl_primitive_attr_t attr, const_dnnl_primitive_desc_t hint) {
    const dnnl_dims_t strides = {s->shape.stride, s->shape.stride}, pad = {s->shape.pad, s->shape.pad};
    const dnnl_dims_t end = {(s->shape.oh - 1) * s->shape.stride + s->shape.kernel - s->shape.h - s->shape.pad,
                             (s->shape.ow - 1) * s->shape.stride + s->shape.kernel - s->shape.w - s->shape.pad};
    dnnl_convolution_desc_t d;
    dnnl_status_t status = dnnl_success;
    switch (product) {
    case NN_PRODUCT_FORWARD:
        status = dnnl_convolution_forward_desc_init(&d, dnnl_forward_training, dnnl_convolution_direct, &s->x,
                                                    &s->weights_any, s->types.bias ? &s->bias : NULL, &s->y, strides, pad, end);
        break;
    case NN_PRODUCT_DATA:
        status = dnnl_convolution_backward_data_desc_init(&d, dnnl_convolution_direct, &s->x, &s->weights_any, &s->y,
                                                          strides, pad, end);
        break;
    case NN_PRODUCT_WEIGHTS:
        status = dnnl_convolution_backward_weights_desc_init(&d, dnnl_convolution_direct, &s->x, &s->weights_any, NULL,
                                                             &s->y, strides, pad, end);
        break;
    }
    return status != dnnl_success ? status : dnnl_primitive_desc_create(out, &d, attr, s->engine, hint);
}

static dnnl_status_t follow_with(dnnl_post_ops_t ops, dnnl_alg_kind_t kind, float alpha) {
    return dnnl_post_ops_append_eltwise(ops, 1, kind, alpha, 0);
}

static dnnl_status_t follow_with_sum(dnnl_post_ops_t ops) {
    return dnnl_post_ops_append_sum(ops, 1);
}

#endif

/* ---- making ---- */

static void destroy_pass(dnn_pass *pass) {
    if (pass->primitive != NULL) {
        dnnl_primitive_destroy(pass->primitive);
    }
    if (pass->description != NULL) {
        dnnl_primitive_desc_destroy(pass->description);
    }
}

static dnnl_status_t follow(dnnl_primitive_attr_t attr, nn_activation activation, bool residual) {
    dnnl_post_ops_t ops = NULL;
    dnnl_status_t status = dnnl_post_ops_create(&ops);
    if (status == dnnl_success && residual) {
        status = follow_with_sum(ops);
    }
    if (status == dnnl_success && activation != NN_LINEAR) {
        status = activation == NN_SIGMOID ? follow_with(ops, dnnl_eltwise_logistic, 0)
                 : activation == NN_TANH  ? follow_with(ops, dnnl_eltwise_tanh, 0)
                                          : follow_with(ops, dnnl_eltwise_relu, activation == NN_RELU ? 0.0f : 0.1f);
    }
    if (status == dnnl_success) {
        status = dnnl_primitive_attr_set_post_ops(attr, ops);
    }
    if (ops != NULL) {
        dnnl_post_ops_destroy(ops);
    }
    return status;
}

static dnnl_status_t make_pass(dnn_pass *out, const dnn_state *s, nn_product product) {
    dnnl_primitive_attr_t attr = NULL;
    dnnl_primitive_desc_t hint = NULL;
    dnnl_status_t status = dnnl_primitive_attr_create(&attr);
    if (status == dnnl_success) {
        status = dnnl_primitive_attr_set_scratchpad_mode(attr, dnnl_scratchpad_mode_user);
    }
    if (status == dnnl_success && product == NN_PRODUCT_FORWARD) {
        status = follow(attr, s->types.activation, s->types.residual);
    }
    if (status == dnnl_success && product != NN_PRODUCT_FORWARD) {
        status = describe(&hint, s, NN_PRODUCT_FORWARD, NULL, NULL);
    }
    if (status == dnnl_success) {
        status = describe(&out->description, s, product, attr, hint);
    }
    if (status == dnnl_success) {
        status = dnnl_primitive_create(&out->primitive, out->description);
    }
    if (status == dnnl_success) {
        out->weights = dnnl_primitive_desc_query_md(
            out->description, product == NN_PRODUCT_WEIGHTS ? dnnl_query_diff_weights_md : dnnl_query_weights_md, 0);
        out->weight_bytes = dnnl_memory_desc_get_size(out->weights);
        out->scratch_bytes =
            dnnl_memory_desc_get_size(dnnl_primitive_desc_query_md(out->description, dnnl_query_scratchpad_md, 0));
    }
    if (hint != NULL) {
        dnnl_primitive_desc_destroy(hint);
    }
    if (attr != NULL) {
        dnnl_primitive_attr_destroy(attr);
    }
    return status;
}

static void destroy(void *p) {
    dnn_state *s = p;
    if (s == NULL) {
        return;
    }
    for (int i = 0; i < 3; i++) {
        destroy_pass(&s->pass[i]);
    }
    own_layout *layouts[] = {&s->x, &s->y, &s->weights_any, &s->weights_plain, &s->bias};
    for (int i = 0; i < s->layouts; i++) {
        free_layout(layouts[i]);
    }
    if (s->stream != NULL) {
        dnnl_stream_destroy(s->stream);
    }
    if (s->engine != NULL) {
        dnnl_engine_destroy(s->engine);
    }
    core_free(s->packed[0].weights);
    core_free(s->packed[1].weights);
    core_free(s);
}

static dnnl_status_t make_layouts(dnn_state *s) {
    const nn_conv_shape *c = &s->shape;
    const dnnl_dims_t x = {c->n, c->c, c->h, c->w}, y = {c->n, c->out, c->oh, c->ow}, bias = {c->out};
    const dnnl_dims_t weights = {c->out, c->c, c->kernel, c->kernel};
    const struct {
        own_layout *out;
        const dnnl_dim_t *dims;
        int rank;
        dnnl_format_tag_t tag;
    } list[] = {{&s->x, x, 4, dnnl_nhwc},
                {&s->y, y, 4, dnnl_nhwc},
                {&s->weights_any, weights, 4, dnnl_format_tag_any},
                {&s->weights_plain, weights, 4, dnnl_oihw},
                {&s->bias, bias, 1, dnnl_x}};
    for (int i = 0; i < 5; i++) {
        dnnl_status_t status = make_layout(list[i].out, list[i].dims, list[i].rank, list[i].tag);
        if (status != dnnl_success) {
            return status;
        }
        s->layouts++;
    }
    return dnnl_success;
}

static brace_status fail(dnn_state *s, dnnl_status_t status, brace_error *error) {
    destroy(s);
    if (status == dnnl_out_of_memory) {
        return core_fail_memory(error, sizeof *s, "oneDNN's convolution");
    }
    return core_fail(error, BRACE_ERROR_UNSUPPORTED, "oneDNN cannot compute a convolution (its status is %d)",
                     (int)status);
}

static brace_status create(void **out, const nn_method *method, const nn_conv_shape *shape, nn_conv_types types,
                           bool training, int threads, brace_error *error) {
    (void)method;
    *out = NULL;
    dnn_state *s = core_calloc(1, sizeof *s);
    if (s == NULL) {
        return core_fail_memory(error, sizeof *s, "oneDNN's convolution");
    }
    s->shape = *shape;
    s->types = types;
    s->threads = threads;
    /* oneDNN divides work by the number of threads that there are when a primitive is made. */
    int before = omp_get_max_threads();
    omp_set_num_threads(threads);
    dnnl_status_t status = dnnl_engine_create(&s->engine, dnnl_cpu, 0);
    if (status == dnnl_success) {
        status = dnnl_stream_create(&s->stream, s->engine, dnnl_stream_default_flags);
    }
    if (status == dnnl_success) {
        status = make_layouts(s);
    }
    for (int i = 0; i < (training ? 3 : 1) && status == dnnl_success; i++) {
        status = make_pass(&s->pass[i], s, (nn_product)i);
    }
    omp_set_num_threads(before);
    if (status != dnnl_success) {
        return fail(s, status, error);
    }
    for (int i = 0; i <= (training ? 1 : 0); i++) {
        s->packed[i].weights = core_alloc(s->pass[i].weight_bytes, 1);
        if (s->packed[i].weights == NULL) {
            return fail(s, dnnl_out_of_memory, error);
        }
    }
    *out = s;
    return BRACE_OK;
}

/* ---- running ---- */

typedef struct argument {
    int name;
    layout shape;
    void *data;
} argument;

static dnnl_status_t execute(dnn_state *s, const_dnnl_primitive_t primitive, const argument *arguments, int count) {
    dnnl_exec_arg_t list[6];
    dnnl_memory_t memory[6];
    dnnl_status_t status = dnnl_success;
    int made = 0;
    for (; made < count && status == dnnl_success; made++) {
        memory[made] = NULL;
        status = dnnl_memory_create(&memory[made], arguments[made].shape, s->engine, arguments[made].data);
        list[made] = (dnnl_exec_arg_t){arguments[made].name, memory[made]};
    }
    if (status == dnnl_success) {
        int before = omp_get_max_threads();
        omp_set_num_threads(s->threads);
#if defined(__SSE2__)
        unsigned flags = _mm_getcsr();
        _mm_setcsr(flags | 0x8040u); /* as in our own workers: denormal numbers are zero */
#endif
        status = dnnl_primitive_execute(primitive, s->stream, count, list);
        if (status == dnnl_success) {
            status = dnnl_stream_wait(s->stream);
        }
#if defined(__SSE2__)
        _mm_setcsr(flags);
#endif
        omp_set_num_threads(before);
    }
    for (int i = 0; i < made; i++) {
        if (memory[i] != NULL) {
            dnnl_memory_destroy(memory[i]);
        }
    }
    return status;
}

static dnnl_status_t reorder(dnn_state *s, void *to, layout to_shape, const void *from, layout from_shape) {
    dnnl_primitive_desc_t description = NULL;
    dnnl_primitive_t primitive = NULL;
    dnnl_status_t status =
        dnnl_reorder_primitive_desc_create(&description, from_shape, s->engine, to_shape, s->engine, NULL);
    if (status == dnnl_success) {
        status = dnnl_primitive_create(&primitive, description);
    }
    if (status == dnnl_success) {
        const argument arguments[] = {{DNNL_ARG_FROM, from_shape, (void *)(uintptr_t)from},
                                      {DNNL_ARG_TO, to_shape, to}};
        status = execute(s, primitive, arguments, 2);
    }
    if (primitive != NULL) {
        dnnl_primitive_destroy(primitive);
    }
    if (description != NULL) {
        dnnl_primitive_desc_destroy(description);
    }
    return status;
}

static dnnl_status_t keep_packed(dnn_state *s, int which, layout shape, const nn_conv_pass *pass) {
    dnnl_status_t status = dnnl_success;
    if (s->packed[which].made_of != pass->weight || s->packed[which].version != pass->version) {
        status = reorder(s, s->packed[which].weights, shape, pass->weight, LAYOUT(s->weights_plain));
        s->packed[which].made_of = status == dnnl_success ? pass->weight : NULL;
        s->packed[which].version = pass->version;
    }
    return status;
}

static void fill_with_nan(float *p, size_t count) {
    for (size_t i = 0; i < count; i++) {
        p[i] = NAN;
    }
}

typedef struct add_run {
    float *to;
    const float *from;
} add_run;

static void add_range(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const add_run *r = arg;
    for (size_t i = begin; i < end; i++) {
        r->to[i] += r->from[i];
    }
}

static size_t round_up(size_t bytes) {
    return (bytes + 63) / 64 * 64;
}

static size_t count_x(const nn_conv_shape *c) {
    return (size_t)c->n * (size_t)c->h * (size_t)c->w * (size_t)c->c;
}

static size_t count_y(const nn_conv_shape *c) {
    return (size_t)c->n * (size_t)c->oh * (size_t)c->ow * (size_t)c->out;
}

static size_t count_weights(const nn_conv_shape *c) {
    return (size_t)c->out * (size_t)c->c * (size_t)c->kernel * (size_t)c->kernel;
}

static size_t scratch(const void *p, nn_product product, int threads) {
    (void)threads;
    const dnn_state *s = p;
    switch (product) {
    case NN_PRODUCT_FORWARD:
        break;
    case NN_PRODUCT_DATA: /* dx, where it is to be added to another */
        return round_up(s->pass[product].scratch_bytes) + count_x(&s->shape) * sizeof(float);
    case NN_PRODUCT_WEIGHTS: /* dW in oneDNN's order and in ours */
        return round_up(s->pass[product].scratch_bytes) + round_up(s->pass[product].weight_bytes) +
               count_weights(&s->shape) * sizeof(float);
    }
    return s->pass[product].scratch_bytes;
}

static void forward(void *p, const nn_conv_pass *pass) {
    dnn_state *s = p;
    const dnn_pass *products = &s->pass[NN_PRODUCT_FORWARD];
    size_t count = count_y(&s->shape);
    dnnl_status_t status = keep_packed(s, 0, products->weights, pass);
    if (status == dnnl_success) {
        if (pass->residual != NULL) { /* is added to what is there */
            memcpy(pass->y, pass->residual, count * sizeof(float));
        }
        const argument arguments[] = {
            {DNNL_ARG_SRC, LAYOUT(s->x), (void *)(uintptr_t)pass->x},
            {DNNL_ARG_WEIGHTS, products->weights, s->packed[0].weights},
            {DNNL_ARG_DST, LAYOUT(s->y), pass->y},
            {DNNL_ARG_SCRATCHPAD, dnnl_primitive_desc_query_md(products->description, dnnl_query_scratchpad_md, 0),
             pass->scratch},
            {DNNL_ARG_BIAS, LAYOUT(s->bias), (void *)(uintptr_t)pass->bias}};
        status = execute(s, products->primitive, arguments, s->types.bias ? 5 : 4);
    }
    if (status != dnnl_success) {
        fill_with_nan(pass->y, count);
    }
}

static void backward_data(void *p, const nn_conv_pass *pass) {
    dnn_state *s = p;
    dnn_pass *data = &s->pass[NN_PRODUCT_DATA];
    unsigned char *own = pass->scratch;
    void *dx = pass->add ? own + round_up(data->scratch_bytes) : pass->dx;
    dnnl_status_t status = keep_packed(s, 1, data->weights, pass);
    if (status == dnnl_success) {
        const argument arguments[] = {
            {DNNL_ARG_DIFF_DST, LAYOUT(s->y), (void *)(uintptr_t)pass->dz},
            {DNNL_ARG_WEIGHTS, data->weights, s->packed[1].weights},
            {DNNL_ARG_DIFF_SRC, LAYOUT(s->x), dx},
            {DNNL_ARG_SCRATCHPAD, dnnl_primitive_desc_query_md(data->description, dnnl_query_scratchpad_md, 0), own}};
        status = execute(s, data->primitive, arguments, 4);
    }
    if (status != dnnl_success) {
        fill_with_nan(pass->dx, count_x(&s->shape));
    } else if (pass->add) {
        core_parallel(pass->pool, count_x(&s->shape), 1 << 14, add_range, &(add_run){pass->dx, dx});
    }
}

static void backward_weights(void *p, const nn_conv_pass *pass) {
    dnn_state *s = p;
    dnn_pass *weights = &s->pass[NN_PRODUCT_WEIGHTS];
    unsigned char *own = pass->scratch;
    void *ordered = own + round_up(weights->scratch_bytes);
    void *plain = own + round_up(weights->scratch_bytes) + round_up(weights->weight_bytes);
    const argument arguments[] = {
        {DNNL_ARG_SRC, LAYOUT(s->x), (void *)(uintptr_t)pass->x},
        {DNNL_ARG_DIFF_DST, LAYOUT(s->y), (void *)(uintptr_t)pass->dz},
        {DNNL_ARG_DIFF_WEIGHTS, weights->weights, ordered},
        {DNNL_ARG_SCRATCHPAD, dnnl_primitive_desc_query_md(weights->description, dnnl_query_scratchpad_md, 0), own}};
    dnnl_status_t status = execute(s, weights->primitive, arguments, 4);
    if (status == dnnl_success) {
        status = reorder(s, plain, LAYOUT(s->weights_plain), ordered, weights->weights);
    }
    if (status != dnnl_success) {
        fill_with_nan(plain, count_weights(&s->shape));
    }
    core_parallel(pass->pool, count_weights(&s->shape), 1 << 14, add_range, &(add_run){pass->dw, plain});
}

const nn_method nn_method_onednn = {"onednn", create,        destroy,          scratch,
                                    forward,  backward_data, backward_weights, NULL};
