/* SPDX-License-Identifier: Apache-2.0 */
/*
 * png.c: PNG files (ISO/IEC 15948). Reading is libpng's; writing has libpng make
 * the chunks around the pixels, which are filtered and deflated on all threads.
 */
#include <setjmp.h>
#include <string.h>

#include <png.h>
#include <zlib.h>

#include "image/image.h"

typedef struct png_state {
    const char *name;
    const unsigned char *data;
    size_t size, at;
    FILE *stream;
    const brace_job *job;
    bool memory_failed;
    char message[192];
} png_state;

static void on_error(png_structp png, png_const_charp message) {
    png_state *state = png_get_error_ptr(png);
    snprintf(state->message, sizeof state->message, "%s", message);
    png_longjmp(png, 1);
}

/* Warnings are about what is not needed (odd profiles, times); damage that matters is an error. */
static void on_warning(png_structp png, png_const_charp message) {
    (void)png;
    (void)message;
}

static png_voidp on_alloc(png_structp png, png_alloc_size_t size) {
    void *p = core_alloc(size, 1);
    if (p == NULL) {
        png_state *state = png_get_mem_ptr(png);
        state->memory_failed = true;
    }
    return p;
}

static void on_free(png_structp png, png_voidp p) {
    (void)png;
    core_free(p);
}

static brace_status fail(const png_state *state, brace_status status, const char *doing, brace_error *error) {
    if (state->memory_failed) {
        return core_fail(error, BRACE_ERROR_MEMORY, "%s: out of memory while %s the PNG picture", state->name,
                         strcmp(doing, "read") == 0 ? "reading" : "writing");
    }
    return core_fail(error, status, "%s: cannot %s the PNG picture: %s", state->name, doing,
                     state->message[0] != '\0' ? state->message : "libpng gave no reason");
}

/* ---- reading ---- */

static void on_read(png_structp png, png_bytep out, size_t size) {
    png_state *state = png_get_io_ptr(png);
    if (state->size - state->at < size) {
        png_error(png, "the file ends too early");
    }
    memcpy(out, state->data + state->at, size);
    state->at += size;
}

static void note_color(const image_source *source, png_structp png, png_infop info) {
    char *profile_name;
    int method;
    png_bytep profile;
    png_uint_32 size;
    int intent;
    double gamma;
    if (png_get_sRGB(png, info, &intent) == PNG_INFO_sRGB) {
        return;
    }
    if (png_get_iCCP(png, info, &profile_name, &method, &profile, &size) == PNG_INFO_iCCP) {
        if (!image_icc_is_srgb(profile, size)) {
            core_note(source->job, "%s: its colour profile (%s) is not applied, sRGB assumed", source->name,
                      profile_name);
        }
    } else if (png_get_gAMA(png, info, &gamma) == PNG_INFO_gAMA && (gamma < 0.44 || gamma > 0.47)) {
        core_note(source->job, "%s: its gamma (%.4g) is not applied, sRGB assumed", source->name, gamma);
    }
}

/* Runs libpng; what it leaves behind on an error is freed by the caller. `rows` is allocated here, so that it
 * survives the jump only through the pointer. */
