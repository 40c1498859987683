/* SPDX-License-Identifier: Apache-2.0 */
/*
 * jpeg.c: JPEG files through libjpeg-turbo.
 */
#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <jpeglib.h>
/* After jpeglib.h, which it needs. */
#include <jerror.h>

#include "image/image.h"

/* A progressive file may hold any number of scans, each of which goes over the
 * whole picture: a small file can take hours. Real encoders stay near ten. */
#define MAX_SCANS 100

typedef struct jpeg_state {
    struct jpeg_error_mgr errors; /* first: libjpeg knows only this part */
    struct jpeg_progress_mgr progress;
    jmp_buf jump;
    const char *name;
    int code; /* of libjpeg's message that ended the work, or of the last warning */
    char message[JMSG_LENGTH_MAX];
} jpeg_state;

static void on_error(j_common_ptr jpeg) {
    jpeg_state *state = (jpeg_state *)jpeg->err;
    state->code = jpeg->err->msg_code;
    jpeg->err->format_message(jpeg, state->message);
    longjmp(state->jump, 1);
}

static void on_message(j_common_ptr jpeg, int level) {
    if (level < 0) { /* a warning: data is damaged, decoding goes on */
        jpeg_state *state = (jpeg_state *)jpeg->err;
        jpeg->err->num_warnings++;
        if (state->code != JWRN_JPEG_EOF) {
            state->code = jpeg->err->msg_code;
            jpeg->err->format_message(jpeg, state->message);
        }
    }
}

static void on_output(j_common_ptr jpeg) {
    (void)jpeg;
}

static void on_scan(j_common_ptr jpeg) {
    if (jpeg->is_decompressor && ((j_decompress_ptr)jpeg)->input_scan_number > MAX_SCANS) {
        jpeg_state *state = (jpeg_state *)jpeg->err;
        state->code = 0;
        snprintf(state->message, sizeof state->message, "more than %d scans", MAX_SCANS);
        longjmp(state->jump, 1);
    }
}

static void state_init(jpeg_state *state, const char *name) {
    memset(state, 0, sizeof *state);
    jpeg_std_error(&state->errors);
    state->errors.error_exit = on_error;
    state->errors.emit_message = on_message;
    state->errors.output_message = on_output;
    state->progress.progress_monitor = on_scan;
    state->name = name;
}

static brace_status fail(const jpeg_state *state, bool writing, brace_error *error) {
    if (state->code == JERR_OUT_OF_MEMORY) {
        return core_fail(error, BRACE_ERROR_MEMORY, "%s: out of memory while %s the JPEG picture", state->name,
                         writing ? "writing" : "reading");
    }
    if (writing) {
        return core_fail(error, BRACE_ERROR_IO, "%s: cannot write the JPEG picture: %s", state->name, state->message);
    }
    return core_fail(error, BRACE_ERROR_FORMAT, "%s: cannot read the JPEG picture: %s", state->name, state->message);
}

/* ---- reading ---- */

/* Inks to light, without their profile: each ink takes away its share. Adobe stores CMYK inverted. */
static void cmyk_to_rgb(unsigned char *out, const unsigned char *in, uint32_t width, bool inverted) {
    for (uint32_t x = 0; x < width; x++, in += 4, out += 3) {
        unsigned k = inverted ? in[3] : 255u - in[3];
        for (int c = 0; c < 3; c++) {
            unsigned v = inverted ? in[c] : 255u - in[c];
            out[c] = (unsigned char)((v * k + 127) / 255);
        }
    }
}

typedef struct jpeg_read {
    struct jpeg_decompress_struct jpeg;
    jpeg_state state;
    brace_image *image;
    unsigned char *row; /* of CMYK */
    JOCTET *profile;    /* malloc'ed by libjpeg-turbo */
    int orientation;
} jpeg_read;

static void read_markers(jpeg_read *r, const image_source *source) {
    for (jpeg_saved_marker_ptr m = r->jpeg.marker_list; m != NULL; m = m->next) {
        if (m->marker == JPEG_APP0 + 1 && m->data_length > 6 && memcmp(m->data, "Exif\0\0", 6) == 0) {
            r->orientation = image_exif_orientation(m->data, m->data_length);
            break;
        }
    }
    unsigned size = 0;
    if (jpeg_read_icc_profile(&r->jpeg, &r->profile, &size) && !image_icc_is_srgb(r->profile, size)) {
        core_note(source->job, "%s: its colour profile is not applied, sRGB assumed", source->name);
    }
}

