/* SPDX-License-Identifier: Apache-2.0 */
/* gphoto2_settings.c: settings that are read, changed, seen to be taken over, and put back. */
#include <math.h>
#include <pthread.h>
#include <string.h>

#include "capture/gphoto2.h"

/* ---- reading ---- */

CameraWidget *gphoto2_widget(gphoto2_session *session, const char *name) {
    CameraWidget *widget = NULL;
    int n;
    GPHOTO2_CALL(session, n, gp_camera_get_single_config(session->camera, name, &widget, session->context));
    if (n < 0 && n != GP_ERROR_BAD_PARAMETERS) { /* which is: there is none of that name */
        gphoto2_trouble(session, n);
    }
    return n < 0 ? NULL : widget;
}

bool gphoto2_widget_text(CameraWidget *widget, char text[GPHOTO2_TEXT]) {
    CameraWidgetType type;
    text[0] = '\0';
    if (gp_widget_get_type(widget, &type) < 0) {
        return false;
    }
    if (type == GP_WIDGET_RADIO || type == GP_WIDGET_MENU || type == GP_WIDGET_TEXT) {
        const char *value = NULL;
        if (gp_widget_get_value(widget, &value) < 0 || value == NULL || strlen(value) >= GPHOTO2_TEXT) {
            return false;
        }
        memcpy(text, value, strlen(value) + 1);
        return true;
    }
    if (type == GP_WIDGET_RANGE) {
        float value = 0;
        if (gp_widget_get_value(widget, &value) < 0) {
            return false;
        }
        snprintf(text, GPHOTO2_TEXT, "%.9g", (double)value);
        return true;
    }
    return false;
}

bool gphoto2_read(gphoto2_session *session, const char *name, char text[GPHOTO2_TEXT]) {
    CameraWidget *widget = gphoto2_widget(session, name);
    if (widget == NULL) {
        text[0] = '\0';
        return false;
    }
    const bool found = gphoto2_widget_text(widget, text);
    gp_widget_free(widget);
    return found;
}

const char *gphoto2_choice(CameraWidget *widget, int index) {
    const char *text = NULL;
    if (widget == NULL || index >= gp_widget_count_choices(widget) || gp_widget_get_choice(widget, index, &text) < 0) {
        return NULL;
    }
    return text;
}

bool gphoto2_is_readonly(CameraWidget *widget) {
    int readonly = 0;
    gp_widget_get_readonly(widget, &readonly);
    return readonly != 0;
}

/* ---- changing ---- */

/* Equal as texts or as numbers: a range comes back as the float that it went in as. */
static bool same(const char *a, const char *b) {
    double x, y;
    return strcmp(a, b) == 0 ||
           (capture_choice_exposure(a, &x) && capture_choice_exposure(b, &y) && fabs(x - y) <= 1e-6 * fabs(y));
}

static int set_once(gphoto2_session *session, CameraWidget *widget, const char *name, const char *text) {
    CameraWidgetType type;
    int n = gp_widget_get_type(widget, &type);
    if (n >= 0 && type == GP_WIDGET_RANGE) {
        double number = 0;
        n = capture_choice_iso(text, &number) ? gp_widget_set_value(widget, &(float){(float)number})
                                              : GP_ERROR_BAD_PARAMETERS;
    } else if (n >= 0) {
        n = gp_widget_set_value(widget, text);
    }
    if (n >= 0) {
        GPHOTO2_CALL(session, n, gp_camera_set_single_config(session->camera, name, widget, session->context));
    }
    return n;
}

