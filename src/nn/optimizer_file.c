/* SPDX-License-Identifier: Apache-2.0 */
/* optimizer_file.c: the state of a training run as one safetensors file. */
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/safetensors.h"
#include "nn/optimizer_state.h"

static const char format_key[] = "brace_training_state", format_text[] = "1";
static const char steps_key[] = "brace_steps", skipped_key[] = "brace_skipped_steps";

enum { KINDS = 4 };
static const char *const kinds[KINDS] = {"weights", "moment1", "moment2", "average"};

static float *array_of(const nn_slot *slot, int kind) {
    float *const arrays[KINDS] = {slot->parameter->value, slot->moment1, slot->moment2, slot->average};
    return arrays[kind];
}

/* "moment1.NAME"; freed with core_free. */
static char *name_of(const nn_slot *slot, int kind) {
    const size_t size = strlen(kinds[kind]) + strlen(slot->parameter->name) + 2;
    char *name = core_alloc(size, 1);
    if (name != NULL) {
        snprintf(name, size, "%s.%s", kinds[kind], slot->parameter->name);
    }
    return name;
}

/* ---- writing ---- */

static brace_status add_array(core_safetensors_writer *writer, const nn_slot *slot, int kind, brace_error *error) {
    const nn_parameter *p = slot->parameter;
    char *name = name_of(slot, kind);
    if (name == NULL) {
        return core_fail_memory(error, strlen(p->name), "the training state");
    }
    core_tensor t = {.name = name, .dtype = CORE_F32, .rank = p->rank, .data = array_of(slot, kind)};
    for (int i = 0; i < p->rank; i++) {
        t.shape[i] = (uint64_t)p->shape[i];
    }
    brace_status status = core_safetensors_add(writer, &t, error);
    core_free(name);
    return status;
}

static brace_status add_count(core_safetensors_writer *writer, const char *key, uint64_t count, brace_error *error) {
    char text[32];
    snprintf(text, sizeof text, "%" PRIu64, count);
    return core_safetensors_add_metadata(writer, key, text, error);
}

brace_status nn_optimizer_save(const nn_optimizer *o, const char *path, const char *const *metadata,
                               brace_error *error) {
    size_t reserve = 4096;
    for (size_t i = 0; i < o->slot_count; i++) {
        reserve += KINDS * (6 * strlen(o->slots[i].parameter->name) + 256);
    }
    for (size_t i = 0; metadata != NULL && metadata[i] != NULL; i++) {
        reserve += 6 * strlen(metadata[i]) + 16;
    }
    core_safetensors_writer *writer = NULL;
    brace_status status = core_safetensors_create(&writer, path, reserve, error);
    if (status != BRACE_OK) {
        return status;
    }
    status = core_safetensors_add_metadata(writer, format_key, format_text, error);
    if (status == BRACE_OK) {
        status = add_count(writer, steps_key, o->steps, error);
    }
    if (status == BRACE_OK) {
        status = add_count(writer, skipped_key, o->skipped, error);
    }
    for (size_t i = 0; status == BRACE_OK && metadata != NULL && metadata[i] != NULL && metadata[i + 1] != NULL;
         i += 2) {
        status = core_safetensors_add_metadata(writer, metadata[i], metadata[i + 1], error);
    }
    for (int kind = 0; kind < KINDS; kind++) {
        for (size_t i = 0; i < o->slot_count && status == BRACE_OK; i++) {
            if (array_of(&o->slots[i], kind) != NULL) {
                status = add_array(writer, &o->slots[i], kind, error);
            }
        }
    }
    if (status != BRACE_OK) {
        core_safetensors_abort(writer);
        return status;
    }
    return core_safetensors_commit(writer, error);
}

/* ---- reading ---- */

/* A decimal number of at most 18 digits and nothing else. */
static bool count_of(const core_safetensors *file, const char *key, uint64_t *count) {
    const char *text = core_safetensors_metadata(file, key);
    const size_t length = text != NULL ? strlen(text) : 0;
    if (length == 0 || length > 18 || strspn(text, "0123456789") != length) {
        return false;
    }
    *count = strtoull(text, NULL, 10);
    return true;
}

/* No number that training cannot have made. */
static bool sound(const float *v, size_t count, bool square) {
    for (size_t i = 0; i < count; i++) {
        if (!isfinite(v[i]) || (square && v[i] < 0)) {
            return false;
        }
    }
    return true;
}

/* Finds an array and checks it. */
static brace_status find(const core_tensor **out, const nn_slot *slot, int kind, const core_safetensors *file,
                         const char *path, brace_error *error) {
    const nn_parameter *p = slot->parameter;
    char *name = name_of(slot, kind);
    if (name == NULL) {
        return core_fail_memory(error, strlen(p->name), path);
    }
    const core_tensor *t = core_safetensors_find(file, name);
    core_free(name);
    bool same = t != NULL && t->dtype == CORE_F32 && t->rank == p->rank;
    for (int i = 0; i < p->rank && same; i++) {
        same = t->shape[i] == (uint64_t)p->shape[i];
    }
    if (!same) {
        return core_fail(error, BRACE_ERROR_MISMATCH,
                         "%s: its training state has no '%s.%s' of the network's shape; it belongs to another network "
                         "or to another way of training",
                         path, kinds[kind], p->name);
    }
    if ((uintptr_t)t->data % sizeof(float) != 0 || !sound(t->data, p->count, array_of(slot, kind) == slot->moment2)) {
        return core_fail(error, BRACE_ERROR_FORMAT, "%s: the numbers of '%s.%s' are damaged", path, kinds[kind],
                         p->name);
    }
    *out = t;
    return BRACE_OK;
}

/* All that can be wrong is found before anything is changed. `found`: KINDS for each slot. */
static brace_status read_state(nn_optimizer *o, const core_safetensors *file, const core_tensor **found,
                               const char *path, brace_error *error) {
    uint64_t steps = 0, skipped = 0;
    const char *format = core_safetensors_metadata(file, format_key);
    if (format == NULL || strcmp(format, format_text) != 0 || !count_of(file, steps_key, &steps) ||
        !count_of(file, skipped_key, &skipped)) {
        return core_fail(error, BRACE_ERROR_FORMAT, "%s: is no training state that this version can go on from", path);
    }
    for (size_t i = 0; i < o->slot_count * KINDS; i++) {
        if (array_of(&o->slots[i / KINDS], (int)(i % KINDS)) != NULL) {
            brace_status status = find(&found[i], &o->slots[i / KINDS], (int)(i % KINDS), file, path, error);
            if (status != BRACE_OK) {
                return status;
            }
        }
    }
    for (size_t i = 0; i < o->slot_count * KINDS; i++) {
        nn_parameter *p = o->slots[i / KINDS].parameter;
        if (found[i] != NULL) {
            memcpy(array_of(&o->slots[i / KINDS], (int)(i % KINDS)), found[i]->data, p->count * sizeof(float));
            p->version++;
        }
    }
    o->steps = steps;
    o->skipped = skipped;
    return BRACE_OK;
}

brace_status nn_optimizer_load(nn_optimizer *o, const char *path, brace_error *error) {
    core_safetensors *file = NULL;
    brace_status status = core_safetensors_open(&file, path, error);
    if (status != BRACE_OK) {
        return status;
    }
    const core_tensor **found = core_calloc(o->slot_count * KINDS, sizeof *found);
    status = found != NULL ? read_state(o, file, found, path, error)
                           : core_fail_memory(error, o->slot_count * KINDS * sizeof *found, path);
    core_free((void *)found);
    core_safetensors_close(file);
    return status;
}
