/* SPDX-License-Identifier: Apache-2.0 */
/*
 * plan.c: from nodes to steps and buffers. The steps are all forward ones, then the
 * backward ones in reverse, each segment's recomputing just before it is needed. A
 * buffer lives from the step that writes it to the last that reads it; place.c lets
 * buffers that never live at once share memory. Two more ways to save: the result
 * takes over the buffer of an input that dies there, and a gradient that of the
 * gradient it is made from.
 */
#include <string.h>

#include "nn/graph.h"

/* ---- which nodes take part ---- */

static bool trains(const nn_node *node) {
    for (int i = 0; i < NN_MAX_PARAMETERS; i++) {
        if (node->parameter[i] != NULL && !node->parameter[i]->frozen) {
            return true;
        }
    }
    return false;
}

/* `needed` for outputs and loss; `backward` where a gradient arrives and leads on. */
static brace_status mark(nn_graph *g, brace_error *error) {
    for (int v = 1; v <= g->count; v++) {
        nn_node *node = g->nodes[v];
        node->wants_grad = g->loss != 0 && (node->wants_grad || trains(node));
        for (int i = 0; i < node->inputs && g->loss != 0; i++) {
            node->wants_grad |= g->nodes[node->in[i]]->wants_grad;
        }
        node->needed = node->output || v == g->loss || node->op == &nn_op_input; /* inputs can be filled in any case */
        node->grad = 0;
    }
    if (g->loss != 0 && !g->nodes[g->loss]->wants_grad) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "the loss depends on no parameter that is trained");
    }
    bool any = false;
    for (int v = g->count; v >= 1; v--) {
        nn_node *node = g->nodes[v];
        any |= node->output || v == g->loss;
        for (int i = 0; i < node->inputs && node->needed; i++) {
            g->nodes[node->in[i]]->needed = true;
        }
    }
    if (!any) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "the network has no output");
    }
    for (int v = g->loss; v >= 1; v--) {
        nn_node *node = g->nodes[v];
        if (v != g->loss && !node->backward) {
            continue; /* no gradient arrives */
        }
        node->backward = true;
        if (!node->source && node->op->backward == NULL) {
            return core_fail(error, BRACE_ERROR_ARGUMENT, "%s: %s has no gradient", node->scope, node->op->name);
        }
        for (int i = 0; i < node->inputs; i++) {
            g->nodes[node->in[i]]->backward |= g->nodes[node->in[i]]->wants_grad;
        }
    }
    return BRACE_OK;
}

static brace_status prepare(nn_graph *g, brace_error *error) {
    brace_status status = BRACE_OK;
    for (int v = 1; v <= g->count && status == BRACE_OK; v++) {
        nn_node *node = g->nodes[v];
        for (int i = 0; i < NN_MAX_PARAMETERS && node->needed && status == BRACE_OK; i++) {
            if (node->parameter[i] != NULL) {
                status = nn_parameter_prepare(node->parameter[i], g->type,
                                              node->backward && !node->parameter[i]->frozen, error);
            }
        }
        if (status != BRACE_OK || !node->needed) {
            continue;
        }
        nn_call call;
        nn_fill_call(g, &call, &(nn_step){.node = v, .pass = node->backward ? NN_BACKWARD : NN_FORWARD});
        if (node->op->prepare != NULL) {
            status = node->op->prepare(&call, g->backend, node->backward, &node->kernel, &node->kernel_name, error);
            if (status != BRACE_OK && error != NULL && node->scope[0] != '\0') {
                core_error_prefix(error, node->scope);
            }
        }
        if (node->op->flops != NULL) {
            node->flops = node->op->flops(&call);
        }
    }
    return status;
}

/* ---- recomputing ---- */

static size_t saved_bytes(nn_graph *g, nn_value v) {
    const nn_op *op = g->nodes[v]->op;
    if (op->saved_bytes == NULL || !g->nodes[v]->backward) {
        return 0;
    }
    nn_call call;
    nn_fill_call(g, &call, &(nn_step){.node = v, .pass = NN_BACKWARD});
    return op->saved_bytes(&call);
}

