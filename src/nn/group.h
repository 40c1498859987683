/* SPDX-License-Identifier: Apache-2.0 */
/*
 * group.h: processes that train one network together, each with its share of a
 * batch (data parallel). Internal.
 *
 *     nn_group_alone(&group, error);  or  nn_group_mpi(&group, error);
 *     nn_group_share_weights(group, weights, error);   // all begin with rank 0's
 *     for (each batch) {
 *         nn_forward(g, error), nn_backward(g, 1, error);
 *         nn_group_sum_gradients(group, weights, error);
 *         nn_optimizer_step(o, rate, 1.0/nn_group_size(group), NULL);
 *     }
 *
 * All processes then hold the same weights without sending them again, since sums
 * are the same bytes everywhere: number i is added up by one process, from rank 0's
 * to the last rank's, in f32, and sent to all.
 *
 * Every process calls the same functions in the same order. One that cannot go on
 * calls nn_group_give_up and exits; mpirun then ends the others, which would wait for
 * it: there is no group with a part missing.
 * Thread safety: one thread of a process uses its group.
 */
#ifndef NN_GROUP_H
#define NN_GROUP_H

#include "nn/nn.h"

typedef struct nn_group nn_group;

brace_status nn_group_alone(nn_group **out, brace_error *error); /* this process only */
#ifdef NN_HAVE_MPI
/* All processes that mpirun started (group_mpi.c). Once a process: MPI cannot be begun again. */
brace_status nn_group_mpi(nn_group **out, brace_error *error);
#endif
/* With MPI it waits for all others. NULL is allowed. */
void nn_group_destroy(nn_group *group);
void nn_group_give_up(nn_group *group); /* the same without waiting, after an error */

int nn_group_rank(const nn_group *group); /* 0 .. size - 1 */
int nn_group_size(const nn_group *group);

/* Each number becomes the sum of all processes'. `count` is the same everywhere. */
brace_status nn_group_sum(nn_group *group, float *values, size_t count, brace_error *error);
/* Rank 0's bytes to all. */
brace_status nn_group_share(nn_group *group, void *bytes, size_t size, brace_error *error);
brace_status nn_group_wait(nn_group *group, brace_error *error); /* until all are here */

/* The gradients of all parameters that have some and are not frozen, and the values of all parameters. A check that
 * all processes have the same parameters comes first. */
brace_status nn_group_sum_gradients(nn_group *group, nn_weights *weights, brace_error *error);
brace_status nn_group_share_weights(nn_group *group, nn_weights *weights, brace_error *error);

/* ---- for kinds of groups ---- */

typedef struct nn_group_kind {
    brace_status (*sum)(nn_group *group, float *values, size_t count, brace_error *error);
    brace_status (*share)(nn_group *group, void *bytes, size_t size, brace_error *error);
    brace_status (*wait)(nn_group *group, brace_error *error);
    void (*leave)(nn_group *group);
} nn_group_kind;

enum { NN_GROUP_CHUNK = 1 << 18 }; /* numbers at a time, a megabyte: memory is bounded */

struct nn_group {
    const nn_group_kind *kind;
    int rank, size;
    float *room; /* NN_GROUP_CHUNK numbers: gradients on their way. NULL alone, like what follows */
    float *chunk, *parts; /* the part that this process adds up, and what all sent of it */
};

#endif
