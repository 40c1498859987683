/* SPDX-License-Identifier: Apache-2.0 */
/* scene.h: brackets of a made-up screen with known light, motion and truth. */
#ifndef TEST_SCENE_H
#define TEST_SCENE_H

#include "brace/restore.h"

typedef struct scene {
    uint32_t width, height;
    brace_cfa cfa;
    double level;     /* brightness of the screen at the reference exposure */
    double pulses;    /* pulses of the light over the readout of the picture; 0: steady */
    double duty;      /* share of the time it is lit */
    double reference; /* reference exposure in pulses */
    double shift;     /* motion of frame i against the reference: (i - middle)*shift pixels in x and y */
    double smear;     /* the longer frames are moved up and down this many pixels, each, while they are exposed */
    bool flashes;     /* the shorter frames meet one line in eight of the light, eightfold, each block and colour in turn */
    bool paper;       /* bright page with rows of ink instead of texture all over */
    bool bezel;       /* a bright page above a dark bezel, the same all along the rows */
    double lamp;      /* light of a lamp that the display mirrors everywhere; it pulses, and the display is steady */
    double slip;      /* the longest frame is moved down by so many pixels more */
    bool no_noise;
    uint64_t seed;
} scene;

/* Light of the scene at (x, y) of colour c, at the reference exposure. */
double scene_light(const scene *s, double x, double y, int color);

/* A bracket of five frames, two stops apart. Fails the test if it can't be made. */
brace_bracket *scene_bracket(const scene *s);

/* Peak signal to noise ratio of a mosaic against the truth, both clipped to
 * [0, 1], on square roots (as displays show it), away from the borders. */
double scene_psnr(const scene *s, const float *mosaic);
#endif
