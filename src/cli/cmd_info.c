/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cmd_info.c: brace info: what RAW files say about themselves, and whether they
 * make a bracket. Frames are read one at a time and their pixels kept only
 * while there are few enough to be a bracket.
 */
#include "cli/cli.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/core.h"

static const char command[] = "info";

/* What is shown of a frame: its fields without its pixels. */
typedef struct row {
    const char *path;
    brace_frame f;   /* data, path and tags are NULL */
    double exposure; /* time * ISO / f^2, 0 if unknown */
    double ev;       /* relative to the middle frame; NAN if unknown */
} row;

typedef struct verdict {
    bool asked, good;
    char problem[BRACE_ERROR_LENGTH];
    size_t reference;                   /* index as given */
    double measured[BRACE_BRACKET_MAX]; /* by index as given */
} verdict;

/* ---- exposure ---- */

static int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void fill_ev(row *rows, size_t count) {
    double *known = calloc(count + 1, sizeof *known);
    size_t n = 0;
    for (size_t i = 0; i < count; i++) {
        const brace_frame *f = &rows[i].f;
        if (f->exposure_time > 0) {
            rows[i].exposure =
                f->exposure_time * (f->iso > 0 ? f->iso : 100) / (f->f_number > 0 ? f->f_number * f->f_number : 1);
            if (known != NULL) {
                known[n++] = rows[i].exposure;
            }
        }
        rows[i].ev = NAN;
    }
    if (n > 0) {
        qsort(known, n, sizeof *known, by_value);
        double middle = known[(n - 1) / 2]; /* as the bracket: the shorter of the middle two */
        for (size_t i = 0; i < count; i++) {
            rows[i].ev = rows[i].exposure > 0 ? log2(rows[i].exposure / middle) : NAN;
        }
    }
    free(known);
}

/* ---- words ---- */

static const char *illuminant_name(unsigned code) {
    switch (code) { /* EXIF 2.32, LightSource */
    case 0:
        return "none";
    case 1:
        return "daylight";
    case 2:
        return "fluorescent";
    case 3:
        return "tungsten";
    case 4:
        return "flash";
    case 9:
        return "fine weather";
    case 10:
        return "cloudy";
    case 11:
        return "shade";
    case 17:
        return "A";
    case 18:
        return "B";
    case 19:
        return "C";
    case 20:
        return "D55";
    case 21:
        return "D65";
    case 22:
        return "D75";
    case 23:
        return "D50";
    case 24:
        return "ISO studio tungsten";
    default:
        return "other";
    }
}

static const char *orientation_name(int orientation) {
    static const char *const names[] = {"unknown",
                                        "as stored",
                                        "mirrored",
                                        "turned 180 degrees",
                                        "upside down, mirrored",
                                        "mirrored, turned 90 degrees counter-clockwise",
                                        "turned 90 degrees clockwise",
                                        "mirrored, turned 90 degrees clockwise",
                                        "turned 90 degrees counter-clockwise"};
    return orientation >= 1 && orientation <= 8 ? names[orientation] : names[0];
}

static void camera_name(const brace_frame *f, char *out, size_t size) {
    size_t make = strlen(f->make);
    /* "NIKON CORPORATION NIKON D850", "Canon Canon EOS R5": say it once. */
    if (make > 0 && strncmp(f->make, f->model, make) == 0) {
        snprintf(out, size, "%s", f->model);
    } else if (make == 0 && f->model[0] == '\0') {
        snprintf(out, size, "unknown camera");
    } else {
        snprintf(out, size, "%s%s%s", f->make, make > 0 && f->model[0] != '\0' ? " " : "", f->model);
    }
}

static void black_text(const brace_frame *f, char *out, size_t size) {
    if (f->black[0] == f->black[1] && f->black[0] == f->black[2] && f->black[0] == f->black[3]) {
        snprintf(out, size, "%g", (double)f->black[0]);
    } else {
        snprintf(out, size, "%g %g %g %g", (double)f->black[0], (double)f->black[1], (double)f->black[2],
                 (double)f->black[3]);
    }
}

/* "400", "?" for what the file does not say. */
static const char *number_text(char *out, size_t size, int digits, double value) {
    if (value > 0) {
        snprintf(out, size, "%.*g", digits, value);
    } else {
        snprintf(out, size, "?");
    }
    return out;
}

/* ---- tables ---- */

