/* SPDX-License-Identifier: Apache-2.0 */
/* sample.c: from a bracket to what a network is shown of it. */
#include "train/sample.h"

#include <math.h>
#include <string.h>

#include "brace/banding.h"
#include "brace/develop.h"

void train_bracket_set(train_bracket *b, int index, const brace_frame *f) {
    train_view *view = index < 0 ? &b->truth : &b->frame[index];
    *view = (train_view){.data = f->data, .cfa = f->cfa, .white = f->white};
    memcpy(view->black, f->black, sizeof view->black);
    if (index < 0) {
        return;
    }
    b->width = f->width, b->height = f->height;
    b->seen[index] = *f;
    b->seen[index].path = NULL, b->seen[index].tags = NULL;
    b->exposure[index] = f->exposure_time * f->iso;
    memcpy(b->neutral, f->as_shot_neutral, sizeof b->neutral);
    memcpy(b->color_matrix, f->color_matrix, sizeof b->color_matrix);
    memcpy(b->illuminant, f->illuminant, sizeof b->illuminant);
}

static brace_status check_view(const train_view *v, const train_bracket *b, brace_error *error) {
    if ((int)v->cfa < BRACE_CFA_RGGB || v->cfa > BRACE_CFA_BGGR || v->cfa != b->frame[0].cfa) {
        return core_fail(error, BRACE_ERROR_MISMATCH, "its frames have different orders of colours");
    }
    for (int i = 0; i < 4; i++) {
        if (!(v->black[i] >= 0 && v->black[i] < v->white && v->white <= 65535)) {
            return core_fail(error, BRACE_ERROR_FORMAT, "black %g and white %g are no levels", (double)v->black[i],
                             (double)v->white);
        }
    }
    return BRACE_OK;
}

brace_status train_bracket_finish(train_bracket *b, brace_error *error) {
    if (b->count < BRACE_BRACKET_MIN || b->count > BRACE_BRACKET_MAX) {
        return core_fail(error, BRACE_ERROR_FORMAT, "a bracket has %d to %d frames, not %d", BRACE_BRACKET_MIN,
                         BRACE_BRACKET_MAX, b->count);
    }
    b->reference = (b->count - 1) / 2;
    brace_status status = check_view(&b->truth, b, error);
    b->truth.gain = 1;
    for (int i = 0; i < b->count && status == BRACE_OK; i++) {
        status = check_view(&b->frame[i], b, error);
        const double gain = b->exposure[b->reference] / b->exposure[i];
        if (status == BRACE_OK && !(b->exposure[i] > 0 && gain > 1e-6 && gain < 1e6)) {
            status = core_fail(error, BRACE_ERROR_FORMAT, "the exposure of frame %d is %g", i + 1, b->exposure[i]);
        }
        if (status == BRACE_OK && i > 0 && b->exposure[i] <= b->exposure[i - 1]) {
            status = core_fail(error, BRACE_ERROR_FORMAT, "frame %d is not exposed longer than frame %d", i + 1, i);
        }
        b->frame[i].gain = (float)gain;
    }
    return status;
}

brace_status train_bracket_align(train_bracket *b, const volatile int *cancel, brace_error *error) {
    const brace_frame *frames[BRACE_BRACKET_MAX];
    core_pool *pool = NULL;
    for (int i = 0; i < b->count; i++) {
        frames[i] = &b->seen[i];
    }
    const brace_job job = {.threads = 1, .cancel = cancel};
    brace_status status = core_pool_create(&pool, &job, error);
    if (status == BRACE_OK) {
        status = restore_motions(b->motion, frames, (size_t)b->count, (size_t)b->reference, pool, &job, error);
    }
    core_pool_destroy(pool);
    b->aligned = status == BRACE_OK;
    return status;
}

static const float guide_most = 16;

uint16_t train_guide_code(float light) {
    const float x = light > 0 ? light / guide_most : 0;
    return (uint16_t)(x < 1 ? powf(x, 1 / 2.2f) * 65535 + 0.5f : 65535);
}

