/* SPDX-License-Identifier: Apache-2.0 */
/* rows_body.h: the loops of rows.h, included by a file for each instruction set, which names the table with SIM_ROWS.
 */
#include <math.h>
#include <string.h>

#include "sim/rows.h"

/* ---- seeing the screen ---- */

/* Four floats, of which three are a texel's colours: one load, one multiplication for all of them. */
typedef float quad __attribute__((vector_size(16)));

static inline quad load(const float *p) {
    quad q;
    memcpy(&q, p, sizeof q); /* levels end with a float to spare */
    return q;
}

/* One level of the pyramid, and the way from the screen's pixels to its own. */
typedef struct sampler {
    const float *rgb;
    float sx, sy, last_x, last_y;
    size_t stride;
    size_t right, down;        /* to the neighbours, 0 where a side has one texel only */
    int32_t ahead, ahead_most; /* to what the next row of a picture will see */
    float most_x, most_y;
} sampler;

static sampler sampler_of(const sim_texture *t, int l) {
    const uint32_t w = t->level[l].width, h = t->level[l].height;
    return (sampler){.rgb = t->level[l].rgb,
                     .sx = (float)w / (float)t->width,
                     .sy = (float)h / (float)t->height,
                     .last_x = (float)(w - 1),
                     .last_y = (float)(h - 1),
                     .stride = 3 * (size_t)w,
                     .right = w > 1 ? 3 : 0,
                     .down = h > 1 ? 3 * (size_t)w : 0,
                     .ahead = 9 * (int32_t)w,
                     .ahead_most = 3 * (int32_t)w * ((int32_t)h - 3),
                     .most_x = (float)(w > 1 ? w - 2 : 0),
                     .most_y = (float)(h > 1 ? h - 2 : 0)};
}

static inline float smaller(float a, float b) {
    return a < b ? a : b;
}

static inline float larger(float a, float b) {
    return a > b ? a : b;
}

/* Bilinear: the last texel is reached with a weight of 1 from the one before it. */
static inline quad sample(const sampler *s, float x, float y) {
    x = larger(smaller(x * s->sx - 0.5f, s->last_x), 0), y = larger(smaller(y * s->sy - 0.5f, s->last_y), 0);
    const int i = (int)smaller(x, s->most_x), j = (int)smaller(y, s->most_y);
    const float fx = x - (float)i, fy = y - (float)j;
    const float *p = s->rgb + (size_t)j * s->stride + 3 * (size_t)i, *q = p + s->down;
    quad a = load(p), b = load(p + s->right), c = load(q), d = load(q + s->right);
    a += fx * (b - a), c += fx * (d - c);
    return a + fy * (c - a);
}

/* The same for the n pixels of a row, moved by (dx, dy): first where, then what. Adds it to row->sum, or begins. */
static void sample_row(const sampler *s, sim_row *row, size_t n, float dx, float dy, float weight, bool first) {
    int32_t *restrict at = row->at;
    float *restrict right = row->right, *restrict down = row->down;
    const float *restrict sx = row->sx, *restrict sy = row->sy;
    const float kx = s->sx, ky = s->sy, last_x = s->last_x, last_y = s->last_y, most_x = s->most_x, most_y = s->most_y;
    const int32_t stride = (int32_t)s->stride;
    for (size_t k = 0; k < n; k++) {
        const float x = larger(smaller((sx[k] + dx) * kx - 0.5f, last_x), 0);
        const float y = larger(smaller((sy[k] + dy) * ky - 0.5f, last_y), 0);
        const int32_t i = (int32_t)smaller(x, most_x), j = (int32_t)smaller(y, most_y);
        at[k] = j * stride + 3 * i;
        right[k] = x - (float)i, down[k] = y - (float)j;
    }
    float *restrict sum = row->sum;
    for (size_t k = 0; k < n; k++) {
        const float *p = s->rgb + at[k], *q = p + s->down;
        quad a = load(p), b = load(p + s->right), c = load(q), d = load(q + s->right);
        /* A row of the picture comes to texels that the one before has not met: slow memory, if nobody asks early. */
        __builtin_prefetch(s->rgb + (at[k] < s->ahead_most ? at[k] + s->ahead : at[k]));
        a += right[k] * (b - a), c += right[k] * (d - c);
        a = weight * (a + down[k] * (c - a));
        if (!first)
            a += load(sum + 4 * k);
        memcpy(sum + 4 * k, &a, sizeof a);
    }
}

