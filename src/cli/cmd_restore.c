/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cmd_restore.c: brace restore: a bracket in, pictures without banding out,
 * and a short account of what was done.
 */
#include "cli/report.h"

#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "core/core.h"

static const char command[] = "restore";

typedef struct arguments {
    cli_list frames, outputs;
    const char *method, *reference, *exposures, *format, *page, *truth, *model, *precision;
    bool no_align, json, quiet, verbose;
    int threads, quality, bits, page_side;
    double exposure, memory;
} arguments;

static int parse(arguments *a, int argc, char **argv) {
    const cli_option options[] = {
        {CLI_HEADING, 0, NULL, NULL, "Output", NULL, 0, 0},
        {CLI_LIST, 'o', "output", "FILE",
         "write the result here; .dng, .tif, .png, .jpg or .webp.\n"
         "May be given several times",
         &a->outputs, 0, 0},
        {CLI_TEXT, 'f', "format", "FORMAT",
         "dng, tif, png, jpg or webp, for an output whose name\n"
         "doesn't tell, such as /dev/stdout",
         &a->format, 0, 0},
        {CLI_INT, 0, "bits", "N",
         "8, 16 or 32 (linear float, TIFF only) bits a channel;\n"
         "default: TIFF 16, PNG, JPEG and WebP 8",
         &a->bits, 8, 32},
        {CLI_INT, 0, "quality", "N", "of JPEG and WebP, 1 to 100, default 92", &a->quality, 1, 100},
        {CLI_NUMBER, 0, "exposure", "EV",
         "make the pictures brighter by this many stops; below 0,\n"
         "highlights that only short frames hold come back. DNGs\n"
         "stay as they are",
         &a->exposure, -10, 10},
        {CLI_HEADING, 0, NULL, NULL, "Report", NULL, 0, 0},
        {CLI_TEXT, 0, "report", "FILE",
         "write a report to look at in a browser: before and after,\n"
         "the frames, the banding, the spectra. One .html file that\n"
         "needs no other; -o may then be left out",
         &a->page, 0, 0},
        {CLI_INT, 0, "report-side", "N", "longest side of its pictures, 64 to 8192; default 2048", &a->page_side, 64, 8192},
        {CLI_TEXT, 0, "truth", "FILE",
         "the true picture, RAW or not, of the frames' size: the\n"
         "report then measures PSNR, SSIM, MS-SWD and SFC",
         &a->truth, 0, 0},
        {CLI_HEADING, 0, NULL, NULL, "Bracket", NULL, 0, 0},
        {CLI_TEXT, 'r', "reference", "FRAME",
         "the frame to restore: its name, or its number as given,\n"
         "from 1; default: the one of middle exposure",
         &a->reference, 0, 0},
        {CLI_TEXT, 0, "exposures", "T1,T2,...",
         "exposure times of the frames, in the order given, for\n"
         "files that don't record them: 1/640,1/160,1/40",
         &a->exposures, 0, 0},
        {CLI_HEADING, 0, NULL, NULL, "Method", NULL, 0, 0},
        {CLI_TEXT, 'm', "method", "METHOD",
         "brace: by a trained network (default, where its weights\n"
         "are installed); merge: align and fuse all frames;\n"
         "reference: develop the reference frame only",
         &a->method, 0, 0},
        {CLI_TEXT, 0, "model", "NAME|FILE",
         "the network's weights: a name, brace-s (default), or a\n"
         ".safetensors file, such as brace train writes",
         &a->model, 0, 0},
        {CLI_NUMBER, 0, "memory", "MB",
         "what the network may use beside the frames; tiles are as\n"
         "large as that allows. Default: half of what is free, at\n"
         "most 1024",
         &a->memory, 1, 1e9},
        {CLI_TEXT, 0, "precision", "f32|bf16",
         "what the network computes in; default: bf16 where the\n"
         "processor has it (AMX, AVX512-BF16), else f32",
         &a->precision, 0, 0},
        {CLI_FLAG, 0, "no-align", NULL, "the camera stood still: don't look for motion", &a->no_align, 0, 0},
        {CLI_HEADING, 0, NULL, NULL, "General", NULL, 0, 0},
        {CLI_INT, 't', "threads", "N", "1 to 256, default: one for each CPU", &a->threads, 1, 256},
        {CLI_FLAG, 0, "json", NULL, "print what was done as a JSON object on stdout", &a->json, 0, 0},
        {CLI_FLAG, 'q', "quiet", NULL, "no progress bar and no summary, only errors", &a->quiet, 0, 0},
        {CLI_FLAG, 'v', "verbose", NULL, "also print where the time went", &a->verbose, 0, 0},
        {CLI_HELP, 'h', "help", NULL, "this text", NULL, 0, 0},
        {.kind = CLI_END},
    };
    const cli_usage usage = {
        command,
        "FRAME... -o OUT [-o OUT]... [OPTION]...",
        "Restores a bracket: 3 to 9 RAW files of the same display, exposed differently, in\n"
        "any order and of any RAW format with a Bayer sensor. A folder stands for the RAW\n"
        "files in it.",
        options,
        "Examples:\n"
        "  brace restore frame_*.dng -o restored.dng -o restored.jpg\n"
        "  brace restore bracket/ -o restored.tif --bits 16 --report report.html\n"
        "  brace restore a.dng b.dng c.dng --exposures 1/800,1/200,1/50 -o out.png\n"
        "  brace restore bracket/ -o out.dng --model runs/mine/weights.safetensors --memory 500\n"
        "  brace restore bracket/ -o merged.jpg --method merge\n",
    };
    int code = cli_parse(&usage, argc, argv, &a->frames);
    if (code < 0 && a->frames.count == 0) {
        code = cli_wrong_usage(command, "which files? brace restore FRAME... -o OUT");
    }
    if (code < 0 && a->bits != 0 && a->bits != 8 && a->bits != 16 && a->bits != 32) {
        code = cli_wrong_usage(command, "--bits is 8, 16 or 32, not %d", a->bits);
    }
    if (code < 0 && a->page == NULL && (a->truth != NULL || a->page_side > 0)) {
        code = cli_wrong_usage(command, "%s is for the report: name it with --report FILE",
                               a->truth != NULL ? "--truth" : "--report-side");
    }
    if (code < 0 && a->truth != NULL && a->exposure * a->exposure > 0) {
        code = cli_wrong_usage(command, "--truth is compared at the exposure as shot: leave out --exposure");
    }
    return code;
}

