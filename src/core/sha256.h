/* SPDX-License-Identifier: Apache-2.0 */
/* sha256.h: the hash that sha256sum(1) prints (FIPS 180-4): what a data set's files are known by. */
#ifndef CORE_SHA256_H
#define CORE_SHA256_H

#include "core/core.h"

typedef struct core_sha256 {
    uint32_t state[8];
    uint64_t length;
    unsigned char block[64];
    bool ni; /* with the processor's own instructions */
} core_sha256;

void core_sha256_begin(core_sha256 *hash);
void core_sha256_add(core_sha256 *hash, const void *data, size_t size);
void core_sha256_end(core_sha256 *hash, char hex[65]); /* terminated */

/* Of a whole file. */
brace_status core_sha256_file(char hex[65], const char *path, uint64_t *size, brace_error *error);

/* The round constants, and many blocks at once where core_cpu_features().sha (sha256_ni.c). */
extern const uint32_t core_sha256_k[64];
void core_sha256_blocks_ni(uint32_t state[8], const unsigned char *p, size_t blocks);

#endif
