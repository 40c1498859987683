/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_dng.c: what is written comes back: every pixel, every field to the last
 * bit, and the tags of a stranger's file. And what cannot be written leaves
 * nothing behind.
 */
#include <dirent.h>
#include <math.h>

#include "raw_test.h"

static brace_frame *write_and_read(const brace_frame *f, const brace_dng_params *params) {
    brace_error error = {0};
    if (brace_frame_write_dng(f, in_folder("out.dng"), params, NULL, &error) != BRACE_OK) {
        fail_msg("%s", error.message);
    }
    return read_frame(in_folder("out.dng"));
}

static size_t files_in_folder(void) {
    DIR *d = opendir(test_folder);
    size_t n = 0;
    for (struct dirent *e; (e = readdir(d)) != NULL;) {
        n += e->d_name[0] != '.' || strlen(e->d_name) > 2 ? 1 : 0;
    }
    closedir(d);
    return n;
}

/* Every field filled with fractions that need all their digits. */
static brace_frame *random_frame(uint64_t seed, uint32_t width, uint32_t height) {
    core_random r = core_random_create(seed, 0, 0, 0);
    brace_frame *f = NULL;
    assert_int_equal(brace_frame_create(&f, width, height, (brace_cfa)(seed & 3), NULL), BRACE_OK);
    for (size_t i = 0; i < (size_t)width * height; i++) {
        f->data[i] = (uint16_t)core_random_u32(&r);
    }
    for (int i = 0; i < 4; i++) {
        f->black[i] = (float)core_random_below(&r, 4096) / 4.0f;
    }
    f->white = (float)(4096 + core_random_below(&r, 60000));
    f->exposure_time = (double)(1 + core_random_below(&r, 1000000)) / (1 + core_random_below(&r, 100000000));
    f->iso = 1 + core_random_below(&r, 204800);
    f->f_number = (double)(1 + core_random_below(&r, 100000)) / (1 + core_random_below(&r, 100000));
    f->focal_length = (double)(1 + core_random_below(&r, 100000)) / (1 + core_random_below(&r, 100000));
    f->baseline_exposure = raw_representable(core_random_range(&r, -3.0, 3.0));
    for (int i = 0; i < 9; i++) {
        f->color_matrix[0][i] = raw_representable(core_random_range(&r, -0.3, 0.3) + (i % 4 == 0 ? 1.0 : 0.0));
        f->color_matrix[1][i] = raw_representable(core_random_range(&r, -0.3, 0.3) + (i % 4 == 0 ? 1.0 : 0.0));
    }
    f->illuminant[0] = 17;
    f->illuminant[1] = 21;
    f->as_shot_neutral[0] = raw_representable(core_random_range(&r, 0.2, 1.5));
    f->as_shot_neutral[2] = raw_representable(core_random_range(&r, 0.2, 1.5));
    for (int c = 0; c < 3; c++) {
        f->noise[c][0] = core_random_range(&r, 1e-6, 1e-2);
        f->noise[c][1] = core_random_range(&r, 1e-9, 1e-4);
    }
    f->has_noise = true;
    f->orientation = 1 + (int)core_random_below(&r, 8);
    strcpy(f->make, "Make");
    strcpy(f->model, "Model 7");
    strcpy(f->unique_model, "Make Model 7");
    strcpy(f->datetime, "2026:01:02 03:04:05");
    strcpy(f->subsec, "678");
    return f;
}

static void test_every_field_survives(void **state) {
    (void)state;
    for (uint64_t seed = 0; seed < 40; seed++) {
        uint32_t w = 22 + (uint32_t)(seed * 7) % 61, h = 22 + (uint32_t)(seed * 13) % 47;
        brace_frame *f = random_frame(seed, w, h);
        brace_dng_params params = {.no_preview = seed % 2 == 0};
        brace_frame *g = write_and_read(f, &params);
        assert_same_frame(f, g);
        brace_frame *again = write_and_read(g, &params);
        assert_same_frame(f, again);
        assert_int_equal(g->tags->count, again->tags->count);
        brace_frame_destroy(again);
        brace_frame_destroy(g);
        brace_frame_destroy(f);
    }
}

