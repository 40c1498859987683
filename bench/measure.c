/* SPDX-License-Identifier: Apache-2.0 */
/*
 * measure.c: runs a command and says on stderr how long it took and how much
 * memory it held at most, as "seconds S" and "peak_mb M" (millions of bytes).
 *
 *   measure COMMAND [ARGUMENT]...
 */
#include <stdio.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "core/core.h"

int main(int argc, char **argv) {
    if (argc < 2) {
        fprintf(stderr, "usage: measure COMMAND [ARGUMENT]...\n");
        return 2;
    }
    double start = core_seconds();
    pid_t child = fork();
    if (child == 0) {
        execvp(argv[1], argv + 1);
        perror(argv[1]);
        _exit(127);
    }
    int status = 0;
    struct rusage usage;
    if (child < 0 || wait4(child, &status, 0, &usage) != child) {
        perror("measure");
        return 1;
    }
    /* Linux counts ru_maxrss in units of 1024 bytes. */
    fprintf(stderr, "seconds %.3f\npeak_mb %.1f\n", core_seconds() - start, (double)usage.ru_maxrss * 1024e-6);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}
