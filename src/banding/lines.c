/* SPDX-License-Identifier: Apache-2.0 */
/*
 * lines.c: the line that flicker makes in the spectrum of the rows' light.
 *
 * Each zone's profile is rid of its slow change, windowed (Hann) and
 * transformed; what all zones share, with a phase that advances evenly from zone
 * to zone (a slant), is the coherent wave at that frequency. It is compared with
 * what surrounds it in the spectrum, where chance and content show but no line.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "banding/profile.h"

enum { SLANTS = 19, SLOW = 4 }; /* slants tried; terms of the slow change: a cubic */

/* Fewer periods than this in the frame are told neither from shading nor from content. */
static const double fewest_cycles = 1.5;

/* Solves the n x n system in place (Gauss, partial pivoting); singular columns give 0. */
static void solve(double a[SLOW][SLOW + 1]) {
    for (int i = 0; i < SLOW; i++) {
        int p = i;
        for (int j = i + 1; j < SLOW; j++)
            p = fabs(a[j][i]) > fabs(a[p][i]) ? j : p;
        for (int k = 0; k <= SLOW; k++) {
            double t = a[i][k];
            a[i][k] = a[p][k], a[p][k] = t;
        }
        if (fabs(a[i][i]) < 1e-9) {
            a[i][i] = 1, a[i][SLOW] = 0;
            for (int k = i + 1; k < SLOW; k++)
                a[i][k] = 0;
        }
        for (int j = 0; j < SLOW; j++)
            if (j != i) {
                double f = a[j][i] / a[i][i];
                for (int k = i; k <= SLOW; k++)
                    a[j][k] -= f * a[i][k];
            }
    }
    for (int i = 0; i < SLOW; i++)
        a[i][SLOW] /= a[i][i];
}

/* One zone without its slow change (a cubic, least squares); 0 where nothing is known. False if too little is. */
static bool detrend(float *out, const banding_profile *profile, size_t zone) {
    const size_t rows = profile->rows;
    double system[SLOW][SLOW + 1] = {{0}};
    size_t known = 0;
    for (size_t y = 0; y < rows; y++) {
        const double q = profile->at[y * BANDING_ZONES + zone];
        if (isnan(q))
            continue;
        double power[SLOW] = {1, 2 * ((double)y + 0.5) / (double)rows - 1};
        power[2] = power[1] * power[1], power[3] = power[2] * power[1];
        for (int i = 0; i < SLOW; i++) {
            for (int j = 0; j < SLOW; j++)
                system[i][j] += power[i] * power[j];
            system[i][SLOW] += power[i] * q;
        }
        known++;
    }
    memset(out, 0, rows * sizeof *out);
    if (known < rows / 4 + 8)
        return false;
    solve(system);
    for (size_t y = 0; y < rows; y++) {
        const double q = profile->at[y * BANDING_ZONES + zone], t = 2 * ((double)y + 0.5) / (double)rows - 1;
        if (!isnan(q))
            out[y] = (float)(q - (system[0][SLOW] + t * (system[1][SLOW] + t * (system[2][SLOW] + t * system[3][SLOW]))));
    }
    return true;
}

static int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* What surrounds each frequency: the median of the incoherent-or-other power over an octave or so,
 * without the bins that the window smears a line over. */
static void surroundings(banding_lines *lines, double *sorted) {
    const long count = (long)lines->count, smear = (long)(3 * lines->length / lines->rows);
    for (long k = 0; k < count; k++) {
        const long reach = smear * 3 + k / 3;
        size_t n = 0;
        for (long j = k - reach; j <= k + reach; j += 1 + reach / 64)
            if (labs(j - k) > smear && j > 0 && j < count)
                sorted[n++] = lines->coherent[j];
        if (n > 0)
            qsort(sorted, n, sizeof *sorted, by_value);
        lines->noise[k] = n > 0 ? sorted[n / 2] : 0;
    }
}