static brace_status decode(jpeg_read *r, const image_source *source, brace_error *error) {
    j_decompress_ptr jpeg = &r->jpeg;
    if (setjmp(r->state.jump) != 0) {
        return fail(&r->state, false, error);
    }
    jpeg_create_decompress(jpeg);
    jpeg->progress = &r->state.progress;
    jpeg_mem_src(jpeg, source->data, (unsigned long)source->size);
    jpeg_save_markers(jpeg, JPEG_APP0 + 1, 0xffff);
    jpeg_save_markers(jpeg, JPEG_APP0 + 2, 0xffff);
    jpeg_read_header(jpeg, TRUE);
    brace_status status =
        image_check_size(source->name, jpeg->image_width, jpeg->image_height, source->max_pixels, error);
    if (status != BRACE_OK) {
        return status;
    }
    read_markers(r, source);
    bool cmyk = jpeg->num_components == 4;
    jpeg->out_color_space = cmyk ? JCS_CMYK : jpeg->num_components == 1 ? JCS_GRAYSCALE : JCS_RGB;
    jpeg_start_decompress(jpeg);
    status = image_create_raw(&r->image, jpeg->output_width, jpeg->output_height, jpeg->output_components == 1 ? 1 : 3,
                              BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, error);
    if (status != BRACE_OK) {
        return status;
    }
    if (cmyk) {
        r->row = core_alloc(jpeg->output_width, 4);
        if (r->row == NULL) {
            return core_fail_memory(error, (size_t)jpeg->output_width * 4, "a row of pixels");
        }
    }
    while (jpeg->output_scanline < jpeg->output_height) {
        unsigned char *target = image_row(r->image, jpeg->output_scanline);
        JSAMPROW row = cmyk ? r->row : target;
        jpeg_read_scanlines(jpeg, &row, 1);
        if (cmyk) {
            cmyk_to_rgb(target, r->row, jpeg->output_width, jpeg->saw_Adobe_marker);
        }
        if (r->state.code == JWRN_JPEG_EOF) {
            return core_fail(error, BRACE_ERROR_FORMAT, "%s: the JPEG picture ends too early, in row %u of %u",
                             source->name, (unsigned)jpeg->output_scanline, (unsigned)jpeg->output_height);
        }
    }
    if (jpeg->err->num_warnings > 0) {
        core_note(source->job, "%s: the JPEG picture is damaged (%s), parts of it may look wrong", source->name,
                  r->state.message);
    }
    jpeg_finish_decompress(jpeg);
    return BRACE_OK;
}

brace_status image_read_jpeg(brace_image **out, const image_source *source, brace_error *error) {
    *out = NULL;
    jpeg_read *r = core_calloc(1, sizeof *r); /* on the heap: what a jump must not lose */
    if (r == NULL) {
        return core_fail_memory(error, sizeof *r, "reading JPEG");
    }
    state_init(&r->state, source->name);
    r->jpeg.err = &r->state.errors;
    r->orientation = 1;
    brace_status status = decode(r, source, error);
    jpeg_destroy_decompress(&r->jpeg);
    if (status == BRACE_OK) {
        status = image_turn(&r->image, r->orientation, error);
    }
    if (status == BRACE_OK) {
        *out = r->image;
    } else {
        brace_image_destroy(r->image);
    }
    free(r->profile);
    core_free(r->row);
    core_free(r);
    return status;
}

/* ---- writing ---- */

typedef struct jpeg_write {
    struct jpeg_compress_struct jpeg;
    jpeg_state state;
    unsigned char *row;
    float *scratch;
    unsigned char profile[IMAGE_ICC_SIZE];
} jpeg_write;

static brace_status encode(jpeg_write *w, const brace_image *image, const image_sink *sink, brace_error *error) {
    j_compress_ptr jpeg = &w->jpeg;
    if (setjmp(w->state.jump) != 0) {
        return fail(&w->state, true, error);
    }
    jpeg_create_compress(jpeg);
    jpeg_stdio_dest(jpeg, core_file_stream(sink->file));
    image_layout layout = {image->channels == 1 ? 1 : 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB};
    jpeg->image_width = image->width;
    jpeg->image_height = image->height;
    jpeg->input_components = (int)layout.channels;
    jpeg->in_color_space = layout.channels == 1 ? JCS_GRAYSCALE : JCS_RGB;
    jpeg_set_defaults(jpeg);
    jpeg_set_quality(jpeg, sink->quality, TRUE);
    if (sink->quality >= 90 && layout.channels == 3) { /* 4:4:4: coloured stripes are what one wants to see */
        jpeg->comp_info[0].h_samp_factor = jpeg->comp_info[0].v_samp_factor = 1;
    }
    jpeg_start_compress(jpeg, TRUE);
    if (layout.channels == 3) { /* the profile is one of RGB */
        jpeg_write_icc_profile(jpeg, w->profile, IMAGE_ICC_SIZE);
    }
    while (jpeg->next_scanline < jpeg->image_height) {
        if (core_cancelled(sink->job)) {
            return core_check_cancel(sink->job, error);
        }
        image_convert_row(w->row, layout, image, jpeg->next_scanline, w->scratch);
        JSAMPROW row = w->row;
        jpeg_write_scanlines(jpeg, &row, 1);
    }
    jpeg_finish_compress(jpeg);
    return BRACE_OK;
}

brace_status image_write_jpeg(const brace_image *image, const image_sink *sink, brace_error *error) {
    if (image->width > JPEG_MAX_DIMENSION || image->height > JPEG_MAX_DIMENSION) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                         "%s: JPEG holds at most %ld pixels a side; this picture has %u x %u", sink->name,
                         JPEG_MAX_DIMENSION, image->width, image->height);
    }
    jpeg_write *w = core_calloc(1, sizeof *w);
    if (w == NULL) {
        return core_fail_memory(error, sizeof *w, "writing JPEG");
    }
    state_init(&w->state, sink->name);
    w->jpeg.err = &w->state.errors;
    image_icc_srgb(w->profile);
    w->row = core_alloc(image->width, 3);
    w->scratch = core_alloc((size_t)image->width * 4, sizeof *w->scratch);
    brace_status status = w->row != NULL && w->scratch != NULL
                              ? encode(w, image, sink, error)
                              : core_fail_memory(error, (size_t)image->width * 19, "a row of pixels");
    jpeg_destroy_compress(&w->jpeg);
    core_free(w->row);
    core_free(w->scratch);
    core_free(w);
    return status;
}
