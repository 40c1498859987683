/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_gphoto2.c: the back end for tethered cameras, with the real libgphoto2,
 * over PTP/IP on loopback, against the test camera: what it finds out, what it
 * fetches, what it puts back, and every fault that the camera can have.
 */
#include <fcntl.h>
#include <limits.h>
#include <math.h>
#include <pthread.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include <arpa/inet.h>
#include <cmocka.h>
#include <netinet/in.h>

#include "capture/camera.h"
#include "ptpip_camera.h"
#include "raw/raw.h"

static char folder[64], notes[8192];
static const capture_backend *gphoto2;

/* The library keeps settings in the home folder. */
static int set_up(void **state) {
    (void)state;
    const char *port;
    brace_error error;
    snprintf(folder, sizeof folder, "/tmp/brace-gphoto2-XXXXXX");
    if (mkdtemp(folder) == NULL || setenv("HOME", folder, 1) != 0 ||
        capture_backend_find(&gphoto2, &port, "gphoto2", &error) != BRACE_OK)
        return -1;
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    char command[128];
    snprintf(command, sizeof command, "rm -rf '%s'", folder);
    return system(command);
}

static void gather(void *user, const char *message) {
    (void)user;
    const size_t n = strlen(notes);
    snprintf(notes + n, sizeof notes - n, "%s\n", message);
}

static volatile int cancel;

static brace_job a_job(void) {
    notes[0] = '\0';
    cancel = 0;
    return (brace_job){.threads = 2, .note = gather, .cancel = &cancel};
}

/* ---- the camera and its pictures ---- */

typedef struct scene {
    uint32_t width, height;
    size_t count;
    double seconds[64], iso[64]; /* of the pictures that were taken */
    void *data[64];
    size_t size[64];
} scene;

static brace_status expose(void *user, double seconds, double iso, void **data, size_t *size, brace_error *error) {
    scene *s = user;
    brace_frame *f = NULL;
    brace_status status = brace_frame_create(&f, s->width, s->height, BRACE_CFA_RGGB, error);
    if (status != BRACE_OK)
        return status;
    for (size_t i = 0; i < (size_t)s->width * s->height; i++)
        f->data[i] = (uint16_t)fmin(16383, 512 + (double)(1 + i % 97) * seconds * iso * 100);
    for (int c = 0; c < 4; c++)
        f->black[c] = 512;
    f->white = 16383;
    f->exposure_time = seconds;
    f->iso = iso;
    snprintf(f->model, sizeof f->model, "Test Camera");
    status = raw_dng_encode(data, size, f, &(brace_dng_params){.no_preview = true}, NULL, "shot", error);
    brace_frame_destroy(f);
    if (status == BRACE_OK && s->count < 64) {
        s->seconds[s->count] = seconds;
        s->iso[s->count] = iso;
        s->size[s->count] = *size;
        s->data[s->count] = malloc(*size);
        assert_non_null(s->data[s->count]);
        memcpy(s->data[s->count++], *data, *size);
    }
    return status;
}

static void scene_free(scene *s) {
    for (size_t i = 0; i < s->count; i++)
        free(s->data[i]);
    s->count = 0;
}

typedef struct bench {
    scene scene;
    ptpip_camera *device;
    char port[64];
    capture_camera *camera;
} bench;

static void begin(bench *b, ptpip_params params) {
    brace_error error;
    *b = (bench){.scene = {.width = 64, .height = 48}};
    params.expose = expose;
    params.user = &b->scene;
    if (ptpip_camera_start(&b->device, &params, &error) != BRACE_OK)
        fail_msg("%s", error.message);
    snprintf(b->port, sizeof b->port, "ptpip:127.0.0.1:%u", (unsigned)ptpip_camera_port(b->device));
}

static brace_status open_camera(bench *b, const brace_job *job, brace_error *error) {
    return gphoto2->open(&b->camera, &(capture_address){.port = b->port}, job, error);
}

static void must_open(bench *b, const brace_job *job) {
    brace_error error;
    if (open_camera(b, job, &error) != BRACE_OK)
        fail_msg("%s", error.message);
}

static void close_camera(bench *b, const brace_job *job) {
    gphoto2->close(b->camera, job);
    b->camera = NULL;
}

static void end(bench *b) {
    ptpip_camera_stop(b->device);
    scene_free(&b->scene);
}

