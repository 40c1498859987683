/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bracket.c: takes frames in any order, makes sure they belong together, sorts
 * them by exposure and chooses the reference.
 *
 * Whatever is refused is refused with the name of the frame that stands out, by
 * majority: with five frames of which one is another size, that one is named.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "raw/raw.h"

/* Two exposures closer than this are the same: shutters are that exact. */
#define SAME_EXPOSURE 1.05
/* Above this, in EV, pixels and metadata contradict each other. */
#define CONTRADICTION_EV 0.5
/* How much of the stripes' own spread is allowed for on top, in EV. */
#define STRIPE_MARGIN_EV 0.25

typedef struct namer {
    char text[96];
} namer;

static const char *frame_name(namer *n, brace_frame *const *frames, size_t i) {
    const char *path = frames[i]->path;
    if (path != NULL && *path != '\0') {
        return raw_name(path);
    }
    snprintf(n->text, sizeof n->text, "frame %zu", i + 1);
    return n->text;
}

/* ---- belonging together ---- */

static bool same_camera(const brace_frame *a, const brace_frame *b) {
    return strcmp(a->make, b->make) == 0 && strcmp(a->model, b->model) == 0;
}

static bool same_size(const brace_frame *a, const brace_frame *b) {
    return a->width == b->width && a->height == b->height;
}

static bool same_cfa(const brace_frame *a, const brace_frame *b) {
    return a->cfa == b->cfa;
}

/* Finds the frame that differs from most others: true if there is one. */
static bool odd_one_out(brace_frame *const *frames, size_t count,
                        bool (*same)(const brace_frame *, const brace_frame *), size_t *odd, size_t *usual) {
    size_t most = 0;
    *usual = 0;
    for (size_t i = 0; i < count; i++) {
        size_t n = 0;
        for (size_t k = 0; k < count; k++) {
            n += same(frames[i], frames[k]) ? 1 : 0;
        }
        if (n > most) {
            most = n;
            *usual = i;
        }
    }
    for (size_t i = 0; i < count; i++) {
        if (!same(frames[*usual], frames[i])) {
            *odd = i;
            return true;
        }
    }
    return false;
}

static void camera_text(char *out, size_t size, const brace_frame *f) {
    snprintf(out, size, "%.60s%s%.60s", f->make, f->make[0] != '\0' && f->model[0] != '\0' ? " " : "", f->model);
    if (out[0] == '\0') {
        snprintf(out, size, "an unknown camera");
    }
}

static brace_status check_together(brace_frame *const *frames, size_t count, brace_error *error) {
    size_t odd = 0, usual = 0;
    namer a, b;
    for (size_t i = 0; i < count; i++) {
        for (size_t k = i + 1; k < count; k++) {
            if (frames[i] == frames[k] || (frames[i]->path != NULL && frames[i]->path[0] != '\0' &&
                                           frames[k]->path != NULL && strcmp(frames[i]->path, frames[k]->path) == 0)) {
                return core_fail(error, BRACE_ERROR_MISMATCH, "%s is given twice: a bracket needs different frames",
                                 frame_name(&a, frames, i));
            }
        }
    }
    if (odd_one_out(frames, count, same_camera, &odd, &usual)) {
        char this_one[160], others[160];
        camera_text(this_one, sizeof this_one, frames[odd]);
        camera_text(others, sizeof others, frames[usual]);
        return core_fail(error, BRACE_ERROR_MISMATCH,
                         "%s was taken with another camera (%s) than %s (%s): the frames of a bracket come from one "
                         "camera",
                         frame_name(&a, frames, odd), this_one, frame_name(&b, frames, usual), others);
    }
    if (odd_one_out(frames, count, same_size, &odd, &usual)) {
        const brace_frame *f = frames[odd], *g = frames[usual];
        bool turned = f->width == g->height && f->height == g->width;
        return core_fail(error, BRACE_ERROR_MISMATCH, "%s has %u x %u pixels, but %s has %u x %u: %s",
                         frame_name(&a, frames, odd), f->width, f->height, frame_name(&b, frames, usual), g->width,
                         g->height,
                         turned ? "one of them was turned; a bracket needs frames as the camera stored them"
                                : "the frames of a bracket have one size");
    }
    if (odd_one_out(frames, count, same_cfa, &odd, &usual)) {
        return core_fail(error, BRACE_ERROR_MISMATCH,
                         "%s has the colour filter order %s, but %s has %s: it was cropped differently; the frames of "
                         "a bracket show the same part of the sensor",
                         frame_name(&a, frames, odd), brace_cfa_name(frames[odd]->cfa), frame_name(&b, frames, usual),
                         brace_cfa_name(frames[usual]->cfa));
    }
    return BRACE_OK;
}

