/* SPDX-License-Identifier: Apache-2.0 */
/* test_align.c: motion is found through flicker, clipping and noise. */
// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>
// clang-format on
#include <math.h>

#include "restore/internal.h"
#include "scene.h"

static void check_motion(const scene *s, double shift_tolerance) {
    brace_bracket *bracket = scene_bracket(s);
    brace_restored *restored;
    brace_error error;
    assert_int_equal(brace_restore(&restored, bracket, NULL, NULL, &error), BRACE_OK);
    for (int i = 0; i < 5; i++) {
        const brace_motion *m = &restored->report.motion[i];
        double want = (i - 2) * s->shift;
        if (fabs(m->dx - want) > shift_tolerance || fabs(m->dy - want) > shift_tolerance || fabs(m->scale - 1) > 2e-3)
            fail_msg("frame %d: found (%.2f, %.2f) scale %.4f confidence %.2f, moved by %.2f", i, m->dx, m->dy,
                     m->scale, m->confidence, want);
    }
    brace_restored_destroy(restored);
    brace_bracket_destroy(bracket);
}

static void test_steady(void **state) {
    (void)state;
    check_motion(&(scene){.width = 256, .height = 208, .level = 0.35, .shift = 1.7, .seed = 1}, 0.3);
}

static void test_flicker(void **state) {
    (void)state;
    /* The shortest frames are dark in every second stripe; stripes must not pass for motion. */
    check_motion(&(scene){.width = 256,
                          .height = 208,
                          .cfa = BRACE_CFA_GBRG,
                          .level = 0.35,
                          .shift = 1.7,
                          .pulses = 7.3,
                          .duty = 0.5,
                          .reference = 0.6,
                          .seed = 2},
                 0.4);
}

static void test_far(void **state) {
    (void)state;
    /* A shift of 24 pixels between the outer frames needs the search at the top of the pyramid. */
    check_motion(&(scene){.width = 304,
                          .height = 256,
                          .level = 0.08,
                          .shift = 6,
                          .pulses = 6,
                          .duty = 0.6,
                          .reference = 0.7,
                          .seed = 3},
                 0.6);
}

/* The longest frame clips where the reference has something to tell: it is found by way of the frame between them. */
static void test_chain(void **state) {
    (void)state;
    const scene s = {.width = 320, .height = 256, .level = 0.1, .shift = 2, .seed = 4};
    brace_bracket *bracket = scene_bracket(&s);
    brace_frame *reference = bracket->frames[2], *longest = bracket->frames[4];
    core_random r = core_random_create(7, 0, 0, 0);
    for (uint32_t y = 0; y < s.height; y++) {
        for (uint32_t x = 0; x < s.width; x++) {
            const size_t i = (size_t)y * s.width + x;
            if (x < s.width / 2)
                longest->data[i] = (uint16_t)longest->white;
            else
                reference->data[i] = (uint16_t)(530 + 5 * core_random_normal(&r));
        }
    }
    brace_restored *restored;
    brace_error error;
    assert_int_equal(brace_restore(&restored, bracket, NULL, NULL, &error), BRACE_OK);
    const brace_motion *m = &restored->report.motion[4];
    if (!(fabs(m->dx - 4) < 1 && fabs(m->dy - 4) < 1 && m->confidence > RESTORE_FOUND))
        fail_msg("found (%.2f, %.2f), confidence %.2f", m->dx, m->dy, m->confidence);
    brace_restored_destroy(restored);
    brace_bracket_destroy(bracket);
}

static void test_tripod(void **state) {
    (void)state;
    scene s = {.width = 200, .height = 150, .level = 0.3, .shift = 2, .seed = 4};
    brace_bracket *bracket = scene_bracket(&s);
    brace_restored *restored;
    brace_error error;
    brace_restore_params params = {.no_align = true};
    assert_int_equal(brace_restore(&restored, bracket, &params, NULL, &error), BRACE_OK);
    for (int i = 0; i < 5; i++)
        assert_true(restored->report.motion[i].dx == 0 && restored->report.motion[i].scale == 1);
    brace_restored_destroy(restored);
    brace_bracket_destroy(bracket);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_steady),
        cmocka_unit_test(test_flicker),
        cmocka_unit_test(test_far),
        cmocka_unit_test(test_chain),
        cmocka_unit_test(test_tripod),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
