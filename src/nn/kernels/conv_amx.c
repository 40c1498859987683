/* SPDX-License-Identifier: Apache-2.0 */
/*
 * conv_amx.c: bf16 blocks of 32 x 32 sums in four AMX tiles: two tiles of A times
 * two of B, so that each that is loaded is used twice. Compiled a second time for
 * the tests, where amx_emulated.h does in plain C what the tiles do, so that all
 * but the instructions themselves is checked on any machine.
 *
 * The system gives the 8 KiB of tile registers to a process that asks (once:
 * choose.c); each thread says how it divides them up (enter).
 */
#include <string.h>

#ifdef NN_AMX_EMULATED
#include "nn/kernels/amx_emulated.h"
#include "nn/kernels/kernels.h"
#define FINISH nn_finish_plain
#include "nn/kernels/pairs_plain.h"
#define NN_AMX nn_isa_amx_emulated
#define NN_AMX_NAME "amx-emulated"
#else
#include "nn/kernels/kernels.h"
#include "nn/kernels/vector_avx512.h"
#include "nn/kernels/conv_finish.h"
#include "nn/kernels/pairs_avx512.h"
#define FINISH finish
#define NN_AMX nn_isa_amx
#define NN_AMX_NAME "amx"
#endif

/* The operand of LDTILECFG (Intel 64 and IA-32 Architectures Software Developer's Manual, volume 2). */
typedef struct tile_config {
    uint8_t palette, start_row, reserved[14];
    uint16_t row_bytes[16];
    uint8_t rows[16];
} tile_config;

static void enter(void) {
    tile_config config __attribute__((aligned(64)));
    memset(&config, 0, sizeof config);
    config.palette = 1;
    for (int i = 0; i < 8; i++) {
        config.rows[i] = 16;
        config.row_bytes[i] = 64;
    }
    /* gcc 12 does not see that the next line reads config, and drops what fills it. */
    __asm__ volatile("" : : "r"(&config) : "memory");
    _tile_loadconfig(&config);
}

static void leave(void) {
    _tile_release();
}

enum { TILE = 16, PAIRS = 16 };

/* Tiles 0..3 are sums, 4 and 5 rows of A, 6 and 7 columns of B. */
#define LOAD_SUM(tile, i, j)                                                                                           \
    if (b->add) {                                                                                                      \
        _tile_loadd(tile, b->c + (i) * TILE * b->c_row + (j) * TILE, (size_t)b->c_row * sizeof(float));                \
    } else {                                                                                                           \
        _tile_zero(tile);                                                                                              \
    }
#define STORE_SUM(tile, i, j)                                                                                          \
    _tile_stored(tile, b->c + (i) * TILE * b->c_row + (j) * TILE, (size_t)b->c_row * sizeof(float))
#define FOR_STEPS                                                                                                      \
    for (int g = 0; g < b->groups; g++) {                                                                              \
        const uint16_t *x = (const uint16_t *)b->a + g * b->a_group, *w = (const uint16_t *)b->b + g * b->b_group;     \
        for (int t = 0; t < b->steps; t++, x += 2 * PAIRS, w += PAIRS * b->b_step)
#define END_STEPS }

static void block(const nn_block *b, int rows, int cols) {
    const size_t a_row = (size_t)b->a_row * 2, b_row = (size_t)b->b_step * 2;
    const ptrdiff_t a_next = TILE * b->a_row, b_next = 2 * TILE;
    if (rows > TILE && cols > TILE) {
        LOAD_SUM(0, 0, 0)
        LOAD_SUM(1, 0, 1)
        LOAD_SUM(2, 1, 0)
        LOAD_SUM(3, 1, 1)
        FOR_STEPS {
            _tile_loadd(6, w, b_row);
            _tile_loadd(4, x, a_row);
            _tile_dpbf16ps(0, 4, 6);
            _tile_loadd(7, w + b_next, b_row);
            _tile_dpbf16ps(1, 4, 7);
            _tile_loadd(5, x + a_next, a_row);
            _tile_dpbf16ps(2, 5, 6);
            _tile_dpbf16ps(3, 5, 7);
        }
        END_STEPS
        STORE_SUM(0, 0, 0);
        STORE_SUM(1, 0, 1);
        STORE_SUM(2, 1, 0);
        STORE_SUM(3, 1, 1);
    } else if (rows > TILE) {
        LOAD_SUM(0, 0, 0)
        LOAD_SUM(2, 1, 0)
        FOR_STEPS {
            _tile_loadd(6, w, b_row);
            _tile_loadd(4, x, a_row);
            _tile_dpbf16ps(0, 4, 6);
            _tile_loadd(5, x + a_next, a_row);
            _tile_dpbf16ps(2, 5, 6);
        }
        END_STEPS
        STORE_SUM(0, 0, 0);
        STORE_SUM(2, 1, 0);
    } else if (cols > TILE) {
        LOAD_SUM(0, 0, 0)
        LOAD_SUM(1, 0, 1)
        FOR_STEPS {
            _tile_loadd(6, w, b_row);
            _tile_loadd(4, x, a_row);
            _tile_dpbf16ps(0, 4, 6);
            _tile_loadd(7, w + b_next, b_row);
            _tile_dpbf16ps(1, 4, 7);
        }
        END_STEPS
        STORE_SUM(0, 0, 0);
        STORE_SUM(1, 0, 1);
    } else {
        LOAD_SUM(0, 0, 0)
        FOR_STEPS {
            _tile_loadd(6, w, b_row);
            _tile_loadd(4, x, a_row);
            _tile_dpbf16ps(0, 4, 6);
        }
        END_STEPS
        STORE_SUM(0, 0, 0);
    }
}

static double peak(long rounds) {
    enter();
    _tile_zero(0);
    _tile_zero(1);
    _tile_zero(2);
    _tile_zero(3);
    _tile_zero(4);
    _tile_zero(5);
    _tile_zero(6);
    _tile_zero(7);
    for (long r = 0; r < rounds; r++) {
        _tile_dpbf16ps(0, 4, 6);
        _tile_dpbf16ps(1, 4, 7);
        _tile_dpbf16ps(2, 5, 6);
        _tile_dpbf16ps(3, 5, 7);
    }
    leave();
    return 2.0 * 4 * TILE * TILE * 2 * PAIRS * (double)rounds;
}

const nn_isa NN_AMX = {.name = NN_AMX_NAME,
                       .in = NN_BF16,
                       .rows = 2 * TILE,
                       .cols = 2 * TILE,
                       .lanes = TILE,
                       .step = 2 * PAIRS,
                       .row_multiple = TILE,
                       .block = block,
                       .finish = FINISH,
                       .enter = enter,
                       .leave = leave,
                       .peak = peak,
                       .interleave = interleave,
                       .transpose = transpose};
