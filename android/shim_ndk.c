/* SPDX-License-Identifier: Apache-2.0 */
/*
 * shim_ndk.c: the camera calls of shim.h, made of the NDK's Camera2 and
 * AImageReader. Its callbacks arrive on threads of the system; they only note
 * what happened, under the lock, and the one thread of the program waits for it.
 *
 * A session has two outputs: RAW16 for the frames, and a small YUV stream, which
 * nobody looks at, for the phone's automatics to find focus and white balance by.
 */
#include <camera/NdkCameraCaptureSession.h>
#include <camera/NdkCameraDevice.h>
#include <camera/NdkCameraManager.h>
#include <camera/NdkCaptureRequest.h>
#include <dlfcn.h>
#include <media/NdkImageReader.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/system_properties.h>
#include <time.h>

#include "shim.h"
#include "shim_ndk.h"

/* One request and what came of it. Each has its own, so that a late callback of a request that was
 * given up does not speak for the next. */
typedef struct capture {
    shim *owner;
    bool done, failed;
    capture_wire_frame frame;
} capture;

enum { CAPTURES = 16 };

struct shim {
    ACameraManager *manager;
    ACameraDevice *device;
    AImageReader *raw, *preview;
    ACaptureSessionOutputContainer *outputs;
    ACaptureSessionOutput *raw_output, *preview_output;
    ACameraOutputTarget *raw_target, *preview_target;
    ACameraCaptureSession *session;
    ACaptureRequest *request; /* of a RAW frame */
    AImage *image;            /* that shoot gave out */
    capture_wire_camera camera;
    ndk_habits habits;
    double focus;  /* dioptres, of the next frame */
    unsigned next; /* capture to be used */

    pthread_mutex_t lock; /* of what follows */
    pthread_cond_t event;
    capture captures[CAPTURES];
    bool gone;
    uint64_t results; /* of metering, that have come */
    capture_wire_metered metered;
    int af_state;
};

static int fail(char *why, int trouble, const char *text) {
    snprintf(why, SHIM_WHY, "%s", text);
    return trouble;
}

/* What a call of the NDK that failed means. */
static int fail_status(char *why, camera_status_t status, const char *doing) {
    switch (status) {
    case ACAMERA_ERROR_CAMERA_IN_USE:
    case ACAMERA_ERROR_MAX_CAMERA_IN_USE:
        return fail(why, CAPTURE_WIRE_BUSY, "another app is using the camera");
    case ACAMERA_ERROR_CAMERA_DISABLED:
        return fail(why, CAPTURE_WIRE_FAILED, "the camera is disabled by a policy, or by the camera switch");
    case ACAMERA_ERROR_PERMISSION_DENIED:
        return fail(why, CAPTURE_WIRE_FAILED,
                    "the phone does not let adb's shell use the camera (that needs Android 12 or newer)");
    case ACAMERA_ERROR_CAMERA_DISCONNECTED:
    case ACAMERA_ERROR_CAMERA_DEVICE:
    case ACAMERA_ERROR_CAMERA_SERVICE:
    case ACAMERA_ERROR_SESSION_CLOSED:
        snprintf(why, SHIM_WHY, "the camera is gone (%s: error %d)", doing, (int)status);
        return CAPTURE_WIRE_GONE;
    default:
        snprintf(why, SHIM_WHY, "%s failed (camera error %d)", doing, (int)status);
        return CAPTURE_WIRE_FAILED;
    }
}

/* ---- waiting ---- */

static int64_t milliseconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000 + t.tv_nsec / 1000000;
}

/* Waits for an event, with the lock held. False after `deadline`. */
static bool wait_event(shim *s, int64_t deadline) {
    const int64_t left = deadline - milliseconds();
    if (left <= 0) {
        return false;
    }
    const struct timespec until = {(time_t)(deadline / 1000), (long)(deadline % 1000) * 1000000};
    pthread_cond_timedwait(&s->event, &s->lock, &until);
    return true;
}

/* ---- callbacks ---- */

