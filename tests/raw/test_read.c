/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_read.c: what the reader takes from a file and how it refuses others.
 */
#include <math.h>

#include "raw_test.h"

/* Each CFA order, with origins of the active area that shift it by every parity, in each orientation. */
static void test_cfa_origin_orientation(void **state) {
    (void)state;
    for (int cfa = 0; cfa < 4; cfa++) {
        for (uint32_t origin = 0; origin < 4; origin++) {
            for (int orientation = 1; orientation <= 8; orientation++) {
                test_dng d = {.width = 40,
                              .height = 34,
                              .top = 2 + (origin >> 1),
                              .left = 4 + (origin & 1),
                              .bottom = 31,
                              .right = 39,
                              .cfa = (brace_cfa)cfa,
                              .orientation = orientation};
                write_test_dng(in_folder("cfa.dng"), &d);
                brace_frame *f = read_frame(in_folder("cfa.dng"));
                assert_int_equal(f->width, d.right - d.left);
                assert_int_equal(f->height, d.bottom - d.top);
                assert_int_equal(f->cfa, cfa);
                assert_int_equal(f->orientation, orientation);
                for (uint32_t y = 0; y < f->height; y++) {
                    for (uint32_t x = 0; x < f->width; x++) {
                        assert_int_equal(f->data[y * f->width + x], pixel_of(x + d.left, y + d.top));
                    }
                }
                brace_frame_destroy(f);
            }
        }
    }
}

static void test_metadata(void **state) {
    (void)state;
    test_dng d = {.width = 32, .height = 24, .exposure_time = 1.0 / 640.0, .iso = 320, .f_number = 1.8, .white = 4000};
    write_test_dng(in_folder("meta.dng"), &d);
    brace_job job = noting_job();
    brace_frame *f = NULL;
    assert_int_equal(brace_frame_read(&f, in_folder("meta.dng"), &job, NULL), BRACE_OK);
    assert_string_equal(test_notes, "");
    assert_true(fabs(f->exposure_time * 640.0 - 1.0) < 1e-6);
    assert_true(f->iso == 320.0 && fabs(f->f_number - 1.8) < 1e-6);
    assert_true(f->white == 4000.0f && f->black[0] == 512.0f);
    assert_true(f->as_shot_neutral[0] == 0.5 && f->as_shot_neutral[1] == 1.0 && f->as_shot_neutral[2] == 0.625);
    assert_true(fabs(f->color_matrix[0][0] - 0.8664) < 1e-6);
    assert_int_equal(f->illuminant[0], 21);
    assert_int_equal(f->illuminant[1], 0);
    assert_true(f->has_noise && f->noise[1][0] == 2.25e-4 && f->noise[2][1] == 6e-7);
    assert_string_equal(f->make, "Tester");
    assert_string_equal(f->model, "One");
    assert_string_equal(f->unique_model, "Tester One");
    assert_string_equal(f->datetime, "2026:05:04 03:02:01");
    assert_string_equal(f->path, in_folder("meta.dng"));
    char text[32];
    raw_tag_text(raw_tags_find(f->tags, RAW_IFD_MAIN, 315), text, sizeof text);
    assert_string_equal(text, "A. Photographer");
    brace_frame_destroy(f);
}

static void test_missing_metadata(void **state) {
    (void)state;
    test_dng d = {.width = 32, .height = 24, .no_exposure = true, .no_color = true};
    write_test_dng(in_folder("bare.dng"), &d);
    brace_job job = noting_job();
    brace_frame *f = NULL;
    assert_int_equal(brace_frame_read(&f, in_folder("bare.dng"), &job, NULL), BRACE_OK);
    assert_true(f->exposure_time == 0.0 && f->iso == 0.0 && f->f_number == 0.0);
    assert_true(f->as_shot_neutral[0] == 1.0);
    assert_int_equal(f->illuminant[0], 0);
    assert_false(f->has_noise);
    assert_true(f->noise[0][0] > 1e-5 && f->noise[0][0] < 1e-3);
    assert_non_null(strstr(test_notes, "bare.dng does not say its exposure time"));
    assert_non_null(strstr(test_notes, "colour matrix"));
    assert_non_null(strstr(test_notes, "AsShotNeutral"));
    brace_frame_destroy(f);
}

