/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_screens.c: no content is in both splits: copies and lookalikes of a picture
 * (smaller, brighter, compressed, another format) stay together, different ones
 * do not, and neither names nor threads matter.
 */
// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>
// clang-format on
#include <ftw.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "sim/dataset_screens.h"

static char folder[64];
static brace_error error;

static int setup(void **state) {
    (void)state;
    strcpy(folder, "/tmp/brace-screens-XXXXXX");
    return mkdtemp(folder) == NULL ? -1 : 0;
}

static int forget(const char *path, const struct stat *info, int kind, struct FTW *ftw) {
    (void)info, (void)kind, (void)ftw;
    return remove(path);
}

static int teardown(void **state) {
    (void)state;
    return nftw(folder, forget, 16, FTW_DEPTH | FTW_PHYS);
}

/* A page of text, as it were: lines of dark words on light paper. */
static brace_image *page(uint32_t seed, uint32_t width, uint32_t height) {
    brace_image *image;
    assert_int_equal(brace_image_create(&image, width, height, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, &error),
                     BRACE_OK);
    memset(image->data, 235, image->stride * height);
    core_random r = core_random_create(seed, 1, 2, 3);
    for (uint32_t y = 8; y + 10 < height; y += 14)
        for (uint32_t x = 10; x + 70 < width;) {
            uint32_t word = 8 + core_random_below(&r, 60);
            if (core_random_below(&r, 12) == 0)
                break; /* the end of a paragraph */
            for (uint32_t j = 0; j < 8; j++)
                for (uint32_t i = 0; i < word; i++)
                    if (core_random_below(&r, 3) > 0)
                        memset((char *)image->data + (y + j) * image->stride + 3 * (size_t)(x + i), 40, 3);
            x += word + 6;
        }
    return image;
}

static void save(const brace_image *image, const char *name, int quality) {
    char path[200];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    const brace_image_write_params p = {.quality = quality};
    assert_int_equal(brace_image_write(image, path, &p, NULL, &error), BRACE_OK);
}

static bool alike(const brace_image *a, const brace_image *b) {
    sim_print p, q;
    assert_int_equal(sim_print_create(&p, a, &error), BRACE_OK);
    assert_int_equal(sim_print_create(&q, b, &error), BRACE_OK);
    bool yes = sim_prints_alike(&p, &q);
    assert_int_equal(yes, sim_prints_alike(&q, &p));
    return yes;
}

static brace_image *grey(uint32_t width, uint32_t height, int r, int g, int b) {
    brace_image *image;
    assert_int_equal(brace_image_create(&image, width, height, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, &error),
                     BRACE_OK);
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            uint8_t *p = (uint8_t *)image->data + y * image->stride + 3 * (size_t)x;
            p[0] = (uint8_t)r, p[1] = (uint8_t)g, p[2] = (uint8_t)b;
        }
    return image;
}

static void test_alike(void **state) {
    (void)state;
    brace_image *first = page(1, 640, 360), *other = page(2, 640, 360), *changed = page(1, 640, 360), *small, *linear;
    assert_true(alike(first, first));
    assert_false(alike(first, other)); /* two pages of text are two pages */
    /* And so they are with the same beginning. */
    brace_image *edited = page(1, 640, 360);
    for (uint32_t y = 270; y < 360; y++)
        memcpy((char *)edited->data + y * edited->stride, (char *)other->data + y * other->stride, other->stride);
    assert_false(alike(first, edited));
    brace_image_destroy(edited);
    /* A clock in the corner does not make another screen, and so does not less light. */
    for (uint32_t y = 0; y < 10; y++)
        memset((char *)changed->data + y * changed->stride + 3 * 600, 120, 3 * 24);
    for (size_t i = 0; i < changed->stride * 360; i++)
        ((uint8_t *)changed->data)[i] = (uint8_t)(((uint8_t *)changed->data)[i] * 4 / 5);
    assert_true(alike(first, changed));
    assert_int_equal(brace_image_resize(&small, first, 417, 233, &error), BRACE_OK);
    assert_true(alike(first, small));
    assert_int_equal(brace_image_convert(&linear, first, 4, BRACE_SAMPLE_F32, BRACE_TRANSFER_LINEAR, &error), BRACE_OK);
    assert_true(alike(first, linear));
    brace_image_destroy(small);
    brace_image_destroy(linear);
    /* Colour counts: the same layout, red for blue, is another picture. */
    brace_image *red = grey(64, 36, 60, 60, 60), *blue = grey(64, 36, 60, 60, 60);
    for (uint32_t y = 10; y < 30; y++)
        for (uint32_t x = 10; x < 50; x++) {
            ((uint8_t *)red->data)[y * red->stride + 3 * (size_t)x] = 200;
            ((uint8_t *)blue->data)[y * blue->stride + 3 * (size_t)x + 2] = 200;
        }
    assert_false(alike(red, blue));
    /* Flat pictures, down to one pixel. */
    brace_image *one = grey(1, 1, 90, 90, 90), *near = grey(500, 3, 91, 91, 91), *far = grey(1, 1, 110, 110, 110);
    assert_true(alike(one, near));
    assert_false(alike(one, far));
    assert_false(alike(one, first));
    brace_image *const all[] = {first, other, changed, red, blue, one, near, far};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        brace_image_destroy(all[i]);
}

