/* SPDX-License-Identifier: Apache-2.0 */
/* ptpip_camera.c: the test camera's connections, commands and faults. */
#include "ptpip_camera.h"

#include <arpa/inet.h>
#include <errno.h>
#include <limits.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include "ptpip_device.h"

#define NEWCOMERS 4

struct ptpip_camera {
    ptpip_params params;
    ptpip_fault faults[PTPIP_FAULTS_MAX];
    unsigned seen[PTPIP_FAULT_COUNT]; /* occurrences of the commands that faults befall */
    ptpip_device device;
    ptpip_tally tally;
    pthread_mutex_t mutex; /* device and tally */
    pthread_t thread;
    int listener, stop;
    uint16_t port;
    int newcomers[NEWCOMERS]; /* connections that have not said yet what they are; -1: none */
    int command, event;       /* -1: none */
    uint8_t computer[16];     /* its GUID: the same one may come again */
    bool session;
    uint32_t transaction;
    uint8_t packet[PTPIP_PACKET_MAX], reply[PTPIP_PACKET_MAX];
};

/* ---- faults ---- */

static const char *const fault_names[PTPIP_FAULT_COUNT] = {
    [PTPIP_FAULT_BUSY_OPEN] = "busy-open",
    [PTPIP_FAULT_BUSY_SET] = "busy-set",
    [PTPIP_FAULT_BUSY_SHOOT] = "busy-shoot",
    [PTPIP_FAULT_BUSY_DOWNLOAD] = "busy-download",
    [PTPIP_FAULT_BUSY_READ] = "busy-read",
    [PTPIP_FAULT_DROP_READ] = "drop-read",
    [PTPIP_FAULT_DROP_SET] = "drop-set",
    [PTPIP_FAULT_DROP_SHOOT] = "drop-shoot",
    [PTPIP_FAULT_DROP_EXPOSE] = "drop-expose",
    [PTPIP_FAULT_DROP_DOWNLOAD] = "drop-download",
    [PTPIP_FAULT_NO_OBJECT] = "no-object",
    [PTPIP_FAULT_NO_EVENT] = "no-event",
    [PTPIP_FAULT_REFUSE] = "refuse",
    [PTPIP_FAULT_KEEP] = "keep",
    [PTPIP_FAULT_LIE] = "lie",
    [PTPIP_FAULT_TRUNCATE] = "truncate",
    [PTPIP_FAULT_JPEG] = "jpeg",
    [PTPIP_FAULT_FULL] = "full",
    [PTPIP_FAULT_HANG] = "hang",
    [PTPIP_FAULT_LENGTH] = "length",
};

const char *ptpip_fault_name(ptpip_fault_kind kind) {
    return fault_names[kind];
}

/* A number from 1, or "all" where that is allowed. */
static bool count_parse(unsigned *out, const char **text, bool all) {
    if (all && strncmp(*text, "all", 3) == 0) {
        *out = UINT_MAX;
        *text += 3;
        return true;
    }
    char *end;
    if (**text < '1' || **text > '9') {
        return false;
    }
    const unsigned long n = strtoul(*text, &end, 10);
    *out = (unsigned)n;
    *text = end;
    return n <= 1000000;
}

bool ptpip_fault_parse(ptpip_fault *out, const char *text) {
    const size_t n = strcspn(text, "@");
    for (int kind = 0; kind < PTPIP_FAULT_COUNT; kind++) {
        if (strlen(fault_names[kind]) != n || strncmp(fault_names[kind], text, n) != 0) {
            continue;
        }
        *out = (ptpip_fault){(ptpip_fault_kind)kind, 1, 1};
        text += n;
        if (*text == '@') {
            text++;
            if (!count_parse(&out->from, &text, false)) {
                return false;
            }
            if (*text == 'x') {
                text++;
                if (!count_parse(&out->times, &text, true)) {
                    return false;
                }
            }
        }
        return *text == '\0';
    }
    return false;
}

