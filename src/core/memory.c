/* SPDX-License-Identifier: Apache-2.0 */
/*
 * memory.c: allocation that checks its sizes, can be made to fail by tests,
 * and is aligned for the widest vectors; and arenas.
 */
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "core/core.h"

#define ALIGNMENT 64u /* a cache line, and an AVX-512 register */

static atomic_long fail_countdown; /* 1: the next allocation fails; 0: none does */

void core_alloc_fail_after(long n) {
    atomic_store(&fail_countdown, n > 0 ? n : 0);
}

static bool injected_failure(void) {
    if (atomic_load_explicit(&fail_countdown, memory_order_relaxed) == 0) {
        return false;
    }
    return atomic_fetch_sub(&fail_countdown, 1) == 1;
}

static void *aligned(size_t count, size_t size, size_t *bytes) {
    size_t n = 0;
    if (__builtin_mul_overflow(count, size, &n) || n > (size_t)PTRDIFF_MAX - ALIGNMENT || injected_failure()) {
        return NULL;
    }
    void *p = NULL;
    if (posix_memalign(&p, ALIGNMENT, n == 0 ? 1 : n) != 0) {
        return NULL;
    }
    *bytes = n;
    return p;
}

void *core_alloc(size_t count, size_t size) {
    size_t n = 0;
    return aligned(count, size, &n);
}

void *core_calloc(size_t count, size_t size) {
    size_t n = 0;
    void *p = aligned(count, size, &n);
    if (p != NULL) {
        memset(p, 0, n);
    }
    return p;
}

void core_free(void *p) {
    free(p);
}

char *core_strdup(const char *s) {
    size_t n = strlen(s) + 1;
    char *copy = core_alloc(n, 1);
    if (copy != NULL) {
        memcpy(copy, s, n);
    }
    return copy;
}

/* ---- arenas ---- */

typedef struct arena_block {
    struct arena_block *next;
    size_t size, used;
    unsigned char *data;
} arena_block;

struct core_arena {
    size_t block;
    arena_block *first, *current; /* blocks before `current` are full, those after it empty */
};

core_arena *core_arena_create(size_t block) {
    core_arena *arena = core_calloc(1, sizeof *arena);
    if (arena != NULL) {
        arena->block = block < 4096 ? 4096 : block;
    }
    return arena;
}

static arena_block *new_block(size_t size) {
    arena_block *b = core_calloc(1, sizeof *b);
    if (b == NULL) {
        return NULL;
    }
    b->data = core_alloc(size, 1);
    if (b->data == NULL) {
        core_free(b);
        return NULL;
    }
    b->size = size;
    return b;
}

void *core_arena_alloc(core_arena *arena, size_t count, size_t size) {
    size_t n = 0;
    if (__builtin_mul_overflow(count, size, &n) || n > (size_t)PTRDIFF_MAX - ALIGNMENT) {
        return NULL;
    }
    n = (n + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
    if (n == 0) {
        n = ALIGNMENT;
    }
    arena_block *b = arena->current;
    while (b != NULL && b->size - b->used < n && b->next != NULL) {
        b = b->next;
    }
    if (b == NULL || b->size - b->used < n) {
        arena_block *fresh = new_block(n > arena->block ? n : arena->block);
        if (fresh == NULL) {
            return NULL;
        }
        if (b == NULL) {
            arena->first = fresh;
        } else {
            b->next = fresh;
        }
        b = fresh;
    }
    arena->current = b;
    void *p = b->data + b->used;
    b->used += n;
    memset(p, 0, n);
    return p;
}

void core_arena_reset(core_arena *arena) {
    for (arena_block *b = arena->first; b != NULL; b = b->next) {
        b->used = 0;
    }
    arena->current = arena->first;
}

void core_arena_destroy(core_arena *arena) {
    if (arena == NULL) {
        return;
    }
    for (arena_block *b = arena->first; b != NULL;) {
        arena_block *next = b->next;
        core_free(b->data);
        core_free(b);
        b = next;
    }
    core_free(arena);
}
