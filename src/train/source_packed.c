/* SPDX-License-Identifier: Apache-2.0 */
/*
 * source_packed.c: brackets where they lie, in the mapped shards of a packed set
 * (docs/dataset.md). Headers and texts are read once; pixels when they are needed.
 */
#include <dirent.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "core/safetensors.h"
#include "sim/dataset.h"
#include "train/source.h"

enum { SHARDS_MOST = 65536 };

typedef struct packed_item {
    char *name;
    train_bracket bracket;
} packed_item;

struct train_packed {
    core_safetensors **shard;
    size_t shards;
    packed_item *item;
    size_t count, room;
};

void train_packed_close(train_packed *p) {
    if (p != NULL) {
        for (size_t i = 0; i < p->shards; i++) {
            core_safetensors_close(p->shard[i]);
        }
        for (size_t i = 0; i < p->count; i++) {
            core_free(p->item[i].name);
        }
        core_free((void *)p->shard);
        core_free(p->item);
        core_free(p);
    }
}

size_t train_packed_count(const train_packed *p) {
    return p != NULL ? p->count : 0;
}

const train_bracket *train_packed_at(const train_packed *p, size_t index) {
    return &p->item[index].bracket;
}

const char *train_packed_name(const train_packed *p, size_t index) {
    return p->item[index].name;
}

/* A list of `count` numbers; false if it is none. */
static bool numbers(double *out, const json_t *object, const char *key, size_t count) {
    const json_t *list = json_object_get(object, key);
    if (!json_is_array(list) || json_array_size(list) != count) {
        return false;
    }
    for (size_t i = 0; i < count; i++) {
        const json_t *n = json_array_get(list, i);
        if (!json_is_number(n)) {
            return false;
        }
        out[i] = json_number_value(n);
    }
    return true;
}

/* The metadata that dataset_frame_json wrote. */
static bool frame_of(brace_frame *f, const json_t *json) {
    const char *cfa = json_string_value(json_object_get(json, "cfa"));
    double black[4], noise[6];
    int k = 0;
    for (; cfa != NULL && k < 4 && strcmp(cfa, brace_cfa_name((brace_cfa)k)) != 0; k++) {
    }
    if (cfa == NULL || k == 4 || !numbers(black, json, "black", 4) ||
        !numbers(f->as_shot_neutral, json, "as_shot_neutral", 3) ||
        !numbers(f->color_matrix[0], json, "color_matrix_1", 9) ||
        !numbers(f->color_matrix[1], json, "color_matrix_2", 9) || !numbers(noise, json, "noise", 6)) {
        return false;
    }
    f->cfa = (brace_cfa)k;
    for (k = 0; k < 4; k++) {
        f->black[k] = (float)black[k];
    }
    for (k = 0; k < 6; k++) {
        f->noise[k / 2][k % 2] = noise[k];
    }
    f->has_noise = true; /* a profile, or what the ISO tells: readers always give it */
    f->white = (float)json_number_value(json_object_get(json, "white"));
    f->exposure_time = json_number_value(json_object_get(json, "exposure_time"));
    f->iso = json_number_value(json_object_get(json, "iso"));
    f->illuminant[0] = (uint16_t)json_integer_value(json_object_get(json, "illuminant_1"));
    f->illuminant[1] = (uint16_t)json_integer_value(json_object_get(json, "illuminant_2"));
    return true;
}

static const core_tensor *array(const core_safetensors *shard, const char *name, const char *what, int rank) {
    char *full = dataset_path(name, what);
    const core_tensor *t = full != NULL ? core_safetensors_find(shard, full) : NULL;
    core_free(full);
    return t != NULL && t->dtype == CORE_U16 && t->rank == rank && (uintptr_t)t->data % 2 == 0 ? t : NULL;
}

static brace_status read_bracket(train_bracket *b, const core_safetensors *shard, const char *name, const json_t *json,
                                 int count, brace_error *error) {
    const core_tensor *frames = array(shard, name, "frames", 3), *truth = array(shard, name, "gt", 2);
    const json_t *list = json_object_get(json, "frames");
    if (frames == NULL || truth == NULL || !json_is_array(list) || json_array_size(list) != frames->shape[0] ||
        frames->shape[1] != truth->shape[0] || frames->shape[2] != truth->shape[1] || truth->shape[0] < 4 ||
        truth->shape[1] < 4 || truth->shape[0] > BRACE_MAX_SIDE || truth->shape[1] > BRACE_MAX_SIDE) {
        return core_fail(error, BRACE_ERROR_FORMAT, "frames and truth are not those of a bracket");
    }
    if (count == 0) {
        count = frames->shape[0] <= BRACE_BRACKET_MAX ? (int)frames->shape[0] : 0;
    }
    if (frames->shape[0] != (uint64_t)count) {
        return core_fail(error, BRACE_ERROR_MISMATCH, "%llu frames; brackets of %d are wanted",
                         (unsigned long long)frames->shape[0], count);
    }
    const size_t plane = (size_t)(truth->shape[0] * truth->shape[1]);
    b->count = count;
    for (int i = -1; i < count; i++) {
        brace_frame f = {.width = (uint32_t)truth->shape[1], .height = (uint32_t)truth->shape[0]};
        if (!frame_of(&f, i < 0 ? json_object_get(json, "gt") : json_array_get(list, (size_t)i))) {
            return core_fail(error, BRACE_ERROR_FORMAT, "what is said of its frames is incomplete");
        }
        /* Borrowed and only read. */
        f.data = (uint16_t *)(uintptr_t)(i < 0 ? truth->data : (const uint16_t *)frames->data + (size_t)i * plane);
        train_bracket_set(b, i, &f);
    }
    return train_bracket_finish(b, error);
}

