/* SPDX-License-Identifier: Apache-2.0 */
/*
 * align.c: motion between two frames of different exposure whose light differs
 * from row to row.
 *
 * What flicker does to a picture is a gain that hardly changes along a row
 * (the sensor reads it at one time). So we compare the horizontal gradient of
 * log light,
 *     f = (dI/dx) / (I + noise),
 * in which any such gain cancels, where neither frame clips. Vertical motion
 * shows in it as well, since the horizontal gradient changes from row to row.
 *
 * On a pyramid, coarse to fine: an exhaustive search for the shift at the top,
 * then Gauss-Newton (Lucas-Kanade) for an affine motion with robust weights,
 * then for the displacement of each tile. Priors keep what the pixels cannot
 * tell where a hand-held camera would have it: near zero.
 */
#include <math.h>
#include <string.h>

#include "restore/internal.h"

enum { LEVELS = 7, BASE_SIDE = 640, TOP_SIDE = 28 };

/* Three planes (R, G, B, 0) of features, and 1 where they may be used. */
typedef struct align_level {
    size_t width, height;
    v4 *feature, *valid;
} align_level;

struct restore_pyramid {
    int base; /* level 0 here is the packed picture halved this often */
    int count;
    align_level level[LEVELS];
};

/* ---- the pyramid ---- */

typedef struct align_build {
    const restore_picture *picture; /* first level */
    const brace_frame *frame;
    size_t width, height;
    const v4 *in, *in_valid;
    v4 *out, *out_valid;
    size_t in_width;
    v4 noise_s, noise_o;
} align_build;

static void color_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const align_build *b = arg;
    int red = -1, blue = -1, green[2] = {0, 0}, greens = 0;
    for (uint32_t c = 0; c < 4; c++) {
        int color = brace_cfa_color(b->frame->cfa, c & 1, c >> 1);
        if (color == 0)
            red = (int)c;
        else if (color == 2)
            blue = (int)c;
        else
            green[greens++ & 1] = (int)c;
    }
    for (size_t i = begin * b->width; i < end * b->width; i++) {
        v4 p = b->picture->at[i];
        float g = p[green[0]] > p[green[1]] ? p[green[0]] : p[green[1]];
        b->out[i] = (v4){p[red], 0.5f * (p[green[0]] + p[green[1]]), p[blue], 0};
        b->out_valid[i] = (v4){p[red] < 0.96f, g < 0.96f, p[blue] < 0.96f, 0};
    }
}

static void halve_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const align_build *b = arg;
    for (size_t y = begin; y < end; y++)
        for (size_t x = 0; x < b->width; x++) {
            size_t i = 2 * y * b->in_width + 2 * x, j = i + b->in_width;
            b->out[y * b->width + x] = (b->in[i] + b->in[i + 1] + b->in[j] + b->in[j + 1]) * v4_set(0.25f);
            b->out_valid[y * b->width + x] = b->in_valid[i] * b->in_valid[i + 1] * b->in_valid[j] * b->in_valid[j + 1];
        }
}

/* 1 4 6 4 1 in both directions; the picture goes on beyond its borders as its last row and column. */
static void smooth_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const align_build *b = arg;
    const size_t width = b->width, height = b->height;
    v4 column[BASE_SIDE + 4];
    for (size_t y = begin; y < end; y++) {
        const v4 *row[5];
        for (size_t j = 0; j < 5; j++)
            row[j] = b->in + (y + j < 2 ? 0 : y + j - 2 >= height ? height - 1 : y + j - 2) * width;
        for (size_t x = 0; x < width; x++)
            column[x + 2] = (row[0][x] + row[4][x]) * v4_set(0.0625f) + (row[1][x] + row[3][x]) * v4_set(0.25f) +
                            row[2][x] * v4_set(0.375f);
        column[0] = column[1] = column[2];
        column[width + 2] = column[width + 3] = column[width + 1];
        for (size_t x = 0; x < width; x++)
            b->out[y * width + x] = (column[x] + column[x + 4]) * v4_set(0.0625f) +
                                    (column[x + 1] + column[x + 3]) * v4_set(0.25f) + column[x + 2] * v4_set(0.375f);
    }
}