static void signal_gone(shim *s) {
    pthread_mutex_lock(&s->lock);
    s->gone = true;
    pthread_cond_broadcast(&s->event);
    pthread_mutex_unlock(&s->lock);
}

static void on_disconnected(void *context, ACameraDevice *device) {
    (void)device;
    signal_gone(context);
}

static void on_error(void *context, ACameraDevice *device, int error) {
    (void)device;
    (void)error;
    signal_gone(context);
}

static void on_session(void *context, ACameraCaptureSession *session) {
    (void)context;
    (void)session;
}

static void on_raw_image(void *context, AImageReader *reader) {
    shim *s = context;
    (void)reader;
    pthread_mutex_lock(&s->lock);
    pthread_cond_broadcast(&s->event);
    pthread_mutex_unlock(&s->lock);
}

/* The stream stops when nobody takes its images. */
static void on_preview_image(void *context, AImageReader *reader) {
    AImage *image = NULL;
    (void)context;
    if (AImageReader_acquireLatestImage(reader, &image) == AMEDIA_OK) {
        AImage_delete(image);
    }
}

static void on_completed(void *context, ACameraCaptureSession *session, ACaptureRequest *request,
                         const ACameraMetadata *result) {
    capture *c = context;
    shim *s = c->owner;
    capture_wire_frame frame;
    (void)session;
    (void)request;
    const bool good = ndk_frame(&frame, result, &s->habits);
    pthread_mutex_lock(&s->lock);
    c->frame = frame;
    c->done = good;
    c->failed = !good;
    pthread_cond_broadcast(&s->event);
    pthread_mutex_unlock(&s->lock);
}

static void signal_failed(capture *c) {
    pthread_mutex_lock(&c->owner->lock);
    c->failed = true;
    pthread_cond_broadcast(&c->owner->event);
    pthread_mutex_unlock(&c->owner->lock);
}

static void on_failed(void *context, ACameraCaptureSession *session, ACaptureRequest *request,
                      ACameraCaptureFailure *failure) {
    (void)session;
    (void)request;
    (void)failure;
    signal_failed(context);
}

static void on_lost(void *context, ACameraCaptureSession *session, ACaptureRequest *request, ANativeWindow *window,
                    int64_t number) {
    (void)session;
    (void)request;
    (void)window;
    (void)number;
    signal_failed(context);
}

static void on_metered(void *context, ACameraCaptureSession *session, ACaptureRequest *request,
                       const ACameraMetadata *result) {
    shim *s = context;
    capture_wire_metered metered;
    ACameraMetadata_const_entry e;
    (void)session;
    (void)request;
    ndk_metered(&metered, result);
    const bool has_af =
        ACameraMetadata_getConstEntry(result, ACAMERA_CONTROL_AF_STATE, &e) == ACAMERA_OK && e.count > 0;
    pthread_mutex_lock(&s->lock);
    s->metered = metered;
    s->af_state = has_af ? e.data.u8[0] : -1;
    s->results++;
    pthread_cond_broadcast(&s->event);
    pthread_mutex_unlock(&s->lock);
}

/* ---- the phone ---- */

/* Callbacks come through Binder's threads, which apps have from their start and other programs must start. The
 * function is in every phone's libbinder_ndk.so, but not in the NDK's. */
static bool start_binder(void) {
    void *library = dlopen("libbinder_ndk.so", RTLD_NOW | RTLD_LOCAL);
    if (library == NULL) {
        return false;
    }
    void *symbol = dlsym(library, "ABinderProcess_startThreadPool");
    void (*start)(void) = NULL;
    if (symbol == NULL) {
        return false;
    }
    memcpy(&start, &symbol, sizeof start);
    start();
    return true; /* the library stays: its threads run on */
}