static int parse_method(const arguments *a, brace_restore_params *out) {
    out->method = BRACE_METHOD_DEFAULT;
    for (brace_method m = BRACE_METHOD_REFERENCE; m <= BRACE_METHOD_NETWORK && a->method != NULL; m++) {
        out->method = strcmp(a->method, brace_method_name(m)) == 0 ? m : out->method;
    }
    if (a->method != NULL && out->method == BRACE_METHOD_DEFAULT) {
        return cli_wrong_usage(command, "--method is brace, merge or reference, not '%s'%s", a->method,
                               strchr(a->method, '.') != NULL ? "; a file of weights is given with --model" : "");
    }
    const char *only = a->model != NULL ? "--model" : a->precision != NULL ? "--precision" : a->memory > 0 ? "--memory" : NULL;
    if (only != NULL && (out->method == BRACE_METHOD_MERGE || out->method == BRACE_METHOD_REFERENCE)) {
        return cli_wrong_usage(command, "%s is for networks, but --method is %s", only, a->method);
    }
    if (a->precision != NULL && strcmp(a->precision, "f32") != 0 && strcmp(a->precision, "bf16") != 0) {
        return cli_wrong_usage(command, "--precision is f32 or bf16, not '%s'", a->precision);
    }
    out->precision = a->precision == NULL ? BRACE_PRECISION_DEFAULT
                     : a->precision[0] == 'f' ? BRACE_PRECISION_F32 : BRACE_PRECISION_BF16;
    out->model = a->model;
    out->memory = (uint64_t)(a->memory * 1e6);
    return -1;
}

