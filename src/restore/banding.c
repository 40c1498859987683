/* SPDX-License-Identifier: Apache-2.0 */
/*
 * banding.c: the light behind a bracket's banding.
 *
 * Frames are aligned as for a restoration. Each is then divided, pixel by pixel,
 * by the longest frame that does not clip there: content cancels, and what
 * remains is the light of this frame's rows over that of an exposure long enough
 * to have little banding. A frame for which no longer one tells enough (the
 * longest, or a single one) is measured on its own.
 */
#include <math.h>
#include <string.h>

#include "banding/consensus.h"
#include "banding/frequency.h"
#include "raw/isp.h"
#include "restore/internal.h"

/* As in light.c: frames agree no better than this, and edges may be misplaced by so many pixels. */
static const float texture = 0.05f, misplaced = 0.5f;

typedef struct ratio_job {
    const restore_view *views; /* sorted, shortest first */
    size_t count, index;
    double *above, *below; /* a row and zone: sums of w seen longer and of w longer^2 */
    float *longer;         /* a row for each worker */
} ratio_job;

/* Sum of the four samples if all can be trusted, else -1. */
static float all_of(const restore_view *view, size_t i) {
    const uint8_t *t = view->trust + 4 * i;
    return t[0] > 128 && t[1] > 128 && t[2] > 128 && t[3] > 128 ? v4_sum(view->light.at[i]) : -1;
}

static void ratio_rows(void *arg, size_t begin, size_t end, int worker) {
    const ratio_job *job = arg;
    const restore_view *view = &job->views[job->index];
    const size_t width = view->light.width;
    const float s = v4_sum(view->noise_s) * 0.25f, o = v4_sum(view->noise_o);
    float *longer = job->longer + (size_t)worker * width;
    for (size_t y = begin; y < end; y++) {
        for (size_t x = 0; x < width; x++) {
            longer[x] = -1;
            for (size_t j = job->count; longer[x] < 0 && j-- > job->index + 1;)
                longer[x] = all_of(&job->views[j], y * width + x);
        }
        for (size_t z = 0; z < BANDING_ZONES; z++) {
            const size_t first = width * z / BANDING_ZONES, last = width * (z + 1) / BANDING_ZONES;
            double above = 0, below = 0, mean = 0;
            size_t n = 0;
            for (size_t x = first; x < last; x++)
                if (longer[x] > 0)
                    mean += longer[x], n++;
            mean = n ? mean / (double)n : 0;
            for (size_t x = first + 1; x + 1 < last; x++) {
                const float l = longer[x], seen = all_of(view, y * width + x);
                if (l <= 0 || longer[x - 1] < 0 || longer[x + 1] < 0 || seen < -1 + 1e-6f)
                    continue;
                const float edge = (longer[x + 1] - longer[x - 1]) * misplaced * 0.5f, fuzzy = texture * l;
                const float floor_of = (float)(0.05 * mean);
                const float w = 1 / (edge * edge + s * l + o + fuzzy * fuzzy + floor_of * floor_of + 1e-12f);
                above += (double)(w * seen * l), below += (double)(w * l * l);
            }
            job->above[y * BANDING_ZONES + z] = above, job->below[y * BANDING_ZONES + z] = below;
        }
    }
}

/* Zones joined by `group`; how much is told then. */
static double ratio_fill(banding_profile *out, const double *above, const double *below, size_t group) {
    size_t told = 0;
    for (size_t y = 0; y < out->rows; y++)
        for (size_t z = 0; z < BANDING_ZONES; z++) {
            double a = 0, b = 0;
            for (size_t g = z - z % group; g < z - z % group + group; g++)
                a += above[y * BANDING_ZONES + g], b += below[y * BANDING_ZONES + g];
            /* The standard error of a/b is b^-1/2. */
            const bool known = b > 16;
            out->at[y * BANDING_ZONES + z] = known ? (float)fmin(fmax(a / b, -1), 10) - 1 : NAN;
            told += known;
        }
    return (double)told / (double)(out->rows * BANDING_ZONES);
}

