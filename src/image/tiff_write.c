/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tiff_write.c: writing TIFF: deflate with a predictor (TIFF 6.0 section 14 for
 * integers; Adobe Photoshop TIFF technical note 3 for float), strips compressed
 * on all threads and handed to libtiff as they are.
 */
#include <string.h>

#include <tiffio.h>
#include <zlib.h>

#include "image/image.h"
#include "image/tiff_handle.h"

#define STRIP_BYTES ((size_t)1 << 19)

static void difference_u8(unsigned char *p, size_t count, size_t step) {
    for (size_t i = count; i-- > step;) {
        p[i] = (unsigned char)(p[i] - p[i - step]);
    }
}

static void difference_u16(unsigned char *bytes, size_t count, size_t step) {
    uint16_t *p = (uint16_t *)(void *)bytes;
    for (size_t i = count; i-- > step;) {
        p[i] = (uint16_t)(p[i] - p[i - step]);
    }
}

/* The most significant bytes of the row first, then the next, ...; then the differences of bytes. */
static void split_floats(unsigned char *out, const unsigned char *in, size_t count, size_t step) {
    for (size_t i = 0; i < count; i++) {
        for (size_t k = 0; k < 4; k++) {
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
            out[k * count + i] = in[i * 4 + 3 - k];
#else
            out[k * count + i] = in[i * 4 + k];
#endif
        }
    }
    difference_u8(out, count * 4, step);
}

static void predict(const image_strips *s, unsigned char *out, uint32_t y, uint32_t rows, unsigned char *row,
                    float *scratch) {
    size_t channels = s->layout.channels, count = (size_t)s->image->width * channels;
    for (uint32_t i = 0; i < rows; i++, out += s->bytes_per_row) {
        image_convert_row(row, s->layout, s->image, y + i, scratch);
        if (s->layout.sample == BRACE_SAMPLE_F32) {
            split_floats(out, row, count, channels);
        } else if (s->layout.sample == BRACE_SAMPLE_U16) {
            difference_u16(row, count, channels);
            memcpy(out, row, s->bytes_per_row);
        } else {
            difference_u8(row, count, channels);
            memcpy(out, row, s->bytes_per_row);
        }
    }
}

static brace_status fail_write(const image_tiff *handle, brace_error *error) {
    return core_fail(error, BRACE_ERROR_IO, "%s: cannot write the TIFF picture, the disk may be full: %s", handle->name,
                     handle->message[0] != '\0' ? handle->message : "libtiff gave no reason");
}

static brace_status emit(void *arg, uint32_t index, unsigned char *data, size_t size, brace_error *error) {
    image_tiff *handle = arg;
    if (TIFFWriteRawStrip(handle->tiff, index, data, (tmsize_t)size) != (tmsize_t)size) {
        return fail_write(handle, error);
    }
    return BRACE_OK;
}

static bool set_tags(TIFF *t, const image_strips *s) {
    static const uint16_t alpha[1] = {EXTRASAMPLE_UNASSALPHA};
    unsigned char profile[IMAGE_ICC_SIZE];
    image_icc_srgb(profile);
    brace_sample sample = s->layout.sample;
    bool real = sample == BRACE_SAMPLE_F32;
    uint32_t channels = s->layout.channels;
    bool ok = TIFFSetField(t, TIFFTAG_IMAGEWIDTH, s->image->width) &&
              TIFFSetField(t, TIFFTAG_IMAGELENGTH, s->image->height) &&
              TIFFSetField(t, TIFFTAG_BITSPERSAMPLE, (int)(8 * image_sample_size(sample))) &&
              TIFFSetField(t, TIFFTAG_SAMPLEFORMAT, real ? SAMPLEFORMAT_IEEEFP : SAMPLEFORMAT_UINT) &&
              TIFFSetField(t, TIFFTAG_SAMPLESPERPIXEL, (int)channels) &&
              TIFFSetField(t, TIFFTAG_PHOTOMETRIC, channels == 1 ? PHOTOMETRIC_MINISBLACK : PHOTOMETRIC_RGB) &&
              TIFFSetField(t, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG) &&
              TIFFSetField(t, TIFFTAG_ORIENTATION, ORIENTATION_TOPLEFT) &&
              TIFFSetField(t, TIFFTAG_COMPRESSION, COMPRESSION_ADOBE_DEFLATE) &&
              TIFFSetField(t, TIFFTAG_PREDICTOR, real ? PREDICTOR_FLOATINGPOINT : PREDICTOR_HORIZONTAL) &&
              /* Required of a baseline file, though a picture on a screen has no size in inches. */
              TIFFSetField(t, TIFFTAG_XRESOLUTION, 72.0) && TIFFSetField(t, TIFFTAG_YRESOLUTION, 72.0) &&
              TIFFSetField(t, TIFFTAG_RESOLUTIONUNIT, RESUNIT_INCH) && TIFFSetField(t, TIFFTAG_ROWSPERSTRIP, s->rows) &&
              TIFFSetField(t, TIFFTAG_SOFTWARE, "BRACE");
    if (channels == 4) {
        ok = ok && TIFFSetField(t, TIFFTAG_EXTRASAMPLES, 1, alpha);
    }
    /* The profile is one of encoded RGB: neither of grey nor of linear light. */
    if (channels != 1 && s->layout.transfer == BRACE_TRANSFER_SRGB) {
        ok = ok && TIFFSetField(t, TIFFTAG_ICCPROFILE, (uint32_t)IMAGE_ICC_SIZE, profile);
    }
    return ok;
}

brace_status image_write_tiff(const brace_image *image, const image_sink *sink, brace_error *error) {
    bool real = sink->bits == 32;
    image_layout layout = {image->channels,
                           real               ? BRACE_SAMPLE_F32
                           : sink->bits == 16 ? BRACE_SAMPLE_U16
                                              : BRACE_SAMPLE_U8,
                           real ? BRACE_TRANSFER_LINEAR : BRACE_TRANSFER_SRGB};
    size_t row = image_row_bytes(layout, image->width);
    image_tiff handle = {.name = sink->name, .stream = core_file_stream(sink->file)};
    uint64_t bytes = (uint64_t)row * image->height;
    brace_status status = image_tiff_open_stream(&handle, bytes > 0xf0000000u, error);
    if (status != BRACE_OK) {
        return status;
    }
    image_strips strips = {
        .image = image,
        .layout = layout,
        .rows = row >= STRIP_BYTES ? 1 : (uint32_t)(STRIP_BYTES / row),
        .bytes_per_row = row,
        .one_stream = false,
        .level = sink->compression,
        .strategy = image_strips_strategy(layout.sample, sink->compression),
        .name = sink->name,
        .prepare = predict,
        .emit = emit,
        .arg = &handle,
    };
    if (strips.rows > image->height) {
        strips.rows = image->height;
    }
    if (!set_tags(handle.tiff, &strips)) {
        status = fail_write(&handle, error);
    }
    if (status == BRACE_OK) {
        status = image_strips_run(&strips, sink->job, error);
    }
    if (status == BRACE_OK && !TIFFFlush(handle.tiff)) {
        status = fail_write(&handle, error);
    }
    TIFFClose(handle.tiff);
    return status;
}
