/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cmd_metrics.c: brace metrics: how far pictures are from the truth, one row a
 * picture, with mean and deviation.
 */
#include "cli/report.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "core/core.h"

static const char command[] = "metrics";

typedef struct arguments {
    cli_list operands, bracket;
    const char *metrics, *weights, *csv, *html;
    bool json, quiet;
    int threads, html_side;
    bool wanted[METRICS];
    bool chosen; /* by --metrics, and not the default */
} arguments;

/* ---- arguments ---- */

static int parse_metrics(arguments *a) {
    if (a->metrics == NULL) {
        a->wanted[PSNR] = a->wanted[SSIM] = a->wanted[MS_SWD] = a->wanted[LPIPS_ALEX] = a->wanted[DISTS] = true;
        a->wanted[SFC] = a->bracket.count > 0;
        return -1;
    }
    char *copy = strdup(a->metrics), *rest = copy, *word;
    int code = -1;
    if (copy == NULL) {
        cli_error(command, "out of memory");
        return CLI_FAILED;
    }
    a->chosen = true;
    while (code < 0 && (word = strsep(&rest, ",")) != NULL) {
        int m = 0;
        while (m < METRICS && strcmp(word, metric_kinds[m].name) != 0 &&
               !(m == LPIPS_ALEX && strcmp(word, "lpips") == 0)) {
            m++;
        }
        if (m == METRICS) {
            const char *names[METRICS + 1] = {NULL};
            for (int i = 0; i < METRICS; i++) {
                names[i] = metric_kinds[i].name;
            }
            const char *close = cli_closest(word, names);
            code = close != NULL
                       ? cli_wrong_usage(command, "--metrics: there is no '%s'; did you mean %s?", word, close)
                       : cli_wrong_usage(command, "--metrics: there is no '%s'", word);
        } else {
            a->wanted[m] = true;
        }
    }
    free(copy);
    if (code < 0 && a->wanted[SFC] && a->bracket.count == 0) {
        code = cli_wrong_usage(command,
                               "SFC looks along the banding of the shortest frame: give the frames with --bracket");
    }
    return code;
}

