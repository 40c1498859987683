/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fabp_error.c: how the banding prior's frequency and direction degrade with the contrast of the stripes, with noise and
 * with texture: fabp_error [CASES].
 *
 * Stripes 1 + c cos of random frequency (6 to 60 periods), direction (within 25 degrees of the rows, as tilted displays
 * show them) and phase over a texture whose amplitude falls as 1/frequency, as that of pictures does; Gaussian noise.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "brace/brace.h"
#include "core/core.h"

enum { SIDE = 512, WAVES = 160 };

static int by_value(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

int main(int argc, char **argv) {
    const int cases = argc > 1 ? atoi(argv[1]) : 60;
    static const double contrasts[] = {0.5, 0.2, 0.1, 0.05, 0.02, 0.01};
    static const struct {
        double noise, texture;
    } beside[] = {{0, 0}, {0.05, 0}, {0.2, 0}, {0, 0.05}, {0, 0.2}, {0.05, 0.1}};
    float *plane = malloc(sizeof(float) * SIDE * SIDE), *texture = malloc(sizeof(float) * SIDE * SIDE);
    double *frequency = malloc(sizeof(double) * (size_t)cases), *angle = malloc(sizeof(double) * (size_t)cases);
    if (!plane || !texture || !frequency || !angle || cases < 1)
        return 1;
    printf("| contrast | noise | texture | frequency: median error | 95 %% | direction: median | 95 %% | found |\n"
           "|---:|---:|---:|---:|---:|---:|---:|---:|\n");
    for (size_t s = 0; s < sizeof beside / sizeof *beside; s++)
        for (size_t k = 0; k < sizeof contrasts / sizeof *contrasts; k++) {
            int found = 0;
            for (int n = 0; n < cases; n++) {
                core_random r = core_random_create(31, (uint32_t)n, (uint32_t)s, (uint32_t)k);
                const double cycles = exp(core_random_range(&r, log(6), log(60)));
                const double tilt = core_random_range(&r, -25, 25) * M_PI / 180, phase = core_random_range(&r, 0, 2 * M_PI);
                const double fx = cycles * sin(tilt) / SIDE, fy = cycles * cos(tilt) / SIDE;
                for (size_t i = 0; i < (size_t)SIDE * SIDE; i++)
                    texture[i] = 0;
                double power = 0;
                for (int w = 0; w < WAVES && beside[s].texture > 0; w++) {
                    const double f = exp(core_random_range(&r, log(1), log(150))), a = core_random_range(&r, 0, M_PI);
                    const double p = core_random_range(&r, 0, 2 * M_PI), u = f * cos(a) / SIDE, v = f * sin(a) / SIDE;
                    for (size_t y = 0; y < SIDE; y++) {
                        const double start = 2 * M_PI * v * (double)y + p, c = cos(2 * M_PI * u), d = sin(2 * M_PI * u);
                        double re = cos(start) / f, im = sin(start) / f;
                        for (size_t x = 0; x < SIDE; x++) {
                            texture[y * SIDE + x] += (float)re;
                            const double t = re * c - im * d;
                            im = re * d + im * c, re = t;
                        }
                    }
                    power += 0.5 / (f * f);
                }
                const double scale = power > 0 ? beside[s].texture / sqrt(power) : 0;
                for (size_t y = 0; y < SIDE; y++)
                    for (size_t x = 0; x < SIDE; x++) {
                        const double light = 1 + contrasts[k] * cos(2 * M_PI * (fx * (double)x + fy * (double)y) + phase);
                        plane[y * SIDE + x] = (float)(0.4 * light * (1 + scale * texture[y * SIDE + x]) +
                                                      0.4 * beside[s].noise * core_random_normal(&r));
                    }
                brace_fabp fabp;
                if (brace_fabp_plane(&fabp, plane, SIDE, SIDE, NULL, NULL, NULL) != BRACE_OK)
                    return 1;
                frequency[n] = 100 * fabs(fabp.refined_f * SIDE / cycles - 1);
                double off = fmod(fabs(fabp.refined_theta - (atan2(fy, fx) + M_PI / 2)), M_PI);
                off = off > M_PI / 2 ? M_PI - off : off;
                angle[n] = off * 180 / M_PI;
                found += frequency[n] < 5 && angle[n] < 5;
            }
            qsort(frequency, (size_t)cases, sizeof *frequency, by_value);
            qsort(angle, (size_t)cases, sizeof *angle, by_value);
            printf("| %g | %g | %g | %.3f %% | %.3f %% | %.3f° | %.3f° | %d of %d |\n", contrasts[k], beside[s].noise,
                   beside[s].texture, frequency[cases / 2], frequency[cases * 95 / 100], angle[cases / 2], angle[cases * 95 / 100],
                   found, cases);
            fflush(stdout);
        }
    free(plane), free(texture), free(frequency), free(angle);
    return 0;
}
