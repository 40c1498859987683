/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_measure.c: brackets made here, of known light: texture times a pulse train integrated over each row's exposure,
 * with noise. Frequency, contrast and orientation must be found, steady light must not be taken for banding, and
 * whatever else comes in must give finite numbers.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "brace/banding.h"
#include "banding/consensus.h"
#include "core/core.h"

enum { WIDTH = 320, HEIGHT = 480, FRAMES = 4 };

static const double readout = 0.012;

/* Light of 1 in the mean: pulses of this duty; smooth if it has none, of this depth. hz 0: steady. */
typedef struct lamp {
    double hz, duty, depth;
    double lag;     /* of the display's last column behind its first, seconds */
    double readout; /* of the camera; 0: as above */
} lamp;

/* From 0 to t. */
static double light_until(double t, const lamp *l) {
    if (l->hz <= 0)
        return t;
    if (l->duty <= 0)
        return t + l->depth * (1 - cos(2 * M_PI * l->hz * t)) / (2 * M_PI * l->hz);
    const double periods = floor(t * l->hz), rest = t * l->hz - periods;
    return (periods + fmin(rest, l->duty) / l->duty) / l->hz;
}

static void free_all(brace_frame **frames) {
    for (int i = 0; i < FRAMES; i++)
        brace_frame_destroy(frames[i]);
}

/* The content is lines of text of 12 rows; it moves by `shift` rows from frame to frame. */
static void make(brace_frame **frames, const lamp *l, uint32_t seed, int shift) {
    for (int i = 0; i < FRAMES; i++) {
        core_random r = core_random_create(seed, (uint32_t)i, 0, 0);
        brace_frame *f = NULL;
        assert_int_equal(brace_frame_create(&f, WIDTH, HEIGHT, BRACE_CFA_RGGB, NULL), BRACE_OK);
        frames[i] = f;
        f->exposure_time = ldexp(1.0 / 6400, 2 * i), f->iso = 100, f->f_number = 2;
        for (int c = 0; c < 3; c++)
            f->noise[c][0] = 4e-5, f->noise[c][1] = 1e-7;
        for (uint32_t y = 0; y < HEIGHT; y++) {
            const double row_start = (l->readout > 0 ? l->readout : readout) * y / HEIGHT + 0.1 * i, t = f->exposure_time;
            for (uint32_t x = 0; x < WIDTH; x++) {
                const double start = row_start + l->lag * (WIDTH - x) / WIDTH;
                const double light = (light_until(start + t, l) - light_until(start, l)) / t;
                const uint32_t row = y + (uint32_t)(shift * i), letter = (x / 5 * 2654435761u ^ row / 12 * 40503u) >> 16;
                const bool ink = row % 12 < 7 && letter & 1;
                const double signal = fmin(1, (ink ? 0.1 : 0.9) * 0.015 * ldexp(1, 2 * i) * light);
                const double value = signal + core_random_normal(&r) * sqrt(4e-5 * signal + 1e-7);
                f->data[y * WIDTH + x] = (uint16_t)lround(65535 * fmin(1, fmax(0, value)));
            }
        }
    }
}

