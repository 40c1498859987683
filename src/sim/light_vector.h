/* SPDX-License-Identifier: Apache-2.0 */
/*
 * light_vector.h: the light kernels of all drivers, written once over lanes of
 * doubles (vd); included by light_avx512.c and light_avx2.c, which say what a
 * vd is. The same operations in the same order make both give the same bits.
 *
 * Doubles throughout: a pulse of a microsecond must be placed after seconds of
 * capture, and the gathers and divisions cost more than the wider lanes.
 */
#ifndef SIM_LIGHT_VECTOR_H
#define SIM_LIGHT_VECTOR_H

#include <math.h>
#include <string.h>

/* What a driver gets: where the samples are, and the phases of both ends of the exposure. */
typedef struct light_lanes {
    vd y, level, a, b;
    vi tile;
} light_lanes;

/* F(b) - F(a) of a driver: of s->level, or, with run_shared, of level 1. */
typedef vd light_body(const sim_panel *panel, int channel, const light_lanes *s);

#define ALWAYS_INLINE static inline __attribute__((always_inline))

ALWAYS_INLINE vd vd_clamp(vd x, vd low, vd high) {
    return vd_min(vd_max(x, low), high); /* NaN: low */
}

/* exp(x) for x <= 0 to 1e-14; what is under exp(-700) is no light at all. */
ALWAYS_INLINE vd vd_exp(vd x) {
    x = vd_max(x, vd_set(-700));
    vd n = vd_round(x * vd_set(1.4426950408889634));
    vd r = vd_fnma(n, vd_set(6.93147180369123816490e-01), x);
    r = vd_fnma(n, vd_set(1.90821492927058770002e-10), r);
    static const double taylor[] = {1.0 / 3628800, 1.0 / 362880, 1.0 / 40320, 1.0 / 5040, 1.0 / 720, 1.0 / 120,
                                    1.0 / 24,      1.0 / 6,      1.0 / 2,     1.0,        1.0};
    vd p = vd_set(1.0 / 39916800);
#pragma GCC unroll 11
    for (int i = 0; i < 11; i++)
        p = vd_fma(p, r, vd_set(taylor[i]));
    return p * vd_power_of_two(n);
}

#define PARAMETERS                                                                                                     \
    const sim_panel *panel, size_t n, const int32_t *x, const int32_t *y, const float *level, int channel,             \
        const double *start, double exposure, float *out
#define ARGUMENTS panel, n, x, y, level, channel, start, exposure, out

ALWAYS_INLINE vi tile_of(const sim_panel *panel, vd x, vd y) {
    if (panel->tile_start == NULL)
        return vd_int(vd_set(0));
    vd half = vd_set(0.5);
    vd column = vd_floor((x + half) * vd_set(panel->tile_rate_x));
    vd row = vd_floor((y + half) * vd_set(panel->tile_rate_y));
    column = vd_min(column, vd_set((double)panel->tile_columns - 1));
    row = vd_min(row, vd_set((double)panel->tile_rows - 1));
    return vd_int(vd_fma(row, vd_set((double)panel->tile_columns), column));
}

/* When the period starts, but for the tile's share. */
ALWAYS_INLINE vd start_of(const sim_panel *panel, int channel, vd x, vd y) {
    vd start = vd_fma(x, vd_set(panel->start_x), vd_set(panel->start_channel[channel]));
    start = vd_fma(y, vd_set(panel->start_y), start);
    if (panel->scan > 1) {
        vd group = vd_floor((y + vd_set(0.5)) * vd_set(panel->scan_rate));
        group = vd_fnma(group, vd_set(panel->scan), y);
        start = vd_fma(group, vd_set(panel->start_scan), start);
    }
    return start;
}

/* Splits an exposure that begins at `begin`: phases of its ends into *s, time of its whole periods. */
ALWAYS_INLINE vd split(const sim_panel *panel, vd begin, vd start, double exposure, light_lanes *s) {
    vd zero = vd_set(0), period = vd_set(panel->period), rate = vd_set(panel->rate);
    if (panel->tile_start != NULL)
        start = start + vd_gather(panel->tile_start, s->tile);
    vd a = begin - start;
    vd b = a + vd_set(exposure);
    vd whole_a = vd_floor(a * rate), whole_b = vd_floor(b * rate);
    s->a = vd_clamp(vd_fnma(whole_a, period, a), zero, period);
    s->b = vd_clamp(vd_fnma(whole_b, period, b), zero, period);
    return (whole_b - whole_a) * period;
}

ALWAYS_INLINE vd load_position(const int32_t *at, uint32_t size) {
    return vd_clamp(vd_load_int(at), vd_set(0), vd_set((double)size - 1));
}

