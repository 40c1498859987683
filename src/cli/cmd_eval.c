/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cmd_eval.c: brace eval: methods compared on the samples of a set, as in the tables of the paper. Each bracket is read
 * once and restored by every method; results are developed with the truth's colours and compared with it.
 */
#include "cli/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "brace/develop.h"

static const char command[] = "eval";

enum {
    SHEET_ROWS = 12,
    SHEET_SIDE = 360,    /* of a picture on the sheet, by default */
    PICTURE_LEAST = 320, /* the smallest side of the report's pictures, */
    PICTURE_MOST = 1024, /* and the largest */
};
static const double budget = 24e6; /* pixels of all of them, some five megabytes as JPEG */

typedef struct arguments {
    const char *data, *methods, *csv, *html, *sheet, *scenes, *weights, *precision;
    bool json, quiet;
    int count, threads, sheet_side;
    double memory;
} arguments;

typedef struct state {
    const arguments *a;
    eval_set set;
    brace_perceptual *perceptual[METRICS];
    uint32_t side; /* of pictures that are kept; 0: none */
    brace_job job, inner; /* `inner`: without progress */
    cli_report report;
    bool failed;
} state;

static int parse(arguments *a, int argc, char **argv) {
    cli_list operands = {0};
    const cli_option options[] = {
        {CLI_HEADING, 0, NULL, NULL, "What is compared", NULL, 0, 0},
        {CLI_TEXT, 'd', "data", "FOLDER",
         "samples: a set that brace dataset made (its test split, if\n"
         "it has one), or folders with frame_1.dng ... and gt.dng",
         &a->data, 0, 0},
        {CLI_TEXT, 'm', "method", "NAME,...",
         "reference, merge, and networks: names of weights that are\n"
         "installed (brace-s, tmrnet-s) or .safetensors files;\n"
         "LABEL=FILE names one in the tables. Default:\n"
         "reference,merge, and brace-s where it is installed",
         &a->methods, 0, 0},
        {CLI_INT, 'n', "count", "N", "so many of the samples, spread evenly; default: all", &a->count, 1, 1000000},
        {CLI_TEXT, 'w', "weights", "FOLDER",
         "the published weights of LPIPS and DISTS; default: the\n"
         "folder that BRACE_WEIGHTS names. Without, they are left out",
         &a->weights, 0, 0},
        {CLI_HEADING, 0, NULL, NULL, "Output", NULL, 0, 0},
        {CLI_TEXT, 0, "csv", "FILE", "write every number, a row for each sample and method", &a->csv, 0, 0},
        {CLI_TEXT, 0, "html", "FILE",
         "write a report to look at in a browser, with pictures.\n"
         "One file that needs no other",
         &a->html, 0, 0},
        {CLI_TEXT, 0, "sheet", "FILE.png",
         "write one picture of many: as shot, each method, the\n"
         "truth, a row for each scene",
         &a->sheet, 0, 0},
        {CLI_TEXT, 0, "scenes", "NAME,...",
         "samples with one of these in their names are shown in sheet\n"
         "and report; default: 12 of all families in turn",
         &a->scenes, 0, 0},
        {CLI_INT, 0, "sheet-side", "N", "width of the sheet's pictures, 64 to 2048; default 360", &a->sheet_side, 64, 2048},
        {CLI_FLAG, 0, "json", NULL, "print a JSON object on stdout instead of the tables", &a->json, 0, 0},
        {CLI_HEADING, 0, NULL, NULL, "General", NULL, 0, 0},
        {CLI_NUMBER, 0, "memory", "MB", "what a network may use, as for brace restore", &a->memory, 1, 1e9},
        {CLI_TEXT, 0, "precision", "f32|bf16", "what networks compute in, as for brace restore", &a->precision, 0, 0},
        {CLI_INT, 't', "threads", "N", "1 to 256, default: one for each CPU", &a->threads, 1, 256},
        {CLI_FLAG, 'q', "quiet", NULL, "no progress bar and no remarks, only results and errors", &a->quiet, 0, 0},
        {CLI_HELP, 'h', "help", NULL, "this text", NULL, 0, 0},
        {.kind = CLI_END},
    };
    const cli_usage usage = {
        command,
        "--data FOLDER [OPTION]...",
        "Restores the brackets of a set by several methods and measures how far each result is\n"
        "from the truth (gt_exact.dng where there is one, else gt.dng): PSNR, SSIM, MS-SWD, SFC\n"
        "along the banding of the shortest frame and its parts, LPIPS and DISTS. Means of the\n"
        "samples with banding, of those without, by family of display and by kind of screen.",
        options,
        "Examples:\n"
        "  brace eval --data set/ --method reference,merge,tmrnet-s,brace-s --html eval.html\n"
        "  brace eval --data set/ --method brace-s,mine=runs/mine/weights.safetensors --count 20\n"
        "  brace eval --data set/ --sheet scenes.png --scenes 000004,000017 --csv eval.csv\n",
    };
    int code = cli_parse(&usage, argc, argv, &operands);
    if (code < 0 && operands.count > 0) {
        code = cli_wrong_usage(command, "what is %s? The samples are named with --data", operands.items[0]);
    }
    if (code < 0 && a->data == NULL) {
        code = cli_wrong_usage(command, "which samples? --data FOLDER");
    }
    if (code < 0 && a->sheet == NULL && a->sheet_side > 0) {
        code = cli_wrong_usage(command, "--sheet-side is for the sheet: name it with --sheet FILE.png");
    }
    if (code < 0 && a->scenes != NULL && a->sheet == NULL && a->html == NULL) {
        code = cli_wrong_usage(command, "--scenes is for --sheet and --html");
    }
    if (code < 0 && a->precision != NULL && strcmp(a->precision, "f32") != 0 && strcmp(a->precision, "bf16") != 0) {
        code = cli_wrong_usage(command, "--precision is f32 or bf16, not '%s'", a->precision);
    }
    cli_list_free(&operands);
    return code;
}

