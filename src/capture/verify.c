/* SPDX-License-Identifier: Apache-2.0 */
/*
 * verify.c: whether a frame is what it was to be: what its metadata say, and
 * what its light says beside the other frames'.
 *
 * The light of two frames of a steady screen stands in the ratio of their
 * exposures. A flickering screen's does not, quite: a short exposure catches more or
 * less of the pulses, row by row. raw_measure_ratio gives the ratio over the
 * picture and its spread over stripes of rows, and only what neither explains is a lie.
 */
#include <math.h>
#include <string.h>

#include "capture/capture.h"
#include "raw/raw.h"
#include "restore/internal.h"

/* ---- probes ---- */

/* Blocks of 2x2 along a side that are left out between two that are kept. */
static uint32_t probe_step(const brace_frame *f) {
    uint32_t step = 1;
    while ((uint64_t)(f->width / 2 / step) * (f->height / 2 / step) > 200000)
        step++;
    return step;
}

brace_status capture_probe_create(capture_probe *out, const brace_frame *frame, const char *name, double exposure,
                                  double iso, brace_error *error) {
    *out = (capture_probe){.exposure = exposure, .iso = iso, .light = exposure * iso};
    snprintf(out->name, sizeof out->name, "%s", name);
    if (frame->f_number > 0)
        out->light /= frame->f_number * frame->f_number;
    const uint32_t step = probe_step(frame);
    const uint32_t width = frame->width / 2 / step, height = frame->height / 2 / step;
    brace_frame *s;
    brace_status status = brace_frame_create(&s, 2 * width, 2 * height, frame->cfa, error);
    if (status != BRACE_OK)
        return status;
    memcpy(s->black, frame->black, sizeof s->black);
    memcpy(s->make, frame->make, sizeof s->make);
    memcpy(s->model, frame->model, sizeof s->model);
    s->white = frame->white;
    s->exposure_time = frame->exposure_time, s->iso = frame->iso, s->f_number = frame->f_number;
    out->width = frame->width, out->height = frame->height;
    const double white = 0.975 * (frame->white - frame->black[0]) + frame->black[0];
    size_t clipped = 0;
    for (uint32_t y = 0; y < s->height; y++) {
        const uint16_t *from = frame->data + ((size_t)(y / 2) * 2 * step + y % 2) * frame->width;
        uint16_t *to = s->data + (size_t)y * s->width;
        for (uint32_t x = 0; x < s->width; x++) {
            to[x] = from[(size_t)(x / 2) * 2 * step + x % 2];
            clipped += to[x] >= white;
        }
    }
    out->clipped = (double)clipped / ((double)s->width * s->height);
    out->sample = s;
    return BRACE_OK;
}

void capture_probe_free(capture_probe *probe) {
    brace_frame_destroy(probe->sample);
    probe->sample = NULL;
}

/* ---- metadata ---- */

brace_status capture_verify_metadata(const brace_frame *frame, const char *name, double exposure, double iso,
                                     const brace_job *job, brace_error *error) {
    char asked[32], says[32];
    if (!(frame->exposure_time > 0))
        core_note(job, "%s does not say its exposure time", name);
    else if (!(fabs(log2(frame->exposure_time / exposure)) <= CAPTURE_EXIF_EV))
        return core_fail(error, BRACE_ERROR_MISMATCH, "%s says %s, %s was asked for", name,
                         capture_time_text(says, frame->exposure_time), capture_time_text(asked, exposure));
    if (!(frame->iso > 0))
        core_note(job, "%s does not say its ISO", name);
    else if (!(fabs(log2(frame->iso / iso)) <= CAPTURE_EXIF_EV))
        return core_fail(error, BRACE_ERROR_MISMATCH, "%s says ISO %g, ISO %g was asked for", name, frame->iso, iso);
    return BRACE_OK;
}

/* ---- light ---- */

/* The same file twice: noise alone makes any two photographs differ in most of the samples that are neither black nor
 * clipped. */
static bool identical(const brace_frame *a, const brace_frame *b) {
    size_t looked = 0, same = 0;
    if (a->width != b->width || a->height != b->height)
        return false;
    for (size_t i = 0; i < (size_t)a->width * a->height; i++) {
        const size_t plane = (i / a->width % 2) * 2 + i % a->width % 2;
        const float black = a->black[plane], low = black + 0.01f * (a->white - black),
                    high = black + 0.9f * (a->white - black);
        if ((float)a->data[i] > low && (float)a->data[i] < high) {
            looked++;
            same += a->data[i] == b->data[i];
        }
    }
    return looked >= 64 && same == looked;
}

