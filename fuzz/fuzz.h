/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz.h: gives the readers, which take names, a file in memory.
 */
#ifndef FUZZ_FUZZ_H
#define FUZZ_FUZZ_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

/* Limits of the readers themselves are generous (400 megapixels). Fuzzing
 * learns nothing from gigabytes of zeros, so targets skip what is larger than this. */
enum { FUZZ_PIXELS = 1 << 22 };

/* The bytes as text of exactly this size, so that a byte too far is seen; to be freed; NULL: memory ended. */
static inline char *fuzz_text(const uint8_t *data, size_t size) {
    char *text = malloc(size + 1);
    if (text != NULL) {
        memcpy(text, data, size);
        text[size] = '\0';
    }
    return text;
}

/* Puts the bytes into a file, its name into `path`; the descriptor, to be closed, or -1. */
static inline int fuzz_file(const uint8_t *data, size_t size, char path[64]) {
    int fd = memfd_create("fuzz", MFD_CLOEXEC);
    if (fd < 0) {
        return -1;
    }
    for (size_t done = 0; done < size;) {
        ssize_t n = write(fd, data + done, size - done);
        if (n <= 0) {
            close(fd);
            return -1;
        }
        done += (size_t)n;
    }
    snprintf(path, 64, "/proc/self/fd/%d", fd);
    return fd;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#endif
