/* SPDX-License-Identifier: Apache-2.0 */
/* plane.c: what is measured: one number a pixel, from a RAW frame or from a picture. */
#include <math.h>

#include "banding/banding.h"
#include "image/color.h"
#include "image/image.h"
#include "raw/isp.h"

typedef struct plane_job {
    banding_plane *out;
    const brace_frame *frame;
    const brace_image *image;
    float *scratch; /* `per_worker` for each worker */
    size_t per_worker;
} plane_job;

static void frame_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const plane_job *job = arg;
    const brace_frame *f = job->frame;
    const size_t width = job->out->width;
    float black[4], scale[4];
    for (int c = 0; c < 4; c++)
        black[c] = f->black[c], scale[c] = 0.25f / (f->white - f->black[c]);
    for (size_t y = begin; y < end; y++) {
        const uint16_t *top = f->data + 2 * y * f->width, *bottom = top + f->width;
        for (size_t x = 0; x < width; x++)
            job->out->at[y * width + x] = ((float)top[2 * x] - black[0]) * scale[0] +
                                          ((float)top[2 * x + 1] - black[1]) * scale[1] +
                                          ((float)bottom[2 * x] - black[2]) * scale[2] +
                                          ((float)bottom[2 * x + 1] - black[3]) * scale[3];
    }
}

static brace_status plane_create(banding_plane *out, uint32_t width, uint32_t height, brace_error *error) {
    *out = (banding_plane){width, height, core_alloc((size_t)width * height, sizeof(float))};
    return out->at ? BRACE_OK : core_fail_memory(error, (size_t)width * height * sizeof(float), "a plane");
}

brace_status banding_plane_frame(banding_plane *out, const brace_frame *frame, core_pool *pool, brace_error *error) {
    out->at = NULL;
    brace_status status = raw_check_frame(frame, error);
    if (status == BRACE_OK)
        status = plane_create(out, frame->width / 2, frame->height / 2, error);
    if (status != BRACE_OK)
        return status;
    plane_job job = {.out = out, .frame = frame};
    core_parallel(pool, out->height, 32, frame_rows, &job);
    return BRACE_OK;
}

static void image_rows(void *arg, size_t begin, size_t end, int worker) {
    const plane_job *job = arg;
    const uint32_t width = job->image->width, channels = job->image->channels;
    float *scratch = job->scratch + (size_t)worker * job->per_worker, *row = scratch + 4 * (size_t)width;
    const image_layout layout = {channels == 1 ? 1 : 3, BRACE_SAMPLE_F32, BRACE_TRANSFER_SRGB};
    for (size_t y = begin; y < end; y++) {
        float *out = job->out->at + y * width;
        image_convert_row(row, layout, job->image, (uint32_t)y, scratch);
        for (size_t x = 0; x < width; x++)
            out[x] = channels == 1 ? row[x]
                                   : 0.2126f * row[3 * x] + 0.7152f * row[3 * x + 1] + 0.0722f * row[3 * x + 2];
    }
}

brace_status banding_plane_image(banding_plane *out, const brace_image *image, core_pool *pool, brace_error *error) {
    out->at = NULL;
    brace_status status = image_check(image, error);
    if (status == BRACE_OK)
        status = plane_create(out, image->width, image->height, error);
    if (status != BRACE_OK)
        return status;
    plane_job job = {.out = out, .image = image, .per_worker = 8 * (size_t)image->width};
    job.scratch = core_alloc((size_t)core_pool_threads(pool) * job.per_worker, sizeof(float));
    if (job.scratch)
        core_parallel(pool, image->height, 32, image_rows, &job);
    else
        status = core_fail_memory(error, job.per_worker * sizeof(float), "a plane");
    core_free(job.scratch);
    if (status == BRACE_OK)
        status = banding_plane_check(out->at, out->width, out->height, error);
    if (status != BRACE_OK)
        banding_plane_free(out);
    return status;
}

void banding_plane_free(banding_plane *plane) {
    core_free(plane->at);
    plane->at = NULL;
}

brace_status banding_plane_check(const float *plane, uint32_t width, uint32_t height, brace_error *error) {
    if (!plane || width < 1 || height < 1 || width > BRACE_MAX_SIDE || height > BRACE_MAX_SIDE ||
        (uint64_t)width * height > BRACE_MAX_PIXELS)
        return core_fail(error, BRACE_ERROR_ARGUMENT, "a plane of %u x %u pixels is empty or too large", width, height);
    for (size_t i = 0; i < (size_t)width * height; i++)
        if (!(fabsf(plane[i]) <= 1e9f))
            return core_fail(error, BRACE_ERROR_ARGUMENT, "the pixel at (%zu, %zu) is %s: no picture has that",
                             i % width, i / width, isnan(plane[i]) ? "not a number" : "beyond all limits");
    return BRACE_OK;
}
