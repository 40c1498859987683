/* SPDX-License-Identifier: Apache-2.0 */
/*
 * guides.h: the merged pictures of a packed set's brackets, for networks that are shown them. Internal.
 *
 * As with motions (motions.h), `brace dataset pack` makes them once: guides.safetensors has one for each sample, as
 * train_guide_code. Without that file brackets are merged each time that they are asked for, which is slow.
 */
#ifndef TRAIN_GUIDES_H
#define TRAIN_GUIDES_H

#include "train/source.h"

typedef struct train_guides train_guides;

/* A file that is not there counts as an empty one. */
brace_status train_guides_open(train_guides **out, const char *folder, brace_error *error);
void train_guides_close(train_guides *guides); /* NULL is allowed */
/* The guide of the sample `name` of a split, the file's; NULL: it is not there, or not of this size. */
const uint16_t *train_guides_get(const train_guides *guides, const char *split, const char *name, uint32_t width,
                                 uint32_t height);

/* Merges all brackets of a packed set, whose motions are there, and writes the file, atomically. */
brace_status train_guides_make(const char *folder, const brace_job *job, brace_error *error);

#endif
