/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_perceptual.c: LPIPS and DISTS against PyTorch with the same hashed weights
 * (make_perceptual_vectors.py), their tiles against the whole picture, and what is
 * said when weights are missing.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "metrics/metrics.h"
#include "metrics/perceptual.h"
#include "perceptual_vectors.h"

static brace_image *picture(uint32_t width, uint32_t height, uint32_t seed, uint32_t noise) {
    brace_image *image = NULL;
    assert_int_equal(brace_image_create(&image, width, height, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, NULL),
                     BRACE_OK);
    for (uint32_t y = 0; y < height; y++) {
        unsigned char *p = (unsigned char *)image->data + y * image->stride;
        for (uint32_t x = 0; x < width; x++) {
            for (uint32_t c = 0; c < 3; c++) {
                uint32_t base = (x * 5 + y * 3 + c * 40 + x * y / 7) % 256;
                uint32_t h = ((y * width + x) * 3 + c + 1) * 2654435761u + seed * 40503u;
                h = (h ^ h >> 15) * 2246822519u;
                h = h >> 16 & 255;
                *p++ = (unsigned char)((base * (100 - noise) + h * noise) / 100);
            }
        }
    }
    return image;
}

/* As `weights` in make_perceptual_vectors.py. */
static brace_status hashed(void *arg, float *values, const char *name, const size_t shape[4], brace_error *error) {
    (void)error;
    uint32_t tag = 2166136261u;
    for (const char *p = name; *p != '\0'; p++) {
        tag = (tag ^ (unsigned char)*p) * 16777619u;
    }
    size_t count = 1;
    for (int i = 0; i < 4; i++) {
        count *= shape[i] > 0 ? shape[i] : 1;
    }
    const bool bias = strstr(name, ".bias") != NULL, feature = strncmp(name, "features.", 9) == 0;
    const float scale = feature && !bias ? (float)sqrt(6.0 / (double)(shape[1] * shape[2] * shape[3])) : 0;
    for (size_t i = 0; i < count; i++) {
        uint32_t h = (uint32_t)i * 2654435761u + tag;
        h = (h ^ h >> 15) * 2246822519u;
        h = (h ^ h >> 13) * 3266489917u;
        const float u = (float)(h >> 16) / 65536;
        values[i] = bias ? (2 * u - 1) * 0.125f : feature ? (2 * u - 1) * scale : u;
    }
    const char *spoil = arg;
    if (spoil != NULL && strcmp(name, spoil) == 0) {
        values[count - 1] = NAN;
    }
    return BRACE_OK;
}

static void test_vectors(void **state) {
    (void)state;
    static const char *const sets[] = {"avx512", "avx2", "plain"};
    for (int s = 0; s < 3; s++) {
        assert_int_equal(setenv("BRACE_CPU", sets[s], 1), 0);
        for (int kind = 0; kind < 4; kind++) {
            if (s > 0 && (kind == BRACE_LPIPS_VGG || kind == BRACE_DISTS)) {
                continue; /* the same loops, and slow without vectors */
            }
            brace_perceptual *metric = NULL;
            assert_int_equal(metrics_perceptual_create(&metric, (brace_perceptual_kind)kind, hashed, NULL, NULL),
                             BRACE_OK);
            for (size_t i = 0; i < sizeof vectors / sizeof *vectors; i++) {
                if ((int)vectors[i].kind != kind) {
                    continue;
                }
                brace_image *a = picture(vectors[i].width, vectors[i].height, 1, vectors[i].noise),
                            *b = picture(vectors[i].width, vectors[i].height, 2, vectors[i].noise);
                double distance = -1;
                assert_int_equal(brace_perceptual_distance(&distance, metric, a, b, NULL, NULL), BRACE_OK);
                if (!(fabs(distance - vectors[i].distance) < 2e-5 * vectors[i].distance + 2e-8)) {
                    fail_msg("%s, %ux%u: %.10g instead of %.10g", brace_perceptual_name((brace_perceptual_kind)kind),
                             vectors[i].width, vectors[i].height, distance, vectors[i].distance);
                }
                brace_image_destroy(a);
                brace_image_destroy(b);
            }
            brace_perceptual_destroy(metric);
        }
    }
    unsetenv("BRACE_CPU");
}

