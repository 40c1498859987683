/* SPDX-License-Identifier: Apache-2.0 */
/*
 * webp.c: WebP files (RFC 9649) through libwebp. The encoder gives a bare
 * picture; the extended container that holds a colour profile is put around it here.
 */
#include <string.h>

#include <webp/decode.h>
#include <webp/encode.h>

#include "image/image.h"

static uint32_t get32(const unsigned char *p) {
    return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

static void put24(unsigned char *p, uint32_t v) {
    p[0] = (unsigned char)v;
    p[1] = (unsigned char)(v >> 8);
    p[2] = (unsigned char)(v >> 16);
}

static void put32(unsigned char *p, uint32_t v) {
    put24(p, v);
    p[3] = (unsigned char)(v >> 24);
}

/* The payload of the first chunk of a kind, or NULL. */
static const unsigned char *find_chunk(const unsigned char *data, size_t size, const char *kind, size_t *length) {
    for (size_t at = 12; at <= size && size - at >= 8;) {
        size_t n = get32(data + at + 4);
        if (n > size - at - 8) {
            return NULL;
        }
        if (memcmp(data + at, kind, 4) == 0) {
            *length = n;
            return data + at + 8;
        }
        at += 8 + n + (n & 1);
    }
    return NULL;
}

/* ---- reading ---- */

static brace_status fail_read(const image_source *source, VP8StatusCode code, brace_error *error) {
    switch (code) {
    case VP8_STATUS_OUT_OF_MEMORY:
        return core_fail(error, BRACE_ERROR_MEMORY, "%s: out of memory while reading the WebP picture", source->name);
    case VP8_STATUS_NOT_ENOUGH_DATA:
        return core_fail(error, BRACE_ERROR_FORMAT, "%s: cannot read the WebP picture: the file ends too early",
                         source->name);
    case VP8_STATUS_UNSUPPORTED_FEATURE:
        return core_fail(error, BRACE_ERROR_UNSUPPORTED, "%s: a WebP picture of a kind that is not handled",
                         source->name);
    default:
        return core_fail(error, BRACE_ERROR_FORMAT, "%s: cannot read the WebP picture: it is damaged", source->name);
    }
}

brace_status image_read_webp(brace_image **out, const image_source *source, brace_error *error) {
    *out = NULL;
    WebPDecoderConfig config;
    if (!WebPInitDecoderConfig(&config)) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED, "%s: the installed libwebp is too old", source->name);
    }
    VP8StatusCode code = WebPGetFeatures(source->data, source->size, &config.input);
    if (code != VP8_STATUS_OK) {
        return fail_read(source, code, error);
    }
    if (config.input.has_animation) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED, "%s: this is an animation; a still WebP picture is needed",
                         source->name);
    }
    brace_status status = image_check_size(source->name, (uint64_t)config.input.width, (uint64_t)config.input.height,
                                           source->max_pixels, error);
    if (status != BRACE_OK) {
        return status;
    }
    brace_image *image = NULL;
    status = image_create_raw(&image, (uint32_t)config.input.width, (uint32_t)config.input.height,
                              config.input.has_alpha ? 4 : 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, error);
    if (status != BRACE_OK) {
        return status;
    }
    config.output.colorspace = config.input.has_alpha ? MODE_RGBA : MODE_RGB;
    config.output.is_external_memory = 1;
    config.output.u.RGBA.rgba = image->data;
    config.output.u.RGBA.stride = (int)image->stride;
    config.output.u.RGBA.size = image->stride * image->height;
    code = WebPDecode(source->data, source->size, &config);
    WebPFreeDecBuffer(&config.output);
    if (code != VP8_STATUS_OK) {
        brace_image_destroy(image);
        return fail_read(source, code, error);
    }
    size_t length = 0;
    const unsigned char *chunk = find_chunk(source->data, source->size, "ICCP", &length);
    if (chunk != NULL && !image_icc_is_srgb(chunk, length)) {
        core_note(source->job, "%s: its colour profile is not applied, sRGB assumed", source->name);
    }
    chunk = find_chunk(source->data, source->size, "EXIF", &length);
    if (chunk != NULL) {
        status = image_turn(&image, image_exif_orientation(chunk, length), error);
    }
    *out = image;
    return status;
}

/* ---- writing ---- */

static int on_progress(int percent, const WebPPicture *picture) {
    (void)percent;
    return !core_cancelled(picture->user_data);
}

