/* SPDX-License-Identifier: Apache-2.0 */
/*
 * weights_file.c: parameters in safetensors files, as f32, bf16 or f16; reading them from PyTorch's files, too.
 */
#include <limits.h>
#include <string.h>

#include "core/safetensors.h"
#include "nn/node.h"
#include "nn/pth.h"
#include "nn/weights.h"

/* ---- a file of either kind ---- */

typedef struct tensors {
    core_safetensors *safe;
    nn_pth *pth; /* one of them */
} tensors;

/* A zip archive or a pickle. As the length of a header, with which safetensors begin, these are more than allowed. */
static bool is_torch(const char *path) {
    unsigned char start[4] = {0};
    FILE *f = fopen(path, "rb");
    const bool read = f != NULL && fread(start, 1, 4, f) == 4;
    if (f != NULL) {
        fclose(f);
    }
    return read && (memcmp(start, "PK\3\4", 4) == 0 || memcmp(start, "\x80\2\x8a\n", 4) == 0);
}

static brace_status open_tensors(tensors *out, const char *path, brace_error *error) {
    *out = (tensors){NULL, NULL};
    return is_torch(path) ? nn_pth_open(&out->pth, path, error) : core_safetensors_open(&out->safe, path, error);
}

static void close_tensors(tensors *file) {
    core_safetensors_close(file->safe);
    nn_pth_close(file->pth);
}

static size_t count_tensors(const tensors *file) {
    return file->pth != NULL ? nn_pth_count(file->pth) : core_safetensors_count(file->safe);
}

/* Checkpoints keep a network's parameters under this key, beside others. */
static const char state_dict[] = "state_dict.";
enum { STATE_DICT = sizeof state_dict - 1 };

static core_tensor tensor_at(const tensors *file, size_t i) {
    core_tensor t = file->pth != NULL ? *nn_pth_at(file->pth, i) : *core_safetensors_at(file->safe, i);
    if (file->pth != NULL && strncmp(t.name, state_dict, STATE_DICT) == 0) {
        t.name += STATE_DICT;
    }
    return t;
}

static bool find_tensor(const tensors *file, const char *name, core_tensor *out) {
    for (size_t i = 0; i < count_tensors(file); i++) {
        *out = tensor_at(file, i);
        if (strcmp(out->name, name) == 0) {
            return true;
        }
    }
    return false;
}

/* ---- numbers ---- */

/* IEEE 754 binary16. Subnormals: the ten bits are a multiple of 2^-24. */
static float from_f16(uint16_t h) {
    const uint32_t sign = (uint32_t)(h & 0x8000u) << 16, exponent = h >> 10 & 31u, fraction = h & 0x3ffu;
    union {
        uint32_t u;
        float f;
    } x;
    if (exponent == 0) {
        x.f = (float)fraction * 0x1p-24f;
        x.u |= sign;
    } else {
        x.u = sign | (exponent == 31 ? 0xffu : exponent + 112) << 23 | fraction << 13;
    }
    return x.f;
}

/* To nearest, ties to even; too large becomes infinite. */
static uint16_t to_f16(float f) {
    union {
        float f;
        uint32_t u;
    } x = {f};
    const uint16_t sign = (uint16_t)(x.u >> 16 & 0x8000u);
    x.u &= 0x7fffffffu;
    if (x.u > 0x7f800000u) {
        return (uint16_t)(sign | 0x7e00u);
    }
    if (x.u >= 0x477ff000u) { /* 65520 and more */
        return (uint16_t)(sign | 0x7c00u);
    }
    if (x.u < 0x38800000u) { /* below 2^-14: adding 1/2 leaves multiples of 2^-24 in the low bits */
        x.f += 0.5f;
        return (uint16_t)(sign | (x.u & 0x7ffu));
    }
    return (uint16_t)(sign | ((x.u - 0x38000000u + 0xfffu + (x.u >> 13 & 1u)) >> 13));
}

static float number(const core_tensor *t, size_t i) {
    const unsigned char *p = t->data; /* perhaps not aligned */
    uint16_t half;
    float single;
    double wide;
    switch (t->dtype) {
    case CORE_F16:
        memcpy(&half, p + 2 * i, 2);
        return from_f16(half);
    case CORE_BF16:
        memcpy(&half, p + 2 * i, 2);
        return nn_from_bf16(half);
    case CORE_F64:
        memcpy(&wide, p + 8 * i, 8);
        return (float)wide;
    default:
        memcpy(&single, p + 4 * i, 4);
        return single;
    }
}

static bool is_real(core_dtype t) {
    return t == CORE_F16 || t == CORE_BF16 || t == CORE_F32 || t == CORE_F64;
}

/* The shape as ours; false where it cannot be one. */
static bool shape_of(const core_tensor *t, int shape[NN_RANK_MAX]) {
    for (int i = 0; i < t->rank && t->rank <= NN_RANK_MAX; i++) {
        if (t->shape[i] > INT_MAX) {
            return false;
        }
        shape[i] = (int)t->shape[i];
    }
    return t->rank <= NN_RANK_MAX;
}

