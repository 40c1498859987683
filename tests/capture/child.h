/* SPDX-License-Identifier: Apache-2.0 */
/*
 * child.h: the phone's program and the cable as processes of a test.
 */
#ifndef TESTS_CAPTURE_CHILD_H
#define TESTS_CAPTURE_CHILD_H

#include <fcntl.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

typedef struct child {
    pid_t pid;
    unsigned port;
} child;

/* Starts a program that prints "listening on 127.0.0.1:PORT". */
static inline child child_start(const char *const *arguments, const char *faults) {
    int ends[2];
    assert_int_equal(pipe2(ends, O_CLOEXEC), 0);
    child c = {.pid = fork()};
    assert_true(c.pid >= 0);
    if (c.pid == 0) {
        dup2(ends[1], 1);
        if (faults != NULL) {
            setenv("BRACE_FAKE_FAULTS", faults, 1);
        }
        execv(arguments[0], (char *const *)(uintptr_t)arguments);
        _exit(127);
    }
    close(ends[1]);
    char line[256] = "";
    size_t have = 0;
    while (have < sizeof line - 1 && strchr(line, '\n') == NULL) {
        const ssize_t n = read(ends[0], line + have, sizeof line - 1 - have);
        assert_true(n > 0);
        have += (size_t)n;
    }
    close(ends[0]);
    assert_int_equal(sscanf(line, "listening on 127.0.0.1:%u", &c.port), 1);
    return c;
}

static inline child child_phone(const char *program, const char *faults) {
    const char *arguments[] = {program, "--port", "0", "--timeout", "2", "--quiet", NULL};
    return child_start(arguments, faults);
}

/* `faults`: of the first connections, ended by NULL; at most 8. */
static inline child child_cable(const char *program, child phone, const char *const *faults) {
    char port[16];
    const char *arguments[11] = {program, port};
    snprintf(port, sizeof port, "%u", phone.port);
    for (size_t i = 0; i < 8 && faults[i] != NULL; i++) {
        arguments[i + 2] = faults[i];
    }
    return child_start(arguments, NULL);
}

/* Ends a program; its exit code, or -1 if it had to be killed or a signal ended it. */
static inline int child_end(child c, bool politely) {
    int code = 0;
    kill(c.pid, politely ? SIGTERM : SIGKILL);
    waitpid(c.pid, &code, 0);
    return WIFEXITED(code) ? WEXITSTATUS(code) : -1;
}

#endif