/* Counts an occurrence of the command; true if a fault befalls it. */
static bool strikes(ptpip_camera *camera, ptpip_fault_kind kind) {
    const unsigned n = ++camera->seen[kind];
    for (size_t i = 0; i < camera->params.fault_count; i++) {
        const ptpip_fault *f = &camera->faults[i];
        if (f->kind == kind && n >= f->from && n - f->from < f->times) {
            camera->tally.faults++;
            return true;
        }
    }
    return false;
}

/* ---- connections ---- */

static void hang_up(int *fd) {
    if (*fd >= 0) {
        close(*fd);
    }
    *fd = -1;
}

static void drop(ptpip_camera *camera) {
    hang_up(&camera->command);
    hang_up(&camera->event);
    camera->session = false;
}

static void receive_failed(ptpip_camera *camera, bool oversized) {
    camera->tally.rejected += oversized;
}

/* The first packet of a connection says which of the two it is. */
static void greet(ptpip_camera *camera, int *newcomer) {
    const int fd = *newcomer;
    uint32_t type;
    size_t size;
    bool oversized;
    *newcomer = -1;
    if (!ptpip_receive_packet(fd, &type, camera->packet, &size, &oversized)) {
        receive_failed(camera, oversized);
    } else if (type == PTPIP_INIT_COMMAND_REQUEST && size >= 16 + 2 + 4 &&
               (camera->command < 0 || memcmp(camera->computer, camera->packet, 16) == 0)) {
        drop(camera);
        memcpy(camera->computer, camera->packet, 16);
        static const char name[] = "Test Camera";
        ptpip_writer w = {.data = camera->reply, .capacity = sizeof camera->reply};
        ptpip_put32(&w, 1); /* connection number */
        ptpip_put_bytes(&w, "brace test cam\1\1", 16);
        for (size_t i = 0; i < sizeof name; i++) {
            ptpip_put16(&w, (unsigned char)name[i]);
        }
        ptpip_put32(&w, 0x00010000); /* version of the protocol */
        if (ptpip_send_packet(fd, PTPIP_INIT_COMMAND_ACK, w.data, w.size)) {
            camera->command = fd;
            return;
        }
    } else if (type == PTPIP_INIT_EVENT_REQUEST && size == 4 && camera->command >= 0 && camera->event < 0) {
        ptpip_reader r = {.data = camera->packet, .size = size};
        if (ptpip_get32(&r) == 1 && ptpip_send_packet(fd, PTPIP_INIT_EVENT_ACK, NULL, 0)) {
            camera->event = fd;
            return;
        }
    } else {
        static const uint8_t busy[4] = {2, 0, 0, 0};
        ptpip_send_packet(fd, PTPIP_INIT_FAIL, busy, sizeof busy);
        camera->tally.rejected++;
    }
    close(fd);
}

static void admit(ptpip_camera *camera) {
    const int fd = accept4(camera->listener, NULL, NULL, SOCK_CLOEXEC);
    for (int i = 0; fd >= 0 && i < NEWCOMERS; i++) {
        if (camera->newcomers[i] < 0) {
            setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &(int){1}, sizeof(int));
            camera->newcomers[i] = fd;
            return;
        }
    }
    if (fd >= 0) {
        close(fd);
    }
}

/* ---- answers ---- */

static void respond(ptpip_camera *camera, unsigned code, size_t count, uint32_t parameter) {
    uint8_t bytes[16];
    ptpip_writer w = {.data = bytes, .capacity = sizeof bytes};
    ptpip_put16(&w, code);
    ptpip_put32(&w, camera->transaction);
    if (count > 0) {
        ptpip_put32(&w, parameter);
    }
    if (!ptpip_send_packet(camera->command, PTPIP_RESPONSE, w.data, w.size)) {
        drop(camera);
    }
}

