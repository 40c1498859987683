/* SPDX-License-Identifier: Apache-2.0 */
/* models_test.h: what the tests of the models share: networks whose numbers come from a formula (make_parity.py). */
#ifndef MODELS_TEST_H
#define MODELS_TEST_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "models/models.h"
#include "nn/node.h"

/* Number i of `name`, in [-1, 1); it depends on i modulo 251. */
double test_number(const char *name, size_t i);
void test_ok(brace_status status, const brace_error *error);

/* A graph of a network with the inputs of models_inputs and, if it is to be trained, a loss: the sum of the result
 * times test_number("r", i). Not planned yet. */
typedef struct test_network {
    nn_weights *weights;
    nn_graph *g;
    models_inputs in;
    nn_value y, loss;
} test_network;
brace_status test_network_build(test_network *out, const models_shape *shape, int h, int w,
                                const nn_graph_params *params, bool train, brace_error *error);
void test_network_destroy(test_network *network);
nn_value test_loss(nn_graph *g, nn_value y);

/* After planning. */
void test_fill_inputs(test_network *network);
void test_fill_value(nn_graph *g, nn_value v, const char *name, double low, double high);
void test_fill_weights(nn_weights *weights);

/* As in make_parity.py. */
models_shape test_shape(void);

#endif
