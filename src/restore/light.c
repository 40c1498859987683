/* SPDX-License-Identifier: Apache-2.0 */
/*
 * light.c: how much light the display gave while each row of each frame was
 * exposed, relative to its mean.
 *
 * The exposure ladder. A frame's banding fades as its exposure grows, so the
 * longest frame is taken as steady and each shorter one is measured against
 * the picture that all longer ones make together, wherever those don't clip:
 * the ratio of the two has no content in it, only the gain of the light. Where
 * a row shares its light (backlights, row-scanned panels), that gain also holds
 * for the row's pixels that only the shorter frame recorded, and is divided out
 * there. How far rows, zones of a row and colours share their light is itself
 * measured: estimates are shrunk towards the coarser level by empirical Bayes.
 *
 * A longer frame may also be blurred by the hand, and lines of text smeared over
 * rows look like banding. So each frame is compared with the next shorter one
 * too, as they are: light that was unsteady during an exposure was no steadier
 * during a shorter one at another time, and must show as a difference of the two.
 * What does not is not believed. Where three in a row agree at different times, light was steady, whatever little a longer
 * one measured there.
 *
 * Rows in which every longer frame clips altogether (a white page) are left to
 * periodic.c.
 */
#include <math.h>
#include <string.h>

#include "restore/internal.h"
#include "restore/periodic.h"

enum { HISTOGRAM = 512, RUN = 16 };

/* Content that two frames cannot agree on better than this, from misalignment. */
static const float texture = 0.05f;

/* How far, in pixels, edges may be misplaced between frames. */
static const float misplaced = 0.5f;

/* Residuals of neighbouring pixels go together: so much of the nominal information is real. */
static const double independent = 0.3;

typedef struct light_job {
    restore_view *view;
    restore_picture *sum, *weight; /* of the longer frames */
    const restore_view *longer;    /* the next longer one */
    const float *bright;           /* typical light around each row */
    v4 *above, *below;             /* a row and zone: sums of w Y L and of w L^2 */
    v4 *gain_rows;                 /* a row for each worker */
    uint32_t (*histogram)[HISTOGRAM];
    float *ratio;                  /* of each frame to the next longer one as they are, row by zone; 0: not told */
} light_job;

static v4 light_trust(const uint8_t *trust, v4 weight) {
    v4 t = v4_trust(trust);
    for (int c = 0; c < 4; c++)
        if (!(weight[c] > 0))
            t[c] = 0;
    return t;
}

static v4 light_divide(v4 a, v4 b) {
    for (int c = 0; c < 4; c++)
        a[c] = b[c] > 0 ? a[c] / b[c] : 0;
    return a;
}

/* The longer frames' picture; takes the trust of what they don't know. */
static v4 longer_at(const light_job *job, size_t i, v4 *trust) {
    v4 weight = job->weight->at[i];
    for (int c = 0; c < 4; c++)
        if (!(weight[c] > 0))
            (*trust)[c] = 0;
    return light_divide(job->sum->at[i], weight);
}

