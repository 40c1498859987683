/* SPDX-License-Identifier: Apache-2.0 */
/*
 * consensus.c: banding told from one frame alone, by agreement.
 *
 * Banding multiplies all pixels of a row by one gain, whatever they show: blank
 * paper, text and photographs alike carry the same wave. Content does not: it
 * changes few pixels of a row at a time, and not everywhere in the same way. So
 * the frame is cut into strips of columns and segments of rows. Each strip gives
 * its light's steps over a few rows, the median over its brightest pixels (Weiss,
 * Deriving intrinsic images from image sequences, ICCV 2001, with pixels in the
 * place of frames), less what they disagree by. At each frequency every block of
 * strip and segment then has a wave with a phase of its own, and blocks vote: one
 * block one vote, however strong its content. Phases that advance evenly from
 * strip to strip are a slant.
 */
#include "banding/consensus.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "raw/isp.h"

enum {
    STRIPS = 32,      /* of columns */
    ACROSS = 16,      /* pixels of a strip, at most */
    SEGMENTS = 6,     /* of rows, at most: of a period and a half or more */
    LAGS = 10,        /* steps are taken over 1, 2, 4, ... rows */
    PHASES = 128,     /* of a slant, over one strip; a power of two */
    LEVELS = 48,      /* places along a strip whose brightness is told */
    FEWEST_STRIPS = 4
};

/* Samples nearer to white than this may be clipped. */
static const float clipped = 0.95f;

/* Periods of the frame that are looked for at least; slants in columns a row: a display is held that straight. */
static const double fewest_cycles = 1.5, steepest = 0.16;

typedef struct consensus_job {
    const brace_frame *frame;
    size_t rows, strips, across; /* of the reduced picture */
    size_t bin_x, bin_y;         /* packed pixels that became one */
    size_t lags;
    double noise_s, noise_o;     /* of a reduced pixel, green */
    float *pixels;               /* rows*strips*across; below -1 where one clips */
    float *level;                /* rows*strips: of the bright pixels, 1 where they clip */
    float *scale, *noise;        /* rows*strips: brightness about here; deviation of a pixel over it */
    float *step;                 /* lags*rows*strips: of the light, over the scale; NAN where not known */
    double *cycles;              /* periods in the frame that are tried */
    double cosine[PHASES], sine[PHASES];
    banding_consensus *found;    /* one for each of them */
} consensus_job;

/* The k-th smallest of n, which are reordered. n is small. */
static float small_select(float *a, size_t n, size_t k) {
    for (size_t i = 1; i < n; i++) {
        const float v = a[i];
        size_t j = i;
        for (; j > 0 && a[j - 1] > v; j--)
            a[j] = a[j - 1];
        a[j] = v;
    }
    return a[k];
}

static int by_float(const void *a, const void *b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static void reduce_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const consensus_job *job = arg;
    const brace_frame *f = job->frame;
    const float share = 1 / (float)(4 * job->bin_x * job->bin_y);
    float gain[4];
    for (int c = 0; c < 4; c++)
        gain[c] = 1 / (f->white - f->black[c]);
    for (size_t y = begin; y < end; y++)
        for (size_t x = 0; x < job->strips * job->across; x++) {
            float sum = 0, most = 0;
            for (size_t j = 2 * y * job->bin_y; j < 2 * (y + 1) * job->bin_y; j++) {
                const uint16_t *in = f->data + j * f->width;
                for (size_t i = 2 * x * job->bin_x; i < 2 * (x + 1) * job->bin_x; i++) {
                    const size_t c = j % 2 * 2 + i % 2;
                    const float s = ((float)in[i] - f->black[c]) * gain[c];
                    sum += s, most = s > most ? s : most;
                }
            }
            job->pixels[y * job->strips * job->across + x] = most < clipped ? fmaxf(sum * share, -0.5f) : -2;
        }
}

static void level_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const consensus_job *job = arg;
    for (size_t i = begin * job->strips; i < end * job->strips; i++) {
        float sorted[ACROSS];
        memcpy(sorted, job->pixels + i * job->across, job->across * sizeof *sorted);
        const float level = small_select(sorted, job->across, job->across * 3 / 4);
        job->level[i] = level > -1 ? level : 1;
    }
}

/* Brightness about each row: the ninth decile over a quarter of the frame's height, so that dark phases of
 * the light do not count as dark content. */
