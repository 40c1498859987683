/* SPDX-License-Identifier: Apache-2.0 */
/*
 * dataset_verify.c: is everything there, unchanged and plausible? Every sample
 * that is not gets named with the reason; one bad sample does not stop the rest.
 * Folders are looked at side by side, a sample a thread, and told of in order.
 */
#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/safetensors.h"
#include "core/sha256.h"
#include "sim/dataset.h"

typedef struct verifier {
    dataset_problem_fn *problem;
    void *user;
    dataset_verified *out;
    bool bad;         /* this sample has been told of */
    json_t *problems; /* collects them for later; NULL: they are told at once */
} verifier;

static void tell(verifier *v, const char *sample, const char *format, ...) __attribute__((format(printf, 3, 4)));
static void tell(verifier *v, const char *sample, const char *format, ...) {
    char text[BRACE_ERROR_LENGTH];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    v->bad = true;
    if (v->problems != NULL) {
        json_array_append_new(v->problems, json_string_nocheck(text)); /* names of files may be no UTF-8 */
    } else if (v->problem != NULL) {
        v->problem(v->user, sample, text);
    }
}

/* ---- folders ---- */

/* The files against what meta.json says of them. */
static brace_status check_hashes(verifier *v, const dataset_sample *sample, json_t *meta, brace_error *error) {
    json_t *files = json_object_get(meta, "files"), *now = NULL;
    if (!json_is_object(files)) {
        v->out->unhashed++;
        return BRACE_OK;
    }
    brace_error problem = {0};
    brace_status status = dataset_hashes(&now, sample->folder, &problem);
    if (status == BRACE_ERROR_MEMORY) {
        return core_fail(error, status, "%s", problem.message);
    }
    if (status != BRACE_OK) {
        tell(v, sample->name, "%s", problem.message);
        return BRACE_OK;
    }
    const char *name;
    json_t *expected;
    json_object_foreach(files, name, expected) {
        json_t *found = json_object_get(now, name);
        if (found == NULL) {
            tell(v, sample->name, "%s is missing", name);
        } else if (!json_equal(json_object_get(found, "bytes"), json_object_get(expected, "bytes"))) {
            tell(v, sample->name, "%s has %lld bytes, not %lld", name,
                 (long long)json_integer_value(json_object_get(found, "bytes")),
                 (long long)json_integer_value(json_object_get(expected, "bytes")));
        } else if (!json_equal(json_object_get(found, "sha256"), json_object_get(expected, "sha256"))) {
            tell(v, sample->name, "%s has changed since it was made (its SHA-256 is another)", name);
        }
    }
    json_decref(now);
    return BRACE_OK;
}

static void check_range(verifier *v, const char *sample, const char *name, const brace_frame *f) {
    size_t count = (size_t)f->width * f->height, above = 0;
    uint16_t low = UINT16_MAX, high = 0;
    for (size_t i = 0; i < count; i++) {
        uint16_t x = f->data[i];
        low = x < low ? x : low;
        high = x > high ? x : high;
        above += (float)x > f->white;
    }
    if (above > 0) {
        tell(v, sample, "%s: %zu pixels are above its white level of %g", name, above, (double)f->white);
    } else if (low == high && (float)low < f->white && strncmp(name, "gt", 2) != 0) {
        /* A bright page may clip whole, and only the truth has no noise. */
        tell(v, sample, "%s: all pixels have the value %u", name, low);
    }
}

/* Takes the frames of `s` over. */
static brace_status check_bracket(verifier *v, const char *sample, dataset_loaded *s, const brace_job *job,
                                  brace_error *error) {
    brace_bracket *bracket = NULL;
    brace_error problem = {0};
    brace_job quiet = {.threads = job != NULL ? job->threads : 0, .cancel = job != NULL ? job->cancel : NULL};
    const brace_status status = brace_bracket_create(&bracket, s->frames, s->count, NULL, &quiet, &problem);
    if (core_gave_up(status)) {
        return core_fail(error, status, "%s", problem.message);
    }
    if (status != BRACE_OK) {
        tell(v, sample, "%s", problem.message);
        return BRACE_OK;
    }
    s->count = 0;
    const brace_frame *reference = bracket->frames[bracket->reference];
    for (size_t i = 0; i < bracket->count; i++) {
        if (bracket->order[i] != i) {
            tell(v, sample, "the frames are not numbered by exposure, shortest first");
            break;
        }
    }
    const double a = reference->exposure_time * reference->iso;
    for (int i = 0; i < 2; i++) {
        const brace_frame *truth = i == 0 ? s->truth : s->exact;
        const double b = truth != NULL ? truth->exposure_time * truth->iso : 0;
        if (a > 0 && b > 0 && fabs(log2(b / a)) > 0.1) {
            tell(v, sample, "%s has %+.1f stops more exposure than the reference frame",
                 i == 0 ? "gt.dng" : "gt_exact.dng", log2(b / a));
        }
    }
    brace_bracket_destroy(bracket);
    return BRACE_OK;
}