static void test_backlights(void **state) {
    (void)state;
    static const double hz[] = {400, 700, 1234, 2500}, duty[] = {0.3, 0.5, 0.7, 0.4};
    for (size_t n = 0; n < sizeof hz / sizeof *hz; n++) {
        brace_frame *frames[FRAMES];
        make(frames, &(lamp){.hz = hz[n], .duty = duty[n]}, (uint32_t)n, (int)n % 3);
        const brace_banding_params params = {.readout = readout};
        /* The order given is the order of the answers, whatever the exposures. */
        const brace_frame *shuffled[FRAMES] = {frames[2], frames[0], frames[3], frames[1]};
        brace_banding b, same;
        const brace_job one = {.threads = 1}, three = {.threads = 3};
        assert_int_equal(brace_banding_measure(&b, shuffled, FRAMES, &params, &one, NULL), BRACE_OK);
        assert_int_equal(brace_banding_measure(&same, shuffled, FRAMES, &params, &three, NULL), BRACE_OK);
        assert_true(b.hz == same.hz && b.confidence == same.confidence);
        if (!(fabs(b.hz / hz[n] - 1) < 0.005 && b.confidence > 0.9 && b.frequency_confidence > 0.8))
            fail_msg("%g Hz: %g, confidence %g, of the frequency %g", hz[n], b.hz, b.confidence, b.frequency_confidence);
        assert_true(b.frame[1].exposure_time < b.frame[3].exposure_time);
        assert_true(b.frame[1].contrast > 0.9 && b.frame[1].compared);
        assert_true(fmin(b.frame[1].orientation, 180 - b.frame[1].orientation) < 1);
        assert_true(fabs(b.frame[1].period * b.frame[1].frequency - 1) < 0.01);
        assert_int_equal(b.decay, 0);
        assert_true(b.usuals == 34 && b.exacts > 3 && b.exact[0].contrast < 0.02);
        for (size_t i = 0; i < b.aliases; i++)
            assert_true(b.alias_hz[i] > 0);
        /* Half the readout time is another frequency, and one that the decay contradicts or allows, but never hides. */
        const brace_banding_params wrong = {.readout = readout / 3};
        assert_int_equal(brace_banding_measure(&b, shuffled, FRAMES, &wrong, &one, NULL), BRACE_OK);
        assert_true(fabs(b.hz / (3 * hz[n]) - 1) < 0.005);
        /* Without a readout there are no hertz. */
        assert_int_equal(brace_banding_measure(&b, shuffled, FRAMES, NULL, &one, NULL), BRACE_OK);
        assert_true(b.hz == 0 && b.usuals == 0 && b.confidence > 0.9);
        free_all(frames);
    }
}

static void test_steady(void **state) {
    (void)state;
    for (uint32_t seed = 0; seed < 3; seed++) {
        brace_frame *frames[FRAMES];
        make(frames, &(lamp){0}, seed, (int)seed);
        brace_banding b;
        const brace_banding_params params = {.readout = readout};
        assert_int_equal(brace_banding_measure(&b, (const brace_frame *const *)frames, FRAMES, &params, NULL, NULL),
                         BRACE_OK);
        if (b.confidence >= 0.5)
            fail_msg("steady light, seed %u: confidence %g at %g Hz", seed, b.confidence, b.hz);
        assert_int_equal(b.source, BRACE_BANDING_STEADY);
        assert_int_equal(b.usuals, 0);
        free_all(frames);
    }
}

/* What shone is told by its frequency, its shape, and whether the display's columns share it. */
static void test_sources(void **state) {
    (void)state;
    static const struct {
        lamp lamp;
        brace_banding_source source;
        const char *name;
    } cases[] = {
        {{.hz = 400, .duty = 0.4}, BRACE_BANDING_BACKLIGHT, "backlight"},
        {{.hz = 1920, .duty = 0.3}, BRACE_BANDING_LED_WALL, "led_wall"},
        {{.hz = 400, .duty = 0.4, .lag = 0.0008}, BRACE_BANDING_SCANNED, "scanned"},
        {{.hz = 100, .depth = 0.3, .readout = 0.06}, BRACE_BANDING_MAINS, "mains"},
        {{.hz = 120, .depth = 0.3, .readout = 0.06}, BRACE_BANDING_MAINS, "mains"},
        {{.hz = 100, .duty = 0.3, .readout = 0.06}, BRACE_BANDING_UNKNOWN, "unknown"}, /* no lamp is as deep */
    };
    for (size_t n = 0; n < sizeof cases / sizeof *cases; n++) {
        brace_frame *frames[FRAMES];
        make(frames, &cases[n].lamp, (uint32_t)n, 0);
        const brace_banding_params params = {.readout = cases[n].lamp.readout > 0 ? cases[n].lamp.readout : readout};
        brace_banding b;
        assert_int_equal(brace_banding_measure(&b, (const brace_frame *const *)frames, FRAMES, &params, NULL, NULL),
                         BRACE_OK);
        if (b.source != cases[n].source || strcmp(brace_banding_source_name(b.source), cases[n].name) != 0)
            fail_msg("light of %g Hz is told as %s and not as %s (%g Hz)", cases[n].lamp.hz,
                     brace_banding_source_name(b.source), cases[n].name, b.hz);
        free_all(frames);
    }
    assert_string_equal(brace_banding_source_name((brace_banding_source)99), "unknown");
}

/* One frame on its own: a page of text with margins and a table's rules across all of it, seen by a camera that is tilted;
 * light of this contrast and so many periods in the frame, aslant by `slant` rows a column. */
