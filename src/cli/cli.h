/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cli.h: what the files of the `brace` program share. Options are parsed from a
 * table (options.c), paths are checked before any work starts (paths.c), numbers
 * are put the way photographers write them (text.c).
 */
#ifndef CLI_CLI_H
#define CLI_CLI_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#include <jansson.h>

#include "brace/brace.h"

/* Exit codes: done, failed, wrong usage; 130 (128 + SIGINT and so on) when stopped by a signal. */
enum { CLI_DONE = 0, CLI_FAILED = 1, CLI_USAGE = 2 };

/* ---- main.c ---- */

typedef struct cli_command {
    const char *name;
    const char *summary;               /* one line for `brace --help` */
    int (*run)(int argc, char **argv); /* argv[0] is the command's name */
} cli_command;

int cli_restore(int argc, char **argv);
int cli_analyze(int argc, char **argv);
int cli_info(int argc, char **argv);
int cli_metrics(int argc, char **argv);
int cli_simulate(int argc, char **argv);
int cli_capture(int argc, char **argv);
int cli_dataset(int argc, char **argv);
int cli_train(int argc, char **argv);
int cli_model(int argc, char **argv);
int cli_eval(int argc, char **argv);
int cli_bench(int argc, char **argv);

/* "brace: COMMAND: sentence" on stderr. */
void cli_error(const char *command, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Flushes stdout. True, or false with the reason on stderr: what was printed did not arrive. */
bool cli_flush(const char *command);

/* ---- options.c ---- */

typedef struct cli_list {
    const char **items; /* point into argv */
    size_t count;
} cli_list;

typedef enum cli_kind {
    CLI_END = 0,
    CLI_FLAG,   /* bool *: set to true */
    CLI_HELP,   /* prints the help and ends with code 0 */
    CLI_TEXT,   /* const char **: the last one given counts */
    CLI_LIST,   /* cli_list *: may be given several times */
    CLI_INT,    /* int *, low to high */
    CLI_NUMBER, /* double *, low to high */
    CLI_HEADING /* a line in the help, `help` holds it */
} cli_kind;

typedef struct cli_option {
    cli_kind kind;
    char letter;          /* 0: no short form */
    const char *name;     /* without the two dashes */
    const char *argument; /* what to call its value in the help */
    const char *help;     /* lines separated by \n */
    void *target;
    double low, high;
} cli_option;

typedef struct cli_usage {
    const char *command;
    const char *synopsis; /* after "brace COMMAND" */
    const char *about;
    const cli_option *options; /* ends with CLI_END */
    const char *epilogue;      /* examples; may be NULL */
} cli_usage;

/* Parses argv[1..]; what is no option goes to `operands`. Returns -1 to go on,
 * otherwise the exit code (after help, or an error with its hint). The lists
 * are freed with cli_list_free, also after an error. */
int cli_parse(const cli_usage *usage, int argc, char **argv, cli_list *operands);
void cli_list_free(cli_list *list);
bool cli_list_add(cli_list *list, const char *item);

/* "brace: COMMAND: sentence" and the hint at --help; returns CLI_USAGE. */
int cli_wrong_usage(const char *command, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* The word of `words` (ends with NULL) closest to `word`, NULL when none is close. */
const char *cli_closest(const char *word, const char *const *words);

/* Decimal number, all of `text`, locale-free in practice (the program sets none). */
bool cli_number(const char *text, double *value);

/* ---- paths.c ---- */

typedef struct cli_paths {
    char **items;
    size_t count;
} cli_paths;

/* The files that the arguments name: files as they are, of a folder the RAW
 * files in it sorted by name (but for those in `except`, NULL-terminated or
 * NULL). Refuses what does not exist and what is given twice, with a sentence. */
bool cli_paths_expand(cli_paths *out, const cli_list *arguments, const cli_list *except, const char *command);
void cli_paths_free(cli_paths *paths);

/* Takes the truths of samples and of sequences (gt.dng, gt_exact.dng) out of a list of a bracket's frames, if at least
 * `least` others stay. True if there was one; `name` is told. */
bool cli_paths_leave_truth(cli_paths *paths, size_t least, char *name, size_t size);

/* The folder that a file's name puts it into, "." if it says none; to be freed; NULL when memory ends. */
char *cli_folder_of(const char *path);

/* Whether two names lead to the same file, whether it exists yet or not. */
bool cli_same_file(const char *a, const char *b);

/* Whether a file's name ends like those of RAW files. */
bool cli_is_raw_name(const char *name);

/* The part after the last slash. */
const char *cli_basename(const char *path);

/* ---- text.c ---- */

/* "1/640 s", "0.4 s", "2 s", "?" for 0. */
const char *cli_exposure_text(char *buffer, size_t size, double seconds);

/* Seconds from "1/60", "0.5", "2s" or "1/60s"; false if it is none or not positive. */
bool cli_exposure_parse(const char *text, double *seconds);

/* ---- report.c: what a job's callbacks do ---- */

typedef struct cli_report {
    const char *command;
    bool quiet;
    struct core_bar *bar;
    char **notes; /* each once, also when quiet: --json lists them */
    size_t note_count;
} cli_report;

/* Fills a job that reports to `report` and stops on SIGINT, SIGTERM and SIGHUP. */
void cli_report_begin(cli_report *report, brace_job *job, const char *command, bool quiet, int threads);

/* Takes the bar off the screen: call before printing anything else. */
void cli_report_flush(cli_report *report);
void cli_report_end(cli_report *report);

/* ---- signals.c ---- */

/* From here on the first SIGINT, SIGTERM or SIGHUP sets the flag returned, the
 * second removes unfinished files and ends the program. */
const volatile int *cli_signals_install(void);

/* After a call ended with BRACE_ERROR_CANCELLED: ends the program as the signal
 * would have, so that shells and scripts see it; 1 if there was none. */
int cli_signals_exit(void);

/* ---- JSON ---- */

/* Prints one object and frees it; false (said on stderr) if that failed. */
bool cli_json_print(json_t *object, const char *command);

/* {"error": {"status": ..., "message": ...}} */
void cli_json_error(const brace_error *error, const char *command);

json_t *cli_json_number(double value);   /* null for NaN and infinities */
json_t *cli_json_text(const char *text); /* bytes that are not UTF-8 become '?' */

#endif