static void tell(ptpip_camera *camera, unsigned code, uint32_t parameter) {
    uint8_t bytes[16];
    ptpip_writer w = {.data = bytes, .capacity = sizeof bytes};
    ptpip_put16(&w, code);
    ptpip_put32(&w, camera->transaction);
    ptpip_put32(&w, parameter);
    if (camera->event >= 0 && !ptpip_send_packet(camera->event, PTPIP_EVENT, w.data, w.size)) {
        drop(camera);
    }
}

/* Announces `announced` bytes and sends `size` of them. */
static bool send_data(ptpip_camera *camera, const uint8_t *data, size_t size, size_t announced) {
    ptpip_writer w = {.data = camera->packet, .capacity = sizeof camera->packet};
    ptpip_put32(&w, camera->transaction);
    ptpip_put32(&w, (uint32_t)announced);
    ptpip_put32(&w, 0);
    bool ok = ptpip_send_packet(camera->command, PTPIP_START_DATA, w.data, w.size);
    size_t at = 0;
    do {
        const size_t left = size - at, n = left < 60000 ? left : 60000;
        w.size = 0;
        ptpip_put32(&w, camera->transaction);
        if (n > 0) {
            ptpip_put_bytes(&w, data + at, n);
        }
        at += n;
        ok = ok && ptpip_send_packet(camera->command, at == size ? PTPIP_END_DATA : PTPIP_DATA, w.data, w.size);
    } while (ok && at < size);
    if (!ok) {
        drop(camera);
    }
    return ok;
}

static void answer(ptpip_camera *camera, const ptpip_writer *w) {
    if (w->bad) {
        respond(camera, PTP_GENERAL_ERROR, 0, 0);
    } else if (send_data(camera, w->data, w->size, w->size)) {
        respond(camera, PTP_OK, 0, 0);
    }
}

/* ---- commands ---- */

typedef struct request {
    uint32_t phase; /* 1: no data, or data from the camera; 2: data to the camera */
    unsigned code;
    uint32_t parameters[5];
    uint8_t data[256];
    size_t size;
} request;

/* The data that follows a request, all of it in `q->data`. */
static bool receive_data(ptpip_camera *camera, request *q) {
    uint32_t type;
    size_t size;
    bool oversized = false, last = false;
    uint64_t announced = 0;
    for (bool first = true; !last; first = false) {
        if (!ptpip_receive_packet(camera->command, &type, camera->packet, &size, &oversized)) {
            receive_failed(camera, oversized);
            return false;
        }
        ptpip_reader r = {.data = camera->packet, .size = size};
        const uint32_t transaction = ptpip_get32(&r);
        if (first) {
            announced = ptpip_get32(&r);
            announced |= (uint64_t)ptpip_get32(&r) << 32;
        }
        last = type == PTPIP_END_DATA;
        /* Of the length, libgphoto2 fills only the low half with care: what comes is what counts. */
        if (r.bad || transaction != camera->transaction || first != (type == PTPIP_START_DATA) ||
            (!first && !last && type != PTPIP_DATA) || (uint32_t)announced > sizeof q->data ||
            (!first && size - 4 > sizeof q->data - q->size)) {
            camera->tally.rejected++;
            return false;
        }
        if (!first) {
            memcpy(q->data + q->size, camera->packet + 4, size - 4);
            q->size += size - 4;
        }
    }
    return true;
}

/* The smallest thing that begins and ends as a JPEG does. */
static void *small_jpeg(size_t *size) {
    static const uint8_t bytes[] = {0xff, 0xd8, 0xff, 0xe0, 0, 16, 'J', 'F', 'I', 'F',  0,
                                    1,    1,    0,    0,    1, 0,  1,   0,   0,   0xff, 0xd9};
    void *copy = core_alloc(sizeof bytes, 1);
    if (copy != NULL) {
        memcpy(copy, bytes, sizeof bytes);
        *size = sizeof bytes;
    }
    return copy;
}

