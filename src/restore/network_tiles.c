/* SPDX-License-Identifier: Apache-2.0 */
/*
 * network_tiles.c: how a picture is divided into tiles, and how their results are joined.
 *
 * A convolution does not see past the edge of its tile, so results near the edge differ from what they would be in the
 * middle. The outermost pixels of an overlap are therefore not used; over its middle one tile's share falls from 1 to 0
 * along half a period of a cosine while its neighbour's rises. docs/restoring.md has what seams measure.
 */
#include <math.h>

#include "restore/network.h"

static int round_up(int n) {
    return (n + RESTORE_TILE_STEP - 1) / RESTORE_TILE_STEP * RESTORE_TILE_STEP;
}

/* How many tiles of at most `side` an axis takes, and how long each then is. */
static int divide(int length, int side, int *tile) {
    if (length <= side) {
        *tile = round_up(length);
        return 1;
    }
    const int overlap = RESTORE_TILE_OVERLAP + RESTORE_TILE_GRID; /* of which beginnings on the grid may take a part */
    const int step = side - overlap;
    const int count = (length - overlap + step - 1) / step;
    *tile = round_up((length + (count - 1) * overlap + count - 1) / count);
    return count;
}

restore_tiles restore_tiles_fit(int width, int height, int side) {
    restore_tiles t = {.width = width, .height = height};
    t.columns = divide(width, side, &t.across);
    t.rows = divide(height, side, &t.down);
    return t;
}

int restore_tile_begin(int length, int tile, int count, int k) {
    if (count == 1) {
        return 0;
    }
    const int begin = (int)(((int64_t)(length - tile) * k + count - 2) / (count - 1));
    return (begin + RESTORE_TILE_GRID - 1) / RESTORE_TILE_GRID * RESTORE_TILE_GRID;
}

/* How much of what lies between tiles k - 1 and k is the latter's at x: 0, rising to 1. */
static double risen(int length, int tile, int count, int k, int x) {
    if (k == 0) {
        return 1;
    }
    if (k == count) {
        return 0;
    }
    const int from = restore_tile_begin(length, tile, count, k);
    const double middle = 0.5 * (from + restore_tile_begin(length, tile, count, k - 1) + tile);
    const double along = (x + 0.5 - middle) / RESTORE_TILE_RAMP + 0.5;
    return along <= 0 ? 0 : along >= 1 ? 1 : 0.5 - 0.5 * cos(3.14159265358979323846 * along);
}

void restore_tile_share(float *share, int length, int tile, int count, int k) {
    const int begin = restore_tile_begin(length, tile, count, k);
    for (int i = 0; i < tile; i++) {
        share[i] = (float)(risen(length, tile, count, k, begin + i) - risen(length, tile, count, k + 1, begin + i));
    }
}
