/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cmd_dataset.c: brace dataset: sets of samples built, packed, verified, looked
 * at, and made of real captures. Each action has its own options; what they do
 * is in src/sim/dataset*.c.
 */
#include "cli/cli.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sim/dataset.h"
#include "train/guides.h"
#include "train/motions.h"

typedef struct common {
    bool json, quiet;
    int threads;
    const char *output;
} common;

#define COMMON_OPTIONS(c)                                                                                              \
    {CLI_FLAG, 0, "json", NULL, "print a JSON object on stdout", &(c).json, 0, 0},                                     \
        {CLI_FLAG, 'q', "quiet", NULL, "only errors", &(c).quiet, 0, 0},                                               \
        {CLI_INT, 't', "threads", "N", "1 to 256, default: one for each CPU", &(c).threads, 1, 256},                   \
        {CLI_HELP, 'h', "help", NULL, "this text", NULL, 0, 0}, {                                                      \
        .kind = CLI_END                                                                                                \
    }

/* Ends the report; says what went wrong. */
static int ended(const char *command, cli_report *report, const common *c, brace_status status,
                 const brace_error *error) {
    cli_report_flush(report);
    cli_report_end(report);
    if (status == BRACE_OK) {
        return CLI_DONE;
    }
    if (c->json) {
        cli_json_error(error, command);
    }
    cli_error(command, "%s", error->message);
    return status == BRACE_ERROR_CANCELLED ? cli_signals_exit() : CLI_FAILED;
}

static int print_json(json_t *object, const char *command) {
    return cli_json_print(object, command) ? CLI_DONE : CLI_FAILED;
}

/* Exactly one folder. */
static int one_folder(const char *command, const cli_list *operands) {
    return operands->count == 1 ? -1
                                : cli_wrong_usage(command, operands->count == 0 ? "which folder?"
                                                                                : "one folder at a time");
}

/* ---- build ---- */

/* "3/8": the third of eight. */
static bool parse_shard(const char *text, uint32_t *shard, uint32_t *shards) {
    unsigned k, n;
    char rest;
    if (sscanf(text, "%u/%u%c", &k, &n, &rest) != 2 || k < 1 || k > n || n > 1000000) {
        return false;
    }
    *shard = k - 1;
    *shards = n;
    return true;
}

/* Under mpirun every process is a shard; nothing is sent between them, so no MPI library is
 * needed: Open MPI, MPICH and Slurm say in the environment who a process is. */
static void shard_from_mpi(uint32_t *shard, uint32_t *shards) {
    static const char *const names[][2] = {{"OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"},
                                           {"PMI_RANK", "PMI_SIZE"},
                                           {"SLURM_PROCID", "SLURM_NTASKS"}};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        const char *rank = getenv(names[i][0]), *size = getenv(names[i][1]);
        double k, n;
        if (rank != NULL && size != NULL && cli_number(rank, &k) && cli_number(size, &n) && k >= 0 && k < n &&
            n <= 1000000) {
            *shard = (uint32_t)k;
            *shards = (uint32_t)n;
            return;
        }
    }
}

static bool parse_seed(const char *text, uint64_t *seed) {
    char *end = NULL;
    errno = 0;
    *seed = strtoull(text, &end, 10);
    return text[0] >= '0' && text[0] <= '9' && *end == '\0' && errno == 0;
}

