/* SPDX-License-Identifier: Apache-2.0 */
/*
 * periodic.c: banding told from a single frame, for rows in which every longer
 * frame clips: a white page on a pulsed backlight.
 *
 * Going down the rows, banding changes log light by the same step in all the
 * pixels of a row; content changes it at few of them (glyphs begin and end,
 * the paper between stays). So the median of the steps is the step of the light
 * (the argument of Weiss, Deriving intrinsic images from image sequences, ICCV
 * 2001, with pixels in the place of frames), and their running sum the log
 * gain. What remains of content in it is not periodic. The period of the light
 * is known from the ratio of this frame and a shorter one, in which content
 * cancels; the median over nearby periods is taken of the steps, the mean over
 * one period off their sum, and the result is believed as far as it repeats.
 */
#include "restore/periodic.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { FEWEST = 24 }; /* pixels that a median needs */

typedef struct periodic_job {
    const restore_view *view, *shorter;
    size_t zones;
    float *step;              /* height*zones: of this frame's log light from the row above */
    float *ratio;             /* height*zones: log of the shorter over this frame */
    uint8_t *stepped, *rated; /* whether there was enough to tell */
    v4 *paper;                /* height*zones: light of the paper, from the row's bright pixels */
    float *scratch;           /* two rows of samples for each worker */
} periodic_job;

/* The k-th smallest of a, which is reordered. */
static float select_kth(float *a, size_t n, size_t k) {
    size_t low = 0, high = n - 1;
    while (low < high) { /* Hoare's selection */
        float pivot = a[(low + high) / 2];
        size_t i = low, j = high;
        for (;;) {
            while (a[i] < pivot)
                i++;
            while (a[j] > pivot)
                j--;
            if (i >= j)
                break;
            float t = a[i];
            a[i++] = a[j], a[j--] = t;
        }
        if (a[j] > pivot)
            j--;
        if (k <= j)
            high = j;
        else
            low = j + 1;
    }
    return a[k];
}

/* Columns that tell of a zone: half the width, so that zones overlap. */
static void zone_columns(const periodic_job *job, size_t zone, size_t *first, size_t *last) {
    size_t width = job->view->light.width, reach = width / 4, centre = width * (2 * zone + 1) / (2 * job->zones);
    *first = centre > reach ? centre - reach : 0;
    *last = centre + reach < width ? centre + reach : width;
}

/* Ink is not asked: only pixels near the brightest quarter of their row. */
static void paper_rows(void *arg, size_t begin, size_t end, int worker) {
    const periodic_job *job = arg;
    const size_t width = job->view->light.width;
    float *samples = job->scratch + (size_t)worker * 8 * width;
    for (size_t y = begin; y < end; y++)
        for (size_t z = 0; z < job->zones; z++) {
            size_t first, last;
            zone_columns(job, z, &first, &last);
            for (int c = 0; c < 4; c++) {
                for (size_t x = first; x < last; x++)
                    samples[x - first] = job->view->light.at[y * width + x][c];
                size_t n = last - first;
                job->paper[y * job->zones + z][c] = 0.8f * select_kth(samples, n, n * 3 / 4);
            }
        }
}

static void profile_rows(void *arg, size_t begin, size_t end, int worker) {
    const periodic_job *job = arg;
    const restore_view *view = job->view, *shorter = job->shorter;
    const size_t width = view->light.width;
    float *steps = job->scratch + (size_t)worker * 8 * width, *ratios = steps + 4 * width;
    v4 floor_view = {0}, floor_short = {0};
    for (int c = 0; c < 4; c++) {
        floor_view[c] = 3 * sqrtf(view->noise_o[c]);
        floor_short[c] = 3 * sqrtf(shorter->noise_o[c]);
    }
    for (size_t y = begin; y < end; y++)
        for (size_t z = 0; z < job->zones; z++) {
            size_t n_steps = 0, n_ratios = 0;
            size_t first, last, k = y * job->zones + z;
            zone_columns(job, z, &first, &last);
            v4 paper = job->paper[k], paper_up = y ? job->paper[k - job->zones] : paper;
            for (size_t x = first; x < last; x++) {
                size_t i = y * width + x, up = y ? i - width : i;
                for (int c = 0; c < 4; c++) {
                    size_t t = 4 * i + (size_t)c;
                    float here = view->light.at[i][c];
                    if (view->trust[t] < 128 || here < 4 * floor_view[c])
                        continue;
                    float log_here = logf(here);
                    if (y && view->trust[4 * up + (size_t)c] >= 128 && view->light.at[up][c] > 4 * floor_view[c] &&
                        here > paper[c] && view->light.at[up][c] > paper_up[c])
                        steps[n_steps++] = log_here - logf(view->light.at[up][c]);
                    if (shorter->trust[t] >= 128 && here > paper[c] && here > 2 * floor_short[c])
                        ratios[n_ratios++] = logf(fmaxf(shorter->light.at[i][c], 0) + floor_short[c]) - log_here;
                }
            }
            job->stepped[k] = n_steps >= FEWEST;
            job->step[k] = n_steps >= FEWEST ? select_kth(steps, n_steps, n_steps / 2) : 0;
            job->rated[k] = n_ratios >= FEWEST;
            job->ratio[k] = n_ratios >= FEWEST ? select_kth(ratios, n_ratios, n_ratios / 2) : 0;
        }
}