static const char *stem(void) {
    static char text[128];
    snprintf(text, sizeof text, "%s/shot", folder);
    return text;
}

static bool there(void) {
    char path[160];
    struct stat info;
    snprintf(path, sizeof path, "%s.dng", stem());
    return stat(path, &info) == 0;
}

static void clear(void) {
    char path[160];
    snprintf(path, sizeof path, "%s.dng", stem());
    unlink(path);
}

static brace_status shoot(bench *b, double exposure, double iso, capture_shot_report *report, const brace_job *job,
                          brace_error *error) {
    *report = (capture_shot_report){.timestamp = -1};
    return gphoto2->shoot(b->camera, exposure, iso, stem(), report, job, error);
}

/* The file is the last picture that the camera took, byte for byte, and was taken as it says. */
static void is_last(const bench *b, double exposure, double iso) {
    char path[160];
    void *data = NULL;
    size_t size = 0;
    brace_error error;
    snprintf(path, sizeof path, "%s.dng", stem());
    if (core_file_load(&data, &size, path, 1 << 24, &error) != BRACE_OK)
        fail_msg("%s", error.message);
    assert_true(b->scene.count > 0);
    const size_t last = b->scene.count - 1;
    assert_int_equal(size, b->scene.size[last]);
    assert_memory_equal(data, b->scene.data[last], size);
    core_free(data);
    assert_true(fabs(b->scene.seconds[last] / exposure - 1) < 1e-6);
    assert_true(fabs(b->scene.iso[last] / iso - 1) < 1e-6);
    brace_frame *f = NULL;
    if (brace_frame_read(&f, path, NULL, &error) != BRACE_OK)
        fail_msg("%s", error.message);
    assert_true(fabs(f->exposure_time / exposure - 1) < 1e-3);
    brace_frame_destroy(f);
}

/* ---- what goes well ---- */

static bool has_stop(const double *stops, size_t count, double value) {
    for (size_t i = 0; i < count; i++)
        if (fabs(stops[i] / value - 1) < 1e-6)
            return true;
    return false;
}

static void learns_the_limits(void **state) {
    (void)state;
    for (int maker = 0; maker < 2; maker++) {
        bench b;
        const brace_job job = a_job();
        begin(&b, (ptpip_params){.maker = maker != 0});
        must_open(&b, &job);
        const capture_limits *l = &b.camera->limits;
        assert_string_equal(l->make, "BRACE");
        assert_string_equal(l->model, maker ? "Test Camera M" : "Test Camera");
        assert_string_equal(l->id, "000001");
        assert_int_equal(l->exposure_count, maker ? 15 : 36); /* without Bulb, Time and x 200 */
        assert_true(has_stop(l->exposures, l->exposure_count, maker ? 0.4 : 0.0002));
        assert_true(has_stop(l->exposures, l->exposure_count, maker ? 1.0 / 60 : 0.016));
        assert_true(l->exposure_min <= l->exposures[0] && l->exposure_max >= l->exposures[l->exposure_count - 1]);
        assert_int_equal(l->iso_count, 9);
        assert_true(has_stop(l->isos, l->iso_count, 25) && has_stop(l->isos, l->iso_count, 6400));
        assert_true(fabs(l->f_number - 4) < 1e-6);
        close_camera(&b, &job);
        const ptpip_tally tally = ptpip_camera_tally(b.device);
        assert_true(tally.restored);
        assert_int_equal(tally.rejected, 0);
        assert_true(tally.sets > 0);
        end(&b);
    }
}

static void shoots(void **state) {
    (void)state;
    static const double plain[] = {0.256, 0.064, 0.016, 0.004, 0.001},
                        fractions[] = {1, 0.25, 1.0 / 16, 1.0 / 60, 1.0 / 250};
    for (int kind = 0; kind < 4; kind++) {
        bench b;
        const brace_job job = a_job();
        const double *times = kind > 0 ? fractions : plain;
        begin(&b, (ptpip_params){.maker = kind > 0, .both = kind == 2});
        if (kind == 3) { /* more than the library fetches at once */
            b.scene.width = 1024;
            b.scene.height = 640;
        }
        must_open(&b, &job);
        for (int i = 0; i < 6; i++) {
            capture_shot_report report;
            brace_error error;
            const double t = times[i % 5], iso = i == 5 ? 50 : 400;
            if (shoot(&b, t, iso, &report, &job, &error) != BRACE_OK)
                fail_msg("kind %d, shot %d: %s", kind, i, error.message);
            is_last(&b, t, iso);
            assert_string_equal(report.extension, "dng");
            assert_true(fabs(report.exposure / t - 1) < 1e-6 && fabs(report.iso / iso - 1) < 1e-6);
            assert_true(report.timestamp == -1);
            clear();
        }
        close_camera(&b, &job);
        const ptpip_tally tally = ptpip_camera_tally(b.device);
        assert_true(tally.restored);
        assert_int_equal(tally.connections, 1);
        assert_int_equal(tally.releases, 6);
        assert_int_equal(tally.exposures, 6);
        assert_int_equal(tally.deleted, 0);
        assert_int_equal(tally.rejected, 0);
        assert_string_equal(notes, "");
        end(&b);
    }
}

