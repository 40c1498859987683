/* SPDX-License-Identifier: Apache-2.0 */
/*
 * train.h: training a network as a configuration says. Internal.
 *
 * A run keeps its files in one folder:
 *   config.json             what it was begun with
 *   checkpoint.safetensors  weights, moments, averages, and how far it is; the run goes on from it
 *   weights.safetensors     the averaged weights as of the last validation: the result
 *   log.jsonl               an object a line: every step, every epoch
 *   plot.png, sheets/       loss and PSNR over the epochs; pictures of each validation
 * Every file is complete or not there. A run that was killed at any moment ends with the same weights, byte for byte,
 * as one that was not, on the same kind of processor with the same number of threads. docs/training.md has the rest.
 */
#ifndef TRAIN_TRAIN_H
#define TRAIN_TRAIN_H

#include <jansson.h>

#include "models/models.h"
#include "nn/group.h"
#include "nn/optimizer.h"
#include "train/loss.h"
#include "train/source.h"

/* ---- configuration (config.c) ---- */

typedef struct train_config {
    json_t *json;        /* all of it; strings below point into it */
    const char *model;   /* name of a network, */
    bool known;          /* which is one of models.h: */
    models_shape shape;  /* as changed by "network" */
    const char *initial; /* weights to begin with; NULL: random ones */
    uint64_t seed;
    train_source_params data;
    int data_threads;
    int batch, epochs, epoch_samples;
    bool bf16;
    train_loss_params loss;
    nn_adamw optimizer;
    nn_schedule schedule;                      /* in steps */
    uint64_t epoch_steps, steps;               /* of all epochs */
    int validation_samples, validation_epochs; /* samples; epochs from one to the next */
    int checkpoint_steps;
} train_config;

/* A JSON file, checked: docs/training.md has the keys. */
brace_status train_config_load(train_config *out, const char *path, brace_error *error);
brace_status train_config_parse(train_config *out, const char *text, const char *name, brace_error *error);
void train_config_free(train_config *config);

/* ---- what is trained ---- */

typedef struct train_model {
    const void *user;
    /* Builds the network of one bracket: packed RAW {1, side, side, 4}. */
    nn_value (*build)(const void *user, nn_graph *g, const models_inputs *inputs);
} train_model;

/* ---- the loop (train.c) ---- */

/* All zeros (but for `output`) mean the defaults. */
typedef struct train_run_params {
    const train_model *model; /* NULL: the configuration's */
    const char *output;
    bool resume; /* goes on, or begins where there is nothing to go on from; false: a folder with a run is refused */
    nn_group *group; /* processes that train together; NULL: this one alone */
} train_run_params;

typedef struct train_result {
    uint64_t steps;         /* done in all */
    double seconds, waited; /* of this call; waiting for samples */
    uint64_t samples;       /* that this call learned from, in all processes */
    double loss, psnr;      /* mean of the last epoch that was finished, and of the last validation; NaN: none */
} train_result;

/* BRACE_ERROR_CANCELLED when the job was: the state is saved then. Progress counts samples. `result` may be NULL. */
brace_status train_run(const train_config *config, const train_run_params *params, train_result *result,
                       const brace_job *job, brace_error *error);

/* ---- a network with its losses (network.c) ---- */

typedef struct train_network {
    nn_weights *weights;
    nn_graph *graph;
    models_inputs inputs;
    nn_value prediction;
    train_loss loss;
} train_network;

brace_status train_network_create(train_network *out, const train_config *config, const train_model *model,
                                  const brace_job *job, brace_error *error);
void train_network_destroy(train_network *network);
/* Forward; parts: total, L1, wavelet, colour, and L1 of the frames alone. */
enum { TRAIN_PARTS = 5 };
brace_status train_network_run(train_network *network, const train_sample *sample, double parts[TRAIN_PARTS],
                               brace_error *error);
/* Without the losses' own. f32, atomically. */
brace_status train_network_save(const train_network *network, const char *path, const train_config *config,
                                uint64_t step, brace_error *error);

/* ---- validation (validate.c) ---- */

typedef struct train_scores {
    double psnr, ssim, sfc, loss; /* means */
} train_scores;

typedef struct train_validation {
    int count;
    train_sample *samples;
    train_scores before; /* of the reference frames as they are */
} train_validation;

brace_status train_validation_create(train_validation *out, const train_config *config, const brace_job *job,
                                     brace_error *error);
void train_validation_free(train_validation *validation);
/* Scores the network; writes a contact sheet (reference, result, truth) where `sheet` is not NULL. */
brace_status train_validate(train_scores *out, const train_validation *validation, train_network *network,
                            const char *sheet, const brace_job *job, brace_error *error);

/* ---- the log (log.c) ---- */

typedef struct train_log {
    char *path;
    FILE *file;
    size_t epochs, room; /* what the plot shows */
    struct train_epoch {
        uint64_t epoch;
        double loss, psnr; /* psnr NaN: not validated */
    } * epoch;
} train_log;

/* Opens it for appending; lines of steps after `step`, and those that are torn, are dropped first. `pending`: an epoch ends
 * with that step, and its end is still to come. */
brace_status train_log_open(train_log *out, const char *path, uint64_t step, bool pending, brace_error *error);
void train_log_close(train_log *log);
/* Takes over `line`, which has "step", and "epoch" with "loss" where it is about an epoch. */
brace_status train_log_add(train_log *log, json_t *line, brace_error *error);
brace_status train_log_plot(const train_log *log, const char *path, const brace_job *job, brace_error *error);

#endif
