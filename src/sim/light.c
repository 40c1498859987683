/* SPDX-License-Identifier: Apache-2.0 */
/*
 * light.c: chooses the kernel that computes the light of many samples. The
 * plain one is in display.c, beside the truth that it calls; the vectorised
 * ones are light_vector.h, compiled for each instruction set.
 */
#include "sim/display.h"

sim_light_fn *sim_light_kernel(const sim_panel *panel, core_cpu cpu) {
#if defined(__x86_64__)
    if (cpu.avx512)
        return sim_light_avx512(panel);
    if (cpu.avx2)
        return sim_light_avx2(panel);
#else
    (void)cpu;
#endif
    (void)panel;
    return sim_light_plain;
}
