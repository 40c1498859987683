/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_light.c: every vectorised light kernel against the plain one, with
 * hostile input, odd lengths and guarded ends.
 */
#include <string.h>

#include "sim/data_path.h"
#include "tests_sim.h"

enum { MOST = 4099, GUARD = 16 };

static int32_t xs[MOST], ys[MOST];
static float levels[MOST], plain[MOST + 2 * GUARD], fast[MOST + 2 * GUARD], other[MOST + 2 * GUARD];
static double starts[MOST];

static void fill(core_random *r, const sim_panel *p, size_t n) {
    double period = sim_panel_period(p);
    for (size_t i = 0; i < n; i++) {
        xs[i] = (int32_t)core_random_below(r, p->width);
        ys[i] = (int32_t)core_random_below(r, p->height);
        levels[i] = (float)core_random_uniform(r);
        starts[i] = core_random_range(r, -2, 100) * period;
        switch (core_random_below(r, 24)) {
        case 0:
            levels[i] = 0;
            break;
        case 1:
            levels[i] = 1;
            break;
        case 2:
            levels[i] *= 1e-4f;
            break;
        case 3:
            levels[i] = 1.5f; /* brighter than white */
            break;
        case 4:
            levels[i] = -0.01f;
            break;
        case 5:
            xs[i] = INT32_MIN;
            ys[i] = INT32_MAX;
            break;
        case 6:
            starts[i] = sim_panel_start(p, (uint32_t)xs[i], (uint32_t)ys[i], 1); /* right on a corner */
            break;
        case 7:
            starts[i] = core_random_range(r, -10, 10); /* seconds */
            break;
        case 8:
            levels[i] = (float)(core_random_below(r, 256)) / 255; /* half-way between counts */
            break;
        default:
            break;
        }
    }
}

/* As in a frame: samples that start together and go along a row of the screen, often several to a pixel or zone,
 * with a neighbour here and there. */
static void fill_row(core_random *r, const sim_panel *p, size_t n) {
    const double step = core_random_range(r, 0.01, 2), slope = core_random_range(r, -0.02, 0.02);
    const uint32_t first = core_random_below(r, p->width), y = core_random_below(r, p->height);
    for (size_t i = 0; i < n; i++) {
        xs[i] = (int32_t)(first + step * (double)i) % (int32_t)p->width + (core_random_below(r, 50) == 0);
        ys[i] = (int32_t)(y + slope * (double)i);
        starts[i] = starts[0];
    }
}

static void guard(float *out, size_t n, bool check) {
    const float canary = 12345.0f;
    for (size_t i = 0; i < GUARD; i++) {
        if (check) {
            assert_true(out[i] == canary);
            assert_true(out[GUARD + n + i] == canary);
        } else {
            out[i] = out[GUARD + n + i] = canary;
        }
    }
}

/* The brightest that a subpixel of level 1 gets. */
static double peak(const sim_panel *p, int channel) {
    switch (p->display->kind) {
    case SIM_LED_SPWM:
        return p->period * p->d.led.clock_rate / p->d.led.top;
    case SIM_BCM:
        return p->period / (p->d.bcm.unit * p->d.bcm.top * p->d.bcm.scale[channel]);
    case SIM_RASTER:
        return p->d.raster.norm[channel] * p->d.raster.rate[channel];
    default:
        return 200;
    }
}

static void compare(const sim_panel *p, sim_light_fn *kernel, size_t n, int channel, double exposure, float *out) {
    guard(plain, n, false);
    guard(out, n, false);
    sim_light_plain(p, n, xs, ys, levels, channel, starts, exposure, plain + GUARD);
    kernel(p, n, xs, ys, levels, channel, starts, exposure, out + GUARD);
    guard(plain, n, true);
    guard(out, n, true);
    for (size_t i = 0; i < n; i++) {
        float a = plain[GUARD + i], b = out[GUARD + i];
        /* A time after seconds is rounded to 1e-15 s or so: that much of a bright pulse may come or go. */
        double rounding = 3e-15 * (1 + fabs(starts[i])) / exposure * peak(p, channel);
        if (!(fabs((double)a - (double)b) <= 1e-6 + 2e-7 * fabs((double)a) + rounding))
            fail_msg("%s: sample %zu of %zu: x %d y %d level %.9g start %.12g channel %d exposure %g: %.9g, plain %.9g",
                     p->driver->name, i, n, xs[i], ys[i], (double)levels[i], starts[i], channel, exposure, (double)b,
                     (double)a);
    }
}

