/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_tags.c: exact fractions, the tag container, and the walker on files
 * whose directories point where they should not.
 */
#include <math.h>

#include "raw_test.h"

static void assert_fraction(double value, uint32_t limit, uint32_t n, uint32_t d) {
    uint32_t got_n, got_d;
    assert_true(raw_rational(value, limit, &got_n, &got_d));
    assert_int_equal(got_n, n);
    assert_int_equal(got_d, d);
}

static void test_simple_fractions(void **state) {
    (void)state;
    assert_fraction(0.0, UINT32_MAX, 0, 1);
    assert_fraction(1.0 / 640.0, UINT32_MAX, 1, 640);
    assert_fraction(1.0 / 3.0, UINT32_MAX, 1, 3);
    assert_fraction(2.8, UINT32_MAX, 14, 5);
    assert_fraction(30.0, UINT32_MAX, 30, 1);
    assert_fraction(4294967295.0, UINT32_MAX, UINT32_MAX, 1);
    assert_fraction(0.015625, UINT32_MAX, 1, 64);
    assert_fraction(1.0 / 4294967295.0, UINT32_MAX, 1, UINT32_MAX);
}

/* Every quotient of 32-bit numbers survives as a double, bit by bit. */
static void test_every_fraction_survives(void **state) {
    (void)state;
    core_random r = core_random_create(1, 2, 3, 4);
    for (int i = 0; i < 200000; i++) {
        uint32_t limit = i % 2 == 0 ? UINT32_MAX : INT32_MAX;
        uint32_t n = core_random_u32(&r) >> core_random_below(&r, 32),
                 d = core_random_u32(&r) >> core_random_below(&r, 32);
        n = n > limit ? limit : n;
        d = d > limit ? limit : d < 1 ? 1 : d;
        double value = (double)n / (double)d;
        uint32_t got_n, got_d;
        assert_true(raw_rational(value, limit, &got_n, &got_d));
        assert_true((double)got_n / (double)got_d == value);
        assert_true(got_n <= n && got_d <= d);
    }
}

static void test_nearest_fraction(void **state) {
    (void)state;
    uint32_t n, d;
    raw_rational(3.14159265358979323846, UINT32_MAX, &n, &d);
    assert_true(fabs((double)n / d - 3.14159265358979323846) < 1e-15);
    assert_false(raw_rational(1e12, UINT32_MAX, &n, &d));
    assert_true(n == UINT32_MAX && d == 1);
    assert_false(raw_rational((double)NAN, UINT32_MAX, &n, &d));
    assert_true(d != 0);
    assert_false(raw_rational((double)INFINITY, UINT32_MAX, &n, &d));
    assert_true(d != 0);
    raw_rational(1e-300, UINT32_MAX, &n, &d);
    assert_true(d != 0);
    double again = raw_representable(raw_representable(-0.86644182404073189));
    assert_true(again == raw_representable(-0.86644182404073189));
}

static void test_from_float(void **state) {
    (void)state;
    assert_true(raw_from_float(0.0015625f) == 1.0 / 640.0);
    assert_true(raw_from_float(1.8f) == 1.8);
    assert_true(raw_from_float(-0.2887f) == -0.2887);
    assert_true(raw_from_float(6400.0f) == 6400.0);
    assert_true(raw_from_float(0.0f) == 0.0);
    assert_true(raw_from_float(1.0f / 8000.0f) == 1.0 / 8000.0);
}

