/* SPDX-License-Identifier: Apache-2.0 */
/*
 * display.h: what display.c, the drivers and the light kernels share.
 *
 * Every driver repeats itself after one period. Where a subpixel stands only
 * decides when its period starts, so that a driver has to know no more than
 *
 *   F(phase) = light from the start of a period to `phase`, F(period) = level*period,
 *
 * and E(t) = (whole periods)*level*period + F(rest). What moves the start of the
 * period (rows driven one after another, scan groups, tiles, zones, colours) is
 * common to all drivers: sim_panel_start.
 */
#ifndef SIM_DISPLAY_H
#define SIM_DISPLAY_H

#include "sim/json_check.h"
#include "sim/sim.h"

enum { BCM_SEGMENTS = 32, LED_SUBPERIODS = 256 };

/* ---- parameters, as in the JSON files ---- */

typedef struct lcd_parameters {
    double frequency, duty, edge, depth, decay[3];
    int64_t zone_columns, zone_rows;
    double zone_floor, zone_scan;
} lcd_parameters;

typedef struct oled_parameters {
    double refresh;
    int64_t pulses;
    double brightness, dc_above, duty_max, duty_min, edge, depth, alternate;
    double dip_depth, dip_start, dip_width, scan;
    int64_t scan_axis;
} oled_parameters;

typedef struct led_parameters {
    double refresh;
    int64_t subperiods, bits, unit, scan;
    double line_switch, blanking;
    int64_t low_subperiods, low_below;
    int64_t tile[2];
    double tile_phase;
    int64_t tile_seed;
    double channel_delay[3];
} led_parameters;

typedef struct bcm_parameters {
    double refresh;
    int64_t bits, scan;
    int64_t
        layout; /* 0: a row group shows all its planes, then the next one; 1: all groups show a plane, then the next */
    double order[BCM_SEGMENTS];
    size_t segments;
    double duty;
    double windows[6]; /* of each colour: start and length, as shares of the refresh */
} bcm_parameters;

typedef struct raster_parameters {
    double refresh, decay[3], active;
    int64_t scan_axis;
} raster_parameters;

typedef struct sim_driver sim_driver;

struct sim_display {
    sim_driver_kind kind;
    const sim_driver *driver;
    char name[64], family[32], description[256], source[256];
    union {
        lcd_parameters lcd;
        oled_parameters oled;
        led_parameters led;
        bcm_parameters bcm;
        raster_parameters raster;
    } p;
};

/* ---- made ready for a screen ---- */

/* Trapezoid through a first-order low pass: in the part of the period between two
 * corners the light is a line plus tail*exp(-(time since the corner)/decay). */
typedef struct lcd_zone {
    double width;   /* of the pulse, seconds: the corners are 0, edge, width, width + edge */
    double tail[4]; /* 0 where there is no decay */
    double first;   /* y(0) */
    double pad[2];
} lcd_zone;

typedef struct lcd_panel {
    double edge, half_rate; /* seconds, 1/(2 edge) */
    double steady;          /* 1 - depth */
    double decay[3], rate[3];
    size_t zones;
    lcd_zone *zone[3]; /* of each channel */
} lcd_panel;

typedef struct oled_panel {
    double pulse, rate; /* period of a pulse and its inverse */
    double width, edge, half_rate;
    double steady; /* 1 - depth */
    double gain;   /* depth/(mean of the pulse) */
    double alternate;
    double dip_depth, dip_start, dip_end, dip_light; /* I(dip_start) */
    double norm;                                     /* period/(light of a period) */
} oled_panel;

/* How the lit grey clocks spread over the inner cycles. An entry of the table
 * for (extra units e, cycle m), at e*(n + 1) + m: cycles before m of rank < e,
 * and flags for m itself. */
enum { LED_COUNT = 0x1ff, LED_EXTRA = 0x200, LED_REST = 0x400, LED_REST_GIVEN = 0x800 };
typedef struct led_spread {
    double n;           /* inner cycles in use */
    double cycle, rate; /* their period and its inverse */
    double table;       /* where the table starts */
} led_spread;

