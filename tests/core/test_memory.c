/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_memory.c: allocation limits, injected failures, arenas.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "core/core.h"

static void test_alloc(void **state) {
    (void)state;
    for (size_t n = 0; n < 300; n += 7) {
        unsigned char *p = core_calloc(n, 3);
        assert_non_null(p);
        assert_int_equal((uintptr_t)p % 64, 0);
        for (size_t i = 0; i < n * 3; i++) {
            assert_int_equal(p[i], 0);
        }
        core_free(p);
    }
    assert_null(core_alloc(SIZE_MAX / 2, 3));
    assert_null(core_alloc(SIZE_MAX, 1));
    assert_null(core_calloc((size_t)PTRDIFF_MAX, 1));
    core_free(NULL);
    char *s = core_strdup("abc");
    assert_string_equal(s, "abc");
    core_free(s);
}

static void test_injection(void **state) {
    (void)state;
    core_alloc_fail_after(3);
    void *a = core_alloc(1, 1), *b = core_calloc(1, 1), *c = core_alloc(1, 1), *d = core_alloc(1, 1);
    core_alloc_fail_after(0);
    assert_non_null(a);
    assert_non_null(b);
    assert_null(c);
    assert_non_null(d);
    core_free(a);
    core_free(b);
    core_free(d);
}

static void test_arena(void **state) {
    (void)state;
    core_arena *arena = core_arena_create(8192);
    assert_non_null(arena);
    for (int round = 0; round < 3; round++) {
        unsigned char *all[200];
        for (size_t i = 0; i < 200; i++) {
            size_t n = i * 37 % 500 + (i == 100 ? 20000 : 0);
            all[i] = core_arena_alloc(arena, n, 1);
            assert_non_null(all[i]);
            assert_int_equal((uintptr_t)all[i] % 64, 0);
            for (size_t k = 0; k < n; k++) {
                assert_int_equal(all[i][k], 0);
            }
            memset(all[i], (int)i, n);
        }
        for (size_t i = 0; i < 200; i++) {
            if (i * 37 % 500 > 0) {
                assert_int_equal(all[i][i * 37 % 500 - 1], (unsigned char)i);
            }
        }
        core_arena_reset(arena);
    }
    /* What was reset is used again: nothing new is allocated. */
    core_alloc_fail_after(1);
    assert_non_null(core_arena_alloc(arena, 4000, 1));
    assert_null(core_arena_alloc(arena, 100000, 1));
    core_alloc_fail_after(0);
    assert_null(core_arena_alloc(arena, SIZE_MAX / 2, 3));
    assert_non_null(core_arena_alloc(arena, 100000, 1));
    core_arena_destroy(arena);
    core_arena_destroy(NULL);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_alloc),
        cmocka_unit_test(test_injection),
        cmocka_unit_test(test_arena),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
