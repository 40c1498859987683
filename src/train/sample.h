/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sample.h: what a network is shown: a crop of a bracket as numbers, and the truth. Internal.
 *
 * Where crops come from is a source (source.h): shards of a packed set, or the simulator. A feed (feed.h) prepares
 * them in the background.
 */
#ifndef TRAIN_SAMPLE_H
#define TRAIN_SAMPLE_H

#include "brace/bracket.h"
#include "core/core.h"
#include "restore/internal.h"

/* One frame's mosaic where it lies, and what its numbers mean. */
typedef struct train_view {
    const uint16_t *data; /* width*height, borrowed */
    brace_cfa cfa;
    float black[4], white;
    float gain; /* to the reference's exposure */
} train_view;

/* A bracket with its truth, all of one size; shortest exposure first. */
typedef struct train_bracket {
    uint32_t width, height;
    int count, reference;
    train_view frame[BRACE_BRACKET_MAX], truth;
    brace_frame seen[BRACE_BRACKET_MAX];       /* the frames; pixels borrowed, no path and no tags */
    restore_motion motion[BRACE_BRACKET_MAX];  /* filled by train_bracket_align */
    bool aligned;
    const uint16_t *guide; /* width*height: the merged picture as train_guide_code; NULL: none. Borrowed, */
    const uint8_t *sigma;  /* as are the errors that it may have, as train_sigma_code: with a guide, and else NULL */
    double exposure[BRACE_BRACKET_MAX]; /* time times ISO, as recorded */
    double neutral[3], color_matrix[2][9];
    uint16_t illuminant[2];
} train_bracket;

/* Takes what a frame says; `index` -1: it is the truth. train_bracket_finish checks the whole and sets the gains. */
void train_bracket_set(train_bracket *bracket, int index, const brace_frame *frame);
brace_status train_bracket_finish(train_bracket *bracket, brace_error *error);
/* Finds the motions, as a restoration would; by one thread. Samples of an unaligned bracket have no flow. */
brace_status train_bracket_align(train_bracket *bracket, const volatile int *cancel, brace_error *error);

/* Merges a bracket that is aligned into `guide` and `sigma`, width*height each; by one thread. */
brace_status train_bracket_merge(const train_bracket *bracket, uint16_t *guide, uint8_t *sigma,
                                 const volatile int *cancel, brace_error *error);
/* Of light up to 16 times the reference's white, under the curve 1/2.2: fine enough where it is dark. */
uint16_t train_guide_code(float light);
float train_guide_light(uint16_t code);
/* Of errors under that curve, in steps of three percent. */
uint8_t train_sigma_code(float sigma);
float train_sigma_value(uint8_t code);

/* Where a crop lies and how it is turned: pixel (x, y) of its mosaic is pixel (x0 ± x, y0 ± y) of the frame's, x and y
 * exchanged first with `transpose`. (x0, y0) is a red pixel: so the crop is RGGB, whatever the frame is, and mirrored
 * or not: a mirrored RGGB mosaic begins one column later. */
typedef struct train_window {
    uint32_t x0, y0;
    bool flip_x, flip_y, transpose;
} train_window;

/* Every position and turn that is allowed alike. `side` in packed pixels: frames have 2*side + 2 and
 * more a side. */
train_window train_window_draw(core_random *random, const train_bracket *bracket, int side, bool mirrored,
                               bool transposed);

/* R, G, G, B of side*side blocks, (sample - black)/(white - black)*gain: neither clipped below nor above. */
void train_crop(float *out, const train_view *view, uint32_t width, const train_window *window, int side);

enum { TRAIN_VIEWS_MAX = BRACE_BRACKET_MAX + 1 };

/* The same of a bracket's merged picture, and of its errors. */
void train_crop_guide(float *light, float *sigma, const train_bracket *bracket, const train_window *window, int side);

typedef struct train_sample {
    int frames, side; /* frames: with the guide, if there is one */
    uint64_t index; /* of the sample: sources give the same for the same index */
    float *input;   /* [frames][side][side][8]: linear R, its gamma, linear G, ...; the reference first, then the
                     * others from short to long, then the guide; all at the reference's exposure. gamma: max(x, 0)^(1/2.2) */
    float *flow;    /* [frames][side][side][2]: where a pixel of the reference is found, (dx, dy) in packed pixels */
    float *truth;   /* [side][side][4] */
    float *sigma;   /* [side][side][4]: the guide's expected error; 0 without one */
    float white[TRAIN_VIEWS_MAX]; /* at which value of the linear input each frame clips */
    float descriptor[TRAIN_VIEWS_MAX][8]; /* of the banding prior of each frame's crop, in the input's order */
    float rho[TRAIN_VIEWS_MAX];
    float gains[3], matrix[9]; /* for train_isp (loss.h) */
    double direction;          /* of the wave vector in the shortest frame, for SFC */
    brace_frame *look;         /* RGGB, 2*side a side, no pixels: the reference's colour, to develop results with */
} train_sample;

brace_status train_sample_create(train_sample *out, int frames, int side, brace_error *error);
void train_sample_free(train_sample *sample);

/* The prior is measured on the crop, at the reference's exposure: it says what stripes these pixels have, and its phase
 * is that at their centre. */
brace_status train_sample_make(train_sample *out, const train_bracket *bracket, const train_window *window,
                               brace_error *error);

#endif
