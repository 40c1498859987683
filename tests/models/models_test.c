/* SPDX-License-Identifier: Apache-2.0 */
/* models_test.c: networks whose numbers come from a formula. */
#include "models_test.h"

#include <math.h>

enum { PERIOD = 251 };

double test_number(const char *name, size_t i) {
    uint32_t x = 2166136261u;
    for (const unsigned char *p = (const unsigned char *)name; *p != '\0'; p++) {
        x = (x ^ *p) * 16777619u;
    }
    x += (uint32_t)(i % PERIOD) * 2654435769u;
    x = (x ^ x >> 16) * 0x7feb352du;
    x = (x ^ x >> 15) * 0x846ca68bu;
    x ^= x >> 16;
    return (double)(x >> 8) / (1 << 23) - 1;
}

void test_ok(brace_status status, const brace_error *error) {
    if (status != BRACE_OK) {
        fail_msg("%s", error->message);
    }
}

models_shape test_shape(void) {
    return (models_shape){.frames = 5, .channels = 16, .unshuffle = 1, .extract = 1, .global = 2, .frame = 1,
                          .reconstruct = 1, .offset = 1, .groups = 2};
}

nn_value test_loss(nn_graph *g, nn_value y) {
    const nn_shape s = nn_shape_of(g, y);
    float *r = y != 0 ? core_alloc(nn_count(s), sizeof *r) : NULL;
    if (r == NULL) {
        return 0;
    }
    for (size_t i = 0; i < nn_count(s); i++) {
        r[i] = (float)test_number("r", i);
    }
    const nn_value loss = nn_sum(g, nn_mul(g, y, nn_constant(g, s, r)), true, true, true, true);
    core_free(r);
    return loss;
}

brace_status test_network_build(test_network *out, const models_shape *shape, int h, int w,
                                const nn_graph_params *params, bool train, brace_error *error) {
    *out = (test_network){0};
    brace_status status = nn_weights_create(&out->weights, 1, error);
    if (status == BRACE_OK) {
        status = nn_graph_create(&out->g, out->weights, params, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    nn_graph *g = out->g;
    out->in = models_inputs_create(g, models_views(shape), h, w);
    nn_value alone;
    out->y = train ? models_build_trained(g, shape, &out->in, &alone) : models_build(g, shape, &out->in);
    nn_output(g, "y", out->y);
    out->loss = train ? test_loss(g, out->y) : 0;
    return nn_graph_error(g, error);
}

void test_network_destroy(test_network *network) {
    nn_graph_destroy(network->g);
    nn_weights_destroy(network->weights);
}

void test_fill_value(nn_graph *g, nn_value v, const char *name, double low, double high) {
    void *data = nn_data(g, v);
    for (size_t i = 0; data != NULL && i < nn_count(nn_shape_of(g, v)); i++) {
        const float x = (float)(test_number(name, i) * (0.5 * (high - low)) + 0.5 * (high + low));
        if (nn_type_of(g, v) == NN_F64) {
            ((double *)data)[i] = (double)x;
        } else {
            ((float *)data)[i] = x;
        }
    }
}

void test_fill_inputs(test_network *n) {
    test_fill_value(n->g, n->in.frames, "frames", -0.1, 1.1);
    test_fill_value(n->g, n->in.flow, "flow", -3, 3);
    test_fill_value(n->g, n->in.white, "white", 0.9, 1.5);
    test_fill_value(n->g, n->in.descriptors, "descriptors", -1, 1);
    test_fill_value(n->g, n->in.rho, "rho", 0, 1);
    test_fill_value(n->g, n->in.balance, "balance", 0.7, 2);
    test_fill_value(n->g, n->in.sigma, "sigma", 0.01, 0.3);
}

/* Weights as large as they begin, biases up to 0.1, gates up to 0.5: nothing is zero that begins so. */
void test_fill_weights(nn_weights *weights) {
    for (size_t k = 0; k < nn_weights_count(weights); k++) {
        nn_parameter *p = nn_weights_at(weights, k);
        const double fan_in = (double)p->count / p->shape[0];
        const double bound = p->rank == 1 ? 0.1 : p->rank == 5 ? 0.5 : 1 / sqrt(fan_in);
        for (size_t i = 0; i < p->count; i++) {
            p->value[i] = (float)(test_number(p->name, i) * bound);
            if (p->value64 != NULL) {
                p->value64[i] = (double)p->value[i];
            }
        }
    }
    nn_weights_changed(weights);
}
