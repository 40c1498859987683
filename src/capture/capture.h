/* SPDX-License-Identifier: Apache-2.0 */
/*
 * capture.h: a bracket shot by a camera that is told what to do, and checked
 * while it is shot.
 *
 *   limits of the device -> plan (plan.c): which exposures, in which order ->
 *   run (run.c): shot after shot through camera.h, each verified (verify.c), bad
 *   ones shot again, into a hidden folder that is given its name at the end ->
 *   DIR/frame_1.dng (the shortest) ... frame_N.dng, gt.dng, sequence.json.
 *
 * check.c applies the same tests to a folder that anybody shot. docs/capture.md
 * has the formats and the tolerances with their reasons.
 *
 * Thread safety: everything is local to a call.
 */
#ifndef CAPTURE_CAPTURE_H
#define CAPTURE_CAPTURE_H

#include <jansson.h>

#include "brace/bracket.h"
#include "brace/restore.h"
#include "capture/camera.h"

/* ---- plan.c ---- */

enum {
    CAPTURE_FRAMES_MAX = BRACE_BRACKET_MAX,
    CAPTURE_STEPS_MAX = CAPTURE_FRAMES_MAX + 1, /* and the truth */
    CAPTURE_AVERAGE_MAX = 16                    /* shots that one truth is averaged of */
};

typedef struct capture_step {
    bool truth;
    int number;                         /* of frames: 1 is the shortest; 0 for the truth */
    double wanted_exposure, wanted_iso; /* seconds */
    double exposure, iso;               /* the nearest that the device can do, of each shot */
    int shots;                          /* 1; more: a truth that is the mean of so many */
} capture_step;

typedef struct capture_plan {
    size_t count;
    capture_step steps[CAPTURE_STEPS_MAX]; /* in the order in which they are shot */
    size_t reference;                      /* index of the step with the middle exposure, as a bracket chooses it */
} capture_plan;

/* All zeros mean the defaults. */
typedef struct capture_plan_params {
    double time;      /* exposure time of the reference, seconds; 0: 1/320 */
    double iso;       /* 0: eight times the device's lowest, so that the truth's eighth is there */
    int frames;       /* 3 to 9; 0: 5 */
    double step;      /* exposure time of a frame over the next shorter one's, above 1; 0: 4 */
    bool no_truth;    /* the bracket alone */
    const char *list; /* shots in order instead of frames, step and truth: "16,4,1,1/4,1/16,gt:8@1/8". A number is a
                       * multiple of the reference's time, "1/50s" a time; after @ a multiple of the ISO or "iso800"
                       * itself; "gt:" marks the truth. NULL: none */
} capture_plan_params;

/* What to shoot with a device; `limits` NULL: one that can do anything. What differs from what was asked for
 * is said in notes of the job. Errors: BRACE_ERROR_ARGUMENT for parameters out of range or a list that cannot be read,
 * BRACE_ERROR_UNSUPPORTED if too few different exposures are left within the limits. */
brace_status capture_plan_create(capture_plan *out, const capture_plan_params *params, const capture_limits *limits,
                                 const brace_job *job, brace_error *error);

/* The stop nearest to `wanted` by ratio; without stops `wanted` within [low, high]. */
double capture_nearest(double wanted, const double *stops, size_t count, double low, double high);

double capture_step_ev(const capture_plan *plan, size_t step); /* time x ISO against the reference's, EV */
double capture_plan_seconds(const capture_plan *plan, const capture_limits *limits); /* at least, without transfers */
size_t capture_plan_shots(const capture_plan *plan); /* exposures, those to be averaged counted each */

/* Numbers the steps and finds the reference; plan.steps and plan.count are set. */
void capture_plan_number(capture_plan *plan);

/* "frame_3" or "gt"; parts of an average are "gt_1", ... in a folder of their own. `out` holds 32 bytes. */
const char *capture_step_name(char out[32], const capture_step *step);

/* "1/320 s", "2.5 s". `out` holds 32 bytes. */
const char *capture_time_text(char out[32], double seconds);

/* ---- verify.c ---- */

/* Tolerances, EV. docs/capture.md says where they come from. */
#define CAPTURE_EXIF_EV 0.15  /* 1/60 on the dial is 1/64 in the shutter: 0.09; a third of a stop is 0.33 */
#define CAPTURE_PIXELS_EV 0.5 /* signal against exposure, where banding does not explain it */

