/* SPDX-License-Identifier: Apache-2.0 */
/*
 * safetensors.c: reads the header of a mapped file, trusting nothing in it.
 * Writing is in safetensors_write.c.
 */
#include "core/safetensors.h"

#include <stdlib.h>
#include <string.h>

#include <jansson.h>

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "arrays are used as they lie in the file");

static const struct {
    const char *name;
    size_t size;
} dtypes[] = {
    [CORE_U8] = {"U8", 1},    [CORE_U16] = {"U16", 2}, [CORE_F16] = {"F16", 2}, [CORE_BF16] = {"BF16", 2},
    [CORE_F32] = {"F32", 4},  [CORE_F64] = {"F64", 8}, [CORE_I32] = {"I32", 4}, [CORE_I64] = {"I64", 8},
};
enum { DTYPES = sizeof dtypes / sizeof dtypes[0] };

size_t core_dtype_size(core_dtype dtype) {
    return dtypes[dtype].size;
}

const char *core_dtype_name(core_dtype dtype) {
    return dtypes[dtype].name;
}

struct core_safetensors {
    void *map; /* NULL: the bytes are the caller's */
    size_t mapped;
    json_t *header; /* owns names and texts */
    core_tensor *tensors;
    size_t count;
    const char **keys; /* of the metadata */
    size_t key_count;
    core_tensor **by_name; /* sorted */
};

void core_safetensors_close(core_safetensors *file) {
    if (file == NULL) {
        return;
    }
    if (file->map != NULL) {
        core_file_unmap(file->map, file->mapped);
    }
    json_decref(file->header);
    core_free(file->tensors);
    core_free((void *)file->keys);
    core_free((void *)file->by_name);
    core_free(file);
}

/* A whole number from 0 to `most`. */
static bool whole(const json_t *value, uint64_t most, uint64_t *out) {
    if (!json_is_integer(value) || json_integer_value(value) < 0 || (uint64_t)json_integer_value(value) > most) {
        return false;
    }
    *out = (uint64_t)json_integer_value(value);
    return true;
}

static brace_status read_tensor(core_tensor *t, json_t *entry, const unsigned char *data, size_t size,
                                const char *name, brace_error *error) {
    const char *dtype = json_string_value(json_object_get(entry, "dtype"));
    json_t *shape = json_object_get(entry, "shape"), *offsets = json_object_get(entry, "data_offsets");
    if (dtype == NULL || !json_is_array(shape) || !json_is_array(offsets) || json_array_size(offsets) != 2) {
        return core_fail(error, BRACE_ERROR_FORMAT, "%s: array '%s' lacks its dtype, shape or data_offsets", name,
                         t->name);
    }
    unsigned kind = 0;
    while (kind < DTYPES && strcmp(dtypes[kind].name, dtype) != 0) {
        kind++;
    }
    if (kind == DTYPES) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED, "%s: array '%s' has numbers of the type '%.20s'", name,
                         t->name, dtype);
    }
    t->dtype = (core_dtype)kind;
    if (json_array_size(shape) > CORE_TENSOR_RANK) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED, "%s: array '%s' has more than %d dimensions", name, t->name,
                         CORE_TENSOR_RANK);
    }
    t->rank = (int)json_array_size(shape);
    size_t bytes = dtypes[kind].size;
    for (int i = 0; i < t->rank; i++) {
        if (!whole(json_array_get(shape, (size_t)i), INT64_MAX, &t->shape[i]) ||
            __builtin_mul_overflow(bytes, t->shape[i], &bytes)) {
            return core_fail(error, BRACE_ERROR_FORMAT, "%s: array '%s' has an impossible shape", name, t->name);
        }
    }
    uint64_t begin, end;
    if (!whole(json_array_get(offsets, 0), size, &begin) || !whole(json_array_get(offsets, 1), size, &end) ||
        begin > end) {
        return core_fail(error, BRACE_ERROR_FORMAT, "%s: array '%s' lies outside the file; it may have been cut off",
                         name, t->name);
    }
    if (end - begin != bytes) {
        return core_fail(error, BRACE_ERROR_FORMAT,
                         "%s: array '%s' has %llu bytes, but its shape makes %zu", name, t->name,
                         (unsigned long long)(end - begin), bytes);
    }
    t->data = data + begin;
    t->size = bytes;
    return BRACE_OK;
}

static int by_place(const void *a, const void *b) {
    const core_tensor *x = a, *y = b;
    const char *p = x->data, *q = y->data;
    if (p != q) {
        return p < q ? -1 : 1;
    }
    return x->size != y->size ? (x->size < y->size ? -1 : 1) : strcmp(x->name, y->name);
}

static int by_name(const void *a, const void *b) {
    return strcmp((*(core_tensor *const *)a)->name, (*(core_tensor *const *)b)->name);
}

static brace_status read_metadata(core_safetensors *file, json_t *metadata, const char *name, brace_error *error) {
    if (!json_is_object(metadata)) {
        return core_fail(error, BRACE_ERROR_FORMAT, "%s: __metadata__ is no JSON object", name);
    }
    size_t n = json_object_size(metadata);
    file->keys = core_calloc(n + 1, sizeof *file->keys);
    if (file->keys == NULL) {
        return core_fail_memory(error, n * sizeof *file->keys, "metadata");
    }
    const char *key;
    json_t *value;
    json_object_foreach(metadata, key, value) {
        if (!json_is_string(value)) {
            return core_fail(error, BRACE_ERROR_FORMAT, "%s: __metadata__ '%.100s' is no text", name, key);
        }
        file->keys[file->key_count++] = key;
    }
    return BRACE_OK;
}