/* ---- exposure ---- */

/* True if every frame says the number; if some do and some don't, a note names one that does not. */
static bool all_say(brace_frame *const *frames, size_t count, double (*get)(const brace_frame *), const char *what,
                    const brace_job *job) {
    size_t missing = count, known = 0;
    for (size_t i = 0; i < count; i++) {
        if (get(frames[i]) > 0.0) {
            known++;
        } else if (missing == count) {
            missing = i;
        }
    }
    if (known > 0 && known < count) {
        namer a;
        core_note(job, "%s does not say its %s: the frames are taken as having the same",
                  frame_name(&a, frames, missing), what);
    }
    return known == count;
}

static double get_iso(const brace_frame *f) {
    return f->iso;
}

static double get_f_number(const brace_frame *f) {
    return f->f_number;
}

static brace_status find_exposures(double *out, brace_frame *const *frames, size_t count, const double *given,
                                   const brace_job *job, brace_error *error) {
    namer a;
    bool use_iso = given == NULL && all_say(frames, count, get_iso, "ISO", job);
    bool use_aperture = given == NULL && all_say(frames, count, get_f_number, "aperture", job);
    size_t low = 0, high = 0;
    for (size_t i = 0; i < count; i++) {
        const brace_frame *f = frames[i];
        if (given != NULL) {
            out[i] = given[i];
            if (!(given[i] > 0.0) || !isfinite(given[i])) {
                return core_fail(error, BRACE_ERROR_ARGUMENT,
                                 "the exposure %g given for %s is not above 0: give one number for each frame, such "
                                 "as its exposure time in seconds",
                                 given[i], frame_name(&a, frames, i));
            }
        } else {
            if (!(f->exposure_time > 0.0) || !isfinite(f->exposure_time)) {
                return core_fail(error, BRACE_ERROR_MISMATCH,
                                 "%s does not say its exposure time: give the times of all frames, in the order of "
                                 "the files, with --exposures",
                                 frame_name(&a, frames, i));
            }
            out[i] = f->exposure_time * (use_iso ? f->iso : 1.0) / (use_aperture ? f->f_number * f->f_number : 1.0);
        }
        low = out[i] < out[low] ? i : low;
        high = out[i] > out[high] ? i : high;
    }
    if (out[high] / out[low] < SAME_EXPOSURE) {
        return core_fail(error, BRACE_ERROR_MISMATCH,
                         "all %zu frames, from %s on, have the same exposure (within %.2f EV): a bracket needs shorter "
                         "and longer ones; was the camera's exposure locked?",
                         count, frame_name(&a, frames, 0), log2(out[high] / out[low]));
    }
    return BRACE_OK;
}

/* ---- what the pixels say ---- */

static int compare(const void *x, const void *y) {
    double a = *(const double *)x, b = *(const double *)y;
    return (a > b) - (a < b);
}

static void name_liars(const brace_bracket *b, const double *off, const brace_job *job) {
    double sorted[BRACE_BRACKET_MAX];
    size_t known = 0;
    for (size_t i = 0; i < b->count; i++) {
        if (!isnan(off[i])) {
            sorted[known++] = off[i];
        }
    }
    if (known < 2) {
        return;
    }
    qsort(sorted, known, sizeof sorted[0], compare);
    double middle = known % 2 == 1             ? sorted[known / 2]
                    : isnan(off[b->reference]) ? sorted[known / 2]
                                               : off[b->reference];
    for (size_t i = 0; i < b->count; i++) {
        if (!isnan(off[i]) && fabs(off[i] - middle) > CONTRADICTION_EV) {
            namer a;
            core_note(job,
                      "%s is %.1f EV %s than its exposure data say, compared with the other frames: was the "
                      "exposure locked, the light changed or the file edited?",
                      frame_name(&a, b->frames, i), fabs(off[i] - middle), off[i] > middle ? "brighter" : "darker");
        }
    }
}