/* f = (dI/dx)/(I + noise), and 1 where nothing within 3 pixels clips. */
static void feature_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const align_build *b = arg;
    const size_t width = b->width, height = b->height;
    v4 column[BASE_SIDE + 6];
    for (size_t y = begin; y < end; y++) {
        const size_t first = y > 2 ? y - 3 : 0, last = y + 3 < height ? y + 3 : height - 1;
        for (size_t x = 0; x < width; x++)
            column[x + 3] = b->in_valid[first * width + x];
        for (size_t j = first + 1; j <= last; j++)
            for (size_t x = 0; x < width; x++)
                column[x + 3] = v4_min(column[x + 3], b->in_valid[j * width + x]);
        for (size_t x = 0; x < 3; x++)
            column[x] = column[width + 3 + x] = v4_set(1);
        for (size_t x = 0; x < width; x++) {
            size_t i = y * width + x, left = x ? i - 1 : i, right = x + 1 < width ? i + 1 : i;
            v4 light = v4_max(b->in[i], v4_set(0)), f = (b->in[right] - b->in[left]) * v4_set(0.5f);
            v4 noise = b->noise_s * light + b->noise_o, valid = column[x];
            for (size_t k = 1; k < 7; k++)
                valid = v4_min(valid, column[x + k]);
            for (int c = 0; c < 3; c++)
                f[c] /= light[c] + 6 * sqrtf(noise[c]) + 0.0005f;
            b->out[i] = v4_min(v4_max(f, v4_set(-0.4f)), v4_set(0.4f)) * valid;
            b->out_valid[i] = valid;
        }
    }
}

void restore_pyramid_destroy(restore_pyramid *pyramid) {
    if (!pyramid)
        return;
    for (int i = 0; i < LEVELS; i++) {
        core_free(pyramid->level[i].feature);
        core_free(pyramid->level[i].valid);
    }
    core_free(pyramid);
}

brace_status restore_pyramid_create(restore_pyramid **out, const restore_picture *picture, const brace_frame *frame,
                                    core_pool *pool, brace_error *error) {
    size_t width = picture->width, height = picture->height, bytes = width * height * sizeof(v4);
    restore_pyramid *p = core_calloc(1, sizeof *p);
    v4 *light = core_alloc(width * height, sizeof(v4)), *valid = core_alloc(width * height, sizeof(v4));
    v4 *smooth = NULL, *next = NULL, *next_valid = NULL;
    if (!p || !light || !valid)
        goto memory;

    align_build b = {
        .picture = picture, .frame = frame, .width = width, .height = height, .out = light, .out_valid = valid};
    core_parallel(pool, height, 16, color_rows, &b);
    for (int i = 0; i < 3; i++) { /* the binomial averages noise over about 13 pixels, green is already two */
        b.noise_s[i] = (float)(fmin(fmax(frame->noise[i][0], 0), 1) / (i == 1 ? 26 : 13));
        b.noise_o[i] = (float)(fmin(fmax(frame->noise[i][1], 0), 1) / (i == 1 ? 26 : 13));
    }
    for (;;) {
        if (width <= BASE_SIDE && height <= BASE_SIDE) {
            align_level *level = &p->level[p->count];
            *level = (align_level){width, height, core_alloc(width * height, sizeof(v4)),
                                   core_alloc(width * height, sizeof(v4))};
            smooth = core_alloc(width * height, sizeof(v4));
            if (!level->feature || !level->valid || !smooth)
                goto memory;
            p->count++;
            b.width = width, b.height = height, b.in = light, b.out = smooth;
            core_parallel(pool, height, 8, smooth_rows, &b);
            b.in = smooth, b.in_valid = valid, b.out = level->feature, b.out_valid = level->valid;
            core_parallel(pool, height, 8, feature_rows, &b);
            core_free(smooth);
            smooth = NULL;
        } else {
            p->base++;
        }
        if (p->count == LEVELS || (p->count && (width / 2 < TOP_SIDE || height / 2 < TOP_SIDE)))
            break;
        if (width < 4 || height < 4)
            break;
        b.in = light, b.in_valid = valid, b.in_width = width;
        width /= 2, height /= 2;
        next = core_alloc(width * height, sizeof(v4)), next_valid = core_alloc(width * height, sizeof(v4));
        if (!next || !next_valid)
            goto memory;
        b.width = width, b.height = height, b.out = next, b.out_valid = next_valid;
        core_parallel(pool, height, 16, halve_rows, &b);
        b.noise_s *= v4_set(0.25f), b.noise_o *= v4_set(0.25f);
        core_free(light), core_free(valid);
        light = next, valid = next_valid, next = next_valid = NULL;
    }
    core_free(light), core_free(valid);
    *out = p;
    return BRACE_OK;
memory:
    core_free(light), core_free(valid), core_free(next), core_free(next_valid), core_free(smooth);
    restore_pyramid_destroy(p);
    return core_fail_memory(error, bytes, "aligning the frames");
}