static const dataset_screen *named(const dataset_screens *s, const char *name, bool *test) {
    for (size_t i = 0; i < s->count; i++)
        if (strcmp(s->items[i].name, name) == 0) {
            *test = i < s->test;
            return &s->items[i];
        }
    fail_msg("%s is missing", name);
    return NULL;
}

static void test_splits(void **state) {
    (void)state;
    enum { PAGES = 12 };
    char name[64];
    for (uint32_t i = 0; i < PAGES; i++) {
        brace_image *image = page(100 + i, 320, 180), *small;
        snprintf(name, sizeof name, "%06u_a.png", i);
        save(image, name, 0);
        snprintf(name, sizeof name, "%06u_b.jpg", i + 500);
        save(image, name, 60);
        assert_int_equal(brace_image_resize(&small, image, 256, 144, &error), BRACE_OK);
        snprintf(name, sizeof name, "%06u_c.webp", 900 - i);
        save(small, name, 50);
        brace_image_destroy(small);
        if (i == 3)
            save(image, "copy.png", 0);
        brace_image_destroy(image);
    }
    dataset_screens s;
    for (int threads = 1; threads <= 2; threads++) {
        const brace_job job = {.threads = threads};
        if (dataset_screens_read(&s, folder, 3, 1, &job, &error) != BRACE_OK)
            fail_msg("%s", error.message);
        assert_int_equal(s.count, 3 * PAGES); /* without the copy */
        assert_int_equal(s.test, 3 * PAGES / 4);
        for (uint32_t i = 0; i < PAGES; i++) {
            bool test[3] = {false};
            snprintf(name, sizeof name, "%06u_a.png", i);
            const dataset_screen *a = named(&s, name, &test[0]);
            snprintf(name, sizeof name, "%06u_b.jpg", i + 500);
            const dataset_screen *b = named(&s, name, &test[1]);
            snprintf(name, sizeof name, "%06u_c.webp", 900 - i);
            const dataset_screen *c = named(&s, name, &test[2]);
            assert_true(a->group == b->group && b->group == c->group);
            assert_true(test[0] == test[1] && test[1] == test[2]);
        }
        for (size_t i = 1; i < s.count; i++)
            assert_true(s.items[i - 1].group <= s.items[i].group);
        if (threads == 1) {
            /* Other names, the same splits. */
            char from[200], to[200], hash[65];
            strcpy(hash, s.items[0].sha256);
            snprintf(from, sizeof from, "%s", s.items[0].path);
            snprintf(to, sizeof to, "%s/zzz.%s", folder, strrchr(from, '.') + 1);
            dataset_screens_free(&s);
            assert_int_equal(rename(from, to), 0);
            assert_int_equal(dataset_screens_read(&s, folder, 3, 1, &job, &error), BRACE_OK);
            assert_string_equal(s.items[0].sha256, hash);
            assert_int_equal(s.test, 3 * PAGES / 4);
            assert_int_equal(rename(to, from), 0);
        }
        dataset_screens_free(&s);
    }
    /* However small the share, a split that is wanted gets a whole group; one that is not gets nothing. */
    assert_int_equal(dataset_screens_read(&s, folder, 1000, 1, NULL, &error), BRACE_OK);
    assert_int_equal(s.test, 3);
    dataset_screens_free(&s);
    assert_int_equal(dataset_screens_read(&s, folder, 1, 1000, NULL, &error), BRACE_OK);
    assert_int_equal(s.test, 3 * PAGES - 3);
    dataset_screens_free(&s);
    assert_int_equal(dataset_screens_read(&s, folder, 0, 5, NULL, &error), BRACE_OK);
    assert_int_equal(s.test, 3 * PAGES);
    dataset_screens_free(&s);
    assert_int_equal(dataset_screens_read(&s, folder, 5, 0, NULL, &error), BRACE_OK);
    assert_int_equal(s.test, 0);
    dataset_screens_free(&s);
    /* The first bad screen by name is the one that is named, with however many threads. */
    char path[200];
    for (int i = 0; i < 5; i++) {
        snprintf(path, sizeof path, "%s/%s.png", folder, i == 4 ? "0bad" : (char[]){(char)('p' + i), '\0'});
        FILE *f = fopen(path, "w");
        fputs("no picture", f);
        fclose(f);
    }
    const brace_job two = {.threads = 2};
    assert_int_equal(dataset_screens_read(&s, folder, 1, 1, &two, &error), BRACE_ERROR_FORMAT);
    assert_non_null(strstr(error.message, "0bad.png"));
    assert_non_null(strstr(error.message, "and 4 more screens"));
    volatile int stop = 1;
    const brace_job stopped = {.threads = 2, .cancel = &stop};
    assert_int_equal(dataset_screens_read(&s, folder, 1, 1, &stopped, &error), BRACE_ERROR_CANCELLED);
    assert_int_equal(s.count, 0);
    assert_null(s.items);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_alike),
        cmocka_unit_test_setup_teardown(test_splits, setup, teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
