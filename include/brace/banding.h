/* SPDX-License-Identifier: Apache-2.0 */
/*
 * banding.h: measuring flicker-banding: its spectrum, its frequency, and how
 * well a restoration gives back the spectrum of the truth.
 *
 * FABP (frequency-aware banding prior) finds the dominant stripe of one frame in
 * its 2-D power spectrum; SFC (stripe frequency consistency) compares two
 * pictures along that stripe's direction. Both follow section "Banding Frequency
 * Analysis and Consistency" of the BRACE paper; what the paper leaves open is
 * decided, with the reasons, in docs/banding.md and repeated here.
 *
 * A RAW frame is measured as its packed planes: the four samples of each 2x2
 * block of the mosaic, (x - black)/(white - black), averaged; so its planes are
 * half as wide and high as the frame, and a frequency of f cycles a (packed)
 * pixel is f/2 cycles a row or column of the sensor. An odd last row or column
 * is left out. A picture is measured as its Rec. 709 luma on the sRGB curve, at
 * its full size.
 *
 * Coordinates: x right, y down, as stored. A stripe pattern is
 *     A cos(2 pi (fx (x - (width-1)/2) + fy (y - (height-1)/2)) + phase),
 * its wave vector (fx, fy) is across the stripes, and its orientation theta
 * along them.
 *
 * Thread safety: all functions are pure but for their outputs. The results do not depend
 * on the number of threads.
 */
#ifndef BRACE_BANDING_H
#define BRACE_BANDING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "bracket.h"
#include "frame.h"
#include "image.h"
#include "job.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define BRACE_BANDING_MAX_FRAMES BRACE_BRACKET_MAX

/* ---- the prior of one frame ---- */

/* All zeros mean the defaults. Radii are distances from the centre of the spectrum in bins:
 * r bins are r periods over the side of the picture. */
typedef struct brace_fabp_params {
    double r_min; /* 0: 3, the first radius that the Hann window's main lobe about DC leaves alone */
    double r_max; /* 0: a quarter of the shorter side: half of what the sampling can hold; at least r_min */
    uint32_t reserved[8];
} brace_fabp_params;

typedef struct brace_fabp {
    uint32_t width, height; /* of the plane that was measured */
    double r_min, r_max;    /* of the ring, bins */

    /* The paper's descriptors, at the strongest bin of the half-plane and ring.
     * All zero if the ring holds no energy (a constant picture, or one too small). */
    int u, v;          /* the peak's row and column, from the centre of the spectrum; u <= 0 */
    double fx, fy, f;  /* v/width, u/height and their length, cycles a pixel */
    double theta;      /* orientation of the stripes: atan2(fy, fx) + pi/2, in [0, pi) */
    double rho;        /* peak power / ring power */
    double peak_power; /* |S|^2 at the peak, S the transform of (plane - mean) * Hann */
    double ring_power; /* the sum of |S|^2 over half-plane and ring */

    /* The same peak between the bins: a parabola through the logarithm of the power at
     * the peak and its neighbours, along each axis. Off by at most 0.016 bins for
     * a lone stripe under the Hann window. */
    double refined_fx, refined_fy, refined_f, refined_theta;
    double amplitude; /* A, in the plane's units, from the refined peak */
    double phase;     /* at the centre of the picture, where it does not depend on the refinement; (-pi, pi] */

    /* What a network is given: f, cos 2 theta, sin 2 theta (refined), ln(1e-12 + p), ln(1e-12 + e),
     * rho, cos phase, sin phase, with p = peak_power/(sum of the window)^2 and
     * e = ring_power/(width*height*sum of the squared window): both free of the picture's size.
     * Zero where nothing was found, but for the two logarithms. */
    float descriptor[8];
} brace_fabp;

/* Measures the prior of a RAW frame. `params` and `job` may be NULL. */
BRACE_API brace_status brace_fabp_frame(brace_fabp *out, const brace_frame *frame, const brace_fabp_params *params,
                                        const brace_job *job, brace_error *error);

/* The same of a picture, any sample type, transfer and number of channels. */
BRACE_API brace_status brace_fabp_image(brace_fabp *out, const brace_image *image, const brace_fabp_params *params,
                                        const brace_job *job, brace_error *error);

/* The same of a plane of width*height floats, row-major. BRACE_ERROR_ARGUMENT,
 * naming the pixel, if one is not a number or beyond 1e9. */
