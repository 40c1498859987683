/* SPDX-License-Identifier: Apache-2.0 */
/*
 * train.c: the loop. A step adds up the gradients of a batch, sample by sample,
 * over all processes, and takes one step of AdamW. What a step does follows from
 * the state before it and its number alone; the state is saved between steps. So
 * wherever a run is cut off, it ends with the same weights.
 */
#include "train/train.h"

#include <dirent.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/safetensors.h"
#include "sim/dataset.h"
#include "train/feed.h"

typedef struct train_state {
    uint64_t step;
    unsigned steps_summed, steps_lost; /* lost: of those summed, without a finite loss */
    double sums[TRAIN_PARTS]; /* of the losses of so many of this epoch's steps */
    double loss, psnr;        /* of the last epoch and validation */
} train_state;

typedef struct run {
    const train_config *config;
    const char *output;
    const brace_job *job;
    nn_group *group;
    bool alone, first; /* rank 0 writes */
    train_network network;
    nn_optimizer *optimizer;
    train_source *source;
    train_feed *feed;
    train_validation validation;
    train_log log;
    train_state state;
    double began;
    uint64_t began_at; /* step */
} run;

static void path_of(char *out, const run *r, const char *name) {
    snprintf(out, PATH_MAX, "%s/%s", r->output, name);
}

/* ---- the state ---- */

static brace_status save_state(run *r, brace_error *error) {
    if (!r->first) {
        return BRACE_OK;
    }
    char path[PATH_MAX], step[32], numbers[256];
    const train_state *s = &r->state;
    path_of(path, r, "checkpoint.safetensors");
    snprintf(step, sizeof step, "%llu", (unsigned long long)s->step);
    snprintf(numbers, sizeof numbers, "%u %a %a %a %a %a %a %a %u", s->steps_summed, s->sums[0], s->sums[1],
             s->sums[2], s->sums[3], s->sums[4], s->loss, s->psnr, s->steps_lost);
    char *config = json_dumps(r->config->json, JSON_COMPACT | JSON_SORT_KEYS);
    if (config == NULL) {
        return core_fail_memory(error, 4096, "the configuration");
    }
    const char *const metadata[] = {"step", step, "numbers", numbers, "config", config, NULL};
    const brace_status status = nn_optimizer_save(r->optimizer, path, metadata, error);
    free(config);
    return status;
}

/* What may be changed while a run goes on. */
static void forget_harmless(json_t *config) {
    json_object_del(config, "description");
    json_object_del(config, "checkpoint_steps");
    json_object_del(json_object_get(config, "data"), "threads");
}

static brace_status same_config(const run *r, const char *text, const char *path, brace_error *error) {
    json_t *old = json_loads(text != NULL ? text : "", 0, NULL), *now = json_deep_copy(r->config->json);
    const char *key = NULL, *differs = NULL;
    json_t *value;
    forget_harmless(old);
    forget_harmless(now);
    json_object_foreach(now, key, value) {
        if (!json_equal(value, json_object_get(old, key))) {
            differs = key;
        }
    }
    json_object_foreach(old, key, value) {
        if (json_object_get(now, key) == NULL) {
            differs = key;
        }
    }
    brace_status status = BRACE_OK;
    if (old == NULL || now == NULL || differs != NULL) {
        status =
            core_fail(error, BRACE_ERROR_MISMATCH,
                      "%s: this run was begun with another configuration ('%s' differs); go on with the same one, or "
                      "choose another folder",
                      path, differs != NULL ? differs : "all of it");
    }
    json_decref(old);
    json_decref(now);
    return status;
}