static brace_status verify_sample(verifier *v, const dataset_sample *sample, const brace_job *job,
                                  brace_error *error) {
    dataset_loaded s;
    brace_error problem = {0};
    v->bad = false;
    v->out->samples++;
    brace_job quiet = {.threads = job != NULL ? job->threads : 0, .cancel = job != NULL ? job->cancel : NULL};
    brace_status status = dataset_load(&s, sample->folder, &quiet, &problem);
    if (core_gave_up(status)) {
        return core_fail(error, status, "%s", problem.message);
    }
    if (status != BRACE_OK) {
        tell(v, sample->name, "%s", problem.message);
        v->out->bad++;
        return BRACE_OK;
    }
    status = check_hashes(v, sample, s.meta, error);
    for (size_t i = 0; i < s.count; i++) {
        char name[32];
        snprintf(name, sizeof name, "frame_%zu.dng", i + 1);
        check_range(v, sample->name, name, s.frames[i]);
    }
    check_range(v, sample->name, "gt.dng", s.truth);
    if (s.exact != NULL) {
        check_range(v, sample->name, "gt_exact.dng", s.exact);
    }
    if (status == BRACE_OK) {
        status = check_bracket(v, sample->name, &s, job, error);
    }
    dataset_loaded_free(&s);
    v->out->bad += v->bad;
    return status;
}

