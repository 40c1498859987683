/* SPDX-License-Identifier: Apache-2.0 */
/* motions.c: motions of a packed set, kept. */
#include "train/motions.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/safetensors.h"
#include "core/sha256.h"
#include "sim/dataset.h"
#include "train/beside.h"

static const char file_format[] = "brace motions 2";

/* A motion as numbers: affine part, nodes, confidence, displacements. */
enum { NODES = RESTORE_GRID * RESTORE_GRID, NUMBERS = 9 + 2 * NODES };

static void to_numbers(float *out, const restore_motion *m) {
    for (int i = 0; i < 6; i++) {
        out[i] = (float)m->a[i];
    }
    out[6] = (float)m->columns, out[7] = (float)m->rows, out[8] = (float)m->confidence;
    memcpy(out + 9, m->dx, sizeof m->dx);
    memcpy(out + 9 + NODES, m->dy, sizeof m->dy);
}

static void from_numbers(restore_motion *m, const float *in) {
    *m = (restore_motion){.confidence = (double)in[8]};
    for (int i = 0; i < 6; i++) {
        m->a[i] = (double)in[i];
    }
    if (in[6] >= 1 && in[6] <= RESTORE_GRID && in[7] >= 1 && in[7] <= RESTORE_GRID) {
        m->columns = (int)in[6], m->rows = (int)in[7];
    }
    memcpy(m->dx, in + 9, sizeof m->dx);
    memcpy(m->dy, in + 9 + NODES, sizeof m->dy);
}

struct train_motions {
    core_safetensors *file;
    const float *kept;     /* [brackets][BRACE_BRACKET_MAX][NUMBERS] of the file; NULL: found as they are asked for */
    pthread_mutex_t lock;
    bool *found;
    restore_motion *motion; /* BRACE_BRACKET_MAX for each bracket */
};

/* Which samples a split has, in order: the SHA-256 of their names. */
static void names_of(char out[65], const train_packed *packed) {
    core_sha256 hash;
    core_sha256_begin(&hash);
    for (size_t i = 0; i < train_packed_count(packed); i++) {
        const char *name = train_packed_name(packed, i);
        core_sha256_add(&hash, name, strlen(name) + 1);
    }
    core_sha256_end(&hash, out);
}

static void read_file(train_motions *m, const train_packed *packed, const char *folder, const char *split) {
    char *path = dataset_path(folder, DATASET_MOTIONS), names[65];
    if (path == NULL || access(path, R_OK) != 0 || core_safetensors_open(&m->file, path, NULL) != BRACE_OK) {
        core_free(path);
        return;
    }
    core_free(path);
    names_of(names, packed);
    const char *format = core_safetensors_metadata(m->file, "format"), *of = core_safetensors_metadata(m->file, split);
    const core_tensor *t = core_safetensors_find(m->file, split);
    if (format != NULL && strcmp(format, file_format) == 0 && of != NULL && strcmp(of, names) == 0 && t != NULL &&
        t->dtype == CORE_F32 && t->rank == 3 && t->shape[0] == train_packed_count(packed) &&
        t->shape[1] == BRACE_BRACKET_MAX && t->shape[2] == NUMBERS && (uintptr_t)t->data % sizeof(float) == 0) {
        m->kept = t->data;
    }
}

brace_status train_motions_open(train_motions **out, const train_packed *packed, const char *folder, const char *split,
                                brace_error *error) {
    const size_t count = train_packed_count(packed);
    train_motions *m = core_calloc(1, sizeof *m);
    if (m == NULL || pthread_mutex_init(&m->lock, NULL) != 0) {
        core_free(m);
        return core_fail_memory(error, sizeof *m, "the motions of a set");
    }
    read_file(m, packed, folder, split);
    if (m->kept == NULL) {
        m->found = core_calloc(count, sizeof *m->found);
        m->motion = core_calloc(count * BRACE_BRACKET_MAX, sizeof *m->motion);
        if (m->found == NULL || m->motion == NULL) {
            train_motions_close(m);
            return core_fail_memory(error, count * BRACE_BRACKET_MAX * sizeof(restore_motion), "the motions of a set");
        }
    }
    *out = m;
    return BRACE_OK;
}

void train_motions_close(train_motions *m) {
    if (m != NULL) {
        core_safetensors_close(m->file);
        pthread_mutex_destroy(&m->lock);
        core_free(m->found);
        core_free(m->motion);
        core_free(m);
    }
}

brace_status train_motions_get(train_motions *m, train_bracket *b, size_t index, const volatile int *cancel,
                               brace_error *error) {
    if (m->kept != NULL) {
        for (size_t i = 0; i < BRACE_BRACKET_MAX; i++) {
            from_numbers(&b->motion[i], m->kept + (index * BRACE_BRACKET_MAX + i) * NUMBERS);
        }
        b->aligned = true;
        return BRACE_OK;
    }
    restore_motion *kept = m->motion + index * BRACE_BRACKET_MAX;
    pthread_mutex_lock(&m->lock);
    b->aligned = m->found[index];
    pthread_mutex_unlock(&m->lock);
    if (b->aligned) {
        memcpy(b->motion, kept, sizeof b->motion);
        return BRACE_OK;
    }
    const brace_status status = train_bracket_align(b, cancel, error);
    if (status == BRACE_OK) {
        pthread_mutex_lock(&m->lock);
        memcpy(kept, b->motion, sizeof b->motion);
        m->found[index] = true;
        pthread_mutex_unlock(&m->lock);
    }
    return status;
}

/* ---- all of a set ---- */

typedef struct make_run {
    float *numbers;
    const volatile int *cancel;
} make_run;

static brace_status align_one(void *user, train_bracket *b, size_t index, brace_error *error) {
    make_run *r = user;
    const brace_status status = train_bracket_align(b, r->cancel, error);
    for (size_t k = 0; k < BRACE_BRACKET_MAX && status == BRACE_OK; k++) {
        to_numbers(r->numbers + (index * BRACE_BRACKET_MAX + k) * NUMBERS, &b->motion[k]);
    }
    return status;
}

static brace_status align_split(const train_beside *of, brace_error *error) {
    const size_t count = train_packed_count(of->packed);
    make_run r = {.numbers = core_calloc(count * BRACE_BRACKET_MAX * NUMBERS, sizeof *r.numbers),
                  .cancel = of->job != NULL ? of->job->cancel : NULL};
    if (r.numbers == NULL) {
        return core_fail_memory(error, count * BRACE_BRACKET_MAX * NUMBERS * sizeof *r.numbers, "motions");
    }
    brace_status status = train_beside_each(of, 0, count, "aligning", align_one, &r, error);
    char names[65];
    names_of(names, of->packed);
    if (status == BRACE_OK) {
        const core_tensor t = {of->split, CORE_F32, 3, {count, BRACE_BRACKET_MAX, NUMBERS}, r.numbers, 0};
        status = core_safetensors_add(of->writer, &t, error);
    }
    if (status == BRACE_OK) {
        status = core_safetensors_add_metadata(of->writer, of->split, names, error);
    }
    core_free(r.numbers);
    return status;
}

brace_status train_motions_make(const char *folder, const brace_job *job, brace_error *error) {
    return train_beside_make(folder, DATASET_MOTIONS, file_format, 0, align_split, job, error);
}
