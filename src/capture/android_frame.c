/* SPDX-License-Identifier: Apache-2.0 */
/* android_frame.c: see android_frame.h. */
#include <string.h>
#include <strings.h>
#include <time.h>

#include "capture/android_frame.h"
#include "raw/raw.h"

static bool all_zero(const double *v, int n) {
    for (int i = 0; i < n; i++) {
        if (v[i] != 0) {
            return false;
        }
    }
    return true;
}

static void put_colors(brace_frame *f, const capture_android_shot *shot) {
    const capture_wire_camera *camera = shot->camera;
    int slot = 0;
    for (int i = 0; i < 2; i++) {
        const double *m = camera->matrix[i], *c = camera->calibration[i];
        if (camera->illuminant[i] == 0 || all_zero(m, 9)) {
            continue;
        }
        for (int k = 0; k < 9; k++) {
            const double *row = c + k / 3 * 3;
            f->color_matrix[slot][k] =
                all_zero(c, 9) ? m[k] : row[0] * m[k % 3] + row[1] * m[3 + k % 3] + row[2] * m[6 + k % 3];
        }
        f->illuminant[slot++] = camera->illuminant[i];
    }
    const double *neutral = !all_zero(shot->neutral, 3) ? shot->neutral : shot->frame->neutral;
    for (int i = 0; i < 3 && !all_zero(neutral, 3); i++) {
        f->as_shot_neutral[i] = neutral[i] / neutral[1];
    }
}

/* Levels and noise, which are given at the four places of the buffer's filter array. */
static void put_levels(brace_frame *f, const capture_wire_camera *camera, const capture_wire_frame *frame) {
    const double *black = frame->has_black ? frame->black : camera->black;
    f->white = (float)(frame->white != 0 ? frame->white : camera->white);
    for (uint32_t i = 0; i < 4; i++) {
        const uint32_t x = ((i & 1) + camera->left) & 1, y = ((i >> 1) + camera->top) & 1;
        f->black[i] = (float)black[2 * y + x];
        const int color = brace_cfa_color((brace_cfa)camera->cfa, i & 1, i >> 1);
        const double share = color == 1 ? 0.5 : 1;
        f->noise[color][0] += share * frame->noise[i][0];
        f->noise[color][1] += share * frame->noise[i][1];
    }
    f->has_noise = frame->has_noise;
}

/* Camera2: clockwise to upright is the sensor's own orientation plus the phone's, minus it if it looks at its user. */
static int orientation(const capture_wire_camera *camera, int turn) {
    const int by = camera->facing == CAPTURE_WIRE_FRONT ? 360 - turn : turn;
    static const int exif[] = {1, 6, 3, 8};
    return exif[(camera->orientation + by) % 360 / 90];
}

static void put_time(brace_frame *f, int64_t clock) {
    const time_t seconds = (time_t)(clock / 1000000000);
    struct tm t;
    if (clock <= 0 || localtime_r(&seconds, &t) == NULL) {
        return;
    }
    strftime(f->datetime, sizeof f->datetime, "%Y:%m:%d %H:%M:%S", &t);
    snprintf(f->subsec, sizeof f->subsec, "%03d", (int)(clock / 1000000 % 1000));
}

brace_status capture_android_frame(brace_frame **out, const capture_android_shot *shot, brace_error *error) {
    const capture_wire_camera *camera = shot->camera;
    const capture_wire_frame *frame = shot->frame;
    const unsigned cfa = camera->cfa ^ (camera->left & 1) ^ (camera->top & 1) << 1;
    brace_status status = brace_frame_create(out, camera->active_width, camera->active_height, (brace_cfa)cfa, error);
    if (status != BRACE_OK) {
        return status;
    }
    brace_frame *f = *out;
    put_colors(f, shot);
    put_levels(f, camera, frame);
    for (int i = 0; i < 4; i++) {
        if (f->black[i] >= f->white) {
            status = core_fail(error, BRACE_ERROR_FORMAT,
                               "the phone says that black is %g and white %g in one frame, which cannot be",
                               (double)f->black[i], (double)f->white);
            brace_frame_destroy(f);
            *out = NULL;
            return status;
        }
    }
    f->exposure_time = (double)frame->exposure / 1e9;
    f->iso = frame->iso;
    f->f_number = raw_from_float((float)(frame->aperture > 0 ? frame->aperture : camera->aperture));
    f->focal_length = raw_from_float((float)(frame->focal_length > 0 ? frame->focal_length : camera->focal_length));
    f->orientation = orientation(camera, shot->turn);
    put_time(f, frame->clock);
    snprintf(f->make, sizeof f->make, "%s", shot->make);
    snprintf(f->model, sizeof f->model, "%s", shot->model);
    const bool named = strncasecmp(shot->model, shot->make, strlen(shot->make)) == 0;
    snprintf(f->unique_model, sizeof f->unique_model, "%s%s%s", named ? "" : shot->make, named ? "" : " ", shot->model);
    return BRACE_OK;
}

void capture_android_put(brace_frame *frame, const capture_wire_camera *camera, uint32_t offset, const uint8_t *bytes,
                         uint32_t size) {
    uint32_t x = offset / 2 % camera->width, y = offset / 2 / camera->width;
    for (uint32_t i = 0; i + 1 < size; i += 2) {
        if (x >= camera->left && x - camera->left < frame->width && y >= camera->top &&
            y - camera->top < frame->height) {
            frame->data[(size_t)(y - camera->top) * frame->width + (x - camera->left)] =
                (uint16_t)(bytes[i] | bytes[i + 1] << 8);
        }
        if (++x == camera->width) {
            x = 0;
            y++;
        }
    }
}
