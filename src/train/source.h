/* SPDX-License-Identifier: Apache-2.0 */
/*
 * source.h: an endless, numbered supply of samples. Sample i depends on the source's settings and on i only: any part
 * of it can be had in any order, by any thread, after an interruption.
 *
 * `crops` samples in a row are crops of one bracket: rendering one takes longer than a crop of it is worth.
 */
#ifndef TRAIN_SOURCE_H
#define TRAIN_SOURCE_H

#include "train/sample.h"

enum { TRAIN_SETS_MAX = 8 };

/* All zeros mean the defaults. */
typedef struct train_source_params {
    const char *packed[TRAIN_SETS_MAX]; /* folders of shards (brace dataset pack), up to the first NULL; none: rendered.
                                           Each has samples to train; for tests one of them needs some */
    const char *screens;    /* rendered: folder of pictures; NULL: those that ship with BRACE */
    const char *priors;     /* rendered: JSON file; NULL: data/priors/default.json */
    uint32_t width, height; /* rendered: of the frames; 0: 1024x768 */
    bool field;             /* rendered: the effects that the paper's synthetic set leaves out; the truth stays exact */
    double test_share;      /* rendered: of the screens, kept for the test split; 0: a tenth */
    bool test;              /* samples of the test split, which share no screen with the others */
    int frames, side, crops; /* of a bracket; packed pixels of a crop; crops of a bracket. 0: 5, 128, 4 */
    bool mirrored;           /* crops are mirrored, up to both ways */
    bool transposed;         /* and transposed */
    bool align;              /* samples have flow */
    bool guide;              /* and the merged picture, as one more frame; needs align */
    uint64_t seed;
} train_source_params;

typedef struct train_source train_source;

/* Reads what there is: all screens, or the headers of all shards. Strings are copied. */
brace_status train_source_create(train_source **out, const train_source_params *params, const brace_job *job,
                                 brace_error *error);
void train_source_destroy(train_source *source);                               /* NULL is allowed */
const train_source_params *train_source_params_of(const train_source *source); /* with the defaults filled in */
size_t train_source_size(const train_source *source); /* brackets of the packed sets; 0: endless */

/* Samples first .. first + count - 1, which are crops of one bracket: first/crops == (first + count - 1)/crops.
 * `out` holds `count` created samples. May be called from several threads at once; `cancel` may be NULL. */
brace_status train_source_get(const train_source *source, uint64_t first, int count, train_sample *out,
                              const volatile int *cancel, brace_error *error);

/* source_packed.c: brackets that lie in shards, of so many frames; 0: of any number. BRACE_ERROR_ARGUMENT: there are
 * none of this split. */
typedef struct train_packed train_packed;
brace_status train_packed_open(train_packed **out, const char *folder, const char *split, int frames,
                               brace_error *error);
void train_packed_close(train_packed *packed); /* NULL is allowed */
size_t train_packed_count(const train_packed *packed); /* NULL: 0 */
const train_bracket *train_packed_at(const train_packed *packed, size_t index);
const char *train_packed_name(const train_packed *packed, size_t index);

#endif
