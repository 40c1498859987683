/* SPDX-License-Identifier: Apache-2.0 */
/* capture_print.c: what brace capture shows of plans, sequences and folders. */
#include "cli/capture_print.h"

#include <math.h>
#include <string.h>

/* ---- plans ---- */

/* In one exposure: several shots that are averaged begin anywhere. */
static double periods(const capture_step *s, double hz) {
    return s->exposure * hz;
}

void capture_print_plan(const capture_plan *plan, const capture_limits *limits, const double *flicker, size_t count) {
    char t[32], name[32];
    printf("%-3s %-9s %10s %8s %7s", "", "frame", "time", "ISO", "EV");
    for (size_t k = 0; k < count; k++) {
        snprintf(name, sizeof name, "at %g Hz", flicker[k]);
        printf(" %12s", name);
    }
    printf("\n");
    bool whole = false;
    for (size_t i = 0; i < plan->count; i++) {
        const capture_step *s = &plan->steps[i];
        printf("%2zu. %-9s %10s %8g %+7.2f", i + 1, capture_step_name(name, s), capture_time_text(t, s->exposure),
               s->iso, capture_step_ev(plan, i) + 0.0);
        for (size_t k = 0; k < count; k++) {
            const double n = periods(s, flicker[k]);
            const bool clean = n > 0.9 && fabs(n - round(n)) < 0.02;
            whole = whole || clean;
            printf(" %11.*f%c", n < 9.995 ? 2 : 1, n, clean ? '*' : ' ');
        }
        if (i == plan->reference)
            printf("  reference");
        if (s->truth && s->shots > 1)
            printf("  truth, mean of %d shots", s->shots);
        else if (s->truth)
            printf("  truth");
        printf("\n");
    }
    if (count > 0)
        printf("Periods of the flicker in an exposure%s: the more, the weaker the bands.\n",
               whole ? " (* whole ones: no bands)" : "");
    printf("%zu exposures, %.2f s in all", capture_plan_shots(plan), capture_plan_seconds(plan, limits));
    printf(limits->interval > 0 || limits->readout > 0 ? "\n" : ", and what the camera takes between them\n");
}

json_t *capture_plan_json(const capture_plan *plan, const capture_limits *limits, const double *flicker, size_t count) {
    json_t *steps = json_array();
    for (size_t i = 0; i < plan->count; i++) {
        const capture_step *s = &plan->steps[i];
        char name[32];
        json_t *o = json_pack("{s:s, s:b, s:b, s:f, s:f, s:f, s:f, s:i, s:f}", "name", capture_step_name(name, s),
                              "truth", s->truth, "reference", i == plan->reference, "exposure", s->exposure, "iso",
                              s->iso, "wanted_exposure", s->wanted_exposure, "wanted_iso", s->wanted_iso, "shots",
                              s->shots, "ev", capture_step_ev(plan, i));
        json_t *list = json_array();
        for (size_t k = 0; k < count; k++)
            json_array_append_new(list, json_pack("{s:f, s:f}", "hz", flicker[k], "periods", periods(s, flicker[k])));
        if (count > 0)
            json_object_set(o, "flicker", list);
        json_decref(list);
        json_array_append_new(steps, o);
    }
    return json_pack("{s:o, s:I, s:f}", "plan", steps, "exposures", (json_int_t)capture_plan_shots(plan), "seconds",
                     capture_plan_seconds(plan, limits));
}

/* ---- limits ---- */

void capture_print_limits(const capture_limits *l) {
    char a[32], b[32];
    printf("    %s %s%s%s\n", l->make, l->model, l->id[0] != '\0' ? ", " : "", l->id);
    printf("    exposure %s to %s, ", capture_time_text(a, l->exposure_min), capture_time_text(b, l->exposure_max));
    if (l->exposure_count > 0)
        printf("%zu stops\n", l->exposure_count);
    else
        printf("any\n");
    printf("    ISO %g to %g, ", l->iso_min, l->iso_max);
    if (l->iso_count > 0)
        printf("%zu stops\n", l->iso_count);
    else
        printf("any\n");
    if (l->readout > 0)
        printf("    reads a frame out in %.1f ms\n", 1000 * l->readout);
}

static json_t *numbers(const double *values, size_t count) {
    json_t *list = json_array();
    for (size_t i = 0; i < count; i++)
        json_array_append_new(list, json_real(values[i]));
    return list;
}

json_t *capture_limits_json(const capture_limits *l) {
    return json_pack("{s:o, s:o, s:o, s:[f, f], s:o, s:[f, f], s:o, s:f, s:f, s:f}", "make", cli_json_text(l->make),
                     "model", cli_json_text(l->model), "id", cli_json_text(l->id), "exposure", l->exposure_min,
                     l->exposure_max, "exposures", numbers(l->exposures, l->exposure_count), "iso", l->iso_min,
                     l->iso_max, "isos", numbers(l->isos, l->iso_count), "interval", l->interval, "readout", l->readout,
                     "f_number", l->f_number);
}

/* ---- sequences ---- */

