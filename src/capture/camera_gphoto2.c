/* SPDX-License-Identifier: Apache-2.0 */
/*
 * camera_gphoto2.c: the back end for tethered cameras, on USB or on the network,
 * through libgphoto2. The shutter is released, and the file that appears is
 * fetched. The library's call that does both is used only where there is no
 * other way, because it waits without end for a picture that does not come.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "capture/gphoto2.h"

#define FILE_MOST ((uint64_t)1 << 30) /* bytes: no RAW file of one shot is larger */
#define OPEN_PATIENCE 10.0            /* seconds for all settings of a busy device while it is prepared */
#define PICTURE_PATIENCE 15.0         /* seconds after the exposure in which its file has to appear */
#define COMPANION_PATIENCE 2.0        /* seconds that a JPEG may be ahead of the RAW file of the same shot */
#define DOWNLOAD_PATIENCE 8.0         /* seconds for a device that is busy when its file is fetched */

typedef struct gphoto2_camera {
    capture_camera base;
    gphoto2_session session;
    gphoto2_settings settings;
    capture_stops exposures, isos;
    char shutter_name[16], iso_name[16]; /* of the settings */
    bool delete;                         /* pictures from the card, once they are here */
} gphoto2_camera;

/* ---- list ---- */

static brace_status gphoto2_list(const capture_address *address, const brace_job *job, capture_found_fn *found,
                                 void *user, brace_error *error) {
    (void)address;
    gphoto2_session session = {.port = "usb:"};
    brace_status status = gphoto2_context(&session, job, error);
    if (status != BRACE_OK) {
        return status;
    }
    CameraList *list = NULL;
    int n = gp_list_new(&list);
    if (n >= 0) {
        GPHOTO2_CALL(&session, n, gp_camera_autodetect(list, session.context));
    }
    if (n < 0) {
        status = gphoto2_fail(&session, n, NULL, error, "looking for cameras");
    }
    for (int i = 0; i < n; i++) {
        const char *model, *port;
        if (gp_list_get_name(list, i, &model) >= 0 && gp_list_get_value(list, i, &port) >= 0) {
            found(user, &(capture_found){.port = port, .make = "", .model = model});
        }
    }
    gp_list_free(list);
    gphoto2_close(&session);
    return status;
}

/* ---- open ---- */

/* Settings for a bracket, besides exposure, ISO and file format. Where a camera has such a setting, and it is none of
 * the wanted values, it is set to the first of them that the camera has. */
static const struct {
    const char *name;
    const char *wanted[4];
    const char *only;    /* leave it alone unless its value has this in it */
    const char *else_do; /* NULL: it is no loss if it cannot be set; otherwise what the photographer has to do */
} preparations[] = {
    {"capturetarget", {"Internal RAM", "sdram"}, NULL, NULL},
    {"autoexposuremode", {"Manual", "M"}, NULL, "turn its mode dial to M"},
    {"expprogram", {"M", "Manual"}, NULL, "turn its mode dial to M"},
    {"isoauto", {"Off"}, NULL, NULL},
    {"autoiso", {"Off"}, NULL, NULL},
    {"autofocus", {"Off"}, NULL, NULL},
    {"focusmode", {"Manual", "MF"}, NULL, NULL},
    {"whitebalance", {"Daylight", "Sunny"}, "Auto", NULL},
    {"capturemode", {"Single Shot", "Single"}, NULL, NULL},
    {"drivemode", {"Single", "Single shot", "Single Frame"}, NULL, NULL},
};

static bool is_wanted(const char *const *wanted, const char *text) {
    for (size_t i = 0; i < 4 && wanted[i] != NULL; i++) {
        if (strcasecmp(wanted[i], text) == 0) {
            return true;
        }
    }
    return false;
}

/* The first of the wanted values that the camera offers. */
static bool offered(CameraWidget *widget, const char *const *wanted, char text[GPHOTO2_TEXT]) {
    for (size_t k = 0; k < 4 && wanted[k] != NULL; k++) {
        const char *choice;
        for (int i = 0; (choice = gphoto2_choice(widget, i)) != NULL; i++) {
            if (strcasecmp(wanted[k], choice) == 0 && strlen(choice) < GPHOTO2_TEXT) {
                memcpy(text, choice, strlen(choice) + 1);
                return true;
            }
        }
    }
    return false;
}

