/* SPDX-License-Identifier: Apache-2.0 */
/*
 * run.c: shoots a plan: every frame is fetched, read back, compared with the plan
 * and with the frames before it, and shot again if it is not what it was to be.
 * The folder gets its name when all is there (run_folder.c); until then it can
 * be gone on with.
 */
#include <limits.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#include "capture/run.h"
#include "core/sha256.h"

enum { BUSY_MOST = 12, REOPEN_MOST = 6 };

/* ---- telling ---- */

static void tell(const capture_session *s, const capture_shot *shot, const char *message) {
    if (s->params->event != NULL)
        s->params->event(s->params->user, &(capture_event){.sequence = s->sequence, .shot = shot, .message = message});
}

/* A mishap: kept in sequence.json, too. */
static void mishap(capture_session *s, const char *format, ...) __attribute__((format(printf, 2, 3)));
static void mishap(capture_session *s, const char *format, ...) {
    char sentence[BRACE_ERROR_LENGTH];
    va_list args;
    va_start(args, format);
    vsnprintf(sentence, sizeof sentence, format, args);
    va_end(args);
    /* The hidden folder's name is nobody's business. */
    const bool hidden = strncmp(sentence, s->folder, s->prefix - 1) == 0 && sentence[s->prefix - 1] == '/';
    const char *said = sentence + (hidden ? s->prefix : 0);
    capture_sequence_event(s->sequence, said);
    tell(s, NULL, said);
}

static void show_progress(const capture_session *s) {
    size_t done = 0;
    for (size_t i = 0; i < s->sequence->shot_count; i++)
        done += s->sequence->shots[i].done;
    core_progress(s->job, "shooting", done, s->sequence->shot_count);
}

/* ---- one exposure ---- */

static brace_status back_off(const capture_session *s, int times, brace_error *error) {
    const double first = s->params->backoff > 0 ? s->params->backoff : 0.1;
    return capture_wait(first * ldexp(1, times < 5 ? times : 5), s->job, error);
}

/* The device is gone: closes it, and opens it again after a while. */
static brace_status reopen(capture_session *s, brace_error *error) {
    brace_status status = BRACE_OK;
    s->backend->close(s->camera, s->job);
    s->camera = NULL;
    for (int i = 0; i < REOPEN_MOST && s->camera == NULL; i++) {
        status = back_off(s, i, error);
        if (status != BRACE_OK)
            return status;
        capture_address again = *s->address;
        again.shots = s->sequence->counts.asked;
        status = s->backend->open(&s->camera, &again, s->job, error);
        if (core_gave_up(status))
            return status;
    }
    if (status != BRACE_OK) {
        core_error_prefix(error, "the camera was lost and could not be opened again");
        return status;
    }
    s->sequence->counts.reopened++;
    return BRACE_OK;
}

/* Releases until the device has given a file, or there is no hope. */
static brace_status release(capture_session *s, capture_shot *shot, const char *stem, brace_error *error) {
    const capture_step *step = &s->sequence->plan.steps[shot->step];
    capture_counts *counts = &s->sequence->counts;
    int busy = 0, gone = 0;
    for (;;) {
        brace_error problem = {BRACE_OK, ""};
        shot->report = (capture_shot_report){.timestamp = -1};
        counts->asked++;
        brace_status status =
            s->backend->shoot(s->camera, step->exposure, step->iso, stem, &shot->report, s->job, &problem);
        if (status == BRACE_OK) {
            shot->tries++;
            return BRACE_OK;
        }
        const char *message = problem.message;
        const capture_trouble trouble = core_gave_up(status) ? CAPTURE_TROUBLE_FINAL : shot->report.trouble;
        brace_status next = BRACE_OK;
        switch (trouble) {
        case CAPTURE_TROUBLE_BUSY:
            counts->busy++;
            if (++busy > BUSY_MOST)
                return core_fail(error, status, "%s; it stayed so, %d times", message, busy);
            next = back_off(s, busy - 1, error);
            break;
        case CAPTURE_TROUBLE_DROPPED:
            counts->dropped++;
            mishap(s, "%s: %s", stem + s->prefix, message);
            if (++shot->tries >= s->tries)
                return core_fail(error, status, "%s; %d times in all", message, shot->tries);
            break;
        case CAPTURE_TROUBLE_GONE:
            mishap(s, "%s: %s", stem + s->prefix, message);
            if (++gone > s->tries)
                return core_fail(error, status, "%s; it was lost again after every try", message);
            next = reopen(s, error);
            break;
        case CAPTURE_TROUBLE_FINAL:
            return core_fail(error, status, "%s", message);
        }
        if (next != BRACE_OK)
            return next;
    }
}