/* Within a segment, what backward steps need and nobody outside keeps alive anyway, and what that is made from. */
static void choose_recomputed(nn_graph *g, bool *escapes) {
    for (int v = 1; v <= g->count; v++) {
        const nn_node *node = g->nodes[v];
        escapes[v] |= node->output || v == g->loss || node->segment == 0;
        for (int i = 0; i < node->inputs && node->needed; i++) {
            escapes[node->in[i]] |= g->nodes[node->in[i]]->segment != node->segment;
        }
    }
    for (int v = g->count; v >= 1; v--) {
        nn_node *node = g->nodes[v];
        if (node->segment == 0 || !node->needed) {
            continue;
        }
        if (node->backward) {
            node->recomputed |= !escapes[v] && ((node->op->keeps & NN_KEEP_OUT) != 0 || saved_bytes(g, v) > 0);
        }
        for (int i = 0; i < node->inputs; i++) {
            const bool read = node->recomputed || (node->backward && (node->op->keeps & 1u << i) != 0);
            g->nodes[node->in[i]]->recomputed |= read && !escapes[node->in[i]];
        }
    }
}

/* Which of the values of `in` a backward or recomputing step reads. */
static int version(const nn_node *in, nn_pass pass) {
    return pass != NN_FORWARD && in->recomputed;
}

/* ---- steps ---- */

static void add_step(nn_graph *g, nn_value v, nn_pass pass) {
    g->steps[g->step_count++] = (nn_step){.node = v, .pass = pass};
}

static brace_status make_steps(nn_graph *g, brace_error *error) {
    const size_t most = 3 * (size_t)g->count + 1;
    g->steps = core_calloc(most, sizeof *g->steps);
    if (g->steps == NULL) {
        return core_fail_memory(error, most * sizeof *g->steps, "the plan of a network");
    }
    for (int v = 1; v <= g->count; v++) {
        if (g->nodes[v]->needed && !g->nodes[v]->source) {
            add_step(g, v, NN_FORWARD);
        }
    }
    g->forward_steps = g->step_count;
    int done = 0; /* the segment that was recomputed last */
    for (int v = g->loss; v >= 1; v--) {
        const nn_node *node = g->nodes[v];
        if (!node->backward || node->source) {
            continue;
        }
        if (node->segment != 0 && node->segment != done) {
            done = node->segment;
            for (int u = 1; u <= g->count; u++) {
                if (g->nodes[u]->segment == done && g->nodes[u]->recomputed) {
                    add_step(g, u, NN_RECOMPUTE);
                }
            }
        }
        add_step(g, v, NN_BACKWARD);
    }
    return BRACE_OK;
}

/* ---- buffers ---- */

int nn_buffer_of(const nn_graph *g, int b) {
    while (g->buffers[b].same_as != 0) {
        b = g->buffers[b].same_as;
    }
    return b;
}

static int add_buffer(nn_graph *g, size_t bytes, int first) {
    nn_buffer *b = &g->buffers[++g->buffer_count];
    *b = (nn_buffer){.bytes = (bytes + 63) / 64 * 64, .first = first, .last = first};
    return g->buffer_count;
}

static void use(nn_graph *g, int buffer, int step) {
    nn_buffer *b = &g->buffers[nn_buffer_of(g, buffer)];
    b->last = step > b->last ? step : b->last;
}

static void merge(nn_graph *g, int from, int into) {
    nn_buffer *a = &g->buffers[into], *b = &g->buffers[from];
    b->same_as = into;
    a->last = b->last > a->last ? b->last : a->last;
}

static int value_buffer(const nn_graph *g, nn_value v, nn_pass pass) {
    return g->nodes[v]->buffer[version(g->nodes[v], pass)];
}

