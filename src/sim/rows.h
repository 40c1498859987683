/* SPDX-License-Identifier: Apache-2.0 */
/*
 * rows.h: the loops over pixels of the renderer, the lens and the sensor.
 *
 * They are plain C (rows_body.h), written so that compilers vectorise them, and
 * compiled once for every instruction set. Only operations that IEEE 754 defines
 * exactly, in the same order: all of them give the same bytes.
 */
#ifndef SIM_ROWS_H
#define SIM_ROWS_H

#include "sim/simulate.h"

typedef struct sim_rows sim_rows;

/* ---- lens.c ---- */

/* How far a pixel sees. Lengths in pixels of the picture. */
typedef struct sim_blur {
    double rays;       /* along each axis of a pixel */
    double ray[16][2]; /* where they go, from the pixel's middle */
    double extra;      /* four times the variance that each lookup adds to its footprint's own */
    double ramp;       /* width over which the screen's edge fades */
    int taps;          /* lookups of a ray that make up a disc; 1: one in its middle */
    double tap[16][2];
} sim_blur;

enum { GLARE_COLUMNS = 8, GLARE_ROWS = 6, GLARE_BLOCKS = GLARE_COLUMNS * GLARE_ROWS, GLARE_KNOTS = 17 };

/* The picture in blocks, for the light that the lens spreads widely. A block stands for its part of the screen: a
 * subpixel with the block's mean level, and the shares of its area that are screen and surroundings. */
typedef struct sim_glare {
    double share;
    int32_t x[GLARE_BLOCKS], y[GLARE_BLOCKS];
    float level[3][GLARE_BLOCKS], cover[GLARE_BLOCKS], around[3][GLARE_BLOCKS];
    float across[GLARE_KNOTS][GLARE_COLUMNS]; /* weights of the columns at points along a row */
} sim_glare;

/* ---- render.c ---- */

typedef struct sim_row {
    int32_t *x, *y;
    float *level[3], *light[3], *cover, *sx, *sy;
    int32_t *at;               /* where a lookup begins */
    float *right, *down, *sum; /* its fractions, and the levels of four channels */
    float *around[3];          /* what is seen beside the screen, weighted with how much it is; valid if `open` */
    double *start;
    float knots[3][GLARE_KNOTS]; /* glare along the row */
    bool open;                   /* a pixel sees more than the screen, and something is there */
    void *memory;
} sim_row;

typedef struct sim_render_job {
    sim_light *out;
    const sim_scene *scene;
    const sim_texture *texture, *background;
    const sim_panel *panel;
    sim_light_fn *kernel;
    double start, exposure, row_time, reference_middle;
    double scale; /* of light to signal */
    int parts;    /* sub-exposures */
    bool steady;  /* the time mean, no flicker */
    float matrix[9];
    sim_blur blur;
    sim_glare glare;
    sim_row *rows; /* one a worker */
    const sim_rows *loops;
} sim_render_job;

sim_blur sim_blur_of(const sim_scene *scene);
/* Looks at the whole picture at time t. */
void sim_glare_prepare(sim_render_job *job, sim_row *row, double t);
/* The glare along row y, exposed from `start` on, into row->knots. */
void sim_glare_row(const sim_render_job *job, sim_row *row, size_t y, double start);

/* Mean of room light over [a, a+t]: lamps on the mains go as 1 + cos. */
double sim_room(const sim_render_job *job, double a, double t);

/* ---- texture.c ---- */

enum { FIELD_COLUMNS = 9, FIELD_ROWS = 7 };

typedef struct sim_panel_job {
    sim_texture *texture;
    const sim_scene *scene;
    uint32_t key[2];
    float field[FIELD_ROWS * FIELD_COLUMNS][3];
} sim_panel_job;

/* ---- sensor.c ---- */

/* Purposes of random streams. */
enum { NOISE = 3, PIXEL_GAINS = 4, LINE_GAINS = 5, PANEL_GAINS = 6, PANEL_FIELD = 9 };
enum { QUADS = 64, PIECE = 4 * QUADS }; /* a draw of the generator serves four pixels */

typedef struct sim_sensor_job {
    brace_frame *out;
    const sim_light *light;
    const sim_scene *scene;
    int frame;
    uint32_t key[2];
    const float *columns, *lines; /* gains of the columns' and the rows' amplifiers, less 1; NULL: none */
} sim_sensor_job;

/* ---- the loops ---- */

struct sim_rows {
    /* What the pixels of a row see at one pose: subpixel, level and how much of the pixel is screen. */
    void (*look)(const sim_render_job *job, sim_row *row, const double map[9], double py);
    /* Adds the light of a sub-exposure to row y, or begins with it; `room` is the light of the room's lamps. */
    void (*collect)(const sim_render_job *job, const sim_row *row, const float *const light[3], float room, float scale,
                    size_t y, bool first);
    /* Glare and vignetting of row y. */
    void (*finish)(const sim_render_job *job, const sim_row *row, size_t y);
    core_range_fn *panel_rows;  /* of a sim_panel_job */
    core_range_fn *expose_rows; /* of a sim_sensor_job */
    /* n normal numbers of deviation 1, in pieces. */
    void (*normals)(float *out, size_t n, const uint32_t key[2], uint32_t y, uint32_t sample, uint32_t purpose);
};

extern const sim_rows sim_rows_plain, sim_rows_avx2, sim_rows_avx512;

static inline const sim_rows *sim_rows_for(core_cpu cpu) {
#if defined(__x86_64__)
    return cpu.avx512 ? &sim_rows_avx512 : cpu.avx2 ? &sim_rows_avx2 : &sim_rows_plain;
#else
    (void)cpu;
    return &sim_rows_plain;
#endif
}

#endif
