/* SPDX-License-Identifier: Apache-2.0 */
/*
 * plot.c: an analysis of banding as a picture. A column for each frame: the frame,
 * made as bright as the others, with an arrow across its stripes; below it its power spectrum (logarithmic), with
 * the centre, the ring and the peak of the banding prior. At the bottom the
 * spectra along the stripes' direction and how the contrast decays with exposure.
 */
#include "cli/plot.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "banding/banding.h"
#include "image/image.h"
#include "image/label.h"

enum { TILE = 320, GAP = 8, CHART = 300 };

static const uint8_t white[3] = {224, 224, 224}, cyan[3] = {64, 216, 255}, grey[3] = {110, 110, 110};
static const uint8_t curve[9][3] = {{204, 64, 120}, {240, 140, 60}, {240, 210, 80}, {110, 190, 110}, {90, 150, 220},
                                    {160, 120, 220}, {200, 200, 200}, {150, 110, 80}, {80, 200, 190}};

static void dot(brace_image *image, double x, double y, const uint8_t color[3]) {
    if (x >= 0 && y >= 0 && x < image->width && y < image->height)
        memcpy(image_row(image, (uint32_t)y) + 3 * (size_t)x, color, 3);
}

static void line(brace_image *image, double x0, double y0, double x1, double y1, int thick, const uint8_t color[3]) {
    const int steps = (int)fmin(fmax(fabs(x1 - x0), fabs(y1 - y0)), 10000) + 1;
    for (int i = 0; i <= steps; i++)
        for (int dy = 0; dy < thick; dy++)
            for (int dx = 0; dx < thick; dx++)
                dot(image, x0 + (x1 - x0) * i / steps + dx - thick / 2, y0 + (y1 - y0) * i / steps + dy - thick / 2,
                    color);
}

static void arrow(brace_image *image, double x, double y, double dx, double dy, const uint8_t color[3]) {
    line(image, x - dx, y - dy, x + dx, y + dy, 3, color);
    for (int side = -1; side <= 1; side += 2) {
        const double hx = -0.25 * dx - side * 0.18 * dy, hy = -0.25 * dy + side * 0.18 * dx;
        line(image, x + dx, y + dy, x + dx + hx, y + dy + hy, 3, color);
    }
}

static void circle(brace_image *image, double x, double y, double r, int thick, const uint8_t color[3]) {
    for (double a = 0; a < 2 * M_PI; a += 0.5 / fmax(r, 1))
        for (int i = 0; i < thick; i++)
            dot(image, x + (r + i) * cos(a), y + (r + i) * sin(a), color);
}

static uint32_t tile_x(size_t i) {
    return GAP + (uint32_t)i * (TILE + GAP);
}

static double exposure_of(const brace_frame *f) {
    return f->exposure_time * (f->iso > 0 ? f->iso : 100) / (f->f_number > 0 ? f->f_number * f->f_number : 1);
}

/* Across the stripes, unit length: as the rows' light has it, else the spectrum's peak. False: nothing was found. */
static bool wave(const brace_banding_frame *f, double *x, double *y) {
    if (f->confidence >= 0.5 && f->frequency > 0) {
        const double a = (f->orientation - 90) * M_PI / 180;
        *x = cos(a), *y = sin(a);
        if (*y < 0)
            *x = -*x, *y = -*y;
        return true;
    }
    /* A wave vector has no sign: down, or to the right. */
    *x = -f->fabp.refined_fx / fmax(f->fabp.refined_f, 1e-12), *y = -f->fabp.refined_fy / fmax(f->fabp.refined_f, 1e-12);
    return f->fabp.refined_f > 0;
}

/* ---- the columns ---- */