static int run_build(int argc, char **argv) {
    static const char command[] = "dataset build";
    common c = {0};
    cli_list operands = {0};
    dataset_build_params p = {.seed = 1};
    int train = 1000, test = 100;
    const char *size = NULL, *only = NULL, *shard = NULL, *seed = NULL;
    const cli_option options[] = {
        {CLI_HEADING, 0, NULL, NULL, "Options", NULL, 0, 0},
        {CLI_TEXT, 'o', "output", "FOLDER", "the set; what is there already is kept", &c.output, 0, 0},
        {CLI_TEXT, 0, "screens", "FOLDER", "pictures for the displays to show, default: fourteen\n"
                                           "that ship with BRACE; scripts/screens.sh collects more",
         &p.screens, 0, 0},
        {CLI_TEXT, 0, "priors", "FILE", "displays, cameras and exposures to draw from, JSON", &p.priors, 0, 0},
        {CLI_TEXT, 0, "seed", "N", "default: 1", &seed, 0, 0},
        {CLI_INT, 0, "train", "N", "samples for training, default: 1000", &train, 0, 10000000},
        {CLI_INT, 0, "test", "N", "samples for testing, of other screens, default: 100", &test, 0, 10000000},
        {CLI_TEXT, 0, "size", "WxH", "of the frames, default: 1024x768", &size, 0, 0},
        {CLI_TEXT, 0, "only", "SPLIT", "make the samples of train or of test only", &only, 0, 0},
        {CLI_TEXT, 0, "shard", "K/N", "make the K-th of N parts only", &shard, 0, 0},
        {CLI_FLAG, 0, "field", NULL, "capture the truth, too: 8 times the exposure at ISO/8", &p.field, 0, 0},
        COMMON_OPTIONS(c)};
    const cli_usage usage = {command, "-o SET [options]",
                             "Simulates a set of brackets with their truths from a seed. The same options give\n"
                             "the same bytes, whole, in parts or after an interruption, with any number of\n"
                             "threads. Under mpirun each process makes its share.",
                             options,
                             "Example:\n  brace dataset build -o set/ --screens screens/ --train 1000 --test 100\n"};
    int code = cli_parse(&usage, argc, argv, &operands);
    unsigned w = 0, h = 0;
    char rest;
    if (code < 0 && operands.count > 0) {
        code = cli_wrong_usage(command, "'%s': no argument is expected; the set goes to -o FOLDER", operands.items[0]);
    } else if (code < 0 && c.output == NULL) {
        code = cli_wrong_usage(command, "where to? -o FOLDER");
    } else if (code < 0 && size != NULL && (sscanf(size, "%ux%u%c", &w, &h, &rest) != 2 || w == 0 || h == 0)) {
        code = cli_wrong_usage(command, "--size takes a width and a height, such as 1024x768, not '%s'", size);
    } else if (code < 0 && seed != NULL && !parse_seed(seed, &p.seed)) {
        code = cli_wrong_usage(command, "--seed takes a whole number from 0 to 18446744073709551615, not '%s'", seed);
    } else if (code < 0 && only != NULL && strcmp(only, "train") != 0 && strcmp(only, "test") != 0) {
        code = cli_wrong_usage(command, "--only takes train or test, not '%s'", only);
    } else if (code < 0 && shard != NULL && !parse_shard(shard, &p.shard, &p.shards)) {
        code = cli_wrong_usage(command, "--shard takes a part and their number, such as 1/4 to 4/4, not '%s'", shard);
    }
    if (code < 0) {
        brace_job job;
        cli_report report;
        brace_error error = {0};
        dataset_built done = {0};
        p.width = w;
        p.height = h;
        p.train = (uint32_t)train;
        p.test = (uint32_t)test;
        p.only = only == NULL ? DATASET_BOTH : strcmp(only, "train") == 0 ? DATASET_TRAIN : DATASET_TEST;
        if (shard == NULL) {
            shard_from_mpi(&p.shard, &p.shards);
        }
        cli_report_begin(&report, &job, command, c.quiet, c.threads);
        brace_status status = dataset_build(c.output, &p, &done, &job, &error);
        code = ended(command, &report, &c, status, &error);
        if (code == CLI_DONE && c.json) {
            code = print_json(json_pack("{s:o, s:I, s:I}", "output", cli_json_text(c.output), "made",
                                        (json_int_t)done.made, "there_already", (json_int_t)done.there),
                              command);
        } else if (!c.quiet && !c.json && code == CLI_DONE) {
            fprintf(stderr, "%zu samples made, %zu there already, in %s\n", done.made, done.there, c.output);
        }
    }
    cli_list_free(&operands);
    return code;
}

/* ---- pack ---- */