/* The way from a row's pixels to the screen. */
typedef struct view {
    float m[9]; /* to screen pixels: (A + B qx + C qy)/(D + E qx + F qy), in single precision 1/1000 pixel */
    float k1, k2, step, first, ry, ry2;
} view;

static inline float project(const view *v, size_t x, float *a, float *b) {
    const float px = v->first + v->step * (float)(int32_t)x, r2 = px * px + v->ry2;
    const float bend = 1 + r2 * (v->k1 + r2 * v->k2), qx = px * bend, qy = v->ry * bend;
    const float w = v->m[6] * qx + v->m[7] * qy + v->m[8], d = 1 / w;
    *a = (v->m[0] * qx + v->m[1] * qy + v->m[2]) * d, *b = (v->m[3] * qx + v->m[4] * qy + v->m[5]) * d;
    return w;
}

/* A level of the pyramid and how much of the next one is mixed in: bilinear lookups of the level 2^l have the variance
 * 4^l/4, and so the mixture has the one that is wanted exactly. */
typedef struct mixture {
    sampler near, far;
    float blend;
} mixture;

static mixture mixture_of(const sim_texture *t, double four_variances) {
    int l = 0;
    double texel = 1;
    while (l + 1 < t->levels && 4 * texel <= four_variances)
        l++, texel *= 4;
    const double blend = fmin(fmax((four_variances / texel - 1) / 3, 0), 1);
    return (mixture){sampler_of(t, l), sampler_of(t, l + 1 < t->levels ? l + 1 : l), (float)blend};
}

static inline quad sample_mixture(const mixture *m, float x, float y) {
    quad c = sample(&m->near, x, y);
    if (m->blend > 0)
        c += m->blend * (sample(&m->far, x, y) - c);
    return c;
}

/* Bezel and background, weighted with how much of the pixel is not screen. */
static void look_around(const sim_render_job *job, sim_row *row, const view *v, double foot, float per_foot) {
    const sim_texture *t = job->background;
    const size_t n = job->out->width;
    const float width = (float)job->texture->width, height = (float)job->texture->height;
    const float scale = (float)t->width / (3 * width), bezel = (float)job->scene->bezel * width;
    const double texels = foot * (double)scale;
    const mixture m = mixture_of(t, fmax(1, texels * texels) + texels * texels * job->blur.extra);
    const float bright = (float)job->scene->clutter, dark = 0.1f * bright;
    for (int c = 0; c < 3; c++)
        memset(row->around[c], 0, n * sizeof(float));
    for (size_t x = 0; x < n; x++) {
        float a, b;
        if (row->cover[x] >= 1 || !(project(v, x, &a, &b) > 0))
            continue;
        const float beside = larger(larger(-a, a - width), larger(-b, b - height));
        const float frame = bezel > 0 ? smaller(larger((bezel - beside) * per_foot + 0.5f, 0), 1) : 0;
        const quad c = sample_mixture(&m, (a + width) * scale, (b - 0.5f * height) * scale + 0.5f * (float)t->height);
        const float open = 1 - row->cover[x];
        for (int k = 0; k < 3; k++)
            row->around[k][x] = open * (frame * dark + (1 - frame) * bright * c[k]);
    }
}

