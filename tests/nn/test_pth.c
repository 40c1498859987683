/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_pth.c: PyTorch files as torch.save writes them (make_pth.py), and files that mean harm.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "core/core.h"
#include "nn/pickle.h"
#include "nn/pth.h"

static void *load(const char *name, size_t *size) {
    char path[4096];
    void *data = NULL;
    snprintf(path, sizeof path, "%s/%s", TEST_DATA, name);
    assert_int_equal(core_file_load(&data, size, path, 1 << 20, NULL), BRACE_OK);
    return data;
}

/* Bytes of exactly this size on the heap, so that sanitizers see a byte too far. */
static brace_status parse_copy(const void *data, size_t size, brace_error *error) {
    void *copy = malloc(size > 0 ? size : 1);
    assert_non_null(copy);
    memcpy(copy, data, size);
    nn_pth *file = NULL;
    brace_status status = nn_pth_parse(&file, copy, size, "f.pth", error);
    if (status == BRACE_OK) {
        unsigned sum = 0;
        for (size_t i = 0; i < nn_pth_count(file); i++) {
            const core_tensor *t = nn_pth_at(file, i);
            for (size_t k = 0; k < t->size; k++) {
                sum += ((const unsigned char *)t->data)[k];
            }
            assert_ptr_equal(nn_pth_find(file, t->name), t);
        }
        assert_true(sum < UINT32_MAX);
    } else {
        assert_null(file);
    }
    nn_pth_close(file);
    free(copy);
    return status;
}

static double element(const core_tensor *t, size_t i) {
    const unsigned char *p = (const unsigned char *)t->data + i * core_dtype_size(t->dtype);
    uint32_t bits = 0;
    float f;
    double d;
    int32_t i32;
    int64_t i64;
    switch (t->dtype) {
    case CORE_F32:
        memcpy(&f, p, 4);
        return (double)f;
    case CORE_F64:
        memcpy(&d, p, 8);
        return d;
    case CORE_BF16:
        memcpy((char *)&bits + 2, p, 2);
        memcpy(&f, &bits, 4);
        return (double)f;
    case CORE_F16:
        memcpy(&bits, p, 2);
        return bits == 0 ? 0 : ldexp(1024 + (bits & 1023), (int)(bits >> 10) - 25);
    case CORE_I32:
        memcpy(&i32, p, 4);
        return i32;
    case CORE_I64:
        memcpy(&i64, p, 8);
        return (double)i64;
    default:
        return *p;
    }
}

static const struct {
    const char *name;
    core_dtype dtype;
    int rank, shape[3], first;
    int order[24]; /* of elements, for those that are not counted up */
} expected[] = {
    {"state_dict.f32", CORE_F32, 2, {2, 3, 0}, 0, {0}},
    {"state_dict.f64", CORE_F64, 1, {2, 0, 0}, 1, {0}},
    {"state_dict.f16", CORE_F16, 1, {5, 0, 0}, 2, {0}},
    {"state_dict.bf16", CORE_BF16, 1, {5, 0, 0}, 3, {0}},
    {"state_dict.i64", CORE_I64, 1, {3, 0, 0}, 4, {0}},
    {"state_dict.i32", CORE_I32, 1, {3, 0, 0}, 5, {0}},
    {"state_dict.u8", CORE_U8, 1, {7, 0, 0}, 6, {0}},
    {"state_dict.bool", CORE_U8, 1, {4, 0, 0}, 0, {1, 0, 1, 0}},
    {"state_dict.shared.all", CORE_F32, 3, {2, 3, 4}, 8, {0}},
    {"state_dict.shared.turned", CORE_F32, 3, {4, 2, 3}, 8, {0, 4, 8,  12, 16, 20, 1, 5, 9,  13, 17, 21,
                                                             2, 6, 10, 14, 18, 22, 3, 7, 11, 15, 19, 23}},
    {"state_dict.shared.part", CORE_F32, 1, {4, 0, 0}, 13, {0}},
    {"state_dict.shared.column", CORE_F32, 1, {6, 0, 0}, 8, {1, 5, 9, 13, 17, 21}},
    {"state_dict.scalar", CORE_F32, 0, {0, 0, 0}, 9, {0}},
    {"state_dict.empty", CORE_F32, 2, {0, 3, 0}, 0, {0}},
    {"state_dict.parameter", CORE_F32, 1, {3, 0, 0}, 10, {0}},
    {"list.0", CORE_F32, 1, {2, 0, 0}, 11, {0}},
    {"list.1.0", CORE_F32, 1, {2, 0, 0}, 12, {0}},
    {"3", CORE_F32, 1, {1, 0, 0}, 13, {0}},
};
enum { EXPECTED = sizeof expected / sizeof expected[0] };

