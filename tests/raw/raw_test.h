/* SPDX-License-Identifier: Apache-2.0 */
/*
 * raw_test.h: what the tests of the RAW module share: a folder of their own,
 * and DNGs written with libtiff directly, so that the reader is tried on files
 * that BRACE's own writer did not make.
 */
#ifndef RAW_TEST_H
#define RAW_TEST_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>
#include <tiffio.h>

#include "raw/raw.h"

static char test_folder[64];
static char test_notes[4096];

__attribute__((unused)) static int make_folder(void **state) {
    (void)state;
    snprintf(test_folder, sizeof test_folder, "/tmp/brace-raw-XXXXXX");
    return mkdtemp(test_folder) == NULL ? -1 : 0;
}

__attribute__((unused)) static int remove_folder(void **state) {
    (void)state;
    char command[128];
    snprintf(command, sizeof command, "rm -rf '%s'", test_folder);
    return system(command);
}

__attribute__((unused)) static const char *in_folder(const char *name) {
    static char paths[8][160];
    static int next;
    char *path = paths[next++ % 8];
    snprintf(path, sizeof paths[0], "%s/%s", test_folder, name);
    return path;
}

/* Gathers notes for a test to look into. */
__attribute__((unused)) static void gather_note(void *user, const char *message) {
    (void)user;
    size_t n = strlen(test_notes);
    snprintf(test_notes + n, sizeof test_notes - n, "%s\n", message);
}

__attribute__((unused)) static brace_job noting_job(void) {
    test_notes[0] = '\0';
    return (brace_job){.threads = 2, .note = gather_note};
}

/* A DNG as a stranger writes it. Zeros mean usual values. */
typedef struct test_dng {
    uint32_t width, height;            /* of the sensor */
    uint32_t top, left, bottom, right; /* active area; none if bottom is 0 */
    brace_cfa cfa;                     /* at the active area's origin */
    int orientation;
    int photometric; /* 0: CFA */
    int compression; /* 0: none */
    bool is_float, xtrans, no_exposure, no_color, no_exif;
    double exposure_time, f_number;
    int iso;
    const char *model;
    uint16_t black_rows, black_columns;
    float black[16]; /* 512 each if black_rows is 0 */
    uint32_t white;
    uint16_t (*pixel)(uint32_t x, uint32_t y); /* of the sensor; NULL: pixel_of */
} test_dng;

/* A value that tells where it came from. */
__attribute__((unused)) static uint16_t pixel_of(uint32_t x, uint32_t y) {
    return (uint16_t)(600 + (x * 131 + y * 2749) % 15000);
}

static const TIFFFieldInfo test_fields[] = {
    {51041, -1, -1, TIFF_DOUBLE, FIELD_CUSTOM, 1, 1, (char *)(uintptr_t) "NoiseProfile"},
};

