/* SPDX-License-Identifier: Apache-2.0 */
/* consensus.h: whether the pixels of one frame agree on a wave of light over its rows. */
#ifndef BANDING_CONSENSUS_H
#define BANDING_CONSENSUS_H

#include "banding/banding.h"

/* The wave that the frame's blocks agree on best; all 0 if nothing tells. */
typedef struct banding_consensus {
    double frequency; /* cycles a packed row */
    double slant;     /* cycles a packed column */
    double periods;   /* in the frame */
    double amplitude; /* median of the blocks' waves, of the light about them; may be below 0 where they disagree */
    double quarter;   /* their lower quartile */
    double locked;    /* how well their phases agree: 0 not at all, 1 all */
    double even;      /* mean of their waves over their deviation */
    double odds;      /* logarithm of the odds that it is banding */
} banding_consensus;

/* Rows are averaged where there are more than about a thousand: waves beyond a quarter of a cycle a row that is left
 * are not looked for. */
brace_status banding_consensus_frame(banding_consensus *out, const brace_frame *frame, core_pool *pool,
                                     brace_error *error);

#endif
