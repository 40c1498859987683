/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_file.c: files are complete or not there, whatever goes wrong.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <dirent.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "core/core.h"

static char folder[64], path[128];

static int setup(void **state) {
    (void)state;
    strcpy(folder, "/tmp/brace-file-XXXXXX");
    if (mkdtemp(folder) == NULL) {
        return -1;
    }
    snprintf(path, sizeof path, "%s/out.bin", folder);
    return 0;
}

static int entries(void) {
    int n = 0;
    DIR *d = opendir(folder);
    assert_non_null(d);
    for (struct dirent *e; (e = readdir(d)) != NULL;) {
        n += strcmp(e->d_name, ".") != 0 && strcmp(e->d_name, "..") != 0;
    }
    closedir(d);
    return n;
}

static int teardown(void **state) {
    (void)state;
    DIR *d = opendir(folder);
    for (struct dirent *e; d != NULL && (e = readdir(d)) != NULL;) {
        char name[400];
        snprintf(name, sizeof name, "%s/%s", folder, e->d_name);
        unlink(name);
        rmdir(name);
    }
    closedir(d);
    return rmdir(folder);
}

static void put(const char *name, const char *text) {
    FILE *f = fopen(name, "wb");
    assert_non_null(f);
    fputs(text, f);
    fclose(f);
}

static void assert_holds(const char *name, const char *text) {
    void *data = NULL;
    size_t size = 0;
    assert_int_equal(core_file_load(&data, &size, name, 1000, NULL), BRACE_OK);
    assert_int_equal(size, strlen(text));
    assert_memory_equal(data, text, size);
    core_free(data);
}

static void test_commit(void **state) {
    (void)state;
    core_file *file = NULL;
    mode_t mask = umask(027);
    assert_int_equal(core_file_create(&file, path, NULL), BRACE_OK);
    fputs("hello", core_file_stream(file));
    fseek(core_file_stream(file), 1, SEEK_SET);
    fputs("a", core_file_stream(file));
    assert_int_not_equal(access(path, F_OK), 0);
    assert_int_equal(entries(), 1);
    assert_int_equal(core_file_commit(file, NULL), BRACE_OK);
    umask(mask);
    assert_int_equal(entries(), 1);
    assert_holds(path, "hallo");
    struct stat st;
    assert_int_equal(stat(path, &st), 0);
    assert_int_equal(st.st_mode & 0777, 0640);
}

static void test_abort(void **state) {
    (void)state;
    core_file *file = NULL;
    put(path, "old");
    assert_int_equal(core_file_create(&file, path, NULL), BRACE_OK);
    fputs("new", core_file_stream(file));
    core_file_abort(file);
    core_file_abort(NULL);
    assert_int_equal(entries(), 1);
    assert_holds(path, "old");
}

static void test_replace_keeps_mode_and_link(void **state) {
    (void)state;
    put(path, "old");
    chmod(path, 0604);
    char link[160];
    snprintf(link, sizeof link, "%s/link", folder);
    assert_int_equal(symlink("out.bin", link), 0);
    core_file *file = NULL;
    assert_int_equal(core_file_create(&file, link, NULL), BRACE_OK);
    fputs("new", core_file_stream(file));
    assert_int_equal(core_file_commit(file, NULL), BRACE_OK);
    struct stat st;
    assert_int_equal(lstat(link, &st), 0);
    assert_true(S_ISLNK(st.st_mode));
    assert_int_equal(lstat(path, &st), 0);
    assert_true(S_ISREG(st.st_mode));
    assert_int_equal(st.st_mode & 0777, 0604);
    assert_holds(path, "new");
}

static void test_by_name(void **state) {
    (void)state;
    core_file *file = NULL;
    assert_int_equal(core_file_create(&file, path, NULL), BRACE_OK);
    put(core_file_temporary(file), "written by name");
    assert_int_equal(core_file_commit(file, NULL), BRACE_OK);
    assert_holds(path, "written by name");
}

