/* SPDX-License-Identifier: Apache-2.0 */
/*
 * driver_bcm.c: binary code modulation: a level is a number, and each of its
 * bits is lit for a time of that bit's weight.
 *
 * `order` lists the bit planes as they are shown; a plane that is listed k times
 * is split into k equal parts. Multiplexed matrices (HUB75) show the planes to
 * one group of rows after another: all planes of a group, then the next group
 * ("rows"), or a plane of all groups, then the next plane ("planes").
 * Sequential colour (a projector's wheel or LEDs) gives each colour a window of
 * the refresh. The light up to a phase is a sum over the segments, whose number
 * is the display's, so its cost doesn't depend on the time.
 *
 * A level between two codes takes the nearer code's planes at its own light.
 */
#include <math.h>
#include <stddef.h>

#include "sim/display.h"

#define AT(member) offsetof(bcm_parameters, member)

static const char *const layouts[] = {"rows", "planes", NULL};

static const sim_field fields[] = {
    {"refresh", FIELD_NUMBER, AT(refresh), 0, 1, 20000, JSON_CHECK_REQUIRED, NULL},
    {"bits", FIELD_INTEGER, AT(bits), 0, 1, 16, JSON_CHECK_REQUIRED, NULL},
    {"scan", FIELD_INTEGER, AT(scan), 0, 1, 64, 1, NULL},
    {"layout", FIELD_CHOICE, AT(layout), 0, 0, 1, 0, layouts},
    {"duty", FIELD_NUMBER, AT(duty), 0, 0.01, 1, 1, NULL},
};

/* Also reads `order` and `windows`, whose lengths or defaults are not plain. */
static void check(const json_at *at, sim_display *display) {
    bcm_parameters *p = &display->p.bcm;
    p->segments =
        json_check_numbers(at, "order", p->order, (size_t)p->bits, BCM_SEGMENTS, 0, (double)p->bits - 1, false);
    if (p->segments == 0) {
        p->segments = (size_t)p->bits;
        for (size_t i = 0; i < p->segments; i++)
            p->order[i] = (double)i;
    }
    unsigned seen = 0;
    for (size_t i = 0; i < p->segments; i++) {
        if (p->order[i] != floor(p->order[i])) {
            json_check_fail(at, "order", "%g is not a whole number", p->order[i]);
            return;
        }
        seen |= 1u << (unsigned)p->order[i];
    }
    for (int b = 0; b < p->bits; b++)
        if ((seen >> b & 1) == 0)
            json_check_fail(at, "order", "bit plane %d is missing", b);
    for (int c = 0; c < 3; c++) {
        p->windows[2 * c] = 0;
        p->windows[2 * c + 1] = 1;
    }
    if (json_check_numbers(at, "windows", p->windows, 6, 6, 0, 1, false) == 0)
        return;
    for (int c = 0; c < 3; c++)
        if (p->windows[2 * c + 1] < 0.01 || p->windows[2 * c] + p->windows[2 * c + 1] > 1 + 1e-9)
            json_check_fail(at, "windows", "colour %d: a start and a length (0.01 or more) that end by 1 are expected",
                            c);
    if (p->scan > 1)
        json_check_fail(at, "windows", "colours one after another and scan %lld do not go together",
                        (long long)p->scan);
}

static void json(const sim_display *display, json_t *out) {
    const bcm_parameters *p = &display->p.bcm;
    json_t *order = json_array();
    for (size_t i = 0; i < p->segments; i++)
        json_array_append_new(order, json_integer((json_int_t)p->order[i]));
    json_object_set_new(out, "order", order);
    if (p->scan > 1)
        return;
    json_t *windows = json_array();
    for (int i = 0; i < 6; i++)
        json_array_append_new(windows, json_real(p->windows[i]));
    json_object_set_new(out, "windows", windows);
}

static brace_status prepare(sim_panel *panel, const float *rgb, brace_error *error) {
    (void)rgb;
    (void)error;
    const bcm_parameters *p = &panel->display->p.bcm;
    bcm_panel *d = &panel->d.bcm;
    panel->period = 1 / p->refresh;
    d->top = ldexp(1, (int)p->bits) - 1;
    d->segments = p->segments;
    double share = 1 / (double)p->scan, at = 0;
    double unit = panel->period * share / d->top;
    for (size_t j = 0; j < d->segments; j++) {
        int times = 0;
        for (size_t k = 0; k < d->segments; k++)
            times += p->order[k] == p->order[j];
        d->plane[j] = (int)p->order[j];
        double length = unit * ldexp(1, d->plane[j]) / times;
        d->lit[j] = length * p->duty;
        d->start[j] = p->layout == 0 ? at : at * (double)p->scan;
        d->step[j] = p->layout == 0 ? 0 : length;
        at += length;
    }
    d->unit = unit * p->duty;
    panel->scan = (double)p->scan;
    panel->scan_rate = 1 / panel->scan;
    panel->start_scan = p->layout == 0 ? panel->period * share : 0;
    for (int c = 0; c < 3; c++) {
        d->scale[c] = p->windows[2 * c + 1];
        panel->start_channel[c] = p->windows[2 * c] * panel->period;
    }
    return BRACE_OK;
}

static uint32_t code_of(const bcm_panel *d, double level) {
    return (uint32_t)sim_clamp(rint(level * d->top), 1, d->top);
}

static double light(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double phase) {
    (void)x;
    const bcm_panel *d = &panel->d.bcm;
    uint32_t code = code_of(d, level), group = y % (uint32_t)panel->scan;
    double sum = 0;
    phase /= d->scale[channel];
    for (size_t j = 0; j < d->segments; j++)
        if (code >> d->plane[j] & 1)
            sum += sim_clamp(phase - (d->start[j] + group * d->step[j]), 0, d->lit[j]);
    return level * panel->period * sum / (code * d->unit);
}

static double emission(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double phase) {
    (void)x;
    const bcm_panel *d = &panel->d.bcm;
    uint32_t code = code_of(d, level), group = y % (uint32_t)panel->scan;
    phase /= d->scale[channel];
    for (size_t j = 0; j < d->segments; j++) {
        double u = phase - (d->start[j] + group * d->step[j]);
        if (u >= 0 && u < d->lit[j] && (code >> d->plane[j] & 1))
            return level * panel->period / (code * d->unit * d->scale[channel]);
    }
    return 0;
}

static size_t edges(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double *out,
                    size_t size) {
    (void)x;
    const bcm_panel *d = &panel->d.bcm;
    uint32_t code = code_of(d, level), group = y % (uint32_t)panel->scan;
    size_t n = 0;
    for (size_t j = 0; j < d->segments && n + 2 <= size; j++)
        if (code >> d->plane[j] & 1) {
            double at = d->start[j] + group * d->step[j];
            out[n++] = at * d->scale[channel];
            out[n++] = (at + d->lit[j]) * d->scale[channel];
        }
    return n;
}

const sim_driver sim_driver_bcm = {
    .name = "bcm",
    .fields = fields,
    .field_count = sizeof fields / sizeof *fields,
    .check = check,
    .json = json,
    .prepare = prepare,
    .light = light,
    .emission = emission,
    .edges = edges,
};
