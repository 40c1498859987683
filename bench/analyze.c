/* SPDX-License-Identifier: Apache-2.0 */
/*
 * analyze.c: simulated captures of flickering and of steady displays, measured; one line a capture.
 *
 *     analyze COUNT SCREEN... > captures.tsv
 *
 * Environment: FIRST=n starts at capture n, ONLY=1 leaves out the shortest frame on its own, BACKLIGHTS=1 shows
 * LCD backlights of random frequency instead of the presets.
 * bench/analyze.py makes the tables of docs/benchmarks.md of it.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "brace/brace.h"
#include "core/core.h"
#include "sim/sim.h"

static const struct {
    const char *name;
} displays[] = {{"monitor_lcd_200"},    {"monitor_lcd_240"},    {"monitor_miniled_480"}, {"laptop_lcd_1000"},
                {"phone_oled_120_240"}, {"phone_oled_120_480"}, {"phone_oled_120_1920"}, {"phone_oled_60_240"},
                {"led_wall_3840_32"},   {"led_wall_1920_8"},    {"led_wall_3840_16"},    {"crt_85"},
                {"hub75_300"},          {"dlp_120"}};

enum { ROWS = 4, MOST = 4096 };

/* Contrast of the shortest frame over the same one under steady light: what there is to be found. */
static double true_contrast(const brace_frame *seen, const brace_frame *steady) {
    static double ratio[MOST];
    size_t n = 0;
    double all = 0;
    for (int pass = 0; pass < 2; pass++)
        for (uint32_t y = 0; y + 2 * ROWS <= seen->height; y += 2 * ROWS) {
            double a = 0, b = 0;
            for (size_t i = (size_t)y * seen->width; i < (size_t)(y + 2 * ROWS) * seen->width; i++)
                a += seen->data[i] - (double)seen->black[0], b += steady->data[i] - (double)seen->black[0];
            if (pass == 0)
                all += b / (seen->height / (2 * ROWS));
            else if (n < MOST && b > 0.2 * all)
                ratio[n++] = a / b;
        }
    if (n < 8)
        return 0;
    for (size_t i = 1; i < n; i++)
        for (size_t j = i; j > 0 && ratio[j] < ratio[j - 1]; j--) {
            double t = ratio[j];
            ratio[j] = ratio[j - 1], ratio[j - 1] = t;
        }
    const double low = ratio[n / 20], high = ratio[n - 1 - n / 20];
    return high + low > 0 ? (high - low) / (high + low) : 0;
}

static int simulate(brace_simulated **out, const char *display, const char *camera, const brace_image *screen,
                    uint32_t sample) {
    brace_error error;
    const brace_simulate_params params = {.display = display, .camera = camera, .seed = 77, .sample = sample,
                                          .width = 1024, .height = 768};
    const brace_job job = {.threads = 1};
    if (brace_simulate(out, screen, &params, &job, &error) == BRACE_OK)
        return 0;
    fprintf(stderr, "%s: %s\n", display, error.message);
    return 1;
}

static int measure(const char *display, const char *screen, const char *camera, uint32_t sample, double truth,
                   const brace_simulated *capture, bool alone) {
    brace_error error;
    brace_banding b;
    sim_camera info;
    const brace_job job = {.threads = 1};
    brace_status status = sim_camera_load(&info, camera, &error);
    const brace_banding_params params = {.readout = info.readout};
    if (status == BRACE_OK)
        status = brace_banding_measure(&b, (const brace_frame *const *)capture->frames, alone ? 1 : capture->count,
                                       &params, &job, &error);
    if (status != BRACE_OK) {
        fprintf(stderr, "%s: %s\n", display, error.message);
        return 1;
    }
    printf("%s\t%s\t%s\t%u\t%d\t%.5g\t%.4f\t%.4f\t%.6g\t%.6g\t%.4g\t%.4g\t%s\t%.4g\t%.4f", display, camera, screen, sample, alone,
           b.frame[0].exposure_time, truth, b.confidence, b.hz, b.base_hz, b.spread, info.readout,
           brace_banding_source_name(b.source), b.frequency_error, b.frequency_confidence);
    for (size_t i = 0; i < 5; i++)
        printf("\t%.4f\t%.4f\t%.4f\t%.4f\t%.5g\t%.1f\t%d\t%.4g\t%.4g\t%.4g", i < b.count ? b.frame[i].confidence : 0,
               b.frame[i].contrast, b.frame[i].share, b.frame[i].told, b.frame[i].hz, b.frame[i].orientation,
               b.frame[i].compared, b.frame[i].prominence, b.frame[i].uneven,
               b.frame[i].row_noise);
    printf("\n");
    fflush(stdout);
    return 0;
}

/* A backlight of random frequency and duty; the name holds the frequency. */
static int backlight(char path[64], uint32_t i) {
    core_random r = core_random_create(9, i, 0, 0);
    const double hz = exp(core_random_range(&r, log(200), log(6000))), duty = core_random_range(&r, 0.1, 0.8);
    snprintf(path, 64, "/tmp/backlight_%.6g_.json", hz);
    FILE *file = fopen(path, "w");
    if (!file)
        return 1;
    fprintf(file, "{\"family\": \"monitor\", \"driver\": \"lcd_pwm\", \"frequency\": %.17g, \"duty\": %.17g}\n", hz, duty);
    return fclose(file) != 0;
}

int main(int argc, char **argv) {
    if (argc < 3) {
        fprintf(stderr, "usage: analyze COUNT SCREEN... > captures.tsv\n");
        return 2;
    }
    const uint32_t count = (uint32_t)strtoul(argv[1], NULL, 10);
    const bool backlights = getenv("BACKLIGHTS") != NULL;
    const char *first = getenv("FIRST");
    int failed = 0;
    for (uint32_t i = first ? (uint32_t)strtoul(first, NULL, 10) : 0; i < count && failed == 0; i++) {
        const char *name = argv[2 + i % (uint32_t)(argc - 2)];
        brace_error error;
        brace_image *screen = NULL;
        if (brace_image_read(&screen, name, NULL, &error) != BRACE_OK) {
            fprintf(stderr, "%s\n", error.message);
            return 1;
        }
        char made[64] = "";
        if (backlights && backlight(made, i))
            return 1;
        const char *flickering = backlights ? made : displays[i % (sizeof displays / sizeof *displays)].name;
        static const char *const cameras[] = {"phone_median", "phone_fast", "phone_iphone_15_pro", "canon_r5",
                                              "phone_s23_ultra"};
        const char *camera = cameras[i % 5];
        brace_simulated *capture = NULL, *steady = NULL;
        failed += simulate(&capture, flickering, camera, screen, i) || simulate(&steady, "steady", camera, screen, i);
        for (int alone = 0; alone < (getenv("ONLY") || backlights ? 1 : 2) && failed == 0; alone++) {
            failed += measure(flickering, name, camera, i, true_contrast(capture->frames[0], steady->frames[0]),
                              capture, alone);
            failed += measure("steady", name, camera, i, 0, steady, alone);
        }
        brace_simulated_destroy(capture), brace_simulated_destroy(steady);
        brace_image_destroy(screen);
        remove(made);
    }
    return failed > 0;
}
