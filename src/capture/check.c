/* SPDX-License-Identifier: Apache-2.0 */
/*
 * check.c: a folder of RAW files, shot by any app: do they make a bracket, is
 * there a truth, do the pixels agree with what the files say, and what will take them?
 */
#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "capture/capture.h"
#include "core/sha256.h"

typedef struct checker {
    capture_checked *out;
    const char *folder;
    const brace_job *job;
    size_t count;
    char *paths[CAPTURE_CHECK_FILES];
    capture_probe probe[CAPTURE_CHECK_FILES]; /* without a sample: unreadable */
} checker;

static void add(char **list, size_t *count, const char *format, va_list args) {
    char sentence[BRACE_ERROR_LENGTH];
    vsnprintf(sentence, sizeof sentence, format, args);
    if (*count < CAPTURE_PROBLEMS_MAX && (list[*count] = core_strdup(sentence)) != NULL)
        (*count)++;
}

static void problem(checker *c, const char *format, ...) __attribute__((format(printf, 2, 3)));
static void problem(checker *c, const char *format, ...) {
    va_list args;
    va_start(args, format);
    add(c->out->problems, &c->out->problem_count, format, args);
    va_end(args);
}

static void remark(checker *c, const char *format, ...) __attribute__((format(printf, 2, 3)));
static void remark(checker *c, const char *format, ...) {
    va_list args;
    va_start(args, format);
    add(c->out->remarks, &c->out->remark_count, format, args);
    va_end(args);
}

/* What the reader of a file has to say. */
static void on_note(void *user, const char *message) {
    remark(user, "%s", message);
}

/* ---- which files ---- */

static bool is_raw(const char *name) {
    static const char *const ends[] = {"dng", "3fr", "arw", "cr2", "cr3", "crw", "erf", "iiq", "kdc", "mef",
                                       "nef", "nrw", "orf", "pef", "raf", "raw", "rw2", "rwl", "srw"};
    const char *dot = strrchr(name, '.');
    for (size_t i = 0; dot != NULL && name[0] != '.' && i < sizeof ends / sizeof *ends; i++)
        if (strcasecmp(dot + 1, ends[i]) == 0)
            return true;
    return false;
}

static int by_name(const struct dirent **a, const struct dirent **b) {
    return strverscmp((*a)->d_name, (*b)->d_name);
}

static brace_status find_files(checker *c, brace_error *error) {
    struct dirent **names;
    const int n = scandir(c->folder, &names, NULL, by_name);
    if (n < 0)
        return core_fail(error, BRACE_ERROR_IO, "%s: cannot look into this folder: %s", c->folder, strerror(errno));
    brace_status status = BRACE_OK;
    size_t found = 0;
    for (int i = 0; i < n; i++) {
        if (status == BRACE_OK && is_raw(names[i]->d_name) && found++ < CAPTURE_CHECK_FILES) {
            const size_t size = strlen(c->folder) + strlen(names[i]->d_name) + 2;
            char *path = core_alloc(size, 1);
            if (path == NULL) {
                status = core_fail_memory(error, size, "a name");
            } else {
                snprintf(path, size, "%s/%s", c->folder, names[i]->d_name);
                c->paths[c->count] = path;
                snprintf(c->out->files[c->count].name, sizeof c->out->files[0].name, "%s", names[i]->d_name);
                c->count++;
            }
        }
        free(names[i]);
    }
    free(names);
    if (status == BRACE_OK && found == 0)
        status = core_fail(error, BRACE_ERROR_IO,
                           "%s: there are no RAW files in this folder (.dng, .cr3, .nef, .arw, ...)", c->folder);
    if (status == BRACE_OK && found > CAPTURE_CHECK_FILES)
        problem(c, "%zu RAW files: a capture has at most ten; only the first %d were looked at", found,
                CAPTURE_CHECK_FILES);
    return status;
}

