/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_error.c: error sentences, notes, cancelling, versions.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "brace/version.h"
#include "core/core.h"

static void test_fail(void **state) {
    (void)state;
    brace_error error = {BRACE_OK, ""};
    assert_int_equal(core_fail(&error, BRACE_ERROR_IO, "%s: value %d", "a.dng", 7), BRACE_ERROR_IO);
    assert_int_equal(error.status, BRACE_ERROR_IO);
    assert_string_equal(error.message, "a.dng: value 7");
    core_error_prefix(&error, "bracket");
    assert_string_equal(error.message, "bracket: a.dng: value 7");
    assert_int_equal(error.status, BRACE_ERROR_IO);
    assert_int_equal(core_fail(NULL, BRACE_ERROR_FORMAT, "x"), BRACE_ERROR_FORMAT);
    core_error_prefix(NULL, "x");
    assert_int_equal(core_fail_memory(&error, (size_t)300 << 20, "a frame"), BRACE_ERROR_MEMORY);
    assert_non_null(strstr(error.message, "300 MB for a frame"));
}

static void test_long_and_hostile(void **state) {
    (void)state;
    brace_error error;
    char *name = malloc(5000);
    assert_non_null(name);
    memset(name, 'n', 4999);
    name[4999] = '\0';
    core_fail(&error, BRACE_ERROR_IO, "%s: no", name);
    assert_int_equal(strlen(error.message), BRACE_ERROR_LENGTH - 1);
    core_error_prefix(&error, name);
    assert_int_equal(strlen(error.message), BRACE_ERROR_LENGTH - 1);
    core_fail(&error, BRACE_ERROR_IO, "%s", "a\033[2Jb\nc");
    assert_string_equal(error.message, "a [2Jb c");
    free(name);
}

static void test_names(void **state) {
    (void)state;
    for (int s = -1; s < 20; s++) {
        assert_non_null(brace_status_name((brace_status)s));
    }
    assert_string_equal(brace_status_name(BRACE_ERROR_MEMORY), "out of memory");
}

static char noted[64];

static void on_note(void *user, const char *message) {
    assert_ptr_equal(user, noted);
    strncpy(noted, message, sizeof noted - 1);
}

static void test_job(void **state) {
    (void)state;
    volatile int cancel = 0;
    brace_job job = {.note = on_note, .user = noted, .cancel = &cancel};
    core_note(&job, "%s: %d", "white", 4095);
    assert_string_equal(noted, "white: 4095");
    core_note(NULL, "nothing");
    core_progress(NULL, "x", 1, 2);
    core_progress(&job, "x", 1, 2);
    brace_error error;
    assert_int_equal(core_check_cancel(&job, &error), BRACE_OK);
    assert_int_equal(core_check_cancel(NULL, &error), BRACE_OK);
    cancel = 1;
    assert_int_equal(core_check_cancel(&job, &error), BRACE_ERROR_CANCELLED);
    assert_true(core_cancelled(&job));
}

static void test_version(void **state) {
    (void)state;
    assert_string_equal(brace_version(), BRACE_VERSION_STRING);
    const char *d = brace_dependencies();
    assert_non_null(strstr(d, "LibRaw "));
    assert_non_null(strstr(d, "libtiff "));
    assert_non_null(strstr(d, "libpng 1."));
    assert_null(strchr(d, '\n'));
    assert_ptr_equal(d, brace_dependencies());
}

static void test_cpu(void **state) {
    (void)state;
    setenv("BRACE_CPU", "plain", 1);
    core_cpu cpu = core_cpu_features();
    assert_false(cpu.avx2 || cpu.avx512 || cpu.f16c || cpu.sha);
    setenv("BRACE_CPU", "avx2", 1);
    assert_false(core_cpu_features().avx512);
    unsetenv("BRACE_CPU");
    cpu = core_cpu_features();
    assert_true(!cpu.avx512 || cpu.avx2);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fail), cmocka_unit_test(test_long_and_hostile), cmocka_unit_test(test_names),
        cmocka_unit_test(test_job),  cmocka_unit_test(test_version),          cmocka_unit_test(test_cpu),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