static int parse(arguments *a, int argc, char **argv) {
    const cli_option options[] = {
        {CLI_HEADING, 0, NULL, NULL, "What is measured", NULL, 0, 0},
        {CLI_TEXT, 'm', "metrics", "NAME,NAME",
         "psnr, ssim, ms-swd, sfc, lpips (-alex, -vgg, -squeeze),\n"
         "dists; default: all for which there is what they need,\n"
         "LPIPS with AlexNet",
         &a->metrics, 0, 0},
        {CLI_LIST, 'b', "bracket", "FRAME...",
         "the RAW frames PRED was restored from, or their folder:\n"
         "for SFC, whose direction is that of the banding in the\n"
         "shortest one. For two folders, a folder that holds a\n"
         "folder of frames, or the shortest frame, for each name",
         &a->bracket, 0, 0},
        {CLI_TEXT, 'w', "weights", "FOLDER",
         "where the published weights of LPIPS and DISTS are;\n"
         "default: the folder that BRACE_WEIGHTS names",
         &a->weights, 0, 0},
        {CLI_HEADING, 0, NULL, NULL, "Output", NULL, 0, 0},
        {CLI_TEXT, 0, "csv", "FILE", "write the table as comma-separated values", &a->csv, 0, 0},
        {CLI_TEXT, 0, "html", "FILE",
         "write a report to look at in a browser: the table, and\n"
         "the pictures to compare. One file that needs no other",
         &a->html, 0, 0},
        {CLI_INT, 0, "html-side", "N",
         "longest side of its pictures, 64 to 8192 pixels; default\n"
         "2048, less for many pairs, to keep the file small",
         &a->html_side, 64, 8192},
        {CLI_FLAG, 0, "json", NULL, "print a JSON object on stdout instead of the table", &a->json, 0, 0},
        {CLI_HEADING, 0, NULL, NULL, "General", NULL, 0, 0},
        {CLI_INT, 't', "threads", "N", "1 to 256, default: one for each CPU", &a->threads, 1, 256},
        {CLI_FLAG, 'q', "quiet", NULL, "no progress bar and no remarks, only results and errors", &a->quiet, 0, 0},
        {CLI_HELP, 'h', "help", NULL, "this text", NULL, 0, 0},
        {.kind = CLI_END},
    };
    const cli_usage usage = {
        command,
        "PRED GT [OPTION]...",
        "Measures how far a restored picture PRED is from the ground truth GT: PNG, TIFF, JPEG,\n"
        "WebP or RAW. Two folders: every picture of the one with the picture of the same name\n"
        "(but for the extension) in the other. All are compared as sRGB-encoded values from 0\n"
        "to 1; RAW files are developed as brace restore does it, both with GT's colours.\n"
        "PSNR and SSIM: higher is better. All others: 0 is best.",
        options,
        "Examples:\n"
        "  brace metrics restored.png truth.png\n"
        "  brace metrics restored.dng gt.dng --bracket frame_*.dng\n"
        "  brace metrics results/ truth/ --bracket brackets/ --csv scores.csv --html scores.html\n"
        "  brace metrics a.png b.png --metrics lpips,dists --weights ~/weights\n",
    };
    int code = cli_parse(&usage, argc, argv, &a->operands);
    if (code < 0 && a->operands.count < 2) {
        code = cli_wrong_usage(command, "which pictures? brace metrics PRED GT");
    }
    if (code < 0 && a->html == NULL && a->html_side > 0) {
        code = cli_wrong_usage(command, "--html-side is for the report: name it with --html FILE");
    }
    if (code < 0 && a->operands.count > 2 && a->bracket.count == 0) {
        code = cli_wrong_usage(command, "two pictures are compared, or the pictures of two folders; what is %s?",
                               a->operands.items[2]);
    }
    /* --bracket frame_*.dng: the shell makes several words of it, of which the option takes the first. */
    for (size_t i = 2; code < 0 && i < a->operands.count; i++) {
        if (!cli_list_add(&a->bracket, a->operands.items[i])) {
            cli_error(command, "out of memory");
            code = CLI_FAILED;
        }
    }
    return code < 0 ? parse_metrics(a) : code;
}

/* ---- pictures ---- */

static brace_status develop(brace_image **out, const brace_frame *frame, const brace_job *job, brace_error *error) {
    const brace_develop_params params = {.sample = BRACE_SAMPLE_U16, .transfer = BRACE_TRANSFER_SRGB};
    return brace_develop(out, frame, &params, job, error);
}

brace_status metrics_read_pair(brace_image *picture[2], const cli_pair *pair, const brace_job *job, brace_error *error) {
    const char *const path[2] = {pair->pred, pair->gt};
    brace_frame *frame[2] = {NULL, NULL};
    brace_status status = BRACE_OK;
    picture[0] = picture[1] = NULL;
    for (int k = 0; k < 2 && status == BRACE_OK; k++) {
        status = cli_is_raw_name(path[k]) ? brace_frame_read(&frame[k], path[k], job, error)
                                          : brace_image_read(&picture[k], path[k], job, error);
    }
    if (status == BRACE_OK && frame[0] != NULL && frame[1] != NULL) {
        memcpy(frame[0]->as_shot_neutral, frame[1]->as_shot_neutral, sizeof frame[0]->as_shot_neutral);
        memcpy(frame[0]->color_matrix, frame[1]->color_matrix, sizeof frame[0]->color_matrix);
        memcpy(frame[0]->illuminant, frame[1]->illuminant, sizeof frame[0]->illuminant);
    }
    for (int k = 0; k < 2 && status == BRACE_OK; k++) {
        if (frame[k] != NULL) {
            status = develop(&picture[k], frame[k], job, error);
        }
    }
    brace_frame_destroy(frame[0]);
    brace_frame_destroy(frame[1]);
    if (status == BRACE_OK && (picture[0]->width != picture[1]->width || picture[0]->height != picture[1]->height)) {
        status = BRACE_ERROR_MISMATCH;
        error->status = status;
        snprintf(error->message, sizeof error->message, "%.400s has %u x %u pixels, %.400s %u x %u", pair->pred,
                 picture[0]->width, picture[0]->height, pair->gt, picture[1]->width, picture[1]->height);
    }
    return status;
}

