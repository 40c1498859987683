/* SPDX-License-Identifier: Apache-2.0 */
/*
 * read_meta.c: what a file says of itself, made trustworthy.
 *
 * Where the file is a TIFF the tags' own fractions are taken, as LibRaw's floats
 * have lost digits; LibRaw knows the rest: what makers hide elsewhere, and the
 * colour of the cameras that write no matrix. Every number is checked; one that
 * cannot be true gets the neutral value and a note.
 */
#include <libraw/libraw.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "raw/raw.h"

typedef struct reader {
    brace_frame *frame;
    const libraw_data_t *raw;
    const raw_area *area;
    const brace_tags *tags;
    const char *name;
    const brace_job *job;
    bool dng;
} reader;

/* A tag of the raw directory, which is often the first one. */
static const raw_tag *raw_or_main(const brace_tags *tags, unsigned tag) {
    const raw_tag *t = raw_tags_find(tags, RAW_IFD_RAW, tag);
    return t != NULL ? t : raw_tags_find(tags, RAW_IFD_MAIN, tag);
}

/* A shooting tag: EXIF, or the first directory as TIFF/EP has it. */
static const raw_tag *exif_or_main(const brace_tags *tags, unsigned tag) {
    const raw_tag *t = raw_tags_find(tags, RAW_IFD_EXIF, tag);
    return t != NULL ? t : raw_tags_find(tags, RAW_IFD_MAIN, tag);
}

static double positive(double value, double most) {
    return value > 0.0 && value <= most ? value : 0.0; /* NaN fails both */
}

/* ---- exposure ---- */

static double shooting_number(const reader *r, unsigned tag, float fallback, double most) {
    double value = positive(raw_tag_number(exif_or_main(r->tags, tag), 0), most);
    return value > 0.0 ? value : positive(raw_from_float(fallback), most);
}

static void read_exposure(const reader *r) {
    const libraw_imgother_t *o = &r->raw->other;
    brace_frame *f = r->frame;
    f->exposure_time = shooting_number(r, 33434, o->shutter, 1e5);
    f->f_number = shooting_number(r, 33437, o->aperture, 1e3);
    f->focal_length = shooting_number(r, 37386, o->focal_len, 1e5);
    f->iso = shooting_number(r, 34855, o->iso_speed, 1e8);
    if (f->iso == 65535.0) {
        /* EXIF 2.3: the 16-bit tag is full, the true number is in one of these. */
        static const unsigned longer[] = {34867, 34866, 34865};
        for (size_t i = 0; i < 3; i++) {
            double iso = positive(raw_tag_number(exif_or_main(r->tags, longer[i]), 0), 1e8);
            if (iso > 65535.0) {
                f->iso = iso;
                break;
            }
        }
    }
    double ev = r->dng ? raw_tag_number(raw_tags_find(r->tags, RAW_IFD_MAIN, 50730), 0) : (double)NAN;
    f->baseline_exposure = fabs(ev) <= 20.0 ? ev : 0.0;
    if (f->exposure_time == 0.0) {
        core_note(r->job, "%s does not say its exposure time", r->name);
    }
}

/* ---- levels ---- */

/* LibRaw splits black into a common part, one for each colour, and a pattern that
 * starts at the active area's origin (subtract_black_internal in LibRaw's source;
 * the same for DNG's BlackLevel, DNG 1.6 chapter 4). Larger patterns are averaged. */
static double black_at(const reader *r, unsigned x, unsigned y) {
    const libraw_colordata_t *c = &r->raw->color;
    double black = c->black;
    int color = raw_color_at(r->raw, r->area, (int)x, (int)y);
    black += color >= 0 && color < 4 ? c->cblack[color] : 0;
    unsigned rows = c->cblack[4], columns = c->cblack[5];
    if (rows == 0 || columns == 0 || rows > LIBRAW_CBLACK_SIZE || columns > LIBRAW_CBLACK_SIZE ||
        rows * columns > LIBRAW_CBLACK_SIZE - 6) {
        return black;
    }
    /* Which of the pattern's cells fall on this corner of the 2 x 2 block: all of a side if it is odd. */
    double sum = 0.0;
    unsigned n = 0;
    for (unsigned v = 0; v < rows * 2; v++) {
        for (unsigned u = 0; u < columns * 2; u++) {
            if ((v & 1) == y && (u & 1) == x) {
                sum += c->cblack[6 + (v % rows) * columns + u % columns];
                n++;
            }
        }
    }
    return black + sum / n;
}

