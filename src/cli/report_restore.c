/* SPDX-License-Identifier: Apache-2.0 */
/*
 * report_restore.c: what `brace restore --report` says: the reference frame as shot against the restored one, how much
 * of the banding is left, where it was in the spectrum, and what each frame gave.
 */
#include "cli/report.h"

#include <math.h>
#include <string.h>

enum { THUMBNAIL = 480, MEASURES = 4 };

/* All that is worked out before anything is written. */
typedef struct restore_report {
    const report_restore_params *p;
    const brace_job *job;
    brace_image *picture[3]; /* as shot, restored, truth or NULL; upright */
    brace_banding banding[2]; /* of the bracket, and of the bracket with the restored frame in the reference's place */
    report_spectra spectra;
    report_spectra_result result;
    double measure[MEASURES][2]; /* against the truth: as shot, restored */
} restore_report;

static const struct {
    const char *name, *unit;
    int digits;
    bool more; /* is better */
} measures[MEASURES] = {{"PSNR", " dB", 2, true}, {"SSIM", "", 4, true}, {"MS-SWD", "", 4, false}, {"SFC", "", 4, false}};

static bool bands(const brace_banding_frame *f) {
    return f->confidence >= 0.5;
}

/* ---- measuring ---- */

static brace_status develop_pictures(restore_report *r, brace_error *error) {
    const brace_bracket *b = r->p->bracket;
    const brace_develop_params params = {
        .sample = BRACE_SAMPLE_U16, .exposure = r->p->out->exposure, .highlights = r->p->out->highlights};
    const brace_develop_params shot = {.sample = BRACE_SAMPLE_U16, .exposure = r->p->out->exposure};
    brace_status status = brace_develop(&r->picture[0], b->frames[b->reference], &shot, r->job, error);
    if (status == BRACE_OK)
        status = brace_develop_linear(&r->picture[1], r->p->restored->mosaic, r->p->restored->frame, &params, r->job,
                                      error);
    return status;
}

static brace_status read_truth(restore_report *r, brace_error *error) {
    const brace_frame *reference = r->p->bracket->frames[r->p->bracket->reference];
    const char *path = r->p->truth;
    brace_status status;
    if (cli_is_raw_name(path)) {
        brace_frame *frame = NULL;
        status = brace_frame_read(&frame, path, r->job, error);
        if (status == BRACE_OK) {
            const brace_develop_params params = {.sample = BRACE_SAMPLE_U16};
            memcpy(frame->as_shot_neutral, reference->as_shot_neutral, sizeof frame->as_shot_neutral);
            memcpy(frame->color_matrix, reference->color_matrix, sizeof frame->color_matrix);
            memcpy(frame->illuminant, reference->illuminant, sizeof frame->illuminant);
            status = brace_develop(&r->picture[2], frame, &params, r->job, error);
        }
        brace_frame_destroy(frame);
    } else {
        status = brace_image_read(&r->picture[2], path, r->job, error);
    }
    const brace_image *a = r->picture[1], *b = r->picture[2];
    if (status == BRACE_OK && (a->width != b->width || a->height != b->height))
        status = core_fail(error, BRACE_ERROR_MISMATCH, "%s: the truth has %u x %u pixels, the frames %u x %u", path,
                           b->width, b->height, a->width, a->height);
    return status;
}

static brace_status measure_truth(restore_report *r, brace_error *error) {
    const brace_frame *shortest = r->p->bracket->frames[0];
    brace_fabp fabp;
    brace_status status = brace_fabp_frame(&fabp, shortest, NULL, r->job, error);
    for (int k = 0; k < 2 && status == BRACE_OK; k++) {
        brace_image *const *p = r->picture;
        brace_sfc sfc;
        status = brace_psnr(&r->measure[0][k], p[k], p[2], r->job, error);
        if (status == BRACE_OK)
            status = brace_ssim(&r->measure[1][k], p[k], p[2], r->job, error);
        if (status == BRACE_OK)
            status = brace_ms_swd(&r->measure[2][k], p[k], p[2], NULL, r->job, error);
        if (status == BRACE_OK)
            status = brace_sfc_image(&sfc, p[k], p[2], brace_fabp_direction(&fabp, shortest->orientation), NULL,
                                     r->job, error);
        if (status == BRACE_OK)
            r->measure[3][k] = sfc.sfc;
    }
    return status;
}

