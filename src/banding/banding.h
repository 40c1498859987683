/* SPDX-License-Identifier: Apache-2.0 */
/*
 * banding.h: what the measures of banding share: planes and their spectra.
 * Internal; the public half is include/brace/banding.h.
 */
#ifndef BANDING_BANDING_H
#define BANDING_BANDING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "brace/banding.h"
#include "core/core.h"

/* ---- transforms (fft.c) ---- */

typedef struct banding_complex {
    float re, im;
} banding_complex;

/* A complex forward transform of a fixed length, any from 1 to 2^24. May be used from several threads at a
 * time, each with its own scratch. */
typedef struct banding_fft banding_fft;
brace_status banding_fft_create(banding_fft **out, size_t length, brace_error *error);
void banding_fft_destroy(banding_fft *fft); /* NULL is allowed */
size_t banding_fft_scratch(const banding_fft *fft); /* in banding_complex, at least 1 */
/* in and out are different arrays of `length`. */
void banding_fft_run(const banding_fft *fft, const banding_complex *in, banding_complex *out,
                     banding_complex *scratch);

/* ---- planes (plane.c) ---- */

typedef struct banding_plane {
    uint32_t width, height;
    float *at; /* width*height */
} banding_plane;

/* Mean of the four packed samples, black and white normalised. */
brace_status banding_plane_frame(banding_plane *out, const brace_frame *frame, core_pool *pool, brace_error *error);
/* Rec. 709 luma on the sRGB curve. */
brace_status banding_plane_image(banding_plane *out, const brace_image *image, core_pool *pool, brace_error *error);
void banding_plane_free(banding_plane *plane);
/* Refuses sizes out of range and values that are no numbers; `plane` begins the sentence. */
brace_status banding_plane_check(const float *plane, uint32_t width, uint32_t height, brace_error *error);

/* ---- spectra (spectrum.c) ---- */

/* The transform of (plane - mean) * Hann for columns 0 .. width/2; the rest follows from
 * S(-u, -v) = conj S(u, v). */
typedef struct banding_spectrum {
    size_t width, height, half; /* half = width/2 + 1 */
    banding_complex *at;        /* height*half, row-major, DC first */
    double mean;
    double window, window2;     /* sums of the window and of its square over the plane */
    bool flat;                  /* the plane is constant but for rounding: no energy anywhere */
} banding_spectrum;

brace_status banding_spectrum_create(banding_spectrum *out, const float *plane, uint32_t width, uint32_t height,
                                     core_pool *pool, const brace_job *job, brace_error *error);
void banding_spectrum_free(banding_spectrum *spectrum);

/* S at row u and column v from the centre of the shifted spectrum: u in [-height/2, (height-1)/2], v likewise, or
 * any other, periodically. */
static inline banding_complex banding_spectrum_at(const banding_spectrum *s, long u, long v) {
    const long w = (long)s->width, h = (long)s->height;
    v = (v % w + w) % w;
    bool mirrored = v >= (long)s->half;
    if (mirrored)
        v = w - v, u = -u;
    u = (u % h + h) % h;
    banding_complex c = s->at[(size_t)u * s->half + (size_t)v];
    if (mirrored)
        c.im = -c.im;
    return c;
}
static inline double banding_spectrum_power(const banding_spectrum *s, long u, long v) {
    banding_complex c = banding_spectrum_at(s, u, v);
    return s->flat ? 0 : (double)c.re * c.re + (double)c.im * c.im;
}

/* The ring that is meant by parameters which may be 0; BRACE_ERROR_ARGUMENT for nonsense. */
brace_status banding_ring(double *r_min, double *r_max, uint32_t width, uint32_t height, double wanted_min,
                          double wanted_max, brace_error *error);

/* ---- the prior (fabp.c) ---- */

/* Fills *out from a spectrum. */
void banding_fabp(brace_fabp *out, const banding_spectrum *spectrum, double r_min, double r_max);

#endif
