/* SPDX-License-Identifier: Apache-2.0 */
/*
 * models.h: the restoration networks as graphs. Internal.
 *
 * All of them are one family. TMRNet (Zhang et al., "Bracketing Image Restoration and Enhancement with High-Low
 * Frequency Decomposition"/BracketIRE) extracts features of each frame, brings them to the reference's pose by optical
 * flow and deformable convolution, and aggregates them one after another; BRACE adds MSCAM before the aggregation.
 * What else differs between the networks that ship is in models_shape; docs/model.md has the reasons.
 *
 * Names and shapes of TMRNet's and SPyNet's parameters are those of their published checkpoints, so that these load
 * unchanged.
 */
#ifndef MODELS_MODELS_H
#define MODELS_MODELS_H

#include <jansson.h>

#include "core/safetensors.h"
#include "nn/nn.h"
#include "sim/json_check.h"

typedef struct models_shape {
    int frames;      /* of a bracket; 2 to 9 */
    int channels;    /* of features */
    int unshuffle;   /* features have 1/unshuffle of the packed frames' resolution: 1, 2 or 4 */
    int extract;     /* residual blocks of feature extraction, */
    int global;      /* of the aggregation that all frames share, */
    int frame;       /* of the one that each has of its own, */
    int reconstruct; /* and of reconstruction */
    int offset;      /* convolutions before that of the deformable offsets */
    int groups;      /* of the deformable convolution; 0: frames are moved by the flow instead, before all else */
    bool spynet;     /* flow by SPyNet; false: flow is an input, measured by restore's alignment */
    bool balance;    /* features are made of white-balanced frames: what is white looks the same from every camera */
    bool guide;      /* the merged picture (restore/restore.c) is shown beside the frames, as the last of them */
    bool sigma;      /* so is how far off merging expects it to be; blends move away from it by steps of that size, too */
    bool gate;       /* with sigma: the guide with small steps and the frames' own blend are two answers, and a map says which */
    bool blend;      /* the result is the reference, times a gain, plus what is taken from other frames, plus a rest;
                        false: what the last convolution gives */
    bool mscam;      /* multi-scale spatial cross-attention modulator */
    bool prior;      /* which is told the banding prior */
    int strip;       /* which also looks along rows, in cells of so many feature pixels; 0: it does not */
} models_shape;

/* "brace", "brace-s", "tmrnet", "tmrnet-s"; false: none of them. */
bool models_shape_named(models_shape *out, const char *name);
/* The names, for messages: "brace, brace-s, tmrnet or tmrnet-s". */
extern const char models_names[];

/* Reads keys that are there over what *shape holds; wrong ones are remembered by the document. */
void models_shape_read(models_shape *shape, const json_at *object);
/* The same of a text; `name` is for messages. */
brace_status models_shape_parse(models_shape *shape, const char *text, const char *name, brace_error *error);
json_t *models_shape_json(const models_shape *shape); /* all keys; NULL: out of memory */
bool models_shape_equal(const models_shape *a, const models_shape *b);
/* What a weights file that brace wrote says of its network. `name` is what the user called it, or "", and becomes what
 * the file does; they must agree. `path` is for messages. */
enum { MODELS_NAME = 64 };
brace_status models_shape_of_file(models_shape *out, char name[MODELS_NAME], const core_safetensors *file,
                                  const char *path, brace_error *error);

/* How many pictures a network is shown: the frames of the bracket, and the guide. */
static inline int models_views(const models_shape *shape) {
    return shape->frames + (shape->guide ? 1 : 0);
}

/* What a network is shown: the reference first, then the others from short to long, then the guide. h and w are
 * multiples of `unshuffle`. Values that a network has no use for may be 0. Below, `frames` counts the guide, too. */
typedef struct models_inputs {
    nn_value frames;      /* {frames, h, w, 8}: R, G, G, B, each linear and under max(x, 0)^(1/2.2), at the reference's
                             exposure */
    nn_value flow;        /* {frames, h, w, 2}: where a pixel of the reference is found, (dx, dy); 0 for the reference and
                             the guide */
    nn_value white;       /* {frames, 1, 1, 1}: at which value of `frames` each clips; the guide at that of the shortest */
    nn_value descriptors; /* {frames, 1, 1, 8}: of the banding prior */
    nn_value rho;         /* {frames, 1, 1, 1} */
    nn_value balance;     /* {1, 1, 1, 8}: models_balance */
    nn_value sigma;       /* {1, h, w, 4}: the guide's expected error under that curve */
} models_inputs;

/* All of them, as inputs of the graph with these names, `views` frames each. */
models_inputs models_inputs_create(nn_graph *g, int views, int height, int width);

/* What `frames` are multiplied by to be white-balanced, from the gains of R, G and B; green stays as it is. Gains that are
 * none, or beyond 16, count as 1. */
void models_balance(float balance[8], const double gains[3]);

/* The picture of the reference without banding, packed RAW {1, h, w, 4}, linear. With `gate`, it is a cautious one: see
 * docs/model.md, "Caution". */
nn_value models_build(nn_graph *g, const models_shape *shape, const models_inputs *inputs);
/* As it is trained; with `gate`, *alone is what the frames say without the guide, which training shows the truth, too. 0:
 * there is none. */
nn_value models_build_trained(nn_graph *g, const models_shape *shape, const models_inputs *inputs, nn_value *alone);

/* ---- parts ---- */

/* Flow from each of `reference` to `other`, {n, h, w, 3} in [0, 1]: {n, h, w, 2}, f32 (spynet.c). Scope "spynet". */
nn_value models_spynet(nn_graph *g, nn_value reference, nn_value other);
/* Convolution, LeakyReLU, `blocks` residual blocks: the published "ResidualBlocksWithInputConv" (blocks.c). */
nn_value models_residual_blocks(nn_graph *g, const char *name, nn_value x, int channels, int blocks);
/* The features, modulated (mscam.c). Scope "mscam". */
nn_value models_mscam(nn_graph *g, const models_shape *shape, nn_value features, const models_inputs *inputs);

#endif
