/* SPDX-License-Identifier: Apache-2.0 */
/* gphoto2_session.c: opening and closing a camera of libgphoto2, and what it says. */
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "capture/gphoto2.h"

/* ---- signals ---- */

/* The library's PTP/IP driver writes to its socket with write(), which raises SIGPIPE if the camera is gone, and takes
 * a wait that a signal has interrupted for a connection that has failed. */
static void hold(gphoto2_session *session, const sigset_t *held) {
    sigset_t pending;
    sigemptyset(&pending);
    sigpending(&pending);
    session->piped = sigismember(&pending, SIGPIPE) == 1;
    pthread_sigmask(SIG_BLOCK, held, &session->mask);
    session->said[0] = '\0';
}

void gphoto2_begin(gphoto2_session *session) {
    static const int faults[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGTRAP, SIGSYS};
    sigset_t held;
    sigfillset(&held);
    for (size_t i = 0; i < sizeof faults / sizeof faults[0]; i++) {
        sigdelset(&held, faults[i]);
    }
    hold(session, &held);
}

void gphoto2_begin_endless(gphoto2_session *session) {
    sigset_t held;
    sigemptyset(&held);
    sigaddset(&held, SIGPIPE);
    hold(session, &held);
}

void gphoto2_end(gphoto2_session *session) {
    sigset_t pipe;
    sigemptyset(&pipe);
    sigaddset(&pipe, SIGPIPE);
    while (!session->piped && sigtimedwait(&pipe, NULL, &(struct timespec){0, 0}) < 0 && errno == EINTR) {
    }
    pthread_sigmask(SIG_SETMASK, &session->mask, NULL);
}

/* ---- what the library says ---- */

/* Texts may hold what the device sent: one line, nothing that steers a terminal. */
static void append(char *out, size_t size, const char *text) {
    size_t n = strlen(out);
    if (n > 0 && n + 3 < size) {
        out[n++] = ';';
        out[n++] = ' ';
    }
    for (; *text != '\0' && n + 1 < size; text++) {
        out[n++] = (unsigned char)*text < 32 || *text == 127 ? ' ' : *text;
    }
    while (n > 0 && out[n - 1] == ' ') {
        n--;
    }
    out[n] = '\0';
}

static void on_error(GPContext *context, const char *text, void *data) {
    (void)context;
    gphoto2_session *session = data;
    append(session->said, sizeof session->said, text);
}

static void on_message(GPContext *context, const char *text, void *data) {
    (void)context;
    const gphoto2_session *session = data;
    char line[256] = "";
    append(line, sizeof line, text);
    if (line[0] != '\0') {
        core_note(session->job, "the camera's driver says: %s", line);
    }
}

static GPContextFeedback on_cancel(GPContext *context, void *data) {
    (void)context;
    const gphoto2_session *session = data;
    return core_cancelled(session->job) ? GP_CONTEXT_FEEDBACK_CANCEL : GP_CONTEXT_FEEDBACK_OK;
}

capture_trouble gphoto2_trouble(gphoto2_session *session, int result) {
    /* The driver forgets the device's answer when a setting is refused, but not to tell it. */
    if (result == GP_ERROR_CAMERA_BUSY || strstr(session->said, "0x2019") != NULL) {
        return CAPTURE_TROUBLE_BUSY;
    }
    switch (result) {
    case GP_ERROR_IO:
    case GP_ERROR_IO_INIT:
    case GP_ERROR_IO_READ:
    case GP_ERROR_IO_WRITE:
    case GP_ERROR_IO_UPDATE:
    case GP_ERROR_IO_USB_CLEAR_HALT:
    case GP_ERROR_IO_USB_FIND:
    case GP_ERROR_IO_USB_CLAIM:
    case GP_ERROR_TIMEOUT: /* its answer may still come, and would be taken for that to the next question */
        session->gone = true;
        break;
    case GP_ERROR_NO_MEMORY:
    case GP_ERROR_CANCEL:
    case GP_ERROR_NO_SPACE:
        return CAPTURE_TROUBLE_FINAL;
    default:
        /* "Unspecified error" is also what the driver makes of a connection that has ended. */
        if (!session->gone && session->camera != NULL) {
            CameraStorageInformation *storages = NULL;
            char said[sizeof session->said];
            int count = 0, answer;
            memcpy(said, session->said, sizeof said);
            GPHOTO2_CALL(session, answer,
                         gp_camera_get_storageinfo(session->camera, &storages, &count, session->context));
            free(storages);
            memcpy(session->said, said, sizeof said);
            session->gone = answer < 0 && answer != GP_ERROR_NOT_SUPPORTED && answer != GP_ERROR_CAMERA_BUSY &&
                            answer != GP_ERROR_BAD_PARAMETERS;
        }
    }
    return session->gone ? CAPTURE_TROUBLE_GONE : CAPTURE_TROUBLE_DROPPED;
}

