/* SPDX-License-Identifier: Apache-2.0 */
/*
 * eval.h: what `brace eval` compares: methods on the samples of a set. eval_set.c knows the samples, their groups and
 * means over them; eval_table.c prints; eval_sheet.c makes a picture of pictures; report_eval.c the report;
 * cmd_eval.c does the work.
 */
#ifndef CLI_EVAL_H
#define CLI_EVAL_H

#include "cli/metrics_table.h"
#include "sim/dataset.h"

enum { EVAL_METHODS = 16 };

typedef struct eval_method {
    char label[64]; /* in tables */
    char *model;    /* a name or a file; NULL: none */
    brace_method method;
    size_t merged; /* samples that the network could not take */
} eval_method;

typedef struct eval_result {
    result measured; /* all NaN: it failed */
    double seconds;  /* that the restoration took */
} eval_result;

typedef struct eval_sample {
    char *folder, *name;
    char family[48], category[48]; /* of the display, from meta.json; of the screen, from the name */
    bool steady;                   /* the display does not flicker: the control */
    bool done;                     /* it was read and the reference frame measured */
    double reference_psnr;         /* of the reference frame */
    eval_result result[EVAL_METHODS];
    /* Small pictures to show: the reference frame, each method's, the truth. NULL: not shown. */
    brace_image *picture[EVAL_METHODS + 2];
    bool shown;
} eval_sample;

typedef struct eval_set {
    const char *folder;
    eval_sample *items;
    size_t count;
    eval_method method[EVAL_METHODS];
    size_t methods;
    bool wanted[METRICS];
} eval_set;

/* ---- eval_set.c ---- */

/* The samples of a folder: those of the test split where there is one; of them `most` (0: all), spread evenly. */
brace_status eval_set_read(eval_set *out, const char *folder, size_t most, const brace_job *job, brace_error *error);
void eval_set_free(eval_set *set);

/* "reference,merge,NAME,FILE,LABEL=FILE": -1 to go on, or the exit code. */
int eval_methods_parse(eval_set *set, const char *text, const char *command);

/* Samples to show: `most` of them, all families in turn. */
void eval_choose(eval_set *set, size_t most);
/* The same by name, or by part of it: "000012,web". False, said, if one fits none. */
bool eval_choose_named(eval_set *set, const char *names, const char *command);

/* Whether picture `index` of the samples has something of its own to show: 0 is the frame as shot, which is what the
 * method `reference` gives, then the methods from 1, the truth. */
bool eval_has_picture(const eval_set *set, size_t index);

typedef enum eval_kind { EVAL_BANDED, EVAL_STEADY, EVAL_FAMILY, EVAL_CATEGORY } eval_kind;
typedef struct eval_group {
    eval_kind kind;
    const char *name; /* of a family or category of banded samples; else NULL */
    size_t count;     /* of samples that were measured */
} eval_group;

/* Groups that have samples, banded first, names in order: at most `room`. Returns their number. */
enum { EVAL_GROUPS = 64 };
size_t eval_groups(const eval_set *set, eval_group *out, size_t room);
/* "banded", "steady", "family led_wall (12)" */
const char *eval_group_text(char *text, size_t size, const eval_group *group);

typedef struct eval_mean {
    double mean[METRICS], deviation[METRICS]; /* PSNR of equal pictures counts as 100 dB; NaN: not measured */
    double parts[SFC_PARTS], parts_deviation[SFC_PARTS]; /* of SFC; NaN: not measured */
    size_t count, worse; /* measured; of lower PSNR than the reference frame */
    double seconds;      /* NaN: none was measured */
} eval_mean;
eval_mean eval_mean_of(const eval_set *set, const eval_group *group, size_t method);

/* ---- eval_table.c ---- */

void eval_print(const eval_set *set);
json_t *eval_json(const eval_set *set, const cli_report *report);
brace_status eval_csv(const eval_set *set, const char *path, brace_error *error);

/* ---- eval_sheet.c ---- */

/* A row for each sample that is shown: as shot, each method, the truth. */
brace_status eval_sheet(const eval_set *set, const char *path, uint32_t side, const brace_job *job, brace_error *error);

#endif