static brace_status prepare(gphoto2_camera *camera, brace_error *error) {
    gphoto2_session *s = &camera->session;
    const double end = core_seconds() + OPEN_PATIENCE;
    for (size_t i = 0; i < sizeof preparations / sizeof preparations[0]; i++) {
        const char *name = preparations[i].name, *const *wanted = preparations[i].wanted;
        CameraWidget *widget = gphoto2_widget(s, name);
        if (s->gone) {
            return gphoto2_fail(s, GP_ERROR_IO, NULL, error, "reading '%s'", name);
        }
        char now[GPHOTO2_TEXT], text[GPHOTO2_TEXT];
        if (widget == NULL) {
            continue;
        }
        const bool known = gphoto2_widget_text(widget, now);
        const bool done = known && is_wanted(wanted, now);
        const bool can = !gphoto2_is_readonly(widget) && offered(widget, wanted, text);
        gp_widget_free(widget);
        if (done || (preparations[i].only != NULL && strcasestr(now, preparations[i].only) == NULL)) {
            continue;
        }
        brace_error problem;
        brace_status status = BRACE_ERROR_UNSUPPORTED;
        if (can) {
            status = gphoto2_change(s, &camera->settings, name, text, false, end - core_seconds(), NULL, &problem);
        }
        if (status == BRACE_ERROR_CANCELLED || s->gone) {
            return core_fail(error, status, "%s", problem.message);
        }
        if (status != BRACE_OK && preparations[i].else_do != NULL) {
            return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                             "%s: '%s' of the camera is '%s', and a bracket needs '%s': %s", s->port, name,
                             known ? now : "unknown", wanted[0], preparations[i].else_do);
        }
    }
    return BRACE_OK;
}

/* RAW, if the camera lets the computer choose. */
static brace_status choose_raw(gphoto2_camera *camera, brace_error *error) {
    static const char *const names[] = {"imageformat", "imagequality", "imagequality2", "imageformatcf",
                                        "imageformatsd"};
    gphoto2_session *s = &camera->session;
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        CameraWidget *widget = gphoto2_widget(s, names[i]);
        char now[GPHOTO2_TEXT] = "", best[GPHOTO2_TEXT] = "";
        const char *choice;
        if (widget == NULL) {
            continue;
        }
        gphoto2_widget_text(widget, now);
        int rank = capture_choice_raw(now);
        for (int k = 0; !gphoto2_is_readonly(widget) && (choice = gphoto2_choice(widget, k)) != NULL; k++) {
            if (capture_choice_raw(choice) > rank && strlen(choice) < sizeof best) {
                rank = capture_choice_raw(choice);
                memcpy(best, choice, strlen(choice) + 1);
            }
        }
        gp_widget_free(widget);
        if (best[0] != '\0') {
            brace_status status =
                gphoto2_change(s, &camera->settings, names[i], best, false, OPEN_PATIENCE, NULL, error);
            if (status != BRACE_OK) {
                return status;
            }
        }
    }
    return s->gone ? gphoto2_fail(s, GP_ERROR_IO, NULL, error, "choosing RAW") : BRACE_OK;
}

/* The first setting of some names that can be set to at least one number; `range` gets the bounds of one that has no
 * choices but may be anything between. False: there is none. */
static bool find_stops(gphoto2_camera *camera, const char *const *names, char name[16], capture_stops *stops,
                       bool (*parse)(const char *, double *), double range[2], bool *readonly) {
    *readonly = false;
    for (; *names != NULL; names++) {
        CameraWidget *widget = gphoto2_widget(&camera->session, *names);
        CameraWidgetType type;
        const char *choice;
        float low, high, step;
        if (widget == NULL) {
            continue;
        }
        stops->count = 0;
        for (int i = 0; (choice = gphoto2_choice(widget, i)) != NULL; i++) {
            capture_stops_add(stops, choice, parse);
        }
        bool found = stops->count > 0;
        if (!found && range != NULL && gp_widget_get_type(widget, &type) >= 0 && type == GP_WIDGET_RANGE &&
            gp_widget_get_range(widget, &low, &high, &step) >= 0 && low >= 1 && high > low) {
            range[0] = (double)low;
            range[1] = (double)high;
            found = true;
        }
        const bool fixed = found && gphoto2_is_readonly(widget);
        *readonly = *readonly || fixed;
        gp_widget_free(widget);
        if (found && !fixed) {
            snprintf(name, 16, "%s", *names);
            return true;
        }
    }
    return false;
}