/* A frame without anything still becomes a file that readers accept. */
static void test_bare_frame(void **state) {
    (void)state;
    brace_frame *f = NULL;
    assert_int_equal(brace_frame_create(&f, 32, 24, BRACE_CFA_BGGR, NULL), BRACE_OK);
    brace_frame *g = write_and_read(f, NULL);
    assert_int_equal(g->cfa, BRACE_CFA_BGGR);
    assert_true(g->exposure_time == 0.0 && g->white == 65535.0f && g->black[0] == 0.0f);
    assert_memory_equal(g->data, f->data, 32 * 24 * 2);
    brace_frame_destroy(g);
    brace_frame_destroy(f);
}

static void assert_tag_text(const brace_frame *f, raw_ifd ifd, unsigned tag, const char *want) {
    char text[64];
    raw_tag_text(raw_tags_find(f->tags, ifd, tag), text, sizeof text);
    assert_string_equal(text, want);
}

static void test_strangers_tags_survive(void **state) {
    (void)state;
    test_dng d = {.width = 48, .height = 32, .exposure_time = 1.0 / 640.0};
    write_test_dng(in_folder("in.dng"), &d);
    brace_frame *f = read_frame(in_folder("in.dng"));
    /* What the test's libtiff cannot write easily, as if it had been read. */
    static const uint32_t place[6] = {51, 1, 30, 1, 1234, 100}, speed[2] = {10, 6400};
    assert_true(raw_tags_put(f->tags, RAW_IFD_GPS, 2, RAW_RATIONAL, 3, place));
    assert_true(raw_tags_put_text(f->tags, RAW_IFD_GPS, 1, "N"));
    assert_true(raw_tags_put(f->tags, RAW_IFD_MAIN, 700, RAW_BYTE, 6, "<xmp/>"));
    assert_true(raw_tags_put(f->tags, RAW_IFD_MAIN, 50740, RAW_BYTE, 5, "priv\1"));
    static const uint32_t lens[8] = {24, 1, 70, 1, 28, 10, 28, 10};
    assert_true(raw_tags_put(f->tags, RAW_IFD_MAIN, 50736, RAW_RATIONAL, 4, lens));
    assert_true(raw_tags_put(f->tags, RAW_IFD_EXIF, 33434, RAW_RATIONAL, 1, speed));
    f->exposure_time = 10.0 / 6400.0;
    brace_frame *g = write_and_read(f, &(brace_dng_params){.software = "a test"});
    assert_same_frame(f, g);
    assert_tag_text(g, RAW_IFD_MAIN, 315, "A. Photographer");
    assert_tag_text(g, RAW_IFD_MAIN, 33432, "(c) A. Photographer");
    assert_tag_text(g, RAW_IFD_MAIN, 305, "a test");
    assert_tag_text(g, RAW_IFD_EXIF, 42036, "Test 35mm F2");
    assert_tag_text(g, RAW_IFD_GPS, 1, "N");
    const raw_tag *t = raw_tags_find(g->tags, RAW_IFD_EXIF, 37500);
    assert_non_null(t);
    assert_int_equal(t->type, RAW_UNDEFINED);
    assert_int_equal(t->count, 9);
    assert_memory_equal(t->bytes, "maker\0\1\2\3", 9);
    t = raw_tags_find(g->tags, RAW_IFD_GPS, 2);
    assert_non_null(t);
    assert_memory_equal(t->bytes, place, sizeof place);
    t = raw_tags_find(g->tags, RAW_IFD_MAIN, 700);
    assert_non_null(t);
    assert_memory_equal(t->bytes, "<xmp/>", 6);
    t = raw_tags_find(g->tags, RAW_IFD_MAIN, 50740);
    assert_non_null(t);
    assert_memory_equal(t->bytes, "priv\1", 5);
    t = raw_tags_find(g->tags, RAW_IFD_MAIN, 50736);
    assert_non_null(t);
    assert_memory_equal(t->bytes, lens, sizeof lens);
    t = raw_tags_find(g->tags, RAW_IFD_EXIF, 33434);
    assert_memory_equal(t->bytes, speed, sizeof speed); /* the camera's own words */
    for (size_t i = 0; i < f->tags->count; i++) {
        assert_non_null(raw_tags_find(g->tags, (raw_ifd)f->tags->items[i].ifd, f->tags->items[i].tag));
    }
    brace_frame_destroy(g);
    brace_frame_destroy(f);
}

