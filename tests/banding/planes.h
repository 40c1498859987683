/* SPDX-License-Identifier: Apache-2.0 */
/* planes.h: the test planes, as in make_vectors.py: texture and noise from integers, and one stripe. */
#ifndef PLANES_H
#define PLANES_H

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

static float *planes_make(uint32_t width, uint32_t height, uint32_t seed, double fx, double fy, double phase,
                          double amplitude) {
    float *plane = malloc((size_t)width * height * sizeof *plane);
    for (uint32_t y = 0; plane && y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            uint32_t base = (x * 5 + y * 3 + x * y / 7) % 256;
            uint32_t h = (y * width + x + 1) * 2654435761u + seed * 40503u;
            h = (h ^ h >> 15) * 2246822519u;
            h = h >> 16 & 255;
            double texture = (double)((base * 60 + h * 40) / 100) / 255;
            double xc = x - (width - 1) / 2.0, yc = y - (height - 1) / 2.0;
            plane[(size_t)y * width + x] =
                (float)(0.4 * texture + 0.3 + amplitude * cos(2 * M_PI * (fx * xc + fy * yc) + phase));
        }
    return plane;
}

#endif