/* Metadata and a sample of the pixels; what cannot be read is a problem, not the end. */
static brace_status read_files(checker *c, brace_error *error) {
    brace_job job = {.note = on_note, .user = c};
    if (c->job != NULL)
        job.threads = c->job->threads, job.cancel = c->job->cancel;
    for (size_t i = 0; i < c->count; i++) {
        capture_checked_file *f = &c->out->files[i];
        brace_error why = {BRACE_OK, ""};
        brace_frame *frame = NULL;
        core_progress(c->job, "reading", i, c->count);
        brace_status status = brace_frame_read(&frame, c->paths[i], &job, &why);
        if (core_gave_up(status))
            return core_fail(error, status, "%s", why.message);
        f->readable = status == BRACE_OK;
        if (!f->readable) {
            problem(c, "%s", why.message);
            continue;
        }
        f->exposure = frame->exposure_time, f->iso = frame->iso;
        /* Where the ISO is not said it is taken as the same for all. */
        status = capture_probe_create(&c->probe[i], frame, f->name, f->exposure, f->iso > 0 ? f->iso : 100, error);
        f->clipped = c->probe[i].clipped;
        brace_frame_destroy(frame);
        if (status != BRACE_OK)
            return status;
    }
    core_progress(c->job, "reading", c->count, c->count);
    return BRACE_OK;
}

/* ---- which is what ---- */

static void swap_files(checker *c, size_t a, size_t b) {
    char *path = c->paths[a];
    const capture_probe probe = c->probe[a];
    const capture_checked_file file = c->out->files[a];
    c->paths[a] = c->paths[b], c->probe[a] = c->probe[b], c->out->files[a] = c->out->files[b];
    c->paths[b] = path, c->probe[b] = probe, c->out->files[b] = file;
}

/* By name, or as sets of samples have it: the one whose ISO is at most half of all the others'. */
static void find_truth(checker *c) {
    size_t lowest = c->count;
    for (size_t i = 0; i < c->count; i++) {
        const char *name = c->out->files[i].name;
        if (strncasecmp(name, "gt.", 3) == 0) {
            c->out->files[i].truth = true;
            return;
        }
        if (c->out->files[i].readable && c->out->files[i].iso > 0 &&
            (lowest == c->count || c->out->files[i].iso < c->out->files[lowest].iso))
            lowest = i;
    }
    for (size_t i = 0; i < c->count; i++)
        if (lowest == c->count ||
            (i != lowest && c->out->files[i].readable && !(c->out->files[lowest].iso <= 0.5 * c->out->files[i].iso)))
            return;
    c->out->files[lowest].truth = c->count > BRACE_BRACKET_MIN;
}

/* Shortest first, the truth last, unreadable ones after it. */
static int rank(const checker *c, size_t i) {
    return !c->out->files[i].readable ? 2 : c->out->files[i].truth ? 1 : 0;
}

static void sort_files(checker *c) {
    for (size_t i = 1; i < c->count; i++)
        for (size_t k = i; k > 0 && (rank(c, k) < rank(c, k - 1) ||
                                     (rank(c, k) == rank(c, k - 1) && c->probe[k].light < c->probe[k - 1].light));
             k--)
            swap_files(c, k, k - 1);
}

/* ---- do they belong together ---- */

static void check_bracket(checker *c, size_t frames) {
    capture_checked *out = c->out;
    size_t silent = 0;
    for (size_t i = 0; i < c->count; i++) {
        const capture_probe *p = &c->probe[i], *usual = &c->probe[0];
        const brace_frame *h = p->sample, *first = usual->sample;
        if (h == NULL || first == NULL)
            continue;
        if (!(h->exposure_time > 0)) {
            problem(c, "%s does not say its exposure time", out->files[i].name);
            silent++;
        }
        if (p->width != usual->width || p->height != usual->height || h->cfa != first->cfa ||
            strcmp(h->model, first->model) != 0)
            problem(c, "%s has another camera, size or CFA than %s", out->files[i].name, out->files[0].name);
        if (h->f_number > 0 && first->f_number > 0 && fabs(log2(h->f_number / first->f_number)) > 0.1)
            problem(c, "%s was shot at f/%g, %s at f/%g: keep the aperture", out->files[i].name, h->f_number,
                    out->files[0].name, first->f_number);
        if (i < frames && h->iso > 0 && fabs(log2(h->iso / first->iso)) > 0.1)
            remark(c, "%s has ISO %g, %s ISO %g: brackets are best shot at one ISO", out->files[i].name, h->iso,
                   out->files[0].name, first->iso);
    }
    if (frames < BRACE_BRACKET_MIN || frames > BRACE_BRACKET_MAX)
        problem(c, "%zu frame%s: a bracket has %d to %d", frames, frames == 1 ? "" : "s", BRACE_BRACKET_MIN,
                BRACE_BRACKET_MAX);
    else if (silent == 0 && !(c->probe[frames - 1].light / c->probe[0].light > 1.05))
        problem(c, "all frames have the same exposure: was it locked?");
    if (frames == 0 || silent > 0)
        return;
    out->reference = (frames - 1) / 2;
    for (size_t i = 0; i + 1 < frames; i++) {
        const double step = log2(c->probe[i + 1].light / c->probe[i].light);
        if (step < 0.5)
            remark(c, "%s and %s are %.1f EV apart: steps of 2 EV say more with fewer frames", out->files[i].name,
                   out->files[i + 1].name, step);
        else if (step > 3.1)
            remark(c, "%s and %s are %.1f EV apart: steps of 2 EV leave no gap", out->files[i].name,
                   out->files[i + 1].name, step);
    }
    if (out->files[0].clipped > 0.01)
        remark(c, "%.0f %% of the shortest frame, %s, is clipped: expose shorter", 100 * out->files[0].clipped,
               out->files[0].name);
    if (capture_brightest(&c->probe[frames - 1]) < 0.05)
        remark(c, "the longest frame, %s, shows hardly any light: is the lens cap on?", out->files[frames - 1].name);
    else if (out->files[frames - 1].clipped < 1e-4 && frames >= 3)
        remark(c, "nothing is clipped in the longest frame, %s: longer ones would average more flicker",
               out->files[frames - 1].name);
}

