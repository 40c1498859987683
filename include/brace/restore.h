/* SPDX-License-Identifier: Apache-2.0 */
/*
 * restore.h: a bracket in, one frame without banding out.
 *
 * The result is the reference frame as it would have been under steady light of
 * the same mean: its pose, its exposure, its metadata, other pixels.
 *
 * Thread safety: a bracket is only read; several restorations may share one.
 */
#ifndef BRACE_RESTORE_H
#define BRACE_RESTORE_H

#include <stdbool.h>

#include "bracket.h"
#include "job.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum brace_method {
    BRACE_METHOD_DEFAULT = 0,   /* the best that is available: today merge */
    BRACE_METHOD_REFERENCE = 1, /* the reference frame, untouched */
    BRACE_METHOD_MERGE = 2      /* alignment, light model and fusion without a network: docs/merge.md */
} brace_method;

/* How one frame was found to lie on the reference. */
typedef struct brace_motion {
    double dx, dy;       /* where the frame's content moved, pixels, mean over the picture */
    double rotation;     /* degrees, counter-clockwise as seen */
    double scale;        /* 1: none */
    double local;        /* largest residual displacement found locally, pixels */
    double confidence;   /* 0: could not be aligned and is not used, to 1 */
} brace_motion;

/* What a restoration did; filled when asked for. Seconds are wall-clock. */
typedef struct brace_restore_report {
    brace_method method;
    brace_motion motion[BRACE_BRACKET_MAX]; /* by bracket index; identity for the reference */
    double weight[BRACE_BRACKET_MAX];       /* mean share of each frame in the result; they sum to 1 */
    double banding[BRACE_BRACKET_MAX];      /* relative deviation of each frame's light from its mean, 0: steady */
    double clipped;                         /* share of the result's pixels at white */
    double seconds_align, seconds_light, seconds_fuse;
} brace_restore_report;

/* All zeros mean the defaults. */
typedef struct brace_restore_params {
    brace_method method;
    bool no_align; /* the camera stood on a tripod: do not look for motion */
    uint32_t reserved[8];
} brace_restore_params;

/* The result: `frame` is the reference's clone with restored pixels rounded to its raw
 * units; `mosaic` the same before rounding, normalised to the reference's
 * [black, white] as [0, 1]; values above 1 are light that only shorter frames hold. */
typedef struct brace_restored {
    brace_frame *frame;
    float *mosaic; /* width*height */
    brace_restore_report report;
} brace_restored;

/* Restores a bracket. `params` may be NULL. The caller frees *out with brace_restored_destroy. */
BRACE_API brace_status brace_restore(brace_restored **out, const brace_bracket *bracket,
                                     const brace_restore_params *params, const brace_job *job, brace_error *error);

/* Frees a result; NULL is allowed. */
BRACE_API void brace_restored_destroy(brace_restored *restored);

/* "reference", "merge"; never NULL. */
BRACE_API const char *brace_method_name(brace_method method);

#ifdef __cplusplus
}
#endif
#endif
