/* SPDX-License-Identifier: Apache-2.0 */
/*
 * camera_android.c: the back end `android`: a phone on which android/brace_camera
 * runs, reached through the port that adb forwards. The phone exposes and says
 * what it did; the DNG is written here.
 *
 * Whatever arrives is as untrusted as a file: the protocol's parser bounds it.
 * After a message that is damaged, late or out of place the connection is given up,
 * because nothing says where the next one begins; the core opens another.
 */
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "brace/version.h"
#include "capture/adb.h"
#include "capture/android_frame.h"
#include "capture/camera.h"
#include "capture/channel.h"

/* What the address and options say. */
typedef struct settings {
    unsigned port;
    char camera[32]; /* "": the phone chooses */
    const char *serial;
    double focus; /* dioptres; < 0: found by the phone */
    int turn;
    int patience; /* milliseconds */
} settings;

typedef struct android_camera {
    capture_camera base;
    capture_channel *channel;
    capture_message message;
    capture_wire_welcome phone;
    capture_wire_camera camera;
    double neutral[3];
    uint32_t number; /* of the last request */
    int turn;
    char serial[128];
    unsigned forwarded; /* the port that we had adb forward; 0: none */
} android_camera;

static const char *const option_names[] = {"focus", "turn", "serial", "timeout", NULL};

/* ---- address and options ---- */

static brace_status read_number(double *out, const char *text, double low, double high, const char *what,
                                brace_error *error) {
    char *end = NULL;
    *out = strtod(text, &end);
    return end != text && *end == '\0' && *out >= low && *out <= high
               ? BRACE_OK
               : core_fail(error, BRACE_ERROR_ARGUMENT, "android: %s '%s' is not a number from %g to %g", what, text,
                           low, high);
}

static brace_status read_port(settings *s, const char *text, brace_error *error) {
    if (text == NULL) {
        return BRACE_OK;
    }
    const char *slash = strchr(text, '/');
    const size_t n = slash != NULL ? (size_t)(slash - text) : strlen(text);
    char port[8] = "";
    double value = 0;
    if (n > 0) {
        snprintf(port, sizeof port, "%.*s", (int)n, text);
        brace_status status = read_number(&value, n < sizeof port ? port : text, 1, 65535, "port", error);
        if (status != BRACE_OK) {
            return status;
        }
        if (value != floor(value)) {
            return core_fail(error, BRACE_ERROR_ARGUMENT, "android: port '%s' is not a whole number", port);
        }
        s->port = (unsigned)value;
    }
    if (slash != NULL && strlen(slash + 1) >= sizeof s->camera) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "android: no camera has a name as long as '%s'", slash + 1);
    }
    snprintf(s->camera, sizeof s->camera, "%s", slash != NULL ? slash + 1 : "");
    return BRACE_OK;
}

static brace_status read_settings(settings *s, const capture_address *address, brace_error *error) {
    *s = (settings){.port = CAPTURE_WIRE_PORT, .focus = -1, .patience = 10000};
    brace_status status = capture_option_unknown(address, "android", option_names, error);
    if (status == BRACE_OK) {
        status = read_port(s, address->port, error);
    }
    const char *focus = capture_option(address, "focus"), *turn = capture_option(address, "turn");
    const char *timeout = capture_option(address, "timeout");
    s->serial = capture_option(address, "serial");
    if (status == BRACE_OK && focus != NULL && strcmp(focus, "auto") != 0) {
        s->focus = 0;
        if (strcmp(focus, "infinity") != 0) {
            status = read_number(&s->focus, focus, 0, 100, "focus (dioptres: 1 / metres; or auto, infinity)", error);
        }
    }
    if (status == BRACE_OK && turn != NULL) {
        double degrees = 0;
        status = read_number(&degrees, turn, 0, 270, "turn", error);
        if (status == BRACE_OK && fmod(degrees, 90) != 0) {
            status = core_fail(error, BRACE_ERROR_ARGUMENT, "android: turn '%s' is not 0, 90, 180 or 270", turn);
        }
        s->turn = (int)degrees;
    }
    if (status == BRACE_OK && timeout != NULL) {
        double seconds = 0;
        status = read_number(&seconds, timeout, 0.1, 25, "timeout", error);
        s->patience = (int)(seconds * 1000);
    }
    return status;
}

/* ---- the connection ---- */

static bool cancelled(void *user) {
    return core_cancelled(user);
}