static void add_picture(ptpip_camera *camera, void *data, size_t size, bool jpeg) {
    const uint32_t handle = data != NULL ? ptpip_device_add(&camera->device, data, size, jpeg) : 0;
    camera->tally.exposures += handle != 0 && !jpeg;
    if (handle != 0) {
        tell(camera, PTP_OBJECT_ADDED, handle);
    }
}

static void shoot(ptpip_camera *camera, double exposure, double iso) {
    camera->tally.releases++;
    if (strikes(camera, PTPIP_FAULT_BUSY_SHOOT)) {
        respond(camera, PTP_DEVICE_BUSY, 0, 0);
        return;
    }
    if (strikes(camera, PTPIP_FAULT_DROP_SHOOT)) {
        drop(camera);
        return;
    }
    if (strikes(camera, PTPIP_FAULT_FULL)) {
        respond(camera, PTP_STORE_FULL, 0, 0);
        return;
    }
    if (strikes(camera, PTPIP_FAULT_HANG)) {
        return;
    }
    if (strikes(camera, PTPIP_FAULT_LENGTH)) {
        static const uint8_t header[8] = {0xff, 0xff, 0xff, 0x7f, PTPIP_RESPONSE, 0, 0, 0};
        ptpip_send(camera->command, header, sizeof header);
        return;
    }
    respond(camera, PTP_OK, 0, 0);
    if (strikes(camera, PTPIP_FAULT_DROP_EXPOSE)) {
        drop(camera);
        return;
    }
    if (strikes(camera, PTPIP_FAULT_NO_EVENT)) {
        return;
    }
    const ptpip_property *format = ptpip_device_property(&camera->device, PTP_COMPRESSION);
    const bool raw = format == NULL || format->value >= 4, both = format != NULL && format->value == 5;
    void *data = NULL;
    size_t size = 0;
    if (strikes(camera, PTPIP_FAULT_NO_OBJECT)) {
        tell(camera, PTP_CAPTURE_COMPLETE, 0);
        return;
    }
    if (strikes(camera, PTPIP_FAULT_JPEG) || !raw || both) {
        data = small_jpeg(&size);
        add_picture(camera, data, size, true);
    }
    if ((data == NULL || both) && raw) {
        brace_error error;
        data = NULL;
        pthread_mutex_unlock(&camera->mutex); /* this may take its time */
        const brace_status status = camera->params.expose(camera->params.user, exposure, iso, &data, &size, &error);
        pthread_mutex_lock(&camera->mutex);
        if (status == BRACE_OK) {
            add_picture(camera, data, size, false);
        }
    }
    tell(camera, PTP_CAPTURE_COMPLETE, 0);
}

static void send_picture(ptpip_camera *camera, uint32_t handle, size_t offset, size_t most, bool partial) {
    ptpip_object *o = ptpip_device_object(&camera->device, handle);
    if (o == NULL || o->data == NULL || offset > o->size) {
        respond(camera, PTP_INVALID_OBJECT, 0, 0);
        return;
    }
    if (strikes(camera, PTPIP_FAULT_BUSY_DOWNLOAD)) {
        respond(camera, PTP_DEVICE_BUSY, 0, 0);
        return;
    }
    size_t size = o->size - offset < most ? o->size - offset : most;
    if (strikes(camera, PTPIP_FAULT_DROP_DOWNLOAD)) {
        send_data(camera, o->data + offset, size / 2, size);
        drop(camera);
        return;
    }
    size = strikes(camera, PTPIP_FAULT_TRUNCATE) ? size / 2 : size;
    if (send_data(camera, o->data + offset, size, size)) {
        camera->tally.downloads += offset + size == o->size;
        respond(camera, PTP_OK, partial ? 1 : 0, (uint32_t)size);
    }
}

static bool is_light(const ptpip_property *p) {
    return p->code == PTP_EXPOSURE_TIME || p->code == PTP_EXPOSURE_INDEX || p->code == PTP_MAKER_EXPOSURE;
}