static void test_relative_after_chdir(void **state) {
    (void)state;
    char *before = getcwd(NULL, 0);
    assert_int_equal(chdir(folder), 0);
    core_file *file = NULL;
    assert_int_equal(core_file_create(&file, "rel.bin", NULL), BRACE_OK);
    assert_int_equal(chdir("/"), 0);
    fputs("x", core_file_stream(file));
    assert_int_equal(core_file_commit(file, NULL), BRACE_OK);
    assert_int_equal(chdir(before), 0);
    free(before);
    char name[160];
    snprintf(name, sizeof name, "%s/rel.bin", folder);
    assert_holds(name, "x");
}

static void test_full_disk(void **state) {
    (void)state;
    core_file *file = NULL;
    brace_error error;
    assert_int_equal(core_file_create(&file, "/dev/full", &error), BRACE_OK);
    for (int i = 0; i < 10000; i++) {
        fputs("0123456789", core_file_stream(file));
    }
    assert_int_equal(core_file_commit(file, &error), BRACE_ERROR_IO);
    assert_non_null(strstr(error.message, "/dev/full"));
    assert_non_null(strstr(error.message, "no space left"));
    assert_int_equal(core_file_create(&file, "/dev/null", &error), BRACE_OK);
    fputs("gone", core_file_stream(file));
    assert_int_equal(core_file_commit(file, &error), BRACE_OK);
}

/* A file system in memory has files like any other: they stay whole until they are replaced. */
static void test_memory_files(void **state) {
    (void)state;
    char name[64];
    snprintf(name, sizeof name, "/dev/shm/brace-test-%d.bin", (int)getpid());
    FILE *f = fopen(name, "w");
    if (f == NULL) {
        skip(); /* there is none */
    }
    fputs("old", f);
    fclose(f);
    core_file *file = NULL;
    for (int keep = 0; keep < 2; keep++) {
        assert_int_equal(core_file_create(&file, name, NULL), BRACE_OK);
        fputs("new", core_file_stream(file));
        assert_holds(name, "old");
        if (keep == 0) {
            core_file_abort(file);
            assert_holds(name, "old");
        } else {
            assert_int_equal(core_file_commit(file, NULL), BRACE_OK);
            assert_holds(name, "new");
        }
    }
    unlink(name);
}

static void *drain(void *arg) {
    static char text[32];
    int fd = open(arg, O_RDONLY);
    ssize_t n = 0, k;
    while (fd >= 0 && (k = read(fd, text + n, sizeof text - 1 - (size_t)n)) > 0) {
        n += k;
    }
    close(fd);
    return text;
}

static void test_pipe(void **state) {
    (void)state;
    assert_int_equal(mkfifo(path, 0600), 0);
    pthread_t reader;
    void *text = NULL;
    assert_int_equal(pthread_create(&reader, NULL, drain, path), 0);
    core_file *file = NULL;
    assert_int_equal(core_file_create(&file, path, NULL), BRACE_OK);
    fputs("XXXX", core_file_stream(file));
    fseek(core_file_stream(file), 0, SEEK_SET); /* seeking works even so */
    fputs("pipe", core_file_stream(file));
    assert_int_equal(core_file_commit(file, NULL), BRACE_OK);
    pthread_join(reader, &text);
    assert_string_equal(text, "pipe");
    brace_error error;
    void *data = NULL;
    size_t size = 0;
    assert_int_equal(core_file_load(&data, &size, path, 100, &error), BRACE_ERROR_IO);
}

