/* SPDX-License-Identifier: Apache-2.0 */
/*
 * outputs.c: the files that `brace restore` writes. The picture is developed
 * once, as fine as the most demanding output needs it.
 */
#include "cli/outputs.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/core.h"
#include "raw/raw.h"

static const char restored_mark[] = ", restored"; /* at the end of a DNG's Software */

static const struct {
    const char *word; /* extension, and value of --format */
    output_format format;
} words[] = {
    {"dng", OUTPUT_DNG},  {"tif", OUTPUT_TIFF},  {"tiff", OUTPUT_TIFF}, {"png", OUTPUT_PNG},
    {"jpg", OUTPUT_JPEG}, {"jpeg", OUTPUT_JPEG}, {"webp", OUTPUT_WEBP},
};

static output_format format_of(const char *word) {
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
        if (strcasecmp(word, words[i].word) == 0) {
            return words[i].format;
        }
    }
    return OUTPUT_NONE;
}

const char *output_format_name(output_format format) {
    static const char *const names[] = {"none", "DNG", "PNG", "TIFF", "JPEG", "WebP"};
    return names[format];
}

static int default_bits(output_format format) {
    return format == OUTPUT_TIFF ? 16 : 8;
}

static bool has_bits(output_format format, int bits) {
    return bits == 8 || (bits == 16 && (format == OUTPUT_PNG || format == OUTPUT_TIFF)) ||
           (bits == 32 && format == OUTPUT_TIFF);
}

int outputs_init(outputs *out, const cli_list *paths, const char *format, const char *command) {
    output_format fallback = OUTPUT_NONE;
    bool fallback_used = false;
    if (format != NULL) {
        fallback = format_of(format);
        if (fallback == OUTPUT_NONE) {
            return cli_wrong_usage(command, "--format is one of dng, tif, png, jpg, webp, not '%s'", format);
        }
    }
    if (paths->count == 0) {
        return cli_wrong_usage(command, "where shall the result go? Name it with -o, for example -o restored.dng");
    }
    if (paths->count > CLI_OUTPUTS_MAX) {
        return cli_wrong_usage(command, "-o can be given at most %d times", CLI_OUTPUTS_MAX);
    }
    for (size_t i = 0; i < paths->count; i++) {
        output *o = &out->items[out->count++];
        o->path = paths->items[i];
        const char *base = cli_basename(o->path), *dot = strrchr(base, '.');
        o->format = dot != NULL && dot > base ? format_of(dot + 1) : OUTPUT_NONE;
        if (o->format == OUTPUT_NONE) {
            o->format = fallback;
            fallback_used = true;
        }
        if (o->format == OUTPUT_NONE) {
            return cli_wrong_usage(command,
                                   "%s: the name has to end in .dng, .tif, .png, .jpg or .webp (or say --format)",
                                   o->path[0] != '\0' ? o->path : "''");
        }
    }
    if (fallback != OUTPUT_NONE && !fallback_used && out->items[0].format != fallback) {
        return cli_wrong_usage(command, "%s is named as %s, but --format says %s", out->items[0].path,
                               output_format_name(out->items[0].format), output_format_name(fallback));
    }
    return -1;
}

int outputs_check(const outputs *out, const cli_paths *inputs, const char *command) {
    bool bits_possible = out->bits == 0;
    for (size_t i = 0; i < out->count; i++) {
        const char *path = out->items[i].path;
        struct stat info;
        bits_possible = bits_possible || has_bits(out->items[i].format, out->bits);
        for (size_t j = 0; j < i; j++) {
            if (cli_same_file(path, out->items[j].path)) {
                return cli_wrong_usage(command, "the output %s is given twice", path);
            }
        }
        for (size_t j = 0; j < inputs->count; j++) {
            if (cli_same_file(path, inputs->items[j])) {
                return cli_wrong_usage(command, "the output %s is one of the inputs; it would be overwritten", path);
            }
        }
        if (stat(path, &info) == 0) {
            if (S_ISDIR(info.st_mode)) {
                return cli_wrong_usage(command, "the output %s is a folder; name a file in it", path);
            }
            continue;
        }
        /* An absent folder is found now and not after the work is done. */
        char *folder = cli_folder_of(path);
        if (folder == NULL) {
            cli_error(command, "out of memory");
            return CLI_FAILED;
        }
        int problem = access(folder, W_OK | X_OK) != 0 ? errno : 0;
        if (problem != 0) {
            cli_error(command, "%s: can't write into the folder %s: %s", path, folder, strerror(problem));
        }
        free(folder);
        if (problem != 0) {
            return CLI_FAILED;
        }
    }
    if (!bits_possible) {
        return cli_wrong_usage(command,
                               "--bits %d fits none of the outputs (PNG has 8 or 16, TIFF 8, 16 or 32, JPEG "
                               "and WebP 8)",
                               out->bits);
    }
    return -1;
}