/* Both times against the same longer frames, so that the two numbers mean the same. */
static brace_status measure_banding(restore_report *r, brace_error *error) {
    const brace_bracket *b = r->p->bracket;
    const brace_frame *frames[BRACE_BRACKET_MAX];
    memcpy(frames, b->frames, b->count * sizeof *frames);
    brace_status status = brace_banding_measure(&r->banding[0], frames, b->count, NULL, r->job, error);
    frames[b->reference] = r->p->restored->frame;
    if (status == BRACE_OK)
        status = brace_banding_measure(&r->banding[1], frames, b->count, NULL, r->job, error);
    return status;
}

/* Across the stripes: of the reference if it is sure, else of the frame that is the surest. */
static const brace_banding_frame *surest(const brace_banding *b, size_t reference) {
    const brace_banding_frame *best = &b->frame[reference];
    for (size_t i = 0; i < b->count && !bands(&b->frame[reference]); i++)
        best = b->frame[i].confidence > best->confidence ? &b->frame[i] : best;
    return best;
}

static brace_status measure_spectra(restore_report *r, brace_error *error) {
    const brace_bracket *b = r->p->bracket;
    const brace_banding_frame *from = surest(&r->banding[0], b->reference);
    const brace_frame *frames[2] = {b->frames[b->reference], r->p->restored->frame};
    report_spectra *s = &r->spectra;
    core_pool *pool = NULL;
    s->label[0] = "As shot", s->label[1] = "Restored";
    s->css[0] = "b", s->css[1] = "a";
    s->pixels = 2;
    const bool found = bands(from) && from->period > 0;
    const double angle = (from->orientation - 90) * M_PI / 180, f = from->fabp.refined_f;
    s->wave_x = found ? cos(angle) : f > 0 ? from->fabp.refined_fx / f : 0;
    s->wave_y = found ? sin(angle) : f > 0 ? from->fabp.refined_fy / f : 1;
    s->period = found ? from->period : 0;
    brace_status status = core_pool_create(&pool, r->job, error);
    for (int k = 0; k < 2 && status == BRACE_OK; k++)
        status = banding_plane_frame(&s->plane[k], frames[k], pool, error);
    core_pool_destroy(pool);
    return status == BRACE_OK ? report_spectra_measure(s, &r->result, r->job, error) : status;
}

/* ---- writing ---- */

static void write_head(FILE *f, const restore_report *r) {
    const brace_bracket *b = r->p->bracket;
    const brace_frame *frame = b->frames[b->reference];
    fputs("<header class=\"top\">\n<p class=\"eyebrow\">Restoration</p>\n<h1>", f);
    report_name(f, cli_basename(r->p->out->count > 0 ? r->p->out->items[0].path : frame->path));
    fputs("</h1>\n<p class=\"lead\">", f);
    if (frame->make[0] != '\0' || frame->model[0] != '\0') {
        fputs("<span>", f);
        /* Most cameras repeat the maker's name in the model's. */
        if (strncmp(frame->model, frame->make, strlen(frame->make)) != 0) {
            report_name(f, frame->make);
            fputc(' ', f);
        }
        report_name(f, frame->model);
        fputs("</span>", f);
    }
    fprintf(f, "<span>%zu frames</span><span>%u \xc3\x97 %u pixels</span>", b->count, r->picture[0]->width,
            r->picture[0]->height);
    if (frame->datetime[0] != '\0') {
        char when[sizeof frame->datetime];
        memcpy(when, frame->datetime, sizeof when);
        when[sizeof when - 1] = '\0';
        if (strlen(when) > 10 && when[4] == ':' && when[7] == ':') /* EXIF writes dates with colons */
            when[4] = when[7] = '-';
        fputs("<span>taken ", f);
        report_text(f, when);
        fputs("</span>", f);
    }
    fputs("</p>\n</header>\n<main>\n", f);
}

/* A low confidence is no proof that there is nothing: below a tenth the words say so. */
static void write_contrast(FILE *f, const brace_banding_frame *b) {
    if (!bands(b))
        fputs(b->told < 0.4 ? "can't tell" : b->confidence < 0.1 ? "none found" : "unsure", f);
    else if (b->contrast > 0)
        fprintf(f, "%.3g %%", 100 * b->contrast);
    else
        fputs("uneven", f);
}

