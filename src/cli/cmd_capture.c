/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cmd_capture.c: brace capture: which cameras there are, what they would shoot,
 * shooting it, and checking folders that others shot. The work is in src/capture.
 */
#include "cli/cli.h"

#include <limits.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#include "cli/capture_print.h"
#include "core/core.h"
#include "sim/dataset.h"

enum { FLICKER_MOST = 8 };

typedef struct arguments {
    bool json, quiet;
    int threads;
    const char *camera, *time, *list, *fault, *output;
    cli_list options, flicker;
    double iso, step;
    int frames, repeat, tries;
    bool no_truth, resume, restart, accept;
    double hz[FLICKER_MOST];
    size_t hz_count;
    capture_plan_params plan;
    /* the address */
    const capture_backend *backend;
    const char *port, **all;
    char *fault_option;
} arguments;

#define PLAN_OPTIONS(a)                                                                                                \
    {CLI_HEADING, 0, NULL, NULL, "What to shoot", NULL, 0, 0},                                                         \
        {CLI_TEXT, 0, "time", "T", "exposure time of the reference, default 1/320", &(a).time, 0, 0},                  \
        {CLI_NUMBER, 0, "iso", "ISO", "default: eight times the camera's lowest, for the truth's eighth",              \
         &(a).iso,   1, 1e6},                                                                                          \
        {CLI_INT, 0, "frames", "N", "3 to 9, default 5", &(a).frames, BRACE_BRACKET_MIN, BRACE_BRACKET_MAX},           \
        {CLI_NUMBER, 0, "step", "X", "from frame to frame, default 4 times the time", &(a).step, 1.1, 64},             \
        {CLI_FLAG, 0, "no-truth", NULL, "the bracket alone, without 8 times the time at ISO/8", &(a).no_truth, 0, 0},  \
    {                                                                                                                  \
        CLI_TEXT, 0, "shots", "LIST",                                                                                  \
            "instead: TIME[@ISO],... in order; multiples of the reference's, or\n1/50s and iso800; gt: before the "    \
            "truth, "                                                                                                  \
            "such as\n16,4,1,1/4,1/16,gt:8@1/8 (the default)",                                                         \
            &(a).list, 0, 0                                                                                            \
    }

#define CAMERA_OPTIONS(a)                                                                                              \
    {CLI_HEADING, 0, NULL, NULL, "Camera", NULL, 0, 0},                                                                \
        {CLI_TEXT, 'c', "camera", "NAME[:PORT]", "one of brace capture list", &(a).camera, 0, 0}, {                    \
        CLI_LIST, 0, "option", "NAME=VALUE", "for the camera; brace capture list names them", &(a).options, 0, 0       \
    }

#define COMMON_OPTIONS(a)                                                                                              \
    {CLI_HEADING, 0, NULL, NULL, "General", NULL, 0, 0},                                                               \
        {CLI_FLAG, 0, "json", NULL, "print a JSON object on stdout", &(a).json, 0, 0},                                 \
        {CLI_FLAG, 'q', "quiet", NULL, "only errors", &(a).quiet, 0, 0},                                               \
        {CLI_INT, 't', "threads", "N", "1 to 256, default: one for each CPU", &(a).threads, 1, 256},                   \
        {CLI_HELP, 'h', "help", NULL, "this text", NULL, 0, 0}, {                                                      \
        .kind = CLI_END                                                                                                \
    }

static void arguments_free(arguments *a) {
    cli_list_free(&a->options);
    cli_list_free(&a->flicker);
    core_free(a->all);
    core_free(a->fault_option);
}

/* Ends the report; says what went wrong. */
static int ended(const char *command, cli_report *report, const arguments *a, brace_status status,
                 const brace_error *error) {
    cli_report_flush(report);
    cli_report_end(report);
    if (status == BRACE_OK)
        return CLI_DONE;
    if (a->json)
        cli_json_error(error, command);
    cli_error(command, "%s", error->message);
    return status == BRACE_ERROR_CANCELLED ? cli_signals_exit() : CLI_FAILED;
}

/* ---- what the options say ---- */

