/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_sim.c: brace bench sim: megapixel-frames a second on one core, for each
 * driver and each instruction set that there is.
 *
 * First the light kernel alone, with how far it is off plain C. Then whole
 * frames, the way a capture makes them: texture and light (sim_render), lens
 * (sim_degrade), noise and mosaic (sim_expose), for each of a bracket's five.
 */
#include "cli/bench.h"

#include <math.h>
#include <string.h>

#include "brace/develop.h"
#include "sim/simulate.h"

static const char command[] = "bench sim";

/* One of each driver; backlights also with zones. */
static const char *const usual[] = {"steady",           "monitor_lcd_240", "monitor_miniled_480", "phone_oled_120_480",
                                    "led_wall_3840_16", "hub75_300",       "crt_60"};

enum { STAGES = 2 };

/* What was measured of a display; rates in megapixel-frames a second. */
typedef struct bench_row {
    char display[64], driver[16];
    double light[BENCH_SETS], off[BENCH_SETS], frame[BENCH_SETS];
    double share[STAGES]; /* of the whole frame's time, with the best set */
} bench_row;

typedef struct sim_bench {
    const brace_job *job;
    sim_scene scene;
    sim_camera camera;
    double seconds; /* to repeat a measurement for */
    int least;      /* times to repeat it, at the least */
    bench_set sets[BENCH_SETS];
    brace_image *screen;
    sim_texture texture;
    sim_panel *panel; /* of the display at hand */
    uint64_t done, total;
} sim_bench;

/* ---- the screen ---- */

/* Full HD: smooth shades, flat areas with sharp edges, and something like text. */
static brace_status draw_screen(brace_image **out, brace_error *error) {
    enum { WIDTH = 1920, HEIGHT = 1080 };
    brace_status status = brace_image_create(out, WIDTH, HEIGHT, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, error);
    core_random r = core_random_create(3, 0, 0, 0);
    for (uint32_t y = 0; y < HEIGHT && status == BRACE_OK; y++) {
        uint8_t *row = (uint8_t *)(*out)->data + y * (*out)->stride;
        for (uint32_t x = 0; x < WIDTH; x++) {
            const bool page = x > 480 && y > 120, ink = page && y / 14 % 2 == 0 && core_random_below(&r, 3) == 0;
            const uint32_t block = (x / 160 * 37 + y / 120 * 59) % 200;
            const uint32_t rgb[3] = {x * 255 / WIDTH, y * 255 / HEIGHT, 40 + block};
            for (int c = 0; c < 3; c++)
                row[3 * x + (uint32_t)c] = (uint8_t)(ink ? 20 : page ? 235 - 10 * c : (int)rgb[c]);
        }
    }
    return status;
}

/* ---- the light kernel alone ---- */

enum { ROWS = 24 }; /* of a frame, evenly spread */

typedef struct light_run {
    const sim_bench *bench;
    sim_light_fn *kernel;
    size_t n;
    int32_t *x, *y;
    float *level[3], *out;
    double *start;
    float *reference; /* of plain C, where the results are wanted; NULL: time counts */
    double off;
    bool compare;
} light_run;

/* The rows as a camera that looks straight at the screen exposes them. */
static void run_light(void *arg) {
    light_run *run = arg;
    const sim_bench *b = run->bench;
    const sim_texture *t = &b->texture;
    const size_t n = run->n;
    for (int frame = 0; frame < b->scene.frames; frame++) {
        const double exposure = ldexp(b->scene.reference_time, 2 * (frame - b->scene.frames / 2));
        for (size_t k = 0; k < ROWS; k++) {
            const double at = ((double)k + 0.5) / ROWS;
            const int32_t y = (int32_t)(at * t->height);
            const double start = sim_frame_start(&b->scene, b->camera.readout, frame) + at * b->camera.readout;
            for (size_t i = 0; i < n; i++) {
                run->y[i] = y;
                run->start[i] = start;
            }
            for (int c = 0; c < 3; c++) {
                const size_t at_sample = ((size_t)frame * ROWS + k) * 3 + (size_t)c;
                float *out = run->reference != NULL && !run->compare ? run->reference + at_sample * n : run->out;
                run->kernel(b->panel, n, run->x, run->y, run->level[c] + k * n, c, run->start, exposure, out);
                for (size_t i = 0; run->compare && i < n; i++)
                    run->off = fmax(run->off, fabs((double)out[i] - (double)run->reference[at_sample * n + i]));
            }
        }
    }
}

