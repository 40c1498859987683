/* SPDX-License-Identifier: Apache-2.0 */
/*
 * graph.c: building: nodes, scopes, and the first error, which stays.
 */
#include <string.h>

#include "nn/graph.h"

brace_status nn_graph_create(nn_graph **out, nn_weights *weights, const nn_graph_params *params, brace_error *error) {
    *out = NULL;
    nn_graph *g = core_calloc(1, sizeof *g);
    if (g == NULL) {
        return core_fail_memory(error, sizeof *g, "a network");
    }
    g->weights = weights;
    if (params != NULL) {
        g->type = params->type;
        g->backend = params->backend;
        g->separate = params->separate;
        g->poison = params->poison;
        if (params->job != NULL) {
            g->job = *params->job;
        }
    }
    g->arena = core_arena_create((size_t)64 << 10);
    if (g->arena == NULL) {
        nn_graph_destroy(g);
        return core_fail_memory(error, 64, "a network");
    }
    brace_status status = core_pool_create(&g->pool, &g->job, error);
    if (status != BRACE_OK) {
        nn_graph_destroy(g);
        return status;
    }
    *out = g;
    return BRACE_OK;
}

void nn_graph_destroy(nn_graph *g) {
    if (g == NULL) {
        return;
    }
    for (int v = 1; v <= g->count; v++) {
        nn_node *node = g->nodes[v];
        if (node->kernel != NULL && node->op->release != NULL) {
            node->op->release(node->kernel);
        }
    }
    core_pool_destroy(g->pool);
    core_free(g->memory);
    core_free(g->steps);
    core_free(g->buffers);
    core_free((void *)g->nodes);
    core_arena_destroy(g->arena);
    core_free(g);
}

/* ---- errors ---- */

static void fail_text(nn_graph *g, brace_status status, const char *format, va_list list) {
    if (g->error.status != BRACE_OK) {
        return;
    }
    char text[BRACE_ERROR_LENGTH / 2];
    vsnprintf(text, sizeof text, format, list);
    core_fail(&g->error, status, "%s%s%s", g->scope, g->scope[0] != '\0' ? ": " : "", text);
}

void nn_fail(nn_graph *g, brace_status status, const char *format, ...) {
    va_list list;
    va_start(list, format);
    fail_text(g, status, format, list);
    va_end(list);
}

nn_value nn_reject(nn_graph *g, const char *format, ...) {
    va_list list;
    va_start(list, format);
    fail_text(g, BRACE_ERROR_ARGUMENT, format, list);
    va_end(list);
    return 0;
}

bool nn_usable(nn_graph *g, nn_value v) {
    if (g->error.status == BRACE_OK && g->planned) {
        nn_reject(g, "the network is planned already; nothing can be added");
    }
    if (g->error.status == BRACE_OK && (v < 1 || v > g->count)) {
        nn_reject(g, "an input of the operation is missing");
    }
    return g->error.status == BRACE_OK;
}

brace_status nn_graph_error(const nn_graph *g, brace_error *error) {
    return g->error.status == BRACE_OK ? BRACE_OK : core_fail(error, g->error.status, "%s", g->error.message);
}

/* ---- scopes ---- */

void nn_push(nn_graph *g, const char *format, ...) {
    size_t end = strlen(g->scope);
    if (g->depth < NN_SCOPE_DEPTH) {
        g->scope_end[g->depth] = end;
    }
    g->depth++;
    if (g->depth > NN_SCOPE_DEPTH || end + 2 > sizeof g->scope) {
        nn_reject(g, "scopes are nested too deep");
        return;
    }
    if (end > 0) {
        g->scope[end++] = '.';
    }
    va_list list;
    va_start(list, format);
    int n = vsnprintf(g->scope + end, sizeof g->scope - end, format, list);
    va_end(list);
    if (n < 0 || (size_t)n >= sizeof g->scope - end) {
        nn_reject(g, "the name of a scope is too long");
    }
}

void nn_pop(nn_graph *g) {
    if (g->depth == 0) {
        nn_reject(g, "a scope is left that was not entered");
        return;
    }
    g->depth--;
    if (g->depth < NN_SCOPE_DEPTH) {
        g->scope[g->scope_end[g->depth]] = '\0';
    }
}

