/* SPDX-License-Identifier: Apache-2.0 */
/* ptpip_wire.c: see ptpip_wire.h. */
#include "ptpip_wire.h"

#include <errno.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>

#define PATIENCE_MS 2000

void ptpip_put_bytes(ptpip_writer *w, const void *data, size_t size) {
    if (w->bad || size > w->capacity - w->size) {
        w->bad = true;
        return;
    }
    if (size > 0) {
        memcpy(w->data + w->size, data, size);
        w->size += size;
    }
}

void ptpip_put8(ptpip_writer *w, unsigned value) {
    ptpip_put_bytes(w, &(uint8_t){(uint8_t)value}, 1);
}

void ptpip_put16(ptpip_writer *w, unsigned value) {
    ptpip_put8(w, value & 255);
    ptpip_put8(w, value >> 8);
}

void ptpip_put32(ptpip_writer *w, uint32_t value) {
    ptpip_put16(w, value & 65535);
    ptpip_put16(w, value >> 16);
}

void ptpip_put_string(ptpip_writer *w, const char *ascii) {
    const size_t n = strlen(ascii);
    if (n == 0 || n > 254) {
        w->bad = w->bad || n > 254;
        ptpip_put8(w, 0);
        return;
    }
    ptpip_put8(w, (unsigned)n + 1);
    for (size_t i = 0; i <= n; i++) {
        ptpip_put16(w, (unsigned char)ascii[i]);
    }
}

void ptpip_put_array16(ptpip_writer *w, const uint16_t *values, size_t count) {
    ptpip_put32(w, (uint32_t)count);
    for (size_t i = 0; i < count; i++) {
        ptpip_put16(w, values[i]);
    }
}

unsigned ptpip_get8(ptpip_reader *r) {
    if (r->bad || r->at >= r->size) {
        r->bad = true;
        return 0;
    }
    return r->data[r->at++];
}

unsigned ptpip_get16(ptpip_reader *r) {
    const unsigned low = ptpip_get8(r);
    return low | ptpip_get8(r) << 8;
}

uint32_t ptpip_get32(ptpip_reader *r) {
    const uint32_t low = ptpip_get16(r);
    return low | (uint32_t)ptpip_get16(r) << 16;
}

static bool ready(int fd, short what) {
    struct pollfd p = {.fd = fd, .events = what};
    int n;
    do {
        n = poll(&p, 1, PATIENCE_MS);
    } while (n < 0 && errno == EINTR);
    return n > 0;
}

bool ptpip_send(int fd, const void *data, size_t size) {
    const uint8_t *p = data;
    while (size > 0) {
        const ssize_t n = send(fd, p, size, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (n > 0) {
            p += n;
            size -= (size_t)n;
        } else if (n < 0 && errno != EINTR && !((errno == EAGAIN || errno == EWOULDBLOCK) && ready(fd, POLLOUT))) {
            return false;
        }
    }
    return true;
}

bool ptpip_send_packet(int fd, uint32_t type, const void *payload, size_t size) {
    uint8_t header[8];
    ptpip_writer w = {.data = header, .capacity = sizeof header};
    ptpip_put32(&w, (uint32_t)(size + sizeof header));
    ptpip_put32(&w, type);
    return ptpip_send(fd, header, sizeof header) && (size == 0 || ptpip_send(fd, payload, size));
}

static bool receive(int fd, void *data, size_t size) {
    uint8_t *p = data;
    while (size > 0) {
        if (!ready(fd, POLLIN)) {
            return false;
        }
        const ssize_t n = recv(fd, p, size, MSG_DONTWAIT);
        /* The library writes small pieces, and sends the next one when the last is acknowledged. */
        setsockopt(fd, IPPROTO_TCP, TCP_QUICKACK, &(int){1}, sizeof(int));
        if (n > 0) {
            p += n;
            size -= (size_t)n;
        } else if (n == 0 || (errno != EINTR && errno != EAGAIN && errno != EWOULDBLOCK)) {
            return false;
        }
    }
    return true;
}

bool ptpip_receive_packet(int fd, uint32_t *type, uint8_t *payload, size_t *size, bool *oversized) {
    uint8_t header[8];
    *oversized = false;
    if (!receive(fd, header, sizeof header)) {
        return false;
    }
    ptpip_reader r = {.data = header, .size = sizeof header};
    const uint32_t length = ptpip_get32(&r);
    *type = ptpip_get32(&r);
    if (length < sizeof header || length - sizeof header > PTPIP_PACKET_MAX) {
        *oversized = true;
        return false;
    }
    *size = length - sizeof header;
    return receive(fd, payload, *size);
}
