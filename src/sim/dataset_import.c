/* SPDX-License-Identifier: Apache-2.0 */
/*
 * dataset_import.c: real captures into a set. A capture is a folder of six RAW
 * files shot as the paper has it: five exposures whose times are 16, 4, 1, 1/4
 * and 1/16 of the reference's at one ISO, and a truth of 8 times the time at an
 * eighth of the ISO. Files are told apart by what they record, not by name or
 * order. What does not fit is rejected with the reason.
 */
#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/sha256.h"
#include "sim/dataset.h"

enum { FRAMES = 5, FILES = FRAMES + 1 };

static const char hashes_key[] = "sources_sha256"; /* of the six files, in meta.json */

typedef struct importer {
    const char *out;
    int reduce;
    double tolerance;
    dataset_import_fn *each;
    void *user;
    dataset_imported *done;
    const brace_job *job;
} importer;

/* ---- folders ---- */

static bool is_raw(const char *name) {
    static const char *const ends[] = {"dng", "3fr", "arw", "cr2", "cr3", "crw", "erf", "iiq", "kdc", "mef", "nef",
                                       "nrw", "orf", "pef", "raf", "raw", "rw2", "rwl", "srw"};
    const char *dot = strrchr(name, '.');
    for (size_t i = 0; dot != NULL && name[0] != '.' && i < sizeof ends / sizeof ends[0]; i++) {
        if (strcasecmp(dot + 1, ends[i]) == 0) {
            return true;
        }
    }
    return false;
}

typedef struct names {
    struct dirent **items;
    int count;
} names;

static brace_status names_read(names *out, const char *folder, brace_error *error) {
    out->count = scandir(folder, &out->items, NULL, versionsort);
    if (out->count < 0) {
        out->items = NULL;
        return core_fail(error, BRACE_ERROR_IO, "%s: cannot look into this folder: %s", folder, strerror(errno));
    }
    return BRACE_OK;
}

static void names_free(names *n) {
    for (int i = 0; i < n->count; i++) {
        free(n->items[i]);
    }
    free(n->items);
}

/* ---- one capture ---- */

static bool about(double value, double wanted) {
    return value > 0 && fabs(log2(value / wanted)) < 0.25;
}

static int by_time(const void *a, const void *b) {
    const brace_frame *x = *(brace_frame *const *)a, *y = *(brace_frame *const *)b;
    return (x->exposure_time > y->exposure_time) - (x->exposure_time < y->exposure_time);
}

/* frames[0..5] in any order: the five by exposure time, then the truth. */
static brace_status sort_capture(brace_frame *frames[FILES], brace_error *error) {
    size_t lowest = 0;
    for (size_t i = 0; i < FILES; i++) {
        const brace_frame *f = frames[i];
        if (!(f->exposure_time > 0) || !(f->iso > 0)) {
            return core_fail(error, BRACE_ERROR_MISMATCH, "%s records no exposure time or no ISO", f->path);
        }
        if (f->width != frames[0]->width || f->height != frames[0]->height || f->cfa != frames[0]->cfa ||
            strcmp(f->model, frames[0]->model) != 0) {
            return core_fail(error, BRACE_ERROR_MISMATCH, "%s has another camera, size or CFA than %s", f->path,
                             frames[0]->path);
        }
        lowest = f->iso < frames[lowest]->iso ? i : lowest;
    }
    brace_frame *truth = frames[lowest];
    frames[lowest] = frames[FRAMES];
    frames[FRAMES] = truth;
    qsort(frames, FRAMES, sizeof *frames, by_time);
    const brace_frame *reference = frames[FRAMES / 2];
    if (truth->iso > 0.5 * reference->iso) {
        return core_fail(error, BRACE_ERROR_MISMATCH,
                         "no file has a much lower ISO than the others: the truth is shot at an eighth");
    }
    for (int i = 0; i < FRAMES; i++) {
        if (!about(frames[i]->iso, reference->iso)) {
            return core_fail(error, BRACE_ERROR_MISMATCH, "%s has ISO %g, the others %g", frames[i]->path,
                             frames[i]->iso, reference->iso);
        }
        double wanted = pow(4, i - FRAMES / 2);
        if (!about(frames[i]->exposure_time / reference->exposure_time, wanted)) {
            return core_fail(error, BRACE_ERROR_MISMATCH, "%s has %.3g times the reference's exposure, not %g",
                             frames[i]->path, frames[i]->exposure_time / reference->exposure_time, wanted);
        }
    }
    if (!about(truth->exposure_time / reference->exposure_time, 8) || !about(truth->iso / reference->iso, 0.125)) {
        return core_fail(error, BRACE_ERROR_MISMATCH,
                         "%s, the truth, has %.3g times the reference's exposure time at %.3g of its ISO, not 8 at 1/8",
                         truth->path, truth->exposure_time / reference->exposure_time, truth->iso / reference->iso);
    }
    return BRACE_OK;
}

