/* SPDX-License-Identifier: Apache-2.0 */
/*
 * dataset.c: finding, reading and naming samples; making a folder that is
 * complete or not there.
 */
#include "sim/dataset.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/sha256.h"

char *dataset_path(const char *folder, const char *name) {
    size_t a = strlen(folder), b = strlen(name);
    bool slash = a > 0 && folder[a - 1] != '/';
    char *path = core_alloc(a + b + 2, 1);
    if (path != NULL) {
        memcpy(path, folder, a);
        path[a] = '/';
        memcpy(path + a + slash, name, b + 1);
    }
    return path;
}

static bool is_folder(const char *path) {
    struct stat info;
    return stat(path, &info) == 0 && S_ISDIR(info.st_mode);
}

static bool has(const char *folder, const char *name) {
    char *path = dataset_path(folder, name);
    bool there = path != NULL && access(path, F_OK) == 0;
    core_free(path);
    return there;
}

bool dataset_is_sample(const char *folder) {
    return has(folder, "frame_1.dng") || has(folder, "gt.dng") || has(folder, "meta.json");
}

/* ---- lists ---- */

void dataset_list_free(dataset_list *list) {
    for (size_t i = 0; i < list->count; i++) {
        core_free(list->items[i].folder);
        core_free(list->items[i].name);
    }
    core_free(list->items);
    *list = (dataset_list){0};
}

static brace_status list_add(dataset_list *list, const char *folder, const char *name, brace_error *error) {
    if (list->count == list->capacity) {
        size_t capacity = list->capacity > 0 ? 2 * list->capacity : 64;
        dataset_sample *grown = core_alloc(capacity, sizeof *grown);
        if (grown == NULL) {
            return core_fail_memory(error, capacity * sizeof *grown, "a list of samples");
        }
        if (list->count > 0) {
            memcpy(grown, list->items, list->count * sizeof *grown);
        }
        core_free(list->items);
        list->items = grown;
        list->capacity = capacity;
    }
    dataset_sample sample = {core_strdup(folder), core_strdup(name)};
    if (sample.folder == NULL || sample.name == NULL) {
        core_free(sample.folder);
        core_free(sample.name);
        return core_fail_memory(error, strlen(folder), "a name");
    }
    list->items[list->count++] = sample;
    return BRACE_OK;
}

static brace_status list_folder(dataset_list *list, const char *folder, const char *prefix, int depth,
                                brace_error *error) {
    DIR *dir = opendir(folder);
    if (dir == NULL) {
        return core_fail(error, BRACE_ERROR_IO, "%s: cannot look into this folder: %s", folder,
                         errno == ENOENT ? "it does not exist" : strerror(errno));
    }
    brace_status status = BRACE_OK;
    for (struct dirent *entry; status == BRACE_OK && (entry = readdir(dir)) != NULL;) {
        if (entry->d_name[0] == '.') {
            continue;
        }
        char *path = dataset_path(folder, entry->d_name), *name = dataset_path(prefix, entry->d_name);
        if (path == NULL || name == NULL) {
            status = core_fail_memory(error, 256, "a name");
        } else if (is_folder(path)) {
            const char *shown = prefix[0] != '\0' ? name : entry->d_name;
            if (dataset_is_sample(path)) {
                status = list_add(list, path, shown, error);
            } else if (depth > 0) {
                status = list_folder(list, path, shown, depth - 1, error);
            }
        }
        core_free(path);
        core_free(name);
    }
    closedir(dir);
    return status;
}

static int by_name(const void *a, const void *b) {
    return strcmp(((const dataset_sample *)a)->name, ((const dataset_sample *)b)->name);
}

brace_status dataset_list_read(dataset_list *out, const char *folder, brace_error *error) {
    *out = (dataset_list){0};
    brace_status status;
    if (dataset_is_sample(folder)) {
        const char *slash = strrchr(folder, '/');
        status = list_add(out, folder, slash != NULL && slash[1] != '\0' ? slash + 1 : folder, error);
    } else {
        status = list_folder(out, folder, "", 1, error);
    }
    if (status == BRACE_OK && out->count == 0) {
        status = core_fail(error, BRACE_ERROR_FORMAT,
                           "%s: there are no samples in this folder (folders with frame_1.dng ... and gt.dng)", folder);
    }
    if (status != BRACE_OK) {
        dataset_list_free(out);
    } else if (out->count > 1) {
        qsort(out->items, out->count, sizeof *out->items, by_name);
    }
    return status;
}