static int read_plan(const char *command, arguments *a) {
    a->plan = (capture_plan_params){
        .iso = a->iso, .frames = a->frames, .step = a->step, .no_truth = a->no_truth, .list = a->list};
    if (a->time != NULL && !cli_exposure_parse(a->time, &a->plan.time))
        return cli_wrong_usage(command, "--time %s is no exposure time such as 1/320", a->time);
    if (a->list != NULL && (a->frames != 0 || a->step != 0 || a->no_truth))
        return cli_wrong_usage(command, "--shots says it all: not together with --frames, --step or --no-truth");
    capture_plan trial;
    brace_error error;
    if (capture_plan_create(&trial, &a->plan, NULL, NULL, &error) != BRACE_OK)
        return cli_wrong_usage(command, "%s", error.message);
    for (size_t i = 0; i < a->flicker.count; i++) {
        const char *text = a->flicker.items[i];
        if (a->hz_count == FLICKER_MOST || !cli_number(text, &a->hz[a->hz_count]) || !(a->hz[a->hz_count] >= 1) ||
            !(a->hz[a->hz_count] <= 1e6))
            return cli_wrong_usage(command, "--flicker takes up to %d frequencies from 1 to 1000000 Hz, not '%s'",
                                   FLICKER_MOST, text);
        a->hz_count++;
    }
    return -1;
}

/* --camera and --option, and --fault as the option that it is. */
static int read_camera(const char *command, arguments *a) {
    brace_error error;
    if (a->camera != NULL && capture_backend_find(&a->backend, &a->port, a->camera, &error) != BRACE_OK)
        return cli_wrong_usage(command, "%s", error.message);
    a->all = core_calloc(a->options.count + 1, sizeof *a->all);
    if (a->fault != NULL) {
        a->fault_option = core_alloc(strlen(a->fault) + 7, 1);
        if (a->fault_option != NULL)
            snprintf(a->fault_option, strlen(a->fault) + 7, "fault=%s", a->fault);
    }
    if (a->all == NULL || (a->fault != NULL && a->fault_option == NULL)) {
        cli_error(command, "out of memory");
        return CLI_FAILED;
    }
    for (size_t i = 0; i < a->options.count; i++)
        a->all[i] = a->options.items[i];
    if (a->fault != NULL)
        a->all[a->options.count] = a->fault_option;
    return -1;
}

static capture_address address_of(const arguments *a) {
    return (capture_address){
        .port = a->port, .options = a->all, .option_count = a->options.count + (a->fault != NULL ? 1 : 0)};
}

static int no_operands(const char *command, const cli_list *operands) {
    return operands->count == 0 ? -1 : cli_wrong_usage(command, "'%s': no argument is expected", operands->items[0]);
}

/* ---- list ---- */

typedef struct listing {
    const arguments *a;
    const capture_backend *backend;
    const brace_job *job;
    cli_report *report;
    json_t *cameras; /* NULL: printed */
    size_t count;
} listing;

static void on_found(void *user, const capture_found *found) {
    listing *l = user;
    char camera[256];
    snprintf(camera, sizeof camera, "%s%s%s", l->backend->name, found->port[0] != '\0' ? ":" : "", found->port);
    l->count++;
    capture_address address = {.port = found->port[0] != '\0' ? found->port : NULL};
    if (l->a->backend != NULL)
        address.options = l->a->all, address.option_count = l->a->options.count;
    capture_camera *opened = NULL;
    brace_error error = {BRACE_OK, ""};
    const brace_status status = l->backend->open(&opened, &address, l->job, &error);
    cli_report_flush(l->report);
    if (l->cameras != NULL) {
        json_array_append_new(l->cameras,
                              json_pack("{s:o, s:o, s:o, s:o, s:o}", "camera", cli_json_text(camera), "make",
                                        cli_json_text(found->make), "model", cli_json_text(found->model), "limits",
                                        status == BRACE_OK ? capture_limits_json(&opened->limits) : json_null(),
                                        "problem", status != BRACE_OK ? cli_json_text(error.message) : json_null()));
    } else {
        printf("  --camera %s", camera);
        printf(found->note != NULL ? "   (%s)\n" : "\n", found->note);
        if (status == BRACE_OK)
            capture_print_limits(&opened->limits);
        else
            printf("    %s %s: %s\n", found->make, found->model, error.message);
    }
    l->backend->close(opened, l->job);
}