/* The regression of a frame on the longer ones, zone by zone. */
static void measure_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const light_job *job = arg;
    const restore_view *view = job->view;
    const size_t width = view->light.width, height = view->light.height, zones = (size_t)view->zones;
    const float scale = (float)zones / (float)width;
    for (size_t y = begin; y < end; y++) {
        v4 *above = job->above + y * zones, *below = job->below + y * zones;
        memset(above, 0, zones * sizeof(v4));
        memset(below, 0, zones * sizeof(v4));
        float floor_y = texture * job->bright[y];
        for (size_t x = 0; x < width; x++) {
            size_t i = y * width + x;
            v4 trust = light_trust(view->trust + 4 * i, job->weight->at[i]);
            if (v4_sum(trust) == 0)
                continue;
            size_t left = x ? i - 1 : i, right = x + 1 < width ? i + 1 : i;
            size_t up = y ? i - width : i, down = y + 1 < height ? i + width : i;
            v4 longer = v4_max(longer_at(job, i, &trust), v4_set(0));
            v4 gx = longer_at(job, right, &trust) - longer_at(job, left, &trust);
            v4 gy = longer_at(job, down, &trust) - longer_at(job, up, &trust);
            v4 fuzzy = v4_set(texture) * longer, edge = (gx * gx + gy * gy) * v4_set(0.25f * misplaced * misplaced);
            v4 variance =
                edge + view->noise_s * longer + view->noise_o + fuzzy * fuzzy + v4_set(floor_y * floor_y + 1e-12f);
            v4 w = trust / variance, a = w * view->light.at[i] * longer, b = w * longer * longer;
            float g = ((float)x + 0.5f) * scale - 0.5f;
            g = g < 0 ? 0 : g > (float)(zones - 1) ? (float)(zones - 1) : g;
            size_t z = (size_t)g;
            float f = g - (float)z;
            above[z] += v4_set(1 - f) * a, below[z] += v4_set(1 - f) * b;
            if (z + 1 < zones)
                above[z + 1] += v4_set(f) * a, below[z + 1] += v4_set(f) * b;
        }
    }
}

/* Variance of gains beyond what their errors explain: what is to be believed. */
static double spread(double squares, double weights, double errors) {
    double v = weights > 0 ? (squares - errors) / weights : 0;
    return v < 1e-8 ? 1e-8 : v > 1 ? 1 : v; /* light pulses, but its mean is 1 */
}

/* Light has a mean of 1. Gains that don't were measured against a frame that
 * is not aligned or shows something else: then nothing was measured. */
static void drop_nonsense(light_job *job) {
    const size_t zones = (size_t)job->view->zones, height = job->view->light.height;
    double sum = 0, weight = 0;
    for (size_t y = 0; y < height; y++) {
        double a = 0, b = 0;
        for (size_t z = 0; z < zones; z++)
            a += v4_sum(job->above[y * zones + z]), b += v4_sum(job->below[y * zones + z]);
        double sure = b / (b + 100); /* every row that tells counts about the same */
        sum += b > 0 ? sure * fmin(a / b, 8) : 0, weight += b > 0 ? sure : 0;
    }
    double mean = weight > 0 ? sum / weight : 1;
    if (mean > 0.6 && mean < 1.6)
        return;
    memset(job->above, 0, height * zones * sizeof(v4));
    memset(job->below, 0, height * zones * sizeof(v4));
}

/* Frames whose ratios are further from 1 than this don't agree: those of the longest of three and the other two's. */
static const float unlike = 0.15f, more_unlike = 0.22f;

/* Agreement is never better than this. */
static const float finest = 0.02f;

/* Said of frame i as a measurement of 1, as sure as it and the two frames before it agree. What longer frames say may be
 * of a dark wall beside a bright display, which has other light and is all that doesn't clip. */
static void add_agreement(light_job *job, size_t i) {
    const size_t cells = (size_t)job->view->zones * job->view->light.height;
    const float *near = job->ratio + (i - 1) * cells, *far = near - cells;
    for (size_t k = 0; k < cells; k++) {
        const float a = near[k] - 1, b = far[k] - 1;
        if (near[k] > 0 && far[k] > 0 && fabsf(a) < unlike && fabsf(b) < more_unlike) {
            const float sure = 1 / (a * a + b * b + finest * finest);
            const v4 each = v4_set(0.25f / (float)independent * sure); /* of four samples, discounted as measured ones are */
            job->above[k] += each, job->below[k] += each;
        }
    }
}

/* How far rows differ from 1, zones from their row and colours from their zone, as variances. */
typedef struct light_spread {
    double row, zone, color;
} light_spread;

static double light_row(const light_job *job, size_t y, double *below) {
    const size_t zones = (size_t)job->view->zones;
    double a = 0, b = 0;
    for (size_t z = 0; z < zones; z++)
        a += v4_sum(job->above[y * zones + z]), b += v4_sum(job->below[y * zones + z]);
    *below = independent * b;
    return independent * a;
}

