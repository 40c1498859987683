/* SPDX-License-Identifier: Apache-2.0 */
/*
 * report_spectrum.c: two spectra side by side on one scale, and the power across the stripes over the stripes' period:
 * where the stripes were, nothing should stand out after a restoration.
 */
#include "cli/report.h"

#include <math.h>
#include <string.h>

#include "image/image.h"

enum { TILE = 480, POINTS = 160 };
static const double decades = 5, chart_db = 70;

/* ---- measuring ---- */

/* Where the stripes' frequency lies, in bins from the centre. */
static void stripe_bin(const report_spectra *s, const banding_spectrum *p, double *u, double *v) {
    const double f = s->pixels / s->period;
    *u = f * s->wave_y * (double)p->height, *v = f * s->wave_x * (double)p->width;
}

/* The strongest bin within two of the stripes' frequency: the Hann window spreads a line over that many. */
static double stripe_power(const report_spectra *s, const banding_spectrum *p) {
    double u0, v0, most = 0;
    stripe_bin(s, p, &u0, &v0);
    for (long u = lround(u0) - 2; u <= lround(u0) + 2; u++)
        for (long v = lround(v0) - 2; v <= lround(v0) + 2; v++)
            most = fmax(most, banding_spectrum_power(p, u, v));
    return most;
}

brace_status report_spectra_measure(report_spectra *s, report_spectra_result *r, const brace_job *job,
                                    brace_error *error) {
    core_pool *pool = NULL;
    brace_status status = core_pool_create(&pool, job, error);
    for (int k = 0; k < 2 && status == BRACE_OK; k++) {
        double r_min = 0, r_max = 0;
        const banding_plane *p = &s->plane[k];
        status = banding_ring(&r_min, &r_max, p->width, p->height, 0, 0, error);
        if (status == BRACE_OK)
            status = banding_spectrum_create(&r->spectrum[k], p->at, p->width, p->height, pool, job, error);
        if (status == BRACE_OK)
            banding_fabp(&r->fabp[k], &r->spectrum[k], r_min, r_max);
    }
    core_pool_destroy(pool);
    s->decibel = NAN;
    if (status == BRACE_OK && s->period > 2 * s->pixels) {
        const double before = stripe_power(s, &r->spectrum[0]), after = stripe_power(s, &r->spectrum[1]);
        s->decibel = before > 0 && after > 0 ? 10 * log10(after / before) : NAN;
    }
    return status;
}

void report_spectra_free(report_spectra *s, report_spectra_result *r) {
    for (int k = 0; k < 2; k++) {
        banding_spectrum_free(&r->spectrum[k]);
        banding_plane_free(&s->plane[k]);
    }
}

/* ---- the two pictures ---- */

/* Night blue over violet and orange to pale yellow: lighter is stronger, also in grey. */
static void heat(unsigned char out[3], double t) {
    static const double color[][3] = {{8, 10, 24}, {52, 24, 92}, {140, 40, 110}, {222, 88, 70}, {250, 168, 80}, {254, 246, 200}};
    enum { LAST = sizeof color / sizeof *color - 1 };
    t = fmax(0, fmin(1, t)) * LAST;
    const int i = t < LAST ? (int)t : LAST - 1;
    for (int c = 0; c < 3; c++)
        out[c] = (unsigned char)lround(color[i][c] + (t - i) * (color[i + 1][c] - color[i][c]));
}

static void ring(brace_image *image, double x, double y, double radius, double thick, const unsigned char color[3]) {
    const double reach = radius + thick + 1;
    for (long j = lround(y - reach); j <= lround(y + reach); j++)
        for (long i = lround(x - reach); i <= lround(x + reach); i++) {
            const double off = fabs(hypot((double)i - x, (double)j - y) - radius) - thick / 2;
            const double share = fmax(0, fmin(1, 0.5 - off));
            if (i < 0 || j < 0 || i >= (long)image->width || j >= (long)image->height || !(share > 0))
                continue;
            unsigned char *p = image_row(image, (uint32_t)j) + 3 * (size_t)i;
            for (int c = 0; c < 3; c++)
                p[c] = (unsigned char)lround(p[c] + share * (color[c] - p[c]));
        }
}