static brace_status read_header(core_safetensors *file, const unsigned char *data, size_t size, const char *name,
                                brace_error *error) {
    if (size < 10) {
        return core_fail(error, BRACE_ERROR_FORMAT, "%s: no safetensors file: it has %zu bytes only", name, size);
    }
    uint64_t n;
    memcpy(&n, data, 8);
    if (n > size - 8 || n < 2 || data[8] != '{') {
        return core_fail(error, BRACE_ERROR_FORMAT, "%s: no safetensors file, or cut off: its header is missing", name);
    }
    if (n > CORE_SAFETENSORS_HEADER) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED, "%s: its header of %llu bytes is too long", name,
                         (unsigned long long)n);
    }
    json_error_t problem;
    file->header = json_loadb((const char *)data + 8, (size_t)n, JSON_REJECT_DUPLICATES, &problem);
    if (!json_is_object(file->header)) {
        return core_fail(error, BRACE_ERROR_FORMAT, "%s: its header is damaged: %s", name,
                         file->header != NULL ? "no JSON object" : problem.text);
    }
    file->tensors = core_calloc(json_object_size(file->header) + 1, sizeof *file->tensors);
    file->by_name = core_calloc(json_object_size(file->header) + 1, sizeof *file->by_name);
    if (file->tensors == NULL || file->by_name == NULL) {
        return core_fail_memory(error, json_object_size(file->header) * sizeof *file->tensors, "a list of arrays");
    }
    const char *key;
    json_t *entry;
    json_object_foreach(file->header, key, entry) {
        brace_status status;
        if (strcmp(key, "__metadata__") == 0) {
            status = read_metadata(file, entry, name, error);
        } else {
            core_tensor *t = &file->tensors[file->count];
            t->name = key;
            status = read_tensor(t, entry, data + 8 + n, size - 8 - (size_t)n, name, error);
            file->count += status == BRACE_OK;
        }
        if (status != BRACE_OK) {
            return status;
        }
    }
    /* The arrays fill the rest of the file: a gap would be a place to hide things, an overlap a lie. */
    if (file->count > 1) {
        qsort(file->tensors, file->count, sizeof *file->tensors, by_place);
    }
    const unsigned char *at = data + 8 + n;
    for (size_t i = 0; i < file->count; i++) {
        if (file->tensors[i].data != at) {
            return core_fail(error, BRACE_ERROR_FORMAT, "%s: array '%s' does not begin where the one before it ends",
                             name, file->tensors[i].name);
        }
        at += file->tensors[i].size;
        file->by_name[i] = &file->tensors[i];
    }
    if (at != data + size) {
        return core_fail(error, BRACE_ERROR_FORMAT, "%s: %zu bytes at its end belong to no array", name,
                         (size_t)(data + size - at));
    }
    if (file->count > 1) {
        qsort((void *)file->by_name, file->count, sizeof *file->by_name, by_name);
    }
    return BRACE_OK;
}

brace_status core_safetensors_parse(core_safetensors **out, const void *data, size_t size, const char *name,
                                    brace_error *error) {
    *out = NULL;
    core_safetensors *file = core_calloc(1, sizeof *file);
    if (file == NULL) {
        return core_fail_memory(error, sizeof *file, "a file");
    }
    brace_status status = read_header(file, data, size, name, error);
    if (status != BRACE_OK) {
        core_safetensors_close(file);
        return status;
    }
    *out = file;
    return BRACE_OK;
}

brace_status core_safetensors_open(core_safetensors **out, const char *path, brace_error *error) {
    *out = NULL;
    void *map;
    size_t size;
    brace_status status = core_file_map(&map, &size, path, 10, "safetensors file", error);
    if (status != BRACE_OK) {
        return status;
    }
    status = core_safetensors_parse(out, map, size, path, error);
    if (status != BRACE_OK) {
        core_file_unmap(map, size);
        return status;
    }
    (*out)->map = map;
    (*out)->mapped = size;
    return BRACE_OK;
}

size_t core_safetensors_count(const core_safetensors *file) {
    return file->count;
}

const core_tensor *core_safetensors_at(const core_safetensors *file, size_t index) {
    return &file->tensors[index];
}

const core_tensor *core_safetensors_find(const core_safetensors *file, const char *name) {
    if (file->count == 0) {
        return NULL;
    }
    core_tensor wanted = {.name = name}, *key = &wanted;
    core_tensor *const *found =
        bsearch(&key, (void *)file->by_name, file->count, sizeof *file->by_name, by_name);
    return found != NULL ? *found : NULL;
}

const char *core_safetensors_metadata(const core_safetensors *file, const char *key) {
    return json_string_value(json_object_get(json_object_get(file->header, "__metadata__"), key));
}

const char *core_safetensors_metadata_key(const core_safetensors *file, size_t index) {
    return index < file->key_count ? file->keys[index] : NULL;
}