static brace_status fail_channel(const android_camera *c, capture_channel_result result, const char *doing,
                                 brace_error *error) {
    if (result == CAPTURE_CHANNEL_STOPPED) {
        return core_fail(error, BRACE_ERROR_CANCELLED, "cancelled");
    }
    return core_fail(error, result == CAPTURE_CHANNEL_BAD ? BRACE_ERROR_FORMAT : BRACE_ERROR_IO, "the phone, %s: %s",
                     doing, c->channel->why);
}

/* Sends c->message as a request. */
static brace_status ask(android_camera *c, capture_wire_type type, const brace_job *job, brace_error *error) {
    c->channel->stopped = cancelled;
    c->channel->user = (void *)(uintptr_t)job;
    c->message.type = type;
    c->message.number = ++c->number;
    const capture_channel_result result = capture_channel_send(c->channel, &c->message);
    return result == CAPTURE_CHANNEL_OK ? BRACE_OK : fail_channel(c, result, "while it was asked", error);
}

/* Receives an answer of `type` into c->message. An ERROR fails with the phone's sentence, *trouble is of what kind;
 * after any other failure the connection is closed and *trouble is CAPTURE_WIRE_GONE. */
static brace_status hear(android_camera *c, capture_wire_type type, int wait, int *trouble, brace_error *error) {
    char doing[48];
    snprintf(doing, sizeof doing, "while %s was waited for", capture_wire_name(type));
    const capture_channel_result result = capture_channel_receive(c->channel, &c->message, wait);
    brace_status status = BRACE_OK;
    *trouble = CAPTURE_WIRE_GONE;
    if (result != CAPTURE_CHANNEL_OK) {
        status = fail_channel(c, result, doing, error);
    } else if (c->message.number != c->number || (c->message.type != type && c->message.type != CAPTURE_WIRE_ERROR)) {
        status = core_fail(error, BRACE_ERROR_FORMAT, "the phone sent %s out of place, %s",
                           capture_wire_name(c->message.type), doing);
    } else if (c->message.type == CAPTURE_WIRE_ERROR) {
        *trouble = c->message.error.trouble;
        return core_fail(error, *trouble == CAPTURE_WIRE_UNSUPPORTED ? BRACE_ERROR_UNSUPPORTED : BRACE_ERROR_IO,
                         "the phone: %s", c->message.error.text);
    }
    if (status != BRACE_OK) {
        capture_channel_end(c->channel);
    }
    return status;
}

/* Connects to 127.0.0.1:port, in two seconds at most. -1 and errno otherwise. */
static int connect_loopback(unsigned port) {
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (fd < 0) {
        return -1;
    }
    int failed = connect(fd, (const struct sockaddr *)&address, sizeof address) == 0 ? 0 : errno;
    if (failed == EINPROGRESS) {
        struct pollfd p = {.fd = fd, .events = POLLOUT};
        socklen_t size = sizeof failed;
        failed = ETIMEDOUT;
        if (poll(&p, 1, 2000) == 1) {
            getsockopt(fd, SOL_SOCKET, SO_ERROR, &failed, &size);
        }
    }
    if (failed != 0) {
        close(fd);
        errno = failed;
        return -1;
    }
    const int yes = 1;
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    return fd;
}

/* Greets the program at the other end of a fresh connection. *silent: it closed without a word, as adb does where
 * nothing listens on the phone. */
static brace_status greet(android_camera *c, int fd, int patience, bool *silent, const brace_job *job,
                          brace_error *error) {
    int trouble = 0;
    capture_channel_begin(c->channel, fd, patience);
    memset(&c->message, 0, sizeof c->message);
    snprintf(c->message.hello.program, sizeof c->message.hello.program, "BRACE %s", BRACE_VERSION_STRING);
    *silent = false;
    brace_status status = ask(c, CAPTURE_WIRE_HELLO, job, error);
    if (status == BRACE_OK) {
        status = hear(c, CAPTURE_WIRE_WELCOME, patience, &trouble, error);
    }
    if (status == BRACE_OK) {
        c->phone = c->message.welcome;
    } else {
        *silent = status == BRACE_ERROR_IO && c->channel->have == 0 && c->message.type != CAPTURE_WIRE_ERROR;
    }
    return status;
}

static brace_status fail_unreachable(const settings *s, const char *why, brace_error *error) {
    return core_fail(error, BRACE_ERROR_IO,
                     "no phone on port %u (%s): connect it by USB with USB debugging on, start "
                     "/data/local/tmp/brace_camera in `adb shell`, and run: adb %s%s%sforward tcp:%u localabstract:%s",
                     s->port, why, s->serial != NULL ? "-s " : "", s->serial != NULL ? s->serial : "",
                     s->serial != NULL ? " " : "", s->port, CAPTURE_WIRE_SOCKET);
}

