/* SPDX-License-Identifier: Apache-2.0 */
/*
 * driver_lcd_pwm.c: a liquid-crystal panel in front of a pulsed backlight.
 *
 * All pixels of a zone of the backlight share its pulse: a trapezoid. What
 * the eye and the camera get is that pulse through a first-order low pass for
 * each colour, because a white LED is a fast blue die behind slow phosphors:
 * y' = (x - y)/decay. Hence its integral is that of the pulse, less
 * decay*(y(t) - y(0)). In its periodic state y is a line plus an exponential
 * between any two corners of the pulse.
 *
 * Local dimming (mini-LED) gives each zone a pulse width from its content; the
 * crystals open further in return, so the mean stays that of the content.
 */
#include <math.h>
#include <stddef.h>

#include "sim/display.h"

#define AT(member) offsetof(lcd_parameters, member)

static const sim_field fields[] = {
    {"frequency", FIELD_NUMBER, AT(frequency), 0, 50, 500000, JSON_CHECK_REQUIRED, NULL},
    {"duty", FIELD_NUMBER, AT(duty), 0, 0.005, 0.995, JSON_CHECK_REQUIRED, NULL},
    {"edge", FIELD_NUMBER, AT(edge), 0, 0, 1e-3, 1e-6, NULL},
    {"depth", FIELD_NUMBER, AT(depth), 0, 0, 1, 1, NULL},
    {"decay", FIELD_NUMBERS, AT(decay), 3, 0, 0.02, 0, NULL},
    {"zone_columns", FIELD_INTEGER, AT(zone_columns), 0, 1, 256, 1, NULL},
    {"zone_rows", FIELD_INTEGER, AT(zone_rows), 0, 1, 256, 1, NULL},
    {"zone_floor", FIELD_NUMBER, AT(zone_floor), 0, 0.01, 1, 1, NULL},
    {"zone_scan", FIELD_NUMBER, AT(zone_scan), 0, -1, 1, 0, NULL},
};

/*
 * Filters faster or slower than this, in periods, are as good as none and as the
 * slowest one, which leaves a ripple of at most 0.25 %. Beyond it, and with edges
 * below shortest_edge, the terms in decay/edge cancel to fewer than 8 digits.
 */
static const double fastest_filter = 1e-6, slowest_filter = 100, shortest_edge = 1e-4;

static lcd_zone make_zone(double period, double edge, double width, double decay) {
    lcd_zone z = {.width = width};
    if (decay <= 0)
        return z;
    /* What is left at phase 0 of all earlier pulses, a geometric series. */
    double g = decay / edge * -expm1(-edge / decay);
    z.first = g * (exp(-(period - width - edge) / decay) - exp(-(period - edge) / decay)) / -expm1(-period / decay);
    z.tail[0] = z.first + decay / edge;
    double y1 = 1 - decay / edge + z.tail[0] * exp(-edge / decay);
    z.tail[1] = y1 - 1;
    double y2 = 1 + z.tail[1] * exp(-(width - edge) / decay);
    z.tail[2] = y2 - 1 - decay / edge;
    z.tail[3] = decay / edge + z.tail[2] * exp(-edge / decay);
    return z;
}

/* How far each zone's light is up, [zone_floor, 1]: between the mean and the peak of what it shows. */
static void zone_drive(const sim_panel *panel, const float *rgb, double floor_level, double *drive, double *sum,
                       uint32_t *count) {
    for (uint32_t y = 0; y < panel->height; y++)
        for (uint32_t x = 0; x < panel->width; x++) {
            const float *p = rgb + 3 * ((size_t)y * panel->width + x);
            double v = (double)fmaxf(p[0], fmaxf(p[1], p[2]));
            size_t z = sim_panel_tile(panel, x, y);
            drive[z] = fmax(drive[z], v);
            sum[z] += v > 0 ? v : 0;
            count[z]++;
        }
    for (size_t z = 0; z < panel->tile_count; z++) {
        double mean = count[z] > 0 ? sum[z] / count[z] : 0;
        drive[z] = sim_clamp(0.5 * (drive[z] + mean), floor_level, 1);
    }
}

static brace_status make_zones(sim_panel *panel, const float *rgb, double *drive, brace_error *error) {
    const lcd_parameters *p = &panel->display->p.lcd;
    double *sum = core_calloc(panel->tile_count, sizeof *sum);
    uint32_t *count = core_calloc(panel->tile_count, sizeof *count);
    bool have = sum != NULL && count != NULL;
    if (have)
        zone_drive(panel, rgb, p->zone_floor, drive, sum, count);
    core_free(sum);
    core_free(count);
    if (!have)
        return core_fail_memory(error, panel->tile_count * sizeof *sum, "a display's zones");
    for (size_t z = 0; z < panel->tile_count; z++)
        panel->tile_start[z] =
            panel->period * p->zone_scan * (double)(z / panel->tile_columns) / (double)panel->tile_rows;
    return BRACE_OK;
}

