/* SPDX-License-Identifier: Apache-2.0 */
/*
 * background.c: what stands around a screen: a wall with smooth differences of
 * light and colour, and things with edges before it. It lies in the screen's
 * plane, three screens wide and high with the screen in its middle, and its mean
 * is 1.
 */
#include <math.h>

#include "sim/simulate.h"

enum { SIDE = 512, GRID = 17, THINGS = 24, BACKGROUND = 8 /* purpose of its random numbers */ };

typedef struct thing {
    double x, y, width, height, turn_x, turn_y;
    float color[3];
} thing;

static void color(float out[3], core_random *r, double low, double high) {
    const double light = low * exp(core_random_uniform(r) * log(high / low));
    for (int c = 0; c < 3; c++)
        out[c] = (float)(light * core_random_range(r, 0.6, 1.4));
}

/* The wall at (x, y) in cells of the grid: bicubic by smoothed steps, two scales over one another. */
static float wall(const float grid[GRID][GRID], double x, double y) {
    const int i = (int)fmin(x, GRID - 2), j = (int)fmin(y, GRID - 2);
    const float u = (float)(x - i), v = (float)(y - j), s = u * u * (3 - 2 * u), t = v * v * (3 - 2 * v);
    const float top = grid[j][i] + s * (grid[j][i + 1] - grid[j][i]);
    const float low = grid[j + 1][i] + s * (grid[j + 1][i + 1] - grid[j + 1][i]);
    return top + t * (low - top);
}

static void paint(float *rgb, const thing *t) {
    const double reach = 0.5 * hypot(t->width, t->height);
    const int left = (int)fmax((t->x - reach) * SIDE - 1, 0), right = (int)fmin((t->x + reach) * SIDE + 1, SIDE - 1);
    const int top = (int)fmax((t->y - reach) * SIDE - 1, 0), low = (int)fmin((t->y + reach) * SIDE + 1, SIDE - 1);
    for (int j = top; j <= low; j++)
        for (int i = left; i <= right; i++) {
            const double dx = (i + 0.5) / SIDE - t->x, dy = (j + 0.5) / SIDE - t->y;
            /* How far inside, in texels: edges run over one of them. */
            const double in = SIDE * fmin(t->width / 2 - fabs(dx * t->turn_x + dy * t->turn_y),
                                          t->height / 2 - fabs(dy * t->turn_x - dx * t->turn_y));
            const float cover = (float)fmin(fmax(in + 0.5, 0), 1);
            for (int c = 0; c < 3 && cover > 0; c++)
                rgb[3 * (j * SIDE + i) + c] += cover * (t->color[c] - rgb[3 * (j * SIDE + i) + c]);
        }
}

brace_status sim_background_create(sim_texture *out, const sim_scene *scene, brace_error *error) {
    brace_status status = sim_texture_begin(out, SIDE, SIDE, error);
    if (status != BRACE_OK)
        return status;
    core_random r = core_random_create(scene->seed, scene->sample, BACKGROUND, 0);
    float grid[GRID][GRID], tint[3];
    thing things[THINGS];
    for (int j = 0; j < GRID; j++)
        for (int i = 0; i < GRID; i++)
            grid[j][i] = (float)core_random_range(&r, 0.4, 1.6);
    color(tint, &r, 0.7, 1.4);
    for (int k = 0; k < THINGS; k++) {
        const double turn = 0.15 * core_random_normal(&r), size = exp(core_random_range(&r, log(0.05), log(0.4)));
        things[k] = (thing){.x = core_random_uniform(&r),
                            .y = core_random_uniform(&r),
                            .width = size * core_random_range(&r, 0.2, 1),
                            .height = size * core_random_range(&r, 0.2, 1),
                            .turn_x = cos(turn),
                            .turn_y = sin(turn)};
        color(things[k].color, &r, 0.1, 4);
    }
    float *rgb = out->level[0].rgb;
    for (int i = 0; i < 3 * SIDE * SIDE; i++)
        rgb[i] = tint[i % 3];
    for (int k = 0; k < THINGS; k++)
        paint(rgb, &things[k]);
    double sum = 0;
    for (int j = 0; j < SIDE; j++)
        for (int i = 0; i < SIDE; i++) {
            const double x = (i + 0.5) / SIDE * (GRID - 1), y = (j + 0.5) / SIDE * (GRID - 1);
            const float shade = 0.7f * wall(grid, x / 4, y / 4) + 0.3f * wall(grid, x, y);
            for (int c = 0; c < 3; c++)
                sum += rgb[3 * (j * SIDE + i) + c] *= shade;
        }
    const float scale = (float)(3.0 * SIDE * SIDE / sum);
    for (int i = 0; i < 3 * SIDE * SIDE; i++)
        rgb[i] *= scale;
    sim_texture_finish(out);
    return BRACE_OK;
}
