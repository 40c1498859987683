/* SPDX-License-Identifier: Apache-2.0 */
/*
 * driver_raster.c: a beam that visits each pixel once a refresh and leaves an
 * exponential afterglow: cathode-ray tubes, laser scanners.
 */
#include <math.h>
#include <stddef.h>

#include "sim/display.h"

#define AT(member) offsetof(raster_parameters, member)

static const char *const axes[] = {"y", "x", NULL};

static const sim_field fields[] = {
    {"refresh", FIELD_NUMBER, AT(refresh), 0, 1, 1000, JSON_CHECK_REQUIRED, NULL},
    {"decay", FIELD_NUMBERS, AT(decay), 3, 1e-7, 0.1, JSON_CHECK_REQUIRED, NULL},
    {"active", FIELD_NUMBER, AT(active), 0, 0.1, 1, 0.92, NULL},
    {"scan_axis", FIELD_CHOICE, AT(scan_axis), 0, 0, 1, 0, axes},
};

static brace_status prepare(sim_panel *panel, const float *rgb, brace_error *error) {
    (void)rgb;
    (void)error;
    const raster_parameters *p = &panel->display->p.raster;
    raster_panel *d = &panel->d.raster;
    panel->period = 1 / p->refresh;
    for (int c = 0; c < 3; c++) {
        d->rate[c] = 1 / p->decay[c];
        d->norm[c] = panel->period / -expm1(-panel->period * d->rate[c]);
    }
    /* Along a line the beam takes a line's time for all pixels. */
    double lines = p->scan_axis == 0 ? panel->height : panel->width;
    double pixels = p->scan_axis == 0 ? panel->width : panel->height;
    double line = p->active * panel->period / lines;
    panel->start_y = p->scan_axis == 0 ? line : line / pixels;
    panel->start_x = p->scan_axis == 0 ? line / pixels : line;
    return BRACE_OK;
}

static double light(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double phase) {
    (void)x;
    (void)y;
    const raster_panel *d = &panel->d.raster;
    return level * d->norm[channel] * (1 - exp(-phase * d->rate[channel]));
}

static double emission(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double phase) {
    (void)x;
    (void)y;
    const raster_panel *d = &panel->d.raster;
    return level * d->norm[channel] * d->rate[channel] * exp(-phase * d->rate[channel]);
}

static size_t edges(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double *out,
                    size_t size) {
    (void)panel;
    (void)x;
    (void)y;
    (void)channel;
    (void)level;
    if (size > 0)
        out[0] = 0;
    return size > 0;
}

const sim_driver sim_driver_raster = {
    .name = "raster",
    .fields = fields,
    .field_count = sizeof fields / sizeof *fields,
    .prepare = prepare,
    .light = light,
    .emission = emission,
    .edges = edges,
};
