/* SPDX-License-Identifier: Apache-2.0 */
/*
 * shim_ndk_metadata.c: see shim_ndk.h. What the tags mean is in the NDK's
 * NdkCameraMetadataTags.h; their types and counts are checked, because phones
 * differ in what they leave out.
 */
#include "shim_ndk.h"

#include <media/NdkImage.h>
#include <string.h>
#include <time.h>

/* An entry of a type with at least `count` values. */
static bool find(const ACameraMetadata *m, uint32_t tag, uint8_t type, uint32_t count, ACameraMetadata_const_entry *e) {
    memset(e, 0, sizeof *e);
    return ACameraMetadata_getConstEntry(m, tag, e) == ACAMERA_OK && e->type == type && e->count >= count;
}

static int32_t get_u8(const ACameraMetadata *m, uint32_t tag, int32_t otherwise) {
    ACameraMetadata_const_entry e;
    return find(m, tag, ACAMERA_TYPE_BYTE, 1, &e) ? e.data.u8[0] : otherwise;
}

static int32_t get_i32(const ACameraMetadata *m, uint32_t tag, int32_t otherwise) {
    ACameraMetadata_const_entry e;
    return find(m, tag, ACAMERA_TYPE_INT32, 1, &e) ? e.data.i32[0] : otherwise;
}

static int64_t get_i64(const ACameraMetadata *m, uint32_t tag, int64_t otherwise) {
    ACameraMetadata_const_entry e;
    return find(m, tag, ACAMERA_TYPE_INT64, 1, &e) ? e.data.i64[0] : otherwise;
}

static double get_float(const ACameraMetadata *m, uint32_t tag, double otherwise) {
    ACameraMetadata_const_entry e;
    return find(m, tag, ACAMERA_TYPE_FLOAT, 1, &e) ? (double)e.data.f[0] : otherwise;
}

/* Zeros where the phone has none, or a fraction over 0. */
static void get_rationals(double *out, uint32_t count, const ACameraMetadata *m, uint32_t tag) {
    ACameraMetadata_const_entry e;
    memset(out, 0, count * sizeof *out);
    if (!find(m, tag, ACAMERA_TYPE_RATIONAL, count, &e)) {
        return;
    }
    for (uint32_t i = 0; i < count; i++) {
        if (e.data.r[i].denominator == 0) {
            memset(out, 0, count * sizeof *out);
            return;
        }
        out[i] = (double)e.data.r[i].numerator / (double)e.data.r[i].denominator;
    }
}

/* ---- what is constant about a camera ---- */

static bool has_capability(const ACameraMetadata *m, uint8_t wanted) {
    ACameraMetadata_const_entry e;
    if (!find(m, ACAMERA_REQUEST_AVAILABLE_CAPABILITIES, ACAMERA_TYPE_BYTE, 1, &e)) {
        return false;
    }
    return memchr(e.data.u8, wanted, e.count) != NULL;
}

/* Four numbers a stream: format, width, height, and whether it goes into the camera. */
static void get_sizes(ndk_sizes *out, const ACameraMetadata *m) {
    ACameraMetadata_const_entry e;
    memset(out, 0, sizeof *out);
    if (!find(m, ACAMERA_SCALER_AVAILABLE_STREAM_CONFIGURATIONS, ACAMERA_TYPE_INT32, 4, &e)) {
        return;
    }
    for (uint32_t i = 0; i + 4 <= e.count; i += 4) {
        const int32_t format = e.data.i32[i], width = e.data.i32[i + 1], height = e.data.i32[i + 2];
        const int64_t area = (int64_t)width * height;
        if (e.data.i32[i + 3] != ACAMERA_SCALER_AVAILABLE_STREAM_CONFIGURATIONS_OUTPUT || width <= 0 || height <= 0) {
            continue;
        }
        if (format == AIMAGE_FORMAT_RAW16 && area > (int64_t)out->raw_width * out->raw_height) {
            out->raw_width = width;
            out->raw_height = height;
        } else if (format == AIMAGE_FORMAT_YUV_420_888 && width >= 320 &&
                   (out->preview_width == 0 || area < (int64_t)out->preview_width * out->preview_height)) {
            out->preview_width = width;
            out->preview_height = height;
        }
    }
}