static brace_status ratio_profile(banding_profile *out, const restore_view *views, size_t count, size_t index,
                                  core_pool *pool, brace_error *error) {
    const size_t width = views[index].light.width, rows = views[index].light.height;
    brace_status status = banding_profile_create(out, rows, width, error);
    if (status != BRACE_OK)
        return status;
    ratio_job job = {.views = views, .count = count, .index = index};
    job.above = core_alloc(2 * rows * BANDING_ZONES, sizeof *job.above);
    job.longer = core_alloc((size_t)core_pool_threads(pool) * width, sizeof *job.longer);
    if (!job.above || !job.longer) {
        core_free(job.above), core_free(job.longer);
        banding_profile_free(out);
        return core_fail_memory(error, 2 * rows * BANDING_ZONES * sizeof *job.above, "the rows' light");
    }
    job.below = job.above + rows * BANDING_ZONES;
    core_parallel(pool, rows, 8, ratio_rows, &job);
    /* In the dark a zone of a row does not tell enough, several together may. */
    for (size_t group = 1; group <= BANDING_ZONES && out->covered < 0.5; group *= 2)
        out->covered = ratio_fill(out, job.above, job.below, group);
    for (size_t z = 0; z < BANDING_ZONES; z++) {
        double sum = 0;
        for (size_t y = 0; y < rows; y++)
            sum += job.below[y * BANDING_ZONES + z];
        sum /= (double)rows;
        out->weight[z] = 0.02 + sum / (sum + 100);
    }
    core_free(job.above), core_free(job.longer);
    return BRACE_OK;
}

typedef struct measure_state {
    size_t order[BRACE_BRACKET_MAX]; /* shortest first */
    restore_view view[BRACE_BRACKET_MAX];
    size_t made;
    restore_picture packed;
    restore_pyramid *reference, *moved;
    banding_profile profile[BRACE_BRACKET_MAX];
    banding_lines lines[BRACE_BRACKET_MAX];
    banding_line line[BRACE_BRACKET_MAX];
    banding_consensus alone[BRACE_BRACKET_MAX];
} measure_state;

static double exposure_of(const brace_frame *f) {
    return f->exposure_time * (f->iso > 0 ? f->iso : 100) / (f->f_number > 0 ? f->f_number * f->f_number : 1);
}

/* Whether the frames are exposures of one camera that can be compared. */
static bool comparable(const brace_frame *const *frames, size_t count) {
    double least = INFINITY, most = 0;
    for (size_t i = 0; i < count; i++) {
        const brace_frame *a = frames[0], *b = frames[i];
        if (a->width != b->width || a->height != b->height || a->cfa != b->cfa || !(b->exposure_time > 0))
            return false;
        least = fmin(least, exposure_of(b)), most = fmax(most, exposure_of(b));
    }
    return count > 1 && most > 1.5 * least && most < 1e6 * least;
}

static brace_status make_views(measure_state *s, const brace_frame *const *frames, size_t count, bool align,
                               const brace_job *job, core_pool *pool, brace_error *error) {
    const size_t middle = (count - 1) / 2;
    const brace_frame *reference = frames[s->order[middle]];
    brace_status status = restore_picture_create(&s->packed, ((size_t)reference->width + 1) / 2,
                                                 ((size_t)reference->height + 1) / 2, "a packed frame", error);
    if (status == BRACE_OK && align) {
        restore_pack(&s->packed, reference, pool);
        status = restore_pyramid_create(&s->reference, &s->packed, reference, pool, error);
    }
    for (size_t i = 0; i < count && status == BRACE_OK; i++) {
        const brace_frame *frame = frames[s->order[i]];
        restore_motion motion = {.confidence = 1};
        core_progress(job, "aligning", i, count);
        if ((status = core_check_cancel(job, error)))
            break;
        restore_pack(&s->packed, frame, pool);
        if (align && i != middle) {
            status = restore_pyramid_create(&s->moved, &s->packed, frame, pool, error);
            if (status)
                break;
            restore_align(&motion, s->reference, s->moved, pool);
            restore_pyramid_destroy(s->moved);
            s->moved = NULL;
        }
        const bool lost = motion.confidence < 0.3;
        if (lost)
            motion = (restore_motion){.confidence = motion.confidence};
        status = restore_view_create(&s->view[i], &s->packed, frame, exposure_of(frame) / exposure_of(reference),
                                     align && i != middle && !lost ? &motion : NULL, pool, error);
        if (status)
            break;
        s->made = i + 1;
        /* A longer frame that was not found would mislead all shorter ones. */
        if (lost && i > middle)
            memset(s->view[i].trust, 0, 4 * s->packed.width * s->packed.height);
    }
    core_progress(job, "aligning", count, count);
    return status;
}

