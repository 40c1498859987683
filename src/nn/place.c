/* SPDX-License-Identifier: Apache-2.0 */
/*
 * place.c: lets buffers that never live at once share memory. The largest is placed
 * first; each goes into the smallest gap that is wide enough between those that
 * live at the same time, or else after them.
 */
#include <stdlib.h>

#include "nn/graph.h"

static int by_size(const void *a, const void *b) {
    const nn_buffer *x = *(nn_buffer *const *)a, *y = *(nn_buffer *const *)b;
    if (x->bytes != y->bytes) {
        return x->bytes > y->bytes ? -1 : 1;
    }
    return x < y ? -1 : 1; /* the same order everywhere */
}

/* Where `b` goes among those placed, which are in the order of their offsets. */
static size_t find_gap(const nn_buffer *b, nn_buffer *const *placed, size_t count) {
    size_t end = 0, best = 0, best_width = SIZE_MAX; /* end: of what was passed so far */
    for (size_t i = 0; i < count; i++) {
        const nn_buffer *p = placed[i];
        if (p->last < b->first || b->last < p->first) {
            continue;
        }
        if (p->offset >= end + b->bytes && p->offset - end < best_width) {
            best = end;
            best_width = p->offset - end;
        }
        if (p->offset + p->bytes > end) {
            end = p->offset + p->bytes;
        }
    }
    return best_width < SIZE_MAX ? best : end;
}

size_t nn_place(nn_buffer *buffers, int count, bool separate) {
    nn_buffer **order = core_alloc((size_t)count + 1, sizeof *order),
              **placed = core_alloc((size_t)count + 1, sizeof *placed);
    if (order == NULL || placed == NULL) {
        core_free((void *)order);
        core_free((void *)placed);
        return SIZE_MAX;
    }
    size_t n = 0, total = 0, done = 0;
    for (int i = 1; i <= count; i++) {
        if (buffers[i].same_as == 0) {
            order[n++] = &buffers[i];
        }
    }
    qsort((void *)order, n, sizeof *order, by_size);
    for (size_t i = 0; i < n; i++) {
        nn_buffer *b = order[i];
        b->offset = separate ? total : find_gap(b, placed, done);
        size_t at = done++;
        for (; at > 0 && placed[at - 1]->offset > b->offset; at--) {
            placed[at] = placed[at - 1];
        }
        placed[at] = b;
        if (b->offset + b->bytes > total) {
            total = b->offset + b->bytes;
        }
    }
    core_free((void *)order);
    core_free((void *)placed);
    return total;
}
