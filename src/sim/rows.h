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

/* ---- render.c ---- */

typedef struct sim_rows sim_rows;

typedef struct sim_row {
    int32_t *x, *y;
    float *level[3], *light[3], *cover, *sx, *sy;
    double *start;
    void *memory;
} sim_row;

typedef struct sim_render_job {
    sim_light *out;
    const sim_scene *scene;
    const sim_texture *texture;
    const sim_panel *panel;
    sim_light_fn *kernel;
    double start, exposure, row_time, reference_middle;
    double scale; /* of light to signal */
    int parts;    /* sub-exposures */
    bool steady;  /* the time mean, no flicker */
    float matrix[9];
    sim_row *rows; /* one a worker */
    const sim_rows *loops;
} sim_render_job;

/* ---- degrade.c ---- */

enum { BLOCK = 16, REACH = 64 };

typedef struct sim_lens_job {
    sim_light *light;
    float *scratch, *lines; /* a line for each worker */
    const float *kernel;
    int reach;
    float share, vignetting;
    float *means;      /* where one of them goes */
    const float *wide; /* the glare's three small planes */
    size_t columns, rows;
    int plane;
} sim_lens_job;

/* ---- sensor.c ---- */

enum { NOISE = 3, GAINS = 4 };          /* purposes of random streams */
enum { QUADS = 64, PIECE = 4 * QUADS }; /* a draw of the generator serves four pixels */

typedef struct sim_sensor_job {
    brace_frame *out;
    const sim_light *light;
    const sim_scene *scene;
    int frame;
    uint32_t key[2];
} sim_sensor_job;

/* ---- the loops ---- */

struct sim_rows {
    /* What the pixels of a row see at one pose: subpixel, level and how much of the pixel is screen. */
    void (*look)(const sim_render_job *job, const sim_row *row, const double map[9], double py);
    /* Adds the light of a sub-exposure to row y, or begins with it. What is around the screen is grey and steady, the
     * room's light lies over all. */
    void (*collect)(const sim_render_job *job, const sim_row *row, const float *const light[3], float around,
                    float lamp, float scale, size_t y, bool first);
    core_range_fn *blur_rows, *blur_columns, *average_blocks, *finish_rows; /* of a sim_lens_job */
    core_range_fn *expose_rows;                                             /* of a sim_sensor_job */
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