static void check_light(checker *c) {
    capture_checked *out = c->out;
    capture_probe present[CAPTURE_CHECK_FILES];
    size_t index[CAPTURE_CHECK_FILES], n = 0;
    for (size_t i = 0; i < c->count; i++) {
        capture_checked_file *f = &out->files[i];
        f->ev = f->measured = (double)NAN;
        if (!f->readable || !(c->probe[i].light > 0) || out->reference >= c->count)
            continue;
        f->ev = log2(c->probe[i].light / c->probe[out->reference].light);
        const capture_comparison found = capture_compare(&c->probe[i], &c->probe[out->reference]);
        f->measured = i == out->reference ? 0 : f->ev + found.ev;
        present[n] = c->probe[i];
        index[n++] = i;
    }
    char why[BRACE_ERROR_LENGTH / 2];
    bool doubtful;
    for (int liar; (liar = capture_find_liar(present, n, &doubtful, why, sizeof why)) >= 0;) {
        if (doubtful)
            remark(c, "%s: so short an exposure may fall between two pulses of the display", why);
        else
            problem(c, "%s", why);
        n--;
        for (size_t i = (size_t)liar; i < n; i++)
            present[i] = present[i + 1], index[i] = index[i + 1];
    }
}

/* ---- who takes it ---- */

static bool about(double value, double wanted) {
    return value > 0 && fabs(log2(value / wanted)) < 0.25;
}

/* The rules of `brace dataset import`. */
static void check_import(checker *c, size_t frames) {
    capture_checked *out = c->out;
    char *why = out->not_importable;
    const size_t size = sizeof out->not_importable;
    const bool truth = frames < c->count && out->files[frames].truth;
    if (c->count != 6 || frames != 5 || !truth) {
        snprintf(why, size, "five frames and a truth are needed, there are %zu frames and %s", frames,
                 truth ? "a truth" : "no truth (8 times the reference's exposure time at an eighth of its ISO)");
        return;
    }
    const capture_checked_file *r = &out->files[2], *t = &out->files[5];
    for (size_t i = 0; i < 5; i++) {
        const double wanted = ldexp(1, 2 * ((int)i - 2));
        if (!about(out->files[i].exposure / r->exposure, wanted) || !about(out->files[i].iso, r->iso)) {
            snprintf(why, size, "%s has %.3g times the reference's exposure at %.3g of its ISO, not %g at 1",
                     out->files[i].name, out->files[i].exposure / r->exposure, out->files[i].iso / r->iso, wanted);
            return;
        }
    }
    if (!about(t->exposure / r->exposure, 8) || !about(t->iso / r->iso, 0.125)) {
        snprintf(why, size,
                 "%s, the truth, has %.3g times the reference's exposure time at %.3g of its ISO, not 8 at 1/8",
                 t->name, t->exposure / r->exposure, t->iso / r->iso);
        return;
    }
    out->importable = true;
}