brace_status gphoto2_fail(gphoto2_session *session, int result, capture_trouble *trouble, brace_error *error,
                          const char *doing, ...) {
    char what[256];
    va_list args;
    va_start(args, doing);
    vsnprintf(what, sizeof what, doing, args);
    va_end(args);
    if (result == GP_ERROR_CANCEL && core_cancelled(session->job)) {
        return core_check_cancel(session->job, error);
    }
    const capture_trouble kind = gphoto2_trouble(session, result);
    if (trouble != NULL) {
        *trouble = kind;
    }
    return core_fail(error, result == GP_ERROR_NO_MEMORY ? BRACE_ERROR_MEMORY : BRACE_ERROR_IO, "%s: %s: %s%s",
                     session->port, what, session->said[0] != '\0' ? session->said : gp_result_as_string(result),
                     kind == CAPTURE_TROUBLE_GONE && session->camera != NULL ? " (the camera is gone)" : "");
}

/* ---- opening ---- */

brace_status gphoto2_context(gphoto2_session *session, const brace_job *job, brace_error *error) {
    session->job = job;
    session->context = gp_context_new();
    if (session->context == NULL) {
        return core_fail_memory(error, 256, "libgphoto2");
    }
    gp_context_set_error_func(session->context, on_error, session);
    gp_context_set_message_func(session->context, on_message, session);
    gp_context_set_status_func(session->context, on_message, session);
    gp_context_set_cancel_func(session->context, on_cancel, session);
    return BRACE_OK;
}

/* The driver's name and the port of the only camera on USB, or of the one at session->port. */
static brace_status detect(gphoto2_session *session, bool any, brace_error *error) {
    CameraList *list = NULL;
    int count = gp_list_new(&list);
    if (count >= 0) {
        GPHOTO2_CALL(session, count, gp_camera_autodetect(list, session->context));
    }
    const char *name = NULL, *port = NULL;
    char names[512] = "";
    int matches = 0;
    for (int i = 0; i < count; i++) {
        const char *n, *p;
        if (gp_list_get_name(list, i, &n) < 0 || gp_list_get_value(list, i, &p) < 0) {
            continue;
        }
        const size_t used = strlen(names);
        snprintf(names + used, sizeof names - used, "%s%s (%s)", used > 0 ? ", " : "", p, n);
        if (any || strcmp(p, session->port) == 0) {
            name = n;
            port = p;
            matches++;
        }
    }
    brace_status status = BRACE_OK;
    if (count < 0) {
        status = gphoto2_fail(session, count, NULL, error, "looking for cameras");
    } else if (matches > 1) {
        status = core_fail(error, BRACE_ERROR_ARGUMENT,
                           "there are several cameras on USB: %s; say which one, as gphoto2:PORT", names);
    } else if (matches == 0) {
        status =
            core_fail(error, BRACE_ERROR_IO,
                      "no camera was found %s%s%s%s; is it switched on, and is no other program (a file manager) "
                      "holding it? One on the network is given by its address: gphoto2:ptpip:ADDRESS",
                      any ? "on USB" : "at ", any ? "" : session->port, names[0] != '\0' ? "; there are: " : "", names);
    } else {
        snprintf(session->driver, sizeof session->driver, "%s", name);
        snprintf(session->port, sizeof session->port, "%s", port);
    }
    gp_list_free(list);
    return status;
}

/* Tells the library which driver and which port. */
static int prepare(gphoto2_session *session, const char *path) {
    CameraAbilitiesList *drivers = NULL;
    GPPortInfoList *ports = NULL;
    CameraAbilities abilities;
    GPPortInfo info;
    int n = gp_abilities_list_new(&drivers);
    n = n < 0 ? n : gp_abilities_list_load(drivers, session->context);
    n = n < 0 ? n : gp_abilities_list_lookup_model(drivers, session->driver);
    n = n < 0 ? n : gp_abilities_list_get_abilities(drivers, n, &abilities);
    n = n < 0 ? n : gp_camera_set_abilities(session->camera, abilities);
    n = n < 0 ? n : gp_port_info_list_new(&ports);
    n = n < 0 ? n : gp_port_info_list_load(ports);
    n = n < 0 ? n : gp_port_info_list_lookup_path(ports, path);
    n = n < 0 ? n : gp_port_info_list_get_info(ports, n, &info);
    n = n < 0 ? n : gp_camera_set_port_info(session->camera, info);
    gp_port_info_list_free(ports);
    gp_abilities_list_free(drivers);
    return n;
}

