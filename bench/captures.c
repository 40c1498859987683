/* SPDX-License-Identifier: Apache-2.0 */
/*
 * captures.c: simulated captures for bench/analyze, made once and kept: pairs of the same screen, camera and hand, of a
 * display that flickers and of a steady one.
 *
 *     captures FOLDER SEED COUNT presets|backlights SCREEN...
 *
 * presets: every preset of data/displays in turn; backlights: LCD backlights of random frequency and duty. Cameras are
 * those of data/cameras, everything else is sampled as data/priors/default.json says. The steady one stands in steady
 * room light: lamps on the mains make true banding on steady displays as well.
 * FOLDER/NNNN/{flicker,steady}/frame_K.dng; FOLDER/NNNN/truth.tsv is one line: display, camera, screen, readout, its
 * frequency (0: a preset's), the room's frequency, exposure time of the shortest frame, true contrast of each frame.
 * Environment: SHARE=k/n makes each n-th capture only, from k.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "brace/brace.h"
#include "core/core.h"
#include "sim/data_path.h"
#include "sim/dataset_priors.h"
#include "sim/screen.h"
#include "sim/simulate.h"

enum { WIDTH = 1024, HEIGHT = 768, FRAMES = 5, ACROSS = 8, DOWN = HEIGHT / 8, BLOCKS = ACROSS * DOWN };

static int by_value(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Half the spread (5 to 95 %) of flickering light over steady, over its mean, in blocks of 8 rows and an eighth of
 * the columns; less what noise spreads. */
static double true_contrast(const brace_frame *seen, const brace_frame *steady) {
    static double ratio[BLOCKS], light[BLOCKS], sorted[BLOCKS], noise[BLOCKS];
    for (size_t k = 0; k < BLOCKS; k++) {
        double a = 0, b = 0, variance = 0, clipped = 0;
        for (size_t y = k / ACROSS * 8; y < k / ACROSS * 8 + 8; y++)
            for (size_t x = k % ACROSS * (WIDTH / ACROSS); x < (k % ACROSS + 1) * (WIDTH / ACROSS); x++) {
                const double black = seen->black[0], white = seen->white;
                const double s = (seen->data[y * WIDTH + x] - black) / (white - black);
                const double t = (steady->data[y * WIDTH + x] - black) / (white - black);
                a += s, b += t, clipped += s > 0.98 || t > 0.98;
                variance += fmax(0, seen->noise[1][0] * (s + t) + 2 * seen->noise[1][1]);
            }
        ratio[k] = clipped < 64 && b > 0 ? a / b : -1, noise[k] = variance / (b * b), light[k] = sorted[k] = b;
    }
    qsort(sorted, BLOCKS, sizeof *sorted, by_value);
    const double lit = 0.2 * sorted[BLOCKS * 9 / 10];
    double mean_noise = 0;
    size_t n = 0;
    for (size_t k = 0; k < BLOCKS; k++)
        if (ratio[k] >= 0 && light[k] > lit)
            mean_noise += noise[k], ratio[n++] = ratio[k];
    if (n < 16)
        return 0;
    qsort(ratio, n, sizeof *ratio, by_value);
    const double low = ratio[n / 20], high = ratio[n - 1 - n / 20], mean = 0.5 * (high + low);
    const double spread = mean > 0 ? 0.5 * (high - low) / mean : 0;
    /* Of Gaussian noise 5 to 95 % are 2 x 1.645 deviations. */
    return sqrt(fmax(0, spread * spread - 1.645 * 1.645 * mean_noise / (double)n / fmax(mean * mean, 1e-6)));
}

