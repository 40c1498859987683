/* SPDX-License-Identifier: Apache-2.0 */
/* Demosaicing: exactness on recorded samples, flat and sloped fields; symmetry; noise; ranking. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "image/color.h"
#include "raw/isp.h"

/* Camera RGB is sRGB, nothing is balanced: what comes out is the demosaicing alone. */
static brace_frame plain_frame(uint32_t width, uint32_t height, brace_cfa cfa) {
    brace_frame frame = {.width = width, .height = height, .cfa = cfa, .orientation = 1, .white = 65535.0f};
    frame.as_shot_neutral[0] = frame.as_shot_neutral[1] = frame.as_shot_neutral[2] = 1.0;
    static uint16_t never_read;
    frame.data = &never_read;
    return frame;
}

static int color_at(brace_cfa cfa, uint32_t x, uint32_t y) {
    return raw_green_phase(cfa, (int)(y & 1)) == (int)(x & 1) ? 1 : raw_row_color(cfa, (int)(y & 1));
}

static float *alloc_floats(size_t count) {
    float *p = calloc(count, sizeof(float));
    assert_non_null(p);
    return p;
}

/* Samples an RGB picture as a sensor would and develops that. */
static brace_image *through_mosaic(const float *rgb, uint32_t width, uint32_t height, brace_cfa cfa,
                                   brace_demosaic method) {
    const brace_frame frame = plain_frame(width, height, cfa);
    float *mosaic = alloc_floats((size_t)width * height);
    for (uint32_t y = 0; y < height; y++) {
        for (uint32_t x = 0; x < width; x++) {
            const size_t i = (size_t)y * width + x;
            mosaic[i] = rgb[3 * i + (size_t)color_at(cfa, x, y)];
        }
    }
    const brace_develop_params params = {
        .demosaic = method, .sample = BRACE_SAMPLE_F32, .transfer = BRACE_TRANSFER_LINEAR};
    brace_image *image = NULL;
    assert_int_equal(brace_develop_linear(&image, mosaic, &frame, &params, NULL, NULL), BRACE_OK);
    free(mosaic);
    return image;
}

static void cfa_helpers_agree_with_the_enum(void **state) {
    (void)state;
    static const int expected[4][4] = {{0, 1, 1, 2}, {1, 0, 2, 1}, {1, 2, 0, 1}, {2, 1, 1, 0}};
    for (int cfa = 0; cfa < 4; cfa++) {
        for (uint32_t i = 0; i < 4; i++) {
            assert_int_equal(color_at((brace_cfa)cfa, i & 1, i >> 1), expected[cfa][i]);
        }
    }
    for (int64_t n = 2; n < 9; n++) {
        for (int64_t i = -40; i < 40; i++) {
            const int64_t m = raw_mirror(i, n);
            assert_true(m >= 0 && m < n && ((m ^ i) & 1) == 0); /* the CFA phase is kept */
            assert_true(i < 0 || i >= n || m == i);
        }
        assert_int_equal(raw_mirror(-1, n), 1);
        assert_int_equal(raw_mirror(n, n), n - 2);
    }
}

static void recorded_samples_are_kept_bit_for_bit(void **state) {
    (void)state;
    raw_tile *tile = calloc(1, sizeof(*tile));
    assert_non_null(tile);
    core_random random = core_random_create(1, 0, 0, 0);
    for (size_t i = 0; i < RAW_TILE_SAMPLES; i++) {
        tile->mosaic[i] = (float)core_random_range(&random, -0.05, 1.0);
    }
    static const int sizes[][2] = {{RAW_TILE_WIDTH, RAW_TILE_HEIGHT}, {1, 1}, {17, 3}};
    for (int s = 0; s < 3; s++) {
        for (int cfa = 0; cfa < 4; cfa++) {
            for (int method = 0; method <= 3; method++) {
                tile->width = sizes[s][0];
                tile->height = sizes[s][1];
                tile->cfa = (brace_cfa)cfa;
                raw_demosaic_tile(tile, (brace_demosaic)method);
                for (int y = RAW_HALO; y < RAW_HALO + tile->height; y++) {
                    for (int x = RAW_HALO; x < RAW_HALO + tile->width; x++) {
                        const size_t i = (size_t)y * RAW_TILE_STRIDE + (size_t)x;
                        const int c = color_at(tile->cfa, (uint32_t)x, (uint32_t)y);
                        assert_memory_equal(&tile->rgb[c][i], &tile->mosaic[i], sizeof(float));
                    }
                }
            }
        }
    }
    free(tile);
}

