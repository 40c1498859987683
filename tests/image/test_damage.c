/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_damage.c: thousands of damaged pictures, always the same ones: each gives
 * an error with a sentence or a picture, and under the sanitizers nothing else.
 */
#include <malloc.h>

#include "make.h"

static const char *const names[] = {"a.png", "b.png", "a.tif", "b.tif", "a.jpg", "b.jpg", "a.webp", "b.webp"};

/* `filler`: of the memory that readers get; with a sanitizer it is the sanitizer's. */
static brace_status decode_once(const void *data, size_t size, int filler, brace_image **out) {
    /* Exactly as long as it says, so that a read beyond it is seen. */
    unsigned char *exact = malloc(size > 0 ? size : 1);
    assert_non_null(exact);
    memcpy(exact, data, size);
    image_source source = {exact, size, "damaged", 4000000, NULL};
    brace_image *image = NULL;
    brace_error error = {BRACE_OK, ""};
    mallopt(M_PERTURB, filler);
    brace_status status = image_read_memory(&image, &source, &error);
    mallopt(M_PERTURB, 0);
    if (status == BRACE_OK) {
        assert_non_null(image);
        assert_int_equal(image_check(image, NULL), BRACE_OK);
    } else {
        assert_null(image);
        assert_int_equal(error.status, status);
        assert_true(strncmp(error.message, "damaged: ", 9) == 0 || status == BRACE_ERROR_MEMORY);
    }
    *out = image;
    free(exact);
    return status;
}

/* Twice, in memory that held something else: every sample was filled in. */
static brace_status decode(const void *data, size_t size) {
    brace_image *image[2] = {NULL, NULL};
    const brace_status status = decode_once(data, size, 0x5a, &image[0]);
    assert_int_equal(decode_once(data, size, 0x33, &image[1]), status);
    for (uint32_t y = 0; status == BRACE_OK && y < image[0]->height; y++) {
        if (memcmp(image_row(image[0], y), image_row(image[1], y),
                   (size_t)image[0]->width * image[0]->channels * image_sample_size(image[0]->sample)) != 0) {
            fail_msg("row %u of %u x %u pixels of a file that begins with %02x %02x is left as memory was", y, image[0]->width,
                     image[0]->height, ((const unsigned char *)data)[0], ((const unsigned char *)data)[1]);
        }
    }
    brace_image_destroy(image[0]);
    brace_image_destroy(image[1]);
    return status;
}

static void write_seed(int i) {
    static const brace_sample samples[8] = {BRACE_SAMPLE_U8, BRACE_SAMPLE_U16, BRACE_SAMPLE_U16, BRACE_SAMPLE_F32,
                                            BRACE_SAMPLE_U8, BRACE_SAMPLE_U8,  BRACE_SAMPLE_U8,  BRACE_SAMPLE_U8};
    static const uint32_t channels[8] = {3, 4, 3, 1, 3, 1, 3, 4};
    brace_image *a = make_picture(53, 31, channels[i], samples[i],
                                  samples[i] == BRACE_SAMPLE_F32 ? BRACE_TRANSFER_LINEAR : BRACE_TRANSFER_SRGB, 2);
    brace_image_write_params params = {.quality = i == 7 ? 100 : 80};
    brace_job job = {.threads = 1};
    assert_int_equal(brace_image_write(a, in_folder(names[i]), &params, &job, NULL), BRACE_OK);
    brace_image_destroy(a);
}

static void test_damage(void **state) {
    (void)state;
    core_random r = core_random_create(2024, 1, 0, 0);
    for (int i = 0; i < 8; i++) {
        write_seed(i);
        void *data = NULL;
        size_t size = 0;
        assert_int_equal(core_file_load(&data, &size, in_folder(names[i]), 1u << 20, NULL), BRACE_OK);
        unsigned char *bytes = data;
        assert_int_equal(decode(bytes, size), BRACE_OK);
        /* Cut off anywhere before the picture's last bytes: always an error. A TIFF ends with its profile, which
         * may be missing. */
        uint32_t needed = (uint32_t)size - (strstr(names[i], ".tif") != NULL ? IMAGE_ICC_SIZE + 200 : 16);
        for (int k = 0; k < 150; k++) {
            size_t n = core_random_below(&r, needed);
            brace_status status = decode(bytes, n);
            if (status == BRACE_OK) {
                fail_msg("%s cut to %zu of %zu bytes was read", names[i], n, size);
            }
        }
        int survived = 0;
        unsigned char *copy = malloc(size);
        assert_non_null(copy);
        for (int k = 0; k < 400; k++) {
            memcpy(copy, bytes, size);
            uint32_t flips = 1 + core_random_below(&r, k % 3 == 0 ? 1 : 20);
            /* Half of them in the head, where the structure is. */
            uint32_t reach = k % 2 == 0 && size > 200 ? 200 : (uint32_t)size;
            for (uint32_t f = 0; f < flips; f++) {
                uint32_t at = core_random_below(&r, reach);
                copy[at] = (unsigned char)(copy[at] ^ 1u << core_random_below(&r, 8));
            }
            survived += decode(copy, size) == BRACE_OK;
        }
        for (int k = 0; k < 50; k++) { /* a run of one value */
            memcpy(copy, bytes, size);
            uint32_t at = core_random_below(&r, (uint32_t)size - 12);
            memset(copy + at, k % 2 == 0 ? 0xff : 0, 12);
            decode(copy, size);
        }
        assert_true(survived < 400);
        free(copy);
        core_free(data);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test_setup_teardown(test_damage, make_folder, remove_folder)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
