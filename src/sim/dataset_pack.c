/* SPDX-License-Identifier: Apache-2.0 */
/*
 * dataset_pack.c: samples into shards: large safetensors files that training
 * maps into memory instead of opening seven files a sample.
 *
 *   "NAME/frames"  U16 [frames, height, width], shortest exposure first
 *   "NAME/gt"      U16 [height, width]
 *   metadata NAME  JSON: levels, exposure, colour and noise of each frame, the
 *                  hash of the pixels, and the sample's meta.json
 */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/safetensors.h"
#include "core/sha256.h"
#include "sim/dataset.h"

static json_t *numbers(const double *values, size_t count) {
    json_t *array = json_array();
    for (size_t i = 0; i < count; i++) {
        json_array_append_new(array, json_real(values[i]));
    }
    return array;
}

json_t *dataset_frame_json(const brace_frame *f) {
    const double black[4] = {(double)f->black[0], (double)f->black[1], (double)f->black[2], (double)f->black[3]};
    return json_pack("{s:s, s:o, s:f, s:f, s:f, s:f, s:o, s:o, s:i, s:o, s:i, s:o}", "cfa", brace_cfa_name(f->cfa),
                     "black", numbers(black, 4), "white", (double)f->white, "exposure_time", f->exposure_time, "iso",
                     f->iso, "f_number", f->f_number, "as_shot_neutral", numbers(f->as_shot_neutral, 3),
                     "color_matrix_1", numbers(f->color_matrix[0], 9), "illuminant_1", (int)f->illuminant[0],
                     "color_matrix_2", numbers(f->color_matrix[1], 9), "illuminant_2", (int)f->illuminant[1], "noise",
                     numbers(&f->noise[0][0], 6));
}

typedef struct packer {
    const char *out;
    uint64_t shard_bytes;
    core_safetensors_writer *writer;
    char split[256]; /* of the open shard */
    size_t number;   /* of the next shard of this split */
    size_t shards;
    uint16_t *pixels; /* scratch */
    size_t capacity;
} packer;

static brace_status shard_path(char **path, const packer *p, brace_error *error) {
    char name[320];
    snprintf(name, sizeof name, "%s-%05zu.safetensors", p->split, p->number);
    *path = dataset_path(p->out, name);
    return *path != NULL ? BRACE_OK : core_fail_memory(error, sizeof name, "a name");
}

static brace_status close_shard(packer *p, brace_error *error) {
    if (p->writer == NULL) {
        return BRACE_OK;
    }
    brace_status status = core_safetensors_commit(p->writer, error);
    p->writer = NULL;
    p->number++;
    p->shards++;
    return status;
}

/* Shards of an earlier, larger packing would be read as if they belonged to this one. */
static brace_status remove_stale(packer *p, brace_error *error) {
    for (;; p->number++) {
        char *path = NULL;
        brace_status status = shard_path(&path, p, error);
        bool gone = status != BRACE_OK || unlink(path) != 0;
        core_free(path);
        if (gone) {
            return status;
        }
    }
}

static brace_status open_shard(packer *p, brace_error *error) {
    char *path = NULL;
    brace_status status = shard_path(&path, p, error);
    size_t reserve = p->shard_bytes / 256 > ((size_t)4 << 20) ? (size_t)4 << 20 : (size_t)1 << 20;
    if (status == BRACE_OK) {
        status = core_safetensors_create(&p->writer, path, reserve, error);
    }
    core_free(path);
    return status == BRACE_OK ? core_safetensors_add_metadata(p->writer, "format", DATASET_FORMAT, error) : status;
}

/* Frames one after another, and the truth behind them, the exact one where it is known; and the text about them. */
static brace_status flatten(packer *p, const dataset_loaded *s, char **text, brace_error *error) {
    const brace_frame *truth = s->exact != NULL ? s->exact : s->truth;
    size_t plane = (size_t)s->truth->width * s->truth->height, count = plane * (s->count + 1);
    if (count > p->capacity) {
        core_free(p->pixels);
        p->capacity = 0;
        p->pixels = core_alloc(count, sizeof *p->pixels);
        if (p->pixels == NULL) {
            return core_fail_memory(error, count * sizeof *p->pixels, "a sample");
        }
        p->capacity = count;
    }
    json_t *frames = json_array();
    for (size_t i = 0; i < s->count; i++) {
        memcpy(p->pixels + i * plane, s->frames[i]->data, plane * sizeof *p->pixels);
        json_array_append_new(frames, dataset_frame_json(s->frames[i]));
    }
    memcpy(p->pixels + s->count * plane, truth->data, plane * sizeof *p->pixels);
    char hex[65];
    core_sha256 hash;
    core_sha256_begin(&hash);
    core_sha256_add(&hash, p->pixels, count * sizeof *p->pixels);
    core_sha256_end(&hash, hex);
    json_t *all = json_pack("{s:o, s:o, s:s, s:O?}", "frames", frames, "gt", dataset_frame_json(truth), "sha256",
                            hex, "meta", s->meta);
    *text = all != NULL ? json_dumps(all, JSON_COMPACT | JSON_REAL_PRECISION(15)) : NULL;
    json_decref(all);
    return *text != NULL ? BRACE_OK : core_fail_memory(error, 4096, "a sample's metadata");
}