/* In tiles, with any number of threads, and of equal pictures. */
static void test_tiles(void **state) {
    (void)state;
    for (int kind = 0; kind < 4; kind++) {
        brace_perceptual *metric = NULL;
        if (kind == BRACE_LPIPS_VGG) {
            continue; /* DISTS goes through the same layers, with wider pools */
        }
        assert_int_equal(metrics_perceptual_create(&metric, (brace_perceptual_kind)kind, hashed, NULL, NULL), BRACE_OK);
        const bool slow = kind == BRACE_DISTS;
        /* The last row of tiles has so few pixels that the last layer has no position there. */
        brace_image *a = picture(slow ? 34 : 125, slow ? 149 : 107, 1, 30), *b = picture(a->width, a->height, 2, 30);
        double whole = 0, tiled = 0, other = 0;
        brace_job one = {.threads = 1}, five = {.threads = 5};
        assert_int_equal(metrics_perceptual_distance(&whole, metric, a, b, 0, &five, NULL), BRACE_OK);
        assert_int_equal(metrics_perceptual_distance(&tiled, metric, a, b, slow ? 144 : 96, &one, NULL), BRACE_OK);
        if (!(fabs(whole - tiled) < 1e-6 * whole)) {
            fail_msg("%s: %.10g whole, %.10g in tiles", brace_perceptual_name((brace_perceptual_kind)kind), whole,
                     tiled);
        }
        if (!slow) {
            assert_int_equal(metrics_perceptual_distance(&other, metric, a, b, 96, &five, NULL), BRACE_OK);
            assert_memory_equal(&other, &tiled, sizeof other);
        }
        brace_image_destroy(b);
        b = picture(40, 40, 1, 30);
        assert_int_equal(brace_perceptual_distance(&whole, metric, b, b, NULL, NULL), BRACE_OK);
        assert_true(fabs(whole) < 1e-6);
        memset(b->data, 0, b->stride * b->height);
        assert_int_equal(brace_perceptual_distance(&whole, metric, b, b, NULL, NULL), BRACE_OK);
        assert_true(fabs(whole) < 1e-6);
        brace_image_destroy(a);
        brace_image_destroy(b);
        brace_perceptual_destroy(metric);
    }
}

