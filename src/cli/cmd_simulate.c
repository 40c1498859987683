/* SPDX-License-Identifier: Apache-2.0 */
/* cmd_simulate.c: brace simulate: screenshots in, brackets of RAW frames with their truth out. */
#include "cli/cli.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "image/image.h"
#include "sim/dataset.h"
#include "sim/screen.h"
#include "sim/sheet.h"
#include "sim/simulate.h"

static const char command[] = "simulate";

typedef struct arguments {
    const char *output, *display, *camera, *size, *sheet, *time;
    int count, threads;
    double seed, iso, level, distance;
    bool field, explain, quiet, no_noise, no_tremor, no_lens;
} arguments;

static bool parse_size(const char *text, uint32_t *width, uint32_t *height) {
    int end = 0;
    return sscanf(text, "%5ux%5u%n", width, height, &end) == 2 && text[end] == '\0';
}

static bool is_picture(const char *name) {
    static const char *const known[] = {"png", "jpg", "jpeg", "tif", "tiff", "webp"};
    const char *dot = strrchr(cli_basename(name), '.');
    for (size_t i = 0; dot != NULL && i < sizeof known / sizeof *known; i++)
        if (strcasecmp(dot + 1, known[i]) == 0)
            return true;
    return false;
}

/* frame_1.dng ..., gt.dng and meta.json, all or nothing. */
static brace_status write_sample(const char *folder, const sim_capture *capture, const brace_job *job,
                                 brace_error *error) {
    char *temporary, path[PATH_MAX];
    brace_status status = dataset_begin(&temporary, folder, error);
    if (status != BRACE_OK)
        return status;
    for (int i = 0; i <= capture->count && status == BRACE_OK; i++) {
        if (i < capture->count)
            snprintf(path, sizeof path, "%s/frame_%d.dng", temporary, i + 1);
        else
            snprintf(path, sizeof path, "%s/gt.dng", temporary);
        status = brace_frame_write_dng(i < capture->count ? capture->frame[i] : capture->truth, path, NULL, job, error);
    }
    if (status == BRACE_OK) {
        snprintf(path, sizeof path, "%s/meta.json", temporary);
        if (json_dump_file(capture->meta, path, JSON_INDENT(1)) != 0)
            status = core_fail(error, BRACE_ERROR_IO, "%s: %s", path, strerror(errno));
    }
    if (status == BRACE_OK)
        status = dataset_finish(temporary, folder, error);
    else
        dataset_discard(temporary);
    core_free(temporary);
    return status;
}

static brace_status write_sheet(const char *path, const sim_capture *capture, const brace_image *screen,
                                const sim_display *display, const sim_camera *camera, const sim_scene *scene,
                                const brace_job *job, brace_error *error) {
    sim_texture texture = {0};
    sim_panel *panel = NULL;
    brace_image *sheet = NULL;
    brace_status status = sim_texture_create(&texture, screen, error);
    if (status == BRACE_OK)
        status = sim_panel_create(&panel, display, texture.level[0].rgb, screen->width, screen->height, error);
    if (status == BRACE_OK)
        status = sim_sheet(&sheet, capture, panel, scene, camera, screen->width, screen->height, job, error);
    if (status == BRACE_OK)
        status = brace_image_write(sheet, path, NULL, job, error);
    brace_image_destroy(sheet);
    sim_panel_destroy(panel);
    sim_texture_free(&texture);
    return status;
}