typedef struct led_panel {
    double top; /* 2^bits - 1 */
    double unit, unit_rate;
    double clock_rate; /* grey clocks a second */
    double low_below;
    led_spread usual, low;
    uint16_t *table; /* 2 entries longer than used: kernels load 4 bytes at a time */
} led_panel;

typedef struct bcm_panel {
    double top;
    size_t segments;
    int plane[BCM_SEGMENTS];
    double start[BCM_SEGMENTS], step[BCM_SEGMENTS]; /* of group 0, and what each further group adds */
    double lit[BCM_SEGMENTS];
    double unit;     /* seconds that a code's unit is lit in all */
    double scale[3]; /* colours' windows, relative to the whole period */
} bcm_panel;

typedef struct raster_panel {
    double rate[3], norm[3]; /* 1/decay, period/(1 - exp(-period/decay)) */
} raster_panel;

struct sim_panel {
    const sim_display *display;
    const sim_driver *driver;
    uint32_t width, height;
    double period, rate;
    /* When the period of (x, y, channel) starts. */
    double start_x, start_y, start_channel[3];
    double scan, scan_rate, start_scan; /* groups of rows: (y mod scan)*start_scan; scan 1: none */
    double *tile_start;                 /* of each tile or zone; NULL: none */
    size_t tile_count;
    uint32_t tile_columns, tile_rows;
    double tile_rate_x, tile_rate_y;
    union {
        lcd_panel lcd;
        oled_panel oled;
        led_panel led;
        bcm_panel bcm;
        raster_panel raster;
    } d;
};

/* ---- drivers ---- */

typedef enum sim_field_type { FIELD_NUMBER, FIELD_INTEGER, FIELD_CHOICE, FIELD_NUMBERS, FIELD_INTEGERS } sim_field_type;

typedef struct sim_field {
    const char *key;
    sim_field_type type;
    size_t offset; /* in the union of parameters */
    size_t count;  /* of a list */
    double low, high;
    double fallback; /* JSON_CHECK_REQUIRED: none; also of every element of a list */
    const char *const *choices;
} sim_field;

struct sim_driver {
    const char *name;
    const sim_field *fields;
    size_t field_count;
    /* What one field's range cannot say. May be NULL. */
    void (*check)(const json_at *at, sim_display *display);
    /* Adds to the JSON what is not in `fields`. May be NULL. */
    void (*json)(const sim_display *display, json_t *out);
    brace_status (*prepare)(sim_panel *panel, const float *rgb, brace_error *error);
    void (*release)(sim_panel *panel); /* may be NULL */
    double (*light)(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double phase);
    double (*emission)(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double phase);
    /* Where in a period the light is not smooth: at most `size` phases, in any order. */
    size_t (*edges)(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double *out,
                    size_t size);
};

extern const sim_driver sim_driver_dc, sim_driver_lcd_pwm, sim_driver_oled_pwm, sim_driver_led_spwm, sim_driver_bcm,
    sim_driver_raster;

/* When the period of a subpixel starts, seconds. */
double sim_panel_start(const sim_panel *panel, uint32_t x, uint32_t y, int channel);
size_t sim_panel_tile(const sim_panel *panel, uint32_t x, uint32_t y);

/* Gives the panel a grid of columns x rows over the screen with starts of 0. */
brace_status sim_panel_tiles(sim_panel *panel, double tile_width, double tile_height, brace_error *error);

/* Times in [0, period) at which e(t) of a subpixel is not smooth, in order. */
size_t sim_panel_edges(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double *out,
                       size_t size);

static inline double sim_clamp(double x, double low, double high) {
    return x > low ? (x < high ? x : high) : low; /* NaN: low */
}

/* Integral from 0 to u of a step that rises linearly within [0, edge]. */
static inline double sim_step_light(double u, double edge, double half_rate) {
    double c = sim_clamp(u, 0, edge);
    return c * c * half_rate + (u > edge ? u - edge : 0);
}

/* The step itself. */
static inline double sim_step(double u, double edge) {
    return u <= 0 ? 0 : u >= edge ? 1 : u / edge;
}

/* ---- kernels (light*.c) ---- */
sim_light_fn sim_light_plain;
sim_light_fn *sim_light_avx2(const sim_panel *panel);
sim_light_fn *sim_light_avx512(const sim_panel *panel);

#endif
