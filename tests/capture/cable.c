/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cable.c: stands for the cable between phone and computer, and can be pulled.
 *
 *   cable PHONE_PORT [FAULT...]
 *
 * prints the port on 127.0.0.1 that it listens on and hands on what it gets, one
 * connection at a time. The first FAULT is for the first connection, and so on;
 * those after the last are sound. N counts bytes from the phone to the computer:
 *
 *   none      sound
 *   cut=N     closed after N bytes
 *   stall=N   nothing more comes after N bytes, until the computer closes
 *   flip=N    a bit of byte N is changed
 */
#include <netinet/in.h>
#include <poll.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

static int make_socket(uint16_t *port, bool listening) {
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons(*port)};
    socklen_t size = sizeof address;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const struct sockaddr *a = (const struct sockaddr *)&address;
    if (fd < 0 || (listening ? bind(fd, a, sizeof address) : connect(fd, a, sizeof address)) != 0 ||
        (listening && (listen(fd, 4) != 0 || getsockname(fd, (struct sockaddr *)&address, &size) != 0))) {
        if (fd >= 0) {
            close(fd);
        }
        return -1;
    }
    *port = ntohs(address.sin_port);
    return fd;
}

static bool send_all(int fd, const uint8_t *bytes, size_t size) {
    for (size_t done = 0; done < size;) {
        const ssize_t n = send(fd, bytes + done, size - done, MSG_NOSIGNAL);
        if (n <= 0) {
            return false;
        }
        done += (size_t)n;
    }
    return true;
}

/* One connection, until either end closes or the fault closes both. */
static void serve(int computer, int phone, const char *fault) {
    static uint8_t buffer[65536];
    const char *number = fault != NULL ? strchr(fault, '=') : NULL;
    const uint64_t at = number != NULL ? strtoull(number + 1, NULL, 10) : UINT64_MAX;
    const char kind = fault != NULL ? fault[0] : 'n';
    uint64_t count = 0;
    bool stalled = false;
    for (;;) {
        struct pollfd p[2] = {{.fd = computer, .events = POLLIN}, {.fd = stalled ? -1 : phone, .events = POLLIN}};
        if (poll(p, 2, -1) < 0) {
            return;
        }
        if (p[0].revents != 0) {
            const ssize_t n = recv(computer, buffer, sizeof buffer, 0);
            if (n <= 0 || !send_all(phone, buffer, (size_t)n)) {
                return;
            }
        }
        if (!stalled && p[1].revents != 0) {
            const ssize_t got = recv(phone, buffer, sizeof buffer, 0);
            if (got <= 0) {
                return;
            }
            size_t n = (size_t)got;
            if (at >= count && at < count + n) {
                if (kind == 'f') {
                    buffer[at - count] ^= 0x10;
                } else {
                    n = (size_t)(at - count);
                    stalled = true;
                }
            }
            if (!send_all(computer, buffer, n) || (stalled && kind == 'c')) {
                return;
            }
            count += (uint64_t)got;
        }
    }
}

int main(int argc, char **argv) {
    uint16_t port = 0, phone_port = (uint16_t)(argc > 1 ? atoi(argv[1]) : 0);
    const int listener = make_socket(&port, true);
    if (listener < 0 || phone_port == 0) {
        fprintf(stderr, "usage: cable PHONE_PORT [FAULT...]\n");
        return 2;
    }
    printf("listening on 127.0.0.1:%u\n", port);
    fflush(stdout);
    for (int next = 2;; next++) {
        const int computer = accept(listener, NULL, NULL);
        const int phone = make_socket(&phone_port, false);
        if (computer >= 0 && phone >= 0) {
            serve(computer, phone, next < argc ? argv[next] : NULL);
        }
        if (computer >= 0) {
            close(computer);
        }
        if (phone >= 0) {
            close(phone);
        }
    }
}