static void print_one(const row *r) {
    const brace_frame *f = &r->f;
    char camera[160], black[96], buffer[64];
    camera_name(f, camera, sizeof camera);
    black_text(f, black, sizeof black);
    printf("%s\n", r->path);
    printf("  camera         %s\n", camera);
    printf("  size           %u x %u, %s\n", f->width, f->height, brace_cfa_name(f->cfa));
    printf("  black, white   %s, %g\n", black, (double)f->white);
    printf("  exposure time  %s\n", cli_exposure_text(buffer, sizeof buffer, f->exposure_time));
    printf("  ISO            %s\n", number_text(buffer, sizeof buffer, 7, f->iso));
    printf("  aperture       f/%s\n", number_text(buffer, sizeof buffer, 3, f->f_number));
    printf("  focal length   %s mm\n", number_text(buffer, sizeof buffer, 3, f->focal_length));
    if (f->baseline_exposure != 0) {
        printf("  baseline       %+.2f EV\n", f->baseline_exposure);
    }
    printf("  neutral        %.4f %.4f %.4f\n", f->as_shot_neutral[0], f->as_shot_neutral[1], f->as_shot_neutral[2]);
    for (int m = 0; m < 2; m++) {
        if (f->illuminant[m] == 0) {
            continue;
        }
        for (int i = 0; i < 3; i++) {
            const double *v = f->color_matrix[m] + 3 * i;
            if (i == 0) {
                printf("  matrix %d (%-3s) ", m + 1, illuminant_name(f->illuminant[m]));
            } else {
                printf("                 ");
            }
            printf("%8.4f %8.4f %8.4f\n", v[0], v[1], v[2]);
        }
    }
    if (f->illuminant[0] == 0 && f->illuminant[1] == 0) {
        printf("  matrix         none: colours are shown as the camera has them\n");
    }
    printf("  noise          S %.3g %.3g %.3g, O %.3g %.3g %.3g%s\n", f->noise[0][0], f->noise[1][0], f->noise[2][0],
           f->noise[0][1], f->noise[1][1], f->noise[2][1], f->has_noise ? "" : " (estimated from the ISO)");
    printf("  orientation    %d, %s\n", f->orientation, orientation_name(f->orientation));
    printf("  taken          %s%s%s\n", f->datetime[0] != '\0' ? f->datetime : "?", f->subsec[0] != '\0' ? "." : "",
           f->subsec);
}

static bool same_camera(const row *rows, size_t count) {
    for (size_t i = 1; i < count; i++) {
        const brace_frame *a = &rows[0].f, *b = &rows[i].f;
        if (strcmp(a->make, b->make) != 0 || strcmp(a->model, b->model) != 0 || a->width != b->width ||
            a->height != b->height || a->cfa != b->cfa || a->white != b->white ||
            memcmp(a->black, b->black, sizeof a->black) != 0) {
            return false;
        }
    }
    return true;
}

static void print_table(const row *rows, size_t count) {
    bool same = same_camera(rows, count);
    int width = 5;
    for (size_t i = 0; i < count; i++) {
        int n = (int)strlen(cli_basename(rows[i].path));
        width = n > width ? n : width;
    }
    char camera[160], black[96];
    if (same) {
        const brace_frame *f = &rows[0].f;
        camera_name(f, camera, sizeof camera);
        black_text(f, black, sizeof black);
        printf("%s, %u x %u, %s, black %s, white %g\n", camera, f->width, f->height, brace_cfa_name(f->cfa), black,
               (double)f->white);
        printf("neutral %.4f %.4f %.4f, matrix for %s%s%s\n\n", f->as_shot_neutral[0], f->as_shot_neutral[1],
               f->as_shot_neutral[2], illuminant_name(f->illuminant[0]), f->illuminant[1] != 0 ? " and " : "",
               f->illuminant[1] != 0 ? illuminant_name(f->illuminant[1]) : "");
    }
    printf("%-*s  %10s  %6s  %5s  %6s  %-*s%s\n", width, "frame", "time", "ISO", "f/", "EV", same ? 5 : 23, "taken",
           same ? "" : "  camera, size, CFA, black, white");
    for (size_t i = 0; i < count; i++) {
        const brace_frame *f = &rows[i].f;
        char time[32], iso[16], aperture[16], ev[16] = "?", taken[64];
        if (isfinite(rows[i].ev)) {
            snprintf(ev, sizeof ev, "%+.2f", rows[i].ev);
        }
        snprintf(taken, sizeof taken, "%s%s%s", f->datetime[0] != '\0' ? f->datetime : "?",
                 f->subsec[0] != '\0' ? "." : "", f->subsec);
        printf("%-*s  %10s  %6s  %5s  %6s  %-*s", width, cli_basename(rows[i].path),
               cli_exposure_text(time, sizeof time, f->exposure_time), number_text(iso, sizeof iso, 7, f->iso),
               number_text(aperture, sizeof aperture, 3, f->f_number), ev, same ? 0 : 23, taken);
        if (!same) {
            camera_name(f, camera, sizeof camera);
            black_text(f, black, sizeof black);
            printf("  %s, %u x %u, %s, %s, %g", camera, f->width, f->height, brace_cfa_name(f->cfa), black,
                   (double)f->white);
        }
        putchar('\n');
    }
}

