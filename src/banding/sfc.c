/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sfc.c: stripe frequency consistency: how far a restored picture's energy along
 * the banding's direction is from the truth's (BRACE paper, "Stripe Frequency Consistency").
 */
#include <math.h>

#include "banding/banding.h"

typedef struct sfc_profile {
    double sector, ring; /* energy */
    size_t radii;
    double *at; /* mean power of the sector at each radius, over that of the ring's mean radius */
} sfc_profile;

/* Sums a spectrum over ring and sector. `sums` has 4 numbers a radius. */
static void measure(sfc_profile *out, const banding_spectrum *s, double r_min, double r_max, double direction,
                    double half_width, double *sums) {
    const long left = -(long)(s->width / 2), right = (long)((s->width - 1) / 2), top = -(long)(s->height / 2);
    const long first = lround(r_min);
    const double nx = cos(direction), ny = sin(direction), edge = cos(half_width);
    double *in = sums, *in_count = in + out->radii, *all = in_count + out->radii, *all_count = all + out->radii;
    for (size_t i = 0; i < 4 * out->radii; i++)
        sums[i] = 0;
    for (long u = top; u <= 0; u++) {
        for (long v = u < 0 ? left : 1; v <= right; v++) {
            double d = hypot((double)u, (double)v);
            if (d < r_min || d > r_max)
                continue;
            double power = banding_spectrum_power(s, u, v);
            size_t k = (size_t)(lround(d) - first);
            /* Angles are those of the wave vector in cycles a pixel: on a picture that is not square, bins are not. */
            double fx = (double)v / (double)s->width, fy = (double)u / (double)s->height;
            bool inside = fabs(fx * nx + fy * ny) >= edge * hypot(fx, fy) - 1e-12;
            all[k] += power, all_count[k]++;
            if (inside)
                in[k] += power, in_count[k]++;
        }
    }
    double mean = 0, used = 0;
    out->sector = out->ring = 0;
    for (size_t k = 0; k < out->radii; k++) {
        out->sector += in[k], out->ring += all[k];
        if (all_count[k] > 0)
            mean += all[k] / all_count[k], used++;
    }
    mean = used > 0 ? mean / used : 0;
    for (size_t k = 0; k < out->radii; k++)
        out->at[k] = in_count[k] > 0 && mean > 0 ? in[k] / in_count[k] / mean : 0;
}

static void compare(brace_sfc *out, const sfc_profile *pred, const sfc_profile *gt, double lambda) {
    out->rho_pred = pred->ring > 0 ? pred->sector / pred->ring : 0;
    out->rho_gt = gt->ring > 0 ? gt->sector / gt->ring : 0;
    out->gate = fmax(out->rho_pred, out->rho_gt);
    double distance = 0, sign = 0;
    for (size_t k = 0; k < gt->radii; k++)
        distance += fabs(pred->at[k] - gt->at[k]), sign += pred->at[k] - gt->at[k];
    out->delta_ratio = 100 * (out->rho_pred - out->rho_gt);
    out->d_ratio = fabs(out->delta_ratio);
    out->d_profile = 100 * distance / (double)gt->radii;
    out->delta_profile = 100 * sign / (double)gt->radii;
    out->sfc = out->d_ratio + lambda * out->gate * out->d_profile;
}

static brace_status sfc_of(brace_sfc *out, const float *pred, const float *gt, uint32_t width, uint32_t height,
                           double direction, const brace_sfc_params *params, core_pool *pool, const brace_job *job,
                           brace_error *error) {
    static const brace_sfc_params defaults = {0};
    params = params ? params : &defaults;
    double r_min, r_max;
    const double half_width = params->half_width > 0 ? params->half_width : 10;
    const double lambda = params->lambda > 0 ? params->lambda : 5;
    if (!isfinite(direction) || !(half_width <= 90) || !isfinite(lambda))
        return core_fail(error, BRACE_ERROR_ARGUMENT,
                         "SFC needs a direction, a sector of at most 90 degrees to each side and a finite weight");
    brace_status status = banding_ring(&r_min, &r_max, width, height, params->r_min, params->r_max, error);
    if (status != BRACE_OK)
        return status;
    r_max = fmin(r_max, hypot(width, height) + r_min); /* nothing lies further out */
    const size_t radii = (size_t)(lround(r_max) - lround(r_min)) + 1;
    sfc_profile profile[2] = {{.radii = radii}, {.radii = radii}};
    double *memory = core_alloc(6 * radii, sizeof *memory);
    if (!memory)
        return core_fail_memory(error, 6 * radii * sizeof *memory, "a profile");
    for (int i = 0; i < 2 && status == BRACE_OK; i++) {
        banding_spectrum spectrum = {0};
        profile[i].at = memory + (size_t)i * radii;
        status = banding_spectrum_create(&spectrum, i ? gt : pred, width, height, pool, job, error);
        if (status == BRACE_OK)
            measure(&profile[i], &spectrum, r_min, r_max, direction, half_width * M_PI / 180, memory + 2 * radii);
        banding_spectrum_free(&spectrum);
    }
    if (status == BRACE_OK) {
        *out = (brace_sfc){.direction = direction};
        compare(out, &profile[0], &profile[1], lambda);
    }
    core_free(memory);
    return status;
}