static brace_status reduce_all(brace_frame *frames[FILES], int factor, brace_error *error) {
    for (size_t i = 0; factor > 1 && i < FILES; i++) {
        brace_frame *smaller = NULL;
        brace_status status = dataset_reduce(&smaller, frames[i], factor, error);
        if (status != BRACE_OK) {
            return status;
        }
        brace_frame_destroy(frames[i]);
        frames[i] = smaller;
    }
    return BRACE_OK;
}

/* `hashes`: of the six files, as they were found. */
static brace_status write_sample(const importer *im, brace_frame *frames[FILES], const char *final, const char *source,
                                 json_t *sources, json_t *hashes, double displacement, brace_error *error) {
    char *folder = NULL;
    brace_status status = dataset_begin(&folder, final, error);
    for (size_t i = 0; i < FILES && status == BRACE_OK; i++) {
        char name[32];
        snprintf(name, sizeof name, i < FRAMES ? "frame_%zu.dng" : "gt.dng", i + 1);
        char *path = dataset_path(folder, name);
        const brace_dng_params params = {.no_preview = true};
        status = path != NULL ? brace_frame_write_dng(frames[i], path, &params, im->job, error)
                              : core_fail_memory(error, 256, "a name");
        core_free(path);
    }
    json_t *files = NULL;
    if (status == BRACE_OK) {
        status = dataset_hashes(&files, folder, error);
    }
    if (status == BRACE_OK) {
        const brace_frame *r = frames[FRAMES / 2];
        json_t *name = json_string(source);
        json_t *meta = json_pack("{s:s, s:s, s:o, s:O, s:O, s:i, s:o, s:{s:f, s:f}, s:o}", "format", DATASET_FORMAT, "kind",
                                 "imported", "source", name != NULL ? name : json_string("?"), "sources", sources,
                                 hashes_key, hashes, "reduced_by", im->reduce,
                                 "displacement", isfinite(displacement) ? json_real(displacement) : json_null(),
                                 "reference", "exposure_time", r->exposure_time, "iso", r->iso, "files", files);
        char *path = dataset_path(folder, "meta.json");
        status = meta != NULL && path != NULL ? dataset_json_save(meta, path, error)
                                              : core_fail_memory(error, 256, "metadata");
        core_free(path);
        json_decref(meta);
    }
    if (status == BRACE_OK) {
        status = dataset_finish(folder, final, error);
    } else if (folder != NULL) {
        dataset_discard(folder);
    }
    core_free(folder);
    return status;
}

/* The names of the files, as they will stand in meta.json: without their folders. */
static json_t *source_names(brace_frame *frames[FILES]) {
    json_t *list = json_array();
    for (size_t i = 0; i < FILES; i++) {
        const char *slash = strrchr(frames[i]->path, '/');
        json_t *name = json_string(slash != NULL ? slash + 1 : frames[i]->path);
        json_array_append_new(list, name != NULL ? name : json_string("?"));
    }
    return list;
}

