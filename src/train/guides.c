/* SPDX-License-Identifier: Apache-2.0 */
/* guides.c: merged pictures of a packed set, kept. */
#include "train/guides.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/safetensors.h"
#include "sim/dataset.h"
#include "train/beside.h"
#include "train/motions.h"

static const char file_format[] = "brace guides 2", sigma_name[] = "sigma";

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

/* NULL: it is not there, or not of this size. */
static const void *plane(const train_guides *g, const char *name, const train_bracket *b, core_dtype type) {
    const core_tensor *t = core_safetensors_find(g->file, name);
    return t != NULL && t->dtype == type && t->rank == 2 && t->shape[0] == b->height && t->shape[1] == b->width &&
                   (type != CORE_U16 || (uintptr_t)t->data % 2 == 0)
               ? t->data
               : NULL;
}

void train_guides_get(const train_guides *g, train_bracket *b, const char *split, const char *name) {
    char *full = g->file != NULL ? dataset_path(split, name) : NULL;
    char *errors = full != NULL ? dataset_path(full, sigma_name) : NULL;
    b->guide = errors != NULL ? plane(g, full, b, CORE_U16) : NULL;
    b->sigma = errors != NULL ? plane(g, errors, b, CORE_U8) : NULL;
    if (b->guide == NULL || b->sigma == NULL) {
        b->guide = NULL, b->sigma = NULL;
    }
    core_free(errors);
    core_free(full);
}

/* ---- all of a set ---- */

enum {
    AT_ONCE = 32, /* brackets that are merged before their guides are written */
    LISTED = 640  /* bytes of the header for each: two arrays with the sample's name */
};

typedef struct make_run {
    train_motions *motions;
    const volatile int *cancel;
    size_t first;
    uint16_t *guide[AT_ONCE]; /* and the errors behind it */
} make_run;

static brace_status merge_one(void *user, train_bracket *b, size_t index, brace_error *error) {
    make_run *r = user;
    const size_t pixels = (size_t)b->width * b->height, bytes = pixels * (sizeof **r->guide + 1);
    const brace_status status = train_motions_get(r->motions, b, index, r->cancel, error);
    if (status != BRACE_OK) {
        return status;
    }
    uint16_t *guide = r->guide[index - r->first] = core_alloc(bytes, 1);
    return guide != NULL ? train_bracket_merge(b, guide, (uint8_t *)(guide + pixels), r->cancel, error)
                         : core_fail_memory(error, bytes, "a merged picture");
}

static brace_status add(const train_beside *of, size_t index, const uint16_t *guide, brace_error *error) {
    const train_bracket *b = train_packed_at(of->packed, index);
    char *full = dataset_path(of->split, train_packed_name(of->packed, index));
    char *errors = full != NULL ? dataset_path(full, sigma_name) : NULL;
    if (errors == NULL) {
        core_free(full);
        return core_fail_memory(error, 256, "a name");
    }
    core_tensor t = {.name = full, .dtype = CORE_U16, .rank = 2, .shape = {b->height, b->width}, .data = guide};
    brace_status status = core_safetensors_add(of->writer, &t, error);
    if (status == BRACE_OK) {
        t.name = errors, t.dtype = CORE_U8, t.data = guide + (size_t)b->width * b->height;
        status = core_safetensors_add(of->writer, &t, error);
    }
    core_free(errors);
    core_free(full);
    return status;
}

static brace_status merge_split(const train_beside *of, brace_error *error) {
    make_run r = {.cancel = of->job != NULL ? of->job->cancel : NULL};
    const size_t all = train_packed_count(of->packed);
    brace_status status = train_motions_open(&r.motions, of->packed, of->folder, of->split, error);
    for (; r.first < all && status == BRACE_OK; r.first += AT_ONCE) {
        const size_t count = all - r.first < AT_ONCE ? all - r.first : AT_ONCE;
        status = train_beside_each(of, r.first, count, "merging", merge_one, &r, error);
        for (size_t i = 0; i < count; i++) {
            if (status == BRACE_OK) {
                status = add(of, r.first + i, r.guide[i], error);
            }
            core_free(r.guide[i]);
            r.guide[i] = NULL;
        }
    }
    train_motions_close(r.motions);
    return status;
}

brace_status train_guides_make(const char *folder, const brace_job *job, brace_error *error) {
    return train_beside_make(folder, DATASET_GUIDES, file_format, LISTED, merge_split, job, error);
}