/* The same, or the reason why not. */
static brace_status must_find(gphoto2_camera *camera, const char *const *names, const char *what, const char *remedy,
                              char name[16], capture_stops *stops, bool (*parse)(const char *, double *),
                              double range[2], brace_error *error) {
    gphoto2_session *s = &camera->session;
    bool readonly = false;
    /* The driver makes no difference between a setting that is not there and one that a busy or lost device does not
     * describe. */
    for (int i = 0; i < 4; i++) {
        if (find_stops(camera, names, name, stops, parse, range, &readonly)) {
            return BRACE_OK;
        }
        if (gphoto2_trouble(s, GP_ERROR) == CAPTURE_TROUBLE_GONE) {
            return gphoto2_fail(s, GP_ERROR_IO, NULL, error, "reading the choices of %s", what);
        }
        brace_status status = readonly ? BRACE_OK : capture_wait(0.2, s->job, error);
        if (status != BRACE_OK) {
            return status;
        }
    }
    return core_fail(error, BRACE_ERROR_UNSUPPORTED, "%s: the camera does not let the computer set its %s%s%s", s->port,
                     what, readonly ? " as it stands: " : "", readonly ? remedy : "");
}

static brace_status fill_limits(gphoto2_camera *camera, brace_error *error) {
    gphoto2_session *s = &camera->session;
    capture_limits *limits = &camera->base.limits;
    /* Where there are both, the second is exact, and the first rounded to tenths of milliseconds (Nikon). */
    static const char *const shutters[] = {"shutterspeed2", "shutterspeed", "exptime", NULL};
    static const char *const speeds[] = {"iso", "isospeed", NULL};
    double range[2] = {0, 0};
    brace_status status = must_find(camera, shutters, "shutter", "turn its mode dial to M", camera->shutter_name,
                                    &camera->exposures, capture_choice_exposure, NULL, error);
    if (status == BRACE_OK) {
        status = must_find(camera, speeds, "ISO", "switch automatic ISO off", camera->iso_name, &camera->isos,
                           capture_choice_iso, range, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    limits->exposure_count = camera->exposures.count;
    memcpy(limits->exposures, camera->exposures.values, camera->exposures.count * sizeof limits->exposures[0]);
    limits->exposure_min = limits->exposures[0];
    limits->exposure_max = limits->exposures[limits->exposure_count - 1];
    limits->iso_count = camera->isos.count;
    limits->iso_min = range[0];
    limits->iso_max = range[1];
    if (limits->iso_count > 0) {
        memcpy(limits->isos, camera->isos.values, camera->isos.count * sizeof limits->isos[0]);
        limits->iso_min = limits->isos[0];
        limits->iso_max = limits->isos[limits->iso_count - 1];
    }
    char text[GPHOTO2_TEXT];
    if (!((gphoto2_read(s, "f-number", text) || gphoto2_read(s, "aperture", text)) &&
          capture_choice_aperture(text, &limits->f_number))) {
        limits->f_number = 0;
    }
    gphoto2_read(s, "manufacturer", text);
    snprintf(limits->make, sizeof limits->make, "%s", text);
    if (!gphoto2_read(s, "cameramodel", text) || text[0] == '\0') {
        snprintf(text, sizeof text, "%s", s->driver);
    }
    snprintf(limits->model, sizeof limits->model, "%s", text);
    gphoto2_read(s, "serialnumber", text);
    snprintf(limits->id, sizeof limits->id, "%s", text[0] != '\0' ? text : s->port);
    /* What is not said may be nothing worse than that. */
    return gphoto2_trouble(s, GP_ERROR) == CAPTURE_TROUBLE_GONE
               ? gphoto2_fail(s, GP_ERROR_IO, NULL, error, "reading the camera's name")
               : BRACE_OK;
}

static void gphoto2_close_camera(capture_camera *base, const brace_job *job) {
    gphoto2_camera *camera = (gphoto2_camera *)base;
    if (camera == NULL) {
        return;
    }
    /* Also after Ctrl-C: this is what it waits for. */
    brace_job last = {.threads = 1};
    if (job != NULL) {
        last = *job;
        last.cancel = NULL;
    }
    camera->session.job = &last;
    if (camera->session.camera != NULL) {
        gphoto2_restore(&camera->session, &camera->settings);
    }
    gphoto2_close(&camera->session);
    core_free(camera);
}

static brace_status gphoto2_open_camera(capture_camera **out, const capture_address *address, const brace_job *job,
                                        brace_error *error) {
    static const char *const known[] = {"model", "delete", NULL};
    *out = NULL;
    brace_status status = capture_option_unknown(address, "gphoto2", known, error);
    if (status != BRACE_OK) {
        return status;
    }
    const char *remove = capture_option(address, "delete");
    if (remove != NULL && strcmp(remove, "yes") != 0 && strcmp(remove, "no") != 0) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "delete=%s: yes or no", remove);
    }
    gphoto2_camera *camera = core_calloc(1, sizeof *camera);
    if (camera == NULL) {
        return core_fail_memory(error, sizeof *camera, "a camera");
    }
    camera->base.backend = &capture_backend_gphoto2;
    camera->delete = remove != NULL && strcmp(remove, "yes") == 0;
    status = gphoto2_context(&camera->session, job, error);
    if (status == BRACE_OK) {
        status = gphoto2_open(&camera->session, address->port, capture_option(address, "model"), error);
    }
    if (status == BRACE_OK) {
        gphoto2_adopt(&camera->session, &camera->settings);
        status = prepare(camera, error);
    }
    if (status == BRACE_OK) {
        status = choose_raw(camera, error);
    }
    if (status == BRACE_OK) {
        status = fill_limits(camera, error);
    }
    if (status != BRACE_OK) {
        gphoto2_close_camera(&camera->base, job);
        return status;
    }
    *out = &camera->base;
    return BRACE_OK;
}