/* The lag at which the ratio repeats, in rows, from the autocorrelation of all
 * zones together; 0 if it doesn't. */
static double find_period(const periodic_job *job, size_t height, double *lag_sum, double *lag_weight) {
    const size_t longest = height / 2;
    memset(lag_sum, 0, longest * sizeof *lag_sum);
    memset(lag_weight, 0, longest * sizeof *lag_weight);
    for (size_t z = 0; z < job->zones; z++) {
        double mean = 0, n = 0, square = 0;
        for (size_t y = 0; y < height; y++)
            if (job->rated[y * job->zones + z])
                mean += job->ratio[y * job->zones + z], n++;
        if (n < 32)
            continue;
        mean /= n;
        for (size_t y = 0; y < height; y++)
            if (job->rated[y * job->zones + z])
                square += pow(job->ratio[y * job->zones + z] - mean, 2);
        if (square / n < 0.02 * 0.02)
            continue; /* steady light */
        for (size_t lag = 0; lag < longest; lag++)
            for (size_t y = 0; y + lag < height; y++) {
                size_t a = y * job->zones + z, b = (y + lag) * job->zones + z;
                if (job->rated[a] && job->rated[b])
                    lag_sum[lag] += (job->ratio[a] - mean) * (job->ratio[b] - mean), lag_weight[lag] += 1;
            }
    }
    if (lag_weight[0] < 32)
        return 0;
    for (size_t lag = 0; lag < longest; lag++)
        lag_sum[lag] = lag_weight[lag] > 0.2 * lag_weight[0] ? lag_sum[lag] / lag_weight[lag] : -1;
    size_t start = 1;
    while (start < longest && lag_sum[start] > 0)
        start++;
    double best = 0;
    for (size_t lag = start; lag < longest; lag++)
        best = fmax(best, lag_sum[lag]);
    if (best < 0.3 * lag_sum[0])
        return 0;
    for (size_t lag = start; lag + 1 < longest; lag++) /* the first of the peaks, not a multiple of it */
        if (lag_sum[lag] > 0.8 * best && lag_sum[lag] >= lag_sum[lag - 1] && lag_sum[lag] >= lag_sum[lag + 1]) {
            double bend = lag_sum[lag - 1] - 2 * lag_sum[lag] + lag_sum[lag + 1];
            double shift = bend < 0 ? 0.5 * (lag_sum[lag - 1] - lag_sum[lag + 1]) / bend : 0;
            return (double)lag + shift;
        }
    return 0;
}

/* a at a fractional position inside [0, n). */
static double at(const double *a, size_t n, double x) {
    if (x <= 0)
        return a[0];
    if (x >= (double)(n - 1))
        return a[n - 1];
    size_t i = (size_t)x;
    return a[i] + (x - (double)i) * (a[i + 1] - a[i]);
}

/* Cycles of the light up to each row of one zone, from the phase of the ratio
 * about each row (its product with exp(-2 pi i y/period) under a Hann window
 * three periods long): stripes of a tilted screen or of a panel that scans its
 * rows come at a rate that changes over the picture. Increasing in y. */
