/* SPDX-License-Identifier: Apache-2.0 */
#include "scene.h"

// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>
// clang-format on
#include <math.h>
#include <string.h>

#include "core/core.h"

static double wave(double x, double y, double fx, double fy, double phase) {
    return 0.5 + 0.5 * sin(fx * x + fy * y + phase);
}

static double tint_of(int color) {
    return color == 0 ? 0.8 : color == 1 ? 1 : 0.7;
}

double scene_light(const scene *s, double x, double y, int color) {
    double tint = tint_of(color);
    if (s->bezel) {
        return (y < 0.7 * s->height ? s->level : 0.004) * tint;
    }
    if (s->paper || s->lamp > 0) {
        /* Lines of text, slightly tilted, each glyph a bar; a margin around. */
        double u = x / s->width, v = y / s->height;
        if (u < 0.06 || u > 0.95 || v < 0.05 || v > 0.94)
            return s->lamp > 0 ? s->lamp * tint : 0.02 * s->level * tint;
        double v_line = (y + 0.02 * x) / 17, glyph = sin(0.61 * x + 11 * floor(v_line));
        double ink = 1 / (1 + exp(-6 * (sin(6.2832 * v_line) - 0.1))) / (1 + exp(-5 * (glyph - 0.1)));
        if (s->lamp > 0)
            return tint * (s->lamp + s->level * ink); /* a terminal */
        return s->level * tint * (1 - 0.9 * ink);
    }
    double texture = 0.3 * wave(x, y, 0.031, 0.017, color) + 0.3 * wave(x, y, -0.05, 0.09, 2) +
                     0.25 * wave(x, y, 0.23, 0.13, 1) + 0.15 * wave(x, y, 0.41, -0.33, 0);
    double block = (sin(0.02 * x + 1) * sin(0.027 * y + 0.5) > 0.3) ? 1 : 0.45;
    return s->level * tint * (0.15 + 0.85 * texture) * block;
}

/* Time that the light is on in [a, a + t], in pulses. */
static double lit(double a, double t, double duty) {
    double end = a + t;
    return (floor(end) * duty + fmin(end - floor(end), duty)) - (floor(a) * duty + fmin(a - floor(a), duty));
}

brace_bracket *scene_bracket(const scene *s) {
    brace_frame *frames[5];
    for (int i = 0; i < 5; i++) {
        brace_error error;
        assert_int_equal(brace_frame_create(&frames[i], s->width, s->height, s->cfa, &error), BRACE_OK);
        brace_frame *f = frames[i];
        double ratio = pow(4, i - 2);
        f->white = 16383;
        for (int c = 0; c < 4; c++)
            f->black[c] = (float)(512 + c);
        f->exposure_time = ratio / 200, f->iso = 100, f->f_number = 1.8;
        for (int c = 0; c < 3; c++)
            f->noise[c][0] = 1e-4, f->noise[c][1] = 1e-7;
        f->has_noise = true;
        for (uint32_t y = 0; y < s->height; y++) {
            double gain = 1;
            if (s->pulses > 0) {
                double t = ratio * s->reference;
                gain = lit(100 + 0.37 * i + s->pulses * y / s->height, t, s->duty) / (t * s->duty);
            }
            for (uint32_t x = 0; x < s->width; x++) {
                double move = (i - 2) * s->shift, at_x = x - move, at_y = y - move - (i == 4 ? s->slip : 0);
                int color = brace_cfa_color(s->cfa, x, y), steps = s->smear > 0 && i > 2 ? 8 : 1;
                double light = 0;
                if (s->flashes && i < 2)
                    gain = (y / 3 + 3 * (uint32_t)i + 5 * (x / 20) + 3 * (uint32_t)color) % 8 == 0 ? 8 : 0.01;
                for (int k = 0; k < steps; k++)
                    light += scene_light(s, at_x, at_y + s->smear * (i - 2) * ((k + 0.5) / steps - 0.5), color) / steps;
                double seen = s->lamp > 0 ? light + (gain - 1) * s->lamp * tint_of(color) : gain * light, v = ratio * seen;
                core_random r = core_random_create(s->seed, (uint32_t)i, x, y);
                if (!s->no_noise)
                    v += core_random_normal(&r) * sqrt(1e-4 * v + 1e-7);
                float black = f->black[(y & 1) * 2 + (x & 1)];
                double raw = floor(v * (f->white - black) + black + 0.5);
                f->data[(size_t)y * s->width + x] = (uint16_t)fmin(fmax(raw, 0), f->white);
            }
        }
    }
    brace_bracket *bracket;
    brace_error error;
    if (brace_bracket_create(&bracket, frames, 5, NULL, NULL, &error))
        fail_msg("%s", error.message);
    return bracket;
}

double scene_psnr(const scene *s, const float *mosaic) {
    double sum = 0, n = 0;
    for (uint32_t y = 8; y + 8 < s->height; y++)
        for (uint32_t x = 8; x + 8 < s->width; x++) {
            double truth = fmin(scene_light(s, x, y, brace_cfa_color(s->cfa, x, y)), 1);
            double got = fmin(fmax((double)mosaic[(size_t)y * s->width + x], 0), 1), d = sqrt(got) - sqrt(truth);
            sum += d * d, n++;
        }
    return 10 * log10(n / sum);
}