static brace_status bench_light(const sim_bench *b, bench_row *row, brace_error *error) {
    const size_t n = b->scene.width, samples = (size_t)b->scene.frames * ROWS * 3 * n;
    light_run run = {.bench = b, .n = n};
    const sim_texture *t = &b->texture;
    run.x = core_alloc(n, sizeof *run.x);
    run.y = core_alloc(n, sizeof *run.y);
    run.start = core_alloc(n, sizeof *run.start);
    run.out = core_alloc(n, sizeof *run.out);
    float *levels = core_alloc(3 * ROWS * n, sizeof *levels);
    float *reference = core_alloc(samples, sizeof *reference);
    brace_status status = BRACE_OK;
    if (run.x == NULL || run.y == NULL || run.start == NULL || run.out == NULL || levels == NULL || reference == NULL) {
        status = core_fail_memory(error, samples * sizeof *reference, "the light of some rows");
        goto done;
    }
    for (size_t i = 0; i < n; i++)
        run.x[i] = (int32_t)(i * t->width / n);
    for (size_t c = 0; c < 3; c++) {
        run.level[c] = levels + c * ROWS * n;
        for (size_t k = 0; k < ROWS; k++)
            for (size_t i = 0; i < n; i++) {
                const size_t y = (2 * k + 1) * t->height / (2 * ROWS);
                run.level[c][k * n + i] = t->level[0].rgb[3 * (y * t->width + (size_t)run.x[i]) + c];
            }
    }
    for (int s = 0; s < BENCH_SETS && status == BRACE_OK; s++) {
        row->light[s] = row->off[s] = NAN;
        if (!b->sets[s].there || (status = core_check_cancel(b->job, error)) != BRACE_OK)
            continue;
        run.kernel = sim_light_kernel(b->panel, b->sets[s].cpu);
        run.reference = reference, run.compare = s > 0, run.off = 0;
        run_light(&run);
        row->off[s] = run.off;
        run.reference = NULL, run.compare = false;
        row->light[s] = 1e-6 * (double)samples / 3 / bench_measure(run_light, &run, b->seconds, b->least);
    }
done:
    core_free(run.x), core_free(run.y), core_free(run.start), core_free(run.out);
    core_free(levels), core_free(reference);
    return status;
}

/* ---- whole frames ---- */

typedef struct frame_run {
    const sim_bench *bench;
    sim_light *light;
    brace_frame *const *frames;
    const sim_stage *scenery;
    double stage[STAGES]; /* seconds, of all runs */
    brace_status status;
    brace_error *error;
} frame_run;

static void run_frames(void *arg) {
    frame_run *run = arg;
    const sim_bench *b = run->bench;
    for (int i = 0; i < b->scene.frames && run->status == BRACE_OK; i++) {
        double at[STAGES + 1] = {bench_seconds()};
        run->status = sim_render(run->light, run->scenery, i, NULL, run->error);
        at[1] = bench_seconds();
        if (run->status == BRACE_OK)
            run->status = sim_expose(run->frames[i], run->light, &b->scene, i, NULL, run->error);
        at[2] = bench_seconds();
        for (int k = 0; k < STAGES; k++)
            run->stage[k] += at[k + 1] - at[k];
    }
}