/* ---- shoot ---- */

typedef struct picture {
    CameraFilePath raw, other;
    bool has_raw, has_other, complete;
} picture;

static void see(picture *p, const CameraFilePath *path) {
    char extension[8];
    if (capture_name_is_raw(path->name, extension)) {
        p->raw = *path;
        p->has_raw = true;
    } else {
        p->other = *path;
        p->has_other = true;
    }
}

/* One event, waited for at most `ms`. `p` may be NULL: what happened before the shot does not matter. */
static int next_event(gphoto2_session *s, int ms, picture *p, bool *nothing) {
    CameraEventType type = GP_EVENT_TIMEOUT;
    void *data = NULL;
    int n;
    GPHOTO2_CALL(s, n, gp_camera_wait_for_event(s->camera, ms, &type, &data, s->context));
    if (n >= 0 && p != NULL && type == GP_EVENT_FILE_ADDED && data != NULL) {
        see(p, data);
    }
    if (n >= 0 && p != NULL && type == GP_EVENT_CAPTURE_COMPLETE) {
        p->complete = true;
    }
    *nothing = n < 0 || type == GP_EVENT_TIMEOUT;
    free(data);
    return n;
}

/* Releases the shutter and waits for what comes of it. */
static brace_status release(gphoto2_camera *camera, double exposure, picture *p, capture_trouble *trouble,
                            brace_error *error) {
    gphoto2_session *s = &camera->session;
    bool nothing = false;
    int n = 0;
    for (int i = 0; i < 100 && n >= 0 && !nothing; i++) {
        n = next_event(s, 1, NULL, &nothing);
    }
    if (n >= 0) {
        GPHOTO2_CALL(s, n, gp_camera_trigger_capture(s->camera, s->context));
    }
    if (n == GP_ERROR_NOT_SUPPORTED) {
        CameraFilePath path;
        gphoto2_begin_endless(s);
        n = gp_camera_capture(s->camera, GP_CAPTURE_IMAGE, &path, s->context);
        gphoto2_end(s);
        if (n >= 0) {
            see(p, &path);
        }
    }
    if (n < 0) {
        const brace_status status = gphoto2_fail(s, n, trouble, error, "releasing the shutter");
        if (*trouble == CAPTURE_TROUBLE_DROPPED &&
            (strcasestr(s->said, "full") != NULL || strcasestr(s->said, "denied") != NULL)) {
            *trouble = CAPTURE_TROUBLE_FINAL; /* a card that is full stays so */
        }
        return status;
    }
    const double start = core_seconds();
    double end = start + 2 * exposure + PICTURE_PATIENCE; /* twice: many take a dark frame to subtract */
    bool ending = false;
    while (!p->has_raw && core_seconds() < end) {
        brace_status status = core_check_cancel(s->job, error);
        if (status != BRACE_OK) {
            return status;
        }
        n = next_event(s, 100, p, &nothing);
        if (n < 0) {
            return gphoto2_fail(s, n, trouble, error, "waiting for the picture");
        }
        /* Events may come in any order, but not long after one another. */
        if (!ending && (p->complete || p->has_other)) {
            ending = true;
            end = fmin(end, core_seconds() + COMPANION_PATIENCE);
        }
    }
    if (p->has_raw) {
        return BRACE_OK;
    }
    if (p->has_other) {
        *trouble = CAPTURE_TROUBLE_FINAL;
        return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                         "%s: the camera made '%s', which is no RAW file; set its image quality to RAW", s->port,
                         p->other.name);
    }
    /* A network camera that has gone without a word is only found out by asking it. */
    *trouble = gphoto2_trouble(s, GP_ERROR);
    return core_fail(error, BRACE_ERROR_IO, "%s: the shutter was released, but no picture came within %.0f s%s%s",
                     s->port, core_seconds() - start, p->complete ? ", though the camera says that it is done" : "",
                     *trouble == CAPTURE_TROUBLE_GONE ? " (the camera is gone)" : "");
}