static void look(const sim_render_job *job, sim_row *row, const double map[9], double py) {
    const sim_texture *t = job->texture;
    const size_t n = job->out->width;
    const double inv = 1 / (double)n, sw = t->width, sh = t->height;
    /* The way of a screen pixel from pixel to pixel, in the middle of the row; the root of its area is the footprint,
     * which with the lens's blur chooses the mip levels. */
    const double z = map[7] * py + map[8], u = map[1] * py + map[2], w = map[4] * py + map[5];
    const double per = inv * sw / (z * z);
    const double right[2] = {(map[0] * z - map[6] * u) * per, (map[3] * z - map[6] * w) * per};
    const double down[2] = {(map[1] * z - map[7] * u) * per, (map[4] * z - map[7] * w) * per};
    const double area = fmin(fmax(fabs(right[0] * down[1] - down[0] * right[1]), 1e-6), 1e12), foot = sqrt(area);
    const double rays = job->blur.rays;
    const mixture m = mixture_of(t, fmax(1, area / (rays * rays)) + area * job->blur.extra);
    const float per_foot = (float)(1 / (foot * job->blur.ramp));
    view v = {.k1 = (float)job->scene->distortion[0],
              .k2 = (float)job->scene->distortion[1],
              .step = (float)inv,
              .first = (float)(0.5 * inv - 0.5),
              .ry = (float)py};
    v.ry2 = v.ry * v.ry;
    for (int i = 0; i < 3; i++) {
        v.m[i] = (float)((map[i] + 0.5 * map[6 + i]) * sw);
        v.m[3 + i] = (float)(map[3 + i] * sw + 0.5 * map[6 + i] * sh);
        v.m[6 + i] = (float)map[6 + i];
    }
    const float width = (float)sw, height = (float)sh;
    /* Just below the last pixel's far side. */
    const float last_x = nextafterf(width, 0), last_y = nextafterf(height, 0);
    float *restrict sx = row->sx, *restrict sy = row->sy, *restrict cover = row->cover;
    int32_t *restrict ix = row->x, *restrict iy = row->y;
    for (size_t x = 0; x < n; x++)
        cover[x] = project(&v, x, &sx[x], &sy[x]);
    int open = 0;
    for (size_t x = 0; x < n; x++) {
        const float a = sx[x], b = sy[x], front = cover[x];
        float edge = smaller(smaller(a, width - a), smaller(b, height - b)) * per_foot + 0.5f;
        edge = smaller(larger(edge, 0), 1);
        cover[x] = front > 0 ? edge : 0; /* not behind the camera */
        const float in_x = larger(smaller(a, last_x), 0), in_y = larger(smaller(b, last_y), 0);
        sx[x] = in_x, sy[x] = in_y;
        ix[x] = (int32_t)in_x, iy[x] = (int32_t)in_y;
    }
    for (size_t x = 0; x < n; x++)
        open |= cover[x] < 1;
    for (int k = 0; k < job->blur.taps; k++) {
        const double *tap = job->blur.tap[k];
        const float dx = (float)(right[0] * tap[0] + down[0] * tap[1]), share = 1 / (float)job->blur.taps;
        const float dy = (float)(right[1] * tap[0] + down[1] * tap[1]);
        sample_row(&m.near, row, n, dx, dy, share * (1 - m.blend), k == 0);
        if (m.blend > 0)
            sample_row(&m.far, row, n, dx, dy, share * m.blend, false);
    }
    float *restrict red = row->level[0], *restrict green = row->level[1], *restrict blue = row->level[2];
    const float *restrict sum = row->sum;
    for (size_t x = 0; x < n; x++)
        red[x] = sum[4 * x], green[x] = sum[4 * x + 1], blue[x] = sum[4 * x + 2];
    row->open = open && job->background != NULL;
    if (row->open)
        look_around(job, row, &v, foot, per_foot);
}