/* Ratios between neighbours, chained to the reference. */
static void measure(brace_bracket *b, const brace_job *job) {
    double step[BRACE_BRACKET_MAX], jump[BRACE_BRACKET_MAX], off[BRACE_BRACKET_MAX];
    for (size_t i = 0; i + 1 < b->count; i++) {
        raw_ratio r = raw_measure_ratio(b->frames[i], b->frames[i + 1]);
        double expected = b->exposure[i] / b->exposure[i + 1];
        step[i] = r.ratio > 0.0 ? r.ratio : (double)NAN;
        jump[i] = log2(step[i] / expected);
        /* Bands may have taken much light from one frame by chance. Only if no stripe
         * of the picture comes near what the metadata say are they wrong. */
        double slack = exp2(STRIPE_MARGIN_EV);
        if (fabs(jump[i]) <= CONTRADICTION_EV || (expected >= r.low / slack && expected <= r.high * slack)) {
            jump[i] = isnan(jump[i]) ? jump[i] : 0.0;
        }
    }
    b->measured[b->reference] = 1.0;
    off[b->reference] = 0.0;
    for (size_t i = b->reference; i-- > 0;) {
        b->measured[i] = b->measured[i + 1] * step[i];
        off[i] = off[i + 1] + jump[i];
    }
    for (size_t i = b->reference; i + 1 < b->count; i++) {
        b->measured[i + 1] = b->measured[i] / step[i];
        off[i + 1] = off[i] - jump[i];
    }
    name_liars(b, off, job);
}

/* ---- making a bracket ---- */

static brace_status check_arguments(size_t count, const brace_bracket_params *params, brace_error *error) {
    if (count < BRACE_BRACKET_MIN) {
        return core_fail(error, BRACE_ERROR_ARGUMENT,
                         "%zu frame%s given: a bracket needs %d to %d exposures of the same screen", count,
                         count == 1 ? " was" : "s were", BRACE_BRACKET_MIN, BRACE_BRACKET_MAX);
    }
    if (count > BRACE_BRACKET_MAX) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%zu frames were given: a bracket has at most %d", count,
                         BRACE_BRACKET_MAX);
    }
    if (params->reference > count) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "frame %zu cannot be the reference: only %zu were given",
                         params->reference, count);
    }
    return BRACE_OK;
}

/* Sorts: order[] by exposure, the given order among equals. */
static void sort_order(size_t *order, const double *exposures, size_t count) {
    for (size_t i = 0; i < count; i++) {
        size_t k = i;
        while (k > 0 && exposures[order[k - 1]] > exposures[i]) {
            order[k] = order[k - 1];
            k--;
        }
        order[k] = i;
    }
}