static int run_pack(int argc, char **argv) {
    static const char command[] = "dataset pack";
    common c = {0};
    cli_list operands = {0};
    double megabytes = 1024;
    const cli_option options[] = {
        {CLI_HEADING, 0, NULL, NULL, "Options", NULL, 0, 0},
        {CLI_TEXT, 'o', "output", "FOLDER", "where the shards go", &c.output, 0, 0},
        {CLI_NUMBER, 0, "shard-size", "MIB", "close a shard at so many MiB of pixels, default: 1024", &megabytes, 1,
         1048576},
        COMMON_OPTIONS(c)};
    const cli_usage usage = {command, "FOLDER -o SHARDS [options]",
                             "Packs the samples of a set into safetensors files (uint16 frames and truths,\n"
                             "metadata as JSON), which training maps into memory, and aligns and merges their\n"
                             "brackets (motions.safetensors, guides.safetensors), which training needs again\n"
                             "and again. The same samples give the same bytes.",
                             options, "Example:\n  brace dataset pack set/ -o shards/\n"};
    int code = cli_parse(&usage, argc, argv, &operands);
    if (code < 0) {
        code = one_folder(command, &operands);
    }
    if (code < 0 && c.output == NULL) {
        code = cli_wrong_usage(command, "where to? -o FOLDER");
    }
    if (code < 0) {
        brace_job job;
        cli_report report;
        brace_error error = {0};
        size_t shards = 0;
        const dataset_pack_params params = {.shard_bytes = (uint64_t)(megabytes * 1048576)};
        cli_report_begin(&report, &job, command, c.quiet, c.threads);
        brace_status status = dataset_pack(operands.items[0], c.output, &params, &job, &shards, &error);
        if (status == BRACE_OK) {
            status = train_motions_make(c.output, &job, &error);
        }
        if (status == BRACE_OK) {
            status = train_guides_make(c.output, &job, &error);
        }
        code = ended(command, &report, &c, status, &error);
        if (code == CLI_DONE && c.json) {
            code = print_json(json_pack("{s:o, s:I}", "output", cli_json_text(c.output), "shards", (json_int_t)shards),
                              command);
        } else if (code == CLI_DONE && !c.quiet) {
            fprintf(stderr, "%zu shard%s in %s\n", shards, shards == 1 ? "" : "s", c.output);
        }
    }
    cli_list_free(&operands);
    return code;
}

/* ---- verify ---- */

typedef struct verify_state {
    cli_report report;
    json_t *problems; /* NULL: printed */
} verify_state;

static void on_problem(void *user, const char *sample, const char *problem) {
    verify_state *s = user;
    cli_report_flush(&s->report);
    if (s->problems != NULL) {
        json_array_append_new(s->problems, json_pack("{s:o, s:o}", "sample", cli_json_text(sample), "problem",
                                                     cli_json_text(problem)));
    } else {
        printf("%s: %s\n", sample, problem);
    }
}

static int run_verify(int argc, char **argv) {
    static const char command[] = "dataset verify";
    common c = {0};
    cli_list operands = {0};
    const cli_option options[] = {{CLI_HEADING, 0, NULL, NULL, "Options", NULL, 0, 0}, COMMON_OPTIONS(c)};
    const cli_usage usage = {command, "FOLDER [options]",
                             "Checks every sample of a set or of its shards: files that are missing, damaged or\n"
                             "changed, numbers out of range, frames that make no bracket, samples that\n"
                             "dataset.json promises and that are not there. Each problem is a line on stdout.\n"
                             "Ends with code 1 if there is any.",
                             options, "Example:\n  brace dataset verify set/\n"};
    int code = cli_parse(&usage, argc, argv, &operands);
    if (code < 0) {
        code = one_folder(command, &operands);
    }
    if (code < 0) {
        brace_job job;
        verify_state s = {.problems = c.json ? json_array() : NULL};
        brace_error error = {0};
        dataset_verified v;
        cli_report_begin(&s.report, &job, command, c.quiet, c.threads);
        brace_status status = dataset_verify(operands.items[0], on_problem, &s, &v, &job, &error);
        code = ended(command, &s.report, &c, status, &error);
        bool good = v.bad + v.missing == 0;
        if (code == CLI_DONE && c.json) {
            code = print_json(json_pack("{s:I, s:I, s:I, s:I, s:O}", "samples", (json_int_t)v.samples, "bad",
                                        (json_int_t)v.bad, "missing", (json_int_t)v.missing, "without_hashes",
                                        (json_int_t)v.unhashed, "problems", s.problems),
                              command);
        } else if (code == CLI_DONE) {
            if (!c.quiet) {
                printf("%zu samples, %zu bad, %zu missing", v.samples, v.bad, v.missing);
                printf(v.unhashed > 0 ? ", %zu without hashes to compare\n" : "\n", v.unhashed);
            }
            code = cli_flush(command) ? CLI_DONE : CLI_FAILED;
        }
        code = code == CLI_DONE && !good ? CLI_FAILED : code;
        json_decref(s.problems);
    }
    cli_list_free(&operands);
    return code;
}

