/* SPDX-License-Identifier: Apache-2.0 */
/*
 * shim.h: the camera calls that the program on the phone makes, and nothing
 * else: shim_ndk.c makes them of Camera2 and AImageReader, the tests' shim_fake.c of
 * a computed scene. Everything that can be decided without a camera is in server.c.
 *
 * A function that fails returns the kind of trouble and puts a sentence of
 * printable ASCII into `why` (SHIM_WHY bytes).
 *
 * Thread safety: one thread.
 */
#ifndef ANDROID_SHIM_H
#define ANDROID_SHIM_H

#include "../src/capture/protocol.h"

enum {
    SHIM_WHY = 200,
    SHIM_OK = -1 /* else one of capture_wire_trouble */
};

typedef struct shim shim;

/* A frame as the camera left it. */
typedef struct shim_image {
    const uint8_t *data; /* the phone's own byte order: 16 bits a pixel */
    size_t size;         /* bytes that can be read there */
    size_t row_stride;   /* bytes from one row to the next */
} shim_image;

int shim_create(shim **out, char *why);
void shim_destroy(shim *s); /* NULL is allowed */

/* Who the phone is, and its cameras. */
int shim_describe(shim *s, capture_wire_welcome *out, char *why);

/* Opens camera `id` for RAW frames with all automatics off. One at a time. */
int shim_open(shim *s, const char *id, capture_wire_camera *out, char *why);
void shim_close(shim *s); /* the camera, if one is open */

/* Lets the phone's own automatics settle, and says what they came to. Returns within request->limit and a second. */
int shim_meter(shim *s, const capture_wire_meter *request, capture_wire_metered *out, char *why);

/* One frame. Returns within the exposure and ten seconds. *image is good until shim_release, which follows every
 * shim_shoot that did not fail. */
int shim_shoot(shim *s, const capture_wire_shoot *request, capture_wire_frame *out, shim_image *image, char *why);
void shim_release(shim *s);

#endif
