/* SPDX-License-Identifier: Apache-2.0 */
/*
 * metrics_table.c: one row a picture, then mean and deviation.
 */
#include "cli/metrics_table.h"

#include <math.h>
#include <string.h>

#include "core/core.h"

const metric_kind metric_kinds[METRICS] = {
    [PSNR] = {"psnr", "PSNR", 2, -1},
    [SSIM] = {"ssim", "SSIM", 4, -1},
    [MS_SWD] = {"ms-swd", "MS-SWD", 4, -1},
    [LPIPS_ALEX] = {"lpips-alex", "LPIPS", 4, BRACE_LPIPS_ALEX},
    [LPIPS_VGG] = {"lpips-vgg", "LPIPS-VGG", 4, BRACE_LPIPS_VGG},
    [LPIPS_SQUEEZE] = {"lpips-squeeze", "LPIPS-SQ", 4, BRACE_LPIPS_SQUEEZE},
    [DISTS] = {"dists", "DISTS", 4, BRACE_DISTS},
    [SFC] = {"sfc", "SFC", 4, -1},
};

/* Mean and deviation (of the population) of what was measured; infinite if one of them is. */
void metrics_table_summary(const metrics_table *t, metric m, double *mean, double *deviation, size_t *count) {
    double sum = 0, squares = 0;
    *count = 0;
    for (size_t i = 0; i < t->pairs.count; i++) {
        if (!isnan(t->results[i].value[m])) {
            sum += t->results[i].value[m];
            ++*count;
        }
    }
    *mean = *count > 0 ? sum / (double)*count : NAN;
    for (size_t i = 0; i < t->pairs.count; i++) {
        double d = t->results[i].value[m] - *mean;
        squares += isnan(t->results[i].value[m]) ? 0 : d * d;
    }
    *deviation = *count > 0 && isfinite(*mean) ? sqrt(squares / (double)*count) : NAN;
}

/* The parts of the SFC, as the paper's table of them has them. */
const char *const metrics_sfc_names[SFC_PARTS] = {"d_ratio", "d_profile", "delta_ratio", "delta_profile"};
const char *const metrics_sfc_heads[SFC_PARTS] = {"D_ratio", "D_profile", "ratio, signed", "profile, signed"};

void metrics_sfc_parts(double parts[SFC_PARTS], const brace_sfc *sfc) {
    parts[0] = sfc->d_ratio, parts[1] = sfc->d_profile, parts[2] = sfc->delta_ratio, parts[3] = sfc->delta_profile;
}

void metrics_sfc_summary(double mean[SFC_PARTS], double deviation[SFC_PARTS], const brace_sfc *items, size_t count) {
    brace_sfc sums[2];
    brace_sfc_summary(&sums[0], &sums[1], items, count);
    metrics_sfc_parts(mean, &sums[0]);
    metrics_sfc_parts(deviation, &sums[1]);
    for (int k = 0; k < SFC_PARTS && count == 0; k++) {
        mean[k] = deviation[k] = NAN;
    }
}

/* Mean and deviation of the parts over all pairs whose SFC was measured. */
static void sfc_parts_summary(const metrics_table *t, double mean[SFC_PARTS], double deviation[SFC_PARTS]) {
    brace_sfc *items = core_alloc(t->pairs.count + 1, sizeof *items);
    size_t count = 0;
    for (size_t i = 0; i < t->pairs.count && items != NULL; i++) {
        if (!isnan(t->results[i].value[SFC])) {
            items[count++] = t->results[i].sfc;
        }
    }
    metrics_sfc_summary(mean, deviation, items, count);
    core_free(items);
}

static const char *number(char buffer[32], double value, int digits) {
    if (isnan(value)) {
        return "-";
    }
    snprintf(buffer, 32, "%.*f", digits, value);
    return buffer;
}

static void print_row(const metrics_table *t, int width, const char *name, const double values[METRICS]) {
    char buffer[32];
    printf("%-*s", width, name);
    for (metric m = 0; m < METRICS; m++) {
        if (t->wanted[m]) {
            printf("  %9s", number(buffer, values[m], metric_kinds[m].digits));
        }
    }
    putchar('\n');
}

void metrics_table_print(const metrics_table *t) {
    int width = 9;
    double mean[METRICS], deviation[METRICS];
    size_t count;
    for (size_t i = 0; i < t->pairs.count; i++) {
        int n = (int)strlen(t->pairs.items[i].name);
        width = n > width ? n : width;
    }
    printf("%-*s", width, "picture");
    for (metric m = 0; m < METRICS; m++) {
        metrics_table_summary(t, m, &mean[m], &deviation[m], &count);
        if (t->wanted[m]) {
            printf("  %9s", metric_kinds[m].head);
        }
    }
    putchar('\n');
    for (size_t i = 0; i < t->pairs.count; i++) {
        print_row(t, width, t->pairs.items[i].name, t->results[i].value);
    }
    if (t->pairs.count > 1) {
        print_row(t, width, "mean", mean);
        print_row(t, width, "deviation", deviation);
    }
    if (t->wanted[SFC] && !isnan(mean[SFC])) {
        double parts[SFC_PARTS], spread[SFC_PARTS];
        sfc_parts_summary(t, parts, spread);
        printf("\n%-17s %9s  %9s\n", "SFC in parts", "mean", "deviation");
        for (int k = 0; k < SFC_PARTS; k++) {
            printf("  %-15s %9.4f  %9.4f\n", metrics_sfc_heads[k], parts[k], spread[k]);
        }
    }
}

