/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cpu.c: which vector instructions may be used here and now. The compiler's
 * built-in test reads CPUID and asks XGETBV whether the system saves the wide registers.
 */
#include <stdlib.h>
#include <string.h>

#if defined(__x86_64__) || defined(__i386__)
#include <cpuid.h>
#endif

#include "core/core.h"

core_cpu core_cpu_features(void) {
    core_cpu cpu = {false, false, false, false};
#if defined(__x86_64__) || defined(__i386__)
    __builtin_cpu_init();
    cpu.avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    /* Every AVX2 processor has F16C, and older compilers do not know its name. */
    cpu.f16c = cpu.avx2;
    cpu.avx512 = cpu.avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                 __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
    unsigned a, b, c, d;
    /* Leaf 7, EBX bit 29; no compiler of before 2021 knows its name. */
    cpu.sha = __builtin_cpu_supports("sse4.1") && __get_cpuid_count(7, 0, &a, &b, &c, &d) && (b >> 29 & 1);
    const char *limit = getenv("BRACE_CPU");
    if (limit != NULL) {
        if (strcmp(limit, "plain") == 0) {
            cpu.avx2 = cpu.avx512 = cpu.f16c = cpu.sha = false;
        } else if (strcmp(limit, "avx2") == 0) {
            cpu.avx512 = false;
        }
    }
#endif
    return cpu;
}