static brace_frame *page(double contrast, double periods, double slant, uint32_t seed) {
    brace_frame *f = NULL;
    core_random r = core_random_create(seed, 0, 0, 1);
    assert_int_equal(brace_frame_create(&f, 512, 384, BRACE_CFA_RGGB, NULL), BRACE_OK);
    f->exposure_time = 0.001;
    for (int c = 0; c < 3; c++)
        f->noise[c][0] = 2e-4, f->noise[c][1] = 1e-6;
    for (uint32_t y = 0; y < 384; y++)
        for (uint32_t x = 0; x < 512; x++) {
            const double row = y + 0.04 * x; /* of the page, which stands askew */
            const uint32_t line = (uint32_t)row / 14, letter = (x / 6 * 2654435761u ^ line * 40503u) >> 16;
            const bool text = x > 60 && x < 420 && (uint32_t)row % 14 < 8 && letter % 3 == 0, rule = (uint32_t)row % 56 == 3;
            const double light = 1 + contrast * cos(2 * M_PI * periods * (y + slant * x) / 384);
            const double signal = (text ? 0.1 : rule ? 0.4 : x > 460 ? 0.3 : 0.8) * 0.3 * light;
            f->data[y * 512 + x] = (uint16_t)lround(65535 * fmax(0, signal + core_random_normal(&r) * sqrt(2e-4 * signal + 1e-6)));
        }
    return f;
}

static void test_alone(void **state) {
    (void)state;
    static const struct {
        double contrast, periods, slant;
    } lit[] = {{0.9, 3.2, 0}, {0.3, 5.5, 0}, {0.3, 8, -0.05}, {0.1, 12, 0}, {0.1, 20, 0.03}, {0.3, 40, 0}};
    double most_steady = -INFINITY;
    for (uint32_t seed = 0; seed < 4; seed++) {
        brace_frame *frame = page(0, 1, 0, seed);
        banding_consensus c;
        assert_int_equal(banding_consensus_frame(&c, frame, NULL, NULL), BRACE_OK);
        most_steady = fmax(most_steady, c.odds);
        brace_frame_destroy(frame);
    }
    for (size_t n = 0; n < sizeof lit / sizeof *lit; n++) {
        brace_frame *frame = page(lit[n].contrast, lit[n].periods, lit[n].slant, (uint32_t)n);
        banding_consensus c, same;
        core_pool *pool = NULL;
        const brace_job three = {.threads = 3};
        assert_int_equal(core_pool_create(&pool, &three, NULL), BRACE_OK);
        assert_int_equal(banding_consensus_frame(&c, frame, NULL, NULL), BRACE_OK);
        assert_int_equal(banding_consensus_frame(&same, frame, pool, NULL), BRACE_OK);
        assert_memory_equal(&c, &same, sizeof c);
        core_pool_destroy(pool);
        if (!(c.odds > most_steady + 1 && fabs(c.periods - lit[n].periods) < 0.8 && c.locked > 0.6))
            fail_msg("%g of %g periods: odds %g (steady %g), %g periods, locked %g", lit[n].contrast, lit[n].periods, c.odds,
                     most_steady, c.periods, c.locked);
        /* Cycles a packed row and column; a strip is as fine as a slant is told. */
        assert_true(fabs(c.slant - lit[n].slant * c.frequency) < 0.002);
        /* Over the brightest light, and less where pixels disagree: never more than there is. */
        const double wave = lit[n].contrast / (1 + lit[n].contrast);
        if (!(c.amplitude > 0.4 * wave && c.amplitude < 1.2 * wave))
            fail_msg("%g of %g periods: amplitude %g", lit[n].contrast, lit[n].periods, c.amplitude);
        brace_banding b;
        assert_int_equal(brace_banding_measure(&b, (const brace_frame *const *)&frame, 1, NULL, NULL, NULL), BRACE_OK);
        if (fabs(b.frame[0].frequency * 384 / lit[n].periods - 1) > 0.03)
            fail_msg("%g of %g periods: %g", lit[n].contrast, lit[n].periods, b.frame[0].frequency * 384);
        assert_true((lit[n].contrast < 0.2 || b.confidence > 0.5) && !b.frame[0].compared && b.frame[0].alone == b.confidence);
        brace_frame_destroy(frame);
    }
    assert_true(most_steady < 0);
}

