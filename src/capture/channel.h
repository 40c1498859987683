/* SPDX-License-Identifier: Apache-2.0 */
/*
 * channel.h: messages of protocol.h over a stream socket, with a time limit on
 * everything that is waited for. Used at both ends; C11 and POSIX only.
 *
 * Thread safety: a channel is used by one thread at a time.
 */
#ifndef CAPTURE_CHANNEL_H
#define CAPTURE_CHANNEL_H

#include "protocol.h"

typedef enum capture_channel_result {
    CAPTURE_CHANNEL_OK,
    CAPTURE_CHANNEL_TIMEOUT, /* nothing, or not all of a message, within the time */
    CAPTURE_CHANNEL_CLOSED,  /* the other end closed, or the connection broke */
    CAPTURE_CHANNEL_BAD,     /* it sent what is no message, or a message that was to be sent is none */
    CAPTURE_CHANNEL_STOPPED  /* `stopped` said so */
} capture_channel_result;

typedef struct capture_channel {
    int fd;                        /* -1: none */
    int patience;                  /* milliseconds that a message may take once it has begun, either way */
    bool (*stopped)(void *user);   /* asked at least ten times a second while waiting; NULL: never */
    void *user;
    char why[160];                 /* after anything but OK: half a sentence, "the connection was closed" */
    size_t have;                   /* bytes of the message that is in `in` */
    bool given;                    /* it was complete, and given out */
    uint8_t in[CAPTURE_WIRE_MESSAGE], out[CAPTURE_WIRE_MESSAGE];
} capture_channel;

/* Takes over a connected socket, which becomes non-blocking. Half a megabyte: belongs on the heap. */
void capture_channel_begin(capture_channel *channel, int fd, int patience);

/* Closes the socket. May be called twice. */
void capture_channel_end(capture_channel *channel);

capture_channel_result capture_channel_send(capture_channel *channel, const capture_message *message);

/* The next message, which must begin within `wait` milliseconds. DATA's bytes are good until the next call. */
capture_channel_result capture_channel_receive(capture_channel *channel, capture_message *message, int wait);

#endif