int shim_create(shim **out, char *why) {
    shim *s = calloc(1, sizeof *s);
    if (s == NULL) {
        return fail(why, CAPTURE_WIRE_FAILED, "no memory left");
    }
    pthread_condattr_t attributes;
    pthread_mutex_init(&s->lock, NULL);
    pthread_condattr_init(&attributes);
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    pthread_cond_init(&s->event, &attributes);
    pthread_condattr_destroy(&attributes);
    for (int i = 0; i < CAPTURES; i++) {
        s->captures[i].owner = s;
    }
    if (!start_binder()) {
        shim_destroy(s);
        return fail(why, CAPTURE_WIRE_FAILED, "this Android has no libbinder_ndk.so that a program can use");
    }
    s->manager = ACameraManager_create();
    if (s->manager == NULL) {
        shim_destroy(s);
        return fail(why, CAPTURE_WIRE_FAILED, "the camera service does not answer");
    }
    *out = s;
    return SHIM_OK;
}

void shim_destroy(shim *s) {
    if (s == NULL) {
        return;
    }
    shim_close(s);
    if (s->manager != NULL) {
        ACameraManager_delete(s->manager);
    }
    pthread_cond_destroy(&s->event);
    pthread_mutex_destroy(&s->lock);
    free(s);
}

/* A property as printable ASCII. */
static void get_property(char *out, size_t size, const char *name, const char *before) {
    char value[PROP_VALUE_MAX] = "";
    __system_property_get(name, value);
    snprintf(out, size, "%s%s", before, value);
    for (char *p = out; *p != '\0'; p++) {
        *p = *p >= ' ' && *p <= '~' ? *p : '?';
    }
}

int shim_describe(shim *s, capture_wire_welcome *out, char *why) {
    ACameraIdList *list = NULL;
    get_property(out->make, sizeof out->make, "ro.product.manufacturer", "");
    get_property(out->model, sizeof out->model, "ro.product.model", "");
    get_property(out->system, sizeof out->system, "ro.build.version.release", "Android ");
    const camera_status_t status = ACameraManager_getCameraIdList(s->manager, &list);
    if (status != ACAMERA_OK) {
        return fail_status(why, status, "listing the cameras");
    }
    out->count = 0;
    for (int i = 0; i < list->numCameras && out->count < CAPTURE_WIRE_CAMERAS; i++) {
        ACameraMetadata *m = NULL;
        if (strlen(list->cameraIds[i]) >= sizeof out->cameras[0].id ||
            ACameraManager_getCameraCharacteristics(s->manager, list->cameraIds[i], &m) != ACAMERA_OK) {
            continue;
        }
        snprintf(out->cameras[out->count].id, sizeof out->cameras[0].id, "%s", list->cameraIds[i]);
        out->cameras[out->count].facing = ndk_facing(m);
        out->cameras[out->count].usable = ndk_usable(m);
        out->cameras[out->count].focal_length = ndk_focal_length(m);
        out->count++;
        ACameraMetadata_free(m);
    }
    ACameraManager_deleteCameraIdList(list);
    return SHIM_OK;
}

/* ---- opening ---- */

static bool set_u8(ACaptureRequest *request, uint32_t tag, uint8_t value) {
    return ACaptureRequest_setEntry_u8(request, tag, 1, &value) == ACAMERA_OK;
}

/* All automatics off. Focus is set by lenses that can. */
static bool set_manual(shim *s, const capture_wire_shoot *shot) {
    const int32_t iso = (int32_t)shot->iso;
    const int64_t frame = shot->exposure > s->camera.frame_min ? shot->exposure : s->camera.frame_min;
    const float focus = (float)s->focus;
    ACaptureRequest *r = s->request;
    return set_u8(r, ACAMERA_CONTROL_MODE, ACAMERA_CONTROL_MODE_OFF) &&
           set_u8(r, ACAMERA_CONTROL_AE_MODE, ACAMERA_CONTROL_AE_MODE_OFF) &&
           set_u8(r, ACAMERA_CONTROL_AF_MODE, ACAMERA_CONTROL_AF_MODE_OFF) &&
           set_u8(r, ACAMERA_CONTROL_AWB_MODE, ACAMERA_CONTROL_AWB_MODE_OFF) &&
           set_u8(r, ACAMERA_FLASH_MODE, ACAMERA_FLASH_MODE_OFF) &&
           ACaptureRequest_setEntry_i64(r, ACAMERA_SENSOR_EXPOSURE_TIME, 1, &shot->exposure) == ACAMERA_OK &&
           ACaptureRequest_setEntry_i32(r, ACAMERA_SENSOR_SENSITIVITY, 1, &iso) == ACAMERA_OK &&
           ACaptureRequest_setEntry_i64(r, ACAMERA_SENSOR_FRAME_DURATION, 1, &frame) == ACAMERA_OK &&
           (s->camera.focus_nearest <= 0 ||
            ACaptureRequest_setEntry_float(r, ACAMERA_LENS_FOCUS_DISTANCE, 1, &focus) == ACAMERA_OK);
}

