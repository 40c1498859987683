/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tags_rational.c: TIFF stores numbers as fractions of 32-bit integers. A frame
 * holds them as doubles; here they become fractions again without losing a bit.
 *
 * The numbers that round to one double form an interval. Of all fractions in it
 * the simplest, found by continued fractions (the Stern-Brocot tree), is
 * smallest in numerator and in denominator. So if the double came from a
 * fraction of 32-bit terms, that simplest one has 32-bit terms too and gives
 * the same double.
 */
#include <math.h>

#include "raw/raw.h"

__extension__ typedef unsigned __int128 u128;

/* The simplest fraction in [a/b, c/d], a/b < c/d; false once a term exceeds limit.
 * Takes partial quotients while both ends agree on them. */
static bool simplest(u128 a, u128 b, u128 c, u128 d, uint32_t limit, uint32_t *numerator, uint32_t *denominator) {
    u128 p0 = 0, q0 = 1, p1 = 1, q1 = 0; /* convergents */
    for (int i = 0; i < 128; i++) {
        u128 k = a / b;
        bool whole = a % b == 0;
        bool last = whole || k < c / d;
        if (last && !whole) {
            k++; /* the smallest whole number inside the interval */
        }
        if (k > limit) {
            return false;
        }
        u128 p = k * p1 + p0, q = k * q1 + q0;
        if (p > limit || q > limit) {
            return false;
        }
        if (last) {
            *numerator = (uint32_t)p;
            *denominator = (uint32_t)q;
            return q != 0;
        }
        p0 = p1;
        q0 = q1;
        p1 = p;
        q1 = q;
        /* x -> 1/(x - k) turns the interval's ends about. */
        u128 ra = a - k * b, rc = c - k * d;
        u128 na = d, nb = rc, nc = b, nd = ra;
        a = na;
        b = nb;
        c = nc;
        d = nd;
        if (b == 0 || d == 0) {
            return false;
        }
    }
    return false;
}

/* The last convergent of value whose terms fit. */
static void nearest(double value, uint32_t limit, uint32_t *numerator, uint32_t *denominator) {
    long double x = value;
    uint64_t p0 = 0, q0 = 1, p1 = 1, q1 = 0;
    for (int i = 0; i < 64; i++) {
        long double whole = floorl(x);
        if (whole > (long double)limit) {
            break;
        }
        uint64_t k = (uint64_t)whole;
        uint64_t p = k * p1 + p0, q = k * q1 + q0;
        if (p > limit || q > limit) {
            break;
        }
        p0 = p1;
        q0 = q1;
        p1 = p;
        q1 = q;
        long double rest = x - whole;
        if (rest <= 0.0L) {
            break;
        }
        x = 1.0L / rest;
    }
    if (q1 == 0) { /* larger than limit */
        p1 = limit;
        q1 = 1;
    } else if (p1 == 0 && value * (double)limit >= 0.5) { /* smaller than 1/limit */
        p1 = 1;
        q1 = limit;
    }
    *numerator = (uint32_t)p1;
    *denominator = (uint32_t)q1;
}

/* Simplest fraction between two neighbours' midpoints of value, which has `bits` of mantissa. */
static bool in_interval(double value, int bits, uint32_t limit, uint32_t *numerator, uint32_t *denominator) {
    int exponent;
    double mantissa = frexp(value, &exponent); /* value = mantissa * 2^exponent, mantissa in [1/2, 1) */
    uint64_t m = (uint64_t)ldexp(mantissa, bits);
    int shift = bits + 1 - exponent; /* value = 2m / 2^shift */
    /* A power of two has a nearer neighbour below; a symmetric interval of half
     * that width is enough, as exact powers of two are their own simplest fraction or too large. */
    u128 low = 2 * (u128)m - 1, high = 2 * (u128)m + 1;
    if (shift < 0 || shift > 100) {
        return false;
    }
    u128 scale = (u128)1 << shift;
    return simplest(low, scale, high, scale, limit, numerator, denominator);
}

bool raw_rational(double value, uint32_t limit, uint32_t *numerator, uint32_t *denominator) {
    *numerator = 0;
    *denominator = 1;
    if (value == 0.0) {
        return true;
    }
    if (!(value > 0.0) || !isfinite(value)) {
        return false;
    }
    if (value == floor(value) && value <= (double)limit) {
        *numerator = (uint32_t)value;
        return true;
    }
    if (in_interval(value, 53, limit, numerator, denominator) && (double)*numerator / (double)*denominator == value) {
        return true;
    }
    nearest(value, limit, numerator, denominator);
    return (double)*numerator / (double)*denominator == value;
}

double raw_from_float(float value) {
    double v = value;
    if (!isfinite(v) || v == 0.0) {
        return v;
    }
    uint32_t n, d;
    double size = fabs(v);
    if (size == floor(size) && size < 16777216.0) {
        return v;
    }
    double decimal = nearbyint(size * 1e4) / 1e4; /* what tables of colour matrices hold */
    if ((float)decimal == fabsf(value)) {
        return v < 0.0 ? -decimal : decimal;
    }
    if (!in_interval(size, 24, INT32_MAX, &n, &d) || (float)((double)n / (double)d) != fabsf(value)) {
        return raw_representable(v);
    }
    double r = (double)n / (double)d;
    return v < 0.0 ? -r : r;
}

double raw_representable(double value) {
    uint32_t n, d;
    if (!isfinite(value)) {
        return value;
    }
    raw_rational(fabs(value), INT32_MAX, &n, &d);
    double r = (double)n / (double)d;
    return value < 0.0 ? -r : r;
}
