/* SPDX-License-Identifier: Apache-2.0 */
/* nn_test.h: what the tests of networks share. */
#ifndef NN_TEST_H
#define NN_TEST_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "nn/node.h"

enum { MOST_INPUTS = 4 };

/* One operation on small tensors: every operation has at least one. */
typedef struct op_case {
    const char *name;
    nn_shape shape[MOST_INPUTS]; /* of the inputs; n = 0: no more */
    double low, high;            /* of the inputs' random numbers */
    nn_value (*build)(nn_graph *g, const nn_value *x);
} op_case;

extern const op_case op_cases[];
extern const size_t op_case_count;

/* A number in [low, high) that depends on all arguments only. */
double test_number(uint64_t seed, uint32_t tensor, size_t index, double low, double high);
void test_ok(brace_status status, const brace_error *error);
void test_fill(nn_graph *g, nn_value v, uint64_t seed, uint32_t tensor, double low, double high);
double test_get(const void *data, nn_type type, size_t i);
void test_set(void *data, nn_type type, size_t i, double value);

#endif