/* The file's bytes, complete. */
static brace_status fetch(gphoto2_camera *camera, const CameraFilePath *path, CameraFile **file,
                          capture_trouble *trouble, brace_error *error) {
    gphoto2_session *s = &camera->session;
    const double end = core_seconds() + DOWNLOAD_PATIENCE;
    for (double pause = 0.1;; pause = fmin(2 * pause, 2)) {
        CameraFileInfo info = {.file.fields = GP_FILE_INFO_NONE};
        const char *data = NULL;
        unsigned long size = 0;
        int n;
        GPHOTO2_CALL(s, n, gp_camera_file_get_info(s->camera, path->folder, path->name, &info, s->context));
        const bool announced = n >= 0 && (info.file.fields & GP_FILE_INFO_SIZE) != 0;
        if (announced && info.file.size > FILE_MOST) {
            return core_fail(error, BRACE_ERROR_FORMAT, "%s: '%s' is said to have %llu bytes, and no RAW file has",
                             s->port, path->name, (unsigned long long)info.file.size);
        }
        n = gp_file_new(file);
        if (n >= 0) {
            GPHOTO2_CALL(
                s, n, gp_camera_file_get(s->camera, path->folder, path->name, GP_FILE_TYPE_NORMAL, *file, s->context));
        }
        n = n >= 0 ? gp_file_get_data_and_size(*file, &data, &size) : n;
        if (n >= 0 && size > 0 && (!announced || size == info.file.size)) {
            return BRACE_OK;
        }
        brace_status status;
        if (n < 0) {
            status = gphoto2_fail(s, n, trouble, error, "fetching '%s'", path->name);
        } else {
            *trouble = CAPTURE_TROUBLE_DROPPED;
            status = core_fail(error, BRACE_ERROR_IO, "%s: '%s' was cut short: %lu of %llu bytes came", s->port,
                               path->name, size, announced ? (unsigned long long)info.file.size : 0);
        }
        gp_file_free(*file);
        *file = NULL;
        /* The exposure is made: to ask again for its file is not to shoot again. */
        if (*trouble != CAPTURE_TROUBLE_BUSY || core_seconds() + pause > end) {
            *trouble = *trouble == CAPTURE_TROUBLE_BUSY ? CAPTURE_TROUBLE_DROPPED : *trouble;
            return status;
        }
        status = capture_wait(pause, s->job, error);
        if (status != BRACE_OK) {
            return status;
        }
    }
}

