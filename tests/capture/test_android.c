/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_android.c: the back end `android` and the phone's program, each in a process
 * of its own, with a computed phone behind the shim: what arrives in the DNG, what
 * goes wrong on the phone or on the way, and what either does with hostile bytes.
 *
 *   test_android PHONE CABLE    the two programs
 */
#include <math.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include "../../android/server.h"
#include "brace/frame.h"
#include "capture/android_frame.h"
#include "capture/camera.h"
#include "raw/raw.h"

#include "child.h"
#include "samples.h"

static const char *phone_program, *cable_program;
static char folder[] = "/tmp/brace-test-android-XXXXXX";

/* ---- programs ---- */

static child start_phone(const char *faults) {
    return child_phone(phone_program, faults);
}

static child start_cable(child phone, const char *fault) {
    const char *const faults[] = {fault, NULL};
    return child_cable(cable_program, phone, faults);
}

/* ---- the computer's end ---- */

static brace_error error;

static brace_status open_port(capture_camera **out, unsigned port, const char *option) {
    char text[64];
    snprintf(text, sizeof text, "%u", port);
    const capture_address address = {.port = text, .options = &option, .option_count = option != NULL};
    return capture_backend_android.open(out, &address, NULL, &error);
}

static capture_camera *open_good(unsigned port) {
    capture_camera *camera = NULL;
    assert_int_equal(open_port(&camera, port, NULL), BRACE_OK);
    assert_non_null(camera);
    return camera;
}

static brace_status shoot(capture_camera *camera, double exposure, capture_shot_report *report) {
    char stem[128];
    snprintf(stem, sizeof stem, "%s/shot", folder);
    *report = (capture_shot_report){.timestamp = -1};
    return camera->backend->shoot(camera, exposure, 200, stem, report, NULL, &error);
}

/* The file of the last shot; NULL if there is none. */
static brace_frame *load(void) {
    char path[128];
    brace_frame *f = NULL;
    snprintf(path, sizeof path, "%s/shot.dng", folder);
    if (access(path, F_OK) != 0) {
        return NULL;
    }
    assert_int_equal(brace_frame_read(&f, path, NULL, &error), BRACE_OK);
    unlink(path);
    return f;
}

static void test_frame(void **state) {
    (void)state;
    const child phone = start_phone(NULL);
    capture_camera *camera = open_good(phone.port);
    assert_string_equal(camera->limits.make, "Fake");
    assert_string_equal(camera->limits.model, "Phone 1");
    assert_true(camera->limits.exposure_min == 1e-5 && camera->limits.exposure_max == 2);
    assert_true(camera->limits.iso_min == 50 && camera->limits.iso_max == 6400);
    assert_true(camera->limits.exposure_count == 0 && camera->limits.iso_count == 0);
    capture_shot_report report;
    int64_t before = -1;
    /* The same pixels, made here. */
    char why[SHIM_WHY];
    shim *twin = NULL;
    capture_wire_camera k;
    assert_int_equal(shim_create(&twin, why), SHIM_OK);
    assert_int_equal(shim_open(twin, "0", &k, why), SHIM_OK);
    for (int i = 0; i < 3; i++) {
        const double exposure = 0.008 / (1 << (2 * i));
        assert_int_equal(shoot(camera, exposure, &report), BRACE_OK);
        assert_string_equal(report.extension, "dng");
        assert_true(fabs(report.exposure / exposure - 1) < 1e-6 && report.iso == 200);
        assert_true(report.timestamp > before);
        before = report.timestamp;
        assert_true(fabs(report.skew - 0.012 * 215 / 216) < 1e-9 && report.has_noise && report.orientation == 6);
        brace_frame *f = load();
        assert_non_null(f);
        assert_int_equal(f->width, 288);
        assert_int_equal(f->height, 204);
        assert_int_equal(f->cfa, BRACE_CFA_GRBG);
        assert_true(f->exposure_time == report.exposure && f->iso == 200 && f->f_number == 1.75);
        assert_true(f->focal_length == 6.5 && f->white == 1023 && f->black[1] == 65 && f->black[2] == 63);
        assert_true(f->has_noise && f->noise[1][0] == 2e-4 && f->noise[2][1] == 1e-6);
        assert_string_equal(f->make, "Fake");
        assert_string_equal(f->unique_model, "Fake Phone 1");
        assert_int_equal(strlen(f->datetime), 19);
        assert_int_equal(f->illuminant[0], 17);
        assert_int_equal(f->illuminant[1], 21);
        assert_true(fabs(f->color_matrix[0][4] - 1.29) < 1e-9);
        assert_true(fabs(f->color_matrix[1][0] - 1.0625 * 0.87) < 1e-9); /* calibration is multiplied in */
        assert_true(fabs(f->color_matrix[1][8] - 0.9375 * 0.54) < 1e-9);
        assert_true(f->as_shot_neutral[0] == 0.5 && f->as_shot_neutral[2] == 0.625);
        const capture_wire_shoot request = {.exposure = (int64_t)nearbyint(exposure * 1e9), .iso = 200, .focus = -1};
        capture_wire_frame frame;
        shim_image image;
        assert_int_equal(shim_shoot(twin, &request, &frame, &image, why), SHIM_OK);
        for (uint32_t y = 0; y < f->height; y++) {
            assert_memory_equal(f->data + (size_t)y * f->width,
                                image.data + (y + k.top) * image.row_stride + 2 * k.left, 2 * f->width);
        }
        shim_release(twin);
        brace_frame_destroy(f);
    }
    shim_destroy(twin);
    camera->backend->close(camera, NULL);
    assert_int_equal(child_end(phone, true), 0);
}

