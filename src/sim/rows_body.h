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
    size_t right, down; /* to the neighbours, 0 where a side has one texel only */
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

/* What the pixels of a row see at one pose: subpixel, level and how much of the pixel is screen. */
static void look(const sim_render_job *job, const sim_row *row, const double map[9], double py) {
    const sim_texture *t = job->texture;
    const size_t n = job->out->width;
    const double inv = 1 / (double)n, sw = t->width, sh = t->height;
    const float k1 = (float)job->scene->distortion[0], k2 = (float)job->scene->distortion[1];
    /* The footprint in the middle of the row, the root of its area, chooses the mip levels. */
    const double z = map[7] * py + map[8], u = map[1] * py + map[2], v = map[4] * py + map[5];
    const double area = ((map[0] * z - map[6] * u) * (map[4] * z - map[7] * v) -
                         (map[1] * z - map[7] * u) * (map[3] * z - map[6] * v)) /
                        (z * z * z * z) * inv * inv * sw * sw;
    const double foot = sqrt(fmin(fmax(fabs(area), 1e-6), 1e12)), most = t->levels - 1;
    const double lod = fmin(fmax(log2(foot), 0), most);
    const int l0 = (int)lod, l1 = l0 + 1 < t->levels ? l0 + 1 : l0;
    const float blend = (float)(lod - l0), per_foot = (float)(1 / foot);
    /* Screen pixels are (A + B qx + C qy)/(D + E qx + F qy), in single precision 1/1000 pixel. */
    float m[9];
    for (int i = 0; i < 3; i++) {
        m[i] = (float)((map[i] + 0.5 * map[6 + i]) * sw);
        m[3 + i] = (float)(map[3 + i] * sw + 0.5 * map[6 + i] * sh);
        m[6 + i] = (float)map[6 + i];
    }
    const float width = (float)sw, height = (float)sh, step = (float)inv, first = (float)(0.5 * inv - 0.5);
    const float ry = (float)py, ry2 = ry * ry;
    /* Just below the last pixel's far side. */
    const float last_x = nextafterf(width, 0), last_y = nextafterf(height, 0);
    float *restrict sx = row->sx, *restrict sy = row->sy, *restrict cover = row->cover;
    int32_t *restrict ix = row->x, *restrict iy = row->y;
    for (size_t x = 0; x < n; x++) {
        const float px = first + step * (float)(int32_t)x, r2 = px * px + ry2;
        const float bend = 1 + r2 * (k1 + r2 * k2), qx = px * bend, qy = ry * bend;
        const float w = m[6] * qx + m[7] * qy + m[8], d = 1 / w;
        float a = (m[0] * qx + m[1] * qy + m[2]) * d, b = (m[3] * qx + m[4] * qy + m[5]) * d;
        float edge = smaller(smaller(a, width - a), smaller(b, height - b)) * per_foot + 0.5f;
        edge = w > 0 ? edge : 0; /* behind the camera */
        cover[x] = smaller(larger(edge, 0), 1);
        a = larger(smaller(a, last_x), 0), b = larger(smaller(b, last_y), 0);
        sx[x] = a, sy[x] = b;
        ix[x] = (int32_t)a, iy[x] = (int32_t)b;
    }
    const sampler near = sampler_of(t, l0), far = sampler_of(t, l1);
    float *restrict red = row->level[0], *restrict green = row->level[1], *restrict blue = row->level[2];
    for (size_t x = 0; x < n; x++) {
        quad c = sample(&near, sx[x], sy[x]);
        if (blend > 0)
            c += blend * (sample(&far, sx[x], sy[x]) - c);
        red[x] = c[0], green[x] = c[1], blue[x] = c[2];
    }
}

static void collect(const sim_render_job *job, const sim_row *row, const float *const light[3], float around,
                    float lamp, float scale, size_t y, bool first) {
    const size_t n = job->out->width;
    const float *restrict r = light[0], *restrict g = light[1], *restrict b = light[2], *restrict cover = row->cover;
    for (int c = 0; c < 3; c++) {
        float *restrict out = job->out->plane[c] + y * n;
        const float *k = job->matrix + 3 * c;
        const float kr = scale * k[0], kg = scale * k[1], kb = scale * k[2], sum = kr + kg + kb;
        const float base = sum * (around + lamp), less = sum * around;
        if (first)
            for (size_t x = 0; x < n; x++)
                out[x] = base + cover[x] * (kr * r[x] + kg * g[x] + kb * b[x] - less);
        else
            for (size_t x = 0; x < n; x++)
                out[x] += base + cover[x] * (kr * r[x] + kg * g[x] + kb * b[x] - less);
    }
}

/* ---- the lens ---- */

/* Both passes add the two neighbours at equal distance, weighted once. */
static void blur_rows(void *arg, size_t begin, size_t end, int worker) {
    const sim_lens_job *job = arg;
    const size_t width = job->light->width, reach = (size_t)job->reach;
    const float *kernel = job->kernel + reach;
    float *wide = job->lines + (size_t)worker * (width + 2 * REACH), *row = wide + reach;
    for (size_t y = begin; y < end; y++) {
        const float *in = job->light->plane[job->plane] + y * width;
        float *restrict out = job->scratch + y * width;
        memcpy(row, in, width * sizeof *row);
        for (size_t k = 0; k < reach; k++)
            wide[k] = in[0], row[width + k] = in[width - 1];
        for (size_t x = 0; x < width; x++)
            out[x] = kernel[0] * row[x];
        for (size_t k = 1; k <= reach; k++) {
            const float *restrict before = row - k, *restrict after = row + k;
            const float w = kernel[k];
            for (size_t x = 0; x < width; x++)
                out[x] += w * (before[x] + after[x]);
        }
    }
}