/* A pattern belongs to the active area's origin, however odd; larger ones are averaged. */
static void test_black_pattern(void **state) {
    (void)state;
    test_dng d = {.width = 36,
                  .height = 30,
                  .top = 1,
                  .left = 3,
                  .bottom = 29,
                  .right = 35,
                  .black_rows = 2,
                  .black_columns = 2,
                  .black = {100, 101, 102, 103}};
    write_test_dng(in_folder("black.dng"), &d);
    brace_frame *f = read_frame(in_folder("black.dng"));
    for (int i = 0; i < 4; i++) {
        assert_true(f->black[i] == (float)(100 + i));
    }
    brace_frame_destroy(f);

    test_dng fine = {
        .width = 36, .height = 30, .black_rows = 2, .black_columns = 2, .black = {100.25f, 101.5f, 102.75f, 103.0f}};
    write_test_dng(in_folder("black.dng"), &fine);
    f = read_frame(in_folder("black.dng"));
    for (int i = 0; i < 4; i++) {
        assert_true(f->black[i] == fine.black[i]);
    }
    brace_frame_destroy(f);

    test_dng wide = {.width = 36,
                     .height = 30,
                     .black_rows = 2,
                     .black_columns = 4,
                     .black = {100, 200, 104, 208, 300, 400, 304, 408}};
    write_test_dng(in_folder("black.dng"), &wide);
    f = read_frame(in_folder("black.dng"));
    assert_true(f->black[0] == 102.0f && f->black[1] == 204.0f && f->black[2] == 302.0f && f->black[3] == 404.0f);
    brace_frame_destroy(f);
}

static void test_nonsense_levels(void **state) {
    (void)state;
    test_dng d = {.width = 32, .height = 24, .white = 100};
    write_test_dng(in_folder("levels.dng"), &d);
    brace_job job = noting_job();
    brace_frame *f = NULL;
    assert_int_equal(brace_frame_read(&f, in_folder("levels.dng"), &job, NULL), BRACE_OK);
    assert_true(f->white > f->black[0]);
    assert_non_null(strstr(test_notes, "white level"));
    brace_frame_destroy(f);
}

static void assert_refused(const char *path, brace_status status, const char *words) {
    brace_frame *f = NULL;
    brace_error e = {0};
    brace_status got = brace_frame_read(&f, path, NULL, &e);
    if (got != status || strstr(e.message, words) == NULL || strstr(e.message, path) == NULL) {
        fail_msg("%s: status %d, \"%s\"; wanted %d and \"%s\"", path, (int)got, e.message, (int)status, words);
    }
    assert_null(f);
    assert_int_equal(e.status, status);
}

static void test_refuses_other_sensors(void **state) {
    (void)state;
    test_dng x = {.width = 36, .height = 36, .xtrans = true};
    write_test_dng(in_folder("xtrans.dng"), &x);
    assert_refused(in_folder("xtrans.dng"), BRACE_ERROR_UNSUPPORTED, "X-Trans");
    test_dng linear = {.width = 36, .height = 36, .photometric = 34892};
    write_test_dng(in_folder("linear.dng"), &linear);
    assert_refused(in_folder("linear.dng"), BRACE_ERROR_UNSUPPORTED, "linear RGB");
    test_dng is_float = {.width = 36, .height = 36, .is_float = true};
    write_test_dng(in_folder("float.dng"), &is_float);
    assert_refused(in_folder("float.dng"), BRACE_ERROR_UNSUPPORTED, "floating-point");
    test_dng deflate = {.width = 36, .height = 36, .compression = COMPRESSION_ADOBE_DEFLATE};
    write_test_dng(in_folder("deflate.dng"), &deflate);
    assert_refused(in_folder("deflate.dng"), BRACE_ERROR_UNSUPPORTED, "deflate");
}