/* Odd origins of the active area move filters and levels; the front camera turns the other way; what the phone does
 * not say is left out. */
static void test_conversion(void **state) {
    (void)state;
    const double none[3] = {0, 0, 0};
    capture_wire_camera camera = sample(CAPTURE_WIRE_CAMERA - 1).camera;
    capture_wire_frame frame = sample(CAPTURE_WIRE_FRAME - 1).frame;
    camera.width = frame.width = 40;
    camera.height = frame.height = 30;
    camera.active_width = 30;
    camera.active_height = 20;
    const capture_android_shot shot = {
        .make = "Google", .model = "google Pixel", .camera = &camera, .frame = &frame, .neutral = none, .turn = 90};
    for (uint32_t i = 0; i < 4; i++) {
        frame.black[i] = 60 + i;
        frame.noise[i][0] = (1 + i) * 1e-4;
    }
    for (uint32_t i = 0; i < 16; i++) {
        brace_frame *f = NULL;
        camera.cfa = (uint8_t)(i >> 2);
        camera.left = 2 + (i & 1);
        camera.top = 4 + (i >> 1 & 1);
        camera.facing = (uint8_t)(i & 1);
        assert_int_equal(capture_android_frame(&f, &shot, &error), BRACE_OK);
        for (uint32_t n = 0; n < 4; n++) {
            const uint32_t x = n & 1, y = n >> 1, from = ((y + camera.top) & 1) * 2 + ((x + camera.left) & 1);
            assert_int_equal(brace_cfa_color(f->cfa, x, y),
                             brace_cfa_color((brace_cfa)camera.cfa, x + camera.left, y + camera.top));
            assert_true(f->black[n] == (float)(60 + from));
            const int color = brace_cfa_color(f->cfa, x, y);
            assert_true(color == 1 || f->noise[color][0] == frame.noise[from][0]);
        }
        /* 270 and 90 degrees: upright for a camera on the back, head down for one on the front. */
        assert_int_equal(f->orientation, camera.facing == CAPTURE_WIRE_BACK ? 1 : 3);
        assert_string_equal(f->unique_model, "google Pixel");
        assert_true(f->as_shot_neutral[0] == 1 && f->as_shot_neutral[2] == 1);
        /* Every sample to its place, in pieces of all sizes. */
        uint8_t bytes[40 * 30 * 2];
        for (uint32_t n = 0; n < sizeof bytes / 2; n++) {
            bytes[2 * n] = (uint8_t)n;
            bytes[2 * n + 1] = (uint8_t)(n >> 8);
        }
        for (uint32_t at = 0, step = 2 + 2 * i; at < sizeof bytes; at += step) {
            const uint32_t left = (uint32_t)sizeof bytes - at;
            capture_android_put(f, &camera, at, bytes + at, left < step ? left : step);
        }
        for (uint32_t y = 0; y < f->height; y++) {
            for (uint32_t x = 0; x < f->width; x++) {
                assert_int_equal(f->data[y * f->width + x], (y + camera.top) * 40 + x + camera.left);
            }
        }
        brace_frame_destroy(f);
    }
    brace_frame *f = NULL;
    memset(camera.matrix[0], 0, sizeof camera.matrix[0]); /* only the second: it becomes the first */
    memset(camera.calibration, 0, sizeof camera.calibration);
    frame.has_black = false;
    frame.white = 0;
    frame.clock = 0;
    assert_int_equal(capture_android_frame(&f, &shot, &error), BRACE_OK);
    assert_true(f->illuminant[0] == camera.illuminant[1] && f->illuminant[1] == 0);
    assert_memory_equal(f->color_matrix[0], camera.matrix[1], sizeof camera.matrix[1]);
    assert_true(f->white == 1023 && f->black[0] == (float)camera.black[3] && f->datetime[0] == '\0');
    brace_frame_destroy(f);
    frame.white = 65; /* below the camera's own black */
    f = NULL;
    assert_int_equal(capture_android_frame(&f, &shot, &error), BRACE_ERROR_FORMAT);
    assert_null(f);
}