float train_guide_light(uint16_t code) {
    return guide_most * powf((float)code / 65535, 2.2f);
}

static const float sigma_least = RESTORE_SIGMA_LEAST, sigma_step = 0.03f; /* up to 1.05 */

uint8_t train_sigma_code(float sigma) {
    const float x = sigma > sigma_least ? logf(sigma / sigma_least) / sigma_step + 0.5f : 0;
    return (uint8_t)(x < 255 ? x : 255);
}

float train_sigma_value(uint8_t code) {
    return sigma_least * expf(sigma_step * (float)code);
}

brace_status train_bracket_merge(const train_bracket *b, uint16_t *guide, uint8_t *sigma,
                                 const volatile int *cancel, brace_error *error) {
    const size_t pixels = (size_t)b->width * b->height;
    brace_frame *frames[BRACE_BRACKET_MAX];
    double exposure[BRACE_BRACKET_MAX];
    const brace_bracket bracket = {.count = (size_t)b->count, .reference = (size_t)b->reference, .frames = frames,
                                   .exposure = exposure};
    brace_restore_report report = {0};
    core_pool *pool = NULL;
    const brace_job job = {.threads = 1, .cancel = cancel};
    for (int i = 0; i < b->count; i++) {
        frames[i] = (brace_frame *)(uintptr_t)&b->seen[i]; /* only read */
        exposure[i] = b->exposure[i] / b->exposure[b->reference];
    }
    float *mosaic = core_alloc(2 * pixels, sizeof *mosaic);
    brace_status status = mosaic != NULL ? core_pool_create(&pool, &job, error)
                                         : core_fail_memory(error, pixels * sizeof *mosaic, "the merged picture");
    if (status == BRACE_OK) {
        status = restore_merge(mosaic, mosaic + pixels, &report, &bracket, b->motion, &job, pool, error);
    }
    for (size_t i = 0; i < pixels && status == BRACE_OK; i++) {
        guide[i] = train_guide_code(mosaic[i]);
        sigma[i] = train_sigma_code(mosaic[pixels + i]);
    }
    core_pool_destroy(pool);
    core_free(mosaic);
    return status;
}

brace_status train_sample_create(train_sample *out, int frames, int side, brace_error *error) {
    const size_t pixels = (size_t)side * (size_t)side;
    *out = (train_sample){.frames = frames, .side = side};
    out->input = core_calloc((size_t)frames * pixels * 8, sizeof *out->input);
    out->flow = core_calloc((size_t)frames * pixels * 2, sizeof *out->flow);
    out->truth = core_calloc(pixels * 4, sizeof *out->truth);
    out->sigma = core_calloc(pixels * 4, sizeof *out->sigma);
    brace_status status =
        out->input != NULL && out->flow != NULL && out->truth != NULL && out->sigma != NULL
            ? brace_frame_create(&out->look, 2 * (uint32_t)side, 2 * (uint32_t)side, BRACE_CFA_RGGB, error)
            : core_fail_memory(error, (size_t)frames * pixels * 40, "a training sample");
    if (status != BRACE_OK) {
        train_sample_free(out);
    }
    return status;
}

void train_sample_free(train_sample *sample) {
    core_free(sample->input);
    core_free(sample->flow);
    core_free(sample->truth);
    core_free(sample->sigma);
    brace_frame_destroy(sample->look);
    *sample = (train_sample){0};
}

static brace_status set_color(train_sample *out, const train_bracket *b, brace_error *error) {
    memcpy(out->look->as_shot_neutral, b->neutral, sizeof b->neutral);
    memcpy(out->look->color_matrix, b->color_matrix, sizeof b->color_matrix);
    memcpy(out->look->illuminant, b->illuminant, sizeof b->illuminant);
    out->look->white = 1;
    brace_color color;
    brace_status status = brace_color_init(&color, out->look, error);
    for (int i = 0; i < 9 && status == BRACE_OK; i++) {
        out->gains[i % 3] = (float)color.wb[i % 3];
        out->matrix[3 * (i % 3) + i / 3] = (float)color.camera_to_srgb[i];
    }
    return status;
}

