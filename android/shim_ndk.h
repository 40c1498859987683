/* SPDX-License-Identifier: Apache-2.0 */
/*
 * shim_ndk.h: Camera2's metadata as the protocol has it. Needs the NDK.
 */
#ifndef ANDROID_SHIM_NDK_H
#define ANDROID_SHIM_NDK_H

#include <camera/NdkCameraMetadata.h>

#include "../src/capture/protocol.h"

/* Sizes that a camera streams. */
typedef struct ndk_sizes {
    int32_t raw_width, raw_height;         /* the largest RAW16; 0: none */
    int32_t preview_width, preview_height; /* the smallest YUV that automatics can judge by; 0: none */
} ndk_sizes;

/* How the camera deals with requests. */
typedef struct ndk_habits {
    int32_t latency;    /* frames until a request's settings count (SYNC_MAX_LATENCY); 0: at once, < 0: unknown */
    bool realtime;      /* time stamps are CLOCK_BOOTTIME, else CLOCK_MONOTONIC */
} ndk_habits;

/* RAW frames of a Bayer sensor, and exposure time and sensitivity by hand. */
bool ndk_usable(const ACameraMetadata *m);
uint8_t ndk_facing(const ACameraMetadata *m);
double ndk_focal_length(const ACameraMetadata *m);

/* False if the camera does not say what a RAW frame cannot be read without. */
bool ndk_camera(capture_wire_camera *out, ndk_sizes *sizes, ndk_habits *habits, const ACameraMetadata *m);

/* The result of a RAW frame, but its size. False if it does not say with which exposure. */
bool ndk_frame(capture_wire_frame *out, const ACameraMetadata *m, const ndk_habits *habits);

/* What the automatics came to, and whether they have settled. */
void ndk_metered(capture_wire_metered *out, const ACameraMetadata *m);

#endif