static brace_status add_sample(packer *p, const char *name, const dataset_loaded *s, brace_error *error) {
    char *text = NULL;
    brace_status status = flatten(p, s, &text, error);
    size_t plane = (size_t)s->truth->width * s->truth->height;
    size_t bytes = plane * (s->count + 1) * sizeof *p->pixels;
    if (status == BRACE_OK && p->writer != NULL &&
        (core_safetensors_written(p->writer) + bytes > p->shard_bytes ||
         core_safetensors_room(p->writer) < 2 * strlen(text) + 4096)) {
        status = close_shard(p, error);
    }
    if (status == BRACE_OK && p->writer == NULL) {
        status = open_shard(p, error);
    }
    char *frames = dataset_path(name, "frames"), *truth = dataset_path(name, "gt");
    if (status == BRACE_OK && (frames == NULL || truth == NULL)) {
        status = core_fail_memory(error, 256, "a name");
    }
    if (status == BRACE_OK) {
        status = core_safetensors_add_metadata(p->writer, name, text, error);
    }
    if (status == BRACE_OK) {
        const core_tensor t = {.name = frames,
                               .dtype = CORE_U16,
                               .rank = 3,
                               .shape = {s->count, s->truth->height, s->truth->width},
                               .data = p->pixels};
        status = core_safetensors_add(p->writer, &t, error);
    }
    if (status == BRACE_OK) {
        const core_tensor t = {.name = truth,
                               .dtype = CORE_U16,
                               .rank = 2,
                               .shape = {s->truth->height, s->truth->width},
                               .data = p->pixels + s->count * plane};
        status = core_safetensors_add(p->writer, &t, error);
    }
    core_free(frames);
    core_free(truth);
    free(text);
    return status;
}

static void split_of(char *out, size_t size, const char *name) {
    const char *slash = strchr(name, '/');
    if (slash != NULL) {
        snprintf(out, size, "%.*s", (int)(slash - name), name);
    } else {
        snprintf(out, size, "samples");
    }
}

/* By split, then by name: shards are numbered within their split, also where samples without one lie between. */
static int by_split(const void *a, const void *b) {
    const char *x = ((const dataset_sample *)a)->name, *y = ((const dataset_sample *)b)->name;
    char split[2][256];
    split_of(split[0], sizeof split[0], x);
    split_of(split[1], sizeof split[1], y);
    const int order = strcmp(split[0], split[1]);
    return order != 0 ? order : strcmp(x, y);
}

/* What was made of the shards that were there before: without it, it is made when it is needed. */
static void remove_beside(const char *out) {
    static const char *const names[] = {DATASET_MOTIONS, DATASET_GUIDES};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        char *path = dataset_path(out, names[i]);
        if (path != NULL) {
            unlink(path);
        }
        core_free(path);
    }
}

static brace_status pack_all(packer *p, const dataset_list *list, const brace_job *job, brace_error *error) {
    brace_status status = BRACE_OK;
    for (size_t i = 0; i < list->count && status == BRACE_OK; i++) {
        char split[sizeof p->split];
        split_of(split, sizeof split, list->items[i].name);
        if (strcmp(split, p->split) != 0) {
            status = close_shard(p, error);
            if (status == BRACE_OK && p->split[0] != '\0') {
                status = remove_stale(p, error);
            }
            snprintf(p->split, sizeof p->split, "%s", split);
            p->number = 0;
        }
        core_progress(job, "packing", i, list->count);
        dataset_loaded sample;
        if (status == BRACE_OK && (status = core_check_cancel(job, error)) == BRACE_OK) {
            status = dataset_load(&sample, list->items[i].folder, job, error);
            if (status != BRACE_OK) {
                core_error_prefix(error, list->items[i].name);
            } else {
                status = add_sample(p, list->items[i].name, &sample, error);
                dataset_loaded_free(&sample);
            }
        }
    }
    if (status == BRACE_OK) {
        status = close_shard(p, error);
    }
    if (status == BRACE_OK) {
        status = remove_stale(p, error);
        core_progress(job, "packing", list->count, list->count);
    }
    return status;
}

brace_status dataset_pack(const char *folder, const char *out, const dataset_pack_params *params, const brace_job *job,
                          size_t *shards, brace_error *error) {
    dataset_list list;
    brace_status status = dataset_list_read(&list, folder, error);
    if (status != BRACE_OK) {
        return status;
    }
    packer p = {.out = out, .shard_bytes = params != NULL && params->shard_bytes > 0 ? params->shard_bytes : 1ull << 30};
    status = dataset_make_folder(out, error);
    if (status == BRACE_OK) {
        remove_beside(out);
        qsort(list.items, list.count, sizeof *list.items, by_split);
        status = pack_all(&p, &list, job, error);
    }
    core_safetensors_abort(p.writer);
    core_free(p.pixels);
    dataset_list_free(&list);
    if (shards != NULL) {
        *shards = p.shards;
    }
    return status;
}