static void set_property(ptpip_camera *camera, const request *q, double *exposure, double *iso) {
    ptpip_property *p = ptpip_device_property(&camera->device, q->parameters[0]);
    camera->tally.sets++;
    if (p == NULL) {
        respond(camera, PTP_PROPERTY_NOT_SUPPORTED, 0, 0);
        return;
    }
    const bool light = is_light(p);
    if (light && strikes(camera, PTPIP_FAULT_BUSY_SET)) {
        respond(camera, PTP_DEVICE_BUSY, 0, 0);
        return;
    }
    if (light && strikes(camera, PTPIP_FAULT_DROP_SET)) {
        drop(camera);
        return;
    }
    if (light && strikes(camera, PTPIP_FAULT_REFUSE)) {
        respond(camera, PTP_ACCESS_DENIED, 0, 0);
        return;
    }
    ptpip_reader r = {.data = q->data, .size = q->size};
    const unsigned code = ptpip_device_set(p, &r, light && strikes(camera, PTPIP_FAULT_KEEP));
    if (!(light && strikes(camera, PTPIP_FAULT_LIE))) {
        *exposure = ptpip_device_exposure(&camera->device);
        *iso = ptpip_device_iso(&camera->device);
    }
    respond(camera, code, 0, 0);
}

static void obey(ptpip_camera *camera, const request *q, double *exposure, double *iso) {
    ptpip_device *device = &camera->device;
    ptpip_writer w = {.data = camera->reply, .capacity = sizeof camera->reply};
    const uint32_t *p = q->parameters;
    if (!camera->session && q->code != PTP_OPEN_SESSION && q->code != PTP_GET_DEVICE_INFO) {
        respond(camera, PTP_SESSION_NOT_OPEN, 0, 0);
        return;
    }
    switch (q->code) {
    case PTP_OPEN_SESSION:
        if (strikes(camera, PTPIP_FAULT_BUSY_OPEN)) {
            respond(camera, PTP_DEVICE_BUSY, 0, 0);
        } else {
            const bool already = camera->session;
            camera->tally.connections += !already;
            camera->session = true;
            respond(camera, already ? PTP_SESSION_ALREADY_OPEN : PTP_OK, 0, 0);
        }
        break;
    case PTP_CLOSE_SESSION:
        camera->session = false;
        respond(camera, PTP_OK, 0, 0);
        break;
    case PTP_GET_DEVICE_INFO:
        ptpip_write_device_info(&w, device);
        answer(camera, &w);
        break;
    case PTP_GET_STORAGE_IDS:
        ptpip_put32(&w, 1);
        ptpip_put32(&w, PTP_STORAGE);
        answer(camera, &w);
        break;
    case PTP_GET_STORAGE_INFO:
        if (p[0] != PTP_STORAGE) {
            respond(camera, PTP_INVALID_STORAGE, 0, 0);
            break;
        }
        ptpip_write_storage_info(&w);
        answer(camera, &w);
        break;
    case PTP_GET_OBJECT_HANDLES:
        ptpip_write_handles(&w, device, p[2]);
        answer(camera, &w);
        break;
    case PTP_GET_NUM_OBJECTS: {
        ptpip_write_handles(&w, device, p[2]);
        ptpip_reader r = {.data = w.data, .size = w.size};
        respond(camera, PTP_OK, 1, ptpip_get32(&r));
        break;
    }
    case PTP_GET_OBJECT_INFO: {
        const ptpip_object *o = ptpip_device_object(device, p[0]);
        if (o == NULL) {
            respond(camera, PTP_INVALID_OBJECT, 0, 0);
            break;
        }
        ptpip_write_object_info(&w, o);
        answer(camera, &w);
        break;
    }
    case PTP_GET_OBJECT:
        send_picture(camera, p[0], 0, SIZE_MAX, false);
        break;
    case PTP_GET_PARTIAL_OBJECT:
        send_picture(camera, p[0], p[1], p[2], true);
        break;
    case PTP_DELETE_OBJECT: {
        ptpip_object *o = ptpip_device_object(device, p[0]);
        if (o == NULL || o->data == NULL) {
            respond(camera, PTP_INVALID_OBJECT, 0, 0);
            break;
        }
        ptpip_device_delete(o);
        camera->tally.deleted++;
        respond(camera, PTP_OK, 0, 0);
        break;
    }
    case PTP_GET_PROPERTY_DESCRIPTION:
    case PTP_GET_PROPERTY: {
        const ptpip_property *property = ptpip_device_property(device, p[0]);
        if (property == NULL) {
            respond(camera, PTP_PROPERTY_NOT_SUPPORTED, 0, 0);
            break;
        }
        if (q->code == PTP_GET_PROPERTY_DESCRIPTION) {
            if (strikes(camera, PTPIP_FAULT_DROP_READ)) {
                drop(camera);
                break;
            }
            if (is_light(property) && strikes(camera, PTPIP_FAULT_BUSY_READ)) {
                respond(camera, PTP_DEVICE_BUSY, 0, 0);
                break;
            }
        }
        if (q->code == PTP_GET_PROPERTY) {
            ptpip_write_value(&w, property, property->value);
        } else {
            ptpip_write_property(&w, property);
        }
        answer(camera, &w);
        break;
    }
    case PTP_SET_PROPERTY:
        set_property(camera, q, exposure, iso);
        break;
    default:
        respond(camera, PTP_OPERATION_NOT_SUPPORTED, 0, 0);
    }
}