static brace_status add(train_packed *p, const core_safetensors *shard, const char *name, int frames,
                        brace_error *error) {
    if (p->count == p->room) {
        const size_t room = p->room > 0 ? 2 * p->room : 64;
        packed_item *item = core_calloc(room, sizeof *item);
        if (item == NULL) {
            return core_fail_memory(error, room * sizeof *item, "a list of samples");
        }
        if (p->item != NULL) {
            memcpy(item, p->item, p->count * sizeof *item);
        }
        core_free(p->item);
        p->item = item;
        p->room = room;
    }
    packed_item *item = &p->item[p->count];
    json_t *json = json_loads(core_safetensors_metadata(shard, name), 0, NULL);
    *item = (packed_item){.name = core_strdup(name)};
    if (item->name == NULL) {
        json_decref(json);
        return core_fail_memory(error, strlen(name), "a name");
    }
    p->count++;
    brace_status status = read_bracket(&item->bracket, shard, name, json, frames, error);
    json_decref(json);
    return status;
}

static brace_status read_shard(train_packed *p, const char *path, int frames, brace_error *error) {
    core_safetensors *shard = NULL;
    brace_status status = core_safetensors_open(&shard, path, error);
    if (status != BRACE_OK) {
        return status;
    }
    p->shard[p->shards++] = shard;
    const char *format = core_safetensors_metadata(shard, "format");
    if (format == NULL || strcmp(format, DATASET_FORMAT) != 0) {
        return core_fail(error, BRACE_ERROR_FORMAT, "%s: no shard of a set (brace dataset pack makes them)", path);
    }
    const char *name;
    for (size_t i = 0; status == BRACE_OK && (name = core_safetensors_metadata_key(shard, i)) != NULL; i++) {
        if (strcmp(name, "format") != 0) {
            status = add(p, shard, name, frames, error);
            if (status != BRACE_OK) {
                core_error_prefix(error, name);
                core_error_prefix(error, path);
            }
        }
    }
    return status;
}

/* NAME-00000.safetensors of a split; "samples" of a set without splits. */
static bool belongs(const char *name, const char *split) {
    const size_t n = strlen(split), length = strlen(name);
    static const char ending[] = ".safetensors";
    return length > n + sizeof ending && strncmp(name, split, n) == 0 && name[n] == '-' &&
           strcmp(name + length - (sizeof ending - 1), ending) == 0;
}

brace_status train_packed_open(train_packed **out, const char *folder, const char *split, int frames,
                               brace_error *error) {
    struct dirent **names = NULL;
    const int n = scandir(folder, &names, NULL, alphasort);
    if (n < 0) {
        return core_fail(error, BRACE_ERROR_IO, "%s: cannot look into this folder: %s", folder, strerror(errno));
    }
    train_packed *p = core_calloc(1, sizeof *p);
    brace_status status = BRACE_OK;
    if (p == NULL || (p->shard = core_calloc((size_t)n + 1, sizeof(core_safetensors *))) == NULL) {
        status = core_fail_memory(error, (size_t)n * sizeof(core_safetensors *), "a list of shards");
    }
    for (int i = 0; i < n; i++) {
        if (status == BRACE_OK && belongs(names[i]->d_name, split) && p->shards < SHARDS_MOST) {
            char *path = dataset_path(folder, names[i]->d_name);
            status = path != NULL ? read_shard(p, path, frames, error) : core_fail_memory(error, 256, "a name");
            core_free(path);
        }
        free(names[i]);
    }
    free(names);
    if (status == BRACE_OK && (p->count == 0 || p->count > UINT32_MAX)) {
        status = core_fail(error, BRACE_ERROR_ARGUMENT,
                           "%s: no shards %s-00000.safetensors, ... with samples are in this folder", folder, split);
    }
    if (status != BRACE_OK) {
        train_packed_close(p);
        return status;
    }
    *out = p;
    return BRACE_OK;
}