/* A reader and what ties it to sessions and requests. */
static bool make_output(shim *s, AImageReader **reader, ACaptureSessionOutput **output, ACameraOutputTarget **target,
                        int32_t width, int32_t height, int32_t format, AImageReader_ImageCallback callback) {
    AImageReader_ImageListener listener = {.context = s, .onImageAvailable = callback};
    ANativeWindow *window = NULL;
    return AImageReader_new(width, height, format, 3, reader) == AMEDIA_OK &&
           AImageReader_setImageListener(*reader, &listener) == AMEDIA_OK &&
           AImageReader_getWindow(*reader, &window) == AMEDIA_OK &&
           ACaptureSessionOutput_create(window, output) == ACAMERA_OK &&
           ACaptureSessionOutputContainer_add(s->outputs, *output) == ACAMERA_OK &&
           ACameraOutputTarget_create(window, target) == ACAMERA_OK;
}

static int open_session(shim *s, const char *id, const ndk_sizes *sizes, char *why) {
    ACameraDevice_StateCallbacks device = {.context = s, .onDisconnected = on_disconnected, .onError = on_error};
    const ACameraCaptureSession_stateCallbacks session = {
        .context = s, .onClosed = on_session, .onReady = on_session, .onActive = on_session};
    camera_status_t status = ACameraManager_openCamera(s->manager, id, &device, &s->device);
    if (status != ACAMERA_OK) {
        return fail_status(why, status, "opening the camera");
    }
    if (ACaptureSessionOutputContainer_create(&s->outputs) != ACAMERA_OK ||
        !make_output(s, &s->raw, &s->raw_output, &s->raw_target, sizes->raw_width, sizes->raw_height,
                     AIMAGE_FORMAT_RAW16, on_raw_image) ||
        !make_output(s, &s->preview, &s->preview_output, &s->preview_target, sizes->preview_width,
                     sizes->preview_height, AIMAGE_FORMAT_YUV_420_888, on_preview_image)) {
        return fail(why, CAPTURE_WIRE_FAILED, "the phone does not give buffers for RAW frames");
    }
    status = ACameraDevice_createCaptureSession(s->device, s->outputs, &session, &s->session);
    if (status != ACAMERA_OK) {
        return fail_status(why, status, "starting a session");
    }
    status = ACameraDevice_createCaptureRequest(s->device, TEMPLATE_MANUAL, &s->request);
    if (status == ACAMERA_OK) {
        status = ACaptureRequest_addTarget(s->request, s->raw_target);
    }
    return status == ACAMERA_OK ? SHIM_OK : fail_status(why, status, "preparing a request");
}

int shim_open(shim *s, const char *id, capture_wire_camera *out, char *why) {
    ACameraMetadata *m = NULL;
    ndk_sizes sizes;
    shim_close(s);
    const camera_status_t status = ACameraManager_getCameraCharacteristics(s->manager, id, &m);
    if (status != ACAMERA_OK) {
        return fail_status(why, status, "asking what the camera can do");
    }
    memset(out, 0, sizeof *out);
    const bool usable = ndk_usable(m) && ndk_camera(out, &sizes, &s->habits, m);
    ACameraMetadata_free(m);
    if (!usable) {
        return fail(why, CAPTURE_WIRE_UNSUPPORTED,
                    "this camera does not give RAW frames with exposure time and sensitivity set by hand");
    }
    snprintf(out->id, sizeof out->id, "%s", id);
    s->camera = *out;
    s->focus = 0;
    s->gone = false;
    const int trouble = open_session(s, id, &sizes, why);
    if (trouble != SHIM_OK) {
        shim_close(s);
    }
    return trouble;
}

