/* SPDX-License-Identifier: Apache-2.0 */
/* beside.h: files that are made once of all brackets of a packed set and lie beside its shards. Internal. */
#ifndef TRAIN_BESIDE_H
#define TRAIN_BESIDE_H

#include "core/core.h"
#include "core/safetensors.h"
#include "train/source.h"

/* A split of the set while such a file is made. */
typedef struct train_beside {
    core_safetensors_writer *writer;
    const train_packed *packed;
    const char *folder, *split;
    core_pool *pool;
    const brace_job *job;
} train_beside;

/* Adds what the file has of one split. */
typedef brace_status train_beside_split(const train_beside *of, brace_error *error);

/* Writes the safetensors file `name` into the folder of the set, atomically, with `format` as metadata: of each split
 * that the set has. `listed`: bytes that the file's header needs for each sample. */
brace_status train_beside_make(const char *folder, const char *name, const char *format, size_t listed,
                               train_beside_split *split, const brace_job *job, brace_error *error);

/* Does `one` for `count` brackets from `first` on, by all threads; each has a copy of the bracket. Tells progress as
 * `what`, of all brackets of the split, and ends with the first error. */
typedef brace_status train_beside_one(void *user, train_bracket *bracket, size_t index, brace_error *error);
brace_status train_beside_each(const train_beside *of, size_t first, size_t count, const char *what,
                               train_beside_one *one, void *user, brace_error *error);

#endif