static brace_status reach(android_camera *c, const settings *s, const brace_job *job, brace_error *error) {
    int fd = connect_loopback(s->port);
    if (fd < 0) {
        brace_error adb = {.message = ""};
        brace_status status = capture_adb_forward(s->port, s->serial, false, job, &adb);
        if (status == BRACE_ERROR_CANCELLED) {
            return core_check_cancel(job, error);
        }
        if (status != BRACE_OK) {
            return fail_unreachable(s, adb.message, error);
        }
        c->forwarded = s->port;
        fd = connect_loopback(s->port);
        if (fd < 0) {
            return fail_unreachable(s, strerror(errno), error);
        }
    }
    bool silent = false;
    const brace_status status = greet(c, fd, s->patience, &silent, job, error);
    return silent ? core_fail(error, BRACE_ERROR_IO,
                              "port %u is forwarded to a phone, but nothing answers there: start "
                              "/data/local/tmp/brace_camera in `adb shell`, and let no other computer use it",
                              s->port)
                  : status;
}

/* ---- opening and closing ---- */

static void fill_limits(android_camera *c) {
    capture_limits *l = &c->base.limits;
    snprintf(l->make, sizeof l->make, "%s", c->phone.make);
    snprintf(l->model, sizeof l->model, "%s", c->phone.model);
    snprintf(l->id, sizeof l->id, "%s%scamera %s", c->serial, c->serial[0] != '\0' ? ", " : "", c->camera.id);
    l->exposure_min = (double)c->camera.exposure_min / 1e9;
    l->exposure_max = (double)c->camera.exposure_max / 1e9;
    l->iso_min = c->camera.iso_min;
    l->iso_max = c->camera.iso_max;
    l->f_number = c->camera.aperture;
}

