/* SPDX-License-Identifier: Apache-2.0 */
/*
 * analyze.c: captures of bench/captures, measured; one line for each measurement.
 *
 *     analyze FOLDER > captures.tsv
 *
 * Every capture, flickering and steady, is measured as a bracket and each of its frames alone (ONLY=1: not those).
 * Columns: display camera screen readout hz room_hz | kind frame (0: the bracket) contrast time | confidence found_hz base_hz
 * hz_confidence source aliased, then for each of five frames: confidence alone contrast prominence uneven row_noise compared
 * orientation hz. SHARE=k/n as in captures.c.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "brace/brace.h"

enum { FRAMES = 5 };

static void print(const char *about, const char *kind, int which, double contrast, double time, const brace_banding *b,
                  double hz) {
    bool aliased = false;
    for (size_t i = 0; i < b->aliases; i++)
        aliased = aliased || (hz > 0 && fabs(b->alias_hz[i] / hz - 1) < 0.01);
    printf("%s\t%s\t%d\t%.5f\t%.5g\t%.5f\t%.6g\t%.6g\t%.5f\t%s\t%d", about, kind, which, contrast, time, b->confidence, b->hz,
           b->base_hz, b->frequency_confidence, brace_banding_source_name(b->source), aliased);
    for (size_t i = 0; i < FRAMES; i++) {
        const brace_banding_frame *f = &b->frame[i];
        if (i < b->count)
            printf("\t%.5f\t%.6f\t%.4f\t%.5g\t%.4g\t%.4g\t%d\t%.1f\t%.6g", f->confidence, f->alone, f->contrast, f->prominence,
                   f->uneven, f->row_noise, f->compared, f->orientation, f->hz);
        else
            printf("\t0\t0\t0\t0\t0\t0\t0\t0\t0");
    }
    printf("\n");
}

static int measure(const char *folder, const char *about, const char *kind, const double *contrast, double readout, double hz,
                   bool only, brace_error *error) {
    const brace_job job = {.threads = 1};
    const brace_banding_params params = {.readout = readout};
    brace_frame *frame[FRAMES] = {NULL};
    brace_banding b;
    brace_status status = BRACE_OK;
    for (int i = 0; i < FRAMES && status == BRACE_OK; i++) {
        char path[4096];
        snprintf(path, sizeof path, "%s/%s/frame_%d.dng", folder, kind, i + 1);
        status = brace_frame_read(&frame[i], path, &job, error);
    }
    double most = 0;
    for (int i = 0; i < FRAMES; i++)
        most = contrast[i] > most ? contrast[i] : most;
    for (int i = 0; i <= (only ? 0 : FRAMES) && status == BRACE_OK; i++) {
        status = brace_banding_measure(&b, (const brace_frame *const *)(i ? &frame[i - 1] : frame), i ? 1 : FRAMES, &params, &job,
                                       error);
        if (status == BRACE_OK)
            print(about, kind, i, i ? contrast[i - 1] : most, frame[i ? i - 1 : 0]->exposure_time, &b, hz);
    }
    for (int i = 0; i < FRAMES; i++)
        brace_frame_destroy(frame[i]);
    return status != BRACE_OK;
}

int main(int argc, char **argv) {
    unsigned first = 0, step = 1;
    const char *share = getenv("SHARE");
    if (argc != 2 || (share && (sscanf(share, "%u/%u", &first, &step) != 2 || step == 0))) {
        fprintf(stderr, "usage: analyze FOLDER > captures.tsv\n");
        return 2;
    }
    for (unsigned i = first;; i += step) {
        char path[4096], line[1024], about[1024];
        snprintf(path, sizeof path, "%s/%04u/truth.tsv", argv[1], i);
        FILE *file = fopen(path, "r");
        if (!file)
            return i == first;
        const bool read = fgets(line, sizeof line, file) != NULL;
        fclose(file);
        double readout = 0, hz = 0, time, contrast[FRAMES];
        int end = 0;
        if (!read || sscanf(line, "%*s %*s %*s %lf %lf %*f%n %lf %lf %lf %lf %lf %lf", &readout, &hz, &end, &time, &contrast[0],
                            &contrast[1], &contrast[2], &contrast[3], &contrast[4]) != 8) {
            fprintf(stderr, "%s: not what bench/captures writes\n", path);
            return 1;
        }
        static const double none[FRAMES];
        brace_error error;
        snprintf(about, sizeof about, "%.*s", end, line);
        snprintf(path, sizeof path, "%s/%04u", argv[1], i);
        const bool only = getenv("ONLY") != NULL;
        if (measure(path, about, "flicker", contrast, readout, hz, only, &error) ||
            (hz <= 0 && measure(path, about, "steady", none, readout, 0, only, &error))) {
            fprintf(stderr, "%s: %s\n", path, error.message);
            return 1;
        }
        fflush(stdout);
    }
}