static double strongest(const banding_spectrum *s, const brace_fabp *f, long reach) {
    double most = 0;
    for (long u = -reach; u <= 0; u++)
        for (long v = -reach; v <= reach; v++)
            if (hypot((double)u, (double)v) >= f->r_min)
                most = fmax(most, banding_spectrum_power(s, u, v));
    return most;
}

static void draw(brace_image *image, const report_spectra *s, const banding_spectrum *p, const brace_fabp *f,
                 double reach, double most) {
    static const unsigned char cyan[3] = {90, 230, 255}, white[3] = {255, 255, 255};
    const double scale = 2 * reach / TILE;
    for (uint32_t j = 0; j < TILE; j++)
        for (uint32_t i = 0; i < TILE; i++) {
            /* The strongest bin under the pixel. */
            const double u0 = (j - TILE / 2.0) * scale, v0 = (i - TILE / 2.0) * scale;
            double power = 0;
            for (long u = lround(u0); u <= lround(u0 + scale) - (scale > 1); u++)
                for (long v = lround(v0); v <= lround(v0 + scale) - (scale > 1); v++)
                    power = fmax(power, banding_spectrum_power(p, u, v));
            heat(image_row(image, j) + 3 * (size_t)i, most > 0 ? 1 + log10(power / most + 1e-30) / decades : 0);
        }
    if (s->period > 2 * s->pixels) {
        double u, v;
        stripe_bin(s, p, &u, &v);
        for (int side = -1; side <= 1; side += 2)
            ring(image, TILE / 2.0 + side * v / scale, TILE / 2.0 + side * u / scale, 13, 2, cyan);
    }
    if (f->f > 0)
        for (int side = -1; side <= 1; side += 2)
            ring(image, TILE / 2.0 + side * f->v / scale, TILE / 2.0 + side * f->u / scale, 7, 2, white);
}

/* ---- the chart ---- */

/* Decibels over POINTS steps of the logarithm of frequency, 2 to `last` periods over the shorter side; NAN: no bin. */
static void profile(double out[POINTS], const banding_spectrum *p, const report_spectra *s, double last) {
    double sum[POINTS] = {0};
    size_t count[POINTS] = {0};
    const double side = (double)(p->width < p->height ? p->width : p->height);
    const long reach_u = lround(last * (double)p->height / side), reach_v = lround(last * (double)p->width / side);
    for (long u = -reach_u; u <= 0; u++)
        for (long v = -reach_v; v <= reach_v; v++) {
            const double fx = (double)v / (double)p->width, fy = (double)u / (double)p->height, f = hypot(fx, fy);
            const double at = log(f * side / 2) / log(last / 2) * (POINTS - 1);
            if (!(at >= 0) || at > POINTS - 1 || fabs(fx * s->wave_x + fy * s->wave_y) < cos(M_PI / 18) * f)
                continue;
            sum[lround(at)] += banding_spectrum_power(p, u, v), count[lround(at)]++;
        }
    for (int i = 0; i < POINTS; i++)
        out[i] = count[i] > 0 ? 10 * log10(sum[i] / (double)count[i] + 1e-30) : NAN;
}