void nn_recompute_begin(nn_graph *g) {
    if (g->segment != 0) {
        nn_reject(g, "segments of recomputing cannot be nested");
        return;
    }
    g->segment = ++g->segments;
}

void nn_recompute_end(nn_graph *g) {
    if (g->segment == 0) {
        nn_reject(g, "a segment of recomputing ends that was not begun");
    }
    g->segment = 0;
}

/* ---- nodes ---- */

static bool make_room(nn_graph *g) {
    if (g->count + 1 < g->room) {
        return true;
    }
    int room = g->room > 0 ? g->room * 2 : 64;
    nn_node **nodes = core_calloc((size_t)room, sizeof *nodes);
    if (nodes == NULL) {
        return false;
    }
    if (g->nodes != NULL) {
        memcpy((void *)nodes, (void *)g->nodes, (size_t)g->room * sizeof *nodes);
    }
    core_free((void *)g->nodes);
    g->nodes = nodes;
    g->room = room;
    return true;
}

/* The scope, and a name in it, kept. */
static const char *keep_name(nn_graph *g, const char *name) {
    size_t a = strlen(g->scope), b = name != NULL ? strlen(name) : 0;
    char *text = core_arena_alloc(g->arena, a + b + 2, 1);
    if (text != NULL) {
        snprintf(text, a + b + 2, "%s%s%s", g->scope, a > 0 && b > 0 ? "." : "", b > 0 ? name : "");
    }
    return text;
}

nn_value nn_node_add(nn_graph *g, const nn_node_params *params) {
    const nn_shape s = params->shape;
    if (g->error.status != BRACE_OK) {
        return 0;
    }
    if (g->planned) {
        return nn_reject(g, "the network is planned already; nothing can be added");
    }
    size_t count = 0;
    if (s.n < 1 || s.h < 1 || s.w < 1 || s.c < 1 ||
        __builtin_mul_overflow((size_t)s.n * (size_t)s.h, (size_t)s.w, &count) ||
        __builtin_mul_overflow(count, (size_t)s.c, &count) || count > (size_t)1 << 40) {
        return nn_reject(g, "%s: the result would be %d x %d x %d x %d", params->op->name, s.n, s.h, s.w, s.c);
    }
    if (params->inputs > NN_MAX_IN) {
        return nn_reject(g, "%s: %d inputs are more than %d", params->op->name, params->inputs, NN_MAX_IN);
    }
    for (int i = 0; i < params->inputs; i++) {
        if (!nn_usable(g, params->in[i])) {
            return 0;
        }
    }
    nn_node *node = core_arena_alloc(g->arena, 1, sizeof *node);
    const char *scope = keep_name(g, NULL);
    void *attributes = params->attributes_size > 0 ? core_arena_alloc(g->arena, params->attributes_size, 1) : NULL;
    if (node == NULL || scope == NULL || (params->attributes_size > 0 && attributes == NULL) || !make_room(g)) {
        nn_fail(g, BRACE_ERROR_MEMORY, "out of memory while the network is built");
        return 0;
    }
    node->op = params->op;
    node->scope = scope;
    node->inputs = params->inputs;
    for (int i = 0; i < params->inputs; i++) {
        node->in[i] = params->in[i];
    }
    node->shape = s;
    node->type = params->type;
    if (attributes != NULL) {
        memcpy(attributes, params->attributes, params->attributes_size);
        node->attributes = attributes;
    }
    memcpy(node->parameter, params->parameter, sizeof node->parameter);
    node->segment = g->segment;
    g->nodes[++g->count] = node;
    return g->count;
}

nn_shape nn_shape_of(const nn_graph *g, nn_value v) {
    return v >= 1 && v <= g->count ? g->nodes[v]->shape : (nn_shape){0, 0, 0, 0};
}

nn_type nn_type_of(const nn_graph *g, nn_value v) {
    return v >= 1 && v <= g->count ? g->nodes[v]->type : NN_F32;
}

nn_type nn_graph_type(const nn_graph *g) {
    return g->type;
}

size_t nn_bytes(const nn_graph *g, nn_value v) {
    return nn_count(nn_shape_of(g, v)) * nn_type_size(nn_type_of(g, v));
}

