/* SPDX-License-Identifier: Apache-2.0 */
/*
 * develop.c: mosaic to picture, tile by tile: normalise, white balance, clip,
 * demosaic, camera RGB to linear sRGB, exposure, curve, sample type, orientation.
 * The only picture-sized memory is the result's.
 */
#include <math.h>
#include <string.h>

#include "image/color.h"
#include "image/image.h"
#include "raw/isp.h"

/* The mosaic's values are kept above this, so that no input makes infinities. */
static const float lowest = -1.0f;

brace_status raw_check_frame(const brace_frame *frame, brace_error *error) {
    if (frame == NULL || frame->data == NULL) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "there is no RAW frame to develop");
    }
    const char *name = frame->path != NULL && frame->path[0] != '\0' ? frame->path : "the frame";
    if (frame->width < 4 || frame->height < 4 || frame->width > BRACE_MAX_SIDE || frame->height > BRACE_MAX_SIDE ||
        (uint64_t)frame->width * frame->height > BRACE_MAX_PIXELS) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%s: %u x %u pixels is not a size that can be developed", name,
                         frame->width, frame->height);
    }
    if ((int)frame->cfa < BRACE_CFA_RGGB || (int)frame->cfa > BRACE_CFA_BGGR) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%s: unknown colour filter order %d", name, (int)frame->cfa);
    }
    for (int i = 0; i < 4; i++) {
        if (!isfinite(frame->black[i]) || !isfinite(frame->white) || !(frame->white > frame->black[i]) ||
            !isfinite(1.0f / (frame->white - frame->black[i]))) {
            return core_fail(error, BRACE_ERROR_ARGUMENT, "%s: white level %g is not above black level %g", name,
                             (double)frame->white, (double)frame->black[i]);
        }
    }
    return BRACE_OK;
}

/* The same arithmetic everywhere, so that developing a frame and developing its
 * normalised mosaic give the same bytes. */
static inline float normalise(uint16_t sample, float black, float scale) {
    return ((float)sample - black) * scale;
}

static inline float balance(float v, float wb, float white) {
    v = v * wb;
    v = v < white ? v : white; /* NaN becomes white */
    return v > lowest ? v : lowest;
}

typedef struct levels_work {
    const brace_frame *frame;
    brace_frame *out;
    const float *in;
    float *mosaic;
} levels_work;

static void normalise_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const levels_work *work = arg;
    const brace_frame *frame = work->frame;
    const size_t width = frame->width;
    for (size_t y = begin; y < end; y++) {
        const uint16_t *in = frame->data + y * width;
        float *restrict out = work->mosaic + y * width;
        const float *black = frame->black + 2 * (y & 1);
        const float b0 = black[0], b1 = black[1];
        const float s0 = 1.0f / (frame->white - b0), s1 = 1.0f / (frame->white - b1);
        for (size_t x = 0; x < width; x++) {
            out[x] = normalise(in[x], x & 1 ? b1 : b0, x & 1 ? s1 : s0);
        }
    }
}

void raw_normalise(const brace_frame *frame, float *mosaic, core_pool *pool) {
    levels_work work = {.frame = frame, .mosaic = mosaic};
    core_parallel(pool, frame->height, 64, normalise_rows, &work);
}

static void quantise_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const levels_work *work = arg;
    const brace_frame *frame = work->out;
    const size_t width = frame->width;
    const float top = frame->white < 65535.0f ? frame->white : 65535.0f;
    for (size_t y = begin; y < end; y++) {
        const float *in = work->in + y * width;
        uint16_t *restrict out = frame->data + y * width;
        const float *black = frame->black + 2 * (y & 1);
        for (size_t x = 0; x < width; x++) {
            const float b = black[x & 1], range = frame->white - b;
            float v = in[x] == in[x] ? in[x] * range + b : b;
            v = v < top ? v : top;
            v = v > 0.0f ? v : 0.0f;
            out[x] = (uint16_t)(int)(v + 0.5f);
        }
    }
}

void raw_quantise(brace_frame *out, const float *mosaic, core_pool *pool) {
    levels_work work = {.out = out, .in = mosaic};
    core_parallel(pool, out->height, 64, quantise_rows, &work);
}