static void print_verdict(const row *rows, size_t count, const verdict *v) {
    if (!v->asked) {
        return;
    }
    if (!v->good) {
        printf("\nNo bracket: %s\n", v->problem);
        return;
    }
    printf("\nA bracket of %zu frames; reference %s\n", count, cli_basename(rows[v->reference].path));
    for (size_t i = 0; i < count; i++) {
        double by_pixels = log2(v->measured[i]), by_tags = rows[i].ev - rows[v->reference].ev;
        /* The library's own limit for doubting the metadata is half a stop. */
        if (isfinite(by_pixels) && isfinite(by_tags) && fabs(by_pixels - by_tags) > 0.5) {
            printf("%s: the pixels say %+.1f EV, the metadata %+.1f\n", cli_basename(rows[i].path), by_pixels, by_tags);
        }
    }
}

/* ---- JSON ---- */

static json_t *numbers_json(const double *values, size_t count) {
    json_t *array = json_array();
    for (size_t i = 0; i < count; i++) {
        json_array_append_new(array, cli_json_number(values[i]));
    }
    return array;
}

static json_t *known_json(double value) {
    return value > 0 ? cli_json_number(value) : json_null();
}

static json_t *row_json(const row *r) {
    const brace_frame *f = &r->f;
    double black[4] = {(double)f->black[0], (double)f->black[1], (double)f->black[2], (double)f->black[3]};
    json_t *matrices = json_array(), *noise = json_array();
    for (int m = 0; m < 2; m++) {
        if (f->illuminant[m] != 0) {
            json_array_append_new(matrices, json_pack("{s:i, s:s, s:o}", "illuminant", (int)f->illuminant[m], "name",
                                                      illuminant_name(f->illuminant[m]), "matrix",
                                                      numbers_json(f->color_matrix[m], 9)));
        }
    }
    for (int c = 0; c < 3; c++) {
        json_array_append_new(noise, numbers_json(f->noise[c], 2));
    }
    json_t *object =
        json_pack("{s:o, s:o, s:o, s:o, s:i, s:i, s:s, s:o, s:f, s:o, s:o, s:o, s:o, s:o}", "path",
                  cli_json_text(r->path), "make", cli_json_text(f->make), "model", cli_json_text(f->model),
                  "unique_model", cli_json_text(f->unique_model), "width", (int)f->width, "height", (int)f->height,
                  "cfa", brace_cfa_name(f->cfa), "black", numbers_json(black, 4), "white", (double)f->white,
                  "exposure_time", known_json(f->exposure_time), "iso", known_json(f->iso), "f_number",
                  known_json(f->f_number), "focal_length", known_json(f->focal_length), "ev", cli_json_number(r->ev));
    json_t *more = json_pack("{s:f, s:o, s:o, s:o, s:b, s:i, s:o, s:o}", "baseline_exposure", f->baseline_exposure,
                             "as_shot_neutral", numbers_json(f->as_shot_neutral, 3), "color_matrices", matrices,
                             "noise", noise, "noise_recorded", (int)f->has_noise, "orientation", f->orientation,
                             "datetime", cli_json_text(f->datetime), "subsec", cli_json_text(f->subsec));
    if (object != NULL && more != NULL) {
        json_object_update(object, more);
    }
    json_decref(more);
    return object;
}

static json_t *verdict_json(const row *rows, size_t count, const verdict *v) {
    if (!v->asked) {
        return json_null();
    }
    if (!v->good) {
        return json_pack("{s:b, s:o}", "complete", 0, "problem", cli_json_text(v->problem));
    }
    return json_pack("{s:b, s:o, s:i, s:o}", "complete", 1, "reference", cli_json_text(rows[v->reference].path),
                     "reference_index", (int)v->reference, "measured", numbers_json(v->measured, count));
}

/* ---- the work ---- */

typedef struct state {
    row *rows;
    size_t count;
    brace_frame *frames[BRACE_BRACKET_MAX]; /* with pixels, while they may be a bracket */
    size_t frame_count;
    verdict verdict;
} state;

static void take(state *s, const char *path, brace_frame *frame, bool keep) {
    row *r = &s->rows[s->count++];
    r->path = path;
    r->f = *frame;
    r->f.data = NULL;
    r->f.path = NULL;
    r->f.tags = NULL;
    if (keep) {
        s->frames[s->frame_count++] = frame;
    } else {
        brace_frame_destroy(frame);
    }
}

