/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_protocol.c: libFuzzer target for the messages between phone and computer. A
 * message that is taken must say the same when it is written again. Each input is
 * tried as it is and with its checksum put right, which no fuzzer finds by itself.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "capture/protocol.h"

#include "fuzz.h"

static void try_bytes(const uint8_t *bytes, size_t size) {
    static uint8_t again[CAPTURE_WIRE_MESSAGE];
    capture_message m;
    size_t used = 0;
    const char *why = NULL;
    switch (capture_message_parse(&m, bytes, size, &used, &why)) {
    case CAPTURE_WIRE_OK:
        if (used > size || capture_message_write(&m, again, sizeof again) != used || memcmp(again, bytes, used) != 0) {
            abort();
        }
        break;
    case CAPTURE_WIRE_MORE:
        if (used <= size || used > CAPTURE_WIRE_MESSAGE) {
            abort();
        }
        break;
    case CAPTURE_WIRE_BAD:
        if (used != 0 || why[0] == '\0') {
            abort();
        }
        break;
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    uint8_t *copy = malloc(size > 0 ? size : 1); /* of exactly this size, so that a byte too far is seen */
    if (copy == NULL) {
        return 0;
    }
    if (size > 0) {
        memcpy(copy, data, size);
    }
    try_bytes(copy, size);
    if (size >= CAPTURE_WIRE_HEADER) {
        uint32_t length = 0;
        memcpy(&length, copy + 12, 4);
        if (length <= size - CAPTURE_WIRE_HEADER) {
            const uint32_t sum = (uint32_t)crc32(crc32(0, copy, 16), copy + CAPTURE_WIRE_HEADER, length);
            memcpy(copy + 16, &sum, 4);
            try_bytes(copy, size);
        }
    }
    free(copy);
    return 0;
}
