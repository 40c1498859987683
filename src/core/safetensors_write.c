/* SPDX-License-Identifier: Apache-2.0 */
/*
 * safetensors_write.c: writes arrays one after another, and the header that
 * describes them into the room kept before them. So a file larger than memory can
 * be written in one go.
 */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include <jansson.h>

#include "core/safetensors.h"

struct core_safetensors_writer {
    core_file *file;
    char *path;
    json_t *header, *metadata;
    size_t reserve, used; /* bytes of header: kept, needed so far at most */
    size_t written;       /* of data */
};

void core_safetensors_abort(core_safetensors_writer *writer) {
    if (writer != NULL) {
        core_file_abort(writer->file);
        json_decref(writer->header);
        json_decref(writer->metadata);
        core_free(writer->path);
        core_free(writer);
    }
}

brace_status core_safetensors_create(core_safetensors_writer **out, const char *path, size_t reserve,
                                     brace_error *error) {
    *out = NULL;
    core_safetensors_writer *writer = core_calloc(1, sizeof *writer);
    if (writer == NULL) {
        return core_fail_memory(error, sizeof *writer, "a file");
    }
    /* The data begins at a multiple of 64, so that vectors can be loaded from the mapping. */
    writer->reserve = (reserve > 0 ? reserve : (size_t)1 << 20) / 64 * 64 + 56;
    writer->header = json_object();
    writer->metadata = json_object();
    writer->path = core_strdup(path);
    writer->used = 64;
    brace_status status = writer->header != NULL && writer->metadata != NULL && writer->path != NULL
                              ? core_file_create(&writer->file, path, error)
                              : core_fail_memory(error, 1024, "a header");
    if (status == BRACE_OK && writer->reserve > CORE_SAFETENSORS_HEADER) {
        status = core_fail(error, BRACE_ERROR_ARGUMENT, "%s: a header of %zu bytes is too long", path, reserve);
    }
    if (status == BRACE_OK &&
        fseeko(core_file_stream(writer->file), (off_t)(writer->reserve + 8), SEEK_SET) != 0) {
        status = core_fail(error, BRACE_ERROR_IO, "%s: cannot write: %s", path, strerror(errno));
    }
    if (status != BRACE_OK) {
        core_safetensors_abort(writer);
        return status;
    }
    *out = writer;
    return BRACE_OK;
}

/* The most bytes that a text takes as JSON. */
static size_t quoted(const char *text) {
    size_t n = 6;
    for (const unsigned char *p = (const unsigned char *)text; *p != '\0'; p++) {
        n += *p < 0x20 ? 6 : *p == '"' || *p == '\\' ? 2 : 1;
    }
    return n;
}

static brace_status take_room(core_safetensors_writer *writer, size_t bytes, brace_error *error) {
    if (bytes > writer->reserve - writer->used) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%s: the header needs more than the %zu bytes kept for it",
                         writer->path, writer->reserve);
    }
    writer->used += bytes;
    return BRACE_OK;
}

brace_status core_safetensors_add(core_safetensors_writer *writer, const core_tensor *tensor, brace_error *error) {
    size_t bytes = core_dtype_size(tensor->dtype);
    if (tensor->rank < 0 || tensor->rank > CORE_TENSOR_RANK || strcmp(tensor->name, "__metadata__") == 0 ||
        json_object_get(writer->header, tensor->name) != NULL) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%s: array '%s' is there twice, or has an impossible rank",
                         writer->path, tensor->name);
    }
    json_t *shape = json_array();
    for (int i = 0; i < tensor->rank; i++) {
        json_array_append_new(shape, json_integer((json_int_t)tensor->shape[i]));
        if (tensor->shape[i] > INT64_MAX || __builtin_mul_overflow(bytes, tensor->shape[i], &bytes)) {
            json_decref(shape);
            return core_fail(error, BRACE_ERROR_ARGUMENT, "%s: array '%s' is too large", writer->path, tensor->name);
        }
    }
    brace_status status = take_room(writer, quoted(tensor->name) + 120 + 21 * (size_t)tensor->rank, error);
    if (status != BRACE_OK) {
        json_decref(shape);
        return status;
    }
    json_t *entry = json_pack("{s:s, s:o, s:[I,I]}", "dtype", core_dtype_name(tensor->dtype), "shape", shape,
                              "data_offsets", (json_int_t)writer->written, (json_int_t)(writer->written + bytes));
    if (json_object_set_new(writer->header, tensor->name, entry) != 0) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%s: the name of an array is not UTF-8, or memory ended",
                         writer->path);
    }
    if (bytes > 0 && fwrite(tensor->data, 1, bytes, core_file_stream(writer->file)) != bytes) {
        return core_fail(error, BRACE_ERROR_IO, "%s: cannot write: %s", writer->path,
                         errno == ENOSPC ? "no space left on the disk" : strerror(errno));
    }
    writer->written += bytes;
    return BRACE_OK;
}

brace_status core_safetensors_add_metadata(core_safetensors_writer *writer, const char *key, const char *text,
                                           brace_error *error) {
    brace_status status = take_room(writer, quoted(key) + quoted(text), error);
    if (status == BRACE_OK && json_object_set_new(writer->metadata, key, json_string(text)) != 0) {
        status = core_fail(error, BRACE_ERROR_ARGUMENT, "%s: a text is not UTF-8, or memory ended", writer->path);
    }
    return status;
}

size_t core_safetensors_room(const core_safetensors_writer *writer) {
    return writer->reserve - writer->used;
}

size_t core_safetensors_written(const core_safetensors_writer *writer) {
    return writer->written;
}

brace_status core_safetensors_commit(core_safetensors_writer *writer, brace_error *error) {
    json_t *all = json_object();
    if (all == NULL || (json_object_size(writer->metadata) > 0 &&
                        json_object_set(all, "__metadata__", writer->metadata) != 0) ||
        json_object_update(all, writer->header) != 0) {
        json_decref(all);
        core_safetensors_abort(writer);
        return core_fail_memory(error, 1024, "a header");
    }
    char *text = json_dumps(all, JSON_COMPACT);
    json_decref(all);
    size_t length = text != NULL ? strlen(text) : 0;
    if (text == NULL || length > writer->reserve) {
        free(text);
        core_safetensors_abort(writer);
        return core_fail_memory(error, 1024, "a header");
    }
    FILE *f = core_file_stream(writer->file);
    uint64_t n = writer->reserve;
    bool good = fseeko(f, 0, SEEK_SET) == 0 && fwrite(&n, 8, 1, f) == 1 && fwrite(text, 1, length, f) == length;
    free(text);
    for (size_t i = length; good && i < writer->reserve; i++) {
        good = putc(' ', f) != EOF;
    }
    brace_status status;
    if (good) {
        status = core_file_commit(writer->file, error);
        writer->file = NULL;
    } else {
        status = core_fail(error, BRACE_ERROR_IO, "%s: cannot write: %s", writer->path, strerror(errno));
    }
    core_safetensors_abort(writer);
    return status;
}