static brace_status load_state(run *r, const char *path, brace_error *error) {
    core_safetensors *file = NULL;
    brace_status status = core_safetensors_open(&file, path, error);
    if (status != BRACE_OK) {
        return status;
    }
    train_state *s = &r->state;
    const char *step = core_safetensors_metadata(file, "step"), *numbers = core_safetensors_metadata(file, "numbers");
    unsigned long long n = 0;
    if (step == NULL || numbers == NULL || sscanf(step, "%llu", &n) != 1 || n > r->config->steps ||
        sscanf(numbers, "%u %la %la %la %la %la %la %la %u", &s->steps_summed, &s->sums[0], &s->sums[1],
               &s->sums[2], &s->sums[3], &s->sums[4], &s->loss, &s->psnr, &s->steps_lost) < 8) {
        status = core_fail(error, BRACE_ERROR_FORMAT, "%s: no state of a training run", path);
    }
    s->step = n;
    if (status == BRACE_OK) {
        status = same_config(r, core_safetensors_metadata(file, "config"), path, error);
    }
    core_safetensors_close(file);
    return status == BRACE_OK ? nn_optimizer_load(r->optimizer, path, error) : status;
}

static brace_status begin_or_resume(run *r, bool resume, brace_error *error) {
    char path[PATH_MAX];
    path_of(path, r, "checkpoint.safetensors");
    const bool there = access(path, F_OK) == 0;
    r->state.loss = r->state.psnr = NAN;
    if (there && !resume) {
        return core_fail(error, BRACE_ERROR_ARGUMENT,
                         "%s: a run has been begun here; --resume goes on with it, or choose another folder",
                         r->output);
    }
    if (resume && !there) {
        core_note(r->job, "%s: nothing to go on from is there; the run begins", r->output);
    }
    brace_status status = there ? load_state(r, path, error) : BRACE_OK;
    if (status == BRACE_OK && !there && r->first) {
        char *text = json_dumps(r->config->json, JSON_INDENT(4));
        core_file *file = NULL;
        path_of(path, r, "config.json");
        status =
            text != NULL ? core_file_create(&file, path, error) : core_fail_memory(error, 4096, "the configuration");
        if (status == BRACE_OK) {
            fprintf(core_file_stream(file), "%s\n", text);
            status = core_file_commit(file, error);
        }
        free(text);
    }
    return status;
}

/* ---- an epoch's end ---- */

/* JSON has no NaN. */
static json_t *number(double value) {
    return isfinite(value) ? json_real(value) : json_null();
}

static brace_status end_epoch(run *r, brace_error *error) {
    const train_config *c = r->config;
    train_state *s = &r->state;
    const uint64_t epoch = s->step / c->epoch_steps;
    double mean[TRAIN_PARTS];
    for (int i = 0; i < TRAIN_PARTS; i++) {
        mean[i] = s->sums[i] / (s->steps_summed - s->steps_lost); /* of none: NaN */
        s->sums[i] = 0;
    }
    s->steps_summed = s->steps_lost = 0;
    s->loss = mean[0];
    if (!r->first) {
        return BRACE_OK;
    }
    json_t *line = json_pack("{s:s,s:I,s:I,s:o,s:o,s:o,s:o,s:o}", "kind", "epoch", "step", (json_int_t)s->step,
                             "epoch", (json_int_t)epoch, "loss", number(mean[0]), "l1", number(mean[1]), "wavelet",
                             number(mean[2]), "color", number(mean[3]), "alone", number(mean[4]));
    char path[PATH_MAX], name[64];
    brace_status status = BRACE_OK;
    const bool validate = epoch % (uint64_t)c->validation_epochs == 0 || s->step == c->steps;
    if (validate) { /* the averages are what is used later */
        nn_optimizer_swap(r->optimizer);
        path_of(path, r, "weights.safetensors");
        status = train_network_save(&r->network, path, c, s->step, error);
        if (status == BRACE_OK && r->validation.count > 0) {
            train_scores scores;
            const train_scores *before = &r->validation.before;
            snprintf(name, sizeof name, "sheets/epoch_%04llu.png", (unsigned long long)epoch);
            path_of(path, r, name);
            if (c->loss.color > 0) { /* the same directions each time */
                status = train_msswd_draw(r->network.weights, "loss.", &c->loss.msswd, c->seed, error);
            }
            if (status == BRACE_OK) {
                status = train_validate(&scores, &r->validation, &r->network, path, r->job, error);
            }
            if (status == BRACE_OK) {
                s->psnr = scores.psnr;
                json_object_update_new(line, json_pack("{s:f,s:f,s:f,s:o,s:f,s:f,s:f}", "psnr", scores.psnr, "ssim",
                                                       scores.ssim, "sfc", scores.sfc, "validation_loss",
                                                       number(scores.loss), "psnr_before", before->psnr, "ssim_before",
                                                       before->ssim, "sfc_before", before->sfc));
                core_note(r->job,
                          "epoch %llu of %d: loss %.5f, PSNR %.2f dB (before %.2f), SSIM %.4f (%.4f), SFC %.2f (%.2f)",
                          (unsigned long long)epoch, c->epochs, mean[0], scores.psnr, before->psnr, scores.ssim,
                          before->ssim, scores.sfc, before->sfc);
            }
        }
        nn_optimizer_swap(r->optimizer);
    }
    if (status != BRACE_OK) {
        json_decref(line);
        return status;
    }
    status = train_log_add(&r->log, line, error);
    if (status == BRACE_OK) {
        path_of(path, r, "plot.png");
        status = train_log_plot(&r->log, path, r->job, error);
    }
    return status;
}

