/* SPDX-License-Identifier: Apache-2.0 */
/*
 * job.h: what a long-running call needs from its caller: how many threads it
 * may use, where to report progress and remarks, and how to be stopped.
 *
 * A NULL job, or one of all zeros, means: every online CPU, no reports, not
 * stoppable. A job is only read; one job may serve several calls, also at once
 * if its callbacks are thread safe. The callbacks run on the calling thread.
 */
#ifndef BRACE_JOB_H
#define BRACE_JOB_H

#include <stdint.h>

#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct brace_job {
    int threads; /* worker threads, 1 to 256; 0: one for each online CPU */

    /* Called as work advances, `done` of `total` in units of the stage (frames,
     * rows, tiles); `done` == `total` once, when the stage ends. */
    void (*progress)(void *user, const char *stage, uint64_t done, uint64_t total);

    /* A remark for the user that is no error ("frame_4.dng: white level missing, 4095 assumed"). */
    void (*note)(void *user, const char *message);

    void *user; /* handed to both callbacks */

    /* Polled between pieces of work; non-zero ends the call with BRACE_ERROR_CANCELLED
     * and nothing half-written. A signal handler may set it. */
    const volatile int *cancel;

    void *reserved[4]; /* must be zero */
} brace_job;

#ifdef __cplusplus
}
#endif
#endif
