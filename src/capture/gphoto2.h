/* SPDX-License-Identifier: Apache-2.0 */
/*
 * gphoto2.h: libgphoto2 as the tethered back end uses it: one session with a
 * camera, what the library says turned into sentences, and settings that are
 * changed, seen to be taken over, and put back. For camera_gphoto2.c.
 *
 * Names and meanings of the library's calls are those of its headers
 * (gphoto2/gphoto2-camera.h and others, version 2.5).
 *
 * Thread safety: one session in one thread. The library loads its drivers with
 * libltdl, which knows no threads: open and close from one thread at a time.
 */
#ifndef CAPTURE_GPHOTO2_H
#define CAPTURE_GPHOTO2_H

#include <gphoto2/gphoto2.h>
#include <signal.h>

#include "capture/camera.h"
#include "capture/choices.h"

/* ---- the session (gphoto2_session.c) ---- */

typedef struct gphoto2_session {
    GPContext *context;
    Camera *camera;
    const brace_job *job; /* of the call that is going on: for the library's messages, and to stop it */
    char asked[128];      /* the port that was asked for; "usb:" if none was */
    char port[128];       /* the one that was found; also the name in messages */
    char driver[128];     /* the library's name of the camera or of its kind */
    char said[512];       /* errors that the library told since gphoto2_begin */
    sigset_t mask;        /* of signals, between gphoto2_begin and gphoto2_end */
    bool piped;           /* a broken pipe was pending before */
    bool gone;            /* the device was found to be gone */
} gphoto2_session;

/* Every call of the library that talks to a device stands between these two: a connection that the device has closed
 * is an error there, not a signal (SIGPIPE) here, and other signals (Ctrl-C) come when the call is done. One that may
 * never end begins with the other. `said` begins anew. */
void gphoto2_begin(gphoto2_session *session);
void gphoto2_begin_endless(gphoto2_session *session);
void gphoto2_end(gphoto2_session *session);
#define GPHOTO2_CALL(session, result, call)                                                                            \
    do {                                                                                                               \
        gphoto2_begin(session);                                                                                        \
        (result) = (call);                                                                                             \
        gphoto2_end(session);                                                                                          \
    } while (0)

/* A context whose messages reach the session; for list, too, which opens nothing. */
brace_status gphoto2_context(gphoto2_session *session, const brace_job *job, brace_error *error);

/* Opens `port`: "usb:001,005", "ptpip:192.168.1.2", "ptpip:192.168.1.2:15740"; NULL: the only camera on USB. `model`
 * names the library's driver where it cannot be told from the port; NULL: by the port. A device that is busy is asked
 * again for some seconds. */
brace_status gphoto2_open(gphoto2_session *session, const char *port, const char *model, brace_error *error);

/* Ends the session; does nothing to what was not opened. */
void gphoto2_close(gphoto2_session *session);

/* What kind of trouble a failed call was. May ask the device whether it is still there. */
capture_trouble gphoto2_trouble(gphoto2_session *session, int result);

/* Fills the error: "DOING: what the library said". `trouble` may be NULL; otherwise it says of what kind it was. */
brace_status gphoto2_fail(gphoto2_session *session, int result, capture_trouble *trouble, brace_error *error,
                          const char *doing, ...) __attribute__((format(printf, 5, 6)));

/* ---- settings (gphoto2_settings.c) ---- */

#define GPHOTO2_TEXT 64 /* bytes of a value's text; longer ones are no choices for us */

/* The widget of a setting, or NULL if the camera has none of that name. Freed with gp_widget_free. */
CameraWidget *gphoto2_widget(gphoto2_session *session, const char *name);

/* The value of a setting as text; false: it has none. */
bool gphoto2_widget_text(CameraWidget *widget, char text[GPHOTO2_TEXT]);
bool gphoto2_read(gphoto2_session *session, const char *name, char text[GPHOTO2_TEXT]);

/* The texts that can be set; NULL-safe. `index` from 0; NULL: no more. */
const char *gphoto2_choice(CameraWidget *widget, int index);
bool gphoto2_is_readonly(CameraWidget *widget);

#define GPHOTO2_SETTINGS_MAX 16

/* What was changed, in order, and what it was before. */
typedef struct gphoto2_settings {
    size_t count;
    struct {
        char name[32], original[GPHOTO2_TEXT];
    } items[GPHOTO2_SETTINGS_MAX];
} gphoto2_settings;

/* Sets `name` to `text`, waits until the camera shows it, and remembers what it was the first time. Without `always`
 * a setting that shows this text already is left alone; with it the camera is told again, in case it only shows it. A
 * device that is busy is asked again for `patience` seconds; one that takes the value and keeps the old one is told
 * again for two. `trouble` may be NULL. */
brace_status gphoto2_change(gphoto2_session *session, gphoto2_settings *settings, const char *name, const char *text,
                            bool always, double patience, capture_trouble *trouble, brace_error *error);

/* Puts all back, the last changed first. What could not be is told in a note; of a device that is gone it is kept for
 * the next time that the port is opened. */
void gphoto2_restore(gphoto2_session *session, gphoto2_settings *settings);

/* What the device at this port is still owed. */
void gphoto2_adopt(const gphoto2_session *session, gphoto2_settings *settings);

#endif
