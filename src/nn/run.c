/* SPDX-License-Identifier: Apache-2.0 */
/*
 * run.c: walks through the steps of a plan. Denormal numbers are flushed to zero
 * meanwhile, in the caller as in the pool's workers: they slow kernels a
 * hundredfold, and a result must not depend on who computed it.
 */
#include <string.h>

#include "nn/graph.h"

static void *memory_of(const nn_graph *g, int buffer) {
    return buffer != 0 && g->memory != NULL ? g->memory + g->buffers[nn_buffer_of(g, buffer)].offset : NULL;
}

static nn_view view_of(const nn_graph *g, nn_value v, int buffer) {
    return (nn_view){memory_of(g, buffer), g->nodes[v]->shape, g->nodes[v]->type};
}

void nn_fill_call(nn_graph *g, nn_call *call, const nn_step *step) {
    const nn_node *node = g->nodes[step->node];
    const bool backward = step->pass == NN_BACKWARD;
    memset(call, 0, sizeof *call);
    call->node = node;
    call->attributes = node->attributes;
    call->inputs = node->inputs;
    call->kernel = node->kernel;
    call->pool = g->pool;
    memcpy(call->parameter, node->parameter, sizeof call->parameter);
    for (int i = 0; i < node->inputs; i++) {
        nn_node *in = g->nodes[node->in[i]];
        const bool there = !backward || (node->op->keeps & 1u << i) != 0;
        const int again = step->pass != NN_FORWARD && in->recomputed;
        call->in[i] = view_of(g, node->in[i], there ? in->buffer[again] : 0);
        call->din[i] = view_of(g, node->in[i], backward && in->wants_grad ? in->grad : 0);
        call->add[i] = (node->add & 1u << i) != 0;
    }
    const bool out = !backward || (node->op->keeps & NN_KEEP_OUT) != 0;
    const int again = step->pass != NN_FORWARD && node->recomputed;
    call->out = view_of(g, step->node, out ? node->buffer[again] : 0);
    call->dout = view_of(g, step->node, backward ? node->grad : 0);
    call->saved = memory_of(g, node->saved[again]);
    call->scratch = memory_of(g, step->scratch);
}

/* What dies with step t, or before the first, is made useless. */
static void poison(nn_graph *g, int t) {
    for (int b = 1; b <= g->buffer_count && g->poison; b++) {
        const nn_buffer *x = &g->buffers[b];
        if (x->same_as == 0 && (x->last == t || (t == -1 && x->first >= 0))) {
            memset(g->memory + x->offset, 0xff, x->bytes);
        }
    }
}

static brace_status run_steps(nn_graph *g, int begin, int end, brace_error *error) {
    brace_status status = BRACE_OK;
    const unsigned old = core_denormals_off();
    for (int t = begin; t < end && status == BRACE_OK; t++) {
        const nn_step *step = &g->steps[t];
        nn_node *node = g->nodes[step->node];
        status = core_check_cancel(&g->job, error);
        if (status == BRACE_OK && (step->pass == NN_BACKWARD || !node->op->view)) {
            nn_call call;
            nn_fill_call(g, &call, step);
            const double start = core_seconds();
            if (step->pass == NN_BACKWARD) {
                node->op->backward(&call);
            } else {
                node->op->forward(&call);
            }
            node->seconds[step->pass != NN_FORWARD] += core_seconds() - start;
        }
        poison(g, t);
    }
    core_denormals_restore(old);
    return status;
}

static void forget_seconds(nn_graph *g, int pass) {
    for (int v = 1; v <= g->count; v++) {
        g->nodes[v]->seconds[pass] = 0;
    }
}

brace_status nn_forward(nn_graph *g, brace_error *error) {
    if (g->memory == NULL) {
        return g->error.status != BRACE_OK ? nn_graph_error(g, error)
                                           : core_fail(error, BRACE_ERROR_ARGUMENT, "the network was not planned");
    }
    forget_seconds(g, 0);
    poison(g, -1);
    brace_status status = run_steps(g, 0, g->forward_steps, error);
    g->ran = status == BRACE_OK;
    return status;
}

brace_status nn_backward(nn_graph *g, double scale, brace_error *error) {
    if (!g->ran || g->loss == 0) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "a backward pass needs a loss, and a forward pass before it");
    }
    g->ran = false; /* what was kept is used up */
    forget_seconds(g, 1);
    void *start = memory_of(g, g->nodes[g->loss]->grad);
    if (g->nodes[g->loss]->type == NN_F64) {
        *(double *)start = scale;
    } else {
        *(float *)start = (float)scale;
    }
    return run_steps(g, g->forward_steps, g->step_count, error);
}

/* ---- looking at a graph ---- */

void *nn_data(nn_graph *g, nn_value v) {
    if (g->memory == NULL || v < 1 || v > g->count) {
        return NULL;
    }
    const nn_node *node = g->nodes[v];
    const bool kept = node->needed && (node->source || node->output || v == g->loss);
    return kept ? memory_of(g, node->buffer[0]) : NULL;
}

void *nn_grad(nn_graph *g, nn_value v) {
    if (g->memory == NULL || v < 1 || v > g->count || !g->nodes[v]->source) {
        return NULL;
    }
    return memory_of(g, g->nodes[v]->grad);
}

size_t nn_graph_memory(const nn_graph *g) {
    return g->memory_bytes;
}

void nn_graph_print(const nn_graph *g, FILE *out) {
    fprintf(out, "%6s  %-40s %-14s %-22s %-14s %10s %9s %9s\n", "node", "layer", "operation", "shape", "kernel",
            "MFLOP", "forward", "backward");
    double flops = 0, seconds[2] = {0, 0};
    for (int v = 1; v <= g->count; v++) {
        const nn_node *node = g->nodes[v];
        char shape[64];
        if (!node->needed && g->planned) {
            continue;
        }
        snprintf(shape, sizeof shape, "%dx%dx%dx%d %s", node->shape.n, node->shape.h, node->shape.w, node->shape.c,
                 node->type == NN_F64    ? "f64"
                 : node->type == NN_BF16 ? "bf16"
                                         : "f32");
        fprintf(out, "%6d  %-40s %-14s %-22s %-14s %10.2f %9.3f %9.3f\n", v, node->scope, node->op->name, shape,
                node->kernel_name != NULL ? node->kernel_name : "", node->flops / 1e6, node->seconds[0] * 1e3,
                node->seconds[1] * 1e3);
        flops += node->flops;
        seconds[0] += node->seconds[0];
        seconds[1] += node->seconds[1];
    }
    fprintf(out, "%.3f GFLOP, %.1f MiB; %.3f ms forward, %.3f ms backward\n", flops / 1e9,
            (double)g->memory_bytes / 1048576, seconds[0] * 1e3, seconds[1] * 1e3);
}
