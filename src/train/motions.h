/* SPDX-License-Identifier: Apache-2.0 */
/*
 * motions.h: how the frames of a packed set's brackets lie on their references. Internal.
 *
 * Aligning a bracket takes longer than learning from a crop of it, and brackets come again and again. So `brace dataset
 * pack` does it once, for the whole set, and leaves motions.safetensors beside the shards; without that file brackets
 * are aligned when they are first asked for.
 */
#ifndef TRAIN_MOTIONS_H
#define TRAIN_MOTIONS_H

#include "train/source.h"

typedef struct train_motions train_motions;

/* Those of a split; a file that is not there or is about other samples counts as none. */
brace_status train_motions_open(train_motions **out, const train_packed *packed, const char *folder, const char *split,
                                brace_error *error);
void train_motions_close(train_motions *motions); /* NULL is allowed */
/* Sets the motions of bracket `index`. From several threads at once. */
brace_status train_motions_get(train_motions *motions, train_bracket *bracket, size_t index,
                               const volatile int *cancel, brace_error *error);

/* Aligns all brackets of a packed set and writes the file, atomically. */
brace_status train_motions_make(const char *folder, const brace_job *job, brace_error *error);

#endif
