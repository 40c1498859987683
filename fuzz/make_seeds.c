/* SPDX-License-Identifier: Apache-2.0 */
/*
 * make_seeds.c: small sound files of every kind that the fuzz targets start from.
 *
 *   make_seeds RAW_FOLDER PICTURE_FOLDER SAFETENSORS_FOLDER PROTOCOL_FOLDER
 */
#include <stdio.h>
#include <string.h>

#include "brace/brace.h"
#include "core/safetensors.h"

#include "../tests/capture/samples.h"

static brace_error error;

static int fail(void) {
    fprintf(stderr, "make_seeds: %s\n", error.message);
    return 1;
}

static int make_raw(const char *folder) {
    static const uint32_t sizes[][2] = {{16, 16}, {24, 10}, {33, 17}};
    for (unsigned i = 0; i < 12; i++) {
        brace_frame *f = NULL;
        const uint32_t *size = sizes[i % 3];
        if (brace_frame_create(&f, size[0], size[1], (brace_cfa)(i % 4), &error) != BRACE_OK) {
            return fail();
        }
        for (uint32_t p = 0; p < size[0] * size[1]; p++) {
            f->data[p] = (uint16_t)(64 + p * 37 % 900);
        }
        for (int c = 0; c < 4; c++) {
            f->black[c] = (float)(62 + c * (int)(i % 2));
        }
        static const double matrix[9] = {1.04, -0.37, -0.12, -0.44, 1.29, 0.13, -0.05, 0.27, 0.43};
        f->white = 1023;
        f->exposure_time = 1.0 / 640;
        f->iso = 400;
        f->f_number = 1.8;
        f->orientation = (int)(1 + i % 8);
        memcpy(f->color_matrix[0], matrix, sizeof matrix);
        memcpy(f->color_matrix[1], matrix, sizeof matrix);
        f->illuminant[0] = i % 2 ? 17 : 21;
        f->illuminant[1] = i % 2 ? 21 : 0;
        snprintf(f->make, sizeof f->make, "Seed");
        snprintf(f->model, sizeof f->model, "Model %u", i);
        snprintf(f->unique_model, sizeof f->unique_model, "Seed Model %u", i);
        snprintf(f->datetime, sizeof f->datetime, "2031:05:01 12:00:00");
        char path[4096];
        brace_dng_params params = {.no_preview = i % 3 != 0};
        snprintf(path, sizeof path, "%s/seed_%u.dng", folder, i);
        brace_status status = brace_frame_write_dng(f, path, &params, NULL, &error);
        brace_frame_destroy(f);
        if (status != BRACE_OK) {
            return fail();
        }
    }
    return 0;
}

static int make_pictures(const char *folder) {
    static const struct {
        const char *name;
        brace_sample sample;
        uint32_t channels;
    } kinds[] = {
        {"u8.png", BRACE_SAMPLE_U8, 3},   {"u16.png", BRACE_SAMPLE_U16, 3},  {"grey.png", BRACE_SAMPLE_U8, 1},
        {"rgba.png", BRACE_SAMPLE_U8, 4}, {"u8.tif", BRACE_SAMPLE_U8, 3},    {"u16.tif", BRACE_SAMPLE_U16, 3},
        {"f32.tif", BRACE_SAMPLE_F32, 3}, {"grey.tif", BRACE_SAMPLE_U16, 1}, {"u8.jpg", BRACE_SAMPLE_U8, 3},
        {"grey.jpg", BRACE_SAMPLE_U8, 1}, {"u8.webp", BRACE_SAMPLE_U8, 3},   {"rgba.webp", BRACE_SAMPLE_U8, 4},
    };
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        brace_image *image = NULL;
        brace_transfer transfer = kinds[i].sample == BRACE_SAMPLE_F32 ? BRACE_TRANSFER_LINEAR : BRACE_TRANSFER_SRGB;
        if (brace_image_create(&image, 19, 13, kinds[i].channels, kinds[i].sample, transfer, &error) != BRACE_OK) {
            return fail();
        }
        for (uint32_t y = 0; y < image->height; y++) {
            unsigned char *row = (unsigned char *)image->data + y * image->stride;
            for (uint32_t n = 0; n < image->width * image->channels; n++) {
                if (image->sample == BRACE_SAMPLE_F32) {
                    ((float *)(void *)row)[n] = (float)(n + y) / 64;
                } else if (image->sample == BRACE_SAMPLE_U16) {
                    ((uint16_t *)(void *)row)[n] = (uint16_t)(n * 997 + y * 313);
                } else {
                    row[n] = (unsigned char)(n * 7 + y * 5);
                }
            }
        }
        char path[4096];
        brace_image_write_params params = {.bits = kinds[i].sample == BRACE_SAMPLE_F32 ? 32 : 0};
        snprintf(path, sizeof path, "%s/%s", folder, kinds[i].name);
        brace_status status = brace_image_write(image, path, &params, NULL, &error);
        brace_image_destroy(image);
        if (status != BRACE_OK) {
            return fail();
        }
    }
    return 0;
}

static int make_tensors(const char *folder) {
    static const uint16_t frames[2][2][3] = {{{1, 2, 3}, {4, 5, 6}}, {{7, 8, 9}, {10, 11, 12}}};
    core_safetensors_writer *writer = NULL;
    char path[4096];
    snprintf(path, sizeof path, "%s/two.safetensors", folder);
    const core_tensor a = {.name = "train/000000_web/frames", .dtype = CORE_U16, .rank = 3, .shape = {2, 2, 3}, .data = frames};
    const core_tensor b = {.name = "weight", .dtype = CORE_F32, .rank = 1, .shape = {3}, .data = frames};
    if (core_safetensors_create(&writer, path, 512, &error) != BRACE_OK) {
        return fail();
    }
    if (core_safetensors_add(writer, &a, &error) != BRACE_OK || core_safetensors_add(writer, &b, &error) != BRACE_OK ||
        core_safetensors_add_metadata(writer, "format", "seed", &error) != BRACE_OK) {
        core_safetensors_abort(writer);
        return fail();
    }
    return core_safetensors_commit(writer, &error) != BRACE_OK ? fail() : 0;
}

static int make_messages(const char *folder) {
    for (int i = 0; i < SAMPLES; i++) {
        static uint8_t bytes[4096];
        char path[4096];
        const capture_message m = sample(i);
        const size_t n = capture_message_write(&m, bytes, sizeof bytes);
        snprintf(path, sizeof path, "%s/%s", folder, capture_wire_name((unsigned)m.type));
        FILE *f = fopen(path, "wb");
        if (f == NULL || fwrite(bytes, 1, n, f) != n || fclose(f) != 0) {
            fprintf(stderr, "make_seeds: cannot write %s\n", path);
            return 1;
        }
    }
    return 0;
}

int main(int argc, char **argv) {
    if (argc != 5) {
        fprintf(stderr, "usage: make_seeds RAW_FOLDER PICTURE_FOLDER SAFETENSORS_FOLDER PROTOCOL_FOLDER\n");
        return 2;
    }
    int code = make_raw(argv[1]);
    if (code == 0) {
        code = make_pictures(argv[2]);
    }
    if (code == 0) {
        code = make_tensors(argv[3]);
    }
    return code != 0 ? code : make_messages(argv[4]);
}
