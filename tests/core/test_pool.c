/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_pool.c: every piece runs exactly once, for any number of threads.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <pthread.h>
#include <stdatomic.h>

#include "core/core.h"

#define MOST 10007

typedef struct check {
    atomic_int hits[MOST];
    size_t grain;
    int threads;
    atomic_int wrong;
    core_pool *pool;
} check;

static void count_hits(void *arg, size_t begin, size_t end, int worker) {
    check *c = arg;
    if (begin >= end || end - begin > c->grain || begin % c->grain != 0 || worker < 0 || worker >= c->threads) {
        atomic_fetch_add(&c->wrong, 1);
    }
    for (size_t i = begin; i < end; i++) {
        atomic_fetch_add(&c->hits[i], 1);
    }
}

static void test_cover(void **state) {
    (void)state;
    static check c;
    static const size_t counts[] = {0, 1, 2, 63, 64, 1000, MOST}, grains[] = {1, 7, 64, 100000};
    for (int threads = 1; threads <= 8; threads = threads * 2 - (threads == 1 ? 0 : 1)) {
        core_pool *pool = NULL;
        brace_job job = {.threads = threads};
        assert_int_equal(core_pool_create(&pool, &job, NULL), BRACE_OK);
        c.threads = core_pool_threads(pool);
        assert_int_equal(c.threads, threads);
        for (size_t i = 0; i < 7; i++) {
            for (size_t g = 0; g < 4; g++) {
                memset(c.hits, 0, sizeof c.hits);
                c.grain = grains[g];
                core_parallel(pool, counts[i], grains[g], count_hits, &c);
                for (size_t k = 0; k < MOST; k++) {
                    assert_int_equal(c.hits[k], k < counts[i] ? 1 : 0);
                }
            }
        }
        assert_int_equal(c.wrong, 0);
        core_pool_destroy(pool);
        if (threads >= 5) {
            break;
        }
    }
    c.threads = 1;
    c.grain = 10;
    memset(c.hits, 0, sizeof c.hits);
    core_parallel(NULL, 95, 10, count_hits, &c);
    assert_int_equal(c.hits[94], 1);
    assert_int_equal(c.wrong, 0);
    assert_int_equal(core_pool_threads(NULL), 1);
}

static void nested(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    check *c = arg;
    static check inner[16];
    for (size_t i = begin; i < end; i++) {
        inner[i].grain = 3;
        inner[i].threads = 1;
        memset(inner[i].hits, 0, sizeof inner[i].hits);
        core_parallel(c->pool, 10, 3, count_hits, &inner[i]);
        for (int k = 0; k < 10; k++) {
            if (inner[i].hits[k] != 1 || inner[i].wrong != 0) {
                atomic_fetch_add(&c->wrong, 1);
            }
        }
    }
}

static void test_nested(void **state) {
    (void)state;
    static check c;
    brace_job job = {.threads = 3};
    assert_int_equal(core_pool_create(&c.pool, &job, NULL), BRACE_OK);
    core_parallel(c.pool, 16, 1, nested, &c);
    assert_int_equal(c.wrong, 0);
    core_pool_destroy(c.pool);
}

typedef struct user {
    core_pool *pool;
    atomic_long *sum;
} user;

static void add(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    atomic_fetch_add((atomic_long *)arg, (long)(end - begin));
}

static void *use_pool(void *arg) {
    user *u = arg;
    for (int i = 0; i < 200; i++) {
        core_parallel(u->pool, 100, 7, add, u->sum);
    }
    return NULL;
}

static void test_shared(void **state) {
    (void)state;
    core_pool *pool = NULL;
    brace_job job = {.threads = 4};
    assert_int_equal(core_pool_create(&pool, &job, NULL), BRACE_OK);
    atomic_long sum = 0;
    user u = {pool, &sum};
    pthread_t other;
    assert_int_equal(pthread_create(&other, NULL, use_pool, &u), 0);
    use_pool(&u);
    pthread_join(other, NULL);
    assert_int_equal(sum, 2 * 200 * 100);
    core_pool_destroy(pool);
}

static void halve(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    volatile float *p = arg;
    for (size_t i = begin; i < end; i++) {
        p[i] = p[i] * 0.5f;
    }
}

static void test_denormals(void **state) {
    (void)state;
#if defined(__SSE2__)
    brace_job job = {.threads = 3};
    core_pool *pool = NULL;
    assert_int_equal(core_pool_create(&pool, &job, NULL), BRACE_OK);
    static float p[1000];
    for (int pass = 0; pass < 2; pass++) {
        for (int i = 0; i < 1000; i++) {
            p[i] = 1.2e-38f;
        }
        core_parallel(pass == 0 ? pool : NULL, 1000, 10, halve, p);
        for (int i = 0; i < 1000; i++) {
            assert_true(p[i] == 0.0f);
        }
    }
    volatile float after = 1.2e-38f;
    after = after * 0.5f;
    assert_true(after > 0.0f); /* the caller's own arithmetic is as before */
    core_pool_destroy(pool);
#endif
}

static void test_arguments(void **state) {
    (void)state;
    core_pool *pool = NULL;
    brace_error error;
    brace_job job = {.threads = -1};
    assert_int_equal(core_pool_create(&pool, &job, &error), BRACE_ERROR_ARGUMENT);
    job.threads = 257;
    assert_int_equal(core_pool_create(&pool, &job, &error), BRACE_ERROR_ARGUMENT);
    assert_null(pool);
    for (long n = 1; n <= 2; n++) {
        core_alloc_fail_after(n);
        brace_status status = core_pool_create(&pool, NULL, &error);
        core_alloc_fail_after(0);
        assert_int_equal(status, BRACE_ERROR_MEMORY);
    }
    assert_int_equal(core_pool_create(&pool, NULL, &error), BRACE_OK);
    assert_true(core_pool_threads(pool) == core_cpu_count());
    core_pool_destroy(pool);
    core_pool_destroy(NULL);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cover),     cmocka_unit_test(test_nested),    cmocka_unit_test(test_shared),
        cmocka_unit_test(test_denormals), cmocka_unit_test(test_arguments),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