/* ---- is it what it was to be ---- */

static brace_status same_kind(const capture_session *s, const brace_frame *frame, const char *name,
                              brace_error *error) {
    for (size_t i = 0; i < s->sequence->shot_count; i++) {
        const capture_probe *p = &s->probes[i];
        if (p->sample != NULL && (frame->width != p->width || frame->height != p->height ||
                                  frame->cfa != p->sample->cfa || strcmp(frame->model, p->sample->model) != 0))
            return core_fail(error, BRACE_ERROR_MISMATCH, "%s has %u x %u pixels of a %s, %s has %u x %u of a %s", name,
                             frame->width, frame->height, frame->model, p->name, p->width, p->height, p->sample->model);
    }
    return BRACE_OK;
}

/* Reads a file back. *again: it is not what was asked for, and worth another try. */
static brace_status inspect(capture_session *s, size_t index, const char *path, bool *again, brace_error *error) {
    capture_shot *shot = &s->sequence->shots[index];
    const capture_step *step = &s->sequence->plan.steps[shot->step];
    capture_counts *counts = &s->sequence->counts;
    brace_frame *frame = NULL;
    char stem[48];
    capture_shot_stem(stem, s->sequence, shot);
    *again = false;
    brace_status status = brace_frame_read(&frame, path, s->job, error);
    if (status == BRACE_ERROR_IO || status == BRACE_ERROR_FORMAT) {
        counts->unreadable++;
        *again = true;
        return status;
    }
    if (status != BRACE_OK)
        return status;
    status = same_kind(s, frame, stem, error);
    if (status == BRACE_OK)
        status = capture_verify_metadata(frame, stem, step->exposure, step->iso, s->job, error);
    if (status != BRACE_OK) {
        counts->metadata++;
        *again = true;
    }
    if (status == BRACE_OK) {
        capture_probe_free(&s->probes[index]);
        status = capture_probe_create(&s->probes[index], frame, stem, step->exposure, step->iso, error);
    }
    if (status == BRACE_OK) {
        shot->exif_exposure = frame->exposure_time, shot->exif_iso = frame->iso;
        if (shot->report.orientation == 0)
            shot->report.orientation = frame->orientation;
        if (!shot->report.has_noise && frame->has_noise) {
            memcpy(shot->report.noise, frame->noise, sizeof frame->noise);
            shot->report.has_noise = true;
        }
    }
    brace_frame_destroy(frame);
    return status;
}

static void forget(capture_session *s, size_t index) {
    capture_shot *shot = &s->sequence->shots[index];
    char path[PATH_MAX];
    if (shot->file[0] != '\0' && session_path(path, s, shot->file))
        unlink(path);
    shot->done = false;
    capture_probe_free(&s->probes[index]);
}