static void all_finite(const brace_banding *b) {
    const double numbers[] = {b->confidence, b->frequency, b->spread, b->frequency_error, b->frequency_confidence, b->hz,
                              b->base_hz};
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++)
        assert_true(isfinite(numbers[i]));
    assert_true(b->confidence >= 0 && b->confidence <= 1);
    for (size_t i = 0; i < b->count; i++) {
        const brace_banding_frame *f = &b->frame[i];
        const double fields[] = {f->confidence, f->told,  f->alone, f->frequency, f->period,    f->orientation,     f->contrast,
                                 f->share,      f->hz,    f->uneven,    f->row_noise, f->frequency_error, f->prominence};
        for (size_t k = 0; k < sizeof fields / sizeof *fields; k++)
            assert_true(isfinite(fields[k]));
    }
}

static void test_odd_frames(void **state) {
    (void)state;
    static const uint32_t sizes[][2] = {{4, 4}, {5, 7}, {22, 22}, {64, 4}, {4, 64}, {97, 101}};
    for (size_t n = 0; n < sizeof sizes / sizeof *sizes; n++)
        for (int kind = 0; kind < 4; kind++) {
            brace_frame *frames[3];
            core_random r = core_random_create(n, (uint32_t)kind, 0, 0);
            for (int i = 0; i < 3; i++) {
                assert_int_equal(brace_frame_create(&frames[i], sizes[n][0], sizes[n][1], BRACE_CFA_GBRG, NULL), BRACE_OK);
                frames[i]->exposure_time = kind == 3 ? NAN : ldexp(0.001, 2 * i);
                for (size_t k = 0; k < (size_t)sizes[n][0] * sizes[n][1]; k++)
                    frames[i]->data[k] = kind == 0 ? 0 : kind == 1 ? 65535 : (uint16_t)core_random_below(&r, 65536);
            }
            for (size_t count = 1; count <= 3; count += 2) {
                brace_banding b;
                const brace_banding_params params = {.readout = 0.01};
                assert_int_equal(
                    brace_banding_measure(&b, (const brace_frame *const *)frames, count, &params, NULL, NULL), BRACE_OK);
                all_finite(&b);
                assert_true(kind > 1 || b.confidence < 0.5);
            }
            for (int i = 0; i < 3; i++)
                brace_frame_destroy(frames[i]);
        }
    brace_banding b;
    brace_error error;
    assert_int_equal(brace_banding_measure(&b, NULL, 0, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    brace_frame *frame = NULL;
    assert_int_equal(brace_frame_create(&frame, 64, 64, BRACE_CFA_RGGB, NULL), BRACE_OK);
    const brace_banding_params nonsense = {.readout = NAN};
    assert_int_equal(brace_banding_measure(&b, (const brace_frame *const *)&frame, 1, &nonsense, NULL, &error),
                     BRACE_ERROR_ARGUMENT);
    brace_frame_destroy(frame);
}

/* Whatever allocation fails, it is said, and nothing leaks. */
static void test_memory(void **state) {
    (void)state;
    brace_frame *frames[2];
    for (int i = 0; i < 2; i++) {
        assert_int_equal(brace_frame_create(&frames[i], 48, 40, BRACE_CFA_RGGB, NULL), BRACE_OK);
        frames[i]->exposure_time = 0.001 * (1 + 3 * i);
        for (size_t k = 0; k < 48 * 40; k++)
            frames[i]->data[k] = (uint16_t)(k * 2654435761u >> 18);
    }
    const brace_job job = {.threads = 1};
    for (long n = 1; n < 80; n++) {
        brace_banding b;
        core_alloc_fail_after(n);
        const brace_status status = brace_banding_measure(&b, (const brace_frame *const *)frames, 2, NULL, &job, NULL);
        core_alloc_fail_after(0);
        assert_true(status == BRACE_OK || status == BRACE_ERROR_MEMORY);
    }
    brace_frame_destroy(frames[0]), brace_frame_destroy(frames[1]);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_backlights), cmocka_unit_test(test_steady),
                                       cmocka_unit_test(test_sources),    cmocka_unit_test(test_alone),
                                       cmocka_unit_test(test_odd_frames), cmocka_unit_test(test_memory)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
