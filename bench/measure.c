/* SPDX-License-Identifier: Apache-2.0 */
/*
 * measure.c: runs a command and says on stderr how long it took, how long processors worked for it and how much memory it
 * held at most, as "seconds S", "cpu_s S" and "peak_mb M" (millions of bytes).
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
    const double cpu = (double)(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
                       (double)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec) * 1e-6;
    fprintf(stderr, "seconds %.3f\ncpu_s %.3f\npeak_mb %.1f\n", core_seconds() - start, cpu,
            (double)usage.ru_maxrss * 1024e-6);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}