static brace_status bench_frames(const sim_bench *b, const sim_display *display, bench_row *row, brace_error *error) {
    const brace_job one = {.threads = 1, .cancel = b->job->cancel};
    sim_light light = {0};
    sim_capture capture; /* its frames are what is exposed over and over */
    sim_stage stage = {.scene = &b->scene, .camera = &b->camera, .texture = &b->texture, .panel = b->panel};
    brace_color color;
    brace_status status = sim_capture_create(&capture, b->screen, display, &b->camera, &b->scene, &one, error);
    if (status == BRACE_OK)
        status = sim_light_create(&light, b->scene.width, b->scene.height, error);
    if (status == BRACE_OK)
        status = brace_color_init(&color, capture.frame[0], error);
    for (int k = 0; k < 9 && status == BRACE_OK; k++)
        stage.to_camera[k] = color.srgb_to_camera[k] / color.wb[k / 3];
    for (int s = 0; s < BENCH_SETS && status == BRACE_OK; s++) {
        row->frame[s] = NAN;
        if (!b->sets[s].there || (status = core_check_cancel(b->job, error)) != BRACE_OK)
            continue;
        frame_run run = {b, &light, capture.frame, &stage, {0}, BRACE_OK, error};
        bench_use(&b->sets[s]);
        const double seconds = bench_measure(run_frames, &run, 2 * b->seconds, b->least);
        row->frame[s] = 1e-6 * (double)b->scene.width * b->scene.height * b->scene.frames / seconds;
        for (int k = 0; k < STAGES; k++)
            row->share[k] = run.stage[k] / (run.stage[0] + run.stage[1]);
        status = run.status;
    }
    sim_light_free(&light);
    sim_capture_free(&capture);
    return status;
}

/* ---- all of it ---- */

static brace_status bench_display(sim_bench *b, const char *name, bench_row *row, brace_error *error) {
    sim_display *display = NULL;
    brace_status status = sim_display_load(&display, name, error);
    if (status == BRACE_OK)
        status = core_check_cancel(b->job, error);
    if (status == BRACE_OK)
        status =
            sim_panel_create(&b->panel, display, b->texture.level[0].rgb, b->texture.width, b->texture.height, error);
    if (status == BRACE_OK) {
        static const char *const kinds[] = {
            [SIM_DC] = "dc",
            [SIM_LCD_PWM] = "lcd_pwm",
            [SIM_OLED_PWM] = "oled_pwm",
            [SIM_LED_SPWM] = "led_spwm",
            [SIM_BCM] = "bcm",
            [SIM_RASTER] = "raster",
        };
        snprintf(row->display, sizeof row->display, "%s", sim_display_name(display));
        snprintf(row->driver, sizeof row->driver, "%s", kinds[sim_display_kind(display)]);
        status = bench_light(b, row, error);
    }
    if (status == BRACE_OK)
        status = bench_frames(b, display, row, error);
    sim_panel_destroy(b->panel);
    b->panel = NULL;
    sim_display_destroy(display);
    return status;
}

static brace_status bench_all(sim_bench *b, const char *camera, const char *const *displays, size_t count,
                              bench_row *rows, brace_error *error) {
    brace_status status = sim_camera_load(&b->camera, camera, error);
    if (status == BRACE_OK)
        status = sim_scene_check(&b->scene, error);
    if (status == BRACE_OK)
        status = draw_screen(&b->screen, error);
    if (status == BRACE_OK)
        status = sim_texture_create(&b->texture, b->screen, error);
    for (size_t i = 0; i < count && status == BRACE_OK; i++) {
        core_progress(b->job, "measuring", i, count);
        status = bench_display(b, displays[i], &rows[i], error);
    }
    if (status == BRACE_OK)
        core_progress(b->job, "measuring", count, count);
    sim_texture_free(&b->texture);
    brace_image_destroy(b->screen);
    return status;
}

/* ---- what comes out ---- */

static const char *const stages[STAGES] = {"light", "sensor"};

/* A float plane for each colour is written once and read once at the least, and the mosaic is written. */
static double copy_bound(double rate) {
    return 2 * rate / (2 * 3 * sizeof(float) + sizeof(uint16_t)) * 1e-6;
}

static json_t *sets_json(const sim_bench *b, const double values[BENCH_SETS]) {
    json_t *out = json_object();
    for (int s = 0; s < BENCH_SETS; s++)
        if (b->sets[s].there)
            json_object_set_new(out, b->sets[s].name, cli_json_number(values[s]));
    return out;
}