static brace_status check_motion(checker *c, size_t truth, brace_error *error) {
    capture_checked *out = c->out;
    const brace_job quiet = {.threads = c->job != NULL ? c->job->threads : 0,
                             .cancel = c->job != NULL ? c->job->cancel : NULL};
    brace_frame *fixed = NULL, *moved = NULL;
    brace_status status = brace_frame_read(&fixed, c->paths[out->reference], &quiet, error);
    if (status == BRACE_OK)
        status = brace_frame_read(&moved, c->paths[truth], &quiet, error);
    if (status == BRACE_OK)
        status = capture_motion(&out->motion, fixed, moved, &quiet, error);
    brace_frame_destroy(fixed);
    brace_frame_destroy(moved);
    if (status != BRACE_OK)
        return status;
    out->has_motion = true;
    const double away = hypot(out->motion.dx, out->motion.dy);
    if (!isfinite(away))
        remark(c, "%s cannot be laid on %s: too little texture, or another scene", out->files[truth].name,
               out->files[out->reference].name);
    else if (away > 4)
        remark(c, "%s lies %.1f pixels off %s: `brace dataset import` reduces by 4 and then allows 1; use a tripod",
               out->files[truth].name, away, out->files[out->reference].name);
    return BRACE_OK;
}

/* ---- sequence.json ---- */

static void check_hash(checker *c, const char *file, const char *sha256) {
    char path[PATH_MAX], hash[65];
    uint64_t bytes;
    if (snprintf(path, sizeof path, "%s/%s", c->folder, file) >= (int)sizeof path ||
        core_sha256_file(hash, path, &bytes, NULL) != BRACE_OK)
        problem(c, "%s is missing; sequence.json has it", file);
    else if (strcmp(hash, sha256) != 0)
        problem(c, "%s was changed since it was shot", file);
}

static brace_status check_sequence(checker *c, brace_error *error) {
    char path[PATH_MAX];
    struct stat info;
    if (snprintf(path, sizeof path, "%s/sequence.json", c->folder) >= (int)sizeof path || stat(path, &info) != 0)
        return BRACE_OK;
    capture_sequence *q = core_calloc(1, sizeof *q);
    if (q == NULL)
        return core_fail_memory(error, sizeof *q, "a sequence");
    brace_error why = {BRACE_OK, ""};
    brace_status status = capture_sequence_load(q, path, &why);
    if (status == BRACE_ERROR_MEMORY) {
        core_free(q);
        return core_fail(error, status, "%s", why.message);
    }
    if (status != BRACE_OK) {
        problem(c, "%s", why.message);
    } else {
        c->out->has_sequence = true;
        if (!q->complete)
            problem(c, "sequence.json is of an interrupted sequence");
        for (size_t i = 0; i < q->shot_count; i++) {
            const capture_shot *s = &q->shots[i];
            if (!s->done)
                continue;
            check_hash(c, s->file, s->sha256);
            if (s->accepted)
                remark(c, "%s contradicted the other frames when it was shot, and was kept", s->file);
        }
        if (q->truth_file[0] != '\0')
            check_hash(c, q->truth_file, q->truth_sha256);
    }
    capture_sequence_free(q);
    core_free(q);
    return BRACE_OK;
}

brace_status capture_check(capture_checked *out, const char *folder, const brace_job *job, brace_error *error) {
    *out = (capture_checked){0};
    checker *c = core_calloc(1, sizeof *c);
    if (c == NULL)
        return core_fail_memory(error, sizeof *c, "a check");
    *c = (checker){.out = out, .folder = folder, .job = job};
    brace_status status = find_files(c, error);
    if (status == BRACE_OK)
        status = read_files(c, error);
    if (status == BRACE_OK) {
        size_t frames = 0;
        find_truth(c);
        sort_files(c);
        while (frames < c->count && rank(c, frames) == 0)
            frames++;
        out->count = out->reference = c->count;
        check_bracket(c, frames);
        check_light(c);
        /* What the restoration minds is found by now; what sequence.json says does not bear on it. */
        out->restorable = out->problem_count == 0;
        check_import(c, frames);
        out->importable = out->importable && out->problem_count == 0;
        if (!out->importable && out->not_importable[0] == '\0')
            snprintf(out->not_importable, sizeof out->not_importable, "of the problems named");
        if (frames < c->count && rank(c, frames) == 1 && out->reference < c->count)
            status = check_motion(c, frames, error);
    }
    if (status == BRACE_OK)
        status = check_sequence(c, error);
    for (size_t i = 0; i < CAPTURE_CHECK_FILES; i++) {
        core_free(c->paths[i]);
        capture_probe_free(&c->probe[i]);
    }
    core_free(c);
    return status;
}

void capture_checked_free(capture_checked *checked) {
    for (size_t i = 0; i < checked->problem_count; i++)
        core_free(checked->problems[i]);
    for (size_t i = 0; i < checked->remark_count; i++)
        core_free(checked->remarks[i]);
    checked->problem_count = checked->remark_count = 0;
}