static void print_options(const capture_backend *backend) {
    for (const char *line = backend->options; line != NULL && *line != '\0';) {
        const size_t n = strcspn(line, "\n");
        printf("    %s %.*s\n", line == backend->options ? "--option" : "        ", (int)n, line);
        line += n + (line[n] == '\n');
    }
}

static int run_list(int argc, char **argv) {
    static const char command[] = "capture list";
    arguments a = {0};
    cli_list operands = {0};
    const cli_option options[] = {CAMERA_OPTIONS(a), COMMON_OPTIONS(a)};
    const cli_usage usage = {command, "[options]",
                             "Shows the kinds of cameras that this program was built with, the devices of each that\n"
                             "are connected, and what they can do.",
                             options,
                             "Examples:\n  brace capture list\n  brace capture list --camera sim:canon_r5 --json\n"};
    int code = cli_parse(&usage, argc, argv, &operands);
    if (code < 0)
        code = no_operands(command, &operands);
    if (code < 0)
        code = read_camera(command, &a);
    if (code < 0) {
        brace_job job;
        cli_report report;
        brace_error error = {BRACE_OK, ""};
        const capture_address address = address_of(&a);
        listing l = {.a = &a, .job = &job, .report = &report, .cameras = a.json ? json_array() : NULL};
        cli_report_begin(&report, &job, command, a.quiet, a.threads);
        brace_status status = BRACE_OK;
        for (size_t i = 0; capture_backends[i] != NULL && status != BRACE_ERROR_CANCELLED; i++) {
            l.backend = capture_backends[i];
            if (a.backend != NULL && a.backend != l.backend)
                continue;
            if (l.cameras == NULL)
                printf("%s: %s\n", l.backend->name, l.backend->description);
            brace_error problem = {BRACE_OK, ""};
            const size_t before = l.count;
            if (a.port != NULL) {
                on_found(&l, &(capture_found){.port = a.port, .make = "", .model = ""});
            } else {
                status = l.backend->list(&address, &job, on_found, &l, &problem);
                cli_report_flush(&report);
                if (status != BRACE_OK && status != BRACE_ERROR_CANCELLED && l.cameras == NULL)
                    printf("  %s\n", problem.message);
                else if (l.count == before && l.cameras == NULL && status == BRACE_OK)
                    printf("  none is connected\n");
                if (status == BRACE_ERROR_CANCELLED)
                    error = problem;
            }
            if (l.cameras == NULL)
                print_options(l.backend);
        }
        code = ended(command, &report, &a, status == BRACE_ERROR_CANCELLED ? status : BRACE_OK, &error);
        if (code == CLI_DONE && l.cameras != NULL)
            code = cli_json_print(json_pack("{s:O}", "cameras", l.cameras), command) ? CLI_DONE : CLI_FAILED;
        else if (code == CLI_DONE)
            code = cli_flush(command) ? CLI_DONE : CLI_FAILED;
        json_decref(l.cameras);
    }
    cli_list_free(&operands);
    arguments_free(&a);
    return code;
}

/* ---- plan ---- */

static int run_plan(int argc, char **argv) {
    static const char command[] = "capture plan";
    arguments a = {0};
    cli_list operands = {0};
    const cli_option options[] = {PLAN_OPTIONS(a),
                                  {CLI_LIST, 0, "flicker", "HZ",
                                   "count the periods of this flicker in each exposure; up to 8 times", &a.flicker, 0,
                                   0},
                                  CAMERA_OPTIONS(a),
                                  COMMON_OPTIONS(a)};
    const cli_usage usage = {command, "[options]",
                             "Shows what would be shot: the longest exposure first, the truth last. With a camera,\n"
                             "its nearest stops; what differs from what was asked for is said.",
                             options,
                             "Examples:\n"
                             "  brace capture plan --time 1/320 --iso 400 --flicker 240\n"
                             "  brace capture plan --camera sim:canon_r5 --frames 7 --step 2\n"
                             "  brace capture plan --shots 1/10s,1/50s,1/200s,gt:1/5s@1/4\n"};
    int code = cli_parse(&usage, argc, argv, &operands);
    if (code < 0)
        code = no_operands(command, &operands);
    if (code < 0)
        code = read_plan(command, &a);
    if (code < 0)
        code = read_camera(command, &a);
    if (code < 0) {
        brace_job job;
        cli_report report;
        brace_error error = {BRACE_OK, ""};
        capture_camera *camera = NULL;
        capture_plan plan;
        capture_limits limits = {0};
        const capture_address address = address_of(&a);
        cli_report_begin(&report, &job, command, a.quiet, a.threads);
        brace_status status = a.backend != NULL ? a.backend->open(&camera, &address, &job, &error) : BRACE_OK;
        if (status == BRACE_OK)
            status = capture_plan_create(&plan, &a.plan, camera != NULL ? &camera->limits : NULL, &job, &error);
        if (camera != NULL) {
            limits = camera->limits;
            a.backend->close(camera, &job);
        }
        code = ended(command, &report, &a, status, &error);
        if (code == CLI_DONE && a.json) {
            code = cli_json_print(capture_plan_json(&plan, &limits, a.hz, a.hz_count), command) ? CLI_DONE : CLI_FAILED;
        } else if (code == CLI_DONE) {
            capture_print_plan(&plan, &limits, a.hz, a.hz_count);
            code = cli_flush(command) ? CLI_DONE : CLI_FAILED;
        }
    }
    cli_list_free(&operands);
    arguments_free(&a);
    return code;
}