/* What is left when n is no multiple of LANES, as a whole group. */
static void run_rest(sim_light_fn *kernel, PARAMETERS) {
    int32_t xs[LANES] = {0}, ys[LANES] = {0};
    float levels[LANES] = {0}, outs[LANES];
    double starts[LANES] = {0};
    memcpy(xs, x, n * sizeof *x);
    memcpy(ys, y, n * sizeof *y);
    memcpy(levels, level, n * sizeof *level);
    memcpy(starts, start, n * sizeof *start);
    kernel(panel, LANES, xs, ys, levels, channel, starts, exposure, outs);
    memcpy(out, outs, n * sizeof *out);
}

ALWAYS_INLINE void run(sim_light_fn *kernel, PARAMETERS, light_body *body) {
    size_t i = 0;
    for (; i + LANES <= n; i += LANES) {
        vd at = load_position(x + i, panel->width);
        light_lanes s = {.y = load_position(y + i, panel->height), .level = vd_load_float(level + i)};
        s.tile = tile_of(panel, at, s.y);
        vd whole = split(panel, vd_load(start + i), start_of(panel, channel, at, s.y), exposure, &s);
        vd_store_float(out + i, vd_fma(whole, s.level, body(panel, channel, &s)) * vd_set(1 / exposure));
    }
    if (i < n)
        run_rest(kernel, panel, n - i, x + i, y + i, level + i, channel, start + i, exposure, out + i);
}

/*
 * The same for light that is proportional to the level: `body` gives that of level 1. Neighbours in a row of a frame
 * begin together and mostly share the start of their period, too: then it is not computed again.
 */
ALWAYS_INLINE void run_shared(sim_light_fn *kernel, PARAMETERS, light_body *body) {
    vd whole = vd_set(0), rest = vd_set(0), last_begin = vd_set(NAN), last_from = vd_set(NAN);
    vi last_tile = vd_int(vd_set(0));
    size_t i = 0;
    for (; i + LANES <= n; i += LANES) {
        vd at = load_position(x + i, panel->width), levels = vd_load_float(level + i), begin = vd_load(start + i);
        light_lanes s = {.y = load_position(y + i, panel->height), .level = vd_set(1)};
        s.tile = tile_of(panel, at, s.y);
        vd from = start_of(panel, channel, at, s.y);
        if (vd_same(begin, last_begin) && vd_same(from, last_from) && vi_same(s.tile, last_tile)) {
            vd_store_float(out + i, vd_fma(whole, levels, levels * rest) * vd_set(1 / exposure));
            continue;
        }
        whole = split(panel, begin, from, exposure, &s);
        rest = body(panel, channel, &s);
        vd_store_float(out + i, vd_fma(whole, levels, levels * rest) * vd_set(1 / exposure));
        whole = vd_last(whole), rest = vd_last(rest);
        last_begin = vd_last(begin), last_from = vd_last(from), last_tile = vi_last(s.tile);
    }
    if (i < n)
        run_rest(kernel, panel, n - i, x + i, y + i, level + i, channel, start + i, exposure, out + i);
}

/* ---- dc ---- */

static void light_dc(PARAMETERS) {
    (void)panel;
    (void)x;
    (void)y;
    (void)channel;
    (void)start;
    (void)exposure;
    memcpy(out, level, n * sizeof *out);
}

/* ---- lcd_pwm ---- */

ALWAYS_INLINE vd step_light(vd u, vd edge, vd half_rate) {
    vd c = vd_clamp(u, vd_set(0), edge);
    return vd_fma(c * c, half_rate, vd_max(u - edge, vd_set(0)));
}

typedef struct lcd_lanes {
    vd width, tail[4];
} lcd_lanes;

/* decay*y(phase), but for a constant. */
ALWAYS_INLINE vd lcd_decay(const lcd_panel *d, int channel, const lcd_lanes *z, vd phase) {
    vd zero = vd_set(0), edge = vd_set(d->edge), slope = vd_set(2 * d->half_rate);
    vd fall = z->width + edge;
    vm second = vd_less(edge, phase), third = vd_less(z->width, phase), last = vd_less(fall, phase);
    vd corner = vd_if(last, fall, vd_if(third, z->width, vd_if(second, edge, zero)));
    vd tail = vd_if(last, z->tail[3], vd_if(third, z->tail[2], vd_if(second, z->tail[1], z->tail[0])));
    vd up = vd_clamp(phase, zero, edge), down = vd_clamp(phase - z->width, zero, edge);
    vd rise = vd_if(last, zero, vd_if(third, zero - slope, vd_if(second, zero, slope)));
    vd decay = vd_set(d->decay[channel]);
    vd y = vd_fma(up - down, slope, tail * vd_exp((corner - phase) * vd_set(d->rate[channel])));
    return decay * vd_fnma(rise, decay, y);
}

