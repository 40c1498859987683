/* SPDX-License-Identifier: Apache-2.0 */
/*
 * restore.c: a bracket in, one clean frame out. `reference` hands back the
 * reference; `merge` aligns (align.c, warp.c), measures the light (light.c),
 * fuses (fuse.c) and evens out what is still uncertain (smooth.c); a network is
 * shown the bracket tile by tile (network.c).
 */
#include <math.h>
#include <string.h>

#include "raw/isp.h"
#include "restore/internal.h"
#include "restore/network.h"

const char *brace_method_name(brace_method method) {
    switch (method) {
    case BRACE_METHOD_REFERENCE:
        return "reference";
    case BRACE_METHOD_DEFAULT:
        return "default";
    case BRACE_METHOD_MERGE:
        return "merge";
    case BRACE_METHOD_NETWORK:
        return "brace";
    }
    return "unknown";
}

void brace_restored_destroy(brace_restored *restored) {
    if (!restored)
        return;
    brace_frame_destroy(restored->frame);
    core_free(restored->mosaic);
    core_free(restored);
}

typedef struct merge_state {
    size_t count, made;
    restore_view view[BRACE_BRACKET_MAX];
    restore_picture packed, sum, weight, precision, sigma;
    uint8_t *doubt;
} merge_state;

/* Every frame as seen from the reference's pose. */
static brace_status merge_views(merge_state *s, const brace_bracket *bracket, const restore_motion *motion,
                                const brace_job *job, core_pool *pool, brace_error *error) {
    for (size_t i = 0; i < bracket->count; i++) {
        brace_status status = core_check_cancel(job, error);
        if (status)
            return status;
        const bool still = motion == NULL || i == bracket->reference;
        const double confidence = still ? 1 : motion[i].confidence, exposure = bracket->exposure[i];
        restore_pack(&s->packed, bracket->frames[i], pool);
        status = restore_view_create(&s->view[i], &s->packed, bracket->frames[i], exposure, still ? NULL : &motion[i],
                                     pool, error);
        if (status)
            return status;
        s->made = i + 1;
        /* Longer frames blur more under a hand's tremor. A frame that hardly correlates with the others, because it is
         * dark or clips, is taken where it was shot, and may lie a pixel off: it counts where light does not change. */
        const double lost = 1 - confidence;
        s->view[i].blur = still ? 0 : (float)(0.4 * pow(fmax(exposure, 1), 0.15) + lost * lost);
    }
    return BRACE_OK;
}

typedef struct pilot_job {
    const restore_picture *sum, *weight;
    const restore_view *fallback, *reference;
    restore_picture *out;
} pilot_job;

/* sum/weight, in place of sum. Where the reference clips, no less than it recorded: shorter frames that flicker wildly
 * may have seen nothing at all. */
static void pilot_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const pilot_job *job = arg;
    for (size_t i = begin * job->out->width; i < end * job->out->width; i++) {
        v4 s = job->sum->at[i], w = job->weight->at[i], f = job->fallback->light.at[i];
        for (int c = 0; c < 4; c++) {
            float l = w[c] > 0 ? s[c] / w[c] : f[c];
            float least = job->reference->trust[4 * i + (size_t)c] == 0 ? job->reference->light.at[i][c] : 0;
            job->out->at[i][c] = l > least ? l : least;
        }
    }
}

/* 3x3 mean: weights must not follow the noise of what they weigh. */
static void box_rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const pilot_job *job = arg;
    const size_t width = job->out->width, height = job->out->height;
    for (size_t y = begin; y < end; y++) {
        const v4 *row = job->sum->at + y * width;
        const v4 *above = y ? row - width : row, *below = y + 1 < height ? row + width : row;
        for (size_t x = 0; x < width; x++) {
            size_t l = x ? x - 1 : x, r = x + 1 < width ? x + 1 : x;
            job->out->at[y * width + x] =
                (above[l] + above[x] + above[r] + row[l] + row[x] + row[r] + below[l] + below[x] + below[r]) *
                v4_set(1.0f / 9);
        }
    }
}