/* What a forward step makes and reads. */
static void live_forward(nn_graph *g, int t) {
    nn_step *step = &g->steps[t];
    nn_node *node = g->nodes[step->node];
    const int again = step->pass == NN_RECOMPUTE;
    const int out = add_buffer(g, nn_bytes(g, step->node), t);
    node->buffer[again] = out;
    if (node->op->view) {
        merge(g, out, nn_buffer_of(g, value_buffer(g, node->in[0], step->pass)));
    }
    for (int i = 0; i < node->inputs; i++) {
        use(g, value_buffer(g, node->in[i], step->pass), t);
    }
    if (!again && (node->output || step->node == g->loss)) {
        use(g, out, g->step_count);
    }
    const size_t saved = again == (int)node->recomputed ? saved_bytes(g, step->node) : 0;
    if (saved > 0) {
        node->saved[again] = add_buffer(g, saved, t);
    }
}

/* What a backward step reads, and the gradients that it is the first to write. */
static void live_backward(nn_graph *g, int t) {
    nn_step *step = &g->steps[t];
    nn_node *node = g->nodes[step->node];
    if (node->op->keeps & NN_KEEP_OUT) {
        use(g, value_buffer(g, step->node, NN_BACKWARD), t);
    }
    if (node->saved[node->recomputed] != 0) {
        use(g, node->saved[node->recomputed], t);
    }
    use(g, node->grad, t);
    for (int i = 0; i < node->inputs; i++) {
        nn_node *in = g->nodes[node->in[i]];
        if (node->op->keeps & 1u << i) {
            use(g, value_buffer(g, node->in[i], NN_BACKWARD), t);
        }
        if (!in->wants_grad) {
            continue;
        }
        if (in->grad == 0) {
            in->grad = add_buffer(g, nn_bytes(g, node->in[i]), t);
        } else {
            node->add |= 1u << i;
        }
        use(g, in->grad, in->source ? g->step_count : t);
    }
}

static void add_scratch(nn_graph *g, int t) {
    nn_step *step = &g->steps[t];
    const nn_op *op = g->nodes[step->node]->op;
    nn_call call;
    nn_fill_call(g, &call, step);
    const size_t bytes =
        op->scratch_bytes != NULL ? op->scratch_bytes(&call, step->pass == NN_BACKWARD, core_pool_threads(g->pool)) : 0;
    if (bytes > 0) {
        step->scratch = add_buffer(g, bytes, t);
    }
}

/* The result takes over the first input's buffer, if this step is the last to read it. */
static void forward_in_place(nn_graph *g, int t) {
    const nn_step *step = &g->steps[t];
    const nn_node *node = g->nodes[step->node];
    if (!node->op->in_place || node->inputs == 0 || g->separate) {
        return;
    }
    const int a = nn_buffer_of(g, value_buffer(g, node->in[0], step->pass)),
              b = nn_buffer_of(g, node->buffer[step->pass == NN_RECOMPUTE]);
    bool legal = a != b && g->buffers[a].last == t && nn_bytes(g, step->node) == nn_bytes(g, node->in[0]) &&
                 node->type == g->nodes[node->in[0]]->type;
    for (int i = 1; i < node->inputs; i++) { /* not where another input is a view of the same memory */
        legal &= node->in[i] == node->in[0] || nn_buffer_of(g, value_buffer(g, node->in[i], step->pass)) != a;
    }
    if (legal) {
        merge(g, b, a);
    }
}

static void backward_in_place(nn_graph *g, int t) {
    const nn_node *node = g->nodes[g->steps[t].node];
    const int i = node->op->grad_in_place - 1;
    if (i < 0 || i >= node->inputs || !g->nodes[node->in[i]]->wants_grad || (node->add & 1u << i) != 0 || g->separate) {
        return;
    }
    const int a = nn_buffer_of(g, node->grad), b = nn_buffer_of(g, g->nodes[node->in[i]]->grad);
    bool legal = a != b && g->buffers[a].last == t && g->buffers[b].first == t &&
                 nn_bytes(g, g->steps[t].node) == nn_bytes(g, node->in[i]) && node->type == g->nodes[node->in[i]]->type;
    for (int j = 0; j < node->inputs; j++) {
        legal &= j == i || node->in[j] != node->in[i];
    }
    if (legal) {
        merge(g, b, a);
    }
}

