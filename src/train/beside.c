/* SPDX-License-Identifier: Apache-2.0 */
/* beside.c: files that are made of all brackets of a packed set. */
#include "train/beside.h"

#include <pthread.h>

#include "sim/dataset.h"

static const char *const splits[] = {"train", "test", "samples", NULL}; /* that a packed set may have */

static size_t count_samples(const char *folder) {
    size_t count = 0;
    for (size_t i = 0; splits[i] != NULL; i++) {
        train_packed *packed = NULL;
        if (train_packed_open(&packed, folder, splits[i], 0, NULL) == BRACE_OK) {
            count += train_packed_count(packed);
        }
        train_packed_close(packed);
    }
    return count;
}

brace_status train_beside_make(const char *folder, const char *name, const char *format, size_t listed,
                               train_beside_split *split, const brace_job *job, brace_error *error) {
    train_beside of = {.folder = folder, .job = job};
    char *path = dataset_path(folder, name);
    brace_status status = path != NULL ? core_pool_create(&of.pool, job, error) : core_fail_memory(error, 256, "a name");
    const size_t count = listed > 0 ? count_samples(folder) : 0, reserve = 65536 + listed * count;
    if (status == BRACE_OK && reserve > CORE_SAFETENSORS_HEADER) {
        status = core_fail(error, BRACE_ERROR_ARGUMENT,
                           "%s: a file can list about %zu samples, and there are %zu: pack them into several folders", path,
                           CORE_SAFETENSORS_HEADER / listed, count);
    }
    if (status == BRACE_OK) {
        status = core_safetensors_create(&of.writer, path, reserve, error);
    }
    if (status == BRACE_OK) {
        status = core_safetensors_add_metadata(of.writer, "format", format, error);
    }
    for (size_t i = 0; splits[i] != NULL && status == BRACE_OK; i++) {
        train_packed *packed = NULL;
        if (train_packed_open(&packed, folder, splits[i], 0, NULL) == BRACE_OK) {
            of.packed = packed;
            of.split = splits[i];
            status = split(&of, error);
        }
        train_packed_close(packed);
    }
    if (status == BRACE_OK) {
        status = core_safetensors_commit(of.writer, error);
    } else {
        core_safetensors_abort(of.writer);
    }
    core_pool_destroy(of.pool);
    core_free(path);
    return status;
}

typedef struct each_run {
    const train_beside *of;
    size_t first;
    uint64_t done;
    const char *what;
    train_beside_one *one;
    void *user;
    pthread_mutex_t lock; /* of all below */
    brace_status status;
    brace_error error;
} each_run;

static void some(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    each_run *r = arg;
    for (size_t i = r->first + begin; i < r->first + end; i++) {
        train_bracket b = *train_packed_at(r->of->packed, i);
        brace_error error = {0};
        brace_status status = core_check_cancel(r->of->job, &error);
        if (status == BRACE_OK) {
            status = r->one(r->user, &b, i, &error);
        }
        pthread_mutex_lock(&r->lock);
        core_progress(r->of->job, r->what, r->done++, train_packed_count(r->of->packed));
        if (status != BRACE_OK && r->status == BRACE_OK) {
            r->status = status;
            r->error = error;
        }
        pthread_mutex_unlock(&r->lock);
    }
}

brace_status train_beside_each(const train_beside *of, size_t first, size_t count, const char *what,
                               train_beside_one *one, void *user, brace_error *error) {
    each_run r = {.of = of,
                  .first = first,
                  .done = first,
                  .what = what,
                  .one = one,
                  .user = user,
                  .lock = PTHREAD_MUTEX_INITIALIZER};
    core_parallel(of->pool, count, 1, some, &r);
    if (r.status != BRACE_OK && error != NULL) {
        *error = r.error;
    }
    const size_t all = train_packed_count(of->packed);
    if (r.status == BRACE_OK && first + count == all) {
        core_progress(of->job, what, all, all);
    }
    return r.status;
}