/* ---- info ---- */

static void print_counts(const char *title, json_t *counts, json_int_t total) {
    const char *key;
    json_t *value;
    if (!json_is_object(counts)) {
        return;
    }
    printf("\n%s\n", title);
    json_object_foreach(counts, key, value) {
        json_int_t n = json_integer_value(value);
        int bar = total > 0 ? (int)(40 * n / total) : 0;
        printf("  %-24s %6lld  %.*s\n", key, (long long)n, bar, "########################################");
    }
}

static int run_info(int argc, char **argv) {
    static const char command[] = "dataset info";
    common c = {0};
    cli_list operands = {0};
    const cli_option options[] = {{CLI_HEADING, 0, NULL, NULL, "Options", NULL, 0, 0}, COMMON_OPTIONS(c)};
    const cli_usage usage = {command, "FOLDER [options]",
                             "Counts the samples of a set by split, screen, display, camera and exposure.", options,
                             "Example:\n  brace dataset info set/\n"};
    int code = cli_parse(&usage, argc, argv, &operands);
    if (code < 0) {
        code = one_folder(command, &operands);
    }
    if (code < 0) {
        brace_job job;
        cli_report report;
        brace_error error = {0};
        json_t *info = NULL;
        cli_report_begin(&report, &job, command, c.quiet, c.threads);
        brace_status status = dataset_info(&info, operands.items[0], &job, &error);
        code = ended(command, &report, &c, status, &error);
        if (code == CLI_DONE && c.json) {
            code = print_json(info, command);
        } else if (code == CLI_DONE) {
            json_int_t n = json_integer_value(json_object_get(info, "samples"));
            static const char *const groups[][2] = {{"splits", "Splits"},
                                                    {"categories", "Screens"},
                                                    {"families", "Display families"},
                                                    {"displays", "Displays"},
                                                    {"cameras", "Cameras"},
                                                    {"reference_times", "Exposure time of the reference"},
                                                    {"iso", "ISO"}};
            printf("%lld samples\n", (long long)n);
            for (size_t i = 0; i < sizeof groups / sizeof groups[0]; i++) {
                print_counts(groups[i][1], json_object_get(info, groups[i][0]), n);
            }
            json_decref(info);
            code = cli_flush(command) ? CLI_DONE : CLI_FAILED;
        }
    }
    cli_list_free(&operands);
    return code;
}

/* ---- import ---- */

static void on_import(void *user, const char *source, const char *sample, const char *problem, double displacement) {
    verify_state *s = user;
    cli_report_flush(&s->report);
    if (s->problems != NULL) {
        json_array_append_new(s->problems, json_pack("{s:o, s:o, s:o, s:o}", "source", cli_json_text(source), "sample",
                                                     problem == NULL ? cli_json_text(sample) : json_null(), "rejected",
                                                     problem != NULL ? cli_json_text(problem) : json_null(),
                                                     "displacement", cli_json_number(displacement)));
    } else if (problem != NULL) {
        printf("%s: rejected: %s\n", source, problem);
    } else if (!isfinite(displacement)) {
        printf("%s: taken; too little texture to check how truth and reference lie\n", source);
    } else {
        printf("%s: taken, truth within %.2f pixels\n", source, displacement);
    }
}