static void write_facts(FILE *f, const restore_report *r) {
    static const char arrow[] = "<span class=\"arrow\" aria-label=\"to\">\xe2\x86\x92</span>";
    const size_t reference = r->p->bracket->reference;
    const brace_banding_frame *before = &r->banding[0].frame[reference], *after = &r->banding[1].frame[reference];
    fputs("<dl class=\"facts\">\n<div><dt>Contrast of the stripes</dt><dd>", f);
    if (!bands(before) && bands(surest(&r->banding[0], reference))) {
        /* The measure missed them in the reference, so it says nothing about what is left of them. */
        fputs("unsure<small>the bracket bands, but in the reference it could not be measured</small></dd></div>\n", f);
    } else {
        fputs("<span class=\"b\">", f);
        write_contrast(f, before);
        fprintf(f, "</span> %s <span class=\"a\">", arrow);
        write_contrast(f, after);
        fprintf(f, "</span><small>of the light; sure of banding: %.0f %% before, %.0f %% after</small></dd></div>\n",
                100 * before->confidence, 100 * after->confidence);
    }
    if (r->spectra.period > 0) {
        const double turned = surest(&r->banding[0], reference)->orientation;
        fprintf(f, "<div><dt>Stripes</dt><dd>%.3g px<small>from one to the next, %.0f\xc2\xb0 off the rows</small></dd></div>\n",
                r->spectra.period, fmin(turned, 180 - turned));
        if (!isnan(r->spectra.decibel))
            fprintf(f, "<div><dt>Power at that period</dt><dd>%s%.1f dB<small>after against before</small></dd></div>\n",
                    r->spectra.decibel < 0 ? "\xe2\x88\x92" : "+", fabs(r->spectra.decibel));
    }
    if (r->picture[2] != NULL) {
        fputs("<div><dt>PSNR to the truth</dt><dd>", f);
        for (int k = 0; k < 2; k++) {
            fprintf(f, "%s <span class=\"%s\">", k > 0 ? arrow : "", r->spectra.css[k]);
            fprintf(f, isinf(r->measure[0][k]) ? "\xe2\x88\x9e" : "%.1f", r->measure[0][k]);
            fputs("</span> ", f);
        }
        fputs("<small>decibels, more is better</small></dd></div>\n", f);
    }
    const brace_restore_report *done = &r->p->restored->report;
    fputs("<div><dt>Method</dt><dd>", f);
    if (done->method == BRACE_METHOD_NETWORK)
        report_name(f, done->model);
    else
        fputs(brace_method_name(done->method), f);
    fprintf(f, "<small>BRACE %s, %.2f s</small></dd></div>\n</dl>\n", brace_version(), r->p->seconds);
}

static brace_status write_pictures(const report_page *page, const restore_report *r, brace_error *error) {
    static const char *const attributes[] = {"alt=\"The reference frame as shot\" data-label=\"As shot\"",
                                             "alt=\"The restored frame\" data-label=\"Restored\"",
                                             "alt=\"The true picture\" data-label=\"Truth\""};
    FILE *f = page->f;
    const uint32_t w = r->picture[0]->width, h = r->picture[0]->height;
    brace_status status = BRACE_OK;
    fprintf(f, "<figure class=\"viewer\" style=\"--ratio:%.5f\">\n", (double)w / h);
    for (int k = 0; k < 3 && status == BRACE_OK; k++)
        if (r->picture[k] != NULL)
            status = report_picture(page, r->picture[k], page->side, REPORT_PHOTO, attributes[k], error);
    fputs("</figure>\n", f);
    if (w > page->side || h > page->side)
        fprintf(f, "<p class=\"hint\">Pictures are shown with at most %u pixels a side; everything was measured on all "
                   "%u \xc3\x97 %u.</p>\n", page->side, w, h);
    fputs("<p class=\"hint keys\">Drag the divider. Wheel, pinch or <kbd>+</kbd> <kbd>\xe2\x88\x92</kbd> zoom, "
          "drag or arrow keys move, <kbd>0</kbd> whole picture, <kbd>1</kbd> pixel for pixel, <kbd>D</kbd> difference, "
          "<kbd>F</kbd> full screen.</p>\n", f);
    return status;
}

