/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sensor.c: light to raw numbers: the mosaic picks one colour a pixel, photons
 * and electronics add noise of variance S x + O (DNG NoiseProfile), the well
 * clips at 1, and the converter rounds between black and white.
 *
 * Rows are done in pieces, each step one loop over a piece without branches or
 * calls, which compilers turn into vector instructions. Only operations that
 * IEEE 754 defines exactly: the same bytes on every machine.
 */
#include <math.h>
#include <string.h>

#include "sim/simulate.h"

enum { NOISE = 3, GAINS = 4 };           /* purposes of random streams */
enum { QUADS = 64, PIECE = 4 * QUADS };  /* a draw of the generator serves four pixels */

typedef struct expose_job {
    brace_frame *out;
    const sim_light *light;
    const sim_scene *scene;
    int frame;
    uint32_t key[2];
} expose_job;

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
    const float s = f * (1.57079633f + t * (-0.645964098f + t * (0.0796926262f + t * (-0.00468175413f + t * 1.60441e-4f))));
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
    const expose_job *job = arg;
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

void sim_expose(brace_frame *out, const sim_light *light, const sim_scene *scene, int frame, core_pool *pool) {
    expose_job job = {out, light, scene, frame, {(uint32_t)scene->seed, (uint32_t)(scene->seed >> 32)}};
    core_parallel(pool, out->height, 16, expose_rows, &job);
}
