/* SPDX-License-Identifier: Apache-2.0 */
/* frequency.h: from stripes in pixels to light in hertz. */
#ifndef BANDING_FREQUENCY_H
#define BANDING_FREQUENCY_H

#include "banding/profile.h"

/* One frame's fields from its line (profile lines are in packed pixels). */
void banding_frame_fill(brace_banding_frame *out, const banding_line *line, const banding_profile *profile);

/* How far to believe that a frame bands, from its other fields; 0 to 1. */
double banding_confidence(const brace_banding_frame *frame);

/* That the bracket's frequency is right; `best` is the frame it rests on. */
double banding_frequency_confidence(const brace_banding *b, const brace_banding_frame *best, uint32_t height);

/* Fills everything of *out that follows from its frames, its frequency and its readout: Hz, aliases, source, shutters.
 * `height`: rows of the frame; `base`: periods after which the light repeats (1: each). */
void banding_frequency(brace_banding *out, uint32_t height, int base);

#endif