/* ---- what goes wrong on the phone ---- */

/* A shot fails with `trouble` and a sentence with `text`, leaves no file, and after what the core does then the next
 * one comes. */
static void check_fault(const char *faults, capture_trouble trouble, const char *text) {
    const child phone = start_phone(faults);
    capture_camera *camera = open_good(phone.port);
    capture_shot_report report;
    assert_int_equal(shoot(camera, 0.004, &report), BRACE_OK);
    brace_frame_destroy(load());
    assert_int_not_equal(shoot(camera, 0.004, &report), BRACE_OK);
    assert_int_equal(report.trouble, trouble);
    if (strstr(error.message, text) == NULL) {
        fail_msg("'%s' does not say '%s'", error.message, text);
    }
    assert_null(load());
    if (trouble == CAPTURE_TROUBLE_GONE) {
        camera->backend->close(camera, NULL);
        camera = open_good(phone.port);
    }
    assert_int_equal(shoot(camera, 0.004, &report), BRACE_OK);
    brace_frame_destroy(load());
    camera->backend->close(camera, NULL);
    assert_int_equal(child_end(phone, true), 0);
}

static void test_phone_faults(void **state) {
    (void)state;
    check_fault("busy@2", CAPTURE_TROUBLE_BUSY, "another app is using the camera");
    check_fault("dropped@2", CAPTURE_TROUBLE_DROPPED, "dropped the frame");
    check_fault("short@2", CAPTURE_TROUBLE_DROPPED, "not of the size");
    check_fault("gone@2", CAPTURE_TROUBLE_GONE, "took the camera");
}

/* The phone exposes less than it was asked to. It says so, or not: the first shows in the report and the file, the
 * second in the pixels, where the core looks for it. */
static void test_phone_lies(void **state) {
    (void)state;
    const child phone = start_phone("metadata@2,pixels@3,nonsense@4");
    capture_camera *camera = open_good(phone.port);
    capture_shot_report report;
    assert_int_equal(shoot(camera, 0.004, &report), BRACE_OK);
    brace_frame *good = load();
    assert_int_equal(shoot(camera, 0.004, &report), BRACE_OK);
    assert_true(report.exposure == 0.002);
    brace_frame *f = load();
    assert_true(f->exposure_time == 0.002);
    brace_frame_destroy(f);
    assert_int_equal(shoot(camera, 0.004, &report), BRACE_OK);
    assert_true(report.exposure == 0.004);
    f = load();
    assert_true(f->exposure_time == 0.004);
    assert_true(fabs(raw_measure_ratio(f, good).ratio - 0.5) < 0.1);
    brace_frame_destroy(f);
    /* Metadata that makes no sense is not passed on. */
    assert_int_equal(shoot(camera, 0.004, &report), BRACE_OK);
    assert_true(!report.has_noise && report.skew == 0);
    f = load();
    assert_true(f->black[2] == 63 && f->as_shot_neutral[1] == 1);
    brace_frame_destroy(f);
    brace_frame_destroy(good);
    camera->backend->close(camera, NULL);
    assert_int_equal(child_end(phone, true), 0);
}

static void test_phone_ends(void **state) {
    (void)state;
    const child phone = start_phone("exit@1");
    capture_camera *camera = open_good(phone.port);
    capture_shot_report report;
    assert_int_equal(shoot(camera, 0.004, &report), BRACE_ERROR_IO);
    assert_int_equal(report.trouble, CAPTURE_TROUBLE_GONE);
    assert_int_equal(shoot(camera, 0.004, &report), BRACE_ERROR_IO);
    assert_int_equal(report.trouble, CAPTURE_TROUBLE_GONE);
    assert_null(load());
    camera->backend->close(camera, NULL);
    assert_int_equal(child_end(phone, false), 3);
}

/* ---- what goes wrong on the way ---- */

