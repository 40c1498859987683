/* SPDX-License-Identifier: Apache-2.0 */
/* guides.c: merged pictures of a packed set, kept. */
#include "train/guides.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/safetensors.h"
#include "sim/dataset.h"
#include "train/motions.h"

static const char file_format[] = "brace guides 1";

struct train_guides {
    core_safetensors *file; /* NULL: none */
};

brace_status train_guides_open(train_guides **out, const char *folder, brace_error *error) {
    train_guides *g = core_calloc(1, sizeof *g);
    char *path = dataset_path(folder, DATASET_GUIDES);
    if (g == NULL || path == NULL) {
        core_free(path);
        core_free(g);
        return core_fail_memory(error, 256, "the guides of a set");
    }
    if (access(path, R_OK) == 0 && core_safetensors_open(&g->file, path, NULL) == BRACE_OK) {
        const char *format = core_safetensors_metadata(g->file, "format");
        if (format == NULL || strcmp(format, file_format) != 0) {
            core_safetensors_close(g->file);
            g->file = NULL;
        }
    }
    core_free(path);
    *out = g;
    return BRACE_OK;
}

void train_guides_close(train_guides *g) {
    if (g != NULL) {
        core_safetensors_close(g->file);
        core_free(g);
    }
}

const uint16_t *train_guides_get(const train_guides *g, const char *split, const char *name, uint32_t width,
                                 uint32_t height) {
    char *full = g->file != NULL ? dataset_path(split, name) : NULL;
    const core_tensor *t = full != NULL ? core_safetensors_find(g->file, full) : NULL;
    core_free(full);
    return t != NULL && t->dtype == CORE_U16 && t->rank == 2 && t->shape[0] == height && t->shape[1] == width &&
                   (uintptr_t)t->data % 2 == 0
               ? t->data
               : NULL;
}

/* ---- all of a set ---- */

enum { AT_ONCE = 32 }; /* brackets that are merged before their guides are written */

typedef struct make_run {
    const train_packed *packed;
    train_motions *motions;
    const brace_job *job;
    size_t first;
    uint16_t *guide[AT_ONCE];
    pthread_mutex_t lock;
    uint64_t done, all;
    brace_status status;
    brace_error error;
} make_run;

static void make_some(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    make_run *r = arg;
    const volatile int *cancel = r->job != NULL ? r->job->cancel : NULL;
    for (size_t i = begin; i < end; i++) {
        train_bracket b = *train_packed_at(r->packed, r->first + i);
        const size_t bytes = (size_t)b.width * b.height * sizeof **r->guide;
        brace_error error = {0};
        brace_status status = core_check_cancel(r->job, &error);
        if (status == BRACE_OK) {
            status = train_motions_get(r->motions, &b, r->first + i, cancel, &error);
        }
        if (status == BRACE_OK) {
            r->guide[i] = core_alloc(bytes, 1);
            status = r->guide[i] != NULL ? train_bracket_merge(&b, r->guide[i], cancel, &error)
                                         : core_fail_memory(&error, bytes, "a merged picture");
        }
        pthread_mutex_lock(&r->lock);
        core_progress(r->job, "merging", r->done++, r->all);
        if (status != BRACE_OK && r->status == BRACE_OK) {
            r->status = status, r->error = error;
        }
        pthread_mutex_unlock(&r->lock);
    }
}

static brace_status add(core_safetensors_writer *writer, const train_packed *packed, size_t index, const char *split,
                        const uint16_t *guide, brace_error *error) {
    const train_bracket *b = train_packed_at(packed, index);
    char *full = dataset_path(split, train_packed_name(packed, index));
    if (full == NULL) {
        return core_fail_memory(error, 256, "a name");
    }
    const brace_status status = core_safetensors_add(
        writer, &(core_tensor){.name = full, .dtype = CORE_U16, .rank = 2, .shape = {b->height, b->width}, .data = guide},
        error);
    core_free(full);
    return status;
}

static brace_status make_split(core_safetensors_writer *writer, make_run *r, const char *split, core_pool *pool,
                               brace_error *error) {
    brace_status status = BRACE_OK;
    r->all = train_packed_count(r->packed), r->done = 0;
    for (r->first = 0; r->first < r->all && status == BRACE_OK; r->first += AT_ONCE) {
        const size_t rest = (size_t)r->all - r->first, count = rest < AT_ONCE ? rest : AT_ONCE;
        core_parallel(pool, count, 1, make_some, r);
        status = r->status;
        if (status != BRACE_OK && error != NULL) {
            *error = r->error;
        }
        for (size_t i = 0; i < count; i++) {
            if (status == BRACE_OK) {
                status = add(writer, r->packed, r->first + i, split, r->guide[i], error);
            }
            core_free(r->guide[i]);
            r->guide[i] = NULL;
        }
    }
    if (status == BRACE_OK) {
        core_progress(r->job, "merging", r->all, r->all);
    }
    return status;
}

brace_status train_guides_make(const char *folder, const brace_job *job, brace_error *error) {
    core_pool *pool = NULL;
    core_safetensors_writer *writer = NULL;
    char *path = dataset_path(folder, DATASET_GUIDES);
    brace_status status = path != NULL ? core_pool_create(&pool, job, error) : core_fail_memory(error, 256, "a name");
    if (status == BRACE_OK) {
        status = core_safetensors_create(&writer, path, 8 << 20, error);
    }
    if (status == BRACE_OK) {
        status = core_safetensors_add_metadata(writer, "format", file_format, error);
    }
    for (size_t i = 0; train_splits[i] != NULL && status == BRACE_OK; i++) {
        train_packed *packed = NULL;
        if (train_packed_open(&packed, folder, train_splits[i], 0, NULL) == BRACE_OK) {
            make_run r = {.packed = packed, .job = job, .lock = PTHREAD_MUTEX_INITIALIZER};
            status = train_motions_open(&r.motions, packed, folder, train_splits[i], error);
            if (status == BRACE_OK) {
                status = make_split(writer, &r, train_splits[i], pool, error);
            }
            train_motions_close(r.motions);
        }
        train_packed_close(packed);
    }
    if (status == BRACE_OK) {
        status = core_safetensors_commit(writer, error);
    } else {
        core_safetensors_abort(writer);
    }
    core_pool_destroy(pool);
    core_free(path);
    return status;
}
