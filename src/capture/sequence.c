/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sequence.c: sequence.json: what was planned, what was shot, what went wrong.
 * It is written after every good shot and read when an interrupted sequence
 * goes on, or a folder is checked: read as a stranger's.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "brace/version.h"
#include "capture/capture.h"
#include "sim/dataset.h"
#include "sim/json_check.h"

const char *capture_shot_stem(char out[48], const capture_sequence *sequence, const capture_shot *shot) {
    char name[32];
    capture_step_name(name, &sequence->plan.steps[shot->step]);
    if (shot->part > 0)
        snprintf(out, 48, "parts/%.20s_%d", name, shot->part);
    else
        snprintf(out, 48, "%s", name);
    return out;
}

void capture_sequence_init(capture_sequence *out, const capture_plan *plan) {
    *out = (capture_sequence){.plan = *plan};
    for (size_t i = 0; i < plan->count; i++)
        for (int part = 1; part <= plan->steps[i].shots && out->shot_count < CAPTURE_SHOTS_MAX; part++)
            out->shots[out->shot_count++] = (capture_shot){
                .step = i, .part = plan->steps[i].shots > 1 ? part : 0, .report.timestamp = -1, .ev = (double)NAN};
}

void capture_sequence_free(capture_sequence *sequence) {
    for (size_t i = 0; i < sequence->event_count; i++)
        core_free(sequence->events[i]);
    sequence->event_count = 0;
}

void capture_sequence_event(capture_sequence *sequence, const char *sentence) {
    if (sequence->event_count == CAPTURE_EVENTS_MAX)
        return;
    char *copy = core_strdup(sentence);
    if (copy != NULL)
        sequence->events[sequence->event_count++] = copy;
}

/* ---- writing ---- */

/* What is not known is not there. */
static void put_known(json_t *object, const char *key, double value) {
    if (isfinite(value) && value > 0)
        json_object_set_new(object, key, json_real(value));
}

static json_t *text(const char *bytes) {
    json_t *value = json_string(bytes);
    return value != NULL ? value : json_string("?"); /* not UTF-8 */
}

static json_t *plan_json(const capture_plan *plan) {
    json_t *list = json_array();
    for (size_t i = 0; i < plan->count; i++) {
        const capture_step *s = &plan->steps[i];
        char name[32];
        json_array_append_new(list,
                              json_pack("{s:s, s:b, s:f, s:f, s:f, s:f, s:i}", "name", capture_step_name(name, s),
                                        "truth", s->truth, "wanted_exposure", s->wanted_exposure, "wanted_iso",
                                        s->wanted_iso, "exposure", s->exposure, "iso", s->iso, "shots", s->shots));
    }
    return list;
}

static json_t *shot_json(const capture_sequence *q, const capture_shot *s) {
    char stem[48];
    json_t *o = json_pack("{s:s, s:b, s:i}", "name", capture_shot_stem(stem, q, s), "done", s->done, "tries", s->tries);
    if (o == NULL || !s->done)
        return o;
    const capture_shot_report *r = &s->report;
    json_object_set_new(o, "file", text(s->file));
    json_object_set_new(o, "bytes", json_integer((json_int_t)s->bytes));
    json_object_set_new(o, "sha256", json_string(s->sha256));
    put_known(o, "exposure", r->exposure);
    put_known(o, "iso", r->iso);
    put_known(o, "exif_exposure", s->exif_exposure);
    put_known(o, "exif_iso", s->exif_iso);
    if (r->timestamp >= 0)
        json_object_set_new(o, "timestamp", json_integer(r->timestamp));
    put_known(o, "skew", r->skew);
    if (r->has_noise)
        json_object_set_new(o, "noise",
                            json_pack("[f, f, f, f, f, f]", r->noise[0][0], r->noise[0][1], r->noise[1][0],
                                      r->noise[1][1], r->noise[2][0], r->noise[2][1]));
    if (r->orientation > 0)
        json_object_set_new(o, "orientation", json_integer(r->orientation));
    if (isfinite(s->ev))
        json_object_set_new(o, "ev", json_real(s->ev));
    if (s->accepted)
        json_object_set_new(o, "accepted", json_true());
    return o;
}

