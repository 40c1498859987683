/* SPDX-License-Identifier: Apache-2.0 */
/* driver_dc.c: steady light, e = L. The negative control: there is nothing to restore. */
#include "sim/display.h"

static brace_status prepare(sim_panel *panel, const float *rgb, brace_error *error) {
    (void)rgb;
    (void)error;
    panel->period = 1.0 / 60; /* any would do */
    return BRACE_OK;
}

static double light(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double phase) {
    (void)panel;
    (void)x;
    (void)y;
    (void)channel;
    return level * phase;
}

static double emission(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double phase) {
    (void)panel;
    (void)x;
    (void)y;
    (void)channel;
    (void)phase;
    return level;
}

static size_t edges(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double *out,
                    size_t size) {
    (void)panel;
    (void)x;
    (void)y;
    (void)channel;
    (void)level;
    (void)out;
    (void)size;
    return 0;
}

const sim_driver sim_driver_dc = {
    .name = "dc",
    .prepare = prepare,
    .light = light,
    .emission = emission,
    .edges = edges,
};