static void count_cycles(double *cycles, const periodic_job *job, size_t zone, size_t height, double period) {
    const double turn = 6.283185307179586;
    const ptrdiff_t reach = (ptrdiff_t)(1.5 * period) + 1;
    double mean = 0, n = 0, last = 0;
    for (size_t y = 0; y < height; y++)
        if (job->rated[y * job->zones + zone])
            mean += job->ratio[y * job->zones + zone], n++;
    mean /= n > 0 ? n : 1;
    for (size_t y = 0; y < height; y++) {
        double re = 0, im = 0, weight = 0;
        for (ptrdiff_t d = -reach; d <= reach; d++) {
            ptrdiff_t i = (ptrdiff_t)y + d;
            if (i < 0 || i >= (ptrdiff_t)height || !job->rated[(size_t)i * job->zones + zone])
                continue;
            double w = 1 + cos(turn * 0.5 * (double)d / (double)(reach + 1));
            double r = job->ratio[(size_t)i * job->zones + zone] - mean, angle = turn * (double)i / period;
            re += w * r * cos(angle), im -= w * r * sin(angle), weight += w;
        }
        /* Where the ratio is silent, the phase runs on at the period's rate. */
        double shift = weight > 0.5 * (double)reach && hypot(re, im) > 0.02 * weight ? -atan2(im, re) / turn : last;
        if (y) {
            shift += floor(last - shift + 0.5);
            shift = fmin(fmax(shift, last - 0.3 / period), last + 0.3 / period);
        }
        cycles[y] = (double)y / period - shift;
        last = shift;
    }
}

/* The row, between rows, by which so many cycles have passed; may lie outside. */
static double row_of(const double *cycles, size_t n, double wanted, double period) {
    if (wanted <= cycles[0])
        return (wanted - cycles[0]) * period;
    if (wanted >= cycles[n - 1])
        return (double)(n - 1) + (wanted - cycles[n - 1]) * period;
    size_t low = 0, high = n - 1;
    while (high - low > 1) {
        size_t middle = (low + high) / 2;
        if (cycles[middle] <= wanted)
            low = middle;
        else
            high = middle;
    }
    return (double)low + (wanted - cycles[low]) / (cycles[high] - cycles[low]);
}

/* Takes from in[0..n) its mean over one cycle about each place, or divides by
 * it; the window is pushed inside at the ends. `sum` is scratch of n + 1. */
static void remove_cycle_mean(double *out, const double *in, size_t n, const double *cycles, double period, double *sum,
                              bool divide) {
    sum[0] = 0;
    for (size_t i = 0; i < n; i++)
        sum[i + 1] = sum[i] + in[i];
    for (size_t i = 0; i < n; i++) {
        double from = row_of(cycles, n, cycles[i] - 0.5, period) + 0.5;
        double to = row_of(cycles, n, cycles[i] + 0.5, period) + 0.5;
        if (to > (double)n)
            from -= to - (double)n, to = (double)n;
        if (from < 0)
            to = fmin(to - from, (double)n), from = 0;
        double mean = (at(sum, n + 1, to) - at(sum, n + 1, from)) / (to - from);
        out[i] = divide ? in[i] / mean : in[i] - mean;
    }
}

/* What a run of rows says of repetition: products and squares of steps a cycle apart. */
typedef struct repetition {
    double product, square;
} repetition;

/* One zone, one run of n rows without gaps. `a`, `b` and `sum` are scratch. */
static void periodic_run(float *gain, const float *step, size_t stride, size_t n, const double *cycles, double period,
                         double *a, double *b, double *sum, repetition *rep) {
    /* Edges of windows and pages, which cross the whole row, are steps far larger than the usual. */
    double usual = 0;
    for (size_t i = 1; i < n; i++)
        usual += fabs(step[i * stride]) / (double)(n - 1);
    for (size_t i = 0; i < n; i++)
        a[i] = i ? fmin(fmax(step[i * stride], -4 * usual), 4 * usual) : 0;
    /* The light steps the same way cycle after cycle: the median over nearby ones is its step. */
    double level = 0;
    for (size_t i = 0; i < n; i++) {
        float near[9];
        size_t count = 0;
        for (int k = -4; k <= 4; k++) {
            double place = row_of(cycles, n, cycles[i] + k, period);
            if (place < 0 || place > (double)(n - 1))
                continue;
            double value = at(a, n, place);
            near[count++] = (float)value;
            if (k == 1) {
                rep->product += a[i] * value;
                rep->square += 0.5 * (a[i] * a[i] + value * value);
            }
        }
        float middle = select_kth(near, count, count / 2);
        if (count % 2 == 0)
            middle = 0.5f * (middle + select_kth(near, count, count / 2 - 1));
        b[i] = level += i ? middle : 0;
    }
    remove_cycle_mean(a, b, n, cycles, period, sum, false);
    for (size_t i = 0; i < n; i++)
        a[i] = exp(a[i]);
    remove_cycle_mean(b, a, n, cycles, period, sum, true);
    for (size_t i = 0; i < n; i++)
        gain[i * stride] = (float)b[i];
}

