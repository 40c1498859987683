/* SPDX-License-Identifier: Apache-2.0 */
/*
 * plan.c: which exposures to shoot, in which order: the BRACE paper's by
 * default, 16, 4, 1, 1/4 and 1/16 times the reference's exposure time at one ISO,
 * then 8 times the time at an eighth of the ISO as truth. The longest is first and the truth last, so that
 * the reference and what it is compared with are close in time.
 *
 * A truth whose ISO the device does not have is split: n shots of an n-th of the
 * time at n times the ISO collect the same light, and their mean has the same
 * signal and as much time to average flicker over.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "capture/capture.h"

/* What differs by less, in EV, is not worth a word: dials are rounded. */
#define SAME_EV 0.06
/* Half of a dial's third of a stop. Sets of samples take a quarter of a stop for what was meant. */
#define NEAR_EV 0.17

double capture_nearest(double wanted, const double *stops, size_t count, double low, double high) {
    if (count == 0)
        return fmin(fmax(wanted, low), high);
    size_t best = 0;
    for (size_t i = 1; i < count; i++)
        if (fabs(log(stops[i] / wanted)) < fabs(log(stops[best] / wanted)))
            best = i;
    return stops[best];
}

const char *capture_time_text(char out[32], double seconds) {
    if (!(seconds > 0))
        snprintf(out, 32, "?");
    else if (seconds < 0.3)
        snprintf(out, 32,
                 fabs(1 / seconds - round(1 / seconds)) < 0.005 / seconds || seconds < 0.01 ? "1/%.0f s" : "1/%.1f s",
                 1 / seconds);
    else
        snprintf(out, 32, "%.3g s", seconds);
    return out;
}

const char *capture_step_name(char out[32], const capture_step *step) {
    if (step->truth)
        snprintf(out, 32, "gt");
    else
        snprintf(out, 32, "frame_%d", step->number);
    return out;
}

static double light(const capture_step *s) {
    return s->exposure * s->iso;
}

double capture_step_ev(const capture_plan *plan, size_t step) {
    return log2(light(&plan->steps[step]) / light(&plan->steps[plan->reference]));
}

size_t capture_plan_shots(const capture_plan *plan) {
    size_t n = 0;
    for (size_t i = 0; i < plan->count; i++)
        n += (size_t)plan->steps[i].shots;
    return n;
}

double capture_plan_seconds(const capture_plan *plan, const capture_limits *limits) {
    double sum = 0;
    for (size_t i = 0; i < plan->count; i++)
        sum += plan->steps[i].shots * (plan->steps[i].exposure + limits->readout + limits->interval);
    return fmax(sum - limits->interval, 0);
}

/* ---- what was asked for ---- */

/* "16", "1/4", "2.5": above 0; all of the text up to `end`. */
static bool parse_ratio(const char *text, const char *end, double *value) {
    char copy[48], *rest;
    const size_t n = (size_t)(end - text);
    if (n == 0 || n >= sizeof copy)
        return false;
    memcpy(copy, text, n);
    copy[n] = '\0';
    if (copy[0] < '0' || copy[0] > '9' || strspn(copy, "0123456789./") != n)
        return false;
    double over = strtod(copy, &rest), under = 1;
    if (*rest == '/') {
        const char *second = rest + 1;
        if (*second < '0' || *second > '9')
            return false;
        under = strtod(second, &rest);
    }
    *value = over / under;
    return *rest == '\0' && isfinite(*value) && *value > 0;
}

static brace_status parse_item(capture_step *out, const char *item, const char *end, double time, double iso,
                               brace_error *error) {
    const char *start = item;
    if (end - item > 3 && strncmp(item, "gt:", 3) == 0)
        out->truth = true, item += 3;
    const char *at = memchr(item, '@', (size_t)(end - item)), *time_end = at != NULL ? at : end;
    const bool seconds = time_end > item && time_end[-1] == 's';
    double t, k = 1;
    bool good = parse_ratio(item, time_end - (seconds ? 1 : 0), &t);
    out->wanted_iso = iso;
    if (good && at != NULL) {
        const bool absolute = end - at > 4 && strncmp(at + 1, "iso", 3) == 0;
        good = parse_ratio(at + (absolute ? 4 : 1), end, &k);
        out->wanted_iso = absolute ? k : k * iso;
    }
    if (!good)
        return core_fail(
            error, BRACE_ERROR_ARGUMENT,
            "'%.*s' in the list of shots is none: TIME or TIME@ISO, such as 4, 1/50s, 8@1/8, 1/20s@iso100, "
            "or gt:8@1/8 for the truth",
            (int)fmin((double)(end - start), 60), start);
    out->wanted_exposure = seconds ? t : t * time;
    if (!(out->wanted_exposure >= 1e-7 && out->wanted_exposure <= 3600 && out->wanted_iso >= 1 &&
          out->wanted_iso <= 1e7))
        return core_fail(error, BRACE_ERROR_ARGUMENT,
                         "'%.*s' in the list of shots comes to %g s at ISO %g: out of range",
                         (int)fmin((double)(end - start), 60), start, out->wanted_exposure, out->wanted_iso);
    return BRACE_OK;
}