bool ndk_usable(const ACameraMetadata *m) {
    ndk_sizes sizes;
    get_sizes(&sizes, m);
    return has_capability(m, ACAMERA_REQUEST_AVAILABLE_CAPABILITIES_RAW) &&
           has_capability(m, ACAMERA_REQUEST_AVAILABLE_CAPABILITIES_MANUAL_SENSOR) && sizes.raw_width > 0 &&
           sizes.preview_width > 0 &&
           get_u8(m, ACAMERA_SENSOR_INFO_COLOR_FILTER_ARRANGEMENT, 255) <=
               ACAMERA_SENSOR_INFO_COLOR_FILTER_ARRANGEMENT_BGGR;
}

uint8_t ndk_facing(const ACameraMetadata *m) {
    switch (get_u8(m, ACAMERA_LENS_FACING, ACAMERA_LENS_FACING_EXTERNAL)) {
    case ACAMERA_LENS_FACING_FRONT:
        return CAPTURE_WIRE_FRONT;
    case ACAMERA_LENS_FACING_BACK:
        return CAPTURE_WIRE_BACK;
    default:
        return CAPTURE_WIRE_EXTERNAL;
    }
}

double ndk_focal_length(const ACameraMetadata *m) {
    return get_float(m, ACAMERA_LENS_INFO_AVAILABLE_FOCAL_LENGTHS, 0);
}

/* A RAW buffer holds either the whole pixel array or the active part of it. */
static void get_area(capture_wire_camera *out, const ndk_sizes *sizes, const ACameraMetadata *m) {
    ACameraMetadata_const_entry pixels, active;
    out->width = (uint32_t)sizes->raw_width;
    out->height = (uint32_t)sizes->raw_height;
    out->left = out->top = 0;
    out->active_width = out->width;
    out->active_height = out->height;
    if (!find(m, ACAMERA_SENSOR_INFO_PIXEL_ARRAY_SIZE, ACAMERA_TYPE_INT32, 2, &pixels) ||
        !find(m, ACAMERA_SENSOR_INFO_PRE_CORRECTION_ACTIVE_ARRAY_SIZE, ACAMERA_TYPE_INT32, 4, &active)) {
        return;
    }
    const int32_t *a = active.data.i32; /* left, top, width, height */
    if (pixels.data.i32[0] == sizes->raw_width && pixels.data.i32[1] == sizes->raw_height && a[0] >= 0 && a[1] >= 0 &&
        a[2] > 0 && a[3] > 0 && a[2] <= sizes->raw_width - a[0] && a[3] <= sizes->raw_height - a[1]) {
        out->left = (uint32_t)a[0];
        out->top = (uint32_t)a[1];
        out->active_width = (uint32_t)a[2];
        out->active_height = (uint32_t)a[3];
    }
}

/* Nanoseconds between RAW16 frames of that size: four numbers a stream here too. */
static int64_t get_frame_min(const ndk_sizes *sizes, const ACameraMetadata *m) {
    ACameraMetadata_const_entry e;
    if (find(m, ACAMERA_SCALER_AVAILABLE_MIN_FRAME_DURATIONS, ACAMERA_TYPE_INT64, 4, &e)) {
        for (uint32_t i = 0; i + 4 <= e.count; i += 4) {
            const int64_t *v = e.data.i64 + i;
            if (v[0] == AIMAGE_FORMAT_RAW16 && v[1] == sizes->raw_width && v[2] == sizes->raw_height && v[3] >= 0) {
                return v[3];
            }
        }
    }
    return 0;
}