/* Direction of the banding in the frame of shortest exposure among the files. */
static brace_status banding_direction(double *direction, const cli_paths *files, const brace_job *job,
                                      brace_error *error) {
    double shortest = INFINITY;
    brace_frame *found = NULL;
    brace_status status = BRACE_OK;
    for (size_t i = 0; i < files->count && status == BRACE_OK; i++) {
        brace_frame *frame = NULL;
        status = brace_frame_read(&frame, files->items[i], job, error);
        if (status == BRACE_OK && files->count > 1 && !(frame->exposure_time > 0)) {
            status = error->status = BRACE_ERROR_FORMAT;
            snprintf(error->message, sizeof error->message,
                     "%.400s does not say how long it was exposed; give the shortest frame alone", files->items[i]);
        }
        if (status == BRACE_OK && (found == NULL || frame->exposure_time < shortest)) {
            shortest = frame->exposure_time;
            brace_frame_destroy(found);
            found = frame;
            frame = NULL;
        }
        brace_frame_destroy(frame);
    }
    brace_fabp fabp;
    if (status == BRACE_OK) {
        status = brace_fabp_frame(&fabp, found, NULL, job, error);
    }
    if (status == BRACE_OK) {
        *direction = brace_fabp_direction(&fabp, found->orientation);
    }
    brace_frame_destroy(found);
    return status;
}

/* ---- the work ---- */

typedef struct state {
    const arguments *a;
    metrics_table table;
    brace_perceptual *perceptual[METRICS];
    brace_job job, quiet; /* `quiet`: without progress, for steps of one pair among many */
    cli_report report;
    bool failed;
} state;

/* A failure of one picture or metric: said, and the rest goes on. False: everything stops. */
static bool go_on(state *s, const char *name, const char *what, brace_status status, const brace_error *error) {
    if (status == BRACE_OK) {
        return true;
    }
    cli_report_flush(&s->report);
    if (status == BRACE_ERROR_CANCELLED) {
        return false;
    }
    s->failed = true;
    cli_error(command, "%s: %s%s%s", name, what, what[0] != '\0' ? ": " : "", error->message);
    return true;
}

brace_status metrics_measure(result *r, metric m, const brace_perceptual *perceptual, brace_image *const picture[2],
                             double direction, const brace_job *job, brace_error *error) {
    brace_status status = BRACE_OK;
    double value = NAN;
    switch (m) {
    case PSNR:
        status = brace_psnr(&value, picture[0], picture[1], job, error);
        break;
    case SSIM:
        status = brace_ssim(&value, picture[0], picture[1], job, error);
        break;
    case MS_SWD:
        status = brace_ms_swd(&value, picture[0], picture[1], NULL, job, error);
        break;
    case SFC:
        status = brace_sfc_image(&r->sfc, picture[0], picture[1], direction, NULL, job, error);
        value = status == BRACE_OK ? r->sfc.sfc : NAN;
        break;
    default:
        status = brace_perceptual_distance(&value, perceptual, picture[0], picture[1], job, error);
    }
    r->value[m] = status == BRACE_OK ? value : NAN;
    return status;
}

/* The frames that belong to a pair. */
static bool bracket_of(state *s, const cli_pair *pair, bool folders, cli_paths *files) {
    const cli_list *given = &s->a->bracket;
    if (!folders) {
        return cli_paths_expand(files, given, NULL, command);
    }
    char *found = cli_pairs_find_in(given->items[0], pair->name, command);
    const char *item = found;
    cli_list one = {&item, 1};
    bool good = found != NULL && cli_paths_expand(files, &one, NULL, command);
    free(found);
    return good;
}

