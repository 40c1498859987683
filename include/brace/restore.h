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
    BRACE_METHOD_DEFAULT = 0,   /* the best that is available: the network where its weights are, else merge */
    BRACE_METHOD_REFERENCE = 1, /* the reference frame, untouched */
    BRACE_METHOD_MERGE = 2,     /* alignment, light model and fusion without a network: docs/merge.md */
    BRACE_METHOD_NETWORK = 3    /* a trained network, tile by tile: docs/restoring.md */
} brace_method;

/* What a network computes in. bf16 keeps 8 bits of each number between its layers; sums are f32 in either. */
typedef enum brace_precision {
    BRACE_PRECISION_DEFAULT = 0, /* bf16 where the processor has instructions for it (AMX, AVX512-BF16), else f32 */
    BRACE_PRECISION_F32 = 1,
    BRACE_PRECISION_BF16 = 2
} brace_precision;

/* How one frame was found to lie on the reference. */
typedef struct brace_motion {
    double dx, dy;       /* where the frame's content moved, pixels, mean over the picture */
    double rotation;     /* degrees, counter-clockwise as seen */
    double scale;        /* 1: none */
    double local;        /* largest residual displacement found locally, pixels */
    double confidence;   /* 0: could not be aligned and is taken as it was shot, to 1 */
} brace_motion;

/* What a restoration did; filled when asked for. Seconds are wall-clock. */
typedef struct brace_restore_report {
    brace_method method;                    /* that was used in the end: never the default */
    brace_motion motion[BRACE_BRACKET_MAX]; /* by bracket index; identity for the reference */
    double weight[BRACE_BRACKET_MAX];       /* mean share of each frame in the result; they sum to 1. NaN for a
                                               network, which does not tell */
    double banding[BRACE_BRACKET_MAX];      /* relative deviation of each frame's light from its mean, 0: steady; NaN
                                               for a network that is not shown the merged picture */
    double clipped;                         /* share of the result's pixels at white */
    double seconds_align, seconds_light, seconds_fuse, seconds_network;
    /* Of a network; empty and 0 otherwise. */
    char model[64];            /* "brace-s": what its weights say that they are for */
    char weights[256];         /* their file, cut off if its name is longer */
    brace_precision precision; /* that was computed in */
    size_t tiles;              /* that the picture was restored in, */
    int tile_width, tile_height; /* each so large, in pixels of the mosaic */
} brace_restore_report;

/* All zeros mean the defaults. */
typedef struct brace_restore_params {
    brace_method method;
    bool no_align; /* the camera stood on a tripod: do not look for motion */

    /* ---- of BRACE_METHOD_NETWORK; naming a model asks for that method ---- */

    /* Weights: a file (anything with a slash or a dot), or a name, "brace-s", of which the file NAME.safetensors is
     * looked for in the folder that the environment variable BRACE_MODELS names and nowhere else, or, without it,
     * in models/ of the folder BRACE_DATA, of the installed data, and of the source tree. NULL: "brace-s". */
    const char *model;

    /* Bytes that a network may use for its work, beside the frames and the result: tiles are as large as that allows.
     * 0: half of what the machine has free, at most 1 GiB. Too few for the smallest tile is BRACE_ERROR_MEMORY. */
    uint64_t memory;

    brace_precision precision;
    uint32_t reserved[3];
} brace_restore_params;

/* The result: `frame` is the reference's clone with restored pixels rounded to its raw
 * units; `mosaic` the same before rounding, normalised to the reference's
 * [black, white] as [0, 1]; values above 1 are light that only shorter frames hold. */
typedef struct brace_restored {
    brace_frame *frame;
    float *mosaic; /* width*height */
    brace_restore_report report;
} brace_restored;

/* Restores a bracket. `params` may be NULL. The caller frees *out with brace_restored_destroy.
 *
 * A network restores brackets like those it learned from: as many frames, each exposed about four times as long as the
 * one before it, the middle one the reference. Other brackets are merged instead, and a note says why; so are all
 * where the default model is not installed (with a note if the method was asked for). Weights that are damaged, or
 * those of a model that was named and is not there, are an error. */
BRACE_API brace_status brace_restore(brace_restored **out, const brace_bracket *bracket,
                                     const brace_restore_params *params, const brace_job *job, brace_error *error);

/* Whether a model (as params.model; NULL: the default) is there and its weights are those of the network that they say:
 * BRACE_OK, or the error that brace_restore would end with; for the default, BRACE_ERROR_IO if it is not installed.
 * `error` may be NULL. */
BRACE_API brace_status brace_model_check(const char *model, brace_error *error);

/* Frees a result; NULL is allowed. */
BRACE_API void brace_restored_destroy(brace_restored *restored);

/* "reference", "merge", "brace" (a network); never NULL. The default has no name of its own: "default". */
BRACE_API const char *brace_method_name(brace_method method);

#ifdef __cplusplus
}
#endif
#endif
