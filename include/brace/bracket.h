/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bracket.h: several exposures of the same screen, sorted and checked.
 *
 * Exposure here is the light that a pixel of given brightness turns into raw
 * signal: time * ISO / f-number^2. Only its ratios between frames matter.
 *
 * Ownership: the bracket owns its frames. Thread safety: as frame.h.
 */
#ifndef BRACE_BRACKET_H
#define BRACE_BRACKET_H

#include <stddef.h>

#include "frame.h"
#include "job.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define BRACE_BRACKET_MIN 3
#define BRACE_BRACKET_MAX 9

typedef struct brace_bracket {
    size_t count;         /* BRACE_BRACKET_MIN to BRACE_BRACKET_MAX */
    brace_frame **frames; /* sorted by exposure, shortest first */
    double *exposure;     /* relative to the reference frame: 1 for it, 4 for two stops more */
    double *measured;     /* the same ratio as the pixels have it, NaN where too few pixels tell */
    size_t *order;        /* order[i]: which argument frame i was (0 is the first) */
    size_t reference;     /* index of the reference frame */
} brace_bracket;

/* All zeros mean the defaults. */
typedef struct brace_bracket_params {
    /* Index (as given, from 1) of the reference; 0: the middle by exposure (of
     * an even number, the longer of the middle two is not taken but the shorter). */
    size_t reference;

    /* Relative exposures of the frames in the order given, for files that do
     * not record exposure time; NULL: from metadata. Any common unit (seconds). */
    const double *exposures;
    uint32_t reserved[8];
} brace_bracket_params;

/* Reads `count` files (in parallel, as the job's threads allow) and makes a bracket of them. */
BRACE_API brace_status brace_bracket_read(brace_bracket **out, const char *const *paths, size_t count,
                                          const brace_bracket_params *params, const brace_job *job,
                                          brace_error *error);

/* Makes a bracket of frames in memory and takes them over: on success the
 * bracket owns them, on failure the caller still does. Refuses, with a
 * sentence naming the odd one out: fewer or more frames than allowed, different
 * cameras, sizes, CFA orders or orientations-with-different-sizes; frames
 * without exposure time (unless params->exposures is given); frames that all
 * have the same exposure. A frame whose pixels contradict its metadata by more
 * than half a stop is named in a note. */
BRACE_API brace_status brace_bracket_create(brace_bracket **out, brace_frame **frames, size_t count,
                                            const brace_bracket_params *params, const brace_job *job,
                                            brace_error *error);

/* Frees the bracket and its frames; NULL is allowed. */
BRACE_API void brace_bracket_destroy(brace_bracket *bracket);

#ifdef __cplusplus
}
#endif
#endif