typedef struct develop_work {
    const brace_frame *frame;
    const float *mosaic;
    const brace_job *job;
    brace_demosaic method;
    float wb[3];
    float to_red[3], to_blue[3]; /* columns of camera_to_srgb */
    float gain;
    float white; /* where light is clipped, before the gain */
    brace_image *image;
    unsigned char *origin;    /* where pixel (0, 0) of the frame goes */
    ptrdiff_t step_x, step_y; /* bytes from there to its right and lower neighbour */
    size_t pixel;             /* bytes of one */
    size_t tiles_across;
    raw_tile *tiles; /* one a worker */
} develop_work;

static void load_tile(const develop_work *work, raw_tile *tile, int64_t x0, int64_t y0) {
    const brace_frame *frame = work->frame;
    const int64_t width = frame->width, height = frame->height;
    const int rows = tile->height + 2 * RAW_HALO, columns = tile->width + 2 * RAW_HALO;
    const int64_t left = x0 - RAW_HALO;
    const int inside = left < 0 ? (int)-left : 0; /* first column that lies in the picture */
    const int outside = left + columns > width ? (int)(width - left) : columns;
    for (int r = 0; r < rows; r++) {
        const int64_t y = raw_mirror(y0 - RAW_HALO + r, height);
        float *restrict out = tile->mosaic + (size_t)r * RAW_TILE_STRIDE;
        const int color = raw_row_color(frame->cfa, r), phase = raw_green_phase(frame->cfa, r);
        /* RAW_HALO and tile origins are even, so columns of the tile have the picture's phase. */
        const float wb[2] = {work->wb[phase == 0 ? 1 : color], work->wb[phase == 0 ? color : 1]};
        const float *black = frame->black + 2 * (r & 1);
        const float scale[2] = {1.0f / (frame->white - black[0]), 1.0f / (frame->white - black[1])};
        const size_t at = (size_t)y * (size_t)width;
        if (work->mosaic != NULL) {
            const float *in = work->mosaic + at;
            for (int c = inside; c < outside; c++) {
                out[c] = balance(in[left + c], c & 1 ? wb[1] : wb[0], work->white);
            }
        } else {
            const uint16_t *in = frame->data + at;
            const float b0 = black[0], b1 = black[1];
            for (int c = inside; c < outside; c++) {
                const float v = normalise(in[left + c], c & 1 ? b1 : b0, c & 1 ? scale[1] : scale[0]);
                out[c] = balance(v, c & 1 ? wb[1] : wb[0], work->white);
            }
        }
        for (int c = 0; c < inside; c++) {
            out[c] = out[raw_mirror(left + c, width) - left];
        }
        for (int c = outside; c < columns; c++) {
            out[c] = out[raw_mirror(left + c, width) - left];
        }
    }
}

/* Camera RGB of one row of a tile to linear sRGB in `line`, interleaved. The rows of
 * the matrix sum to 1, so only differences to green need it, and grey stays grey exactly. */
static void convert_row(const develop_work *work, const raw_tile *tile, size_t at, float *restrict line) {
    const float *restrict red = tile->rgb[0] + at, *restrict green = tile->rgb[1] + at,
                          *restrict blue = tile->rgb[2] + at;
    const float r0 = work->to_red[0], r1 = work->to_red[1], r2 = work->to_red[2];
    const float b0 = work->to_blue[0], b1 = work->to_blue[1], b2 = work->to_blue[2];
    const float gain = work->gain, white = work->white;
    for (int x = 0; x < tile->width; x++) {
        /* What interpolation overshoots white would tint highlights. */
        const float r = red[x] < white ? red[x] : white;
        const float g = green[x] < white ? green[x] : white;
        const float b = blue[x] < white ? blue[x] : white;
        const float dr = r - g, db = b - g;
        line[3 * x] = gain * (g + (r0 * dr + b0 * db));
        line[3 * x + 1] = gain * (g + (r1 * dr + b1 * db));
        line[3 * x + 2] = gain * (g + (r2 * dr + b2 * db));
    }
}

