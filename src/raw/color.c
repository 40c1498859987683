/* SPDX-License-Identifier: Apache-2.0 */
/*
 * color.c: camera RGB to linear sRGB, as chapter 6 of the DNG specification 1.6
 * ("Mapping Camera Color Space to CIE XYZ Space") has it:
 *
 *   AsShotNeutral -> white point xy, by fixed-point iteration when there are two
 *   ColorMatrix tags, which are interpolated linearly in 1/CCT;
 *   CameraToXYZ_D50 = Bradford(white -> D50) * inverse(ColorMatrix);
 *   sRGB = inverse(sRGB primaries adapted to D50) * CameraToXYZ_D50.
 */
#include <float.h>
#include <math.h>
#include <string.h>

#include "raw/isp.h"

/* XYZ of the ICC profile connection space's D50, and D65 from its xy (IEC 61966-2-1). */
static const double white_d50[3] = {0.9642, 1.0, 0.8249};
static const double white_d65[3] = {0.3127 / 0.3290, 1.0, (1.0 - 0.3127 - 0.3290) / 0.3290};

/* A matrix whose result has an entry beyond this is noise, not a camera. */
static const double entry_limit = 64.0;

static void multiply(double out[9], const double a[9], const double b[9]) {
    double m[9];
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            m[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
        }
    }
    memcpy(out, m, sizeof(m));
}

static void apply(double out[3], const double m[9], const double v[3]) {
    for (int i = 0; i < 3; i++) {
        out[i] = m[3 * i] * v[0] + m[3 * i + 1] * v[1] + m[3 * i + 2] * v[2];
    }
}

/* False for matrices that are singular, nearly so, or not finite. */
static bool invert(double out[9], const double m[9]) {
    double scale = 0.0;
    for (int i = 0; i < 9; i++) {
        if (!isfinite(m[i])) {
            return false;
        }
        scale = fmax(scale, fabs(m[i]));
    }
    if (!(scale > 1e-9 && scale < 1e9)) {
        return false;
    }
    double c[9];
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            const int a = (j + 1) % 3, b = (j + 2) % 3, p = (i + 1) % 3, q = (i + 2) % 3;
            c[3 * i + j] = m[3 * a + p] * m[3 * b + q] - m[3 * a + q] * m[3 * b + p];
        }
    }
    const double det = m[0] * c[0] + m[1] * c[3] + m[2] * c[6];
    if (!(fabs(det) > 1e-7 * scale * scale * scale)) {
        return false;
    }
    for (int i = 0; i < 9; i++) {
        out[i] = c[i] / det;
    }
    return true;
}

/* Makes a matrix map (1,1,1) to (1,1,1). False if a row cannot. */
static bool normalise_rows(double m[9]) {
    for (int i = 0; i < 3; i++) {
        const double sum = m[3 * i] + m[3 * i + 1] + m[3 * i + 2];
        if (!(fabs(sum) > 1e-6)) {
            return false;
        }
        for (int j = 0; j < 3; j++) {
            m[3 * i + j] /= sum;
        }
    }
    return true;
}

/* The linear Bradford transform that moves white `from` to white `to` (both with Y = 1). */
static bool adapt(double out[9], const double from[3], const double to[3]) {
    static const double bradford[9] = {0.8951, 0.2664, -0.1614, -0.7502, 1.7135, 0.0367, 0.0389, -0.0685, 1.0296};
    double inverse[9], a[3], b[3];
    apply(a, bradford, from);
    apply(b, bradford, to);
    if (!(a[0] > 1e-3 && a[1] > 1e-3 && a[2] > 1e-3) || !invert(inverse, bradford)) {
        return false;
    }
    double scaled[9];
    for (int i = 0; i < 9; i++) {
        scaled[i] = bradford[i] * b[i / 3] / a[i / 3];
    }
    multiply(out, inverse, scaled);
    return true;
}

