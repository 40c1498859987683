/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cpu.c: which vector instructions may be used here and now. The compiler's
 * built-in test reads CPUID and asks XGETBV whether the system saves the wide registers.
 */
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#if defined(__x86_64__) || defined(__i386__)
#include <cpuid.h>
#endif

#include "core/core.h"

enum { SEEN = 1, AVX2 = 2, AVX512 = 4, SHA = 8 };

/* CPUID takes as long as thousands of multiplications where a hypervisor answers it: it is asked once. */
static unsigned asked(void) {
    unsigned has = SEEN;
#if defined(__x86_64__) || defined(__i386__)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
        has |= AVX2;
        if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
            __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl")) {
            has |= AVX512;
        }
    }
    unsigned a, b, c, d;
    /* Leaf 7, EBX bit 29; no compiler of before 2021 knows its name. */
    if (__builtin_cpu_supports("sse4.1") && __get_cpuid_count(7, 0, &a, &b, &c, &d) && (b >> 29 & 1)) {
        has |= SHA;
    }
#endif
    return has;
}

core_cpu core_cpu_features(void) {
    static atomic_uint answer;
    unsigned has = atomic_load_explicit(&answer, memory_order_relaxed);
    if (has == 0) { /* two threads may both ask, and are told the same */
        has = asked();
        atomic_store_explicit(&answer, has, memory_order_relaxed);
    }
    /* Every AVX2 processor has F16C, and older compilers do not know its name. */
    core_cpu cpu = {.avx2 = (has & AVX2) != 0, .avx512 = (has & AVX512) != 0, .f16c = (has & AVX2) != 0,
                    .sha = (has & SHA) != 0};
    const char *limit = getenv("BRACE_CPU"); /* tests and benches change it */
    if (limit != NULL) {
        if (strcmp(limit, "plain") == 0) {
            cpu.avx2 = cpu.avx512 = cpu.f16c = cpu.sha = false;
        } else if (strcmp(limit, "avx2") == 0) {
            cpu.avx512 = false;
        }
    }
    return cpu;
}
