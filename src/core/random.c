/* SPDX-License-Identifier: Apache-2.0 */
/*
 * random.c: counter-based random numbers: the n-th number of a stream is a pure
 * function of the stream's name, so results are the same for any number of threads.
 *
 * Philox4x32-10: J. K. Salmon, M. A. Moraes, R. O. Dror, D. E. Shaw, "Parallel
 * random numbers: as easy as 1, 2, 3", SC 2011, section 4.3 and table 2.
 */
#include <math.h>

#include "core/core.h"

void core_philox(const uint32_t counter[4], const uint32_t key[2], uint32_t out[4]) {
    const uint64_t m0 = 0xD2511F53u, m1 = 0xCD9E8D57u;
    const uint32_t w0 = 0x9E3779B9u, w1 = 0xBB67AE85u; /* golden ratio; sqrt(3) - 1 */
    uint32_t c0 = counter[0], c1 = counter[1], c2 = counter[2], c3 = counter[3];
    uint32_t k0 = key[0], k1 = key[1];
    for (int round = 0; round < 10; round++) {
        uint64_t p0 = m0 * c0, p1 = m1 * c2;
        uint32_t n0 = (uint32_t)(p1 >> 32) ^ c1 ^ k0;
        uint32_t n2 = (uint32_t)(p0 >> 32) ^ c3 ^ k1;
        c1 = (uint32_t)p1;
        c3 = (uint32_t)p0;
        c0 = n0;
        c2 = n2;
        k0 += w0;
        k1 += w1;
    }
    out[0] = c0;
    out[1] = c1;
    out[2] = c2;
    out[3] = c3;
}

core_random core_random_create(uint64_t seed, uint32_t a, uint32_t b, uint32_t c) {
    core_random r = {
        .key = {(uint32_t)seed, (uint32_t)(seed >> 32)},
        .counter = {0, a, b, c},
        .used = 4,
    };
    return r;
}

uint32_t core_random_u32(core_random *r) {
    if (r->used >= 4) {
        core_philox(r->counter, r->key, r->buffer);
        r->counter[0]++; /* a stream repeats after 2^34 numbers */
        r->used = 0;
    }
    return r->buffer[r->used++];
}

double core_random_uniform(core_random *r) {
    uint64_t high = core_random_u32(r) >> 5, low = core_random_u32(r) >> 6;
    return (double)(high << 26 | low) * 0x1p-53;
}

double core_random_range(core_random *r, double low, double high) {
    double x = low + (high - low) * core_random_uniform(r);
    return x < high ? x : low; /* the sum may have been rounded up to `high` */
}

/* D. Lemire, "Fast random integer generation in an interval", ACM TOMACS 29, 2019. */
uint32_t core_random_below(core_random *r, uint32_t n) {
    if (n == 0) {
        return 0;
    }
    uint64_t product = (uint64_t)core_random_u32(r) * n;
    if ((uint32_t)product < n) {
        uint32_t threshold = (0u - n) % n;
        while ((uint32_t)product < threshold) {
            product = (uint64_t)core_random_u32(r) * n;
        }
    }
    return (uint32_t)(product >> 32);
}

/* G. E. P. Box, M. E. Muller, "A note on the generation of random normal deviates", 1958. */
double core_random_normal(core_random *r) {
    double u = 1.0 - core_random_uniform(r); /* (0, 1] */
    double v = core_random_uniform(r);
    return sqrt(-2.0 * log(u)) * cos(6.283185307179586 * v);
}