void shim_close(shim *s) {
    shim_release(s);
    if (s->session != NULL) {
        ACameraCaptureSession_close(s->session);
    }
    if (s->device != NULL) {
        ACameraDevice_close(s->device); /* waits for what is under way, and for callbacks */
    }
    if (s->request != NULL) {
        ACaptureRequest_free(s->request);
    }
    if (s->raw_target != NULL) {
        ACameraOutputTarget_free(s->raw_target);
    }
    if (s->preview_target != NULL) {
        ACameraOutputTarget_free(s->preview_target);
    }
    if (s->outputs != NULL) {
        ACaptureSessionOutputContainer_free(s->outputs);
    }
    if (s->raw_output != NULL) {
        ACaptureSessionOutput_free(s->raw_output);
    }
    if (s->preview_output != NULL) {
        ACaptureSessionOutput_free(s->preview_output);
    }
    if (s->raw != NULL) {
        AImageReader_delete(s->raw);
    }
    if (s->preview != NULL) {
        AImageReader_delete(s->preview);
    }
    s->session = NULL;
    s->device = NULL;
    s->request = NULL;
    s->raw_target = s->preview_target = NULL;
    s->outputs = NULL;
    s->raw_output = s->preview_output = NULL;
    s->raw = s->preview = NULL;
}

/* ---- metering ---- */

/* The automatics, with AF sought or at a distance. `trigger`: begin to seek the focus now. */
static camera_status_t make_metering(shim *s, ACaptureRequest **out, bool seek, bool trigger) {
    const float focus = (float)s->focus;
    camera_status_t status = ACameraDevice_createCaptureRequest(s->device, TEMPLATE_PREVIEW, out);
    if (status != ACAMERA_OK) {
        return status;
    }
    const bool good =
        set_u8(*out, ACAMERA_CONTROL_MODE, ACAMERA_CONTROL_MODE_AUTO) &&
        set_u8(*out, ACAMERA_CONTROL_AE_MODE, ACAMERA_CONTROL_AE_MODE_ON) &&
        set_u8(*out, ACAMERA_CONTROL_AWB_MODE, ACAMERA_CONTROL_AWB_MODE_AUTO) &&
        set_u8(*out, ACAMERA_CONTROL_AF_MODE, seek ? ACAMERA_CONTROL_AF_MODE_AUTO : ACAMERA_CONTROL_AF_MODE_OFF) &&
        set_u8(*out, ACAMERA_CONTROL_AF_TRIGGER,
               trigger ? ACAMERA_CONTROL_AF_TRIGGER_START : ACAMERA_CONTROL_AF_TRIGGER_IDLE) &&
        (seek || s->camera.focus_nearest <= 0 ||
         ACaptureRequest_setEntry_float(*out, ACAMERA_LENS_FOCUS_DISTANCE, 1, &focus) == ACAMERA_OK);
    return good ? ACaptureRequest_addTarget(*out, s->preview_target) : ACAMERA_ERROR_INVALID_PARAMETER;
}

/* Waits until exposure and white balance have settled, or with `focus` until the search for focus has ended. The
 * first results may still be from before the request. */
static void wait_settled(shim *s, bool focus, int64_t deadline) {
    pthread_mutex_lock(&s->lock);
    const uint64_t first = s->results + 3;
    for (;;) {
        const bool settled = focus ? s->af_state == ACAMERA_CONTROL_AF_STATE_FOCUSED_LOCKED ||
                                         s->af_state == ACAMERA_CONTROL_AF_STATE_NOT_FOCUSED_LOCKED
                                   : s->metered.exposed && s->metered.balanced;
        if (s->gone || (settled && s->results >= first) || !wait_event(s, deadline)) {
            break;
        }
    }
    pthread_mutex_unlock(&s->lock);
}