/* BlackLevel of a DNG with its fractions, which LibRaw cuts off; NaN where the tags
 * have none, or more than this (BlackLevelDelta) goes into black. */
static double dng_black_at(const reader *r, unsigned x, unsigned y) {
    const raw_tag *levels = raw_or_main(r->tags, 50714);
    if (!r->dng || levels == NULL || raw_or_main(r->tags, 50715) != NULL || raw_or_main(r->tags, 50716) != NULL) {
        return (double)NAN;
    }
    const raw_tag *dim = raw_or_main(r->tags, 50713);
    double rows = dim != NULL ? raw_tag_number(dim, 0) : 1.0, columns = dim != NULL ? raw_tag_number(dim, 1) : 1.0;
    if (!((rows == 1.0 || rows == 2.0) && (columns == 1.0 || columns == 2.0)) || rows * columns > levels->count) {
        return (double)NAN;
    }
    return raw_tag_number(levels, (y % (unsigned)rows) * (unsigned)columns + x % (unsigned)columns);
}

static void read_levels(const reader *r) {
    const libraw_colordata_t *c = &r->raw->color;
    brace_frame *f = r->frame;
    for (unsigned i = 0; i < 4; i++) {
        double black = black_at(r, i & 1, i >> 1);
        double exact = dng_black_at(r, i & 1, i >> 1);
        /* Where both agree but for the fraction, the fraction is right. */
        f->black[i] = (float)(exact >= 0.0 && fabs(exact - black) <= 1.0 ? exact : black);
    }
    double white = c->maximum;
    if (!r->dng) {
        /* The makers' own clipping level, the lowest of the four channels. */
        double lowest = HUGE_VAL;
        for (int i = 0; i < 4; i++) {
            double level = (double)c->linear_max[i];
            lowest = level < lowest ? level : lowest;
        }
        if (lowest > 0.5 * white && lowest < white) {
            white = lowest;
        }
    }
    float top = 0.0f;
    for (int i = 0; i < 4; i++) {
        if (!(f->black[i] >= 0.0f && f->black[i] < 65535.0f)) {
            core_note(r->job, "%s: black level %g makes no sense, 0 assumed", r->name, (double)f->black[i]);
            f->black[i] = 0.0f;
        }
        top = f->black[i] > top ? f->black[i] : top;
    }
    if (!(white > (double)top) || white > 65535.0) {
        core_note(r->job, "%s: white level %.0f makes no sense for black level %g, 65535 assumed", r->name, white,
                  (double)top);
        white = 65535.0;
    }
    f->white = (float)white;
}

/* ---- colour ---- */

static double determinant(const double m[9]) {
    return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6]);
}

static bool usable_matrix(const double m[9]) {
    double size = 0.0;
    for (int i = 0; i < 9; i++) {
        if (!isfinite(m[i]) || fabs(m[i]) > 100.0) {
            return false;
        }
        size = fmax(size, fabs(m[i]));
    }
    return fabs(determinant(m)) > 1e-6 * size * size * size;
}

/* DNG chapter 6: XYZ to camera is AnalogBalance * CameraCalibration * ColorMatrix.
 * A frame has one matrix for the three, so they are multiplied here; the two tags
 * are then dropped from what is written. */
