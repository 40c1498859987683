/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bracket_measure.c: what the pixels say of the exposure of two frames.
 *
 * Banding makes single pixels lie by any factor, so light is summed over regions
 * before it is compared: over the whole picture for the ratio, and over stripes
 * of rows (all bands of one phase are alike there) for how far it may be off. A
 * rolling shutter's bands run along the rows as stored.
 */
#include <math.h>
#include <stdlib.h>

#include "raw/raw.h"

enum { STRIPES = 24, STEP = 2 };

/* Mean of the sums of four samples in the dark frame, of white: below this an error of half a
 * raw unit in the black level shows in the ratio. */
#define DARKEST (4.0 * 5e-4)

static int compare(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Adds up the blocks of 2x2 in a row pair that the bright frame does not clip. */
static void add_row(const brace_frame *dark, const brace_frame *bright, uint32_t y, double sums[2], uint64_t *n) {
    const uint16_t *d = dark->data + (size_t)y * dark->width, *b = bright->data + (size_t)y * bright->width;
    size_t below = dark->width;
    double black_d = 0.0, black_b = 0.0;
    float lowest_black = bright->black[0];
    for (int i = 0; i < 4; i++) {
        black_d += (double)dark->black[i];
        black_b += (double)bright->black[i];
        lowest_black = fminf(lowest_black, bright->black[i]);
    }
    /* Not clipped: 85 % of white is below where sensors bend. Dark blocks count too: choosing
     * those that the bright frame shows lit would choose the rows its own bands favour. */
    double range = (double)(bright->white - lowest_black);
    double clip = (double)lowest_black + 0.85 * range;
    for (uint32_t x = 0; x + 1 < dark->width; x += 2 * STEP) {
        uint16_t p[4] = {b[x], b[x + 1], b[below + x], b[below + x + 1]};
        double light = (double)p[0] + p[1] + p[2] + p[3] - black_b;
        if (p[0] > clip || p[1] > clip || p[2] > clip || p[3] > clip) {
            continue;
        }
        sums[1] += light / range;
        sums[0] += ((double)d[x] + d[x + 1] + d[below + x] + d[below + x + 1] - black_d) /
                   (double)(dark->white - lowest_black);
        (*n)++;
    }
}

raw_ratio raw_measure_ratio(const brace_frame *dark, const brace_frame *bright) {
    raw_ratio none = {(double)NAN, (double)NAN, (double)NAN};
    if (dark->width != bright->width || dark->height != bright->height) {
        return none;
    }
    double total[2] = {0.0, 0.0}, ratios[STRIPES];
    uint64_t count = 0;
    size_t known = 0;
    uint32_t pairs = dark->height / 2;
    for (uint32_t s = 0; s < STRIPES; s++) {
        double sums[2] = {0.0, 0.0};
        uint64_t n = 0;
        uint32_t end = (uint32_t)((uint64_t)pairs * (s + 1) / STRIPES);
        for (uint32_t r = (uint32_t)((uint64_t)pairs * s / STRIPES); r < end; r++) {
            if (pairs < 64 || r % STEP == 0) {
                add_row(dark, bright, 2 * r, sums, &n);
            }
        }
        total[0] += sums[0];
        total[1] += sums[1];
        count += n;
        if (n >= 16 && sums[1] / (double)n > DARKEST) {
            ratios[known++] = sums[0] / sums[1];
        }
    }
    /* Too little to tell: hardly any well-exposed pixel, or nothing but noise in the dark frame. */
    uint64_t looked = (uint64_t)(dark->width / (2 * STEP)) * (pairs < 64 ? pairs : pairs / STEP);
    if (known < 4 || count * 200 < looked || count < 64 || total[0] / (double)count < DARKEST) {
        return none;
    }
    qsort(ratios, known, sizeof ratios[0], compare);
    size_t trim = known / 12;
    return (raw_ratio){total[0] / total[1], ratios[trim], ratios[known - 1 - trim]};
}