/* Lets the phone find focus and white balance once, for all frames. */
static brace_status meter(android_camera *c, const settings *s, const brace_job *job, brace_error *error) {
    int trouble = 0;
    memset(&c->message, 0, sizeof c->message);
    c->message.meter.focus = c->camera.focus_nearest > 0 ? fmin(s->focus, c->camera.focus_nearest) : 0;
    c->message.meter.limit = 6000;
    brace_status status = ask(c, CAPTURE_WIRE_METER, job, error);
    if (status == BRACE_OK) {
        status = hear(c, CAPTURE_WIRE_METERED, 8000, &trouble, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    const capture_wire_metered *m = &c->message.metered;
    memcpy(c->neutral, m->neutral, sizeof c->neutral);
    if (m->exposed && m->exposure > 0) {
        const double t = (double)m->exposure / 1e9;
        core_note(job,
                  t < 0.4 ? "the phone by itself would expose for 1/%.0f s at ISO %u"
                          : "the phone by itself would expose for %.1f s at ISO %u",
                  t < 0.4 ? 1 / t : t, m->iso);
    }
    if (m->focused && s->focus < 0 && m->focus >= 0) {
        core_note(job, "the phone focused at %.2f dioptres; --option focus=%.2f keeps it there", m->focus, m->focus);
    }
    if (!m->focused && s->focus < 0 && c->camera.focus_nearest > 0) {
        core_note(job, "the phone did not find a focus; give it as --option focus=DIOPTRES (1 / metres)");
    }
    if (!m->balanced) {
        core_note(job, "the phone's white balance did not settle; the colours may need correcting by hand");
    }
    return BRACE_OK;
}

static void android_close(capture_camera *camera, const brace_job *job) {
    android_camera *c = (android_camera *)camera;
    if (c == NULL) {
        return;
    }
    if (c->channel != NULL) {
        if (c->channel->fd >= 0) {
            c->message.type = CAPTURE_WIRE_BYE;
            c->message.number = ++c->number;
            c->channel->stopped = NULL;
            (void)capture_channel_send(c->channel, &c->message); /* the phone closes either way */
        }
        capture_channel_end(c->channel);
        core_free(c->channel);
    }
    if (c->forwarded != 0) {
        /* Also after Ctrl-C: the job's flag does not count here. */
        brace_error error = {.message = ""};
        if (capture_adb_forward(c->forwarded, c->serial[0] != '\0' ? c->serial : NULL, true, NULL, &error) !=
            BRACE_OK) {
            core_note(job, "port %u is still forwarded to the phone: %s", c->forwarded, error.message);
        }
    }
    core_free(c);
}

static brace_status create(android_camera **out, const settings *s, brace_error *error) {
    android_camera *c = core_calloc(1, sizeof *c);
    if (c == NULL || (c->channel = core_calloc(1, sizeof *c->channel)) == NULL) {
        core_free(c);
        return core_fail_memory(error, sizeof *c + sizeof *c->channel, "a connection to a phone");
    }
    c->base.backend = &capture_backend_android;
    c->channel->fd = -1;
    c->turn = s->turn;
    snprintf(c->serial, sizeof c->serial, "%s", s->serial != NULL ? s->serial : "");
    *out = c;
    return BRACE_OK;
}

static brace_status android_open(capture_camera **out, const capture_address *address, const brace_job *job,
                                 brace_error *error) {
    settings s;
    android_camera *c = NULL;
    int trouble = 0;
    *out = NULL;
    brace_status status = read_settings(&s, address, error);
    if (status == BRACE_OK) {
        status = create(&c, &s, error);
    }
    if (status == BRACE_OK) {
        status = reach(c, &s, job, error);
    }
    if (status == BRACE_OK) {
        memset(&c->message, 0, sizeof c->message);
        snprintf(c->message.open.id, sizeof c->message.open.id, "%s", s.camera);
        status = ask(c, CAPTURE_WIRE_OPEN, job, error);
    }
    if (status == BRACE_OK) {
        status = hear(c, CAPTURE_WIRE_CAMERA, s.patience, &trouble, error);
    }
    if (status == BRACE_OK) {
        c->camera = c->message.camera;
        status = meter(c, &s, job, error);
    }
    if (status != BRACE_OK) {
        android_close(c != NULL ? &c->base : NULL, job);
        return status;
    }
    fill_limits(c);
    *out = &c->base;
    return BRACE_OK;
}

static brace_status android_list(const capture_address *address, const brace_job *job, capture_found_fn *found,
                                 void *user, brace_error *error) {
    settings s;
    android_camera *c = NULL;
    brace_status status = read_settings(&s, address, error);
    const int fd = status == BRACE_OK ? connect_loopback(s.port) : -1;
    if (status != BRACE_OK || fd < 0) {
        return status;
    }
    status = create(&c, &s, error);
    if (status != BRACE_OK) {
        close(fd);
        return status;
    }
    bool silent = false;
    char port[48];
    snprintf(port, sizeof port, "%u", s.port);
    status = greet(c, fd, s.patience < 7000 ? s.patience : 7000, &silent, job, error);
    const capture_wire_welcome phone = c->phone;
    android_close(&c->base, job); /* first: the phone serves one computer at a time, and `found` may open it */
    if (silent) {
        found(user, &(capture_found){.port = port,
                                     .make = "",
                                     .model = "a phone",
                                     .note = "brace_camera does not run on it, or serves another computer"});
        return BRACE_OK;
    }
    for (uint32_t i = 0; status == BRACE_OK && i < phone.count; i++) {
        snprintf(port, sizeof port, "%u/%s", s.port, phone.cameras[i].id);
        found(user, &(capture_found){.port = port,
                                     .make = phone.make,
                                     .model = phone.model,
                                     .note = phone.cameras[i].usable ? NULL : "no RAW with manual exposure"});
    }
    return status;
}

/* ---- shooting ---- */

static capture_trouble trouble_of(int wire) {
    switch (wire) {
    case CAPTURE_WIRE_BUSY:
        return CAPTURE_TROUBLE_BUSY;
    case CAPTURE_WIRE_DROPPED:
        return CAPTURE_TROUBLE_DROPPED;
    case CAPTURE_WIRE_GONE:
        return CAPTURE_TROUBLE_GONE;
    default:
        return CAPTURE_TROUBLE_FINAL;
    }
}

/* What is left until `end`, at most the channel's patience, in milliseconds. */
static int left_until(const android_camera *c, double end) {
    return (int)fmax(fmin((end - core_seconds()) * 1000, c->channel->patience), 0);
}

static brace_status receive_mosaic(android_camera *c, brace_frame *f, double end, int *trouble, brace_error *error) {
    const uint32_t total = c->camera.width * c->camera.height * 2u;
    for (uint32_t have = 0; have < total;) {
        const brace_status status = hear(c, CAPTURE_WIRE_DATA, left_until(c, end), trouble, error);
        if (status != BRACE_OK) {
            return status;
        }
        const capture_wire_data *d = &c->message.data;
        if (d->offset != have || d->size % 2 != 0 || d->size > total - have) {
            capture_channel_end(c->channel);
            *trouble = CAPTURE_WIRE_GONE;
            return core_fail(error, BRACE_ERROR_FORMAT, "the phone sent %u bytes for place %u of a frame, not for %u",
                             d->size, d->offset, have);
        }
        capture_android_put(f, &c->camera, have, d->bytes, d->size);
        have += d->size;
    }
    return BRACE_OK;
}

static brace_status receive_frame(brace_frame **out, android_camera *c, capture_shot_report *report, double exposure,
                                  int *trouble, brace_error *error) {
    const double begin = core_seconds();
    brace_status status = hear(c, CAPTURE_WIRE_FRAME, (int)(exposure * 1000) + c->channel->patience, trouble, error);
    if (status != BRACE_OK) {
        return status;
    }
    const capture_wire_frame frame = c->message.frame;
    if (frame.width != c->camera.width || frame.height != c->camera.height) {
        capture_channel_end(c->channel);
        return core_fail(error, BRACE_ERROR_FORMAT, "the phone sent a frame of %u x %u pixels where %u x %u belong",
                         frame.width, frame.height, c->camera.width, c->camera.height);
    }
    const capture_android_shot shot = {.make = c->phone.make,
                                       .model = c->phone.model,
                                       .camera = &c->camera,
                                       .frame = &frame,
                                       .neutral = c->neutral,
                                       .turn = c->turn};
    status = capture_android_frame(out, &shot, error);
    if (status != BRACE_OK) {
        capture_channel_end(c->channel);
        *trouble = status == BRACE_ERROR_FORMAT ? CAPTURE_WIRE_GONE : CAPTURE_WIRE_FAILED;
        return status;
    }
    report->exposure = (*out)->exposure_time;
    report->iso = (*out)->iso;
    report->timestamp = frame.timestamp;
    report->skew = (double)frame.skew / 1e9 * (frame.height - 1) / frame.height;
    report->has_noise = (*out)->has_noise;
    memcpy(report->noise, (*out)->noise, sizeof report->noise);
    report->orientation = (*out)->orientation;
    return receive_mosaic(c, *out, begin + exposure + 29, trouble, error);
}

static brace_status android_shoot(capture_camera *camera, double exposure, double iso, const char *stem,
                                  capture_shot_report *out, const brace_job *job, brace_error *error) {
    android_camera *c = (android_camera *)camera;
    const capture_wire_camera *k = &c->camera;
    int trouble = CAPTURE_WIRE_GONE;
    brace_frame *frame = NULL;
    memset(&c->message, 0, sizeof c->message);
    /* The limits went through seconds, which may have cost the last nanosecond. */
    c->message.shoot.exposure =
        (int64_t)fmin(fmax(nearbyint(exposure * 1e9), (double)k->exposure_min), (double)k->exposure_max);
    c->message.shoot.iso = (uint32_t)fmin(fmax(nearbyint(iso), k->iso_min), k->iso_max);
    c->message.shoot.focus = -1;
    brace_status status = ask(c, CAPTURE_WIRE_SHOOT, job, error);
    if (status != BRACE_OK) {
        capture_channel_end(c->channel);
    } else {
        status = receive_frame(&frame, c, out, exposure, &trouble, error);
    }
    if (status == BRACE_OK) {
        char path[4096];
        trouble = CAPTURE_WIRE_FAILED;
        if (snprintf(path, sizeof path, "%s.dng", stem) >= (int)sizeof path) {
            status = core_fail(error, BRACE_ERROR_ARGUMENT, "the name %s.dng is too long", stem);
        } else {
            /* No preview: developing one would keep the next frame waiting. */
            const brace_dng_params params = {.no_preview = true, .no_sync = true};
            status = brace_frame_write_dng(frame, path, &params, job, error);
        }
    }
    brace_frame_destroy(frame);
    out->trouble = status == BRACE_OK || status == BRACE_ERROR_CANCELLED ? CAPTURE_TROUBLE_FINAL : trouble_of(trouble);
    snprintf(out->extension, sizeof out->extension, "dng");
    return status;
}

const capture_backend capture_backend_android = {
    .name = "android",
    .description = "a phone on which brace_camera runs, through adb; PORT/CAMERA, default 7325 and the back camera",
    .options = "focus=auto|infinity|DIOPTRES  where to focus; auto: the phone finds it once (default)\n"
               "turn=0|90|180|270  degrees that the phone is turned clockwise from upright (default 0)\n"
               "serial=SERIAL  which phone, as `adb devices` names them, when adb forwards the port\n"
               "timeout=SECONDS  the longest silence of the phone (default 10)",
    .list = android_list,
    .open = android_open,
    .shoot = android_shoot,
    .close = android_close,
};