static void collect(const sim_render_job *job, const sim_row *row, const float *const light[3], float room, float scale,
                    size_t y, bool first) {
    const size_t n = job->out->width;
    const float *restrict r = light[0], *restrict g = light[1], *restrict b = light[2], *restrict cover = row->cover;
    for (int c = 0; c < 3; c++) {
        float *restrict out = job->out->plane[c] + y * n;
        const float *k = job->matrix + 3 * c;
        const float kr = scale * k[0], kg = scale * k[1], kb = scale * k[2];
        const float lamp = (kr + kg + kb) * (float)job->scene->ambient * room;
        if (first)
            for (size_t x = 0; x < n; x++)
                out[x] = cover[x] * (kr * r[x] + kg * g[x] + kb * b[x] + lamp);
        else
            for (size_t x = 0; x < n; x++)
                out[x] += cover[x] * (kr * r[x] + kg * g[x] + kb * b[x] + lamp);
        if (row->open) {
            const float *restrict ar = row->around[0], *restrict ag = row->around[1], *restrict ab = row->around[2];
            for (size_t x = 0; x < n; x++)
                out[x] += room * (kr * ar[x] + kg * ag[x] + kb * ab[x]);
        }
    }
}

/* ---- the lens ---- */

static void finish(const sim_render_job *job, const sim_row *row, size_t y) {
    const size_t n = job->out->width, parts = GLARE_KNOTS - 1;
    const float share = (float)job->glare.share, kept = 1 - share;
    const float fall = 0.5f * (float)job->scene->vignetting, step = 2 / (float)n, length = (float)n / (float)parts;
    const float v = 2 * ((float)y + 0.5f) / (float)job->out->height - 1, most = 1 - fall * v * v;
    for (size_t c = 0; c < 3; c++) {
        float *restrict p = job->out->plane[c] + y * n;
        for (size_t k = 0; k < parts && share > 0; k++) {
            const float slope = share * (row->knots[c][k + 1] - row->knots[c][k]) / length;
            const float base = share * row->knots[c][k] + slope * (0.5f - (float)k * length);
            for (size_t x = k * n / parts; x < (k + 1) * n / parts; x++)
                p[x] = kept * p[x] + (base + slope * (float)(int32_t)x);
        }
        for (size_t x = 0; x < n && fall > 0; x++) {
            const float u = ((float)(int32_t)x + 0.5f) * step - 1;
            p[x] *= most - fall * u * u;
        }
    }
}

/* ---- random numbers ---- */

static inline void rounds(uint32_t c[4], uint32_t k0, uint32_t k1) {
    for (int round = 0; round < 10; round++) {
        const uint64_t p0 = (uint64_t)0xD2511F53u * c[0], p1 = (uint64_t)0xCD9E8D57u * c[2];
        c[0] = (uint32_t)(p1 >> 32) ^ c[1] ^ k0, c[2] = (uint32_t)(p0 >> 32) ^ c[3] ^ k1;
        c[1] = (uint32_t)p1, c[3] = (uint32_t)p0;
        k0 += 0x9E3779B9u, k1 += 0xBB67AE85u;
    }
}

/* core_philox of the counters (x, y, sample, purpose), x = first, first + 4, ...: word i of each into out[i]. */
static void draw(uint32_t out[4][QUADS], const uint32_t key[2], uint32_t first, uint32_t y, uint32_t sample,
                 uint32_t purpose) {
    for (uint32_t i = 0; i < QUADS; i++) {
        uint32_t c[4] = {first + 4 * i, y, sample, purpose};
        rounds(c, key[0], key[1]);
        out[0][i] = c[0], out[1][i] = c[1], out[2][i] = c[2], out[3][i] = c[3];
    }
}

/* ln of a number in (0, 1]: exponent and mantissa m apart, ln m = 2 artanh((m-1)/(m+1)); to 1e-7. */
static inline float logarithm(float u) {
    int32_t bits;
    memcpy(&bits, &u, sizeof bits);
    const int32_t exponent = (bits - 0x3f3504f3) >> 23; /* m from sqrt(1/2) to sqrt(2) */
    bits -= exponent * (1 << 23);
    float m;
    memcpy(&m, &bits, sizeof m);
    const float s = (m - 1) / (m + 1), t = s * s;
    const float p = 2 + t * (2.0f / 3 + t * (2.0f / 5 + t * (2.0f / 7 + t * (2.0f / 9))));
    return (float)exponent * 0.69314718f + s * p;
}