static brace_status decode(png_structp png, png_infop info, const image_source *source, brace_image **image,
                           png_bytep **rows, int *orientation, brace_error *error) {
    if (setjmp(png_jmpbuf(png)) != 0) {
        return fail(png_get_error_ptr(png), BRACE_ERROR_FORMAT, "read", error);
    }
    png_set_read_fn(png, png_get_error_ptr(png), on_read);
    png_set_user_limits(png, 0x7fffffff, 0x7fffffff); /* image_check_size has the better sentence */
    png_set_chunk_malloc_max(png, (png_alloc_size_t)16 << 20);
    png_set_chunk_cache_max(png, 64);
    png_read_info(png, info);
    brace_status status = image_check_size(source->name, png_get_image_width(png, info),
                                           png_get_image_height(png, info), source->max_pixels, error);
    if (status != BRACE_OK) {
        return status;
    }
    int type = png_get_color_type(png, info), depth = png_get_bit_depth(png, info);
    bool transparent = png_get_valid(png, info, PNG_INFO_tRNS) != 0;
    note_color(source, png, info);
    if (type == PNG_COLOR_TYPE_PALETTE || depth < 8 || transparent) {
        png_set_expand(png);
    }
    if (type == PNG_COLOR_TYPE_GRAY_ALPHA || (type == PNG_COLOR_TYPE_GRAY && transparent)) {
        png_set_gray_to_rgb(png);
    }
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
    if (depth == 16) {
        png_set_swap(png);
    }
#endif
    png_set_interlace_handling(png);
    png_read_update_info(png, info);
    uint32_t channels = png_get_channels(png, info), height = png_get_image_height(png, info);
    status = image_create_raw(image, png_get_image_width(png, info), height, channels,
                              png_get_bit_depth(png, info) == 16 ? BRACE_SAMPLE_U16 : BRACE_SAMPLE_U8,
                              BRACE_TRANSFER_SRGB, error);
    if (status != BRACE_OK) {
        return status;
    }
    if (png_get_rowbytes(png, info) != (*image)->stride) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED, "%s: a PNG picture of an unknown layout", source->name);
    }
    *rows = core_alloc(height, sizeof **rows);
    if (*rows == NULL) {
        return core_fail_memory(error, height * sizeof **rows, "a picture's rows");
    }
    for (uint32_t y = 0; y < height; y++) {
        (*rows)[y] = image_row(*image, y);
    }
    png_read_image(png, *rows);
    png_read_end(png, info); /* checks the last pixels' CRC; EXIF may stand behind them */
    png_bytep exif = NULL;
    png_uint_32 exif_size = 0;
    if (png_get_eXIf_1(png, info, &exif_size, &exif) == PNG_INFO_eXIf) {
        *orientation = image_exif_orientation(exif, exif_size);
    }
    return BRACE_OK;
}

brace_status image_read_png(brace_image **out, const image_source *source, brace_error *error) {
    *out = NULL;
    png_state state = {.name = source->name, .data = source->data, .size = source->size, .job = source->job};
    png_structp png =
        png_create_read_struct_2(PNG_LIBPNG_VER_STRING, &state, on_error, on_warning, &state, on_alloc, on_free);
    png_infop info = png != NULL ? png_create_info_struct(png) : NULL;
    if (info == NULL) {
        png_destroy_read_struct(&png, NULL, NULL);
        return core_fail_memory(error, 1024, "reading PNG");
    }
    brace_image *image = NULL;
    png_bytep *rows = NULL;
    int orientation = 1;
    brace_status status = decode(png, info, source, &image, &rows, &orientation, error);
    png_destroy_read_struct(&png, &info, NULL);
    core_free(rows);
    if (status == BRACE_OK) {
        status = image_turn(&image, orientation, error);
    }
    if (status != BRACE_OK) {
        brace_image_destroy(image);
        return status;
    }
    *out = image;
    return BRACE_OK;
}

/* ---- writing ---- */

static void on_write(png_structp png, png_bytep data, size_t size) {
    png_state *state = png_get_io_ptr(png);
    if (fwrite(data, 1, size, state->stream) != size) {
        png_error(png, "the disk does not take it: it may be full");
    }
}

static void on_flush(png_structp png) {
    (void)png;
}

#define ROWS_BYTES ((size_t)1 << 20) /* of a strip: large against the 32 KB window that each starts without */

/* Each row preceded by its filter's number, 9.2. Photographs in 16 bits have noise in the low bytes that no filter
 * removes; Sub predicts the high ones nearly as well as a choice among all five, at a fraction of the time. */
static void filter_rows(const image_strips *s, unsigned char *out, uint32_t y, uint32_t rows, unsigned char *row,
                        float *scratch) {
    size_t bytes = image_row_bytes(s->layout, s->image->width);
    size_t pixel = s->layout.channels * image_sample_size(s->layout.sample);
    for (uint32_t i = 0; i < rows; i++) {
        image_convert_row(row, s->layout, s->image, y + i, scratch);
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
        if (s->layout.sample == BRACE_SAMPLE_U16) {
            for (size_t k = 0; k < bytes; k += 2) {
                unsigned char low = row[k];
                row[k] = row[k + 1];
                row[k + 1] = low;
            }
        }
#endif
        *out++ = 1; /* Sub */
        memcpy(out, row, pixel);
        for (size_t k = pixel; k < bytes; k++) {
            out[k] = (unsigned char)(row[k] - row[k - pixel]);
        }
        out += bytes;
    }
}

