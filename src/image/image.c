/* SPDX-License-Identifier: Apache-2.0 */
/*
 * image.c: rasters and the conversion of rows between sample types, transfers
 * and numbers of channels.
 */
#include "image/image.h"

#include <math.h>
#include <string.h>

#include "image/color.h"

size_t image_sample_size(brace_sample sample) {
    return sample == BRACE_SAMPLE_U8 ? 1 : sample == BRACE_SAMPLE_U16 ? 2 : 4;
}

brace_status image_check_size(const char *name, uint64_t width, uint64_t height, uint64_t max_pixels,
                              brace_error *error) {
    if (width < 1 || height < 1) {
        return core_fail(error, BRACE_ERROR_FORMAT, "%s: the picture has no pixels (%ju x %ju)", name, (uintmax_t)width,
                         (uintmax_t)height);
    }
    if (width > BRACE_MAX_SIDE || height > BRACE_MAX_SIDE || width * height > max_pixels) {
        return core_fail(
            error, BRACE_ERROR_UNSUPPORTED,
            "%s: the picture is too large: %ju x %ju; at most %u a side and %ju million pixels are handled", name,
            (uintmax_t)width, (uintmax_t)height, BRACE_MAX_SIDE, (uintmax_t)(max_pixels / 1000000));
    }
    return BRACE_OK;
}

static bool valid_layout(uint32_t channels, int sample, int transfer) {
    return (channels == 1 || channels == 3 || channels == 4) && sample >= BRACE_SAMPLE_U8 &&
           sample <= BRACE_SAMPLE_F32 && (transfer == BRACE_TRANSFER_SRGB || transfer == BRACE_TRANSFER_LINEAR);
}

static brace_status create(brace_image **out, uint32_t width, uint32_t height, uint32_t channels, brace_sample sample,
                           brace_transfer transfer, bool clear, brace_error *error) {
    *out = NULL;
    if (width < 1 || height < 1 || width > BRACE_MAX_SIDE || height > BRACE_MAX_SIDE ||
        (uint64_t)width * height > BRACE_MAX_PIXELS) {
        return core_fail(error, BRACE_ERROR_ARGUMENT,
                         "an image of %u x %u pixels was asked for; 1 to %u a side and %u million pixels are handled",
                         width, height, BRACE_MAX_SIDE, BRACE_MAX_PIXELS / 1000000);
    }
    if (!valid_layout(channels, (int)sample, (int)transfer)) {
        return core_fail(error, BRACE_ERROR_ARGUMENT,
                         "an image of %u channels, sample type %d and transfer %d was asked for; there are 1, 3 or 4 "
                         "channels, types 0 to 2 and transfers 0 and 1",
                         channels, (int)sample, (int)transfer);
    }
    brace_image *image = core_calloc(1, sizeof *image);
    if (image == NULL) {
        return core_fail_memory(error, sizeof *image, "an image");
    }
    image->width = width;
    image->height = height;
    image->channels = channels;
    image->sample = sample;
    image->transfer = transfer;
    image->stride = (size_t)width * channels * image_sample_size(sample);
    image->data = clear ? core_calloc(height, image->stride) : core_alloc(height, image->stride);
    if (image->data == NULL) {
        brace_status status = core_fail_memory(error, (size_t)height * image->stride, "an image");
        core_free(image);
        return status;
    }
    *out = image;
    return BRACE_OK;
}

brace_status brace_image_create(brace_image **out, uint32_t width, uint32_t height, uint32_t channels,
                                brace_sample sample, brace_transfer transfer, brace_error *error) {
    return create(out, width, height, channels, sample, transfer, true, error);
}

brace_status image_create_raw(brace_image **out, uint32_t width, uint32_t height, uint32_t channels,
                              brace_sample sample, brace_transfer transfer, brace_error *error) {
    return create(out, width, height, channels, sample, transfer, false, error);
}

void brace_image_destroy(brace_image *image) {
    if (image != NULL) {
        core_free(image->data);
        core_free(image);
    }
}

brace_status image_check(const brace_image *image, brace_error *error) {
    if (image == NULL || image->data == NULL) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "an image was expected, and there is none");
    }
    if (!valid_layout(image->channels, (int)image->sample, (int)image->transfer) || image->width < 1 ||
        image->height < 1 || image->width > BRACE_MAX_SIDE || image->height > BRACE_MAX_SIDE ||
        (uint64_t)image->width * image->height > BRACE_MAX_PIXELS ||
        image->stride < (size_t)image->width * image->channels * image_sample_size(image->sample) ||
        image->stride % image_sample_size(image->sample) != 0) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "the image's size, channels, sample type or stride are wrong");
    }
    return BRACE_OK;
}

size_t image_row_bytes(image_layout layout, uint32_t width) {
    return (size_t)width * layout.channels * image_sample_size(layout.sample);
}

/* ---- rows ---- */

/* The samples as floats with the curve they are stored with. */
static void unpack(float *out, const brace_image *image, uint32_t y) {
    size_t n = (size_t)image->width * image->channels;
    const void *row = image_row(image, y);
    if (image->sample == BRACE_SAMPLE_U8) {
        const uint8_t *p = row;
        for (size_t i = 0; i < n; i++) {
            out[i] = (float)p[i] * (1.0f / 255.0f);
        }
    } else if (image->sample == BRACE_SAMPLE_U16) {
        const uint16_t *p = row;
        for (size_t i = 0; i < n; i++) {
            out[i] = (float)p[i] * (1.0f / 65535.0f);
        }
    } else {
        memcpy(out, row, n * sizeof *out);
    }
}