static brace_status give(nn_weights *weights, const core_tensor *t, const char *path, brace_error *error) {
    int shape[NN_RANK_MAX] = {0};
    const size_t count = t->size / core_dtype_size(t->dtype);
    if (!shape_of(t, shape)) {
        return BRACE_OK; /* nothing of ours can be that; missing it is noticed */
    }
    float *values = core_alloc(count, sizeof *values);
    if (values == NULL) {
        return core_fail_memory(error, count * sizeof *values, path);
    }
    for (size_t i = 0; i < count; i++) {
        values[i] = number(t, i);
    }
    brace_status status = nn_weights_give(weights, t->name, t->rank, shape, values, error);
    core_free(values);
    return status;
}

/* All that can be wrong is found before anything is changed. */
static brace_status check(const nn_weights *weights, const tensors *file, const char *path, bool partial,
                          brace_error *error) {
    char a[64], b[64];
    for (size_t i = 0; i < weights->count; i++) {
        const nn_parameter *p = weights->items[i];
        int shape[NN_RANK_MAX] = {0};
        core_tensor t;
        const bool found = find_tensor(file, p->name, &t);
        if (!found && partial) {
            continue;
        }
        if (!found || !is_real(t.dtype)) {
            return core_fail(error, BRACE_ERROR_MISMATCH, "%s: has no weights '%s'; it belongs to another network",
                             path, p->name);
        }
        if (!shape_of(&t, shape) || !nn_same_shape(t.rank, shape, p->rank, p->shape)) {
            return core_fail(error, BRACE_ERROR_MISMATCH,
                             "%s: the weights '%s' are %s, but the network's are %s; they belong to another network",
                             path, p->name, nn_shape_text(a, sizeof a, t.rank <= NN_RANK_MAX ? t.rank : 0, shape),
                             nn_shape_text(b, sizeof b, p->rank, p->shape));
        }
    }
    return BRACE_OK;
}

brace_status nn_weights_load(nn_weights *weights, const char *path, bool partial, brace_error *error) {
    tensors file;
    brace_status status = open_tensors(&file, path, error);
    if (status != BRACE_OK) {
        return status;
    }
    status = check(weights, &file, path, partial, error);
    for (size_t i = 0; status == BRACE_OK && i < count_tensors(&file); i++) {
        const core_tensor t = tensor_at(&file, i);
        if (is_real(t.dtype)) {
            status = give(weights, &t, path, error);
        }
    }
    close_tensors(&file);
    if (status == BRACE_OK && weights->count == 0 && !partial) {
        core_free(weights->complete);
        weights->complete = core_strdup(path);
        if (weights->complete == NULL) {
            status = core_fail_memory(error, strlen(path), path);
        }
    }
    return status;
}

static brace_status save_one(core_safetensors_writer *writer, const nn_parameter *p, core_dtype dtype,
                             brace_error *error) {
    core_tensor t = {.name = p->name, .dtype = dtype, .rank = p->rank, .data = p->value};
    uint16_t *half = NULL;
    for (int i = 0; i < p->rank; i++) {
        t.shape[i] = (uint64_t)p->shape[i];
    }
    if (dtype != CORE_F32) {
        half = core_alloc(p->count, sizeof *half);
        if (half == NULL) {
            return core_fail_memory(error, p->count * sizeof *half, "weights");
        }
        for (size_t i = 0; i < p->count; i++) {
            half[i] = dtype == CORE_F16 ? to_f16(p->value[i]) : nn_to_bf16(p->value[i]);
        }
        t.data = half;
    }
    brace_status status = core_safetensors_add(writer, &t, error);
    core_free(half);
    return status;
}

brace_status nn_weights_save(const nn_weights *weights, const char *path, const char *dtype,
                             const char *const *metadata, brace_error *error) {
    const core_dtype type = strcmp(dtype, "bf16") == 0 ? CORE_BF16 : strcmp(dtype, "f16") == 0 ? CORE_F16 : CORE_F32;
    if (type == CORE_F32 && strcmp(dtype, "f32") != 0) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "weights are saved as f32, bf16 or f16, not as '%.20s'", dtype);
    }
    size_t reserve = 4096;
    for (size_t i = 0; i < weights->count; i++) {
        reserve += 6 * strlen(weights->items[i]->name) + 256;
    }
    for (size_t i = 0; metadata != NULL && metadata[i] != NULL; i++) {
        reserve += 6 * strlen(metadata[i]) + 16;
    }
    core_safetensors_writer *writer = NULL;
    brace_status status = core_safetensors_create(&writer, path, reserve, error);
    if (status != BRACE_OK) {
        return status;
    }
    for (size_t i = 0; status == BRACE_OK && metadata != NULL && metadata[i] != NULL && metadata[i + 1] != NULL;
         i += 2) {
        status = core_safetensors_add_metadata(writer, metadata[i], metadata[i + 1], error);
    }
    for (size_t i = 0; status == BRACE_OK && i < weights->count; i++) {
        status = save_one(writer, weights->items[i], type, error);
    }
    if (status != BRACE_OK) {
        core_safetensors_abort(writer);
        return status;
    }
    return core_safetensors_commit(writer, error);
}