static bool dng_matrix(const reader *r, int index, double out[9]) {
    const raw_tag *matrix = raw_tags_find(r->tags, RAW_IFD_MAIN, index == 0 ? 50721 : 50722);
    if (matrix == NULL || matrix->count != 9) {
        return false;
    }
    for (uint32_t i = 0; i < 9; i++) {
        out[i] = raw_tag_number(matrix, i);
    }
    double calibration[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    bool changed = false;
    const raw_tag *tag = raw_tags_find(r->tags, RAW_IFD_MAIN, index == 0 ? 50723 : 50724);
    char camera[128], profile[128];
    raw_tag_text(raw_tags_find(r->tags, RAW_IFD_MAIN, 50931), camera, sizeof camera);
    raw_tag_text(raw_tags_find(r->tags, RAW_IFD_MAIN, 50932), profile, sizeof profile);
    double values[9];
    if (tag != NULL && tag->count == 9 && strcmp(camera, profile) == 0) {
        for (uint32_t i = 0; i < 9; i++) {
            values[i] = raw_tag_number(tag, i);
        }
        if (usable_matrix(values)) {
            changed = memcmp(values, calibration, sizeof values) != 0;
            memcpy(calibration, values, sizeof values);
        }
    }
    tag = raw_tags_find(r->tags, RAW_IFD_MAIN, 50727);
    if (tag != NULL && tag->count == 3) {
        for (uint32_t i = 0; i < 3; i++) {
            double balance = raw_tag_number(tag, i);
            if (balance > 0.0 && balance <= 100.0 && balance != 1.0) {
                for (uint32_t k = 0; k < 3; k++) {
                    calibration[3 * i + k] *= balance;
                }
                changed = true;
            }
        }
    }
    if (changed) {
        double product[9];
        for (int i = 0; i < 9; i++) {
            const double *row = calibration + i / 3 * 3;
            product[i] = raw_representable(row[0] * out[i % 3] + row[1] * out[3 + i % 3] + row[2] * out[6 + i % 3]);
        }
        memcpy(out, product, sizeof product);
    }
    return true;
}

static void read_matrices(const reader *r) {
    brace_frame *f = r->frame;
    const libraw_colordata_t *c = &r->raw->color;
    int n = 0;
    for (int i = 0; i < 2 && r->dng; i++) {
        double m[9];
        if (!dng_matrix(r, i, m)) {
            continue;
        }
        double light = raw_tag_number(raw_tags_find(r->tags, RAW_IFD_MAIN, i == 0 ? 50778 : 50779), 0);
        if (!usable_matrix(m)) {
            core_note(r->job, "%s: ColorMatrix%d cannot be inverted and is ignored", r->name, i + 1);
            continue;
        }
        memcpy(f->color_matrix[n], m, sizeof m);
        /* DNG: without an illuminant it is unknown, 0, which frames keep for no matrix; D65 is the usual one. */
        f->illuminant[n++] = light >= 1.0 && light <= 255.0 ? (uint16_t)light : 21;
    }
    if (n == 0) {
        double m[9], size = 0.0;
        for (int i = 0; i < 9; i++) {
            m[i] = raw_from_float(c->cam_xyz[i / 3][i % 3]);
            size += fabs(m[i]);
        }
        if (size > 0.0 && usable_matrix(m)) {
            memcpy(f->color_matrix[0], m, sizeof m);
            f->illuminant[0] = 21; /* LibRaw's table is Adobe's, for D65 */
            n = 1;
        }
    }
    if (n == 0) {
        core_note(r->job, "%s has no colour matrix and its camera is not known: its colours will be raw", r->name);
    }
}

static void read_neutral(const reader *r) {
    brace_frame *f = r->frame;
    const raw_tag *tag = r->dng ? raw_tags_find(r->tags, RAW_IFD_MAIN, 50728) : NULL;
    double n[3] = {0.0, 0.0, 0.0};
    if (tag != NULL && tag->count == 3) {
        for (uint32_t i = 0; i < 3; i++) {
            n[i] = raw_tag_number(tag, i);
        }
        if (n[1] > 0.0 && n[1] != 1.0) {
            n[0] = raw_representable(n[0] / n[1]);
            n[2] = raw_representable(n[2] / n[1]);
            n[1] = 1.0;
        }
    } else {
        const float *mul = r->raw->color.cam_mul;
        if (mul[0] > 0.0f && mul[1] > 0.0f && mul[2] > 0.0f) {
            n[0] = raw_representable((double)mul[1] / (double)mul[0]);
            n[1] = 1.0;
            n[2] = raw_representable((double)mul[1] / (double)mul[2]);
        }
    }
    for (int i = 0; i < 3; i++) {
        if (!(n[i] >= 1e-3 && n[i] <= 1e3)) {
            core_note(r->job, "%s does not say its white balance (AsShotNeutral): none is applied", r->name);
            return;
        }
    }
    memcpy(f->as_shot_neutral, n, sizeof n);
}

/* ---- noise ---- */

void raw_noise_from_iso(double noise[3][2], double iso) {
    /* Shot noise grows with gain. S = 6e-5 at ISO 100 is what phones record in
     * NoiseProfile at base ISO (5.0e-5 to 7.9e-5 on Pixels); read noise follows by
     * the log-linear fit of Brooks et al., Unprocessing Images for Learned Raw
     * Denoising, CVPR 2019: ln O = 2.18 ln S + 1.20. */
    double s = 6e-5 * (iso > 0.0 ? iso : 100.0) / 100.0;
    s = fmin(fmax(s, 1e-6), 0.1);
    for (int c = 0; c < 3; c++) {
        noise[c][0] = s;
        noise[c][1] = exp(2.18 * log(s) + 1.20);
    }
}

static void read_noise(const reader *r) {
    brace_frame *f = r->frame;
    const raw_tag *tag = r->dng ? raw_or_main(r->tags, 51041) : NULL;
    raw_noise_from_iso(f->noise, f->iso);
    f->has_noise = false;
    if (tag == NULL || tag->type != RAW_DOUBLE || (tag->count != 2 && tag->count != 6 && tag->count != 8)) {
        return;
    }
    double noise[3][2];
    for (uint32_t c = 0; c < 3; c++) {
        for (uint32_t k = 0; k < 2; k++) {
            double value = raw_tag_number(tag, tag->count == 2 ? k : 2 * c + k);
            if (tag->count == 8) {
                /* Android's habit: one pair for each CFA position. */
                double sum = 0.0;
                uint32_t n = 0;
                for (uint32_t i = 0; i < 4; i++) {
                    if (brace_cfa_color(f->cfa, i & 1, i >> 1) == (int)c) {
                        sum += raw_tag_number(tag, 2 * i + k);
                        n++;
                    }
                }
                value = sum / n;
            }
            if (!(value >= 0.0 && value <= 1.0)) {
                core_note(r->job, "%s: its noise profile makes no sense; noise is estimated from the ISO", r->name);
                return;
            }
            noise[c][k] = value;
        }
        if (noise[c][0] + noise[c][1] <= 0.0) {
            core_note(r->job, "%s: its noise profile is zero; noise is estimated from the ISO", r->name);
            return;
        }
    }
    memcpy(f->noise, noise, sizeof noise);
    f->has_noise = true;
}

/* ---- identity ---- */

static void read_orientation(const reader *r) {
    double own = raw_tag_number(raw_tags_find(r->tags, RAW_IFD_MAIN, 274), 0);
    if (own >= 1.0 && own <= 8.0) {
        r->frame->orientation = (int)own; /* LibRaw's flip knows no mirrored ones */
        return;
    }
    switch (r->raw->sizes.flip) {
    case 3:
        r->frame->orientation = 3;
        break;
    case 5:
        r->frame->orientation = 8;
        break;
    case 6:
        r->frame->orientation = 6;
        break;
    default:
        r->frame->orientation = 1;
        break;
    }
}

static void copy_text(char *out, size_t size, const raw_tag *tag, const char *fallback, size_t most) {
    raw_tag_text(tag, out, size);
    if (out[0] == '\0') {
        size_t n = strnlen(fallback, most);
        n = n < size ? n : size - 1;
        for (size_t i = 0; i < n; i++) {
            out[i] = (unsigned char)fallback[i] < 32 || fallback[i] == 127 ? ' ' : fallback[i];
        }
        out[n] = '\0';
    }
}

static void read_identity(const reader *r) {
    brace_frame *f = r->frame;
    const libraw_iparams_t *id = &r->raw->idata;
    copy_text(f->make, sizeof f->make, raw_tags_find(r->tags, RAW_IFD_MAIN, 271), id->make, sizeof id->make);
    copy_text(f->model, sizeof f->model, raw_tags_find(r->tags, RAW_IFD_MAIN, 272), id->model, sizeof id->model);
    raw_tag_text(r->dng ? raw_tags_find(r->tags, RAW_IFD_MAIN, 50708) : NULL, f->unique_model, sizeof f->unique_model);
    if (f->unique_model[0] == '\0') {
        /* LibRaw's names are the ones that raw developers know the camera by. */
        snprintf(f->unique_model, sizeof f->unique_model, "%.60s%s%.60s", id->make, id->make[0] != '\0' ? " " : "",
                 id->model);
    }
    const raw_tag *date = exif_or_main(r->tags, 36867);
    raw_tag_text(date != NULL ? date : raw_tags_find(r->tags, RAW_IFD_MAIN, 306), f->datetime, sizeof f->datetime);
    if (strlen(f->datetime) != 19 || f->datetime[0] == ' ' || f->datetime[0] == '0') {
        struct tm parts;
        time_t when = r->raw->other.timestamp;
        f->datetime[0] = '\0';
        if (when > 0 && localtime_r(&when, &parts) != NULL) {
            strftime(f->datetime, sizeof f->datetime, "%Y:%m:%d %H:%M:%S", &parts);
        }
    }
    raw_tag_text(exif_or_main(r->tags, 37521), f->subsec, sizeof f->subsec);
    if (f->subsec[strspn(f->subsec, "0123456789")] != '\0') {
        f->subsec[0] = '\0';
    }
}

/* Formats that are no TIFF keep at least what LibRaw found: lens, artist, description. */
static brace_status basic_tags(const reader *r, brace_error *error) {
    const libraw_imgother_t *o = &r->raw->other;
    const libraw_lensinfo_t *l = &r->raw->lens;
    const libraw_shootinginfo_t *s = &r->raw->shootinginfo;
    const struct {
        raw_ifd ifd;
        unsigned tag;
        const char *text;
        size_t most;
    } texts[] = {
        {RAW_IFD_MAIN, 270, o->desc, sizeof o->desc},
        {RAW_IFD_MAIN, 315, o->artist, sizeof o->artist},
        {RAW_IFD_EXIF, 42033, s->BodySerial, sizeof s->BodySerial},
        {RAW_IFD_EXIF, 42035, l->LensMake, sizeof l->LensMake},
        {RAW_IFD_EXIF, 42036, l->Lens, sizeof l->Lens},
        {RAW_IFD_EXIF, 42037, l->LensSerial, sizeof l->LensSerial},
    };
    brace_tags *tags = raw_tags_create();
    bool ok = tags != NULL;
    for (size_t i = 0; ok && i < sizeof texts / sizeof texts[0]; i++) {
        char text[513];
        copy_text(text, sizeof text, NULL, texts[i].text, texts[i].most);
        ok = text[0] == '\0' || raw_tags_put_text(tags, texts[i].ifd, texts[i].tag, text);
    }
    if (!ok) {
        raw_tags_destroy(tags);
        return core_fail_memory(error, sizeof *tags, "the file's metadata");
    }
    r->frame->tags = tags;
    return BRACE_OK;
}

brace_status raw_read_metadata(brace_frame *frame, const void *raw, const raw_area *area, const brace_tags *tags,
                               const char *name, const brace_job *job, brace_error *error) {
    const libraw_data_t *data = raw;
    reader r = {.frame = frame,
                .raw = data,
                .area = area,
                .tags = tags,
                .name = raw_name(name),
                .job = job,
                .dng = data->idata.dng_version != 0 && tags != NULL};
    read_exposure(&r);
    read_levels(&r);
    read_matrices(&r);
    read_neutral(&r);
    read_noise(&r);
    read_orientation(&r);
    read_identity(&r);
    return tags == NULL || tags->count == 0 ? basic_tags(&r, error) : BRACE_OK;
}
