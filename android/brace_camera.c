/* SPDX-License-Identifier: Apache-2.0 */
/*
 * brace_camera.c: the program that `brace capture` talks to on a phone. Started
 * from adb's shell, it waits on the abstract socket "brace" for one computer
 * at a time; see README.md beside it.
 */
#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "server.h"

static volatile sig_atomic_t stop_requested;

static void on_signal(int number) {
    (void)number;
    stop_requested = 1;
}

static bool stopped(void *user) {
    (void)user;
    return stop_requested != 0;
}

static int usage(FILE *to, int code) {
    fputs("usage: brace_camera [--port PORT] [--timeout SECONDS] [--idle SECONDS] [--quiet]\n"
          "\n"
          "Lets brace capture on a computer use the cameras of this phone.\n"
          "\n"
          "  --port PORT        listen on 127.0.0.1:PORT (0: any free one, which is printed)\n"
          "                     instead of the abstract socket \"" CAPTURE_WIRE_SOCKET "\"\n"
          "  --timeout SECONDS  how long a message may take on its way (default 10)\n"
          "  --idle SECONDS     how long a computer may be silent (default 300)\n"
          "  --quiet            print nothing but errors\n",
          to);
    return code;
}

/* A whole number from `least` to `most`, or -1. */
static long number(const char *text, long least, long most) {
    char *end = NULL;
    errno = 0;
    const long v = text != NULL ? strtol(text, &end, 10) : -1;
    return text != NULL && end != text && *end == '\0' && errno == 0 && v >= least && v <= most ? v : -1;
}

int main(int argc, char **argv) {
    long port = -1, timeout = 10, idle = 300;
    bool quiet = false;
    for (int i = 1; i < argc; i++) {
        const char *value = i + 1 < argc ? argv[i + 1] : NULL;
        if (strcmp(argv[i], "--help") == 0) {
            return usage(stdout, 0);
        }
        if (strcmp(argv[i], "--quiet") == 0) {
            quiet = true;
        } else if (strcmp(argv[i], "--port") == 0 && (port = number(value, 0, 65535)) >= 0) {
            i++;
        } else if (strcmp(argv[i], "--timeout") == 0 && (timeout = number(value, 1, 600)) >= 0) {
            i++;
        } else if (strcmp(argv[i], "--idle") == 0 && (idle = number(value, 1, 86400)) >= 0) {
            i++;
        } else {
            return usage(stderr, 2);
        }
    }
    struct sigaction action = {.sa_handler = on_signal};
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    sigaction(SIGHUP, &action, NULL); /* adb's shell ended */
    action.sa_handler = SIG_IGN;
    sigaction(SIGPIPE, &action, NULL);

    char why[SHIM_WHY] = "";
    shim *camera = NULL;
    if (shim_create(&camera, why) != SHIM_OK) {
        fprintf(stderr, "brace_camera: %s\n", why);
        return 1;
    }
    uint16_t bound = (uint16_t)(port > 0 ? port : 0);
    const int listener = port >= 0 ? server_listen_loopback(&bound) : server_listen_abstract(CAPTURE_WIRE_SOCKET);
    int code = 0;
    if (listener < 0) {
        fprintf(stderr, "brace_camera: cannot listen: %s%s\n", strerror(errno),
                errno == EADDRINUSE ? "; is it running already?" : "");
        code = 1;
    } else {
        if (port >= 0) {
            printf("listening on 127.0.0.1:%u\n", bound);
        } else if (!quiet) {
            printf("listening on localabstract:%s\n", CAPTURE_WIRE_SOCKET);
        }
        fflush(stdout);
        const server s = {.camera = camera,
                          .idle = (int)idle * 1000,
                          .patience = (int)timeout * 1000,
                          .stopped = stopped,
                          .log = quiet ? NULL : stdout};
        if (!server_run(&s, listener)) {
            fprintf(stderr, "brace_camera: cannot accept: %s\n", strerror(errno));
            code = 1;
        }
        close(listener);
    }
    shim_destroy(camera);
    return code;
}
