/* SPDX-License-Identifier: Apache-2.0 */
/* fabp_12mp.c: time and memory of the banding prior of a 12-megapixel frame: fabp_12mp THREADS. */
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>

#include "brace/brace.h"
#include "core/core.h"

int main(int argc, char **argv) {
    const brace_job job = {.threads = argc > 1 ? atoi(argv[1]) : 1};
    brace_frame *frame = NULL;
    brace_error error;
    if (brace_frame_create(&frame, 4032, 3024, BRACE_CFA_RGGB, &error) != BRACE_OK)
        return 1;
    for (size_t i = 0; i < (size_t)4032 * 3024; i++)
        frame->data[i] = (uint16_t)(20000 + i * 2654435761u % 9973 + (i / 4032 % 97) * 100);
    struct rusage before, after;
    getrusage(RUSAGE_SELF, &before);
    double best = 1e9;
    for (int n = 0; n < 5; n++) {
        brace_fabp fabp;
        const double start = core_seconds();
        if (brace_fabp_frame(&fabp, frame, NULL, &job, &error) != BRACE_OK) {
            fprintf(stderr, "%s\n", error.message);
            return 1;
        }
        const double seconds = core_seconds() - start;
        best = seconds < best ? seconds : best;
    }
    getrusage(RUSAGE_SELF, &after);
    printf("BRACE, %d thread(s): %.3f s, %.0f MiB beside the frame\n", job.threads, best,
           (double)(after.ru_maxrss - before.ru_maxrss) / 1024);
    brace_frame_destroy(frame);
    return 0;
}