static void test_cable(void **state) {
    (void)state;
    /* From the greeting to the last bytes of the first frame (296 * 216 * 2 = 127872 bytes), and beyond it. */
    static const struct {
        const char *fault;
        bool opens;
    } cases[] = {{"cut=0", false},     {"cut=10", false},    {"flip=40", false},     {"stall=30", false},
                 {"cut=300", false},   {"flip=500", false},  {"cut=1000", true},     {"flip=2000", true},
                 {"cut=64000", true},  {"flip=64001", true}, {"stall=100000", true}, {"cut=128500", true},
                 {"flip=128000", true}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const child phone = start_phone(NULL);
        const child cable = start_cable(phone, cases[i].fault);
        capture_camera *camera = NULL;
        capture_shot_report report;
        const brace_status status = open_port(&camera, cable.port,
                                              cases[i].fault[0] != 's' ? NULL
                                              : cases[i].opens         ? "timeout=2"
                                                                       : "timeout=0.5");
        assert_true((status == BRACE_OK) == cases[i].opens && (camera != NULL) == cases[i].opens);
        if (cases[i].opens) {
            assert_int_not_equal(shoot(camera, 0.004, &report), BRACE_OK);
            assert_int_equal(report.trouble, CAPTURE_TROUBLE_GONE);
            assert_null(load());
            camera->backend->close(camera, NULL);
        }
        /* The next connection is as good as new. */
        camera = open_good(cable.port);
        assert_int_equal(shoot(camera, 0.004, &report), BRACE_OK);
        brace_frame *f = load();
        assert_non_null(f);
        brace_frame_destroy(f);
        camera->backend->close(camera, NULL);
        child_end(cable, false);
        assert_int_equal(child_end(phone, true), 0);
    }
}

/* Ctrl-C while a frame is on its way and the cable is silent: no waiting for the timeout, no file. */
static volatile int cancelled;

static void on_alarm(int number) {
    (void)number;
    cancelled = 1;
}

static void test_cancel(void **state) {
    (void)state;
    char stem[128];
    const child phone = start_phone(NULL);
    const child cable = start_cable(phone, "stall=100000");
    capture_camera *camera = open_good(cable.port);
    const brace_job job = {.cancel = &cancelled};
    capture_shot_report report = {.timestamp = -1};
    snprintf(stem, sizeof stem, "%s/shot", folder);
    struct sigaction action = {.sa_handler = on_alarm};
    sigaction(SIGALRM, &action, NULL);
    alarm(1);
    assert_int_equal(camera->backend->shoot(camera, 0.004, 200, stem, &report, &job, &error), BRACE_ERROR_CANCELLED);
    assert_int_equal(report.trouble, CAPTURE_TROUBLE_FINAL);
    assert_null(load());
    camera->backend->close(camera, &job);
    child_end(cable, false);
    assert_int_equal(child_end(phone, true), 0);
}

/* ---- a hostile phone ---- */

static int listen_any(unsigned *port) {
    uint16_t p = 0;
    const int fd = server_listen_loopback(&p);
    assert_true(fd >= 0);
    *port = p;
    return fd;
}

/* A phone that answers each request with the next of `messages`, written byte for byte. */
static pid_t start_liar(int listener, const capture_message *messages, size_t count) {
    const pid_t pid = fork();
    assert_true(pid >= 0);
    if (pid == 0) {
        const int fd = accept(listener, NULL, NULL);
        capture_channel *channel = calloc(1, sizeof *channel);
        capture_message request;
        capture_channel_begin(channel, fd, 2000);
        uint32_t number = 1;
        for (size_t i = 0; i < count; i++) {
            /* Frames are followed by their data without being asked. */
            if (messages[i].type != CAPTURE_WIRE_DATA &&
                capture_channel_receive(channel, &request, 2000) == CAPTURE_CHANNEL_OK) {
                number = request.number;
            }
            capture_message m = messages[i];
            m.number += number;
            if (capture_channel_send(channel, &m) != CAPTURE_CHANNEL_OK) {
                break;
            }
        }
        (void)capture_channel_receive(channel, &request, 2000);
        _exit(0);
    }
    return pid;
}