/* A frame's crop as the network's input, and its prior; room for the plane lies behind it. */
static brace_status show(train_sample *out, int at, float *packed, bool shortest, brace_error *error) {
    const size_t pixels = (size_t)out->side * (size_t)out->side;
    const brace_job alone = {.threads = 1};
    float *to = out->input + (size_t)at * pixels * 8, *plane = packed + 4 * pixels;
    for (size_t k = 0; k < pixels * 4; k++) {
        to[2 * k] = packed[k];
        to[2 * k + 1] = packed[k] > 0 ? powf(packed[k], 1 / 2.2f) : 0;
    }
    brace_fabp prior;
    for (size_t i = 0; i < pixels; i++) {
        plane[i] = 0.25f * (packed[4 * i] + packed[4 * i + 1] + packed[4 * i + 2] + packed[4 * i + 3]);
    }
    brace_status status =
        brace_fabp_plane(&prior, plane, (uint32_t)out->side, (uint32_t)out->side, NULL, &alone, error);
    if (status == BRACE_OK) {
        memcpy(out->descriptor[at], prior.descriptor, sizeof prior.descriptor);
        out->rho[at] = (float)prior.rho;
        if (shortest) {
            out->direction = brace_fabp_direction(&prior, 1);
        }
    }
    return status;
}

/* The motion of the crop's pixels, turned as the crop is. */
static void set_flow(float *out, const restore_motion *motion, const train_bracket *b, const train_window *w,
                     int side) {
    const size_t width = (b->width + 1) / 2, height = (b->height + 1) / 2;
    const double sign_x = w->flip_x ? -1 : 1, sign_y = w->flip_y ? -1 : 1;
    /* The block's centre, packed: half a mosaic pixel before that of a block at an even position. */
    const double x0 = 0.5 * ((double)w->x0 - (w->flip_x ? 1 : 0)), y0 = 0.5 * ((double)w->y0 - (w->flip_y ? 1 : 0));
    for (int y = 0; y < side; y++) {
        for (int x = 0; x < side; x++, out += 2) {
            double dx, dy;
            restore_motion_at(motion, x0 + sign_x * (w->transpose ? y : x), y0 + sign_y * (w->transpose ? x : y), width,
                              height, &dx, &dy);
            out[w->transpose ? 1 : 0] = (float)(sign_x * dx);
            out[w->transpose ? 0 : 1] = (float)(sign_y * dy);
        }
    }
}

brace_status train_sample_make(train_sample *out, const train_bracket *b, const train_window *window,
                               brace_error *error) {
    const size_t side = (size_t)out->side, pixels = side * side;
    if (out->frames != b->count + (b->guide != NULL) || b->width < 2 * side + 2 || b->height < 2 * side + 2) {
        return core_fail(error, BRACE_ERROR_MISMATCH,
                         "%d frames of %ux%u pixels; %d frames of at least %zu pixels a side are needed", b->count,
                         b->width, b->height, out->frames, 2 * side + 2);
    }
    float *packed = core_alloc(pixels * 5, sizeof *packed);
    if (packed == NULL) {
        return core_fail_memory(error, pixels * 5 * sizeof *packed, "a training sample");
    }
    train_crop(out->truth, &b->truth, b->width, window, out->side);
    brace_status status = set_color(out, b, error);
    for (int i = 0; i < b->count && status == BRACE_OK; i++) {
        const int at = i == b->reference ? 0 : i < b->reference ? i + 1 : i;
        train_crop(packed, &b->frame[i], b->width, window, out->side);
        out->white[at] = b->frame[i].gain;
        if (b->aligned) {
            set_flow(out->flow + (size_t)at * pixels * 2, &b->motion[i], b, window, out->side);
        }
        status = show(out, at, packed, i == 0, error);
    }
    if (b->guide != NULL && status == BRACE_OK) {
        train_crop_guide(packed, out->sigma, b, window, out->side);
        out->white[b->count] = b->frame[0].gain;
        status = show(out, b->count, packed, false, error);
    }
    core_free(packed);
    return status;
}
