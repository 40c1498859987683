/* SPDX-License-Identifier: Apache-2.0 */
/*
 * camera.h: what the capture tool asks of a camera, whatever it is tied to: a
 * small table of functions for each back end (`sim`, `gphoto2`, `android`).
 *
 * A back end sets an exposure, releases the shutter, and puts the RAW file where
 * it is told. Everything else is the core's (plan.c, run.c, verify.c): the order
 * of the shots, nearest stops, waiting and trying again, checking the files,
 * the folder that they land in. So a back end does not retry what failed, does not
 * sleep between shots, prints nothing, and does not look at pixels.
 *
 * How to add one: write NAME.c with a `const capture_backend capture_backend_NAME`,
 * declare it below, add one line to the array in backends.c and the file to
 * meson.build (inside #ifdef CAPTURE_HAVE_LIBRARY if it needs a library that may
 * be missing).
 *
 * Thread safety: a camera is used by one thread at a time; two cameras do not
 * know of each other.
 */
#ifndef CAPTURE_CAMERA_H
#define CAPTURE_CAMERA_H

#include "core/core.h"

/* ---- what a device can do ---- */

#define CAPTURE_STOPS_MAX 256

typedef struct capture_limits {
    char make[64], model[64]; /* as EXIF has them */
    char id[128];             /* serial number or port: tells two cameras of a kind apart; "" if there is none */

    /* Exposure times, seconds. With exposure_count > 0 only those of `exposures` (ascending, all within
     * [exposure_min, exposure_max]) can be set; with 0 any time between the two. Bulb, "auto" and the like are left
     * out. */
    double exposure_min, exposure_max;
    size_t exposure_count;
    double exposures[CAPTURE_STOPS_MAX];

    /* ISO, likewise. */
    double iso_min, iso_max;
    size_t iso_count;
    double isos[CAPTURE_STOPS_MAX];

    double interval; /* least seconds from the end of an exposure to the start of the next; 0: as fast as it goes */
    double readout;  /* rolling shutter: seconds from the first row's start to the last row's; 0: unknown */
    double f_number; /* that the sequence is shot with; 0: unknown */
} capture_limits;

/* ---- what a shot came to ---- */

/* Why a shot failed, as far as the core's reaction differs. */
typedef enum capture_trouble {
    /* Trying again would not help: a disk that is full, a setting that the device refuses, a cancelled job.
     * The sequence ends; what is shot stays and can be gone on with. This is what 0 means, so a back
     * end that says nothing is never tried again without end. */
    CAPTURE_TROUBLE_FINAL = 0,

    /* The device has no time now (PTP Device Busy, a camera still writing to its card). The core waits, longer each
     * time, and asks again. No exposure was made. */
    CAPTURE_TROUBLE_BUSY,

    /* An exposure was made, or should have been, and did not arrive: a dropped frame, a transfer cut short, a timeout
     * with the device still there. The core shoots again. */
    CAPTURE_TROUBLE_DROPPED,

    /* The device is gone: cable, battery, Wi-Fi. The core closes the camera, waits, and opens the same address
     * again a few times before it gives up. */
    CAPTURE_TROUBLE_GONE
} capture_trouble;

typedef struct capture_shot_report {
    capture_trouble trouble; /* only looked at when the call failed */

    /* As the device says it, 0 where it does not. The file's EXIF is compared with it by the core. */
    double exposure; /* seconds */
    double iso;
    int64_t timestamp;  /* nanoseconds, start of the first row's exposure, on any clock of the device that does not jump
                         * during a sequence; < 0: unknown */
    double skew;        /* rolling shutter of this frame: as capture_limits.readout; 0: unknown */
    double noise[3][2]; /* R, G, B: variance = noise[c][0] x + noise[c][1] for a signal x on [0, 1] */
    bool has_noise;
    int orientation;   /* EXIF 1 to 8; 0: unknown */
    char extension[8]; /* of the file that was made: "dng", "nef", ...: lower case, no dot */
} capture_shot_report;

/* ---- cameras ---- */

typedef struct capture_backend capture_backend;

/* A back end's own struct begins with this one. */
typedef struct capture_camera {
    const capture_backend *backend;
    capture_limits limits; /* filled by open, constant until close */
} capture_camera;