BRACE_API brace_status brace_fabp_plane(brace_fabp *out, const float *plane, uint32_t width, uint32_t height,
                                        const brace_fabp_params *params, const brace_job *job, brace_error *error);

/* The direction of the wave vector, across the stripes, in radians in (-pi/2, pi/2], of a
 * frame as it looks upright: `orientation` is the frame's (EXIF, 1: as stored). This is
 * the direction that the SFC takes. */
BRACE_API double brace_fabp_direction(const brace_fabp *fabp, int orientation);

/* ---- stripe frequency consistency ---- */

/* All zeros mean the defaults. */
typedef struct brace_sfc_params {
    double r_min, r_max;  /* the ring, as brace_fabp_params */
    double half_width;    /* of the sector, degrees; 0: 10 */
    double lambda;        /* weight of the profile; 0: 5 */
    uint32_t reserved[8];
} brace_sfc_params;

/* Everything here is already multiplied by 100, but for the energy ratios and the gate. */
typedef struct brace_sfc {
    double sfc;           /* d_ratio + lambda * gate * d_profile */
    double d_ratio;       /* |rho_pred - rho_gt| */
    double d_profile;     /* mean over the radii of |P_pred - P_gt| */
    double delta_ratio;   /* rho_pred - rho_gt, with its sign */
    double delta_profile; /* mean over the radii of P_pred - P_gt */
    double rho_pred, rho_gt; /* energy in the sector / energy in the ring; 0 for a constant picture */
    double gate;          /* the larger of the two */
    double direction;     /* of the wave vector at the sector's centre, radians */
} brace_sfc;

/* Compares a restored picture with the truth in a sector of the spectrum about
 * `direction`, the wave vector of the banding in the shortest frame
 * (brace_fabp_direction of it). Both pictures must have the same size
 * (BRACE_ERROR_MISMATCH otherwise) and are measured as luma on the sRGB curve.
 * `params` and `job` may be NULL.
 *
 * P(k) is the mean power of the sector's bins at radius k (rounded), divided by
 * the mean over all radii of the same number of the whole ring: so D_profile has
 * no unit, and does not depend on the size or the brightness of the pictures. */
BRACE_API brace_status brace_sfc_image(brace_sfc *out, const brace_image *pred, const brace_image *gt,
                                       double direction, const brace_sfc_params *params, const brace_job *job,
                                       brace_error *error);

/* The same of two RAW frames (packed planes, linear) and of two planes of width*height floats. */
BRACE_API brace_status brace_sfc_frame(brace_sfc *out, const brace_frame *pred, const brace_frame *gt,
                                       double direction, const brace_sfc_params *params, const brace_job *job,
                                       brace_error *error);
BRACE_API brace_status brace_sfc_plane(brace_sfc *out, const float *pred, const float *gt, uint32_t width,
                                       uint32_t height, double direction, const brace_sfc_params *params,
                                       const brace_job *job, brace_error *error);

/* Mean and standard deviation (of the population) over a set: every field of *mean
 * and *deviation on its own; the direction is 0. Zeros for an empty set. */
BRACE_API void brace_sfc_summary(brace_sfc *mean, brace_sfc *deviation, const brace_sfc *items, size_t count);

/* ---- the light behind the stripes ---- */

enum { BRACE_BANDING_HARMONICS = 6, BRACE_BANDING_ALIASES = 6, BRACE_BANDING_SHUTTERS = 48 };

/* All zeros mean the defaults. */
typedef struct brace_banding_params {
    double readout; /* seconds from the first row's start to the last row's; 0: unknown, no frequency in Hz */
    bool no_align;  /* the camera stood on a tripod: do not look for motion */
    brace_fabp_params fabp;
    uint32_t reserved[8];
} brace_banding_params;

