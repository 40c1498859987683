/* SPDX-License-Identifier: Apache-2.0 */
/*
 * make.h: pictures and folders for the image tests.
 */
#ifndef TESTS_IMAGE_MAKE_H
#define TESTS_IMAGE_MAKE_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <dirent.h>
#include <unistd.h>

#include <cmocka.h>

#include "core/core.h"
#include "image/image.h"

/* A smooth picture with some noise; float values go below 0 and above 1. */
static inline brace_image *make_picture(uint32_t width, uint32_t height, uint32_t channels, brace_sample sample,
                                        brace_transfer transfer, uint32_t seed) {
    brace_image *image = NULL;
    assert_int_equal(brace_image_create(&image, width, height, channels, sample, transfer, NULL), BRACE_OK);
    core_random r = core_random_create(seed, width, height, channels);
    for (uint32_t y = 0; y < height; y++) {
        for (uint32_t x = 0; x < width; x++) {
            for (uint32_t c = 0; c < channels; c++) {
                double v = 0.5 + 0.4 * sin(0.11 * x + 0.07 * y + c) + 0.05 * core_random_uniform(&r);
                size_t i = (size_t)x * channels + c;
                unsigned char *row = image_row(image, y);
                if (sample == BRACE_SAMPLE_U8) {
                    row[i] = (unsigned char)(v * 255);
                } else if (sample == BRACE_SAMPLE_U16) {
                    ((uint16_t *)(void *)row)[i] = (uint16_t)(v * 65535);
                } else {
                    ((float *)(void *)row)[i] = (float)(c == 3 ? v : v * 1.4 - 0.2);
                }
            }
        }
    }
    return image;
}

static inline void assert_same(const brace_image *a, const brace_image *b) {
    assert_int_equal(a->width, b->width);
    assert_int_equal(a->height, b->height);
    assert_int_equal(a->channels, b->channels);
    assert_int_equal(a->sample, b->sample);
    assert_int_equal(a->transfer, b->transfer);
    size_t n = (size_t)a->width * a->channels * image_sample_size(a->sample);
    for (uint32_t y = 0; y < a->height; y++) {
        assert_memory_equal(image_row(a, y), image_row(b, y), n);
    }
}

static inline double psnr_u8(const brace_image *a, const brace_image *b) {
    double sum = 0;
    assert_int_equal(a->width * a->height * a->channels, b->width * b->height * b->channels);
    size_t n = a->stride * a->height;
    const unsigned char *p = a->data, *q = b->data;
    for (size_t i = 0; i < n; i++) {
        sum += (double)(p[i] - q[i]) * (double)(p[i] - q[i]);
    }
    return sum > 0 ? 10 * log10(255.0 * 255.0 * (double)n / sum) : 999;
}

static char folder[64];

static inline int make_folder(void **state) {
    (void)state;
    strcpy(folder, "/tmp/brace-image-XXXXXX");
    return mkdtemp(folder) != NULL ? 0 : -1;
}

static inline const char *in_folder(const char *name) {
    static char path[4][400];
    static int turn;
    char *p = path[turn++ & 3];
    snprintf(p, sizeof path[0], "%s/%s", folder, name);
    return p;
}

/* Removes the files; returns how many there were. */
static inline int empty_folder(void) {
    int n = 0;
    DIR *d = opendir(folder);
    assert_non_null(d);
    for (struct dirent *e; (e = readdir(d)) != NULL;) {
        if (strcmp(e->d_name, ".") != 0 && strcmp(e->d_name, "..") != 0) {
            unlink(in_folder(e->d_name));
            n++;
        }
    }
    closedir(d);
    return n;
}

static inline int remove_folder(void **state) {
    (void)state;
    empty_folder();
    return rmdir(folder);
}

#endif