/* Whether the frames make a bracket. False: it was interrupted, or memory ended, before that was known. */
static bool judge(state *s, const brace_job *job) {
    verdict *v = &s->verdict;
    brace_bracket *bracket = NULL;
    brace_error error = {0};
    brace_status status = brace_bracket_create(&bracket, s->frames, s->frame_count, NULL, job, &error);
    if (core_gave_up(status)) {
        cli_error(command, "%s", error.message);
        return false;
    }
    v->asked = true;
    if (status != BRACE_OK) {
        snprintf(v->problem, sizeof v->problem, "%s", error.message);
        return true;
    }
    v->good = true;
    v->reference = bracket->order[bracket->reference];
    for (size_t i = 0; i < bracket->count; i++) {
        v->measured[bracket->order[i]] = bracket->measured[i];
    }
    s->frame_count = 0; /* they are the bracket's now */
    brace_bracket_destroy(bracket);
    return true;
}

static int show(const state *s, bool json) {
    if (json) {
        json_t *frames = json_array();
        for (size_t i = 0; i < s->count; i++) {
            json_array_append_new(frames, row_json(&s->rows[i]));
        }
        json_t *object = json_pack("{s:s, s:o, s:o}", "version", brace_version(), "frames", frames, "bracket",
                                   verdict_json(s->rows, s->count, &s->verdict));
        return cli_json_print(object, command) ? CLI_DONE : CLI_FAILED;
    }
    if (s->count == 1) {
        print_one(&s->rows[0]);
    } else if (s->count > 1) {
        print_table(s->rows, s->count);
        print_verdict(s->rows, s->count, &s->verdict);
    }
    return cli_flush(command) ? CLI_DONE : CLI_FAILED;
}

static int work(state *s, const cli_paths *paths, bool json, bool quiet, int threads) {
    brace_job job;
    cli_report report;
    brace_error error = {0};
    bool failed = false, cancelled = false;
    bool keep = paths->count >= BRACE_BRACKET_MIN && paths->count <= BRACE_BRACKET_MAX;

    cli_report_begin(&report, &job, command, quiet, threads);
    job.progress = NULL; /* a file takes less than a second */
    for (size_t i = 0; i < paths->count && !cancelled; i++) {
        brace_frame *frame = NULL;
        brace_status status = brace_frame_read(&frame, paths->items[i], &job, &error);
        if (status == BRACE_OK) {
            take(s, paths->items[i], frame, keep);
        } else {
            cli_report_flush(&report);
            cli_error(command, "%s", error.message);
            failed = true;
            cancelled = status == BRACE_ERROR_CANCELLED;
        }
    }
    if (keep && !failed && !judge(s, &job)) {
        failed = true;
        cancelled = *job.cancel;
    }
    fill_ev(s->rows, s->count);
    cli_report_flush(&report);
    int code = cancelled ? cli_signals_exit() : show(s, json);
    cli_report_end(&report);
    return code == CLI_DONE && failed ? CLI_FAILED : code;
}

int cli_info(int argc, char **argv) {
    cli_list arguments = {0};
    bool json = false, quiet = false;
    int threads = 0;
    const cli_option options[] = {
        {CLI_HEADING, 0, NULL, NULL, "Options", NULL, 0, 0},
        {CLI_FLAG, 0, "json", NULL, "print a JSON object on stdout", &json, 0, 0},
        {CLI_FLAG, 'q', "quiet", NULL, "no notes, only errors", &quiet, 0, 0},
        {CLI_INT, 't', "threads", "N", "1 to 256, default: one for each CPU", &threads, 1, 256},
        {CLI_HELP, 'h', "help", NULL, "this text", NULL, 0, 0},
        {.kind = CLI_END},
    };
    const cli_usage usage = {command, "FRAME... [OPTION]...",
                             "Shows what RAW files say about themselves: camera, size, levels, exposure, colour,\n"
                             "noise. Of 3 to 9 files it also says whether they make a bracket, and where the\n"
                             "pixels contradict the metadata. A folder stands for the RAW files in it.",
                             options, "Example:\n  brace info frame_*.dng\n"};
    int code = cli_parse(&usage, argc, argv, &arguments);
    if (code < 0 && arguments.count == 0) {
        code = cli_wrong_usage(command, "which files? brace info FRAME...");
    }
    cli_paths paths = {0};
    state s = {0};
    if (code < 0 && !cli_paths_expand(&paths, &arguments, NULL, command)) {
        code = CLI_FAILED;
    }
    if (code < 0) {
        s.rows = calloc(paths.count, sizeof *s.rows);
        if (s.rows == NULL) {
            cli_error(command, "out of memory");
            code = CLI_FAILED;
        } else {
            code = work(&s, &paths, json, quiet, threads);
        }
    }
    for (size_t i = 0; i < s.frame_count; i++) {
        brace_frame_destroy(s.frames[i]);
    }
    free(s.rows);
    cli_paths_free(&paths);
    cli_list_free(&arguments);
    return code;
}
