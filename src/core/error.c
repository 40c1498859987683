/* SPDX-License-Identifier: Apache-2.0 */
/*
 * error.c: error sentences, and what a call tells its job: remarks, progress,
 * and whether it was cancelled.
 */
#include <string.h>

#include "core/core.h"

const char *brace_status_name(brace_status status) {
    switch (status) {
    case BRACE_OK:
        return "no error";
    case BRACE_ERROR_ARGUMENT:
        return "invalid argument";
    case BRACE_ERROR_MEMORY:
        return "out of memory";
    case BRACE_ERROR_IO:
        return "input/output error";
    case BRACE_ERROR_FORMAT:
        return "damaged or unrecognised file";
    case BRACE_ERROR_UNSUPPORTED:
        return "unsupported kind of file";
    case BRACE_ERROR_MISMATCH:
        return "inputs do not belong together";
    case BRACE_ERROR_CANCELLED:
        return "cancelled";
    }
    return "unknown error";
}

/* File names and library messages may hold control characters (a terminal
 * would obey an escape sequence in them); a sentence has none. */
static void blank_controls(char *s) {
    for (; *s != '\0'; s++) {
        unsigned char c = (unsigned char)*s;
        if (c < 0x20 || c == 0x7f) {
            *s = ' ';
        }
    }
}

brace_status core_fail(brace_error *error, brace_status status, const char *format, ...) {
    if (error != NULL) {
        /* Formatted apart, so that an argument may be the old message itself. */
        char text[BRACE_ERROR_LENGTH];
        va_list args;
        va_start(args, format);
        int n = vsnprintf(text, sizeof text, format, args);
        va_end(args);
        if (n < 0) {
            text[0] = '\0';
        }
        blank_controls(text);
        error->status = status;
        memcpy(error->message, text, strlen(text) + 1);
    }
    return status;
}

void core_error_prefix(brace_error *error, const char *prefix) {
    if (error == NULL) {
        return;
    }
    core_fail(error, error->status, "%s: %s", prefix, error->message);
}

brace_status core_fail_memory(brace_error *error, size_t bytes, const char *what) {
    if (bytes >= (size_t)10 << 20) {
        return core_fail(error, BRACE_ERROR_MEMORY, "out of memory: %zu MB for %s could not be had", bytes >> 20, what);
    }
    return core_fail(error, BRACE_ERROR_MEMORY, "out of memory: %zu bytes for %s could not be had", bytes, what);
}

void core_note(const brace_job *job, const char *format, ...) {
    if (job == NULL || job->note == NULL) {
        return;
    }
    char text[BRACE_ERROR_LENGTH];
    va_list args;
    va_start(args, format);
    int n = vsnprintf(text, sizeof text, format, args);
    va_end(args);
    if (n >= 0) {
        blank_controls(text);
        job->note(job->user, text);
    }
}

void core_progress(const brace_job *job, const char *stage, uint64_t done, uint64_t total) {
    if (job != NULL && job->progress != NULL) {
        job->progress(job->user, stage, done, total);
    }
}

bool core_cancelled(const brace_job *job) {
    return job != NULL && job->cancel != NULL && *job->cancel != 0;
}

brace_status core_check_cancel(const brace_job *job, brace_error *error) {
    if (core_cancelled(job)) {
        return core_fail(error, BRACE_ERROR_CANCELLED, "cancelled");
    }
    return BRACE_OK;
}