/* The line that all frames show: the best of the sum of what each one shows. */
static double common_line(const measure_state *s, size_t count) {
    banding_line line;
    size_t first = 0; /* those told alone have profiles of another length */
    while (first < count && s->profile[first].steps)
        first++;
    if (first == count)
        return 0;
    banding_lines sum = s->lines[first];
    sum.coherent = core_calloc(sum.count, sizeof(double));
    sum.noise = core_calloc(sum.count, sizeof(double));
    double frequency = 0;
    if (sum.coherent && sum.noise) {
        for (size_t i = first; i < count; i++)
            for (size_t k = 0; k < sum.count && !s->profile[i].steps; k++)
                sum.coherent[k] += s->lines[i].coherent[k], sum.noise[k] += s->lines[i].noise[k];
        banding_line_find(&line, &sum, 0);
        frequency = line.found ? line.frequency : 0;
    }
    core_free(sum.coherent), core_free(sum.noise);
    return frequency;
}

/* After how many periods the light repeats: a refresh often holds several pulses that differ. */
static int repeats_after(const banding_lines *lines, const banding_line *line) {
    for (int n = 8; n >= 2; n--) {
        banding_line slow;
        banding_line_find(&slow, lines, line->frequency / n);
        if (slow.found && slow.ratio > 50 && slow.amplitude > 0.1 * line->amplitude &&
            fabs(slow.frequency * n / line->frequency - 1) < 0.5 * n / (line->frequency * (double)lines->rows) &&
            slow.frequency * (double)lines->rows > 2.5)
            return n;
    }
    return 1;
}

static void combine(brace_banding *out, const measure_state *s, const brace_frame *const *frames, size_t count) {
    bool compared = false;
    for (size_t i = 0; i < count; i++)
        compared = compared || out->frame[i].compared;
    for (size_t i = 0; i < count; i++)
        out->frame[i].confidence = banding_confidence(&out->frame[i]);
    /* Light that is less uneven over a shorter exposure was not what made a longer one uneven: a unit less
     * of the logarithm of the odds. */
    for (size_t i = 1; i < count; i++) {
        brace_banding_frame *longer = &out->frame[s->order[i]];
        const double odds = longer->confidence / fmax(1 - longer->confidence, 1e-12) * exp(-1), less = odds / (1 + odds);
        for (size_t j = 0; j < i; j++) {
            const brace_banding_frame *shorter = &out->frame[s->order[j]];
            if (shorter->compared && longer->compared && shorter->uneven < 0.8 * longer->uneven)
                longer->confidence = fmin(longer->confidence, fmax(shorter->confidence, less));
        }
    }
    /* Comparison is the better witness. A frame measured alone does not overrule it: light that is steady over
     * a short exposure is so over a longer one. */
    for (size_t i = 0; i < count; i++)
        if (out->frame[i].compared == compared)
            out->confidence = fmax(out->confidence, out->frame[i].confidence);
    for (size_t i = 0; i < count; i++)
        out->frame[i].confidence = fmin(out->frame[i].confidence, out->confidence);
    size_t best = 0;
    double most = -1;
    for (size_t i = 0; i < count; i++) {
        const brace_banding_frame *f = &out->frame[s->order[i]];
        const double weight = f->compared == compared ? f->confidence * (f->share + 0.01) : -1;
        if (weight > most)
            most = weight, best = i;
    }
    const brace_banding_frame *first = &out->frame[s->order[best]];
    double sum = 0, weight = 0;
    for (size_t i = 0; i < count; i++) {
        const brace_banding_frame *f = &out->frame[s->order[i]];
        if (f->compared != compared || !(f->frequency > 0) || fabs(f->frequency / first->frequency - 1) > 0.05)
            continue;
        const double w = pow(f->confidence, 4) / (f->frequency_error * f->frequency_error + 1e-8);
        sum += w * f->frequency, weight += w;
    }
    out->frequency = weight > 0 ? sum / weight : first->frequency;
    double deviation = 0, sure = 0;
    for (size_t i = 0; i < count && out->frequency > 0; i++) {
        const brace_banding_frame *f = &out->frame[i];
        if (f->confidence < 0.5 || f->compared != compared)
            continue;
        const double off = fabs(f->frequency / out->frequency - 1);
        const double w = f->confidence / (f->frequency_error * f->frequency_error + 1e-8);
        out->spread = fmax(out->spread, off);
        deviation += w * off * off, sure += w;
    }
    out->frequency_error = hypot(weight > 0 ? sqrt(1 / weight) : 1, sure > 0 ? sqrt(deviation / sure) : 0);
    out->frequency_error = fmin(1, fmax(out->frequency_error, first->frequency_error));
    out->frequency_confidence = banding_frequency_confidence(out, first, frames[0]->height);
    const int base = first->frequency > 0 ? repeats_after(&s->lines[best], &s->line[best]) : 1;
    banding_frequency(out, frames[s->order[best]]->height, base);
}