/* The argument number of the reference, from 1; 0 for the default. */
static int parse_reference(const char *text, const cli_paths *frames, size_t *reference) {
    *reference = 0;
    if (text == NULL) {
        return -1;
    }
    size_t found = 0;
    for (size_t i = 0; i < frames->count; i++) {
        if (cli_same_file(text, frames->items[i])) {
            *reference = i + 1;
            return -1;
        }
        if (strcmp(text, cli_basename(frames->items[i])) == 0) {
            found = found == 0 ? i + 1 : SIZE_MAX;
        }
    }
    if (found == SIZE_MAX) {
        return cli_wrong_usage(command, "--reference %s: several frames have this name; give its folder too", text);
    }
    if (found > 0) {
        *reference = found;
        return -1;
    }
    size_t digits = strspn(text, "0123456789");
    if (digits == 0 || text[digits] != '\0') {
        return cli_wrong_usage(command, "--reference %s is none of the frames", text);
    }
    double number = 0;
    if (!cli_number(text, &number) || number < 1 || number > (double)frames->count) {
        return cli_wrong_usage(command, "--reference takes a number from 1 to %zu or a frame's name, not %s",
                               frames->count, text);
    }
    *reference = (size_t)number;
    return -1;
}

/* Exposure times into `out`, one a frame. */
static int parse_exposures(const char *text, const cli_paths *frames, double *out) {
    char *copy = strdup(text), *rest = copy, *word;
    int code = -1;
    size_t n = 0;
    if (copy == NULL) {
        cli_error(command, "out of memory");
        return CLI_FAILED;
    }
    while (code < 0 && (word = strsep(&rest, ",")) != NULL) {
        double seconds = 0;
        if (!cli_exposure_parse(word, &seconds)) {
            code = cli_wrong_usage(command, "--exposures: '%s' is no exposure time; write 1/60 or 0.5", word);
        } else if (n < frames->count) {
            out[n] = seconds;
        }
        n++;
    }
    free(copy);
    if (code < 0 && n != frames->count) {
        code = cli_wrong_usage(command, "--exposures has %zu times for %zu frames", n, frames->count);
    }
    return code;
}

/* ---- the account ---- */

typedef struct timing {
    double read, total, report; /* `total` without the report */
} timing;

static void print_table(const brace_bracket *b, const brace_restored *r) {
    int width = 5;
    for (size_t i = 0; i < b->count; i++) {
        int n = (int)strlen(cli_basename(b->frames[i]->path));
        width = n > width ? n : width;
    }
    fprintf(stderr, "  %-*s  %9s  %6s  %5s  %6s  %7s  %6s\n", width, "frame", "time", "ISO", "f/", "EV", "motion",
            "weight");
    for (size_t i = 0; i < b->count; i++) {
        const brace_frame *f = b->frames[i];
        const brace_motion *m = &r->report.motion[i];
        char time[32], iso[16] = "?", aperture[16] = "?", motion[32], weight[16] = "-";
        if (f->iso > 0) {
            snprintf(iso, sizeof iso, "%.0f", f->iso);
        }
        if (f->f_number > 0) {
            snprintf(aperture, sizeof aperture, "%.2g", f->f_number);
        }
        if (i == b->reference) {
            snprintf(motion, sizeof motion, "-");
        } else if (r->report.method != BRACE_METHOD_REFERENCE && !(m->confidence > 0)) {
            snprintf(motion, sizeof motion, "unknown");
        } else {
            snprintf(motion, sizeof motion, "%.1f px", hypot(m->dx, m->dy));
        }
        if (!isnan(r->report.weight[i])) {
            snprintf(weight, sizeof weight, "%.1f%%", 100 * r->report.weight[i]);
        }
        fprintf(stderr, "  %-*s  %9s  %6s  %5s  %+6.2f  %7s  %6s%s\n", width, cli_basename(f->path),
                cli_exposure_text(time, sizeof time, f->exposure_time), iso, aperture, log2(b->exposure[i]), motion,
                weight, i == b->reference ? "  reference" : "");
    }
}