brace_status banding_lines_create(banding_lines *out, const banding_profile *profile, brace_error *error) {
    const size_t rows = profile->rows;
    size_t length = 64;
    while (length < 2 * rows)
        length *= 2;
    *out = (banding_lines){.count = length / 2 + 1, .length = length, .rows = rows};
    out->coherent = core_calloc(out->count, sizeof(double));
    out->noise = core_calloc(out->count, sizeof(double));
    out->slant = core_calloc(out->count, sizeof(float));
    banding_fft *fft = NULL;
    brace_status status = banding_fft_create(&fft, length, error);
    float *residual = core_alloc(rows, sizeof *residual);
    double *sorted = core_alloc(512, sizeof *sorted);
    banding_complex *in = core_alloc(length, sizeof *in);
    banding_complex *zone = core_calloc(BANDING_ZONES * length, sizeof *zone);
    banding_complex *scratch = status == BRACE_OK ? core_alloc(banding_fft_scratch(fft), sizeof *scratch) : NULL;
    if (status == BRACE_OK && (!out->coherent || !out->noise || !out->slant || !residual || !sorted || !in || !zone ||
                               !scratch))
        status = core_fail_memory(error, BANDING_ZONES * length * sizeof *zone, "the rows' spectrum");
    double weight[BANDING_ZONES] = {0}, used = 0;
    for (size_t z = 0; z < BANDING_ZONES && status == BRACE_OK; z++) {
        if (!detrend(residual, profile, z))
            continue;
        double window = 0;
        memset(in, 0, length * sizeof *in);
        for (size_t y = 0; y < rows; y++) {
            const double w = 0.5 - 0.5 * cos(2 * M_PI * ((double)y + 0.5) / (double)rows);
            in[y].re = (float)(w * residual[y]);
            window += isnan(profile->at[y * BANDING_ZONES + z]) ? 0 : w;
        }
        weight[z] = window > 0 ? profile->weight[z] : 0, used += weight[z];
        banding_fft_run(fft, in, zone + z * length, scratch);
        for (size_t k = 0; k < length && window > 0; k++) {
            zone[z * length + k].re *= (float)(2 * weight[z] / window);
            zone[z * length + k].im *= (float)(2 * weight[z] / window);
        }
    }
    for (size_t k = 0; k < out->count && status == BRACE_OK && used > 0; k++)
        for (int s = 0; s < SLANTS; s++) {
            const double slant = 0.5 * (s - SLANTS / 2) / (SLANTS / 2 + 1);
            double re = 0, im = 0;
            for (size_t z = 0; z < BANDING_ZONES; z++) {
                const double a = -2 * M_PI * slant * (double)z, c = cos(a), d = sin(a);
                const banding_complex f = zone[z * length + k];
                re += f.re * c - f.im * d, im += f.re * d + f.im * c;
            }
            const double power = (re * re + im * im) / (used * used);
            if (power > out->coherent[k])
                out->coherent[k] = power, out->slant[k] = (float)slant;
        }
    if (status == BRACE_OK)
        surroundings(out, sorted);
    core_free(residual), core_free(sorted), core_free(in), core_free(zone), core_free(scratch);
    banding_fft_destroy(fft);
    if (status != BRACE_OK)
        banding_lines_free(out);
    return status;
}

void banding_lines_free(banding_lines *lines) {
    core_free(lines->coherent), core_free(lines->noise), core_free(lines->slant);
    lines->coherent = lines->noise = NULL, lines->slant = NULL;
}

void banding_line_find(banding_line *out, const banding_lines *lines, double near) {
    *out = (banding_line){0};
    const double bin = (double)lines->length / (double)lines->rows; /* padded bins a cycle */
    size_t first = (size_t)ceil(fewest_cycles * bin), last = lines->count - 2;
    if (near > 0) {
        first = (size_t)fmax((double)first, (near * (double)lines->rows - 1) * bin);
        last = (size_t)fmin((double)last, (near * (double)lines->rows + 1) * bin);
    }
    double best = 0;
    size_t at = 0;
    for (size_t k = first; k <= last && last < lines->count; k++) {
        const double p = lines->coherent[k];
        if (!(p >= lines->coherent[k - 1] && p >= lines->coherent[k + 1]))
            continue;
        /* Strength counts, and standing out. */
        const double score = p * (p / (p + 8 * lines->noise[k]));
        if (score > best)
            best = score, at = k;
    }
    if (at == 0)
        return;
    const double a = log(lines->coherent[at - 1] + 1e-30), b = log(lines->coherent[at] + 1e-30);
    const double c = log(lines->coherent[at + 1] + 1e-30), bend = a - 2 * b + c;
    const double shift = bend < 0 ? fmax(-0.5, fmin(0.5, 0.5 * (a - c) / bend)) : 0;
    out->found = true;
    out->frequency = ((double)at + shift) / (double)lines->length;
    out->slant = lines->slant[at];
    out->amplitude = sqrt(lines->coherent[at]);
    out->ratio = lines->coherent[at] / fmax(lines->noise[at], 1e-12);
}

