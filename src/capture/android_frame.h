/* SPDX-License-Identifier: Apache-2.0 */
/*
 * android_frame.h: what a phone says of a camera and a shot, as a frame of ours.
 * Internal; pure functions.
 */
#ifndef CAPTURE_ANDROID_FRAME_H
#define CAPTURE_ANDROID_FRAME_H

#include "brace/frame.h"
#include "capture/protocol.h"

typedef struct capture_android_shot {
    const char *make, *model;
    const capture_wire_camera *camera;
    const capture_wire_frame *frame;
    const double *neutral; /* found when the bracket began; 0, 0, 0: the frame's own counts */
    int turn;              /* degrees that the phone was turned clockwise from upright: 0, 90, 180, 270 */
} capture_android_shot;

/* A frame of the active area with all metadata and no pixels yet. The tags mean what DNG's of the same name mean
 * (developer.android.com/reference/android/hardware/camera2/CameraCharacteristics), but that CameraCalibration is
 * multiplied into the colour matrices, as our reader of DNGs does. The frame's own neutral counts when none was
 * metered: a phone with white balance off says 1, 1, 1. */
brace_status capture_android_frame(brace_frame **out, const capture_android_shot *shot, brace_error *error);

/* Puts bytes of the phone's buffer, from `offset` on (both even, within the buffer), where they belong in the frame. */
void capture_android_put(brace_frame *frame, const capture_wire_camera *camera, uint32_t offset, const uint8_t *bytes,
                         uint32_t size);

#endif
