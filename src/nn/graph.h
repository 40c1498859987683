/* SPDX-License-Identifier: Apache-2.0 */
/*
 * graph.h: what a graph is made of, for graph.c (building), plan.c, place.c
 * (memory) and run.c only.
 *
 * A node makes one value; both have the same number, from 1, in the order in which
 * they were built, which is an order in which they can be computed.
 */
#ifndef NN_GRAPH_H
#define NN_GRAPH_H

#include "nn/node.h"

enum { NN_SCOPE_LENGTH = 512, NN_SCOPE_DEPTH = 64 };

struct nn_node {
    const nn_op *op;
    const char *scope; /* where it was built; of inputs and outputs their name too */
    int inputs;
    nn_value in[NN_MAX_IN];
    nn_shape shape;
    nn_type type;
    void *attributes;
    nn_parameter *parameter[NN_MAX_PARAMETERS];
    int segment;     /* of recomputing, from 1; 0: none */
    bool source;     /* input or constant: filled from outside, never computed */
    bool output;     /* kept to the end */
    bool wants_grad; /* an nn_input_grad, or d loss/d value leads to a parameter or to such an input */

    /* Of the plan. */
    bool needed;     /* an output or the loss depends on it */
    bool backward;   /* has a step in the backward pass */
    bool recomputed; /* has a second forward step there */
    unsigned add;    /* bit i: another node wrote din[i] before */
    int buffer[2];   /* of the value: made in the forward pass, and again in the backward pass */
    int grad;        /* buffer of d loss/d value */
    int saved[2];
    void *kernel;
    const char *kernel_name;
    double flops, seconds[2]; /* forward, backward */
};

/* A stretch of memory that is in use from one step to another, both included. Numbers from 1. */
typedef struct nn_buffer {
    size_t bytes, offset;
    int first, last;
    int same_as; /* another buffer that this one was merged with; 0: none */
} nn_buffer;

typedef enum nn_pass { NN_FORWARD, NN_RECOMPUTE, NN_BACKWARD } nn_pass;

typedef struct nn_step {
    nn_value node;
    nn_pass pass;
    int scratch; /* buffer */
} nn_step;

struct nn_graph {
    nn_weights *weights;
    nn_type type;
    nn_backend backend;
    bool separate, poison;
    brace_job job;
    core_pool *pool;
    core_arena *arena; /* nodes, names, attributes */
    nn_node **nodes;   /* [0] is none */
    int count, room;   /* values 1 .. count */
    brace_error error; /* the first; BRACE_OK: none */
    char scope[NN_SCOPE_LENGTH];
    size_t scope_end[NN_SCOPE_DEPTH];
    int depth, segment, segments;

    bool planned, ran; /* ran: a backward pass may follow */
    nn_value loss;
    nn_buffer *buffers;
    int buffer_count, buffer_room;
    nn_step *steps;
    int step_count, forward_steps;
    unsigned char *memory;
    size_t memory_bytes;
};

/* The sources, whose values the plan fills. */
extern const nn_op nn_op_input, nn_op_constant, nn_op_param;

void nn_fail(nn_graph *g, brace_status status, const char *format, ...) __attribute__((format(printf, 3, 4)));
int nn_buffer_of(const nn_graph *g, int buffer); /* the one that it was merged with in the end */
/* Gives each buffer its offset: bytes in all, or SIZE_MAX where memory ended. */
size_t nn_place(nn_buffer *buffers, int count, bool separate);
/* The call of a step, as far as shapes, types and parameters go, and with its memory once there is one. */
void nn_fill_call(nn_graph *g, nn_call *call, const nn_step *step);
/* The parameters' second half (weights.c): gradients, and double precision. */
brace_status nn_parameter_prepare(nn_parameter *p, nn_type type, bool training, brace_error *error);

#endif