static void test_refuses_other_files(void **state) {
    (void)state;
    write_bytes(in_folder("photo.dng"), "\xff\xd8\xff\xe0\0\20JFIF\0\1\1\0\0\1\0\1\0\0", 20);
    assert_refused(in_folder("photo.dng"), BRACE_ERROR_FORMAT, "is a JPEG picture, not a RAW file");
    write_bytes(in_folder("photo.png"), "\x89PNG\r\n\x1a\n\0\0\0\rIHDR", 16);
    assert_refused(in_folder("photo.png"), BRACE_ERROR_FORMAT, "is a PNG picture, not a RAW file");
    write_bytes(in_folder("photo.webp"), "RIFF\0\0\0\0WEBPVP8 ", 16);
    assert_refused(in_folder("photo.webp"), BRACE_ERROR_FORMAT, "is a WebP picture, not a RAW file");
    write_bytes(in_folder("empty.dng"), "", 0);
    assert_refused(in_folder("empty.dng"), BRACE_ERROR_FORMAT, "is empty");
    write_bytes(in_folder("noise.cr2"), "this is not a raw file at all, just some words in a row", 55);
    assert_refused(in_folder("noise.cr2"), BRACE_ERROR_FORMAT, "is not a RAW file");
    assert_refused(in_folder("missing.dng"), BRACE_ERROR_IO, "no such file");
    mkdir(in_folder("folder.dng"), 0700);
    assert_refused(in_folder("folder.dng"), BRACE_ERROR_IO, "folder");
    TIFF *t = TIFFOpen(in_folder("picture.tif"), "w");
    uint8_t row[48] = {0};
    TIFFSetField(t, TIFFTAG_IMAGEWIDTH, 16);
    TIFFSetField(t, TIFFTAG_IMAGELENGTH, 1);
    TIFFSetField(t, TIFFTAG_BITSPERSAMPLE, 8);
    TIFFSetField(t, TIFFTAG_SAMPLESPERPIXEL, 3);
    TIFFSetField(t, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_RGB);
    TIFFSetField(t, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    TIFFWriteScanline(t, row, 0, 0);
    TIFFClose(t);
    brace_frame *f = NULL;
    brace_error e = {0};
    assert_int_not_equal(brace_frame_read(&f, in_folder("picture.tif"), NULL, &e), BRACE_OK);
    assert_null(f);
}

static void test_refuses_truncated(void **state) {
    (void)state;
    test_dng d = {.width = 64, .height = 48};
    write_test_dng(in_folder("whole.dng"), &d);
    void *bytes = NULL;
    size_t size = 0;
    assert_int_equal(core_file_load(&bytes, &size, in_folder("whole.dng"), 1u << 20, NULL), BRACE_OK);
    static const double shares[] = {0.02, 0.1, 0.5, 0.9};
    for (size_t i = 0; i < 4; i++) {
        write_bytes(in_folder("cut.dng"), bytes, (size_t)((double)size * shares[i]));
        brace_frame *f = NULL;
        brace_error e = {0};
        assert_int_equal(brace_frame_read(&f, in_folder("cut.dng"), NULL, &e), BRACE_ERROR_FORMAT);
        assert_null(f);
        assert_non_null(strstr(e.message, "cut.dng"));
    }
    core_free(bytes);
}

static void test_cancel(void **state) {
    (void)state;
    volatile int cancel = 1;
    brace_job job = {.cancel = &cancel};
    test_dng d = {.width = 64, .height = 48};
    write_test_dng(in_folder("whole.dng"), &d);
    brace_frame *f = NULL;
    assert_int_equal(brace_frame_read(&f, in_folder("whole.dng"), &job, NULL), BRACE_ERROR_CANCELLED);
    assert_null(f);
    assert_int_equal(brace_frame_read(NULL, "x", NULL, NULL), BRACE_ERROR_ARGUMENT);
    assert_int_equal(brace_frame_read(&f, NULL, NULL, NULL), BRACE_ERROR_ARGUMENT);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cfa_origin_orientation),
        cmocka_unit_test(test_metadata),
        cmocka_unit_test(test_missing_metadata),
        cmocka_unit_test(test_black_pattern),
        cmocka_unit_test(test_nonsense_levels),
        cmocka_unit_test(test_refuses_other_sensors),
        cmocka_unit_test(test_refuses_other_files),
        cmocka_unit_test(test_refuses_truncated),
        cmocka_unit_test(test_cancel),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