json_t *capture_sequence_json(const capture_sequence *q) {
    json_t *shots = json_array(), *events = json_array();
    for (size_t i = 0; i < q->shot_count; i++)
        json_array_append_new(shots, shot_json(q, &q->shots[i]));
    for (size_t i = 0; i < q->event_count; i++)
        json_array_append_new(events, text(q->events[i]));
    const capture_counts *c = &q->counts;
    json_t *device = json_pack("{s:s, s:o, s:o, s:o}", "camera", q->backend, "make", text(q->make), "model",
                               text(q->model), "id", text(q->id));
    json_t *counts =
        json_pack("{s:I, s:I, s:I, s:I, s:I, s:I, s:I}", "asked", (json_int_t)c->asked, "busy", (json_int_t)c->busy,
                  "dropped", (json_int_t)c->dropped, "reopened", (json_int_t)c->reopened, "unreadable",
                  (json_int_t)c->unreadable, "metadata", (json_int_t)c->metadata, "pixels", (json_int_t)c->pixels);
    if (device != NULL) {
        put_known(device, "readout", q->readout);
        put_known(device, "f_number", q->f_number);
    }
    json_t *o = json_pack("{s:s, s:s, s:b, s:o, s:o, s:o, s:o, s:o}", "format", CAPTURE_FORMAT, "software",
                          "BRACE " BRACE_VERSION_STRING, "complete", q->complete, "device", device, "plan",
                          plan_json(&q->plan), "shots", shots, "counts", counts, "events", events);
    if (o != NULL && q->truth_file[0] != '\0')
        json_object_set_new(o, "average",
                            json_pack("{s:s, s:I, s:s}", "file", q->truth_file, "bytes", (json_int_t)q->truth_bytes,
                                      "sha256", q->truth_sha256));
    if (o != NULL && q->has_motion) {
        const brace_motion *m = &q->motion;
        json_t *motion = json_pack("{s:f}", "confidence", m->confidence);
        if (isfinite(m->dx) && isfinite(m->dy))
            json_object_update_new(motion, json_pack("{s:f, s:f, s:f, s:f, s:f}", "dx", m->dx, "dy", m->dy, "rotation",
                                                     m->rotation, "scale", m->scale, "local", m->local));
        json_object_set_new(o, "motion", motion);
    }
    return o;
}

brace_status capture_sequence_save(const capture_sequence *sequence, const char *path, brace_error *error) {
    json_t *o = capture_sequence_json(sequence);
    if (o == NULL)
        return core_fail_memory(error, 4096, "the sequence's description");
    brace_status status = dataset_json_save(o, path, error);
    json_decref(o);
    return status;
}

/* ---- reading ---- */

static void copy(char *to, size_t size, const char *from) {
    snprintf(to, size, "%s", from);
}

static void read_device(capture_sequence *q, const json_at *root) {
    static const char *const keys[] = {"camera", "make", "model", "id", "readout", "f_number", NULL};
    json_at o;
    if (!json_check_object(root, "device", &o)) {
        json_check_fail(root, "device", "it is missing");
        return;
    }
    json_check_only(&o, keys);
    copy(q->backend, sizeof q->backend, json_check_string(&o, "camera", sizeof q->backend - 1, NULL));
    copy(q->make, sizeof q->make, json_check_string(&o, "make", sizeof q->make - 1, NULL));
    copy(q->model, sizeof q->model, json_check_string(&o, "model", sizeof q->model - 1, NULL));
    copy(q->id, sizeof q->id, json_check_string(&o, "id", sizeof q->id - 1, NULL));
    q->readout = json_check_number(&o, "readout", 0, 60, 0);
    q->f_number = json_check_number(&o, "f_number", 0, 1000, 0);
}

static void read_plan(capture_plan *plan, const json_at *root) {
    static const char *const keys[] = {"name",     "truth", "wanted_exposure", "wanted_iso",
                                       "exposure", "iso",   "shots",           NULL};
    json_at list, o;
    size_t truths = 0;
    if (!json_check_array(root, "plan", &list)) {
        json_check_fail(root, "plan", "it is missing");
        return;
    }
    while (json_check_element(&list, plan->count, &o)) {
        if (plan->count == CAPTURE_STEPS_MAX) {
            json_check_fail(&o, NULL, "%d steps are the most", CAPTURE_STEPS_MAX);
            return;
        }
        capture_step *s = &plan->steps[plan->count++];
        json_check_only(&o, keys);
        s->truth = json_check_bool(&o, "truth", false);
        s->wanted_exposure = json_check_number(&o, "wanted_exposure", 1e-9, 1e5, JSON_CHECK_REQUIRED);
        s->wanted_iso = json_check_number(&o, "wanted_iso", 1e-3, 1e9, JSON_CHECK_REQUIRED);
        s->exposure = json_check_number(&o, "exposure", 1e-9, 1e5, JSON_CHECK_REQUIRED);
        s->iso = json_check_number(&o, "iso", 1e-3, 1e9, JSON_CHECK_REQUIRED);
        s->shots = (int)json_check_integer(&o, "shots", 1, s->truth ? CAPTURE_AVERAGE_MAX : 1, 1);
        truths += s->truth;
        if (truths > 1)
            json_check_fail(&o, "truth", "there is one before");
    }
    if (plan->count - truths < BRACE_BRACKET_MIN || plan->count - truths > CAPTURE_FRAMES_MAX)
        json_check_fail(&list, NULL, "%zu frames; a bracket has %d to %d", plan->count - truths, BRACE_BRACKET_MIN,
                        CAPTURE_FRAMES_MAX);
}

