/* SPDX-License-Identifier: Apache-2.0 */
/* eval_table.c: what was measured, as tables to read, as JSON, and as CSV with a row for each sample and method. */
#include "cli/eval.h"

#include <math.h>
#include <string.h>

static int label_width(const eval_set *set) {
    int width = 10;
    for (size_t m = 0; m < set->methods; m++) {
        const int n = (int)strlen(set->method[m].label);
        width = n > width ? n : width;
    }
    return width + 2;
}

static void print_group(const eval_set *set, const eval_group *g, int width) {
    char text[128];
    printf("%s\n", eval_group_text(text, sizeof text, g));
    for (size_t m = 0; m < set->methods; m++) {
        const eval_mean mean = eval_mean_of(set, g, m);
        printf("  %-*s", width - 2, set->method[m].label);
        for (metric k = 0; k < METRICS; k++) {
            if (set->wanted[k] && isnan(mean.mean[k])) {
                printf("  %9s", "-");
            } else if (set->wanted[k]) {
                printf("  %9.*f", metric_kinds[k].digits, mean.mean[k]);
            }
        }
        if (mean.count > 0) {
            printf("  %6zu  %8.2f\n", mean.worse, mean.seconds);
        } else {
            printf("  %6s  %8s\n", "-", "-");
        }
    }
}

static void print_parts(const eval_set *set, const eval_group *g, int width) {
    char text[128];
    printf("\nSFC in parts, mean and deviation: %s\n%*s", eval_group_text(text, sizeof text, g), width, "");
    for (int k = 0; k < SFC_PARTS; k++) {
        printf("  %17s", metrics_sfc_heads[k]);
    }
    putchar('\n');
    for (size_t m = 0; m < set->methods; m++) {
        const eval_mean mean = eval_mean_of(set, g, m);
        printf("  %-*s", width - 2, set->method[m].label);
        for (int k = 0; k < SFC_PARTS; k++) {
            if (isnan(mean.parts[k])) {
                printf("  %17s", "-");
            } else {
                printf("  %8.3f +-%7.3f", mean.parts[k], mean.parts_deviation[k]);
            }
        }
        putchar('\n');
    }
}

void eval_print(const eval_set *set) {
    eval_group groups[EVAL_GROUPS];
    const size_t count = eval_groups(set, groups, EVAL_GROUPS);
    const int width = label_width(set);
    printf("%-*s", width, "mean of");
    for (metric k = 0; k < METRICS; k++) {
        if (set->wanted[k]) {
            printf("  %9s", metric_kinds[k].head);
        }
    }
    printf("  %6s  %8s\n", "worse", "seconds");
    for (size_t i = 0; i < count; i++) {
        print_group(set, &groups[i], width);
    }
    for (size_t i = 0; i < count && set->wanted[SFC]; i++) {
        if (groups[i].kind == EVAL_BANDED) {
            print_parts(set, &groups[i], width);
        }
    }
    puts("\nworse: samples whose PSNR is below that of their reference frame. PSNR and SSIM: higher is better; all\n"
         "others: 0 is best. Families and categories are of the banded samples.");
}

/* ---- JSON ---- */

static json_t *mean_json(const eval_set *set, const eval_group *g, size_t method) {
    const eval_mean mean = eval_mean_of(set, g, method);
    json_t *out = json_object();
    for (metric k = 0; k < METRICS; k++) {
        if (set->wanted[k]) {
            json_object_set_new(out, metric_kinds[k].name,
                                json_pack("{s:o, s:o}", "mean", cli_json_number(mean.mean[k]), "deviation",
                                          cli_json_number(mean.deviation[k])));
        }
    }
    json_t *sfc = json_object();
    for (int k = 0; k < SFC_PARTS; k++) {
        json_object_set_new(sfc, metrics_sfc_names[k], json_pack("{s:o, s:o}", "mean", cli_json_number(mean.parts[k]), "deviation",
                                                          cli_json_number(mean.parts_deviation[k])));
    }
    json_object_set_new(out, "sfc_parts", sfc);
    json_object_set_new(out, "count", json_integer((json_int_t)mean.count));
    json_object_set_new(out, "worse", mean.count > 0 ? json_integer((json_int_t)mean.worse) : json_null());
    json_object_set_new(out, "seconds", cli_json_number(mean.seconds));
    return out;
}