static void assert_tag_bytes(const brace_frame *f, raw_ifd ifd, unsigned tag, const void *bytes, uint32_t count) {
    const raw_tag *t = raw_tags_find(f->tags, ifd, tag);
    if (t == NULL || t->count != count || memcmp(t->bytes, bytes, count) != 0) {
        fail_msg("tag %u: %u bytes of %u, or others", tag, t != NULL ? t->count : 0, count);
    }
}

/* What libtiff has no words for, or another idea of: single bytes that are undefined, notes of more than 64 KiB, texts of
 * two parts, texts where it knows bytes. */
static void test_awkward_tags_survive(void **state) {
    (void)state;
    test_dng d = {.width = 48, .height = 32, .exposure_time = 1.0 / 640.0};
    write_test_dng(in_folder("in.dng"), &d);
    static uint8_t note[70001], private[80000], comment[66000];
    for (size_t i = 0; i < sizeof note; i++) {
        note[i] = (uint8_t)(i * 7 + i / 256), private[i] = (uint8_t)(i * 5), comment[i % sizeof comment] = (uint8_t)(i * 3);
    }
    for (int preview = 0; preview < 2; preview++) {
        brace_frame *f = read_frame(in_folder("in.dng"));
        assert_true(raw_tags_put(f->tags, RAW_IFD_EXIF, 41728, RAW_UNDEFINED, 1, "\3"));
        assert_true(raw_tags_put(f->tags, RAW_IFD_EXIF, 41729, RAW_UNDEFINED, 1, "\1"));
        assert_true(raw_tags_put(f->tags, RAW_IFD_EXIF, 37500, RAW_UNDEFINED, sizeof note, note));
        assert_true(raw_tags_put(f->tags, RAW_IFD_EXIF, 37510, RAW_UNDEFINED, sizeof comment, comment));
        assert_true(raw_tags_put(f->tags, RAW_IFD_MAIN, 50740, RAW_BYTE, sizeof private, private));
        assert_true(raw_tags_put(f->tags, RAW_IFD_MAIN, 33432, RAW_ASCII, 10, " \0Editor.\0"));
        assert_true(raw_tags_put(f->tags, RAW_IFD_MAIN, 50709, RAW_ASCII, 6, "Kodak\0"));
        brace_frame *g = write_and_read(f, &(brace_dng_params){.no_preview = preview == 0});
        assert_same_frame(f, g);
        assert_tag_bytes(g, RAW_IFD_EXIF, 41728, "\3", 1);
        assert_tag_bytes(g, RAW_IFD_EXIF, 41729, "\1", 1);
        assert_tag_bytes(g, RAW_IFD_EXIF, 37500, note, sizeof note);
        assert_tag_bytes(g, RAW_IFD_EXIF, 37510, comment, sizeof comment);
        assert_tag_bytes(g, RAW_IFD_MAIN, 50740, private, sizeof private);
        assert_tag_bytes(g, RAW_IFD_MAIN, 33432, " \0Editor.\0", 10);
        assert_tag_bytes(g, RAW_IFD_MAIN, 50709, "Kodak\0", 6);
        brace_frame_destroy(g);
        brace_frame_destroy(f);
    }
}