/* Frames with too little in common for a ratio can still contradict each other: where the longer one is not clipped,
 * the shorter one should show something; and it cannot be the brighter of the two. */
static double blackout(const capture_probe *dark, const capture_probe *bright, double expected) {
    const brace_frame *d = dark->sample, *b = bright->sample;
    double all[2] = {0, 0}, open[2] = {0, 0};
    size_t unclipped = 0;
    if (d->width != b->width || d->height != b->height)
        return (double)NAN;
    const size_t count = (size_t)d->width * d->height;
    for (size_t i = 0; i < count; i++) {
        const size_t plane = (i / d->width % 2) * 2 + i % d->width % 2;
        const double x = ((double)d->data[i] - d->black[plane]) / (d->white - d->black[plane]);
        const double y = ((double)b->data[i] - b->black[plane]) / (b->white - b->black[plane]);
        all[0] += x, all[1] += y;
        if (y < 0.85)
            open[0] += x, open[1] += y, unclipped++;
    }
    if (all[0] > 0.004 * (double)count && all[1] < 0.25 * all[0])
        return log2(fmax(all[0], 1e-6) / fmax(all[1], 1e-6)) - log2(expected);
    if (unclipped > count / 20 && open[1] * expected > 0.001 * (double)unclipped && open[0] < 0.05 * open[1] * expected)
        return log2(fmax(open[0], 1e-6 * (double)unclipped) / open[1]) - log2(expected);
    return (double)NAN;
}

capture_comparison capture_compare(const capture_probe *a, const capture_probe *b) {
    capture_comparison result = {CAPTURE_UNKNOWN, (double)NAN};
    if (identical(a->sample, b->sample)) {
        result.verdict = CAPTURE_IDENTICAL;
        return result;
    }
    /* The darker by plan is measured against the brighter. */
    const bool swapped = a->light > b->light;
    const capture_probe *dark = swapped ? b : a, *bright = swapped ? a : b;
    const double expected = dark->light / bright->light;
    const raw_ratio r = raw_measure_ratio(dark->sample, bright->sample);
    if (!(r.ratio > 0)) {
        const double off = blackout(dark, bright, expected);
        result.ev = swapped ? -off : off;
        result.verdict = isnan(off) ? CAPTURE_UNKNOWN : CAPTURE_DARK;
        return result;
    }
    const double off = log2(r.ratio / expected), slack = exp2(CAPTURE_PIXELS_EV / 2);
    result.ev = swapped ? -off : off;
    result.verdict = fabs(off) <= CAPTURE_PIXELS_EV || (expected >= r.low / slack && expected <= r.high * slack)
                         ? CAPTURE_AGREE
                         : CAPTURE_DISAGREE;
    return result;
}

double capture_brightest(const capture_probe *probe) {
    const brace_frame *f = probe->sample;
    const size_t count = (size_t)f->width * f->height;
    double level = 1;
    while (level > 1.0 / 128) {
        size_t above = 0;
        level /= 2;
        for (size_t i = 0; i < count; i++)
            above += f->data[i] > f->black[0] + level * (f->white - f->black[0]);
        if (above * 1000 > count)
            return 2 * level;
    }
    return level;
}

/* ---- who lies ---- */

enum { MOST = 32 };

/* The largest set without contradictions; of several the one whose members were shot more often, then the earlier. */
typedef struct search {
    size_t count;
    uint32_t enemies[MOST];
    const capture_probe *probes;
    uint32_t best;
    long best_worth;
} search;

static void grow(search *s, uint32_t set, size_t next, long worth) {
    if (next == s->count) {
        if (worth > s->best_worth)
            s->best = set, s->best_worth = worth;
        return;
    }
    if (worth + (long)(s->count - next) * 1040000 <= s->best_worth)
        return; /* all of the rest would not make it the best */
    if ((s->enemies[next] & set) == 0) {
        /* Members count most, then how often they were shot, then how early. */
        const int tries = s->probes[next].tries < 30 ? s->probes[next].tries : 30;
        grow(s, set | 1u << next, next + 1, worth + 1000000 + 1000 * tries + (long)(MOST - next));
    }
    if (s->enemies[next] != 0)
        grow(s, set, next + 1, worth);
}

/* Longer than the dark time of any display. */
#define LONG_ENOUGH (1.0 / 50)

