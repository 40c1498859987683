/* SPDX-License-Identifier: Apache-2.0 */
/*
 * server.c: see server.h. Whatever a computer sends, it gets an answer, or its
 * connection is closed; the camera is closed with it.
 */
#include "server.h"

#include <errno.h>
#include <math.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

static void say(const server *s, const char *format, ...) __attribute__((format(printf, 2, 3)));

static void say(const server *s, const char *format, ...) {
    if (s->log == NULL) {
        return;
    }
    va_list args;
    va_start(args, format);
    vfprintf(s->log, format, args);
    va_end(args);
    fputc('\n', s->log);
    fflush(s->log);
}

/* ---- sockets ---- */

static int listen_on(int family, const struct sockaddr *address, socklen_t size) {
    const int fd = socket(family, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd < 0) {
        return -1;
    }
    const int yes = 1;
    if (family == AF_INET) {
        setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    }
    if (bind(fd, address, size) != 0 || listen(fd, 2) != 0) {
        const int saved = errno;
        close(fd);
        errno = saved;
        return -1;
    }
    return fd;
}

int server_listen_abstract(const char *name) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    const size_t n = strlen(name);
    if (n + 1 > sizeof address.sun_path) {
        errno = ENAMETOOLONG;
        return -1;
    }
    memcpy(address.sun_path + 1, name, n); /* a first byte of 0: no file, and gone with the process */
    return listen_on(AF_UNIX, (const struct sockaddr *)&address,
                     (socklen_t)(offsetof(struct sockaddr_un, sun_path) + 1 + n));
}

int server_listen_loopback(uint16_t *port) {
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons(*port)};
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const int fd = listen_on(AF_INET, (const struct sockaddr *)&address, sizeof address);
    socklen_t size = sizeof address;
    if (fd >= 0 && getsockname(fd, (struct sockaddr *)&address, &size) == 0) {
        *port = ntohs(address.sin_port);
    }
    return fd;
}

/* Over the abstract socket only adb's daemon, root and whoever runs this program are let in: other apps on the phone
 * reach it too. A loopback address has no such credentials. */
static bool welcome_peer(int fd) {
    struct ucred peer;
    socklen_t size = sizeof peer;
    struct sockaddr_storage address;
    socklen_t address_size = sizeof address;
    if (getsockname(fd, (struct sockaddr *)&address, &address_size) != 0) {
        return false;
    }
    if (address.ss_family != AF_UNIX) {
        return true;
    }
    const uid_t shell = 2000; /* AID_SHELL, which adbd runs as */
    return getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer, &size) == 0 &&
           (peer.uid == 0 || peer.uid == shell || peer.uid == getuid());
}

/* ---- requests ---- */

typedef struct session {
    const server *server;
    capture_channel channel;
    capture_message in, out;
    capture_wire_welcome phone;
    capture_wire_camera camera;
    bool open;
    unsigned long shots;
} session;

/* Answers the request in `in` with `out`. False: the connection is of no more use. */
static bool answer(session *t, capture_wire_type type) {
    t->out.type = type;
    t->out.number = t->in.number;
    if (capture_channel_send(&t->channel, &t->out) == CAPTURE_CHANNEL_OK) {
        return true;
    }
    say(t->server, "%s could not be sent: %s", capture_wire_name(type), t->channel.why);
    return false;
}

static bool refuse(session *t, int trouble, const char *text) {
    say(t->server, "%s: %s", capture_wire_name(t->in.type), text);
    memset(&t->out, 0, sizeof t->out);
    t->out.error.trouble = (uint8_t)trouble;
    snprintf(t->out.error.text, sizeof t->out.error.text, "%s", text);
    return answer(t, CAPTURE_WIRE_ERROR);
}

/* An answer whose values came from the phone's own metadata, which has been seen to be wrong. */
static bool answer_checked(session *t, capture_wire_type type) {
    t->out.type = type;
    t->out.number = t->in.number;
    if (capture_message_write(&t->out, t->channel.out, sizeof t->channel.out) == 0) {
        return refuse(t, CAPTURE_WIRE_UNSUPPORTED, "what the phone says of this camera or frame makes no sense");
    }
    return answer(t, type);
}

