/* SPDX-License-Identifier: Apache-2.0 */
/* blocks_14.h: conv_vector.h's block for each number of rows up to 14. */
BLOCKS(1)
BLOCKS(2)
BLOCKS(3)
BLOCKS(4)
BLOCKS(5)
BLOCKS(6)
BLOCKS(7)
BLOCKS(8)
BLOCKS(9)
BLOCKS(10)
BLOCKS(11)
BLOCKS(12)
BLOCKS(13)
BLOCKS(14)

static void block(const nn_block *b, int rows, int cols) {
    static void (*const blocks[ROWS][2])(const nn_block *) = {
        BLOCK_ENTRY(1) BLOCK_ENTRY(2) BLOCK_ENTRY(3) BLOCK_ENTRY(4) BLOCK_ENTRY(5) BLOCK_ENTRY(6) BLOCK_ENTRY(7)
        BLOCK_ENTRY(8) BLOCK_ENTRY(9) BLOCK_ENTRY(10) BLOCK_ENTRY(11) BLOCK_ENTRY(12) BLOCK_ENTRY(13) BLOCK_ENTRY(14)};
    blocks[rows - 1][cols > LANES](b);
}
