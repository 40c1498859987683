/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pickle.h: the part of Python's pickle format in which PyTorch writes tensors.
 *
 * A pickle is a program for a small stack machine that can call any function of
 * Python. This reader knows the instructions that torch.save emits and a short list
 * of names; a "call" of one of these builds the value that it would return, and
 * every other name is refused. Nothing is executed.
 *
 * Thread safety: one nn_pickle, one thread.
 */
#ifndef NN_PICKLE_H
#define NN_PICKLE_H

#include "core/core.h"
#include "core/safetensors.h"

#define NN_PICKLE_SIZE ((size_t)16 << 20)  /* the longest pickle that is read */
#define NN_PICKLE_VALUES ((size_t)1 << 20) /* that one may make */

typedef enum nn_kind {
    NN_NONE,
    NN_BOOL,
    NN_INT,
    NN_FLOAT,
    NN_TEXT,
    NN_TUPLE,
    NN_LIST,
    NN_DICT,
    NN_NAME,    /* of something of Python: one of the known list */
    NN_STORAGE, /* numbers of one type, kept elsewhere in the file */
    NN_TENSOR   /* a view of a storage */
} nn_kind;

typedef struct nn_value nn_value;

/* What a tuple, list or dict holds, in order. */
typedef struct nn_item {
    const nn_value *key, *value; /* key: of dicts only */
    struct nn_item *next;
} nn_item;

struct nn_value {
    nn_kind kind;
    union {
        int64_t integer; /* NN_BOOL, NN_INT, and which name NN_NAME is */
        struct {
            const char *start; /* in the pickle, not terminated */
            size_t length;
        } text;
        struct {
            nn_item *first, *last;
            size_t count;
        } items;
        struct {
            const nn_value *key; /* NN_TEXT */
            core_dtype dtype;
            uint64_t count; /* numbers in the whole storage */
            uint64_t first; /* where this view of it begins */
        } storage;
        struct {
            const nn_value *storage;
            uint64_t offset; /* in numbers, from the begin of the whole storage */
            int rank;
            uint64_t shape[CORE_TENSOR_RANK], stride[CORE_TENSOR_RANK];
        } tensor;
    };
};

typedef struct nn_pickle nn_pickle;

/* Reads one pickle from the begin of `data`, which must stay as long as `out`; `used`: its length. `name` begins
 * error sentences. */
brace_status nn_pickle_read(nn_pickle **out, size_t *used, const void *data, size_t size, const char *name,
                            brace_error *error);
void nn_pickle_destroy(nn_pickle *pickle);                 /* NULL is allowed */
const nn_value *nn_pickle_result(const nn_pickle *pickle); /* lives as long as the pickle; may contain itself */

bool nn_text_is(const nn_value *value, const char *text);

#endif