static void test_refused(void **state) {
    (void)state;
    brace_perceptual *metric = NULL;
    brace_error error;
    double v = -7;
    assert_int_equal(metrics_perceptual_create(&metric, BRACE_LPIPS_SQUEEZE, hashed, NULL, NULL), BRACE_OK);
    brace_image *a = picture(40, 33, 1, 30), *b = picture(33, 40, 1, 30), *small = picture(31, 60, 1, 30), *bad = NULL;
    assert_int_equal(brace_perceptual_distance(&v, metric, a, b, NULL, &error), BRACE_ERROR_MISMATCH);
    assert_int_equal(brace_perceptual_distance(&v, metric, small, small, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "31 x 60"));
    assert_int_equal(brace_perceptual_distance(&v, metric, a, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(brace_image_convert(&bad, a, 3, BRACE_SAMPLE_F32, BRACE_TRANSFER_SRGB, NULL), BRACE_OK);
    ((float *)bad->data)[50] = NAN;
    assert_int_equal(brace_perceptual_distance(&v, metric, a, bad, NULL, &error), BRACE_ERROR_ARGUMENT);
    const int cancel = 1;
    brace_job job = {.cancel = &cancel};
    assert_int_equal(brace_perceptual_distance(&v, metric, a, a, &job, &error), BRACE_ERROR_CANCELLED);
    for (long n = 1; n <= 40; n++) {
        core_alloc_fail_after(n);
        brace_status status = brace_perceptual_distance(&v, metric, a, a, NULL, &error);
        core_alloc_fail_after(0);
        assert_int_equal(status, BRACE_ERROR_MEMORY);
    }
    assert_true(v == -7);
    brace_perceptual_destroy(metric);
    for (long n = 1; n <= 80; n++) {
        core_alloc_fail_after(n);
        brace_status status = metrics_perceptual_create(&metric, BRACE_LPIPS_SQUEEZE, hashed, NULL, &error);
        core_alloc_fail_after(0);
        assert_int_equal(status, BRACE_ERROR_MEMORY);
        assert_null(metric);
    }
    static char spoiled[] = "features.9.expand3x3.bias";
    assert_int_equal(metrics_perceptual_create(&metric, BRACE_LPIPS_SQUEEZE, hashed, spoiled, &error),
                     BRACE_ERROR_FORMAT);
    assert_non_null(strstr(error.message, spoiled));
    assert_int_equal(metrics_perceptual_create(&metric, (brace_perceptual_kind)9, hashed, NULL, &error),
                     BRACE_ERROR_ARGUMENT);
    brace_perceptual_destroy(NULL);
    brace_image_destroy(a);
    brace_image_destroy(b);
    brace_image_destroy(small);
    brace_image_destroy(bad);
}

/* Missing weights are named, with where they are to be had. */
static void test_missing(void **state) {
    (void)state;
    static const char *const says[] = {"https://download.pytorch.org/models/alexnet-owt-7be5be79.pth",
                                       "https://download.pytorch.org/models/vgg16-397923af.pth",
                                       "https://download.pytorch.org/models/squeezenet1_1-b8a52dc0.pth",
                                       "https://download.pytorch.org/models/vgg16-397923af.pth"};
    brace_perceptual *metric = NULL;
    brace_error error;
    unsetenv("BRACE_WEIGHTS");
    for (int kind = 0; kind < 4; kind++) {
        assert_int_equal(brace_perceptual_load(&metric, (brace_perceptual_kind)kind, "/nowhere", &error),
                         BRACE_ERROR_IO);
        assert_non_null(strstr(error.message, says[kind]));
        assert_non_null(strstr(error.message, "/nowhere"));
        assert_int_equal(brace_perceptual_load(&metric, (brace_perceptual_kind)kind, NULL, &error), BRACE_ERROR_IO);
        assert_non_null(strstr(error.message, "BRACE_WEIGHTS"));
    }
    assert_int_equal(brace_perceptual_load(&metric, (brace_perceptual_kind)9, NULL, &error), BRACE_ERROR_ARGUMENT);
    /* Files that are there, but are something else. */
    char folder[] = "/tmp/brace-weights-XXXXXX", path[2][128];
    assert_non_null(mkdtemp(folder));
    snprintf(path[0], sizeof path[0], "%s/alexnet-owt-4df8aa71.pth", folder);
    snprintf(path[1], sizeof path[1], "%s/alex.pth", folder);
    for (int i = 0; i < 2; i++) {
        void *data = NULL;
        size_t size = 0;
        assert_int_equal(core_file_load(&data, &size, TEST_DATA "/zip.pth", 1 << 20, NULL), BRACE_OK);
        FILE *f = fopen(path[i], "wb");
        assert_non_null(f);
        assert_int_equal(fwrite(data, 1, size, f), size);
        assert_int_equal(fclose(f), 0);
        core_free(data);
    }
    assert_int_equal(setenv("BRACE_WEIGHTS", folder, 1), 0);
    assert_int_equal(brace_perceptual_load(&metric, BRACE_LPIPS_ALEX, NULL, &error), BRACE_ERROR_FORMAT);
    assert_non_null(strstr(error.message, "features.0.weight"));
    unsetenv("BRACE_WEIGHTS");
    assert_int_equal(remove(path[0]), 0);
    assert_int_equal(remove(path[1]), 0);
    assert_int_equal(remove(folder), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_vectors),
        cmocka_unit_test(test_tiles),
        cmocka_unit_test(test_refused),
        cmocka_unit_test(test_missing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