/* The PTP/IP driver takes "ptpip:HOST:PORT:EVENT_PORT" and otherwise connects for events to the usual port, also if a
 * port was given. */
static void network_path(char path[160], const char *port) {
    const char *host = strchr(port, ':'), *number = host != NULL ? strchr(host + 1, ':') : NULL;
    const bool complete = number != NULL && strchr(number + 1, ':') != NULL;
    snprintf(path, 160, "%s%s", port, number != NULL && !complete ? number : "");
}

brace_status gphoto2_open(gphoto2_session *session, const char *port, const char *model, brace_error *error) {
    const bool network = port != NULL && strncmp(port, "ptpip:", 6) == 0;
    if (port != NULL &&
        (strlen(port) >= sizeof session->port || (model != NULL && strlen(model) >= sizeof session->driver))) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "the camera's port or model is too long");
    }
    snprintf(session->asked, sizeof session->asked, "%s", port != NULL ? port : "usb:");
    snprintf(session->port, sizeof session->port, "%s", session->asked);
    brace_status status = BRACE_OK;
    if (model != NULL) {
        snprintf(session->driver, sizeof session->driver, "%s", model);
    } else if (network) {
        snprintf(session->driver, sizeof session->driver, "PTP/IP Camera");
    } else {
        status = detect(session, port == NULL, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    char path[160];
    network_path(path, session->port);
    const double end = core_seconds() + 8;
    for (double pause = 0.1;; pause *= 2) {
        int n = gp_camera_new(&session->camera);
        n = n < 0 ? n : prepare(session, network ? path : session->port);
        if (n == GP_ERROR_MODEL_NOT_FOUND || n == GP_ERROR_UNKNOWN_PORT) {
            gp_camera_free(session->camera);
            session->camera = NULL;
            status = core_fail(error, BRACE_ERROR_ARGUMENT, "libgphoto2 knows no %s '%s'",
                               n == GP_ERROR_UNKNOWN_PORT ? "port" : "camera",
                               n == GP_ERROR_UNKNOWN_PORT ? session->port : session->driver);
            break;
        }
        if (n >= 0) {
            GPHOTO2_CALL(session, n, gp_camera_init(session->camera, session->context));
        }
        if (n >= 0) {
            return BRACE_OK;
        }
        gp_camera_free(session->camera);
        session->camera = NULL;
        capture_trouble trouble;
        status = gphoto2_fail(session, n, &trouble, error, "the camera (%s) does not answer", session->driver);
        session->gone = false;
        if (trouble != CAPTURE_TROUBLE_BUSY || core_seconds() + pause > end) {
            break;
        }
        status = capture_wait(pause, session->job, error);
        if (status != BRACE_OK) {
            break;
        }
    }
    return status;
}

/* The PTP/IP driver of 2.5.30 and others closes descriptor 0 together with its own, as one that it never opened is 0
 * there and not -1. Whatever it is to us, the terminal or a file, it is given back. */
static void exit_and_free(gphoto2_session *session) {
    const int flags = fcntl(STDIN_FILENO, F_GETFD), saved = fcntl(STDIN_FILENO, F_DUPFD_CLOEXEC, STDERR_FILENO + 1);
    gphoto2_begin(session);
    gp_camera_exit(session->camera, session->context);
    gp_camera_free(session->camera);
    gphoto2_end(session);
    session->camera = NULL;
    if (saved >= 0) {
        if (fcntl(STDIN_FILENO, F_GETFD) < 0 && dup2(saved, STDIN_FILENO) == STDIN_FILENO) {
            fcntl(STDIN_FILENO, F_SETFD, flags);
        }
        close(saved);
    }
}

void gphoto2_close(gphoto2_session *session) {
    if (session->camera != NULL) {
        exit_and_free(session);
    }
    if (session->context != NULL) {
        gp_context_unref(session->context);
        session->context = NULL;
    }
}