static json_t *to_json(const sim_bench *b, const bench_row *rows, size_t count, double rate) {
    char processor[128];
    json_t *list = json_array();
    for (size_t i = 0; i < count; i++) {
        json_t *share = json_object();
        for (int k = 0; k < STAGES; k++)
            json_object_set_new(share, stages[k], cli_json_number(rows[i].share[k]));
        json_array_append_new(list, json_pack("{s:o, s:s, s:o, s:o, s:o, s:o}", "display",
                                              cli_json_text(rows[i].display), "driver", rows[i].driver, "light",
                                              sets_json(b, rows[i].light), "deviation", sets_json(b, rows[i].off),
                                              "frame", sets_json(b, rows[i].frame), "share", share));
    }
    return json_pack("{s:s, s:o, s:s, s:i, s:i, s:i, s:f, s:f, s:o}", "bench", "sim", "processor",
                     cli_json_text(bench_processor(processor, sizeof processor)), "unit",
                     "megapixel-frames a second on one core", "width", (int)b->scene.width, "height",
                     (int)b->scene.height, "frames", b->scene.frames, "copy_bytes_a_second", rate, "copy_bound",
                     copy_bound(rate), "displays", list);
}

static void print_cell(double value, const char *format) {
    if (isnan(value))
        printf(" %9s", "-");
    else
        printf(format, value);
}

static void print_heading(const char *what, const sim_bench *b) {
    printf("%-32s", what);
    for (int s = 0; s < BENCH_SETS; s++)
        printf(" %9s", b->sets[s].title);
}

static void print_tables(const sim_bench *b, const bench_row *rows, size_t count, double rate) {
    char processor[128];
    printf("%s, one core. Megapixel-frames a second: frames of %ux%u pixels, %d in a bracket.\n\n",
           bench_processor(processor, sizeof processor), b->scene.width, b->scene.height, b->scene.frames);
    print_heading("Light alone", b);
    printf("    off plain C by\n");
    for (size_t i = 0; i < count; i++) {
        printf("%-9s %-22s", rows[i].driver, rows[i].display);
        for (int s = 0; s < BENCH_SETS; s++)
            print_cell(rows[i].light[s], " %9.1f");
        printf("   ");
        for (int s = 1; s < BENCH_SETS; s++)
            print_cell(rows[i].off[s], " %9.1e");
        printf("\n");
    }
    printf("\n");
    print_heading("Whole frames", b);
    printf("    %5s %6s\n", stages[0], stages[1]);
    for (size_t i = 0; i < count; i++) {
        printf("%-9s %-22s", rows[i].driver, rows[i].display);
        for (int s = 0; s < BENCH_SETS; s++)
            print_cell(rows[i].frame[s], " %9.1f");
        printf("    %4.0f%% %5.0f%%\n", 100 * rows[i].share[0], 100 * rows[i].share[1]);
    }
    if (rate > 0)
        printf("\nIf only memory limited: %.0f. memcpy copies %.1f GB/s here, and a frame's light is written and read\n"
               "at the least once, 24 bytes a pixel, its mosaic written, 2 bytes.\n",
               copy_bound(rate), 1e-9 * rate);
}

typedef struct arguments {
    cli_list displays;
    const char *camera, *size;
    bool hand, quick, json, quiet;
} arguments;

