/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cmd_analyze.c: brace analyze: what bands in a photograph of a display, how
 * strongly, at what frequency, and which shutter times do not show it.
 */
#include "cli/cli.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli/plot.h"
#include "core/core.h"
#include "sim/sim.h"

static const char command[] = "analyze";

typedef struct arguments {
    double readout; /* milliseconds */
    const char *camera, *plot;
    bool json, quiet, no_align;
    int threads;
} arguments;

/* ---- words ---- */

static const char *source_words(brace_banding_source source) {
    switch (source) {
    case BRACE_BANDING_STEADY:
        return "steady light, or modulated too fast for these exposures";
    case BRACE_BANDING_BACKLIGHT:
        return "one light for all rows: a pulsed LCD backlight, or rows that are scanned very fast";
    case BRACE_BANDING_SCANNED:
        return "rows lit one after another: an OLED, or a display that is scanned";
    case BRACE_BANDING_LED_WALL:
        return "an LED wall, by its frequency";
    case BRACE_BANDING_MAINS:
        return "lamps on the mains, by frequency and smoothness";
    case BRACE_BANDING_UNKNOWN:
        break;
    }
    return "not told";
}

static void print_shutters(const brace_banding *b) {
    char text[32];
    bool any = false;
    printf("\nshutter times free of banding (under 1 %%), of the usual ones:\n ");
    for (size_t i = 0; i < b->usuals; i++)
        if (b->usual[i].contrast < 0.01)
            printf(" %s", cli_exposure_text(text, sizeof text, b->usual[i].seconds)), any = true;
    if (!any)
        printf(" none");
    printf("\nof the others, least banded:\n ");
    bool shown[BRACE_BANDING_SHUTTERS] = {0};
    for (int n = 0; n < 5; n++) {
        size_t best = b->usuals;
        for (size_t i = 0; i < b->usuals; i++)
            if (!shown[i] && b->usual[i].contrast >= 0.01 &&
                (best == b->usuals || b->usual[i].contrast < b->usual[best].contrast))
                best = i;
        if (best == b->usuals)
            break;
        shown[best] = true;
        printf(" %s (%.0f %%)", cli_exposure_text(text, sizeof text, b->usual[best].seconds),
               100 * b->usual[best].contrast);
    }
    printf("\nwhole periods:\n ");
    for (size_t i = 0; i < b->exacts; i++)
        printf(" %d/%.5g s", b->exact[i].periods, b->base_hz);
    printf("\n");
}

static void print_bracket(const brace_banding *b) {
    if (b->confidence < 0.5) {
        printf("\nno banding found: %s\n", source_words(b->source));
        return;
    }
    if (!(b->frequency > 0)) {
        printf("\nthe rows' light is uneven, but no stripes repeat: fewer than two periods in the frame, or a display\n"
               "whose parts are out of step\n");
        return;
    }
    printf("\nstripes        every %.4g rows\n", 1 / b->frequency);
    if (b->hz > 0 && b->frequency_confidence < 0.2) {
        printf("frequency      not told: %.4g Hz is a guess (give or take %.2g %%). Few periods in the frame, or a display\n"
               "               whose parts are out of step\n",
               b->hz, 100 * b->frequency_error);
    } else if (b->hz > 0) {
        printf("frequency      %.5g Hz, give or take %.2g %%, %.0f %% sure\n", b->hz, 100 * b->frequency_error,
               100 * b->frequency_confidence);
        if (b->base_hz < 0.99 * b->hz)
            printf("repeats        at %.5g Hz\n", b->base_hz);
        printf("would look the same:");
        for (size_t i = 0; i < b->aliases; i++)
            if (b->alias_possible[i])
                printf(" %.5g Hz", b->alias_hz[i]);
        bool possible = false;
        for (size_t i = 0; i < b->aliases; i++)
            possible = possible || b->alias_possible[i];
        printf("%s\n", possible ? "" : " nothing that could show this contrast");
        printf("display        %s\n", source_words(b->source));
        if (b->source == BRACE_BANDING_SCANNED)
            printf("               (then the scan shifts the frequency: docs/banding.md)\n");
        if (b->decay != 0)
            printf("doubtful       contrast decays %s with exposure than light of this frequency would: is the\n"
                   "               readout right? Or the display lights its rows one after another.\n",
                   b->decay > 0 ? "more slowly" : "faster");
        print_shutters(b);
    } else
        printf("frequency      with --readout or --camera\n");
}

static void print_all(const brace_banding *b, const cli_paths *paths) {
    int width = 5;
    for (size_t i = 0; i < paths->count; i++) {
        const int n = (int)strlen(cli_basename(paths->items[i]));
        width = n > width ? n : width;
    }
    printf("%-*s  %10s  %6s  %9s  %8s  %10s  %6s\n", width, "frame", "time", "sure", "period", "stripes", "contrast",
           "rho");
    for (size_t i = 0; i < b->count; i++) {
        const brace_banding_frame *f = &b->frame[i];
        char time[32];
        printf("%-*s  %10s  %4.0f %%", width, cli_basename(paths->items[i]),
               cli_exposure_text(time, sizeof time, f->exposure_time), 100 * f->confidence);
        if (f->confidence >= 0.5 && f->period > 0)
            printf("  %6.4g px  %4.0f deg  %8.1f %%", f->period, fmod(round(f->orientation), 180), 100 * f->contrast);
        else
            printf("  %9s  %8s  %10s", "-", "-", "-");
        printf("  %6.3f%s\n", f->fabp.rho, f->told < 0.4 ? "  (too little of it tells)" : "");
    }
    print_bracket(b);
}