bool outputs_use_stdout(const outputs *out) {
    struct stat a, b;
    if (fstat(STDOUT_FILENO, &a) != 0) {
        return false;
    }
    for (size_t i = 0; i < out->count; i++) {
        if (stat(out->items[i].path, &b) == 0 && a.st_dev == b.st_dev && a.st_ino == b.st_ino &&
            strcmp(out->items[i].path, "/dev/null") != 0) {
            return true;
        }
    }
    return false;
}

/* What a picture gets: what was asked for if its format has it. */
static int bits_of(const outputs *out, output_format format) {
    return out->bits != 0 && has_bits(format, out->bits) ? out->bits : default_bits(format);
}

static brace_status write_picture(const output *o, const outputs *out, const brace_image *image, const brace_job *job,
                                  brace_error *error) {
    static const brace_picture_format formats[] = {BRACE_PICTURE_AUTO, BRACE_PICTURE_AUTO, BRACE_PICTURE_PNG,
                                                   BRACE_PICTURE_TIFF, BRACE_PICTURE_JPEG, BRACE_PICTURE_WEBP};
    brace_image_write_params params = {
        .format = formats[o->format], .bits = bits_of(out, o->format), .quality = out->quality};
    return brace_image_write(image, o->path, &params, job, error);
}

brace_status outputs_write(outputs *out, const brace_restored *restored, const brace_job *job, brace_error *error) {
    brace_sample finest = BRACE_SAMPLE_U8;
    bool pictures = false;
    for (size_t i = 0; i < out->count; i++) {
        output_format format = out->items[i].format;
        if (format == OUTPUT_DNG) {
            continue;
        }
        pictures = true;
        int bits = bits_of(out, format);
        brace_sample sample = bits == 32 ? BRACE_SAMPLE_F32 : bits == 16 ? BRACE_SAMPLE_U16 : BRACE_SAMPLE_U8;
        if (sample > finest) {
            finest = sample;
        }
    }

    brace_image *picture = NULL;
    brace_status status = BRACE_OK;
    double start = core_seconds();
    if (pictures) {
        brace_develop_params params = {.sample = finest, .exposure = out->exposure, .highlights = out->highlights};
        if (finest == BRACE_SAMPLE_F32) {
            params.transfer = BRACE_TRANSFER_LINEAR; /* float TIFFs are linear; the others are encoded when written */
        }
        status = brace_develop_linear(&picture, restored->mosaic, restored->frame, &params, job, error);
    }
    out->seconds_develop = core_seconds() - start;
    start = core_seconds();
    for (size_t i = 0; i < out->count && status == BRACE_OK; i++) {
        output *o = &out->items[i];
        status = core_check_cancel(job, error);
        if (status == BRACE_OK && o->format == OUTPUT_DNG) {
            /* Makes its own preview, so that the same bracket gives the same file beside any other outputs. */
            char software[64];
            snprintf(software, sizeof software, "BRACE %s%s", brace_version(), restored_mark);
            const brace_dng_params params = {.software = software};
            status = brace_frame_write_dng(restored->frame, o->path, &params, job, error);
        } else if (status == BRACE_OK) {
            status = write_picture(o, out, picture, job, error);
        }
        o->written = status == BRACE_OK;
    }
    out->seconds_write = core_seconds() - start;
    brace_image_destroy(picture);
    return status;
}

bool outputs_is_result(const char *path) {
    brace_frame *frame = NULL;
    bool ours = false;
    if (brace_frame_read(&frame, path, NULL, NULL) == BRACE_OK && frame->tags != NULL) {
        const raw_tag *software = raw_tags_find(frame->tags, RAW_IFD_MAIN, 305);
        ours = software != NULL && memmem(software->bytes, software->count, restored_mark, strlen(restored_mark)) != NULL;
    }
    brace_frame_destroy(frame);
    return ours;
}