/* ---- one level ---- */

/* Sums over a tile for the normal equations: the structure tensor (xx, xy, yy)
 * and the gradient-weighted residual (x, y), each times 1, u, v, uu, uv, vv. */
typedef struct align_sums {
    double tensor[3][6], force[2][3];
    double residual[3], pixels[3];  /* for the next iteration's scale */
    double cross, energy0, energy1; /* for the correlation */
} align_sums;

typedef struct align_run {
    const align_level *reference, *moved;
    const restore_motion *motion;
    int columns, rows;
    float scale[3]; /* residual beyond which a pixel is taken for an outlier */
    align_sums *sums;
} align_run;

static void tile_range(size_t n, int tiles, int i, size_t *begin, size_t *end) {
    *begin = n * (size_t)i / (size_t)tiles;
    *end = n * ((size_t)i + 1) / (size_t)tiles;
}

typedef int32_t v4i __attribute__((vector_size(16)));

/* The sums along one row of a tile, whose v is the same: tensor and force times 1, u, uu; colours side by side. */
typedef struct align_row {
    v4 tensor[3][3], force[2][2], residual, pixels, cross, energy0, energy1;
} align_row;

static double sum3(v4 a) {
    return (double)a[0] + (double)a[1] + (double)a[2];
}

static void add_row(align_sums *s, const align_row *r, double v) {
    for (int a = 0; a < 3; a++) { /* times 1, u, v, uu, uv, vv */
        const double one = sum3(r->tensor[a][0]), u = sum3(r->tensor[a][1]), uu = sum3(r->tensor[a][2]);
        const double add[6] = {one, u, one * v, uu, u * v, one * v * v};
        for (int k = 0; k < 6; k++)
            s->tensor[a][k] += add[k];
    }
    for (int a = 0; a < 2; a++) {
        const double one = sum3(r->force[a][0]), u = sum3(r->force[a][1]);
        s->force[a][0] += one, s->force[a][1] += u, s->force[a][2] += one * v;
    }
    for (int c = 0; c < 3; c++)
        s->residual[c] += (double)r->residual[c], s->pixels[c] += (double)r->pixels[c];
    s->cross += sum3(r->cross), s->energy0 += sum3(r->energy0), s->energy1 += sum3(r->energy1);
}

