/* SPDX-License-Identifier: Apache-2.0 */
/*
 * core.h: what every other module stands on: errors, memory, threads, random
 * numbers and files. Internal; the public half is in include/brace/.
 */
#ifndef CORE_CORE_H
#define CORE_CORE_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "brace/job.h"
#include "brace/status.h"

/* ---- errors (error.c) ---- */

/* Fills `error` (which may be NULL) and returns `status`: return core_fail(error, BRACE_ERROR_IO, "...", ...). */
brace_status core_fail(brace_error *error, brace_status status, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Puts "prefix: " before an error's message. */
void core_error_prefix(brace_error *error, const char *prefix);

/* BRACE_ERROR_MEMORY with the number of bytes that were wanted for `what`. */
brace_status core_fail_memory(brace_error *error, size_t bytes, const char *what);

/* Sends a remark to the job's note callback, if there is one. */
void core_note(const brace_job *job, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Reports progress, if wanted. */
void core_progress(const brace_job *job, const char *stage, uint64_t done, uint64_t total);

/* True once the job was cancelled. */
bool core_cancelled(const brace_job *job);

/* Cancelled, or out of memory: an end that says nothing about what was looked at. */
static inline bool core_gave_up(brace_status status) {
    return status == BRACE_ERROR_CANCELLED || status == BRACE_ERROR_MEMORY;
}

/* BRACE_ERROR_CANCELLED with its sentence, or BRACE_OK. */
brace_status core_check_cancel(const brace_job *job, brace_error *error);

/* ---- memory (memory.c) ---- */

/* count*size bytes aligned to 64, zeroed or not; NULL when that overflows or memory ends.
 * Freed with core_free. */
void *core_alloc(size_t count, size_t size);
void *core_calloc(size_t count, size_t size);
void core_free(void *p);
char *core_strdup(const char *s);

/* Tests make the n-th allocation from now fail (0: never). For one thread at a time. */
void core_alloc_fail_after(long n);

/* An arena hands out memory that is freed all at once. */
typedef struct core_arena core_arena;
core_arena *core_arena_create(size_t block);
void *core_arena_alloc(core_arena *arena, size_t count, size_t size); /* zeroed, aligned to 64; NULL on failure */
void core_arena_reset(core_arena *arena);                           /* forgets all, keeps the memory */
void core_arena_destroy(core_arena *arena);                         /* NULL is allowed */

/* ---- threads (pool.c) ---- */

typedef struct core_pool core_pool;

/* A pool with job->threads workers (the caller counts as one). */
brace_status core_pool_create(core_pool **out, const brace_job *job, brace_error *error);
void core_pool_destroy(core_pool *pool); /* NULL is allowed */
int core_pool_threads(const core_pool *pool); /* 1 for NULL */

/* Calls fn(arg, begin, end, worker) until [0, count) is covered in pieces of at most
 * `grain`; pieces are dealt out in order, as workers come free. A NULL pool runs
 * all in the caller. Which worker gets a piece varies; results must not depend on it.
 * Returns when all pieces are done. Not reentrant from inside fn. */
typedef void core_range_fn(void *arg, size_t begin, size_t end, int worker);
void core_parallel(core_pool *pool, size_t count, size_t grain, core_range_fn *fn, void *arg);

int core_cpu_count(void); /* online CPUs this process may use */

/* Denormal floats count as zero in this thread until it is undone: they slow arithmetic a hundredfold. Workers of a
 * pool run like this always. */
unsigned core_denormals_off(void);
void core_denormals_restore(unsigned before);

/* ---- counter-based random numbers (random.c) ---- */

/* Philox4x32-10 (Salmon, Moraes, Dror, Shaw: Parallel Random Numbers: As Easy as
 * 1, 2, 3; SC 2011): four 32-bit words from a 128-bit counter and a 64-bit key. */
void core_philox(const uint32_t counter[4], const uint32_t key[2], uint32_t out[4]);

/* A stream of numbers keyed by seed and a path (sample, frame, purpose, ...). */
typedef struct core_random {
    uint32_t key[2], counter[4], buffer[4];
    unsigned used;
} core_random;
core_random core_random_create(uint64_t seed, uint32_t a, uint32_t b, uint32_t c);
uint32_t core_random_u32(core_random *r);
double core_random_uniform(core_random *r);                             /* [0, 1), 53 bits */
double core_random_range(core_random *r, double low, double high);      /* [low, high) */
uint32_t core_random_below(core_random *r, uint32_t n);                 /* 0 .. n-1, unbiased */
double core_random_normal(core_random *r);                              /* mean 0, deviation 1 */

/* ---- files (file.c) ---- */

/* A file that appears under its name only when it is complete: written as a
 * temporary in the same folder, synced, renamed. Special files (/dev/full, pipes)
 * are written in place. The temporary is removed on abort, and by
 * core_files_abort_all from a signal handler. */
typedef struct core_file core_file;
brace_status core_file_create(core_file **out, const char *path, brace_error *error);
FILE *core_file_stream(core_file *file); /* readable, writable, seekable */
const char *core_file_temporary(const core_file *file); /* name for libraries that open files themselves */
brace_status core_file_commit(core_file *file, brace_error *error); /* frees `file` in either case */
/* The same without waiting for the disk, which is asked to begin: a caller who writes many files syncs them at the
 * end, with core_folder_sync, before it gives their folder its name. */
brace_status core_file_commit_unsynced(core_file *file, brace_error *error);
brace_status core_folder_sync(const char *path, brace_error *error); /* the files in a folder, and the folder */
void core_file_abort(core_file *file);                               /* frees `file`; NULL is allowed */
void core_files_abort_all(void); /* async-signal-safe */

/* The whole of a regular file, at most `limit` bytes. Freed with core_free. */
brace_status core_file_load(void **data, size_t *size, const char *path, size_t limit, brace_error *error);

/* The same mapped, not read: for large files that are not kept whole. "no WHAT" is said of what is not a regular file
 * of `least` bytes or more. The file must not shrink while it is mapped. */
brace_status core_file_map(void **data, size_t *size, const char *path, size_t least, const char *what,
                           brace_error *error);
void core_file_unmap(void *data, size_t size);

double core_seconds(void); /* monotonic clock */

/* ---- CPU (cpu.c) ---- */
typedef struct core_cpu {
    bool avx2, avx512, f16c; /* avx2 implies fma; avx512 is F, BW, DQ, VL */
    bool sha;                /* with SSE 4.1 */
} core_cpu;
/* What may be used: CPUID and the operating system, lowered by BRACE_CPU=plain|avx2|avx512. */
core_cpu core_cpu_features(void);

#endif
