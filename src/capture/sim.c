/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sim.c: a camera in front of a display that exist as numbers only. Every shot is
 * rendered by the simulator when the shutter is asked for, at the exposure and
 * ISO that were set, on a clock of its own: the same calls with the same seed
 * give the same bytes. It can be told to fail like real ones: sim_fault.c.
 */
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "brace/frame.h"
#include "capture/camera.h"
#include "capture/sim_fault.h"
#include "sim/data_path.h"
#include "sim/quantities.h"
#include "sim/screen.h"
#include "sim/simulate.h"

typedef struct sim_body {
    capture_camera base;
    sim_scene scene;
    sim_camera sensor;
    sim_display *display;
    sim_studio studio;
    sim_light light;
    capture_faults faults;
    bool thirds;          /* a dial with stops of a third: what it says is rounded */
    uint64_t calls;       /* of the shutter, in this sequence */
    double clock;         /* seconds */
    double last_exposure; /* of the shot before, for a lock; 0: none yet */
    double last_iso;
    uint16_t *last; /* its mosaic */
    bool gone;
} sim_body;

/* ---- the dial ---- */

static const double shutter_dial[] = {
    1.0 / 8000, 1.0 / 6400, 1.0 / 5000, 1.0 / 4000, 1.0 / 3200, 1.0 / 2500, 1.0 / 2000, 1.0 / 1600, 1.0 / 1250,
    1.0 / 1000, 1.0 / 800,  1.0 / 640,  1.0 / 500,  1.0 / 400,  1.0 / 320,  1.0 / 250,  1.0 / 200,  1.0 / 160,
    1.0 / 125,  1.0 / 100,  1.0 / 80,   1.0 / 60,   1.0 / 50,   1.0 / 40,   1.0 / 30,   1.0 / 25,   1.0 / 20,
    1.0 / 15,   1.0 / 13,   1.0 / 10,   1.0 / 8,    1.0 / 6,    1.0 / 5,    1.0 / 4,    0.3,        0.4,
    0.5,        0.6,        0.8,        1,          1.3,        1.6,        2};
static const double iso_dial[] = {50,  64,  80,   100,  125,  160,  200,  250,  320,  400,  500,
                                  640, 800, 1000, 1250, 1600, 2000, 2500, 3200, 4000, 5000, 6400};

static void set_limits(sim_body *b) {
    capture_limits *l = &b->base.limits;
    snprintf(l->make, sizeof l->make, "%s", b->sensor.make);
    snprintf(l->model, sizeof l->model, "%s", b->sensor.model);
    snprintf(l->id, sizeof l->id, "%s", b->sensor.name);
    l->readout = b->sensor.readout;
    l->f_number = b->sensor.f_number;
    l->exposure_min = 1.0 / 32000, l->exposure_max = 1;
    l->iso_min = b->sensor.iso_base, l->iso_max = fmax(6400, b->sensor.iso_base);
    if (!b->thirds)
        return;
    for (size_t i = 0; i < sizeof shutter_dial / sizeof *shutter_dial; i++)
        l->exposures[l->exposure_count++] = shutter_dial[i];
    l->exposure_min = l->exposures[0], l->exposure_max = l->exposures[l->exposure_count - 1];
    for (size_t i = 0; i < sizeof iso_dial / sizeof *iso_dial; i++)
        if (iso_dial[i] >= l->iso_min)
            l->isos[l->iso_count++] = iso_dial[i];
    if (l->iso_count > 0)
        l->iso_min = l->isos[0], l->iso_max = l->isos[l->iso_count - 1];
}

/* What a shutter really does when the dial says 1/60: 1/64. */
static double real_exposure(const sim_body *b, double exposure) {
    return b->thirds ? exp2(round(3 * log2(exposure)) / 3) : exposure;
}

/* ---- opening ---- */

static const char *const option_names[] = {"screen", "display", "size", "seed", "time",  "iso",
                                           "level",  "stops",   "set",  "off",  "fault", NULL};

