/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cmd_model.c: brace model: what a file of weights is, and the same weights in another file: smaller, or out of a
 * PyTorch checkpoint.
 */
#include "cli/cli.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/safetensors.h"
#include "models/models.h"

static const char command[] = "model";

enum { SIDE = 64 }; /* of the picture that the network is built for, to learn which weights it has */

typedef struct model_file {
    const char *path;
    char name[MODELS_NAME];
    models_shape shape;
    char *training, *steps; /* metadata; NULL: none */
    nn_weights *weights;
    nn_graph *graph;
} model_file;

static brace_status copy_text(char **out, const core_safetensors *file, const char *key, brace_error *error) {
    const char *text = core_safetensors_metadata(file, key);
    *out = text != NULL ? core_strdup(text) : NULL;
    return text == NULL || *out != NULL ? BRACE_OK : core_fail_memory(error, strlen(text), key);
}

/* What a file that brace wrote says of itself. */
static brace_status read_metadata(model_file *m, const core_safetensors *file, brace_error *error) {
    brace_status status = models_shape_of_file(&m->shape, m->name, file, m->path, error);
    if (status == BRACE_OK) {
        status = copy_text(&m->training, file, "training", error);
    }
    return status == BRACE_OK ? copy_text(&m->steps, file, "steps", error) : status;
}