static brace_status make_buffers(nn_graph *g, brace_error *error) {
    /* Values twice, gradients, what is saved; and scratch. */
    const size_t most = 5 * (size_t)g->count + (size_t)g->step_count + 1;
    g->buffers = core_calloc(most, sizeof *g->buffers);
    if (g->buffers == NULL) {
        return core_fail_memory(error, most * sizeof *g->buffers, "the plan of a network");
    }
    for (int v = 1; v <= g->count; v++) {
        if (g->nodes[v]->source && g->nodes[v]->needed) {
            g->nodes[v]->buffer[0] = add_buffer(g, nn_bytes(g, v), -1);
            use(g, g->nodes[v]->buffer[0], g->step_count);
        }
    }
    if (g->loss != 0) { /* its gradient is written before the backward pass */
        g->nodes[g->loss]->grad = add_buffer(g, nn_bytes(g, g->loss), g->forward_steps);
    }
    for (int t = 0; t < g->step_count; t++) {
        if (g->steps[t].pass == NN_BACKWARD) {
            live_backward(g, t);
        } else {
            live_forward(g, t);
        }
        add_scratch(g, t);
    }
    for (int t = 0; t < g->step_count; t++) {
        if (g->steps[t].pass == NN_BACKWARD) {
            backward_in_place(g, t);
        } else {
            forward_in_place(g, t);
        }
    }
    return BRACE_OK;
}

static void fill_constants(nn_graph *g) {
    for (int v = 1; v <= g->count; v++) {
        const nn_node *node = g->nodes[v];
        if (!node->needed || node->op != &nn_op_constant) {
            continue;
        }
        const float *from = node->attributes;
        void *to = g->memory + g->buffers[nn_buffer_of(g, node->buffer[0])].offset;
        for (size_t i = 0; i < nn_count(node->shape); i++) {
            if (node->type == NN_F64) {
                ((double *)to)[i] = (double)from[i];
            } else {
                ((float *)to)[i] = from[i];
            }
        }
    }
}

static brace_status plan(nn_graph *g, brace_error *error) {
    bool *escapes = core_calloc((size_t)g->count + 1, sizeof *escapes);
    if (escapes == NULL) {
        return core_fail_memory(error, (size_t)g->count + 1, "the plan of a network");
    }
    brace_status status = mark(g, error);
    if (status == BRACE_OK) {
        status = prepare(g, error);
    }
    if (status == BRACE_OK) {
        choose_recomputed(g, escapes);
        status = make_steps(g, error);
    }
    core_free(escapes);
    if (status == BRACE_OK) {
        status = make_buffers(g, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    g->memory_bytes = nn_place(g->buffers, g->buffer_count, g->separate);
    g->memory = g->memory_bytes < SIZE_MAX ? core_alloc(g->memory_bytes, 1) : NULL;
    if (g->memory == NULL) {
        return core_fail_memory(error, g->memory_bytes < SIZE_MAX ? g->memory_bytes : 0, "the network");
    }
    if (g->poison) {
        memset(g->memory, 0xff, g->memory_bytes); /* NaN in every type */
    }
    fill_constants(g);
    return BRACE_OK;
}

brace_status nn_graph_plan(nn_graph *g, const nn_plan_params *params, brace_error *error) {
    if (g->error.status == BRACE_OK && (g->depth != 0 || g->segment != 0)) {
        nn_reject(g, "a scope or a segment of recomputing was not left");
    }
    if (g->error.status == BRACE_OK && g->planned) {
        nn_reject(g, "the network is planned already");
    }
    g->loss = params != NULL ? params->loss : 0;
    if (g->error.status == BRACE_OK && g->loss != 0 && nn_usable(g, g->loss)) {
        const nn_node *node = g->nodes[g->loss];
        if (nn_count(node->shape) != 1 || node->type == NN_BF16 || node->source) {
            nn_reject(g, "the loss must be one number of f32, and computed");
        }
    }
    if (g->error.status == BRACE_OK) {
        brace_error found = {BRACE_OK, ""};
        brace_status status = plan(g, &found);
        g->planned = true;
        if (status != BRACE_OK) {
            g->error = found; /* half a plan is no use: the graph stays unusable */
        }
    }
    return nn_graph_error(g, error);
}