static brace_status number_option(double *value, const capture_address *address, const char *name, double low,
                                  double high, brace_error *error) {
    const char *text = capture_option(address, name);
    if (text == NULL)
        return BRACE_OK;
    char *rest;
    double over = strtod(text, &rest), under = 1;
    const bool fraction = *rest == '/';
    if (fraction)
        under = strtod(rest + 1, &rest);
    if (rest == text || *rest != '\0' || !(over / under >= low && over / under <= high))
        return core_fail(error, BRACE_ERROR_ARGUMENT, "sim: %s=%s is no number from %g to %g", name, text, low, high);
    *value = over / under;
    return BRACE_OK;
}

/* A plausible hand before the screen, with the exposure that was asked for. */
static brace_status read_scene(sim_scene *s, const capture_address *a, brace_error *error) {
    double seed = 1, time = 1.0 / 320, iso = 400, level = 0.6;
    brace_status status = number_option(&seed, a, "seed", 0, 9007199254740991.0, error);
    if (status == BRACE_OK)
        status = number_option(&time, a, "time", 1e-6, 10, error);
    if (status == BRACE_OK)
        status = number_option(&iso, a, "iso", 10, 1e6, error);
    if (status == BRACE_OK)
        status = number_option(&level, a, "level", 1e-4, 100, error);
    if (status != BRACE_OK)
        return status;
    sim_scene_sample(s, (uint64_t)seed, 0, false);
    s->reference_time = time, s->iso = iso, s->level = level;
    s->width = 1024, s->height = 768;
    const char *size = capture_option(a, "size");
    int end = 0;
    if (size != NULL && (sscanf(size, "%5ux%5u%n", &s->width, &s->height, &end) != 2 || size[end] != '\0'))
        return core_fail(error, BRACE_ERROR_ARGUMENT, "sim: size=%s is no size such as 1024x768", size);
    for (size_t i = 0; i < a->option_count && status == BRACE_OK; i++)
        if (strncmp(a->options[i], "set=", 4) == 0)
            status = sim_scene_set(s, a->options[i] + 4, error);
    const char *off = capture_option(a, "off");
    if (status == BRACE_OK && off != NULL)
        status = sim_scene_off(s, off, error);
    return status == BRACE_OK ? sim_scene_check(s, error) : status;
}

static brace_status read_screen(brace_image **out, const capture_address *a, const brace_job *job, brace_error *error) {
    const char *name = capture_option(a, "screen");
    char path[PATH_MAX], folder[PATH_MAX];
    struct stat info;
    if (name == NULL)
        name = "000009_static.webp";
    if (strchr(name, '/') == NULL && stat(name, &info) != 0 && sim_data_folder(folder, "screens", NULL) == BRACE_OK &&
        snprintf(path, sizeof path, "%s/%s", folder, name) < (int)sizeof path)
        name = path;
    return sim_screen_read(out, NULL, name, job, error);
}

static void sim_close(capture_camera *camera, const brace_job *job) {
    (void)job;
    sim_body *b = (sim_body *)camera;
    if (b == NULL)
        return;
    sim_light_free(&b->light);
    sim_studio_free(&b->studio);
    sim_display_destroy(b->display);
    core_free(b->last);
    core_free(b);
}