/* ---- run ---- */

typedef struct live {
    cli_report *report;
    bool quiet;
} live;

static void on_event(void *user, const capture_event *event) {
    const live *l = user;
    if (l->quiet)
        return;
    cli_report_flush(l->report);
    if (event->message != NULL) {
        fprintf(stderr, "  ! %s\n", event->message);
    } else {
        const capture_step *step = &event->sequence->plan.steps[event->shot->step];
        char t[32];
        fprintf(stderr, "  %-14s %10s  ISO %g%s\n", event->shot->file, capture_time_text(t, step->exposure), step->iso,
                event->shot->tries > 1 ? ", after more than one try" : "");
    }
}

/* One sequence. */
static brace_status shoot(const arguments *a, const char *folder, bool resume, live *l, uint64_t *asked,
                          capture_sequence *out, const brace_job *job, brace_error *error) {
    const capture_run_params params = {.plan = a->plan,
                                       .resume = resume,
                                       .own_plan = a->time != NULL || a->list != NULL || a->iso != 0 ||
                                                   a->frames != 0 || a->step != 0 || a->no_truth,
                                       .restart = a->restart,
                                       .accept = a->accept,
                                       .tries = a->tries,
                                       .event = on_event,
                                       .user = l};
    capture_address address = address_of(a);
    address.shots = *asked;
    brace_status status = capture_run(out, a->backend, &address, folder, &params, job, error);
    *asked += out->counts.asked;
    return status;
}

/* What a failure leaves, and what to do with it. */
static void say_left(const capture_sequence *q, const char *command, bool accept) {
    size_t done = 0;
    for (size_t i = 0; i < q->shot_count; i++)
        done += q->shots[i].done;
    if (done > 0)
        cli_error(command, "%zu of %zu shots are good and stay: go on with --resume, or start over with --restart",
                  done, q->shot_count);
    if (done > 0 && q->counts.pixels > 0 && !accept)
        cli_error(command,
                  "does the screen change (a film, a clock), or light up in rare pulses (a tube, a laser)? --accept "
                  "keeps frames that contradict others");
}

