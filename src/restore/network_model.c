/* SPDX-License-Identifier: Apache-2.0 */
/* network_model.c: a file of weights as the network that it belongs to. The file is from anywhere: nothing in it is
 * believed, and a network is only built of arrays that are in it. */
#include <limits.h>
#include <math.h>
#include <string.h>

#include "core/safetensors.h"
#include "restore/network.h"
#include "sim/data_path.h"

static const char default_model[] = "brace-s";
enum { CROP = 128, CROP_LEAST = 16, CROP_MOST = 1024 };

/* Where the weights are; an empty path: nowhere, which only the default may be. */
static brace_status find(char path[PATH_MAX], const char *model, brace_error *error) {
    const char *name = model != NULL ? model : default_model;
    path[0] = '\0';
    if (name[0] == '\0') {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "the name of a model is empty");
    }
    if (strpbrk(name, "/.") != NULL) {
        return snprintf(path, PATH_MAX, "%s", name) < PATH_MAX
                   ? BRACE_OK
                   : core_fail(error, BRACE_ERROR_IO, "%.60s...: the name is too long", name);
    }
    if (sim_data_model(path, name)) {
        return BRACE_OK;
    }
    path[0] = '\0';
    return model == NULL ? BRACE_OK
                         : core_fail(error, BRACE_ERROR_IO,
                                     "%.60s: there are no weights of this name (%.60s.safetensors) among the models "
                                     "that are installed, nor in the folder BRACE_MODELS; a file is named with its "
                                     "folder or its ending",
                                     name, name);
}

/* The side of training's crops, which brace train writes with its configuration. */
static int crop_of(const core_safetensors *file) {
    const char *text = core_safetensors_metadata(file, "training");
    json_t *json = text != NULL ? json_loads(text, 0, NULL) : NULL;
    const json_t *crop = json_object_get(json_object_get(json, "data"), "crop");
    const json_int_t side = json_is_integer(crop) ? json_integer_value(crop) : CROP;
    json_decref(json);
    return side >= CROP_LEAST && side <= CROP_MOST ? (int)side : CROP;
}

brace_status restore_network_open(restore_network **out, const char *model, brace_error *error) {
    char path[PATH_MAX];
    core_safetensors *file = NULL;
    *out = NULL;
    brace_status status = find(path, model, error);
    if (status != BRACE_OK || path[0] == '\0') {
        return status;
    }
    restore_network *n = core_calloc(1, sizeof *n);
    if (n == NULL || (n->path = core_strdup(path)) == NULL) {
        restore_network_close(n);
        return core_fail_memory(error, sizeof *n, "a network");
    }
    status = core_safetensors_open(&file, path, error);
    if (status == BRACE_OK) {
        status = models_shape_of_file(&n->shape, n->name, file, path, error);
        n->side = crop_of(file);
    }
    core_safetensors_close(file);
    if (status == BRACE_OK) {
        status = nn_weights_create(&n->weights, 0, error);
    }
    if (status == BRACE_OK) {
        status = nn_weights_load(n->weights, path, false, error);
    }
    if (status != BRACE_OK) {
        restore_network_close(n);
        return status;
    }
    *out = n;
    return BRACE_OK;
}

void restore_network_close(restore_network *n) {
    if (n != NULL) {
        nn_graph_destroy(n->graph);
        nn_weights_destroy(n->weights);
        core_free(n->path);
        core_free(n);
    }
}

static brace_status check_numbers(const restore_network *n, brace_error *error) {
    for (size_t i = 0; i < nn_weights_count(n->weights); i++) {
        const nn_parameter *p = nn_weights_at(n->weights, i);
        for (size_t k = 0; k < p->count; k++) {
            if (!isfinite(p->value[k])) {
                return core_fail(error, BRACE_ERROR_FORMAT,
                                 "%s: the weights '%s' have a number that is none (%g); the file is damaged, or its "
                                 "training went wrong",
                                 n->path, p->name, (double)p->value[k]);
            }
        }
    }
    return BRACE_OK;
}

brace_status restore_network_plan(restore_network *n, int width, int height, brace_precision precision,
                                  const brace_job *job, brace_error *error) {
    nn_graph_destroy(n->graph);
    n->graph = NULL;
    n->type = precision == BRACE_PRECISION_BF16 || (precision == BRACE_PRECISION_DEFAULT && nn_bf16_is_fast()) ? NN_BF16
                                                                                                              : NN_F32;
    const nn_graph_params params = {.type = n->type, .job = job};
    brace_status status = nn_graph_create(&n->graph, n->weights, &params, error);
    if (status != BRACE_OK) {
        return status;
    }
    nn_graph *g = n->graph;
    n->inputs = models_inputs_create(g, models_views(&n->shape), height, width);
    n->output = models_build(g, &n->shape, &n->inputs);
    n->output = nn_type_of(g, n->output) == NN_F32 ? n->output : nn_cast(g, n->output, NN_F32);
    nn_output(g, "restored", n->output);
    status = nn_graph_plan(g, NULL, error);
    if (status != BRACE_OK && status != BRACE_ERROR_MEMORY && error != NULL && strstr(error->message, n->path) == NULL) {
        core_error_prefix(error, n->path);
    }
    return status == BRACE_OK ? check_numbers(n, error) : status;
}