static light_spread light_spreads(const light_job *job) {
    const size_t height = job->view->light.height, zones = (size_t)job->view->zones;
    double sq[3] = {0}, wt[3] = {0}, er[3] = {0};
    for (size_t y = 0; y < height; y++) {
        double b, a = light_row(job, y, &b);
        if (!(b > 0))
            continue;
        const double row = a / b;
        sq[0] += b * (row - 1) * (row - 1), wt[0] += b, er[0] += 1;
        for (size_t z = 0; z < zones; z++) {
            const v4 above = job->above[y * zones + z], below = job->below[y * zones + z];
            const double bz = independent * v4_sum(below);
            if (!(bz > 0))
                continue;
            const double zone = independent * v4_sum(above) / bz;
            sq[1] += bz * (zone - row) * (zone - row), wt[1] += bz, er[1] += 1;
            for (int c = 0; c < 4; c++) {
                const double bc = independent * below[c];
                if (!(bc > 0))
                    continue;
                const double d = independent * above[c] / bc - zone;
                sq[2] += bc * d * d, wt[2] += bc, er[2] += 1;
            }
        }
    }
    return (light_spread){spread(sq[0], wt[0], er[0]), spread(sq[1], wt[1], er[1]), spread(sq[2], wt[2], er[2])};
}

/* Turns the sums into gains, coarse level first. `prior` (a row and zone) is
 * what to assume where nothing was measured; with belief > 0 it is an estimate
 * itself, of that reliability. No more spread is believed than `most`. Returns the share of rows in
 * which the longer frames said something. */
static double light_gains(light_job *job, const float *prior, double belief, const light_spread *most) {
    restore_view *view = job->view;
    const size_t height = view->light.height, zones = (size_t)view->zones;
    double covered = 0;
    for (size_t y = 0; y < height; y++) {
        double b;
        light_row(job, y, &b);
        covered += b > 25;
    }
    const light_spread found = light_spreads(job);
    const double k_row = 1 / fmin(found.row, most->row), k_zone = 1 / fmin(found.zone, most->zone);
    const double k_color = 1 / fmin(found.color, most->color);

    double k_prior = 0;
    if (belief > 0) {
        for (size_t i = 0; i < height * zones; i++)
            k_prior += (prior[i] - 1) * (prior[i] - 1);
        k_prior = 1 / ((1 - belief) * k_prior / (double)(height * zones) + 1e-4);
    }
    double deviation = 0;
    for (size_t y = 0; y < height; y++) {
        double b, a = light_row(job, y, &b);
        for (size_t z = 0; z < zones; z++) {
            size_t i = y * zones + z;
            double row = (a + k_row * prior[i]) / (b + k_row);
            double az = independent * v4_sum(job->above[i]), bz = independent * v4_sum(job->below[i]);
            double zone = (az + k_zone * row + k_prior * prior[i]) / (bz + k_zone + k_prior);
            /* The two rows of a packed pixel are exposed at two times, a quarter before and after its mean. */
            double slope = y > 0 && y + 1 < height ? 0.125 * (prior[i + zones] - prior[i - zones]) : 0;
            for (int c = 0; c < 4; c++) {
                double ac = independent * job->above[i][c], bc = independent * job->below[i][c];
                double gain = (ac + k_color * (zone + (c < 2 ? -slope : slope))) / (bc + k_color);
                view->gain[i][c] = (float)(gain < 1e-3 ? 1e-3 : gain > 20 ? 20 : gain);
                deviation += (gain - 1) * (gain - 1);
            }
        }
    }
    view->deviation = sqrt(deviation / (4.0 * (double)(height * zones)));
    return covered / (double)height;
}

