/* SPDX-License-Identifier: Apache-2.0 */
/* network.c: a network and its losses as one graph of one bracket; a batch is several runs that add gradients up. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/safetensors.h"
#include "train/train.h"

static const char own[] = "loss."; /* parameters of the losses: the directions of MS-SWD */

brace_status train_network_create(train_network *out, const train_config *config, const train_model *model,
                                  const brace_job *job, brace_error *error) {
    *out = (train_network){0};
    if (model == NULL && !config->known) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "model: \"%s\" is none of %s", config->model, models_names);
    }
    const int views = config->data.frames + config->data.guide, side = config->data.side;
    brace_status status = nn_weights_create(&out->weights, config->seed, error);
    if (status == BRACE_OK && config->initial != NULL) {
        status = nn_weights_load(out->weights, config->initial, false, error);
    }
    if (status == BRACE_OK && config->loss.color > 0) { /* no file has these */
        status = train_msswd_draw(out->weights, own, &config->loss.msswd, config->seed, error);
    }
    if (status == BRACE_OK) {
        const nn_graph_params params = {.type = config->bf16 ? NN_BF16 : NN_F32, .job = job};
        status = nn_graph_create(&out->graph, out->weights, &params, error);
    }
    if (status == BRACE_OK) {
        nn_graph *g = out->graph;
        out->inputs = models_inputs_create(g, views, side, side);
        nn_value alone = 0;
        out->prediction = model != NULL ? model->build(model->user, g, &out->inputs)
                                        : models_build_trained(g, &config->shape, &out->inputs, &alone);
        if (nn_type_of(g, out->prediction) == NN_BF16) {
            out->prediction = nn_cast(g, out->prediction, NN_F32);
        }
        nn_output(g, "prediction", out->prediction);
        out->loss = train_loss_build(g, out->weights, out->prediction, alone, &config->loss);
        status = nn_graph_plan(g, &(nn_plan_params){.loss = out->loss.total}, error);
    }
    if (status != BRACE_OK) {
        train_network_destroy(out);
    }
    return status;
}

void train_network_destroy(train_network *network) {
    nn_graph_destroy(network->graph);
    nn_weights_destroy(network->weights);
    *network = (train_network){0};
}

static void fill(nn_graph *g, nn_value v, const float *from) {
    void *to = v != 0 ? nn_data(g, v) : NULL; /* NULL: the network has no use for it */
    if (to != NULL) {
        memcpy(to, from, nn_bytes(g, v));
    }
}

brace_status train_network_run(train_network *n, const train_sample *sample, double parts[TRAIN_PARTS],
                               brace_error *error) {
    nn_graph *g = n->graph;
    fill(g, n->inputs.frames, sample->input);
    fill(g, n->inputs.flow, sample->flow);
    fill(g, n->inputs.white, sample->white);
    fill(g, n->inputs.descriptors, &sample->descriptor[0][0]);
    fill(g, n->inputs.rho, sample->rho);
    float balance[8];
    models_balance(balance, (const double[3]){sample->gains[0], sample->gains[1], sample->gains[2]});
    fill(g, n->inputs.balance, balance);
    fill(g, n->inputs.sigma, sample->sigma);
    fill(g, n->loss.truth, sample->truth);
    fill(g, n->loss.gains, sample->gains);
    fill(g, n->loss.matrix, sample->matrix);
    brace_status status = nn_forward(g, error);
    const nn_value values[TRAIN_PARTS] = {n->loss.total, n->loss.l1, n->loss.wavelet, n->loss.color, n->loss.alone};
    for (int i = 0; i < TRAIN_PARTS && status == BRACE_OK; i++) {
        parts[i] = values[i] != 0 ? (double)*(const float *)nn_data(g, values[i]) : 0;
    }
    return status;
}

brace_status train_network_save(const train_network *n, const char *path, const train_config *config, uint64_t step,
                                brace_error *error) {
    char *text = json_dumps(config->json, JSON_COMPACT | JSON_SORT_KEYS), number[32];
    json_t *shape = config->known ? models_shape_json(&config->shape) : json_object();
    char *network = json_dumps(shape, JSON_COMPACT);
    json_decref(shape);
    if (text == NULL || network == NULL) {
        free(text);
        free(network);
        return core_fail_memory(error, 4096, "the configuration");
    }
    snprintf(number, sizeof number, "%llu", (unsigned long long)step);
    size_t reserve = 4096 + 2 * (strlen(text) + strlen(network));
    for (size_t i = 0; i < nn_weights_count(n->weights); i++) {
        reserve += 6 * strlen(nn_weights_at(n->weights, i)->name) + 256;
    }
    core_safetensors_writer *writer = NULL;
    brace_status status = core_safetensors_create(&writer, path, reserve, error);
    const char *const metadata[][2] = {{"model", config->model}, {"network", network}, {"training", text}, {"steps", number}};
    for (size_t i = 0; i < 4 && status == BRACE_OK; i++) {
        status = core_safetensors_add_metadata(writer, metadata[i][0], metadata[i][1], error);
    }
    for (size_t i = 0; i < nn_weights_count(n->weights) && status == BRACE_OK; i++) {
        const nn_parameter *p = nn_weights_at(n->weights, i);
        core_tensor t = {.name = p->name, .dtype = CORE_F32, .rank = p->rank, .data = p->value};
        for (int k = 0; k < p->rank; k++) {
            t.shape[k] = (uint64_t)p->shape[k];
        }
        if (strncmp(p->name, own, sizeof own - 1) != 0) {
            status = core_safetensors_add(writer, &t, error);
        }
    }
    free(text);
    free(network);
    if (status != BRACE_OK) {
        core_safetensors_abort(writer);
        return status;
    }
    return core_safetensors_commit(writer, error);
}