static void write_chart(FILE *f, const report_spectra *s, const report_spectra_result *r) {
    const double left = 50, right = 510, top = 12, bottom = 262;
    const banding_spectrum *p = &r->spectrum[0];
    const double side = (double)(p->width < p->height ? p->width : p->height), last = fmax(4, r->fabp[0].r_max);
    double db[2][POINTS], most = -INFINITY;
    for (int k = 0; k < 2; k++) {
        profile(db[k], &r->spectrum[k], s, last);
        for (int i = 0; i < POINTS; i++)
            most = isnan(db[k][i]) ? most : fmax(most, db[k][i]);
    }
    fputs("<figure class=\"card chart\"><h3>Power across the stripes</h3><ul class=\"legend\">", f);
    for (int k = 0; k < 2; k++)
        fprintf(f, "<li><span class=\"%s\"><span class=\"swatch\"></span></span>%s</li>", s->css[k], s->label[k]);
    fprintf(f, "</ul>\n<svg viewBox=\"0 0 520 306\" role=\"img\" aria-label=\"Power in decibels over the period, %s and "
               "%s\">\n", s->label[0], s->label[1]);
    for (int d = 0; d <= (int)chart_db; d += 10) {
        const double y = top + (bottom - top) * d / chart_db;
        fprintf(f, "<line class=\"axis\" x1=\"%g\" x2=\"%g\" y1=\"%.1f\" y2=\"%.1f\"/>", left, right, y, y);
        if (d % 20 == 0)
            fprintf(f, "<text x=\"%g\" y=\"%.1f\" text-anchor=\"end\">%s%d%s</text>\n", left - 8, y + 4.5, d > 0 ? "\xe2\x88\x92" : "", d,
                    d > 0 ? "" : " dB");
    }
    static const int periods[] = {2000, 1000, 500, 200, 100, 50, 20, 10, 5, 2};
    double shown = -INFINITY;
    for (size_t i = 0; i < sizeof periods / sizeof *periods; i++) {
        const double x = left + (right - left) * log(s->pixels * side / periods[i] / 2) / log(last / 2);
        if (x < left || x > right || x < shown + 48)
            continue;
        shown = x;
        fprintf(f, "<line class=\"axis\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%g\" y2=\"%g\"/>"
                   "<text x=\"%.1f\" y=\"%g\" text-anchor=\"middle\">%d</text>\n",
                x, x, bottom, bottom + 5, x, bottom + 19, periods[i]);
    }
    fprintf(f, "<text x=\"%g\" y=\"%g\" text-anchor=\"end\">period, pixels</text>\n", right, bottom + 40);
    const double at = s->period > 0 ? log(s->pixels * side / s->period / 2) / log(last / 2) : -1;
    if (at > 0 && at < 1) {
        const double x = left + (right - left) * at;
        fprintf(f, "<line x1=\"%.1f\" x2=\"%.1f\" y1=\"%g\" y2=\"%g\" stroke=\"currentColor\" stroke-dasharray=\"3 4\" "
                   "opacity=\".55\"/><text x=\"%.1f\" y=\"%g\"%s>the stripes, %.3g px</text>\n",
                x, x, top, bottom, x + (at > 0.7 ? -7 : 7), top + 14, at > 0.7 ? " text-anchor=\"end\"" : "", s->period);
    }
    for (int k = 0; k < 2; k++) {
        fprintf(f, "<polyline class=\"p%s\" points=\"", s->css[k]);
        for (int i = 0; i < POINTS; i++)
            if (!isnan(db[k][i]))
                fprintf(f, "%.1f,%.1f ", left + (right - left) * i / (POINTS - 1),
                        top + (bottom - top) * fmin(1, (most - db[k][i]) / chart_db));
        fputs("\"/>\n", f);
    }
    fputs("</svg></figure>\n", f);
}

brace_status report_spectra_write(const report_page *page, const report_spectra *s, const report_spectra_result *r,
                                  brace_error *error) {
    FILE *f = page->f;
    brace_image *image = NULL;
    brace_status status = brace_image_create(&image, TILE, TILE, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, error);
    const double reach = fmax(r->fabp[0].r_max * 1.05, 8);
    const double most = fmax(strongest(&r->spectrum[0], &r->fabp[0], (long)reach),
                             strongest(&r->spectrum[1], &r->fabp[1], (long)reach));
    fputs("<div class=\"spectra\">\n", f);
    for (int k = 0; k < 2 && status == BRACE_OK; k++) {
        char attributes[160];
        const brace_fabp *p = &r->fabp[k];
        draw(image, s, &r->spectrum[k], p, reach, most);
        snprintf(attributes, sizeof attributes, "alt=\"Power spectrum, %s\"", s->label[k]);
        fputs("<figure class=\"card spectrum\">", f);
        status = report_picture(page, image, TILE, REPORT_PLOT, attributes, error);
        fprintf(f, "<figcaption><b>%s.</b> ", s->label[k]);
        if (p->refined_f > 0)
            fprintf(f, "Strongest line: a period of %.3g px, with %.1f %% of the power.", s->pixels / p->refined_f,
                    100 * p->rho);
        else
            fputs("No line: the picture is constant.", f);
        fputs("</figcaption></figure>\n", f);
    }
    if (status == BRACE_OK)
        write_chart(f, s, r);
    fputs("</div>\n", f);
    brace_image_destroy(image);
    return status;
}