static void print_summary(const arguments *a, const brace_bracket *b, const brace_restored *r, const outputs *out,
                          const timing *t) {
    print_table(b, r);
    if (r->report.clipped >= 0.0005) {
        fprintf(stderr, "  %.1f%% of the result is at white\n", 100 * r->report.clipped);
    }
    const brace_restore_report *did = &r->report;
    const bool network = did->method == BRACE_METHOD_NETWORK;
    if (a->verbose && network) {
        fprintf(stderr, "  weights %s\n  %zu tile%s of %dx%d pixels, %s\n", did->weights, did->tiles,
                did->tiles == 1 ? "" : "s", did->tile_width, did->tile_height,
                did->precision == BRACE_PRECISION_BF16 ? "bf16" : "f32");
        fprintf(stderr, "  read %.2f s, align %.2f s, network %.2f s, develop %.2f s, write %.2f s\n", t->read,
                did->seconds_align, did->seconds_network, out->seconds_develop, out->seconds_write);
    } else if (a->verbose) {
        fprintf(stderr, "  read %.2f s, align %.2f s, light %.2f s, fuse %.2f s, develop %.2f s, write %.2f s\n",
                t->read, did->seconds_align, did->seconds_light, did->seconds_fuse, out->seconds_develop,
                out->seconds_write);
    }
    if (network) {
        fprintf(stderr, "  network %s, %.2f s\n", did->model, t->total);
    } else {
        fprintf(stderr, "  %s, %.2f s\n", brace_method_name(did->method), t->total);
    }
    for (size_t i = 0; i < out->count; i++) {
        fprintf(stderr, "  wrote %s\n", out->items[i].path);
    }
    if (a->page != NULL) {
        fprintf(stderr, "  wrote %s\n", a->page);
    }
}

static json_t *frame_json(const brace_bracket *b, const brace_restored *r, size_t i) {
    const brace_frame *f = b->frames[i];
    const brace_motion *m = &r->report.motion[i];
    return json_pack(
        "{s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:{s:o, s:o, s:o, s:o, s:o, s:o}, s:o, s:o}", "path",
        cli_json_text(f->path), "exposure_time", cli_json_number(f->exposure_time), "iso", cli_json_number(f->iso),
        "f_number", cli_json_number(f->f_number), "relative_exposure", cli_json_number(b->exposure[i]), "ev",
        cli_json_number(log2(b->exposure[i])), "measured", cli_json_number(b->measured[i]), "motion", "dx",
        cli_json_number(m->dx), "dy", cli_json_number(m->dy), "rotation", cli_json_number(m->rotation), "scale",
        cli_json_number(m->scale), "local", cli_json_number(m->local), "confidence", cli_json_number(m->confidence),
        "weight", cli_json_number(r->report.weight[i]), "banding", cli_json_number(r->report.banding[i]));
}

static json_t *network_json(const brace_restore_report *r) {
    return r->method != BRACE_METHOD_NETWORK
               ? json_null()
               : json_pack("{s:o, s:o, s:s, s:I, s:i, s:i}", "model", cli_json_text(r->model), "weights",
                           cli_json_text(r->weights), "precision",
                           r->precision == BRACE_PRECISION_BF16 ? "bf16" : "f32", "tiles", (json_int_t)r->tiles,
                           "tile_width", r->tile_width, "tile_height", r->tile_height);
}

static json_t *report_json(const arguments *a, const brace_bracket *b, const brace_restored *r, const outputs *out, const timing *t,
                           const cli_report *report) {
    json_t *inputs = json_array(), *written = json_array(), *notes = json_array();
    for (size_t i = 0; i < b->count; i++) {
        json_array_append_new(inputs, frame_json(b, r, i));
    }
    for (size_t i = 0; i < out->count; i++) {
        json_array_append_new(written, json_pack("{s:o, s:s}", "path", cli_json_text(out->items[i].path), "format",
                                                 output_format_name(out->items[i].format)));
    }
    if (a->page != NULL) {
        json_array_append_new(written, json_pack("{s:o, s:s}", "path", cli_json_text(a->page), "format", "HTML"));
    }
    for (size_t i = 0; i < report->note_count; i++) {
        json_array_append_new(notes, cli_json_text(report->notes[i]));
    }
    return json_pack("{s:s, s:s, s:o, s:o, s:i, s:o, s:o, s:o, s:o, s:{s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f}}",
                     "version", brace_version(), "method", brace_method_name(r->report.method), "network",
                     network_json(&r->report), "reference",
                     cli_json_text(b->frames[b->reference]->path), "reference_index", (int)b->reference, "inputs",
                     inputs, "outputs", written, "notes", notes, "clipped", cli_json_number(r->report.clipped),
                     "seconds", "read", t->read, "align", r->report.seconds_align, "light", r->report.seconds_light,
                     "fuse", r->report.seconds_fuse, "network", r->report.seconds_network, "develop", out->seconds_develop, "write", out->seconds_write,
                     "total", t->total, "report", t->report);
}

