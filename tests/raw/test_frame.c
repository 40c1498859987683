/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_frame.c: limits, defaults, deep copies and the colour at each pixel.
 */
#include "raw_test.h"

static void test_defaults(void **state) {
    (void)state;
    brace_frame *f = NULL;
    assert_int_equal(brace_frame_create(&f, 6, 4, BRACE_CFA_GBRG, NULL), BRACE_OK);
    assert_int_equal(f->width, 6);
    assert_int_equal(f->height, 4);
    assert_int_equal(f->cfa, BRACE_CFA_GBRG);
    assert_true(f->white == 65535.0f && f->black[3] == 0.0f);
    assert_true(f->as_shot_neutral[0] == 1.0 && f->as_shot_neutral[2] == 1.0);
    assert_int_equal(f->illuminant[0], 0);
    assert_int_equal(f->orientation, 1);
    assert_string_equal(f->path, "");
    for (int i = 0; i < 24; i++) {
        assert_int_equal(f->data[i], 0);
    }
    brace_frame_destroy(f);
    brace_frame_destroy(NULL);
}

static void test_limits(void **state) {
    (void)state;
    static const uint32_t bad[][2] = {{3, 8}, {8, 3}, {0, 0}, {65536, 8}, {8, 65536}, {65535, 65535}};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        brace_frame *f = (brace_frame *)&f;
        brace_error e = {0};
        assert_int_equal(brace_frame_create(&f, bad[i][0], bad[i][1], BRACE_CFA_RGGB, &e), BRACE_ERROR_ARGUMENT);
        assert_null(f);
        assert_non_null(strstr(e.message, "65535"));
    }
    brace_frame *f = NULL;
    assert_int_equal(brace_frame_create(&f, 8, 8, (brace_cfa)4, NULL), BRACE_ERROR_ARGUMENT);
    assert_int_equal(brace_frame_create(NULL, 8, 8, BRACE_CFA_RGGB, NULL), BRACE_ERROR_ARGUMENT);
}

static void test_clone_is_deep(void **state) {
    (void)state;
    brace_frame *f = NULL, *g = NULL;
    assert_int_equal(brace_frame_create(&f, 4, 4, BRACE_CFA_RGGB, NULL), BRACE_OK);
    f->data[5] = 77;
    f->iso = 320;
    f->tags = raw_tags_create();
    assert_true(raw_tags_put_text(f->tags, RAW_IFD_MAIN, 315, "Somebody"));
    assert_int_equal(brace_frame_clone(&g, f, NULL), BRACE_OK);
    assert_same_frame(f, g);
    assert_ptr_not_equal(f->data, g->data);
    assert_ptr_not_equal(f->tags, g->tags);
    brace_frame_destroy(f);
    char text[32];
    raw_tag_text(raw_tags_find(g->tags, RAW_IFD_MAIN, 315), text, sizeof text);
    assert_string_equal(text, "Somebody");
    assert_int_equal(g->data[5], 77);
    brace_frame_destroy(g);
}

static void test_out_of_memory(void **state) {
    (void)state;
    brace_frame *f = NULL;
    assert_int_equal(brace_frame_create(&f, 16, 16, BRACE_CFA_RGGB, NULL), BRACE_OK);
    f->tags = raw_tags_create();
    assert_true(raw_tags_put_text(f->tags, RAW_IFD_MAIN, 315, "Somebody"));
    int failed = 0;
    for (long n = 1; n < 40; n++) {
        brace_frame *g = NULL;
        brace_error e = {0};
        core_alloc_fail_after(n);
        brace_status status = brace_frame_clone(&g, f, &e);
        core_alloc_fail_after(0);
        if (status == BRACE_OK) {
            brace_frame_destroy(g);
            break;
        }
        assert_int_equal(status, BRACE_ERROR_MEMORY);
        assert_null(g);
        failed++;
    }
    assert_in_range(failed, 4, 30);
    brace_frame_destroy(f);
}

static void test_cfa(void **state) {
    (void)state;
    static const char *const names[] = {"RGGB", "GRBG", "GBRG", "BGGR"};
    for (int k = 0; k < 4; k++) {
        assert_string_equal(brace_cfa_name((brace_cfa)k), names[k]);
        for (uint32_t y = 0; y < 4; y++) {
            for (uint32_t x = 0; x < 4; x++) {
                char c = names[k][(y & 1) * 2 + (x & 1)];
                assert_int_equal(brace_cfa_color((brace_cfa)k, x, y), c == 'R' ? 0 : c == 'G' ? 1 : 2);
            }
        }
    }
    assert_string_equal(brace_cfa_name((brace_cfa)9), "unknown");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_defaults),      cmocka_unit_test(test_limits), cmocka_unit_test(test_clone_is_deep),
        cmocka_unit_test(test_out_of_memory), cmocka_unit_test(test_cfa),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