static void test_bad_places(void **state) {
    (void)state;
    core_file *file = NULL;
    brace_error error;
    char name[6000];
    static const char *const bad[] = {"", "/proc/nothing.png", "/nowhere/at/all.png", "/tmp", "/tmp/", "/dev/null/x"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        error.message[0] = '\0';
        assert_int_not_equal(core_file_create(&file, bad[i], &error), BRACE_OK);
        assert_null(file);
        assert_true(strlen(error.message) > 10);
    }
    assert_int_equal(core_file_create(&file, NULL, &error), BRACE_ERROR_ARGUMENT);
    core_file_create(&file, "/nowhere/at/all.png", &error);
    assert_non_null(strstr(error.message, "folder does not exist"));
    memset(name, 'n', sizeof name - 1);
    name[sizeof name - 1] = '\0';
    assert_int_equal(core_file_create(&file, name, &error), BRACE_ERROR_IO);
    snprintf(name, sizeof name, "%s/%0250d", folder,
             1); /* as long as a name may be: the temporary's must not be longer */
    name[strlen(folder) + 1 + 250] = '\0';
    assert_int_equal(core_file_create(&file, name, &error), BRACE_OK);
    assert_int_equal(core_file_commit(file, &error), BRACE_OK);
    if (geteuid() != 0) { /* root may write everywhere */
        chmod(folder, 0500);
        assert_int_equal(core_file_create(&file, path, &error), BRACE_ERROR_IO);
        assert_non_null(strstr(error.message, "does not allow new files"));
        chmod(folder, 0700);
        put(path, "mine");
        chmod(path, 0400);
        assert_int_equal(core_file_create(&file, path, &error), BRACE_ERROR_IO);
        assert_non_null(strstr(error.message, "write-protected"));
    }
}

static void on_signal(int number) {
    (void)number;
    core_files_abort_all();
    _exit(130);
}

static void test_killed(void **state) {
    (void)state;
    put(path, "old");
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        core_file *files[70]; /* more than any fixed table */
        signal(SIGINT, on_signal);
        for (int i = 0; i < 70; i++) {
            if (core_file_create(&files[i], path, NULL) != BRACE_OK) {
                _exit(1);
            }
            fputs("new", core_file_stream(files[i]));
        }
        core_file_abort(files[3]); /* a free slot in between */
        if (entries() != 70) {
            _exit(2);
        }
        raise(SIGINT);
        _exit(3);
    }
    int status = 0;
    waitpid(child, &status, 0);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), 130);
    assert_int_equal(entries(), 1);
    assert_holds(path, "old");
}

static void test_load(void **state) {
    (void)state;
    brace_error error;
    void *data = NULL;
    size_t size = 0;
    put(path, "");
    assert_int_equal(core_file_load(&data, &size, path, 10, &error), BRACE_OK);
    assert_non_null(data);
    assert_int_equal(size, 0);
    core_free(data);
    put(path, "0123456789");
    assert_int_equal(core_file_load(&data, &size, path, 10, &error), BRACE_OK);
    core_free(data);
    assert_int_equal(core_file_load(&data, &size, path, 9, &error), BRACE_ERROR_UNSUPPORTED);
    assert_int_equal(core_file_load(&data, &size, folder, 9, &error), BRACE_ERROR_IO);
    assert_non_null(strstr(error.message, "folder"));
    assert_int_equal(core_file_load(&data, &size, "/nowhere/x", 9, &error), BRACE_ERROR_IO);
    assert_int_equal(core_file_load(&data, &size, "/dev/zero", 9, &error), BRACE_ERROR_IO);
    assert_int_equal(core_file_load(&data, &size, NULL, 9, &error), BRACE_ERROR_ARGUMENT);
    assert_null(data);
}

static void test_allocation_failures(void **state) {
    (void)state;
    brace_status status = BRACE_ERROR_MEMORY;
    for (long n = 1; status != BRACE_OK; n++) {
        assert_true(n < 20);
        core_file *file = NULL;
        core_alloc_fail_after(n);
        status = core_file_create(&file, path, NULL);
        core_alloc_fail_after(0);
        assert_true(status == BRACE_OK || status == BRACE_ERROR_MEMORY);
        core_file_abort(file);
        assert_int_equal(entries(), 0);
    }
}

int main(void) {
#define TEST(f) cmocka_unit_test_setup_teardown(f, setup, teardown)
    const struct CMUnitTest tests[] = {
        TEST(test_commit),
        TEST(test_abort),
        TEST(test_replace_keeps_mode_and_link),
        TEST(test_by_name),
        TEST(test_pipe),
        TEST(test_relative_after_chdir),
        TEST(test_full_disk), TEST(test_memory_files),
        TEST(test_bad_places),
        TEST(test_killed),
        TEST(test_load),
        TEST(test_allocation_failures),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