/* What is kept of a frame to compare later ones with: a sample of its pixels. */
typedef struct capture_probe {
    char name[64];          /* for messages */
    double exposure, iso;   /* what it should be */
    double light;           /* relative signal that it should have: exposure * iso / f-number^2 */
    uint32_t width, height; /* of the frame */
    brace_frame *sample; /* at most about 200,000 blocks of 2x2, with the frame's levels, camera and shot data; owned */
    double clipped;      /* share of its samples at white */
    int tries;           /* how often this one has been shot */
} capture_probe;

brace_status capture_probe_create(capture_probe *out, const brace_frame *frame, const char *name, double exposure,
                                  double iso, brace_error *error);
void capture_probe_free(capture_probe *probe);

/* What metadata say against the plan: BRACE_OK, or BRACE_ERROR_MISMATCH with the sentence. A file that does not say its
 * exposure is a note. */
brace_status capture_verify_metadata(const brace_frame *frame, const char *name, double exposure, double iso,
                                     const brace_job *job, brace_error *error);

/* What two frames' pixels say of each other. */
typedef enum capture_verdict {
    CAPTURE_AGREE = 0,
    CAPTURE_UNKNOWN,   /* too few pixels that are neither clipped nor dark in both */
    CAPTURE_IDENTICAL, /* the same picture twice */
    CAPTURE_DARK,      /* one of them shows hardly any light, and should */
    CAPTURE_DISAGREE
} capture_verdict;
typedef struct capture_comparison {
    capture_verdict verdict;
    double ev; /* signal of a over b, beyond what the plan says; NaN: unknown */
} capture_comparison;
capture_comparison capture_compare(const capture_probe *a, const capture_probe *b);

/* Looks for the frames that lie among `count` probes (at most 32): those outside the largest set that agrees with
 * itself. Of two that contradict each other with nobody to decide, the one that was shot fewer times, then the later.
 * Returns its index, or -1; `why` says what is wrong with it. *doubtful: it is only darker than it should be, and
 * shorter than 1/50 s, so it may have fallen between two pulses of the display: worth another try, no proof. */
int capture_find_liar(const capture_probe *probes, size_t count, bool *doubtful, char *why, size_t size);

/* Of white: the power of two that all but a thousandth of the samples stay below; at least 1/128. */
double capture_brightest(const capture_probe *probe);

/* Where the content of `moved` lies against `fixed`. NaN and confidence 0 if it cannot be found. */
brace_status capture_motion(brace_motion *out, const brace_frame *fixed, const brace_frame *moved, const brace_job *job,
                            brace_error *error);

/* ---- average.c ---- */

/* The mean of frames of one exposure: raw units are scaled up by a whole number so that fractions are kept in 16 bits;
 * exposure time is the sum, ISO and noise are divided by the number. Frames must be alike (BRACE_ERROR_MISMATCH). One
 * is added at a time. */
typedef struct capture_average capture_average;
brace_status capture_average_add(capture_average **average, const brace_frame *frame, brace_error *error);
brace_status capture_average_finish(brace_frame **out, const capture_average *average, brace_error *error);
void capture_average_destroy(capture_average *average);

/* ---- sequence.c ---- */

#define CAPTURE_FORMAT "brace-capture-1"

/* One file of a sequence. */
typedef struct capture_shot {
    size_t step; /* of the plan */
    int part;    /* 1, 2, ... of a step that has several shots; 0: of one */
    bool done;
    int tries;     /* exposures that it took */
    char file[64]; /* inside the folder: "frame_3.dng", "parts/gt_2.dng" */
    uint64_t bytes;
    char sha256[65];
    capture_shot_report report;
    double exif_exposure, exif_iso; /* what the file says; 0: nothing */
    double ev;                      /* signal against the plan, relative to the reference; NaN: unknown */
    bool accepted;                  /* it contradicts the others, or is dark, and was kept all the same */
} capture_shot;

/* How often what happened. */
typedef struct capture_counts {
    uint64_t asked;                        /* calls of the shutter, also in vain */
    uint64_t busy, dropped, reopened;      /* times that the device was busy, a frame was lost, the device was gone */
    uint64_t unreadable, metadata, pixels; /* frames that were shot again: file damaged, EXIF wrong, light wrong */
} capture_counts;

enum { CAPTURE_SHOTS_MAX = CAPTURE_FRAMES_MAX + CAPTURE_AVERAGE_MAX, CAPTURE_EVENTS_MAX = 200 };

typedef struct capture_sequence {
    bool complete;
    char backend[32], make[64], model[64], id[128];
    double readout, f_number;
    capture_plan plan;
    size_t shot_count;
    capture_shot shots[CAPTURE_SHOTS_MAX]; /* in the order of the plan */
    char truth_file[64];                   /* of an average; "" otherwise */
    uint64_t truth_bytes;
    char truth_sha256[65];
    capture_counts counts;
    size_t event_count;
    char *events[CAPTURE_EVENTS_MAX]; /* what went wrong, in sentences; owned */
    bool has_motion;
    brace_motion motion; /* of the truth against the reference */
} capture_sequence;