/* Two words to two normal numbers, mean 0 and deviation 1 (Box and Muller 1958). */
static inline void normal_pair(float *a, float *b, uint32_t u, uint32_t v) {
    const float radius = sqrtf(-2 * logarithm((float)(int32_t)((u >> 8) + 1) * 0x1p-24f));
    /* The angle is a quarter of a turn times (q + f), q = 0 to 3, f from -1/2 to 1/2. */
    const float f = (float)(int32_t)(v << 2 >> 9) * 0x1p-23f - 0.5f, t = f * f;
    const float s =
        f * (1.57079633f + t * (-0.645964098f + t * (0.0796926262f + t * (-0.00468175413f + t * 1.60441e-4f))));
    const float c = 1 + t * (-1.23370055f + t * (0.253669508f + t * (-0.0208634807f + t * 9.19260e-4f)));
    const uint32_t q = v >> 30;
    const float x = q & 1 ? s : c, y = q & 1 ? c : s; /* (c, s) turned by 0, 90, 180, 270 degrees, or mirrored */
    *a = q & 2 ? -radius * x : radius * x;
    *b = (q ^ q << 1) & 2 ? -radius * y : radius * y;
}

static void normals(float out[PIECE], const uint32_t key[2], uint32_t first, uint32_t y, uint32_t sample,
                    uint32_t purpose) {
    uint32_t words[4][QUADS];
    float part[4][QUADS];
    draw(words, key, first, y, sample, purpose);
    for (int i = 0; i < QUADS; i++) {
        normal_pair(&part[0][i], &part[1][i], words[0][i], words[1][i]);
        normal_pair(&part[2][i], &part[3][i], words[2][i], words[3][i]);
    }
    for (int i = 0; i < QUADS; i++)
        for (int k = 0; k < 4; k++)
            out[4 * i + k] = part[k][i];
}

static void normal_line(float *out, size_t n, const uint32_t key[2], uint32_t y, uint32_t sample, uint32_t purpose) {
    float random[PIECE];
    for (size_t x = 0; x < n; x += PIECE) {
        normals(random, key, (uint32_t)x, y, sample, purpose);
        memcpy(out + x, random, (n - x < PIECE ? n - x : PIECE) * sizeof *out);
    }
}

/* ---- the panel ---- */

/* A subpixel's deviation: the smooth field's, and its own, the sum of a word's four bytes, close to normal. Both have
 * the deviation 1; together they are cut two above the mean, where the gain is 1. */
static void panel_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    enum { PIXELS = PIECE / 3 }; /* whole pixels of a draw */
    const sim_panel_job *job = arg;
    const uint32_t width = job->texture->width;
    const float strength = (float)job->scene->panel_nonuniformity, half = 0.70710678f;
    const float across = (float)(FIELD_COLUMNS - 1) / (float)width;
    const float along = (float)(FIELD_ROWS - 1) / (float)job->texture->height;
    for (size_t y = begin; y < end; y++) {
        const float fy = ((float)y + 0.5f) * along, v = fy - floorf(fy), t = v * v * (3 - 2 * v);
        const float(*top)[3] = job->field + (size_t)fy * FIELD_COLUMNS, (*low)[3] = top + FIELD_COLUMNS;
        float field[FIELD_COLUMNS][3];
        for (int i = 0; i < FIELD_COLUMNS; i++)
            for (int c = 0; c < 3; c++)
                field[i][c] = half * (top[i][c] + t * (low[i][c] - top[i][c])) - 2;
        for (uint32_t x0 = 0; x0 < width; x0 += PIXELS) {
            const uint32_t n = width - x0 < PIXELS ? width - x0 : PIXELS;
            uint32_t words[4][QUADS];
            float own[PIECE], smooth[PIECE];
            draw(words, job->key, x0 / PIXELS * PIECE, (uint32_t)y, job->scene->sample, PANEL_GAINS);
            for (int k = 0; k < 4; k++) /* which subpixel has which number does not matter */
                for (int i = 0; i < QUADS; i++) {
                    const uint32_t u = words[k][i];
                    const int32_t sum = (int32_t)((u & 255) + (u >> 8 & 255) + (u >> 16 & 255) + (u >> 24));
                    own[QUADS * k + i] = (float)(sum - 510) * (half / 147.8f);
                }
            for (uint32_t p = 0; p < n; p++) {
                const float fx = ((float)(int32_t)(x0 + p) + 0.5f) * across;
                const int32_t cell = (int32_t)fx;
                const float u = fx - (float)cell, s = u * u * (3 - 2 * u);
                const float *a = field[cell], *b = field[cell + 1];
                for (int c = 0; c < 3; c++)
                    smooth[3 * p + (uint32_t)c] = a[c] + s * (b[c] - a[c]);
            }
            float *restrict rgb = job->texture->level[0].rgb + 3 * (y * width + x0);
            for (uint32_t i = 0; i < 3 * n; i++)
                rgb[i] *= larger(1 + strength * smaller(smooth[i] + own[i], 0), 0);
        }
    }
}

