/* SPDX-License-Identifier: Apache-2.0 */
/*
 * network.h: what the steps of restoring with a network hand to each other: its weights (network_model.c), where tiles
 * lie and how they are joined (network_tiles.c), what a tile is shown (network_input.c), the whole (network.c).
 *
 * Coordinates are packed pixels from the first block with a red pixel at its top left: networks learn from RGGB. Of a
 * frame whose corner is not red that block begins one row or column outside; what lies outside is mirrored about the
 * outermost pixel, which keeps the order of colours.
 */
#ifndef RESTORE_NETWORK_H
#define RESTORE_NETWORK_H

#include "models/models.h"
#include "restore/internal.h"

/* ---- weights and graph (network_model.c) ---- */

typedef struct restore_network {
    char *path;             /* of the weights */
    char name[MODELS_NAME]; /* of the model, as the weights say */
    models_shape shape;
    int side; /* of the crops that it learned from */
    nn_weights *weights;
    nn_graph *graph; /* of one tile; NULL until planned */
    models_inputs inputs;
    nn_value output;
    nn_type type;
} restore_network;

/* Reads the weights of a model. `model` NULL: the default one; if that is not installed, *out is NULL and all is well.
 * Every number in the file is finite. */
brace_status restore_network_open(restore_network **out, const char *model, brace_error *error);
void restore_network_close(restore_network *network); /* NULL is allowed */
/* Plans the network for tiles of this size. */
brace_status restore_network_plan(restore_network *network, int width, int height, brace_precision precision,
                                  const brace_job *job, brace_error *error);

/* ---- tiles (network_tiles.c) ---- */

/* All tiles are of one size; neighbours overlap. */
typedef struct restore_tiles {
    int width, height;   /* of the picture, packed pixels */
    int across, down;    /* of a tile: multiples of RESTORE_TILE_STEP */
    int columns, rows;
} restore_tiles;

enum {
    RESTORE_TILE_STEP = 8,     /* networks halve the resolution up to three times */
    RESTORE_TILE_GRID = 4,     /* they join up to 4 x 4 pixels, the same ones whatever the tile */
    RESTORE_TILE_LEAST = 64,   /* the smallest side of a tile, unless the picture is smaller, */
    RESTORE_TILE_MOST = 512,   /* and the largest: overlaps are an eighth of the work then */
    RESTORE_TILE_OVERLAP = 32, /* at least, from tile to tile, */
    RESTORE_TILE_RAMP = 16     /* over the middle of which one passes into the next */
};

/* Tiles no larger than `side` that cover a picture, as alike in size as can be. A picture that is smaller than a tile
 * has one, which is larger than the picture. */
restore_tiles restore_tiles_fit(int width, int height, int side);
/* Where tile k of `count` begins along an axis of `length` with tiles of `tile`: on the grid; the last one may end
 * beyond the picture. */
int restore_tile_begin(int length, int tile, int count, int k);
/* The tile's share of the result at each of its `tile` pixels: all tiles' shares add up to 1. */
void restore_tile_share(float *share, int length, int tile, int count, int k);

/* ---- what a tile is shown (network_input.c) ---- */

typedef struct restore_tile {
    const brace_bracket *bracket;
    const restore_motion *motion; /* of each frame */
    const float *guide, *sigma;   /* the merged mosaic and its errors; NULL: the network has no use for them */
    int x, y;                     /* of the picture, packed */
} restore_tile;

/* The first red pixel of a frame, or the one before it: 0 or -1. */
int restore_red_column(brace_cfa cfa);
int restore_red_row(brace_cfa cfa);
/* Bracket index of the i-th frame that a network is shown. */
size_t restore_network_frame(const brace_bracket *bracket, int i);

/* Fills the graph's inputs. */
brace_status restore_network_show(restore_network *network, const restore_tile *tile, core_pool *pool,
                                  brace_error *error);

/* ---- the whole (network.c) ---- */

/* Whether the network can restore this bracket; `why` gets the reason if not. */
bool restore_network_fits(const restore_network *network, const brace_bracket *bracket, char *why, size_t size);
brace_status restore_network_run(brace_restored *out, restore_network *network, const brace_bracket *bracket,
                                 const restore_motion *motion, const brace_restore_params *params, const brace_job *job, core_pool *pool,
                                 brace_error *error);

#endif