/* Rows with too little to tell take the gain of a row that told, a whole number
 * of cycles away (at most three). Rows that told are > 0, the others 0. */
static void extend_cycles(float *gain, size_t stride, size_t height, const double *cycles, double period) {
    for (size_t y = 0; y < height; y++) {
        float *here = &gain[y * stride];
        for (int k = 1; k <= 3 && *here == 0; k++)
            for (int sign = -1; sign <= 1 && *here == 0; sign += 2) {
                double place = row_of(cycles, height, cycles[y] + sign * k, period);
                if (place < 0 || place > (double)(height - 2))
                    continue;
                size_t i = (size_t)place;
                float a = gain[i * stride], b = gain[(i + 1) * stride];
                if (a > 0 && b > 0)
                    *here = -(a + (float)(place - (double)i) * (b - a)); /* not to be copied again */
            }
    }
    for (size_t y = 0; y < height; y++)
        gain[y * stride] = fabsf(gain[y * stride]);
}

brace_status restore_periodic(float *gain, double *found, const restore_view *view, const restore_view *shorter,
                              core_pool *pool, brace_error *error) {
    const size_t height = view->light.height, width = view->light.width, zones = (size_t)view->zones;
    const size_t n = height * zones;
    *found = 0;
    for (size_t i = 0; i < n; i++)
        gain[i] = 1;
    if (!shorter || height < 32 || width < 64)
        return BRACE_OK;
    periodic_job job = {.view = view, .shorter = shorter, .zones = zones};
    job.step = core_alloc(n, sizeof(float)), job.ratio = core_alloc(n, sizeof(float));
    job.paper = core_alloc(n, sizeof(v4)), job.stepped = core_alloc(n, 1), job.rated = core_alloc(n, 1);
    job.scratch = core_alloc((size_t)core_pool_threads(pool) * 8 * width, sizeof(float));
    double *scratch = core_alloc(4 * (height + 1), sizeof(double)), *cycles = scratch + 3 * (height + 1);
    brace_status status = BRACE_OK;
    if (!job.paper || !job.step || !job.ratio || !job.stepped || !job.rated || !job.scratch || !scratch) {
        status = core_fail_memory(error, n * 26, "measuring the light");
        goto done;
    }
    core_parallel(pool, height, 4, paper_rows, &job);
    core_parallel(pool, height, 4, profile_rows, &job);
    double period = find_period(&job, height, scratch, scratch + height + 1);
    if (period < 4)
        goto done;

    repetition rep = {0, 0};
    memset(gain, 0, n * sizeof *gain);
    for (size_t z = 0; z < zones; z++) {
        count_cycles(cycles, &job, z, height, period);
        for (size_t y = 0; y < height;) {
            size_t end = y + 1; /* the first row of a run needs no step */
            while (end < height && job.stepped[end * zones + z])
                end++;
            if ((double)(end - y) >= 1.6 * period)
                periodic_run(gain + y * zones + z, job.step + y * zones + z, zones, end - y, cycles + y, period,
                             scratch, scratch + height + 1, scratch + 2 * (height + 1), &rep);
            y = end;
        }
        extend_cycles(gain + z, zones, height, cycles, period);
    }
    /* What repeats is banding, the rest content; of content, as sparse as edges
     * are, the median of nine keeps some hundredths of the power, and Wiener's
     * share of the sum is believed. Little repetition can be chance. */
    double repeats = rep.square > 0 ? rep.product / rep.square : 0;
    double chance = fmin(fmax((repeats - 0.2) / 0.2, 0), 1);
    *found = chance > 0 ? chance * repeats / (repeats + 0.02 * (1 - repeats)) : 0;
    /* What is still open: the nearest zone that knows, or steady light. */
    for (size_t y = 0; y < height; y++) {
        float *g = gain + y * zones;
        for (size_t z = 0; z < zones; z++)
            for (size_t d = 1; d < zones && g[z] == 0; d++) {
                if (z >= d && g[z - d] > 0)
                    g[z] = -g[z - d];
                else if (z + d < zones && g[z + d] > 0)
                    g[z] = -g[z + d];
            }
    }
    for (size_t i = 0; i < n; i++)
        gain[i] = gain[i] == 0 ? 1 : powf(fabsf(gain[i]), (float)*found);
done:
    core_free(job.step), core_free(job.ratio), core_free(job.stepped), core_free(job.rated);
    core_free(job.scratch), core_free(job.paper), core_free(scratch);
    return status;
}
