/* SPDX-License-Identifier: Apache-2.0 */
/* channel.c: see channel.h. */
#include "channel.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

static int64_t now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000 + t.tv_nsec / 1000000;
}

static capture_channel_result fail(capture_channel *c, capture_channel_result result, const char *why) {
    snprintf(c->why, sizeof c->why, "%s", why);
    return result;
}

void capture_channel_begin(capture_channel *channel, int fd, int patience) {
    channel->fd = fd;
    channel->patience = patience;
    channel->stopped = NULL;
    channel->user = NULL;
    channel->why[0] = '\0';
    channel->have = 0;
    channel->given = false;
    const int flags = fcntl(fd, F_GETFL);
    if (flags >= 0) {
        fcntl(fd, F_SETFL, flags | O_NONBLOCK);
    }
}

void capture_channel_end(capture_channel *channel) {
    if (channel->fd >= 0) {
        close(channel->fd);
        channel->fd = -1;
    }
}

/* Until the socket is ready for `events`, `deadline` has passed, or the caller was stopped. */
static capture_channel_result ready(capture_channel *c, short events, int64_t deadline) {
    for (;;) {
        if (c->stopped != NULL && c->stopped(c->user)) {
            return fail(c, CAPTURE_CHANNEL_STOPPED, "it was stopped");
        }
        const int64_t left = deadline - now();
        struct pollfd p = {.fd = c->fd, .events = events};
        const int n = poll(&p, 1, left < 0 ? 0 : left > 50 ? 50 : (int)left);
        if (n > 0) {
            return CAPTURE_CHANNEL_OK; /* errors too: the read or write that follows tells them */
        }
        if (n < 0 && errno != EINTR) {
            return fail(c, CAPTURE_CHANNEL_CLOSED, strerror(errno));
        }
        if (n == 0 && left <= 0) {
            return fail(c, CAPTURE_CHANNEL_TIMEOUT, "nothing came within the time allowed");
        }
    }
}

capture_channel_result capture_channel_send(capture_channel *channel, const capture_message *message) {
    if (channel->fd < 0) {
        return fail(channel, CAPTURE_CHANNEL_CLOSED, "the connection was closed");
    }
    const size_t length = capture_message_write(message, channel->out, sizeof channel->out);
    if (length == 0) {
        return fail(channel, CAPTURE_CHANNEL_BAD, "a message held a value that makes no sense");
    }
    const int64_t deadline = now() + channel->patience;
    for (size_t done = 0; done < length;) {
        const capture_channel_result result = ready(channel, POLLOUT, deadline);
        if (result != CAPTURE_CHANNEL_OK) {
            return result;
        }
        const ssize_t n = send(channel->fd, channel->out + done, length - done, MSG_NOSIGNAL);
        if (n >= 0) {
            done += (size_t)n;
        } else if (errno != EINTR && errno != EAGAIN) {
            return fail(channel, CAPTURE_CHANNEL_CLOSED, strerror(errno));
        }
    }
    return CAPTURE_CHANNEL_OK;
}

capture_channel_result capture_channel_receive(capture_channel *channel, capture_message *message, int wait) {
    if (channel->fd < 0) {
        return fail(channel, CAPTURE_CHANNEL_CLOSED, "the connection was closed");
    }
    if (channel->given) {
        channel->have = 0; /* never more than one message is read */
        channel->given = false;
    }
    int64_t deadline = now() + (channel->have > 0 ? channel->patience : wait);
    for (;;) {
        size_t used = 0;
        const char *why = "";
        switch (capture_message_parse(message, channel->in, channel->have, &used, &why)) {
        case CAPTURE_WIRE_OK:
            channel->given = true;
            return CAPTURE_CHANNEL_OK;
        case CAPTURE_WIRE_BAD:
            return fail(channel, CAPTURE_CHANNEL_BAD, why);
        case CAPTURE_WIRE_MORE:
            break;
        }
        const capture_channel_result result = ready(channel, POLLIN, deadline);
        if (result != CAPTURE_CHANNEL_OK) {
            return result;
        }
        const ssize_t n = recv(channel->fd, channel->in + channel->have, used - channel->have, 0);
        if (n == 0) {
            return fail(channel, CAPTURE_CHANNEL_CLOSED,
                        channel->have > 0 ? "the connection was closed in the middle of a message"
                                          : "the connection was closed");
        }
        if (n > 0) {
            if (channel->have == 0) {
                deadline = now() + channel->patience;
            }
            channel->have += (size_t)n;
        } else if (errno != EINTR && errno != EAGAIN) {
            return fail(channel, CAPTURE_CHANNEL_CLOSED, strerror(errno));
        }
    }
}