/* Relative residuals of the corrected frame against the longer ones, over short
 * runs along the rows: banding goes on through a run, noise and misplaced
 * edges mostly cancel in it. Logarithmic bins. */
static void residual_rows(void *arg, size_t begin, size_t end, int worker) {
    const light_job *job = arg;
    const restore_view *view = job->view;
    const size_t width = view->light.width;
    v4 *gain = job->gain_rows + (size_t)worker * width;
    uint32_t *histogram = job->histogram[worker];
    for (size_t y = begin; y < end; y++) {
        restore_view_gain_row(view, y, gain);
        for (size_t first = 0; first + RUN <= width; first += RUN) {
            v4 seen = v4_set(0), longer = v4_set(0), noise = v4_set(0), trusted = v4_set(1);
            for (size_t x = first; x < first + RUN; x++) {
                size_t i = y * width + x;
                v4 l = v4_max(light_divide(job->sum->at[i], job->weight->at[i]), v4_set(0));
                trusted = v4_min(trusted, light_trust(view->trust + 4 * i, job->weight->at[i]));
                seen += view->light.at[i] / gain[x], longer += l;
                noise += (view->noise_s * l * gain[x] + view->noise_o) / (gain[x] * gain[x]);
            }
            for (int c = 0; c < 4; c++) {
                if (!(trusted[c] > 0.5f && gain[first][c] > 0.3f && longer[c] > RUN * 0.3f * job->bright[y]))
                    continue;
                if (noise[c] > 0.0009f * longer[c] * longer[c])
                    continue;
                float r = fabsf(seen[c] / longer[c] - 1);
                int bin = (int)(log2f(r + 1e-6f) * 20) + 400; /* 1e-6 -> 1, 1 -> 400 */
                histogram[bin < 0 ? 0 : bin >= HISTOGRAM ? HISTOGRAM - 1 : bin]++;
            }
        }
    }
}

static double histogram_median(uint32_t (*histogram)[HISTOGRAM], int workers, double *pixels) {
    uint64_t total[HISTOGRAM] = {0}, all = 0, run = 0;
    for (int w = 0; w < workers; w++)
        for (int i = 0; i < HISTOGRAM; i++)
            total[i] += histogram[w][i], all += histogram[w][i];
    *pixels = (double)all;
    for (int i = 0; i < HISTOGRAM; i++) {
        run += total[i];
        if (2 * run >= all)
            return exp2((i - 400 + 0.5) / 20);
    }
    return 1;
}

static double light_residual(light_job *job, core_pool *pool, double *pixels) {
    const int workers = core_pool_threads(pool);
    memset(job->histogram, 0, (size_t)workers * sizeof *job->histogram);
    core_parallel(pool, job->view->light.height, 8, residual_rows, job);
    return 1.4826 * histogram_median(job->histogram, workers, pixels);
}

/* One frame in place of the picture of the longer ones. */
static void alone_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const light_job *job = arg;
    const restore_view *longer = job->longer;
    for (size_t i = begin * longer->light.width; i < end * longer->light.width; i++) {
        job->weight->at[i] = v4_trust(longer->trust + 4 * i);
        job->sum->at[i] = job->weight->at[i] * longer->light.at[i];
    }
}