static brace_status simulate(const arguments *a, const cli_list *screens, uint32_t width, uint32_t height,
                             double reference_time, const brace_job *job, brace_error *error) {
    sim_display *display = NULL;
    sim_camera camera;
    brace_status status = sim_display_load(&display, a->display, error);
    if (status == BRACE_OK)
        status = sim_camera_load(&camera, a->camera, error);
    if (status == BRACE_OK)
        status = dataset_make_folder(a->output, error);
    const size_t total = screens->count * (size_t)a->count;
    for (size_t i = 0; i < total && status == BRACE_OK; i++) {
        core_progress(job, "simulating", i, total);
        brace_image *screen = NULL;
        sim_capture capture = {0};
        sim_scene scene;
        const char *file = screens->items[i / (size_t)a->count];
        char folder[PATH_MAX];
        if (snprintf(folder, sizeof folder, "%s/%06zu", a->output, i) >= (int)sizeof folder)
            status = core_fail(error, BRACE_ERROR_ARGUMENT, "%s: the name is too long", a->output);
        else if (access(folder, F_OK) == 0)
            status =
                core_fail(error, BRACE_ERROR_IO, "%s is there already; choose another folder for the samples", folder);
        if (status != BRACE_OK)
            break;
        sim_scene_sample(&scene, (uint64_t)a->seed, (uint32_t)i, a->field);
        scene.width = width, scene.height = height;
        if (reference_time > 0)
            scene.reference_time = reference_time;
        if (a->iso > 0)
            scene.iso = a->iso;
        if (a->level > 0)
            scene.level = a->level;
        if (a->distance > 0)
            scene.pose.translation[2] = a->distance;
        if (a->no_noise)
            scene.noise = false;
        if (a->no_tremor)
            scene.tremor_angle = scene.tremor_position = 0;
        if (a->no_lens)
            scene.psf = scene.glare = scene.vignetting = scene.defocus = scene.distortion[0] = scene.distortion[1] = 0;
        status = sim_screen_read(&screen, NULL, file, job, error);
        if (status == BRACE_OK)
            status = sim_capture_create(&capture, screen, display, &camera, &scene, job, error);
        if (status == BRACE_OK) {
            json_object_set_new(capture.meta, "screen", cli_json_text(cli_basename(file)));
            if (a->explain)
                json_dumpf(capture.meta, stdout, JSON_INDENT(1)), putchar('\n');
            status = write_sample(folder, &capture, job, error);
        }
        if (status == BRACE_OK && a->sheet && i == 0)
            status = write_sheet(a->sheet, &capture, screen, display, &camera, &scene, job, error);
        brace_image_destroy(screen);
        sim_capture_free(&capture);
    }
    if (status == BRACE_OK)
        core_progress(job, "simulating", total, total);
    sim_display_destroy(display);
    return status;
}

