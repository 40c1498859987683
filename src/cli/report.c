/* SPDX-License-Identifier: Apache-2.0 */
/*
 * report.c: a job that shows a progress bar, prints each remark once, keeps
 * them for --json, and stops on Ctrl-C.
 */
#include "cli/cli.h"

#include <stdlib.h>
#include <string.h>

#include "core/progress.h"

static void on_progress(void *user, const char *stage, uint64_t done, uint64_t total) {
    cli_report *report = user;
    core_bar_update(report->bar, stage, done, total);
}

static void on_note(void *user, const char *message) {
    enum { MOST = 100 }; /* a damaged file can be the cause of very many */
    cli_report *report = user;
    if (report->note_count >= MOST) {
        return;
    }
    for (size_t i = 0; i < report->note_count; i++) {
        if (strcmp(report->notes[i], message) == 0) {
            return;
        }
    }
    char **grown = realloc(report->notes, (report->note_count + 1) * sizeof *grown);
    if (grown == NULL) {
        return;
    }
    report->notes = grown;
    report->notes[report->note_count] = strdup(message);
    if (report->notes[report->note_count] == NULL) {
        return;
    }
    report->note_count++;
    if (!report->quiet) {
        char line[BRACE_ERROR_LENGTH + 64];
        snprintf(line, sizeof line, "brace: %s: note: %s", report->command, message);
        core_bar_note(report->bar, line);
    }
}

void cli_report_begin(cli_report *report, brace_job *job, const char *command, bool quiet, int threads) {
    memset(report, 0, sizeof *report);
    memset(job, 0, sizeof *job);
    report->command = command;
    report->quiet = quiet;
    core_bar_params params = {.out = quiet ? NULL : stderr, .quiet = quiet};
    report->bar = core_bar_create(&params);
    job->threads = threads;
    job->progress = on_progress;
    job->note = on_note;
    job->user = report;
    job->cancel = cli_signals_install();
}

void cli_report_flush(cli_report *report) {
    core_bar_clear(report->bar);
}

void cli_report_end(cli_report *report) {
    core_bar_destroy(report->bar);
    report->bar = NULL;
    for (size_t i = 0; i < report->note_count; i++) {
        free(report->notes[i]);
    }
    free(report->notes);
    report->notes = NULL;
    report->note_count = 0;
}
