/* SPDX-License-Identifier: Apache-2.0 */
/*
 * loss.h: what training makes small, as graphs. Internal.
 *
 * Pictures here are packed RAW, {1, h, w, 4}: R, G, G, B of a 2x2 block of the mosaic, [0, 1] from black to white.
 * All losses are scalars, computed in f32 (f64 in a graph of that type). docs/training.md has the reasons.
 *
 * The total is L1 + wavelet * multi-level wavelet loss + color * MS-SWD (BRACE paper, "Stage One", "Stage Two").
 */
#ifndef TRAIN_LOSS_H
#define TRAIN_LOSS_H

#include "nn/nn.h"

/* ---- the domain of the differences (loss_encode.c) ---- */

typedef enum train_encoding {
    TRAIN_GAMMA, /* ((x + e)^(1/2.2) - e^(1/2.2))/((1 + e)^(1/2.2) - e^(1/2.2)), e = 1/1000 */
    TRAIN_MU_LAW /* ln(1 + mu x)/ln(1 + mu) */
} train_encoding;

/* 0 to 0, 1 to 1, for x < 0 the tangent at 0: noise below black, and what a network makes of it, keeps its gradient. */
nn_value train_encode(nn_graph *g, nn_value raw, train_encoding encoding, double mu);

/* ---- L1 and wavelets (loss_wavelet.c) ---- */

enum { TRAIN_WAVELET_LEVELS = 3, TRAIN_WAVELET_BANDS = 10 };
/* LH, HL, HH of the levels from fine to coarse, then the coarsest LL. They sum to 1. */
extern const double train_wavelet_weights[TRAIN_WAVELET_BANDS];

/* Sum over the sub-bands of weight * mean |band|/2^level, of a difference of encoded pictures whose sides are multiples
 * of 8. Haar's gain of 2 a level is divided out, so that a constant difference d costs |d| times LL's weight. */
nn_value train_loss_wavelet(nn_graph *g, nn_value difference, const double weights[TRAIN_WAVELET_BANDS]);

/* ---- a differentiable image signal processor (loss_isp.c) ---- */

/* Packed RAW to sRGB-encoded {1, h, w, 3}, plane by plane: R, mean G, B; times `gains` {1, 1, 1, 3}; clipped above 1,
 * where the first channel clips; `matrix` {1, 1, 3, 3} (rows: camera R, G, B; columns: sRGB); the sRGB curve, whose
 * straight part goes on below 0. */
nn_value train_isp(nn_graph *g, nn_value raw, nn_value gains, nn_value matrix);

/* ---- MS-SWD (loss_msswd.c): He et al., ECCV 2024; docs/metrics.md ---- */

typedef struct train_msswd {
    int scales;      /* at most; 1 to 8; fewer where pictures become smaller than 6 pixels */
    int projections; /* a scale, 1 to 512 */
} train_msswd;

/* Of two pictures {1, h, w, 3}, sRGB-encoded; the gradient is for `a`, or for both. The directions are frozen
 * parameters "msswd.N.weight" of the graph's scope, which train_msswd_draw fills: before the graph is built, or at any
 * time after. */
nn_value train_loss_msswd(nn_graph *g, nn_weights *weights, nn_value a, nn_value b, const train_msswd *params);
/* Draws all directions of the scope ("" or "loss.") anew: the same for the same seed, those of brace_ms_swd. */
brace_status train_msswd_draw(nn_weights *weights, const char *scope, const train_msswd *params, uint64_t seed,
                              brace_error *error);

/* ---- all together (loss.c) ---- */

typedef struct train_loss_params {
    train_encoding encoding;
    double mu;             /* of the mu-law */
    double wavelet, color; /* weights; 0: left out */
    bool no_l1;            /* L1 is left out, too, which an ablation asks for */
    /* r > 0: the sum L of all parts counts as r log(1 + L/r): errors far above r by their ratio, as PSNR does, so that
     * a bracket which is nearly right is worth as much care as one which is beyond rescue. 0: as it is. */
    double relative;
    double alone; /* weight of the same loss, without colour, of what a network's frames say without their guide; 0: left out */
    double bands[TRAIN_WAVELET_BANDS];
    train_msswd msswd;
} train_loss_params;

typedef struct train_loss {
    nn_value truth;                     /* input {1, h, w, 4} */
    nn_value gains, matrix;             /* inputs; 0 without colour */
    nn_value total, l1, wavelet, color, alone; /* 0: left out */
} train_loss;

/* `prediction` is packed RAW of any type, and so is `alone`; 0: there is none. The parts are outputs of the graph, too. */
train_loss train_loss_build(nn_graph *g, nn_weights *weights, nn_value prediction, nn_value alone,
                            const train_loss_params *params);

#endif