/* Lays the shots of a plan out. */
void capture_sequence_init(capture_sequence *out, const capture_plan *plan);
void capture_sequence_free(capture_sequence *sequence);
/* "frame_3", "gt" or "parts/gt_2": a shot's file without its extension. `out` holds 48 bytes. */
const char *capture_shot_stem(char out[48], const capture_sequence *sequence, const capture_shot *shot);
/* Remembers a sentence; beyond CAPTURE_EVENTS_MAX, and when memory ends, it is forgotten. */
void capture_sequence_event(capture_sequence *sequence, const char *sentence);
json_t *capture_sequence_json(const capture_sequence *sequence); /* new reference; NULL when memory ends */
/* Refuses what capture_sequence_json cannot have written: BRACE_ERROR_FORMAT with file, line and key. */
brace_status capture_sequence_parse(capture_sequence *out, const char *json, const char *name, brace_error *error);
brace_status capture_sequence_load(capture_sequence *out, const char *path, brace_error *error);
brace_status capture_sequence_save(const capture_sequence *sequence, const char *path, brace_error *error);

/* ---- run.c ---- */

/* Called after every shot that was kept, and for every mishap. */
typedef struct capture_event {
    const capture_sequence *sequence;
    const capture_shot *shot; /* NULL: a mishap */
    const char *message;      /* NULL: a shot that was kept */
} capture_event;

/* All zeros mean the defaults. */
typedef struct capture_run_params {
    capture_plan_params plan;
    bool resume;    /* go on with the interrupted sequence that is there; none there: an error */
    bool own_plan;  /* on resuming, `plan` must be the interrupted one's; otherwise it is not looked at */
    bool restart;   /* throw an interrupted sequence away */
    bool accept;    /* keep frames that still contradict the plan after the last try, and say so in sequence.json */
    int tries;      /* of each shot before it is given up; 0: 4 */
    double backoff; /* seconds to wait when the device is busy the first time, then twice as long, up to 32 times; 0:
                       0.1 */
    void (*event)(void *user, const capture_event *event);
    void *user;
} capture_run_params;

/* Shoots a sequence into `folder`, which must not be there yet (a trailing slash is allowed). `out` tells what was
 * shot, also after an error, and is freed with capture_sequence_free in either case. Until all is done the files
 * stand in the hidden folder ".capture-NAME" beside it; one that holds at least one good frame is left for `resume`. */
brace_status capture_run(capture_sequence *out, const capture_backend *backend, const capture_address *address,
                         const char *folder, const capture_run_params *params, const brace_job *job,
                         brace_error *error);

/* What capture_run has left of a sequence: nothing, frames of one that was interrupted, or all of it. */
typedef enum capture_left { CAPTURE_LEFT_NOTHING, CAPTURE_LEFT_FRAMES, CAPTURE_LEFT_ALL } capture_left;
brace_status capture_left_of(capture_left *out, const char *folder, brace_error *error);

/* ---- check.c ---- */

enum { CAPTURE_CHECK_FILES = 20, CAPTURE_PROBLEMS_MAX = 64 };

typedef struct capture_checked_file {
    char name[256];
    bool truth, readable;
    double exposure, iso, clipped; /* as the file says; share of samples at white */
    double ev;                     /* planned by its metadata, against the reference */
    double measured;               /* the same as the pixels have it; NaN: unknown */
} capture_checked_file;

typedef struct capture_checked {
    size_t count;
    capture_checked_file files[CAPTURE_CHECK_FILES]; /* the bracket, shortest first, then the truth */
    size_t reference;                                /* index; `count` if there is no bracket */
    bool has_sequence;                               /* sequence.json was there and was compared */
    bool has_motion;
    brace_motion motion;
    bool restorable;          /* `brace restore` takes the bracket */
    bool importable;          /* `brace dataset import` takes the folder */
    char not_importable[512]; /* why not */
    size_t problem_count, remark_count;
    char *problems[CAPTURE_PROBLEMS_MAX]; /* what is wrong; owned */
    char *remarks[CAPTURE_PROBLEMS_MAX];  /* what could be better; owned */
} capture_checked;

/* Looks at the RAW files of a folder. BRACE_OK also when they are bad: that is told in *out, which the caller frees
 * with capture_checked_free in either case. */
brace_status capture_check(capture_checked *out, const char *folder, const brace_job *job, brace_error *error);
void capture_checked_free(capture_checked *checked);

#endif