ALWAYS_INLINE vd lcd_body(const sim_panel *panel, int channel, const light_lanes *s, bool zones, bool decays) {
    const lcd_panel *d = &panel->d.lcd;
    const lcd_zone *zone = d->zone[channel];
    lcd_lanes z = {vd_set(zone->width), {vd_set(0), vd_set(0), vd_set(0), vd_set(0)}};
    if (zones) {
        vi at = vd_int(vi_double(s->tile) * vd_set(sizeof *zone / sizeof(double)));
        z.width = vd_gather(&zone->width, at);
        for (int i = 0; i < 4 && decays; i++)
            z.tail[i] = vd_gather(&zone->tail[i], at);
    } else {
        for (int i = 0; i < 4 && decays; i++)
            z.tail[i] = vd_set(zone->tail[i]);
    }
    vd edge = vd_set(d->edge), half_rate = vd_set(d->half_rate);
    vd pulse = (step_light(s->b, edge, half_rate) - step_light(s->b - z.width, edge, half_rate)) -
               (step_light(s->a, edge, half_rate) - step_light(s->a - z.width, edge, half_rate));
    if (decays)
        pulse = pulse - (lcd_decay(d, channel, &z, s->b) - lcd_decay(d, channel, &z, s->a));
    vd gain = vd_set((1 - d->steady) * panel->period) / z.width;
    return vd_fma(gain, pulse, vd_set(d->steady) * (s->b - s->a));
}

ALWAYS_INLINE vd lcd_even(const sim_panel *panel, int channel, const light_lanes *s) {
    return lcd_body(panel, channel, s, false, false);
}
ALWAYS_INLINE vd lcd_even_decay(const sim_panel *panel, int channel, const light_lanes *s) {
    return lcd_body(panel, channel, s, false, true);
}
ALWAYS_INLINE vd lcd_zones(const sim_panel *panel, int channel, const light_lanes *s) {
    return lcd_body(panel, channel, s, true, false);
}
ALWAYS_INLINE vd lcd_zones_decay(const sim_panel *panel, int channel, const light_lanes *s) {
    return lcd_body(panel, channel, s, true, true);
}

static void light_lcd(PARAMETERS) {
    bool decays = panel->d.lcd.decay[channel] > 0;
    if (panel->tile_start == NULL && !decays)
        run_shared(light_lcd, ARGUMENTS, lcd_even);
    else if (panel->tile_start == NULL)
        run_shared(light_lcd, ARGUMENTS, lcd_even_decay);
    else if (!decays)
        run_shared(light_lcd, ARGUMENTS, lcd_zones);
    else
        run_shared(light_lcd, ARGUMENTS, lcd_zones_decay);
}

/* ---- oled_pwm ---- */

ALWAYS_INLINE vd oled_plain(const oled_panel *d, vd phase) {
    vd one = vd_set(1), alternate = vd_set(d->alternate);
    vd edge = vd_set(d->edge), half_rate = vd_set(d->half_rate), width = vd_set(d->width);
    vd k = vd_floor(phase * vd_set(d->rate));
    vd u = vd_fnma(k, vd_set(d->pulse), phase);
    vd odd = vd_fnma(vd_floor(k * vd_set(0.5)), vd_set(2), k);
    vd pulse = step_light(u, edge, half_rate) - step_light(u - width, edge, half_rate);
    vd area = width * vd_fma(alternate, odd, k);
    area = vd_fma(pulse, vd_fma(alternate, vd_fnma(vd_set(2), odd, one), one), area);
    return vd_fma(vd_set(d->gain), area, vd_set(d->steady) * phase);
}

ALWAYS_INLINE vd oled_body(const sim_panel *panel, int channel, const light_lanes *s) {
    (void)channel;
    const oled_panel *d = &panel->d.oled;
    vd sum = oled_plain(d, s->b) - oled_plain(d, s->a);
    if (d->dip_depth > 0) {
        vd start = vd_set(d->dip_start), end = vd_set(d->dip_end);
        vd dip = oled_plain(d, vd_clamp(s->b, start, end)) - oled_plain(d, vd_clamp(s->a, start, end));
        sum = vd_fnma(vd_set(d->dip_depth), dip, sum);
    }
    return vd_set(d->norm) * sum;
}

static void light_oled(PARAMETERS) {
    run_shared(light_oled, ARGUMENTS, oled_body);
}

/* ---- led_spwm ---- */

typedef struct led_lanes {
    vd n, cycle, rate, row, base, rest;
} led_lanes;