brace_status brace_bracket_create(brace_bracket **out, brace_frame **frames, size_t count,
                                  const brace_bracket_params *params, const brace_job *job, brace_error *error) {
    static const brace_bracket_params none = {0};
    if (out == NULL || frames == NULL) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "frames and a place to put the bracket are needed");
    }
    *out = NULL;
    params = params != NULL ? params : &none;
    double exposures[BRACE_BRACKET_MAX] = {0};
    brace_status status = check_arguments(count, params, error);
    for (size_t i = 0; status == BRACE_OK && i < count; i++) {
        if (frames[i] == NULL) {
            status = core_fail(error, BRACE_ERROR_ARGUMENT, "frame %zu of the bracket is missing", i + 1);
        }
    }
    if (status == BRACE_OK) {
        status = check_together(frames, count, error);
    }
    if (status == BRACE_OK) {
        status = find_exposures(exposures, frames, count, params->exposures, job, error);
    }
    if (status == BRACE_OK) {
        status = core_check_cancel(job, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    brace_bracket *b = core_calloc(1, sizeof *b);
    if (b != NULL) {
        b->frames = core_calloc(count, sizeof(brace_frame *));
        b->exposure = core_calloc(count, sizeof(double));
        b->measured = core_calloc(count, sizeof(double));
        b->order = core_calloc(count, sizeof(size_t));
    }
    if (b == NULL || b->frames == NULL || b->exposure == NULL || b->measured == NULL || b->order == NULL) {
        brace_bracket_destroy(b); /* count is 0: the frames stay the caller's */
        return core_fail_memory(error, sizeof *b, "a bracket");
    }
    sort_order(b->order, exposures, count);
    b->reference = (count - 1) / 2;
    for (size_t i = 0; i < count; i++) {
        b->frames[i] = frames[b->order[i]];
        if (params->reference != 0 && b->order[i] == params->reference - 1) {
            b->reference = i;
        }
    }
    double unit = exposures[b->order[b->reference]];
    for (size_t i = 0; i < count; i++) {
        b->exposure[i] = exposures[b->order[i]] / unit;
    }
    b->count = count;
    measure(b, job);
    *out = b;
    return BRACE_OK;
}

void brace_bracket_destroy(brace_bracket *bracket) {
    if (bracket == NULL) {
        return;
    }
    for (size_t i = 0; i < bracket->count; i++) {
        brace_frame_destroy(bracket->frames[i]);
    }
    core_free(bracket->frames);
    core_free(bracket->exposure);
    core_free(bracket->measured);
    core_free(bracket->order);
    core_free(bracket);
}

/* ---- reading in parallel ---- */

enum { NOTES = 8 };

/* A worker may not call the job back: its notes wait here for the caller's thread. */
typedef struct read_slot {
    brace_frame *frame;
    brace_status status;
    brace_error error;
    size_t notes;
    char note[NOTES][256];
} read_slot;

typedef struct read_work {
    const char *const *paths;
    read_slot *slots;
    const brace_job *job;
} read_work;

static void keep_note(void *user, const char *message) {
    read_slot *slot = user;
    if (slot->notes < NOTES) {
        snprintf(slot->note[slot->notes++], sizeof slot->note[0], "%s", message);
    }
}

static void read_some(void *arg, size_t begin, size_t end, int worker) {
    read_work *work = arg;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        read_slot *slot = &work->slots[i];
        brace_job job = {.threads = 1, .note = keep_note, .user = slot};
        job.cancel = work->job != NULL ? work->job->cancel : NULL;
        slot->status = brace_frame_read(&slot->frame, work->paths[i], &job, &slot->error);
    }
}

brace_status brace_bracket_read(brace_bracket **out, const char *const *paths, size_t count,
                                const brace_bracket_params *params, const brace_job *job, brace_error *error) {
    static const brace_bracket_params none = {0};
    if (out == NULL || paths == NULL) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "file names and a place to put the bracket are needed");
    }
    *out = NULL;
    params = params != NULL ? params : &none;
    brace_status status = check_arguments(count, params, error);
    for (size_t i = 0; status == BRACE_OK && i < count; i++) {
        if (paths[i] == NULL) {
            status = core_fail(error, BRACE_ERROR_ARGUMENT, "the name of file %zu is missing", i + 1);
        }
    }
    if (status != BRACE_OK) {
        return status;
    }
    core_pool *pool = NULL;
    read_slot *slots = core_calloc(count, sizeof *slots);
    if (slots == NULL) {
        return core_fail_memory(error, count * sizeof *slots, "a bracket");
    }
    status = core_pool_create(&pool, job, error);
    read_work work = {.paths = paths, .slots = slots, .job = job};
    /* As many at a time as there are workers, so that progress can be told from this thread. */
    size_t batch = (size_t)core_pool_threads(pool);
    for (size_t done = 0; status == BRACE_OK && done < count; done += batch) {
        size_t n = count - done < batch ? count - done : batch;
        work.paths = paths + done;
        work.slots = slots + done;
        core_parallel(pool, n, 1, read_some, &work);
        for (size_t i = done; i < done + n; i++) {
            for (size_t k = 0; k < slots[i].notes; k++) {
                core_note(job, "%s", slots[i].note[k]);
            }
            if (slots[i].status != BRACE_OK && status == BRACE_OK) {
                status = slots[i].status;
                if (error != NULL) {
                    *error = slots[i].error;
                }
            }
        }
        if (status == BRACE_OK) {
            core_progress(job, "reading", done + n, count);
        }
    }
    core_pool_destroy(pool);
    brace_frame *frames[BRACE_BRACKET_MAX] = {NULL};
    for (size_t i = 0; i < count; i++) {
        frames[i] = slots[i].frame;
    }
    core_free(slots);
    if (status == BRACE_OK) {
        status = brace_bracket_create(out, frames, count, params, job, error);
    }
    for (size_t i = 0; status != BRACE_OK && i < count; i++) {
        brace_frame_destroy(frames[i]);
    }
    return status;
}