static brace_status import_files(const importer *im, char *paths[FILES], const char *source, json_t *hashes,
                                 const char *final, double *displacement, brace_error *error) {
    brace_frame *frames[FILES] = {NULL};
    brace_status status = BRACE_OK;
    for (size_t i = 0; i < FILES && status == BRACE_OK; i++) {
        status = brace_frame_read(&frames[i], paths[i], im->job, error);
        if (status == BRACE_ERROR_IO) {
            status = BRACE_ERROR_FORMAT; /* one file that cannot be read rejects its capture, and ends nothing else */
        }
    }
    if (status == BRACE_OK) {
        status = sort_capture(frames, error);
    }
    json_t *sources = status == BRACE_OK ? source_names(frames) : NULL;
    if (status == BRACE_OK) {
        status = reduce_all(frames, im->reduce, error);
    }
    if (status == BRACE_OK) {
        *displacement = dataset_displacement(frames[FRAMES / 2], frames[FRAMES]);
        if (*displacement > im->tolerance) {
            status = core_fail(error, BRACE_ERROR_MISMATCH,
                               "the truth is displaced by %.1f pixels against the reference, %.1f are allowed",
                               *displacement, im->tolerance);
        }
    }
    if (status == BRACE_OK) {
        status = write_sample(im, frames, final, source, sources, hashes, *displacement, error);
    }
    json_decref(sources);
    for (size_t i = 0; i < FILES; i++) {
        brace_frame_destroy(frames[i]);
    }
    return status;
}

/* ---- captures ---- */

static int by_text(const void *a, const void *b) {
    return strcmp(a, b);
}

/* What tells a capture from another of the same name, whatever its files are called: in order of the hashes. A file that
 * cannot be read rejects it. */
static brace_status hash_files(json_t **out, char *const paths[FILES], brace_error *error) {
    char hex[FILES][65];
    for (size_t i = 0; i < FILES; i++) {
        const brace_status status = core_sha256_file(hex[i], paths[i], NULL, error);
        if (status != BRACE_OK) {
            return status == BRACE_ERROR_IO ? BRACE_ERROR_FORMAT : status;
        }
    }
    qsort(hex, FILES, sizeof *hex, by_text);
    *out = json_array();
    for (size_t i = 0; i < FILES; i++) {
        json_array_append_new(*out, json_string(hex[i]));
    }
    return *out != NULL ? BRACE_OK : core_fail_memory(error, 256, "hashes");
}

static bool made_of(const char *sample, const json_t *hashes) {
    char *path = dataset_path(sample, "meta.json");
    json_t *meta = NULL;
    const bool same = path != NULL && dataset_json_load(&meta, path, DATASET_META_LIMIT, NULL) == BRACE_OK &&
                      json_equal(json_object_get(meta, hashes_key), hashes);
    json_decref(meta);
    core_free(path);
    return same;
}

/* The sample that a capture becomes: of its folder's name, or the first of NAME-2, NAME-3, ... that is not another's.
 * *there: it was imported before. */
static brace_status place(char **final, bool *there, const char *out, const char *name, const json_t *hashes,
                          brace_error *error) {
    *there = false;
    for (unsigned n = 1;; n++) {
        char numbered[NAME_MAX + 16];
        snprintf(numbered, sizeof numbered, "%s-%u", name, n);
        *final = dataset_path(out, n > 1 ? numbered : name);
        if (*final == NULL) {
            return core_fail_memory(error, 256, "a name");
        }
        if (access(*final, F_OK) != 0) {
            return BRACE_OK;
        }
        if (made_of(*final, hashes)) {
            *there = true;
            return BRACE_OK;
        }
        core_free(*final);
        *final = NULL;
    }
}