/* XYZ under D50 to linear sRGB. The primaries are IEC 61966-2-1's (Rec. 709). */
static bool xyz_d50_to_srgb(double out[9]) {
    static const double xy[3][2] = {{0.64, 0.33}, {0.30, 0.60}, {0.15, 0.06}};
    double primaries[9], inverse[9], weight[3], to_d50[9];
    for (int c = 0; c < 3; c++) {
        primaries[c] = xy[c][0] / xy[c][1];
        primaries[3 + c] = 1.0;
        primaries[6 + c] = (1.0 - xy[c][0] - xy[c][1]) / xy[c][1];
    }
    if (!invert(inverse, primaries) || !adapt(to_d50, white_d65, white_d50)) {
        return false;
    }
    apply(weight, inverse, white_d65);
    for (int i = 0; i < 9; i++) {
        primaries[i] *= weight[i % 3];
    }
    multiply(primaries, to_d50, primaries);
    return invert(out, primaries);
}

/* Kelvins of an EXIF LightSource code, 0 if it names no temperature. The fluorescent
 * kinds are the middle of the range that EXIF 2.32 gives them. */
static double illuminant_temperature(uint16_t code) {
    switch (code) {
    case 1:  /* daylight */
    case 4:  /* flash */
    case 9:  /* fine weather */
    case 20: /* D55 */
        return 5503.0;
    case 2: /* fluorescent, unspecified */
    case 14:
        return 4150.0;
    case 3:  /* tungsten */
    case 17: /* standard light A */
        return 2856.0;
    case 10: /* cloudy */
    case 21: /* D65 */
        return 6504.0;
    case 11: /* shade */
    case 22: /* D75 */
        return 7504.0;
    case 12:
        return 6400.0;
    case 13:
        return 5050.0;
    case 15:
        return 3525.0;
    case 16:
        return 2925.0;
    case 18:
        return 4874.0;
    case 19:
        return 6774.0;
    case 23:
        return 5003.0;
    case 24: /* ISO studio tungsten */
        return 3200.0;
    default:
        return 0.0;
    }
}

/* Squared distance from (u, v) to the black body of 1e6/mired kelvins, with the
 * rational approximation of Krystek (Color Research and Application 10, 1985). */
static double locus_distance(double u, double v, double mired) {
    const double t = 1e6 / mired, t2 = t * t;
    const double du =
        u - (0.860117757 + 1.54118254e-4 * t + 1.28641212e-7 * t2) / (1.0 + 8.42420235e-4 * t + 7.08145163e-7 * t2);
    const double dv =
        v - (0.317398726 + 4.22806245e-5 * t + 4.20481691e-8 * t2) / (1.0 - 2.89741816e-5 * t + 1.61456053e-7 * t2);
    return du * du + dv * dv;
}

/* Correlated colour temperature in mireds: the nearest black body in CIE 1960 uv
 * between 15000 K and 1667 K, where Krystek's formula holds. */
static double xy_to_mired(const double xy[2]) {
    const double d = -2.0 * xy[0] + 12.0 * xy[1] + 3.0;
    const double u = 4.0 * xy[0] / d, v = 6.0 * xy[1] / d;
    double low = 1e6 / 15000.0, high = 600.0;
    for (int i = 0; i < 80; i++) {
        const double third = (high - low) / 3.0;
        if (locus_distance(u, v, low + third) < locus_distance(u, v, high - third)) {
            high -= third;
        } else {
            low += third;
        }
    }
    return (low + high) / 2.0;
}

/* The camera's neutral seen through one XYZ-to-camera matrix: XYZ with Y = 1. */
static bool neutral_to_white(double white[3], const double inverse[9], const double neutral[3]) {
    double xyz[3];
    apply(xyz, inverse, neutral);
    if (!(xyz[1] > 1e-6) || !(xyz[0] > 1e-3 * xyz[1]) || !(xyz[2] > 1e-3 * xyz[1])) {
        return false;
    }
    for (int i = 0; i < 3; i++) {
        white[i] = xyz[i] / xyz[1];
    }
    return isfinite(white[0]) && isfinite(white[2]);
}

/* Camera to XYZ for the light that `neutral` was shot under, and that light's
 * white. The loop is the specification's: a white point gives a temperature,
 * that a matrix, and that a white point. */