brace_status restore_merge(float *mosaic, float *sigma, brace_restore_report *report, const brace_bracket *bracket,
                           const restore_motion *motion, const brace_job *job, core_pool *pool, brace_error *error) {
    const brace_frame *reference = bracket->frames[bracket->reference];
    const size_t width = (reference->width + 1) / 2, height = (reference->height + 1) / 2;
    merge_state s = {.count = bracket->count};
    double start = core_seconds();

    brace_status status = restore_picture_create(&s.packed, width, height, "a packed frame", error);
    if (status)
        goto done;
    status = merge_views(&s, bracket, motion, job, pool, error);
    if (status)
        goto done;
    restore_contradict(s.view, s.count, pool);
    report->seconds_align += core_seconds() - start;

    if ((status = core_check_cancel(job, error)))
        goto done;
    start = core_seconds();
    s.sum = s.packed, s.packed.at = NULL;
    status = restore_picture_create(&s.weight, width, height, "the merged picture", error);
    if (status)
        goto done;
    core_progress(job, "measuring light", 0, 1);
    status = restore_light(s.view, s.count, &s.sum, &s.weight, pool, error);
    if (status)
        goto done;
    core_progress(job, "measuring light", 1, 1);
    report->seconds_light = core_seconds() - start;

    if ((status = core_check_cancel(job, error)))
        goto done;
    start = core_seconds();
    core_progress(job, "fusing", 0, 2);
    pilot_job pilot = {&s.sum, &s.weight, &s.view[0], &s.view[bracket->reference], &s.sum};
    core_parallel(pool, height, 16, pilot_rows, &pilot);
    pilot.out = &s.weight;
    core_parallel(pool, height, 16, box_rows, &pilot);
    status = restore_picture_create(&s.precision, width, height, "the merged picture's precision", error);
    if (!status && sigma != NULL)
        status = restore_picture_create(&s.sigma, width, height, "the merged picture's errors", error);
    if (status)
        goto done;
    s.doubt = core_alloc(width * height, 1);
    if (!s.doubt) {
        status = core_fail_memory(error, width * height, "the merged picture's precision");
        goto done;
    }
    status = restore_fuse(s.view, s.count, bracket->reference, &s.weight, &s.sum, &s.precision,
                          sigma != NULL ? &s.sigma : NULL, s.doubt, pool, error);
    if (status)
        goto done;
    for (size_t i = 0; i < s.count; i++) {
        report->weight[i] = s.view[i].weight;
        report->banding[i] = hypot(s.view[i].deviation, s.view[i].banding);
        restore_view_free(&s.view[i]);
    }
    core_progress(job, "fusing", 1, 2);
    if ((status = core_check_cancel(job, error)))
        goto done;
    restore_smooth(&s.sum, &s.weight, &s.precision, s.doubt, pool);
    restore_picture_free(&s.precision);
    restore_unpack(mosaic, reference, &s.sum, pool);
    if (sigma != NULL)
        restore_unpack(sigma, reference, &s.sigma, pool);
    core_progress(job, "fusing", 2, 2);
    report->seconds_fuse = core_seconds() - start;
done:
    for (size_t i = 0; i < s.count; i++)
        restore_view_free(&s.view[i]);
    restore_picture_free(&s.packed), restore_picture_free(&s.sum);
    restore_picture_free(&s.weight), restore_picture_free(&s.precision), restore_picture_free(&s.sigma);
    core_free(s.doubt);
    return status;
}

/* Where the frames lie on the reference; none of them moved if the camera stood still. */
static brace_status find_motions(restore_motion *motion, brace_restore_report *report, const brace_bracket *bracket,
                                 const brace_restore_params *params, const brace_job *job, core_pool *pool,
                                 brace_error *error) {
    const double start = core_seconds();
    for (size_t i = 0; i < bracket->count; i++)
        motion[i] = (restore_motion){.confidence = 1};
    if (params && params->no_align)
        return BRACE_OK;
    brace_status status = restore_motions(motion, (const brace_frame *const *)bracket->frames, bracket->count,
                                          bracket->reference, pool, job, error);
    for (size_t i = 0; i < bracket->count && !status; i++) {
        report->motion[i] = restore_motion_report(&motion[i], (bracket->frames[i]->width + 1) / 2);
        if (motion[i].confidence < RESTORE_FOUND)
            report->motion[i].confidence = 0;
    }
    report->seconds_align = core_seconds() - start;
    return status;
}

/* Which method it is, and the network if it is one: merge where the default network is not installed or where the
 * bracket is none for it. */
