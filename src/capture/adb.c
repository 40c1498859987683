/* SPDX-License-Identifier: Apache-2.0 */
/* adb.c: see adb.h. No shell is involved: nothing in a serial number is interpreted. */
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "capture/adb.h"
#include "capture/camera.h"
#include "capture/protocol.h"

extern char **environ;

/* The child's output, as far as it is there; unprintable bytes become blanks. */
static void drain(int fd, char *text, size_t size) {
    size_t have = strlen(text);
    while (have + 1 < size) {
        const ssize_t n = read(fd, text + have, size - 1 - have);
        if (n <= 0) {
            break;
        }
        for (size_t end = have + (size_t)n; have < end; have++) {
            text[have] = text[have] >= ' ' && text[have] <= '~' ? text[have] : ' ';
        }
        text[have] = '\0';
    }
}

static int start(pid_t *child, char *const *arguments, int out) {
    posix_spawn_file_actions_t actions;
    int failed = posix_spawn_file_actions_init(&actions);
    if (failed != 0) {
        return failed;
    }
    failed = posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
    failed = failed != 0 ? failed : posix_spawn_file_actions_adddup2(&actions, out, 1);
    failed = failed != 0 ? failed : posix_spawn_file_actions_adddup2(&actions, out, 2);
    failed = failed != 0 ? failed : posix_spawnp(child, arguments[0], &actions, NULL, arguments, environ);
    posix_spawn_file_actions_destroy(&actions);
    return failed;
}

/* Waits for the child, not for the end of its output: a server that adb leaves behind keeps that open. */
static brace_status finish(pid_t child, int in, const brace_job *job, brace_error *error) {
    const double end = core_seconds() + 10;
    char text[400] = "";
    int code = 0;
    for (;;) {
        drain(in, text, sizeof text);
        const pid_t done = waitpid(child, &code, WNOHANG);
        if (done == child) {
            break;
        }
        brace_status status =
            done < 0 ? core_fail(error, BRACE_ERROR_IO, "adb: %s", strerror(errno)) : capture_wait(0.02, job, error);
        if (status == BRACE_OK && core_seconds() > end) {
            status = core_fail(error, BRACE_ERROR_IO, "adb does not come to an end: %s", text);
        }
        if (status != BRACE_OK) {
            if (done == 0) {
                kill(child, SIGKILL);
                waitpid(child, &code, 0);
            }
            return status;
        }
    }
    drain(in, text, sizeof text);
    if (WIFEXITED(code) && WEXITSTATUS(code) == 0) {
        return BRACE_OK;
    }
    if (WIFEXITED(code) && WEXITSTATUS(code) == 127 && text[0] == '\0') {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED, "there is no adb on the PATH");
    }
    return core_fail(error, BRACE_ERROR_IO, "adb failed: %s", text[0] != '\0' ? text : "it does not say why");
}

brace_status capture_adb_forward(unsigned port, const char *serial, bool remove, const brace_job *job,
                                 brace_error *error) {
    char adb[] = "adb", dash_s[] = "-s", forward[] = "forward", dash_remove[] = "--remove", tcp[16];
    char device[128], socket[] = "localabstract:" CAPTURE_WIRE_SOCKET;
    char *arguments[8];
    size_t n = 0;
    snprintf(tcp, sizeof tcp, "tcp:%u", port);
    arguments[n++] = adb;
    if (serial != NULL) {
        snprintf(device, sizeof device, "%s", serial);
        arguments[n++] = dash_s;
        arguments[n++] = device;
    }
    arguments[n++] = forward;
    if (remove) {
        arguments[n++] = dash_remove;
    }
    arguments[n++] = tcp;
    if (!remove) {
        arguments[n++] = socket;
    }
    arguments[n] = NULL;

    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) {
        return core_fail(error, BRACE_ERROR_IO, "adb cannot be run: %s", strerror(errno));
    }
    fcntl(ends[0], F_SETFL, O_NONBLOCK);
    pid_t child = 0;
    const int failed = start(&child, arguments, ends[1]);
    close(ends[1]);
    brace_status status;
    if (failed == ENOENT) {
        status = core_fail(error, BRACE_ERROR_UNSUPPORTED, "there is no adb on the PATH");
    } else if (failed != 0) {
        status = core_fail(error, BRACE_ERROR_IO, "adb cannot be run: %s", strerror(failed));
    } else {
        status = finish(child, ends[0], job, error);
    }
    close(ends[0]);
    return status;
}