static void blur_columns(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const sim_lens_job *job = arg;
    const size_t width = job->light->width, height = job->light->height, reach = (size_t)job->reach;
    const float *kernel = job->kernel + reach;
    for (size_t y = begin; y < end; y++) {
        float *restrict out = job->light->plane[job->plane] + y * width;
        const float *restrict middle = job->scratch + y * width;
        for (size_t x = 0; x < width; x++)
            out[x] = kernel[0] * middle[x];
        for (size_t k = 1; k <= reach; k++) {
            const float *restrict above = job->scratch + (y > k ? y - k : 0) * width;
            const float *restrict below = job->scratch + (y + k < height ? y + k : height - 1) * width;
            const float w = kernel[k];
            for (size_t x = 0; x < width; x++)
                out[x] += w * (above[x] + below[x]);
        }
    }
}

/* The small planes' values along row y of plane c, linear between the centres of blocks and level beyond
 * the outermost. */
static void glare_line(float *restrict line, const sim_lens_job *job, size_t c, size_t y) {
    const size_t width = job->light->width, columns = job->columns;
    const float at = fminf(fmaxf(((float)y + 0.5f) / BLOCK - 0.5f, 0), (float)(job->rows - 1));
    const size_t j = (size_t)at, j1 = j + 1 < job->rows ? j + 1 : j;
    const float down = at - (float)j;
    const float *a = job->wide + (c * job->rows + j) * columns, *b = job->wide + (c * job->rows + j1) * columns;
    float left = a[0] + down * (b[0] - a[0]);
    size_t x = 0;
    for (; x < BLOCK / 2 && x < width; x++)
        line[x] = left;
    for (size_t i = 1; i < columns; i++) {
        const float right = a[i] + down * (b[i] - a[i]), slope = (right - left) / BLOCK;
        const size_t n = width - x < BLOCK ? width - x : BLOCK;
        for (size_t k = 0; k < n; k++)
            line[x + k] = left + slope * ((float)(int32_t)k + 0.5f);
        x += n;
        left = right;
    }
    for (; x < width; x++)
        line[x] = left;
}

static void finish_rows(void *arg, size_t begin, size_t end, int worker) {
    const sim_lens_job *job = arg;
    const size_t width = job->light->width, height = job->light->height;
    float *line = job->lines + (size_t)worker * (width + 2 * REACH);
    const float share = job->share, fall = 0.5f * job->vignetting, step = 2 / (float)width;
    for (size_t y = begin; y < end; y++) {
        const float v = 2 * ((float)y + 0.5f) / (float)height - 1, most = 1 - fall * v * v;
        for (size_t c = 0; c < 3; c++) {
            float *restrict p = job->light->plane[c] + y * width;
            if (share > 0) {
                glare_line(line, job, c, y);
                for (size_t x = 0; x < width; x++)
                    p[x] += share * (line[x] - p[x]);
            }
            for (size_t x = 0; x < width; x++) {
                const float u = ((float)(int32_t)x + 0.5f) * step - 1;
                p[x] *= most - fall * u * u;
            }
        }
    }
}

/* Means over blocks of one plane. */
static void average_blocks(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const sim_lens_job *job = arg;
    const size_t width = job->light->width, height = job->light->height;
    for (size_t j = begin; j < end; j++) {
        float *out = job->means + j * job->columns;
        const size_t last = (j + 1) * BLOCK < height ? (j + 1) * BLOCK : height;
        memset(out, 0, job->columns * sizeof *out);
        for (size_t y = j * BLOCK; y < last; y++) {
            const float *in = job->light->plane[job->plane] + y * width;
            for (size_t i = 0; i < job->columns; i++) {
                const size_t n = width - i * BLOCK < BLOCK ? width - i * BLOCK : BLOCK;
                float part[4] = {0}; /* four sums side by side */
                size_t x = 0;
                for (; x + 4 <= n; x += 4)
                    for (size_t k = 0; k < 4; k++)
                        part[k] += in[i * BLOCK + x + k];
                for (; x < n; x++)
                    part[0] += in[i * BLOCK + x];
                out[i] += (part[0] + part[1] + part[2] + part[3]) / (float)(n * (last - j * BLOCK));
            }
        }
    }
}

/* ---- the sensor ---- */

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

/* What a row's pixels share, by the parity of their column. */
typedef struct row_constants {
    const float *plane[2];
    float s[2], o[2], black[2], range[2];
} row_constants;

static void expose_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const sim_sensor_job *job = arg;
    brace_frame *f = job->out;
    const bool noisy = job->frame >= 0 && job->scene->noise;
    const float uneven = (float)job->scene->nonuniformity, white = f->white;
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
                normals(random, job->key, x0, y, 0, GAINS);
                for (int i = 0; i < n; i++)
                    v[i] *= 1 + uneven * random[i];
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
    .blur_rows = blur_rows,
    .blur_columns = blur_columns,
    .average_blocks = average_blocks,
    .finish_rows = finish_rows,
    .expose_rows = expose_rows,
};
