/* SPDX-License-Identifier: Apache-2.0 */
/*
 * shim_fake.c: a phone made of arithmetic, in place of android/shim_ndk.c: a
 * screen that pulses 240 times a second in front of a rolling shutter, with a
 * phone's ways of going wrong.
 *
 * BRACE_FAKE_FAULTS="KIND@N,..." makes the N-th request to shoot (from 1, counted
 * for the life of the program) go wrong:
 *
 *   busy      the camera is in use
 *   dropped   the frame is lost
 *   gone      the camera is taken away; it must be opened again
 *   metadata  the frame was exposed with half the time that was asked for, and says so
 *   pixels    the frame was exposed with half the time, and says otherwise
 *   short     the buffer is smaller than the frame
 *   nonsense  noise, black level, neutral and skew are no numbers
 *   stall     nothing happens for three seconds
 *   exit      the program ends
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "../../android/shim.h"

/* The buffer is larger than the active area, and its rows are longer than they are wide, as with real sensors. */
enum { WIDTH = 296, HEIGHT = 216, LEFT = 4, TOP = 6, ACTIVE_WIDTH = 288, ACTIVE_HEIGHT = 204, STRIDE = 2 * WIDTH + 40 };
static const double readout = 0.012, pulses = 240, duty = 0.6;

struct shim {
    char faults[256];
    unsigned shots;
    bool open;
    double focus;
    int64_t clock; /* nanoseconds, of the phone's own time */
    uint8_t *pixels;
};

static const capture_wire_camera camera = {
    .id = "0",
    .facing = CAPTURE_WIRE_BACK,
    .width = WIDTH,
    .height = HEIGHT,
    .left = LEFT,
    .top = TOP,
    .active_width = ACTIVE_WIDTH,
    .active_height = ACTIVE_HEIGHT,
    .cfa = 1,
    .white = 1023,
    .black = {64, 65, 63, 64},
    .exposure_min = 10000,
    .exposure_max = 2000000000,
    .frame_min = 33333333,
    .iso_min = 50,
    .iso_max = 6400,
    .matrix = {{1.04, -0.37, -0.12, -0.44, 1.29, 0.13, -0.05, 0.27, 0.43},
               {0.87, -0.21, -0.14, -0.46, 1.27, 0.2, -0.08, 0.21, 0.54}},
    .calibration = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {1.0625, 0, 0, 0, 1, 0, 0, 0, 0.9375}},
    .illuminant = {17, 21},
    .orientation = 90,
    .aperture = 1.75,
    .focal_length = 6.5,
    .focus_nearest = 10,
};
static const double gains[3] = {0.5, 1, 0.625}; /* camera R, G, B of white light */

/* Whether `kind` is due at this shot. */
static bool due(const shim *s, const char *kind) {
    char wanted[32];
    const size_t n = (size_t)snprintf(wanted, sizeof wanted, "%s@%u", kind, s->shots);
    for (const char *p = s->faults; (p = strstr(p, wanted)) != NULL; p++) {
        if (p[n] == '\0' || p[n] == ',') {
            return true;
        }
    }
    return false;
}

static int fail(char *why, int trouble, const char *text) {
    snprintf(why, SHIM_WHY, "%s", text);
    return trouble;
}

int shim_create(shim **out, char *why) {
    shim *s = calloc(1, sizeof *s);
    if (s == NULL || (s->pixels = calloc(HEIGHT, STRIDE)) == NULL) {
        free(s);
        return fail(why, CAPTURE_WIRE_FAILED, "no memory");
    }
    const char *faults = getenv("BRACE_FAKE_FAULTS");
    snprintf(s->faults, sizeof s->faults, "%s", faults != NULL ? faults : "");
    s->clock = 1000000000;
    *out = s;
    return SHIM_OK;
}

void shim_destroy(shim *s) {
    if (s != NULL) {
        free(s->pixels);
        free(s);
    }
}

int shim_describe(shim *s, capture_wire_welcome *out, char *why) {
    (void)s;
    (void)why;
    snprintf(out->make, sizeof out->make, "Fake");
    snprintf(out->model, sizeof out->model, "Phone 1");
    snprintf(out->system, sizeof out->system, "Android 15");
    out->count = 3;
    snprintf(out->cameras[0].id, sizeof out->cameras[0].id, "1");
    out->cameras[0].facing = CAPTURE_WIRE_FRONT;
    snprintf(out->cameras[1].id, sizeof out->cameras[1].id, "2");
    out->cameras[1].facing = CAPTURE_WIRE_BACK;
    snprintf(out->cameras[2].id, sizeof out->cameras[2].id, "0");
    out->cameras[2].facing = CAPTURE_WIRE_BACK;
    out->cameras[2].usable = true;
    out->cameras[2].focal_length = camera.focal_length;
    return SHIM_OK;
}

int shim_open(shim *s, const char *id, capture_wire_camera *out, char *why) {
    if (strcmp(id, camera.id) != 0) {
        return fail(why, CAPTURE_WIRE_REFUSED, "no such camera");
    }
    s->open = true;
    s->focus = 0;
    *out = camera;
    return SHIM_OK;
}