/* ---- one sample ---- */

/* Said, and the rest goes on. False: everything stops. */
static bool go_on(state *s, const eval_sample *sample, const char *what, brace_status status, const brace_error *error) {
    if (status == BRACE_OK) {
        return true;
    }
    cli_report_flush(&s->report);
    if (status == BRACE_ERROR_CANCELLED) {
        return false;
    }
    s->failed = true;
    cli_error(command, "%s: %s%s%s", sample->name, what, what[0] != '\0' ? ": " : "", error->message);
    return true;
}

static brace_status develop(brace_image **out, brace_frame *frame, const brace_frame *truth, const brace_job *job,
                            brace_error *error) {
    const brace_develop_params params = {.sample = BRACE_SAMPLE_U16, .transfer = BRACE_TRANSFER_SRGB};
    memcpy(frame->as_shot_neutral, truth->as_shot_neutral, sizeof frame->as_shot_neutral);
    memcpy(frame->color_matrix, truth->color_matrix, sizeof frame->color_matrix);
    memcpy(frame->illuminant, truth->illuminant, sizeof frame->illuminant);
    return brace_develop(out, frame, &params, job, error);
}

/* A small copy to show. */
static brace_status keep(state *s, eval_sample *sample, size_t index, const brace_image *picture, brace_error *error) {
    if (!sample->shown || s->side == 0 || !eval_has_picture(&s->set, index)) {
        return BRACE_OK;
    }
    const uint32_t longest = picture->width > picture->height ? picture->width : picture->height;
    const double scale = longest > s->side ? (double)s->side / longest : 1;
    brace_image *small = NULL;
    brace_status status = brace_image_resize(&small, picture, (uint32_t)fmax(1, round(picture->width * scale)),
                                             (uint32_t)fmax(1, round(picture->height * scale)), error);
    if (status == BRACE_OK) {
        status = brace_image_convert(&sample->picture[index], small, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, error);
    }
    brace_image_destroy(small);
    return status;
}

