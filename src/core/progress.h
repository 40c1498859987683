/* SPDX-License-Identifier: Apache-2.0 */
/*
 * progress.h: a progress display for people: a bar with rate and time left on a
 * terminal, plain lines elsewhere, nothing when quiet. The library itself never
 * prints; the program hands core_bar_update to a job.
 *
 * Thread safety: one bar, one thread.
 */
#ifndef CORE_PROGRESS_H
#define CORE_PROGRESS_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

typedef struct core_bar core_bar;

/* All zeros (but for `out`) mean the defaults. */
typedef struct core_bar_params {
    FILE *out;                                                         /* borrowed; NULL: quiet */
    bool quiet;                                                        /* prints no progress; notes still appear */
    enum { CORE_BAR_ASK = 0, CORE_BAR_TERMINAL, CORE_BAR_PLAIN } kind; /* ASK: isatty(out), and TERM is not "dumb" */
    int width;                                                         /* columns; 0: asked of the terminal */
    double (*clock)(void *user);                                       /* seconds; NULL: core_seconds */
    void *user;
} core_bar_params;

/* NULL when memory ends; all functions here take a NULL bar and do nothing. */
core_bar *core_bar_create(const core_bar_params *params);

/* Shows `done` of `total` (0: unknown) of `stage`. At most ten redraws a second
 * on a terminal, otherwise one line at the start, one every ten seconds and one at the end. */
void core_bar_update(core_bar *bar, const char *stage, uint64_t done, uint64_t total);

/* Prints a line of text without tearing the bar. */
void core_bar_note(core_bar *bar, const char *message);

/* Removes an unfinished bar from the terminal: before an error message, or at the end. */
void core_bar_clear(core_bar *bar);
void core_bar_destroy(core_bar *bar);

#endif