void shim_close(shim *s) {
    s->open = false;
}

int shim_meter(shim *s, const capture_wire_meter *request, capture_wire_metered *out, char *why) {
    if (!s->open) {
        return fail(why, CAPTURE_WIRE_GONE, "the camera is closed");
    }
    s->focus = request->focus >= 0 ? request->focus : 2.5;
    *out = (capture_wire_metered){
        .exposure = 8000000, .iso = 200, .focus = s->focus, .focused = true, .exposed = true, .balanced = true};
    memcpy(out->neutral, gains, sizeof gains);
    return SHIM_OK;
}

/* The light that a row has had by time t: the integral of a pulse wave of mean 1. */
static double light(double t) {
    const double cycles = t * pulses, whole = floor(cycles);
    return (whole + fmin((cycles - whole) / duty, 1)) / pulses;
}

/* -1 to 1, of no pattern. */
static double noise(uint32_t a, uint32_t b) {
    uint64_t v = ((uint64_t)a << 32 | b) * 0x9e3779b97f4a7c15u;
    v = (v ^ v >> 29) * 0xbf58476d1ce4e5b9u;
    return (double)(int64_t)(v ^ v >> 32) / 9223372036854775808.0;
}

static void render(shim *s, double exposure, double iso) {
    const double s0 = 2e-4, o0 = 1e-6, start = (double)s->clock / 1e9;
    for (uint32_t y = 0; y < HEIGHT; y++) {
        const double a = start + readout * y / HEIGHT;
        const double pulse = light(a + exposure) - light(a);
        for (uint32_t x = 0; x < WIDTH; x++) {
            const unsigned place = (y & 1) * 2 + (x & 1);
            const unsigned color = ((x ^ camera.cfa) & 1) + ((y ^ camera.cfa >> 1) & 1);
            const double u = (double)x / WIDTH, v = (double)y / HEIGHT;
            const double scene = 0.3 + 0.25 * sin(9 * u + 3 * v) * cos(7 * v) + (fmod(8 * u, 1) < 0.5 ? 0.2 : 0.05);
            double signal = 12.0 * scene * gains[color] * pulse * iso / 100;
            signal += sqrt(3 * (s0 * signal + o0)) * noise(s->shots, y * WIDTH + x);
            const double black = camera.black[place];
            const double raw = fmin(fmax(black + signal * (camera.white - black), 0), camera.white);
            const uint16_t value = (uint16_t)(raw + 0.5);
            memcpy(s->pixels + (size_t)y * STRIDE + 2 * x, &value, 2);
        }
    }
}

int shim_shoot(shim *s, const capture_wire_shoot *request, capture_wire_frame *out, shim_image *image, char *why) {
    s->shots++;
    if (!s->open) {
        return fail(why, CAPTURE_WIRE_GONE, "the camera is closed");
    }
    if (due(s, "busy")) {
        return fail(why, CAPTURE_WIRE_BUSY, "another app is using the camera");
    }
    if (due(s, "dropped")) {
        return fail(why, CAPTURE_WIRE_DROPPED, "the camera dropped the frame");
    }
    if (due(s, "gone")) {
        s->open = false;
        return fail(why, CAPTURE_WIRE_GONE, "another app took the camera");
    }
    if (due(s, "exit")) {
        _exit(3);
    }
    if (due(s, "stall")) {
        nanosleep(&(struct timespec){3, 0}, NULL);
    }
    const bool less = due(s, "metadata") || due(s, "pixels");
    const int64_t exposure = less ? request->exposure / 2 : request->exposure;
    s->focus = request->focus >= 0 ? request->focus : s->focus;
    render(s, (double)exposure / 1e9, request->iso);
    *out = (capture_wire_frame){.width = WIDTH,
                                .height = HEIGHT,
                                .exposure = due(s, "pixels") ? request->exposure : exposure,
                                .iso = request->iso,
                                .timestamp = s->clock,
                                .clock = 1750000000000000000 + s->clock,
                                .skew = 12000000,
                                .has_black = true,
                                .black = {64, 65, 63, 64},
                                .white = 1023,
                                .has_noise = true,
                                .noise = {{2e-4, 1e-6}, {2e-4, 1e-6}, {2e-4, 1e-6}, {2e-4, 1e-6}},
                                .aperture = 1.75,
                                .focal_length = 6.5,
                                .focus = s->focus};
    out->neutral[0] = out->neutral[1] = out->neutral[2] = 1; /* with white balance off, as phones have it */
    if (due(s, "nonsense")) {
        out->noise[1][0] = -NAN;
        out->black[2] = -1e30;
        out->neutral[1] = INFINITY;
        out->skew = -5;
    }
    *image = (shim_image){.data = s->pixels, .size = (size_t)STRIDE * HEIGHT - 40, .row_stride = STRIDE};
    if (due(s, "short")) {
        image->size -= STRIDE;
    }
    s->clock += request->exposure + 50000000;
    return SHIM_OK;
}

void shim_release(shim *s) {
    memset(s->pixels, 0, (size_t)STRIDE * HEIGHT);
}
