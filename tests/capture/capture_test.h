/* SPDX-License-Identifier: Apache-2.0 */
/* capture_test.h: a folder to work in, and sequences of the simulated camera. */
#ifndef TESTS_CAPTURE_TEST_H
#define TESTS_CAPTURE_TEST_H

#include <dirent.h>
#include <ftw.h>
#include <limits.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "brace/image.h"
#include "capture/capture.h"
#include "sim/screen.h"

static char test_folder[64], test_screen[PATH_MAX];

static inline int test_remove_one(const char *path, const struct stat *info, int kind, struct FTW *where) {
    (void)info, (void)kind, (void)where;
    return remove(path);
}

static inline void test_remove(const char *path) {
    nftw(path, test_remove_one, 16, FTW_DEPTH | FTW_PHYS);
}

static inline int test_folder_make(void **state) {
    (void)state;
    snprintf(test_folder, sizeof test_folder, "/tmp/brace-capture-XXXXXX");
    return mkdtemp(test_folder) == NULL;
}

static inline int test_folder_remove(void **state) {
    (void)state;
    test_remove(test_folder);
    return 0;
}

/* A path in the folder, in one of four buffers. */
static inline const char *test_path(const char *name) {
    static char buffers[4][PATH_MAX];
    static int next;
    char *out = buffers[next++ % 4];
    snprintf(out, PATH_MAX, "%s/%s", test_folder, name);
    return out;
}

static inline bool test_exists(const char *name) {
    struct stat info;
    return lstat(test_path(name), &info) == 0;
}

/* Files in a folder, hidden ones too; -1: it is not there. */
static inline int test_count(const char *name) {
    DIR *dir = opendir(test_path(name));
    int n = 0;
    if (dir == NULL)
        return -1;
    for (const struct dirent *e; (e = readdir(dir)) != NULL;)
        n += strcmp(e->d_name, ".") != 0 && strcmp(e->d_name, "..") != 0;
    closedir(dir);
    return n;
}

/* cmocka's own compares single precision. */
static inline void test_near(double a, double b, double tolerance) {
    if (!(fabs(a - b) <= tolerance))
        fail_msg("%.17g is not %.17g within %g", a, b, tolerance);
}

static inline void test_good(brace_status status, const brace_error *error) {
    if (status != BRACE_OK)
        fail_msg("%s", error->message);
}

/* A small copy of a screen: decoding a large one would take longer than photographing it. */
static inline int test_screen_make(void **state) {
    (void)state;
    brace_image *large = NULL, *small = NULL;
    char path[PATH_MAX];
    snprintf(test_screen, sizeof test_screen, "/tmp/brace-capture-screen-%d.png", (int)getpid());
    snprintf(path, sizeof path, "%s/screens/000009_static.webp",
             getenv("BRACE_DATA") != NULL ? getenv("BRACE_DATA") : "data");
    brace_status status = sim_screen_read(&large, NULL, path, NULL, NULL);
    if (status == BRACE_OK)
        status = brace_image_resize(&small, large, 384, 216, NULL);
    if (status == BRACE_OK)
        status = brace_image_write(small, test_screen, NULL, NULL, NULL);
    brace_image_destroy(large);
    brace_image_destroy(small);
    return status != BRACE_OK;
}

static inline int test_screen_remove(void **state) {
    (void)state;
    return remove(test_screen);
}

/* Shoots a small sequence with the simulated camera. `fault` NULL: none. */
static inline brace_status test_shoot(capture_sequence *out, const char *name, const char *port, const char *fault,
                                      const char *more, capture_run_params params, brace_error *error) {
    char option[256], screen[PATH_MAX + 8];
    const char *options[4] = {"size=192x144", screen};
    size_t count = 2;
    snprintf(screen, sizeof screen, "screen=%s", test_screen);
    const capture_backend *backend;
    const char *unused;
    assert_int_equal(capture_backend_find(&backend, &unused, "sim", error), BRACE_OK);
    snprintf(option, sizeof option, "fault=%s", fault != NULL ? fault : "");
    if (fault != NULL)
        options[count++] = option;
    if (more != NULL)
        options[count++] = more;
    const capture_address address = {.port = port, .options = options, .option_count = count};
    const brace_job job = {.threads = 1};
    params.backoff = params.backoff > 0 ? params.backoff : 0.001;
    return capture_run(out, backend, &address, test_path(name), &params, &job, error);
}

#endif