/* ---- the work ---- */

/* Says what went wrong and what was written before it did. */
static int fail(const arguments *a, const outputs *out, const brace_error *error) {
    bool stopped = error->status == BRACE_ERROR_CANCELLED;
    const char *kept = NULL;
    for (size_t i = 0; i < out->count; i++) {
        kept = out->items[i].written ? out->items[i].path : kept;
    }
    if (stopped) {
        cli_error(command, "stopped%s", kept == NULL ? "; nothing was written" : "");
    } else {
        cli_error(command, "%s", error->message);
    }
    for (size_t i = 0; i < out->count; i++) {
        if (out->items[i].written) {
            cli_error(command, "%s was already written and is complete", out->items[i].path);
        }
    }
    if (a->json) {
        cli_json_error(error, command);
    }
    return stopped ? cli_signals_exit() : CLI_FAILED;
}

static int work(const arguments *a, const cli_paths *frames, const brace_bracket_params *bracket_params,
                const brace_restore_params *restore_params, outputs *out) {
    brace_job job;
    cli_report report;
    brace_error error = {0};
    brace_bracket *bracket = NULL;
    brace_restored *restored = NULL;
    timing t = {0, 0, 0};
    int code = CLI_DONE;

    cli_report_begin(&report, &job, command, a->quiet, a->threads);
    double start = core_seconds();
    brace_status status =
        brace_bracket_read(&bracket, (const char *const *)frames->items, frames->count, bracket_params, &job, &error);
    t.read = core_seconds() - start;
    if (status == BRACE_OK) {
        status = brace_restore(&restored, bracket, restore_params, &job, &error);
    }
    if (status == BRACE_OK) {
        /* What a merge finds above white lasts to where the shortest frame clips. */
        out->highlights = restored->report.method == BRACE_METHOD_MERGE ? 1 / bracket->exposure[0] : 1;
        status = outputs_write(out, restored, &job, &error);
    }
    t.total = core_seconds() - start;
    if (status == BRACE_OK && a->page != NULL) {
        const report_restore_params page = {.path = a->page, .truth = a->truth, .side = a->page_side, .bracket = bracket,
                                            .restored = restored, .out = out, .seconds = t.total,
                                            .notes = report.notes, .note_count = report.note_count};
        double begin = core_seconds();
        status = report_restore(&page, &job, &error);
        t.report = core_seconds() - begin;
    }
    cli_report_flush(&report);
    if (status != BRACE_OK) {
        error.status = status;
        code = fail(a, out, &error);
    } else {
        if (!a->quiet) {
            print_summary(a, bracket, restored, out, &t);
        }
        if (a->json && !cli_json_print(report_json(a, bracket, restored, out, &t, &report), command)) {
            code = CLI_FAILED;
        }
    }
    cli_report_end(&report);
    brace_restored_destroy(restored);
    brace_bracket_destroy(bracket);
    return code;
}

/* A name for a web page, or something that is no file. */
static bool is_page(const char *path) {
    const char *dot = strrchr(path, '.');
    struct stat info;
    return (dot != NULL && (strcasecmp(dot, ".html") == 0 || strcasecmp(dot, ".htm") == 0)) ||
           (stat(path, &info) == 0 && !S_ISREG(info.st_mode));
}

/* A result of before, in the folder of the frames, may be replaced; a photograph of the folder may not, although the name
 * of the output keeps it from being taken for a frame. -1 to go on. */