brace_status brace_banding_measure(brace_banding *out, const brace_frame *const *frames, size_t count,
                                   const brace_banding_params *params, const brace_job *job, brace_error *error) {
    static const brace_banding_params defaults = {0};
    params = params ? params : &defaults;
    if (count < 1 || count > BRACE_BANDING_MAX_FRAMES)
        return core_fail(error, BRACE_ERROR_ARGUMENT, "banding is measured in 1 to %d frames, not %zu",
                         BRACE_BANDING_MAX_FRAMES, count);
    if (!(params->readout >= 0 && params->readout <= 10))
        return core_fail(error, BRACE_ERROR_ARGUMENT, "a readout of %g s is none", params->readout);
    brace_status status = BRACE_OK;
    for (size_t i = 0; i < count && status == BRACE_OK; i++)
        status = raw_check_frame(frames[i], error);
    if (status != BRACE_OK)
        return status;
    measure_state *s = core_calloc(1, sizeof *s);
    if (!s)
        return core_fail_memory(error, sizeof *s, "measuring banding");
    core_pool *pool = NULL;
    *out = (brace_banding){.count = count, .readout = params->readout};
    status = core_pool_create(&pool, job, error);
    for (size_t i = 0; i < count; i++) { /* insertion sort by exposure */
        size_t at = i;
        for (; at > 0 && exposure_of(frames[s->order[at - 1]]) > exposure_of(frames[i]); at--)
            s->order[at] = s->order[at - 1];
        s->order[at] = i;
    }
    const bool together = comparable(frames, count);
    if (status == BRACE_OK && together)
        status = make_views(s, frames, count, !params->no_align, job, pool, error);
    for (size_t i = 0; i < count && status == BRACE_OK; i++) {
        const brace_frame *frame = frames[s->order[i]];
        brace_banding_frame *f = &out->frame[s->order[i]];
        core_progress(job, "measuring banding", i, count);
        status = core_check_cancel(job, error);
        if (status == BRACE_OK)
            status = brace_fabp_frame(&f->fabp, frame, &params->fabp, job, error);
        f->exposure_time = frame->exposure_time;
        if (status == BRACE_OK)
            status = banding_consensus_frame(&s->alone[i], frame, pool, error);
        f->alone = status == BRACE_OK ? 1 / (1 + exp(-s->alone[i].odds)) : 0;
        if (status == BRACE_OK && together)
            status = ratio_profile(&s->profile[i], s->view, count, i, pool, error);
        if (status == BRACE_OK && !(s->profile[i].covered > 0.4)) {
            banding_profile_free(&s->profile[i]);
            status = banding_profile_frame(&s->profile[i], frame, pool, error);
        }
        if (status == BRACE_OK)
            status = banding_lines_create(&s->lines[i], &s->profile[i], error);
    }
    if (status == BRACE_OK) {
        const double common = together ? common_line(s, count) : 0;
        for (size_t i = 0; i < count; i++) {
            /* From one frame alone its pixels' vote is better than the strongest line. */
            const double near = s->profile[i].steps ? s->alone[i].frequency : common;
            banding_line_find(&s->line[i], &s->lines[i], near);
            banding_line_measure(&s->line[i], &s->profile[i]);
            banding_frame_fill(&out->frame[s->order[i]], &s->line[i], &s->profile[i]);
        }
        combine(out, s, frames, count);
        core_progress(job, "measuring banding", count, count);
    }
    for (size_t i = 0; i < count; i++) {
        banding_profile_free(&s->profile[i]);
        banding_lines_free(&s->lines[i]);
    }
    for (size_t i = 0; i < s->made; i++)
        restore_view_free(&s->view[i]);
    restore_picture_free(&s->packed);
    restore_pyramid_destroy(s->reference), restore_pyramid_destroy(s->moved);
    core_pool_destroy(pool);
    core_free(s);
    return status;
}
