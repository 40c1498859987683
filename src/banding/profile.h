/* SPDX-License-Identifier: Apache-2.0 */
/*
 * profile.h: the light of a display over the rows of a frame, and the line in
 * its spectrum that flicker makes.
 */
#ifndef BANDING_PROFILE_H
#define BANDING_PROFILE_H

#include "banding/banding.h"

/* A row is split into so many zones: light may differ along it (a screen that is
 * scanned itself and stands askew makes slanted stripes). */
enum { BANDING_ZONES = 8, BANDING_HARMONICS = 6, BANDING_PHASES = 48 };

/* Light of each zone of each packed row over its mean, less 1; or, told from one frame alone, its logarithm but
 * for a constant. NAN where nothing tells. */
typedef struct banding_profile {
    size_t rows, columns; /* packed */
    float *at;            /* rows*BANDING_ZONES */
    double weight[BANDING_ZONES]; /* how well each zone tells */
    double covered;               /* share that is not NAN */
    bool steps;                   /* told from one frame alone: logarithms whose errors add up from row to row */
} banding_profile;

brace_status banding_profile_create(banding_profile *out, size_t rows, size_t columns, brace_error *error);
void banding_profile_free(banding_profile *profile);

/* From one frame alone (profile.c). */
brace_status banding_profile_frame(banding_profile *out, const brace_frame *frame, core_pool *pool,
                                   brace_error *error);

/* Half the distance of the 10th and the 90th percentile of the light, zone by zone, after a median of five rows; and
 * what the median took away, the rows' noise. Steady light is even, whatever it shows. */
void banding_profile_evenness(const banding_profile *profile, double *uneven, double *noise);

/* What a profile's spectrum holds at each frequency. */
typedef struct banding_lines {
    size_t count;      /* frequencies: k is k/length cycles a packed row */
    size_t length;     /* of the padded transform */
    size_t rows;
    double *coherent;  /* squared amplitude of the wave that all zones share, at its best slant */
    double *noise;     /* the same of what surrounds it: what chance and content give */
    float *slant;      /* of that wave, cycles a zone */
} banding_lines;

brace_status banding_lines_create(banding_lines *out, const banding_profile *profile, brace_error *error);
void banding_lines_free(banding_lines *lines);

/* One wave. */
typedef struct banding_line {
    bool found;
    double frequency; /* cycles a packed row */
    double error;     /* of the frequency, one standard deviation */
    double slant;     /* cycles a packed column */
    double amplitude; /* of the profile's numbers */
    double ratio;     /* power over what surrounds it */
    double share;     /* of the profile's variance that the wave and its harmonics explain, 0 to 1 */
    double contrast;  /* (max - min)/(max + min) of the light over one period */
    double harmonic[BANDING_HARMONICS]; /* amplitude of light over its mean: 2 |c_n|/c_0, n = 1, 2, ... */
} banding_line;

/* The strongest line; `near` > 0 looks only within a bin of that frequency. */
void banding_line_find(banding_line *out, const banding_lines *lines, double near);
/* Refines frequency and slant on the profile itself and folds it over the period. */
void banding_line_measure(banding_line *line, const banding_profile *profile);

#endif