static bool one_pair(state *s, size_t index, bool folders) {
    const cli_pair *pair = &s->table.pairs.items[index];
    const brace_job *job = s->table.pairs.count == 1 ? &s->job : &s->quiet;
    result *r = &s->table.results[index];
    brace_error error = {0};
    brace_image *picture[2];
    double direction = NAN;
    brace_status status = metrics_read_pair(picture, pair, job, &error);
    bool good = go_on(s, pair->name, "", status, &error);
    if (status == BRACE_OK && s->table.wanted[SFC]) {
        cli_paths files = {0};
        cli_report_flush(&s->report);
        if (!bracket_of(s, pair, folders, &files)) {
            s->failed = true;
        } else {
            good = go_on(s, pair->name, "SFC", banding_direction(&direction, &files, job, &error), &error);
        }
        cli_paths_free(&files);
    }
    for (metric m = 0; m < METRICS && good && status == BRACE_OK; m++) {
        if (s->table.wanted[m] && !(m == SFC && isnan(direction))) {
            good =
                go_on(s, pair->name, metric_kinds[m].head,
                      metrics_measure(r, m, s->perceptual[m], picture, direction, job, &error), &error);
        }
    }
    brace_image_destroy(picture[0]);
    brace_image_destroy(picture[1]);
    return good;
}

/* Weights for what was asked for; by default, for what they are there. */
static bool load_weights(state *s) {
    const char *variable = getenv("BRACE_WEIGHTS");
    const bool given = s->a->weights != NULL || (variable != NULL && variable[0] != '\0');
    if (!s->a->chosen && !given) {
        s->table.wanted[LPIPS_ALEX] = s->table.wanted[DISTS] = false;
        s->job.note(s->job.user, "LPIPS and DISTS are left out: their weights are not part of BRACE; "
                                 "--metrics lpips,dists says what to download");
        return true;
    }
    for (metric m = 0; m < METRICS; m++) {
        brace_error error = {0};
        if (!s->table.wanted[m] || metric_kinds[m].perceptual < 0) {
            continue;
        }
        brace_status status = brace_perceptual_load(
            &s->perceptual[m], (brace_perceptual_kind)metric_kinds[m].perceptual, s->a->weights, &error);
        if (status == BRACE_ERROR_IO && !s->a->chosen) {
            char text[BRACE_ERROR_LENGTH + 32];
            snprintf(text, sizeof text, "left out: %s", error.message);
            s->job.note(s->job.user, text);
            s->table.wanted[m] = false;
        } else if (status != BRACE_OK) {
            cli_report_flush(&s->report);
            cli_error(command, "%s", error.message);
            if (s->a->json) {
                cli_json_error(&error, command);
            }
            return false;
        }
    }
    return true;
}

/* ---- all pairs ---- */

/* Finds out before the work that report and table can be written, and overwrite no picture. -1 to go on. */
static int check_outputs(const state *s) {
    const cli_pairs *pairs = &s->table.pairs;
    outputs out = {0};
    cli_paths inputs = {calloc(2 * pairs->count, sizeof *inputs.items), 2 * pairs->count};
    if (inputs.items == NULL) {
        cli_error(command, "out of memory");
        return CLI_FAILED;
    }
    for (size_t i = 0; i < pairs->count; i++) {
        inputs.items[2 * i] = pairs->items[i].pred;
        inputs.items[2 * i + 1] = pairs->items[i].gt;
    }
    if (s->a->html != NULL) {
        out.items[out.count++].path = s->a->html;
    }
    int code = outputs_use_stdout(&out)
                   ? cli_wrong_usage(command, "the report and the numbers can't both go to standard output")
                   : -1;
    if (s->a->csv != NULL) {
        out.items[out.count++].path = s->a->csv;
    }
    code = code < 0 ? outputs_check(&out, &inputs, command) : code;
    free(inputs.items);
    return code;
}