static void check_kernels(const sim_panel *p, core_random *r) {
    core_cpu cpu = core_cpu_features();
    sim_light_fn *kernels[2] = {NULL, NULL};
#if defined(__x86_64__)
    if (cpu.avx2)
        kernels[0] = sim_light_avx2(p);
    if (cpu.avx512)
        kernels[1] = sim_light_avx512(p);
#endif
    (void)cpu;
    static const size_t sizes[] = {0, 1, 3, 4, 7, 8, 9, 31, 1000, MOST};
    for (size_t s = 0; s < 2 * sizeof sizes / sizeof *sizes; s++) {
        size_t n = sizes[s / 2];
        fill(r, p, n);
        if (s % 2 == 1)
            fill_row(r, p, n);
        int channel = (int)core_random_below(r, 3);
        double exposure = test_log_range(r, 4e-6, 1);
        for (int k = 0; k < 2; k++)
            if (kernels[k] != NULL)
                compare(p, kernels[k], n, channel, exposure, k == 0 ? fast : other);
        /* A set made on one machine is the same on another. */
        if (kernels[0] != NULL && kernels[1] != NULL)
            assert_memory_equal(fast + GUARD, other + GUARD, n * sizeof *fast);
    }
}

static void test_kernels(void **state) {
    (void)state;
    core_random r = core_random_create(9, 0, 0, 0);
    float *rgb = test_screen(97, 61, 1);
    for (int kind = SIM_DC; kind <= SIM_RASTER; kind++)
        for (int i = 0; i < 30; i++) {
            sim_display *display = test_random_display((sim_driver_kind)kind, &r);
            sim_panel *panel = NULL;
            assert_int_equal(sim_panel_create(&panel, display, rgb, 97, 61, NULL), BRACE_OK);
            check_kernels(panel, &r);
            sim_panel_destroy(panel);
            sim_display_destroy(display);
        }
    free(rgb);
}

/* A window of a whole number of periods has no banding, to the precision of its numbers. */
static void test_whole_periods(void **state) {
    (void)state;
    core_random r = core_random_create(11, 0, 0, 0);
    json_t *names = sim_data_names("displays");
    float *rgb = test_screen(97, 61, 1);
    for (size_t i = 0; i < json_array_size(names); i++) {
        sim_display *display = NULL;
        sim_panel *p = NULL;
        assert_int_equal(sim_display_load(&display, json_string_value(json_array_get(names, i)), NULL), BRACE_OK);
        assert_int_equal(sim_panel_create(&p, display, rgb, 97, 61, NULL), BRACE_OK);
        fill(&r, p, 500);
        for (int k = 1; k <= 3; k++) {
            sim_light_kernel(p, core_cpu_features())(p, 500, xs, ys, levels, k - 1, starts, k * p->period, fast);
            for (size_t s = 0; s < 500; s++)
                assert_true(fabsf(fast[s] - levels[s]) <= 4e-7f * fabsf(levels[s]) + 1e-9f);
        }
        sim_panel_destroy(p);
        sim_display_destroy(display);
    }
    json_decref(names);
    free(rgb);
}

/* Nothing but NaN and infinity comes of NaN and infinity: no bad access, no endless loop. */
static void test_hostile(void **state) {
    (void)state;
    core_random r = core_random_create(10, 0, 0, 0);
    float *rgb = test_screen(97, 61, 1);
    const double bad[] = {NAN, INFINITY, -INFINITY, 1e300, -1e18, 1e18};
    for (int kind = SIM_DC; kind <= SIM_RASTER; kind++)
        for (int i = 0; i < 10; i++) {
            sim_display *display = test_random_display((sim_driver_kind)kind, &r);
            sim_panel *panel = NULL;
            assert_int_equal(sim_panel_create(&panel, display, rgb, 97, 61, NULL), BRACE_OK);
            size_t n = 203;
            fill(&r, panel, n);
            for (size_t k = 0; k < n; k++) {
                if (core_random_below(&r, 2) == 0)
                    starts[k] = bad[core_random_below(&r, 6)];
                else
                    levels[k] = (float)bad[core_random_below(&r, 6)];
            }
            core_cpu cpu = core_cpu_features();
            for (int pass = 0; pass < 3; pass++) {
                guard(fast, n, false);
                sim_light_kernel(panel, cpu)(panel, n, xs, ys, levels, i % 3, starts, pass == 0 ? 1e-3 : bad[pass],
                                             fast + GUARD);
                guard(fast, n, true);
                if (cpu.avx512)
                    cpu.avx512 = false;
                else
                    cpu.avx2 = false;
            }
            sim_panel_destroy(panel);
            sim_display_destroy(display);
        }
    free(rgb);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_kernels), cmocka_unit_test(test_whole_periods),
                                       cmocka_unit_test(test_hostile)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