bool ndk_camera(capture_wire_camera *out, ndk_sizes *sizes, ndk_habits *habits, const ACameraMetadata *m) {
    ACameraMetadata_const_entry exposure, iso, black;
    get_sizes(sizes, m);
    get_area(out, sizes, m);
    out->facing = ndk_facing(m);
    out->cfa = (uint8_t)get_u8(m, ACAMERA_SENSOR_INFO_COLOR_FILTER_ARRANGEMENT, 255);
    out->white = (uint32_t)get_i32(m, ACAMERA_SENSOR_INFO_WHITE_LEVEL, 0);
    if (!find(m, ACAMERA_SENSOR_BLACK_LEVEL_PATTERN, ACAMERA_TYPE_INT32, 4, &black) ||
        !find(m, ACAMERA_SENSOR_INFO_EXPOSURE_TIME_RANGE, ACAMERA_TYPE_INT64, 2, &exposure) ||
        !find(m, ACAMERA_SENSOR_INFO_SENSITIVITY_RANGE, ACAMERA_TYPE_INT32, 2, &iso)) {
        return false;
    }
    for (int i = 0; i < 4; i++) {
        out->black[i] = black.data.i32[i];
    }
    out->exposure_min = exposure.data.i64[0];
    out->exposure_max = exposure.data.i64[1];
    out->iso_min = (uint32_t)iso.data.i32[0];
    out->iso_max = (uint32_t)iso.data.i32[1];
    out->frame_min = get_frame_min(sizes, m);
    get_rationals(out->matrix[0], 9, m, ACAMERA_SENSOR_COLOR_TRANSFORM1);
    get_rationals(out->matrix[1], 9, m, ACAMERA_SENSOR_COLOR_TRANSFORM2);
    get_rationals(out->calibration[0], 9, m, ACAMERA_SENSOR_CALIBRATION_TRANSFORM1);
    get_rationals(out->calibration[1], 9, m, ACAMERA_SENSOR_CALIBRATION_TRANSFORM2);
    out->illuminant[0] = (uint8_t)get_u8(m, ACAMERA_SENSOR_REFERENCE_ILLUMINANT1, 0);
    out->illuminant[1] = (uint8_t)get_u8(m, ACAMERA_SENSOR_REFERENCE_ILLUMINANT2, 0);
    const int32_t turn = get_i32(m, ACAMERA_SENSOR_ORIENTATION, 0);
    out->orientation = (uint16_t)(turn >= 0 ? turn % 360 : 0);
    out->aperture = get_float(m, ACAMERA_LENS_INFO_AVAILABLE_APERTURES, 0);
    out->focal_length = ndk_focal_length(m);
    out->focus_nearest = get_float(m, ACAMERA_LENS_INFO_MINIMUM_FOCUS_DISTANCE, 0);
    habits->latency = get_i32(m, ACAMERA_SYNC_MAX_LATENCY, ACAMERA_SYNC_MAX_LATENCY_UNKNOWN);
    habits->realtime = get_u8(m, ACAMERA_SENSOR_INFO_TIMESTAMP_SOURCE, ACAMERA_SENSOR_INFO_TIMESTAMP_SOURCE_UNKNOWN) ==
                       ACAMERA_SENSOR_INFO_TIMESTAMP_SOURCE_REALTIME;
    return true;
}

/* ---- frames ---- */

