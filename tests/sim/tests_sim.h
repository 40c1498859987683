/* SPDX-License-Identifier: Apache-2.0 */
/* tests_sim.h: screens and random displays for the simulator's tests. */
#ifndef TESTS_SIM_H
#define TESTS_SIM_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "sim/display.h"

static inline float *test_screen(uint32_t width, uint32_t height, uint32_t seed) {
    float *rgb = malloc((size_t)width * height * 3 * sizeof *rgb);
    assert_non_null(rgb);
    core_random r = core_random_create(seed, 7, 7, 7);
    for (size_t i = 0; i < (size_t)width * height * 3; i++)
        rgb[i] = (float)core_random_uniform(&r);
    return rgb;
}

static inline double test_log_range(core_random *r, double low, double high) {
    return low * exp(core_random_uniform(r) * log(high / low));
}

/* A valid display of a driver with parameters from all over their ranges. */
static inline sim_display *test_random_display(sim_driver_kind kind, core_random *r) {
    char text[2000];
    switch (kind) {
    case SIM_DC:
        snprintf(text, sizeof text, "{\"driver\": \"dc\"}");
        break;
    case SIM_LCD_PWM: {
        double decay[3];
        for (int i = 0; i < 3; i++)
            decay[i] = core_random_below(r, 3) == 0 ? 0 : test_log_range(r, 1e-7, 0.02);
        snprintf(text, sizeof text,
                 "{\"driver\": \"lcd_pwm\", \"frequency\": %.17g, \"duty\": %.17g, \"edge\": %.17g, \"depth\": %.17g,"
                 "\"decay\": [%.17g, %.17g, %.17g], \"zone_columns\": %u, \"zone_rows\": %u, \"zone_floor\": %.17g,"
                 "\"zone_scan\": %.17g}",
                 test_log_range(r, 50, 500000), core_random_range(r, 0.005, 0.995),
                 core_random_below(r, 3) == 0 ? 0 : test_log_range(r, 1e-8, 1e-3),
                 core_random_below(r, 2) == 0 ? 1 : core_random_uniform(r), decay[0], decay[1], decay[2],
                 core_random_below(r, 2) == 0 ? 1 : 1 + core_random_below(r, 70), 1 + core_random_below(r, 3) * 7,
                 core_random_range(r, 0.01, 1), core_random_range(r, -1, 1));
        break;
    }
    case SIM_OLED_PWM: {
        unsigned pulses = 1 + core_random_below(r, 32);
        double dip = core_random_uniform(r);
        snprintf(text, sizeof text,
                 "{\"driver\": \"oled_pwm\", \"refresh\": %.17g, \"pulses\": %u, \"brightness\": %.17g, \"dc_above\": "
                 "%.17g, \"duty_max\": %.17g, \"duty_min\": 0.005, \"edge\": %.17g, \"depth\": %.17g,"
                 "\"alternate\": %.17g, \"dip_depth\": %.17g, \"dip_start\": %.17g, \"dip_width\": %.17g,"
                 "\"scan\": %.17g, \"scan_axis\": \"%s\"}",
                 test_log_range(r, 10, 1000), pulses, core_random_range(r, 0.01, 1), core_random_range(r, 0.01, 1),
                 core_random_below(r, 3) == 0 ? 1 : core_random_range(r, 0.05, 1),
                 core_random_below(r, 3) == 0 ? 0 : test_log_range(r, 1e-8, 1e-3),
                 core_random_below(r, 2) == 0 ? 1 : core_random_uniform(r),
                 pulses % 2 == 0 ? core_random_range(r, 0, 0.9) : 0,
                 core_random_below(r, 3) == 0 ? 0 : core_random_range(r, 0, 0.95), dip,
                 fmin(0.5, (1 - dip) * core_random_uniform(r)), core_random_range(r, -1, 1),
                 core_random_below(r, 2) == 0 ? "x" : "y");
        break;
    }
    case SIM_LED_SPWM: {
        unsigned n = core_random_below(r, 9), bits = 8 + core_random_below(r, 9);
        unsigned width = bits - n, low = core_random_below(r, n + 1);
        bool tiles = core_random_below(r, 2) == 0;
        snprintf(text, sizeof text,
                 "{\"driver\": \"led_spwm\", \"refresh\": %.17g, \"subperiods\": %u, \"bits\": %u, \"scan\": %u,"
                 "\"unit\": %u, \"line_switch\": %.17g, \"blanking\": %.17g, \"low_subperiods\": %u, \"low_below\": %u,"
                 "\"tile\": [%u, %u], \"tile_phase\": %.17g, \"channel_delay\": [%.17g, 0, %.17g]}",
                 core_random_range(r, 10, 240), 1u << n, bits, 1 + core_random_below(r, 64),
                 1u << core_random_below(r, width + 1), core_random_range(r, 0, 0.5),
                 core_random_below(r, 3) == 0 ? 0 : core_random_range(r, 0, 0.5), 1u << low,
                 bits < 16 ? core_random_below(r, (1u << (low + width)) + 1)
                           : core_random_below(r, 1u << (low + width)),
                 tiles ? 8 + core_random_below(r, 20) : 0, tiles ? 8 + core_random_below(r, 20) : 0,
                 core_random_uniform(r), core_random_range(r, -1, 1), core_random_range(r, -1, 1));
        break;
    }
    case SIM_BCM: {
        unsigned bits = 1 + core_random_below(r, 16), n = bits + core_random_below(r, BCM_SEGMENTS - bits + 1);
        char order[300];
        size_t used = 0;
        for (unsigned i = 0; i < n; i++)
            used += (size_t)snprintf(order + used, sizeof order - used, "%s%u", i > 0 ? "," : "",
                                     i < bits ? i * 17 % bits : core_random_below(r, bits));
        bool sequential = core_random_below(r, 2) == 0;
        snprintf(text, sizeof text,
                 "{\"driver\": \"bcm\", \"refresh\": %.17g, \"bits\": %u, \"scan\": %u, \"layout\": \"%s\","
                 "\"order\": [%s], \"duty\": %.17g%s}",
                 test_log_range(r, 10, 2000), bits, sequential ? 1 : 1 + core_random_below(r, 64),
                 core_random_below(r, 2) == 0 ? "rows" : "planes", order, core_random_range(r, 0.01, 1),
                 sequential ? ", \"windows\": [0, 0.3, 0.35, 0.31, 0.69, 0.31]" : "");
        break;
    }
    case SIM_RASTER:
        snprintf(text, sizeof text,
                 "{\"driver\": \"raster\", \"refresh\": %.17g, \"decay\": [%.17g, %.17g, %.17g], \"active\": %.17g,"
                 "\"scan_axis\": \"%s\"}",
                 core_random_range(r, 10, 240), test_log_range(r, 1e-7, 0.1), test_log_range(r, 1e-7, 0.1),
                 test_log_range(r, 1e-6, 1e-3), core_random_range(r, 0.1, 1), core_random_below(r, 2) == 0 ? "x" : "y");
        break;
    }
    brace_error error = {BRACE_OK, ""};
    sim_display *display = NULL;
    if (sim_display_parse(&display, text, "random.json", &error) != BRACE_OK)
        fail_msg("%s in %s", error.message, text);
    return display;
}

#endif