/* A folder with RAW files is a capture. Errors of its content are told, others returned. */
static brace_status import_capture(const importer *im, const char *folder, const names *in, brace_error *error) {
    char *paths[FILES] = {NULL};
    size_t found = 0;
    brace_status status = BRACE_OK;
    for (int i = 0; i < in->count; i++) {
        if (is_raw(in->items[i]->d_name) && found++ < FILES) {
            paths[found - 1] = dataset_path(folder, in->items[i]->d_name);
        }
    }
    char *full = realpath(folder, NULL), *final = NULL; /* "." has a name, too */
    const char *slash = full != NULL ? strrchr(full, '/') : NULL, *name = slash != NULL ? slash + 1 : "";
    brace_error problem = {0};
    double displacement = NAN;
    json_t *hashes = NULL;
    bool there = false;
    brace_status inner = found == FILES
                             ? hash_files(&hashes, paths, &problem)
                             : core_fail(&problem, BRACE_ERROR_MISMATCH, "%zu RAW files, six make a capture", found);
    if (inner == BRACE_OK && name[0] == '\0') {
        inner = core_fail(&problem, BRACE_ERROR_MISMATCH, "the folder has no name that a sample could have");
    }
    if (inner == BRACE_OK) {
        inner = place(&final, &there, im->out, name, hashes, &problem);
    }
    if (there) {
        im->done->there++;
    } else {
        if (inner == BRACE_OK) {
            inner = import_files(im, paths, name, hashes, final, &displacement, &problem);
        }
        /* A full disk or an end of memory is nobody's capture's fault. */
        if (inner == BRACE_ERROR_IO || core_gave_up(inner)) {
            status = core_fail(error, inner, "%s", problem.message);
        } else {
            *(inner == BRACE_OK ? &im->done->good : &im->done->rejected) += 1;
            if (im->each != NULL) {
                const char *base = final != NULL ? strrchr(final, '/') : NULL;
                im->each(im->user, folder, base != NULL ? base + 1 : name, inner == BRACE_OK ? NULL : problem.message,
                         displacement);
            }
        }
    }
    for (size_t i = 0; i < FILES; i++) {
        core_free(paths[i]);
    }
    json_decref(hashes);
    free(full);
    core_free(final);
    return status;
}

static brace_status import_folder(const importer *im, const char *folder, int depth, brace_error *error) {
    names in;
    brace_status status = names_read(&in, folder, error);
    if (status != BRACE_OK) {
        return status;
    }
    bool any = false;
    for (int i = 0; i < in.count; i++) {
        any = any || is_raw(in.items[i]->d_name);
    }
    if (any) {
        status = import_capture(im, folder, &in, error);
    }
    for (int i = 0; !any && depth > 0 && status == BRACE_OK && i < in.count; i++) {
        struct stat info;
        if (in.items[i]->d_name[0] == '.') {
            continue;
        }
        char *path = dataset_path(folder, in.items[i]->d_name);
        core_progress(im->job, "importing", (uint64_t)i, (uint64_t)in.count);
        if ((status = core_check_cancel(im->job, error)) == BRACE_OK && path != NULL && stat(path, &info) == 0 &&
            S_ISDIR(info.st_mode)) {
            status = import_folder(im, path, depth - 1, error);
        }
        core_free(path);
    }
    names_free(&in);
    return status;
}

brace_status dataset_import(const char *const *folders, size_t count, const char *out,
                            const dataset_import_params *params, dataset_import_fn *each, void *user,
                            dataset_imported *done, const brace_job *job, brace_error *error) {
    *done = (dataset_imported){0};
    importer im = {.out = out, .reduce = 4, .tolerance = 1, .each = each, .user = user, .done = done, .job = job};
    if (params != NULL && params->reduce > 0) {
        im.reduce = params->reduce;
    }
    if (params != NULL && params->tolerance > 0) {
        im.tolerance = params->tolerance;
    }
    brace_status status = dataset_make_folder(out, error);
    for (size_t i = 0; i < count && status == BRACE_OK; i++) {
        status = import_folder(&im, folders[i], 3, error);
    }
    if (status == BRACE_OK && done->good + done->rejected + done->there == 0) {
        status = core_fail(error, BRACE_ERROR_FORMAT, "%s: there are no captures (folders with six RAW files)",
                           count > 0 ? folders[0] : "");
    }
    return status;
}