/* Flat fields are exact up to the borders, in each channel its own level. */
static void flat_fields_are_exact(void **state) {
    (void)state;
    static const float level[3] = {0.7f, 0.31f, 0.002f};
    static const uint32_t sizes[][2] = {{4, 4}, {5, 5}, {7, 4}, {240, 70}};
    for (int s = 0; s < 4; s++) {
        const size_t count = 3 * (size_t)sizes[s][0] * sizes[s][1];
        float *rgb = alloc_floats(count);
        for (size_t i = 0; i < count; i++) {
            rgb[i] = level[i % 3];
        }
        for (int cfa = 0; cfa < 4; cfa++) {
            for (int method = 1; method <= 3; method++) {
                brace_image *image =
                    through_mosaic(rgb, sizes[s][0], sizes[s][1], (brace_cfa)cfa, (brace_demosaic)method);
                const float *out = image->data;
                for (size_t i = 0; i < count; i++) {
                    assert_true(fabsf(out[i] - rgb[i]) < 5e-7f);
                }
                brace_image_destroy(image);
            }
        }
        free(rgb);
    }
}

/* Linear methods are exact on slopes; the directional one sees them through the
 * root, where they bend a little. Borders are mirrored and so not sloped. */
static void slopes_are_exact(void **state) {
    (void)state;
    enum { W = 250, H = 90 };
    float *rgb = alloc_floats(3 * W * H);
    static const float slope[][6] = {/* x and y of R, G, B */
                                     {1e-3f, 0.0f, 1e-3f, 0.0f, 1e-3f, 0.0f},
                                     {0.0f, 3e-3f, 0.0f, 2e-3f, 0.0f, 1e-3f},
                                     {1e-3f, 1e-3f, -5e-4f, 1e-3f, 1e-3f, -1e-3f}};
    for (int s = 0; s < 3; s++) {
        for (uint32_t y = 0; y < H; y++) {
            for (uint32_t x = 0; x < W; x++) {
                for (int c = 0; c < 3; c++) {
                    rgb[3 * (y * W + x) + (uint32_t)c] =
                        0.3f + slope[s][2 * c] * (float)x + slope[s][2 * c + 1] * (float)y;
                }
            }
        }
        for (int method = 1; method <= 3; method++) {
            brace_image *image = through_mosaic(rgb, W, H, (brace_cfa)s, (brace_demosaic)method);
            const float *out = image->data;
            for (uint32_t y = 12; y < H - 12; y++) {
                for (uint32_t i = 3 * (y * W + 12); i < 3 * (y * W + W - 12); i++) {
                    if (!(fabsf(out[i] - rgb[i]) < (method == 3 ? 2e-5f : 1e-6f))) {
                        fail_msg("slope %d, method %d, sample %u: %.7f, is %.7f", s, method, i, (double)out[i],
                                 (double)rgb[i]);
                    }
                }
            }
            brace_image_destroy(image);
        }
    }
    free(rgb);
}

/* Mirroring the scene mirrors the result: no direction is preferred. */
static void mirrored_scene_gives_mirrored_picture(void **state) {
    (void)state;
    enum { N = 41 }; /* odd, so that the mirrored mosaic has the same CFA order */
    float *rgb = alloc_floats(3 * N * N), *flipped = alloc_floats(3 * N * N);
    core_random random = core_random_create(2, 0, 0, 0);
    for (size_t i = 0; i < 3 * N * N; i++) {
        rgb[i] = (float)core_random_uniform(&random);
    }
    for (int turn = 0; turn < 3; turn++) { /* left-right, top-bottom, transposed */
        for (size_t y = 0; y < N; y++) {
            for (size_t x = 0; x < N; x++) {
                const size_t u = turn == 0   ? N - 1 - x
                                 : turn == 1 ? x
                                             : y,
                             v = turn == 0   ? y
                                 : turn == 1 ? N - 1 - y
                                             : x;
                memcpy(flipped + 3 * (v * N + u), rgb + 3 * (y * N + x), 3 * sizeof(float));
            }
        }
        for (int method = 1; method <= 3; method++) {
            brace_image *a = through_mosaic(rgb, N, N, BRACE_CFA_RGGB, (brace_demosaic)method);
            brace_image *b = through_mosaic(flipped, N, N, BRACE_CFA_RGGB, (brace_demosaic)method);
            const float *p = a->data, *q = b->data;
            for (size_t y = 0; y < N; y++) {
                for (size_t x = 0; x < N; x++) {
                    const size_t u = turn == 0 ? N - 1 - x : turn == 1 ? x : y;
                    const size_t v = turn == 0 ? y : turn == 1 ? N - 1 - y : x;
                    for (size_t c = 0; c < 3; c++) {
                        assert_true(fabsf(p[3 * (y * N + x) + c] - q[3 * (v * N + u) + c]) < 2e-5f);
                    }
                }
            }
            brace_image_destroy(b);
            brace_image_destroy(a);
        }
    }
    free(flipped);
    free(rgb);
}

