/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_pth.c: libFuzzer target for the reader of PyTorch files: zip archives, old
 * files and pickles, and that every byte they promise can be read.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "nn/pickle.h"
#include "nn/pth.h"

#include "fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    uint8_t *copy = malloc(size > 0 ? size : 1); /* of exactly this size, so that a byte too far is seen */
    if (copy == NULL) {
        return 0;
    }
    if (size > 0) {
        memcpy(copy, data, size);
    }
    nn_pth *file = NULL;
    nn_pickle *pickle = NULL;
    size_t used = 0;
    if (nn_pth_parse(&file, copy, size, "fuzz", NULL) == BRACE_OK) {
        unsigned sum = 0;
        for (size_t i = 0; i < nn_pth_count(file); i++) {
            const core_tensor *t = nn_pth_at(file, i);
            const uint8_t *p = t->data;
            for (size_t n = 0; n < t->size; n++) {
                sum += p[n];
            }
            if (nn_pth_find(file, t->name) != t) {
                abort();
            }
        }
        nn_pth_close(file);
        if (sum == 0x7fffffff) { /* keeps the reads from being optimised away */
            abort();
        }
    } else if (nn_pickle_read(&pickle, &used, copy, size, "fuzz", NULL) == BRACE_OK) {
        if (used > size || nn_pickle_result(pickle) == NULL) {
            abort();
        }
        nn_pickle_destroy(pickle);
    }
    free(copy);
    return 0;
}
