/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ptpip_wire.h: bytes of PTP (ISO 15740) and of PTP/IP (CIPA DC-005), the way it
 * is carried by TCP: little-endian numbers, counted UTF-16 strings and arrays,
 * packets that begin with their length and type.
 *
 * A writer that has no room left, or a reader that has no bytes left, says so in
 * `bad` and does nothing more: callers look at it once, at the end.
 */
#ifndef PTPIP_WIRE_H
#define PTPIP_WIRE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define PTPIP_PACKET_MAX 65600 /* 64 KiB of data and a header: what the camera sends and accepts */

enum {
    PTPIP_INIT_COMMAND_REQUEST = 1,
    PTPIP_INIT_COMMAND_ACK = 2,
    PTPIP_INIT_EVENT_REQUEST = 3,
    PTPIP_INIT_EVENT_ACK = 4,
    PTPIP_INIT_FAIL = 5,
    PTPIP_REQUEST = 6,
    PTPIP_RESPONSE = 7,
    PTPIP_EVENT = 8,
    PTPIP_START_DATA = 9,
    PTPIP_DATA = 10,
    PTPIP_CANCEL = 11,
    PTPIP_END_DATA = 12,
    PTPIP_PROBE_REQUEST = 13,
    PTPIP_PROBE_RESPONSE = 14
};

typedef struct ptpip_writer {
    uint8_t *data;
    size_t size, capacity;
    bool bad;
} ptpip_writer;

void ptpip_put8(ptpip_writer *w, unsigned value);
void ptpip_put16(ptpip_writer *w, unsigned value);
void ptpip_put32(ptpip_writer *w, uint32_t value);
void ptpip_put_bytes(ptpip_writer *w, const void *data, size_t size);
void ptpip_put_string(ptpip_writer *w, const char *ascii); /* PTP: one byte that counts, with the final zero */
void ptpip_put_array16(ptpip_writer *w, const uint16_t *values, size_t count);

typedef struct ptpip_reader {
    const uint8_t *data;
    size_t size, at;
    bool bad;
} ptpip_reader;

unsigned ptpip_get8(ptpip_reader *r);
unsigned ptpip_get16(ptpip_reader *r);
uint32_t ptpip_get32(ptpip_reader *r);

/* Sends all, or gives up after two seconds without progress; false then, and when the other side is gone. */
bool ptpip_send(int fd, const void *data, size_t size);

/* A packet of `type` with what follows its header. */
bool ptpip_send_packet(int fd, uint32_t type, const void *payload, size_t size);

/* One packet into `payload`, which has room for PTPIP_PACKET_MAX bytes. False: the other side is gone, has sent nothing
 * for two seconds in the middle of a packet, or claims a length that no packet has (*oversized). */
bool ptpip_receive_packet(int fd, uint32_t *type, uint8_t *payload, size_t *size, bool *oversized);

#endif