/* Linear light to what the picture holds, one row. */
static void encode_row(const brace_image *image, void *out, const float *line, size_t count) {
    const bool curve = image->transfer == BRACE_TRANSFER_SRGB;
    if (image->sample == BRACE_SAMPLE_U8) {
        (curve ? image_srgb_encode_row_u8 : image_quantize_row_u8)(out, line, count);
    } else if (image->sample == BRACE_SAMPLE_U16) {
        (curve ? image_srgb_encode_row_u16 : image_quantize_row_u16)(out, line, count);
    } else if (curve) {
        float *encoded = out;
        for (size_t i = 0; i < count; i++) {
            encoded[i] = image_srgb_encode(line[i]);
        }
    } else {
        memcpy(out, line, count * sizeof(float));
    }
}

/* Puts pixels `step` bytes apart; constant sizes make single moves of memcpy. */
static void scatter(unsigned char *to, ptrdiff_t step, const unsigned char *from, int count, size_t pixel) {
    if (step == (ptrdiff_t)pixel) {
        memcpy(to, from, (size_t)count * pixel);
    } else if (pixel == 3) {
        for (int i = 0; i < count; i++, to += step, from += 3) {
            memcpy(to, from, 3);
        }
    } else if (pixel == 6) {
        for (int i = 0; i < count; i++, to += step, from += 6) {
            memcpy(to, from, 6);
        }
    } else {
        for (int i = 0; i < count; i++, to += step, from += 12) {
            memcpy(to, from, 12);
        }
    }
}

static void develop_tiles(void *arg, size_t begin, size_t end, int worker) {
    const develop_work *work = arg;
    raw_tile *tile = work->tiles + worker;
    const size_t width = work->frame->width, height = work->frame->height;
    float line[3 * RAW_TILE_WIDTH];
    _Alignas(float) unsigned char row[sizeof(line)];
    for (size_t i = begin; i < end; i++) {
        if (core_cancelled(work->job)) {
            return;
        }
        const size_t x0 = i % work->tiles_across * RAW_TILE_WIDTH, y0 = i / work->tiles_across * RAW_TILE_HEIGHT;
        tile->width = (int)(width - x0 < RAW_TILE_WIDTH ? width - x0 : RAW_TILE_WIDTH);
        tile->height = (int)(height - y0 < RAW_TILE_HEIGHT ? height - y0 : RAW_TILE_HEIGHT);
        tile->cfa = work->frame->cfa;
        load_tile(work, tile, (int64_t)x0, (int64_t)y0);
        raw_demosaic_tile(tile, work->method);
        for (int y = 0; y < tile->height; y++) {
            convert_row(work, tile, (size_t)(y + RAW_HALO) * RAW_TILE_STRIDE + RAW_HALO, line);
            encode_row(work->image, row, line, 3 * (size_t)tile->width);
            scatter(work->origin + (ptrdiff_t)x0 * work->step_x + (ptrdiff_t)(y0 + (size_t)y) * work->step_y,
                    work->step_x, row, tile->width, work->pixel);
        }
    }
}

/* Where the frame's pixels go in a picture turned as EXIF says: 2 mirrored left-right,
 * 3 turned by 180 degrees, 4 mirrored top-bottom, 5 to 8 the same with rows and columns
 * exchanged (5 mirrored along the main diagonal, 6 clockwise, 8 counter-clockwise). */
static void place(develop_work *work, brace_image *image, int orientation) {
    work->image = image;
    work->pixel = 3 * image_sample_size(image->sample);
    const ptrdiff_t right = (ptrdiff_t)work->pixel, down = (ptrdiff_t)image->stride;
    const bool flip_x = orientation == 2 || orientation == 3 || orientation == 6 || orientation == 7;
    const bool flip_y = orientation == 3 || orientation == 4 || orientation == 7 || orientation == 8;
    work->origin = (unsigned char *)image->data + (flip_x ? (ptrdiff_t)(image->width - 1) * right : 0) +
                   (flip_y ? (ptrdiff_t)(image->height - 1) * down : 0);
    const ptrdiff_t along_x = flip_x ? -right : right, along_y = flip_y ? -down : down;
    work->step_x = orientation >= 5 ? along_y : along_x;
    work->step_y = orientation >= 5 ? along_x : along_y;
}

