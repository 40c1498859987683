/* SPDX-License-Identifier: Apache-2.0 */
/*
 * server.h: what the program on the phone does with the requests of one computer
 * at a time.
 */
#ifndef ANDROID_SERVER_H
#define ANDROID_SERVER_H

#include <stdio.h>

#include "../src/capture/channel.h"
#include "shim.h"

typedef struct server {
    shim *camera;
    int idle;                 /* milliseconds that a computer may be silent between two requests */
    int patience;             /* milliseconds that a message may take once it has begun */
    bool (*stopped)(void *user); /* asked often; NULL: never */
    void *user;
    FILE *log;                /* one line for each thing that happened; NULL: none */
} server;

/* Listens on the abstract socket `name`, which only processes of this device reach. -1: see errno. */
int server_listen_abstract(const char *name);

/* Listens on 127.0.0.1. *port 0 takes a free one, and is set. -1: see errno. */
int server_listen_loopback(uint16_t *port);

/* Serves one computer after another until `stopped`. False if accepting failed: see errno. */
bool server_run(const server *s, int listener);

/* Serves a connected socket until either end has enough of it, and closes it. */
void server_serve(const server *s, int fd);

#endif