static brace_status add_frame(brace_image *plot, const brace_banding_frame *f, const brace_frame *frame, double ev,
                              size_t column, uint32_t high, const brace_job *job, brace_error *error) {
    brace_image *full = NULL, *small = NULL;
    const brace_develop_params params = {.demosaic = BRACE_DEMOSAIC_BILINEAR, .exposure = ev,
                                         .sample = BRACE_SAMPLE_U8, .as_stored = true};
    brace_status status = brace_develop(&full, frame, &params, job, error);
    if (status == BRACE_OK)
        status = brace_image_resize(&small, full, TILE, high, error);
    brace_image_destroy(full);
    if (status != BRACE_OK)
        return status;
    const uint32_t x = tile_x(column), y = GAP;
    for (uint32_t row = 0; row < high; row++)
        memcpy(image_row(plot, y + row) + 3 * (size_t)x, image_row(small, row), 3 * TILE);
    brace_image_destroy(small);
    double wx, wy;
    if (wave(f, &wx, &wy)) {
        const double reach = 0.12 * TILE + 0.25 * fmin(TILE, high) * (f->confidence >= 0.5 ? f->contrast : 0);
        arrow(plot, x + TILE / 2.0, y + high / 2.0, reach * wx, reach * wy, f->confidence >= 0.5 ? cyan : grey);
    }
    char text[64];
    if (f->exposure_time > 0 && f->exposure_time < 0.3)
        snprintf(text, sizeof text, "1/%.0f s", 1 / f->exposure_time);
    else
        snprintf(text, sizeof text, f->exposure_time > 0 ? "%.2g s" : "? s", f->exposure_time);
    image_label(plot, x, y, text, white);
    if (f->confidence >= 0.5)
        snprintf(text, sizeof text, "%.0f %% deep, %.0f %% sure", 100 * f->contrast, 100 * f->confidence);
    else
        snprintf(text, sizeof text, "%.0f %% sure", 100 * f->confidence);
    image_label(plot, x, y + high - IMAGE_LABEL_HEIGHT, text, white);
    return BRACE_OK;
}

/* Dark violet over red to light yellow, by the logarithm. */
static void heat(uint8_t out[3], double t) {
    t = fmax(0, fmin(1, t));
    out[0] = (uint8_t)(255 * fmin(1, 1.7 * t));
    out[1] = (uint8_t)(255 * pow(fmax(0, t - 0.35) / 0.65, 1.2));
    out[2] = (uint8_t)(255 * (t < 0.5 ? 0.08 + 0.5 * t : fmax(0, 0.33 - 0.6 * (t - 0.5)) + pow(fmax(0, t - 0.75) / 0.25, 2) * 0.6));
}

static void add_spectrum(brace_image *plot, const banding_spectrum *s, const brace_fabp *f, size_t column,
                         uint32_t top) {
    const double reach = fmax(f->r_max * 1.05, 8), scale = 2 * reach / TILE;
    double most = 1e-30;
    for (long u = -(long)reach; u <= 0; u++)
        for (long v = -(long)reach; v <= (long)reach; v++)
            if (hypot((double)u, (double)v) >= f->r_min)
                most = fmax(most, banding_spectrum_power(s, u, v));
    const uint32_t x = tile_x(column);
    for (uint32_t j = 0; j < TILE; j++)
        for (uint32_t i = 0; i < TILE; i++) {
            /* The strongest bin under the pixel. */
            const double u0 = (j - TILE / 2.0) * scale, v0 = (i - TILE / 2.0) * scale;
            double power = 0;
            for (long u = lround(u0); u <= lround(u0 + scale) - (scale > 1); u++)
                for (long v = lround(v0); v <= lround(v0 + scale) - (scale > 1); v++)
                    power = fmax(power, banding_spectrum_power(s, u, v));
            /* Five decades. */
            heat(image_row(plot, top + j) + 3 * (size_t)(x + i), 1 + log10(power / most + 1e-30) / 5);
        }
    const double cx = x + TILE / 2.0, cy = top + TILE / 2.0;
    circle(plot, cx, cy, f->r_min / scale, 1, grey);
    circle(plot, cx, cy, f->r_max / scale, 1, grey);
    line(plot, cx - 5, cy, cx + 5, cy, 1, white), line(plot, cx, cy - 5, cx, cy + 5, 1, white);
    if (f->f > 0)
        circle(plot, cx + f->v / scale, cy + f->u / scale, 7, 2, cyan);
    char text[64];
    snprintf(text, sizeof text, "rho %.3f", f->rho);
    image_label(plot, x, top, text, white);
}

/* ---- the charts ---- */

static void frame_chart(brace_image *plot, uint32_t x, uint32_t y, uint32_t wide, const char *title) {
    line(plot, x, y, x, y + CHART, 1, grey), line(plot, x, y + CHART, x + wide, y + CHART, 1, grey);
    image_label(plot, x + 6, y, title, white);
}