/* Grey clocks lit from the start of the period. */
ALWAYS_INLINE vd led_clocks(const led_panel *d, const led_lanes *l, vd phase) {
    vd zero = vd_set(0), unit = vd_set(d->unit);
    vd m = vd_clamp(vd_floor(phase * l->rate), zero, l->n);
    vi entry = vi_gather_short(d->table, vd_int(l->row + m));
    vd count = vi_double(vi_field(entry, 0, LED_COUNT));
    vd extra = vi_double(vi_field(entry, 9, 1));
    vd rest = vi_double(vi_field(entry, 10, 1)), given = vi_double(vi_field(entry, 11, 1));
    vd lit = vd_fma(unit, l->base + extra, l->rest * rest);
    lit = vd_if(vd_less(m, l->n), lit, zero);
    vd before = vd_fma(unit, vd_fma(m, l->base, count), l->rest * given);
    vd here = vd_fnma(m, l->cycle, phase) * vd_set(d->clock_rate);
    return before + vd_clamp(here, zero, lit);
}

ALWAYS_INLINE vd led_body(const sim_panel *panel, int channel, const light_lanes *s) {
    (void)channel;
    const led_panel *d = &panel->d.led;
    vd g = vd_clamp(vd_round(s->level * vd_set(d->top)), vd_set(1), vd_set(d->top));
    led_lanes l = {.n = vd_set(d->usual.n), .cycle = vd_set(d->usual.cycle), .rate = vd_set(d->usual.rate)};
    vd table = vd_set(0);
    vd n_rate = vd_set(1 / d->usual.n); /* exact: powers of two */
    if (d->low_below > 0) {
        vm low = vd_less(g, vd_set(d->low_below));
        l.n = vd_if(low, vd_set(d->low.n), l.n);
        l.cycle = vd_if(low, vd_set(d->low.cycle), l.cycle);
        l.rate = vd_if(low, vd_set(d->low.rate), l.rate);
        n_rate = vd_if(low, vd_set(1 / d->low.n), n_rate);
        table = vd_if(low, vd_set(d->low.table), table);
    }
    vd units = vd_floor(g * vd_set(d->unit_rate));
    l.rest = vd_fnma(units, vd_set(d->unit), g);
    l.base = vd_floor(units * n_rate);
    vd extra = vd_fnma(l.base, l.n, units);
    l.row = vd_fma(extra, l.n + vd_set(1), table);
    vd clocks = led_clocks(d, &l, s->b) - led_clocks(d, &l, s->a);
    return s->level * vd_set(panel->period) * (clocks / g);
}

static void light_led(PARAMETERS) {
    run(light_led, ARGUMENTS, led_body);
}

/* ---- bcm ---- */

ALWAYS_INLINE vd bcm_body(const sim_panel *panel, int channel, const light_lanes *s) {
    const bcm_panel *d = &panel->d.bcm;
    vd zero = vd_set(0), top = vd_set(d->top), scale = vd_set(1 / d->scale[channel]);
    vd code = vd_clamp(vd_round(s->level * top), vd_set(1), top);
    vi bits = vd_int(code);
    vd a = s->a * scale, b = s->b * scale, sum = zero;
    vd group = vd_floor((s->y + vd_set(0.5)) * vd_set(panel->scan_rate));
    group = vd_fnma(group, vd_set(panel->scan), s->y);
    for (size_t j = 0; j < d->segments; j++) {
        vd start = vd_fma(group, vd_set(d->step[j]), vd_set(d->start[j])), lit = vd_set(d->lit[j]);
        vd part = vd_clamp(b - start, zero, lit) - vd_clamp(a - start, zero, lit);
        sum = sum + vd_if_bit(bits, d->plane[j], part);
    }
    return s->level * vd_set(panel->period) * (sum / (code * vd_set(d->unit)));
}

static void light_bcm(PARAMETERS) {
    run(light_bcm, ARGUMENTS, bcm_body);
}

/* ---- raster ---- */

ALWAYS_INLINE vd raster_body(const sim_panel *panel, int channel, const light_lanes *s) {
    const raster_panel *d = &panel->d.raster;
    vd rate = vd_set(-d->rate[channel]);
    return s->level * vd_set(d->norm[channel]) * (vd_exp(s->a * rate) - vd_exp(s->b * rate));
}

static void light_raster(PARAMETERS) {
    run(light_raster, ARGUMENTS, raster_body);
}

static sim_light_fn *vector_kernel(const sim_panel *panel) {
    static sim_light_fn *const kernels[] = {
        [SIM_DC] = light_dc,        [SIM_LCD_PWM] = light_lcd, [SIM_OLED_PWM] = light_oled,
        [SIM_LED_SPWM] = light_led, [SIM_BCM] = light_bcm,     [SIM_RASTER] = light_raster,
    };
    return kernels[panel->display->kind];
}

#endif