static void test_hostile_phone(void **state) {
    (void)state;
    capture_message m[6] = {sample(CAPTURE_WIRE_WELCOME - 1), sample(CAPTURE_WIRE_CAMERA - 1),
                            sample(CAPTURE_WIRE_METERED - 1), sample(CAPTURE_WIRE_FRAME - 1),
                            sample(CAPTURE_WIRE_DATA - 1),    sample(CAPTURE_WIRE_DATA - 1)};
    for (int i = 0; i < 6; i++) {
        m[i].number = 0;
    }
    m[1].camera.width = m[3].frame.width = 40;
    m[1].camera.height = m[3].frame.height = 30;
    m[1].camera.left = m[1].camera.top = 0;
    m[1].camera.active_width = 40;
    m[1].camera.active_height = 30;
    m[4].data.offset = 0;
    m[5].data.offset = 300;
    static const char *const sentences[] = {"for place 302", "for place 262144", "out of place", "39 x 30",
                                            "out of place",  "for place 0",      "black is"};
    for (size_t lie = 0; lie < sizeof sentences / sizeof sentences[0]; lie++) {
        capture_message told[6];
        memcpy(told, m, sizeof m);
        switch (lie) {
        case 0:
            told[5].data.offset = 302;
            break;
        case 1:
            told[4].data.offset = 1 << 18;
            break;
        case 2:
            told[4].number = 1; /* of another request */
            break;
        case 3:
            told[3].frame.width = 39;
            break;
        case 4:
            told[3] = sample(CAPTURE_WIRE_METERED - 1);
            told[3].number = 0;
            break;
        case 5:
            told[4].data.size = 299; /* half a sample */
            break;
        default:
            told[3].frame.has_black = false;
            told[3].frame.white = 40;
        }
        unsigned port = 0;
        const int listener = listen_any(&port);
        const pid_t liar = start_liar(listener, told, 6);
        capture_camera *camera = open_good(port);
        capture_shot_report report;
        assert_int_equal(shoot(camera, 0.004, &report), BRACE_ERROR_FORMAT);
        assert_int_equal(report.trouble, CAPTURE_TROUBLE_GONE);
        if (strstr(error.message, sentences[lie]) == NULL) {
            fail_msg("'%s' does not say '%s'", error.message, sentences[lie]);
        }
        assert_null(load());
        camera->backend->close(camera, NULL);
        close(listener);
        waitpid(liar, NULL, 0);
    }
}

/* ---- a hostile computer ---- */

static int connect_to(unsigned port) {
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_int_equal(connect(fd, (const struct sockaddr *)&address, sizeof address), 0);
    return fd;
}

/* Asks, and expects an answer of a type; an ERROR's kind otherwise. */
static int ask(capture_channel *channel, capture_message m, capture_wire_type type) {
    capture_message back;
    m.number = 77;
    assert_int_equal(capture_channel_send(channel, &m), CAPTURE_CHANNEL_OK);
    assert_int_equal(capture_channel_receive(channel, &back, 5000), CAPTURE_CHANNEL_OK);
    assert_int_equal(back.number, 77);
    assert_true(back.type == type || back.type == CAPTURE_WIRE_ERROR);
    return back.type == type ? SHIM_OK : back.error.trouble;
}