static void test_files(void **state) {
    (void)state;
    static const char *const files[] = {"zip.pth", "legacy.pth", "deflated.pth"};
    for (int f = 0; f < 3; f++) {
        char path[4096];
        nn_pth *file = NULL;
        snprintf(path, sizeof path, "%s/%s", TEST_DATA, files[f]);
        assert_int_equal(nn_pth_open(&file, path, NULL), BRACE_OK);
        assert_int_equal(nn_pth_count(file), EXPECTED);
        for (int i = 0; i < EXPECTED; i++) {
            const core_tensor *t = nn_pth_at(file, (size_t)i);
            size_t count = 1;
            assert_string_equal(t->name, expected[i].name);
            assert_ptr_equal(nn_pth_find(file, expected[i].name), t);
            assert_int_equal(t->dtype, expected[i].dtype);
            assert_int_equal(t->rank, expected[i].rank);
            for (int k = 0; k < t->rank; k++) {
                assert_int_equal(t->shape[k], expected[i].shape[k]);
                count *= (size_t)t->shape[k];
            }
            assert_int_equal(t->size, count * core_dtype_size(t->dtype));
            bool ordered = false;
            for (size_t k = 0; k < 24; k++) {
                ordered = ordered || expected[i].order[k] != 0;
            }
            for (size_t k = 0; k < count; k++) {
                int want = expected[i].first + (ordered ? expected[i].order[k] : (int)k);
                assert_true(element(t, k) == want);
            }
        }
        assert_null(nn_pth_find(file, "f32"));
        nn_pth_close(file);
    }
}

static void test_small(void **state) {
    (void)state;
    char path[4096];
    nn_pth *file = NULL;
    snprintf(path, sizeof path, "%s/python2.pth", TEST_DATA);
    assert_int_equal(nn_pth_open(&file, path, NULL), BRACE_OK);
    assert_int_equal(nn_pth_count(file), 2);
    const core_tensor *a = nn_pth_find(file, "a"), *b = nn_pth_find(file, "b");
    assert_true(a != NULL && b != NULL && a->rank == 2 && b->rank == 1 && b->shape[0] == 2);
    assert_true(element(a, 5) == 5 && element(b, 0) == 3 && element(b, 1) == 4);
    nn_pth_close(file);
    snprintf(path, sizeof path, "%s/bare.pth", TEST_DATA);
    assert_int_equal(nn_pth_open(&file, path, NULL), BRACE_OK);
    assert_string_equal(nn_pth_at(file, 0)->name, "tensor");
    assert_true(element(nn_pth_at(file, 0), 3) == 17);
    nn_pth_close(file);
    nn_pth_close(NULL);
    brace_error error;
    assert_int_equal(nn_pth_open(&file, TEST_DATA "/none.pth", &error), BRACE_ERROR_IO);
    assert_non_null(strstr(error.message, "no such file"));
    assert_int_equal(nn_pth_open(&file, TEST_DATA, &error), BRACE_ERROR_FORMAT);
}

/* Cut off anywhere: an error, but for bytes behind what counts. */
static void test_truncated(void **state) {
    (void)state;
    static const char *const files[] = {"zip.pth", "legacy.pth", "deflated.pth", "python2.pth", "bare.pth"};
    for (int f = 0; f < 5; f++) {
        size_t size = 0;
        void *data = load(files[f], &size);
        assert_int_equal(parse_copy(data, size, NULL), BRACE_OK);
        for (size_t n = 0; n < size; n++) {
            brace_error error = {0};
            brace_status status = parse_copy(data, n, &error);
            assert_true(status == BRACE_ERROR_FORMAT || status == BRACE_ERROR_UNSUPPORTED);
            assert_non_null(strstr(error.message, "f.pth: "));
        }
        core_free(data);
    }
}

