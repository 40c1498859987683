/* SPDX-License-Identifier: Apache-2.0 */
/* screen.c: pictures of screens: read within bounds, and compared by what they show. */
#include "sim/screen.h"

#include <stdlib.h>

#include "core/sha256.h"
#include "image/image.h"
#include "sim/simulate.h"

/* 64 megapixels of 16 bytes, the most that any format stores for one. */
static const size_t longest_file = (size_t)1 << 30;

brace_status sim_screen_read(brace_image **out, char sha256[65], const char *path, const brace_job *job,
                             brace_error *error) {
    *out = NULL;
    void *data;
    size_t size;
    brace_status status = core_file_load(&data, &size, path, longest_file, error);
    if (status != BRACE_OK)
        return status;
    if (sha256 != NULL) {
        core_sha256 hash;
        core_sha256_begin(&hash);
        core_sha256_add(&hash, data, size);
        core_sha256_end(&hash, sha256);
    }
    image_source source = {data, size, path, SIM_SCREEN_PIXELS, job};
    status = image_read_memory(out, &source, error);
    core_free(data);
    return status;
}

/* Where block i of n begins on a side; a block has one pixel at least. */
static uint32_t begin_of(uint32_t i, uint32_t n, uint32_t side) {
    return (uint32_t)((uint64_t)i * side / n);
}

static uint32_t end_of(uint32_t i, uint32_t n, uint32_t side) {
    uint32_t begin = begin_of(i, n, side), end = begin_of(i + 1, n, side);
    return end > begin ? end : begin + 1;
}

static void means(sim_print *out, const brace_image *image) {
    uint64_t sum[3 * SIM_PRINT_COLUMNS];
    for (uint32_t j = 0; j < SIM_PRINT_ROWS; j++) {
        const uint32_t top = begin_of(j, SIM_PRINT_ROWS, image->height), end = end_of(j, SIM_PRINT_ROWS, image->height);
        for (size_t i = 0; i < 3 * SIM_PRINT_COLUMNS; i++)
            sum[i] = 0;
        for (uint32_t y = top; y < end; y++) {
            const unsigned char *row = image_row(image, y);
            for (uint32_t i = 0; i < SIM_PRINT_COLUMNS; i++) {
                const uint32_t last = end_of(i, SIM_PRINT_COLUMNS, image->width);
                for (uint32_t x = begin_of(i, SIM_PRINT_COLUMNS, image->width); x < last; x++)
                    for (size_t c = 0; c < 3; c++)
                        sum[3 * i + c] += row[image->channels * (size_t)x + (image->channels < 3 ? 0 : c)];
            }
        }
        for (uint32_t i = 0; i < SIM_PRINT_COLUMNS; i++) {
            const uint64_t n = (uint64_t)(end - top) * (end_of(i, SIM_PRINT_COLUMNS, image->width) -
                                                        begin_of(i, SIM_PRINT_COLUMNS, image->width));
            for (size_t c = 0; c < 3; c++)
                out->value[3 * ((size_t)j * SIM_PRINT_COLUMNS + i) + c] = (uint8_t)((sum[3 * i + c] + n / 2) / n);
        }
    }
}

brace_status sim_print_create(sim_print *out, const brace_image *image, brace_error *error) {
    brace_image *bytes = NULL;
    if (image->sample != BRACE_SAMPLE_U8 || image->transfer != BRACE_TRANSFER_SRGB) {
        brace_status status = brace_image_convert(&bytes, image, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, error);
        if (status != BRACE_OK)
            return status;
    }
    means(out, bytes != NULL ? bytes : image);
    brace_image_destroy(bytes);
    int64_t sum = 0, squares = 0;
    for (size_t i = 0; i < SIM_PRINT; i++)
        sum += out->value[i], squares += out->value[i] * out->value[i];
    out->sum = sum;
    out->energy = SIM_PRINT * squares - sum * sum;
    return BRACE_OK;
}

bool sim_prints_alike(const sim_print *a, const sim_print *b) {
    /* Contrast below one step of 8 bits: there is nothing to correlate. */
    const int64_t flat = (int64_t)SIM_PRINT * SIM_PRINT;
    if (a->energy < flat || b->energy < flat) {
        for (size_t i = 0; i < SIM_PRINT; i++)
            if (abs(a->value[i] - b->value[i]) > 2)
                return false;
        return true;
    }
    int32_t product = 0; /* at most 1728*255*255 */
    for (size_t i = 0; i < SIM_PRINT; i++)
        product += a->value[i] * b->value[i];
    const double covariance = (double)(SIM_PRINT * (int64_t)product - a->sum * b->sum);
    return covariance > 0 && covariance * covariance > 0.985 * 0.985 * (double)a->energy * (double)b->energy;
}