/* Where and how to open. Strings are borrowed for the call. */
typedef struct capture_address {
    const char *port; /* what stands after the colon of `--camera NAME:PORT`, in the back end's own notation; NULL: the
                       * only device that there is, or the default one */
    const char *const *options; /* "NAME=VALUE" of `--option`; a name that the back end does not know is an error that
                                 * lists those that it does (capture_option_unknown says it) */
    size_t option_count;
    uint64_t shots; /* calls of shoot that the sequence made before: not 0 for a camera that is opened again. The
                     * simulated camera's time and faults go on from there; others need not look at it */
} capture_address;

/* One device that `list` found. */
typedef struct capture_found {
    const char *port; /* what to give to open; "" if the name of the back end is enough */
    const char *make, *model;
    const char *note; /* NULL: none; one sentence, such as "no manual exposure" */
} capture_found;
typedef void capture_found_fn(void *user, const capture_found *found);

struct capture_backend {
    const char *name;        /* as in --camera NAME */
    const char *description; /* one line for people */
    const char *options;     /* help: lines of "NAME=VALUE  what it does", separated by \n; NULL: none */

    /* Calls `found` for every device that could be opened now. None is no error; an error is when looking is not
     * possible (a service that is not running). Opens nothing for long and changes no setting. At most ten seconds. */
    brace_status (*list)(const capture_address *address, const brace_job *job, capture_found_fn *found, void *user,
                         brace_error *error);

    /* Opens a device for a sequence: manual exposure, RAW, automatic exposure, focus and white balance off or locked,
     * remembers the settings that it changes, fills (*out)->limits. Either all is done and *out is set, or nothing is
     * left open, *out is NULL, and the error says what to do about it. At most thirty seconds.
     * BRACE_ERROR_UNSUPPORTED: a device without manual exposure or RAW. */
    brace_status (*open)(capture_camera **out, const capture_address *address, const brace_job *job,
                         brace_error *error);

    /* Sets `exposure` (seconds) and `iso`, both within the limits and, where there are stops, equal to one; waits until
     * the device has taken them over; releases; and writes the RAW file to "STEM.EXT", with EXT as in out->extension.
     * The file is made by core_file_create and core_file_commit_unsynced, or otherwise so that it stands under that
     * name only if it is complete (the core syncs it). A file that is there is replaced.
     *
     * *out is all zeros with timestamp -1 when this is called. On failure out->trouble says of what kind it was, the
     * error what happened, and no file is left. Returns within exposure + 30 seconds, sooner with
     * BRACE_ERROR_CANCELLED when the job's cancel flag is set (poll with core_check_cancel while waiting). */
    brace_status (*shoot)(capture_camera *camera, double exposure, double iso, const char *stem,
                          capture_shot_report *out, const brace_job *job, brace_error *error);

    /* Restores the settings that open and shoot changed (as far as the device is still there), closes, frees. Never
     * fails for the caller; says what it could not restore in a note of the job. NULL is allowed. */
    void (*close)(capture_camera *camera, const brace_job *job);
};

/* ---- the back ends (backends.c) ---- */

extern const capture_backend capture_backend_sim;
#ifdef CAPTURE_HAVE_GPHOTO2
extern const capture_backend capture_backend_gphoto2;
#endif
extern const capture_backend capture_backend_android;

/* All that were compiled in, ended by NULL, in the order in which they are listed. */
extern const capture_backend *const capture_backends[];

/* "NAME" or "NAME:PORT": the back end, and where the port begins (NULL: none). BRACE_ERROR_ARGUMENT with the names that
 * there are. */
brace_status capture_backend_find(const capture_backend **out, const char **port, const char *camera,
                                  brace_error *error);

/* ---- for back ends ---- */

/* The value of an option "NAME=VALUE"; NULL if it was not given. The last one counts. */
const char *capture_option(const capture_address *address, const char *name);

/* BRACE_ERROR_ARGUMENT if an option was given whose name is not among `known` (ends with NULL). */
brace_status capture_option_unknown(const capture_address *address, const char *backend, const char *const *known,
                                    brace_error *error);

/* Sleeps, at most a tenth of a second too long, and wakes with BRACE_ERROR_CANCELLED when the job is cancelled. */
brace_status capture_wait(double seconds, const brace_job *job, brace_error *error);

#endif
