/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_progress.c: what the progress display prints, with a clock of our own.
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
#include "core/progress.h"

static double clock_now;

static double fake_clock(void *user) {
    (void)user;
    return clock_now;
}

typedef struct capture {
    FILE *stream;
    char *text;
    size_t size;
} capture;

static core_bar *start(capture *c, bool terminal, bool quiet) {
    c->text = NULL;
    c->stream = open_memstream(&c->text, &c->size);
    assert_non_null(c->stream);
    clock_now = 100;
    core_bar_params params = {.out = c->stream,
                              .quiet = quiet,
                              .kind = terminal ? CORE_BAR_TERMINAL : CORE_BAR_PLAIN,
                              .width = 60,
                              .clock = fake_clock};
    core_bar *bar = core_bar_create(&params);
    assert_non_null(bar);
    return bar;
}

static void finish(capture *c, core_bar *bar) {
    core_bar_destroy(bar);
    fclose(c->stream);
}

static int count(const char *text, char what) {
    int n = 0;
    for (; *text != '\0'; text++) {
        n += *text == what;
    }
    return n;
}

static void run(core_bar *bar, double seconds) {
    for (uint64_t i = 0; i <= 1000; i++) {
        core_bar_update(bar, "align", i, 1000);
        clock_now += seconds / 1000;
    }
}

static void test_terminal(void **state) {
    (void)state;
    capture c;
    core_bar *bar = start(&c, true, false);
    run(bar, 5);
    finish(&c, bar);
    int redraws = count(c.text, '\r');
    assert_true(redraws > 20 && redraws <= 52);
    assert_int_equal(count(c.text, '\n'), 1);
    assert_non_null(strstr(c.text, "#"));
    assert_non_null(strstr(c.text, "left"));
    assert_non_null(strstr(c.text, "align: done, 1000 in 5.0 s (200/s)\n"));
    /* No line is wider than the window. */
    for (const char *p = strchr(c.text, '\r'); p != NULL; p = strchr(p + 1, '\r')) {
        assert_true(strcspn(p + 1, "\r\n\033") < 60);
    }
    free(c.text);
}

static void test_plain(void **state) {
    (void)state;
    capture c;
    core_bar *bar = start(&c, false, false);
    run(bar, 35);
    finish(&c, bar);
    assert_null(strpbrk(c.text, "\r\033"));
    assert_int_equal(count(c.text, '\n'), 5); /* start, 10, 20, 30 seconds, end */
    assert_non_null(strstr(c.text, "align: started\n"));
    assert_non_null(strstr(c.text, "left\n"));
    free(c.text);
}

static void test_quiet_and_notes(void **state) {
    (void)state;
    capture c;
    core_bar *bar = start(&c, true, true);
    run(bar, 35);
    core_bar_note(bar, "frame_4.dng: odd");
    finish(&c, bar);
    assert_string_equal(c.text, "frame_4.dng: odd\n");
    free(c.text);
    bar = start(&c, true, false);
    core_bar_update(bar, "read", 1, 5);
    core_bar_note(bar, "a remark");
    core_bar_update(bar, "align", 0, 0); /* unknown total */
    clock_now += 1;
    core_bar_update(bar, "align", 12345678, 0);
    finish(&c, bar);
    assert_non_null(strstr(c.text, "\r\033[Ka remark\n"));
    assert_non_null(strstr(c.text, "align 12345678  12.3M/s"));
    assert_true(strcmp(c.text + strlen(c.text) - 4, "\r\033[K") == 0); /* the unfinished bar is gone */
    free(c.text);
    core_bar_update(NULL, "x", 1, 2);
    core_bar_note(NULL, "x");
    core_bar_destroy(NULL);
    core_bar_params none = {.out = NULL};
    bar = core_bar_create(&none);
    core_bar_update(bar, "x", 1, 2);
    core_bar_note(bar, "x");
    core_bar_destroy(bar);
}

static void test_stages(void **state) {
    (void)state;
    capture c;
    core_bar *bar = start(&c, false, false);
    core_bar_update(bar, "read", 3, 3);
    core_bar_update(bar, "read", 3, 3);
    core_bar_update(bar, "merge", 9, 3); /* more than all is all */
    finish(&c, bar);
    assert_int_equal(count(c.text, '\n'), 3);
    assert_non_null(strstr(c.text, "merge: done, 3 in 0.0 s\n"));
    free(c.text);
}

/* Work that goes on where an earlier run stopped: rate and time left are those of this run. */
static void test_resumed(void **state) {
    (void)state;
    capture c;
    core_bar *bar = start(&c, false, false);
    core_bar_update(bar, "training", 900, 1000);
    clock_now += 20;
    core_bar_update(bar, "training", 940, 1000);
    clock_now += 30;
    core_bar_update(bar, "training", 1000, 1000);
    finish(&c, bar);
    assert_non_null(strstr(c.text, "2.0/s  0:30 left"));
    assert_non_null(strstr(c.text, "1000 in 50.0 s (2.0/s)"));
    free(c.text);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_terminal),
        cmocka_unit_test(test_plain),
        cmocka_unit_test(test_quiet_and_notes),
        cmocka_unit_test(test_stages),
        cmocka_unit_test(test_resumed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
