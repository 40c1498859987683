/* SPDX-License-Identifier: Apache-2.0 */
/*
 * safetensors.h: named arrays of numbers in one file, mapped and not read.
 *
 * The format (github.com/huggingface/safetensors): 8 bytes, the length n of the
 * header, little-endian; n bytes of JSON, {"name": {"dtype": "U16", "shape":
 * [5, 768, 1024], "data_offsets": [begin, end]}, ..., "__metadata__": {texts}};
 * then the arrays, without gaps, little-endian, rows first. BRACE keeps training
 * sets and the weights of its networks in it.
 */
#ifndef CORE_SAFETENSORS_H
#define CORE_SAFETENSORS_H

#include "core/core.h"

typedef enum core_dtype { CORE_U8, CORE_U16, CORE_F16, CORE_BF16, CORE_F32, CORE_F64, CORE_I32, CORE_I64 } core_dtype;
size_t core_dtype_size(core_dtype dtype);
const char *core_dtype_name(core_dtype dtype); /* "U8", "U16", ... */

#define CORE_TENSOR_RANK 8
#define CORE_SAFETENSORS_HEADER ((size_t)32 << 20) /* the longest header that is read or written */

typedef struct core_tensor {
    const char *name;
    core_dtype dtype;
    int rank; /* 0: one number */
    uint64_t shape[CORE_TENSOR_RANK];
    const void *data; /* aligned for its type in files that BRACE wrote; others may need memcpy */
    size_t size;      /* bytes: the product of the shape times the type's size */
} core_tensor;

/* ---- reading ---- */

typedef struct core_safetensors core_safetensors;

/* Maps a file: its pages are read when they are touched, and the file must not shrink
 * while it is open. The header is checked whole: every array lies in the file, as large
 * as its shape says, and no two overlap. */
brace_status core_safetensors_open(core_safetensors **out, const char *path, brace_error *error);
/* The same of bytes in memory, which must stay as long as `out`. */
brace_status core_safetensors_parse(core_safetensors **out, const void *data, size_t size, const char *name,
                                    brace_error *error);
void core_safetensors_close(core_safetensors *file); /* NULL is allowed */

size_t core_safetensors_count(const core_safetensors *file);
const core_tensor *core_safetensors_at(const core_safetensors *file, size_t index);        /* in the order of the data */
const core_tensor *core_safetensors_find(const core_safetensors *file, const char *name);  /* NULL: none */
const char *core_safetensors_metadata(const core_safetensors *file, const char *key);      /* NULL: none */
/* The keys of the metadata in the file's order: NULL after the last. */
const char *core_safetensors_metadata_key(const core_safetensors *file, size_t index);

/* ---- writing ---- */

typedef struct core_safetensors_writer core_safetensors_writer;

/* Arrays are written as they are added; the header is written last, into room kept
 * before them. `reserve`: bytes of room; 0: 1 MiB. Unused room is padded with spaces,
 * as the format allows. */
brace_status core_safetensors_create(core_safetensors_writer **out, const char *path, size_t reserve,
                                     brace_error *error);
/* `tensor->size` is computed here. Names must differ. */
brace_status core_safetensors_add(core_safetensors_writer *writer, const core_tensor *tensor, brace_error *error);
brace_status core_safetensors_add_metadata(core_safetensors_writer *writer, const char *key, const char *text,
                                           brace_error *error);
size_t core_safetensors_room(const core_safetensors_writer *writer); /* bytes of header still free, about */
size_t core_safetensors_written(const core_safetensors_writer *writer); /* bytes of arrays so far */
/* The file appears under its name. Frees the writer in either case. */
brace_status core_safetensors_commit(core_safetensors_writer *writer, brace_error *error);
void core_safetensors_abort(core_safetensors_writer *writer); /* NULL is allowed */

#endif
