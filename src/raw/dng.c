/* SPDX-License-Identifier: Apache-2.0 */
/*
 * dng.c: what stands in the directories of a DNG 1.4 that BRACE writes.
 *
 * The first directory is the preview with everything about camera and colour,
 * its SubIFD is the mosaic (Adobe's own layout, which every reader knows); without
 * preview the first directory is the mosaic. The frame's fields win over the
 * tags that came with it, but a tag that says the same in other words (10/16000
 * for 1/1600) is left as it was.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "brace/version.h"
#include "raw/raw.h"

/* Puts numbers, unless a tag says exactly them already. */
static bool put_same(brace_tags *tags, raw_ifd ifd, unsigned tag, unsigned type, uint32_t count, const double *values) {
    const raw_tag *old = raw_tags_find(tags, ifd, tag);
    bool same = old != NULL && old->count == count && old->type == type;
    for (uint32_t i = 0; same && i < count; i++) {
        same = raw_tag_number(old, i) == values[i];
    }
    return same || raw_tags_put_real(tags, ifd, tag, type, count, values);
}

static bool put_or_remove(brace_tags *tags, raw_ifd ifd, unsigned tag, double value) {
    if (!(value > 0.0) || !isfinite(value)) {
        raw_tags_remove(tags, ifd, tag);
        return true;
    }
    return put_same(tags, ifd, tag, RAW_RATIONAL, 1, &value);
}

static bool put_iso(brace_tags *tags, double iso) {
    if (!(iso > 0.0) || iso > 4294967295.0) {
        raw_tags_remove(tags, RAW_IFD_EXIF, 34855);
        return true;
    }
    double rounded = fmax(nearbyint(iso), 1.0);
    if (rounded < 65535.0) {
        return raw_tags_put_short(tags, RAW_IFD_EXIF, 34855, (unsigned)rounded);
    }
    /* EXIF 2.3: too large for 16 bits, so it stands in ISOSpeed, of SensitivityType 3. */
    return raw_tags_put_short(tags, RAW_IFD_EXIF, 34855, 65535) && raw_tags_put_short(tags, RAW_IFD_EXIF, 34864, 3) &&
           raw_tags_put_long(tags, RAW_IFD_EXIF, 34867, (uint32_t)rounded);
}

static bool put_text_or_remove(brace_tags *tags, raw_ifd ifd, unsigned tag, const char *text) {
    char old[128];
    raw_tag_text(raw_tags_find(tags, ifd, tag), old, sizeof old);
    if (text[0] == '\0') {
        raw_tags_remove(tags, ifd, tag);
        return true;
    }
    return strcmp(old, text) == 0 || raw_tags_put_text(tags, ifd, tag, text);
}

static bool put_exif(brace_tags *tags, const brace_frame *f) {
    bool ok = put_or_remove(tags, RAW_IFD_EXIF, 33434, f->exposure_time) &&
              put_or_remove(tags, RAW_IFD_EXIF, 33437, f->f_number) &&
              put_or_remove(tags, RAW_IFD_EXIF, 37386, f->focal_length) && put_iso(tags, f->iso) &&
              put_text_or_remove(tags, RAW_IFD_EXIF, 36867, f->datetime) &&
              put_text_or_remove(tags, RAW_IFD_EXIF, 37521, f->subsec);
    if (ok && raw_tags_find(tags, RAW_IFD_EXIF, 36864) == NULL) {
        ok = raw_tags_put(tags, RAW_IFD_EXIF, 36864, RAW_UNDEFINED, 4, "0231");
    }
    return ok;
}