/* One frame, until it is good by itself. */
static brace_status shoot(capture_session *s, size_t index, brace_error *error) {
    capture_shot *shot = &s->sequence->shots[index];
    char stem[48], path[PATH_MAX], full[PATH_MAX];
    capture_shot_stem(stem, s->sequence, shot);
    if (!session_path(full, s, stem))
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%.200s...: the name is too long", s->folder);
    for (;;) {
        brace_status status = core_check_cancel(s->job, error);
        if (status == BRACE_OK && s->last_end > 0)
            status = capture_wait(s->last_end + s->camera->limits.interval - core_seconds(), s->job, error);
        if (status == BRACE_OK)
            status = release(s, shot, full, error);
        if (status != BRACE_OK)
            return status;
        s->last_end = core_seconds();
        char extension[sizeof shot->report.extension];
        memcpy(extension, shot->report.extension, sizeof extension);
        snprintf(shot->file, sizeof shot->file, "%s.%s", stem, extension);
        if (!session_path(path, s, shot->file))
            return core_fail(error, BRACE_ERROR_ARGUMENT, "%.200s...: the name is too long", s->folder);
        bool again;
        brace_error problem = {BRACE_OK, ""};
        status = inspect(s, index, path, &again, &problem);
        if (status == BRACE_OK)
            status = core_sha256_file(shot->sha256, path, &shot->bytes, error);
        else if (!again || shot->tries >= s->tries)
            core_fail(error, status, again ? "%s, %d times" : "%s", problem.message, shot->tries);
        if (status == BRACE_OK) {
            shot->done = true;
            return BRACE_OK;
        }
        forget(s, index);
        if (!again || shot->tries >= s->tries)
            return status;
        mishap(s, "%s; shot again", problem.message);
    }
}

/* All good frames against each other. One that lies is to be shot again; *kept says whether none does. */
static brace_status cross_check(capture_session *s, brace_error *error) {
    capture_sequence *q = s->sequence;
    capture_probe present[CAPTURE_SHOTS_MAX];
    size_t index[CAPTURE_SHOTS_MAX];
    char why[BRACE_ERROR_LENGTH / 2];
    for (;;) {
        size_t n = 0;
        for (size_t i = 0; i < q->shot_count; i++)
            if (q->shots[i].done && !q->shots[i].accepted) {
                present[n] = s->probes[i];
                present[n].tries = q->shots[i].tries;
                index[n++] = i;
            }
        bool doubtful;
        const int liar = capture_find_liar(present, n, &doubtful, why, sizeof why);
        if (liar < 0)
            return BRACE_OK;
        capture_shot *shot = &q->shots[index[liar]];
        q->counts.pixels++;
        if (shot->tries < s->tries) {
            mishap(s, "%s; shot again", why);
            forget(s, index[liar]);
        } else if (s->params->accept || doubtful) {
            shot->accepted = true;
            mishap(s, "%s, also after %d tries; kept all the same%s", why, shot->tries,
                   doubtful ? ": so short an exposure may fall between two pulses of the display" : "");
        } else {
            forget(s, index[liar]);
            return core_fail(error, BRACE_ERROR_MISMATCH, "%s, also after %d tries", why, shot->tries);
        }
    }
}

/* ---- the end ---- */

static const capture_shot *shot_of_step(const capture_sequence *q, size_t step, size_t *index) {
    for (size_t i = 0; i < q->shot_count; i++)
        if (q->shots[i].step == step) {
            *index = i;
            return &q->shots[i];
        }
    return NULL;
}

static brace_status read_back(brace_frame **out, const capture_session *s, const char *file, brace_error *error) {
    char path[PATH_MAX];
    if (!session_path(path, s, file))
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%.200s...: the name is too long", s->folder);
    const brace_job quiet = {.threads = s->job != NULL ? s->job->threads : 0,
                             .cancel = s->job != NULL ? s->job->cancel : NULL};
    return brace_frame_read(out, path, &quiet, error);
}