/* Adds the corrected frame to the picture of the longer ones. */
static void add_rows(void *arg, size_t begin, size_t end, int worker) {
    const light_job *job = arg;
    const restore_view *view = job->view;
    const size_t width = view->light.width;
    v4 *gain = job->gain_rows + (size_t)worker * width;
    for (size_t y = begin; y < end; y++) {
        restore_view_gain_row(view, y, gain);
        for (size_t x = 0; x < width; x++) {
            size_t i = y * width + x;
            v4 trust = v4_trust(view->trust + 4 * i);
            if (v4_sum(trust) == 0)
                continue;
            /* Weights must not follow the sample's own error, or low ones would win. */
            v4 mean = v4_set(0);
            const size_t left = x > 2 ? x - 3 : 0, right = x + 4 < width ? x + 4 : width;
            for (size_t j = left; j < right; j++)
                mean += view->light.at[y * width + j];
            mean = v4_max(mean / v4_set((float)(right - left)), v4_set(0)) / gain[x];
            for (int c = 0; c < 4; c++)
                if (job->weight->at[i][c] > 0)
                    mean[c] = fmaxf(job->sum->at[i][c] / job->weight->at[i][c], 0);
            v4 off = restore_view_unexplained(view, gain[x]), poor = v4_set(0.02f) / gain[x];
            v4 variance = (view->noise_s * mean * gain[x] + view->noise_o) / (gain[x] * gain[x]) +
                          (off + poor * poor) * mean * mean + v4_set(1e-10f);
            v4 w = trust / variance;
            job->sum->at[i] += w * view->light.at[i] / gain[x];
            job->weight->at[i] += w;
        }
    }
}

/* Light of the brightest zone of each row, averaged over a sixteenth of the
 * picture (longer than the usual band). What is much darker than that is seen
 * through glare from it, whose light is not that of its row, and counts little. */
static void row_brightness(const restore_view *view, float *bright, float *scratch) {
    const size_t width = view->light.width, height = view->light.height, reach = height / 32 + 1;
    const size_t zones = (size_t)view->zones;
    for (size_t y = 0; y < height; y++) {
        double brightest = 0;
        for (size_t z = 0; z < zones; z++) {
            size_t first = width * z / zones, last = width * (z + 1) / zones;
            double s = 0;
            for (size_t x = first; x < last; x++)
                s += v4_sum(v4_max(view->light.at[y * width + x], v4_set(0)));
            brightest = fmax(brightest, s / (4.0 * (double)(last - first)));
        }
        scratch[y] = (float)brightest;
    }
    for (size_t y = 0; y < height; y++) {
        size_t from = y > reach ? y - reach : 0, to = y + reach < height ? y + reach : height - 1;
        double s = 0;
        for (size_t j = from; j <= to; j++)
            s += scratch[j];
        bright[y] = (float)(s / (double)(to - from + 1));
    }
}

/* What a frame may be believed to deviate by: what it and its shorter neighbour show as they are, or any pair of
 * shorter ones. */
typedef struct light_limit {
    light_spread spread;
    double banding;
} light_limit;

/* Of frame i, which was just measured against the next longer one. */
static void keep_ratios(const light_job *job, size_t i) {
    const size_t cells = (size_t)job->view->zones * job->view->light.height;
    for (size_t k = 0; k < cells; k++) {
        const float below = v4_sum(job->below[k]);
        job->ratio[i * cells + k] = independent * (double)below > 25 ? v4_sum(job->above[k]) / below : 0;
    }
}

static void light_limits(light_job *job, restore_view *views, size_t count, light_limit *most, float *bright,
                         core_pool *pool) {
    const size_t height = views[0].light.height;
    most[0] = (light_limit){{1, 1, 1}, 100};
    for (size_t i = 1; i < count; i++) {
        most[i] = most[i - 1];
        job->view = &views[i - 1], job->longer = &views[i];
        core_parallel(pool, height, 16, alone_rows, job);
        row_brightness(job->view, bright, bright + height);
        core_parallel(pool, height, 8, measure_rows, job);
        keep_ratios(job, i - 1);
        double pixels = 0, measured = 0, below;
        for (size_t y = 0; y < height; y++) {
            light_row(job, y, &below);
            measured += below > 25;
        }
        double residual = light_residual(job, pool, &pixels);
        if (measured < 0.5 * (double)height || pixels < 200)
            continue; /* a dark frame or a clipped one says nothing */
        light_spread s = light_spreads(job);
        most[i].spread = (light_spread){fmin(most[i].spread.row, s.row), fmin(most[i].spread.zone, s.zone),
                                        fmin(most[i].spread.color, s.color)};
        most[i].banding = fmin(most[i].banding, residual);
    }
}

