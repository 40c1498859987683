/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_safetensors.c: libFuzzer target for the reader of safetensors files: the
 * header, and that every byte it promises can be read.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "core/safetensors.h"

#include "fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    uint8_t *copy = malloc(size > 0 ? size : 1); /* of exactly this size, so that a byte too far is seen */
    if (copy == NULL) {
        return 0;
    }
    if (size > 0) {
        memcpy(copy, data, size);
    }
    core_safetensors *file = NULL;
    if (core_safetensors_parse(&file, copy, size, "fuzz", NULL) == BRACE_OK) {
        unsigned sum = 0;
        for (size_t i = 0; i < core_safetensors_count(file); i++) {
            const core_tensor *t = core_safetensors_at(file, i);
            const uint8_t *p = t->data;
            for (size_t n = 0; n < t->size; n++) {
                sum += p[n];
            }
            if (core_safetensors_find(file, t->name) != t) {
                abort();
            }
        }
        const char *key;
        for (size_t i = 0; (key = core_safetensors_metadata_key(file, i)) != NULL; i++) {
            sum += core_safetensors_metadata(file, key) != NULL;
        }
        core_safetensors_close(file);
        if (sum == 0x7fffffff) { /* keeps the reads from being optimised away */
            abort();
        }
    }
    free(copy);
    return 0;
}
