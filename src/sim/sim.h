/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sim.h: how a photograph of a flickering display comes about, step by step.
 *
 *   screen (sRGB picture) -> display driver: cumulative light E(t) of every
 *   subpixel -> scene: which subpixel a pixel sees, when -> renderer: light that
 *   each pixel of the mosaic collects in its exposure, through the lens: blur,
 *   glare, vignetting, and with the room's light -> sensor: colour, noise,
 *   clipping, raw numbers -> frames and ground truth.
 *
 * All light is linear. A subpixel of linear level L in [0, 1] emits e(t) >= 0
 * whose mean over time is L (relative to a white pixel's mean); a driver gives
 * E(t) = integral of e from 0 to t exactly and in O(1), for any t (also < 0).
 * An exposure over [a, a + T] collects (E(a+T) - E(a))/T_ref.
 *
 * Times are seconds (double; single precision does not resolve a pulse after a
 * few seconds), screen positions are screen pixels, x right, y down.
 */
#ifndef SIM_SIM_H
#define SIM_SIM_H

#include <jansson.h>

#include "brace/image.h"
#include "core/core.h"

/* ---- displays (display.c, one file for each driver) ---- */

typedef enum sim_driver_kind { SIM_DC, SIM_LCD_PWM, SIM_OLED_PWM, SIM_LED_SPWM, SIM_BCM, SIM_RASTER } sim_driver_kind;

typedef struct sim_display sim_display;

/* From a preset in data/displays (by name) or a JSON file (by path). Unknown
 * keys, wrong types and values out of range are refused with the file, the line
 * and the path of the key ("oled.json:7: pulses: 0 is out of range 1 to 32"). */
brace_status sim_display_load(sim_display **out, const char *name_or_path, brace_error *error);
brace_status sim_display_parse(sim_display **out, const char *json, const char *name, brace_error *error);
/* Another display of that kind: each real number that the file gives, or that stands where it gives none, is multiplied
 * by what factor() says for its key (of a list each element by the same), and kept within its range. Data sets' priors
 * ask for it. */
typedef double sim_display_factor(const void *user, const char *key);
brace_status sim_display_load_varied(sim_display **out, const char *name_or_path, sim_display_factor *factor,
                                     const void *user, brace_error *error);
bool sim_display_varies(const char *key); /* a real number of some driver */
void sim_display_destroy(sim_display *display);
sim_driver_kind sim_display_kind(const sim_display *display);
const char *sim_display_name(const sim_display *display);
const char *sim_display_family(const sim_display *display); /* "phone", "monitor", "led_wall", ...: for tables */
json_t *sim_display_json(const sim_display *display);       /* new reference: every parameter */

/* Makes ready for one screen content: zones of local dimming and the like are
 * computed here. `rgb` is linear, 3 floats a pixel. The display must outlive its state. */
typedef struct sim_panel sim_panel;
brace_status sim_panel_create(sim_panel **out, const sim_display *display, const float *rgb, uint32_t width,
                              uint32_t height, brace_error *error);
void sim_panel_destroy(sim_panel *panel);

/* E(t) of one subpixel: the plain, double-precision truth. Pure. */
double sim_panel_cumulative(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double t);
/* e(t), where it is finite, for brute-force integration and for drawing waveforms. Pure. */
double sim_panel_emission(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double t);
/* The longest time after which the light of all subpixels repeats, seconds. */
double sim_panel_period(const sim_panel *panel);

/* The hot loop: light that n samples of one channel collect: out[i] =
 * (E(start[i]+exposure) - E(start[i]))/exposure at x[i], y[i], level[i]. One
 * implementation in plain C for every driver, others chosen from CPUID; all
 * agree to 1e-5 of a white pixel. */
typedef void sim_light_fn(const sim_panel *panel, size_t n, const int32_t *x, const int32_t *y, const float *level,
                          int channel, const double *start, double exposure, float *out);
sim_light_fn *sim_light_kernel(const sim_panel *panel, core_cpu cpu);

/* ---- cameras (camera.c) ---- */

typedef struct sim_camera {
    char name[64], make[64], model[64];
    uint32_t width, height; /* of the full sensor; simulated sizes are crops or bins of it */
    double readout;         /* seconds from the first row's start to the last row's */
    int bits;               /* 10 to 14 */
    double black[4], white;
    double f_number, focal_length;
    double iso_base;
    double noise_s, noise_o;   /* var = S x + O on [0,1] at iso_base */
    double noise_s_iso, noise_o_iso; /* growth: S ~ (iso/base)^noise_s_iso, O ~ (iso/base)^noise_o_iso */
    double neutral[3], matrix[9]; /* AsShotNeutral and ColorMatrix for D65 */
    int cfa;
} sim_camera;

brace_status sim_camera_load(sim_camera *out, const char *name_or_path, brace_error *error);
/* From text such as sim_camera_json gives; `name` is for messages. */
brace_status sim_camera_parse(sim_camera *out, const char *json, const char *name, brace_error *error);
json_t *sim_camera_json(const sim_camera *camera);

/* ---- one capture (quantities.c, scene.c, render.c, lens.c, sensor.c, simulate.c) ---- */

/* Where the screen stands in the camera's frame: rotation (radians, x y z),
 * and translation in screen widths; z is the distance. */
typedef struct sim_pose {
    double rotation[3], translation[3];
} sim_pose;

/* Everything that one capture depends on; sampled by sim_scene_sample, every
 * field can be set by hand afterwards. A zero strength switches an effect off.
 * quantities.c lists every field with its range, unit and effect: a field that is
 * added here is added there, and nowhere else. */
typedef struct sim_scene {
    uint64_t seed;
    uint32_t sample;           /* number of the sample: with the seed it keys all randomness */
    uint32_t width, height;    /* of the mosaic */
    int frames;                /* 5: exposures 4^(i-3) of the reference's */
    double reference_time;     /* T_ref, seconds */
    double iso;
    double level;              /* raw signal of a white pixel at the reference exposure, 1: just clips */
    sim_pose pose;             /* at the reference frame */
    double tremor_position, tremor_angle; /* deviation over a second, screen widths and radians */
    double frame_gap;          /* dead time between frames, seconds */
    int subexposures;          /* for motion within an exposure, 1: none */
    int supersample;           /* 1, 2 or 4 rays along each axis of a pixel */
    double distortion[2];      /* Brown-Conrady k1, k2 */
    double psf;                /* lens blur, deviation in pixels */
    double defocus;            /* radius of the disc that a point becomes, pixels */
    double glare;              /* share of the light that is spread widely */
    double vignetting;         /* loss at the corners */
    double ambient;            /* room light reflected by the screen, of white */
    double ambient_hz;         /* 0 steady, 100 or 120 */
    double clutter;            /* brightness of what is around the screen, of white; flickers with the room */
    double bezel;              /* width of the dark frame, in screen widths; only seen with clutter */
    double panel_nonuniformity;  /* relative deviation of the subpixels' light */
    double sensor_nonuniformity; /* relative deviation of the pixels' gain */
    double noise;              /* deviation of shot and read noise, of what the camera's profile says */
    bool field;                /* ground truth captured as the paper does: 8 times the exposure at ISO/8 */
} sim_scene;

#endif
