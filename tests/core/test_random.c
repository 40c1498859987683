/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_random.c: Philox against its published vectors, and the distributions.
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

/* philox4x32 with 10 rounds, from kat_vectors of the authors' Random123 library. */
static void test_known_answers(void **state) {
    (void)state;
    static const struct {
        uint32_t counter[4], key[2], expected[4];
    } kat[] = {
        {{0, 0, 0, 0}, {0, 0}, {0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}},
        {{0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff},
         {0xffffffff, 0xffffffff},
         {0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}},
        {{0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344},
         {0xa4093822, 0x299f31d0},
         {0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}},
    };
    for (size_t i = 0; i < sizeof kat / sizeof *kat; i++) {
        uint32_t out[4];
        core_philox(kat[i].counter, kat[i].key, out);
        assert_memory_equal(out, kat[i].expected, sizeof out);
    }
}

static void test_streams(void **state) {
    (void)state;
    core_random a = core_random_create(42, 1, 2, 3), b = core_random_create(42, 1, 2, 3);
    core_random c = core_random_create(42, 1, 2, 4), d = core_random_create(43, 1, 2, 3);
    int same_c = 0, same_d = 0;
    for (int i = 0; i < 1000; i++) {
        uint32_t v = core_random_u32(&a);
        assert_int_equal(v, core_random_u32(&b));
        same_c += v == core_random_u32(&c);
        same_d += v == core_random_u32(&d);
    }
    assert_true(same_c < 3 && same_d < 3);
}

static void test_distributions(void **state) {
    (void)state;
    core_random r = core_random_create(7, 0, 0, 0);
    enum { N = 200000 };
    double sum = 0, squares = 0, fourth = 0, uniform = 0;
    int bins[6] = {0};
    for (int i = 0; i < N; i++) {
        double u = core_random_uniform(&r), x = core_random_normal(&r), y = core_random_range(&r, -2, 3);
        assert_true(u >= 0 && u < 1);
        assert_true(isfinite(x));
        assert_true(y >= -2 && y < 3);
        uniform += u;
        sum += x;
        squares += x * x;
        fourth += x * x * x * x;
        uint32_t k = core_random_below(&r, 6);
        assert_true(k < 6);
        bins[k]++;
    }
    assert_true(fabs(uniform / N - 0.5) < 0.005);
    assert_true(fabs(sum / N) < 0.01);
    assert_true(fabs(squares / N - 1) < 0.02);
    assert_true(fabs(fourth / N - 3) < 0.15);
    for (int k = 0; k < 6; k++) {
        assert_true(abs(bins[k] - N / 6) < 1000);
    }
    assert_int_equal(core_random_below(&r, 1), 0);
    assert_int_equal(core_random_below(&r, 0), 0);
    assert_true(core_random_range(&r, 5, 5) == 5);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_known_answers),
        cmocka_unit_test(test_streams),
        cmocka_unit_test(test_distributions),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