static bool put_color(brace_tags *tags, const brace_frame *f) {
    static const unsigned matrix_tag[] = {50721, 50722}, light_tag[] = {50778, 50779};
    bool ok = true;
    for (int i = 0; i < 2; i++) {
        if (f->illuminant[i] != 0) {
            ok = ok && put_same(tags, RAW_IFD_MAIN, matrix_tag[i], RAW_SRATIONAL, 9, f->color_matrix[i]) &&
                 raw_tags_put_short(tags, RAW_IFD_MAIN, light_tag[i], f->illuminant[i]);
        } else {
            raw_tags_remove(tags, RAW_IFD_MAIN, matrix_tag[i]);
            raw_tags_remove(tags, RAW_IFD_MAIN, light_tag[i]);
        }
    }
    /* A frame without matrix: camera RGB taken as sRGB, so that readers show it as BRACE does
     * (IEC 61966-2-1, XYZ to linear sRGB). */
    static const double srgb[9] = {3.2406, -1.5372, -0.4986, -0.9689, 1.8758, 0.0415, 0.0557, -0.2040, 1.0570};
    if (f->illuminant[0] == 0 && f->illuminant[1] == 0) {
        ok = ok && raw_tags_put_real(tags, RAW_IFD_MAIN, 50721, RAW_SRATIONAL, 9, srgb) &&
             raw_tags_put_short(tags, RAW_IFD_MAIN, 50778, 21);
    }
    return ok && put_same(tags, RAW_IFD_MAIN, 50728, RAW_RATIONAL, 3, f->as_shot_neutral) &&
           put_same(tags, RAW_IFD_MAIN, 50730, RAW_SRATIONAL, 1, &f->baseline_exposure);
}

static bool put_identity(brace_tags *tags, const brace_frame *f, const char *software) {
    static const uint8_t version[4] = {1, 4, 0, 0}, backward[4] = {1, 1, 0, 0};
    const char *unique = f->unique_model[0] != '\0' ? f->unique_model : f->model[0] != '\0' ? f->model : "Unknown";
    char name[80];
    snprintf(name, sizeof name, "BRACE %s", BRACE_VERSION_STRING);
    return raw_tags_put(tags, RAW_IFD_MAIN, 50706, RAW_BYTE, 4, version) &&
           raw_tags_put(tags, RAW_IFD_MAIN, 50707, RAW_BYTE, 4, backward) &&
           raw_tags_put_text(tags, RAW_IFD_MAIN, 50708, unique) &&
           put_text_or_remove(tags, RAW_IFD_MAIN, 271, f->make) &&
           put_text_or_remove(tags, RAW_IFD_MAIN, 272, f->model) &&
           raw_tags_put_short(tags, RAW_IFD_MAIN, 274, (unsigned)f->orientation) &&
           raw_tags_put_text(tags, RAW_IFD_MAIN, 305, software != NULL && *software != '\0' ? software : name);
}

static bool put_mosaic(brace_tags *tags, const brace_frame *f) {
    uint8_t pattern[4];
    double black[4], noise[6];
    const uint16_t two[2] = {2, 2};
    const uint8_t planes[3] = {0, 1, 2};
    const uint32_t area[4] = {0, 0, f->height, f->width};
    const double origin[2] = {0.0, 0.0}, size[2] = {f->width, f->height};
    for (unsigned i = 0; i < 4; i++) {
        pattern[i] = (uint8_t)brace_cfa_color(f->cfa, i & 1, i >> 1);
        black[i] = (double)f->black[i];
    }
    for (int c = 0; c < 3; c++) {
        noise[2 * c] = f->noise[c][0];
        noise[2 * c + 1] = f->noise[c][1];
    }
    bool ok = raw_tags_put(tags, RAW_IFD_RAW, 33421, RAW_SHORT, 2, two) &&    /* CFARepeatPatternDim */
              raw_tags_put(tags, RAW_IFD_RAW, 33422, RAW_BYTE, 4, pattern) && /* CFAPattern */
              raw_tags_put(tags, RAW_IFD_RAW, 50710, RAW_BYTE, 3, planes) &&  /* CFAPlaneColor */
              raw_tags_put_short(tags, RAW_IFD_RAW, 50711, 1) &&              /* CFALayout */
              raw_tags_put(tags, RAW_IFD_RAW, 50713, RAW_SHORT, 2, two) &&    /* BlackLevelRepeatDim */
              raw_tags_put_real(tags, RAW_IFD_RAW, 50714, RAW_RATIONAL, 4, black) &&
              raw_tags_put_long(tags, RAW_IFD_RAW, 50717, (uint32_t)lrintf(f->white)) &&
              raw_tags_put_real(tags, RAW_IFD_RAW, 50719, RAW_RATIONAL, 2, origin) && /* DefaultCropOrigin */
              raw_tags_put_real(tags, RAW_IFD_RAW, 50720, RAW_RATIONAL, 2, size) &&   /* DefaultCropSize */
              raw_tags_put(tags, RAW_IFD_RAW, 50829, RAW_LONG, 4, area);              /* ActiveArea */
    if (f->has_noise) {
        return ok && put_same(tags, RAW_IFD_RAW, 51041, RAW_DOUBLE, 6, noise);
    }
    raw_tags_remove(tags, RAW_IFD_RAW, 51041);
    return ok;
}