static void deletes_when_told(void **state) {
    (void)state;
    bench b;
    const brace_job job = a_job();
    capture_shot_report report;
    brace_error error;
    const char *const options[] = {"delete=yes"};
    begin(&b, (ptpip_params){0});
    assert_int_equal(gphoto2->open(&b.camera, &(capture_address){b.port, options, 1, 0}, &job, &error), BRACE_OK);
    assert_int_equal(shoot(&b, 0.016, 100, &report, &job, &error), BRACE_OK);
    assert_int_equal(shoot(&b, 0.004, 100, &report, &job, &error), BRACE_OK);
    is_last(&b, 0.004, 100);
    close_camera(&b, &job);
    assert_int_equal(ptpip_camera_tally(b.device).deleted, 2);
    clear();
    end(&b);
}

static void look(void *user, const capture_found *found) {
    assert_null(user);
    assert_true(found->port[0] != '\0' && found->model[0] != '\0');
}

static void lists(void **state) {
    (void)state;
    const brace_job job = a_job();
    brace_error error;
    assert_int_equal(gphoto2->list(&(capture_address){0}, &job, look, NULL, &error), BRACE_OK);
}

/* ---- what goes wrong ---- */

enum { FINAL, SURVIVED };

typedef struct mishap {
    const char *fault;
    int outcome;
    capture_trouble trouble;
    const char *says; /* part of the message of the first failure; NULL: nothing fails, the back end waits it out */
} mishap;

static const mishap mishaps[] = {
    {"busy-open@1x3", SURVIVED, CAPTURE_TROUBLE_BUSY, NULL}, /* the driver itself asks three times */
    {"busy-open@1x6", SURVIVED, CAPTURE_TROUBLE_BUSY, NULL},
    {"busy-set@1x1", SURVIVED, CAPTURE_TROUBLE_BUSY, "Busy"},
    {"busy-set@2x3", SURVIVED, CAPTURE_TROUBLE_BUSY, "Busy"},
    {"busy-shoot@1x3", SURVIVED, CAPTURE_TROUBLE_BUSY, "Busy"},
    {"busy-download@1x2", SURVIVED, CAPTURE_TROUBLE_BUSY, NULL},
    {"busy-read@1x1", SURVIVED, CAPTURE_TROUBLE_BUSY, NULL},
    {"busy-read@2x2", SURVIVED, CAPTURE_TROUBLE_BUSY, NULL},
    {"drop-set@1x1", SURVIVED, CAPTURE_TROUBLE_GONE, "gone"},
    {"drop-set@3x1", SURVIVED, CAPTURE_TROUBLE_GONE, "gone"},
    {"drop-shoot@1x1", SURVIVED, CAPTURE_TROUBLE_GONE, "gone"},
    {"drop-shoot@3x2", SURVIVED, CAPTURE_TROUBLE_GONE, "gone"},
    {"drop-expose@2x1", SURVIVED, CAPTURE_TROUBLE_GONE, "gone"},
    {"drop-download@1x1", SURVIVED, CAPTURE_TROUBLE_GONE, "gone"},
    {"drop-download@2x1", SURVIVED, CAPTURE_TROUBLE_GONE, "gone"},
    {"no-object@1x1", SURVIVED, CAPTURE_TROUBLE_DROPPED, "no picture came"},
    {"keep@1x1", SURVIVED, CAPTURE_TROUBLE_FINAL, NULL},
    {"keep@2x2", SURVIVED, CAPTURE_TROUBLE_FINAL, NULL},
    {"truncate@1x1", SURVIVED, CAPTURE_TROUBLE_DROPPED, "cut short"},
    {"truncate@3x1", SURVIVED, CAPTURE_TROUBLE_DROPPED, "cut short"},
    {"hang@1x1", SURVIVED, CAPTURE_TROUBLE_GONE, "gone"},
    {"length@1x1", SURVIVED, CAPTURE_TROUBLE_GONE, "gone"},
    {"jpeg@2x1", FINAL, CAPTURE_TROUBLE_FINAL, "no RAW file"},
    {"full@1xall", FINAL, CAPTURE_TROUBLE_FINAL, "Full"},
    {"refuse@1xall", FINAL, CAPTURE_TROUBLE_FINAL, "Denied"},
    {"keep@1xall", FINAL, CAPTURE_TROUBLE_FINAL, "keeps"},
};