static void serve_command(ptpip_camera *camera, double *exposure, double *iso) {
    uint32_t type;
    size_t size;
    bool oversized;
    if (!ptpip_receive_packet(camera->command, &type, camera->packet, &size, &oversized)) {
        receive_failed(camera, oversized);
        drop(camera);
        return;
    }
    if (type == PTPIP_PROBE_REQUEST) {
        ptpip_send_packet(camera->command, PTPIP_PROBE_RESPONSE, NULL, 0);
        return;
    }
    ptpip_reader r = {.data = camera->packet, .size = size};
    request q = {.phase = ptpip_get32(&r), .code = ptpip_get16(&r)};
    camera->transaction = ptpip_get32(&r);
    for (int i = 0; i < 5 && !r.bad && r.at < r.size; i++) {
        q.parameters[i] = ptpip_get32(&r);
    }
    if (type != PTPIP_REQUEST || r.bad || r.at != r.size || q.phase < 1 || q.phase > 2) {
        camera->tally.rejected++;
        drop(camera);
        return;
    }
    if (q.phase == 2 && !receive_data(camera, &q)) {
        drop(camera);
        return;
    }
    if (q.code == PTP_INITIATE_CAPTURE && camera->session) {
        shoot(camera, *exposure, *iso);
    } else {
        obey(camera, &q, exposure, iso);
    }
}

static void serve_event(ptpip_camera *camera) {
    uint32_t type;
    size_t size;
    bool oversized;
    if (!ptpip_receive_packet(camera->event, &type, camera->packet, &size, &oversized)) {
        receive_failed(camera, oversized);
        drop(camera);
    } else if (type == PTPIP_PROBE_REQUEST) {
        ptpip_send_packet(camera->event, PTPIP_PROBE_RESPONSE, NULL, 0);
    }
}