typedef struct loaded {
    brace_bracket *bracket;
    brace_frame *truth;
    brace_image *picture;  /* of the truth */
    double direction;      /* of the banding */
} loaded;

static brace_status load(state *s, eval_sample *sample, loaded *out, brace_error *error) {
    dataset_loaded files;
    brace_status status = dataset_load(&files, sample->folder, &s->inner, error);
    if (status != BRACE_OK) {
        return status;
    }
    status = brace_bracket_create(&out->bracket, files.frames, files.count, NULL, &s->inner, error);
    if (status == BRACE_OK) {
        files.count = 0; /* the bracket has them */
        brace_frame **truth = files.exact != NULL ? &files.exact : &files.truth;
        out->truth = *truth;
        *truth = NULL;
    }
    dataset_loaded_free(&files);
    brace_fabp fabp;
    if (status == BRACE_OK) {
        status = develop(&out->picture, out->truth, out->truth, &s->inner, error);
    }
    if (status == BRACE_OK) {
        status = brace_fabp_frame(&fabp, out->bracket->frames[0], NULL, &s->inner, error);
    }
    if (status == BRACE_OK) {
        out->direction = brace_fabp_direction(&fabp, out->bracket->frames[0]->orientation);
        status = keep(s, sample, s->set.methods + 1, out->picture, error);
    }
    return status;
}

/* PSNR of the frame as it was shot, which every method is to beat. */
static brace_status measure_reference(state *s, eval_sample *sample, const loaded *in, brace_error *error) {
    brace_frame *copy = NULL;
    brace_image *picture = NULL;
    brace_status status = brace_frame_clone(&copy, in->bracket->frames[in->bracket->reference], error);
    if (status == BRACE_OK) {
        status = develop(&picture, copy, in->truth, &s->inner, error);
    }
    if (status == BRACE_OK) {
        status = brace_psnr(&sample->reference_psnr, picture, in->picture, &s->inner, error);
    }
    if (status == BRACE_OK) {
        status = keep(s, sample, 0, picture, error);
    }
    brace_image_destroy(picture);
    brace_frame_destroy(copy);
    return status;
}

static brace_status one_method(state *s, eval_sample *sample, size_t index, const loaded *in, brace_error *error) {
    eval_method *method = &s->set.method[index];
    eval_result *r = &sample->result[index];
    const char *precision = s->a->precision;
    const brace_restore_params params = {
        .method = method->method, .model = method->model, .memory = (uint64_t)(s->a->memory * 1e6),
        .precision = precision == NULL ? BRACE_PRECISION_DEFAULT
                     : precision[0] == 'f' ? BRACE_PRECISION_F32 : BRACE_PRECISION_BF16};
    brace_restored *restored = NULL;
    brace_image *picture[2] = {NULL, in->picture};
    const double start = core_seconds();
    brace_status status = brace_restore(&restored, in->bracket, &params, &s->inner, error);
    r->seconds = core_seconds() - start;
    if (status == BRACE_OK) {
        method->merged += restored->report.method != method->method;
        status = develop(&picture[0], restored->frame, in->truth, &s->inner, error);
    }
    for (metric m = 0; m < METRICS && status == BRACE_OK; m++) {
        if (s->set.wanted[m]) {
            status = metrics_measure(&r->measured, m, s->perceptual[m], picture, in->direction, &s->inner, error);
        }
    }
    if (status == BRACE_OK) {
        status = keep(s, sample, index + 1, picture[0], error);
    } else {
        for (metric m = 0; m < METRICS; m++) {
            r->measured.value[m] = NAN;
        }
    }
    brace_image_destroy(picture[0]);
    brace_restored_destroy(restored);
    return status;
}