static int run(const arguments *a, uint32_t width, uint32_t height) {
    sim_bench b = {.seconds = a->quick ? 0.01 : 0.25, .least = a->quick ? 1 : 5};
    sim_scene_default(&b.scene);
    b.scene.width = width, b.scene.height = height;
    /* The middle of what scenes are sampled from. */
    b.scene.psf = 0.6, b.scene.glare = 0.01, b.scene.vignetting = 0.12, b.scene.distortion[0] = 0.01;
    if (a->hand)
        b.scene.subexposures = 4, b.scene.tremor_position = b.scene.tremor_angle = 8e-4;
    bench_sets(b.sets);
    const bench_set *best = &b.sets[0];
    for (int s = 0; s < BENCH_SETS; s++)
        best = b.sets[s].there ? &b.sets[s] : best;

    const char *const *displays = a->displays.count > 0 ? a->displays.items : usual;
    const size_t count = a->displays.count > 0 ? a->displays.count : sizeof usual / sizeof *usual;
    brace_error error = {BRACE_OK, ""};
    bench_row *rows = core_calloc(count, sizeof *rows);
    double rate = 0;
    brace_job job;
    cli_report report;
    cli_report_begin(&report, &job, command, a->quiet, 1);
    b.job = &job;
    brace_status status = rows != NULL ? bench_all(&b, a->camera, displays, count, rows, &error)
                                       : core_fail_memory(&error, count * sizeof *rows, "the results");
    bench_use(best);
    if (status == BRACE_OK)
        rate = bench_copy_rate();
    cli_report_flush(&report);
    cli_report_end(&report);
    int code = CLI_FAILED;
    if (status != BRACE_OK) {
        if (a->json)
            cli_json_error(&error, command);
        cli_error(command, "%s", error.message);
        if (status == BRACE_ERROR_CANCELLED)
            code = cli_signals_exit();
    } else if (a->json) {
        code = cli_json_print(to_json(&b, rows, count, rate), command) ? CLI_DONE : CLI_FAILED;
    } else {
        print_tables(&b, rows, count, rate);
        code = cli_flush(command) ? CLI_DONE : CLI_FAILED;
    }
    core_free(rows);
    return code;
}

int bench_sim(int argc, char **argv) {
    arguments a = {.camera = "phone_median"};
    cli_list operands = {0};
    const cli_option options[] = {
        {CLI_HEADING, 0, NULL, NULL, "Options", NULL, 0, 0},
        {CLI_LIST, 'd', "display", "NAME|FILE.json",
         "measure this one; may be given several times;\ndefault: one or two of each driver", &a.displays, 0, 0},
        {CLI_TEXT, 'c', "camera", "NAME|FILE.json", "default: phone_median", &a.camera, 0, 0},
        {CLI_TEXT, 0, "size", "WxH", "of the frames, default: 1024x768", &a.size, 0, 0},
        {CLI_FLAG, 0, "hand", NULL, "a hand that trembles: up to four sub-exposures in a frame", &a.hand, 0, 0},
        {CLI_FLAG, 0, "quick", NULL, "small frames, few repetitions: rough numbers in a second", &a.quick, 0, 0},
        {CLI_FLAG, 0, "json", NULL, "print a JSON object on stdout", &a.json, 0, 0},
        {CLI_FLAG, 'q', "quiet", NULL, "no progress", &a.quiet, 0, 0},
        {CLI_HELP, 'h', "help", NULL, "this text", NULL, 0, 0},
        {.kind = CLI_END},
    };
    const cli_usage usage = {
        command, "[OPTION]...",
        "Measures the simulator on one core: megapixel-frames a second for displays of each\n"
        "driver, plain C beside the instruction sets of this processor. First the light of\n"
        "the display alone, and how far the results are off those of plain C, in units of\n"
        "white. Then whole frames: texture, lens, light, noise and mosaic, with the shares\n"
        "of the time. Medians of CPU time; BRACE_CPU leaves instruction sets out.",
        options,
        "Examples:\n"
        "  brace bench sim\n"
        "  brace bench sim --display led_wall_3840_16 --hand --json\n"};
    int code = cli_parse(&usage, argc, argv, &operands);
    unsigned width = 0, height = 0;
    char rest;
    if (code < 0 && operands.count > 0)
        code = cli_wrong_usage(command, "'%s': no argument is expected; displays go to --display", operands.items[0]);
    if (code < 0 && a.size != NULL && (sscanf(a.size, "%5ux%5u%c", &width, &height, &rest) != 2 || width == 0))
        code = cli_wrong_usage(command, "--size takes a width and a height, such as 1024x768, not '%s'", a.size);
    if (code < 0)
        code = run(&a, width > 0 ? width : a.quick ? 160 : 1024, width > 0 ? height : a.quick ? 120 : 768);
    cli_list_free(&operands);
    cli_list_free(&a.displays);
    return code;
}