/* Three shots as the core makes them: again when busy or lost, opened anew when gone. The number of failures. */
static int three_shots(bench *b, const mishap *m, const brace_job *job, brace_error *first, bool *done) {
    static const double times[] = {0.064, 0.016, 0.004};
    int failures = 0;
    *done = false;
    for (int i = 0; i < 3;) {
        capture_shot_report report;
        brace_error error;
        if (b->camera == NULL && open_camera(b, job, &error) != BRACE_OK) {
            fail_msg("%s: %s", m->fault, error.message);
        }
        clear();
        const brace_status status = shoot(b, times[i], i == 0 ? 400 : 200, &report, job, &error);
        if (status == BRACE_OK) {
            is_last(b, times[i], i == 0 ? 400 : 200);
            i++;
            continue;
        }
        assert_false(there());
        if (failures++ == 0)
            *first = error;
        if (report.trouble != m->trouble)
            fail_msg("%s: trouble %d, not %d: %s", m->fault, (int)report.trouble, (int)m->trouble, error.message);
        if (report.trouble == CAPTURE_TROUBLE_FINAL)
            return failures;
        if (report.trouble == CAPTURE_TROUBLE_GONE)
            close_camera(b, job);
        assert_true(failures < 10);
    }
    *done = true;
    return failures;
}

static void survives_or_says(void **state) {
    (void)state;
    int survived = 0, named = 0;
    const int total = (int)(sizeof mishaps / sizeof mishaps[0]);
    for (int i = 0; i < total; i++) {
        const mishap *m = &mishaps[i];
        const brace_job job = a_job();
        ptpip_fault fault;
        bench b;
        brace_error first = {.message = ""};
        bool done;
        if (!ptpip_fault_parse(&fault, m->fault))
            fail_msg("there is no fault %s", m->fault);
        begin(&b, (ptpip_params){.faults = &fault, .fault_count = 1});
        const int failures = three_shots(&b, m, &job, &first, &done);
        close_camera(&b, &job);
        const ptpip_tally tally = ptpip_camera_tally(b.device);
        if (tally.faults == 0)
            fail_msg("%s did not happen", m->fault);
        if ((m->says != NULL) != (failures > 0) || (m->says != NULL && strstr(first.message, m->says) == NULL))
            fail_msg("%s: %d failures, '%s'", m->fault, failures, first.message);
        if (done != (m->outcome == SURVIVED))
            fail_msg("%s: %s", m->fault, done ? "survived" : first.message);
        /* A camera that takes no settings cannot be given its own back, and needs none: nothing was changed. */
        if (!tally.restored && strcmp(m->fault, "keep@1xall") != 0 && strcmp(m->fault, "refuse@1xall") != 0)
            fail_msg("%s: not put back: %s", m->fault, notes);
        survived += m->outcome == SURVIVED;
        named += m->says != NULL;
        end(&b);
    }
    clear();
    print_message("%d faults injected: %d survived, %d ended with their cause; %d of them named in a message, the "
                  "others waited out\n",
                  total, survived, total - survived, named);
}