int cli_simulate(int argc, char **argv) {
    arguments a = {.display = "led_wall_3840_16", .camera = "phone_median", .count = 1, .seed = 1};
    cli_list screens = {0};
    const cli_option options[] = {
        {CLI_TEXT, 'o', "output", "DIR", "folder for the samples, each one in a folder 000000, ... of its own",
         &a.output, 0, 0},
        {CLI_TEXT, 0, "sheet", "OUT.png", "a picture of the first sample: frames, truth, and the display's light",
         &a.sheet, 0, 0},
        {CLI_FLAG, 0, "explain", NULL, "print everything that was set or sampled, as JSON", &a.explain, 0, 0},
        {CLI_HEADING, 0, NULL, NULL, "Scene", NULL, 0, 0},
        {CLI_TEXT, 'd', "display", "NAME|FILE.json", "default led_wall_3840_16; docs/displays.md has the presets",
         &a.display, 0, 0},
        {CLI_TEXT, 'c', "camera", "NAME|FILE.json", "default phone_median; docs/cameras.md has the presets", &a.camera,
         0, 0},
        {CLI_TEXT, 0, "size", "WxH", "of the frames, default 1024x768", &a.size, 0, 0},
        {CLI_INT, 'n', "count", "N", "samples of each screen, default 1", &a.count, 1, 1000000},
        {CLI_NUMBER, 0, "seed", "S", "everything that is sampled follows from it; default 1", &a.seed, 0,
         9007199254740991.0},
        {CLI_TEXT, 0, "time", "T", "exposure time of the reference, such as 1/320; default: sampled", &a.time, 0, 0},
        {CLI_NUMBER, 0, "iso", "ISO", "default: sampled", &a.iso, 10, 1e6},
        {CLI_NUMBER, 0, "level", "X", "signal of white in the reference, 1 just clips; default: sampled", &a.level,
         1e-4, 100},
        {CLI_NUMBER, 0, "distance", "X", "of the camera in widths of the screen; default: sampled", &a.distance, 0.05,
         100},
        {CLI_FLAG, 0, "field", NULL,
         "as in the field: ambient light, defocus, non-uniformity,\nand a truth of 8 times the exposure at ISO/8",
         &a.field, 0, 0},
        {CLI_FLAG, 0, "no-noise", NULL, "a sensor without noise", &a.no_noise, 0, 0},
        {CLI_FLAG, 0, "no-tremor", NULL, "a tripod", &a.no_tremor, 0, 0},
        {CLI_FLAG, 0, "no-lens", NULL, "no blur, glare, vignetting or distortion", &a.no_lens, 0, 0},
        {CLI_HEADING, 0, NULL, NULL, "General", NULL, 0, 0},
        {CLI_INT, 't', "threads", "N", "1 to 256, default: one for each CPU", &a.threads, 1, 256},
        {CLI_FLAG, 'q', "quiet", NULL, "only errors", &a.quiet, 0, 0},
        {CLI_HELP, 'h', "help", NULL, "this text", NULL, 0, 0},
        {.kind = CLI_END},
    };
    const cli_usage usage = {
        command, "SCREEN... -o DIR [OPTION]...",
        "Simulates photographs of displays: every SCREEN (PNG, JPEG, TIFF, WebP) is shown on\n"
        "a display, photographed as a bracket of five RAW frames, and written with the frame\n"
        "that steady light would have given (gt.dng) and all that was sampled (meta.json).",
        options,
        "Examples:\n"
        "  brace simulate desktop.png -o captures\n"
        "  brace simulate page.png -o captures --display phone_oled_120_480 --time 1/320 --sheet sheet.png\n"
        "  brace simulate screens/*.png -o set --count 10 --seed 7 --field\n"};
    int code = cli_parse(&usage, argc, argv, &screens);
    uint32_t width = 1024, height = 768;
    double reference_time = 0;
    if (code < 0 && screens.count == 0)
        code = cli_wrong_usage(command, "no picture of a screen was given");
    if (code < 0 && a.output == NULL)
        code = cli_wrong_usage(command, "say where to put the samples: -o DIR");
    if (code < 0 && a.size != NULL && !parse_size(a.size, &width, &height))
        code = cli_wrong_usage(command, "--size %s is no size such as 1024x768", a.size);
    if (code < 0 && a.sheet != NULL && !is_picture(a.sheet))
        code = cli_wrong_usage(command, "--sheet %s: the name should end in .png, .jpg, .tif or .webp", a.sheet);
    if (code < 0 && a.time != NULL && !cli_exposure_parse(a.time, &reference_time))
        code = cli_wrong_usage(command, "--time %s is no exposure time such as 1/320", a.time);
    if (code < 0) {
        brace_error error = {BRACE_OK, ""};
        brace_job job;
        cli_report report;
        cli_report_begin(&report, &job, command, a.quiet, a.threads);
        brace_status status = simulate(&a, &screens, width, height, reference_time, &job, &error);
        cli_report_flush(&report);
        cli_report_end(&report);
        if (status == BRACE_ERROR_CANCELLED)
            cli_error(command, "stopped; the samples that are there are complete");
        else if (status != BRACE_OK)
            cli_error(command, "%s", error.message);
        code = status == BRACE_ERROR_CANCELLED            ? cli_signals_exit()
               : status == BRACE_OK && cli_flush(command) ? CLI_DONE
                                                          : CLI_FAILED;
    }
    cli_list_free(&screens);
    return code;
}