static void test_container(void **state) {
    (void)state;
    brace_tags *t = raw_tags_create();
    double v[3] = {0.5, 1.0, 0.25};
    assert_true(raw_tags_put_real(t, RAW_IFD_MAIN, 50728, RAW_RATIONAL, 3, v));
    assert_true(raw_tags_put_short(t, RAW_IFD_EXIF, 34855, 400));
    assert_true(raw_tags_put_short(t, RAW_IFD_EXIF, 34855, 800));
    assert_int_equal(t->count, 2);
    assert_int_equal(t->bytes, 26);
    assert_true(raw_tag_number(raw_tags_find(t, RAW_IFD_EXIF, 34855), 0) == 800.0);
    assert_true(raw_tag_number(raw_tags_find(t, RAW_IFD_MAIN, 50728), 2) == 0.25);
    assert_true(isnan(raw_tag_number(raw_tags_find(t, RAW_IFD_MAIN, 50728), 3)));
    assert_null(raw_tags_find(t, RAW_IFD_MAIN, 34855));
    double minus = -1.5;
    assert_false(raw_tags_put_real(t, RAW_IFD_MAIN, 1, RAW_RATIONAL, 1, &minus));
    assert_true(raw_tags_put_real(t, RAW_IFD_MAIN, 1, RAW_SRATIONAL, 1, &minus));
    assert_true(raw_tag_number(raw_tags_find(t, RAW_IFD_MAIN, 1), 0) == -1.5);
    assert_false(raw_tags_put(t, RAW_IFD_MAIN, 2, 99, 1, v));
    assert_false(raw_tags_put(t, RAW_IFD_MAIN, 2, RAW_DOUBLE, UINT32_MAX, v));
    raw_tags_remove(t, RAW_IFD_MAIN, 50728);
    raw_tags_remove(t, RAW_IFD_MAIN, 50728);
    assert_int_equal(t->count, 2);
    assert_int_equal(t->bytes, 10);
    raw_tags_destroy(t);
    char text[8];
    raw_tag_text(NULL, text, sizeof text);
    assert_string_equal(text, "");
}

static void put32(uint8_t *p, uint32_t v) {
    p[0] = (uint8_t)v, p[1] = (uint8_t)(v >> 8), p[2] = (uint8_t)(v >> 16), p[3] = (uint8_t)(v >> 24);
}

static void put_entry(uint8_t *p, uint32_t tag, uint32_t type, uint32_t count, uint32_t value) {
    p[0] = (uint8_t)tag, p[1] = (uint8_t)(tag >> 8), p[2] = (uint8_t)type, p[3] = 0;
    put32(p + 4, count);
    put32(p + 8, value);
}

static void test_walker_hostile(void **state) {
    (void)state;
    uint8_t file[256] = {'I', 'I', 42, 0, 8, 0, 0, 0, 9, 0};
    put_entry(file + 10, 256, RAW_LONG, 1, 77);               /* sound */
    put_entry(file + 22, 700, RAW_BYTE, 0xffffffff, 20);      /* larger than the file */
    put_entry(file + 34, 315, RAW_ASCII, 10, 250);            /* over the end */
    put_entry(file + 46, 34665, RAW_LONG, 1, 8);              /* EXIF is the first directory again */
    put_entry(file + 58, 330, RAW_LONG, 1, 0xfffffff0);       /* a SubIFD outside */
    put_entry(file + 70, 34853, RAW_LONG, 1, 254);            /* GPS at the last two bytes */
    put_entry(file + 82, 272, 200, 1, 0);                     /* a type that is none */
    put_entry(file + 94, 50728, RAW_RATIONAL, 1, 0xffffffff); /* offset overflows */
    put_entry(file + 106, 271, RAW_ASCII, 0, 8);              /* nothing */
    file[254] = 255, file[255] = 255;
    brace_tags *t = NULL;
    assert_int_equal(raw_tags_read(&t, file, sizeof file, NULL), BRACE_OK);
    assert_non_null(t);
    assert_int_equal(t->count, 2); /* ImageWidth, once in each directory */
    assert_true(raw_tag_number(raw_tags_find(t, RAW_IFD_MAIN, 256), 0) == 77.0);
    raw_tags_destroy(t);
    for (size_t n = 0; n < sizeof file; n++) {
        uint8_t *copy = malloc(n + 1);
        memcpy(copy, file, n);
        assert_int_equal(raw_tags_read(&t, copy, n, NULL), BRACE_OK);
        raw_tags_destroy(t);
        free(copy);
    }
}