brace_status brace_sfc_plane(brace_sfc *out, const float *pred, const float *gt, uint32_t width, uint32_t height,
                             double direction, const brace_sfc_params *params, const brace_job *job,
                             brace_error *error) {
    core_pool *pool = NULL;
    brace_status status = banding_plane_check(pred, width, height, error);
    if (status == BRACE_OK)
        status = banding_plane_check(gt, width, height, error);
    if (status == BRACE_OK)
        status = core_pool_create(&pool, job, error);
    if (status == BRACE_OK)
        status = sfc_of(out, pred, gt, width, height, direction, params, pool, job, error);
    core_pool_destroy(pool);
    return status;
}

static brace_status sfc_planes(brace_sfc *out, const banding_plane plane[2], double direction,
                               const brace_sfc_params *params, core_pool *pool, const brace_job *job,
                               brace_error *error) {
    if (plane[0].width != plane[1].width || plane[0].height != plane[1].height)
        return core_fail(error, BRACE_ERROR_MISMATCH, "the restored picture has %u x %u pixels, the truth %u x %u",
                         plane[0].width, plane[0].height, plane[1].width, plane[1].height);
    return sfc_of(out, plane[0].at, plane[1].at, plane[0].width, plane[0].height, direction, params, pool, job, error);
}

brace_status brace_sfc_image(brace_sfc *out, const brace_image *pred, const brace_image *gt, double direction,
                             const brace_sfc_params *params, const brace_job *job, brace_error *error) {
    core_pool *pool = NULL;
    banding_plane plane[2] = {{0}, {0}};
    brace_status status = core_pool_create(&pool, job, error);
    if (status == BRACE_OK)
        status = banding_plane_image(&plane[0], pred, pool, error);
    if (status == BRACE_OK)
        status = banding_plane_image(&plane[1], gt, pool, error);
    if (status == BRACE_OK)
        status = sfc_planes(out, plane, direction, params, pool, job, error);
    banding_plane_free(&plane[0]), banding_plane_free(&plane[1]);
    core_pool_destroy(pool);
    return status;
}

brace_status brace_sfc_frame(brace_sfc *out, const brace_frame *pred, const brace_frame *gt, double direction,
                             const brace_sfc_params *params, const brace_job *job, brace_error *error) {
    core_pool *pool = NULL;
    banding_plane plane[2] = {{0}, {0}};
    brace_status status = core_pool_create(&pool, job, error);
    if (status == BRACE_OK)
        status = banding_plane_frame(&plane[0], pred, pool, error);
    if (status == BRACE_OK)
        status = banding_plane_frame(&plane[1], gt, pool, error);
    if (status == BRACE_OK)
        status = sfc_planes(out, plane, direction, params, pool, job, error);
    banding_plane_free(&plane[0]), banding_plane_free(&plane[1]);
    core_pool_destroy(pool);
    return status;
}

void brace_sfc_summary(brace_sfc *mean, brace_sfc *deviation, const brace_sfc *items, size_t count) {
    enum { FIELDS = 8 };
    static const size_t field[FIELDS] = {
        offsetof(brace_sfc, sfc),           offsetof(brace_sfc, d_ratio),  offsetof(brace_sfc, d_profile),
        offsetof(brace_sfc, delta_ratio),   offsetof(brace_sfc, delta_profile), offsetof(brace_sfc, rho_pred),
        offsetof(brace_sfc, rho_gt),        offsetof(brace_sfc, gate)};
    *mean = *deviation = (brace_sfc){0};
    for (size_t f = 0; f < FIELDS && count > 0; f++) {
        double sum = 0, squares = 0;
        for (size_t i = 0; i < count; i++)
            sum += *(const double *)(const void *)((const char *)&items[i] + field[f]);
        sum /= (double)count;
        for (size_t i = 0; i < count; i++) {
            double d = *(const double *)(const void *)((const char *)&items[i] + field[f]) - sum;
            squares += d * d;
        }
        *(double *)(void *)((char *)mean + field[f]) = sum;
        *(double *)(void *)((char *)deviation + field[f]) = sqrt(squares / (double)count);
    }
}
