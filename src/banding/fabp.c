/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fabp.c: the frequency-aware banding prior of one frame: the strongest stripe
 * in a ring of its power spectrum (BRACE paper, "Banding Frequency Analysis and
 * Consistency").
 */
#include <math.h>

#include "banding/banding.h"

/* Where the parabola through three logarithms of power has its top, in (-1/2, 1/2), and how far above the middle one. */
static double parabola(double before, double at, double after, double *above) {
    double a = log(fmax(before, 1e-30 * at)), b = log(at), c = log(fmax(after, 1e-30 * at));
    double bend = a - 2 * b + c;
    double top = bend < 0 ? 0.5 * (a - c) / bend : 0;
    top = fmax(-0.5, fmin(0.5, top));
    *above = -0.25 * (a - c) * top;
    return top;
}

static double orientation_of(double fx, double fy) {
    double theta = fmod(atan2(fy, fx) + M_PI / 2, M_PI);
    theta = theta < 0 ? theta + M_PI : theta;
    return theta < M_PI ? theta : 0;
}

static void refine(brace_fabp *out, const banding_spectrum *s) {
    const long u = out->u, v = out->v;
    double above_x, above_y, at = out->peak_power;
    double dx = parabola(banding_spectrum_power(s, u, v - 1), at, banding_spectrum_power(s, u, v + 1), &above_x);
    double dy = parabola(banding_spectrum_power(s, u - 1, v), at, banding_spectrum_power(s, u + 1, v), &above_y);
    out->refined_fx = ((double)v + dx) / (double)s->width;
    out->refined_fy = ((double)u + dy) / (double)s->height;
    out->refined_f = hypot(out->refined_fx, out->refined_fy);
    out->refined_theta = orientation_of(out->refined_fx, out->refined_fy);
    out->amplitude = s->window > 0 ? 2 * sqrt(at * exp(above_x + above_y)) / s->window : 0;
    /* The window is symmetric about the centre, so its transform is real there: the phase at the centre
     * is that of the stripe wherever between the bins its frequency lies. */
    banding_complex c = banding_spectrum_at(s, u, v);
    double centre = M_PI * (out->fx * (double)(s->width - 1) + out->fy * (double)(s->height - 1));
    out->phase = remainder(atan2(c.im, c.re) + centre, 2 * M_PI);
}

void banding_fabp(brace_fabp *out, const banding_spectrum *s, double r_min, double r_max) {
    *out = (brace_fabp){.width = (uint32_t)s->width, .height = (uint32_t)s->height, .r_min = r_min, .r_max = r_max};
    const long left = -(long)(s->width / 2), right = (long)((s->width - 1) / 2), top = -(long)(s->height / 2);
    for (long u = top; u <= 0; u++) {
        double row = 0;
        for (long v = u < 0 ? left : 1; v <= right; v++) {
            double d = hypot((double)u, (double)v);
            if (d < r_min || d > r_max)
                continue;
            double power = banding_spectrum_power(s, u, v);
            row += power;
            if (power > out->peak_power)
                out->peak_power = power, out->u = (int)u, out->v = (int)v;
        }
        out->ring_power += row;
    }
    if (out->peak_power > 0) {
        out->fx = (double)out->v / (double)s->width, out->fy = (double)out->u / (double)s->height;
        out->f = hypot(out->fx, out->fy);
        out->theta = orientation_of(out->fx, out->fy);
        out->rho = out->peak_power / out->ring_power;
        refine(out, s);
        out->descriptor[0] = (float)out->refined_f;
        out->descriptor[1] = (float)cos(2 * out->refined_theta);
        out->descriptor[2] = (float)sin(2 * out->refined_theta);
        out->descriptor[5] = (float)out->rho;
        out->descriptor[6] = (float)cos(out->phase);
        out->descriptor[7] = (float)sin(out->phase);
    }
    const double p = s->window > 0 ? out->peak_power / (s->window * s->window) : 0;
    const double e = s->window2 > 0 ? out->ring_power / ((double)(s->width * s->height) * s->window2) : 0;
    out->descriptor[3] = (float)log(1e-12 + p);
    out->descriptor[4] = (float)log(1e-12 + e);
}

static brace_status fabp_of(brace_fabp *out, const float *plane, uint32_t width, uint32_t height,
                            const brace_fabp_params *params, core_pool *pool, const brace_job *job,
                            brace_error *error) {
    banding_spectrum spectrum = {0};
    double r_min, r_max;
    brace_status status =
        banding_ring(&r_min, &r_max, width, height, params ? params->r_min : 0, params ? params->r_max : 0, error);
    if (status == BRACE_OK)
        status = banding_spectrum_create(&spectrum, plane, width, height, pool, job, error);
    if (status == BRACE_OK)
        banding_fabp(out, &spectrum, r_min, r_max);
    banding_spectrum_free(&spectrum);
    return status;
}

brace_status brace_fabp_plane(brace_fabp *out, const float *plane, uint32_t width, uint32_t height,
                              const brace_fabp_params *params, const brace_job *job, brace_error *error) {
    core_pool *pool = NULL;
    brace_status status = banding_plane_check(plane, width, height, error);
    if (status == BRACE_OK)
        status = core_pool_create(&pool, job, error);
    if (status == BRACE_OK)
        status = fabp_of(out, plane, width, height, params, pool, job, error);
    core_pool_destroy(pool);
    return status;
}

brace_status brace_fabp_frame(brace_fabp *out, const brace_frame *frame, const brace_fabp_params *params,
                              const brace_job *job, brace_error *error) {
    core_pool *pool = NULL;
    banding_plane plane = {0};
    brace_status status = core_pool_create(&pool, job, error);
    if (status == BRACE_OK)
        status = banding_plane_frame(&plane, frame, pool, error);
    if (status == BRACE_OK)
        status = fabp_of(out, plane.at, plane.width, plane.height, params, pool, job, error);
    banding_plane_free(&plane);
    core_pool_destroy(pool);
    return status;
}

brace_status brace_fabp_image(brace_fabp *out, const brace_image *image, const brace_fabp_params *params,
                              const brace_job *job, brace_error *error) {
    core_pool *pool = NULL;
    banding_plane plane = {0};
    brace_status status = core_pool_create(&pool, job, error);
    if (status == BRACE_OK)
        status = banding_plane_image(&plane, image, pool, error);
    if (status == BRACE_OK)
        status = fabp_of(out, plane.at, plane.width, plane.height, params, pool, job, error);
    banding_plane_free(&plane);
    core_pool_destroy(pool);
    return status;
}

double brace_fabp_direction(const brace_fabp *fabp, int orientation) {
    double x = fabp->refined_fx, y = fabp->refined_fy;
    /* EXIF orientations 2, 4, 5, 7 mirror; 5 to 8 turn the axes; a wave vector has no sign. */
    if (orientation == 2 || orientation == 4)
        x = -x;
    else if (orientation == 5 || orientation == 7) {
        double t = x;
        x = y, y = t;
    } else if (orientation == 6 || orientation == 8) {
        double t = x;
        x = -y, y = t;
    }
    double angle = x == 0 && y == 0 ? 0 : atan2(y, x);
    if (angle > M_PI / 2)
        angle -= M_PI;
    return angle <= -M_PI / 2 ? angle + M_PI : angle;
}
