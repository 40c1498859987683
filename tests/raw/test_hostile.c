/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_hostile.c: thousands of damaged files from fixed seeds. Each must be read
 * or refused with a sentence; under the sanitizers none may touch what it should
 * not or leave anything behind. fuzz/fuzz_raw.c searches on from here.
 */
#include <math.h>

#include "raw_test.h"

enum { MUTATIONS = 1200 };

static void check_result(brace_status status, brace_frame *f, const brace_error *e) {
    if (status != BRACE_OK) {
        assert_null(f);
        assert_int_equal(e->status, status);
        assert_true(e->message[0] != '\0');
        assert_true(status == BRACE_ERROR_FORMAT || status == BRACE_ERROR_UNSUPPORTED || status == BRACE_ERROR_MEMORY);
        return;
    }
    /* What is accepted is sound. */
    assert_true(f->width >= 4 && f->height >= 4);
    assert_in_range(f->orientation, 1, 8);
    for (int i = 0; i < 4; i++) {
        assert_true(f->black[i] >= 0.0f && f->black[i] < f->white && f->white <= 65535.0f);
    }
    for (int c = 0; c < 3; c++) {
        assert_true(f->as_shot_neutral[c] > 0.0 && isfinite(f->as_shot_neutral[c]));
        assert_true(f->noise[c][0] >= 0.0 && f->noise[c][0] <= 1.0 && f->noise[c][1] >= 0.0);
    }
    for (int i = 0; i < 18; i++) {
        assert_true(isfinite(f->color_matrix[i / 9][i % 9]));
    }
    assert_true(f->exposure_time >= 0.0 && f->iso >= 0.0 && f->f_number >= 0.0 && isfinite(f->baseline_exposure));
    brace_frame_destroy(f);
}

static void try_bytes(const uint8_t *bytes, size_t n) {
    uint8_t *copy = malloc(n + 1); /* its own block, so that the sanitizer sees one byte too many */
    memcpy(copy, bytes, n);
    copy = realloc(copy, n > 0 ? n : 1);
    brace_frame *f = NULL;
    brace_error e = {0};
    brace_status status = raw_frame_read_memory(&f, copy, n, "damaged.dng", NULL, &e);
    check_result(status, f, &e);
    free(copy);
}

static void mutate(const uint8_t *file, size_t size, uint64_t seed) {
    uint8_t *copy = malloc(size);
    for (uint32_t i = 0; i < MUTATIONS; i++) {
        core_random r = core_random_create(seed, i, 0, 0);
        memcpy(copy, file, size);
        size_t n = size;
        uint32_t flips = 1 + core_random_below(&r, 6);
        for (uint32_t k = 0; k < flips; k++) {
            /* Mostly directories, which lie at both ends of these small files. */
            uint32_t zone = core_random_below(&r, 4);
            size_t span = zone == 3 ? size : 700;
            size_t at = core_random_below(&r, (uint32_t)span);
            at = zone == 1 || zone == 2 ? size - 1 - at : at;
            switch (core_random_below(&r, 3)) {
            case 0:
                copy[at] ^= (uint8_t)(1u << core_random_below(&r, 8));
                break;
            case 1:
                copy[at] = (uint8_t)core_random_u32(&r);
                break;
            default:
                memset(copy + at, core_random_below(&r, 2) != 0 ? 0xff : 0, at + 4 <= size ? 4 : 1);
                break;
            }
        }
        if (core_random_below(&r, 8) == 0) {
            n = core_random_below(&r, (uint32_t)size);
        }
        try_bytes(copy, n);
    }
    free(copy);
}

static void load(const char *path, uint8_t **bytes, size_t *size) {
    void *p = NULL;
    assert_int_equal(core_file_load(&p, size, path, 1u << 24, NULL), BRACE_OK);
    *bytes = p;
}

static void test_strangers_dng(void **state) {
    (void)state;
    test_dng d = {.width = 32, .height = 28, .top = 1, .left = 1, .bottom = 27, .right = 31};
    write_test_dng(in_folder("seed.dng"), &d);
    uint8_t *bytes = NULL;
    size_t size = 0;
    load(in_folder("seed.dng"), &bytes, &size);
    mutate(bytes, size, 1);
    core_free(bytes);
}

static void test_own_dng(void **state) {
    (void)state;
    for (int preview = 0; preview < 2; preview++) {
        brace_frame *f = NULL;
        assert_int_equal(brace_frame_create(&f, 32, 24, BRACE_CFA_RGGB, NULL), BRACE_OK);
        f->exposure_time = 0.01;
        f->illuminant[0] = 21;
        f->color_matrix[0][0] = f->color_matrix[0][4] = f->color_matrix[0][8] = 1.0;
        f->has_noise = true;
        raw_noise_from_iso(f->noise, 100);
        brace_dng_params params = {.no_preview = preview == 0};
        assert_int_equal(brace_frame_write_dng(f, in_folder("own.dng"), &params, NULL, NULL), BRACE_OK);
        brace_frame_destroy(f);
        uint8_t *bytes = NULL;
        size_t size = 0;
        load(in_folder("own.dng"), &bytes, &size);
        mutate(bytes, size, 2 + (uint64_t)preview);
        core_free(bytes);
    }
}

static void test_every_length(void **state) {
    (void)state;
    test_dng d = {.width = 24, .height = 22};
    write_test_dng(in_folder("seed.dng"), &d);
    uint8_t *bytes = NULL;
    size_t size = 0;
    load(in_folder("seed.dng"), &bytes, &size);
    for (size_t n = 0; n <= size; n++) {
        try_bytes(bytes, n);
    }
    core_free(bytes);
}

/* The beginnings that LibRaw takes for cameras' own formats. */
static void test_other_magics(void **state) {
    (void)state;
    static const struct {
        const char *bytes;
        size_t n, at;
    } magics[] = {
        {"FUJIFILMCCD-RAW 0201", 20, 0},
        {"ftypcrx ", 8, 4},
        {"IIRO", 4, 0},
        {"IIU\0", 4, 0},
        {"II\x1a\0\0\0HEAPCCDR", 14, 0},
        {"MM\0*", 4, 0},
        {"\0MRM", 4, 0},
        {"FOVb", 4, 0},
        {"ARRI", 4, 0},
        {"NOKIARAW", 8, 0},
        {"DSC-Image", 9, 0},
        {"RIFF", 4, 0},
        {"PXN", 3, 0},
        {"qktk", 4, 0},
        {"II*\0\x10\0\0\0CR", 10, 0},
    };
    for (uint32_t i = 0; i < 30 * sizeof magics / sizeof magics[0]; i++) {
        core_random r = core_random_create(9, i, 0, 0);
        uint8_t bytes[2048];
        for (size_t k = 0; k < sizeof bytes; k++) {
            bytes[k] = core_random_below(&r, 3) == 0 ? (uint8_t)core_random_u32(&r) : 0;
        }
        memcpy(bytes + magics[i / 30].at, magics[i / 30].bytes, magics[i / 30].n);
        try_bytes(bytes, sizeof bytes);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_strangers_dng),
        cmocka_unit_test(test_own_dng),
        cmocka_unit_test(test_every_length),
        cmocka_unit_test(test_other_magics),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
