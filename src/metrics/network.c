/* SPDX-License-Identifier: Apache-2.0 */
/*
 * network.c: the networks that LPIPS and DISTS look through, layer by layer, and their weights.
 */
#include "metrics/perceptual.h"

#include <math.h>
#include <stdio.h>

#define CONV(number, kernel, stride, pad, in, out, tap)                                                                \
    { METRICS_LAYER_CONV, number, kernel, stride, pad, in, out, 0, tap }
#define FIRE(number, in, squeeze, out, tap)                                                                            \
    { METRICS_LAYER_FIRE, number, 3, 1, 1, in, out, squeeze, tap }
#define MAX(kernel)                                                                                                    \
    { METRICS_LAYER_MAX, 0, kernel, 2, 0, 0, 0, 0, false }
#define L2                                                                                                             \
    { METRICS_LAYER_L2, 0, 3, 2, 1, 0, 0, 0, false }

static const metrics_layer alex[] = {CONV(0, 11, 4, 2, 3, 64, true),    MAX(3),
                                     CONV(3, 5, 1, 2, 64, 192, true),   MAX(3),
                                     CONV(6, 3, 1, 1, 192, 384, true),  CONV(8, 3, 1, 1, 384, 256, true),
                                     CONV(10, 3, 1, 1, 256, 256, true), {0}};

#define VGG(POOL)                                                                                                      \
    CONV(0, 3, 1, 1, 3, 64, false), CONV(2, 3, 1, 1, 64, 64, true), POOL, CONV(5, 3, 1, 1, 64, 128, false),            \
        CONV(7, 3, 1, 1, 128, 128, true), POOL, CONV(10, 3, 1, 1, 128, 256, false),                                    \
        CONV(12, 3, 1, 1, 256, 256, false), CONV(14, 3, 1, 1, 256, 256, true), POOL,                                   \
        CONV(17, 3, 1, 1, 256, 512, false), CONV(19, 3, 1, 1, 512, 512, false), CONV(21, 3, 1, 1, 512, 512, true),     \
        POOL, CONV(24, 3, 1, 1, 512, 512, false), CONV(26, 3, 1, 1, 512, 512, false),                                  \
        CONV(28, 3, 1, 1, 512, 512, true), {                                                                           \
        0                                                                                                              \
    }

static const metrics_layer vgg[] = {VGG(MAX(2))};
static const metrics_layer vgg_l2[] = {VGG(L2)};

/* SqueezeNet 1.1: its pools count windows that reach over the end. */
static const metrics_layer squeeze[] = {CONV(0, 3, 2, 0, 3, 64, true),
                                        MAX(3),
                                        FIRE(3, 64, 16, 128, false),
                                        FIRE(4, 128, 16, 128, true),
                                        MAX(3),
                                        FIRE(6, 128, 32, 256, false),
                                        FIRE(7, 256, 32, 256, true),
                                        MAX(3),
                                        FIRE(9, 256, 48, 384, true),
                                        FIRE(10, 384, 48, 384, true),
                                        FIRE(11, 384, 64, 512, true),
                                        FIRE(12, 512, 64, 512, true),
                                        {0}};

static const metrics_network kinds[] = {
    [BRACE_LPIPS_ALEX] = {"lpips-alex", alex, 2, false},
    [BRACE_LPIPS_VGG] = {"lpips-vgg", vgg, 1, false},
    [BRACE_LPIPS_SQUEEZE] = {"lpips-squeeze", squeeze, 1, true},
    [BRACE_DISTS] = {"dists", vgg_l2, 1, false},
};
enum { KINDS = sizeof kinds / sizeof kinds[0] };

const char *brace_perceptual_name(brace_perceptual_kind kind) {
    return (unsigned)kind < KINDS ? kinds[kind].name : "?";
}

/* ---- weights ---- */

void brace_perceptual_destroy(brace_perceptual *m) {
    if (m == NULL) {
        return;
    }
    for (int i = 0; i < METRICS_LAYERS; i++) {
        metrics_weights_free(&m->weights[i].conv);
        metrics_weights_free(&m->weights[i].squeeze);
        metrics_weights_free(&m->weights[i].expand);
    }
    for (int i = 0; i < METRICS_TAPS; i++) {
        core_free(m->head[i]);
    }
    core_free(m->alpha);
    core_free(m->beta);
    core_free(m);
}

typedef struct loader {
    brace_perceptual *metric;
    metrics_tensor_fn *tensor;
    void *arg;
    brace_error *error;
} loader;

static brace_status check_finite(const float *v, size_t n, const char *name, brace_error *error) {
    for (size_t i = 0; i < n; i++) {
        if (!isfinite(v[i])) {
            return core_fail(error, BRACE_ERROR_FORMAT, "the weights '%s' hold infinite values or NaN", name);
        }
    }
    return BRACE_OK;
}