static brace_status load(model_file *m, brace_error *error) {
    core_safetensors *file = NULL;
    brace_error ignored = {0};
    brace_status status = BRACE_OK;
    if (core_safetensors_open(&file, m->path, &ignored) == BRACE_OK) {
        status = read_metadata(m, file, error);
        core_safetensors_close(file);
    } else if (m->name[0] == '\0') { /* perhaps a checkpoint of PyTorch, which says nothing of its network */
        return core_fail(error, BRACE_ERROR_ARGUMENT,
                         "%s; for a checkpoint of PyTorch, --network says of which network", ignored.message);
    } else {
        models_shape_named(&m->shape, m->name);
    }
    if (status == BRACE_OK) {
        status = nn_weights_create(&m->weights, 0, error);
    }
    if (status == BRACE_OK) {
        status = nn_weights_load(m->weights, m->path, false, error);
    }
    if (status == BRACE_OK) {
        status = nn_graph_create(&m->graph, m->weights, NULL, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    nn_graph *g = m->graph;
    const models_inputs in = models_inputs_create(g, models_views(&m->shape), SIDE, SIDE);
    nn_output(g, "restored", models_build(g, &m->shape, &in));
    status = nn_graph_plan(g, NULL, error);
    if (status != BRACE_OK) {
        core_error_prefix(error, m->path);
    }
    return status;
}

static void unload(model_file *m) {
    nn_graph_destroy(m->graph);
    nn_weights_destroy(m->weights);
    core_free(m->training);
    core_free(m->steps);
}

static brace_status save(const model_file *m, const char *path, const char *type, brace_error *error) {
    json_t *shape = models_shape_json(&m->shape);
    char *network = shape != NULL ? json_dumps(shape, JSON_COMPACT) : NULL;
    json_decref(shape);
    if (network == NULL) {
        return core_fail_memory(error, 1024, "the network's shape");
    }
    const char *metadata[9] = {"model", m->name, "network", network, NULL};
    int n = 4;
    if (m->training != NULL) {
        metadata[n++] = "training", metadata[n++] = m->training;
    }
    if (m->steps != NULL) {
        metadata[n++] = "steps", metadata[n++] = m->steps;
    }
    metadata[n] = NULL;
    const brace_status status = nn_weights_save(m->weights, path, type, metadata, error);
    free(network);
    return status;
}

static size_t parameters(const model_file *m) {
    size_t count = 0;
    for (size_t i = 0; i < nn_weights_count(m->weights); i++) {
        count += nn_weights_at(m->weights, i)->count;
    }
    return count;
}

/* Multiplications and additions a packed pixel: of the whole bracket. */
static double flops(const model_file *m) {
    return nn_graph_flops(m->graph) / (SIDE * SIDE);
}

static json_t *to_json(const model_file *m) {
    json_t *training = m->training != NULL ? json_loads(m->training, 0, NULL) : NULL;
    return json_pack("{s:o, s:o, s:o, s:I, s:f, s:o, s:o}", "file", cli_json_text(m->path), "model",
                     cli_json_text(m->name), "network", models_shape_json(&m->shape), "parameters",
                     (json_int_t)parameters(m), "kflop_per_packed_pixel", flops(m) * 1e-3, "steps",
                     m->steps != NULL ? json_integer(strtoll(m->steps, NULL, 10)) : json_null(), "training",
                     training != NULL ? training : json_null());
}

static void print(const model_file *m) {
    const models_shape *s = &m->shape;
    printf("%s: %s\n", m->path, m->name);
    printf("  %zu parameters; %.0f kFLOP a packed pixel\n", parameters(m), flops(m) * 1e-3);
    printf("  brackets of %d frames; %d channels at 1/%d of the packed resolution\n", s->frames, s->channels,
           s->unshuffle);
    printf("  residual blocks: %d extraction, %d shared and %d of each frame, %d reconstruction\n", s->extract,
           s->global, s->frame, s->reconstruct);
    printf("  shown white-balanced frames: %s\n", s->balance ? "yes" : "no");
    printf("  shown the merged picture, too: %s\n", !s->guide ? "no" : s->sigma ? "yes, with its expected errors" : "yes");
    printf("  answers without it, too: %s\n", s->gate ? "yes, with a gate between the two" : "no");
    printf("  alignment: %s%s\n", s->spynet ? "optical flow" : "measured motion",
           s->groups > 0 ? " and deformable convolution" : "");
    printf("  MSCAM: %s%s%s\n", s->mscam ? "yes" : "no", s->mscam && s->prior ? ", with banding prior" : "",
           s->mscam && s->strip > 0 ? ", along rows" : "");
    if (m->steps != NULL) {
        printf("  %s steps of training\n", m->steps);
    }
}

int cli_model(int argc, char **argv) {
    bool json = false;
    const char *output = NULL, *type = "f32", *network = NULL;
    cli_list operands = {0};
    const cli_option options[] = {
        {CLI_HEADING, 0, NULL, NULL, "Options", NULL, 0, 0},
        {CLI_TEXT, 'o', "output", "FILE", "write the weights here, .safetensors", &output, 0, 0},
        {CLI_TEXT, 0, "type", "TYPE", "of the numbers written: f32 (default), f16 or bf16", &type, 0, 0},
        {CLI_TEXT, 0, "network", "NAME", "of a PyTorch checkpoint: brace, brace-s, tmrnet or tmrnet-s", &network, 0, 0},
        {CLI_FLAG, 0, "json", NULL, "print a JSON object on stdout, with how it was trained", &json, 0, 0},
        {CLI_HELP, 'h', "help", NULL, "this text", NULL, 0, 0},
        {.kind = CLI_END}};
    const cli_usage usage = {command, "WEIGHTS [options]",
                             "Says what network a file of weights is for and how it was trained; writes the\n"
                             "same weights in half the size, or those of a PyTorch checkpoint (.pth, nothing in\n"
                             "it is executed) as a file that brace restore --model takes.",
                             options,
                             "Examples:\n"
                             "  brace model brace-s.safetensors\n"
                             "  brace model runs/mine/weights.safetensors --type f16 -o mine.safetensors\n"
                             "  brace model tmrnet.pth --network tmrnet -o tmrnet.safetensors\n"};
    int code = cli_parse(&usage, argc, argv, &operands);
    if (code < 0 && operands.count != 1) {
        code = cli_wrong_usage(command, operands.count == 0 ? "which file?" : "one file at a time");
    }
    if (code < 0 && strcmp(type, "f32") != 0 && strcmp(type, "f16") != 0 && strcmp(type, "bf16") != 0) {
        code = cli_wrong_usage(command, "--type is f32, f16 or bf16, not '%s'", type);
    }
    models_shape shape;
    if (code < 0 && network != NULL && !models_shape_named(&shape, network)) {
        code = cli_wrong_usage(command, "--network takes %s, not '%s'", models_names, network);
    }
    if (code < 0) {
        brace_error error = {0};
        model_file m = {.path = operands.items[0]};
        snprintf(m.name, sizeof m.name, "%s", network != NULL ? network : "");
        brace_status status = load(&m, &error);
        if (status == BRACE_OK && output != NULL) {
            status = save(&m, output, type, &error);
        }
        code = CLI_DONE;
        if (status != BRACE_OK) {
            if (json) {
                cli_json_error(&error, command);
            }
            cli_error(command, "%s", error.message);
            code = CLI_FAILED;
        } else if (json) {
            code = cli_json_print(to_json(&m), command) ? CLI_DONE : CLI_FAILED;
        } else {
            print(&m);
            code = cli_flush(command) ? CLI_DONE : CLI_FAILED;
        }
        unload(&m);
    }
    cli_list_free(&operands);
    return code;
}
