/* SPDX-License-Identifier: Apache-2.0 */
/* dataset_screens.h: which screens there are, and which split each belongs to. */
#ifndef SIM_DATASET_SCREENS_H
#define SIM_DATASET_SCREENS_H

#include <jansson.h>

#include "core/core.h"
#include "sim/screen.h"

typedef struct dataset_screen {
    char *path, *name; /* name: the file's, without folder */
    char category[32]; /* 000012_web2.webp: "web2" */
    char sha256[65];
    sim_print print;
    size_t group; /* the same for pictures that look alike */
} dataset_screen;

typedef struct dataset_screens {
    dataset_screen *items; /* groups in the order of their first hash; each file once */
    size_t count;
    size_t test; /* the first so many are for the test split, the others for training */
} dataset_screens;

/* The pictures (PNG, WebP, JPEG, TIFF) in a folder, all of which must be sound: every one is
 * looked at. They are shared out in proportion to `train` and `test`, lookalikes together; each
 * split that is wanted gets at least one. */
brace_status dataset_screens_read(dataset_screens *out, const char *folder, uint32_t train, uint32_t test,
                                  const brace_job *job, brace_error *error);
void dataset_screens_free(dataset_screens *screens);
json_t *dataset_screens_json(const dataset_screens *screens); /* new reference */

/* The screen of the n-th sample of a split: all of them in random order, then all again in
 * another. */
const dataset_screen *dataset_screens_pick(const dataset_screens *screens, bool test, uint64_t seed, uint32_t n,
                                           uint32_t *scratch); /* `count` numbers */

#endif
