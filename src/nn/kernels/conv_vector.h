/* SPDX-License-Identifier: Apache-2.0 */
/*
 * conv_vector.h: the block of sums in registers, for vector instructions. Included
 * by conv_avx2.c, conv_avx512.c and conv_avx512bf16.c, which say what a vector is:
 *
 *     vf, LANES                    floats
 *     ELEMENT                      what A and B are made of
 *     STEP                         elements of A in a step: 1, or a pair
 *     vf_zero() vf_load(p) vf_store(p, v)
 *     vb, vb_load(p) vb_spread(p)  a row of B; one step of A in all lanes
 *     vf_sum(c, a, b)              c + a b
 *     VECTOR_REGISTER              what inline assembly calls a register of them
 *     ROWS                         of a block; two vectors wide, all sums in registers
 *
 * Each step loads two vectors of B and uses each with every row of A: 2 ROWS
 * multiply-adds for ROWS + 2 loads, so the multipliers are what is waited for.
 */

#ifndef ALWAYS_INLINE
#define ALWAYS_INLINE static inline __attribute__((always_inline))
#endif

ALWAYS_INLINE void block_of(const nn_block *block, const int rows, const int vectors) {
    vf sum[ROWS][2];
#pragma GCC unroll 16
    for (int i = 0; i < rows; i++) {
#pragma GCC unroll 2
        for (int v = 0; v < vectors; v++) {
            sum[i][v] = block->add ? vf_load(block->c + i * block->c_row + v * LANES) : vf_zero();
        }
    }
    const ptrdiff_t row = block->a_row, a_step = STEP == 1 ? block->a_step : STEP, b_step = block->b_step;
    for (int g = 0; g < block->groups; g++) {
        const ELEMENT *a = (const ELEMENT *)block->a + g * block->a_group;
        const ELEMENT *b = (const ELEMENT *)block->b + g * block->b_group;
        for (int t = block->steps; t > 0; t--) {
            vb w[2];
#pragma GCC unroll 2
            for (int v = 0; v < vectors; v++) {
                w[v] = vb_load(b + v * LANES * STEP);
            }
#pragma GCC unroll 16
            for (int i = 0; i < rows; i++) {
                vb x = vb_spread(a + i * row);
#pragma GCC unroll 2
                for (int v = 0; v < vectors; v++) {
                    sum[i][v] = vf_sum(sum[i][v], x, w[v]);
                }
            }
            a += a_step;
            b += b_step;
        }
    }
#pragma GCC unroll 16
    for (int i = 0; i < rows; i++) {
#pragma GCC unroll 2
        for (int v = 0; v < vectors; v++) {
            vf_store(block->c + i * block->c_row + v * LANES, sum[i][v]);
        }
    }
}

/* As many sums as keep the multipliers busy in spite of their latency. */
static double peak(long rounds) {
    enum { SUMS = 12 };
    static const ELEMENT ones[LANES * STEP];
    vf sum[SUMS];
    vb x = vb_load(ones), w = vb_spread(ones);
#pragma GCC unroll 16
    for (int i = 0; i < SUMS; i++) {
        sum[i] = vf_zero();
        __asm__("" : "+" VECTOR_REGISTER(sum[i])); /* twelve different ones */
    }
    for (long r = 0; r < rounds; r++) {
        __asm__ volatile("" : "+" VECTOR_REGISTER(x), "+" VECTOR_REGISTER(w)); /* or it would be seen that all is zero */
#pragma GCC unroll 16
        for (int i = 0; i < SUMS; i++) {
            sum[i] = vf_sum(sum[i], x, w);
        }
    }
    float out[LANES];
#pragma GCC unroll 16
    for (int i = 1; i < SUMS; i++) {
        sum[0] = vf_add(sum[0], sum[i]);
    }
    vf_store(out, sum[0]);
    return 2.0 * SUMS * LANES * STEP * (double)rounds + 0 * (double)out[0]; /* the sums are needed */
}

#define BLOCKS(rows)                                                                                                   \
    static void block_##rows##_1(const nn_block *block) {                                                              \
        block_of(block, rows, 1);                                                                                      \
    }                                                                                                                  \
    static void block_##rows##_2(const nn_block *block) {                                                              \
        block_of(block, rows, 2);                                                                                      \
    }
#define BLOCK_ENTRY(rows) {block_##rows##_1, block_##rows##_2},