/* The truth as the mean of its parts. */
static brace_status average(capture_session *s, size_t step, brace_frame **truth, brace_error *error) {
    capture_sequence *q = s->sequence;
    capture_average *sum = NULL;
    brace_status status = BRACE_OK;
    char path[PATH_MAX];
    for (size_t i = 0; i < q->shot_count && status == BRACE_OK; i++) {
        brace_frame *part = NULL;
        if (q->shots[i].step != step)
            continue;
        status = read_back(&part, s, q->shots[i].file, error);
        if (status == BRACE_OK)
            status = capture_average_add(&sum, part, error);
        brace_frame_destroy(part);
    }
    if (status == BRACE_OK)
        status = capture_average_finish(truth, sum, error);
    capture_average_destroy(sum);
    if (status == BRACE_OK) {
        snprintf(q->truth_file, sizeof q->truth_file, "gt.dng");
        if (!session_path(path, s, q->truth_file))
            return core_fail(error, BRACE_ERROR_ARGUMENT, "%.200s...: the name is too long", s->folder);
        status = brace_frame_write_dng(*truth, path, &(brace_dng_params){.no_sync = true}, s->job, error);
    }
    return status == BRACE_OK ? core_sha256_file(q->truth_sha256, path, &q->truth_bytes, error) : status;
}

/* Light against the reference, the truth, and how far it lies off. */
static brace_status conclude(capture_session *s, brace_error *error) {
    capture_sequence *q = s->sequence;
    size_t r = 0;
    const capture_shot *reference = shot_of_step(q, q->plan.reference, &r);
    double brightest = 0;
    for (size_t i = 0; i < q->shot_count; i++)
        brightest = fmax(brightest, capture_brightest(&s->probes[i]));
    if (brightest < 0.05)
        mishap(s, "no frame shows more than %.0f %% of white: is the lens cap on?", 100 * brightest);
    for (size_t i = 0; i < q->shot_count && reference != NULL; i++)
        q->shots[i].ev = i == r ? 0 : capture_compare(&s->probes[i], &s->probes[r]).ev;
    brace_status status = BRACE_OK;
    for (size_t step = 0; step < q->plan.count && status == BRACE_OK && reference != NULL; step++) {
        size_t t = 0;
        brace_frame *truth = NULL, *fixed = NULL;
        if (!q->plan.steps[step].truth)
            continue;
        const capture_shot *shot = shot_of_step(q, step, &t);
        status =
            q->plan.steps[step].shots > 1 ? average(s, step, &truth, error) : read_back(&truth, s, shot->file, error);
        if (status == BRACE_OK)
            status = read_back(&fixed, s, reference->file, error);
        if (status == BRACE_OK)
            status = capture_motion(&q->motion, fixed, truth, s->job, error);
        q->has_motion = status == BRACE_OK;
        brace_frame_destroy(truth);
        brace_frame_destroy(fixed);
    }
    return status;
}

static brace_status shoot_all(capture_session *s, brace_error *error) {
    capture_sequence *q = s->sequence;
    for (;;) {
        size_t next = 0;
        while (next < q->shot_count && q->shots[next].done)
            next++;
        show_progress(s);
        if (next == q->shot_count)
            return BRACE_OK;
        brace_status status = shoot(s, next, error);
        if (status == BRACE_OK)
            status = cross_check(s, error);
        if (status == BRACE_OK && q->shots[next].done)
            tell(s, &q->shots[next], NULL);
        const brace_status saved = session_save(s, status == BRACE_OK ? error : NULL);
        if (status == BRACE_OK)
            status = saved;
        if (status != BRACE_OK)
            return status;
    }
}

/* Whether a frame that was shot before is still what it was. */
static brace_status recheck(capture_session *s, size_t index, brace_error *error) {
    const capture_shot *shot = &s->sequence->shots[index];
    char path[PATH_MAX], hash[65];
    uint64_t bytes;
    bool again;
    if (!session_path(path, s, shot->file))
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%.200s...: the name is too long", s->folder);
    const brace_status status = core_sha256_file(hash, path, &bytes, error);
    if (status != BRACE_OK)
        return status;
    if (strcmp(hash, shot->sha256) != 0)
        return core_fail(error, BRACE_ERROR_FORMAT, "%s is not the file that was written", shot->file);
    return inspect(s, index, path, &again, error);
}

