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
#include "sim/quantities.h"
#include "sim/screen.h"
#include "sim/sheet.h"
#include "sim/simulate.h"

static const char command[] = "simulate";

typedef struct arguments {
    const char *output, *display, *camera, *size, *sheet, *time, *scene;
    cli_list set, off;
    int count, threads;
    double seed, iso, level, distance; /* < 0: not given */
    uint32_t width, height;            /* 0: not given */
    double reference_time;             /* likewise */
    bool field, explain, list, quiet;
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

/* The DNG files, and meta.json with their hashes: all or nothing. */
static brace_status write_sample(const char *folder, const sim_capture *capture, const brace_job *job,
                                 brace_error *error) {
    char *temporary, path[PATH_MAX];
    json_t *files = NULL;
    brace_status status = dataset_begin(&temporary, folder, error);
    if (status != BRACE_OK)
        return status;
    status = sim_capture_write(capture, temporary, &(brace_dng_params){.no_sync = true}, job, error);
    if (status == BRACE_OK)
        status = dataset_hashes(&files, temporary, error);
    if (status == BRACE_OK) {
        json_object_set_new(capture->meta, "files", files);
        if (snprintf(path, sizeof path, "%s/meta.json", temporary) >= (int)sizeof path)
            status = core_fail(error, BRACE_ERROR_ARGUMENT, "%.200s...: the name is too long", folder);
        else
            status = dataset_json_save(capture->meta, path, error);
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

/* Sample number i of the call: sampled, or from a file, and what the options say on top of it. */
static brace_status make_scene(sim_scene *s, const arguments *a, const sim_scene_file *file, uint32_t i,
                               brace_error *error) {
    if (a->scene != NULL) {
        *s = file->scene;
        s->sample += i;
        s->seed = a->seed >= 0 ? (uint64_t)a->seed : s->seed;
        s->field = s->field || a->field;
    } else {
        sim_scene_sample(s, a->seed >= 0 ? (uint64_t)a->seed : 1, i, a->field);
    }
    s->width = a->width > 0 ? a->width : s->width;
    s->height = a->height > 0 ? a->height : s->height;
    s->reference_time = a->reference_time > 0 ? a->reference_time : s->reference_time;
    s->iso = a->iso > 0 ? a->iso : s->iso;
    s->level = a->level > 0 ? a->level : s->level;
    s->pose.translation[2] = a->distance > 0 ? a->distance : s->pose.translation[2];
    brace_status status = BRACE_OK;
    for (size_t k = 0; k < a->set.count && status == BRACE_OK; k++)
        status = sim_scene_set(s, a->set.items[k], error);
    for (size_t k = 0; k < a->off.count && status == BRACE_OK; k++)
        status = sim_scene_off(s, a->off.items[k], error);
    return status;
}

/* Every quantity, so that nobody has to look into the source. */
static void print_list(void) {
    printf("Quantities of a scene, for --set NAME=VALUE, --scene files and priors. 0 switches an effect off,\n"
           "as --off EFFECT does.\n\n%-21s %-24s %-8s %-14s %s\n",
           "NAME", "RANGE", "UNIT", "EFFECT", "MEANING");
    for (size_t i = 0; i < sim_quantity_count; i++) {
        const sim_quantity *q = &sim_quantities[i];
        char range[64];
        sim_quantity_range(range, sizeof range, q);
        printf("%-21s %-24s %-8s %-14s %s\n", q->name, range, q->unit[0] != '\0' ? q->unit : "-",
               q->effect != NULL ? q->effect : "-", q->meaning);
    }
}

static brace_status simulate(const arguments *a, const cli_list *screens, const sim_scene_file *file,
                             const brace_job *job, brace_error *error) {
    sim_display *loaded = NULL;
    sim_camera camera = file->camera;
    brace_status status = BRACE_OK;
    if (a->display != NULL || file->display == NULL)
        status = sim_display_load(&loaded, a->display != NULL ? a->display : "led_wall_3840_16", error);
    const sim_display *display = loaded != NULL ? loaded : file->display;
    if (status == BRACE_OK && (a->camera != NULL || !file->has_camera))
        status = sim_camera_load(&camera, a->camera != NULL ? a->camera : "phone_median", error);
    if (status == BRACE_OK)
        status = dataset_make_folder(a->output, error);
    const size_t total = screens->count * (size_t)a->count;
    for (size_t i = 0; i < total && status == BRACE_OK; i++) {
        core_progress(job, "simulating", i, total);
        brace_image *screen = NULL;
        sim_capture capture = {0};
        sim_scene scene;
        const char *picture = screens->items[i / (size_t)a->count];
        char folder[PATH_MAX];
        if (snprintf(folder, sizeof folder, "%s/%06zu", a->output, i) >= (int)sizeof folder)
            status = core_fail(error, BRACE_ERROR_ARGUMENT, "%s: the name is too long", a->output);
        else if (access(folder, F_OK) == 0)
            status =
                core_fail(error, BRACE_ERROR_IO, "%s is there already; choose another folder for the samples", folder);
        if (status != BRACE_OK)
            break;
        status = make_scene(&scene, a, file, (uint32_t)i, error);
        if (status == BRACE_OK)
            status = sim_screen_read(&screen, NULL, picture, job, error);
        if (status == BRACE_OK)
            status = sim_capture_create(&capture, screen, display, &camera, &scene, job, error);
        if (status == BRACE_OK) {
            json_object_set_new(capture.meta, "screen", cli_json_text(cli_basename(picture)));
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
    sim_display_destroy(loaded);
    return status;
}

int cli_simulate(int argc, char **argv) {
    arguments a = {.count = 1, .seed = -1, .iso = -1, .level = -1, .distance = -1};
    cli_list screens = {0};
    const cli_option options[] = {
        {CLI_TEXT, 'o', "output", "DIR", "folder for the samples, each one in a folder 000000, ... of its own",
         &a.output, 0, 0},
        {CLI_TEXT, 0, "sheet", "OUT.png", "a picture of the first sample: frames, truth, and the display's light",
         &a.sheet, 0, 0},
        {CLI_FLAG, 0, "explain", NULL, "print everything that was set or sampled, as JSON", &a.explain, 0, 0},
        {CLI_FLAG, 0, "list", NULL, "print every quantity that can be set, with its range", &a.list, 0, 0},
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
        {CLI_LIST, 's', "set", "NAME=VALUE", "any other quantity of the scene, such as psf=1.2; see --list", &a.set, 0,
         0},
        {CLI_LIST, 0, "off", "EFFECT[,...]",
         "leave out: pose, tremor, distortion, psf, defocus, glare,\nvignetting, ambient, clutter, nonuniformity, "
         "noise, or all",
         &a.off, 0, 0},
        {CLI_TEXT, 0, "scene", "FILE.json",
         "meta.json of an earlier sample: that capture again, byte\nfor byte; or a scene alone", &a.scene, 0, 0},
        {CLI_FLAG, 0, "field", NULL,
         "as in the field: ambient light, defocus, clutter, uneven\npanel and sensor, and a truth of 8 times the "
         "exposure at ISO/8",
         &a.field, 0, 0},
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
        "that steady light would have given (gt.dng) and all that was sampled (meta.json).\n"
        "What is not set is sampled.",
        options,
        "Examples:\n"
        "  brace simulate desktop.png -o captures\n"
        "  brace simulate page.png -o captures --display phone_oled_120_480 --time 1/320 --sheet sheet.png\n"
        "  brace simulate page.png -o plain --off all --set distance=0.7 --set rotation_z=0.1\n"
        "  brace simulate page.png -o again --scene captures/000000/meta.json\n"
        "  brace simulate screens/*.png -o set --count 10 --seed 7 --field\n"};
    int code = cli_parse(&usage, argc, argv, &screens);
    if (code < 0 && a.list) {
        print_list();
        code = cli_flush(command) ? CLI_DONE : CLI_FAILED;
    }
    if (code < 0 && screens.count == 0)
        code = cli_wrong_usage(command, "no picture of a screen was given");
    if (code < 0 && a.output == NULL)
        code = cli_wrong_usage(command, "say where to put the samples: -o DIR");
    if (code < 0 && a.size != NULL && !parse_size(a.size, &a.width, &a.height))
        code = cli_wrong_usage(command, "--size %s is no size such as 1024x768", a.size);
    if (code < 0 && a.sheet != NULL && !is_picture(a.sheet))
        code = cli_wrong_usage(command, "--sheet %s: the name should end in .png, .jpg, .tif or .webp", a.sheet);
    for (size_t i = 0; code < 0 && a.sheet != NULL && i < screens.count; i++)
        if (cli_same_file(a.sheet, screens.items[i]))
            code = cli_wrong_usage(command, "--sheet %s is one of the screens; it would be overwritten", a.sheet);
    if (code < 0 && a.time != NULL && !cli_exposure_parse(a.time, &a.reference_time))
        code = cli_wrong_usage(command, "--time %s is no exposure time such as 1/320", a.time);
    brace_error error = {BRACE_OK, ""};
    sim_scene_file file = {0};
    sim_scene trial;
    if (code < 0 && a.scene != NULL &&
        sim_scene_load(&file, a.scene, a.seed >= 0 ? (uint64_t)a.seed : 1, a.field, &error) != BRACE_OK) {
        cli_error(command, "%s", error.message);
        code = CLI_FAILED;
    }
    if (code < 0 && make_scene(&trial, &a, &file, 0, &error) != BRACE_OK)
        code = cli_wrong_usage(command, "%s", error.message);
    if (code < 0) {
        brace_job job;
        cli_report report;
        cli_report_begin(&report, &job, command, a.quiet, a.threads);
        brace_status status = simulate(&a, &screens, &file, &job, &error);
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
    sim_scene_file_free(&file);
    cli_list_free(&a.set);
    cli_list_free(&a.off);
    cli_list_free(&screens);
    return code;
}