double nn_graph_flops(const nn_graph *g) {
    double sum = 0;
    for (int v = 1; v <= g->count; v++) {
        sum += g->nodes[v]->flops;
    }
    return sum;
}

/* ---- sources and outputs ---- */

const nn_op nn_op_input = {.name = "input"};
const nn_op nn_op_constant = {.name = "constant"};

static nn_type wide_type(const nn_graph *g) {
    return g->type == NN_F64 ? NN_F64 : NN_F32;
}

static nn_value add_source(nn_graph *g, const nn_op *op, const char *name, nn_shape shape, const float *values) {
    int segment = g->segment;
    g->segment = 0;
    nn_value v =
        nn_node_add(g, &(nn_node_params){.op = op,
                                         .shape = shape,
                                         .type = wide_type(g),
                                         .attributes = values,
                                         .attributes_size = values != NULL ? nn_count(shape) * sizeof(float) : 0});
    g->segment = segment;
    if (v != 0) {
        g->nodes[v]->source = true;
        if (name != NULL) {
            const char *kept = keep_name(g, name);
            if (kept == NULL) {
                nn_fail(g, BRACE_ERROR_MEMORY, "out of memory while the network is built");
                return 0;
            }
            g->nodes[v]->scope = kept;
        }
    }
    return v;
}

nn_value nn_input(nn_graph *g, const char *name, nn_shape shape) {
    return add_source(g, &nn_op_input, name, shape, NULL);
}

nn_value nn_input_grad(nn_graph *g, const char *name, nn_shape shape) {
    nn_value v = add_source(g, &nn_op_input, name, shape, NULL);
    if (v != 0) {
        g->nodes[v]->wants_grad = true;
    }
    return v;
}

nn_value nn_constant(nn_graph *g, nn_shape shape, const float *values) {
    if (shape.n < 1 || shape.h < 1 || shape.w < 1 || shape.c < 1) {
        return nn_reject(g, "constant: its shape is %d x %d x %d x %d", shape.n, shape.h, shape.w, shape.c);
    }
    return add_source(g, &nn_op_constant, NULL, shape, values);
}

void nn_output(nn_graph *g, const char *name, nn_value v) {
    if (!nn_usable(g, v)) {
        return;
    }
    const char *kept = keep_name(g, name);
    if (kept == NULL) {
        nn_fail(g, BRACE_ERROR_MEMORY, "out of memory while the network is built");
        return;
    }
    g->nodes[v]->output = true;
    g->nodes[v]->scope = kept;
}

/* A parameter as a value: a copy, since it may have another type, and is small. */
static void param_forward(nn_call *call) {
    const nn_parameter *p = call->parameter[0];
    if (call->out.type == NN_F64) {
        memcpy(call->out.data, p->value64, p->count * sizeof(double));
    } else {
        memcpy(call->out.data, p->value, p->count * sizeof(float));
    }
}

static void param_backward(nn_call *call) {
    nn_parameter *p = call->parameter[0];
    for (size_t i = 0; i < p->count; i++) {
        if (call->dout.type == NN_F64) {
            p->grad64[i] += ((const double *)call->dout.data)[i];
        } else {
            p->grad[i] += ((const float *)call->dout.data)[i];
        }
    }
}

const nn_op nn_op_param = {.name = "param", .forward = param_forward, .backward = param_backward};

nn_value nn_param(nn_graph *g, const char *name, nn_shape shape, int rank, const int *torch_shape, nn_init init) {
    int fan_in = 1;
    for (int i = 1; i < rank; i++) {
        fan_in *= torch_shape[i];
    }
    nn_parameter *p = nn_parameter_get(g, name, rank, torch_shape, init, fan_in);
    if (p == NULL) {
        return 0;
    }
    if (p->count != nn_count(shape)) {
        return nn_reject(g, "%s: %zu numbers cannot be seen as %d x %d x %d x %d", name, p->count, shape.n, shape.h,
                         shape.w, shape.c);
    }
    return nn_node_add(g,
                       &(nn_node_params){.op = &nn_op_param, .shape = shape, .type = wide_type(g), .parameter = {p}});
}