brace_status restore_light(restore_view *views, size_t count, restore_picture *sum, restore_picture *weight,
                           core_pool *pool, brace_error *error) {
    const size_t width = sum->width, height = sum->height;
    const int workers = core_pool_threads(pool);
    size_t zones = width / 48 < 2 ? 2 : width / 48 > 8 ? 8 : width / 48;
    brace_status status = BRACE_OK;

    light_job job = {.sum = sum, .weight = weight};
    float *bright = core_alloc(2 * height, sizeof(float));
    float *prior = core_alloc(height * zones, sizeof(float));
    job.above = core_alloc(height * zones, sizeof(v4));
    job.below = core_alloc(height * zones, sizeof(v4));
    job.gain_rows = core_alloc((size_t)workers * width, sizeof(v4));
    job.histogram = core_alloc((size_t)workers, sizeof *job.histogram);
    job.ratio = core_alloc(count * height * zones, sizeof(float));
    job.bright = bright;
    if (!bright || !prior || !job.above || !job.below || !job.gain_rows || !job.histogram || !job.ratio) {
        status = core_fail_memory(error, height * zones * 60, "measuring the light");
        goto done;
    }
    for (size_t i = 0; i < count && !status; i++) {
        views[i].zones = (int)zones;
        views[i].gain = core_alloc(height * zones, sizeof(v4));
        if (!views[i].gain)
            status = core_fail_memory(error, height * zones * sizeof(v4), "measuring the light");
        else
            for (size_t k = 0; k < height * zones; k++)
                views[i].gain[k] = v4_set(1);
    }
    light_limit most[BRACE_BRACKET_MAX];
    if (!status)
        light_limits(&job, views, count, most, bright, pool);
    memset(sum->at, 0, width * height * sizeof(v4));
    memset(weight->at, 0, width * height * sizeof(v4));
    for (size_t i = count; i-- > 0 && !status;) {
        restore_view *view = &views[i];
        job.view = view;
        row_brightness(view, bright, bright + height);
        core_parallel(pool, height, 8, measure_rows, &job);
        drop_nonsense(&job);
        if (i >= 2)
            add_agreement(&job, i);
        for (size_t k = 0; k < height * zones; k++)
            prior[k] = 1;
        double covered = light_gains(&job, prior, 0, &most[i].spread), periodic = 0;
        if (covered < 0.95) {
            status = restore_periodic(prior, &periodic, view, i > 0 ? &views[i - 1] : NULL, pool, error);
            if (status)
                break;
            double sq = 0;
            for (size_t k = 0; k < height * zones; k++)
                sq += (prior[k] - 1) * (prior[k] - 1);
            /* More than the light can have done: lines of text repeat, too. */
            if (sq / (double)(height * zones) > 4 * most[i].spread.row)
                periodic = 0;
            if (periodic > 0)
                light_gains(&job, prior, periodic, &most[i].spread);
        }

        double pixels, residual = light_residual(&job, pool, &pixels);
        /* What to expect of a frame that nothing could be compared with. */
        double guess = 0.35 * pow(view->exposure, -0.9);
        guess = guess > 1.2 ? 1.2 : guess < 0.01 ? 0.01 : guess;
        if (periodic > 0)
            guess = fmin(guess, hypot(0.02, 2 * (1 - periodic) * view->deviation));
        double known = pixels / (pixels + 20);
        view->banding = (float)fmin(known * residual + (1 - known) * guess, most[i].banding);
        core_parallel(pool, height, 8, add_rows, &job);
    }
    /* Light that is steady over a short exposure is so over a longer one. */
    for (size_t i = 1; i < count && !status; i++)
        views[i].banding = fminf(views[i].banding, views[i - 1].banding);
done:
    core_free(bright), core_free(prior), core_free(job.above), core_free(job.below);
    core_free(job.gain_rows), core_free(job.histogram), core_free(job.ratio);
    return status;
}
