/* SPDX-License-Identifier: Apache-2.0 */
/*
 * simulate.h: photographs of displays that exist as numbers only: a picture is
 * shown on a display whose light is modulated in time, and a camera with a
 * rolling shutter takes a bracket of it. docs/simulator.md has the physics.
 *
 * What is not set is sampled. All randomness is keyed by seed and sample: the
 * same parameters give the same frames, with any number of threads.
 *
 * Thread safety: everything is local to a call.
 */
#ifndef BRACE_SIMULATE_H
#define BRACE_SIMULATE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "bracket.h"
#include "frame.h"
#include "image.h"
#include "job.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* All zeros mean the defaults. */
typedef struct brace_simulate_params {
    const char *display;    /* a preset's name or a JSON file (docs/displays.md); NULL: led_wall_3840_16 */
    const char *camera;     /* likewise (docs/cameras.md); NULL: phone_median */
    uint64_t seed;          /* 0 is a seed like any other */
    uint32_t sample;        /* another capture with the same seed */
    uint32_t width, height; /* of the frames, 32 to 16384 each; 0: 1024 and 768 */
    int frames;             /* 3, 5, 7 or 9, each four times as long as the one before; 0: 5 */
    double reference_time;  /* exposure time of the middle frame, seconds, 1e-6 to 10; 0: sampled */
    double iso;             /* 10 to 1e6; 0: sampled */
    double level;           /* signal of white in the middle frame, 1 just clips; 0: sampled */
    double distance;        /* of the camera, in widths of the screen; 0: sampled */
    bool field;             /* ambient light, defocus, clutter, uneven panel and sensor are sampled; the truth is a
                             * photograph, too, of 8 times the exposure time at an eighth of the ISO */
    const char *scene;      /* JSON file: a capture's `meta`, which gives the same capture again (with its display and
                             * camera, where those are NULL here), or a scene alone; what it holds is not sampled. NULL:
                             * none */
    const char *const *set; /* set_count settings "NAME=VALUE" of any quantity of a scene, such as "psf=1.2";
                             * docs/simulator.md and `brace simulate --list` have the names */
    size_t set_count;
    const char *off; /* effects to leave out, such as "noise,tremor", or "all"; NULL: none */
    uint32_t reserved[8];
} brace_simulate_params;

typedef struct brace_simulated {
    size_t count;
    brace_frame *frames[BRACE_BRACKET_MAX]; /* shortest first */
    brace_frame *truth; /* the middle frame under steady light of the same mean, without noise and motion blur;
                         * in the field as a photograph of long exposure */
    brace_frame *exact; /* the same where `truth` is a photograph (field), otherwise NULL */
    char *meta;         /* everything that was set or sampled: one JSON object */
} brace_simulated;

/* Simulates one capture of `screen`, of at most 64 million pixels. `params` may be NULL. A frame that is set to NULL in
 * the result is no longer freed with it: so frames are handed to brace_bracket_create. The caller frees *out with
 * brace_simulated_destroy. */
BRACE_API brace_status brace_simulate(brace_simulated **out, const brace_image *screen,
                                      const brace_simulate_params *params, const brace_job *job, brace_error *error);

/* Frees a result; NULL is allowed. */
BRACE_API void brace_simulated_destroy(brace_simulated *simulated);

#ifdef __cplusplus
}
#endif
#endif