static void scale_strips(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    consensus_job *job = arg;
    for (size_t z = begin; z < end; z++) {
        float at[LEVELS], *sorted = job->scale + z * job->rows; /* used as scratch first, column by column */
        const size_t half = job->rows / 8 + 1;
        for (size_t k = 0; k < LEVELS; k++) {
            const size_t centre = (2 * k + 1) * job->rows / (2 * LEVELS), low = centre > half ? centre - half : 0;
            size_t n = 0;
            for (size_t y = low; y < job->rows && y <= centre + half; y++)
                sorted[n++] = job->level[y * job->strips + z];
            qsort(sorted, n, sizeof *sorted, by_float);
            at[k] = sorted[n * 9 / 10];
        }
        for (size_t y = 0; y < job->rows; y++) {
            const float here = at[y * LEVELS / job->rows];
            const float noise = (float)sqrt(fmax(job->noise_s * here + job->noise_o, 0) + 1e-9);
            sorted[y] = fmaxf(here, noise);
            job->noise[z * job->rows + y] = noise / sorted[y];
        }
    }
}

/* The step of a strip's light from row y - lag to row y: the median over its bright pixels, less the distance of their
 * quartiles as far as noise does not explain it. */
static float strip_step(const consensus_job *job, size_t y, size_t z, size_t lag) {
    const float *here = job->pixels + (y * job->strips + z) * job->across;
    const float *above = here - lag * job->strips * job->across;
    float sum[ACROSS], step[ACROSS], sorted[ACROSS];
    size_t n = 0;
    for (size_t x = 0; x < job->across; x++)
        if (here[x] > -1 && above[x] > -1)
            sum[n] = sorted[n] = here[x] + above[x], step[n++] = here[x] - above[x];
    const size_t fewest = job->across * 3 / 8 > 2 ? job->across * 3 / 8 : 2;
    if (n < fewest)
        return NAN;
    const float paper = 0.7f * small_select(sorted, n, n * 3 / 4);
    size_t bright = 0;
    for (size_t x = 0; x < n; x++)
        if (sum[x] >= paper)
            step[bright++] = step[x];
    if (bright < fewest)
        return NAN;
    const float median = 0.5f * (small_select(step, bright, bright / 2) + step[(bright - 1) / 2]);
    const float scale = job->scale[z * job->rows + y], noise = job->noise[z * job->rows + y] * scale;
    const size_t quarter = (bright - 1) / 4;
    const float apart = step[bright - 1 - quarter] - step[quarter];
    /* Of noise alone the quartiles lie 1.35 deviations apart, and a step has twice a pixel's variance. */
    const float expected = 1.35f * 1.41f * noise, differ = sqrtf(fmaxf(apart * apart - 1.2f * expected * expected, 0));
    return copysignf(fmaxf(fabsf(median) - differ, 0), median) / scale;
}

static void step_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const consensus_job *job = arg;
    for (size_t i = begin; i < end; i++) {
        const size_t k = i / job->rows, y = i % job->rows, lag = (size_t)1 << k;
        for (size_t z = 0; z < job->strips; z++)
            job->step[(k * job->strips + z) * job->rows + y] = y >= lag ? strip_step(job, y, z, lag) : NAN;
    }
}

/* Steps of one strip without their mean; none counts more than three usual ones: edges are rare. */
static void clip_steps(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const consensus_job *job = arg;
    for (size_t i = begin; i < end; i++) {
        float *step = job->step + i * job->rows;
        double usual = 0, mean = 0;
        size_t n = 0;
        for (size_t y = 0; y < job->rows; y++)
            if (!isnan(step[y]))
                usual += fabsf(step[y]), n++;
        const float most = n > 0 ? (float)(3 * usual / (double)n) : 0;
        for (size_t y = 0; y < job->rows; y++)
            if (!isnan(step[y]))
                step[y] = fminf(fmaxf(step[y], -most), most), mean += step[y] / (double)n;
        for (size_t y = 0; y < job->rows; y++)
            step[y] -= (float)mean;
    }
}

/* Logarithm of the odds: fitted to simulated captures (docs/banding.md). */
static double odds_of(const banding_consensus *c) {
    const double amplitude = fmax(c->amplitude, 1e-3);
    return -0.48 + 1.24 * log(amplitude) + 0.69 * log(c->periods) - 0.48 * log(fmax(1 - c->locked, 0.02)) -
           1.13 * log(fmin(fmax(c->even, 0.1), 6)) + 2.36 * fmax(c->quarter, 0) / amplitude;
}

typedef struct block_waves {
    banding_complex wave[SEGMENTS][STRIPS];
    float vote[SEGMENTS][STRIPS]; /* what the wave's amplitude is divided by for its vote; 0: the block tells nothing */
} block_waves;