/* PREFIX.weight and PREFIX.bias */
static brace_status load_conv(const loader *l, metrics_weights *w, const char *prefix) {
    char name[64];
    const size_t count = w->out * w->in * w->kernel * w->kernel;
    const size_t shape[4] = {w->out, w->in, w->kernel, w->kernel}, bias_shape[4] = {w->out, 0, 0, 0};
    float *values = core_alloc(count + w->out, sizeof *values);
    if (values == NULL) {
        return core_fail_memory(l->error, count * sizeof *values, "the weights of a network");
    }
    snprintf(name, sizeof name, "%s.weight", prefix);
    brace_status status = l->tensor(l->arg, values, name, shape, l->error);
    if (status == BRACE_OK) {
        status = check_finite(values, count, name, l->error);
    }
    if (status == BRACE_OK) {
        snprintf(name, sizeof name, "%s.bias", prefix);
        status = l->tensor(l->arg, values + count, name, bias_shape, l->error);
    }
    if (status == BRACE_OK) {
        status = check_finite(values + count, w->out, name, l->error);
    }
    if (status == BRACE_OK && !metrics_weights_pack(w, l->metric->kernels, values, values + count)) {
        status = core_fail_memory(l->error, count * sizeof *values, "the weights of a network");
    }
    core_free(values);
    return status;
}

static brace_status load_layer(const loader *l, metrics_layer_weights *w, const metrics_layer *y) {
    char prefix[48];
    snprintf(prefix, sizeof prefix, "features.%d", y->number);
    if (y->kind == METRICS_LAYER_CONV) {
        w->conv = (metrics_weights){NULL, NULL, y->kernel, y->stride, y->pad, y->in, y->out};
        return load_conv(l, &w->conv, prefix);
    }
    if (y->kind != METRICS_LAYER_FIRE) {
        return BRACE_OK;
    }
    w->squeeze = (metrics_weights){NULL, NULL, 1, 1, 0, y->in, y->squeeze};
    w->expand = (metrics_weights){NULL, NULL, 1, 1, 0, y->squeeze, y->out / 2};
    w->conv = (metrics_weights){NULL, NULL, 3, 1, 1, y->squeeze, y->out / 2};
    snprintf(prefix, sizeof prefix, "features.%d.squeeze", y->number);
    brace_status status = load_conv(l, &w->squeeze, prefix);
    if (status == BRACE_OK) {
        snprintf(prefix, sizeof prefix, "features.%d.expand1x1", y->number);
        status = load_conv(l, &w->expand, prefix);
    }
    if (status == BRACE_OK) {
        snprintf(prefix, sizeof prefix, "features.%d.expand3x3", y->number);
        status = load_conv(l, &w->conv, prefix);
    }
    return status;
}

static brace_status load_vector(const loader *l, float **out, size_t count, const char *name) {
    const size_t shape[4] = {1, count, 1, 1};
    *out = core_alloc(count, sizeof **out);
    if (*out == NULL) {
        return core_fail_memory(l->error, count * sizeof **out, "the weights of a metric");
    }
    brace_status status = l->tensor(l->arg, *out, name, shape, l->error);
    return status == BRACE_OK ? check_finite(*out, count, name, l->error) : status;
}

static brace_status load(const loader *l) {
    brace_perceptual *m = l->metric;
    const metrics_layer *layers = m->network->layers;
    size_t total = 0;
    if (m->kind == BRACE_DISTS) {
        m->channels[m->taps++] = 3;
        total = 3;
    }
    for (int i = 0; layers[i].kind != METRICS_LAYER_END; i++) {
        brace_status status = load_layer(l, &m->weights[i], &layers[i]);
        if (status != BRACE_OK) {
            return status;
        }
        if (layers[i].tap) {
            m->channels[m->taps++] = layers[i].out;
            total += layers[i].out;
        }
    }
    if (m->kind == BRACE_DISTS) {
        brace_status status = load_vector(l, &m->alpha, total, "alpha");
        return status == BRACE_OK ? load_vector(l, &m->beta, total, "beta") : status;
    }
    for (size_t t = 0; t < m->taps; t++) {
        char name[32];
        snprintf(name, sizeof name, "lin%zu.model.1.weight", t);
        brace_status status = load_vector(l, &m->head[t], m->channels[t], name);
        if (status != BRACE_OK) {
            return status;
        }
    }
    return BRACE_OK;
}

brace_status metrics_perceptual_create(brace_perceptual **out, brace_perceptual_kind kind, metrics_tensor_fn *tensor,
                                       void *arg, brace_error *error) {
    *out = NULL;
    if ((unsigned)kind >= KINDS) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "there is no perceptual metric number %d", (int)kind);
    }
    brace_perceptual *m = core_calloc(1, sizeof *m);
    if (m == NULL) {
        return core_fail_memory(error, sizeof *m, "a metric");
    }
    m->kind = kind;
    m->network = &kinds[kind];
    m->kernels = metrics_kernels_for(core_cpu_features());
    const loader l = {m, tensor, arg, error};
    brace_status status = load(&l);
    if (status != BRACE_OK) {
        brace_perceptual_destroy(m);
        return status;
    }
    *out = m;
    return BRACE_OK;
}
