/* SPDX-License-Identifier: Apache-2.0 */
/*
 * lens.c: what the lens does to light before it meets the sensor, without ever
 * mixing rows: a row of the sensor is exposed at its own time, and all the light
 * that it receives, of whatever part of the screen, is of that time.
 *
 * Blur (point spread and defocus) is therefore no filter over the picture, which
 * would carry light from one row's exposure into another's. A pixel looks at a
 * wider part of the screen instead: its footprint grows by the blur's variance,
 * and a disc that is clearly seen is made up of several footprints. Veiling glare
 * is, for each row, the light that the whole screen gives while that row is
 * exposed.
 */
#include <math.h>
#include <string.h>

#include "sim/rows.h"

/* Discs of a smaller radius look like a Gaussian of the same deviation. */
static const double visible_disc = 2.5;

sim_blur sim_blur_of(const sim_scene *s) {
    const int grid = s->supersample, rays = grid * grid;
    sim_blur b = {.rays = grid, .taps = 1};
    const double g2 = b.rays * b.rays, r = s->defocus, disc = r * r / 4; /* a disc's variance along an axis */
    double variance = s->psf * s->psf, each = 0;
    if (r < visible_disc) {
        variance += disc;
    } else {
        /* Taps on a spiral of equal density (Vogel 1979), each as wide as half the way to the next one, so that
         * the whole has the variance of the disc. */
        const int taps = rays > 1 ? rays : r < 4 ? 8 : 16;
        const double radius = r / sqrt(1 + 3.141592653589793 / taps);
        each = disc - radius * radius / 4;
        for (int i = 0; i < taps; i++) {
            const double rho = radius * sqrt((i + 0.5) / taps), phi = 2.399963229728653 * i;
            double *at = rays > 1 ? b.ray[i] : b.tap[i]; /* several rays are the taps */
            at[0] = rho * cos(phi), at[1] = rho * sin(phi);
        }
        b.taps = rays > 1 ? 1 : taps;
    }
    /* Rays spread evenly over a square have the variance spread^2 (1 - 1/rays^2)/12, and each looks at a footprint of
     * spread/rays whose lookup (bilinear, of box means) has 1/4 of that squared. With one ray the pixel and its lookup
     * have 1/4, to which the blur is added; with more, as much less as they sample the pixel better. */
    const double square = 1 + 12 * variance / (1 + 2 / g2);
    for (int i = 0; i < rays; i++) {
        b.ray[i][0] += sqrt(square) * ((0.5 + i % grid) / grid - 0.5);
        b.ray[i][1] += sqrt(square) * ((0.5 + i / grid) / grid - 0.5);
    }
    b.extra = (square - 1) / g2 + 4 * each;
    const double ramp = 1 + 12 * (s->psf * s->psf + disc) - square * (1 - 1 / g2);
    b.ramp = sqrt(fmax(ramp, 1 / g2));
    return b;
}

/* ---- glare ---- */

static const double reach = 0.2; /* deviation of the glare, of the picture's longer side */

/* Weights of n places evenly spread over [0, length] for the point `at`, of sum 1. */
static void weights(float *out, int n, double length, double at, double deviation) {
    double w[GLARE_COLUMNS], sum = 0;
    for (int i = 0; i < n; i++) {
        const double d = ((i + 0.5) * length / n - at) / deviation;
        sum += w[i] = exp(-0.5 * d * d);
    }
    for (int i = 0; i < n; i++)
        out[i] = (float)(w[i] / sum);
}

static double glare_deviation(const sim_render_job *job, double *tall) {
    *tall = (double)job->out->height / job->out->width;
    return reach * fmax(1, *tall);
}

void sim_glare_prepare(sim_render_job *job, sim_row *row, double t) {
    enum { PART = 8, COLUMNS = PART * GLARE_COLUMNS, ROWS = PART * GLARE_ROWS };
    sim_glare *g = &job->glare;
    memset(g, 0, sizeof *g);
    g->share = job->scene->glare;
    if (!(g->share > 0))
        return;
    double tall, map[9];
    const double deviation = glare_deviation(job, &tall);
    for (int k = 0; k < GLARE_KNOTS; k++)
        weights(g->across[k], GLARE_COLUMNS, 1, (double)k / (GLARE_KNOTS - 1), deviation);
    /* The picture once more, in a few large pixels. */
    sim_light few = {COLUMNS, ROWS, {NULL, NULL, NULL}};
    sim_render_job look = *job;
    look.out = &few;
    look.blur = (sim_blur){.rays = 1, .ramp = 1, .taps = 1};
    sim_scene_map(map, job->scene, t, job->reference_middle);
    int rank[GLARE_BLOCKS];
    for (int b = 0; b < GLARE_BLOCKS; b++)
        rank[b] = PART * PART;
    for (int y = 0; y < ROWS; y++) {
        job->loops->look(&look, row, map, ((y + 0.5) / ROWS - 0.5) * tall);
        for (int x = 0; x < COLUMNS; x++) {
            const int b = y / PART * GLARE_COLUMNS + x / PART, i = y % PART * PART + x % PART;
            const float share = row->cover[x] / (PART * PART);
            g->cover[b] += share;
            for (int c = 0; c < 3; c++) {
                g->level[c][b] += share * row->level[c][x];
                g->around[c][b] += row->open ? row->around[c][x] / (PART * PART) : 0;
            }
            /* The block's subpixel lies elsewhere in each block: rows that are driven in turns are all met. */
            const int order = (i + 29 * b) % (PART * PART);
            if (row->cover[x] > 0.5f && order < rank[b])
                rank[b] = order, g->x[b] = row->x[x], g->y[b] = row->y[x];
        }
    }
    for (int b = 0; b < GLARE_BLOCKS; b++)
        for (int c = 0; c < 3 && g->cover[b] > 0; c++)
            g->level[c][b] = fminf(g->level[c][b] / g->cover[b], 1);
}

void sim_glare_row(const sim_render_job *job, sim_row *row, size_t y, double start) {
    const sim_glare *g = &job->glare;
    double starts[GLARE_BLOCKS], tall;
    const double deviation = glare_deviation(job, &tall);
    const float room = (float)sim_room(job, start, job->exposure), lamp = (float)job->scene->ambient * room;
    float down[GLARE_ROWS], column[3][GLARE_COLUMNS] = {{0}}, light[GLARE_BLOCKS];
    weights(down, GLARE_ROWS, tall, ((double)y + 0.5) / job->out->width, deviation);
    for (int b = 0; b < GLARE_BLOCKS; b++)
        starts[b] = start;
    for (int c = 0; c < 3; c++) {
        const float *given = g->level[c];
        if (!job->steady) {
            job->kernel(job->panel, GLARE_BLOCKS, g->x, g->y, g->level[c], c, starts, job->exposure, light);
            given = light;
        }
        for (int b = 0; b < GLARE_BLOCKS; b++)
            column[c][b % GLARE_COLUMNS] +=
                down[b / GLARE_COLUMNS] * (g->cover[b] * (given[b] + lamp) + g->around[c][b] * room);
    }
    for (int c = 0; c < 3; c++) {
        const float *m = job->matrix + 3 * c;
        for (int k = 0; k < GLARE_KNOTS; k++) {
            float sum = 0;
            for (int i = 0; i < GLARE_COLUMNS; i++)
                sum += g->across[k][i] * (m[0] * column[0][i] + m[1] * column[1][i] + m[2] * column[2][i]);
            row->knots[c][k] = (float)job->scale * sum;
        }
    }
}