static brace_status choose_method(brace_method *method, restore_network **network, const brace_bracket *bracket,
                                  const brace_restore_params *params, const brace_job *job, brace_error *error) {
    const char *model = params ? params->model : NULL;
    const bool asked = *method == BRACE_METHOD_NETWORK;
    char why[256];
    *network = NULL;
    if (!asked && *method != BRACE_METHOD_DEFAULT)
        return BRACE_OK;
    *method = BRACE_METHOD_MERGE;
    brace_status status = restore_network_open(network, model, error);
    if (status)
        return status;
    if (!*network) {
        if (asked)
            core_note(job, "merged instead: no network's weights are installed (brace-s.safetensors)");
        return BRACE_OK;
    }
    if (restore_network_fits(*network, bracket, why, sizeof why)) {
        *method = BRACE_METHOD_NETWORK;
        return BRACE_OK;
    }
    core_note(job, "merged instead: %s", why);
    restore_network_close(*network);
    *network = NULL;
    return BRACE_OK;
}

brace_status brace_restore(brace_restored **out, const brace_bracket *bracket, const brace_restore_params *params,
                           const brace_job *job, brace_error *error) {
    brace_method method = params ? params->method : BRACE_METHOD_DEFAULT;
    if ((int)method < BRACE_METHOD_DEFAULT || method > BRACE_METHOD_NETWORK)
        return core_fail(error, BRACE_ERROR_ARGUMENT, "restoration method %d is unknown", (int)method);
    if (params && ((int)params->precision < BRACE_PRECISION_DEFAULT || params->precision > BRACE_PRECISION_BF16))
        return core_fail(error, BRACE_ERROR_ARGUMENT, "precision %d is unknown", (int)params->precision);
    const brace_frame *reference = bracket->frames[bracket->reference];
    const size_t count = (size_t)reference->width * reference->height;

    brace_status status = BRACE_OK;
    for (size_t i = 0; i < bracket->count && !status; i++)
        status = raw_check_frame(bracket->frames[i], error);
    if (status)
        return status;
    for (size_t i = 0; i < bracket->count; i++)
        if (!(bracket->exposure[i] > 1e-5 && bracket->exposure[i] < 1e5))
            return core_fail(error, BRACE_ERROR_MISMATCH,
                             "%s has %g times the exposure of the reference: these frames are no bracket of one scene",
                             bracket->frames[i]->path, bracket->exposure[i]);

    restore_network *network = NULL;
    status = choose_method(&method, &network, bracket, params, job, error);
    if (status)
        return status;
    brace_restored *r = core_calloc(1, sizeof *r);
    if (!r) {
        restore_network_close(network);
        return core_fail_memory(error, sizeof *r, "the result");
    }
    core_pool *pool = NULL;
    restore_motion motion[BRACE_BRACKET_MAX];
    status = core_pool_create(&pool, job, error);
    if (!status)
        status = brace_frame_clone(&r->frame, reference, error);
    if (!status) {
        r->mosaic = core_alloc(count, sizeof(float));
        if (!r->mosaic)
            status = core_fail_memory(error, count * sizeof(float), "the result");
    }
    if (!status) {
        r->report.method = method;
        for (size_t i = 0; i < bracket->count; i++)
            r->report.motion[i] = (brace_motion){.scale = 1, .confidence = 1};
        if (method == BRACE_METHOD_REFERENCE) {
            r->report.weight[bracket->reference] = 1;
            raw_normalise(reference, r->mosaic, pool);
        } else {
            status = find_motions(motion, &r->report, bracket, params, job, pool, error);
            if (!status)
                status = network ? restore_network_run(r, network, bracket, motion, params, job, pool, error)
                                 : restore_merge(r->mosaic, NULL, &r->report, bracket, motion, job, pool, error);
            if (!status)
                raw_quantise(r->frame, r->mosaic, pool);
        }
    }
    restore_network_close(network);
    if (!status) {
        size_t clipped = 0;
        for (size_t i = 0; i < count; i++)
            clipped += r->mosaic[i] >= 1;
        r->report.clipped = (double)clipped / (double)count;
    }
    core_pool_destroy(pool);
    if (status) {
        brace_restored_destroy(r);
        return status;
    }
    *out = r;
    return BRACE_OK;
}
