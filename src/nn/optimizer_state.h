/* SPDX-License-Identifier: Apache-2.0 */
/* optimizer_state.h: what an optimizer is made of, for optimizer.c and optimizer_file.c only. */
#ifndef NN_OPTIMIZER_STATE_H
#define NN_OPTIMIZER_STATE_H

#include "nn/optimizer.h"

/* A parameter and what is kept beside it. */
typedef struct nn_slot {
    nn_parameter *parameter;
    float *moment1, *moment2, *average; /* average: NULL where none is kept */
    bool decays;
} nn_slot;

/* Some of a parameter's numbers: what a worker takes at a time. */
typedef struct nn_stretch {
    size_t slot, begin, count;
} nn_stretch;

struct nn_optimizer {
    nn_adamw params;
    nn_weights *weights;
    core_pool *pool;
    nn_slot *slots;
    size_t slot_count;
    nn_stretch *stretches;
    double *squares; /* of each stretch */
    size_t stretch_count;
    float *memory;
    uint64_t steps, skipped;
};

#endif
