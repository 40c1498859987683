/* SPDX-License-Identifier: Apache-2.0 */
/*
 * report_eval.c: what `brace eval --html` says: means by group, the parts of SFC, and every sample with the pictures of
 * those that are shown. Pictures wait in templates, which a browser does not decode before they are used.
 */
#include "cli/report.h"

#include <math.h>
#include <string.h>

static const eval_group *find(const eval_group *groups, size_t count, eval_kind kind) {
    for (size_t i = 0; i < count; i++) {
        if (groups[i].kind == kind) {
            return &groups[i];
        }
    }
    return NULL;
}

static void write_number(FILE *f, double value, int digits) {
    if (isnan(value)) {
        fputs("<td data-v=\"\"><span class=\"none\">\xe2\x80\x93</span></td>", f);
    } else {
        fprintf(f, "<td data-v=\"%.9g\">%.*f</td>", value, digits, value);
    }
}

static void write_spread(FILE *f, double mean, double deviation, int digits) {
    if (isnan(mean)) {
        write_number(f, mean, digits);
    } else {
        fprintf(f, "<td data-v=\"%.9g\">%.*f <span class=\"none\">\xc2\xb1 %.*f</span></td>", mean, digits, mean, digits,
                deviation);
    }
}

static void begin_table(FILE *f, const char *label, bool tall) {
    fprintf(f, "<div class=\"scroll%s\" tabindex=\"0\" role=\"region\" aria-label=\"%s\"><table class=\"sortable\">\n"
               "<thead><tr>", tall ? " long" : "", label);
}

static void write_heads(FILE *f, const eval_set *set, const char *first) {
    fprintf(f, "<th class=\"name\" scope=\"col\">%s</th>", first);
    if (strcmp(first, "Method") != 0) {
        fputs("<th class=\"name\" scope=\"col\">Method</th><th scope=\"col\" data-number>Samples</th>", f);
    }
    for (metric m = 0; m < METRICS; m++) {
        if (set->wanted[m]) {
            fprintf(f, "<th scope=\"col\" data-number>%s</th>", metric_kinds[m].head);
        }
    }
    fputs("<th scope=\"col\" data-number>Worse than input</th><th scope=\"col\" data-number>Seconds</th></tr></thead>\n"
          "<tbody>\n", f);
}

static void write_mean(FILE *f, const eval_set *set, const eval_mean *mean, bool deviation) {
    for (metric m = 0; m < METRICS; m++) {
        if (!set->wanted[m]) {
            continue;
        }
        if (deviation) {
            write_spread(f, mean->mean[m], mean->deviation[m], metric_kinds[m].digits);
        } else {
            write_number(f, mean->mean[m], metric_kinds[m].digits);
        }
    }
    write_number(f, mean->count > 0 ? (double)mean->worse : NAN, 0);
    write_number(f, mean->seconds, 2);
}

/* Methods in rows. */
static void write_group(FILE *f, const eval_set *set, const eval_group *group) {
    begin_table(f, "Means", false);
    write_heads(f, set, "Method");
    for (size_t m = 0; m < set->methods; m++) {
        const eval_mean mean = eval_mean_of(set, group, m);
        fputs("<tr><th class=\"name\" scope=\"row\">", f);
        report_name(f, set->method[m].label);
        fputs("</th>", f);
        write_mean(f, set, &mean, true);
        fputs("</tr>\n", f);
    }
    fputs("</tbody></table></div>\n", f);
}

static void write_parts(FILE *f, const eval_set *set, const eval_group *group) {
    fputs("<h2>SFC in parts</h2>\n", f);
    begin_table(f, "SFC in parts", false);
    fputs("<th class=\"name\" scope=\"col\">Method</th><th scope=\"col\" data-number>D<sub>ratio</sub></th>"
          "<th scope=\"col\" data-number>D<sub>profile</sub></th><th scope=\"col\" data-number>Ratio, signed</th>"
          "<th scope=\"col\" data-number>Profile, signed</th></tr></thead>\n<tbody>\n", f);
    for (size_t m = 0; m < set->methods; m++) {
        const eval_mean mean = eval_mean_of(set, group, m);
        fputs("<tr><th class=\"name\" scope=\"row\">", f);
        report_name(f, set->method[m].label);
        fputs("</th>", f);
        for (int k = 0; k < SFC_PARTS; k++) {
            write_spread(f, mean.parts[k], mean.parts_deviation[k], 3);
        }
        fputs("</tr>\n", f);
    }
    fputs("</tbody></table></div>\n", f);
}

