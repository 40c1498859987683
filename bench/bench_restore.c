/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_restore.c: how close each method comes to the truth. For every folder
 * with frame_*.dng and gt.dng: PSNR and SSIM of each method against gt.dng, all
 * developed by the same ISP to sRGB, as a Markdown table. With --check the exit
 * code tells whether merge beats reference everywhere (or is within 0.1 dB where
 * there is nothing to gain: above 40 dB).
 *
 *   bench_restore [--check] FOLDER...
 */
#include <glob.h>
#include <stdio.h>
#include <string.h>

#include "brace/brace.h"
#include "core/core.h"
#include "metrics/metrics.h"

typedef struct score {
    double psnr, ssim, seconds;
} score;

static brace_error error;

static brace_status develop(brace_image **out, const brace_frame *frame) {
    brace_develop_params params = {.sample = BRACE_SAMPLE_F32, .transfer = BRACE_TRANSFER_SRGB};
    return brace_develop(out, frame, &params, NULL, &error);
}

static brace_status rate(score *out, const brace_bracket *bracket, brace_method method, const brace_image *truth) {
    brace_restored *restored = NULL;
    brace_image *image = NULL;
    brace_restore_params params = {.method = method};
    double start = core_seconds();
    brace_status status = brace_restore(&restored, bracket, &params, NULL, &error);
    out->seconds = core_seconds() - start;
    if (status == BRACE_OK) {
        status = develop(&image, restored->frame);
    }
    if (status == BRACE_OK) {
        status = metrics_psnr(&out->psnr, image, truth, NULL, &error);
    }
    if (status == BRACE_OK) {
        status = metrics_ssim(&out->ssim, image, truth, NULL, &error);
    }
    brace_image_destroy(image);
    brace_restored_destroy(restored);
    return status;
}

static brace_status rate_folder(score out[2], const char *folder) {
    char name[4096];
    glob_t found;
    brace_bracket *bracket = NULL;
    brace_frame *frame = NULL;
    brace_image *truth = NULL;
    snprintf(name, sizeof name, "%s/frame_*.dng", folder);
    if (glob(name, 0, NULL, &found) != 0) {
        return core_fail(&error, BRACE_ERROR_IO, "%s: no frames", name);
    }
    brace_status status =
        brace_bracket_read(&bracket, (const char *const *)found.gl_pathv, found.gl_pathc, NULL, NULL, &error);
    globfree(&found);
    snprintf(name, sizeof name, "%s/gt.dng", folder);
    if (status == BRACE_OK) {
        status = brace_frame_read(&frame, name, NULL, &error);
    }
    if (status == BRACE_OK) {
        status = develop(&truth, frame);
    }
    if (status == BRACE_OK) {
        status = rate(&out[0], bracket, BRACE_METHOD_REFERENCE, truth);
    }
    if (status == BRACE_OK) {
        status = rate(&out[1], bracket, BRACE_METHOD_MERGE, truth);
    }
    brace_image_destroy(truth);
    brace_frame_destroy(frame);
    brace_bracket_destroy(bracket);
    return status;
}

static bool merge_wins(const score s[2]) {
    double slack = s[0].psnr > 40 ? 0.1 : 0;
    return s[1].psnr > s[0].psnr - slack && s[1].ssim > s[0].ssim - slack / 100;
}

int main(int argc, char **argv) {
    bool check = argc > 1 && strcmp(argv[1], "--check") == 0;
    if (argc < 2 + check) {
        fprintf(stderr, "usage: bench_restore [--check] FOLDER...\n");
        return 2;
    }
    int lost = 0;
    printf("| bracket | reference PSNR | SSIM | merge PSNR | SSIM | gain dB | merge s |\n"
           "|---|---:|---:|---:|---:|---:|---:|\n");
    for (int i = 1 + check; i < argc; i++) {
        score s[2] = {{0, 0, 0}, {0, 0, 0}};
        if (rate_folder(s, argv[i]) != BRACE_OK) {
            fprintf(stderr, "bench_restore: %s\n", error.message);
            return 1;
        }
        size_t length = strlen(argv[i]);
        while (length > 1 && argv[i][length - 1] == '/') {
            argv[i][--length] = '\0';
        }
        const char *slash = strrchr(argv[i], '/');
        printf("| %s | %.2f | %.4f | %.2f | %.4f | %+.2f | %.2f |\n", slash != NULL ? slash + 1 : argv[i], s[0].psnr,
               s[0].ssim, s[1].psnr, s[1].ssim, s[1].psnr - s[0].psnr, s[1].seconds);
        fflush(stdout);
        lost += !merge_wins(s);
    }
    return check && lost > 0 ? 1 : 0;
}
