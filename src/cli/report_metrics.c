/* SPDX-License-Identifier: Apache-2.0 */
/*
 * report_metrics.c: what `brace metrics --html` says: the table with mean and deviation, and each pair of pictures to
 * compare. The pictures of the pairs wait in templates, which a browser does not decode before they are used.
 */
#include "cli/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    MOST_PAIRS = 200,   /* of which the pictures are in the file: the worst ones */
    SMALLEST_SIDE = 320 /* that pictures shrink to for the sake of the file's size */
};
static const double budget = 24e6; /* pixels of all pictures together, some five megabytes as JPEG */

static bool more_is_better(metric m) {
    return m == PSNR || m == SSIM;
}

/* The first metric that was asked for: what `worst` means. */
static metric first_metric(const metrics_table *t) {
    metric m = 0;
    while (m < METRICS - 1 && !t->wanted[m])
        m++;
    return m;
}

static bool measured(const metrics_table *t, size_t i) {
    for (metric m = 0; m < METRICS; m++)
        if (!isnan(t->results[i].value[m]))
            return true;
    return false;
}

/* The pairs from worst to best in `order`; those without a number last. Returns how many have one. */
static size_t sort_pairs(size_t *order, const metrics_table *t) {
    const metric m = first_metric(t);
    size_t n = 0;
    for (size_t i = 0; i < t->pairs.count; i++) {
        if (!measured(t, i))
            continue;
        const double mine = t->results[i].value[m];
        size_t at = n++;
        for (; at > 0; at--) {
            const double other = t->results[order[at - 1]].value[m];
            if (!(isnan(other) || (more_is_better(m) ? mine < other : mine > other)) || isnan(mine))
                break;
            order[at] = order[at - 1];
        }
        order[at] = i;
    }
    return n;
}

static void write_number(FILE *f, double value, int digits) {
    if (isnan(value))
        fputs("<span class=\"none\">\xe2\x80\x93</span>", f);
    else if (isinf(value))
        fputs("\xe2\x88\x9e", f);
    else
        fprintf(f, "%.*f", digits, value);
}

static void write_head(FILE *f, const metrics_table *t) {
    fputs("<header class=\"top\">\n<p class=\"eyebrow\">Comparison with the truth</p>\n<h1>", f);
    if (t->pairs.count == 1)
        report_name(f, t->pairs.items[0].name);
    else
        fprintf(f, "%zu pairs of pictures", t->pairs.count);
    fprintf(f, "</h1>\n<p class=\"lead\"><span>BRACE %s</span>", brace_version());
    if (t->pairs.unmatched.count > 0)
        fprintf(f, "<span>%zu without a partner</span>", t->pairs.unmatched.count);
    fputs("</p>\n</header>\n<main>\n<dl class=\"facts\">\n", f);
    for (metric m = 0; m < METRICS; m++) {
        if (!t->wanted[m])
            continue;
        double mean, deviation;
        size_t count;
        metrics_table_summary(t, m, &mean, &deviation, &count);
        fprintf(f, "<div><dt>%s</dt><dd>", metric_kinds[m].head);
        write_number(f, mean, metric_kinds[m].digits);
        if (m == PSNR && isfinite(mean))
            fputs(" dB", f);
        fputs("<small>", f);
        if (count > 1 && isfinite(deviation))
            fprintf(f, "\xc2\xb1 %.*f, ", metric_kinds[m].digits, deviation);
        fprintf(f, "%s is better</small></dd></div>\n", more_is_better(m) ? "more" : "less");
    }
    fputs("</dl>\n", f);
}

/* ---- the pictures ---- */

static brace_status write_images(const report_page *page, brace_image *const picture[2], brace_error *error) {
    brace_status status = report_picture(page, picture[0], page->side, REPORT_PHOTO,
                                         "alt=\"The picture that is measured\" data-label=\"Prediction\"", error);
    if (status == BRACE_OK)
        status = report_picture(page, picture[1], page->side, REPORT_PHOTO, "alt=\"The truth\" data-label=\"Truth\"", error);
    return status;
}