static bool do_open(session *t) {
    char why[SHIM_WHY] = "", id[32];
    snprintf(id, sizeof id, "%s", t->in.open.id);
    const capture_wire_welcome *p = &t->phone;
    for (int pass = 0; pass < 2 && id[0] == '\0'; pass++) {
        for (uint32_t i = 0; i < p->count && id[0] == '\0'; i++) {
            if (p->cameras[i].usable && (pass == 1 || p->cameras[i].facing == CAPTURE_WIRE_BACK)) {
                snprintf(id, sizeof id, "%s", p->cameras[i].id);
            }
        }
    }
    uint32_t at = 0;
    while (at < p->count && strcmp(p->cameras[at].id, id) != 0) {
        at++;
    }
    if (id[0] == '\0') {
        return refuse(t, CAPTURE_WIRE_UNSUPPORTED,
                      "no camera of this phone gives RAW frames with exposure time and sensitivity set by hand");
    }
    if (at == p->count) {
        return refuse(t, CAPTURE_WIRE_REFUSED, "the phone has no camera of that name");
    }
    if (!p->cameras[at].usable) {
        return refuse(t, CAPTURE_WIRE_UNSUPPORTED,
                      "this camera does not give RAW frames with exposure time and sensitivity set by hand");
    }
    shim_close(t->server->camera);
    t->open = false;
    memset(&t->out, 0, sizeof t->out);
    const int trouble = shim_open(t->server->camera, id, &t->out.camera, why);
    if (trouble != SHIM_OK) {
        return refuse(t, trouble, why);
    }
    t->camera = t->out.camera;
    say(t->server, "camera %s: %u x %u, %.6f to %.3f s, ISO %u to %u", id, t->camera.width, t->camera.height,
        (double)t->camera.exposure_min / 1e9, (double)t->camera.exposure_max / 1e9, t->camera.iso_min,
        t->camera.iso_max);
    const bool good = answer_checked(t, CAPTURE_WIRE_CAMERA);
    t->open = t->out.type == CAPTURE_WIRE_CAMERA;
    return good;
}

static bool do_meter(session *t) {
    char why[SHIM_WHY] = "";
    memset(&t->out, 0, sizeof t->out);
    const int trouble = shim_meter(t->server->camera, &t->in.meter, &t->out.metered, why);
    return trouble != SHIM_OK ? refuse(t, trouble, why) : answer_checked(t, CAPTURE_WIRE_METERED);
}

/* What a frame can be used without is left out rather than the frame refused for it. */
static void drop_nonsense(capture_wire_frame *f) {
    for (int i = 0; i < 4; i++) {
        f->has_noise =
            f->has_noise && f->noise[i][0] >= 0 && f->noise[i][0] <= 1 && f->noise[i][1] >= 0 && f->noise[i][1] <= 1;
    }
    if (!f->has_noise) {
        memset(f->noise, 0, sizeof f->noise);
    }
    const double white = f->white != 0 ? (double)f->white : 65535;
    for (int i = 0; i < 4; i++) {
        f->has_black = f->has_black && f->black[i] >= 0 && f->black[i] < white;
    }
    if (!f->has_black) {
        memset(f->black, 0, sizeof f->black);
    }
    for (int i = 0; i < 3; i++) {
        if (!(f->neutral[i] >= 1e-3 && f->neutral[i] <= 1e3)) {
            memset(f->neutral, 0, sizeof f->neutral);
        }
    }
    if (f->skew < 0 || f->skew > 1000000000) {
        f->skew = 0;
    }
}

/* The mosaic, row after row without what stands between them, in the protocol's byte order. */
static bool send_mosaic(session *t, const shim_image *image, uint32_t width, uint32_t height, uint8_t *chunk) {
    const size_t row = (size_t)width * 2;
    size_t filled = 0;
    uint32_t offset = 0;
    for (uint32_t y = 0; y < height; y++) {
        const uint8_t *from = image->data + y * image->row_stride;
        for (size_t done = 0; done < row;) {
            const size_t room = CAPTURE_WIRE_CHUNK - filled, n = row - done < room ? row - done : room;
            for (size_t i = 0; i < n; i += 2) {
                uint16_t v;
                memcpy(&v, from + done + i, 2);
                chunk[filled + i] = (uint8_t)v;
                chunk[filled + i + 1] = (uint8_t)(v >> 8);
            }
            done += n;
            filled += n;
            if (filled == CAPTURE_WIRE_CHUNK || (y + 1 == height && done == row)) {
                t->out.data.offset = offset;
                t->out.data.size = (uint32_t)filled;
                t->out.data.bytes = chunk;
                if (!answer(t, CAPTURE_WIRE_DATA)) {
                    return false;
                }
                offset += (uint32_t)filled;
                filled = 0;
            }
        }
    }
    return true;
}