const char *capture_counts_text(char *out, size_t size, const capture_counts *c) {
    const struct {
        uint64_t n;
        const char *what;
    } all[] = {{c->busy, "times busy"},
               {c->dropped, "lost"},
               {c->reopened, "times reconnected"},
               {c->unreadable, "damaged"},
               {c->metadata, "with wrong metadata"},
               {c->pixels, "with wrong light"}};
    size_t used = 0;
    out[0] = '\0';
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        if (all[i].n > 0 && used < size)
            used += (size_t)snprintf(out + used, size - used, "%s%llu %s", used > 0 ? ", " : "",
                                     (unsigned long long)all[i].n, all[i].what);
    return out;
}

static void print_motion(const brace_motion *m) {
    if (isfinite(m->dx))
        printf("The truth lies %.1f pixels off the reference, turned by %.2f degrees\n", hypot(m->dx, m->dy),
               m->rotation);
    else
        printf("The truth could not be laid on the reference: too little texture, or another scene\n");
}

void capture_print_summary(const capture_sequence *q, const char *folder) {
    char t[32], text[256];
    printf("%-16s %10s %8s %7s %9s\n", "file", "time", "ISO", "EV", "measured");
    for (size_t i = 0; i < q->shot_count; i++) {
        const capture_shot *s = &q->shots[i];
        const capture_step *step = &q->plan.steps[s->step];
        const double ev = capture_step_ev(&q->plan, s->step);
        printf("%-16s %10s %8g %+7.2f", s->file, capture_time_text(t, step->exposure), step->iso, ev + 0.0);
        if (isfinite(s->ev))
            printf(" %+9.2f", ev + s->ev);
        else
            printf(" %9s", "-");
        printf("%s%s\n",
               s->step == q->plan.reference ? "  reference"
               : step->truth                ? "  truth"
                                            : "",
               s->accepted ? "  contradicts the others" : "");
    }
    if (q->truth_file[0] != '\0')
        printf("%-16s the mean of the truths\n", q->truth_file);
    if (q->has_motion)
        print_motion(&q->motion);
    capture_counts_text(text, sizeof text, &q->counts);
    printf("%llu releases%s%s. In %s\n", (unsigned long long)q->counts.asked, text[0] != '\0' ? ": " : "", text,
           folder);
}

/* ---- checked folders ---- */

void capture_print_checked(const capture_checked *c, const char *folder) {
    char t[32];
    printf("%s\n  %-20s %10s %8s %7s %9s %9s\n", folder, "file", "time", "ISO", "EV", "measured", "clipped");
    for (size_t i = 0; i < c->count; i++) {
        const capture_checked_file *f = &c->files[i];
        if (!f->readable) {
            printf("  %-20s cannot be read\n", f->name);
            continue;
        }
        printf("  %-20s %10s %8g", f->name, capture_time_text(t, f->exposure), f->iso);
        isfinite(f->ev) ? printf(" %+7.2f", f->ev + 0.0) : printf(" %7s", "-");
        isfinite(f->measured) ? printf(" %+9.2f", f->measured + 0.0) : printf(" %9s", "-");
        printf(" %7.1f %%%s\n", 100 * f->clipped, i == c->reference ? "  reference" : f->truth ? "  truth" : "");
    }
    if (c->has_motion) {
        printf("  ");
        print_motion(&c->motion);
    }
    for (size_t i = 0; i < c->problem_count; i++)
        printf("  wrong: %s\n", c->problems[i]);
    for (size_t i = 0; i < c->remark_count; i++)
        printf("  note: %s\n", c->remarks[i]);
    printf("  brace restore %s\n", c->restorable ? "takes it" : "should not be given it");
    if (c->importable)
        printf("  brace dataset import takes it\n");
    else
        printf("  brace dataset import does not take it: %s\n", c->not_importable);
}

static json_t *texts(char *const *items, size_t count) {
    json_t *list = json_array();
    for (size_t i = 0; i < count; i++)
        json_array_append_new(list, cli_json_text(items[i]));
    return list;
}

json_t *capture_checked_json(const capture_checked *c, const char *folder) {
    json_t *files = json_array();
    for (size_t i = 0; i < c->count; i++) {
        const capture_checked_file *f = &c->files[i];
        json_array_append_new(files, json_pack("{s:o, s:b, s:b, s:b, s:f, s:f, s:o, s:o, s:f}", "name",
                                               cli_json_text(f->name), "readable", f->readable, "truth", f->truth,
                                               "reference", i == c->reference, "exposure", f->exposure, "iso", f->iso,
                                               "ev", cli_json_number(f->readable ? f->ev : (double)NAN), "measured",
                                               cli_json_number(f->readable ? f->measured : (double)NAN), "clipped",
                                               f->clipped));
    }
    json_t *o =
        json_pack("{s:o, s:o, s:o, s:o, s:b, s:b, s:b, s:o}", "folder", cli_json_text(folder), "files", files,
                  "problems", texts(c->problems, c->problem_count), "remarks", texts(c->remarks, c->remark_count),
                  "sequence", c->has_sequence, "restorable", c->restorable, "importable", c->importable,
                  "not_importable", c->importable ? json_null() : cli_json_text(c->not_importable));
    if (o != NULL && c->has_motion)
        json_object_set_new(o, "motion",
                            json_pack("{s:o, s:o, s:o, s:f}", "dx", cli_json_number(c->motion.dx), "dy",
                                      cli_json_number(c->motion.dy), "rotation", cli_json_number(c->motion.rotation),
                                      "confidence", c->motion.confidence));
    return o;
}