static brace_status write_spectra(const report_page *page, brace_image *const picture[2], brace_error *error) {
    report_spectra s = {.label = {"Prediction", "Truth"}, .css = {"b", "a"}, .pixels = 1, .wave_y = 1};
    report_spectra_result r = {0};
    core_pool *pool = NULL;
    brace_status status = core_pool_create(&pool, page->job, error);
    for (int k = 0; k < 2 && status == BRACE_OK; k++)
        status = banding_plane_image(&s.plane[k], picture[k], pool, error);
    core_pool_destroy(pool);
    if (status == BRACE_OK)
        status = report_spectra_measure(&s, &r, page->job, error);
    if (status == BRACE_OK) {
        fputs("<h2>Spectra</h2>\n<p class=\"hint\">Power of the brightness by direction and fineness, the middle being "
              "coarse; on one scale of five decades. White rings: the strongest line.</p>\n", page->f);
        if (r.fabp[0].refined_f > 0) {
            s.wave_x = r.fabp[0].refined_fx / r.fabp[0].refined_f;
            s.wave_y = r.fabp[0].refined_fy / r.fabp[0].refined_f;
        }
        status = report_spectra_write(page, &s, &r, error);
    }
    report_spectra_free(&s, &r);
    return status;
}

/* A picture can have changed or gone since it was measured: then the pair is shown without. */
static brace_status read_again(brace_image *picture[2], const cli_pair *pair, const brace_job *job, brace_error *error,
                               bool *there) {
    const brace_status status = metrics_read_pair(picture, pair, job, error);
    *there = status == BRACE_OK;
    return core_gave_up(status) ? status : BRACE_OK;
}

/* The viewer with the worst pair; the others in templates. `shown` tells which have their pictures in the file. */
static brace_status write_pictures(const report_page *page, const metrics_table *t, const size_t *order, size_t count,
                                   bool *shown, brace_error *error) {
    FILE *f = page->f;
    brace_status status = BRACE_OK;
    bool first = true;
    double widest = 0;
    for (size_t k = 0; k < count && status == BRACE_OK; k++) {
        brace_image *picture[2] = {NULL, NULL};
        core_progress(page->job, "report", k, count);
        status = read_again(picture, &t->pairs.items[order[k]], page->job, error, &shown[order[k]]);
        if (status == BRACE_OK && shown[order[k]]) {
            widest = fmax(widest, fmax(picture[0]->width, picture[0]->height));
            if (first) {
                fputs("<h2>", f);
                fputs(count > 1 ? "Pictures: <span id=\"pair-name\">" : "<span>", f);
                if (count > 1)
                    report_name(f, t->pairs.items[order[k]].name);
                else
                    fputs("Pictures", f);
                fprintf(f, "</span></h2>\n<figure class=\"viewer\" style=\"--ratio:%.5f\">\n",
                        (double)picture[0]->width / picture[0]->height);
                status = write_images(page, picture, error);
                fputs("</figure>\n<p class=\"hint keys\">Drag the divider. Wheel, pinch or <kbd>+</kbd> <kbd>\xe2\x88\x92</kbd> "
                      "zoom, drag or arrow keys move, <kbd>0</kbd> whole picture, <kbd>1</kbd> pixel for pixel, "
                      "<kbd>D</kbd> difference, <kbd>F</kbd> full screen.</p>\n", f);
                if (status == BRACE_OK && count == 1)
                    status = write_spectra(page, picture, error);
            }
            if (status == BRACE_OK && count > 1) {
                fprintf(f, "<template id=\"pair-%zu\">", order[k]);
                status = write_images(page, picture, error);
                fputs("</template>\n", f);
            }
            first = false;
        }
        brace_image_destroy(picture[0]);
        brace_image_destroy(picture[1]);
    }
    core_progress(page->job, "report", count, count);
    if (widest > page->side)
        fprintf(f, "<p class=\"hint\">Pictures are shown with at most %u pixels a side; they were measured in full.</p>\n",
                page->side);
    return status;
}

/* ---- the table ---- */

static void write_cells(FILE *f, const metrics_table *t, const double values[METRICS], bool key) {
    for (metric m = 0; m < METRICS; m++) {
        if (!t->wanted[m])
            continue;
        if (!key)
            fputs("<td>", f);
        else if (isnan(values[m]))
            fputs("<td data-v=\"\">", f);
        else if (isinf(values[m]))
            fprintf(f, "<td data-v=\"%sInfinity\">", values[m] < 0 ? "-" : "");
        else
            fprintf(f, "<td data-v=\"%.9g\">", values[m]);
        write_number(f, values[m], metric_kinds[m].digits);
        fputs("</td>", f);
    }
}