static brace_status sim_open(capture_camera **out, const capture_address *address, const brace_job *job,
                             brace_error *error) {
    *out = NULL;
    brace_status status = capture_option_unknown(address, "sim", option_names, error);
    if (status != BRACE_OK)
        return status;
    sim_body *b = core_calloc(1, sizeof *b);
    if (b == NULL)
        return core_fail_memory(error, sizeof *b, "a simulated camera");
    b->base.backend = &capture_backend_sim;
    brace_image *screen = NULL;
    core_pool *pool = NULL;
    const char *fault = capture_option(address, "fault"), *display = capture_option(address, "display"),
               *stops = capture_option(address, "stops");
    const char *sensor = address->port != NULL ? address->port : "phone_median";
    status = fault != NULL ? capture_faults_parse(&b->faults, fault, error) : BRACE_OK;
    if (status == BRACE_OK)
        status = read_scene(&b->scene, address, error);
    if (status == BRACE_OK)
        status = sim_camera_load(&b->sensor, sensor, error);
    if (status == BRACE_OK)
        status = sim_display_load(&b->display, display != NULL ? display : "phone_oled_120_480", error);
    /* Phones set any exposure; cameras have a dial. */
    b->thirds = strncmp(b->sensor.name, "phone", 5) != 0;
    if (status == BRACE_OK && stops != NULL) {
        if (strcmp(stops, "thirds") != 0 && strcmp(stops, "none") != 0)
            status = core_fail(error, BRACE_ERROR_ARGUMENT, "sim: stops=%s is neither thirds nor none", stops);
        b->thirds = strcmp(stops, "thirds") == 0;
    }
    if (status == BRACE_OK)
        status = read_screen(&screen, address, job, error);
    if (status == BRACE_OK)
        status = core_pool_create(&pool, job, error);
    if (status == BRACE_OK)
        status = sim_studio_create(&b->studio, screen, b->display, &b->sensor, &b->scene, pool, error);
    if (status == BRACE_OK)
        status = sim_light_create(&b->light, b->scene.width, b->scene.height, error);
    core_pool_destroy(pool);
    brace_image_destroy(screen);
    if (status != BRACE_OK) {
        sim_close(&b->base, job);
        return status;
    }
    set_limits(b);
    b->calls = address->shots;
    b->clock = sim_frame_start(&b->scene, b->sensor.readout, b->scene.frames - 1) +
               (double)b->calls * (b->base.limits.exposure_max + 1);
    *out = &b->base;
    return BRACE_OK;
}

static brace_status sim_list(const capture_address *address, const brace_job *job, capture_found_fn *found, void *user,
                             brace_error *error) {
    (void)address, (void)job;
    sim_camera sensor;
    brace_status status = sim_camera_load(&sensor, "phone_median", error);
    if (status == BRACE_OK)
        found(user, &(capture_found){.port = "",
                                     .make = sensor.make,
                                     .model = sensor.model,
                                     .note = "simulated; sim:NAME is another one of docs/cameras.md"});
    return status;
}

/* ---- shooting ---- */

/* The photograph itself. `exposure` and `iso` are what the sensor does, not what the file says. */
static brace_status expose(sim_body *b, brace_frame *frame, double exposure, double iso, bool lid, const brace_job *job,
                           brace_error *error) {
    core_pool *pool = NULL;
    brace_status status = core_pool_create(&pool, job, error);
    const sim_shot shot = {.start = b->clock,
                           .exposure = exposure,
                           .scale =
                               lid ? 0 : b->scene.level * exposure * iso / (b->scene.reference_time * b->scene.iso)};
    if (status == BRACE_OK)
        status = sim_render_shot(&b->light, &b->studio.stage, &shot, pool, error);
    if (status == BRACE_OK)
        status = sim_expose(frame, &b->light, &b->scene, (int)(b->calls % INT_MAX), pool, error);
    core_pool_destroy(pool);
    return status;
}

/* The next shot may ask for the same bytes, or the same exposure. */
static brace_status remember(sim_body *b, const brace_frame *frame, double exposure, double iso, brace_error *error) {
    const size_t bytes = (size_t)frame->width * frame->height * sizeof *frame->data;
    if (b->last == NULL && (b->last = core_alloc(bytes, 1)) == NULL)
        return core_fail_memory(error, bytes, "the last frame");
    memcpy(b->last, frame->data, bytes);
    b->last_exposure = exposure, b->last_iso = iso;
    return BRACE_OK;
}

static brace_status write_frame(const brace_frame *frame, const char *stem, bool cut, const brace_job *job,
                                brace_error *error) {
    char path[PATH_MAX];
    if (snprintf(path, sizeof path, "%s.dng", stem) >= (int)sizeof path)
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%.200s...: the name is too long", stem);
    brace_status status = brace_frame_write_dng(frame, path, &(brace_dng_params){.no_sync = true}, job, error);
    struct stat info;
    if (status == BRACE_OK && cut && (stat(path, &info) != 0 || truncate(path, info.st_size / 2) != 0))
        status = core_fail(error, BRACE_ERROR_IO, "%s: cannot be cut short", path);
    return status;
}

