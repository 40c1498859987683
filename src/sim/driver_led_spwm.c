/* SPDX-License-Identifier: Apache-2.0 */
/*
 * driver_led_spwm.c: LED walls with scrambled PWM, as in driver chips of
 * Macroblock (MBI5153, MBI5353) and Texas Instruments (TLC6983, LP5890).
 *
 * A refresh is n inner cycles and a blank rest. Each inner cycle has a slot for
 * every group of rows (row mod scan). A level is a count G of grey clocks, of
 * 2^bits - 1 in all; they are dealt out to the cycles in units, bit-reversed so
 * that few units lie far apart: the cycle of rank r = bitrev(m) gets
 *
 *   unit*(floor(K/n) + [r < K mod n]) + [r = K mod n]*(G mod unit),  K = floor(G/unit)
 *
 * clocks, lit from the start of its slot. So a level of a few units lights only
 * a few cycles, and its stripes are wider than those of a bright one. With
 * dynamic sub-periods, levels under low_below use only low_subperiods cycles.
 *
 * A level between two counts is shown with the nearer count's pattern at its
 * own light: the mean stays exact. Levels below one count take its pattern.
 */
#include <math.h>
#include <stddef.h>

#include "sim/display.h"

#define AT(member) offsetof(led_parameters, member)

static const sim_field fields[] = {
    {"refresh", FIELD_NUMBER, AT(refresh), 0, 10, 1000, JSON_CHECK_REQUIRED, NULL},
    {"subperiods", FIELD_INTEGER, AT(subperiods), 0, 1, LED_SUBPERIODS, JSON_CHECK_REQUIRED, NULL},
    {"bits", FIELD_INTEGER, AT(bits), 0, 8, 16, JSON_CHECK_REQUIRED, NULL},
    {"scan", FIELD_INTEGER, AT(scan), 0, 1, 64, JSON_CHECK_REQUIRED, NULL},
    {"unit", FIELD_INTEGER, AT(unit), 0, 1, 65536, 1, NULL},
    {"line_switch", FIELD_NUMBER, AT(line_switch), 0, 0, 0.5, 0.05, NULL},
    {"blanking", FIELD_NUMBER, AT(blanking), 0, 0, 0.5, 0.02, NULL},
    {"low_subperiods", FIELD_INTEGER, AT(low_subperiods), 0, 0, LED_SUBPERIODS, 0, NULL},
    {"low_below", FIELD_INTEGER, AT(low_below), 0, 0, 65535, 0, NULL},
    {"tile", FIELD_INTEGERS, AT(tile), 2, 0, 65536, 0, NULL},
    {"tile_phase", FIELD_NUMBER, AT(tile_phase), 0, 0, 1, 0, NULL},
    {"tile_seed", FIELD_INTEGER, AT(tile_seed), 0, 0, 4294967295.0, 1, NULL},
    {"channel_delay", FIELD_NUMBERS, AT(channel_delay), 3, -1, 1, 0, NULL},
};

static bool power_of_two(int64_t x) {
    return x > 0 && (x & (x - 1)) == 0;
}

/* Grey clocks that fit into a cycle. */
static int64_t clocks_per_cycle(const led_parameters *p) {
    int64_t all = (int64_t)1 << p->bits;
    return all > p->subperiods ? all / p->subperiods : 1;
}

static void check(const json_at *at, sim_display *display) {
    const led_parameters *p = &display->p.led;
    int64_t width = clocks_per_cycle(p);
    if (!power_of_two(p->subperiods))
        json_check_fail(at, "subperiods", "%lld is not a power of two", (long long)p->subperiods);
    else if (!power_of_two(p->unit) || p->unit > width)
        json_check_fail(at, "unit", "%lld is not a power of two up to the %lld clocks of a cycle", (long long)p->unit,
                        (long long)width);
    else if (p->low_subperiods != 0 && (!power_of_two(p->low_subperiods) || p->low_subperiods > p->subperiods))
        json_check_fail(at, "low_subperiods", "%lld is neither 0 nor a power of two up to subperiods, %lld",
                        (long long)p->low_subperiods, (long long)p->subperiods);
    else if (p->low_below > p->low_subperiods * width)
        json_check_fail(at, "low_below", "%lld clocks do not fit into %lld cycles of %lld", (long long)p->low_below,
                        (long long)p->low_subperiods, (long long)width);
    else if ((p->tile[0] != 0 && p->tile[0] < 8) || (p->tile[1] != 0 && p->tile[1] < 8) ||
             (p->tile[0] == 0) != (p->tile[1] == 0))
        json_check_fail(at, "tile", "[0, 0] (no tiles) or two sizes of 8 or more are expected");
}

static unsigned reversed(unsigned m, unsigned n) {
    unsigned r = 0;
    for (; n > 1; n >>= 1, m >>= 1)
        r = r << 1 | (m & 1);
    return r;
}

static void fill_table(uint16_t *table, unsigned n) {
    for (unsigned e = 0; e < n; e++) {
        unsigned count = 0, given = 0;
        for (unsigned m = 0; m <= n; m++) {
            unsigned rank = m < n ? reversed(m, n) : n;
            table[e * (n + 1) + m] =
                (uint16_t)(count | (rank < e ? LED_EXTRA : 0) | (rank == e ? LED_REST : 0) | given);
            count += rank < e;
            given |= rank == e ? (unsigned)LED_REST_GIVEN : 0;
        }
    }
}

static void release(sim_panel *panel) {
    core_free(panel->d.led.table);
}

