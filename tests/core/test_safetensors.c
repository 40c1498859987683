/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_safetensors.c: what is written is read back, bit for bit; headers that
 * lie are refused with a sentence; and the hash beside it is SHA-256.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <unistd.h>

#include "core/safetensors.h"
#include "core/sha256.h"

static char folder[64], path[128];

static int setup(void **state) {
    (void)state;
    strcpy(folder, "/tmp/brace-tensor-XXXXXX");
    if (mkdtemp(folder) == NULL) {
        return -1;
    }
    snprintf(path, sizeof path, "%s/a.safetensors", folder);
    return 0;
}

static int teardown(void **state) {
    (void)state;
    unlink(path);
    return rmdir(folder);
}

static void test_round_trip(void **state) {
    (void)state;
    brace_error error = {0};
    core_safetensors_writer *writer = NULL;
    uint16_t frames[2][3][4];
    for (unsigned i = 0; i < 24; i++) {
        (&frames[0][0][0])[i] = (uint16_t)(i * 2731);
    }
    const float weights[3] = {1.5f, -0.25f, 1e-30f};
    const uint8_t bytes[5] = {1, 2, 3, 250, 255};
    assert_int_equal(core_safetensors_create(&writer, path, 4096, &error), BRACE_OK);
    const core_tensor in[] = {
        {.name = "z/frames", .dtype = CORE_U16, .rank = 3, .shape = {2, 3, 4}, .data = frames},
        {.name = "weights", .dtype = CORE_F32, .rank = 1, .shape = {3}, .data = weights},
        {.name = "empty", .dtype = CORE_F32, .rank = 2, .shape = {0, 7}},
        {.name = "bytes \"quoted\" \n\xc3\xa9", .dtype = CORE_U8, .rank = 1, .shape = {5}, .data = bytes},
        {.name = "scalar", .dtype = CORE_U8, .rank = 0, .data = bytes},
    };
    for (size_t i = 0; i < 5; i++) {
        assert_int_equal(core_safetensors_add(writer, &in[i], &error), BRACE_OK);
    }
    assert_int_equal(core_safetensors_add(writer, &in[0], &error), BRACE_ERROR_ARGUMENT); /* a name twice */
    assert_int_equal(core_safetensors_add_metadata(writer, "format", "{\"a\": \"\\\"\"}\t", &error), BRACE_OK);
    assert_int_equal(core_safetensors_add_metadata(writer, "\xff", "x", &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(core_safetensors_written(writer), 48 + 12 + 5 + 1);
    assert_int_not_equal(access(path, F_OK), 0); /* not before it is complete */
    assert_int_equal(core_safetensors_commit(writer, &error), BRACE_OK);

    core_safetensors *file = NULL;
    assert_int_equal(core_safetensors_open(&file, path, &error), BRACE_OK);
    assert_int_equal(core_safetensors_count(file), 5);
    for (size_t i = 0; i < 5; i++) {
        const core_tensor *t = core_safetensors_find(file, in[i].name);
        assert_non_null(t);
        assert_int_equal(t->dtype, in[i].dtype);
        assert_int_equal(t->rank, in[i].rank);
        assert_memory_equal(t->shape, in[i].shape, sizeof *t->shape * (size_t)t->rank);
        if (t->size > 0) {
            assert_memory_equal(t->data, in[i].data, t->size);
        }
    }
    assert_int_equal((uintptr_t)core_safetensors_at(file, 0)->data % 64, 0);
    assert_string_equal(core_safetensors_at(file, 0)->name, "z/frames"); /* in the order of the data */
    assert_null(core_safetensors_find(file, "none"));
    assert_string_equal(core_safetensors_metadata(file, "format"), "{\"a\": \"\\\"\"}\t");
    assert_null(core_safetensors_metadata(file, "none"));
    assert_string_equal(core_safetensors_metadata_key(file, 0), "format");
    assert_null(core_safetensors_metadata_key(file, 1));
    core_safetensors_close(file);
}

static void test_header_full(void **state) {
    (void)state;
    core_safetensors_writer *writer = NULL;
    assert_int_equal(core_safetensors_create(&writer, path, 640, NULL), BRACE_OK);
    char name[16];
    int added = 0;
    for (int i = 0; i < 100; i++) {
        snprintf(name, sizeof name, "t%d", i);
        added += core_safetensors_add(writer, &(core_tensor){.name = name, .dtype = CORE_U8, .rank = 1, .shape = {1}, .data = "x"},
                                      NULL) == BRACE_OK;
    }
    assert_in_range(added, 1, 20);
    assert_int_equal(core_safetensors_commit(writer, NULL), BRACE_OK);
    core_safetensors *file = NULL;
    assert_int_equal(core_safetensors_open(&file, path, NULL), BRACE_OK);
    assert_int_equal(core_safetensors_count(file), added);
    core_safetensors_close(file);
    writer = NULL;
    assert_int_equal(core_safetensors_create(&writer, path, 0, NULL), BRACE_OK);
    core_safetensors_abort(writer);
}

/* A file of this header, with `size` bytes of data. */
static brace_status parse(const char *header, size_t size, brace_error *error) {
    uint64_t n = strlen(header);
    unsigned char *bytes = calloc(1, 8 + n + size);
    memcpy(bytes, &n, 8);
    memcpy(bytes + 8, header, n);
    core_safetensors *file = NULL;
    brace_status status = core_safetensors_parse(&file, bytes, 8 + n + size, "a.safetensors", error);
    core_safetensors_close(file);
    free(bytes);
    return status;
}

static void test_lies(void **state) {
    (void)state;
    brace_error error = {0};
    assert_int_equal(parse("{\"a\":{\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[0,4]}}", 4, &error), BRACE_OK);
    assert_int_equal(parse("{}    ", 0, &error), BRACE_OK);
    static const struct {
        const char *header;
        size_t size;
        brace_status status;
        const char *says;
    } bad[] = {
        {"[]", 0, BRACE_ERROR_FORMAT, "header"},
        {"{\"a\"", 0, BRACE_ERROR_FORMAT, "damaged"},
        {"{\"a\":{\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[0,4]}}", 3, BRACE_ERROR_FORMAT, "cut off"},
        {"{\"a\":{\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[0,4]}}", 5, BRACE_ERROR_FORMAT, "no array"},
        {"{\"a\":{\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[4,0]}}", 4, BRACE_ERROR_FORMAT, "outside"},
        {"{\"a\":{\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[-1,3]}}", 4, BRACE_ERROR_FORMAT, "outside"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[4],\"data_offsets\":[0,4]}}", 4, BRACE_ERROR_FORMAT, "shape makes 16"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[4611686018427387905],\"data_offsets\":[0,4]}}", 4, BRACE_ERROR_FORMAT,
         "impossible"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[1.0],\"data_offsets\":[0,4]}}", 4, BRACE_ERROR_FORMAT, "impossible"},
        {"{\"a\":{\"dtype\":\"F8_E4M3\",\"shape\":[4],\"data_offsets\":[0,4]}}", 4, BRACE_ERROR_UNSUPPORTED, "F8_E4M3"},
        {"{\"a\":{\"dtype\":\"U8\",\"shape\":[1,1,1,1,1,1,1,1,1],\"data_offsets\":[0,1]}}", 1, BRACE_ERROR_UNSUPPORTED,
         "dimensions"},
        {"{\"a\":{\"dtype\":\"U8\",\"shape\":[2],\"data_offsets\":[0,2]},"
         "\"b\":{\"dtype\":\"U8\",\"shape\":[2],\"data_offsets\":[1,3]}}",
         3, BRACE_ERROR_FORMAT, "'b'"},
        {"{\"a\":{\"dtype\":\"U8\",\"shape\":[1],\"data_offsets\":[0,1]},"
         "\"b\":{\"dtype\":\"U8\",\"shape\":[1],\"data_offsets\":[2,3]}}",
         3, BRACE_ERROR_FORMAT, "'b'"},
        {"{\"a\":{\"dtype\":\"U8\",\"shape\":[1],\"data_offsets\":[0,1]},"
         "\"a\":{\"dtype\":\"U8\",\"shape\":[1],\"data_offsets\":[0,1]}}",
         1, BRACE_ERROR_FORMAT, "duplicate"},
        {"{\"__metadata__\":{\"a\":1}}", 0, BRACE_ERROR_FORMAT, "no text"},
        {"{\"a\":[]}", 0, BRACE_ERROR_FORMAT, "lacks"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        memset(&error, 0, sizeof error);
        assert_int_equal(parse(bad[i].header, bad[i].size, &error), bad[i].status);
        if (strstr(error.message, bad[i].says) == NULL) {
            fail_msg("case %zu: \"%s\" does not say \"%s\"", i, error.message, bad[i].says);
        }
    }
    core_safetensors *file = NULL;
    unsigned char large[16] = {0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, '{', '}'};
    assert_int_equal(core_safetensors_parse(&file, large, sizeof large, "x", NULL), BRACE_ERROR_FORMAT);
    assert_int_equal(core_safetensors_parse(&file, large, 3, "x", NULL), BRACE_ERROR_FORMAT);
    assert_int_equal(core_safetensors_open(&file, "/nowhere/x", &error), BRACE_ERROR_IO);
    assert_int_equal(core_safetensors_open(&file, "/tmp", &error), BRACE_ERROR_FORMAT);
    assert_null(file);
}

static void test_memory_ends(void **state) {
    (void)state;
    for (long n = 1; n < 30; n++) {
        core_alloc_fail_after(n);
        brace_error error = {0};
        brace_status status = parse("{\"a\":{\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[0,4]},\"__metadata__\":{}}", 4, &error);
        core_alloc_fail_after(0);
        assert_true(status == BRACE_OK || status == BRACE_ERROR_MEMORY);
    }
}

static void test_sha256(void **state) {
    (void)state;
    char hex[65];
    core_sha256 hash;
    core_sha256_begin(&hash);
    core_sha256_end(&hash, hex);
    assert_string_equal(hex, "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
    core_sha256_begin(&hash);
    core_sha256_add(&hash, "abc", 3);
    core_sha256_end(&hash, hex);
    assert_string_equal(hex, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    /* FIPS 180-4's million of a, in pieces of odd sizes. */
    char text[997];
    memset(text, 'a', sizeof text);
    core_sha256_begin(&hash);
    for (size_t left = 1000000, n = 1; left > 0; left -= n, n = n * 7 % 997 + 1) {
        n = n < left ? n : left;
        core_sha256_add(&hash, text, n);
    }
    core_sha256_end(&hash, hex);
    assert_string_equal(hex, "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
    uint64_t size = 1;
    assert_int_equal(core_sha256_file(hex, "/dev/null", &size, NULL), BRACE_OK);
    assert_int_equal(size, 0);
    assert_int_equal(core_sha256_file(hex, "/nowhere", &size, NULL), BRACE_ERROR_IO);
}

/* The same without the processor's own instructions. */
static void test_sha256_plain(void **state) {
    setenv("BRACE_CPU", "plain", 1);
    test_sha256(state);
    unsetenv("BRACE_CPU");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_round_trip, setup, teardown),
        cmocka_unit_test_setup_teardown(test_header_full, setup, teardown),
        cmocka_unit_test(test_lies),
        cmocka_unit_test(test_memory_ends),
        cmocka_unit_test(test_sha256),
        cmocka_unit_test(test_sha256_plain),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