static brace_status check_params(const brace_develop_params *params, brace_error *error) {
    if ((int)params->demosaic < 0 || (int)params->demosaic > BRACE_DEMOSAIC_DIRECTIONAL) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "unknown demosaicing method %d", (int)params->demosaic);
    }
    if (!(fabs(params->exposure) <= 32.0)) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "exposure of %g EV is outside -32 to 32", params->exposure);
    }
    if ((int)params->sample < 0 || (int)params->sample > BRACE_SAMPLE_F32) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "unknown sample type %d", (int)params->sample);
    }
    if ((int)params->transfer < 0 || (int)params->transfer > BRACE_TRANSFER_LINEAR) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "unknown transfer curve %d", (int)params->transfer);
    }
    return BRACE_OK;
}

brace_status raw_develop(brace_image **out, const float *mosaic, const brace_frame *frame,
                         const brace_develop_params *params, const brace_job *job, core_pool *pool,
                         brace_error *error) {
    static const brace_develop_params defaults = {0};
    const brace_develop_params *p = params != NULL ? params : &defaults;
    if (out == NULL) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "developing needs a place for its result");
    }
    *out = NULL;
    brace_color color;
    brace_status status = raw_check_frame(frame, error);
    if (status == BRACE_OK) {
        status = check_params(p, error);
    }
    if (status == BRACE_OK) {
        status = brace_color_init(&color, frame, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    develop_work work = {.frame = frame, .mosaic = mosaic, .job = job, .method = p->demosaic};
    work.gain = (float)exp2(p->exposure);
    work.white = 1;
    if (mosaic != NULL && p->highlights > 1) {
        const double visible = p->sample == BRACE_SAMPLE_F32 ? p->highlights : exp2(-p->exposure);
        work.white = (float)fmin(fmax(visible, 1), p->highlights);
    }
    for (int c = 0; c < 3; c++) {
        work.wb[c] = (float)color.wb[c];
        work.to_red[c] = (float)color.camera_to_srgb[3 * c];
        work.to_blue[c] = (float)color.camera_to_srgb[3 * c + 2];
    }
    const int orientation = p->as_stored || frame->orientation < 1 || frame->orientation > 8 ? 1 : frame->orientation;
    const bool turned = orientation >= 5;
    const size_t tiles_down = (frame->height + RAW_TILE_HEIGHT - 1) / RAW_TILE_HEIGHT;
    work.tiles_across = (frame->width + RAW_TILE_WIDTH - 1) / RAW_TILE_WIDTH;
    const size_t workers = (size_t)core_pool_threads(pool);

    brace_image *image = NULL;
    status = image_create_raw(&image, turned ? frame->height : frame->width, turned ? frame->width : frame->height, 3,
                              p->sample, p->transfer, error);
    if (status != BRACE_OK) {
        return status;
    }
    place(&work, image, orientation);
    work.tiles = core_calloc(workers, sizeof(raw_tile));
    if (work.tiles == NULL) {
        status = core_fail_memory(error, workers * sizeof(raw_tile), "demosaicing");
    } else {
        core_parallel(pool, work.tiles_across * tiles_down, 1, develop_tiles, &work);
        status = core_check_cancel(job, error);
    }
    core_free(work.tiles);
    if (status != BRACE_OK) {
        brace_image_destroy(image);
        return status;
    }
    *out = image;
    return BRACE_OK;
}

static brace_status develop_with_pool(brace_image **out, const float *mosaic, const brace_frame *frame,
                                      const brace_develop_params *params, const brace_job *job, brace_error *error) {
    core_pool *pool = NULL;
    brace_status status = core_pool_create(&pool, job, error);
    if (status == BRACE_OK) {
        status = raw_develop(out, mosaic, frame, params, job, pool, error);
    }
    core_pool_destroy(pool);
    return status;
}

brace_status brace_develop(brace_image **out, const brace_frame *frame, const brace_develop_params *params,
                           const brace_job *job, brace_error *error) {
    if (out != NULL) {
        *out = NULL;
    }
    return develop_with_pool(out, NULL, frame, params, job, error);
}

brace_status brace_develop_linear(brace_image **out, const float *mosaic, const brace_frame *frame,
                                  const brace_develop_params *params, const brace_job *job, brace_error *error) {
    if (out != NULL) {
        *out = NULL;
    }
    if (mosaic == NULL) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "there is no mosaic to develop");
    }
    return develop_with_pool(out, mosaic, frame, params, job, error);
}