/* ---- JSON ---- */

static json_t *numbers(const double *values, size_t count) {
    json_t *array = json_array();
    for (size_t i = 0; i < count; i++)
        json_array_append_new(array, cli_json_number(values[i]));
    return array;
}

static json_t *fabp_json(const brace_fabp *f) {
    json_t *descriptor = json_array();
    for (int i = 0; i < 8; i++)
        json_array_append_new(descriptor, cli_json_number((double)f->descriptor[i]));
    return json_pack("{s:[i,i], s:[o,o], s:[i,i], s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o}", "size",
                     (int)f->width, (int)f->height, "ring", cli_json_number(f->r_min), cli_json_number(f->r_max),
                     "peak", f->v, f->u, "fx", cli_json_number(f->refined_fx), "fy", cli_json_number(f->refined_fy),
                     "f", cli_json_number(f->refined_f), "theta", cli_json_number(f->refined_theta), "rho",
                     cli_json_number(f->rho), "peak_power", cli_json_number(f->peak_power), "ring_power",
                     cli_json_number(f->ring_power), "amplitude", cli_json_number(f->amplitude), "phase",
                     cli_json_number(f->phase), "descriptor", descriptor);
}

static json_t *frame_json(const brace_banding_frame *f, const char *path, bool readout) {
    return json_pack("{s:o, s:o, s:o, s:o, s:b, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o}", "path",
                     cli_json_text(path), "exposure_time",
                     f->exposure_time > 0 ? cli_json_number(f->exposure_time) : json_null(), "confidence",
                     cli_json_number(f->confidence), "alone", cli_json_number(f->alone), "compared", (int)f->compared,
                     "told", cli_json_number(f->told), "frequency", cli_json_number(f->frequency), "frequency_error",
                     cli_json_number(f->frequency_error), "hz", readout ? cli_json_number(f->hz) : json_null(),
                     "period", cli_json_number(f->period), "orientation", cli_json_number(f->orientation), "contrast",
                     cli_json_number(f->contrast), "share", cli_json_number(f->share), "harmonics",
                     numbers(f->harmonic, BRACE_BANDING_HARMONICS), "fabp", fabp_json(&f->fabp));
}

static json_t *shutters_json(const brace_banding_shutter *s, size_t count) {
    json_t *array = json_array();
    for (size_t i = 0; i < count; i++)
        json_array_append_new(array, json_pack("{s:o, s:o, s:i}", "seconds", cli_json_number(s[i].seconds), "contrast",
                                               cli_json_number(s[i].contrast), "periods", s[i].periods));
    return array;
}

static json_t *all_json(const brace_banding *b, const cli_paths *paths, const cli_report *report) {
    json_t *frames = json_array(), *aliases = json_array(), *notes = json_array();
    const bool readout = b->readout > 0;
    for (size_t i = 0; i < b->count; i++)
        json_array_append_new(frames, frame_json(&b->frame[i], paths->items[i], readout));
    for (size_t i = 0; i < b->aliases; i++)
        json_array_append_new(aliases, json_pack("{s:o, s:b}", "hz", cli_json_number(b->alias_hz[i]), "possible",
                                                 (int)b->alias_possible[i]));
    for (size_t i = 0; i < report->note_count; i++)
        json_array_append_new(notes, cli_json_text(report->notes[i]));
    return json_pack("{s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:i, s:s, s:o, s:o, s:o}", "frames", frames,
                     "confidence", cli_json_number(b->confidence), "frequency", cli_json_number(b->frequency),
                     "frequency_error", cli_json_number(b->frequency_error), "frequency_confidence",
                     cli_json_number(b->frequency_confidence), "readout",
                     readout ? cli_json_number(b->readout) : json_null(), "hz",
                     readout ? cli_json_number(b->hz) : json_null(), "base_hz",
                     readout ? cli_json_number(b->base_hz) : json_null(), "aliases", aliases, "decay", b->decay, "source",
                     brace_banding_source_name(b->source), "usual_shutters", shutters_json(b->usual, b->usuals),
                     "whole_periods", shutters_json(b->exact, b->exacts), "notes", notes);
}

/* ---- the work ---- */