static bool one_sample(state *s, size_t index) {
    eval_sample *sample = &s->set.items[index];
    brace_error error = {0};
    loaded in = {NULL, NULL, NULL, NAN};
    const uint64_t methods = s->set.methods, total = s->set.count * methods;
    core_progress(&s->job, "evaluating", index * methods, total);
    brace_status status = load(s, sample, &in, &error);
    if (status == BRACE_OK) {
        status = measure_reference(s, sample, &in, &error);
    }
    sample->done = status == BRACE_OK;
    bool good = go_on(s, sample, "", status, &error);
    for (size_t m = 0; m < methods && good && sample->done; m++) {
        core_progress(&s->job, "evaluating", index * methods + m, total);
        good = go_on(s, sample, s->set.method[m].label, one_method(s, sample, m, &in, &error), &error);
    }
    brace_bracket_destroy(in.bracket);
    brace_frame_destroy(in.truth);
    brace_image_destroy(in.picture);
    return good;
}

/* ---- all ---- */

/* LPIPS and DISTS, where their weights are. */
static bool load_perceptual(state *s) {
    static const metric kinds[] = {LPIPS_ALEX, DISTS};
    const char *variable = getenv("BRACE_WEIGHTS");
    if (s->a->weights == NULL && (variable == NULL || variable[0] == '\0')) {
        return true;
    }
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
        const metric m = kinds[i];
        brace_error error = {0};
        const brace_status status = brace_perceptual_load(
            &s->perceptual[m], (brace_perceptual_kind)metric_kinds[m].perceptual, s->a->weights, &error);
        s->set.wanted[m] = status == BRACE_OK;
        if (status == BRACE_ERROR_IO) {
            core_note(&s->job, "left out: %.900s", error.message);
        } else if (status != BRACE_OK) {
            cli_report_flush(&s->report);
            cli_error(command, "%s", error.message);
            return false;
        }
    }
    return true;
}

/* Weights that are wrong are found before an hour of work. */
static bool check_models(state *s) {
    for (size_t m = 0; m < s->set.methods; m++) {
        brace_error error = {0};
        if (s->set.method[m].method == BRACE_METHOD_NETWORK &&
            brace_model_check(s->set.method[m].model, &error) != BRACE_OK) {
            cli_report_flush(&s->report);
            cli_error(command, "%s", error.message);
            return false;
        }
    }
    return true;
}

/* Which samples keep pictures, and how large these are. */
static bool choose_shown(state *s) {
    eval_set *set = &s->set;
    if (s->a->sheet == NULL && s->a->html == NULL) {
        return true;
    }
    if (s->a->scenes != NULL && !eval_choose_named(set, s->a->scenes, command)) {
        return false;
    }
    if (s->a->scenes == NULL) {
        eval_choose(set, SHEET_ROWS);
    }
    size_t pictures = 0;
    for (size_t i = 0; i < set->count; i++) {
        pictures += set->items[i].shown ? set->methods + 2 : 0;
    }
    /* As if pictures were 4:3. */
    const double fits = sqrt(budget / (double)(pictures > 0 ? pictures : 1) * 4 / 3);
    const double html = s->a->html != NULL ? fmax(PICTURE_LEAST, fmin(PICTURE_MOST, fits)) : 0;
    const double sheet = s->a->sheet == NULL ? 0 : s->a->sheet_side > 0 ? s->a->sheet_side : SHEET_SIDE;
    s->side = (uint32_t)fmax(html, sheet);
    return true;
}

/* Finds out before the work that files can be written. -1 to go on. */
static int check_outputs(const state *s) {
    outputs out = {0};
    const cli_paths inputs = {0};
    const char *const paths[] = {s->a->csv, s->a->html, s->a->sheet};
    for (size_t i = 0; i < sizeof paths / sizeof *paths; i++) {
        if (paths[i] != NULL) {
            out.items[out.count++].path = paths[i];
        }
    }
    const char *dot = s->a->sheet != NULL ? strrchr(s->a->sheet, '.') : NULL;
    if (s->a->sheet != NULL && (dot == NULL || strcasecmp(dot, ".png") != 0)) {
        return cli_wrong_usage(command, "--sheet makes a PNG: %s does not end in .png", s->a->sheet);
    }
    if (outputs_use_stdout(&out)) {
        return cli_wrong_usage(command, "a file and the numbers can't both go to standard output");
    }
    return outputs_check(&out, &inputs, command);
}