static void write_table(FILE *f, const metrics_table *t, const bool *shown, size_t first) {
    double mean[METRICS], deviation[METRICS];
    size_t count;
    fprintf(f, "<h2>Numbers</h2>\n%s<div class=\"scroll%s\" tabindex=\"0\" role=\"region\" aria-label=\"Numbers of every pair\">"
               "<table class=\"sortable\">\n<thead><tr><th class=\"name\" scope=\"col\">Picture</th>",
            t->pairs.count > 1 ? "<p class=\"hint\">Click a heading to sort, a row to see its pictures above.</p>\n" : "",
            t->pairs.count > 14 ? " long" : "");
    for (metric m = 0; m < METRICS; m++) {
        metrics_table_summary(t, m, &mean[m], &deviation[m], &count);
        if (t->wanted[m])
            fprintf(f, "<th scope=\"col\" data-number>%s</th>", metric_kinds[m].head);
    }
    fputs("</tr></thead>\n<tbody>\n", f);
    for (size_t i = 0; i < t->pairs.count; i++) {
        const bool pick = shown[i] && t->pairs.count > 1;
        if (pick)
            fprintf(f, "<tr data-pair=\"%zu\"%s>", i, i == first ? " class=\"shown\"" : "");
        else
            fputs("<tr>", f);
        fputs("<th class=\"name\" scope=\"row\">", f);
        if (pick)
            fprintf(f, "<button type=\"button\" aria-pressed=\"%s\">", i == first ? "true" : "false");
        report_name(f, t->pairs.items[i].name);
        fputs(pick ? "</button></th>" : "</th>", f);
        write_cells(f, t, t->results[i].value, true);
        fputs("</tr>\n", f);
    }
    fputs("</tbody>\n", f);
    if (t->pairs.count > 1) {
        fputs("<tfoot><tr><th class=\"name\" scope=\"row\">Mean</th>", f);
        write_cells(f, t, mean, false);
        fputs("</tr>\n<tr><th class=\"name\" scope=\"row\">Deviation</th>", f);
        write_cells(f, t, deviation, false);
        fputs("</tr></tfoot>\n", f);
    }
    fputs("</table></div>\n", f);
}

static void write_details(FILE *f, const metrics_table *t) {
    fputs("<details><summary>Files</summary><dl>\n", f);
    for (size_t i = 0; i < t->pairs.count; i++) {
        report_fact(f, "Prediction", t->pairs.items[i].pred);
        report_fact(f, "Truth", t->pairs.items[i].gt);
    }
    for (size_t i = 0; i < t->pairs.unmatched.count; i++)
        report_fact(f, "No partner", t->pairs.unmatched.items[i]);
    fputs("</dl></details>\n", f);
}

/* ---- all ---- */

static uint32_t side_for(size_t pairs, int wanted) {
    if (wanted > 0)
        return (uint32_t)wanted;
    /* As if pictures were 4:3. */
    const double side = sqrt(budget / (2 * (double)(pairs > 0 ? pairs : 1)) * 4 / 3);
    return (uint32_t)fmax(SMALLEST_SIDE, fmin(REPORT_SIDE, side));
}

brace_status report_metrics(const metrics_table *table, const char *path, int side, const cli_report *notes,
                            const brace_job *job, brace_error *error) {
    const size_t pairs = table->pairs.count;
    size_t *order = calloc(pairs, sizeof *order);
    bool *shown = calloc(pairs, sizeof *shown);
    brace_status status = order != NULL && shown != NULL ? BRACE_OK : core_fail_memory(error, pairs * 9, "the report");
    const size_t good = status == BRACE_OK ? sort_pairs(order, table) : 0, count = good < MOST_PAIRS ? good : MOST_PAIRS;
    report_page page = {.side = side_for(count, side)};
    if (status == BRACE_OK)
        status = report_open(&page, path, "BRACE metrics", job, error);
    if (status == BRACE_OK) {
        write_head(page.f, table);
        status = write_pictures(&page, table, order, count, shown, error);
        if (good > count)
            fprintf(page.f, "<p class=\"hint\">Of %zu pairs, the pictures of the %zu with the worst %s are here.</p>\n", good,
                    count, metric_kinds[first_metric(table)].head);
        size_t first = 0;
        while (first < count && !shown[order[first]])
            first++;
        write_table(page.f, table, shown, first < count ? order[first] : pairs);
        report_notes(page.f, notes->notes, notes->note_count);
        write_details(page.f, table);
        fputs("</main>\n", page.f);
    }
    status = report_close(&page, status, error);
    free(order);
    free(shown);
    return status;
}