/* Noise must not shift brightness or colour, also in deep shadow where the root bends most. */
static void noise_keeps_the_mean(void **state) {
    (void)state;
    enum { N = 256 };
    static const double light[] = {0.002, 0.02, 0.2};
    float *rgb = alloc_floats(3 * N * N);
    for (int k = 0; k < 3; k++) {
        core_random random = core_random_create(3, (uint32_t)k, 0, 0);
        const double deviation = sqrt(1e-3 * light[k] + 1e-6);
        double in[3] = {0}, out[3] = {0};
        for (size_t i = 0; i < 3 * N * N; i++) {
            rgb[i] = (float)(light[k] + deviation * core_random_normal(&random));
        }
        brace_image *image = through_mosaic(rgb, N, N, BRACE_CFA_RGGB, BRACE_DEMOSAIC_DIRECTIONAL);
        const float *p = image->data;
        for (uint32_t y = 0; y < N; y++) {
            for (uint32_t x = 0; x < N; x++) {
                const size_t i = 3 * ((size_t)y * N + x);
                const int c = color_at(BRACE_CFA_RGGB, x, y);
                in[c] += (double)rgb[i + (size_t)c] * (c == 1 ? 2.0 : 4.0);
                for (size_t j = 0; j < 3; j++) {
                    out[j] += (double)p[i + j];
                }
            }
        }
        for (int c = 0; c < 3; c++) {
            print_message("light %.3f channel %d: mean off by %+.2f %%\n", light[k], c, 100.0 * (out[c] / in[c] - 1.0));
            assert_true(fabs(out[c] / in[c] - 1.0) < 0.006);
        }
        brace_image_destroy(image);
    }
    free(rgb);
}

/* A scene with what demosaicing finds hard: a zone plate, thin slanted lines, a
 * coloured checkerboard, and a slow coloured background; averaged over each pixel. */
static void scene(double u, double v, double rgb[3]) {
    const double x = u - 96.0, y = v - 96.0;
    const double ring = 0.5 + 0.4 * cos((x * x + y * y) * 0.0105);
    rgb[0] = ring * (0.9 - 0.002 * u);
    rgb[1] = ring * 0.85;
    rgb[2] = ring * (0.4 + 0.002 * v);
    if (fmod(u * 0.8 + v * 0.6, 17.0) < 1.6) {
        rgb[0] = rgb[1] = rgb[2] = 0.02;
    }
    if (u > 130.0 && v > 130.0) {
        const bool odd = fmod(u, 14.0) < 7.0;
        const bool even = fmod(v, 14.0) < 7.0;
        rgb[0] = odd == even ? 0.8 : 0.05;
        rgb[1] = odd == even ? 0.75 : 0.15;
        rgb[2] = odd == even ? 0.7 : 0.4;
    }
}

static double psnr(const float *a, const float *b, size_t count) {
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        const double d = (double)image_srgb_encode(fminf(fmaxf(a[i], 0.0f), 1.0f)) -
                         (double)image_srgb_encode(fminf(fmaxf(b[i], 0.0f), 1.0f));
        sum += d * d;
    }
    return -10.0 * log10(sum / (double)count);
}

static void each_method_beats_the_one_before(void **state) {
    (void)state;
    enum { N = 192, SUB = 4 };
    float *rgb = alloc_floats(3 * N * N);
    for (size_t y = 0; y < N; y++) {
        for (size_t x = 0; x < N; x++) {
            for (int k = 0; k < SUB * SUB; k++) {
                double color[3];
                scene((double)x + (k % SUB + 0.5) / SUB, (double)y + (k / SUB + 0.5) / SUB, color);
                for (size_t c = 0; c < 3; c++) {
                    rgb[3 * (y * N + x) + c] += (float)(color[c] / (SUB * SUB));
                }
            }
        }
    }
    for (int cfa = 0; cfa < 4; cfa++) {
        double previous = 0.0;
        for (int method = 1; method <= 3; method++) {
            brace_image *image = through_mosaic(rgb, N, N, (brace_cfa)cfa, (brace_demosaic)method);
            const double quality = psnr(image->data, rgb, 3 * N * N);
            print_message("CFA %d method %d: %.2f dB\n", cfa, method, quality);
            assert_true(quality > previous + 0.5);
            previous = quality;
            brace_image_destroy(image);
        }
        brace_image *usual = through_mosaic(rgb, N, N, (brace_cfa)cfa, BRACE_DEMOSAIC_DEFAULT);
        assert_true(fabs(psnr(usual->data, rgb, 3 * N * N) - previous) < 1e-9);
        brace_image_destroy(usual);
    }
    free(rgb);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cfa_helpers_agree_with_the_enum),
        cmocka_unit_test(recorded_samples_are_kept_bit_for_bit),
        cmocka_unit_test(flat_fields_are_exact),
        cmocka_unit_test(slopes_are_exact),
        cmocka_unit_test(mirrored_scene_gives_mirrored_picture),
        cmocka_unit_test(noise_keeps_the_mean),
        cmocka_unit_test(each_method_beats_the_one_before),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