/* Log of the mean power in a sector of 10 degrees about the direction, over the radius. `at` has `radii` numbers. */
static void radial(double *at, size_t radii, const banding_spectrum *s, double wx, double wy) {
    for (size_t k = 0; k < radii; k++) {
        double sum = 0;
        size_t n = 0;
        const long r = (long)k + 1;
        for (long u = -r - 1; u <= 0; u++)
            for (long v = -r - 1; v <= r + 1; v++) {
                const double fx = (double)v / (double)s->width, fy = (double)u / (double)s->height;
                if (lround(hypot((double)u, (double)v)) != r || fabs(fx * wx + fy * wy) < cos(M_PI / 18) * hypot(fx, fy))
                    continue;
                sum += banding_spectrum_power(s, u, v), n++;
            }
        at[k] = n ? log10(sum / (double)n + 1e-30) : NAN;
    }
}

static void draw_radial(brace_image *plot, double (*profile)[TILE], size_t count, size_t radii, uint32_t x,
                        uint32_t top, uint32_t wide) {
    double high = -INFINITY;
    for (size_t i = 0; i < count; i++)
        for (size_t k = 2; k < radii; k++)
            high = isnan(profile[i][k]) ? high : fmax(high, profile[i][k]);
    frame_chart(plot, x, top, wide, "power along the arrow, over periods in the frame");
    for (size_t i = 0; i < count; i++)
        for (size_t k = 1; k < radii; k++) {
            const double y0 = fmin(fmax((high - profile[i][k - 1]) / 7, 0), 1) * (CHART - 30) + 26;
            const double y1 = fmin(fmax((high - profile[i][k]) / 7, 0), 1) * (CHART - 30) + 26;
            if (!isnan(y0) && !isnan(y1))
                line(plot, x + (double)k * wide / (double)radii, top + y0, x + (double)(k + 1) * wide / (double)radii,
                     top + y1, 2, curve[i]);
        }
    for (int tick = 1; tick <= 4; tick++) {
        char text[32];
        snprintf(text, sizeof text, "%zu", radii * (size_t)tick / 4);
        image_label(plot, x + wide * (uint32_t)tick / 4 - image_label_width(text), top + CHART + 3, text, white);
    }
}

static void draw_decay(brace_image *plot, const brace_banding *b, uint32_t x, uint32_t top, uint32_t wide) {
    double shortest = INFINITY, longest = 0, strongest = 0, expected = 0;
    for (size_t i = 0; i < b->count; i++) {
        const brace_banding_frame *f = &b->frame[i];
        if (!(f->exposure_time > 0))
            continue;
        shortest = fmin(shortest, f->exposure_time), longest = fmax(longest, f->exposure_time);
        if (f->confidence * f->harmonic[0] > strongest) {
            strongest = f->confidence * f->harmonic[0];
            const double c = M_PI * b->hz * f->exposure_time;
            expected = f->harmonic[0] / fmax(0.1, b->hz > 0 ? fabs(sin(c) / c) : 1);
        }
    }
    frame_chart(plot, x, top, wide, "contrast (%), over exposure time");
    if (!(longest > 0))
        return;
    const double span = log(fmax(longest / shortest, 2)) + 0.7, left = log(shortest) - 0.35, floor_of = log10(0.003);
    for (uint32_t i = 0; i < wide && b->hz > 0 && b->confidence >= 0.5; i++) {
        const double t = exp(left + span * i / wide), c = M_PI * b->hz * t;
        const double level = log10(fmin(1, fmax(0.003, expected * fabs(sin(c) / c))));
        dot(plot, x + i, top + CHART - 4 - (CHART - 34) * (1 - level / floor_of), grey);
    }
    for (size_t i = 0; i < b->count; i++) {
        const brace_banding_frame *f = &b->frame[i];
        if (!(f->exposure_time > 0))
            continue;
        const double px = x + wide * (log(f->exposure_time) - left) / span;
        const double py = top + CHART - 4 - (CHART - 34) * (1 - log10(fmin(1, fmax(0.003, f->contrast))) / floor_of);
        circle(plot, px, py, 5, f->confidence >= 0.5 ? 4 : 1, curve[i]);
        char text[32];
        snprintf(text, sizeof text, "1/%.0f", 1 / f->exposure_time);
        if (f->exposure_time >= 0.3)
            snprintf(text, sizeof text, "%.2g", f->exposure_time);
        image_label(plot, (uint32_t)fmin(fmax(px - image_label_width(text) / 2.0, x), plot->width - 80), top + CHART + 3,
                    text, curve[i]);
    }
    static const int percent[] = {1, 10, 100};
    for (size_t i = 0; i < sizeof percent / sizeof *percent; i++) {
        char text[16];
        snprintf(text, sizeof text, "%d", percent[i]);
        image_label(plot, x - image_label_width(text) - 2,
                    top + CHART - 14 - (uint32_t)((CHART - 34) * (1 - log10(percent[i] / 100.0) / floor_of)), text, white);
    }
}