static void test_hostile_computer(void **state) {
    (void)state;
    const child phone = start_phone(NULL);
    capture_channel *channel = calloc(1, sizeof *channel);
    capture_message back, m;
    assert_non_null(channel);
    /* Bytes that are no message, half a message, messages of the wrong kind at the start. */
    core_random r = core_random_create(11, 0, 0, 0);
    for (int round = 0; round < 40; round++) {
        uint8_t noise[600];
        size_t n = 1 + core_random_below(&r, 500);
        for (size_t i = 0; i < sizeof noise; i++) {
            noise[i] = (uint8_t)core_random_u32(&r);
        }
        if (round % 2 != 0) {
            m = sample(round / 2 % SAMPLES);
            n = capture_message_write(&m, noise, sizeof noise);
            n -= round % 4 == 1 ? core_random_below(&r, (uint32_t)n) : 0;
        }
        const int fd = connect_to(phone.port);
        assert_int_equal(send(fd, noise, n, MSG_NOSIGNAL), (ssize_t)n);
        shutdown(fd, SHUT_WR);
        while (recv(fd, noise, sizeof noise, 0) > 0) {
        }
        close(fd);
    }
    /* Requests out of order or of values that the camera does not have. */
    capture_channel_begin(channel, connect_to(phone.port), 2000);
    assert_int_equal(ask(channel, sample(CAPTURE_WIRE_HELLO - 1), CAPTURE_WIRE_WELCOME), SHIM_OK);
    assert_int_equal(ask(channel, sample(CAPTURE_WIRE_SHOOT - 1), CAPTURE_WIRE_FRAME), CAPTURE_WIRE_GONE);
    assert_int_equal(ask(channel, sample(CAPTURE_WIRE_METER - 1), CAPTURE_WIRE_METERED), CAPTURE_WIRE_GONE);
    m = sample(CAPTURE_WIRE_OPEN - 1);
    assert_int_equal(ask(channel, m, CAPTURE_WIRE_CAMERA), CAPTURE_WIRE_UNSUPPORTED); /* "2", without RAW */
    strcpy(m.open.id, "no such");
    assert_int_equal(ask(channel, m, CAPTURE_WIRE_CAMERA), CAPTURE_WIRE_REFUSED);
    strcpy(m.open.id, "");
    assert_int_equal(ask(channel, m, CAPTURE_WIRE_CAMERA), SHIM_OK);
    m = sample(CAPTURE_WIRE_SHOOT - 1);
    m.shoot.exposure = 9999;
    assert_int_equal(ask(channel, m, CAPTURE_WIRE_FRAME), CAPTURE_WIRE_REFUSED);
    m.shoot.exposure = 2000000001;
    assert_int_equal(ask(channel, m, CAPTURE_WIRE_FRAME), CAPTURE_WIRE_REFUSED);
    m.shoot.exposure = 1000000;
    m.shoot.iso = 49;
    assert_int_equal(ask(channel, m, CAPTURE_WIRE_FRAME), CAPTURE_WIRE_REFUSED);
    m.shoot.iso = 50;
    m.shoot.focus = 10.5;
    assert_int_equal(ask(channel, m, CAPTURE_WIRE_FRAME), CAPTURE_WIRE_REFUSED);
    /* The connection has survived that; a second greeting ends it. */
    m.shoot.focus = 10;
    assert_int_equal(ask(channel, m, CAPTURE_WIRE_FRAME), SHIM_OK);
    assert_int_equal(capture_channel_receive(channel, &back, 2000), CAPTURE_CHANNEL_OK);
    assert_int_equal(back.type, CAPTURE_WIRE_DATA);
    assert_int_equal(back.data.size, 296 * 216 * 2);
    assert_int_equal(ask(channel, sample(CAPTURE_WIRE_HELLO - 1), CAPTURE_WIRE_WELCOME), CAPTURE_WIRE_REFUSED);
    assert_int_equal(capture_channel_receive(channel, &back, 2000), CAPTURE_CHANNEL_CLOSED);
    capture_channel_end(channel);
    /* One that says nothing holds the phone up for its patience, no longer. */
    const int silent = connect_to(phone.port);
    capture_channel_begin(channel, connect_to(phone.port), 2000);
    m = sample(CAPTURE_WIRE_HELLO - 1);
    assert_int_equal(capture_channel_send(channel, &m), CAPTURE_CHANNEL_OK);
    assert_int_equal(capture_channel_receive(channel, &back, 20000), CAPTURE_CHANNEL_OK);
    assert_int_equal(back.type, CAPTURE_WIRE_WELCOME);
    close(silent);
    capture_channel_end(channel);
    free(channel);
    assert_int_equal(child_end(phone, true), 0);
}

/* The socket that adb forwards to: abstract, and for this user. */
static bool stop_when_told(void *user) {
    return *(volatile sig_atomic_t *)user != 0;
}

static void test_abstract_socket(void **state) {
    (void)state;
    char name[64];
    snprintf(name, sizeof name, "brace-test-%ld", (long)getpid());
    const int listener = server_listen_abstract(name);
    assert_true(listener >= 0);
    assert_int_equal(server_listen_abstract(name), -1); /* one at a time */
    char longest[200];
    memset(longest, 'x', sizeof longest);
    longest[sizeof longest - 1] = '\0';
    assert_int_equal(server_listen_abstract(longest), -1);
    const pid_t pid = fork();
    assert_true(pid >= 0);
    if (pid == 0) {
        char why[SHIM_WHY];
        shim *camera = NULL;
        static volatile sig_atomic_t never;
        if (shim_create(&camera, why) != SHIM_OK) {
            _exit(1);
        }
        const server s = {.camera = camera,
                          .idle = 2000,
                          .patience = 2000,
                          .stopped = stop_when_told,
                          .user = (void *)(uintptr_t)&never};
        _exit(server_run(&s, listener) ? 0 : 1);
    }
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    const size_t n = strlen(name);
    memcpy(address.sun_path + 1, name, n);
    const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_int_equal(
        connect(fd, (const struct sockaddr *)&address, (socklen_t)(offsetof(struct sockaddr_un, sun_path) + 1 + n)), 0);
    capture_channel *channel = calloc(1, sizeof *channel);
    assert_non_null(channel);
    capture_channel_begin(channel, fd, 2000);
    assert_int_equal(ask(channel, sample(CAPTURE_WIRE_HELLO - 1), CAPTURE_WIRE_WELCOME), SHIM_OK);
    capture_channel_end(channel);
    free(channel);
    close(listener);
    kill(pid, SIGKILL);
    waitpid(pid, NULL, 0);
}