static int64_t nanoseconds(clockid_t clock) {
    struct timespec t = {0, 0};
    clock_gettime(clock, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

bool ndk_frame(capture_wire_frame *out, const ACameraMetadata *m, const ndk_habits *habits) {
    ACameraMetadata_const_entry e;
    memset(out, 0, sizeof *out);
    out->exposure = get_i64(m, ACAMERA_SENSOR_EXPOSURE_TIME, 0);
    const int32_t iso = get_i32(m, ACAMERA_SENSOR_SENSITIVITY, 0);
    out->timestamp = get_i64(m, ACAMERA_SENSOR_TIMESTAMP, -1);
    if (out->exposure <= 0 || iso <= 0 || out->timestamp < 0) {
        return false;
    }
    out->iso = (uint32_t)iso;
    const int64_t age = nanoseconds(habits->realtime ? CLOCK_BOOTTIME : CLOCK_MONOTONIC) - out->timestamp;
    if (age >= 0 && age < 3600000000000) { /* else it is of another clock than it says */
        out->clock = nanoseconds(CLOCK_REALTIME) - age;
    }
    out->skew = get_i64(m, ACAMERA_SENSOR_ROLLING_SHUTTER_SKEW, 0);
    get_rationals(out->neutral, 3, m, ACAMERA_SENSOR_NEUTRAL_COLOR_POINT);
    if (find(m, ACAMERA_SENSOR_DYNAMIC_BLACK_LEVEL, ACAMERA_TYPE_FLOAT, 4, &e)) {
        out->has_black = true;
        for (int i = 0; i < 4; i++) {
            out->black[i] = (double)e.data.f[i];
        }
    }
    const int32_t white = get_i32(m, ACAMERA_SENSOR_DYNAMIC_WHITE_LEVEL, 0);
    out->white = white > 0 && white <= 65535 ? (uint32_t)white : 0;
    if (find(m, ACAMERA_SENSOR_NOISE_PROFILE, ACAMERA_TYPE_DOUBLE, 8, &e)) {
        out->has_noise = true;
        memcpy(out->noise, e.data.d, sizeof out->noise);
    }
    out->aperture = get_float(m, ACAMERA_LENS_APERTURE, 0);
    out->focal_length = get_float(m, ACAMERA_LENS_FOCAL_LENGTH, 0);
    out->focus = get_float(m, ACAMERA_LENS_FOCUS_DISTANCE, -1);
    return true;
}

void ndk_metered(capture_wire_metered *out, const ACameraMetadata *m) {
    memset(out, 0, sizeof *out);
    const int64_t exposure = get_i64(m, ACAMERA_SENSOR_EXPOSURE_TIME, 0);
    const int32_t iso = get_i32(m, ACAMERA_SENSOR_SENSITIVITY, 0);
    out->exposure = exposure > 0 ? exposure : 0;
    out->iso = iso > 0 ? (uint32_t)iso : 0;
    out->focus = get_float(m, ACAMERA_LENS_FOCUS_DISTANCE, -1);
    get_rationals(out->neutral, 3, m, ACAMERA_SENSOR_NEUTRAL_COLOR_POINT);
    for (int i = 0; i < 3; i++) {
        if (!(out->neutral[i] >= 1e-3 && out->neutral[i] <= 1e3)) {
            memset(out->neutral, 0, sizeof out->neutral);
        }
    }
    switch (get_u8(m, ACAMERA_CONTROL_AE_STATE, ACAMERA_CONTROL_AE_STATE_INACTIVE)) {
    case ACAMERA_CONTROL_AE_STATE_CONVERGED:
    case ACAMERA_CONTROL_AE_STATE_LOCKED:
    case ACAMERA_CONTROL_AE_STATE_FLASH_REQUIRED: /* settled, and would like more light */
        out->exposed = true;
        break;
    default:
        break;
    }
    const int32_t awb = get_u8(m, ACAMERA_CONTROL_AWB_STATE, ACAMERA_CONTROL_AWB_STATE_INACTIVE);
    out->balanced = awb == ACAMERA_CONTROL_AWB_STATE_CONVERGED || awb == ACAMERA_CONTROL_AWB_STATE_LOCKED;
    out->focused = get_u8(m, ACAMERA_CONTROL_AF_STATE, ACAMERA_CONTROL_AF_STATE_INACTIVE) ==
                   ACAMERA_CONTROL_AF_STATE_FOCUSED_LOCKED;
}