static void summary(char *text, size_t size, const brace_banding *b) {
    if (b->confidence < 0.5)
        snprintf(text, size, "no banding found (%.0f %% sure that there is some)", 100 * b->confidence);
    else if (b->hz > 0)
        snprintf(text, size, "%.5g Hz (+- %.2g %%), %s, %.0f %% sure", b->hz, 100 * b->frequency_error,
                 brace_banding_source_name(b->source), 100 * b->confidence);
    else
        snprintf(text, size, "%.4g rows from stripe to stripe, %.0f %% sure", b->frequency > 0 ? 1 / b->frequency : 0,
                 100 * b->confidence);
    for (char *c = text; *c; c++)
        *c = *c == '_' ? ' ' : *c;
}

brace_status cli_plot(brace_image **out, const brace_banding *b, const brace_frame *const *frames,
                      const brace_job *job, brace_error *error) {
    const double shape = (double)frames[0]->height / frames[0]->width;
    const uint32_t high = (uint32_t)fmax(40, fmin(2 * TILE, TILE * shape)), spectra = 2 * GAP + high;
    const uint32_t charts = spectra + TILE + 2 * GAP, columns = (uint32_t)(b->count < 3 ? 3 : b->count);
    const uint32_t width = tile_x(columns), height = charts + CHART + 70;
    brace_image *plot = NULL;
    brace_status status = brace_image_create(&plot, width, height, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, error);
    double (*profile)[TILE] = core_calloc(b->count, sizeof *profile);
    if (status == BRACE_OK && !profile)
        status = core_fail_memory(error, b->count * sizeof *profile, "a plot");
    if (status == BRACE_OK)
        memset(plot->data, 24, plot->stride * plot->height);
    core_pool *pool = NULL;
    if (status == BRACE_OK)
        status = core_pool_create(&pool, job, error);
    /* All as bright as the one in the middle. */
    double middle = 0, wx = 0, wy = 1;
    size_t shorter = 0;
    for (size_t i = 0; i < b->count; i++) {
        size_t rank = 0;
        for (size_t j = 0; j < b->count; j++)
            rank += exposure_of(frames[j]) < exposure_of(frames[i]) || (exposure_of(frames[j]) == exposure_of(frames[i]) && j < i);
        if (rank == (b->count - 1) / 2)
            middle = exposure_of(frames[i]);
        if (rank == 0)
            shorter = i;
    }
    wave(&b->frame[shorter], &wx, &wy);
    const size_t radii = (size_t)fmin(TILE, fmax(4, b->frame[0].fabp.r_max));
    for (size_t i = 0; i < b->count && status == BRACE_OK; i++) {
        const double mine = exposure_of(frames[i]), ev = mine > 0 && middle > 0 ? log2(middle / mine) : 0;
        banding_plane plane = {0};
        banding_spectrum spectrum = {0};
        status = add_frame(plot, &b->frame[i], frames[i], fmax(-16, fmin(16, ev)), i, high, job, error);
        if (status == BRACE_OK)
            status = banding_plane_frame(&plane, frames[i], pool, error);
        if (status == BRACE_OK)
            status = banding_spectrum_create(&spectrum, plane.at, plane.width, plane.height, pool, job, error);
        if (status == BRACE_OK) {
            add_spectrum(plot, &spectrum, &b->frame[i].fabp, i, spectra);
            radial(profile[i], radii, &spectrum, wx, wy);
        }
        banding_spectrum_free(&spectrum);
        banding_plane_free(&plane);
    }
    if (status == BRACE_OK) {
        const uint32_t half = (width - 4 * GAP - 60) / 2;
        draw_radial(plot, profile, b->count, radii, GAP, charts, half);
        draw_decay(plot, b, 3 * GAP + half + 50, charts, half);
        char text[160];
        summary(text, sizeof text, b);
        image_label(plot, GAP, height - IMAGE_LABEL_HEIGHT - 8, text, cyan);
    }
    core_pool_destroy(pool);
    core_free(profile);
    if (status != BRACE_OK)
        brace_image_destroy(plot);
    else
        *out = plot;
    return status;
}
