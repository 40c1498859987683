/* SPDX-License-Identifier: Apache-2.0 */
/*
 * wasserstein.c: the distance between two sets of equally many numbers,
 *
 *   W1 = 1/n sum |x_(i) - y_(i)| = 1/n integral |D(t)| dt,  D(t) = #{x <= t} - #{y <= t},
 *
 * mostly without sorting them. The numbers are counted and summed in bins. D at a
 * bin's begin is then known, and where it is larger than what the bin holds, its sign
 * cannot change inside, so that the bin's integral follows from its sums, exactly:
 *
 *   integral D = D0 (e1 - e0) + sum_x (e1 - x) - sum_y (e1 - y).
 *
 * Only the numbers of the other bins are sorted. Pictures that differ have few of these.
 */
#include <math.h>
#include <string.h>

#include "metrics/swd.h"

typedef struct bin {
    double sum; /* of x minus sum of y, both from the lowest number */
    uint32_t x, y;
} bin;

/* ---- sorting, by 11 bits at a time ---- */

enum { DIGIT = 11, DIGITS = 1 << DIGIT, PASSES = 3 };

/* Order of floats as order of whole numbers: the sign bit flipped, all bits of negative ones. */
static inline uint32_t key_of(float v) {
    uint32_t bits;
    memcpy(&bits, &v, sizeof bits);
    return bits ^ ((uint32_t) - (int32_t)(bits >> 31) | 0x80000000u);
}

static inline void scatter(float *to, const float *from, size_t n, uint32_t *place, int shift) {
    for (size_t i = 0; i < n; i++) {
        to[place[key_of(from[i]) >> shift & (DIGITS - 1)]++] = from[i];
    }
}

static void sort(float *v, size_t n, float *scratch) {
    static const int shifts[PASSES] = {0, DIGIT, 2 * DIGIT};
    uint32_t place[PASSES][DIGITS];
    if (n < 2) {
        return;
    }
    memset(place, 0, sizeof place);
    for (size_t i = 0; i < n; i++) {
        uint32_t key = key_of(v[i]);
        for (int p = 0; p < PASSES; p++) {
            place[p][key >> shifts[p] & (DIGITS - 1)]++;
        }
    }
    for (int p = 0; p < PASSES; p++) {
        uint32_t at = 0;
        for (int d = 0; d < DIGITS; d++) {
            uint32_t count = place[p][d];
            place[p][d] = at;
            at += count;
        }
    }
    scatter(scratch, v, n, place[0], shifts[0]);
    scatter(v, scratch, n, place[1], shifts[1]);
    scatter(scratch, v, n, place[2], shifts[2]);
    memcpy(v, scratch, n * sizeof *v);
}

/* ---- bins ---- */

typedef struct grid {
    float low, scale;
    int last; /* bin */
} grid;

static inline int bin_of(const grid *g, float v) {
    int b = (int)((v - g->low) * g->scale);
    return b < g->last ? b : g->last;
}

/* Sixteen minima and maxima side by side, which compilers keep in registers. */
static void limits(const float *v, size_t n, float *low, float *high) {
    enum { LANES = 16 };
    float l[LANES], h[LANES];
    size_t i = 0;
    for (int k = 0; k < LANES; k++) {
        l[k] = *low;
        h[k] = *high;
    }
    for (; n - i >= LANES; i += LANES) {
        for (int k = 0; k < LANES; k++) {
            l[k] = v[i + (size_t)k] < l[k] ? v[i + (size_t)k] : l[k];
            h[k] = v[i + (size_t)k] > h[k] ? v[i + (size_t)k] : h[k];
        }
    }
    for (; i < n; i++) {
        l[0] = v[i] < l[0] ? v[i] : l[0];
        h[0] = v[i] > h[0] ? v[i] : h[0];
    }
    for (int k = 0; k < LANES; k++) {
        *low = l[k] < *low ? l[k] : *low;
        *high = h[k] > *high ? h[k] : *high;
    }
}

/* Integral of |D| over a bin from e0 to e1 whose numbers are sorted. */
static double walk(double d, double e0, double e1, const float *x, size_t nx, const float *y, size_t ny, double low) {
    double area = 0, at = e0;
    size_t i = 0, j = 0;
    while (i < nx || j < ny) {
        bool is_x = j == ny || (i < nx && x[i] <= y[j]);
        double t = (double)(is_x ? x[i] : y[j]) - low;
        if (t > at) {
            area += fabs(d) * (t - at);
            at = t;
        }
        d += is_x ? 1 : -1;
        i += is_x;
        j += !is_x;
    }
    return area + (e1 > at ? fabs(d) * (e1 - at) : 0);
}

/* Keeps the numbers of the bins that are to be sorted. */
static size_t keep(float *v, size_t n, const grid *g, const unsigned char *wanted) {
    size_t kept = 0;
    for (size_t i = 0; i < n; i++) {
        float value = v[i];
        v[kept] = value;
        kept += wanted[bin_of(g, value)];
    }
    return kept;
}

double metrics_wasserstein(float *x, float *y, size_t n, float *scratch) {
    enum { MOST = 1 << 13 };
    bin bins[MOST];
    unsigned char wanted[MOST];
    float low = x[0], high = x[0];
    limits(x, n, &low, &high);
    limits(y, n, &low, &high);
    if (!(low < high)) {
        return 0;
    }
    int count = 64;
    while (count < MOST && (size_t)count < n / 16) {
        count *= 2;
    }
    grid g = {low, (float)count / (high - low), count - 1};
    if (!isfinite(g.scale)) { /* numbers that differ by less than what a float can divide by */
        return 0;
    }
    memset(bins, 0, (size_t)count * sizeof *bins);
    for (size_t i = 0; i < n; i++) {
        bin *bx = &bins[bin_of(&g, x[i])];
        bx->x++;
        bx->sum += (double)x[i] - (double)low;
        bin *by = &bins[bin_of(&g, y[i])];
        by->y++;
        by->sum -= (double)y[i] - (double)low;
    }
    const double width = 1 / (double)g.scale, end = (double)high - (double)low;
    double area = 0, d = 0;
    bool sorted = true;
    for (int b = 0; b < count; b++) {
        const double e0 = b * width, e1 = b == g.last ? end : (b + 1) * width, nx = bins[b].x, ny = bins[b].y;
        wanted[b] = !(d >= ny || d <= -nx);
        if (wanted[b]) {
            sorted = false;
        } else {
            area += fabs(d * (e1 - e0) + (nx - ny) * e1 - bins[b].sum);
        }
        d += nx - ny;
    }
    if (!sorted) {
        sort(x, keep(x, n, &g, wanted), scratch);
        sort(y, keep(y, n, &g, wanted), scratch);
        d = 0;
        for (int b = 0; b < count; b++) {
            if (wanted[b]) {
                area +=
                    walk(d, b * width, b == g.last ? end : (b + 1) * width, x, bins[b].x, y, bins[b].y, (double)low);
                x += bins[b].x;
                y += bins[b].y;
            }
            d += (double)bins[b].x - (double)bins[b].y;
        }
    }
    return area / (double)n;
}