static int stopped(void) {
    cli_error(command, "stopped");
    return cli_signals_exit();
}

static int show(state *s) {
    brace_error error = {0};
    int code = s->failed ? CLI_FAILED : CLI_DONE;
    const char *const paths[] = {s->a->csv, s->a->html, s->a->sheet};
    for (size_t i = 0; i < 3; i++) {
        const uint32_t side = s->a->sheet_side > 0 ? (uint32_t)s->a->sheet_side : SHEET_SIDE;
        const brace_status status = paths[i] == NULL ? BRACE_OK
                                    : i == 0 ? eval_csv(&s->set, paths[i], &error)
                                    : i == 1 ? report_eval(&s->set, paths[i], &s->report, &s->inner, &error)
                                             : eval_sheet(&s->set, paths[i], side, &s->inner, &error);
        if (status == BRACE_ERROR_CANCELLED) {
            return stopped();
        }
        if (status != BRACE_OK) {
            cli_error(command, "%s", error.message);
            code = CLI_FAILED;
        }
    }
    if (s->a->json) {
        return cli_json_print(eval_json(&s->set, &s->report), command) ? code : CLI_FAILED;
    }
    eval_print(&s->set);
    return cli_flush(command) ? code : CLI_FAILED;
}

static int run(state *s) {
    const arguments *a = s->a;
    eval_set *set = &s->set;
    brace_error error = {0};
    const char *methods = a->methods;
    if (methods == NULL) {
        methods = brace_model_check("brace-s", NULL) == BRACE_OK ? "reference,merge,brace-s" : "reference,merge";
    }
    int code = eval_methods_parse(set, methods, command);
    code = code < 0 ? check_outputs(s) : code;
    if (code >= 0) {
        return code;
    }
    set->wanted[PSNR] = set->wanted[SSIM] = set->wanted[MS_SWD] = set->wanted[SFC] = true;
    brace_status status = BRACE_OK;
    if (!check_models(s) || !load_perceptual(s)) {
        return CLI_FAILED;
    }
    status = eval_set_read(set, a->data, (size_t)a->count, &s->job, &error);
    cli_report_flush(&s->report);
    if (status != BRACE_OK) {
        cli_error(command, "%s", error.message);
        if (a->json) {
            cli_json_error(&error, command);
        }
        return CLI_FAILED;
    }
    if (!choose_shown(s)) {
        return CLI_FAILED;
    }
    size_t done = 0;
    for (size_t i = 0; i < set->count; i++) {
        if (!one_sample(s, i)) {
            return stopped();
        }
        done += set->items[i].done;
    }
    core_progress(&s->job, "evaluating", set->count * set->methods, set->count * set->methods);
    for (size_t m = 0; m < set->methods; m++) {
        if (set->method[m].merged > 0) {
            core_note(&s->job, "%s: %zu of the samples were merged instead", set->method[m].label, set->method[m].merged);
        }
    }
    cli_report_flush(&s->report);
    if (done == 0) {
        cli_error(command, "%s: none of the samples could be measured", a->data);
        return CLI_FAILED;
    }
    return show(s);
}

int cli_eval(int argc, char **argv) {
    arguments a = {0};
    int code = parse(&a, argc, argv);
    if (code < 0) {
        state *s = core_calloc(1, sizeof *s);
        if (s == NULL) {
            cli_error(command, "out of memory");
            return CLI_FAILED;
        }
        s->a = &a;
        cli_report_begin(&s->report, &s->job, command, a.quiet, a.threads);
        s->inner = s->job;
        s->inner.progress = NULL;
        code = run(s);
        cli_report_end(&s->report);
        for (metric m = 0; m < METRICS; m++) {
            brace_perceptual_destroy(s->perceptual[m]);
        }
        eval_set_free(&s->set);
        core_free(s);
    }
    return code;
}