static void write_truth(FILE *f, const restore_report *r) {
    fputs("<h2>Against the truth</h2>\n<div class=\"scroll\"><table>\n<thead><tr><th scope=\"col\">Measure</th>"
          "<th scope=\"col\">As shot</th><th scope=\"col\">Restored</th><th scope=\"col\">Better is</th></tr></thead>\n<tbody>\n", f);
    for (int m = 0; m < MEASURES; m++) {
        const double *v = r->measure[m];
        fprintf(f, "<tr><th scope=\"row\">%s</th>", measures[m].name);
        for (int k = 0; k < 2; k++) {
            const bool better = measures[m].more ? v[k] > v[1 - k] : v[k] < v[1 - k];
            fprintf(f, "<td%s>", better ? " class=\"better\"" : "");
            if (isinf(v[k]))
                fputs("\xe2\x88\x9e", f);
            else
                fprintf(f, "%.*f%s", measures[m].digits, v[k], measures[m].unit);
            fputs("</td>", f);
        }
        fprintf(f, "<td class=\"none\">%s</td></tr>\n", measures[m].more ? "more" : "less");
    }
    fputs("</tbody></table></div>\n", f);
}

static brace_status write_frame(const report_page *page, const restore_report *r, size_t i, brace_error *error) {
    FILE *f = page->f;
    const brace_bracket *b = r->p->bracket;
    const brace_frame *frame = b->frames[i];
    const brace_restore_report *done = &r->p->restored->report;
    const brace_motion *m = &done->motion[i];
    const brace_banding_frame *banding = &r->banding[0].frame[i];
    const double ev = log2(b->exposure[i]);
    const brace_develop_params params = {.demosaic = BRACE_DEMOSAIC_BILINEAR, .sample = BRACE_SAMPLE_U8,
                                         .exposure = fmax(-16, fmin(16, r->p->out->exposure - ev))};
    char text[64], attributes[96];
    brace_image *image = NULL;
    brace_status status = brace_develop(&image, frame, &params, page->job, error);
    fprintf(f, "<li class=\"card%s\">", i == b->reference ? " chosen" : "");
    if (status == BRACE_OK) {
        snprintf(attributes, sizeof attributes, "alt=\"Frame %zu, made as bright as the reference\" loading=\"lazy\"", i + 1);
        status = report_picture(page, image, THUMBNAIL, REPORT_THUMBNAIL, attributes, error);
    }
    brace_image_destroy(image);
    fprintf(f, "<div class=\"body\"><h3>%s%s</h3><p class=\"file\">", cli_exposure_text(text, sizeof text, frame->exposure_time),
            i == b->reference ? " <span class=\"badge\">reference</span>" : "");
    report_name(f, cli_basename(frame->path));
    fputs("</p><dl>\n", f);
    if (frame->iso > 0)
        fprintf(f, "<dt>ISO</dt><dd>%.0f</dd>\n", frame->iso);
    if (frame->f_number > 0)
        fprintf(f, "<dt>Aperture</dt><dd>f/%.2g</dd>\n", frame->f_number);
    fprintf(f, "<dt>EV</dt><dd>%s%.2f</dd>\n", ev < -0.005 ? "\xe2\x88\x92" : ev > 0.005 ? "+" : "", fabs(ev));
    fputs("<dt>Banding</dt><dd>", f);
    write_contrast(f, banding);
    fputs("</dd>\n<dt>Motion</dt><dd>", f);
    if (i == b->reference)
        fputs("\xe2\x80\x93", f);
    else if (done->method != BRACE_METHOD_REFERENCE && !(m->confidence > 0))
        fputs("unknown", f);
    else
        fprintf(f, "%.1f px", hypot(m->dx, m->dy));
    fputs("</dd>\n", f);
    if (!isnan(done->weight[i])) /* networks don't tell */
        fprintf(f, "<dt>Weight</dt><dd>%.1f %%</dd></dl><span class=\"bar\" aria-hidden=\"true\"><i style=\"--v:%.4f\"></i>"
                   "</span>", 100 * done->weight[i], fmax(0, fmin(1, done->weight[i])));
    else
        fputs("</dl>", f);
    fputs("</div></li>\n", f);
    return status;
}