static brace_status parse_list(capture_plan *out, const char *list, double time, double iso, brace_error *error) {
    size_t truths = 0;
    for (const char *item = list;;) {
        const char *end = item + strcspn(item, ",");
        capture_step step = {.shots = 1};
        brace_status status = parse_item(&step, item, end, time, iso, error);
        if (status != BRACE_OK)
            return status;
        truths += step.truth;
        if (out->count == CAPTURE_STEPS_MAX || truths > 1 || out->count - truths + 1 > CAPTURE_FRAMES_MAX)
            return core_fail(error, BRACE_ERROR_ARGUMENT,
                             "the list of shots is too long: %d frames and one truth at most", CAPTURE_FRAMES_MAX);
        out->steps[out->count++] = step;
        if (*end == '\0')
            return BRACE_OK;
        item = end + 1;
    }
}

static void paper_list(capture_plan *out, const capture_plan_params *p, double time, double iso) {
    const int frames = p->frames > 0 ? p->frames : 5;
    const double step = p->step > 0 ? p->step : 4;
    for (int i = frames - 1; i >= 0; i--)
        out->steps[out->count++] =
            (capture_step){.wanted_exposure = time * pow(step, i - frames / 2), .wanted_iso = iso, .shots = 1};
    if (!p->no_truth)
        out->steps[out->count++] =
            (capture_step){.truth = true, .wanted_exposure = 8 * time, .wanted_iso = iso / 8, .shots = 1};
}

/* ---- what the device can do ---- */

static void set_nearest(capture_step *s, double exposure, double iso, const capture_limits *l) {
    s->exposure = capture_nearest(exposure, l->exposures, l->exposure_count, l->exposure_min, l->exposure_max);
    s->iso = capture_nearest(iso, l->isos, l->iso_count, l->iso_min, l->iso_max);
}

static bool near(double a, double b, double ev) {
    return fabs(log2(a / b)) <= ev;
}

/* As few shots as there may be, each an n-th of the time at n times the ISO. With as many as the truth is times longer
 * than the reference they are the reference's own exposure, which the device has. */
static void fit_truth(capture_step *s, const capture_limits *l) {
    const double total = s->wanted_exposure, product = s->wanted_exposure * s->wanted_iso;
    for (int n = 1; n <= CAPTURE_AVERAGE_MAX; n++) {
        set_nearest(s, total / n, s->wanted_iso * n, l);
        s->exposure =
            capture_nearest(product / s->iso, l->exposures, l->exposure_count, l->exposure_min, l->exposure_max);
        s->shots = n;
        if (near(s->exposure * n, total, NEAR_EV) && near(light(s), product, NEAR_EV))
            return;
    }
    set_nearest(s, s->wanted_exposure, s->wanted_iso, l);
    s->shots = 1;
}

static void say(const capture_step *s, const brace_job *job) {
    char name[32], a[32], b[32];
    capture_step_name(name, s);
    if (s->shots > 1)
        core_note(
            job,
            "%s: ISO %g for %s is not to be had; the mean of %d shots of %s at ISO %g takes its place. Bands average "
            "out in it less than in one long exposure",
            name, s->wanted_iso, capture_time_text(a, s->wanted_exposure), s->shots, capture_time_text(b, s->exposure),
            s->iso);
    else if (!near(s->exposure, s->wanted_exposure, SAME_EV) || !near(s->iso, s->wanted_iso, SAME_EV))
        core_note(job, "%s: %s at ISO %g instead of %s at ISO %g, the nearest that the camera can do", name,
                  capture_time_text(a, s->exposure), s->iso, capture_time_text(b, s->wanted_exposure), s->wanted_iso);
}

/* Frames that the limits made equal are shot once. */
static void drop_equal(capture_plan *plan, const brace_job *job) {
    for (size_t i = 0; i < plan->count; i++)
        for (size_t k = 0; k < i; k++) {
            const capture_step *a = &plan->steps[k], *b = &plan->steps[i];
            const bool meant =
                near(a->wanted_exposure, b->wanted_exposure, SAME_EV) && near(a->wanted_iso, b->wanted_iso, SAME_EV);
            if (a->truth || b->truth || meant || a->exposure != b->exposure || a->iso != b->iso)
                continue;
            /* The one that is farther from what it was to be goes. */
            const double off_a = fabs(log(a->exposure / a->wanted_exposure)),
                         off_b = fabs(log(b->exposure / b->wanted_exposure));
            const size_t out = off_a > off_b ? k : i;
            char t[32], u[32];
            core_note(job, "the frame of %s is left out: the camera's nearest, %s, is in the plan already",
                      capture_time_text(t, plan->steps[out].wanted_exposure), capture_time_text(u, b->exposure));
            memmove(&plan->steps[out], &plan->steps[out + 1], (plan->count - out - 1) * sizeof *plan->steps);
            plan->count--;
            i = out > 0 ? out - 1 : 0;
            break;
        }
}