/* A small file whose entries all claim the same megabytes must not be multiplied. */
static void test_walker_amplification(void **state) {
    (void)state;
    size_t size = 12u << 20;
    uint8_t *file = calloc(size, 1);
    memcpy(file, "II*\0\10\0\0\0", 8);
    file[8] = 0, file[9] = 64; /* 16384 entries */
    for (uint32_t i = 0; i < 16384; i++) {
        put_entry(file + 10 + 12 * (size_t)i, 1000 + i, RAW_BYTE, 10u << 20, 1000);
    }
    brace_tags *t = NULL;
    assert_int_equal(raw_tags_read(&t, file, size, NULL), BRACE_OK);
    assert_true(t->bytes <= RAW_TAGS_MAX_BYTES && t->count <= RAW_TAGS_MAX_COUNT);
    raw_tags_destroy(t);
    free(file);
}

static void test_big_endian(void **state) {
    (void)state;
    const uint8_t file[] = {'M',  'M',  0, 42, 0, 0, 0, 8, 0, 2,        /* entries */
                            0x01, 0x12, 0, 3,  0, 0, 0, 1, 0, 6, 0, 0,  /* Orientation 6 */
                            0xc6, 0x28, 0, 5,  0, 0, 0, 1, 0, 0, 0, 38, /* a rational at 38 */
                            0,    0,    0, 0,  0, 0, 0, 1, 0, 0, 2, 0x80};
    brace_tags *t = NULL;
    assert_int_equal(raw_tags_read(&t, file, sizeof file, NULL), BRACE_OK);
    assert_true(raw_tag_number(raw_tags_find(t, RAW_IFD_MAIN, 274), 0) == 6.0);
    assert_true(raw_tag_number(raw_tags_find(t, RAW_IFD_MAIN, 50728), 0) == 1.0 / 640.0);
    raw_tags_destroy(t);
}

static void test_portable(void **state) {
    (void)state;
    static const struct {
        raw_ifd ifd;
        unsigned tag;
        bool kept, kept_dng;
    } cases[] = {
        {RAW_IFD_MAIN, 315, true, true},     {RAW_IFD_MAIN, 256, false, false},   {RAW_IFD_MAIN, 50740, false, true},
        {RAW_IFD_MAIN, 50829, false, false}, {RAW_IFD_MAIN, 50712, false, false}, {RAW_IFD_MAIN, 51009, false, false},
        {RAW_IFD_EXIF, 37500, true, true},   {RAW_IFD_EXIF, 40962, false, false}, {RAW_IFD_EXIF, 273, false, false},
        {RAW_IFD_GPS, 2, true, true},        {RAW_IFD_GPS, 300, false, false},    {RAW_IFD_RAW, 51041, false, true},
        {RAW_IFD_RAW, 51022, false, false},  {RAW_IFD_MAIN, 50723, false, false}, {RAW_IFD_MAIN, 50964, false, true},
    };
    for (int dng = 0; dng < 2; dng++) {
        brace_tags *t = raw_tags_create();
        for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
            assert_true(raw_tags_put_short(t, cases[i].ifd, cases[i].tag, 1));
        }
        assert_true(raw_tags_put_short(t, RAW_IFD_MAIN, 34855, 100)); /* a phone's ISO goes into the EXIF directory */
        raw_tags_keep_portable(t, dng != 0);
        for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
            bool want = dng != 0 ? cases[i].kept_dng : cases[i].kept;
            assert_int_equal(raw_tags_find(t, cases[i].ifd, cases[i].tag) != NULL, want);
        }
        assert_non_null(raw_tags_find(t, RAW_IFD_EXIF, 34855));
        assert_int_equal(t->bytes, 2 * t->count);
        raw_tags_destroy(t);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_simple_fractions),
        cmocka_unit_test(test_every_fraction_survives),
        cmocka_unit_test(test_nearest_fraction),
        cmocka_unit_test(test_from_float),
        cmocka_unit_test(test_container),
        cmocka_unit_test(test_walker_hostile),
        cmocka_unit_test(test_walker_amplification),
        cmocka_unit_test(test_big_endian),
        cmocka_unit_test(test_portable),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
