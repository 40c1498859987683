/* SPDX-License-Identifier: Apache-2.0 */
/*
 * resize.c: other sizes, in linear light: each new pixel is the light of the
 * area that it covers (shrinking), or a Mitchell-Netravali interpolation
 * (growing). The two directions are filtered one after the other.
 */
#include <math.h>
#include <string.h>

#include "image/color.h"
#include "image/image.h"

/* The taps of one new pixel: old pixels first .. first+count-1. */
typedef struct tap_range {
    uint32_t first, count;
    size_t weights; /* offset into axis.weights */
} tap_range;

typedef struct axis {
    tap_range *ranges; /* one a new pixel */
    float *weights;
} axis;

/* D. P. Mitchell, A. N. Netravali, "Reconstruction filters in computer graphics",
 * SIGGRAPH 1988, B = C = 1/3. */
static double mitchell(double x) {
    x = fabs(x);
    if (x < 1) {
        return (7 * x * x * x - 12 * x * x + 16.0 / 3) / 6;
    }
    return x < 2 ? (-7.0 / 3 * x * x * x + 12 * x * x - 20 * x + 32.0 / 3) / 6 : 0;
}

static void axis_free(axis *a) {
    core_free(a->ranges);
    core_free(a->weights);
}

static brace_status axis_init(axis *a, uint32_t from, uint32_t to, brace_error *error) {
    double scale = (double)from / (double)to; /* old pixels a new one */
    size_t most = from > to ? (size_t)from / to + 3 : 4;
    a->ranges = core_calloc(to, sizeof *a->ranges);
    a->weights = core_calloc((size_t)to * most, sizeof *a->weights);
    if (a->ranges == NULL || a->weights == NULL) {
        return core_fail_memory(error, (size_t)to * most * sizeof *a->weights, "the weights of resizing");
    }
    for (uint32_t i = 0; i < to; i++) {
        float *w = a->weights + i * most;
        uint32_t first = 0, count = 0;
        if (from == to) {
            first = i;
            count = 1;
            w[0] = 1;
        } else if (from > to) {
            /* Edges in exact integers: new pixel i covers [i*from, (i+1)*from) in units of 1/to. */
            uint64_t begin = (uint64_t)i * from, end = begin + from;
            first = (uint32_t)(begin / to);
            for (uint64_t k = first; k * to < end; k++) {
                uint64_t low = k * to > begin ? k * to : begin, high = (k + 1) * to < end ? (k + 1) * to : end;
                w[count++] = (float)((double)(high - low) / (double)from);
            }
        } else {
            double centre = (i + 0.5) * scale - 0.5, sum = 0;
            int64_t low = (int64_t)floor(centre) - 1;
            double raw[4];
            for (int k = 0; k < 4; k++) {
                int64_t at = low + k;
                raw[k] = at >= 0 && at < (int64_t)from ? mitchell(centre - (double)at) : 0;
                sum += raw[k];
            }
            first = (uint32_t)(low < 0 ? 0 : low);
            for (int k = 0; k < 4; k++) {
                int64_t at = low + k;
                if (at >= 0 && at < (int64_t)from) {
                    w[count++] = (float)(raw[k] / sum);
                }
            }
        }
        a->ranges[i] = (tap_range){first, count, i * most};
    }
    return BRACE_OK;
}

typedef struct resizer {
    const brace_image *image;
    axis x, y;
    uint32_t width; /* of the result */
    float *unpacked;
    float *ring[4]; /* old rows, filtered to the new width; row y is kept at y%4 */
    int64_t held[4];
    float *sum;
} resizer;

static const float *filtered_row(resizer *r, uint32_t y) {
    float *out = r->ring[y % 4];
    if (r->held[y % 4] == (int64_t)y) {
        return out;
    }
    r->held[y % 4] = (int64_t)y;
    uint32_t channels = r->image->channels;
    image_unpack_linear(r->unpacked, r->image, y);
    if (channels == 4) { /* colour counts as much as it is seen */
        for (size_t x = 0; x < r->image->width; x++) {
            float *p = r->unpacked + x * 4;
            p[0] *= p[3];
            p[1] *= p[3];
            p[2] *= p[3];
        }
    }
    for (uint32_t x = 0; x < r->width; x++) {
        const tap_range *range = &r->x.ranges[x];
        const float *w = r->x.weights + range->weights;
        const float *in = r->unpacked + (size_t)range->first * channels;
        float acc[4] = {0, 0, 0, 0};
        for (uint32_t k = 0; k < range->count; k++) {
            for (uint32_t c = 0; c < channels; c++) {
                acc[c] += w[k] * in[(size_t)k * channels + c];
            }
        }
        memcpy(out + (size_t)x * channels, acc, channels * sizeof *acc);
    }
    return out;
}

static void resize_row(resizer *r, brace_image *out, uint32_t y) {
    size_t n = (size_t)out->width * out->channels;
    const tap_range *range = &r->y.ranges[y];
    memset(r->sum, 0, n * sizeof *r->sum);
    for (uint32_t k = 0; k < range->count; k++) {
        const float *row = filtered_row(r, range->first + k);
        float w = r->y.weights[range->weights + k];
        for (size_t i = 0; i < n; i++) {
            r->sum[i] += w * row[i];
        }
    }
    if (out->channels == 4) {
        for (size_t x = 0; x < out->width; x++) {
            float *p = r->sum + x * 4;
            float scale = p[3] > 1e-6f ? 1.0f / p[3] : 0.0f;
            p[0] *= scale;
            p[1] *= scale;
            p[2] *= scale;
        }
    }
    /* The sums are a linear image of one row. */
    brace_image linear = {out->width,        1,     out->channels, BRACE_SAMPLE_F32, BRACE_TRANSFER_LINEAR,
                          n * sizeof(float), r->sum};
    image_layout layout = {out->channels, out->sample, out->transfer};
    image_convert_row(image_row(out, y), layout, &linear, 0, r->unpacked);
}

brace_status brace_image_resize(brace_image **out, const brace_image *image, uint32_t width, uint32_t height,
                                brace_error *error) {
    *out = NULL;
    brace_status status = image_check(image, error);
    if (status != BRACE_OK) {
        return status;
    }
    brace_image *result = NULL;
    status = image_create_raw(&result, width, height, image->channels, image->sample, image->transfer, error);
    if (status != BRACE_OK) {
        return status;
    }
    resizer r = {.image = image, .width = width, .held = {-1, -1, -1, -1}};
    status = axis_init(&r.x, image->width, width, error);
    if (status == BRACE_OK) {
        status = axis_init(&r.y, image->height, height, error);
    }
    /* `unpacked` later serves as the four floats a pixel of scratch for the new row. */
    size_t wide = (size_t)(width > image->width ? width : image->width) * 4;
    size_t row = (size_t)width * image->channels;
    float *memory = status == BRACE_OK ? core_alloc(wide + 5 * row, sizeof *memory) : NULL;
    if (status == BRACE_OK && memory == NULL) {
        status = core_fail_memory(error, (wide + 5 * row) * sizeof *memory, "rows of pixels");
    }
    if (status == BRACE_OK) {
        r.unpacked = memory;
        r.sum = memory + wide;
        for (int i = 0; i < 4; i++) {
            r.ring[i] = memory + wide + (size_t)(i + 1) * row;
        }
        for (uint32_t y = 0; y < height; y++) {
            resize_row(&r, result, y);
        }
        *out = result;
    } else {
        brace_image_destroy(result);
    }
    core_free(memory);
    axis_free(&r.x);
    axis_free(&r.y);
    return status;
}