static int make(const char *folder, const dataset_priors *priors, uint64_t seed, uint32_t i, bool backlights,
                const char *screen_path, const brace_job *job, brace_error *error) {
    char path[4096], truth[4112];
    struct stat there;
    snprintf(path, sizeof path, "%s/%04u", folder, i);
    snprintf(truth, sizeof truth, "%s/truth.tsv", path);
    if (stat(truth, &there) == 0)
        return 0;
    mkdir(path, 0777);
    core_random r = core_random_create(seed, i, 0, 9);
    json_t *displays = sim_data_names("displays"), *cameras = sim_data_names("cameras");
    const char *name = json_string_value(json_array_get(displays, i % json_array_size(displays)));
    if (strcmp(name, "steady") == 0)
        name = "monitor_lcd_240";
    const char *camera_name =
        json_string_value(json_array_get(cameras, core_random_below(&r, (uint32_t)json_array_size(cameras))));
    brace_image *screen = NULL;
    sim_display *display = NULL, *steady = NULL;
    sim_camera camera;
    sim_scene scene;
    sim_capture capture[2] = {{0}, {0}};
    double hz = 0;
    brace_status status = sim_screen_read(&screen, NULL, screen_path, job, error);
    if (status == BRACE_OK)
        status = sim_camera_load(&camera, camera_name, error);
    if (status == BRACE_OK)
        status = sim_display_load(&steady, "steady", error);
    if (status == BRACE_OK && backlights) {
        char text[256];
        hz = exp(core_random_range(&r, log(200), log(6000)));
        snprintf(text, sizeof text, "{\"family\": \"monitor\", \"driver\": \"lcd_pwm\", \"frequency\": %.17g, \"duty\": %.17g}",
                 hz, core_random_range(&r, 0.1, 0.8));
        status = sim_display_parse(&display, text, "backlight", error);
        name = "backlight";
    } else if (status == BRACE_OK)
        status = sim_display_load(&display, name, error);
    if (status == BRACE_OK) {
        sim_scene_sample(&scene, seed, i, false);
        scene.width = WIDTH, scene.height = HEIGHT;
        dataset_priors_scene(&scene, priors, seed, i);
        status = sim_capture_create(&capture[0], screen, display, &camera, &scene, job, error);
    }
    if (status == BRACE_OK) {
        sim_scene still = scene;
        still.ambient_hz = 0;
        status = sim_capture_create(&capture[1], screen, steady, &camera, &still, job, error);
    }
    for (int k = 0; k < 2 && status == BRACE_OK; k++) {
        brace_frame_destroy(capture[k].truth);
        capture[k].truth = NULL;
        snprintf(path, sizeof path, "%s/%04u/%s", folder, i, k ? "steady" : "flicker");
        mkdir(path, 0777);
        status = sim_capture_write(&capture[k], path, &(brace_dng_params){.no_preview = true}, job, error);
    }
    FILE *file = status == BRACE_OK ? fopen(truth, "w") : NULL;
    if (file) {
        fprintf(file, "%s\t%s\t%s\t%.9g\t%.9g\t%g\t%.6g", name, camera_name, strrchr(screen_path, '/') ? strrchr(screen_path, '/') + 1 : screen_path,
                camera.readout, hz, scene.ambient_hz, capture[0].frame[0]->exposure_time);
        for (int f = 0; f < FRAMES; f++)
            fprintf(file, "\t%.5f", true_contrast(capture[0].frame[f], capture[1].frame[f]));
        fprintf(file, "\n");
        fclose(file);
    }
    sim_capture_free(&capture[0]), sim_capture_free(&capture[1]);
    sim_display_destroy(display), sim_display_destroy(steady);
    brace_image_destroy(screen);
    json_decref(displays), json_decref(cameras);
    return status != BRACE_OK || !file;
}

int main(int argc, char **argv) {
    if (argc < 6) {
        fprintf(stderr, "usage: captures FOLDER SEED COUNT presets|backlights SCREEN...\n");
        return 2;
    }
    const uint32_t count = (uint32_t)strtoul(argv[3], NULL, 10);
    uint32_t first = 0, step = 1;
    const char *share = getenv("SHARE");
    if (share && (sscanf(share, "%u/%u", &first, &step) != 2 || step == 0))
        return 2;
    const brace_job job = {.threads = 1};
    brace_error error;
    dataset_priors *priors = NULL;
    if (dataset_priors_load(&priors, NULL, &error) != BRACE_OK) {
        fprintf(stderr, "%s\n", error.message);
        return 1;
    }
    mkdir(argv[1], 0777);
    for (uint32_t i = first; i < count; i += step)
        if (make(argv[1], priors, strtoull(argv[2], NULL, 10), i, strcmp(argv[4], "backlights") == 0,
                 argv[5 + i % (uint32_t)(argc - 5)], &job, &error)) {
            fprintf(stderr, "capture %u: %s\n", i, error.message);
            return 1;
        }
    dataset_priors_destroy(priors);
    return 0;
}