static void *serve(void *arg) {
    ptpip_camera *camera = arg;
    double exposure = ptpip_device_exposure(&camera->device), iso = ptpip_device_iso(&camera->device);
    for (;;) {
        struct pollfd p[4 + NEWCOMERS] = {{.fd = camera->stop, .events = POLLIN},
                                          {.fd = camera->listener, .events = POLLIN},
                                          {.fd = camera->command, .events = POLLIN},
                                          {.fd = camera->event, .events = POLLIN}};
        for (int i = 0; i < NEWCOMERS; i++) {
            p[4 + i] = (struct pollfd){.fd = camera->newcomers[i], .events = POLLIN};
        }
        if (poll(p, 4 + NEWCOMERS, -1) < 0 && errno != EINTR) {
            return NULL;
        }
        if (p[0].revents != 0) {
            return NULL;
        }
        pthread_mutex_lock(&camera->mutex);
        /* What ended goes first, so that who comes anew finds room. */
        if (p[3].revents != 0) {
            serve_event(camera);
        }
        if (p[2].revents != 0 && camera->command >= 0) {
            serve_command(camera, &exposure, &iso);
        }
        for (int i = 0; i < NEWCOMERS; i++) {
            if (p[4 + i].revents != 0) {
                greet(camera, &camera->newcomers[i]);
            }
        }
        if (p[1].revents != 0) {
            admit(camera);
        }
        pthread_mutex_unlock(&camera->mutex);
    }
}

/* ---- start and end ---- */

static void camera_free(ptpip_camera *camera) {
    hang_up(&camera->listener);
    hang_up(&camera->stop);
    drop(camera);
    for (int i = 0; i < NEWCOMERS; i++) {
        hang_up(&camera->newcomers[i]);
    }
    ptpip_device_free(&camera->device);
    pthread_mutex_destroy(&camera->mutex);
    core_free(camera);
}

brace_status ptpip_camera_start(ptpip_camera **out, const ptpip_params *params, brace_error *error) {
    ptpip_camera *camera = core_calloc(1, sizeof *camera);
    if (camera == NULL) {
        return core_fail_memory(error, sizeof *camera, "the test camera");
    }
    camera->params = *params;
    for (size_t i = 0; i < params->fault_count && i < PTPIP_FAULTS_MAX; i++) {
        camera->faults[i] = params->faults[i];
    }
    camera->command = camera->event = -1;
    for (int i = 0; i < NEWCOMERS; i++) {
        camera->newcomers[i] = -1;
    }
    pthread_mutex_init(&camera->mutex, NULL);
    ptpip_device_init(&camera->device, params);
    camera->stop = eventfd(0, EFD_CLOEXEC);
    camera->listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons(params->port)};
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t length = sizeof address;
    if (camera->stop < 0 || camera->listener < 0 ||
        setsockopt(camera->listener, SOL_SOCKET, SO_REUSEADDR, &(int){1}, sizeof(int)) != 0 ||
        bind(camera->listener, (struct sockaddr *)&address, sizeof address) != 0 || listen(camera->listener, 4) != 0 ||
        getsockname(camera->listener, (struct sockaddr *)&address, &length) != 0 ||
        pthread_create(&camera->thread, NULL, serve, camera) != 0) {
        const int problem = errno;
        camera_free(camera);
        return core_fail(error, BRACE_ERROR_IO, "the test camera cannot listen on 127.0.0.1, port %u: %s",
                         (unsigned)params->port, strerror(problem));
    }
    camera->port = ntohs(address.sin_port);
    *out = camera;
    return BRACE_OK;
}

uint16_t ptpip_camera_port(const ptpip_camera *camera) {
    return camera->port;
}

ptpip_tally ptpip_camera_tally(ptpip_camera *camera) {
    pthread_mutex_lock(&camera->mutex);
    ptpip_tally tally = camera->tally;
    tally.restored = ptpip_device_restored(&camera->device);
    pthread_mutex_unlock(&camera->mutex);
    return tally;
}

void ptpip_camera_stop(ptpip_camera *camera) {
    if (camera == NULL) {
        return;
    }
    if (write(camera->stop, &(uint64_t){1}, sizeof(uint64_t)) == (ssize_t)sizeof(uint64_t)) {
        pthread_join(camera->thread, NULL);
        camera_free(camera);
    }
}
