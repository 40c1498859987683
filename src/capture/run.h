/* SPDX-License-Identifier: Apache-2.0 */
/* run.h: a sequence while it is shot, and the hidden folder that it is shot into. */
#ifndef CAPTURE_RUN_H
#define CAPTURE_RUN_H

#include "capture/capture.h"

typedef struct capture_session {
    capture_sequence *sequence;
    const capture_backend *backend;
    const capture_address *address;
    const capture_run_params *params;
    const brace_job *job;
    capture_camera *camera;
    char *final, *folder; /* the name that it will have, and the hidden one */
    size_t prefix;        /* length of `folder` and a slash */
    int lock;             /* the open folder */
    bool resumed;
    int tries;
    double last_end; /* of an exposure, by this computer's clock; 0: none yet */
    capture_probe probes[CAPTURE_SHOTS_MAX];
} capture_session;

/* Makes the hidden folder, or finds the one of an interrupted sequence and reads its sequence.json. */
brace_status session_begin(capture_session *s, const char *folder, brace_error *error);

/* Removes what no good shot put there. */
brace_status session_tidy(capture_session *s, brace_error *error);

/* Writes sequence.json. */
brace_status session_save(const capture_session *s, brace_error *error);

/* With BRACE_OK: syncs the files and gives the folder its name. Otherwise leaves a folder with good frames for a
 * resumption, and removes any other. Frees the session's names; returns `status`, or why the folder did not get its
 * name. */
brace_status session_end(capture_session *s, brace_status status, brace_error *error);

/* A file in the hidden folder; false: too long. `out` holds PATH_MAX bytes. */
bool session_path(char *out, const capture_session *s, const char *file);

#endif