static void measure_blocks(block_waves *b, const consensus_job *job, double frequency, size_t segments, size_t k) {
    const size_t rows = job->rows, lag = (size_t)1 << k;
    const double gain = 2 * sin(M_PI * fmin(frequency * (double)lag, 0.5));
    for (size_t g = 0; g < segments; g++) {
        const size_t first = g * rows / segments, last = (g + 1) * rows / segments, n = last - first;
        double re[STRIPS] = {0}, im[STRIPS] = {0}, window[STRIPS] = {0}, noise[STRIPS] = {0};
        size_t known[STRIPS] = {0};
        for (size_t y = first; y < last; y++) {
            const double turn = 2 * M_PI * frequency * (double)y, c = cos(turn), s = sin(turn);
            const double w = 0.5 - 0.5 * cos(2 * M_PI * (double)(y - first + 1) / (double)(n + 1));
            for (size_t z = 0; z < job->strips; z++) {
                const float step = job->step[(k * job->strips + z) * rows + y];
                noise[z] += job->noise[z * rows + y];
                if (!isnan(step))
                    re[z] += w * step * c, im[z] -= w * step * s, window[z] += w, known[z]++;
            }
        }
        for (size_t z = 0; z < job->strips; z++) {
            const bool tells = (double)known[z] > 0.4 * (double)n && window[z] > 0;
            const double scale = tells ? 2 / (window[z] * gain) : 0;
            b->wave[g][z] = (banding_complex){(float)(re[z] * scale), (float)(im[z] * scale)};
            /* A vote counts by how far it stands above the noise of such a wave: a median of half the pixels (its
             * deviation is 1.25 times a mean's), two pixels a step, a Hann window (1.5 times the variance). */
            const double pixels = 0.5 * (double)job->across;
            const double deviation = noise[z] / (double)n * 1.25 * sqrt(2 * 1.5 * 2 / (pixels * fmax((double)known[z], 1)));
            b->vote[g][z] = tells ? (float)(hypot(b->wave[g][z].re, b->wave[g][z].im) + deviation / gain + 0.004) : 0;
        }
    }
}

/* The vote on one frequency. */
static void vote(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const consensus_job *job = arg;
    for (size_t i = begin; i < end; i++) {
        banding_consensus *out = &job->found[i];
        const double cycles = job->cycles[i], frequency = cycles / (double)job->rows;
        size_t k = 0; /* steps over about a third of a period are large, but cross few edges */
        while (k + 1 < job->lags && frequency * ldexp(1, (int)k) * M_SQRT2 < 0.35)
            k++;
        const size_t segments = (size_t)fmin(fmax(round(cycles / 1.5), 1), SEGMENTS);
        block_waves b;
        measure_blocks(&b, job, frequency, segments, k);
        double weight[SEGMENTS] = {0}, weights = 0, votes = 0;
        for (size_t g = 0; g < segments; g++) {
            for (size_t z = 0; z < job->strips; z++)
                weight[g] += b.vote[g][z] > 0;
            weights += weight[g] * weight[g], votes += weight[g];
        }
        if (votes < fmax(6, 0.2 * (double)(segments * job->strips)))
            continue;
        const double strip_rows = (double)(job->across * job->bin_x) / (double)job->bin_y;
        const long reach = (long)fmin(PHASES / 2 - 1, (steepest * frequency * strip_rows) * PHASES + 1);
        double best = -1;
        long at = 0;
        double phase[SEGMENTS][2] = {{0}};
        for (long s = -reach; s <= reach; s++) {
            double power = 0, sum[SEGMENTS][2];
            for (size_t g = 0; g < segments; g++) {
                double re = 0, im = 0;
                for (size_t z = 0; z < job->strips; z++)
                    if (b.vote[g][z] > 0) {
                        const size_t turn = (size_t)(-s * (long)z) & (PHASES - 1);
                        const double c = job->cosine[turn], d = job->sine[turn], v = 1 / b.vote[g][z];
                        re += v * (b.wave[g][z].re * c - b.wave[g][z].im * d);
                        im += v * (b.wave[g][z].re * d + b.wave[g][z].im * c);
                    }
                sum[g][0] = re, sum[g][1] = im, power += re * re + im * im;
            }
            if (power > best)
                best = power, at = s, memcpy(phase, sum, segments * sizeof *sum);
        }
        float part[SEGMENTS * STRIPS];
        double mean = 0, square = 0;
        size_t n = 0;
        for (size_t g = 0; g < segments; g++) {
            const double length = hypot(phase[g][0], phase[g][1]) + 1e-9;
            for (size_t z = 0; z < job->strips; z++)
                if (b.vote[g][z] > 0) {
                    const size_t turn = (size_t)(-at * (long)z) & (PHASES - 1);
                    const double c = job->cosine[turn], d = job->sine[turn];
                    const double re = b.wave[g][z].re * c - b.wave[g][z].im * d;
                    const double im = b.wave[g][z].re * d + b.wave[g][z].im * c;
                    part[n++] = (float)((re * phase[g][0] + im * phase[g][1]) / length);
                }
        }
        qsort(part, n, sizeof *part, by_float);
        for (size_t j = 0; j < n; j++)
            mean += part[j] / (double)n;
        for (size_t j = 0; j < n; j++)
            square += (part[j] - mean) * (part[j] - mean) / (double)n;
        out->frequency = frequency / (double)job->bin_y;
        out->slant = (double)at / PHASES / (double)(job->across * job->bin_x);
        out->periods = cycles;
        out->amplitude = part[n / 2], out->quarter = part[n / 4];
        out->locked = sqrt(best / weights);
        out->even = mean / (sqrt(square) + 0.003);
        out->odds = odds_of(out);
    }
}