/* Mean of the profile at each phase of the wave; returns the share of variance that it explains. */
static double fold(double mean[BANDING_PHASES], const banding_profile *profile, const float *residual,
                   const double *weight, double frequency, double slant) {
    double count[BANDING_PHASES] = {0}, square = 0, all = 0;
    memset(mean, 0, BANDING_PHASES * sizeof *mean);
    for (size_t z = 0; z < BANDING_ZONES; z++)
        for (size_t y = 0; weight[z] > 0 && y < profile->rows; y++) {
            if (isnan(profile->at[y * BANDING_ZONES + z]))
                continue;
            const double r = residual[z * profile->rows + y];
            double phase = frequency * (double)y + slant * (double)z;
            phase -= floor(phase);
            const size_t bin = (size_t)(phase * BANDING_PHASES) % BANDING_PHASES;
            mean[bin] += weight[z] * r, count[bin] += weight[z], square += weight[z] * r * r, all++;
        }
    double explained = 0;
    for (int b = 0; b < BANDING_PHASES; b++) {
        mean[b] = count[b] > 0 ? mean[b] / count[b] : NAN;
        explained += count[b] > 0 ? count[b] * mean[b] * mean[b] : 0;
    }
    /* Bins take out their share of noise as well. */
    const double chance = all > 0 ? BANDING_PHASES / all : 1;
    return square > 0 ? fmax(0, (explained / square - chance) / (1 - fmin(chance, 0.99))) : 0;
}

/* ---- least squares in one profile of all zones ---- */

enum { TERMS = SLOW + 2 * 4 };

typedef struct line_fit {
    size_t rows;
    double *mean, *weight; /* of the zones */
    int harmonics;
} line_fit;

/* Squares that are left of the profile beside a cubic and the harmonics of f, fitted together: a
 * window or a trend taken off before would pull the frequency where few periods are seen. */
static double squares_left(const line_fit *fit, double f) {
    double a[TERMS][TERMS + 1] = {{0}}, total = 0;
    const int n = SLOW + 2 * fit->harmonics;
    for (size_t y = 0; y < fit->rows; y++) {
        const double w = fit->weight[y], q = fit->mean[y];
        if (!(w > 0))
            continue;
        double term[TERMS] = {1, 2 * ((double)y + 0.5) / (double)fit->rows - 1};
        term[2] = term[1] * term[1], term[3] = term[2] * term[1];
        const double c = cos(2 * M_PI * f * (double)y), s = sin(2 * M_PI * f * (double)y);
        double re = 1, im = 0;
        for (int h = 0; h < fit->harmonics; h++) {
            const double t = re * c - im * s;
            im = re * s + im * c, re = t;
            term[SLOW + 2 * h] = re, term[SLOW + 2 * h + 1] = im;
        }
        for (int i = 0; i < n; i++) {
            for (int j = 0; j <= i; j++)
                a[i][j] += w * term[i] * term[j];
            a[i][TERMS] += w * term[i] * q;
        }
        total += w * q * q;
    }
    /* Cholesky in place; what the right side loses is what is explained. */
    for (int i = 0; i < n; i++) {
        for (int j = 0; j <= i; j++) {
            double sum = a[i][j];
            for (int k = 0; k < j; k++)
                sum -= a[i][k] * a[j][k];
            if (i == j)
                a[i][i] = sqrt(fmax(sum, 1e-9));
            else
                a[i][j] = sum / a[j][j];
        }
        double right = a[i][TERMS];
        for (int k = 0; k < i; k++)
            right -= a[i][k] * a[k][TERMS];
        a[i][TERMS] = right / a[i][i];
        total -= a[i][TERMS] * a[i][TERMS];
    }
    return fmax(total, 0);
}