static int run_import(int argc, char **argv) {
    static const char command[] = "dataset import";
    common c = {0};
    cli_list operands = {0};
    int reduce = 4;
    double tolerance = 1;
    const cli_option options[] = {
        {CLI_HEADING, 0, NULL, NULL, "Options", NULL, 0, 0},
        {CLI_TEXT, 'o', "output", "FOLDER", "the set that the samples go to", &c.output, 0, 0},
        {CLI_INT, 0, "reduce", "N", "make N x N pixels one, in the Bayer domain, default: 4", &reduce, 1, 8},
        {CLI_NUMBER, 0, "tolerance", "PIXELS", "how far the truth may lie off, after reduction, default: 1",
         &tolerance, 0.01, 16},
        COMMON_OPTIONS(c)};
    const cli_usage usage = {command, "FOLDER... -o SET [options]",
                             "Makes samples of real captures. A capture is a folder of six RAW files: exposure\n"
                             "times of 16, 4, 1, 1/4 and 1/16 of the reference's at one ISO, and the truth of 8\n"
                             "times at an eighth of the ISO. Order and names do not matter. What is rejected is\n"
                             "named with the reason.",
                             options, "Example:\n  brace dataset import card/* -o real/test\n"};
    int code = cli_parse(&usage, argc, argv, &operands);
    if (code < 0 && operands.count == 0) {
        code = cli_wrong_usage(command, "which folders?");
    }
    if (code < 0 && c.output == NULL) {
        code = cli_wrong_usage(command, "where to? -o FOLDER");
    }
    if (code < 0) {
        brace_job job;
        verify_state s = {.problems = c.json ? json_array() : NULL};
        brace_error error = {0};
        dataset_imported done;
        const dataset_import_params params = {.reduce = reduce, .tolerance = tolerance};
        cli_report_begin(&s.report, &job, command, c.quiet, c.threads);
        brace_status status = dataset_import(operands.items, operands.count, c.output, &params, on_import, &s, &done,
                                             &job, &error);
        code = ended(command, &s.report, &c, status, &error);
        if (code == CLI_DONE && c.json) {
            code = print_json(json_pack("{s:I, s:I, s:I, s:O}", "taken", (json_int_t)done.good, "rejected",
                                        (json_int_t)done.rejected, "there_already", (json_int_t)done.there, "captures",
                                        s.problems),
                              command);
        } else if (code == CLI_DONE) {
            if (!c.quiet) {
                printf("%zu taken, %zu rejected, %zu there already\n", done.good, done.rejected, done.there);
            }
            code = cli_flush(command) ? CLI_DONE : CLI_FAILED;
        }
        json_decref(s.problems);
    }
    cli_list_free(&operands);
    return code;
}

/* ---- which ---- */

static const struct {
    const char *name, *summary;
    int (*run)(int argc, char **argv);
} actions[] = {
    {"build", "a set simulated from a seed", run_build},
    {"pack", "samples into safetensors shards for training", run_pack},
    {"verify", "is everything there, unchanged and plausible?", run_verify},
    {"info", "counts by split, display, camera, exposure", run_info},
    {"import", "real captures into a set", run_import},
};
enum { ACTIONS = sizeof actions / sizeof actions[0] };

static int print_help(void) {
    printf("Usage: brace dataset ACTION ...\n\nSets of brackets with their truths, for training and testing.\n\nActions:\n");
    for (int i = 0; i < ACTIONS; i++) {
        printf("  %-8s %s\n", actions[i].name, actions[i].summary);
    }
    printf("\nThe help of an action: brace dataset pack --help\n");
    return cli_flush("dataset") ? CLI_DONE : CLI_FAILED;
}

int cli_dataset(int argc, char **argv) {
    const char *names[ACTIONS + 1] = {NULL};
    if (argc < 2) {
        return cli_wrong_usage("dataset", "which action? build, pack, verify, info or import");
    }
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0) {
        return print_help();
    }
    for (int i = 0; i < ACTIONS; i++) {
        names[i] = actions[i].name;
        if (strcmp(argv[1], actions[i].name) == 0) {
            return actions[i].run(argc - 1, argv + 1);
        }
    }
    const char *close = cli_closest(argv[1], names);
    if (close != NULL) {
        return cli_wrong_usage("dataset", "there is no action '%s'; did you mean '%s'?", argv[1], close);
    }
    return cli_wrong_usage("dataset", "there is no action '%s'", argv[1]);
}