static brace_status prepare(sim_panel *panel, const float *rgb, brace_error *error) {
    (void)rgb;
    const led_parameters *p = &panel->display->p.led;
    led_panel *d = &panel->d.led;
    size_t n = (size_t)p->subperiods;
    size_t low = p->low_subperiods > 0 && p->low_below > 0 ? (size_t)p->low_subperiods : n;
    panel->period = 1 / p->refresh;
    double cycle = panel->period * (1 - p->blanking) / (double)n;
    double slot = cycle / (double)p->scan;
    d->top = ldexp(1, (int)p->bits) - 1;
    d->unit = (double)p->unit;
    d->unit_rate = 1 / d->unit;
    d->clock_rate = (double)clocks_per_cycle(p) / (slot * (1 - p->line_switch));
    d->low_below = low < n ? (double)p->low_below : 0;
    d->usual = (led_spread){(double)n, cycle, 1 / cycle, 0};
    double stretch = cycle * (double)(n / low);
    d->low = (led_spread){(double)low, stretch, 1 / stretch, (double)(n * (n + 1))};
    size_t entries = n * (n + 1) + low * (low + 1) + 2;
    d->table = core_calloc(entries, sizeof *d->table);
    if (d->table == NULL)
        return core_fail_memory(error, entries * sizeof *d->table, "a display's timing");
    fill_table(d->table, (unsigned)n);
    fill_table(d->table + n * (n + 1), (unsigned)low);
    panel->scan = (double)p->scan;
    panel->scan_rate = 1 / panel->scan;
    panel->start_scan = slot;
    for (int c = 0; c < 3; c++)
        panel->start_channel[c] = p->channel_delay[c] * cycle;
    if (p->tile[0] > 0 && p->tile_phase > 0) {
        brace_status status = sim_panel_tiles(panel, (double)p->tile[0], (double)p->tile[1], error);
        if (status != BRACE_OK)
            return status;
        for (size_t i = 0; i < panel->tile_count; i++) {
            core_random r = core_random_create((uint64_t)p->tile_seed, (uint32_t)(i % panel->tile_columns),
                                               (uint32_t)(i / panel->tile_columns), 0x4c4544);
            panel->tile_start[i] = p->tile_phase * core_random_uniform(&r) * panel->period;
        }
    }
    return BRACE_OK;
}

/* The count of a level. */
static double count_of(const led_panel *d, double level) {
    return sim_clamp(rint(level * d->top), 1, d->top);
}

static double light(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double phase) {
    (void)x;
    (void)y;
    (void)channel;
    const led_panel *d = &panel->d.led;
    double g = count_of(d, level);
    const led_spread *s = g < d->low_below ? &d->low : &d->usual;
    double units = floor(g * d->unit_rate);
    double rest = g - units * d->unit;
    double base = floor(units / s->n);
    double extra = units - base * s->n;
    double m = sim_clamp(floor(phase * s->rate), 0, s->n);
    unsigned entry = d->table[(size_t)(s->table + extra * (s->n + 1) + m)];
    double lit = 0; /* in this cycle; in the blank rest, m = n, there is none */
    if (m < s->n)
        lit = d->unit * (base + (entry & LED_EXTRA ? 1 : 0)) + (entry & LED_REST ? rest : 0);
    double before = d->unit * (m * base + (entry & LED_COUNT)) + (entry & LED_REST_GIVEN ? rest : 0);
    double clocks = before + sim_clamp((phase - m * s->cycle) * d->clock_rate, 0, lit);
    return level * panel->period * (clocks / g);
}

/* Grey clocks of one inner cycle, by the rule as it stands above: for emission and edges. */
static int64_t clocks_of(int64_t g, int64_t unit, int64_t n, int64_t m) {
    int64_t rank = reversed((unsigned)m, (unsigned)n), k = g / unit;
    return unit * (k / n + (rank < k % n)) + (rank == k % n ? g % unit : 0);
}

static int64_t cycles_of(const sim_panel *panel, double level, int64_t *g) {
    const led_parameters *p = &panel->display->p.led;
    *g = (int64_t)count_of(&panel->d.led, level);
    return *g < p->low_below && p->low_subperiods > 0 ? p->low_subperiods : p->subperiods;
}

static double emission(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double phase) {
    (void)x;
    (void)y;
    (void)channel;
    const led_parameters *p = &panel->display->p.led;
    int64_t g, n = cycles_of(panel, level, &g);
    double clock = 1 / panel->d.led.clock_rate;
    double cycle = panel->period * (1 - p->blanking) / (double)n;
    int64_t m = (int64_t)floor(phase / cycle);
    if (m < 0 || m >= n || phase - (double)m * cycle >= clock * (double)clocks_of(g, p->unit, n, m))
        return 0;
    return level * panel->period / ((double)g * clock);
}

static size_t edges(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double *out,
                    size_t size) {
    (void)x;
    (void)y;
    (void)channel;
    const led_parameters *p = &panel->display->p.led;
    int64_t g, cycles = cycles_of(panel, level, &g);
    double cycle = panel->period * (1 - p->blanking) / (double)cycles;
    size_t n = 0;
    for (int64_t m = 0; m < cycles && n + 2 <= size; m++) {
        int64_t lit = clocks_of(g, p->unit, cycles, m);
        if (lit == 0)
            continue;
        out[n++] = (double)m * cycle;
        out[n++] = (double)m * cycle + (double)lit / panel->d.led.clock_rate;
    }
    return n;
}

const sim_driver sim_driver_led_spwm = {
    .name = "led_spwm",
    .fields = fields,
    .field_count = sizeof fields / sizeof *fields,
    .check = check,
    .prepare = prepare,
    .release = release,
    .light = light,
    .emission = emission,
    .edges = edges,
};
