/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pool.c: a fixed set of threads that share out the pieces of a range.
 *
 * The caller works too, as worker 0. Pieces are dealt from one atomic counter,
 * so a slow piece holds up nobody. Every piece, whoever runs it, runs with
 * denormal numbers flushed to zero: they slow float kernels a hundredfold, and a
 * result must not depend on which thread computed it.
 */
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <string.h>
#include <unistd.h>

#if defined(__SSE2__)
#include <immintrin.h>
#endif

#include "core/core.h"

#define MAX_THREADS 256

typedef struct pool_worker {
    core_pool *pool;
    pthread_t thread;
    int index;
} pool_worker;

struct core_pool {
    pthread_mutex_t busy; /* held for the length of one core_parallel */
    pthread_mutex_t lock; /* guards what follows, but for `next` */
    pthread_cond_t wake, idle;
    pool_worker *workers;
    int threads; /* including the caller */
    int running; /* workers that have not finished the present range */
    uint64_t generation;
    bool stop;

    core_range_fn *fn;
    void *arg;
    size_t count, grain;
    atomic_size_t next; /* the next piece, in units of `grain` */
};

static _Thread_local bool inside_piece;

unsigned core_denormals_off(void) {
#if defined(__SSE2__)
    unsigned old = _mm_getcsr();
    _mm_setcsr(old | 0x8040u); /* FTZ is bit 15, DAZ bit 6 */
    return old;
#else
    return 0;
#endif
}

void core_denormals_restore(unsigned old) {
#if defined(__SSE2__)
    _mm_setcsr(old);
#else
    (void)old;
#endif
}

int core_cpu_count(void) {
    cpu_set_t set;
    CPU_ZERO(&set);
    long n = 0;
    if (sched_getaffinity(0, sizeof set, &set) == 0) {
        n = CPU_COUNT(&set);
    } else { /* more than 1024 CPUs */
        n = sysconf(_SC_NPROCESSORS_ONLN);
    }
    return n < 1 ? 1 : n > MAX_THREADS ? MAX_THREADS : (int)n;
}

static void run_pieces(core_pool *pool, int worker) {
    size_t pieces = (pool->count - 1) / pool->grain + 1;
    for (;;) {
        size_t i = atomic_fetch_add_explicit(&pool->next, 1, memory_order_relaxed);
        if (i >= pieces) {
            return;
        }
        size_t begin = i * pool->grain;
        size_t end = pool->count - begin > pool->grain ? begin + pool->grain : pool->count;
        pool->fn(pool->arg, begin, end, worker);
    }
}

static void *worker_main(void *arg) {
    pool_worker *self = arg;
    core_pool *pool = self->pool;
    uint64_t seen = 0;
    core_denormals_off();
    inside_piece = true;
    pthread_mutex_lock(&pool->lock);
    for (;;) {
        while (!pool->stop && pool->generation == seen) {
            pthread_cond_wait(&pool->wake, &pool->lock);
        }
        if (pool->stop) {
            break;
        }
        seen = pool->generation;
        pthread_mutex_unlock(&pool->lock);
        run_pieces(pool, self->index);
        pthread_mutex_lock(&pool->lock);
        if (--pool->running == 0) {
            pthread_cond_signal(&pool->idle);
        }
    }
    pthread_mutex_unlock(&pool->lock);
    return NULL;
}

brace_status core_pool_create(core_pool **out, const brace_job *job, brace_error *error) {
    *out = NULL;
    int threads = job != NULL ? job->threads : 0;
    if (threads < 0 || threads > MAX_THREADS) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "number of threads is %d; 1 to %d can be used, or 0 for all CPUs",
                         threads, MAX_THREADS);
    }
    if (threads == 0) {
        threads = core_cpu_count();
    }
    core_pool *pool = core_calloc(1, sizeof *pool);
    if (pool == NULL) {
        return core_fail_memory(error, sizeof *pool, "the thread pool");
    }
    pool->workers = core_calloc((size_t)threads, sizeof *pool->workers);
    if (pool->workers == NULL) {
        core_free(pool);
        return core_fail_memory(error, (size_t)threads * sizeof *pool->workers, "the thread pool");
    }
    pthread_mutex_init(&pool->busy, NULL);
    pthread_mutex_init(&pool->lock, NULL);
    pthread_cond_init(&pool->wake, NULL);
    pthread_cond_init(&pool->idle, NULL);
    pool->threads = 1;

    /* Signals belong to the program's own threads: a handler never runs in a worker. */
    sigset_t all, old;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &old);
    for (int i = 1; i < threads; i++) {
        pool_worker *w = &pool->workers[pool->threads];
        w->pool = pool;
        w->index = pool->threads;
        /* Where the system gives no more threads, those there are must do. */
        if (pthread_create(&w->thread, NULL, worker_main, w) != 0) {
            break;
        }
        pool->threads++;
    }
    pthread_sigmask(SIG_SETMASK, &old, NULL);
    *out = pool;
    return BRACE_OK;
}

void core_pool_destroy(core_pool *pool) {
    if (pool == NULL) {
        return;
    }
    pthread_mutex_lock(&pool->lock);
    pool->stop = true;
    pthread_cond_broadcast(&pool->wake);
    pthread_mutex_unlock(&pool->lock);
    for (int i = 1; i < pool->threads; i++) {
        pthread_join(pool->workers[i].thread, NULL);
    }
    pthread_cond_destroy(&pool->idle);
    pthread_cond_destroy(&pool->wake);
    pthread_mutex_destroy(&pool->lock);
    pthread_mutex_destroy(&pool->busy);
    core_free(pool->workers);
    core_free(pool);
}

int core_pool_threads(const core_pool *pool) {
    return pool != NULL ? pool->threads : 1;
}

static void run_alone(size_t count, size_t grain, core_range_fn *fn, void *arg) {
    for (size_t begin = 0; begin < count;) {
        size_t end = count - begin > grain ? begin + grain : count;
        fn(arg, begin, end, 0);
        begin = end;
    }
}

void core_parallel(core_pool *pool, size_t count, size_t grain, core_range_fn *fn, void *arg) {
    if (count == 0) {
        return;
    }
    if (grain == 0) {
        grain = 1;
    }
    unsigned old = core_denormals_off();
    if (pool == NULL || pool->threads == 1 || inside_piece || count <= grain) {
        /* From inside a piece the workers are busy with that very range: waiting for them would be for ever. */
        run_alone(count, grain, fn, arg);
        core_denormals_restore(old);
        return;
    }
    pthread_mutex_lock(&pool->busy);
    pthread_mutex_lock(&pool->lock);
    pool->fn = fn;
    pool->arg = arg;
    pool->count = count;
    pool->grain = grain;
    atomic_store(&pool->next, 0);
    pool->running = pool->threads - 1;
    pool->generation++;
    pthread_cond_broadcast(&pool->wake);
    pthread_mutex_unlock(&pool->lock);

    inside_piece = true;
    run_pieces(pool, 0);
    inside_piece = false;

    pthread_mutex_lock(&pool->lock);
    while (pool->running > 0) {
        pthread_cond_wait(&pool->idle, &pool->lock);
    }
    pthread_mutex_unlock(&pool->lock);
    pthread_mutex_unlock(&pool->busy);
    core_denormals_restore(old);
}