static bool is_hash(const char *hex) {
    return strlen(hex) == 64 && strspn(hex, "0123456789abcdef") == 64;
}

/* Inside the folder, and no other name than the tool itself gives. */
static bool is_file_of(const char *file, const char *stem) {
    const size_t n = strlen(stem), length = strlen(file);
    return strncmp(file, stem, n) == 0 && file[n] == '.' && length > n + 1 && length <= n + 8 &&
           strspn(file + n + 1, "abcdefghijklmnopqrstuvwxyz0123456789") == length - n - 1;
}

static void read_shot(capture_shot *s, const capture_sequence *q, const json_at *o) {
    static const char *const keys[] = {
        "name",     "done",      "tries", "file",  "bytes",       "sha256", "exposure", "iso", "exif_exposure",
        "exif_iso", "timestamp", "skew",  "noise", "orientation", "ev",     "accepted", NULL};
    char stem[48];
    json_check_only(o, keys);
    capture_shot_stem(stem, q, s);
    if (strcmp(json_check_string(o, "name", 63, NULL), stem) != 0)
        json_check_fail(o, "name", "the plan has %s here", stem);
    s->done = json_check_bool(o, "done", false);
    s->tries = (int)json_check_integer(o, "tries", 0, 1000000, 0);
    if (!s->done)
        return;
    copy(s->file, sizeof s->file, json_check_string(o, "file", sizeof s->file - 1, NULL));
    if (!is_file_of(s->file, stem))
        json_check_fail(o, "file", "%s with an extension is expected", stem);
    s->bytes = (uint64_t)json_check_integer(o, "bytes", 0, INT64_MAX, JSON_CHECK_REQUIRED_INTEGER);
    copy(s->sha256, sizeof s->sha256, json_check_string(o, "sha256", 64, NULL));
    if (!is_hash(s->sha256))
        json_check_fail(o, "sha256", "64 hexadecimal digits are expected");
    capture_shot_report *r = &s->report;
    r->exposure = json_check_number(o, "exposure", 0, 1e5, 0);
    r->iso = json_check_number(o, "iso", 0, 1e9, 0);
    s->exif_exposure = json_check_number(o, "exif_exposure", 0, 1e9, 0);
    s->exif_iso = json_check_number(o, "exif_iso", 0, 1e9, 0);
    r->timestamp = json_check_integer(o, "timestamp", 0, INT64_MAX, -1);
    r->skew = json_check_number(o, "skew", 0, 60, 0);
    r->has_noise = json_check_numbers(o, "noise", &r->noise[0][0], 6, 6, -1e9, 1e9, false) == 6;
    r->orientation = (int)json_check_integer(o, "orientation", 1, 8, 0);
    s->ev = json_check_number(o, "ev", -100, 100, (double)NAN);
    s->accepted = json_check_bool(o, "accepted", false);
}

static void read_shots(capture_sequence *q, const json_at *root) {
    json_at list, o;
    size_t n = 0;
    if (!json_check_array(root, "shots", &list)) {
        json_check_fail(root, "shots", "it is missing");
        return;
    }
    for (; n < q->shot_count && json_check_element(&list, n, &o); n++)
        read_shot(&q->shots[n], q, &o);
    if (n != q->shot_count || json_check_element(&list, n, &o))
        json_check_fail(&list, NULL, "the plan has %zu shots, the list another number", q->shot_count);
}