static void align_tile(const align_run *run, int tile) {
    const align_level *r = run->reference, *m = run->moved;
    const restore_motion *motion = run->motion;
    const float half_w = 0.5f * (float)r->width, half_h = 0.5f * (float)r->height;
    align_sums *s = &run->sums[tile];
    memset(s, 0, sizeof *s);
    size_t x0, x1, y0, y1;
    tile_range(r->width, run->columns, tile % run->columns, &x0, &x1);
    tile_range(r->height, run->rows, tile / run->columns, &y0, &y1);
    if (x0 < 1)
        x0 = 1;
    if (y0 < 1)
        y0 = 1;
    if (x1 > r->width - 1)
        x1 = r->width - 1;
    if (y1 > r->height - 1)
        y1 = r->height - 1;
    const double local_x = motion->columns ? (double)motion->dx[tile] : 0;
    const double local_y = motion->columns ? (double)motion->dy[tile] : 0;
    v4 sharpness = v4_set(1), strength = v4_set(0); /* of the Cauchy weights 1/(k k (1 + (d/2k)^2)) */
    for (int c = 0; c < 3; c++) {
        const float k = run->scale[c];
        sharpness[c] = 0.25f / (k * k), strength[c] = 1 / (k * k);
    }
    /* Along a row, where a pixel is found moves by the same step: x' = ax + bx x, y' = ay + by x. */
    const float step_x = (float)(1 + motion->a[1] / (double)half_w), step_y = (float)(motion->a[4] / (double)half_w);
    const float last_x = (float)m->width - 1, last_y = (float)m->height - 1;
    const v4 zero = v4_set(0), half = v4_set(0.5f), one = v4_set(1);
    for (size_t y = y0; y < y1; y++) {
        const float v = ((float)y - half_h) / half_w;
        const double u0 = ((double)x0 - (double)half_w) / (double)half_w;
        float sx = (float)((double)x0 + motion->a[0] + motion->a[1] * u0 + motion->a[2] * (double)v + local_x);
        float sy = (float)((double)y + motion->a[3] + motion->a[4] * u0 + motion->a[5] * (double)v + local_y);
        align_row row = {0};
        for (size_t x = x0; x < x1; x++, sx += step_x, sy += step_y) {
            const size_t i = y * r->width + x;
            v4 valid = r->valid[i];
            if (valid[0] + valid[1] + valid[2] == 0 || !(sx >= 0 && sy >= 0 && sx < last_x && sy < last_y))
                continue;
            const size_t ix = (size_t)sx, iy = (size_t)sy, j = iy * m->width + ix, k = j + m->width;
            valid *= m->valid[j] * m->valid[j + 1] * m->valid[k] * m->valid[k + 1];
            valid = (v4)((valid != zero) & (v4i)one);
            const v4 fx = v4_set(sx - (float)ix), fy = v4_set(sy - (float)iy);
            const v4 top = m->feature[j] + fx * (m->feature[j + 1] - m->feature[j]);
            const v4 bottom = m->feature[k] + fx * (m->feature[k + 1] - m->feature[k]);
            const v4 f1 = valid * (top + fy * (bottom - top)), f0 = valid * r->feature[i], d = f0 - f1;
            const v4 gx = valid * (r->feature[i + 1] - r->feature[i - 1]) * half;
            const v4 gy = valid * (r->feature[i + r->width] - r->feature[i - r->width]) * half;
            const v4 w = strength / (one + d * d * sharpness), wx = w * gx, wy = w * gy;
            const v4 u = v4_set(((float)x - half_w) / half_w), uu = u * u;
            const v4 xx = wx * gx, xy = wx * gy, yy = wy * gy, bx = wx * d, by = wy * d;
            row.tensor[0][0] += xx, row.tensor[0][1] += xx * u, row.tensor[0][2] += xx * uu;
            row.tensor[1][0] += xy, row.tensor[1][1] += xy * u, row.tensor[1][2] += xy * uu;
            row.tensor[2][0] += yy, row.tensor[2][1] += yy * u, row.tensor[2][2] += yy * uu;
            row.force[0][0] += bx, row.force[0][1] += bx * u;
            row.force[1][0] += by, row.force[1][1] += by * u;
            row.residual += v4_abs(d), row.pixels += valid;
            row.cross += f0 * f1, row.energy0 += f0 * f0, row.energy1 += f1 * f1;
        }
        add_row(s, &row, (double)v);
    }
}