/* Finer steps where stripes are few: the frame is so many periods high. */
static size_t tried(double *cycles, size_t rows) {
    size_t n = 0;
    for (double c = fewest_cycles; c < 0.25 * (double)rows; c += c < 20 ? 0.25 : c < 60 ? 0.5 : 1) {
        if (cycles)
            cycles[n] = c;
        n++;
    }
    return n;
}

brace_status banding_consensus_frame(banding_consensus *out, const brace_frame *frame, core_pool *pool,
                                     brace_error *error) {
    *out = (banding_consensus){.odds = -INFINITY};
    brace_status status = raw_check_frame(frame, error);
    if (status != BRACE_OK)
        return status;
    consensus_job job = {.frame = frame};
    const size_t columns = frame->width / 2, rows = frame->height / 2;
    job.bin_x = (columns + STRIPS * ACROSS - 1) / (STRIPS * ACROSS);
    job.bin_x = job.bin_x > 0 ? job.bin_x : 1;
    job.bin_y = rows / 512 > 1 ? rows / 512 : 1;
    job.rows = rows / job.bin_y;
    const size_t wide = columns / job.bin_x;
    job.strips = wide / 8 < STRIPS ? wide / 8 : STRIPS;
    job.across = job.strips > 0 ? wide / job.strips : 0;
    job.across = job.across < ACROSS ? job.across : ACROSS;
    if (job.strips < FEWEST_STRIPS || job.rows < 24)
        return BRACE_OK;
    while (job.lags < LAGS && ((size_t)1 << job.lags) * 20 <= job.rows)
        job.lags++;
    const double pixels = 4.0 * (double)(job.bin_x * job.bin_y);
    job.noise_s = frame->noise[1][0] / pixels, job.noise_o = frame->noise[1][1] / pixels;
    for (int k = 0; k < PHASES; k++)
        job.cosine[k] = cos(2 * M_PI * k / PHASES), job.sine[k] = sin(2 * M_PI * k / PHASES);
    const size_t blocks = job.rows * job.strips, count = tried(NULL, job.rows);
    job.pixels = core_alloc(blocks * job.across, sizeof(float));
    job.level = core_alloc(blocks * (3 + job.lags), sizeof(float));
    job.cycles = core_alloc(count, sizeof *job.cycles);
    job.found = core_calloc(count, sizeof *job.found);
    if (job.pixels && job.level && job.cycles && job.found) {
        job.scale = job.level + blocks, job.noise = job.scale + blocks, job.step = job.noise + blocks;
        tried(job.cycles, job.rows);
        core_parallel(pool, job.rows, 8, reduce_rows, &job);
        core_parallel(pool, job.rows, 8, level_rows, &job);
        core_parallel(pool, job.strips, 1, scale_strips, &job);
        core_parallel(pool, job.lags * job.rows, 8, step_rows, &job);
        core_parallel(pool, job.lags * job.strips, 1, clip_steps, &job);
        core_parallel(pool, count, 4, vote, &job);
        for (size_t i = 0; i < count; i++)
            if (job.found[i].periods > 0 && job.found[i].odds > out->odds)
                *out = job.found[i];
    } else
        status = core_fail_memory(error, blocks * job.across * sizeof(float), "the rows' light");
    core_free(job.pixels), core_free(job.level), core_free(job.cycles), core_free(job.found);
    return status;
}