void image_unpack_linear(float *out, const brace_image *image, uint32_t y) {
    size_t n = (size_t)image->width * image->channels;
    uint32_t channels = image->channels;
    if (image->transfer == BRACE_TRANSFER_LINEAR) {
        unpack(out, image, y);
        return;
    }
    const void *row = image_row(image, y);
    if (image->sample == BRACE_SAMPLE_U8) {
        const float *decode = image_srgb_decode_u8();
        const uint8_t *p = row;
        for (size_t i = 0; i < n; i++) {
            out[i] = channels == 4 && i % 4 == 3 ? (float)p[i] * (1.0f / 255.0f) : decode[p[i]];
        }
    } else if (image->sample == BRACE_SAMPLE_U16) {
        const float *decode = image_srgb_decode_u16();
        const uint16_t *p = row;
        for (size_t i = 0; i < n; i++) {
            out[i] = channels == 4 && i % 4 == 3 ? (float)p[i] * (1.0f / 65535.0f) : decode[p[i]];
        }
    } else {
        const float *p = row;
        for (size_t i = 0; i < n; i++) {
            out[i] = channels == 4 && i % 4 == 3 ? p[i] : image_srgb_decode(p[i]);
        }
    }
}

/* Changes the number of channels of `width` pixels in place; `p` has room for 4 a pixel.
 * From colour to grey the values must be linear: Y of Rec. 709, whose primaries are sRGB's. */
static void change_channels(float *p, uint32_t width, uint32_t from, uint32_t to) {
    if (from == to) {
        return;
    }
    if (to > from) { /* from the end, so that nothing is overwritten before it is read */
        for (size_t x = width; x-- > 0;) {
            const float *in = p + x * from;
            float r = in[0], g = from == 1 ? r : in[1], b = from == 1 ? r : in[2];
            float *out = p + x * to;
            out[0] = r;
            out[1] = g;
            out[2] = b;
            if (to == 4) {
                out[3] = 1.0f;
            }
        }
        return;
    }
    for (size_t x = 0; x < width; x++) {
        const float *in = p + x * from;
        float *out = p + x * to;
        if (to == 1) {
            out[0] = 0.2126f * in[0] + 0.7152f * in[1] + 0.0722f * in[2];
        } else {
            float r = in[0], g = in[1], b = in[2];
            out[0] = r;
            out[1] = g;
            out[2] = b;
        }
    }
}

/* Floats, linear or already with the wanted curve, to samples. */
static void pack(void *out, image_layout layout, const float *in, uint32_t width, bool encode) {
    size_t n = (size_t)width * layout.channels;
    if (layout.sample == BRACE_SAMPLE_F32) {
        float *p = out;
        for (size_t i = 0; i < n; i++) {
            bool alpha = layout.channels == 4 && i % 4 == 3;
            p[i] = encode && !alpha ? image_srgb_encode(in[i]) : in[i];
        }
    } else if (layout.sample == BRACE_SAMPLE_U16) {
        uint16_t *p = out;
        if (encode) {
            image_srgb_encode_row_u16(p, in, n);
        } else {
            image_quantize_row_u16(p, in, n);
        }
        for (size_t i = 3; encode && layout.channels == 4 && i < n; i += 4) {
            image_quantize_row_u16(p + i, in + i, 1);
        }
    } else {
        uint8_t *p = out;
        if (encode) {
            image_srgb_encode_row_u8(p, in, n);
        } else {
            image_quantize_row_u8(p, in, n);
        }
        for (size_t i = 3; encode && layout.channels == 4 && i < n; i += 4) {
            image_quantize_row_u8(p + i, in + i, 1);
        }
    }
}

void image_convert_row(void *out, image_layout layout, const brace_image *image, uint32_t y, float *scratch) {
    if (layout.channels == image->channels && layout.sample == image->sample && layout.transfer == image->transfer) {
        memcpy(out, image_row(image, y), image_row_bytes(layout, image->width));
        return;
    }
    bool to_grey = layout.channels == 1 && image->channels != 1;
    bool through_light = layout.transfer != image->transfer || (to_grey && image->transfer == BRACE_TRANSFER_SRGB);
    if (through_light) {
        image_unpack_linear(scratch, image, y);
    } else {
        unpack(scratch, image, y);
    }
    change_channels(scratch, image->width, image->channels, layout.channels);
    pack(out, layout, scratch, image->width, through_light && layout.transfer == BRACE_TRANSFER_SRGB);
}

brace_status brace_image_convert(brace_image **out, const brace_image *image, uint32_t channels, brace_sample sample,
                                 brace_transfer transfer, brace_error *error) {
    *out = NULL;
    brace_status status = image_check(image, error);
    if (status != BRACE_OK) {
        return status;
    }
    status = image_create_raw(out, image->width, image->height, channels, sample, transfer, error);
    if (status != BRACE_OK) {
        return status;
    }
    float *scratch = core_alloc((size_t)image->width * 4, sizeof *scratch);
    if (scratch == NULL) {
        brace_image_destroy(*out);
        *out = NULL;
        return core_fail_memory(error, (size_t)image->width * 4 * sizeof *scratch, "a row of pixels");
    }
    image_layout layout = {channels, sample, transfer};
    for (uint32_t y = 0; y < image->height; y++) {
        image_convert_row(image_row(*out, y), layout, image, y, scratch);
    }
    core_free(scratch);
    return BRACE_OK;
}