/* Any byte changed: nothing worse than an error. */
static void test_flipped(void **state) {
    (void)state;
    static const char *const files[] = {"zip.pth", "legacy.pth", "deflated.pth", "python2.pth"};
    static const unsigned char flips[] = {0xff, 0x01, 0x80, 0x10};
    for (int f = 0; f < 4; f++) {
        size_t size = 0;
        unsigned char *data = load(files[f], &size);
        for (size_t i = 0; i < size; i++) {
            unsigned char flip = flips[(i + (size_t)f) % 4];
            data[i] ^= flip;
            parse_copy(data, size, NULL);
            data[i] ^= flip;
        }
        core_free(data);
    }
}

/* ---- pickles that mean harm ---- */

static brace_status pickle(const char *bytes, size_t size, brace_error *error) {
    nn_pickle *p = NULL;
    size_t used = 0;
    char *copy = malloc(size);
    assert_non_null(copy);
    memcpy(copy, bytes, size);
    brace_status status = nn_pickle_read(&p, &used, copy, size, "p", error);
    nn_pickle_destroy(p);
    free(copy);
    return status;
}

#define STORE "(U\7storagectorch\nFloatStorage\nU\0010U\3cpu" /* then the count and tQ */
#define VIEW "ctorch._utils\n_rebuild_tensor_v2\n("

static void test_pickles(void **state) {
    (void)state;
    static const struct {
        const char *bytes;
        size_t size;
        brace_status status;
        const char *says;
    } cases[] = {
#define CASE(text, status, says) {text, sizeof text - 1, status, says}
        CASE("\x80\2}.", BRACE_OK, ""),
        CASE("\x80\2(]}q\1h\1t.", BRACE_OK, ""),
        CASE("\x80\2]q\0h\0a.", BRACE_OK, ""), /* a list that contains itself */
        CASE("", BRACE_ERROR_FORMAT, "cut off"),
        CASE("\x80\7.", BRACE_ERROR_FORMAT, ""),
        CASE(".", BRACE_ERROR_FORMAT, ""),
        CASE("(.", BRACE_ERROR_FORMAT, ""),
        CASE("0.", BRACE_ERROR_FORMAT, ""),
        CASE("1.", BRACE_ERROR_FORMAT, ""),
        CASE("N", BRACE_ERROR_FORMAT, ""),
        CASE("cos\nsystem\n(U\4ls /tR.", BRACE_ERROR_UNSUPPORTED, "os.system"),
        CASE("cbuiltins\neval\n.", BRACE_ERROR_UNSUPPORTED, "builtins.eval"),
        CASE("\x8c\2os\x8c\6system\x93.", BRACE_ERROR_UNSUPPORTED, "os.system"),
        CASE("c\xff\n\x1b[1m\n.", BRACE_ERROR_UNSUPPORTED, "'?.?[1m'"),
        CASE("cos\nsystem", BRACE_ERROR_FORMAT, ""),
        CASE("i", BRACE_ERROR_UNSUPPORTED, "0x69"),    /* INST */
        CASE("\x81", BRACE_ERROR_UNSUPPORTED, "0x81"), /* NEWOBJ */
        CASE("NNR.", BRACE_ERROR_FORMAT, ""),
        CASE("ctorch\nFloatStorage\n)R.", BRACE_ERROR_FORMAT, ""),
        CASE("ccollections\nOrderedDict\n(NtR.", BRACE_ERROR_FORMAT, ""),
        CASE("ccollections\nOrderedDict\n(](]NaetR.", BRACE_ERROR_FORMAT, ""),
        CASE("Nq\0h\1.", BRACE_ERROR_FORMAT, ""),
        CASE("Nr\377\377\377\377.", BRACE_ERROR_FORMAT, ""),
        CASE("h\0.", BRACE_ERROR_FORMAT, ""),
        CASE("(q\0.", BRACE_ERROR_FORMAT, ""),
        CASE("Na.", BRACE_ERROR_FORMAT, ""),
        CASE("NNa.", BRACE_ERROR_FORMAT, ""),
        CASE("}(Nu.", BRACE_ERROR_FORMAT, ""),
        CASE("(Nu.", BRACE_ERROR_FORMAT, ""),
        CASE("](N(e.", BRACE_ERROR_FORMAT, ""),
        CASE("N\x87.", BRACE_ERROR_FORMAT, ""),
        CASE("((N\x86.", BRACE_ERROR_FORMAT, ""),
        CASE("X\377\377\377\377a.", BRACE_ERROR_FORMAT, ""),
        CASE("\x8d\377\377\377\377\377\377\377\377a.", BRACE_ERROR_FORMAT, ""),
        CASE("\x8a\11\1\1\1\1\1\1\1\1\1.", BRACE_ERROR_UNSUPPORTED, "64 bits"),
        CASE("NQ.", BRACE_ERROR_FORMAT, ""),
        CASE("}Nb.", BRACE_ERROR_FORMAT, ""),
        CASE("N}b.", BRACE_ERROR_FORMAT, ""),
        CASE(STORE "K\6tQ.", BRACE_OK, ""),
        CASE(STORE "J\377\377\377\377tQ.", BRACE_ERROR_FORMAT, ""),
        CASE(VIEW STORE "K\6tQK\0(K\2K\3t(K\3K\1ttR.", BRACE_OK, ""),
        CASE(VIEW STORE "K\6tQK\1(K\2K\3t(K\3K\1ttR.", BRACE_ERROR_FORMAT, "larger"),
        CASE(VIEW STORE "K\6tQK\0(K\2K\3t(K\4K\1ttR.", BRACE_ERROR_FORMAT, "larger"),
        CASE(VIEW STORE "K\6tQK\0(K\2K\3t(K\3ttR.", BRACE_ERROR_FORMAT, ""),
        CASE(VIEW STORE "K\6tQK\0(K\2J\377\377\377\377t(K\3K\1ttR.", BRACE_ERROR_FORMAT, ""),
        CASE(VIEW STORE "K\6tQJ\377\377\377\377(K\1t(K\1ttR.", BRACE_ERROR_FORMAT, ""),
        /* 2^62 * 2^62 elements; and a stride that wraps around */
        CASE(VIEW STORE "K\6tQK\0(\x8a\10\0\0\0\0\0\0\0\x40\x8a\10\0\0\0\0\0\0\0\x40t(K\0K\0ttR.", BRACE_ERROR_FORMAT,
             "larger"),
        CASE(VIEW STORE "K\6tQK\0(K\3t(\x8a\10\0\0\0\0\0\0\0\x40ttR.", BRACE_ERROR_FORMAT, "larger"),
        CASE(VIEW STORE "K\6tQK\0(K\1K\1K\1K\1K\1K\1K\1K\1K\1t(K\1K\1K\1K\1K\1K\1K\1K\1K\1ttR.", BRACE_ERROR_FORMAT,
             ""),
        CASE(VIEW "NK\0(K\1t(K\1ttR.", BRACE_ERROR_FORMAT, ""),
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        brace_error error = {0};
        brace_status status = pickle(cases[i].bytes, cases[i].size, &error);
        if (status != cases[i].status || strstr(error.message, cases[i].says) == NULL) {
            fail_msg("pickle %zu: status %d, %s", i, (int)status, error.message);
        }
    }
}