static int shoot_repeats(const char *command, const arguments *a) {
    brace_job job;
    cli_report report;
    brace_error error = {BRACE_OK, ""};
    capture_sequence *q = core_calloc(1, sizeof *q);
    json_t *list = json_array();
    if (q == NULL || list == NULL) {
        core_free(q);
        json_decref(list);
        cli_error(command, "out of memory");
        return CLI_FAILED;
    }
    cli_report_begin(&report, &job, command, a->quiet, a->threads);
    live l = {&report, a->quiet};
    uint64_t asked = 0;
    brace_status status = a->repeat > 1 ? dataset_make_folder(a->output, &error) : BRACE_OK;
    char folder[PATH_MAX];
    for (int i = 1; i <= a->repeat && status == BRACE_OK; i++) {
        const int n = a->repeat > 1 ? snprintf(folder, sizeof folder, "%s/%02d", a->output, i)
                                    : snprintf(folder, sizeof folder, "%s", a->output);
        if (n >= (int)sizeof folder) {
            status = core_fail(&error, BRACE_ERROR_ARGUMENT, "%.200s...: the name is too long", a->output);
            break;
        }
        /* Of several, those that are complete stay, and only one that was interrupted is gone on with. */
        capture_left left = CAPTURE_LEFT_FRAMES;
        if (a->repeat > 1 && (a->resume || a->restart))
            status = capture_left_of(&left, folder, &error);
        if (status != BRACE_OK || left == CAPTURE_LEFT_ALL)
            continue;
        capture_sequence_free(q);
        status = shoot(a, folder, a->resume && left == CAPTURE_LEFT_FRAMES, &l, &asked, q, &job, &error);
        cli_report_flush(&report);
        if (status == BRACE_OK && a->json) {
            json_t *o = capture_sequence_json(q);
            if (o != NULL)
                json_object_set_new(o, "folder", cli_json_text(folder));
            json_array_append_new(list, o);
        } else if (status == BRACE_OK && !a->quiet) {
            capture_print_summary(q, folder);
        }
    }
    /* A signal ends the program in `ended`. */
    if (status == BRACE_ERROR_CANCELLED) {
        cli_report_flush(&report);
        say_left(q, command, a->accept);
    }
    int code = ended(command, &report, a, status, &error);
    if (status != BRACE_OK && status != BRACE_ERROR_CANCELLED)
        say_left(q, command, a->accept);
    if (code == CLI_DONE)
        code = !a->json || cli_json_print(json_pack("{s:O}", "sequences", list), command) ? CLI_DONE : CLI_FAILED;
    if (code == CLI_DONE && !cli_flush(command))
        code = CLI_FAILED;
    capture_sequence_free(q);
    core_free(q);
    json_decref(list);
    return code;
}

static int run_run(int argc, char **argv) {
    static const char command[] = "capture run";
    arguments a = {.repeat = 1};
    cli_list operands = {0};
    const cli_option options[] = {
        {CLI_TEXT, 'o', "output", "DIR", "folder for the sequence; it is there when all is", &a.output, 0, 0},
        CAMERA_OPTIONS(a),
        PLAN_OPTIONS(a),
        {CLI_INT, 'n', "repeat", "N",
         "shoot it N times, into DIR/01, DIR/02, ...; with --resume or\n--restart those that are complete stay", &a.repeat, 1,
         10000},
        {CLI_HEADING, 0, NULL, NULL, "When something goes wrong", NULL, 0, 0},
        {CLI_FLAG, 0, "resume", NULL, "go on with the interrupted sequence", &a.resume, 0, 0},
        {CLI_FLAG, 0, "restart", NULL, "throw it away and start over", &a.restart, 0, 0},
        {CLI_INT, 0, "tries", "N", "of each frame, default 4", &a.tries, 1, 100},
        {CLI_FLAG, 0, "accept", NULL, "after the last try keep a frame whose light contradicts the others", &a.accept,
         0, 0},
        {CLI_TEXT, 0, "fault", "KIND:N[,...]",
         "what the simulated camera does wrong at the N-th release, N-M or N+:\nbusy, drop, disconnect, full, cut, "
         "exif, "
         "iso, shutter, locked,\nsame, black, bump",
         &a.fault, 0, 0},
        COMMON_OPTIONS(a)};
    const cli_usage usage = {command, "-o DIR --camera NAME [options]",
                             "Shoots a bracket with its truth, checks every frame's metadata and light, and shoots\n"
                             "again what is not what was asked for. DIR is there when all of it is: frame_1 (the\n"
                             "shortest) to frame_N, gt (the truth) and sequence.json, for brace restore and\n"
                             "brace dataset import. Ctrl-C, a full disk or a lost cable cost one frame: --resume.",
                             options,
                             "Examples:\n"
                             "  brace capture run -o wall --camera sim --option display=led_wall_3840_16\n"
                             "  brace restore wall -o wall.png\n"
                             "  brace capture run -o wall --camera sim --fault busy:2,same:4,disconnect:5\n"
                             "  brace capture run -o wall --camera sim --resume\n"};
    int code = cli_parse(&usage, argc, argv, &operands);
    if (code < 0)
        code = no_operands(command, &operands);
    if (code < 0 && a.output == NULL)
        code = cli_wrong_usage(command, "say where to put the sequence: -o DIR");
    if (code < 0 && a.camera == NULL)
        code = cli_wrong_usage(command, "which camera? --camera NAME; brace capture list shows them");
    if (code < 0 && a.resume && a.restart)
        code = cli_wrong_usage(command, "either --resume or --restart");
    if (code < 0)
        code = read_plan(command, &a);
    if (code < 0)
        code = read_camera(command, &a);
    if (code < 0 && a.fault != NULL && a.backend != &capture_backend_sim)
        code = cli_wrong_usage(command, "--fault is for the simulated camera");
    if (code < 0)
        code = shoot_repeats(command, &a);
    cli_list_free(&operands);
    arguments_free(&a);
    return code;
}