static void read_rest(capture_sequence *q, const json_at *root) {
    static const char *const count_keys[] = {"asked",      "busy",     "dropped", "reopened",
                                             "unreadable", "metadata", "pixels",  NULL};
    static const char *const average_keys[] = {"file", "bytes", "sha256", NULL};
    static const char *const motion_keys[] = {"confidence", "dx", "dy", "rotation", "scale", "local", NULL};
    json_at o;
    if (json_check_object(root, "counts", &o)) {
        uint64_t *const to[] = {&q->counts.asked,      &q->counts.busy,     &q->counts.dropped, &q->counts.reopened,
                                &q->counts.unreadable, &q->counts.metadata, &q->counts.pixels};
        json_check_only(&o, count_keys);
        for (size_t i = 0; i < sizeof to / sizeof *to; i++)
            *to[i] = (uint64_t)json_check_integer(&o, count_keys[i], 0, 1000000000, 0);
    }
    if (json_check_object(root, "average", &o)) {
        json_check_only(&o, average_keys);
        copy(q->truth_file, sizeof q->truth_file, json_check_string(&o, "file", sizeof q->truth_file - 1, NULL));
        q->truth_bytes = (uint64_t)json_check_integer(&o, "bytes", 0, INT64_MAX, JSON_CHECK_REQUIRED_INTEGER);
        copy(q->truth_sha256, sizeof q->truth_sha256, json_check_string(&o, "sha256", 64, NULL));
        if (!is_file_of(q->truth_file, "gt") || !is_hash(q->truth_sha256))
            json_check_fail(&o, NULL, "no file and hash of an averaged truth");
    }
    if (json_check_object(root, "motion", &o)) {
        brace_motion *m = &q->motion;
        json_check_only(&o, motion_keys);
        q->has_motion = true;
        m->confidence = json_check_number(&o, "confidence", 0, 1, 0);
        m->dx = json_check_number(&o, "dx", -1e6, 1e6, (double)NAN);
        m->dy = json_check_number(&o, "dy", -1e6, 1e6, (double)NAN);
        m->rotation = json_check_number(&o, "rotation", -360, 360, (double)NAN);
        m->scale = json_check_number(&o, "scale", 0, 1e6, (double)NAN);
        m->local = json_check_number(&o, "local", 0, 1e6, 0);
    }
    if (json_check_array(root, "events", &o))
        for (size_t i = 0; i < json_array_size(o.value) && i < CAPTURE_EVENTS_MAX; i++) {
            const char *sentence = json_string_value(json_array_get(o.value, i));
            if (sentence == NULL || strlen(sentence) >= BRACE_ERROR_LENGTH) {
                json_check_fail(&o, NULL, "sentences are expected");
                return;
            }
            capture_sequence_event(q, sentence);
        }
}

static brace_status read_document(capture_sequence *out, json_check *doc, brace_error *error) {
    static const char *const keys[] = {"format", "software", "complete", "device", "plan", "shots",
                                       "counts", "events",   "average",  "motion", NULL};
    json_at root = json_check_root(doc);
    capture_plan plan = {0};
    json_check_only(&root, keys);
    if (strcmp(json_check_string(&root, "format", 63, NULL), CAPTURE_FORMAT) != 0)
        json_check_fail(&root, "format", "%s is expected", CAPTURE_FORMAT);
    json_check_string(&root, "software", 255, "");
    read_plan(&plan, &root);
    brace_status status = json_check_status(doc, error); /* shots are laid out by a sound plan only */
    if (status == BRACE_OK) {
        capture_plan_number(&plan);
        capture_sequence_init(out, &plan);
        out->complete = json_check_bool(&root, "complete", false);
        read_device(out, &root);
        read_shots(out, &root);
        read_rest(out, &root);
        status = json_check_status(doc, error);
    }
    return status;
}

static brace_status finish(capture_sequence *out, json_check *doc, brace_status status, brace_error *error) {
    *out = (capture_sequence){0};
    if (status == BRACE_OK)
        status = read_document(out, doc, error);
    json_check_destroy(doc);
    if (status != BRACE_OK) {
        capture_sequence_free(out);
        *out = (capture_sequence){0};
    }
    return status;
}

brace_status capture_sequence_parse(capture_sequence *out, const char *json, const char *name, brace_error *error) {
    json_check *doc = NULL;
    brace_status status = json_check_parse(&doc, json, name, error);
    return finish(out, doc, status, error);
}

brace_status capture_sequence_load(capture_sequence *out, const char *path, brace_error *error) {
    json_check *doc = NULL;
    brace_status status = json_check_load(&doc, path, error);
    return finish(out, doc, status, error);
}