static void names_what_cannot_be(void **state) {
    (void)state;
    static const struct {
        ptpip_params params;
        const char *says;
        bool opens;
    } cases[] = {
        {{.maker = true, .jpeg_only = true}, "set its image quality to RAW", true},
        {{.program = true}, "turn its mode dial to M", false},
        {{.maker = true, .program = true}, "turn its mode dial to M", false},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        bench b;
        const brace_job job = a_job();
        capture_shot_report report = {0};
        brace_error error = {.message = ""};
        begin(&b, cases[i].params);
        brace_status status = open_camera(&b, &job, &error);
        if ((status == BRACE_OK) != cases[i].opens)
            fail_msg("%s", error.message);
        if (status == BRACE_OK)
            status = shoot(&b, 0.25, 400, &report, &job, &error);
        assert_int_equal(status, BRACE_ERROR_UNSUPPORTED);
        assert_int_equal(report.trouble, CAPTURE_TROUBLE_FINAL);
        if (strstr(error.message, cases[i].says) == NULL)
            fail_msg("'%s' does not say '%s'", error.message, cases[i].says);
        assert_false(there());
        close_camera(&b, &job);
        assert_true(ptpip_camera_tally(b.device).restored);
        end(&b);
    }
}

static void says_what_is_wrong_with_an_address(void **state) {
    (void)state;
    static const struct {
        const char *port, *option;
        brace_status status;
        const char *says;
    } cases[] = {
        {"ptpip:127.0.0.1:1", NULL, BRACE_ERROR_IO, "does not answer"},
        {"ptpip:nowhere", NULL, BRACE_ERROR_IO, "does not answer"},
        {"usb:999,999", NULL, BRACE_ERROR_IO, "no camera was found at usb:999,999"},
        {"nonsense", NULL, BRACE_ERROR_IO, "no camera was found at nonsense"},
        {"ptpip:127.0.0.1:1", "model=Potato 9000", BRACE_ERROR_ARGUMENT, "no camera 'Potato 9000'"},
        {"ptpip:127.0.0.1:1", "delete=maybe", BRACE_ERROR_ARGUMENT, "yes or no"},
        {"ptpip:127.0.0.1:1", "colour=red", BRACE_ERROR_ARGUMENT, "no option 'colour=red'"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const brace_job job = a_job();
        capture_camera *camera = NULL;
        brace_error error = {.message = ""};
        const capture_address address = {cases[i].port, &cases[i].option, cases[i].option != NULL, 0};
        assert_int_equal(gphoto2->open(&camera, &address, &job, &error), cases[i].status);
        assert_null(camera);
        if (strstr(error.message, cases[i].says) == NULL)
            fail_msg("'%s' does not say '%s'", error.message, cases[i].says);
    }
    gphoto2->close(NULL, NULL);
}

/* Closing a session closes nothing of ours. */
static void keeps_descriptors(void **state) {
    (void)state;
    bench b;
    const brace_job job = a_job();
    struct stat before, after;
    const int file = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC), input = dup(STDIN_FILENO);
    assert_true(file >= 0 && dup2(file, STDIN_FILENO) == STDIN_FILENO && fstat(STDIN_FILENO, &before) == 0);
    begin(&b, (ptpip_params){0});
    must_open(&b, &job);
    close_camera(&b, &job);
    assert_int_equal(fstat(STDIN_FILENO, &after), 0);
    assert_true(before.st_ino == after.st_ino && before.st_dev == after.st_dev);
    end(&b);
    close(file);
    if (input >= 0) {
        dup2(input, STDIN_FILENO);
        close(input);
    }
}

static volatile sig_atomic_t rings;
static void ring(int number) {
    (void)number;
    rings++;
}

/* Signals that the program handles don't break a connection. */
static void is_not_disturbed_by_signals(void **state) {
    (void)state;
    bench b;
    const brace_job job = a_job();
    struct sigaction before, action = {.sa_handler = ring, .sa_flags = SA_RESTART};
    const struct itimerval fast = {{0, 3000}, {0, 3000}}, off = {{0, 0}, {0, 0}};
    sigaction(SIGALRM, &action, &before);
    begin(&b, (ptpip_params){0});
    setitimer(ITIMER_REAL, &fast, NULL);
    must_open(&b, &job);
    for (int i = 0; i < 4; i++) {
        capture_shot_report report;
        brace_error error;
        if (shoot(&b, i % 2 == 0 ? 0.016 : 0.004, 100, &report, &job, &error) != BRACE_OK)
            fail_msg("%s", error.message);
    }
    close_camera(&b, &job);
    setitimer(ITIMER_REAL, &off, NULL);
    sigaction(SIGALRM, &before, NULL);
    assert_true(rings > 10);
    assert_int_equal(ptpip_camera_tally(b.device).connections, 1);
    assert_true(ptpip_camera_tally(b.device).restored);
    clear();
    end(&b);
}

static void *cancel_soon(void *arg) {
    (void)arg;
    nanosleep(&(struct timespec){0, 300000000}, NULL);
    cancel = 1;
    return NULL;
}