/* ---- JSON files ---- */

brace_status dataset_json_load(json_t **out, const char *path, size_t limit, brace_error *error) {
    *out = NULL;
    if (access(path, F_OK) != 0 && errno == ENOENT) {
        return BRACE_OK;
    }
    void *text = NULL;
    size_t size = 0;
    brace_status status = core_file_load(&text, &size, path, limit, error);
    if (status != BRACE_OK) {
        return status;
    }
    json_error_t problem;
    *out = json_loadb(text, size, JSON_REJECT_DUPLICATES, &problem);
    core_free(text);
    if (!json_is_object(*out)) {
        bool parsed = *out != NULL;
        json_decref(*out);
        *out = NULL;
        return parsed ? core_fail(error, BRACE_ERROR_FORMAT, "%s: it holds no JSON object", path)
                      : core_fail(error, BRACE_ERROR_FORMAT, "%s:%d: %s", path, problem.line, problem.text);
    }
    return BRACE_OK;
}

brace_status dataset_json_save(json_t *value, const char *path, brace_error *error) {
    core_file *file = NULL;
    brace_status status = core_file_create(&file, path, error);
    if (status != BRACE_OK) {
        return status;
    }
    errno = 0;
    if (value == NULL || json_dumpf(value, core_file_stream(file), JSON_INDENT(1) | JSON_REAL_PRECISION(17)) != 0 ||
        putc('\n', core_file_stream(file)) == EOF) {
        int code = errno;
        core_file_abort(file);
        return core_fail(error, BRACE_ERROR_IO, "%s: cannot write: %s", path,
                         code == ENOSPC ? "no space left on the disk" : code != 0 ? strerror(code) : "no valid text");
    }
    return core_file_commit(file, error);
}

/* ---- one sample ---- */

void dataset_loaded_free(dataset_loaded *sample) {
    for (size_t i = 0; i < sample->count; i++) {
        brace_frame_destroy(sample->frames[i]);
    }
    brace_frame_destroy(sample->truth);
    brace_frame_destroy(sample->exact);
    json_decref(sample->meta);
    *sample = (dataset_loaded){0};
}

static brace_status read_one(brace_frame **out, const char *folder, const char *name, const brace_job *job,
                             brace_error *error) {
    char *path = dataset_path(folder, name);
    if (path == NULL) {
        return core_fail_memory(error, 256, "a name");
    }
    brace_status status = access(path, F_OK) == 0
                              ? brace_frame_read(out, path, job, error)
                              : core_fail(error, BRACE_ERROR_FORMAT, "%s is missing", name);
    core_free(path);
    return status;
}

static bool alike(const brace_frame *a, const brace_frame *b) {
    return a->width == b->width && a->height == b->height && a->cfa == b->cfa;
}

brace_status dataset_load(dataset_loaded *out, const char *folder, const brace_job *job, brace_error *error) {
    *out = (dataset_loaded){0};
    brace_status status = BRACE_OK;
    for (int i = 1; i <= BRACE_BRACKET_MAX && status == BRACE_OK; i++) {
        char name[32];
        snprintf(name, sizeof name, "frame_%d.dng", i);
        if (i > BRACE_BRACKET_MIN && !has(folder, name)) {
            break;
        }
        status = read_one(&out->frames[out->count], folder, name, job, error);
        out->count += status == BRACE_OK;
        if (status == BRACE_OK && i > 1 && !alike(out->frames[0], out->frames[i - 1])) {
            status = core_fail(error, BRACE_ERROR_MISMATCH, "%s has another size or CFA than frame_1.dng", name);
        }
    }
    if (status == BRACE_OK) {
        status = read_one(&out->truth, folder, "gt.dng", job, error);
    }
    if (status == BRACE_OK && !alike(out->frames[0], out->truth)) {
        status = core_fail(error, BRACE_ERROR_MISMATCH, "gt.dng has another size or CFA than the frames");
    }
    if (status == BRACE_OK && has(folder, "gt_exact.dng")) {
        status = read_one(&out->exact, folder, "gt_exact.dng", job, error);
        if (status == BRACE_OK && !alike(out->frames[0], out->exact)) {
            status = core_fail(error, BRACE_ERROR_MISMATCH, "gt_exact.dng has another size or CFA than the frames");
        }
    }
    if (status == BRACE_OK) {
        char *path = dataset_path(folder, "meta.json");
        status = path != NULL ? dataset_json_load(&out->meta, path, DATASET_META_LIMIT, error)
                              : core_fail_memory(error, 256, "a name");
        core_free(path);
    }
    if (status != BRACE_OK) {
        dataset_loaded_free(out);
    }
    return status;
}