static json_t *values_json(const metrics_table *t, const result *r) {
    json_t *object = json_object();
    for (metric m = 0; m < METRICS; m++) {
        if (t->wanted[m]) {
            json_object_set_new(object, metric_kinds[m].name, cli_json_number(r->value[m]));
        }
    }
    if (t->wanted[PSNR]) { /* JSON has no infinity */
        json_object_set_new(object, "identical", json_boolean(isinf(r->value[PSNR])));
    }
    if (t->wanted[SFC] && !isnan(r->value[SFC])) {
        json_object_set_new(object, "sfc_parts",
                            json_pack("{s:o, s:o, s:o, s:o, s:o}", "d_ratio", cli_json_number(r->sfc.d_ratio),
                                      "d_profile", cli_json_number(r->sfc.d_profile), "delta_ratio",
                                      cli_json_number(r->sfc.delta_ratio), "delta_profile",
                                      cli_json_number(r->sfc.delta_profile), "direction",
                                      cli_json_number(r->sfc.direction)));
    }
    return object;
}

json_t *metrics_table_json(const metrics_table *t, const cli_report *report) {
    json_t *pairs = json_array(), *all = json_object(), *unmatched = json_array(), *notes = json_array();
    for (size_t i = 0; i < t->pairs.count; i++) {
        const cli_pair *p = &t->pairs.items[i];
        json_array_append_new(pairs, json_pack("{s:o, s:o, s:o, s:o}", "name", cli_json_text(p->name), "pred",
                                               cli_json_text(p->pred), "gt", cli_json_text(p->gt), "metrics",
                                               values_json(t, &t->results[i])));
    }
    for (metric m = 0; m < METRICS; m++) {
        double mean, deviation;
        size_t count;
        metrics_table_summary(t, m, &mean, &deviation, &count);
        if (t->wanted[m]) {
            json_object_set_new(all, metric_kinds[m].name,
                                json_pack("{s:o, s:o, s:I}", "mean", cli_json_number(mean), "deviation",
                                          cli_json_number(deviation), "count", (json_int_t)count));
        }
    }
    if (t->wanted[SFC]) {
        double mean[SFC_PARTS], deviation[SFC_PARTS];
        json_t *parts = json_object();
        sfc_parts_summary(t, mean, deviation);
        for (int k = 0; k < SFC_PARTS; k++) {
            json_object_set_new(parts, metrics_sfc_names[k],
                                json_pack("{s:o, s:o}", "mean", cli_json_number(mean[k]), "deviation",
                                          cli_json_number(deviation[k])));
        }
        json_object_set_new(all, "sfc_parts", parts);
    }
    for (size_t i = 0; i < t->pairs.unmatched.count; i++) {
        json_array_append_new(unmatched, cli_json_text(t->pairs.unmatched.items[i]));
    }
    for (size_t i = 0; i < report->note_count; i++) {
        json_array_append_new(notes, cli_json_text(report->notes[i]));
    }
    return json_pack("{s:s, s:o, s:o, s:o, s:o}", "version", brace_version(), "pairs", pairs, "summary", all,
                     "unmatched", unmatched, "notes", notes);
}

void metrics_csv_text(FILE *f, const char *text) {
    if (strpbrk(text, ",\"\r\n") == NULL) {
        fputs(text, f);
        return;
    }
    putc('"', f);
    for (; *text != '\0'; text++) {
        if (*text == '"') {
            putc('"', f);
        }
        putc(*text, f);
    }
    putc('"', f);
}

static void csv_values(const metrics_table *t, FILE *f, const double values[METRICS], const double parts[SFC_PARTS]) {
    for (metric m = 0; m < METRICS; m++) {
        if (t->wanted[m]) {
            putc(',', f);
            if (!isnan(values[m])) {
                fprintf(f, "%.9g", values[m]);
            }
        }
    }
    for (int k = 0; k < SFC_PARTS && t->wanted[SFC]; k++) {
        putc(',', f);
        if (!isnan(values[SFC])) {
            fprintf(f, "%.9g", parts[k]);
        }
    }
    fputs("\r\n", f);
}

brace_status metrics_table_csv(const metrics_table *t, const char *path, brace_error *error) {
    core_file *file = NULL;
    brace_status status = core_file_create(&file, path, error);
    if (status != BRACE_OK) {
        return status;
    }
    FILE *f = core_file_stream(file);
    double mean[METRICS], deviation[METRICS];
    size_t count;
    fputs("name,pred,gt", f);
    for (metric m = 0; m < METRICS; m++) {
        metrics_table_summary(t, m, &mean[m], &deviation[m], &count);
        if (t->wanted[m]) {
            fprintf(f, ",%s", metric_kinds[m].name);
        }
    }
    for (int k = 0; k < SFC_PARTS && t->wanted[SFC]; k++) {
        fprintf(f, ",sfc_%s", metrics_sfc_names[k]);
    }
    fputs("\r\n", f);
    double parts[SFC_PARTS], spread[SFC_PARTS];
    for (size_t i = 0; i < t->pairs.count; i++) {
        const cli_pair *p = &t->pairs.items[i];
        metrics_csv_text(f, p->name);
        putc(',', f);
        metrics_csv_text(f, p->pred);
        putc(',', f);
        metrics_csv_text(f, p->gt);
        metrics_sfc_parts(parts, &t->results[i].sfc);
        csv_values(t, f, t->results[i].value, parts);
    }
    sfc_parts_summary(t, parts, spread);
    fputs("mean,,", f);
    csv_values(t, f, mean, parts);
    fputs("deviation,,", f);
    csv_values(t, f, deviation, spread);
    return core_file_commit(file, error);
}
