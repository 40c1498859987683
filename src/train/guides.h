/* SPDX-License-Identifier: Apache-2.0 */
/*
 * guides.h: the merged pictures of a packed set's brackets, for networks that are shown them. Internal.
 *
 * As with motions (motions.h), `brace dataset pack` makes them once: guides.safetensors has one for each sample, as
 * train_guide_code, and its errors, "NAME/sigma", as train_sigma_code. Without that file brackets are merged each
 * time that they are asked for, which is slow.
 */
#ifndef TRAIN_GUIDES_H
#define TRAIN_GUIDES_H

#include "train/source.h"

typedef struct train_guides train_guides;

/* A file that is not there counts as an empty one. */
brace_status train_guides_open(train_guides **out, const char *folder, brace_error *error);
void train_guides_close(train_guides *guides); /* NULL is allowed */
/* Gives a bracket the guide and the errors of the sample `name` of a split, which are the file's; NULL: they are not
 * there, or not of the bracket's size. */
void train_guides_get(const train_guides *guides, train_bracket *bracket, const char *split, const char *name);

/* Merges all brackets of a packed set, whose motions are there, and writes the file, atomically. */
brace_status train_guides_make(const char *folder, const brace_job *job, brace_error *error);

#endif
