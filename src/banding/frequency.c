/* SPDX-License-Identifier: Apache-2.0 */
/*
 * frequency.c: from stripes in pixels to light in hertz, and to the shutter
 * times that do not show it.
 *
 * Row r is read at r tau, tau = readout/height. Light of frequency F that all
 * rows share makes f = F tau cycles a row. A (packed) row is a sample of it every
 * 2 tau, so that F and |F + k/(2 tau)| look the same. An exposure of T shows the
 * n-th harmonic of the light with |sinc(n F T)| of its amplitude (the Fourier
 * transform of the shutter's window), nothing at all where F T is a whole number.
 */
#include "banding/frequency.h"

#include <math.h>
#include <string.h>

static double sinc(double x) {
    return fabs(x) < 1e-9 ? 1 : sin(M_PI * x) / (M_PI * x);
}

/* Logistic in logarithms; weights fitted to simulated captures of flickering and steady displays (docs/banding.md). */
double banding_confidence(const brace_banding_frame *f) {
    const double contrast = log(fmax(f->contrast, 3e-3)), prominence = log(fmax(f->prominence, 1));
    if (!f->compared)
        return f->alone;
    const double uneven = log(fmax(f->uneven, 1e-3)), clear = uneven - log(fmax(f->row_noise, 1e-3));
    return 1 / (1 + exp(-(1.7 + 1.2 * contrast + 1.05 * prominence + 1.5 * uneven + 0.7 * clear)));
}

double banding_frequency_confidence(const brace_banding *b, const brace_banding_frame *best, uint32_t height) {
    /* An error of 1 % is `off` standard deviations away; few periods and stripes that explain little are doubtful. */
    const double off = 0.01 / fmax(b->frequency_error, 1e-4), periods = b->frequency * height;
    const double doubt = exp(-0.5 * off * off), few = 1 / (1 + exp(-4 * (periods - 2.5)));
    const double clear = 1 / (1 + exp(-12 * (best->share - 0.35)));
    return b->confidence * (1 - doubt) * few * clear;
}

void banding_frame_fill(brace_banding_frame *out, const banding_line *line, const banding_profile *profile) {
    out->compared = !profile->steps;
    out->told = profile->covered;
    banding_profile_evenness(profile, &out->uneven, &out->row_noise);
    if (!line->found)
        return;
    const double fy = 0.5 * line->frequency, fx = 0.5 * line->slant;
    out->frequency = fy;
    out->period = 1 / hypot(fx, fy);
    double degrees = fmod(atan2(fy, fx) * 180 / M_PI + 90, 180);
    out->orientation = degrees < 0 ? degrees + 180 : degrees;
    out->contrast = line->contrast;
    out->share = line->share;
    out->prominence = line->ratio;
    out->frequency_error = line->frequency > 0 ? line->error / line->frequency : 0;
    for (int h = 0; h < BRACE_BANDING_HARMONICS; h++)
        out->harmonic[h] = line->harmonic[h];
}

/* The light's own harmonics, as instantaneous exposures would show them: from the frame that tells best. */
static bool light_harmonics(double light[BRACE_BANDING_HARMONICS], const brace_banding *b) {
    const brace_banding_frame *best = NULL;
    double most = 0;
    for (size_t i = 0; i < b->count; i++) {
        const brace_banding_frame *f = &b->frame[i];
        const double seen = f->exposure_time > 0 ? f->confidence * f->harmonic[0] : 0;
        if (seen > most)
            most = seen, best = f;
    }
    if (!best)
        return false;
    for (int h = 0; h < BRACE_BANDING_HARMONICS; h++) {
        /* Near a zero of the sinc nothing is known; light is positive, so no harmonic exceeds twice its mean. */
        const double s = fabs(sinc((h + 1) * b->hz * best->exposure_time));
        light[h] = fmin(2, best->harmonic[h] / fmax(s, 0.1));
    }
    return true;
}

static double predicted(const double light[BRACE_BANDING_HARMONICS], double hz, double seconds) {
    double sum = 0;
    for (int h = 0; h < BRACE_BANDING_HARMONICS; h++)
        sum += light[h] * fabs(sinc((h + 1) * hz * seconds));
    return fmin(1, sum);
}

/* The frames' contrasts against each other. 3 % of frequency are forgiven: near a zero of the sinc they matter. */
static int decay(const brace_banding *b) {
    double light[BRACE_BANDING_HARMONICS];
    int slower = 0, faster = 0;
    if (!light_harmonics(light, b))
        return 0;
    for (size_t i = 0; i < b->count; i++) {
        const brace_banding_frame *f = &b->frame[i];
        if (!f->compared || f->confidence < 0.5 || !(f->exposure_time > 0))
            continue;
        double low = INFINITY, high = 0;
        for (int shift = -3; shift <= 3; shift++) {
            const double expected = light[0] * fabs(sinc((1 + 0.01 * shift) * b->hz * f->exposure_time));
            low = fmin(low, expected), high = fmax(high, expected);
        }
        slower += f->harmonic[0] > 2.5 * high + 0.03;
        faster += low > 3 * f->harmonic[0] + 0.1;
    }
    return slower > faster ? 1 : faster > slower ? -1 : 0;
}