static void stops_when_told_and_puts_back(void **state) {
    (void)state;
    bench b;
    const brace_job job = a_job();
    const ptpip_fault fault = {PTPIP_FAULT_NO_EVENT, 2, UINT_MAX};
    capture_shot_report report;
    brace_error error;
    pthread_t thread;
    begin(&b, (ptpip_params){.faults = &fault, .fault_count = 1});
    must_open(&b, &job);
    assert_int_equal(shoot(&b, 0.064, 200, &report, &job, &error), BRACE_OK);
    clear();
    assert_int_equal(pthread_create(&thread, NULL, cancel_soon, NULL), 0);
    assert_int_equal(shoot(&b, 1.024, 100, &report, &job, &error), BRACE_ERROR_CANCELLED);
    pthread_join(thread, NULL);
    assert_false(there());
    assert_false(ptpip_camera_tally(b.device).restored);
    close_camera(&b, &job);
    assert_true(ptpip_camera_tally(b.device).restored);
    end(&b);
}

/* A connection that ends while the camera is being prepared, or while its settings are put back: an error or a note that
 * says so, and the next session leaves all as it was. */
static void is_lost_while_opening_or_closing(void **state) {
    (void)state;
    static const unsigned moments[] = {1, 2, 4, 7, 8, 9, 10};
    int failed = 0;
    for (size_t i = 0; i < sizeof moments / sizeof moments[0]; i++) {
        bench b;
        const brace_job job = a_job();
        const ptpip_fault fault = {PTPIP_FAULT_DROP_READ, moments[i], 1};
        brace_error error = {.message = ""};
        begin(&b, (ptpip_params){.faults = &fault, .fault_count = 1});
        if (open_camera(&b, &job, &error) != BRACE_OK) {
            failed++;
            assert_int_equal(error.status, BRACE_ERROR_IO);
            if (strstr(error.message, "gone") == NULL)
                fail_msg("%u: %s", moments[i], error.message);
        } else {
            close_camera(&b, &job);
            assert_non_null(strstr(notes, "could not be put back"));
        }
        must_open(&b, &job);
        close_camera(&b, &job);
        assert_int_equal(ptpip_camera_tally(b.device).faults, 1);
        if (!ptpip_camera_tally(b.device).restored)
            fail_msg("%u: not put back: %s", moments[i], notes);
        end(&b);
    }
    assert_true(failed >= 4);
}

static void says_what_a_camera_that_is_gone_keeps(void **state) {
    (void)state;
    bench b;
    const brace_job job = a_job();
    const ptpip_fault fault = {PTPIP_FAULT_DROP_SHOOT, 1, 1};
    capture_shot_report report;
    brace_error error;
    begin(&b, (ptpip_params){.faults = &fault, .fault_count = 1});
    must_open(&b, &job);
    assert_int_equal(shoot(&b, 0.064, 200, &report, &job, &error), BRACE_ERROR_IO);
    assert_int_equal(report.trouble, CAPTURE_TROUBLE_GONE);
    assert_int_equal(shoot(&b, 0.064, 200, &report, &job, &error), BRACE_ERROR_IO);
    assert_int_equal(report.trouble, CAPTURE_TROUBLE_GONE);
    close_camera(&b, &job);
    assert_non_null(strstr(notes, "could not be put back"));
    assert_non_null(strstr(notes, "shutterspeed (was '0.0080s')"));
    assert_false(ptpip_camera_tally(b.device).restored);
    /* The next session owes it what it was before the first. */
    must_open(&b, &job);
    close_camera(&b, &job);
    assert_true(ptpip_camera_tally(b.device).restored);
    end(&b);
}

static void has_no_room(void **state) {
    (void)state;
    bench b;
    const brace_job job = a_job();
    capture_shot_report report = {.timestamp = -1};
    brace_error error;
    begin(&b, (ptpip_params){0});
    core_alloc_fail_after(1);
    const brace_status status = open_camera(&b, &job, &error);
    core_alloc_fail_after(0);
    assert_int_equal(status, BRACE_ERROR_MEMORY);
    assert_null(b.camera);
    must_open(&b, &job);
    assert_int_equal(gphoto2->shoot(b.camera, 0.016, 100, "/nowhere/at/all/shot", &report, &job, &error),
                     BRACE_ERROR_IO);
    assert_int_equal(report.trouble, CAPTURE_TROUBLE_FINAL);
    assert_non_null(strstr(error.message, "/nowhere/at/all/shot.dng"));
    close_camera(&b, &job);
    end(&b);
}