static brace_status emit(void *arg, uint32_t index, unsigned char *data, size_t size, brace_error *error) {
    static const png_byte idat[5] = "IDAT";
    png_structp png = arg;
    png_state *state = png_get_error_ptr(png);
    if (setjmp(png_jmpbuf(png)) != 0) {
        return fail(state, BRACE_ERROR_IO, "write", error);
    }
    if (index == 0) { /* RFC 1950: deflate with a 32 KB window, no dictionary */
        static const png_byte head[2] = {0x78, 0x5e};
        png_write_chunk_start(png, idat, (png_uint_32)(size + sizeof head));
        png_write_chunk_data(png, head, sizeof head);
    } else {
        png_write_chunk_start(png, idat, (png_uint_32)size);
    }
    png_write_chunk_data(png, data, size);
    png_write_chunk_end(png);
    return BRACE_OK;
}

static brace_status write_head(png_structp png, png_infop info, const image_strips *s, brace_error *error) {
    if (setjmp(png_jmpbuf(png)) != 0) {
        return fail(png_get_error_ptr(png), BRACE_ERROR_IO, "write", error);
    }
    int type = s->layout.channels == 1   ? PNG_COLOR_TYPE_GRAY
               : s->layout.channels == 3 ? PNG_COLOR_TYPE_RGB
                                         : PNG_COLOR_TYPE_RGB_ALPHA;
    png_set_user_limits(png, BRACE_MAX_SIDE, BRACE_MAX_SIDE);
    png_set_IHDR(png, info, s->image->width, s->image->height, s->layout.sample == BRACE_SAMPLE_U16 ? 16 : 8, type,
                 PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_set_sRGB_gAMA_and_cHRM(png, info, PNG_sRGB_INTENT_RELATIVE);
    png_write_info(png, info);
    return BRACE_OK;
}

static brace_status write_tail(png_structp png, brace_error *error) {
    static const png_byte iend[5] = "IEND";
    if (setjmp(png_jmpbuf(png)) != 0) {
        return fail(png_get_error_ptr(png), BRACE_ERROR_IO, "write", error);
    }
    png_write_chunk(png, iend, NULL, 0);
    return BRACE_OK;
}

brace_status image_write_png(const brace_image *image, const image_sink *sink, brace_error *error) {
    png_state state = {.name = sink->name, .stream = core_file_stream(sink->file), .job = sink->job};
    png_structp png =
        png_create_write_struct_2(PNG_LIBPNG_VER_STRING, &state, on_error, on_warning, &state, on_alloc, on_free);
    png_infop info = png != NULL ? png_create_info_struct(png) : NULL;
    if (info == NULL) {
        png_destroy_write_struct(&png, NULL);
        return core_fail_memory(error, 1024, "writing PNG");
    }
    png_set_write_fn(png, &state, on_write, on_flush);
    image_layout layout = {image->channels, sink->bits == 16 ? BRACE_SAMPLE_U16 : BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB};
    size_t row = image_row_bytes(layout, image->width) + 1;
    image_strips strips = {
        .image = image,
        .layout = layout,
        .rows = row >= ROWS_BYTES ? 1 : (uint32_t)(ROWS_BYTES / row),
        .bytes_per_row = row,
        .one_stream = true,
        .level = sink->compression,
        .strategy = image_strips_strategy(layout.sample, sink->compression),
        .name = sink->name,
        .prepare = filter_rows,
        .emit = emit,
        .arg = png,
    };
    brace_status status = write_head(png, info, &strips, error);
    if (status == BRACE_OK) {
        status = image_strips_run(&strips, sink->job, error);
    }
    if (status == BRACE_OK) {
        status = write_tail(png, error);
    }
    png_destroy_write_struct(&png, &info);
    return status;
}