static brace_status set(gphoto2_session *session, const char *name, const char *text, double patience,
                        capture_trouble *trouble, brace_error *error) {
    const double busy_end = core_seconds() + patience, kept_end = core_seconds() + 2;
    brace_status status;
    for (double pause = 0.1;; pause = fmin(2 * pause, 1)) {
        char now[GPHOTO2_TEXT] = "";
        CameraWidget *widget = gphoto2_widget(session, name);
        if (widget == NULL) {
            return gphoto2_fail(session, session->gone ? GP_ERROR_IO : GP_ERROR, trouble, error, "reading '%s'", name);
        }
        const bool readonly = gphoto2_is_readonly(widget);
        const int n = readonly ? GP_ERROR_NOT_SUPPORTED : set_once(session, widget, name, text);
        gp_widget_free(widget);
        double end;
        if (n < 0) {
            status = gphoto2_fail(session, n, trouble, error, "setting '%s' to '%s'", name, text);
            if (*trouble == CAPTURE_TROUBLE_DROPPED) { /* it is there, and does not want to */
                *trouble = CAPTURE_TROUBLE_FINAL;
            }
            end = *trouble == CAPTURE_TROUBLE_BUSY ? busy_end : 0;
        } else {
            if (gphoto2_read(session, name, now) && same(now, text)) {
                *trouble = CAPTURE_TROUBLE_FINAL;
                return BRACE_OK;
            }
            if (session->gone) {
                return gphoto2_fail(session, GP_ERROR_IO, trouble, error, "reading '%s' back", name);
            }
            /* The driver remembers what it read for two seconds, unless it was told to set: so that is done again. */
            *trouble = CAPTURE_TROUBLE_FINAL;
            status =
                core_fail(error, BRACE_ERROR_IO,
                          "%s: the camera was told to set '%s' to '%s' and keeps '%s'; does its mode dial allow it?",
                          session->port, name, text, now);
            end = kept_end;
        }
        if (core_seconds() + pause > end) {
            return status;
        }
        status = capture_wait(pause, session->job, error);
        if (status != BRACE_OK) {
            return status;
        }
    }
}

brace_status gphoto2_change(gphoto2_session *session, gphoto2_settings *settings, const char *name, const char *text,
                            bool always, double patience, capture_trouble *trouble, brace_error *error) {
    capture_trouble kind = CAPTURE_TROUBLE_FINAL;
    char now[GPHOTO2_TEXT];
    const bool known = gphoto2_read(session, name, now);
    size_t i = 0;
    while (i < settings->count && strcmp(settings->items[i].name, name) != 0) {
        i++;
    }
    if (known && i == settings->count && i < GPHOTO2_SETTINGS_MAX && !same(now, text)) {
        snprintf(settings->items[i].name, sizeof settings->items[i].name, "%s", name);
        snprintf(settings->items[i].original, sizeof settings->items[i].original, "%s", now);
        settings->count++;
    }
    brace_status status = BRACE_OK;
    if (always || !known || !same(now, text)) {
        status = set(session, name, text, patience, &kind, error);
    }
    if (trouble != NULL) {
        *trouble = kind;
    }
    return status;
}

/* ---- putting back ---- */

/* Settings of cameras that were gone when they should have been put back. A sequence opens such a camera again, and
 * must not take what it has set itself for what the photographer wants back. */
static struct {
    char port[128];
    gphoto2_settings settings;
} owed[4];
static size_t owed_next;
static pthread_mutex_t owed_mutex = PTHREAD_MUTEX_INITIALIZER;

static void owe(const char *port, const gphoto2_settings *settings) {
    pthread_mutex_lock(&owed_mutex);
    const size_t i = owed_next++ % (sizeof owed / sizeof owed[0]);
    snprintf(owed[i].port, sizeof owed[i].port, "%s", port);
    owed[i].settings = *settings;
    pthread_mutex_unlock(&owed_mutex);
}

void gphoto2_adopt(const gphoto2_session *session, gphoto2_settings *settings) {
    pthread_mutex_lock(&owed_mutex);
    for (size_t i = 0; i < sizeof owed / sizeof owed[0]; i++) {
        if (strcmp(owed[i].port, session->asked) == 0) {
            *settings = owed[i].settings;
            owed[i].port[0] = '\0';
        }
    }
    pthread_mutex_unlock(&owed_mutex);
}

void gphoto2_restore(gphoto2_session *session, gphoto2_settings *settings) {
    gphoto2_settings left = {.count = 0};
    char list[512] = "";
    for (size_t i = settings->count; i-- > 0;) {
        const char *name = settings->items[i].name, *original = settings->items[i].original;
        capture_trouble trouble = CAPTURE_TROUBLE_GONE;
        brace_error error;
        if (!session->gone &&
            gphoto2_change(session, settings, name, original, false, 3, &trouble, &error) == BRACE_OK) {
            continue;
        }
        left.items[left.count++] = settings->items[i];
        const size_t used = strlen(list);
        snprintf(list + used, sizeof list - used, "%s%s (was '%s')", used > 0 ? ", " : "", name, original);
    }
    if (left.count > 0) {
        core_note(session->job, "%s: %s these settings could not be put back: %s", session->port,
                  session->gone ? "the camera is gone, and" : "the camera refused it:", list);
    }
    if (session->gone && left.count > 0) {
        /* Back in the order in which they were changed. */
        gphoto2_settings turned = {.count = left.count};
        for (size_t i = 0; i < left.count; i++) {
            turned.items[i] = left.items[left.count - 1 - i];
        }
        owe(session->asked, &turned);
    }
    settings->count = 0;
}
