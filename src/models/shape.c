/* SPDX-License-Identifier: Apache-2.0 */
/* shape.c: the networks by name, and what a weights file says of its network. */
#include <stddef.h>
#include <string.h>

#include "models/models.h"

const char models_names[] = "brace, brace-s, tmrnet or tmrnet-s";

static const models_shape paper = {.frames = 5, .channels = 64, .unshuffle = 1, .extract = 5, .global = 16,
                                   .frame = 24, .reconstruct = 5, .offset = 3, .groups = 8, .spynet = true};
static const models_shape everyday = {.frames = 5, .channels = 32, .unshuffle = 2, .extract = 1, .global = 3,
                                      .frame = 1, .reconstruct = 2, .blend = true};

bool models_shape_named(models_shape *out, const char *name) {
    const bool small = strcmp(name, "brace-s") == 0, large = strcmp(name, "brace") == 0;
    if (!small && !large && strcmp(name, "tmrnet") != 0 && strcmp(name, "tmrnet-s") != 0) {
        return false;
    }
    *out = name[strlen(name) - 1] == 's' ? everyday : paper;
    out->mscam = out->prior = small || large;
    out->guide = out->sigma = out->gate = small;
    out->balance = strcmp(name, "tmrnet") != 0; /* whose published weights know no balance */
    return true;
}

/* Every number and every switch, once. */
static const struct {
    const char *key;
    size_t offset;
    int low, high;
} numbers[] = {
    {"frames", offsetof(models_shape, frames), 2, 9},
    {"channels", offsetof(models_shape, channels), 8, 1024},
    {"unshuffle", offsetof(models_shape, unshuffle), 1, 4},
    {"extract", offsetof(models_shape, extract), 0, 1000},
    {"global", offsetof(models_shape, global), 0, 1000},
    {"frame", offsetof(models_shape, frame), 0, 1000},
    {"reconstruct", offsetof(models_shape, reconstruct), 0, 1000},
    {"offset", offsetof(models_shape, offset), 0, 100},
    {"groups", offsetof(models_shape, groups), 0, 64},
    {"strip", offsetof(models_shape, strip), 0, 4096},
}, switches[] = {
    {"spynet", offsetof(models_shape, spynet), 0, 1},
    {"balance", offsetof(models_shape, balance), 0, 1},
    {"guide", offsetof(models_shape, guide), 0, 1},
    {"sigma", offsetof(models_shape, sigma), 0, 1},
    {"gate", offsetof(models_shape, gate), 0, 1},
    {"blend", offsetof(models_shape, blend), 0, 1},
    {"mscam", offsetof(models_shape, mscam), 0, 1},
    {"prior", offsetof(models_shape, prior), 0, 1},
};
enum { NUMBERS = sizeof numbers / sizeof *numbers, SWITCHES = sizeof switches / sizeof *switches };

static int *number_of(const models_shape *shape, int i) {
    return (int *)((char *)(uintptr_t)shape + numbers[i].offset);
}
static bool *switch_of(const models_shape *shape, int i) {
    return (bool *)((char *)(uintptr_t)shape + switches[i].offset);
}

void models_shape_read(models_shape *shape, const json_at *object) {
    const char *keys[NUMBERS + SWITCHES + 1] = {NULL};
    for (int i = 0; i < NUMBERS; i++) {
        keys[i] = numbers[i].key;
        int *n = number_of(shape, i);
        *n = (int)json_check_integer(object, numbers[i].key, numbers[i].low, numbers[i].high, *n);
    }
    for (int i = 0; i < SWITCHES; i++) {
        keys[NUMBERS + i] = switches[i].key;
        *switch_of(shape, i) = json_check_bool(object, switches[i].key, *switch_of(shape, i));
    }
    json_check_only(object, keys);
    if (shape->unshuffle == 3) {
        json_check_fail(object, "unshuffle", "3 is none of 1, 2 and 4");
    }
    if (shape->groups > 0 && shape->channels % shape->groups != 0) {
        json_check_fail(object, "groups", "%d do not divide %d channels", shape->groups, shape->channels);
    }
}

brace_status models_shape_parse(models_shape *shape, const char *text, const char *name, brace_error *error) {
    json_check *doc = NULL;
    brace_status status = json_check_parse(&doc, text, name, error);
    if (status == BRACE_OK) {
        const json_at root = json_check_root(doc);
        models_shape_read(shape, &root);
        status = json_check_status(doc, error);
    }
    json_check_destroy(doc);
    return status;
}

json_t *models_shape_json(const models_shape *shape) {
    json_t *out = json_object();
    bool whole = out != NULL;
    for (int i = 0; i < NUMBERS && whole; i++) {
        whole = json_object_set_new(out, numbers[i].key, json_integer(*number_of(shape, i))) == 0;
    }
    for (int i = 0; i < SWITCHES && whole; i++) {
        whole = json_object_set_new(out, switches[i].key, json_boolean(*switch_of(shape, i))) == 0;
    }
    if (!whole) {
        json_decref(out);
        return NULL;
    }
    return out;
}

bool models_shape_equal(const models_shape *a, const models_shape *b) {
    for (int i = 0; i < NUMBERS; i++) {
        if (*number_of(a, i) != *number_of(b, i)) {
            return false;
        }
    }
    for (int i = 0; i < SWITCHES; i++) {
        if (*switch_of(a, i) != *switch_of(b, i)) {
            return false;
        }
    }
    return true;
}

brace_status models_shape_of_file(models_shape *out, char name[MODELS_NAME], const core_safetensors *file,
                                  const char *path, brace_error *error) {
    const char *model = core_safetensors_metadata(file, "model"), *network = core_safetensors_metadata(file, "network");
    if (name[0] != '\0' && model != NULL && strcmp(name, model) != 0) {
        return core_fail(error, BRACE_ERROR_MISMATCH, "%s: says that it is for %.60s, not for %s", path, model, name);
    }
    if (model != NULL || name[0] == '\0') {
        snprintf(name, MODELS_NAME, "%s", model != NULL && model[0] != '\0' ? model : "unnamed");
    }
    /* A network of another name says all of its shape, if it is one of these at all. */
    if (!models_shape_named(out, name) &&
        (network == NULL || strcmp(network, "{}") == 0 || !models_shape_named(out, "brace-s"))) {
        return core_fail(error, BRACE_ERROR_FORMAT,
                         "%s: does not say what network these weights belong to; brace train writes files that do, and "
                         "so does brace model with --network, which takes %s",
                         path, models_names);
    }
    if (network == NULL) {
        return BRACE_OK;
    }
    out->balance = out->guide = out->sigma = out->gate = false; /* a file without these keys is older than they are */
    const brace_status status = models_shape_parse(out, network, "its network", error);
    if (status != BRACE_OK) {
        core_error_prefix(error, path);
    }
    return status;
}