/* The frequency of stripes along the rows, and its error. */
static void fit_frequency(banding_line *line, const banding_profile *profile) {
    const size_t rows = profile->rows;
    double *memory = core_alloc(2 * rows, sizeof *memory);
    if (!memory)
        return;
    line_fit fit = {.rows = rows, .mean = memory, .weight = memory + rows};
    fit.harmonics = (int)fmin(4, fmax(1, floor(0.45 / line->frequency)));
    double known = 0;
    for (size_t y = 0; y < rows; y++) {
        double sum = 0, weight = 0;
        for (size_t z = 0; z < BANDING_ZONES; z++) {
            const double q = profile->at[y * BANDING_ZONES + z];
            if (!isnan(q))
                sum += profile->weight[z] * q, weight += profile->weight[z];
        }
        fit.mean[y] = weight > 0 ? sum / weight : 0;
        fit.weight[y] = weight > 0;
        known += weight > 0;
    }
    const double reach = 0.6 / (double)rows, step = reach / 12;
    double best = INFINITY, at = line->frequency;
    for (int i = -12; i <= 12; i++) {
        const double f = line->frequency + i * step, left = f > 0 ? squares_left(&fit, f) : INFINITY;
        if (left < best)
            best = left, at = f;
    }
    double width = step;
    for (int round = 0; round < 16; round++, width *= 0.6)
        for (int side = -1; side <= 1; side += 2) {
            const double left = squares_left(&fit, at + side * width);
            if (left < best)
                best = left, at += side * width;
        }
    /* Error from the curvature. Neighbouring rows err together: an eighth of them counts. */
    const double h = 0.05 / (double)rows;
    const double bend = (squares_left(&fit, at - h) - 2 * best + squares_left(&fit, at + h)) / (h * h);
    const double variance = known > 0 ? best / fmax(known - TERMS, 1) : 0;
    line->error = bend > 0 ? sqrt(2 * 8 * variance / bend) : 1 / (double)rows;
    line->frequency = at;
    core_free(memory);
}

void banding_line_measure(banding_line *line, const banding_profile *profile) {
    float *residual = core_alloc(BANDING_ZONES * profile->rows, sizeof *residual);
    double used[BANDING_ZONES] = {0};
    if (!line->found || !residual) {
        core_free(residual);
        return;
    }
    for (size_t z = 0; z < BANDING_ZONES; z++)
        used[z] = detrend(residual + z * profile->rows, profile, z) ? profile->weight[z] : 0;
    /* The fold is sharpest at the right frequency and slant. */
    double mean[BANDING_PHASES], best = fold(mean, profile, residual, used, line->frequency, line->slant);
    double step_f = 0.2 / (double)profile->rows, step_s = 0.02;
    for (int round = 0; round < 12; round++, step_f *= 0.6, step_s *= 0.6)
        for (int way = 0; way < 4; way++) {
            const double f = line->frequency + (way == 0 ? step_f : way == 1 ? -step_f : 0);
            const double s = line->slant + (way == 2 ? step_s : way == 3 ? -step_s : 0);
            const double share = f > 0 ? fold(mean, profile, residual, used, f, s) : 0;
            if (share > best)
                best = share, line->frequency = f, line->slant = s;
        }
    if (fabs(line->slant) < 0.05)
        fit_frequency(line, profile);
    else
        line->error = 0.1 / (double)profile->rows;
    line->share = fold(mean, profile, residual, used, line->frequency, line->slant);
    core_free(residual);
    double low = INFINITY, high = 0, zero = 0, re[BANDING_HARMONICS] = {0}, im[BANDING_HARMONICS] = {0};
    for (int b = 0; b < BANDING_PHASES; b++) {
        /* A little smoothing: noise must not pass for contrast. */
        double sum = 0, n = 0;
        for (int j = -1; j <= 1; j++) {
            const double m = mean[(b + j + BANDING_PHASES) % BANDING_PHASES];
            if (!isnan(m))
                sum += m, n++;
        }
        const double light = n <= 0 ? 1 : profile->steps ? exp(sum / n) : fmax(0, 1 + sum / n);
        low = fmin(low, light), high = fmax(high, light), zero += light;
        for (int h = 0; h < BANDING_HARMONICS; h++) {
            const double a = 2 * M_PI * (h + 1) * b / BANDING_PHASES;
            re[h] += light * cos(a), im[h] += light * sin(a);
        }
    }
    line->contrast = high > 0 ? (high - low) / (high + low) : 0;
    for (int h = 0; h < BANDING_HARMONICS; h++)
        line->harmonic[h] = zero > 0 ? 2 * hypot(re[h], im[h]) / zero : 0;
    line->slant *= (double)BANDING_ZONES / (double)profile->columns;
}
