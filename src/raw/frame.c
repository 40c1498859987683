/* SPDX-License-Identifier: Apache-2.0 */
/*
 * frame.c: making, copying and freeing frames, and the colour of each pixel.
 */
#include <string.h>

#include "raw/raw.h"

brace_status brace_frame_create(brace_frame **out, uint32_t width, uint32_t height, brace_cfa cfa, brace_error *error) {
    if (out == NULL) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "no place to put the frame was given");
    }
    *out = NULL;
    if (width < 4 || height < 4 || width > BRACE_MAX_SIDE || height > BRACE_MAX_SIDE ||
        (uint64_t)width * height > BRACE_MAX_PIXELS) {
        return core_fail(error, BRACE_ERROR_ARGUMENT,
                         "a frame of %u x %u pixels: sides must be 4 to %u and no more than %u million pixels in all",
                         width, height, BRACE_MAX_SIDE, BRACE_MAX_PIXELS / 1000000u);
    }
    if ((int)cfa < BRACE_CFA_RGGB || (int)cfa > BRACE_CFA_BGGR) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "colour filter order %d is not one of the four of Bayer",
                         (int)cfa);
    }
    brace_frame *frame = core_calloc(1, sizeof *frame);
    if (frame == NULL) {
        return core_fail_memory(error, sizeof *frame, "a frame");
    }
    size_t count = (size_t)width * height;
    frame->data = core_calloc(count, sizeof *frame->data);
    frame->path = core_strdup("");
    if (frame->data == NULL || frame->path == NULL) {
        brace_frame_destroy(frame);
        return core_fail_memory(error, count * sizeof *frame->data, "the pixels of a frame");
    }
    frame->width = width;
    frame->height = height;
    frame->cfa = cfa;
    frame->white = 65535.0f;
    frame->as_shot_neutral[0] = frame->as_shot_neutral[1] = frame->as_shot_neutral[2] = 1.0;
    frame->orientation = 1;
    *out = frame;
    return BRACE_OK;
}

brace_status brace_frame_clone(brace_frame **out, const brace_frame *frame, brace_error *error) {
    if (out == NULL || frame == NULL) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "a frame to copy and a place to put it are needed");
    }
    brace_frame *copy = NULL;
    brace_status status = brace_frame_create(&copy, frame->width, frame->height, frame->cfa, error);
    if (status != BRACE_OK) {
        return status;
    }
    uint16_t *data = copy->data;
    core_free(copy->path);
    *copy = *frame;
    copy->data = data;
    copy->path = core_strdup(frame->path != NULL ? frame->path : "");
    copy->tags = frame->tags != NULL ? raw_tags_clone(frame->tags) : NULL;
    if (copy->path == NULL || (frame->tags != NULL && copy->tags == NULL)) {
        brace_frame_destroy(copy);
        return core_fail_memory(error, frame->tags != NULL ? frame->tags->bytes : 1, "the metadata of a frame");
    }
    memcpy(data, frame->data, (size_t)frame->width * frame->height * sizeof *data);
    *out = copy;
    return BRACE_OK;
}

void brace_frame_destroy(brace_frame *frame) {
    if (frame == NULL) {
        return;
    }
    core_free(frame->data);
    core_free(frame->path);
    raw_tags_destroy(frame->tags);
    core_free(frame);
}

int brace_cfa_color(brace_cfa cfa, uint32_t x, uint32_t y) {
    /* Bit 0 of the order says that red's column is the second, bit 1 that its row is. */
    unsigned u = (x ^ (unsigned)cfa) & 1u;
    unsigned v = (y ^ ((unsigned)cfa >> 1)) & 1u;
    return (int)(u + v);
}

const char *brace_cfa_name(brace_cfa cfa) {
    static const char *const names[] = {"RGGB", "GRBG", "GBRG", "BGGR"};
    return (int)cfa >= BRACE_CFA_RGGB && (int)cfa <= BRACE_CFA_BGGR ? names[cfa] : "unknown";
}
