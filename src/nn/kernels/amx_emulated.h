/* SPDX-License-Identifier: Apache-2.0 */
/*
 * amx_emulated.h: what AMX's tile instructions do, in plain C, for the tests on
 * machines without them. Palette 1: eight tiles of at most 16 rows of 64 bytes. As
 * in the processor, a thread that has not configured its tiles may not use them.
 */
#ifndef NN_AMX_EMULATED_H
#define NN_AMX_EMULATED_H

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "nn/node.h"

static _Thread_local struct {
    int configured, rows[8], row_bytes[8];
    unsigned char tile[8][16][64];
} amx;

static inline void amx_require(int condition) {
    if (!condition) {
        abort(); /* where the processor would raise #UD or #GP; this is only in tests */
    }
}

static inline void _tile_loadconfig(const void *p) {
    const unsigned char *config = p;
    amx_require(config[0] == 1 && config[1] == 0);
    memset(&amx, 0, sizeof amx);
    for (int i = 0; i < 8; i++) {
        uint16_t bytes;
        memcpy(&bytes, config + 16 + 2 * i, 2);
        amx.row_bytes[i] = bytes;
        amx.rows[i] = config[48 + i];
        amx_require(bytes <= 64 && config[48 + i] <= 16);
    }
    amx.configured = 1;
}

static inline void _tile_release(void) {
    amx.configured = 0;
}

static inline void _tile_zero(int t) {
    amx_require(amx.configured);
    memset(amx.tile[t], 0, sizeof amx.tile[t]);
}

static inline void _tile_loadd(int t, const void *base, size_t stride) {
    amx_require(amx.configured);
    memset(amx.tile[t], 0, sizeof amx.tile[t]);
    for (int i = 0; i < amx.rows[t]; i++) {
        memcpy(amx.tile[t][i], (const unsigned char *)base + (size_t)i * stride, (size_t)amx.row_bytes[t]);
    }
}

static inline void _tile_stored(int t, void *base, size_t stride) {
    amx_require(amx.configured);
    for (int i = 0; i < amx.rows[t]; i++) {
        memcpy((unsigned char *)base + (size_t)i * stride, amx.tile[t][i], (size_t)amx.row_bytes[t]);
    }
}

/* c[m][n] += sum_k a[m][2 k] b[k][2 n] + a[m][2 k + 1] b[k][2 n + 1] */
static inline void _tile_dpbf16ps(int c, int a, int b) {
    amx_require(amx.configured && amx.row_bytes[a] / 4 == amx.rows[b] && amx.row_bytes[c] == amx.row_bytes[b]);
    float even[16][16], odd[16][16]; /* of b */
    for (int k = 0; k < 16; k++) {
        uint16_t pair[32];
        memcpy(pair, amx.tile[b][k], sizeof pair);
        for (int n = 0; n < 16; n++) {
            even[k][n] = nn_from_bf16(pair[2 * n]);
            odd[k][n] = nn_from_bf16(pair[2 * n + 1]);
        }
    }
    for (int m = 0; m < amx.rows[c]; m++) {
        float sum[16];
        memcpy(sum, amx.tile[c][m], sizeof sum);
        for (int k = 0; k < amx.rows[b]; k++) {
            uint16_t pair[2];
            memcpy(pair, amx.tile[a][m] + 4 * k, sizeof pair);
            float x = nn_from_bf16(pair[0]), y = nn_from_bf16(pair[1]);
            for (int n = 0; n < 16; n++) {
                sum[n] += x * even[k][n] + y * odd[k][n];
            }
        }
        memcpy(amx.tile[c][m], sum, sizeof sum);
    }
}

#endif