static void align_tiles(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    for (size_t i = begin; i < end; i++)
        align_tile(arg, (int)i);
}

static void sums_add(align_sums *to, const align_sums *from) {
    double *a = (double *)to;
    const double *b = (const double *)from;
    for (size_t i = 0; i < sizeof *to / sizeof(double); i++)
        a[i] += b[i];
}

static double sums_correlation(const align_sums *s) {
    return s->energy0 > 0 && s->energy1 > 0 ? s->cross / sqrt(s->energy0 * s->energy1) : 0;
}

/* All tiles, and their sum, under the current motion. */
static align_sums align_measure(align_run *run, core_pool *pool) {
    align_sums total = {0};
    int tiles = run->columns * run->rows;
    core_parallel(pool, (size_t)tiles, 1, align_tiles, run);
    for (int i = 0; i < tiles; i++)
        sums_add(&total, &run->sums[i]);
    for (int c = 0; c < 3; c++)
        if (total.pixels[c] > 0) {
            float scale = (float)(total.residual[c] / total.pixels[c]);
            run->scale[c] = scale > 1e-4f ? scale : 1e-4f;
        }
    return total;
}

/* Solves the symmetric positive definite n x n system in place (Cholesky). */
static bool solve(double *a, double *b, int n) {
    for (int i = 0; i < n; i++) {
        for (int j = 0; j <= i; j++) {
            double s = a[i * n + j];
            for (int k = 0; k < j; k++)
                s -= a[i * n + k] * a[j * n + k];
            if (i == j) {
                if (!(s > 0))
                    return false;
                a[i * n + i] = sqrt(s);
            } else {
                a[i * n + j] = s / a[j * n + j];
            }
        }
    }
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < i; k++)
            b[i] -= a[i * n + k] * b[k];
        b[i] /= a[i * n + i];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++)
            b[i] -= a[k * n + i] * b[k];
        b[i] /= a[i * n + i];
    }
    return true;
}

/* Neighbouring residuals are correlated by the smoothing: about so many of them count as one. */
static const double correlated = 14;

