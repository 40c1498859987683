/* SPDX-License-Identifier: Apache-2.0 */
/*
 * picture.c: reading and writing pictures of any format: told apart by content
 * when reading, by name or by request when writing.
 */
#include <string.h>
#include <strings.h>

#include "image/image.h"

/* No sound picture within BRACE_MAX_PIXELS takes more bytes in a file than this. */
#define MAX_FILE ((size_t)BRACE_MAX_PIXELS * 16u)

brace_status image_read_memory(brace_image **out, const image_source *source, brace_error *error) {
    *out = NULL;
    const unsigned char *p = source->data;
    size_t n = source->size;
    if (n == 0) {
        return core_fail(error, BRACE_ERROR_FORMAT, "%s: the file is empty", source->name);
    }
    if (n >= 8 && memcmp(p, "\x89PNG\r\n\x1a\n", 8) == 0) {
        return image_read_png(out, source, error);
    }
    if (n >= 3 && memcmp(p, "\xff\xd8\xff", 3) == 0) {
        return image_read_jpeg(out, source, error);
    }
    if (n >= 12 && memcmp(p, "RIFF", 4) == 0 && memcmp(p + 8, "WEBP", 4) == 0) {
        return image_read_webp(out, source, error);
    }
    if (n >= 4 && (memcmp(p, "II*\0", 4) == 0 || memcmp(p, "MM\0*", 4) == 0 || memcmp(p, "II+\0", 4) == 0 ||
                   memcmp(p, "MM\0+", 4) == 0)) {
        return image_read_tiff(out, source, error);
    }
    return core_fail(error, BRACE_ERROR_FORMAT, "%s: not a PNG, TIFF, JPEG or WebP picture", source->name);
}

brace_status brace_image_read(brace_image **out, const char *path, const brace_job *job, brace_error *error) {
    *out = NULL;
    void *data = NULL;
    size_t size = 0;
    brace_status status = core_check_cancel(job, error);
    if (status == BRACE_OK) {
        status = core_file_load(&data, &size, path, MAX_FILE, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    image_source source = {data, size, path, BRACE_MAX_PIXELS, job};
    status = image_read_memory(out, &source, error);
    core_free(data);
    return status;
}

static brace_picture_format format_of(const char *path) {
    static const struct {
        const char *extension;
        brace_picture_format format;
    } known[] = {
        {"png", BRACE_PICTURE_PNG},  {"tif", BRACE_PICTURE_TIFF},  {"tiff", BRACE_PICTURE_TIFF},
        {"jpg", BRACE_PICTURE_JPEG}, {"jpeg", BRACE_PICTURE_JPEG}, {"webp", BRACE_PICTURE_WEBP},
    };
    const char *slash = strrchr(path, '/');
    const char *dot = strrchr(slash != NULL ? slash : path, '.');
    for (size_t i = 0; dot != NULL && i < sizeof known / sizeof *known; i++) {
        if (strcasecmp(dot + 1, known[i].extension) == 0) {
            return known[i].format;
        }
    }
    return BRACE_PICTURE_AUTO;
}

/* Fills in the defaults; refuses what the format does not have. */
static brace_status resolve(image_sink *sink, brace_picture_format *format, const brace_image *image,
                            const brace_image_write_params *params, brace_error *error) {
    static const char *const names[] = {"", "PNG", "TIFF", "JPEG", "WebP"};
    *format = params->format;
    if (*format == BRACE_PICTURE_AUTO) {
        *format = format_of(sink->name);
    }
    if (*format < BRACE_PICTURE_PNG || *format > BRACE_PICTURE_WEBP) {
        return core_fail(error, BRACE_ERROR_ARGUMENT,
                         "%s: cannot tell the picture's format from its name; it should end in .png, .tif, .jpg or "
                         ".webp",
                         sink->name);
    }
    int most = *format == BRACE_PICTURE_TIFF ? 32 : *format == BRACE_PICTURE_PNG ? 16 : 8;
    int own = (int)(8 * image_sample_size(image->sample));
    if (params->bits != 0 && params->bits != 8 && params->bits != 16 && params->bits != 32) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%s: %d bits a sample were asked for; there are 8, 16 and 32",
                         sink->name, params->bits);
    }
    if (params->bits > most) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%s: %d bits a sample were asked for; %s holds at most %d",
                         sink->name, params->bits, names[*format], most);
    }
    if (params->quality < 0 || params->quality > 100) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%s: quality is %d; 1 to 100 can be used", sink->name,
                         params->quality);
    }
    if (params->compression < 0 || params->compression > 9) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%s: compression is %d; 1 (fast) to 9 (small) can be used",
                         sink->name, params->compression);
    }
    sink->bits = params->bits != 0 ? params->bits : own < most ? own : most;
    sink->quality = params->quality != 0 ? params->quality : 92;
    sink->compression = params->compression != 0 ? params->compression : 4;
    return BRACE_OK;
}

brace_status brace_image_write(const brace_image *image, const char *path, const brace_image_write_params *params,
                               const brace_job *job, brace_error *error) {
    const brace_image_write_params defaults = {0};
    if (params == NULL) {
        params = &defaults;
    }
    if (path == NULL || *path == '\0') {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "the name of the picture to write is empty");
    }
    image_sink sink = {.name = path, .job = job};
    brace_picture_format format = BRACE_PICTURE_AUTO;
    brace_status status = image_check(image, error);
    if (status == BRACE_OK) {
        status = resolve(&sink, &format, image, params, error);
    }
    if (status == BRACE_OK) {
        status = core_check_cancel(job, error);
    }
    if (status == BRACE_OK) {
        status = core_file_create(&sink.file, path, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    switch (format) {
    case BRACE_PICTURE_PNG:
        status = image_write_png(image, &sink, error);
        break;
    case BRACE_PICTURE_TIFF:
        status = image_write_tiff(image, &sink, error);
        break;
    case BRACE_PICTURE_JPEG:
        status = image_write_jpeg(image, &sink, error);
        break;
    default:
        status = image_write_webp(image, &sink, error);
        break;
    }
    if (status != BRACE_OK) {
        core_file_abort(sink.file);
        return status;
    }
    return core_file_commit(sink.file, error);
}