static void write_details(FILE *f, const restore_report *r) {
    const brace_bracket *b = r->p->bracket;
    const brace_restore_report *done = &r->p->restored->report;
    fputs("<details><summary>How it was made</summary><dl>\n", f);
    for (size_t i = 0; i < r->p->out->count; i++)
        if (r->p->out->items[i].written)
            report_fact(f, "Written", r->p->out->items[i].path);
    report_fact(f, "Reference", b->frames[b->reference]->path);
    if (r->p->truth != NULL)
        report_fact(f, "Truth", r->p->truth);
    if (b->frames[b->reference]->unique_model[0] != '\0')
        report_fact(f, "Camera", b->frames[b->reference]->unique_model);
    fprintf(f, "<dt>At white</dt><dd>%.2f %% of the result</dd>\n", 100 * done->clipped);
    if (done->method == BRACE_METHOD_NETWORK) {
        report_fact(f, "Weights", done->weights);
        fprintf(f, "<dt>Tiles</dt><dd>%zu of %d \xc3\x97 %d pixels, %s</dd>\n", done->tiles, done->tile_width,
                done->tile_height, done->precision == BRACE_PRECISION_BF16 ? "bf16" : "f32");
        fprintf(f, "<dt>Time</dt><dd>align %.2f s, network %.2f s, all %.2f s</dd>\n", done->seconds_align,
                done->seconds_network, r->p->seconds);
    } else {
        fprintf(f, "<dt>Time</dt><dd>align %.2f s, light %.2f s, fuse %.2f s, all %.2f s</dd>\n", done->seconds_align,
                done->seconds_light, done->seconds_fuse, r->p->seconds);
    }
    if (fabs(r->p->out->exposure) > 0)
        fprintf(f, "<dt>Brightness</dt><dd>pictures made brighter by %+.2g EV</dd>\n", r->p->out->exposure);
    report_fact(f, "Libraries", brace_dependencies());
    fputs("</dl></details>\n", f);
}

static brace_status write_all(const report_page *page, const restore_report *r, brace_error *error) {
    FILE *f = page->f;
    write_head(f, r);
    write_facts(f, r);
    brace_status status = write_pictures(page, r, error);
    if (status == BRACE_OK && r->picture[2] != NULL)
        write_truth(f, r);
    fprintf(f, "<h2>The frames</h2>\n<p class=\"hint\">All made as bright as the reference. %s of its stripes.</p>\n"
               "<ul class=\"grid\">\n",
            r->p->restored->report.method == BRACE_METHOD_NETWORK
                ? "Banding is the contrast"
                : "Weight is the share of the frame in the result, banding the contrast");
    for (size_t i = 0; i < r->p->bracket->count && status == BRACE_OK; i++)
        status = write_frame(page, r, i, error);
    fputs("</ul>\n<h2>Spectra</h2>\n<p class=\"hint\">Power of the reference before and after, by direction and fineness, "
          "the middle being coarse; on one scale of five decades. White rings: the strongest line.", f);
    if (r->spectra.period > 0)
        fputs(" Blue rings: where the stripes were.", f);
    fputs("</p>\n", f);
    if (status == BRACE_OK)
        status = report_spectra_write(page, &r->spectra, &r->result, error);
    report_notes(f, r->p->notes, r->p->note_count);
    write_details(f, r);
    fputs("</main>\n", f);
    return status;
}

brace_status report_restore(const report_restore_params *params, const brace_job *job, brace_error *error) {
    restore_report *r = core_calloc(1, sizeof *r);
    if (r == NULL)
        return core_fail_memory(error, sizeof *r, "the report");
    r->p = params;
    r->job = job;
    brace_status status = develop_pictures(r, error);
    if (status == BRACE_OK && params->truth != NULL)
        status = read_truth(r, error);
    if (status == BRACE_OK && params->truth != NULL)
        status = measure_truth(r, error);
    if (status == BRACE_OK)
        status = measure_banding(r, error);
    if (status == BRACE_OK)
        status = measure_spectra(r, error);
    report_page page = {.side = params->side > 0 ? (uint32_t)params->side : REPORT_SIDE};
    if (status == BRACE_OK)
        status = report_open(&page, params->path, "BRACE restoration", job, error);
    if (status == BRACE_OK)
        status = write_all(&page, r, error);
    status = report_close(&page, status, error);
    report_spectra_free(&r->spectra, &r->result);
    for (int k = 0; k < 3; k++)
        brace_image_destroy(r->picture[k]);
    core_free(r);
    return status;
}