/* A frame that no reader could make sense of is refused before it becomes a file. */
static brace_status check_frame(const brace_frame *f, const char *name, brace_error *error) {
    const char *wrong = NULL;
    if (f->width < 4 || f->height < 4 || f->width > BRACE_MAX_SIDE || f->height > BRACE_MAX_SIDE || f->data == NULL) {
        wrong = "the frame has no pixels or a size outside the limits";
    } else if ((int)f->cfa < BRACE_CFA_RGGB || (int)f->cfa > BRACE_CFA_BGGR) {
        wrong = "the frame's colour filter order is not one of the four of Bayer";
    } else if (f->orientation < 1 || f->orientation > 8) {
        wrong = "the frame's orientation is not 1 to 8";
    } else if (!(f->white >= 1.0f && f->white <= 65535.0f)) {
        wrong = "the frame's white level is not 1 to 65535";
    } else if (!isfinite(f->baseline_exposure)) {
        wrong = "the frame's baseline exposure is not a number";
    }
    for (int i = 0; i < 4 && wrong == NULL; i++) {
        if (!(f->black[i] >= 0.0f && f->black[i] < f->white)) {
            wrong = "the frame's black level is not between 0 and its white level";
        }
    }
    for (int i = 0; i < 3 && wrong == NULL; i++) {
        if (!(f->as_shot_neutral[i] > 0.0 && f->as_shot_neutral[i] < 1e6)) {
            wrong = "the frame's neutral colour (AsShotNeutral) is not above 0";
        }
    }
    for (int i = 0; i < 18 && wrong == NULL; i++) {
        if (f->illuminant[i / 9] != 0 && !(fabs(f->color_matrix[i / 9][i % 9]) < 1e6)) {
            wrong = "the frame's colour matrix holds a value that is not a number";
        }
    }
    return wrong == NULL ? BRACE_OK : core_fail(error, BRACE_ERROR_ARGUMENT, "%s cannot be written: %s", name, wrong);
}

brace_status raw_dng_encode(void **data, size_t *size, const brace_frame *frame, const brace_dng_params *params,
                            const brace_job *job, const char *name, brace_error *error) {
    static const brace_dng_params none = {0};
    params = params != NULL ? params : &none;
    *data = NULL;
    *size = 0;
    brace_status status = check_frame(frame, name, error);
    if (status != BRACE_OK) {
        return status;
    }
    brace_image *preview = NULL;
    if (!params->no_preview) {
        status = raw_dng_preview(&preview, frame, params->preview, job, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    brace_tags *tags = raw_tags_clone(frame->tags);
    if (tags == NULL || !put_identity(tags, frame, params->software) || !put_exif(tags, frame) ||
        !put_color(tags, frame) || !put_mosaic(tags, frame)) {
        status = core_fail_memory(error, 4096, "the tags of a DNG");
    }
    if (status == BRACE_OK) {
        status = core_check_cancel(job, error);
    }
    if (status == BRACE_OK) {
        status = raw_dng_assemble(data, size, tags, frame, preview, name, error);
    }
    raw_tags_destroy(tags);
    brace_image_destroy(preview);
    return status;
}

brace_status brace_frame_write_dng(const brace_frame *frame, const char *path, const brace_dng_params *params,
                                   const brace_job *job, brace_error *error) {
    if (frame == NULL || path == NULL) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "a frame and a file name to write it to are needed");
    }
    /* The name is tried first: no work is done for a folder that cannot be written to. */
    core_file *file = NULL;
    brace_status status = core_file_create(&file, path, error);
    if (status != BRACE_OK) {
        return status;
    }
    void *data = NULL;
    size_t size = 0;
    status = raw_dng_encode(&data, &size, frame, params, job, path, error);
    if (status == BRACE_OK) {
        if (fwrite(data, 1, size, core_file_stream(file)) != size) {
            status = core_fail(error, BRACE_ERROR_IO, "%s: cannot write: %s", path, strerror(errno));
        } else {
            status = core_check_cancel(job, error);
        }
    }
    core_free(data);
    if (status != BRACE_OK) {
        core_file_abort(file);
        return status;
    }
    return params != NULL && params->no_sync ? core_file_commit_unsynced(file, error) : core_file_commit(file, error);
}