/* ---- the sensor ---- */

/* What a row's pixels share, by the parity of their column. */
typedef struct row_constants {
    const float *plane[2];
    float s[2], o[2], black[2], range[2];
} row_constants;

static void expose_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const sim_sensor_job *job = arg;
    brace_frame *f = job->out;
    const bool noisy = job->frame >= 0 && job->scene->noise > 0;
    const float uneven = (float)job->scene->sensor_nonuniformity, white = f->white;
    for (uint32_t y = (uint32_t)begin; y < (uint32_t)end; y++) {
        row_constants row;
        for (uint32_t i = 0; i < 2; i++) {
            const int color = brace_cfa_color(f->cfa, i, y);
            row.plane[i] = job->light->plane[color] + (size_t)y * f->width;
            row.s[i] = (float)f->noise[color][0], row.o[i] = (float)f->noise[color][1];
            row.black[i] = f->black[(y & 1) * 2 + i], row.range[i] = white - row.black[i];
        }
        for (uint32_t x0 = 0; x0 < f->width; x0 += PIECE) {
            const int n = f->width - x0 < PIECE ? (int)(f->width - x0) : PIECE;
            float v[PIECE], random[PIECE];
            const float *even = row.plane[0] + x0, *odd = row.plane[1] + x0;
            for (int i = 0; i < n; i++)
                v[i] = i & 1 ? odd[i] : even[i];
            if (uneven > 0) { /* the same in every frame: it belongs to the sensor */
                const float *columns = job->columns + x0, line = 1 + uneven * job->lines[y];
                normals(random, job->key, x0, y, job->scene->sample, PIXEL_GAINS);
                for (int i = 0; i < n; i++)
                    v[i] *= line + uneven * (columns[i] + random[i]);
            }
            if (noisy) {
                normals(random, job->key, x0, y, job->scene->sample, (uint32_t)(NOISE + 16 * job->frame));
                for (int i = 0; i < n; i++) {
                    const float x = v[i] > 0 ? v[i] : 0, s = i & 1 ? row.s[1] : row.s[0];
                    v[i] += sqrtf(s * x + (i & 1 ? row.o[1] : row.o[0])) * random[i];
                }
            }
            uint16_t *out = f->data + (size_t)y * f->width + x0;
            for (int i = 0; i < n; i++) {
                float raw = v[i] * (i & 1 ? row.range[1] : row.range[0]) + (i & 1 ? row.black[1] : row.black[0]);
                raw = raw > 0 ? raw : 0; /* NaN: 0 */
                raw = raw < white ? raw : white;
                out[i] = (uint16_t)(int32_t)(raw + 0.5f);
            }
        }
    }
}

const sim_rows SIM_ROWS = {
    .look = look,
    .collect = collect,
    .finish = finish,
    .panel_rows = panel_rows,
    .expose_rows = expose_rows,
    .normals = normal_line,
};