static void write_kind(FILE *f, const eval_set *set, const eval_group *groups, size_t count, eval_kind kind,
                       const char *title, const char *head) {
    fprintf(f, "<h2>%s</h2>\n", title);
    begin_table(f, title, true);
    write_heads(f, set, head);
    for (size_t i = 0; i < count; i++) {
        for (size_t m = 0; m < set->methods && groups[i].kind == kind; m++) {
            const eval_mean mean = eval_mean_of(set, &groups[i], m);
            fputs("<tr><th class=\"name\" scope=\"row\">", f);
            report_name(f, groups[i].name);
            fputs("</th><td class=\"name\">", f);
            report_name(f, set->method[m].label);
            fprintf(f, "</td><td data-v=\"%zu\">%zu</td>", mean.count, mean.count);
            write_mean(f, set, &mean, false);
            fputs("</tr>\n", f);
        }
    }
    fputs("</tbody></table></div>\n", f);
}

/* ---- pictures ---- */

static brace_status write_images(const report_page *page, const eval_set *set, const eval_sample *s, brace_error *error) {
    const size_t count = set->methods + 2;
    brace_status status = BRACE_OK;
    for (size_t i = 0; i < count && status == BRACE_OK; i++) {
        const size_t k = i == 0 || i + 1 == count ? i : count - 1 - i; /* the viewer begins with the first two */
        if (s->picture[k] == NULL) {
            continue;
        }
        /* Labels go into attributes: an image's own is escaped as text is. */
        char *attributes = NULL;
        size_t size = 0;
        FILE *text = open_memstream(&attributes, &size);
        if (text == NULL) {
            return core_fail_memory(error, 256, "the report");
        }
        fputs("alt=\"\" data-label=\"", text);
        report_text(text, k == 0 ? "As shot" : k + 1 == count ? "Truth" : set->method[k - 1].label);
        putc('"', text);
        const bool good = fclose(text) == 0;
        status = good ? report_picture(page, s->picture[k], page->side, REPORT_PHOTO, attributes, error)
                      : core_fail_memory(error, 256, "the report");
        free(attributes);
    }
    return status;
}

static brace_status write_pictures(const report_page *page, const eval_set *set, size_t *first, brace_error *error) {
    FILE *f = page->f;
    brace_status status = BRACE_OK;
    *first = set->count;
    for (size_t i = 0; i < set->count && status == BRACE_OK; i++) {
        const eval_sample *s = &set->items[i];
        if (!s->shown || s->picture[0] == NULL) {
            continue;
        }
        if (*first == set->count) {
            *first = i;
            fputs("<h2>Pictures: <span id=\"pair-name\">", f);
            report_name(f, s->name);
            fprintf(f, "</span></h2>\n<figure class=\"viewer\" style=\"--ratio:%.5f\">\n",
                    (double)s->picture[0]->width / s->picture[0]->height);
            status = write_images(page, set, s, error);
            fputs("</figure>\n<p class=\"hint keys\">Choose two of the pictures; a row of the samples below shows its own. "
                  "Drag the divider. Wheel, pinch or <kbd>+</kbd> <kbd>\xe2\x88\x92</kbd> zoom, <kbd>D</kbd> difference, "
                  "<kbd>F</kbd> full screen. They are made smaller here; they were measured in full.</p>\n", f);
        }
        if (status == BRACE_OK) {
            fprintf(f, "<template id=\"pair-%zu\">", i);
            status = write_images(page, set, s, error);
            fputs("</template>\n", f);
        }
    }
    return status;
}