static bool do_shoot(session *t) {
    const capture_wire_shoot *request = &t->in.shoot;
    char why[SHIM_WHY] = "";
    if (request->exposure < t->camera.exposure_min || request->exposure > t->camera.exposure_max ||
        request->iso < t->camera.iso_min || request->iso > t->camera.iso_max) {
        return refuse(t, CAPTURE_WIRE_REFUSED, "the camera has no such exposure time or sensitivity");
    }
    if (request->focus > t->camera.focus_nearest) {
        return refuse(t, CAPTURE_WIRE_REFUSED, "the lens does not focus as near as that");
    }
    shim_image image = {0};
    memset(&t->out, 0, sizeof t->out);
    const int trouble = shim_shoot(t->server->camera, request, &t->out.frame, &image, why);
    if (trouble != SHIM_OK) {
        t->open = t->open && trouble != CAPTURE_WIRE_GONE;
        return refuse(t, trouble, why);
    }
    drop_nonsense(&t->out.frame);
    const uint32_t width = t->out.frame.width, height = t->out.frame.height;
    const size_t row = (size_t)width * 2;
    bool good;
    if (width != t->camera.width || height != t->camera.height || image.row_stride < row || image.size < row ||
        (image.size - row) / image.row_stride < height - 1) {
        good = refuse(t, CAPTURE_WIRE_DROPPED, "the frame is not of the size that was asked for");
    } else {
        uint8_t *chunk = malloc(CAPTURE_WIRE_CHUNK);
        good = chunk == NULL ? refuse(t, CAPTURE_WIRE_FAILED, "the phone has no memory left")
                             : answer_checked(t, CAPTURE_WIRE_FRAME);
        if (good && chunk != NULL && t->out.type == CAPTURE_WIRE_FRAME) {
            t->shots++;
            say(t->server, "frame %lu: %.6f s, ISO %u", t->shots, (double)t->out.frame.exposure / 1e9,
                t->out.frame.iso);
            good = send_mosaic(t, &image, width, height, chunk);
        }
        free(chunk);
    }
    shim_release(t->server->camera);
    return good;
}

static bool do_request(session *t) {
    switch (t->in.type) {
    case CAPTURE_WIRE_OPEN:
        return do_open(t);
    case CAPTURE_WIRE_METER:
    case CAPTURE_WIRE_SHOOT:
        if (!t->open) {
            return refuse(t, CAPTURE_WIRE_GONE, "no camera is open");
        }
        return t->in.type == CAPTURE_WIRE_METER ? do_meter(t) : do_shoot(t);
    case CAPTURE_WIRE_BYE:
        return false;
    default:
        refuse(t, CAPTURE_WIRE_REFUSED, "a message out of place");
        return false;
    }
}

static void serve(session *t) {
    const server *s = t->server;
    char why[SHIM_WHY] = "";
    capture_channel_result result = capture_channel_receive(&t->channel, &t->in, s->patience);
    if (result != CAPTURE_CHANNEL_OK || t->in.type != CAPTURE_WIRE_HELLO) {
        say(s, "not a computer that runs BRACE: %s", result == CAPTURE_CHANNEL_OK ? "no greeting" : t->channel.why);
        return;
    }
    say(s, "connected: %s", t->in.hello.program);
    memset(&t->out, 0, sizeof t->out);
    const int trouble = shim_describe(s->camera, &t->out.welcome, why);
    t->phone = t->out.welcome;
    if (trouble != SHIM_OK) {
        refuse(t, trouble, why);
        return;
    }
    bool good = answer_checked(t, CAPTURE_WIRE_WELCOME);
    while (good) {
        result = capture_channel_receive(&t->channel, &t->in, s->idle);
        if (result == CAPTURE_CHANNEL_BAD) {
            say(s, "dropped: %s", t->channel.why);
        }
        good = result == CAPTURE_CHANNEL_OK && do_request(t);
    }
}

void server_serve(const server *s, int fd) {
    session *t = calloc(1, sizeof *t);
    if (t == NULL) {
        say(s, "no memory left");
        close(fd);
        return;
    }
    t->server = s;
    capture_channel_begin(&t->channel, fd, s->patience);
    t->channel.stopped = s->stopped;
    t->channel.user = s->user;
    serve(t);
    shim_close(s->camera);
    capture_channel_end(&t->channel);
    say(s, "disconnected after %lu frames", t->shots);
    free(t);
}

bool server_run(const server *s, int listener) {
    while (s->stopped == NULL || !s->stopped(s->user)) {
        struct pollfd p = {.fd = listener, .events = POLLIN};
        const int n = poll(&p, 1, 100);
        if (n < 0 && errno != EINTR) {
            return false;
        }
        if (n <= 0) {
            continue;
        }
        const int fd = accept4(listener, NULL, NULL, SOCK_CLOEXEC);
        if (fd < 0) {
            if (errno == EINTR || errno == EAGAIN || errno == ECONNABORTED) {
                continue;
            }
            return false;
        }
        if (!welcome_peer(fd)) {
            say(s, "a program of another user was turned away");
            close(fd);
            continue;
        }
        server_serve(s, fd);
    }
    return true;
}