/* VP8X header, profile, then the encoder's own picture chunks (ALPH, VP8, VP8L). */
static brace_status put_container(const image_sink *sink, const brace_image *image, const WebPMemoryWriter *coded,
                                  brace_error *error) {
    FILE *f = core_file_stream(sink->file);
    const unsigned char *body = coded->mem + 12;
    size_t body_size = coded->size - 12;
    if (memcmp(body, "VP8X", 4) == 0) { /* it is made anew */
        body += 18;
        body_size -= 18;
    }
    unsigned char head[12 + 18 + 8 + IMAGE_ICC_SIZE] = "RIFF....WEBPVP8X\n\0\0";
    put32(head + 4, (uint32_t)(sizeof head - 8 + body_size));
    head[16] = 10;
    head[20] = (unsigned char)(0x20 | (image->channels == 4 ? 0x10 : 0)); /* profile, alpha */
    put24(head + 24, image->width - 1);
    put24(head + 27, image->height - 1);
    memcpy(head + 30, "ICCP", 4);
    put32(head + 34, IMAGE_ICC_SIZE); /* even: no padding */
    image_icc_srgb(head + 38);
    if (fwrite(head, 1, sizeof head, f) != sizeof head || fwrite(body, 1, body_size, f) != body_size) {
        return core_fail(error, BRACE_ERROR_IO, "%s: cannot write the WebP picture: the disk may be full", sink->name);
    }
    return BRACE_OK;
}

static brace_status encode(WebPPicture *picture, const WebPConfig *config, const brace_image *image,
                           const image_sink *sink, brace_error *error) {
    image_layout layout = {image->channels == 4 ? 4 : 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB};
    size_t row = image_row_bytes(layout, image->width);
    unsigned char *pixels = core_alloc(image->height, row);
    float *scratch = core_alloc((size_t)image->width * 4, sizeof *scratch);
    brace_status status = BRACE_OK;
    if (pixels == NULL || scratch == NULL) {
        status = core_fail_memory(error, image->height * row, "encoding WebP");
    }
    for (uint32_t y = 0; status == BRACE_OK && y < image->height; y++) {
        image_convert_row(pixels + y * row, layout, image, y, scratch);
    }
    if (status == BRACE_OK) {
        int ok = layout.channels == 4 ? WebPPictureImportRGBA(picture, pixels, (int)row)
                                      : WebPPictureImportRGB(picture, pixels, (int)row);
        if (!ok) {
            status = core_fail_memory(error, image->height * row, "encoding WebP");
        }
    }
    core_free(pixels);
    core_free(scratch);
    if (status == BRACE_OK && !WebPEncode(config, picture)) {
        if (picture->error_code == VP8_ENC_ERROR_USER_ABORT) {
            status = core_fail(error, BRACE_ERROR_CANCELLED, "cancelled");
        } else if (picture->error_code == VP8_ENC_ERROR_OUT_OF_MEMORY ||
                   picture->error_code == VP8_ENC_ERROR_BITSTREAM_OUT_OF_MEMORY) {
            status =
                core_fail(error, BRACE_ERROR_MEMORY, "%s: out of memory while writing the WebP picture", sink->name);
        } else {
            status = core_fail(error, BRACE_ERROR_UNSUPPORTED, "%s: the picture cannot be held in WebP (error %d)",
                               sink->name, (int)picture->error_code);
        }
    }
    return status;
}

brace_status image_write_webp(const brace_image *image, const image_sink *sink, brace_error *error) {
    if (image->width > WEBP_MAX_DIMENSION || image->height > WEBP_MAX_DIMENSION) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                         "%s: WebP holds at most %d pixels a side; this picture has %u x %u", sink->name,
                         WEBP_MAX_DIMENSION, image->width, image->height);
    }
    WebPConfig config;
    WebPPicture picture;
    if (!WebPConfigInit(&config) || !WebPPictureInit(&picture)) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED, "%s: the installed libwebp is too old", sink->name);
    }
    config.quality = (float)sink->quality;
    config.thread_level = 1;
    if (sink->quality == 100) {
        config.lossless = 1;
        config.exact = 1;    /* colours under full transparency too */
        config.quality = 75; /* means effort here */
        picture.use_argb = 1;
    }
    WebPMemoryWriter writer;
    WebPMemoryWriterInit(&writer);
    picture.width = (int)image->width;
    picture.height = (int)image->height;
    picture.writer = WebPMemoryWrite;
    picture.custom_ptr = &writer;
    picture.progress_hook = on_progress;
    brace_job job = sink->job != NULL ? *sink->job : (brace_job){0};
    picture.user_data = &job; /* the field is not const */
    brace_status status = encode(&picture, &config, image, sink, error);
    if (status == BRACE_OK) {
        status = put_container(sink, image, &writer, error);
    }
    WebPMemoryWriterClear(&writer);
    WebPPictureFree(&picture);
    return status;
}