static int show(state *s) {
    brace_error error = {0};
    int code = s->failed ? CLI_FAILED : CLI_DONE;
    if (s->a->csv != NULL && metrics_table_csv(&s->table, s->a->csv, &error) != BRACE_OK) {
        cli_error(command, "%s", error.message);
        code = CLI_FAILED;
    }
    if (s->a->html != NULL) {
        brace_status status = report_metrics(&s->table, s->a->html, s->a->html_side, &s->report, &s->job, &error);
        cli_report_flush(&s->report);
        if (status == BRACE_ERROR_CANCELLED) {
            cli_error(command, "stopped");
            return cli_signals_exit();
        }
        if (status != BRACE_OK) {
            cli_error(command, "%s", error.message);
            code = CLI_FAILED;
        }
    }
    if (s->a->json) {
        return cli_json_print(metrics_table_json(&s->table, &s->report), command) ? code : CLI_FAILED;
    }
    metrics_table_print(&s->table);
    return cli_flush(command) ? code : CLI_FAILED;
}

static int run(state *s) {
    struct stat info;
    const char *pred = s->a->operands.items[0], *gt = s->a->operands.items[1];
    const bool folders = stat(pred, &info) == 0 && S_ISDIR(info.st_mode);
    if (!cli_pairs_find(&s->table.pairs, pred, gt, command)) {
        return CLI_FAILED;
    }
    int code = check_outputs(s);
    if (code >= 0) {
        return code;
    }
    if (folders && s->table.wanted[SFC] && s->a->bracket.count > 1) {
        return cli_wrong_usage(command,
                               "with two folders, --bracket is one folder that holds the frames of each picture");
    }
    for (size_t i = 0; i < s->table.pairs.unmatched.count; i++) {
        char text[BRACE_ERROR_LENGTH];
        snprintf(text, sizeof text, "%.900s has no partner of the same name", s->table.pairs.unmatched.items[i]);
        s->job.note(s->job.user, text);
    }
    if (!load_weights(s)) {
        return CLI_FAILED;
    }
    s->table.results = calloc(s->table.pairs.count, sizeof *s->table.results);
    if (s->table.results == NULL) {
        cli_error(command, "out of memory");
        return CLI_FAILED;
    }
    for (size_t i = 0; i < s->table.pairs.count; i++) {
        for (metric m = 0; m < METRICS; m++) {
            s->table.results[i].value[m] = NAN;
        }
    }
    for (size_t i = 0; i < s->table.pairs.count; i++) {
        if (s->table.pairs.count > 1) {
            core_progress(&s->job, "compare", i, s->table.pairs.count);
        }
        if (!one_pair(s, i, folders)) {
            cli_error(command, "stopped");
            return cli_signals_exit();
        }
    }
    if (s->table.pairs.count > 1) {
        core_progress(&s->job, "compare", s->table.pairs.count, s->table.pairs.count);
    }
    cli_report_flush(&s->report);
    return show(s);
}

int cli_metrics(int argc, char **argv) {
    arguments a = {0};
    int code = parse(&a, argc, argv);
    if (code < 0) {
        state s = {.a = &a};
        memcpy(s.table.wanted, a.wanted, sizeof s.table.wanted);
        cli_report_begin(&s.report, &s.job, command, a.quiet, a.threads);
        s.quiet = s.job;
        s.quiet.progress = NULL;
        code = run(&s);
        cli_report_end(&s.report);
        for (metric m = 0; m < METRICS; m++) {
            brace_perceptual_destroy(s.perceptual[m]);
        }
        free(s.table.results);
        cli_pairs_free(&s.table.pairs);
    }
    cli_list_free(&a.operands);
    cli_list_free(&a.bracket);
    return code;
}
