/* SPDX-License-Identifier: Apache-2.0 */
/* pack.c: mosaic to packed picture and back. */
#include <stdlib.h>

#include "restore/internal.h"

brace_status restore_picture_create(restore_picture *out, size_t width, size_t height, const char *what,
                                    brace_error *error) {
    *out = (restore_picture){width, height, core_alloc(width * height, sizeof(v4))};
    return out->at ? BRACE_OK : core_fail_memory(error, width * height * sizeof(v4), what);
}

void restore_picture_free(restore_picture *picture) {
    core_free(picture->at);
    picture->at = NULL;
}

typedef struct pack_job {
    restore_picture *picture;
    const brace_frame *frame;
    float *mosaic;
} pack_job;

/* The nearest position inside [0, n) with the same parity. */
static size_t pack_inside(size_t i, size_t n) {
    return i < n ? i : i - 2;
}

static void pack_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const pack_job *job = arg;
    const brace_frame *f = job->frame;
    v4 black, scale;
    for (int c = 0; c < 4; c++) {
        black[c] = f->black[c];
        scale[c] = 1.0f / (f->white - f->black[c]);
    }
    for (size_t y = begin; y < end; y++) {
        const uint16_t *top = f->data + 2 * y * f->width;
        const uint16_t *bottom = f->data + pack_inside(2 * y + 1, f->height) * f->width;
        v4 *out = job->picture->at + y * job->picture->width;
        for (size_t x = 0; x < job->picture->width; x++) {
            size_t a = 2 * x, b = pack_inside(2 * x + 1, f->width);
            out[x] = ((v4){(float)top[a], (float)top[b], (float)bottom[a], (float)bottom[b]} - black) * scale;
        }
    }
}

void restore_pack(restore_picture *out, const brace_frame *frame, core_pool *pool) {
    pack_job job = {out, frame, NULL};
    core_parallel(pool, out->height, 32, pack_rows, &job);
}

static void unpack_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const pack_job *job = arg;
    size_t width = job->frame->width, height = job->frame->height;
    for (size_t y = begin; y < end; y++) {
        const v4 *in = job->picture->at + y * job->picture->width;
        for (size_t row = 0; row < 2 && 2 * y + row < height; row++) {
            float *out = job->mosaic + (2 * y + row) * width;
            for (size_t x = 0; x < width; x++)
                out[x] = in[x / 2][2 * row + (x & 1)];
        }
    }
}

void restore_unpack(float *mosaic, const brace_frame *frame, const restore_picture *picture, core_pool *pool) {
    pack_job job = {(restore_picture *)picture, frame, mosaic};
    core_parallel(pool, picture->height, 32, unpack_rows, &job);
}
