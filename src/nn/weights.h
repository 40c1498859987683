/* SPDX-License-Identifier: Apache-2.0 */
/* weights.h: what a set of parameters is made of, for weights.c and weights_file.c only. */
#ifndef NN_WEIGHTS_H
#define NN_WEIGHTS_H

#include "nn/nn.h"

/* An array of a file that no parameter asked for yet. */
typedef struct nn_kept {
    struct nn_kept *next;
    char *name;
    int rank, shape[NN_RANK_MAX];
    size_t count;
    float *value;
} nn_kept;

struct nn_weights {
    uint64_t seed;
    nn_parameter **items;
    size_t count, room;
    nn_kept *kept;
    char *complete; /* a file that must have every parameter; NULL: none */
};

bool nn_same_shape(int rank_a, const int *a, int rank_b, const int *b);
/* "64 x 3 x 3 x 3" */
const char *nn_shape_text(char *text, size_t size, int rank, const int *shape);

#endif