/* Numbers the frames by exposure and finds the middle one; equal ones in the order of the plan. */
void capture_plan_number(capture_plan *plan) {
    size_t frames = 0;
    for (size_t i = 0; i < plan->count; i++)
        frames += !plan->steps[i].truth;
    for (size_t i = 0; i < plan->count; i++) {
        capture_step *s = &plan->steps[i];
        s->number = s->truth ? 0 : 1;
        for (size_t k = 0; k < plan->count && !s->truth; k++)
            if (!plan->steps[k].truth &&
                (light(&plan->steps[k]) < light(s) || (light(&plan->steps[k]) == light(s) && k < i)))
                s->number++;
        if (!s->truth && s->number == (int)(frames - 1) / 2 + 1)
            plan->reference = i;
    }
}

static brace_status check_params(const capture_plan_params *p, brace_error *error) {
    if (p->frames != 0 && (p->frames < BRACE_BRACKET_MIN || p->frames > CAPTURE_FRAMES_MAX))
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%d frames are no bracket: %d to %d", p->frames,
                         BRACE_BRACKET_MIN, CAPTURE_FRAMES_MAX);
    if (p->step != 0 && !(p->step >= 1.1 && p->step <= 64))
        return core_fail(error, BRACE_ERROR_ARGUMENT, "a step of %g from frame to frame is out of range 1.1 to 64",
                         p->step);
    if (p->time != 0 && !(p->time >= 1e-6 && p->time <= 60))
        return core_fail(error, BRACE_ERROR_ARGUMENT, "a reference exposure of %g s is out of range 1e-6 to 60",
                         p->time);
    if (p->iso != 0 && !(p->iso >= 1 && p->iso <= 1e6))
        return core_fail(error, BRACE_ERROR_ARGUMENT, "ISO %g is out of range 1 to 1000000", p->iso);
    return BRACE_OK;
}

brace_status capture_plan_create(capture_plan *out, const capture_plan_params *params, const capture_limits *limits,
                                 const brace_job *job, brace_error *error) {
    static const capture_limits anything = {.exposure_min = 1e-7, .exposure_max = 3600, .iso_min = 1, .iso_max = 1e7};
    static const capture_plan_params defaults;
    const capture_plan_params *p = params != NULL ? params : &defaults;
    const capture_limits *l = limits != NULL ? limits : &anything;
    *out = (capture_plan){0};
    brace_status status = check_params(p, error);
    if (status != BRACE_OK)
        return status;
    const double time = p->time > 0 ? p->time : 1.0 / 320;
    /* Cameras begin at 25 to 200; what begins far below is no limit, and what ends early is one. */
    const double iso = p->iso > 0 ? p->iso : l->iso_min >= 20 ? fmin(8 * l->iso_min, l->iso_max) : 400;
    if (p->list != NULL)
        status = parse_list(out, p->list, time, iso, error);
    else
        paper_list(out, p, time, iso);
    if (status != BRACE_OK)
        return status;
    for (size_t i = 0; i < out->count; i++)
        if (!out->steps[i].truth)
            set_nearest(&out->steps[i], out->steps[i].wanted_exposure, out->steps[i].wanted_iso, l);
    drop_equal(out, job);
    size_t frames = 0;
    double low = INFINITY, high = 0;
    for (size_t i = 0; i < out->count; i++)
        if (!out->steps[i].truth) {
            frames++;
            low = fmin(low, light(&out->steps[i])), high = fmax(high, light(&out->steps[i]));
        }
    if (frames < BRACE_BRACKET_MIN || !(high / low > 1.05)) {
        char a[32], b[32];
        return core_fail(
            error, p->list != NULL && limits == NULL ? BRACE_ERROR_ARGUMENT : BRACE_ERROR_UNSUPPORTED,
            "%zu different exposures are left: a bracket needs %d (the camera does %s to %s; choose another "
            "time for the reference, or a smaller step)",
            frames, BRACE_BRACKET_MIN, capture_time_text(a, l->exposure_min), capture_time_text(b, l->exposure_max));
    }
    capture_plan_number(out);
    for (size_t i = 0; i < out->count; i++) {
        capture_step *s = &out->steps[i];
        if (s->truth) {
            /* Of the brightness that the reference really has. */
            const capture_step *r = &out->steps[out->reference];
            if (p->list == NULL)
                s->wanted_exposure = 8 * r->exposure, s->wanted_iso = r->iso / 8;
            fit_truth(s, l);
        }
        say(s, job);
    }
    return BRACE_OK;
}