static brace_status sim_shoot(capture_camera *camera, double exposure, double iso, const char *stem,
                              capture_shot_report *out, const brace_job *job, brace_error *error) {
    sim_body *b = (sim_body *)camera;
    brace_status status = core_check_cancel(job, error);
    if (status != BRACE_OK)
        return status;
    const unsigned faults = capture_faults_at(&b->faults, ++b->calls);
    b->clock += b->scene.frame_gap;
    if (b->gone || (faults & CAPTURE_FAULT_DISCONNECT) != 0) {
        b->gone = true;
        out->trouble = CAPTURE_TROUBLE_GONE;
        return core_fail(error, BRACE_ERROR_IO, "the simulated camera was disconnected");
    }
    if ((faults & CAPTURE_FAULT_BUSY) != 0) {
        out->trouble = CAPTURE_TROUBLE_BUSY;
        return core_fail(error, BRACE_ERROR_IO, "the simulated camera is busy");
    }
    if ((faults & CAPTURE_FAULT_FULL) != 0)
        return core_fail(error, BRACE_ERROR_IO, "%s.dng: cannot write: no space left on the disk", stem);
    if ((faults & CAPTURE_FAULT_BUMP) != 0)
        b->scene.pose.translation[0] += 0.02, b->scene.pose.rotation[2] += 0.01;

    double real = real_exposure(b, exposure), gain = iso, says = exposure, says_iso = iso;
    if ((faults & CAPTURE_FAULT_LOCKED) != 0 && b->last_exposure > 0)
        real = says = b->last_exposure, gain = says_iso = b->last_iso;
    if ((faults & CAPTURE_FAULT_SHUTTER) != 0)
        real /= 4;
    if ((faults & CAPTURE_FAULT_EXIF) != 0)
        says /= 4;
    if ((faults & CAPTURE_FAULT_ISO) != 0)
        gain *= 4, says_iso *= 4;
    brace_frame *frame = NULL;
    status = sim_frame_create(&frame, &b->sensor, &b->scene, says, says_iso, b->clock, error);
    if (status == BRACE_OK && (faults & CAPTURE_FAULT_SAME) != 0 && b->last != NULL)
        memcpy(frame->data, b->last, (size_t)frame->width * frame->height * sizeof *frame->data);
    else if (status == BRACE_OK)
        status = expose(b, frame, real, gain, (faults & CAPTURE_FAULT_BLACK) != 0, job, error);
    if (status == BRACE_OK)
        status = remember(b, frame, real, gain, error);
    if (status == BRACE_OK) {
        out->exposure = frame->exposure_time, out->iso = frame->iso;
        out->timestamp = (int64_t)llround(b->clock * 1e9);
        out->skew = b->sensor.readout;
        memcpy(out->noise, frame->noise, sizeof out->noise);
        out->has_noise = true;
        out->orientation = frame->orientation;
        snprintf(out->extension, sizeof out->extension, "dng");
        b->clock += real + b->sensor.readout;
    }
    if (status == BRACE_OK && (faults & CAPTURE_FAULT_DROP) != 0) {
        out->trouble = CAPTURE_TROUBLE_DROPPED;
        status = core_fail(error, BRACE_ERROR_IO, "the simulated camera dropped the frame");
    }
    if (status == BRACE_OK)
        status = write_frame(frame, stem, (faults & CAPTURE_FAULT_CUT) != 0, job, error);
    brace_frame_destroy(frame);
    return status;
}

const capture_backend capture_backend_sim = {
    .name = "sim",
    .description = "a simulated camera in front of a simulated display; sim:NAME for one of docs/cameras.md",
    .options = "screen=FILE      the picture that is shown, default: one that ships with BRACE\n"
               "display=NAME     docs/displays.md, default phone_oled_120_480\n"
               "size=WxH         of the frames, default 1024x768\n"
               "seed=N           default 1: the hand, the noise and the moment follow from it\n"
               "time=T iso=I level=X  white has the signal X (1 clips) at T and ISO I; default 1/320, 400, 0.6\n"
               "stops=thirds|none     a dial, or any exposure; default: cameras have one, phones don't\n"
               "set=NAME=VALUE   any other quantity of `brace simulate --list`\n"
               "off=EFFECT,...   leave effects out, as `brace simulate --off`\n"
               "fault=KIND:N,... fail at the N-th release; also --fault",
    .list = sim_list,
    .open = sim_open,
    .shoot = sim_shoot,
    .close = sim_close,
};