/* Tags of a type or count that their standard forbids are a stranger's mistake: no failure, no crash. */
static void test_odd_tags_do_no_harm(void **state) {
    (void)state;
    core_random r = core_random_create(7, 7, 7, 7);
    uint8_t bytes[512];
    for (int round = 0; round < 60; round++) {
        brace_frame *f = random_frame((uint64_t)round, 24, 22);
        f->tags = raw_tags_create();
        for (int i = 0; i < 60; i++) {
            static const unsigned from[] = {269,   33432, 33434, 34850, 36864, 37377, 37500,
                                            41483, 42032, 50708, 50930, 51107, 0};
            for (size_t k = 0; k < sizeof bytes; k++) {
                bytes[k] = (uint8_t)core_random_u32(&r);
            }
            unsigned tag = from[core_random_below(&r, 13)] + core_random_below(&r, 32);
            assert_true(raw_tags_put(f->tags, (raw_ifd)core_random_below(&r, 4), tag, 1 + core_random_below(&r, 12),
                                     1 + core_random_below(&r, 60), bytes));
        }
        raw_tags_keep_portable(f->tags, true);
        brace_dng_params params = {.no_preview = true};
        brace_frame *g = write_and_read(f, &params);
        assert_memory_equal(f->data, g->data, 24 * 22 * 2);
        assert_true(f->exposure_time == g->exposure_time && f->iso == g->iso);
        brace_frame_destroy(g);
        brace_frame_destroy(f);
    }
}