static brace_status store(gphoto2_camera *camera, const CameraFilePath *path, CameraFile *file, const char *stem,
                          capture_shot_report *out, brace_error *error) {
    const char *data = NULL;
    unsigned long size = 0;
    char name[4096];
    capture_name_is_raw(path->name, out->extension);
    if (gp_file_get_data_and_size(file, &data, &size) < 0 ||
        snprintf(name, sizeof name, "%s.%s", stem, out->extension) >= (int)sizeof name) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%s: the name of the file is too long", stem);
    }
    if (size >= 3 && memcmp(data, "\xff\xd8\xff", 3) == 0) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                         "%s: '%s' is a JPEG, whatever its name says; set the camera's image quality to RAW",
                         camera->session.port, path->name);
    }
    core_file *f = NULL;
    brace_status status = core_file_create(&f, name, error);
    if (status != BRACE_OK) {
        return status;
    }
    /* What cannot be written is found and told by the commit. */
    fwrite(data, 1, size, core_file_stream(f));
    return core_file_commit_unsynced(f, error);
}

/* Pictures that a camera holds in its memory are shown in the root folder; there the next one needs their room. Those
 * on a card are the photographer's. */
static void remove_from_camera(gphoto2_camera *camera, const CameraFilePath *path) {
    if (camera->delete || strcmp(path->folder, "/") == 0) {
        gphoto2_session *s = &camera->session;
        int n;
        GPHOTO2_CALL(s, n, gp_camera_file_delete(s->camera, path->folder, path->name, s->context));
        if (n < 0 && camera->delete) {
            core_note(s->job, "%s: '%s' could not be deleted from the camera: %s", s->port, path->name,
                      s->said[0] != '\0' ? s->said : gp_result_as_string(n));
        }
    }
}

static brace_status gphoto2_shoot(capture_camera *base, double exposure, double iso, const char *stem,
                                  capture_shot_report *out, const brace_job *job, brace_error *error) {
    gphoto2_camera *camera = (gphoto2_camera *)base;
    gphoto2_session *s = &camera->session;
    s->job = job;
    out->trouble = CAPTURE_TROUBLE_FINAL;
    if (s->gone) {
        out->trouble = CAPTURE_TROUBLE_GONE;
        return core_fail(error, BRACE_ERROR_IO, "%s: the camera is gone", s->port);
    }
    const size_t stop = capture_stops_nearest(&camera->exposures, exposure);
    char speed[GPHOTO2_TEXT];
    if (camera->isos.count > 0) {
        const size_t i = capture_stops_nearest(&camera->isos, iso);
        snprintf(speed, sizeof speed, "%s", camera->isos.texts[i]);
        iso = camera->isos.values[i];
    } else {
        iso = round(iso);
        snprintf(speed, sizeof speed, "%.0f", iso);
    }
    brace_status status = gphoto2_change(s, &camera->settings, camera->iso_name, speed, true, 0, &out->trouble, error);
    if (status == BRACE_OK) {
        status = gphoto2_change(s, &camera->settings, camera->shutter_name, camera->exposures.texts[stop], true, 0,
                                &out->trouble, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    picture p = {.has_raw = false};
    CameraFile *file = NULL;
    out->trouble = CAPTURE_TROUBLE_FINAL;
    status = release(camera, camera->exposures.values[stop], &p, &out->trouble, error);
    if (status == BRACE_OK) {
        status = fetch(camera, &p.raw, &file, &out->trouble, error);
    }
    if (status == BRACE_OK) {
        out->trouble = CAPTURE_TROUBLE_FINAL;
        status = store(camera, &p.raw, file, stem, out, error);
    }
    if (file != NULL) {
        gp_file_free(file);
    }
    if (status == BRACE_OK) {
        remove_from_camera(camera, &p.raw);
        if (p.has_other) {
            remove_from_camera(camera, &p.other);
        }
        out->exposure = camera->exposures.values[stop];
        out->iso = iso;
    }
    return status;
}

const capture_backend capture_backend_gphoto2 = {
    .name = "gphoto2",
    .description = "a tethered camera: USB, or PTP/IP on the network (gphoto2:ptpip:ADDRESS)",
    .options = "model=NAME     the driver of libgphoto2 for a camera that it cannot tell from the port\n"
               "delete=yes     delete pictures from the camera's card once they are here (default: no)",
    .list = gphoto2_list,
    .open = gphoto2_open_camera,
    .shoot = gphoto2_shoot,
    .close = gphoto2_close_camera,
};
