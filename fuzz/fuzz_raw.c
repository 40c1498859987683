/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_raw.c: libFuzzer target for the RAW reader: the tag walker alone, then a
 * whole frame from bytes, and the frame out again as DNG.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "raw/raw.h"

#include "fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    brace_tags *tags = NULL;
    if (raw_tags_read(&tags, data, size, NULL) == BRACE_OK && tags != NULL) {
        raw_tags_keep_portable(tags, size % 2 == 0);
        raw_tags_destroy(tags);
    }
    uint8_t *copy = malloc(size > 0 ? size : 1);
    if (copy == NULL) {
        return 0;
    }
    memcpy(copy, data, size);
    brace_frame *frame = NULL;
    if (raw_frame_read_memory(&frame, copy, size, "fuzz", NULL, NULL) == BRACE_OK) {
        void *out = NULL;
        size_t n = 0;
        brace_dng_params params = {.no_preview = true};
        if (raw_dng_encode(&out, &n, frame, &params, NULL, "fuzz", NULL) == BRACE_OK) {
            core_free(out);
        }
        brace_frame_destroy(frame);
    }
    free(copy);
    return 0;
}