static int spare_frames(const arguments *a) {
    for (size_t i = 0; i < a->outputs.count; i++) {
        const char *path = a->outputs.items[i];
        struct stat info;
        if (!cli_is_raw_name(path) || stat(path, &info) != 0 || !S_ISREG(info.st_mode)) {
            continue;
        }
        char *folder = cli_folder_of(path);
        bool inside = false;
        for (size_t k = 0; k < a->frames.count && folder != NULL; k++) {
            inside = inside || cli_same_file(folder, a->frames.items[k]);
        }
        free(folder);
        if (inside && !outputs_is_result(path)) {
            return cli_wrong_usage(command, "the output %s is one of the inputs; it would be overwritten", path);
        }
    }
    return -1;
}

static int run(arguments *a, cli_paths *frames, double **exposures) {
    outputs out = {.bits = a->bits, .quality = a->quality, .exposure = a->exposure};
    brace_restore_params restore_params = {.no_align = a->no_align};
    brace_bracket_params bracket_params = {0};

    int code = parse_method(a, &restore_params);
    if (code < 0 && (a->outputs.count > 0 || a->page == NULL)) {
        code = outputs_init(&out, &a->outputs, a->format, command);
    }
    /* For the checks the report is an output like the others. */
    outputs all = out;
    if (a->page != NULL) {
        all.items[all.count++].path = a->page;
    }
    /* In a folder neither what is to be written nor the truth is a frame. */
    cli_list except = {0};
    for (size_t i = 0; i < a->outputs.count + (a->truth != NULL) && code < 0; i++) {
        if (!cli_list_add(&except, i < a->outputs.count ? a->outputs.items[i] : a->truth)) {
            code = CLI_FAILED;
        }
    }
    if (code < 0 && a->json && outputs_use_stdout(&all)) {
        code = cli_wrong_usage(command, "--json and an output can't both go to standard output");
    }
    code = code < 0 ? spare_frames(a) : code;
    if (code < 0 && !cli_paths_expand(frames, &a->frames, &except, command)) {
        code = CLI_FAILED;
    }
    cli_list_free(&except);
    char truth[256];
    if (code < 0 && a->exposures == NULL && cli_paths_leave_truth(frames, BRACE_BRACKET_MIN, truth, sizeof truth) &&
        !a->quiet) {
        cli_error(command, "note: %s is the truth of this bracket, not one of its frames: left out", truth);
    }
    if (code < 0 && (frames->count < BRACE_BRACKET_MIN || frames->count > BRACE_BRACKET_MAX)) {
        cli_error(command, "a bracket has %d to %d frames, but %zu %s given", BRACE_BRACKET_MIN, BRACE_BRACKET_MAX,
                  frames->count, frames->count == 1 ? "was" : "were");
        code = CLI_FAILED;
    }
    if (code < 0) {
        char *read[BRACE_BRACKET_MAX + 1];
        cli_paths inputs = {read, frames->count};
        memcpy(read, frames->items, frames->count * sizeof *read);
        if (a->truth != NULL) {
            read[inputs.count++] = (char *)(uintptr_t)a->truth; /* only looked at */
        }
        code = outputs_check(&all, &inputs, command);
    }
    if (code < 0 && a->page != NULL && !is_page(a->page)) {
        code = cli_wrong_usage(command, "--report takes the name of an HTML file, and %s does not end in .html", a->page);
    }
    if (code < 0) {
        code = parse_reference(a->reference, frames, &bracket_params.reference);
    }
    if (code < 0 && a->exposures != NULL) {
        *exposures = calloc(frames->count, sizeof **exposures);
        if (*exposures == NULL) {
            cli_error(command, "out of memory");
            return CLI_FAILED;
        }
        bracket_params.exposures = *exposures;
        code = parse_exposures(a->exposures, frames, *exposures);
    }
    return code >= 0 ? code : work(a, frames, &bracket_params, &restore_params, &out);
}

int cli_restore(int argc, char **argv) {
    arguments a = {0};
    cli_paths frames = {0};
    double *exposures = NULL;
    int code = parse(&a, argc, argv);
    if (code < 0) {
        code = run(&a, &frames, &exposures);
    }
    free(exposures);
    cli_paths_free(&frames);
    cli_list_free(&a.frames);
    cli_list_free(&a.outputs);
    return code;
}