int shim_meter(shim *s, const capture_wire_meter *request, capture_wire_metered *out, char *why) {
    if (s->session == NULL) {
        return fail(why, CAPTURE_WIRE_GONE, "no camera is open");
    }
    const int64_t deadline = milliseconds() + request->limit;
    const bool seek = request->focus < 0 && s->camera.focus_nearest > 0;
    ACameraCaptureSession_captureCallbacks callbacks = {.context = s, .onCaptureCompleted = on_metered};
    ACaptureRequest *repeated = NULL, *trigger = NULL;
    s->focus = request->focus >= 0 ? request->focus : 0;
    pthread_mutex_lock(&s->lock);
    memset(&s->metered, 0, sizeof s->metered);
    s->metered.focus = -1;
    s->af_state = -1;
    pthread_mutex_unlock(&s->lock);
    camera_status_t status = make_metering(s, &repeated, seek, false);
    if (status == ACAMERA_OK) {
        status = ACameraCaptureSession_setRepeatingRequest(s->session, &callbacks, 1, &repeated, NULL);
    }
    if (status == ACAMERA_OK) {
        wait_settled(s, false, seek ? deadline - (int64_t)request->limit / 2 : deadline);
        if (seek && (status = make_metering(s, &trigger, true, true)) == ACAMERA_OK &&
            (status = ACameraCaptureSession_capture(s->session, &callbacks, 1, &trigger, NULL)) == ACAMERA_OK) {
            wait_settled(s, true, deadline);
        }
        const camera_status_t stopped = ACameraCaptureSession_stopRepeating(s->session);
        status = status == ACAMERA_OK ? stopped : status;
    }
    if (repeated != NULL) {
        ACaptureRequest_free(repeated);
    }
    if (trigger != NULL) {
        ACaptureRequest_free(trigger);
    }
    pthread_mutex_lock(&s->lock);
    const bool gone = s->gone;
    *out = s->metered;
    pthread_mutex_unlock(&s->lock);
    if (gone) {
        return fail(why, CAPTURE_WIRE_GONE, "another app took the camera, or it broke down");
    }
    if (status != ACAMERA_OK) {
        return fail_status(why, status, "metering");
    }
    if (seek && out->focus >= 0) {
        s->focus = out->focus < s->camera.focus_nearest ? out->focus : s->camera.focus_nearest;
    }
    out->focused = out->focused || !seek;
    out->focus = s->focus;
    return SHIM_OK;
}

/* ---- shooting ---- */

/* Waits for the result of `c` and the image of the same time stamp. */
static int wait_frame(shim *s, capture *c, capture_wire_frame *out, int64_t deadline, char *why) {
    int trouble = CAPTURE_WIRE_DROPPED;
    pthread_mutex_lock(&s->lock);
    for (;;) {
        AImage *image = NULL;
        int64_t timestamp = -1;
        if (s->gone) {
            trouble = fail(why, CAPTURE_WIRE_GONE, "another app took the camera, or it broke down");
            break;
        }
        if (c->failed) {
            fail(why, trouble, "the camera dropped the frame");
            break;
        }
        if (c->done && AImageReader_acquireNextImage(s->raw, &image) == AMEDIA_OK) {
            if (AImage_getTimestamp(image, &timestamp) == AMEDIA_OK && timestamp == c->frame.timestamp) {
                *out = c->frame;
                s->image = image;
                trouble = SHIM_OK;
                break;
            }
            AImage_delete(image); /* of a request that was given up */
            continue;
        }
        if (!wait_event(s, deadline)) {
            fail(why, trouble, "the camera did not deliver the frame in time");
            break;
        }
    }
    pthread_mutex_unlock(&s->lock);
    return trouble;
}