/* ---- the test camera itself ---- */

static int connected(uint16_t port) {
    struct sockaddr_in a = {.sin_family = AF_INET, .sin_port = htons(port)};
    a.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const int fd = socket(AF_INET, SOCK_STREAM, 0);
    assert_true(fd >= 0 && connect(fd, (struct sockaddr *)&a, sizeof a) == 0);
    return fd;
}

static void the_camera_bounds_what_it_reads(void **state) {
    (void)state;
    bench b;
    const brace_job job = a_job();
    begin(&b, (ptpip_params){0});
    static const uint8_t packets[][12] = {
        {0xff, 0xff, 0xff, 0xff, 1, 0, 0, 0},  /* 4 GiB */
        {4, 0, 0, 0, 1, 0, 0, 0},              /* shorter than its header */
        {12, 0, 0, 0, 1, 0, 0, 0, 1, 2, 3, 4}, /* no name, no version */
        {12, 0, 0, 0, 3, 0, 0, 0, 9, 0, 0, 0}, /* events of a session that is not there */
        {8, 0, 0, 0, 6, 0, 0, 0},              /* a command before anything else */
    };
    for (size_t i = 0; i < sizeof packets / sizeof packets[0]; i++) {
        const int fd = connected(ptpip_camera_port(b.device));
        const size_t n = packets[i][0] == 12 ? 12 : 8;
        uint8_t answer[64];
        assert_int_equal(send(fd, packets[i], n, MSG_NOSIGNAL), n);
        while (recv(fd, answer, sizeof answer, 0) > 0) {
        }
        close(fd);
    }
    const int fd = connected(ptpip_camera_port(b.device));
    core_random r = core_random_create(7, 0, 0, 0);
    for (int i = 0; i < 2000; i++) {
        const uint32_t word = core_random_u32(&r);
        if (send(fd, &word, sizeof word, MSG_NOSIGNAL) < 0)
            break;
    }
    close(fd);
    /* It still works. */
    must_open(&b, &job);
    close_camera(&b, &job);
    assert_true(ptpip_camera_tally(b.device).rejected >= 6);
    end(&b);
}

static void faults_are_read(void **state) {
    (void)state;
    ptpip_fault f;
    assert_true(ptpip_fault_parse(&f, "busy-set") && f.kind == PTPIP_FAULT_BUSY_SET && f.from == 1 && f.times == 1);
    assert_true(ptpip_fault_parse(&f, "lie@3x2") && f.kind == PTPIP_FAULT_LIE && f.from == 3 && f.times == 2);
    assert_true(ptpip_fault_parse(&f, "full@2xall") && f.times == UINT_MAX);
    static const char *const bad[] = {"",
                                      "busy",
                                      "busy-set@",
                                      "busy-set@0",
                                      "busy-set@1x",
                                      "busy-set@1x0",
                                      "busy-set@-1",
                                      "busy-set@1xalles",
                                      "busy-set@all"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        if (ptpip_fault_parse(&f, bad[i]))
            fail_msg("'%s' was taken for a fault", bad[i]);
    for (int i = 0; i < PTPIP_FAULT_COUNT; i++)
        assert_true(ptpip_fault_parse(&f, ptpip_fault_name((ptpip_fault_kind)i)) && (int)f.kind == i);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(faults_are_read),
        cmocka_unit_test(the_camera_bounds_what_it_reads),
        cmocka_unit_test(lists),
        cmocka_unit_test(learns_the_limits),
        cmocka_unit_test(shoots),
        cmocka_unit_test(deletes_when_told),
        cmocka_unit_test(names_what_cannot_be),
        cmocka_unit_test(says_what_is_wrong_with_an_address),
        cmocka_unit_test(keeps_descriptors),
        cmocka_unit_test(is_not_disturbed_by_signals),
        cmocka_unit_test(stops_when_told_and_puts_back),
        cmocka_unit_test(is_lost_while_opening_or_closing),
        cmocka_unit_test(says_what_a_camera_that_is_gone_keeps),
        cmocka_unit_test(has_no_room),
        cmocka_unit_test(survives_or_says),
    };
    return cmocka_run_group_tests_name("gphoto2", tests, set_up, tear_down);
}