static bool camera_to_xyz(double out[9], double white[3], const brace_frame *frame, const double neutral[3]) {
    double inverse[2][9];
    const bool usable[2] = {invert(inverse[0], frame->color_matrix[0]), invert(inverse[1], frame->color_matrix[1])};
    if (!usable[0] && !usable[1]) {
        return false;
    }
    const double kelvin[2] = {illuminant_temperature(frame->illuminant[0]),
                              illuminant_temperature(frame->illuminant[1])};
    if (!usable[0] || !usable[1] || kelvin[0] <= 0.0 || kelvin[1] <= 0.0 || fabs(kelvin[0] - kelvin[1]) < 1.0) {
        memcpy(out, inverse[usable[0] ? 0 : 1], sizeof(inverse[0]));
        return neutral_to_white(white, out, neutral);
    }
    const double mired[2] = {1e6 / kelvin[0], 1e6 / kelvin[1]};
    double xy[2] = {0.3457, 0.3585};
    for (int step = 0; step < 60; step++) {
        double weight = (xy_to_mired(xy) - mired[1]) / (mired[0] - mired[1]);
        weight = fmin(fmax(weight, 0.0), 1.0);
        double matrix[9];
        for (int i = 0; i < 9; i++) {
            matrix[i] = weight * frame->color_matrix[0][i] + (1.0 - weight) * frame->color_matrix[1][i];
        }
        if (!invert(out, matrix) || !neutral_to_white(white, out, neutral)) {
            return false;
        }
        const double sum = white[0] + white[1] + white[2];
        const double next[2] = {white[0] / sum, white[1] / sum};
        const double moved = fabs(next[0] - xy[0]) + fabs(next[1] - xy[1]);
        /* Two points that take turns are met halfway. */
        const double pull = step < 20 ? 1.0 : 0.5;
        xy[0] += pull * (next[0] - xy[0]);
        xy[1] += pull * (next[1] - xy[1]);
        if (moved < 1e-9) {
            break;
        }
    }
    return true;
}

static bool matrix_from_tags(double out[9], const brace_frame *frame, const double neutral[3]) {
    double xyz[9], white[3], to_d50[9], to_srgb[9];
    if (!camera_to_xyz(xyz, white, frame, neutral) || !adapt(to_d50, white, white_d50) || !xyz_d50_to_srgb(to_srgb)) {
        return false;
    }
    multiply(out, to_d50, xyz);
    multiply(out, to_srgb, out);
    for (int i = 0; i < 9; i++) { /* white-balanced camera RGB in, so undo the balance first */
        out[i] *= neutral[i % 3];
    }
    /* All rows have the same sum up to rounding; this also sets the brightness of white to 1. */
    if (!normalise_rows(out)) {
        return false;
    }
    for (int i = 0; i < 9; i++) {
        if (!(fabs(out[i]) < entry_limit)) {
            return false;
        }
    }
    return true;
}

brace_status brace_color_init(brace_color *out, const brace_frame *frame, brace_error *error) {
    if (out == NULL || frame == NULL) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "brace_color_init: frame and result must not be NULL");
    }
    double neutral[3] = {frame->as_shot_neutral[0], frame->as_shot_neutral[1], frame->as_shot_neutral[2]};
    const double largest = fmax(neutral[0], fmax(neutral[1], neutral[2]));
    for (int c = 0; c < 3; c++) {
        /* A channel a thousand times weaker than another is damage, not light. */
        if (!isfinite(frame->as_shot_neutral[c]) || !(frame->as_shot_neutral[c] > 1e-3 * largest)) {
            neutral[0] = neutral[1] = neutral[2] = 1.0;
            break;
        }
    }
    const double strongest = fmax(neutral[0], fmax(neutral[1], neutral[2]));
    brace_color color = {.camera_to_srgb = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .srgb_to_camera = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    for (int c = 0; c < 3; c++) {
        neutral[c] /= strongest;
        color.wb[c] = 1.0 / neutral[c];
    }
    double matrix[9], inverse[9];
    if (matrix_from_tags(matrix, frame, neutral) && invert(inverse, matrix) && normalise_rows(inverse)) {
        memcpy(color.camera_to_srgb, matrix, sizeof(matrix));
        memcpy(color.srgb_to_camera, inverse, sizeof(inverse));
    }
    *out = color;
    return BRACE_OK;
}