/* Wraps a pickle into an old file with one storage of six floats. */
static brace_status old_file(const void *object, size_t size, brace_error *error) {
    static const char start[] = "\x80\2\x8a\12\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.\x80\2M\xe9\3.\x80\2}.",
                      keys[] = "\x80\2]U\0010a.\6\0\0\0\0\0\0\0";
    unsigned char *file = calloc(1, sizeof start + size + sizeof keys + 24);
    assert_non_null(file);
    memcpy(file, start, sizeof start - 1);
    memcpy(file + sizeof start - 1, object, size);
    memcpy(file + sizeof start - 1 + size, keys, sizeof keys - 1);
    brace_status status = parse_copy(file, sizeof start - 1 + size + sizeof keys - 1 + 24, error);
    free(file);
    return status;
}

static void test_bombs(void **state) {
    (void)state;
    enum { SIZE = 3 << 20 };
    brace_error error = {0};
    char *p = malloc(SIZE);
    assert_non_null(p);

    static const char good[] = "}U\1a" VIEW STORE "K\6tQK\0(K\2K\3t(K\3K\1ttRs.";
    assert_int_equal(old_file(good, sizeof good - 1, &error), BRACE_OK);
    static const char twice[] = "}U\1a" VIEW STORE "K\6tQK\0(K\6t(K\1ttRq\1sU\1ah\1s.";
    assert_int_equal(old_file(twice, sizeof twice - 1, &error), BRACE_ERROR_FORMAT);
    assert_non_null(strstr(error.message, "two tensors"));
    static const char none[] = "}.";
    assert_int_equal(old_file(none, sizeof none - 1, &error), BRACE_ERROR_UNSUPPORTED);
    /* Storage 0 once with six, once with five numbers. */
    static const char disagree[] = "}U\1a" VIEW STORE "K\6tQK\0(K\2t(K\1ttRsU\1b" VIEW STORE "K\5tQK\0(K\2t(K\1ttRs.";
    assert_int_equal(old_file(disagree, sizeof disagree - 1, &error), BRACE_ERROR_FORMAT);
    /* One number spread over 2^40 places. */
    static const char spread[] = "}U\1a" VIEW STORE "K\6tQK\0(\x8a\6\0\0\0\0\0\1t(K\0ttRs.";
    assert_int_equal(old_file(spread, sizeof spread - 1, &error), BRACE_ERROR_UNSUPPORTED);
    assert_non_null(strstr(error.message, "memory"));
    /* A dict in itself; and each of thirty dicts twice in the next one. */
    static const char inside[] = "}q\0U\1ah\0s.";
    assert_int_equal(old_file(inside, sizeof inside - 1, &error), BRACE_ERROR_UNSUPPORTED);
    assert_non_null(strstr(error.message, "deep"));
    size_t n = 0;
    p[n++] = ']', p[n++] = 'q', p[n++] = 0;
    for (int i = 0; i < 14; i++) { /* 64 times in each of 14: 2^84 */
        p[n++] = ']', p[n++] = 'q', p[n++] = (char)(i + 1), p[n++] = '(';
        for (int k = 0; k < 64; k++) {
            p[n++] = 'h', p[n++] = (char)i;
        }
        p[n++] = 'e';
    }
    p[n++] = '.';
    assert_int_equal(old_file(p, n, &error), BRACE_ERROR_UNSUPPORTED);
    assert_non_null(strstr(error.message, "million"));
    /* Millions of lists, marks, of one tuple's copies. */
    memset(p, ']', SIZE);
    assert_int_equal(pickle(p, SIZE, &error), BRACE_ERROR_UNSUPPORTED);
    memset(p, '(', SIZE);
    assert_int_equal(pickle(p, SIZE, &error), BRACE_ERROR_FORMAT);
    memset(p, '(', SIZE / 2);
    memset(p + SIZE / 2, 't', SIZE / 2);
    assert_int_equal(pickle(p, SIZE, &error), BRACE_ERROR_UNSUPPORTED);
    n = 0;
    p[n++] = '(';
    for (int i = 0; i < 1000; i++) {
        p[n++] = ']';
    }
    p[n++] = 't', p[n++] = 'q', p[n++] = 0;
    static const char again[] = "]((h\0e"; /* lists that take the tuple */
    while (n + 8 < SIZE) {
        memcpy(p + n, again, 6);
        n += 6;
    }
    p[n++] = '.';
    assert_int_not_equal(pickle(p, n, &error), BRACE_OK);
    /* OrderedDict of a long list, again and again. */
    n = 0;
    p[n++] = ']', p[n++] = 'q', p[n++] = 0, p[n++] = '(';
    for (int i = 0; i < 1000; i++) {
        p[n++] = 'N', p[n++] = 'N', p[n++] = '\x86';
    }
    p[n++] = 'e';
    static const char call[] = "ccollections\nOrderedDict\nh\0\x85R0";
    while (n + sizeof call < SIZE) {
        memcpy(p + n, call, sizeof call - 1);
        n += sizeof call - 1;
    }
    assert_int_equal(pickle(p, n, &error), BRACE_ERROR_UNSUPPORTED);
    free(p);
}

static void test_memory(void **state) {
    (void)state;
    static const char *const files[] = {"zip.pth", "legacy.pth", "deflated.pth"};
    for (int f = 0; f < 3; f++) {
        size_t size = 0;
        void *data = load(files[f], &size);
        brace_status status = BRACE_ERROR_MEMORY;
        for (long n = 1; status != BRACE_OK; n++) {
            assert_true(n < 1000);
            core_alloc_fail_after(n);
            status = parse_copy(data, size, NULL);
            core_alloc_fail_after(0);
            assert_true(status == BRACE_OK || status == BRACE_ERROR_MEMORY);
        }
        core_free(data);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_files),   cmocka_unit_test(test_small),   cmocka_unit_test(test_truncated),
        cmocka_unit_test(test_flipped), cmocka_unit_test(test_pickles), cmocka_unit_test(test_bombs),
        cmocka_unit_test(test_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