/* One Gauss-Newton step of the affine motion; returns the largest move at a corner. */
static double affine_step(restore_motion *motion, const align_sums *s, double width) {
    /* Hand tremor between frames: some percent of the width in place, some per mille in shape. */
    const double place = 0.03 * width, shape = 0.004 * width;
    static const int index[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
    double a[36], b[6];
    for (int i = 0; i < 6; i++) {
        for (int j = 0; j < 6; j++)
            a[i * 6 + j] = s->tensor[i / 3 + j / 3][index[i % 3][j % 3]] / correlated;
        double prior = i % 3 == 0 ? place : shape;
        a[i * 6 + i] += 1 / (prior * prior);
        b[i] = s->force[i / 3][i % 3] / correlated - motion->a[i] / (prior * prior);
    }
    if (!solve(a, b, 6))
        return 0;
    double moved = 0;
    for (int i = 0; i < 6; i++) {
        motion->a[i] += b[i];
        moved += fabs(b[i]);
    }
    return moved;
}

/* One step of every tile's own displacement, held near zero. */
static void local_step(restore_motion *motion, const align_sums *sums) {
    const double prior = 1 / (0.35 * 0.35);
    for (int i = 0; i < motion->columns * motion->rows; i++) {
        const align_sums *s = &sums[i];
        double a[4] = {s->tensor[0][0] / correlated + prior, 0, s->tensor[1][0] / correlated,
                       s->tensor[2][0] / correlated + prior};
        double b[2] = {s->force[0][0] / correlated - prior * motion->dx[i],
                       s->force[1][0] / correlated - prior * motion->dy[i]};
        if (!solve(a, b, 2))
            continue;
        motion->dx[i] = (float)fmin(fmax(motion->dx[i] + b[0], -3), 3);
        motion->dy[i] = (float)fmin(fmax(motion->dy[i] + b[1], -3), 3);
    }
}

/* The whole-pixel shift that correlates best at the coarsest level, tried out to
 * an eighth of the picture; zero unless another is clearly better. */
static void coarse_search(align_run *run, restore_motion *motion, core_pool *pool) {
    int reach_x = (int)(run->reference->width / 8), reach_y = (int)(run->reference->height / 8);
    double best = -1, at_zero = 0, best_x = 0, best_y = 0;
    for (int dy = -reach_y; dy <= reach_y; dy++)
        for (int dx = -reach_x; dx <= reach_x; dx++) {
            motion->a[0] = dx, motion->a[3] = dy;
            align_sums s = align_measure(run, pool);
            double share = (s.pixels[0] + s.pixels[1] + s.pixels[2]) /
                           (3.0 * (double)run->reference->width * (double)run->reference->height);
            double c = share > 0.02 ? sums_correlation(&s) : -1;
            if (dx == 0 && dy == 0)
                at_zero = c;
            if (c > best)
                best = c, best_x = dx, best_y = dy;
        }
    bool clearly = best > at_zero + 0.1 && best > 0.3;
    motion->a[0] = clearly ? best_x : 0;
    motion->a[3] = clearly ? best_y : 0;
}

void restore_align(restore_motion *out, const restore_pyramid *reference, const restore_pyramid *moved,
                   core_pool *pool) {
    align_sums sums[RESTORE_GRID * RESTORE_GRID];
    restore_motion motion = {0};
    *out = motion;
    if (reference->count == 0 || moved->count == 0)
        return; /* a picture a few pixels high has nothing to align */
    align_run run = {.motion = &motion, .columns = 1, .rows = 1, .scale = {0.05f, 0.05f, 0.05f}, .sums = sums};
    for (int i = reference->count - 1; i >= 0; i--) {
        run.reference = &reference->level[i], run.moved = &moved->level[i];
        double width = (double)run.reference->width;
        run.columns = (int)(run.reference->width / 48) + 1, run.rows = (int)(run.reference->height / 48) + 1;
        if (run.columns > RESTORE_GRID)
            run.columns = RESTORE_GRID;
        if (run.rows > RESTORE_GRID)
            run.rows = RESTORE_GRID;
        if (i == reference->count - 1) {
            coarse_search(&run, &motion, pool);
        } else {
            for (int k = 0; k < 6; k++)
                motion.a[k] *= 2;
        }
        for (int k = 0; k < 8; k++) {
            align_sums s = align_measure(&run, pool);
            if (affine_step(&motion, &s, width) < 0.01)
                break;
        }
    }
    /* Keep it only if it explains the pixels better than standing still does. */
    align_sums found = align_measure(&run, pool);
    restore_motion still = {0};
    run.motion = &still;
    align_sums unmoved = align_measure(&run, pool);
    run.motion = &motion;
    motion.confidence = sums_correlation(&found);
    if (!(motion.confidence >= sums_correlation(&unmoved))) {
        memset(motion.a, 0, sizeof motion.a);
        motion.confidence = sums_correlation(&unmoved);
    } else {
        motion.columns = run.columns, motion.rows = run.rows;
        for (int k = 0; k < 4; k++) {
            align_measure(&run, pool);
            local_step(&motion, sums);
        }
    }
    if (motion.confidence < 0)
        motion.confidence = 0;
    double up = ldexp(1, reference->base);
    for (int k = 0; k < 6; k++)
        motion.a[k] *= up;
    for (int k = 0; k < motion.columns * motion.rows; k++)
        motion.dx[k] *= (float)up, motion.dy[k] *= (float)up;
    *out = motion;
}
