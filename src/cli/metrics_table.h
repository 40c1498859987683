/* SPDX-License-Identifier: Apache-2.0 */
/*
 * metrics_table.h: what `brace metrics` measured, as a table, as JSON and as CSV.
 */
#ifndef CLI_METRICS_TABLE_H
#define CLI_METRICS_TABLE_H

#include "cli/pairs.h"

typedef enum metric { PSNR, SSIM, MS_SWD, LPIPS_ALEX, LPIPS_VGG, LPIPS_SQUEEZE, DISTS, SFC, METRICS } metric;

typedef struct metric_kind {
    const char *name, *head; /* as given and in JSON; in the table */
    int digits;
    int perceptual; /* brace_perceptual_kind, or -1 */
} metric_kind;

extern const metric_kind metric_kinds[METRICS];

typedef struct result {
    double value[METRICS]; /* NAN: not measured; psnr may be infinite */
    brace_sfc sfc;
} result;

typedef struct metrics_table {
    bool wanted[METRICS];
    cli_pairs pairs;
    result *results; /* one a pair */
} metrics_table;

/* Mean and deviation (of the population) of what was measured; infinite if one of them is. */
void metrics_table_summary(const metrics_table *t, metric m, double *mean, double *deviation, size_t *count);

/* Both pictures of a pair, of one size; two RAW files with the same colours (cmd_metrics.c). After an error, too, what
 * was read is to be destroyed. */
brace_status metrics_read_pair(brace_image *picture[2], const cli_pair *pair, const brace_job *job, brace_error *error);

/* One metric of two pictures of one size; `perceptual` for those that need it, `direction` for SFC. The value is NaN after
 * an error (cmd_metrics.c). */
brace_status metrics_measure(result *r, metric m, const brace_perceptual *perceptual, brace_image *const picture[2],
                             double direction, const brace_job *job, brace_error *error);

/* The parts of SFC: |D_ratio|, |D_profile|, and both signed. */
enum { SFC_PARTS = 4 };
extern const char *const metrics_sfc_names[SFC_PARTS], *const metrics_sfc_heads[SFC_PARTS]; /* in files; in tables */
void metrics_sfc_parts(double parts[SFC_PARTS], const brace_sfc *sfc);
/* Their mean and deviation over a set; NaN for an empty one: no parts are not perfect ones. */
void metrics_sfc_summary(double mean[SFC_PARTS], double deviation[SFC_PARTS], const brace_sfc *items, size_t count);

/* RFC 4180: quoted where a comma, a quote or a new line is in it. */
void metrics_csv_text(FILE *f, const char *text);

void metrics_table_print(const metrics_table *t);
json_t *metrics_table_json(const metrics_table *t, const cli_report *report);
brace_status metrics_table_csv(const metrics_table *t, const char *path, brace_error *error);

#endif