int capture_find_liar(const capture_probe *probes, size_t count, bool *doubtful, char *why, size_t size) {
    search s = {.count = count < MOST ? count : MOST, .probes = probes, .best_worth = -1};
    capture_comparison c[MOST][MOST];
    for (size_t i = 0; i < s.count; i++)
        for (size_t k = 0; k < i; k++) {
            c[i][k] = capture_compare(&probes[i], &probes[k]);
            if (c[i][k].verdict >= CAPTURE_IDENTICAL) {
                s.enemies[i] |= 1u << k;
                s.enemies[k] |= 1u << i;
            }
        }
    grow(&s, 0, 0, 0);
    for (size_t i = s.count; i-- > 0;) {
        if ((s.best >> i & 1) != 0)
            continue;
        /* Contradicted by a member of the set: the nearest in exposure says it best. */
        size_t witness = s.count;
        *doubtful = probes[i].exposure < LONG_ENOUGH;
        for (size_t k = 0; k < s.count; k++)
            if ((s.best & s.enemies[i]) >> k & 1)
                *doubtful = *doubtful && (i > k ? c[i][k] : c[k][i]).verdict == CAPTURE_DARK;
        for (size_t k = 0; k < s.count; k++)
            if ((s.best & s.enemies[i]) >> k & 1 &&
                (witness == s.count ||
                 fabs(log(probes[k].light / probes[i].light)) < fabs(log(probes[witness].light / probes[i].light))))
                witness = k;
        if (witness == s.count)
            continue;
        const capture_comparison found = i > witness ? c[i][witness] : c[witness][i];
        const double ev = i > witness ? found.ev : -found.ev, planned = log2(probes[i].light / probes[witness].light);
        char t[32];
        if (found.verdict == CAPTURE_IDENTICAL)
            snprintf(why, size, "%s is the same picture as %s, sample for sample", probes[i].name,
                     probes[witness].name);
        else if (found.verdict == CAPTURE_DARK)
            snprintf(why, size, ev < 0 ? "%s shows hardly any light beside %s" : "%s shows light that %s does not",
                     probes[i].name, probes[witness].name);
        else if (fabs(planned) > 1 && fabs(ev + planned) < CAPTURE_PIXELS_EV)
            snprintf(why, size,
                     "%s is as bright as %s, although %s at ISO %g should make it %.1f EV %s: is the exposure locked?",
                     probes[i].name, probes[witness].name, capture_time_text(t, probes[i].exposure), probes[i].iso,
                     fabs(planned), planned > 0 ? "brighter" : "darker");
        else
            snprintf(why, size, "%s is %.1f EV %s than %s at ISO %g should be beside %s", probes[i].name, fabs(ev),
                     ev > 0 ? "brighter" : "darker", capture_time_text(t, probes[i].exposure), probes[i].iso,
                     probes[witness].name);
        return (int)i;
    }
    return -1;
}

/* ---- motion ---- */

brace_status capture_motion(brace_motion *out, const brace_frame *fixed, const brace_frame *moved, const brace_job *job,
                            brace_error *error) {
    restore_picture packed = {0};
    restore_pyramid *a = NULL, *b = NULL;
    core_pool *pool = NULL;
    *out = (brace_motion){.dx = (double)NAN, .dy = (double)NAN, .rotation = (double)NAN, .scale = (double)NAN};
    if (fixed->width != moved->width || fixed->height != moved->height)
        return BRACE_OK;
    brace_status status = core_pool_create(&pool, job, error);
    if (status == BRACE_OK)
        status = restore_picture_create(&packed, (fixed->width + 1) / 2, (fixed->height + 1) / 2, "a frame", error);
    if (status == BRACE_OK) {
        restore_pack(&packed, fixed, pool);
        status = restore_pyramid_create(&a, &packed, fixed, pool, error);
    }
    if (status == BRACE_OK) {
        restore_pack(&packed, moved, pool);
        status = restore_pyramid_create(&b, &packed, moved, pool, error);
    }
    if (status == BRACE_OK) {
        restore_motion found;
        restore_align(&found, a, b, pool);
        if (found.confidence >= 0.1)
            *out = restore_motion_report(&found, packed.width);
        out->confidence = found.confidence;
    }
    restore_pyramid_destroy(a);
    restore_pyramid_destroy(b);
    restore_picture_free(&packed);
    core_pool_destroy(pool);
    return status;
}
