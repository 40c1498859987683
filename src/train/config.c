/* SPDX-License-Identifier: Apache-2.0 */
/* config.c: what a run does, read from a JSON file with every key checked. */
#include <string.h>

#include "sim/json_check.h"
#include "train/train.h"

static void read_network(train_config *c, const json_at *root) {
    json_at network;
    c->known = models_shape_named(&c->shape, c->model);
    if (json_check_object(root, "network", &network)) {
        if (c->known) {
            models_shape_read(&c->shape, &network);
        } else {
            json_check_fail(root, "network", "there is nothing to change: \"%s\" is none of %s", c->model,
                            models_names);
        }
    }
}

/* A folder, or a list of folders. */
static void read_packed(train_source_params *d, const json_at *data) {
    const json_t *packed = json_object_get(data->value, "packed");
    if (!json_is_array(packed)) {
        const char *folder = json_check_string(data, "packed", 4096, "");
        d->packed[0] = folder[0] != '\0' ? folder : NULL;
        return;
    }
    const size_t count = json_array_size(packed);
    if (count < 1 || count > TRAIN_SETS_MAX) {
        json_check_fail(data, "packed", "1 to %d folders are expected, not %zu", TRAIN_SETS_MAX, count);
        return;
    }
    for (size_t i = 0; i < count; i++) {
        d->packed[i] = json_string_value(json_array_get(packed, i));
        if (d->packed[i] == NULL || d->packed[i][0] == '\0') {
            json_check_fail(data, "packed", "folder %zu is no name", i + 1);
            return;
        }
    }
}

static void read_data(train_config *c, const json_at *root) {
    static const char *const keys[] = {"packed", "screens", "priors",  "width",     "height",  "field", "test_share",
                                       "crop",   "crops",   "augment", "transpose", "threads", NULL};
    json_at data;
    train_source_params *d = &c->data;
    d->frames = 5, d->side = 128, d->crops = 4, d->mirrored = d->transposed = true, d->seed = c->seed;
    d->align = c->known && (!c->shape.spynet || c->shape.guide);
    if (c->known) {
        d->frames = c->shape.frames;
        d->guide = c->shape.guide;
    }
    c->data_threads = 1;
    if (!json_check_object(root, "data", &data)) {
        return; /* rendered, of the screens that are there */
    }
    json_check_only(&data, keys);
    read_packed(d, &data);
    const char *screens = json_check_string(&data, "screens", 4096, "");
    const char *priors = json_check_string(&data, "priors", 4096, "");
    d->screens = screens[0] != '\0' ? screens : NULL;
    d->priors = priors[0] != '\0' ? priors : NULL;
    d->width = (uint32_t)json_check_integer(&data, "width", 32, 16384, 1024);
    d->height = (uint32_t)json_check_integer(&data, "height", 32, 16384, 768);
    d->field = json_check_bool(&data, "field", false);
    d->test_share = json_check_number(&data, "test_share", 0.001, 0.9, 0.1);
    d->side = (int)json_check_integer(&data, "crop", 16, 1024, 128);
    d->crops = (int)json_check_integer(&data, "crops", 1, 64, 4);
    d->mirrored = json_check_bool(&data, "augment", true);
    d->transposed = json_check_bool(&data, "transpose", true) && d->mirrored;
    c->data_threads = (int)json_check_integer(&data, "threads", 1, 64, 1);
    if (d->side % 16 != 0) {
        json_check_fail(&data, "crop", "%d is no multiple of 16", d->side);
    }
    static const char *const simulator[] = {"screens", "priors", "width", "height", "field", "test_share"};
    for (size_t i = 0; i < sizeof simulator / sizeof *simulator && d->packed[0] != NULL; i++) {
        if (json_object_get(data.value, simulator[i]) != NULL) {
            json_check_fail(&data, simulator[i], "this is for samples that are rendered, but \"packed\" is given");
        }
    }
}

static void read_loss(train_config *c, const json_at *root) {
    static const char *const keys[] = {"encoding", "mu",           "wavelet",           "wavelet_weights", "l1",
                                       "color",    "color_scales", "color_projections", "relative",        "alone", NULL};
    static const char *const encodings[] = {"gamma", "mu_law", NULL};
    train_loss_params *l = &c->loss;
    *l = (train_loss_params){.encoding = TRAIN_GAMMA, .mu = 5000, .wavelet = 0.5, .msswd = {5, 32}};
    memcpy(l->bands, train_wavelet_weights, sizeof l->bands);
    l->alone = c->known && c->shape.gate ? 0.5 : 0;
    json_at loss;
    if (!json_check_object(root, "loss", &loss)) {
        return;
    }
    json_check_only(&loss, keys);
    l->encoding = (train_encoding)json_check_choice(&loss, "encoding", encodings, TRAIN_GAMMA);
    l->mu = json_check_number(&loss, "mu", 1, 1e6, 5000);
    l->wavelet = json_check_number(&loss, "wavelet", 0, 1000, 0.5);
    json_check_numbers(&loss, "wavelet_weights", l->bands, TRAIN_WAVELET_BANDS, TRAIN_WAVELET_BANDS, 0, 1000, false);
    l->color = json_check_number(&loss, "color", 0, 1000, 0);
    l->no_l1 = !json_check_bool(&loss, "l1", true);
    if (l->no_l1 && !(l->wavelet > 0 || l->color > 0)) {
        json_check_fail(&loss, "l1", "nothing is left to learn from: wavelet and color are 0");
    }
    l->relative = json_check_number(&loss, "relative", 0, 1000, 0);
    l->alone = json_check_number(&loss, "alone", 0, 1000, l->alone);
    if (l->alone > 0 && !(c->known && c->shape.gate)) {
        json_check_fail(&loss, "alone", "a network without a gate has one answer only");
    }
    l->msswd.scales = (int)json_check_integer(&loss, "color_scales", 1, 8, 5);
    l->msswd.projections = (int)json_check_integer(&loss, "color_projections", 1, 512, 32);
}