static void write_samples(FILE *f, const eval_set *set, size_t first) {
    fputs("<h2>Samples</h2>\n<p class=\"hint\">PSNR in dB. Click a heading to sort, a row with a button to see its "
          "pictures.</p>\n", f);
    begin_table(f, "Every sample", true);
    fputs("<th class=\"name\" scope=\"col\">Sample</th><th class=\"name\" scope=\"col\">Display</th>"
          "<th scope=\"col\" data-number>Input</th>", f);
    for (size_t m = 0; m < set->methods; m++) {
        fputs("<th scope=\"col\" data-number>", f);
        report_name(f, set->method[m].label);
        fputs("</th>", f);
    }
    fputs("</tr></thead>\n<tbody>\n", f);
    for (size_t i = 0; i < set->count; i++) {
        const eval_sample *s = &set->items[i];
        if (!s->done) {
            continue;
        }
        const bool pick = s->shown && s->picture[0] != NULL;
        if (pick) {
            fprintf(f, "<tr data-pair=\"%zu\"%s><th class=\"name\" scope=\"row\"><button type=\"button\" aria-pressed=\"%s\">",
                    i, i == first ? " class=\"shown\"" : "", i == first ? "true" : "false");
        } else {
            fputs("<tr><th class=\"name\" scope=\"row\">", f);
        }
        report_name(f, s->name);
        fputs(pick ? "</button></th><td class=\"name\">" : "</th><td class=\"name\">", f);
        report_name(f, s->steady ? "flicker-free" : s->family);
        fputs("</td>", f);
        write_number(f, fmin(s->reference_psnr, 100), 2);
        for (size_t m = 0; m < set->methods; m++) {
            const double psnr = s->result[m].measured.value[PSNR];
            write_number(f, psnr > 100 ? 100 : psnr, 2);
        }
        fputs("</tr>\n", f);
    }
    fputs("</tbody></table></div>\n", f);
}

brace_status report_eval(const eval_set *set, const char *path, const cli_report *notes, const brace_job *job,
                         brace_error *error) {
    eval_group groups[EVAL_GROUPS];
    const size_t count = eval_groups(set, groups, EVAL_GROUPS);
    const eval_group *banded = find(groups, count, EVAL_BANDED), *steady = find(groups, count, EVAL_STEADY);
    report_page page = {.side = 4096}; /* the pictures are small already */
    brace_status status = report_open(&page, path, "BRACE eval", job, error);
    if (status != BRACE_OK) {
        return status;
    }
    FILE *f = page.f;
    size_t first = 0;
    fputs("<header class=\"top\">\n<p class=\"eyebrow\">Methods compared</p>\n<h1>", f);
    report_name(f, set->folder);
    fprintf(f, "</h1>\n<p class=\"lead\"><span>BRACE %s</span><span>%zu samples with banding</span>"
               "<span>%zu without</span></p>\n</header>\n<main>\n", brace_version(), banded != NULL ? banded->count : 0,
            steady != NULL ? steady->count : 0);
    if (banded != NULL) {
        fputs("<h2>Displays that flicker</h2>\n<p class=\"hint\">Mean and deviation over the samples. PSNR and SSIM: more is "
              "better; all others: 0 is best.</p>\n", f);
        write_group(f, set, banded);
    }
    if (steady != NULL) {
        fputs("<h2>Displays that do not: the control</h2>\n", f);
        write_group(f, set, steady);
    }
    if (banded != NULL && set->wanted[SFC]) {
        write_parts(f, set, banded);
    }
    status = write_pictures(&page, set, &first, error);
    if (banded != NULL) {
        write_kind(f, set, groups, count, EVAL_FAMILY, "By kind of display", "Display");
        write_kind(f, set, groups, count, EVAL_CATEGORY, "By what is shown", "Screen");
    }
    write_samples(f, set, first);
    report_notes(f, notes->notes, notes->note_count);
    fputs("</main>\n", f);
    return report_close(&page, status, error);
}