static void release(sim_panel *panel) {
    for (int c = 0; c < 3; c++)
        core_free(panel->d.lcd.zone[c]);
}

static brace_status prepare(sim_panel *panel, const float *rgb, brace_error *error) {
    const lcd_parameters *p = &panel->display->p.lcd;
    lcd_panel *d = &panel->d.lcd;
    panel->period = 1 / p->frequency;
    d->edge = sim_clamp(p->edge, shortest_edge * panel->period, 0.25 * panel->period);
    d->half_rate = 0.5 / d->edge;
    d->steady = 1 - p->depth;
    d->zones = 1;
    double *drive = NULL;
    if (p->zone_columns > 1 || p->zone_rows > 1) {
        brace_status status = sim_panel_tiles(panel, fmax(1, panel->width / (double)p->zone_columns),
                                              fmax(1, panel->height / (double)p->zone_rows), error);
        if (status != BRACE_OK)
            return status;
        d->zones = panel->tile_count;
        drive = core_calloc(d->zones, sizeof *drive);
        if (drive == NULL)
            return core_fail_memory(error, d->zones * sizeof *drive, "a display's zones");
        status = make_zones(panel, rgb, drive, error);
        if (status != BRACE_OK) {
            core_free(drive);
            return status;
        }
    }
    brace_status status = BRACE_OK;
    for (int c = 0; c < 3 && status == BRACE_OK; c++) {
        d->decay[c] =
            p->decay[c] > fastest_filter * panel->period ? fmin(p->decay[c], slowest_filter * panel->period) : 0;
        d->rate[c] = d->decay[c] > 0 ? 1 / d->decay[c] : 0;
        d->zone[c] = core_calloc(d->zones, sizeof **d->zone);
        if (d->zone[c] == NULL) {
            status = core_fail_memory(error, d->zones * sizeof **d->zone, "a display's zones");
            break;
        }
        for (size_t z = 0; z < d->zones; z++) {
            double width = p->duty * (drive != NULL ? drive[z] : 1) * panel->period;
            /* The trapezoid needs room for both its edges. */
            width = sim_clamp(width, d->edge, panel->period - d->edge);
            d->zone[c][z] = make_zone(panel->period, d->edge, width, d->decay[c]);
        }
    }
    core_free(drive);
    return status;
}

/* The filtered pulse. */
static double filtered(const lcd_panel *d, const lcd_zone *z, int channel, double phase) {
    double corner = 0, tail = z->tail[0];
    if (phase > z->width + d->edge) {
        corner = z->width + d->edge;
        tail = z->tail[3];
    } else if (phase > z->width) {
        corner = z->width;
        tail = z->tail[2];
    } else if (phase > d->edge) {
        corner = d->edge;
        tail = z->tail[1];
    }
    double x = sim_step(phase, d->edge) - sim_step(phase - z->width, d->edge);
    double slope = corner == 0 ? 1 / d->edge : corner == z->width ? -1 / d->edge : 0;
    return d->decay[channel] > 0 ? x - slope * d->decay[channel] + tail * exp(-(phase - corner) * d->rate[channel]) : x;
}

static double light(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double phase) {
    const lcd_panel *d = &panel->d.lcd;
    const lcd_zone *z = &d->zone[channel][sim_panel_tile(panel, x, y)];
    double pulse =
        sim_step_light(phase, d->edge, d->half_rate) - sim_step_light(phase - z->width, d->edge, d->half_rate);
    if (d->decay[channel] > 0)
        pulse -= d->decay[channel] * (filtered(d, z, channel, phase) - z->first);
    return level * (d->steady * phase + (1 - d->steady) * pulse * panel->period / z->width);
}

static double emission(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double phase) {
    const lcd_panel *d = &panel->d.lcd;
    const lcd_zone *z = &d->zone[channel][sim_panel_tile(panel, x, y)];
    return level * (d->steady + (1 - d->steady) * filtered(d, z, channel, phase) * panel->period / z->width);
}

static size_t edges(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double *out,
                    size_t size) {
    (void)level;
    const lcd_panel *d = &panel->d.lcd;
    const lcd_zone *z = &d->zone[channel][sim_panel_tile(panel, x, y)];
    const double corners[4] = {0, d->edge, z->width, z->width + d->edge};
    size_t n = 0;
    for (; n < 4 && n < size; n++)
        out[n] = corners[n];
    return n;
}

const sim_driver sim_driver_lcd_pwm = {
    .name = "lcd_pwm",
    .fields = fields,
    .field_count = sizeof fields / sizeof *fields,
    .prepare = prepare,
    .release = release,
    .light = light,
    .emission = emission,
    .edges = edges,
};
