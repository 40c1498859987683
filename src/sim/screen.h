/* SPDX-License-Identifier: Apache-2.0 */
/* screen.h: pictures of screens: read within bounds, and compared by what they show. */
#ifndef SIM_SCREEN_H
#define SIM_SCREEN_H

#include "brace/image.h"
#include "core/core.h"

/* The picture in a file, refused before it is decoded if it is larger than any display. `sha256`, if not NULL, gets the
 * hash of the file. */
brace_status sim_screen_read(brace_image **out, char sha256[65], const char *path, const brace_job *job,
                             brace_error *error);

/* A coarse copy, 32x18 means of the sRGB values, and its sums. */
enum { SIM_PRINT_COLUMNS = 32, SIM_PRINT_ROWS = 18, SIM_PRINT = 3 * SIM_PRINT_COLUMNS * SIM_PRINT_ROWS };
typedef struct sim_print {
    uint8_t value[SIM_PRINT];
    int64_t sum, energy; /* of the values; of their deviation from the mean, times SIM_PRINT */
} sim_print;
brace_status sim_print_create(sim_print *out, const brace_image *image, brace_error *error);

/* Whether two pictures show the same but for size, compression, brightness and small changes: their coarse copies
 * correlate above 0.985, as in scripts/screens/collect.py; pictures of one colour are compared by it. In integers and
 * single roundings: the same on every machine. */
bool sim_prints_alike(const sim_print *a, const sim_print *b);

#endif