/* What one frame shows. Lengths are in pixels of the sensor's mosaic, as stored. */
typedef struct brace_banding_frame {
    brace_fabp fabp;
    double exposure_time; /* seconds; 0 if the frame does not say */
    double confidence;    /* that there is banding at all, 0 to 1 */
    double alone;         /* the same as far as this frame says by itself: pixels of a row agree on a wave of light */
    bool compared;        /* true: told by comparison with longer frames, in which content cancels */
    double told;          /* share of the rows of which something could be told, 0 (all clips) to 1 */
    /* The stripes that were found, whether believed or not; all 0 if none. */
    double frequency;   /* cycles a row */
    double period;      /* pixels from stripe to stripe, across them */
    double orientation; /* of the stripes, degrees in [0, 180): 0 along the rows, 90 along the columns */
    double contrast;    /* modulation depth (max - min)/(max + min) of the light over one period */
    double share;       /* of the rows' variation that the stripes explain, 0 to 1 */
    double row_noise;   /* of the light of one row of a zone */
    double uneven;      /* of frames compared: half the spread (10 to 90 %) of the rows' light about its mean */
    double prominence;  /* power of the line over what surrounds it in the spectrum */
    double frequency_error; /* expected relative error of the frequency, one standard deviation */
    double harmonic[BRACE_BANDING_HARMONICS]; /* amplitude of the light's 1st, 2nd, ... harmonic over its mean */
    double hz;          /* frequency with the row time; 0 without a readout */
} brace_banding_frame;

/* What probably shone. */
typedef enum brace_banding_source {
    BRACE_BANDING_STEADY = 0,    /* no banding was found: steady light, or too fast for these exposures */
    BRACE_BANDING_UNKNOWN = 1,   /* banding, but nothing that tells more (or no readout time was given) */
    BRACE_BANDING_BACKLIGHT = 2, /* one light for all rows: an LCD's pulsed backlight */
    BRACE_BANDING_SCANNED = 3,   /* rows lit one after another: an OLED */
    BRACE_BANDING_LED_WALL = 4,  /* scrambled PWM at a multiple of 960 Hz */
    BRACE_BANDING_MAINS = 5      /* 100 or 120 Hz, smooth: lamps on the mains */
} brace_banding_source;

/* A shutter time and the contrast that it would show, with the light as it was measured. */
typedef struct brace_banding_shutter {
    double seconds;
    double contrast; /* 0 to 1 */
    int periods;     /* n where seconds = n/hz exactly, 0 for a usual time */
} brace_banding_shutter;

typedef struct brace_banding {
    size_t count;
    brace_banding_frame frame[BRACE_BANDING_MAX_FRAMES]; /* in the order given */
    double confidence; /* that at least one frame bands */
    double frequency;  /* cycles a row, of all frames together; 0 if none was found */
    double spread;     /* largest relative deviation of a believed frame from it */
    double frequency_error;      /* expected relative error, one standard deviation, the spread considered */
    double frequency_confidence; /* that it is within 1 % of the light's, but for aliases and scanned rows; 0 to 1 */
    /* With a readout; shutter times only if the confidence is at least 1/2: */
    double readout;
    double hz;      /* frequency / row time, if all rows of the display are lit together */
    double base_hz; /* the light repeats only after several of these periods (refresh): that frequency; else hz */
    double alias_hz[BRACE_BANDING_ALIASES]; /* what would look the same: rows sample the light */
    bool alias_possible[BRACE_BANDING_ALIASES]; /* false: too fast to show the contrast that was measured */
    size_t aliases;
    /* How the contrast decays with exposure time, against |sinc(hz T)|: 0 as light of that frequency does,
     * or too little told; 1 more slowly, -1 faster. Not 0 means that the readout is wrong or the display's rows are
     * scanned: then hz and the shutter times are wrong as well. */
    int decay;
    brace_banding_source source;
    brace_banding_shutter usual[BRACE_BANDING_SHUTTERS]; /* third stops, 1/8000 s to 1/4 s, longest first */
    size_t usuals;
    brace_banding_shutter exact[BRACE_BANDING_SHUTTERS]; /* n/hz */
    size_t exacts;
} brace_banding;

/* Measures 1 to BRACE_BANDING_MAX_FRAMES frames of one screen. Frames of the same camera, size and CFA
 * but different exposure are aligned and each compared with the longer ones; a
 * frame on its own is measured by itself, which is less sure. The frequency in Hz
 * is that of light that all rows of the display share. A display that lights its
 * rows one after another shifts it (docs/banding.md). `params` and `job` may be NULL. */
BRACE_API brace_status brace_banding_measure(brace_banding *out, const brace_frame *const *frames, size_t count,
                                             const brace_banding_params *params, const brace_job *job,
                                             brace_error *error);

/* "steady", "unknown", "backlight", "scanned", "led_wall", "mains"; never NULL. */
BRACE_API const char *brace_banding_source_name(brace_banding_source source);

#ifdef __cplusplus
}
#endif
#endif