/* An epoch whose end is not yet behind it has sums. */
static brace_status end_of_epoch(run *r, brace_error *error) {
    const train_state before = r->state;
    if (before.step == 0 || before.step % r->config->epoch_steps != 0 || before.steps_summed == 0) {
        return BRACE_OK;
    }
    const brace_status status = end_epoch(r, error);
    if (status != BRACE_OK) {
        r->state = before;
    }
    return status;
}

/* ---- a step ---- */

static brace_status one_step(run *r, brace_error *error) {
    const train_config *c = r->config;
    train_state *s = &r->state;
    double sums[TRAIN_PARTS] = {0};
    const int rank = nn_group_rank(r->group), size = nn_group_size(r->group);
    const int count = c->batch * (rank + 1) / size - c->batch * rank / size;
    brace_status status = BRACE_OK;
    if (c->loss.color > 0) {
        status = train_msswd_draw(r->network.weights, "loss.", &c->loss.msswd,
                                  c->seed + 0x9e3779b97f4a7c15u * (s->step + 1), error);
    }
    for (int i = 0; i < count && status == BRACE_OK; i++) {
        const train_sample *sample;
        double parts[TRAIN_PARTS];
        status = train_feed_next(r->feed, &sample, error);
        if (status == BRACE_OK) {
            status = train_network_run(&r->network, sample, parts, error);
        }
        if (status == BRACE_OK) {
            status = nn_backward(r->network.graph, 1, error);
        }
        for (int k = 0; k < TRAIN_PARTS && status == BRACE_OK; k++) {
            sums[k] += parts[k];
        }
        if (status == BRACE_OK) {
            status = r->alone ? core_check_cancel(r->job, error) : BRACE_OK;
        }
    }
    if (status == BRACE_OK) {
        status = nn_group_sum_gradients(r->group, r->network.weights, error);
    }
    float shared[TRAIN_PARTS];
    for (int k = 0; k < TRAIN_PARTS; k++) {
        shared[k] = (float)(sums[k] / c->batch);
    }
    if (status == BRACE_OK) {
        status = nn_group_sum(r->group, shared, TRAIN_PARTS, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    nn_step_report report;
    const double rate = nn_schedule_rate(&c->schedule, s->step);
    nn_optimizer_step(r->optimizer, rate, 1.0 / c->batch, &report);
    for (int k = 0; k < TRAIN_PARTS; k++) {
        s->sums[k] += isfinite(shared[0]) ? (double)shared[k] : 0;
    }
    s->steps_lost += isfinite(shared[0]) ? 0 : 1;
    s->steps_summed++;
    s->step++;
    if (r->first) {
        json_t *line = json_pack("{s:I,s:I,s:o,s:o,s:f,s:o,s:f,s:f,s:f}", "step", (json_int_t)s->step, "epoch",
                                 (json_int_t)((s->step - 1) / c->epoch_steps + 1), "loss", number((double)shared[0]),
                                 "l1", number((double)shared[1]), "rate", rate, "norm", number(report.norm), "seconds",
                                 core_seconds() - r->began, "waited", train_feed_waited(r->feed), "samples_per_second",
                                 (double)(s->step - r->began_at) * c->batch / fmax(core_seconds() - r->began, 1e-9));
        if (report.skipped) {
            json_object_set_new(line, "skipped", json_true());
            core_note(r->job, "step %llu: the gradient is not finite; the step is left out",
                      (unsigned long long)s->step);
        }
        status = train_log_add(&r->log, line, error);
    }
    return status;
}

/* One process's Ctrl-C is everyone's. */
static brace_status check_stop(run *r, bool *stop, brace_error *error) {
    float flag = core_cancelled(r->job) ? 1 : 0;
    const brace_status status = nn_group_sum(r->group, &flag, 1, error);
    *stop = flag > 0;
    return status;
}

static brace_status loop(run *r, brace_error *error) {
    const train_config *c = r->config;
    train_state *s = &r->state;
    const uint64_t batch = (uint64_t)c->batch;
    uint64_t saved = s->step;
    const bool cut_off = s->steps_summed > 0 && s->step == c->steps;
    brace_status status = end_of_epoch(r, error); /* that was cut off */
    if (status == BRACE_OK && cut_off) { /* no step will save it */
        status = save_state(r, error);
    }
    while (s->step < c->steps && status == BRACE_OK) {
        bool stop;
        core_progress(r->job, "training", s->step * batch, c->steps * batch);
        status = check_stop(r, &stop, error);
        if (status == BRACE_OK && stop) {
            status = BRACE_ERROR_CANCELLED;
        }
        if (status == BRACE_OK) {
            status = one_step(r, error);
        }
        if (status == BRACE_OK) {
            status = end_of_epoch(r, error);
        }
        if (status == BRACE_OK && (s->step % (uint64_t)c->checkpoint_steps == 0 || s->step == c->steps)) {
            status = save_state(r, error);
            saved = s->step;
        }
    }
    if (status == BRACE_ERROR_CANCELLED) { /* between two steps, within one, or within an epoch's end */
        core_fail(error, BRACE_ERROR_CANCELLED, "stopped at step %llu of %llu; --resume goes on", (unsigned long long)s->step,
                  (unsigned long long)c->steps);
    }
    if (status == BRACE_ERROR_CANCELLED && saved != s->step) {
        brace_error problem = {0};
        if (save_state(r, &problem) != BRACE_OK) {
            core_note(r->job, "%s", problem.message);
        }
    }
    if (status == BRACE_OK) {
        core_progress(r->job, "training", c->steps * batch, c->steps * batch);
    }
    return status;
}

/* ---- a run ---- */

/* What a killed run had begun to write: temporaries of core_file_create. A checkpoint is large. */
static void remove_torn(const char *folder) {
    struct dirent **names = NULL;
    const int n = scandir(folder, &names, NULL, NULL);
    for (int i = 0; i < n; i++) {
        const char *name = names[i]->d_name;
        const size_t length = strlen(name);
        if (length > 11 && strncmp(name, ".brace-", 7) == 0 && strcmp(name + length - 4, ".tmp") == 0) {
            char *path = dataset_path(folder, name);
            if (path != NULL) {
                unlink(path);
            }
            core_free(path);
        }
        free(names[i]);
    }
    free(names);
}

static brace_status prepare(run *r, const train_run_params *params, const brace_job *graph_job, brace_error *error) {
    const train_config *c = r->config;
    char path[PATH_MAX];
    path_of(path, r, "sheets");
    brace_status status = r->first ? dataset_make_folder(path, error) : BRACE_OK;
    if (status == BRACE_OK && r->first) {
        remove_torn(path);
        remove_torn(r->output);
    }
    if (status == BRACE_OK) {
        status = nn_group_wait(r->group, error);
    }
    if (status == BRACE_OK) {
        status = train_network_create(&r->network, c, params->model, graph_job, error);
    }
    if (status == BRACE_OK) {
        status = nn_optimizer_create(&r->optimizer, r->network.weights, &c->optimizer, graph_job, error);
    }
    if (status == BRACE_OK) {
        status = begin_or_resume(r, params->resume, error);
    }
    if (status == BRACE_OK && r->first) {
        path_of(path, r, "log.jsonl");
        status = train_log_open(&r->log, path, r->state.step, r->state.steps_summed > 0, error);
    }
    if (status != BRACE_OK || (r->state.step == c->steps && r->state.steps_summed == 0)) {
        return status;
    }
    status = nn_group_share_weights(r->group, r->network.weights, error);
    if (status == BRACE_OK) {
        status = train_source_create(&r->source, &c->data, r->job, error);
    }
    if (status == BRACE_OK && r->first) {
        status = train_validation_create(&r->validation, c, r->job, error);
    }
    if (status == BRACE_OK) {
        const int rank = nn_group_rank(r->group), size = nn_group_size(r->group), begin = c->batch * rank / size;
        status = train_feed_create(&r->feed, r->source,
                                   &(train_feed_params){.step = r->state.step,
                                                        .batch = c->batch,
                                                        .first = begin,
                                                        .count = c->batch * (rank + 1) / size - begin,
                                                        .threads = c->data_threads},
                                   error);
    }
    return status;
}

brace_status train_run(const train_config *config, const train_run_params *params, train_result *result,
                       const brace_job *job, brace_error *error) {
    run r = {.config = config, .output = params->output, .job = job, .group = params->group};
    nn_group *alone = NULL;
    if (strlen(params->output) > PATH_MAX - 64) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%.200s...: the name is too long", params->output);
    }
    brace_status status = BRACE_OK;
    if (r.group == NULL) {
        status = nn_group_alone(&alone, error);
        r.group = alone;
    }
    if (status == BRACE_OK && nn_group_size(r.group) > config->batch) {
        status = core_fail(error, BRACE_ERROR_ARGUMENT, "%d processes share a batch of %d samples; start fewer",
                           nn_group_size(r.group), config->batch);
    }
    if (status == BRACE_OK) {
        r.alone = nn_group_size(r.group) == 1;
        r.first = nn_group_rank(r.group) == 0;
        /* A process that stops on its own in the middle of a step would leave the others waiting. */
        const brace_job graph_job = {.threads = job != NULL ? job->threads : 0,
                                     .cancel = r.alone && job != NULL ? job->cancel : NULL};
        status = prepare(&r, params, &graph_job, error);
        r.began = core_seconds();
        r.began_at = r.state.step;
        if (status == BRACE_OK) {
            status = loop(&r, error);
        }
    }
    if (result != NULL) {
        *result = (train_result){.steps = r.state.step,
                                 .seconds = r.began > 0 ? core_seconds() - r.began : 0,
                                 .waited = r.feed != NULL ? train_feed_waited(r.feed) : 0,
                                 .samples = (r.state.step - r.began_at) * (uint64_t)config->batch,
                                 .loss = r.state.loss,
                                 .psnr = r.state.psnr};
    }
    train_feed_destroy(r.feed);
    train_log_close(&r.log);
    train_validation_free(&r.validation);
    train_source_destroy(r.source);
    nn_optimizer_destroy(r.optimizer);
    train_network_destroy(&r.network);
    nn_group_destroy(alone);
    return status;
}