static bool listed(const dataset_list *list, const char *name) {
    size_t low = 0, high = list->count;
    while (low < high) {
        size_t middle = (low + high) / 2;
        int order = strcmp(list->items[middle].name, name);
        if (order == 0) {
            return true;
        }
        if (order < 0) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return false;
}

/* What dataset.json says should be there. */
static brace_status check_index(verifier *v, const char *folder, const dataset_list *list, brace_error *error) {
    char *path = dataset_path(folder, "dataset.json");
    json_t *index = NULL;
    brace_status status = path != NULL ? dataset_json_load(&index, path, DATASET_INDEX_LIMIT, error)
                                       : core_fail_memory(error, 256, "a name");
    core_free(path);
    size_t i;
    json_t *name;
    json_array_foreach(json_object_get(index, "samples"), i, name) {
        if (json_is_string(name) && !listed(list, json_string_value(name))) {
            v->out->missing++;
            tell(v, json_string_value(name), "it is missing");
        }
    }
    json_decref(index);
    return status;
}

/* What became of one sample. */
typedef struct verdict {
    dataset_verified counts;
    json_t *problems;
    brace_status status;
    brace_error error;
} verdict;

typedef struct verify_job {
    const dataset_sample *samples;
    verdict *verdicts;
    const brace_job *job;
} verify_job;

static void verify_some(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const verify_job *all = arg;
    const brace_job one = {.threads = 1, .cancel = all->job != NULL ? all->job->cancel : NULL};
    for (size_t i = begin; i < end; i++) {
        verdict *r = &all->verdicts[i];
        *r = (verdict){.problems = json_array()};
        verifier v = {.out = &r->counts, .problems = r->problems};
        r->status = r->problems != NULL ? core_check_cancel(&one, &r->error)
                                        : core_fail_memory(&r->error, 64, "a list of problems");
        if (r->status == BRACE_OK) {
            r->status = verify_sample(&v, &all->samples[i], &one, &r->error);
        }
    }
}

/* Tells of a sample, or of why it could not be looked at. */
static brace_status settle(verifier *v, verdict *r, const dataset_sample *sample, brace_error *error) {
    v->out->samples += r->counts.samples;
    v->out->bad += r->counts.bad;
    v->out->unhashed += r->counts.unhashed;
    size_t i;
    json_t *text;
    json_array_foreach(r->problems, i, text) {
        tell(v, sample->name, "%s", json_string_value(text));
    }
    if (r->status != BRACE_OK && error != NULL) {
        *error = r->error;
    }
    return r->status;
}

static brace_status verify_folders(verifier *v, const char *folder, const brace_job *job, brace_error *error) {
    dataset_list list;
    brace_status status = dataset_list_read(&list, folder, error);
    core_pool *pool = NULL;
    if (status == BRACE_OK) {
        status = core_pool_create(&pool, job, error);
    }
    const size_t batch = 8 * (size_t)core_pool_threads(pool);
    verdict *verdicts = core_calloc(batch, sizeof *verdicts);
    if (status == BRACE_OK && verdicts == NULL) {
        status = core_fail_memory(error, batch * sizeof *verdicts, "what was found");
    }
    for (size_t i = 0; status == BRACE_OK && i < list.count; i += batch) {
        const size_t n = list.count - i < batch ? list.count - i : batch;
        verify_job all = {&list.items[i], verdicts, job};
        core_progress(job, "verifying", i, list.count);
        core_parallel(pool, n, 1, verify_some, &all);
        for (size_t k = 0; k < n; k++) {
            if (status == BRACE_OK) {
                status = settle(v, &verdicts[k], &list.items[i + k], error);
            }
            json_decref(verdicts[k].problems);
        }
    }
    if (status == BRACE_OK) {
        core_progress(job, "verifying", list.count, list.count);
        status = check_index(v, folder, &list, error);
    }
    core_pool_destroy(pool);
    core_free(verdicts);
    dataset_list_free(&list);
    return status;
}

/* ---- shards ---- */

static void verify_packed(verifier *v, const core_safetensors *file, const char *name) {
    char *a = dataset_path(name, "frames"), *b = dataset_path(name, "gt");
    const core_tensor *frames = a != NULL ? core_safetensors_find(file, a) : NULL;
    const core_tensor *truth = b != NULL ? core_safetensors_find(file, b) : NULL;
    core_free(a);
    core_free(b);
    json_t *meta = json_loads(core_safetensors_metadata(file, name), JSON_REJECT_DUPLICATES, NULL);
    const char *expected = json_string_value(json_object_get(meta, "sha256"));
    v->bad = false;
    v->out->samples++;
    if (frames == NULL || truth == NULL) {
        tell(v, name, "its frames or its truth are missing");
    } else if (frames->dtype != CORE_U16 || truth->dtype != CORE_U16 || frames->rank != 3 || truth->rank != 2 ||
               frames->shape[1] != truth->shape[0] || frames->shape[2] != truth->shape[1]) {
        tell(v, name, "frames and truth have no shapes that fit each other");
    } else if (expected == NULL || json_array_size(json_object_get(meta, "frames")) != frames->shape[0]) {
        tell(v, name, "its metadata is damaged");
    } else {
        char hex[65];
        core_sha256 hash;
        core_sha256_begin(&hash);
        core_sha256_add(&hash, frames->data, frames->size);
        core_sha256_add(&hash, truth->data, truth->size);
        core_sha256_end(&hash, hex);
        if (strcmp(hex, expected) != 0) {
            tell(v, name, "its pixels have changed since it was packed (their SHA-256 is another)");
        }
    }
    json_decref(meta);
    v->out->bad += v->bad;
}

static bool is_shard(const char *name) {
    static const char end[] = ".safetensors";
    size_t n = strlen(name);
    return name[0] != '.' && n > sizeof end - 1 && strcmp(name + n - (sizeof end - 1), end) == 0 &&
           strcmp(name, DATASET_MOTIONS) != 0 && strcmp(name, DATASET_GUIDES) != 0;
}

static brace_status verify_shards(verifier *v, const char *folder, bool *any, const brace_job *job,
                                  brace_error *error) {
    struct dirent **names = NULL;
    int n = scandir(folder, &names, NULL, alphasort);
    brace_status status = BRACE_OK;
    if (n < 0) {
        return core_fail(error, BRACE_ERROR_IO, "%s: cannot look into this folder: %s", folder,
                         errno == ENOENT ? "it does not exist" : strerror(errno));
    }
    for (int i = 0; i < n; i++) {
        if (status == BRACE_OK && is_shard(names[i]->d_name)) {
            *any = true;
            char *path = dataset_path(folder, names[i]->d_name);
            core_safetensors *file = NULL;
            brace_error problem = {0};
            core_progress(job, "verifying", (uint64_t)i, (uint64_t)n);
            if (path == NULL) {
                status = core_fail_memory(error, 256, "a name");
            } else if ((status = core_safetensors_open(&file, path, &problem)) == BRACE_OK) {
                const char *key;
                for (size_t m = 0; status == BRACE_OK && (key = core_safetensors_metadata_key(file, m)) != NULL; m++) {
                    status = core_check_cancel(job, error);
                    if (status == BRACE_OK && strcmp(key, "format") != 0) {
                        verify_packed(v, file, key);
                    }
                }
                core_safetensors_close(file);
            } else if (status != BRACE_ERROR_MEMORY) {
                tell(v, names[i]->d_name, "%s", problem.message);
                v->out->bad++;
                status = BRACE_OK;
            } else {
                core_fail(error, status, "%s", problem.message);
            }
            core_free(path);
        }
        free(names[i]);
    }
    free(names);
    if (*any) {
        core_progress(job, "verifying", (uint64_t)n, (uint64_t)n);
    }
    return status;
}

brace_status dataset_verify(const char *folder, dataset_problem_fn *problem, void *user, dataset_verified *out,
                            const brace_job *job, brace_error *error) {
    *out = (dataset_verified){0};
    verifier v = {.problem = problem, .user = user, .out = out};
    bool shards = false;
    brace_status status = verify_shards(&v, folder, &shards, job, error);
    return status == BRACE_OK && !shards ? verify_folders(&v, folder, job, error) : status;
}