static int shoot_once(shim *s, capture_wire_frame *out, int64_t deadline, char *why) {
    AImage *stale = NULL;
    while (AImageReader_acquireNextImage(s->raw, &stale) == AMEDIA_OK) {
        AImage_delete(stale);
    }
    capture *c = &s->captures[s->next++ % CAPTURES];
    pthread_mutex_lock(&s->lock);
    c->done = c->failed = false;
    pthread_mutex_unlock(&s->lock);
    ACameraCaptureSession_captureCallbacks callbacks = {
        .context = c, .onCaptureCompleted = on_completed, .onCaptureFailed = on_failed, .onCaptureBufferLost = on_lost};
    const camera_status_t status = ACameraCaptureSession_capture(s->session, &callbacks, 1, &s->request, NULL);
    if (status != ACAMERA_OK) {
        return fail_status(why, status, "asking for a frame");
    }
    const int trouble = wait_frame(s, c, out, deadline, why);
    if (trouble == CAPTURE_WIRE_DROPPED) {
        ACameraCaptureSession_abortCaptures(s->session);
    }
    return trouble;
}

/* Sensors round to whole rows. */
static bool as_asked(const capture_wire_frame *frame, const capture_wire_shoot *request) {
    const int64_t off = frame->exposure - request->exposure, allowed = request->exposure / 20 + 50000;
    return off <= allowed && -off <= allowed && frame->iso * 20 >= request->iso * 19 &&
           frame->iso * 20 <= request->iso * 21;
}

/* Where the image is, and how large. */
static bool map_image(shim *s, capture_wire_frame *out, shim_image *image) {
    int32_t width = 0, height = 0, row = 0, pixel = 0;
    uint8_t *data = NULL;
    int size = 0;
    if (AImage_getWidth(s->image, &width) != AMEDIA_OK || AImage_getHeight(s->image, &height) != AMEDIA_OK ||
        AImage_getPlaneRowStride(s->image, 0, &row) != AMEDIA_OK ||
        AImage_getPlanePixelStride(s->image, 0, &pixel) != AMEDIA_OK ||
        AImage_getPlaneData(s->image, 0, &data, &size) != AMEDIA_OK || data == NULL || width <= 0 || height <= 0 ||
        row <= 0 || pixel != 2 || size <= 0) {
        return false;
    }
    out->width = (uint32_t)width;
    out->height = (uint32_t)height;
    *image = (shim_image){.data = data, .size = (size_t)size, .row_stride = (size_t)row};
    return true;
}

int shim_shoot(shim *s, const capture_wire_shoot *request, capture_wire_frame *out, shim_image *image, char *why) {
    if (s->session == NULL) {
        return fail(why, CAPTURE_WIRE_GONE, "no camera is open");
    }
    shim_release(s);
    if (request->focus >= 0) {
        s->focus = request->focus;
    }
    if (!set_manual(s, request)) {
        return fail(why, CAPTURE_WIRE_FAILED, "the camera does not take settings by hand");
    }
    /* Cameras that are not of hardware level FULL expose the first frames after a change as before. */
    const int64_t deadline = milliseconds() + request->exposure / 1000000 + 9000;
    const int tries = 1 + (s->habits.latency < 0 ? 4 : s->habits.latency < 8 ? s->habits.latency : 8);
    for (int i = 1;; i++) {
        const int trouble = shoot_once(s, out, deadline, why);
        if (trouble != SHIM_OK) {
            return trouble;
        }
        if (as_asked(out, request) || i >= tries ||
            milliseconds() + 2 * request->exposure / 1000000 + 1000 > deadline) {
            break; /* the computer judges what came */
        }
        shim_release(s);
    }
    if (!map_image(s, out, image)) {
        shim_release(s);
        return fail(why, CAPTURE_WIRE_DROPPED, "the frame's buffer cannot be read");
    }
    return SHIM_OK;
}

void shim_release(shim *s) {
    if (s->image != NULL) {
        AImage_delete(s->image);
        s->image = NULL;
    }
}