__attribute__((unused)) static void write_test_dng(const char *path, const test_dng *d) {
    static const uint8_t patterns[4][4] = {{0, 1, 1, 2}, {1, 0, 2, 1}, {1, 2, 0, 1}, {2, 1, 1, 0}};
    static const uint8_t xtrans[36] = {1, 1, 0, 1, 1, 2, 1, 1, 2, 1, 1, 0, 2, 0, 1, 0, 2, 1,
                                       1, 1, 2, 1, 1, 0, 1, 1, 0, 1, 1, 2, 0, 2, 1, 2, 0, 1};
    static const float matrix[9] = {0.8664f, -0.2887f, -0.1083f, -0.249f, 1.1252f, 0.1023f, 0.0407f, 0.0684f, 0.4f};
    static const float neutral[3] = {0.5f, 1.0f, 0.625f};
    static const double noise[6] = {2.5e-4, 5e-7, 2.25e-4, 4e-7, 2.75e-4, 6e-7};
    uint16_t iso = (uint16_t)(d->iso != 0 ? d->iso : 400);
    uint16_t two[2] = {d->xtrans ? 6 : 2, d->xtrans ? 6 : 2};
    uint32_t white = d->white != 0 ? d->white : 16383;
    uint16_t samples = d->photometric == 34892 ? 3 : 1, bits = d->is_float ? 32 : 16;
    uint64_t exif = 0;

    TIFF *t = TIFFOpen(path, "wl");
    assert_non_null(t);
    TIFFMergeFieldInfo(t, test_fields, 1);
    if (!d->no_exif) {
        TIFFCreateEXIFDirectory(t);
        if (!d->no_exposure) {
            TIFFSetField(t, EXIFTAG_EXPOSURETIME, d->exposure_time > 0 ? d->exposure_time : 0.01);
            TIFFSetField(t, EXIFTAG_ISOSPEEDRATINGS, 1, &iso);
            if (d->f_number >= 0.0) {
                TIFFSetField(t, EXIFTAG_FNUMBER, d->f_number > 0 ? d->f_number : 2.8);
            }
        }
        TIFFSetField(t, EXIFTAG_DATETIMEORIGINAL, "2026:05:04 03:02:01");
        TIFFSetField(t, EXIFTAG_LENSMODEL, "Test 35mm F2");
        TIFFSetField(t, EXIFTAG_MAKERNOTE, 9, "maker\0\1\2\3");
        TIFFWriteCustomDirectory(t, &exif);
        TIFFFreeDirectory(t);
        TIFFCreateDirectory(t);
        TIFFMergeFieldInfo(t, test_fields, 1);
        TIFFSetField(t, TIFFTAG_EXIFIFD, exif);
    }
    TIFFSetField(t, TIFFTAG_SUBFILETYPE, 0);
    TIFFSetField(t, TIFFTAG_IMAGEWIDTH, d->width);
    TIFFSetField(t, TIFFTAG_IMAGELENGTH, d->height);
    TIFFSetField(t, TIFFTAG_BITSPERSAMPLE, bits);
    TIFFSetField(t, TIFFTAG_SAMPLEFORMAT, d->is_float ? SAMPLEFORMAT_IEEEFP : SAMPLEFORMAT_UINT);
    TIFFSetField(t, TIFFTAG_SAMPLESPERPIXEL, samples);
    TIFFSetField(t, TIFFTAG_COMPRESSION, d->compression != 0 ? d->compression : COMPRESSION_NONE);
    TIFFSetField(t, TIFFTAG_PHOTOMETRIC, d->photometric != 0 ? d->photometric : PHOTOMETRIC_CFA);
    TIFFSetField(t, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    TIFFSetField(t, TIFFTAG_ROWSPERSTRIP, d->height);
    TIFFSetField(t, TIFFTAG_MAKE, "Tester");
    TIFFSetField(t, TIFFTAG_MODEL, d->model != NULL ? d->model : "One");
    TIFFSetField(t, TIFFTAG_UNIQUECAMERAMODEL, d->model != NULL ? d->model : "Tester One");
    TIFFSetField(t, TIFFTAG_ORIENTATION, d->orientation != 0 ? d->orientation : 1);
    TIFFSetField(t, TIFFTAG_ARTIST, "A. Photographer");
    TIFFSetField(t, TIFFTAG_COPYRIGHT, "(c) A. Photographer");
    TIFFSetField(t, TIFFTAG_DNGVERSION, "\1\4\0\0");
    TIFFSetField(t, TIFFTAG_DNGBACKWARDVERSION, "\1\1\0\0");
    if (samples == 1) {
        TIFFSetField(t, TIFFTAG_CFAREPEATPATTERNDIM, two);
        TIFFSetField(t, TIFFTAG_CFAPATTERN, two[0] * two[1], d->xtrans ? xtrans : patterns[d->cfa]);
    }
    if (!d->no_color) {
        TIFFSetField(t, TIFFTAG_COLORMATRIX1, 9, matrix);
        TIFFSetField(t, TIFFTAG_ASSHOTNEUTRAL, 3, neutral);
        TIFFSetField(t, TIFFTAG_CALIBRATIONILLUMINANT1, 21);
        TIFFSetField(t, 51041, 6, noise);
    }
    float black[16] = {512, 512, 512, 512};
    uint16_t repeat[2] = {2, 2};
    if (d->black_rows != 0) {
        memcpy(black, d->black, sizeof black);
        repeat[0] = d->black_rows;
        repeat[1] = d->black_columns;
    }
    TIFFSetField(t, TIFFTAG_BLACKLEVELREPEATDIM, repeat);
    TIFFSetField(t, TIFFTAG_BLACKLEVEL, repeat[0] * repeat[1], black);
    TIFFSetField(t, TIFFTAG_WHITELEVEL, 1, &white);
    if (d->bottom != 0) {
        uint32_t area[4] = {d->top, d->left, d->bottom, d->right};
        TIFFSetField(t, TIFFTAG_ACTIVEAREA, area);
    }
    uint8_t *row = calloc((size_t)d->width * samples, 4);
    for (uint32_t y = 0; y < d->height; y++) {
        for (uint32_t x = 0; x < d->width * samples; x++) {
            uint16_t v = (d->pixel != NULL ? d->pixel : pixel_of)(x, y);
            float f = (float)v / 16383.0f;
            memcpy(row + (size_t)x * (d->is_float ? 4 : 2), d->is_float ? (void *)&f : (void *)&v, d->is_float ? 4 : 2);
        }
        assert_int_equal(TIFFWriteScanline(t, row, y, 0), 1);
    }
    free(row);
    TIFFClose(t);
}

__attribute__((unused)) static void write_bytes(const char *path, const void *bytes, size_t n) {
    FILE *f = fopen(path, "wb");
    assert_non_null(f);
    assert_int_equal(fwrite(bytes, 1, n, f), n);
    fclose(f);
}

__attribute__((unused)) static brace_frame *read_frame(const char *path) {
    brace_frame *frame = NULL;
    brace_error error = {0};
    if (brace_frame_read(&frame, path, NULL, &error) != BRACE_OK) {
        fail_msg("%s", error.message);
    }
    return frame;
}

/* Everything but path and tags. */
__attribute__((unused)) static void assert_same_frame(const brace_frame *a, const brace_frame *b) {
    assert_int_equal(a->width, b->width);
    assert_int_equal(a->height, b->height);
    assert_int_equal(a->cfa, b->cfa);
    assert_memory_equal(a->data, b->data, (size_t)a->width * a->height * 2);
    assert_memory_equal(a->black, b->black, sizeof a->black);
    assert_true(a->white == b->white);
    assert_true(a->exposure_time == b->exposure_time);
    assert_true(a->iso == b->iso);
    assert_true(a->f_number == b->f_number);
    assert_true(a->focal_length == b->focal_length);
    assert_true(a->baseline_exposure == b->baseline_exposure);
    assert_memory_equal(a->as_shot_neutral, b->as_shot_neutral, sizeof a->as_shot_neutral);
    assert_memory_equal(a->color_matrix, b->color_matrix, sizeof a->color_matrix);
    assert_memory_equal(a->illuminant, b->illuminant, sizeof a->illuminant);
    assert_memory_equal(a->noise, b->noise, sizeof a->noise);
    assert_int_equal(a->has_noise, b->has_noise);
    assert_int_equal(a->orientation, b->orientation);
    assert_string_equal(a->make, b->make);
    assert_string_equal(a->model, b->model);
    assert_string_equal(a->unique_model, b->unique_model);
    assert_string_equal(a->datetime, b->datetime);
    assert_string_equal(a->subsec, b->subsec);
}

#endif