static json_t *sample_json(const eval_set *set, const eval_sample *s) {
    json_t *methods = json_object();
    for (size_t m = 0; m < set->methods; m++) {
        const eval_result *r = &s->result[m];
        json_t *values = json_object();
        for (metric k = 0; k < METRICS; k++) {
            if (set->wanted[k]) { /* equal pictures: 100 dB, as in the means */
                json_object_set_new(values, metric_kinds[k].name,
                                    cli_json_number(k == PSNR && r->measured.value[k] > 100 ? 100 : r->measured.value[k]));
            }
        }
        json_object_set_new(values, "seconds", cli_json_number(r->seconds));
        json_object_set_new(methods, set->method[m].label, values);
    }
    return json_pack("{s:o, s:o, s:o, s:b, s:o, s:o}", "name", cli_json_text(s->name), "family", cli_json_text(s->family),
                     "category", cli_json_text(s->category), "flicker_free", s->steady, "reference_psnr",
                     cli_json_number(fmin(s->reference_psnr, 100)), "methods", methods);
}

json_t *eval_json(const eval_set *set, const cli_report *report) {
    static const char *const kinds[] = {"banded", "flicker_free", "family", "category"};
    eval_group groups[EVAL_GROUPS];
    const size_t count = eval_groups(set, groups, EVAL_GROUPS);
    json_t *methods = json_array(), *means = json_array(), *samples = json_array(), *notes = json_array();
    for (size_t m = 0; m < set->methods; m++) {
        const eval_method *method = &set->method[m];
        json_array_append_new(methods, json_pack("{s:o, s:s, s:o, s:I}", "label", cli_json_text(method->label), "method",
                                                 brace_method_name(method->method), "model",
                                                 method->model != NULL ? cli_json_text(method->model) : json_null(),
                                                 "merged", (json_int_t)method->merged));
    }
    for (size_t i = 0; i < count; i++) {
        json_t *by_method = json_object();
        for (size_t m = 0; m < set->methods; m++) {
            json_object_set_new(by_method, set->method[m].label, mean_json(set, &groups[i], m));
        }
        json_array_append_new(means, json_pack("{s:s, s:o, s:I, s:o}", "kind", kinds[groups[i].kind], "name",
                                               groups[i].name != NULL ? cli_json_text(groups[i].name) : json_null(),
                                               "count", (json_int_t)groups[i].count, "methods", by_method));
    }
    for (size_t i = 0; i < set->count; i++) {
        json_array_append_new(samples, sample_json(set, &set->items[i]));
    }
    for (size_t i = 0; i < report->note_count; i++) {
        json_array_append_new(notes, cli_json_text(report->notes[i]));
    }
    return json_pack("{s:s, s:o, s:o, s:o, s:o, s:o}", "version", brace_version(), "data", cli_json_text(set->folder),
                     "methods", methods, "groups", means, "samples", samples, "notes", notes);
}

/* ---- CSV ---- */

brace_status eval_csv(const eval_set *set, const char *path, brace_error *error) {
    core_file *file = NULL;
    brace_status status = core_file_create(&file, path, error);
    if (status != BRACE_OK) {
        return status;
    }
    FILE *f = core_file_stream(file);
    fputs("sample,family,category,flicker_free,method", f);
    for (metric k = 0; k < METRICS; k++) {
        if (set->wanted[k]) {
            fprintf(f, ",%s", metric_kinds[k].name);
        }
    }
    for (int k = 0; k < SFC_PARTS; k++) {
        fprintf(f, ",sfc_%s", metrics_sfc_names[k]);
    }
    fputs(",reference_psnr,seconds\r\n", f);
    for (size_t i = 0; i < set->count; i++) {
        const eval_sample *s = &set->items[i];
        for (size_t m = 0; m < set->methods && s->done; m++) {
            const eval_result *r = &s->result[m];
            double parts[SFC_PARTS];
            metrics_csv_text(f, s->name);
            putc(',', f);
            metrics_csv_text(f, s->family);
            putc(',', f);
            metrics_csv_text(f, s->category);
            fprintf(f, ",%d,", s->steady);
            metrics_csv_text(f, set->method[m].label);
            for (metric k = 0; k < METRICS; k++) {
                if (set->wanted[k]) {
                    putc(',', f);
                    if (!isnan(r->measured.value[k])) {
                        fprintf(f, "%.9g", r->measured.value[k]);
                    }
                }
            }
            metrics_sfc_parts(parts, &r->measured.sfc);
            for (int k = 0; k < SFC_PARTS; k++) {
                putc(',', f);
                if (!isnan(r->measured.value[SFC])) {
                    fprintf(f, "%.9g", parts[k]);
                }
            }
            fprintf(f, ",%.9g,%.4f\r\n", s->reference_psnr, r->seconds);
        }
    }
    return core_file_commit(file, error);
}
