/* SPDX-License-Identifier: Apache-2.0 */
/*
 * average.c: the mean of several RAW frames, as one frame of n times the
 * exposure time at an n-th of the ISO, which is what it is worth: the same signal,
 * light of n exposures, variance divided by n.
 */
#include <math.h>
#include <string.h>

#include "capture/capture.h"

struct capture_average {
    brace_frame *first; /* metadata, black and white of all */
    uint64_t count;
    double seconds;
    uint32_t *sum;
};

void capture_average_destroy(capture_average *a) {
    if (a == NULL)
        return;
    brace_frame_destroy(a->first);
    core_free(a->sum);
    core_free(a);
}

static bool alike(const brace_frame *a, const brace_frame *b) {
    return a->width == b->width && a->height == b->height && a->cfa == b->cfa && a->white == b->white &&
           memcmp(a->black, b->black, sizeof a->black) == 0 && strcmp(a->make, b->make) == 0 &&
           strcmp(a->model, b->model) == 0 && fabs(log2(a->exposure_time / b->exposure_time)) < 0.05 &&
           fabs(log2(a->iso / b->iso)) < 0.05;
}

brace_status capture_average_add(capture_average **average, const brace_frame *frame, brace_error *error) {
    capture_average *a = *average;
    const size_t n = (size_t)frame->width * frame->height;
    if (a == NULL) {
        if (!(frame->exposure_time > 0) || !(frame->iso > 0))
            return core_fail(error, BRACE_ERROR_MISMATCH, "%s records no exposure time or no ISO", frame->path);
        a = core_calloc(1, sizeof *a);
        if (a == NULL || (a->sum = core_calloc(n, sizeof *a->sum)) == NULL) {
            core_free(a);
            return core_fail_memory(error, n * sizeof *a->sum, "the sum of frames");
        }
        brace_status status = brace_frame_clone(&a->first, frame, error);
        if (status != BRACE_OK) {
            capture_average_destroy(a);
            return status;
        }
        *average = a;
    } else if (!alike(a->first, frame)) {
        return core_fail(error, BRACE_ERROR_MISMATCH,
                         "%s has another camera, size, black or white level, or exposure than %s: they have no mean",
                         frame->path, a->first->path);
    } else if (a->count == UINT16_MAX) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%d frames are the most that are averaged", UINT16_MAX);
    }
    for (size_t i = 0; i < n; i++)
        a->sum[i] += frame->data[i];
    a->count++;
    a->seconds += frame->exposure_time;
    return BRACE_OK;
}

brace_status capture_average_finish(brace_frame **out, const capture_average *a, brace_error *error) {
    brace_status status = brace_frame_clone(out, a->first, error);
    if (status != BRACE_OK)
        return status;
    brace_frame *f = *out;
    const size_t n = (size_t)f->width * f->height;
    /* As many fractions of a raw unit as 16 bits hold, but no more than there are. Values above the white level clip
     * alike in all frames, and stay clipped. */
    uint64_t scale = (uint64_t)(65535 / f->white);
    scale = scale < 1 ? 1 : scale > a->count ? a->count : scale;
    for (size_t i = 0; i < n; i++) {
        const uint64_t mean = (a->sum[i] * scale + a->count / 2) / a->count;
        f->data[i] = (uint16_t)(mean < 65535 ? mean : 65535);
    }
    for (int i = 0; i < 4; i++)
        f->black[i] *= (float)scale;
    f->white *= (float)scale;
    f->exposure_time = a->seconds;
    f->iso /= (double)a->count;
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 2; k++)
            f->noise[c][k] /= (double)a->count;
    return BRACE_OK;
}