static int work(const arguments *a, const cli_paths *paths, double readout) {
    brace_job job;
    cli_report report;
    brace_error error = {0};
    brace_frame *frames[BRACE_BANDING_MAX_FRAMES] = {NULL};
    brace_banding banding;
    brace_image *plot = NULL;
    brace_status status = BRACE_OK;

    cli_report_begin(&report, &job, command, a->quiet, a->threads);
    for (size_t i = 0; i < paths->count && status == BRACE_OK; i++)
        status = brace_frame_read(&frames[i], paths->items[i], &job, &error);
    const brace_banding_params params = {.readout = readout, .no_align = a->no_align};
    if (status == BRACE_OK)
        status = brace_banding_measure(&banding, (const brace_frame *const *)frames, paths->count, &params, &job,
                                       &error);
    if (status == BRACE_OK && a->plot != NULL)
        status = cli_plot(&plot, &banding, (const brace_frame *const *)frames, &job, &error);
    if (status == BRACE_OK && a->plot != NULL)
        status = brace_image_write(plot, a->plot, NULL, &job, &error);
    cli_report_flush(&report);
    int code = CLI_DONE;
    if (status == BRACE_ERROR_CANCELLED) {
        code = cli_signals_exit();
    } else if (status != BRACE_OK) {
        error.status = status;
        if (a->json)
            cli_json_error(&error, command);
        cli_error(command, "%s", error.message);
        code = CLI_FAILED;
    } else if (a->json) {
        code = cli_json_print(all_json(&banding, paths, &report), command) ? CLI_DONE : CLI_FAILED;
    } else {
        print_all(&banding, paths);
        code = cli_flush(command) ? CLI_DONE : CLI_FAILED;
    }
    cli_report_end(&report);
    brace_image_destroy(plot);
    for (size_t i = 0; i < paths->count; i++)
        brace_frame_destroy(frames[i]);
    return code;
}

static int run(const arguments *a, const cli_list *names, cli_paths *paths) {
    double readout = a->readout * 1e-3;
    if (a->readout > 0 && a->camera != NULL)
        return cli_wrong_usage(command, "--readout and --camera both say how fast the sensor is read: give one");
    if (a->camera != NULL) {
        sim_camera camera;
        brace_error error;
        if (sim_camera_load(&camera, a->camera, &error) != BRACE_OK) {
            cli_error(command, "%s", error.message);
            return CLI_FAILED;
        }
        readout = camera.readout;
    }
    if (!cli_paths_expand(paths, names, NULL, command))
        return CLI_FAILED;
    if (paths->count < 1 || paths->count > BRACE_BANDING_MAX_FRAMES) {
        cli_error(command, "1 to %d frames are analysed together, but %zu were given", BRACE_BANDING_MAX_FRAMES,
                  paths->count);
        return CLI_FAILED;
    }
    for (size_t i = 0; a->plot != NULL && i < paths->count; i++)
        if (cli_same_file(a->plot, paths->items[i])) {
            cli_error(command, "%s is a frame: the plot must not overwrite it", a->plot);
            return CLI_FAILED;
        }
    return work(a, paths, readout);
}

int cli_analyze(int argc, char **argv) {
    arguments a = {0};
    cli_list names = {0};
    cli_paths paths = {0};
    const cli_option options[] = {
        {CLI_HEADING, 0, NULL, NULL, "Options", NULL, 0, 0},
        {CLI_NUMBER, 'r', "readout", "MS",
         "milliseconds that the camera takes to read a frame from its first row\nto its last: gives frequencies in Hz "
         "and shutter times",
         &a.readout, 0.01, 10000},
        {CLI_TEXT, 'c', "camera", "NAME", "take the readout of a camera preset or JSON file", &a.camera, 0, 0},
        {CLI_TEXT, 'p', "plot", "FILE", "draw frames, spectra and decay: .png, .jpg, .tif or .webp", &a.plot, 0, 0},
        {CLI_FLAG, 0, "no-align", NULL, "the camera stood still: do not look for motion", &a.no_align, 0, 0},
        {CLI_FLAG, 0, "json", NULL, "print a JSON object on stdout", &a.json, 0, 0},
        {CLI_FLAG, 'q', "quiet", NULL, "no progress and no notes, only errors", &a.quiet, 0, 0},
        {CLI_INT, 't', "threads", "N", "1 to 256, default: one for each CPU", &a.threads, 1, 256},
        {CLI_HELP, 'h', "help", NULL, "this text", NULL, 0, 0},
        {.kind = CLI_END},
    };
    const cli_usage usage = {command, "FRAME... [OPTION]...",
                             "Measures the banding of 1 to 9 RAW photographs of a display: how sure it is that there\n"
                             "is any, direction and period of the stripes, their contrast and how it decays with the\n"
                             "exposure. With the camera's readout time also the frequency of the light, the likely\n"
                             "kind of display, and the shutter times that do not show it. Several exposures tell far\n"
                             "more than one. A folder stands for the RAW files in it.",
                             options,
                             "Examples:\n  brace analyze frame_*.dng --readout 14.5\n"
                             "  brace analyze bracket/ --camera sony_a1 --plot report.png\n"};
    int code = cli_parse(&usage, argc, argv, &names);
    if (code < 0 && names.count == 0)
        code = cli_wrong_usage(command, "which frames? brace analyze FRAME...");
    if (code < 0)
        code = run(&a, &names, &paths);
    cli_paths_free(&paths);
    cli_list_free(&names);
    return code;
}
