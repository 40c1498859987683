/* SPDX-License-Identifier: Apache-2.0 */
/*
 * dng_preview.c: the small picture in a DNG. When none is given the frame is
 * shrunk as a mosaic first, each sample becoming the mean of its colour in a
 * block, and only that little frame is developed: milliseconds for any size.
 */
#include <string.h>

#include "brace/develop.h"
#include "raw/raw.h"

enum { PREVIEW_SIDE = 1024 };

/* A frame `times` smaller each way: sample (2X+i, 2Y+j) is the mean of the samples
 * of that corner in times*times blocks of 2x2. */
static brace_status shrink(brace_frame **out, const brace_frame *f, uint32_t times, brace_error *error) {
    uint32_t w = f->width / (2 * times), h = f->height / (2 * times);
    brace_frame *small = NULL;
    brace_status status = brace_frame_create(&small, 2 * w, 2 * h, f->cfa, error);
    if (status != BRACE_OK) {
        return status;
    }
    memcpy(small->black, f->black, sizeof small->black);
    memcpy(small->as_shot_neutral, f->as_shot_neutral, sizeof small->as_shot_neutral);
    memcpy(small->color_matrix, f->color_matrix, sizeof small->color_matrix);
    memcpy(small->illuminant, f->illuminant, sizeof small->illuminant);
    memcpy(small->noise, f->noise, sizeof small->noise);
    small->white = f->white;
    for (uint32_t y = 0; y < 2 * h; y++) {
        for (uint32_t x = 0; x < 2 * w; x++) {
            uint64_t sum = 0;
            for (uint32_t v = 0; v < times; v++) {
                const uint16_t *row = f->data + (size_t)((y / 2 * times + v) * 2 + (y & 1)) * f->width;
                for (uint32_t u = 0; u < times; u++) {
                    sum += row[(x / 2 * times + u) * 2 + (x & 1)];
                }
            }
            uint64_t n = (uint64_t)times * times;
            small->data[(size_t)y * 2 * w + x] = (uint16_t)((sum + n / 2) / n);
        }
    }
    *out = small;
    return BRACE_OK;
}

static brace_status from_frame(brace_image **out, const brace_frame *frame, const brace_job *job, brace_error *error) {
    const brace_develop_params params = {.sample = BRACE_SAMPLE_U8, .transfer = BRACE_TRANSFER_SRGB, .as_stored = true};
    uint32_t longest = frame->width > frame->height ? frame->width : frame->height;
    uint32_t shortest = frame->width < frame->height ? frame->width : frame->height;
    uint32_t times = (longest + PREVIEW_SIDE - 1) / PREVIEW_SIDE;
    if (shortest / (2 * times) < 2) {
        times = shortest / 4; /* a very long strip */
    }
    /* The little one's steps are its own: it reports no progress. */
    brace_job quiet = {0};
    if (job != NULL) {
        quiet.threads = job->threads;
        quiet.cancel = job->cancel;
    }
    if (times <= 1) {
        return brace_develop(out, frame, &params, &quiet, error);
    }
    brace_frame *small = NULL;
    brace_status status = shrink(&small, frame, times, error);
    if (status == BRACE_OK) {
        status = brace_develop(out, small, &params, &quiet, error);
    }
    brace_frame_destroy(small);
    return status;
}

brace_status raw_dng_preview(brace_image **out, const brace_frame *frame, const brace_image *given,
                             const brace_job *job, brace_error *error) {
    *out = NULL;
    if (given == NULL) {
        return from_frame(out, frame, job, error);
    }
    uint32_t longest = given->width > given->height ? given->width : given->height;
    if (longest <= PREVIEW_SIDE) {
        return brace_image_convert(out, given, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, error);
    }
    uint32_t w = (uint32_t)((uint64_t)given->width * PREVIEW_SIDE / longest);
    uint32_t h = (uint32_t)((uint64_t)given->height * PREVIEW_SIDE / longest);
    brace_image *small = NULL;
    brace_status status = brace_image_resize(&small, given, w > 0 ? w : 1, h > 0 ? h : 1, error);
    if (status == BRACE_OK) {
        status = brace_image_convert(out, small, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, error);
    }
    brace_image_destroy(small);
    return status;
}