static void read_optimizer(train_config *c, const json_at *root) {
    static const char *const keys[] = {"rate",  "floor", "warmup_epochs", "schedule", "weight_decay",
                                       "beta1", "beta2", "clip",          "average",  NULL};
    static const char *const kinds[] = {"constant", "cosine", NULL};
    c->optimizer = nn_adamw_defaults();
    c->schedule = (nn_schedule){.kind = NN_RATE_COSINE, .rate = 1e-4, .steps = c->steps};
    json_at o = {0};
    const bool there = json_check_object(root, "optimizer", &o);
    if (there) {
        json_check_only(&o, keys);
        c->schedule.kind = json_check_choice(&o, "schedule", kinds, 1) == 0 ? NN_RATE_CONSTANT : NN_RATE_COSINE;
        c->schedule.rate = json_check_number(&o, "rate", 1e-12, 10, 1e-4);
        c->schedule.floor = json_check_number(&o, "floor", 0, 10, 0);
        const double warmup = json_check_number(&o, "warmup_epochs", 0, 1e6, 0);
        c->schedule.warmup = (uint64_t)(warmup * (double)c->epoch_steps + 0.5);
        if (c->schedule.warmup >= c->steps) {
            json_check_fail(&o, "warmup_epochs", "%g: there are only %d epochs", warmup, c->epochs);
        }
        c->optimizer.weight_decay = json_check_number(&o, "weight_decay", 0, 10, 0.01);
        c->optimizer.beta1 = json_check_number(&o, "beta1", 0, 0.9999999, 0.9);
        c->optimizer.beta2 = json_check_number(&o, "beta2", 0, 0.9999999, 0.999);
    }
    c->optimizer.clip = there ? json_check_number(&o, "clip", 0, 1e9, 1) : 1;
    c->optimizer.average = there ? json_check_number(&o, "average", 0, 0.9999999, 0.99) : 0.99;
}

static void read_all(train_config *c, const json_at *root) {
    static const char *const keys[] = {
        "description", "model",         "initial", "seed", "precision", "data",       "batch",
        "epochs",      "epoch_samples", "network", "loss", "optimizer", "validation", "checkpoint_steps",
        NULL};
    static const char *const precisions[] = {"f32", "bf16", NULL};
    json_check_only(root, keys);
    json_check_string(root, "description", 4096, "");
    c->model = json_check_string(root, "model", 63, NULL);
    const char *initial = json_check_string(root, "initial", 4096, "");
    c->initial = initial[0] != '\0' ? initial : NULL;
    c->seed = (uint64_t)json_check_integer(root, "seed", 0, INT64_MAX, 1);
    c->bf16 = json_check_choice(root, "precision", precisions, 0) == 1;
    c->batch = (int)json_check_integer(root, "batch", 1, 65536, 16);
    c->epochs = (int)json_check_integer(root, "epochs", 1, 1000000, 50);
    c->epoch_samples = (int)json_check_integer(root, "epoch_samples", 1, 100000000, 1000);
    c->checkpoint_steps = (int)json_check_integer(root, "checkpoint_steps", 1, 1000000, 50);
    const uint64_t batch = c->batch > 0 ? (uint64_t)c->batch : 1;
    c->epoch_steps = ((uint64_t)c->epoch_samples + batch - 1) / batch;
    c->steps = c->epoch_steps * (uint64_t)c->epochs;
    read_network(c, root);
    read_data(c, root);
    read_loss(c, root);
    read_optimizer(c, root);
    c->validation_samples = 16, c->validation_epochs = 1;
    json_at v;
    if (json_check_object(root, "validation", &v)) {
        static const char *const inner[] = {"samples", "epochs", NULL};
        json_check_only(&v, inner);
        c->validation_samples = (int)json_check_integer(&v, "samples", 0, 1000, 16);
        c->validation_epochs = (int)json_check_integer(&v, "epochs", 1, 1000000, 1);
    }
}

static brace_status finish(train_config *out, json_check *doc, brace_error *error) {
    const json_at root = json_check_root(doc);
    read_all(out, &root);
    const brace_status status = json_check_status(doc, error);
    out->json = status == BRACE_OK ? json_incref(root.value) : NULL;
    json_check_destroy(doc);
    return status;
}

brace_status train_config_parse(train_config *out, const char *text, const char *name, brace_error *error) {
    json_check *doc = NULL;
    *out = (train_config){0};
    brace_status status = json_check_parse(&doc, text, name, error);
    return status == BRACE_OK ? finish(out, doc, error) : status;
}

brace_status train_config_load(train_config *out, const char *path, brace_error *error) {
    json_check *doc = NULL;
    *out = (train_config){0};
    brace_status status = json_check_load(&doc, path, error);
    return status == BRACE_OK ? finish(out, doc, error) : status;
}

void train_config_free(train_config *config) {
    json_decref(config->json);
    *config = (train_config){0};
}
