/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sha256.c: FIPS 180-4, sections 4.1.2, 5.1.1 and 6.2. The constants are the
 * first 32 bits of the fractional parts of the cube and square roots of primes.
 */
#include "core/sha256.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

const uint32_t core_sha256_k[64] = {
    0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5, 0xd807aa98, 0x12835b01,
    0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174, 0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc,
    0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da, 0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147,
    0x06ca6351, 0x14292967, 0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
    0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070, 0x19a4c116, 0x1e376c08,
    0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3, 0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208,
    0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2};

static uint32_t turn(uint32_t x, int n) {
    return x >> n | x << (32 - n);
}

static inline void round_of(uint32_t a, uint32_t b, uint32_t c, uint32_t *d, uint32_t e, uint32_t f, uint32_t g,
                            uint32_t *h, uint32_t input) {
    uint32_t t = *h + (turn(e, 6) ^ turn(e, 11) ^ turn(e, 25)) + ((e & f) ^ (~e & g)) + input;
    *d += t;
    *h = t + (turn(a, 2) ^ turn(a, 13) ^ turn(a, 22)) + ((a & b) ^ (a & c) ^ (b & c));
}

static void add_block(uint32_t state[8], const unsigned char *p) {
    const uint32_t *k = core_sha256_k;
    uint32_t w[64], s[8];
    for (int i = 0; i < 16; i++) {
        w[i] = (uint32_t)p[4 * i] << 24 | (uint32_t)p[4 * i + 1] << 16 | (uint32_t)p[4 * i + 2] << 8 | p[4 * i + 3];
    }
    for (int i = 16; i < 64; i++) {
        uint32_t a = turn(w[i - 15], 7) ^ turn(w[i - 15], 18) ^ w[i - 15] >> 3;
        uint32_t b = turn(w[i - 2], 17) ^ turn(w[i - 2], 19) ^ w[i - 2] >> 10;
        w[i] = w[i - 16] + a + w[i - 7] + b;
    }
    memcpy(s, state, sizeof s);
    for (int i = 0; i < 64; i += 8) {
        /* The eight words change places in each round; eight rounds bring each back to its own. */
        round_of(s[0], s[1], s[2], &s[3], s[4], s[5], s[6], &s[7], k[i] + w[i]);
        round_of(s[7], s[0], s[1], &s[2], s[3], s[4], s[5], &s[6], k[i + 1] + w[i + 1]);
        round_of(s[6], s[7], s[0], &s[1], s[2], s[3], s[4], &s[5], k[i + 2] + w[i + 2]);
        round_of(s[5], s[6], s[7], &s[0], s[1], s[2], s[3], &s[4], k[i + 3] + w[i + 3]);
        round_of(s[4], s[5], s[6], &s[7], s[0], s[1], s[2], &s[3], k[i + 4] + w[i + 4]);
        round_of(s[3], s[4], s[5], &s[6], s[7], s[0], s[1], &s[2], k[i + 5] + w[i + 5]);
        round_of(s[2], s[3], s[4], &s[5], s[6], s[7], s[0], &s[1], k[i + 6] + w[i + 6]);
        round_of(s[1], s[2], s[3], &s[4], s[5], s[6], s[7], &s[0], k[i + 7] + w[i + 7]);
    }
    for (int i = 0; i < 8; i++) {
        state[i] += s[i];
    }
}

static void add_blocks(core_sha256 *hash, const unsigned char *p, size_t blocks) {
#if defined(__x86_64__)
    if (hash->ni) {
        core_sha256_blocks_ni(hash->state, p, blocks);
        return;
    }
#endif
    for (; blocks > 0; blocks--, p += 64) {
        add_block(hash->state, p);
    }
}

void core_sha256_begin(core_sha256 *hash) {
    static const uint32_t first[8] = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                      0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
    memcpy(hash->state, first, sizeof first);
    hash->length = 0;
    hash->ni = core_cpu_features().sha;
}

void core_sha256_add(core_sha256 *hash, const void *data, size_t size) {
    const unsigned char *p = data;
    size_t have = hash->length % 64;
    hash->length += size;
    if (have > 0) {
        size_t n = 64 - have < size ? 64 - have : size;
        memcpy(hash->block + have, p, n);
        p += n;
        size -= n;
        if (have + n < 64) {
            return;
        }
        add_blocks(hash, hash->block, 1);
    }
    add_blocks(hash, p, size / 64);
    p += size / 64 * 64;
    size %= 64;
    if (size > 0) {
        memcpy(hash->block, p, size);
    }
}

void core_sha256_end(core_sha256 *hash, char hex[65]) {
    uint64_t bits = hash->length * 8;
    unsigned char tail[72] = {0x80};
    size_t pad = (hash->length % 64 < 56 ? 56 : 120) - hash->length % 64;
    for (int i = 0; i < 8; i++) {
        tail[pad + (size_t)i] = (unsigned char)(bits >> (56 - 8 * i));
    }
    core_sha256_add(hash, tail, pad + 8);
    for (int i = 0; i < 8; i++) {
        snprintf(hex + 8 * i, 9, "%08x", hash->state[i]);
    }
}

brace_status core_sha256_file(char hex[65], const char *path, uint64_t *size, brace_error *error) {
    unsigned char *buffer = core_alloc(1 << 18, 1);
    if (buffer == NULL) {
        return core_fail_memory(error, 1 << 18, path);
    }
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    core_sha256 hash;
    core_sha256_begin(&hash);
    ssize_t n = -1;
    if (fd >= 0) {
        while ((n = read(fd, buffer, 1 << 18)) > 0 || (n < 0 && errno == EINTR)) {
            core_sha256_add(&hash, buffer, n > 0 ? (size_t)n : 0);
        }
    }
    int code = errno;
    core_free(buffer);
    if (fd >= 0) {
        close(fd);
    }
    if (n < 0) {
        return core_fail(error, BRACE_ERROR_IO, "%s: cannot read: %s", path, strerror(code));
    }
    if (size != NULL) {
        *size = hash.length;
    }
    core_sha256_end(&hash, hex);
    return BRACE_OK;
}