brace_status dataset_hashes(json_t **out, const char *folder, brace_error *error) {
    *out = json_object();
    brace_status status = *out != NULL ? BRACE_OK : core_fail_memory(error, 64, "hashes");
    for (int i = 1; i <= BRACE_BRACKET_MAX + 2 && status == BRACE_OK; i++) {
        char name[32], hex[65];
        uint64_t size = 0;
        snprintf(name, sizeof name, "%s", i == BRACE_BRACKET_MAX + 1 ? "gt.dng" : "gt_exact.dng");
        if (i <= BRACE_BRACKET_MAX) {
            snprintf(name, sizeof name, "frame_%d.dng", i);
        }
        if (!has(folder, name)) {
            continue;
        }
        char *path = dataset_path(folder, name);
        status = path != NULL ? core_sha256_file(hex, path, &size, error) : core_fail_memory(error, 256, "a name");
        core_free(path);
        if (status == BRACE_OK &&
            json_object_set_new(*out, name, json_pack("{s:I, s:s}", "bytes", (json_int_t)size, "sha256", hex)) != 0) {
            status = core_fail_memory(error, 64, "hashes");
        }
    }
    if (status != BRACE_OK) {
        json_decref(*out);
        *out = NULL;
    }
    return status;
}

/* ---- folders ---- */

brace_status dataset_make_folder(const char *path, brace_error *error) {
    char *copy = core_strdup(path);
    if (copy == NULL) {
        return core_fail_memory(error, strlen(path), "a name");
    }
    brace_status status = BRACE_OK;
    for (char *p = copy + 1; status == BRACE_OK; p++) {
        if (*p != '/' && *p != '\0') {
            continue;
        }
        char end = *p;
        *p = '\0';
        if (mkdir(copy, 0777) != 0 && errno != EEXIST) {
            status = core_fail(error, BRACE_ERROR_IO, "%s: cannot make this folder: %s", copy, strerror(errno));
        } else if (!is_folder(copy)) {
            status = core_fail(error, BRACE_ERROR_IO, "%s: it is a file, a folder is needed", copy);
        }
        *p = end;
        if (end == '\0') {
            break;
        }
    }
    core_free(copy);
    return status;
}

/* Removes the files in a folder that BRACE makes, then the folder. */
void dataset_discard(const char *temporary) {
    DIR *dir = opendir(temporary);
    if (dir == NULL) {
        return;
    }
    for (struct dirent *entry; (entry = readdir(dir)) != NULL;) {
        if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0) {
            unlinkat(dirfd(dir), entry->d_name, 0);
        }
    }
    closedir(dir);
    rmdir(temporary);
}

brace_status dataset_begin(char **temporary, const char *final, brace_error *error) {
    const char *slash = strrchr(final, '/');
    size_t n = slash != NULL ? (size_t)(slash - final) + 1 : 0;
    *temporary = core_alloc(strlen(final) + 16, 1);
    if (*temporary == NULL) {
        return core_fail_memory(error, strlen(final), "a name");
    }
    snprintf(*temporary, strlen(final) + 16, "%.*s.part-%s", (int)n, final, final + n);
    dataset_discard(*temporary);
    brace_status status = dataset_make_folder(*temporary, error);
    if (status != BRACE_OK) {
        core_free(*temporary);
        *temporary = NULL;
    }
    return status;
}

brace_status dataset_finish(const char *temporary, const char *final, brace_error *error) {
    brace_status status = core_folder_sync(temporary, error);
    if (status != BRACE_OK) {
        dataset_discard(temporary);
        return status;
    }
    if (rename(temporary, final) != 0) {
        int code = errno;
        dataset_discard(temporary);
        return core_fail(error, BRACE_ERROR_IO, "%s: cannot give the sample its name: %s", final, strerror(code));
    }
    return BRACE_OK;
}
