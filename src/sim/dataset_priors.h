/* SPDX-License-Identifier: Apache-2.0 */
/*
 * dataset_priors.h: from what a set's samples are drawn: displays and cameras
 * with weights, and a distribution for every number of a scene that should not
 * keep the simulator's own. One JSON file, described in docs/dataset.md.
 */
#ifndef SIM_DATASET_PRIORS_H
#define SIM_DATASET_PRIORS_H

#include "sim/sim.h"

typedef struct dataset_priors dataset_priors;

/* NULL: data/priors/default.json. Every preset that is named must exist. */
brace_status dataset_priors_load(dataset_priors **out, const char *path, brace_error *error);
void dataset_priors_destroy(dataset_priors *priors); /* NULL is allowed */
json_t *dataset_priors_json(const dataset_priors *priors); /* new reference: all of it, for dataset.json */

/* What one sample is: pure in (priors, seed, sample). */
typedef struct dataset_draw {
    const char *display, *camera; /* presets; NULL camera: the default one */
    bool flicker_free;
} dataset_draw;
void dataset_priors_draw(dataset_draw *out, const dataset_priors *priors, uint64_t seed, uint32_t sample);

/* The display that was drawn, as the sample shows it: the preset's numbers times what the priors have for each. */
brace_status dataset_priors_display(sim_display **out, const dataset_priors *priors, const char *display,
                                    uint64_t seed, uint32_t sample, brace_error *error);

/* Sets the numbers that the priors speak of. */
void dataset_priors_scene(sim_scene *scene, const dataset_priors *priors, uint64_t seed, uint32_t sample);

#endif