/* ---- memory ---- */

/* Whichever allocation fails: an error, no file, and the phone is free again. */
static void test_memory(void **state) {
    (void)state;
    const child phone = start_phone(NULL);
    bool done = false;
    unsigned failures = 0;
    for (long n = 1; !done && n < 300; n++) {
        capture_camera *camera = NULL;
        capture_shot_report report;
        core_alloc_fail_after(n);
        brace_status status = open_port(&camera, phone.port, NULL);
        if (status == BRACE_OK) {
            status = shoot(camera, 0.004, &report);
        }
        core_alloc_fail_after(0);
        done = status == BRACE_OK;
        failures += !done;
        capture_backend_android.close(camera, NULL);
        brace_frame *f = load();
        assert_true((f != NULL) == done);
        brace_frame_destroy(f);
        if (!done) {
            assert_int_equal(status, BRACE_ERROR_MEMORY);
        }
    }
    assert_true(done && failures > 4);
    assert_int_equal(child_end(phone, true), 0);
}

/* ---- addresses, options, adb ---- */

static void expect_refusal(const char *port, const char *option, const char *text) {
    capture_camera *camera = NULL;
    const capture_address address = {.port = port, .options = &option, .option_count = option != NULL};
    assert_int_equal(capture_backend_android.open(&camera, &address, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_null(camera);
    if (strstr(error.message, text) == NULL) {
        fail_msg("'%s' does not say '%s'", error.message, text);
    }
}

static void test_options(void **state) {
    (void)state;
    expect_refusal("0", NULL, "port '0'");
    expect_refusal("65536/1", NULL, "port '65536'");
    expect_refusal("72.5", NULL, "port '72.5'");
    expect_refusal("123456789012", NULL, "port");
    expect_refusal("x", NULL, "port 'x'");
    expect_refusal("7325/0123456789012345678901234567890123456789", NULL, "as long");
    expect_refusal(NULL, "focus=near", "focus");
    expect_refusal(NULL, "focus=nan", "focus");
    expect_refusal(NULL, "turn=45", "turn '45'");
    expect_refusal(NULL, "timeout=0", "timeout");
    expect_refusal(NULL, "colour=red", "focus, turn, serial, timeout");
    const child phone = start_phone(NULL);
    capture_camera *camera = NULL;
    capture_shot_report report;
    assert_int_equal(open_port(&camera, phone.port, "turn=90"), BRACE_OK);
    assert_int_equal(shoot(camera, 0.004, &report), BRACE_OK);
    assert_int_equal(report.orientation, 3);
    brace_frame *f = load();
    assert_int_equal(f->orientation, 3);
    brace_frame_destroy(f);
    camera->backend->close(camera, NULL);
    char port[32];
    snprintf(port, sizeof port, "%u/1", phone.port);
    const capture_address address = {.port = port};
    assert_int_equal(capture_backend_android.open(&camera, &address, NULL, &error), BRACE_ERROR_UNSUPPORTED);
    capture_backend_android.close(NULL, NULL);
    assert_int_equal(child_end(phone, true), 0);
}

static char found[512];

static void on_found(void *user, const capture_found *f) {
    const size_t used = strlen(found);
    snprintf(found + used, sizeof found - used, "%s %s %s %s\n",
             strchr(f->port, '/') != NULL ? strchr(f->port, '/') : "-", f->make, f->model,
             f->note != NULL ? f->note : "good");
    (void)user;
}

static brace_status list(unsigned port) {
    char text[16];
    snprintf(text, sizeof text, "%u", port);
    const capture_address address = {.port = text};
    found[0] = '\0';
    return capture_backend_android.list(&address, NULL, on_found, NULL, &error);
}

static void test_list(void **state) {
    (void)state;
    const child phone = start_phone(NULL);
    assert_int_equal(list(phone.port), BRACE_OK);
    assert_string_equal(found,
                        "/1 Fake Phone 1 no RAW with manual exposure\n/2 Fake Phone 1 no RAW with manual exposure\n"
                        "/0 Fake Phone 1 good\n");
    const child cable = start_cable(phone, "cut=0"); /* as adb does where no program listens on the phone */
    assert_int_equal(list(cable.port), BRACE_OK);
    assert_non_null(strstr(found, "does not run on it"));
    child_end(cable, false);
    assert_int_equal(child_end(phone, true), 0);
    assert_int_equal(list(cable.port), BRACE_OK);
    assert_string_equal(found, "");
}

/* An adb that writes down how it was called, and forwards to a phone of ours. */
static void write_adb(const char *body) {
    char path[128];
    snprintf(path, sizeof path, "%s/adb", folder);
    FILE *f = fopen(path, "w");
    assert_non_null(f);
    fprintf(f, "#!/bin/sh\n%s\n", body);
    fclose(f);
    assert_int_equal(chmod(path, 0755), 0);
}

static void test_adb(void **state) {
    (void)state;
    char path[4096], body[1024], text[1024] = "", port[16];
    const char *old = getenv("PATH");
    char *saved = old != NULL ? strdup(old) : NULL;
    const char *options[] = {"serial=X Y;z", "timeout=1"};
    /* A port that is free now; the adb below has a cable listen on it... which is the phone itself here. */
    unsigned free_port = 0;
    close(listen_any(&free_port));
    snprintf(port, sizeof port, "%u", free_port);
    const capture_address address = {.port = port, .options = options, .option_count = 2};
    capture_camera *camera = NULL;

    setenv("PATH", folder, 1);
    assert_int_equal(capture_backend_android.open(&camera, &address, NULL, &error), BRACE_ERROR_IO);
    snprintf(text, sizeof text, "adb -s X Y;z forward tcp:%u localabstract:brace", free_port);
    assert_non_null(strstr(error.message, text));
    assert_non_null(strstr(error.message, "no adb"));

    snprintf(path, sizeof path, "%s:%s", folder, saved != NULL ? saved : "/usr/bin:/bin");
    setenv("PATH", path, 1);
    write_adb("echo \"error: device 'X' not found\" >&2; exit 1");
    assert_int_equal(capture_backend_android.open(&camera, &address, NULL, &error), BRACE_ERROR_IO);
    assert_non_null(strstr(error.message, "device 'X' not found"));

    snprintf(body, sizeof body,
             "printf '[%%s]' \"$@\" >>%s/calls; echo >>%s/calls\n"
             "case \"$*\" in *--remove*) kill $(cat %s/pid); exit 0;; esac\n"
             "'%s' --port %u --quiet >%s/started & echo $! >%s/pid\n"
             "while ! grep -q listening %s/started 2>/dev/null; do sleep 0.02; done",
             folder, folder, folder, phone_program, free_port, folder, folder, folder);
    write_adb(body);
    assert_int_equal(capture_backend_android.open(&camera, &address, NULL, &error), BRACE_OK);
    assert_string_equal(camera->limits.id, "X Y;z, camera 0");
    capture_shot_report report;
    assert_int_equal(shoot(camera, 0.004, &report), BRACE_OK);
    brace_frame_destroy(load());
    camera->backend->close(camera, NULL);
    snprintf(path, sizeof path, "%s/calls", folder);
    FILE *f = fopen(path, "r");
    assert_non_null(f);
    char calls[512] = "";
    assert_true(fread(calls, 1, sizeof calls - 1, f) > 0);
    fclose(f);
    snprintf(text, sizeof text,
             "[-s][X Y;z][forward][tcp:%u][localabstract:brace]\n[-s][X Y;z][forward][--remove][tcp:%u]\n", free_port,
             free_port);
    assert_string_equal(calls, text);
    if (saved != NULL) {
        setenv("PATH", saved, 1);
    }
    free(saved);
}

static int make_folder(void **state) {
    (void)state;
    return mkdtemp(folder) != NULL ? 0 : -1;
}

static int remove_folder(void **state) {
    (void)state;
    static const char *const names[] = {"adb", "calls", "pid", "started", "shot.dng"};
    char path[128];
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        unlink(path);
    }
    return rmdir(folder); /* fails if a temporary was left behind */
}

int main(int argc, char **argv) {
    if (argc != 3) {
        fprintf(stderr, "usage: test_android PHONE CABLE\n");
        return 2;
    }
    phone_program = argv[1];
    cable_program = argv[2];
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_frame),
        cmocka_unit_test(test_conversion),
        cmocka_unit_test(test_phone_faults),
        cmocka_unit_test(test_phone_lies),
        cmocka_unit_test(test_phone_ends),
        cmocka_unit_test(test_cable),
        cmocka_unit_test(test_cancel),
        cmocka_unit_test(test_hostile_phone),
        cmocka_unit_test(test_hostile_computer),
        cmocka_unit_test(test_abstract_socket),
        cmocka_unit_test(test_options),
        cmocka_unit_test(test_list),
        cmocka_unit_test(test_memory),
        cmocka_unit_test(test_adb),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
