/* SPDX-License-Identifier: Apache-2.0 */
/*
 * status.h: how every BRACE function that can fail says so.
 *
 * A function that can fail returns a brace_status and takes an optional
 * brace_error as its last argument. On failure the error holds one sentence
 * that a user can act on: which file, which value, what was expected. Nothing
 * in the library prints, exits or aborts because of its input.
 *
 * Thread safety: the functions here are pure and may be called from any thread.
 */
#ifndef BRACE_STATUS_H
#define BRACE_STATUS_H

#ifdef __cplusplus
extern "C" {
#endif

/* Marks what the shared library exports; everything else is hidden. */
#if defined(__GNUC__)
#define BRACE_API __attribute__((visibility("default")))
#else
#define BRACE_API
#endif

/* What kind of thing went wrong. The numbers are part of the ABI. */
typedef enum brace_status {
    BRACE_OK = 0,
    BRACE_ERROR_ARGUMENT = 1,    /* the caller passed a value outside its documented range */
    BRACE_ERROR_MEMORY = 2,      /* an allocation failed */
    BRACE_ERROR_IO = 3,          /* open, read, write, sync or rename failed; the message has errno's text */
    BRACE_ERROR_FORMAT = 4,      /* a file is damaged or not what its name says */
    BRACE_ERROR_UNSUPPORTED = 5, /* a sound file of a kind BRACE does not handle */
    BRACE_ERROR_MISMATCH = 6,    /* inputs that are fine alone do not belong together */
    BRACE_ERROR_CANCELLED = 7    /* the job's cancel flag was set */
} brace_status;

#define BRACE_ERROR_LENGTH 1024

/* Filled on failure, untouched on success. `message` is always terminated. */
typedef struct brace_error {
    brace_status status;
    char message[BRACE_ERROR_LENGTH];
} brace_error;

/* A short English name of a status ("out of memory"); never NULL. */
BRACE_API const char *brace_status_name(brace_status status);

#ifdef __cplusplus
}
#endif
#endif