static void shutters(brace_banding *b) {
    static const double usual[] = {4,   5,   6,   8,   10,  13,  15,  20,   25,   30,   40,   50,   60,   80,   100,  125, 160,
                                   200, 250, 320, 400, 500, 640, 800, 1000, 1250, 1600, 2000, 2500, 3200, 4000, 5000, 6400,
                                   8000};
    double light[BRACE_BANDING_HARMONICS];
    if (!light_harmonics(light, b))
        return;
    for (size_t i = 0; i < sizeof usual / sizeof *usual; i++)
        b->usual[b->usuals++] = (brace_banding_shutter){1 / usual[i], predicted(light, b->hz, 1 / usual[i]), 0};
    for (int n = 1; n <= 1 << 20 && b->exacts < 12; n += n < 5 ? 1 : n / 2) {
        const double seconds = n / b->base_hz;
        if (seconds > 0.25)
            break;
        if (seconds >= 1.0 / 8000)
            b->exact[b->exacts++] = (brace_banding_shutter){seconds, predicted(light, b->hz, seconds), n};
    }
}

/* Stripes aslant: the light's phase depends on where on the display a row lies. One frame may err by some degrees,
 * frames that agree do not. */
static bool aslant(const brace_banding *b, const brace_banding_frame *best) {
    double tilt[BRACE_BANDING_MAX_FRAMES], sum = 0, apart = 0;
    size_t n = 0;
    for (size_t i = 0; i < b->count; i++) {
        const brace_banding_frame *f = &b->frame[i];
        if (f->confidence < 0.5 || !f->compared || f->contrast < 0.05)
            continue;
        tilt[n] = f->orientation > 90 ? f->orientation - 180 : f->orientation;
        sum += tilt[n++];
    }
    for (size_t i = 0; i < n; i++)
        apart = fmax(apart, fabs(tilt[i] - sum / (double)n));
    if (n > 1)
        return fabs(sum) > 1.5 * (double)n && apart < 2;
    return fmin(best->orientation, 180 - best->orientation) > 3 && best->share > 0.3;
}

static brace_banding_source source(const brace_banding *b) {
    if (b->confidence < 0.5)
        return BRACE_BANDING_STEADY;
    const brace_banding_frame *best = &b->frame[0];
    for (size_t i = 1; i < b->count; i++)
        if (b->frame[i].confidence * b->frame[i].contrast > best->confidence * best->contrast)
            best = &b->frame[i];
    if (aslant(b, best))
        return BRACE_BANDING_SCANNED;
    /* What follows rests on the frequency. */
    if (b->hz <= 0 || b->frequency_confidence < 0.5)
        return BRACE_BANDING_UNKNOWN;
    if (b->decay != 0)
        return b->decay < 0 ? BRACE_BANDING_SCANNED : BRACE_BANDING_UNKNOWN;
    const double error = fmax(0.01, b->spread);
    for (int mains = 100; mains <= 120; mains += 20)
        if (fabs(b->hz / mains - 1) < error && best->contrast < 0.4 && best->harmonic[1] < 0.3 * best->harmonic[0])
            return BRACE_BANDING_MAINS;
    const double refreshes = b->hz / 960;
    if (refreshes > 0.9 && fabs(refreshes / fmax(1, round(refreshes)) - 1) < 2 * error)
        return BRACE_BANDING_LED_WALL;
    return b->hz > 150 ? BRACE_BANDING_BACKLIGHT : BRACE_BANDING_UNKNOWN;
}

void banding_frequency(brace_banding *b, uint32_t height, int base) {
    const bool found = b->frequency > 0;
    if (b->readout > 0 && found) {
        const double row = b->readout / height, sampled = 1 / (2 * row);
        b->hz = b->frequency / row;
        b->base_hz = b->hz / base;
        for (size_t i = 0; i < b->count; i++)
            b->frame[i].hz = b->frame[i].frequency / row;
        for (int k = 1; 2 * k <= BRACE_BANDING_ALIASES; k++)
            for (int sign = -1; sign <= 1; sign += 2) {
                const double alias = k * sampled + sign * b->hz;
                bool possible = true;
                for (size_t i = 0; i < b->count; i++) {
                    const brace_banding_frame *f = &b->frame[i];
                    /* |2 c_n / c_0| <= 2 for light, times the envelope of the sinc. */
                    if (f->confidence > 0.5 && f->exposure_time > 0)
                        possible = possible && f->harmonic[0] < 1.2 * 2 / (M_PI * alias * f->exposure_time);
                }
                b->alias_possible[b->aliases] = possible;
                b->alias_hz[b->aliases++] = alias;
            }
        if (b->confidence >= 0.5)
            shutters(b), b->decay = decay(b);
    }
    b->source = source(b);
}

const char *brace_banding_source_name(brace_banding_source which) {
    static const char *const names[] = {"steady", "unknown", "backlight", "scanned", "led_wall", "mains"};
    return (unsigned)which < sizeof names / sizeof *names ? names[which] : names[BRACE_BANDING_UNKNOWN];
}