/* The plan, or what was left of it; and the frames that are there already. */
static brace_status prepare(capture_session *s, brace_error *error) {
    capture_sequence *q = s->sequence;
    const capture_limits *l = &s->camera->limits;
    capture_plan plan;
    brace_status status = BRACE_OK;
    if (!s->resumed || s->params->own_plan)
        status = capture_plan_create(&plan, &s->params->plan, l, s->job, error);
    if (status != BRACE_OK)
        return status;
    if (s->resumed) {
        if (strcmp(q->make, l->make) != 0 || strcmp(q->model, l->model) != 0)
            return core_fail(error, BRACE_ERROR_MISMATCH,
                             "the interrupted sequence was shot with a %s %s, this is a %s %s", q->make, q->model,
                             l->make, l->model);
        bool same = !s->params->own_plan || plan.count == q->plan.count;
        for (size_t i = 0; same && s->params->own_plan && i < plan.count; i++) {
            const capture_step *a = &plan.steps[i], *b = &q->plan.steps[i];
            same = a->truth == b->truth && a->exposure == b->exposure && a->iso == b->iso && a->shots == b->shots;
        }
        if (!same)
            return core_fail(error, BRACE_ERROR_ARGUMENT,
                             "the interrupted sequence has another plan: go on with it without "
                             "giving one, or start over");
    } else {
        capture_sequence_init(q, &plan);
        snprintf(q->backend, sizeof q->backend, "%s", s->backend->name);
        snprintf(q->make, sizeof q->make, "%s", l->make);
        snprintf(q->model, sizeof q->model, "%s", l->model);
        snprintf(q->id, sizeof q->id, "%s", l->id);
        q->readout = l->readout, q->f_number = l->f_number;
    }
    for (size_t i = 0; i < q->shot_count && status == BRACE_OK; i++) {
        capture_shot *shot = &q->shots[i];
        brace_error problem = {0};
        shot->tries = 0;
        if (!shot->done)
            continue;
        const capture_shot was = *shot;
        const brace_status found = recheck(s, i, &problem);
        if (core_gave_up(found)) {
            if (error != NULL)
                *error = problem;
            return found;
        }
        if (found != BRACE_OK) {
            mishap(s, "%s is damaged or gone; shot again", was.file);
            forget(s, i);
        } else {
            shot->tries = 1;
        }
    }
    return session_tidy(s, error);
}

brace_status capture_run(capture_sequence *out, const capture_backend *backend, const capture_address *address,
                         const char *folder, const capture_run_params *params, const brace_job *job,
                         brace_error *error) {
    static const capture_run_params defaults;
    *out = (capture_sequence){0};
    capture_session s = {.sequence = out, .backend = backend, .address = address, .job = job};
    s.params = params != NULL ? params : &defaults;
    s.tries = s.params->tries > 0 ? s.params->tries : 4;
    brace_status status = session_begin(&s, folder, error);
    if (status == BRACE_OK) {
        capture_address first = *address;
        first.shots += out->counts.asked;
        status = backend->open(&s.camera, &first, job, error);
    }
    if (status == BRACE_OK)
        status = prepare(&s, error);
    if (status == BRACE_OK)
        status = session_save(&s, error);
    if (status == BRACE_OK)
        status = shoot_all(&s, error);
    /* The camera is not needed any more, and gets its settings back whatever happens now. */
    if (s.camera != NULL)
        backend->close(s.camera, job);
    if (status == BRACE_OK)
        status = conclude(&s, error);
    out->complete = status == BRACE_OK;
    if (status == BRACE_OK)
        status = session_save(&s, error);
    out->complete = status == BRACE_OK;
    status = session_end(&s, status, error);
    for (size_t i = 0; i < CAPTURE_SHOTS_MAX; i++)
        capture_probe_free(&s.probes[i]);
    return status;
}