/* ---- check ---- */

static int run_check(int argc, char **argv) {
    static const char command[] = "capture check";
    arguments a = {0};
    cli_list operands = {0};
    const cli_option options[] = {COMMON_OPTIONS(a)};
    const cli_usage usage = {command, "DIR... [options]",
                             "Looks at folders of RAW files, shot by any app: do the frames belong together, does\n"
                             "their light agree with the exposures that they record, is there a truth, has it\n"
                             "moved, what is clipped? Ends with code 1 if something is wrong.",
                             options, "Example:\n  brace capture check card/DCIM/100\n"};
    int code = cli_parse(&usage, argc, argv, &operands);
    if (code < 0 && operands.count == 0)
        code = cli_wrong_usage(command, "which folder?");
    if (code < 0) {
        brace_job job;
        cli_report report;
        brace_error error = {BRACE_OK, ""};
        json_t *list = a.json ? json_array() : NULL;
        size_t wrong = 0;
        brace_status status = BRACE_OK;
        cli_report_begin(&report, &job, command, a.quiet, a.threads);
        for (size_t i = 0; i < operands.count && status == BRACE_OK; i++) {
            capture_checked checked;
            status = capture_check(&checked, operands.items[i], &job, &error);
            cli_report_flush(&report);
            if (status == BRACE_OK) {
                wrong += checked.problem_count > 0;
                if (list != NULL)
                    json_array_append_new(list, capture_checked_json(&checked, operands.items[i]));
                else if (!a.quiet)
                    capture_print_checked(&checked, operands.items[i]);
            }
            capture_checked_free(&checked);
        }
        code = ended(command, &report, &a, status, &error);
        if (code == CLI_DONE && list != NULL)
            code = cli_json_print(json_pack("{s:O}", "folders", list), command) ? CLI_DONE : CLI_FAILED;
        else if (code == CLI_DONE)
            code = cli_flush(command) ? CLI_DONE : CLI_FAILED;
        code = code == CLI_DONE && wrong > 0 ? CLI_FAILED : code;
        json_decref(list);
    }
    cli_list_free(&operands);
    return code;
}

/* ---- which ---- */

static const struct {
    const char *name, *summary;
    int (*run)(int argc, char **argv);
} actions[] = {
    {"list", "cameras, and what they can do", run_list},
    {"plan", "what would be shot", run_plan},
    {"run", "shoot it, and verify every frame", run_run},
    {"check", "verify a folder that any app shot", run_check},
};
enum { ACTIONS = sizeof actions / sizeof actions[0] };

static int print_help(void) {
    printf("Usage: brace capture ACTION ...\n\nBrackets of RAW exposures, planned, shot and verified.\n\nActions:\n");
    for (int i = 0; i < ACTIONS; i++)
        printf("  %-8s %s\n", actions[i].name, actions[i].summary);
    printf("\nThe help of an action: brace capture run --help\n");
    return cli_flush("capture") ? CLI_DONE : CLI_FAILED;
}

int cli_capture(int argc, char **argv) {
    const char *names[ACTIONS + 1] = {NULL};
    if (argc < 2)
        return cli_wrong_usage("capture", "which action? list, plan, run or check");
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0)
        return print_help();
    for (int i = 0; i < ACTIONS; i++) {
        names[i] = actions[i].name;
        if (strcmp(argv[1], actions[i].name) == 0)
            return actions[i].run(argc - 1, argv + 1);
    }
    const char *close = cli_closest(argv[1], names);
    if (close != NULL)
        return cli_wrong_usage("capture", "there is no action '%s'; did you mean '%s'?", argv[1], close);
    return cli_wrong_usage("capture", "there is no action '%s'", argv[1]);
}