static void test_preview(void **state) {
    (void)state;
    brace_frame *f = random_frame(3, 2600, 60);
    brace_image *given = NULL;
    assert_int_equal(brace_image_create(&given, 2600, 60, 3, BRACE_SAMPLE_U16, BRACE_TRANSFER_SRGB, NULL), BRACE_OK);
    for (size_t i = 0; i < given->stride * given->height / 2; i++) {
        ((uint16_t *)given->data)[i] = 0xc0c0; /* 192 of 255 */
    }
    for (int pass = 0; pass < 2; pass++) {
        brace_dng_params params = {.preview = pass == 0 ? given : NULL};
        brace_frame *g = write_and_read(f, &params);
        assert_same_frame(f, g);
        brace_frame_destroy(g);
        TIFF *t = TIFFOpen(in_folder("out.dng"), "r");
        assert_non_null(t);
        uint32_t w = 0, h = 0;
        uint16_t compression = 0;
        TIFFGetField(t, TIFFTAG_IMAGEWIDTH, &w);
        TIFFGetField(t, TIFFTAG_IMAGELENGTH, &h);
        TIFFGetField(t, TIFFTAG_COMPRESSION, &compression);
        assert_in_range(w, 512, 1024);
        assert_in_range(h, 10, 60);
        assert_int_equal(compression, COMPRESSION_JPEG);
        uint8_t *row = malloc((size_t)TIFFScanlineSize(t) * 2 + w * 3);
        TIFFSetField(t, TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
        assert_int_equal(TIFFReadScanline(t, row, 0, 0), 1);
        unsigned alike = 0;
        for (uint32_t i = 0; i < 3 * w; i++) {
            alike += row[i] >= 188 && row[i] <= 196;
        }
        assert_true(pass == 0 ? alike == 3 * w : alike < 2 * w); /* the one that was given; noise, developed */
        free(row);
        TIFFClose(t);
    }
    brace_image_destroy(given);
    brace_frame_destroy(f);
}

static void test_refuses_nonsense(void **state) {
    (void)state;
    size_t before = files_in_folder();
    for (int i = 0; i < 6; i++) {
        brace_frame *f = random_frame(1, 8, 8);
        switch (i) {
        case 0:
            f->orientation = 9;
            break;
        case 1:
            f->white = f->black[2];
            break;
        case 2:
            f->black[1] = NAN;
            break;
        case 3:
            f->as_shot_neutral[0] = 0.0;
            break;
        case 4:
            f->color_matrix[0][4] = (double)NAN;
            break;
        default:
            f->baseline_exposure = (double)INFINITY;
            break;
        }
        brace_error e = {0};
        assert_int_equal(brace_frame_write_dng(f, in_folder("bad.dng"), NULL, NULL, &e), BRACE_ERROR_ARGUMENT);
        assert_non_null(strstr(e.message, "bad.dng cannot be written: the frame's"));
        brace_frame_destroy(f);
    }
    assert_int_equal(files_in_folder(), before);
}

static void test_unwritable(void **state) {
    (void)state;
    brace_frame *f = random_frame(2, 64, 64);
    brace_error e = {0};
    assert_int_equal(brace_frame_write_dng(f, "/dev/full", NULL, NULL, &e), BRACE_ERROR_IO);
    assert_non_null(strstr(e.message, "space"));
    assert_int_equal(brace_frame_write_dng(f, in_folder("none/out.dng"), NULL, NULL, &e), BRACE_ERROR_IO);
    assert_int_equal(brace_frame_write_dng(f, test_folder, NULL, NULL, &e), BRACE_ERROR_IO);
    volatile int cancel = 1;
    brace_job job = {.cancel = &cancel};
    write_bytes(in_folder("old.dng"), "old", 3);
    size_t before = files_in_folder();
    assert_int_equal(brace_frame_write_dng(f, in_folder("old.dng"), NULL, &job, &e), BRACE_ERROR_CANCELLED);
    assert_int_equal(files_in_folder(), before);
    struct stat st;
    assert_int_equal(stat(in_folder("old.dng"), &st), 0);
    assert_int_equal(st.st_size, 3);
    brace_frame_destroy(f);
}

/* Memory ends at every allocation in turn: a clean error each time, and nothing on disk. */
static void test_out_of_memory(void **state) {
    (void)state;
    test_dng d = {.width = 24, .height = 22};
    write_test_dng(in_folder("small.dng"), &d);
    size_t before = files_in_folder();
    int failed = 0;
    for (long n = 1; n < 2000; n++) {
        brace_frame *f = NULL;
        brace_error e = {0};
        core_alloc_fail_after(n);
        brace_status status = brace_frame_read(&f, in_folder("small.dng"), NULL, &e);
        if (status == BRACE_OK) {
            brace_dng_params params = {.no_preview = true};
            status = brace_frame_write_dng(f, in_folder("oom.dng"), &params, NULL, &e);
        }
        core_alloc_fail_after(0);
        brace_frame_destroy(f);
        if (status == BRACE_OK) {
            break;
        }
        assert_int_equal(status, BRACE_ERROR_MEMORY);
        assert_int_equal(files_in_folder(), before);
        failed++;
    }
    assert_in_range(failed, 20, 1900);
}

/* Whole brackets from elsewhere, where a folder of them is given. */
static void test_samples(void **state) {
    (void)state;
    const char *root = getenv("BRACE_SAMPLES");
    if (root == NULL || *root == '\0') {
        skip();
    }
    DIR *d = opendir(root);
    assert_non_null(d);
    int seen = 0;
    for (struct dirent *e; (e = readdir(d)) != NULL;) {
        for (int i = 1; i <= 6 && e->d_name[0] != '.'; i++) {
            char path[1024];
            if (i < 6) {
                snprintf(path, sizeof path, "%s/%s/frame_%d.dng", root, e->d_name, i);
            } else {
                snprintf(path, sizeof path, "%s/%s/gt.dng", root, e->d_name);
            }
            if (access(path, R_OK) != 0) {
                continue;
            }
            brace_frame *f = read_frame(path);
            brace_frame *g = write_and_read(f, NULL);
            assert_same_frame(f, g);
            for (size_t k = 0; k < f->tags->count; k++) {
                const raw_tag *a = &f->tags->items[k], *b = raw_tags_find(g->tags, (raw_ifd)a->ifd, a->tag);
                assert_non_null(b);
                assert_int_equal(a->count == b->count || a->tag == 305, 1);
            }
            brace_frame_destroy(g);
            brace_frame_destroy(f);
            seen++;
        }
    }
    closedir(d);
    assert_true(seen > 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_every_field_survives),
        cmocka_unit_test(test_bare_frame),
        cmocka_unit_test(test_strangers_tags_survive),
        cmocka_unit_test(test_awkward_tags_survive),
        cmocka_unit_test(test_odd_tags_do_no_harm),
        cmocka_unit_test(test_preview),
        cmocka_unit_test(test_refuses_nonsense),
        cmocka_unit_test(test_unwritable),
        cmocka_unit_test(test_out_of_memory),
        cmocka_unit_test(test_samples),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
