/* SPDX-License-Identifier: Apache-2.0 */
/*
 * driver_oled_pwm.c: a panel whose rows are switched on and off one after
 * another, several times a refresh.
 *
 * Within a refresh of one row: `pulses` trapezoids (their area may alternate),
 * on top of a steady part, and a dip while the row is written anew. Above a
 * brightness the current is lowered instead of the pulses' width (DC dimming):
 * the pulses are then as wide as they get. The dip multiplies by 1 - dip_depth,
 * so its share of the integral is that of the pulses within it.
 */
#include <math.h>
#include <stddef.h>

#include "sim/display.h"

#define AT(member) offsetof(oled_parameters, member)

static const char *const axes[] = {"y", "x", NULL};

static const sim_field fields[] = {
    {"refresh", FIELD_NUMBER, AT(refresh), 0, 1, 1000, JSON_CHECK_REQUIRED, NULL},
    {"pulses", FIELD_INTEGER, AT(pulses), 0, 1, 128, JSON_CHECK_REQUIRED, NULL},
    {"brightness", FIELD_NUMBER, AT(brightness), 0, 0.01, 1, 1, NULL},
    {"dc_above", FIELD_NUMBER, AT(dc_above), 0, 0.01, 1, 1, NULL},
    {"duty_max", FIELD_NUMBER, AT(duty_max), 0, 0.01, 1, 1, NULL},
    {"duty_min", FIELD_NUMBER, AT(duty_min), 0, 0.001, 1, 0.02, NULL},
    {"edge", FIELD_NUMBER, AT(edge), 0, 0, 1e-3, 20e-6, NULL},
    {"depth", FIELD_NUMBER, AT(depth), 0, 0, 1, 1, NULL},
    {"alternate", FIELD_NUMBER, AT(alternate), 0, 0, 0.9, 0, NULL},
    {"dip_depth", FIELD_NUMBER, AT(dip_depth), 0, 0, 1, 0, NULL},
    {"dip_start", FIELD_NUMBER, AT(dip_start), 0, 0, 1, 0, NULL},
    {"dip_width", FIELD_NUMBER, AT(dip_width), 0, 0, 0.5, 0, NULL},
    {"scan", FIELD_NUMBER, AT(scan), 0, -1, 1, 0.95, NULL},
    {"scan_axis", FIELD_CHOICE, AT(scan_axis), 0, 0, 1, 0, axes},
};

static void check(const json_at *at, sim_display *display) {
    const oled_parameters *p = &display->p.oled;
    if (p->duty_min > p->duty_max)
        json_check_fail(at, "duty_min", "%g is more than duty_max, %g", p->duty_min, p->duty_max);
    if (p->dip_start + p->dip_width > 1)
        json_check_fail(at, "dip_width", "the dip ends after the refresh: %g + %g is more than 1", p->dip_start,
                        p->dip_width);
    if (p->alternate > 0 && p->pulses % 2 != 0)
        json_check_fail(at, "alternate", "pulses that alternate must be even in number, not %lld",
                        (long long)p->pulses);
}

/* Without the dip, from the start of the refresh. */
static double plain_light(const oled_panel *d, double phase) {
    double k = floor(phase * d->rate);
    double u = phase - k * d->pulse;
    double odd = k - 2 * floor(0.5 * k);
    double pulse = sim_step_light(u, d->edge, d->half_rate) - sim_step_light(u - d->width, d->edge, d->half_rate);
    /* Pulses 0, 2, ... have area (1 + alternate), pulses 1, 3, ... (1 - alternate). */
    double area = d->width * (k + d->alternate * odd) + pulse * (1 + d->alternate * (1 - 2 * odd));
    return d->steady * phase + d->gain * area;
}

static brace_status prepare(sim_panel *panel, const float *rgb, brace_error *error) {
    (void)rgb;
    (void)error;
    const oled_parameters *p = &panel->display->p.oled;
    oled_panel *d = &panel->d.oled;
    panel->period = 1 / p->refresh;
    d->pulse = panel->period / (double)p->pulses;
    d->rate = 1 / d->pulse;
    d->edge = sim_clamp(p->edge, 1e-6 * d->pulse, 0.25 * d->pulse);
    d->half_rate = 0.5 / d->edge;
    double duty = p->duty_max;
    if (p->brightness < p->dc_above)
        duty = fmax(p->duty_min, p->duty_max * p->brightness / p->dc_above);
    double depth = duty < 1 ? p->depth : 0; /* lit all the time: no pulses */
    d->width = sim_clamp(duty * d->pulse, d->edge, d->pulse - d->edge);
    d->steady = 1 - depth;
    d->gain = depth * d->pulse / d->width;
    d->alternate = p->alternate;
    d->dip_start = p->dip_start * panel->period;
    d->dip_end = (p->dip_start + p->dip_width) * panel->period;
    d->dip_depth = p->dip_depth;
    d->dip_light = plain_light(d, d->dip_start);
    double total = panel->period - d->dip_depth * (plain_light(d, d->dip_end) - d->dip_light);
    if (!(total > 1e-9 * panel->period))
        return core_fail(error, BRACE_ERROR_ARGUMENT,
                         "%s: the dip takes all the light: make dip_width or dip_depth less", panel->display->name);
    d->norm = panel->period / total;
    if (p->scan_axis == 0)
        panel->start_y = p->scan * panel->period / panel->height;
    else
        panel->start_x = p->scan * panel->period / panel->width;
    return BRACE_OK;
}

static double light(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double phase) {
    (void)x;
    (void)y;
    (void)channel;
    const oled_panel *d = &panel->d.oled;
    double sum = plain_light(d, phase);
    if (d->dip_depth > 0)
        sum -= d->dip_depth * (plain_light(d, sim_clamp(phase, d->dip_start, d->dip_end)) - d->dip_light);
    return level * d->norm * sum;
}

static double emission(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double phase) {
    (void)x;
    (void)y;
    (void)channel;
    const oled_panel *d = &panel->d.oled;
    int64_t k = (int64_t)(phase / d->pulse);
    double u = phase - (double)k * d->pulse;
    double pulse = sim_step(u, d->edge) - sim_step(u - d->width, d->edge);
    double e = d->steady + d->gain * pulse * (k % 2 == 0 ? 1 + d->alternate : 1 - d->alternate);
    if (phase >= d->dip_start && phase < d->dip_end)
        e *= 1 - d->dip_depth;
    return level * d->norm * e;
}

static size_t edges(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double *out,
                    size_t size) {
    (void)x;
    (void)y;
    (void)channel;
    (void)level;
    const oled_panel *d = &panel->d.oled;
    size_t n = 0;
    for (int64_t k = 0; k < panel->display->p.oled.pulses && n + 6 <= size; k++) {
        double at = (double)k * d->pulse;
        out[n++] = at;
        out[n++] = at + d->edge;
        out[n++] = at + d->width;
        out[n++] = at + d->width + d->edge;
    }
    if (n + 2 <= size) {
        out[n++] = d->dip_start;
        out[n++] = d->dip_end;
    }
    return n;
}

const sim_driver sim_driver_oled_pwm = {
    .name = "oled_pwm",
    .fields = fields,
    .field_count = sizeof fields / sizeof *fields,
    .check = check,
    .prepare = prepare,
    .light = light,
    .emission = emission,
    .edges = edges,
};
