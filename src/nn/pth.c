/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pth.c: from the values of the pickle and the bytes of the storages to named tensors.
 */
#include "nn/pth.h"

#include <stdlib.h>
#include <string.h>

#include "nn/pickle.h"
#include "nn/zip.h"

enum { DEPTH = 16, NAME = 512, BUCKETS = 4096 }; /* of nested dicts; longest name of a tensor; of storages */

/* A storage that was found: its bytes, in the file or unpacked. */
typedef struct storage {
    const char *key; /* in the pickle */
    size_t length;
    core_dtype dtype;
    uint64_t count;
    const unsigned char *data;
    void *unpacked;
    size_t next; /* of the same bucket, from 1; 0: none */
} storage;

struct nn_pth {
    void *map; /* NULL: the bytes are the caller's */
    size_t mapped;
    core_arena *arena; /* names */
    core_tensor *tensors;
    size_t count, room;
    core_tensor **by_name;
    storage *storages;
    size_t storage_count, storage_room;
    size_t buckets[BUCKETS]; /* storages by key, from 1 */
    void **copies;           /* tensors that did not lie in one piece */
    size_t copy_count, copy_room;
    size_t budget; /* bytes that copies and unpacked storages may still take */
};

typedef struct reader {
    nn_pth *file;
    const unsigned char *data;
    size_t size;
    const char *name;
    brace_error *error;
    nn_zip *zip;        /* NULL: the old format */
    const char *folder; /* of the archive, with its slash */
    size_t folder_length;
    size_t values; /* looked at */
} reader;

void nn_pth_close(nn_pth *file) {
    if (file == NULL) {
        return;
    }
    for (size_t i = 0; i < file->copy_count; i++) {
        core_free(file->copies[i]);
    }
    for (size_t i = 0; i < file->storage_count; i++) {
        core_free(file->storages[i].unpacked);
    }
    if (file->map != NULL) {
        core_file_unmap(file->map, file->mapped);
    }
    core_free((void *)file->copies);
    core_free(file->storages);
    core_free(file->tensors);
    core_free((void *)file->by_name);
    core_arena_destroy(file->arena);
    core_free(file);
}

/* A list with room for one more, or NULL: the list as it was. */
static void *with_room(void *list, size_t *room, size_t count, size_t size) {
    if (count < *room) {
        return list;
    }
    size_t more = *room == 0 ? 64 : *room * 2;
    void *grown = core_calloc(more, size);
    if (grown != NULL) {
        if (count > 0) {
            memcpy(grown, list, count * size);
        }
        core_free(list);
        *room = more;
    }
    return grown;
}

static brace_status take_budget(reader *r, size_t bytes) {
    if (bytes > r->file->budget) {
        return core_fail(r->error, BRACE_ERROR_UNSUPPORTED,
                         "%s: its tensors would take much more memory than the file has bytes", r->name);
    }
    r->file->budget -= bytes;
    return BRACE_OK;
}

/* ---- storages ---- */

/* Keys are short decimal numbers. */
static size_t bucket_of(const char *key, size_t length) {
    size_t h = 0;
    for (size_t i = 0; i < length; i++) {
        h = h * 31 + (unsigned char)key[i];
    }
    return h % BUCKETS;
}

static storage *find_storage(nn_pth *file, const char *key, size_t length) {
    for (size_t i = file->buckets[bucket_of(key, length)]; i > 0; i = file->storages[i - 1].next) {
        storage *s = &file->storages[i - 1];
        if (s->length == length && memcmp(s->key, key, length) == 0) {
            return s;
        }
    }
    return NULL;
}

/* archive/data/KEY */
static brace_status read_zip_storage(reader *r, storage *s) {
    char path[NAME];
    const size_t bytes = (size_t)s->count * core_dtype_size(s->dtype); /* the count fits: see add_storage */
    const nn_zip_entry *e = NULL;
    if (r->folder_length + 5 + s->length <= sizeof path) {
        memcpy(path, r->folder, r->folder_length);
        memcpy(path + r->folder_length, "data/", 5);
        memcpy(path + r->folder_length + 5, s->key, s->length);
        e = nn_zip_find(r->zip, path, r->folder_length + 5 + s->length);
    }
    if (e == NULL || e->size != bytes) {
        return core_fail(r->error, BRACE_ERROR_FORMAT,
                         "%s: the numbers of a tensor are missing, or not as many as it says", r->name);
    }
    s->data = e->data;
    if (e->deflated) {
        brace_status status = take_budget(r, e->size);
        if (status != BRACE_OK) {
            return status;
        }
        s->unpacked = core_alloc(e->size + 1, 1);
        if (s->unpacked == NULL) {
            return core_fail_memory(r->error, e->size, "tensors");
        }
        s->data = s->unpacked;
        return nn_zip_unpack(s->unpacked, e, r->name, r->error);
    }
    return BRACE_OK;
}

static brace_status add_storage(reader *r, const nn_value *value) {
    const char *key = value->storage.key->text.start;
    const size_t length = value->storage.key->text.length;
    storage *s = find_storage(r->file, key, length);
    if (s != NULL) {
        return s->dtype == value->storage.dtype && s->count == value->storage.count
                   ? BRACE_OK
                   : core_fail(r->error, BRACE_ERROR_FORMAT, "%s: two tensors disagree about the numbers they share",
                               r->name);
    }
    if (value->storage.count > SIZE_MAX / 16) {
        return core_fail(r->error, BRACE_ERROR_FORMAT, "%s: a tensor has an impossible size", r->name);
    }
    nn_pth *file = r->file;
    storage *grown = with_room(file->storages, &file->storage_room, file->storage_count, sizeof *s);
    if (grown == NULL) {
        return core_fail_memory(r->error, file->storage_room * 2 * sizeof *s, "a list of tensors");
    }
    file->storages = grown;
    s = &file->storages[file->storage_count++];
    size_t *bucket = &file->buckets[bucket_of(key, length)];
    *s = (storage){
        .key = key, .length = length, .dtype = value->storage.dtype, .count = value->storage.count, .next = *bucket};
    *bucket = file->storage_count;
    return r->zip != NULL ? read_zip_storage(r, s) : BRACE_OK;
}

/* ---- tensors ---- */

static brace_status add_tensor(reader *r, const nn_value *value, const char *name, size_t length) {
    nn_pth *file = r->file;
    brace_status status = add_storage(r, value->tensor.storage);
    if (status != BRACE_OK) {
        return status;
    }
    core_tensor *grown = with_room(file->tensors, &file->room, file->count, sizeof *file->tensors);
    file->tensors = grown != NULL ? grown : file->tensors;
    char *copy = core_arena_alloc(file->arena, 1, length + 1);
    if (grown == NULL || copy == NULL) {
        return core_fail_memory(r->error, file->room * 2 * sizeof *grown, "a list of tensors");
    }
    for (size_t i = 0; i < length; i++) { /* a name may be printed */
        copy[i] = name[i] >= 32 && name[i] != 127 ? name[i] : '?';
    }
    core_tensor *t = &file->tensors[file->count++];
    t->name = copy;
    t->dtype = value->tensor.storage->storage.dtype;
    t->rank = value->tensor.rank;
    memcpy(t->shape, value->tensor.shape, sizeof t->shape);
    t->data = value; /* until the storages are known */
    return BRACE_OK;
}

/* Tensors in `value` and below, named with what `name` holds so far. */
static brace_status walk(reader *r, const nn_value *value, char name[NAME], size_t length, int depth) {
    if (value->kind == NN_TENSOR) {
        return length > 0 ? add_tensor(r, value, name, length) : add_tensor(r, value, "tensor", 6);
    }
    if (value->kind != NN_DICT && value->kind != NN_LIST && value->kind != NN_TUPLE) {
        return BRACE_OK;
    }
    if (depth == DEPTH) {
        return core_fail(r->error, BRACE_ERROR_UNSUPPORTED, "%s: tensors are nested more than %d deep", r->name, DEPTH);
    }
    size_t index = 0;
    for (const nn_item *item = value->items.first; item != NULL; item = item->next, index++) {
        if (++r->values > NN_PICKLE_VALUES) {
            return core_fail(r->error, BRACE_ERROR_UNSUPPORTED, "%s: it holds more than a million values", r->name);
        }
        char number[24];
        const char *key = number;
        size_t n = (size_t)snprintf(number, sizeof number, "%lld",
                                    item->key != NULL && item->key->kind == NN_INT ? (long long)item->key->integer
                                                                                   : (long long)index);
        if (item->key != NULL && item->key->kind == NN_TEXT) {
            key = item->key->text.start;
            n = item->key->text.length;
        }
        size_t dot = length > 0 ? 1 : 0;
        if (length + dot + n > NAME) {
            return core_fail(r->error, BRACE_ERROR_UNSUPPORTED, "%s: the name of a tensor is longer than %d letters",
                             r->name, NAME);
        }
        if (dot == 1) {
            name[length] = '.';
        }
        memcpy(name + length + dot, key, n);
        brace_status status = walk(r, item->value, name, length + dot + n, depth + 1);
        if (status != BRACE_OK) {
            return status;
        }
    }
    return BRACE_OK;
}

static bool in_one_piece(const nn_value *v) {
    uint64_t stride = 1;
    for (int i = v->tensor.rank - 1; i >= 0; i--) {
        if (v->tensor.shape[i] != 1 && v->tensor.stride[i] != stride) {
            return false;
        }
        stride *= v->tensor.shape[i];
    }
    return true;
}

/* Numbers in the order of the shape. The view was checked to lie in its storage. */
static void gather(unsigned char *out, const unsigned char *in, const nn_value *v, size_t size, uint64_t count) {
    uint64_t at[CORE_TENSOR_RANK] = {0}, offset = 0;
    for (uint64_t n = 0; n < count; n++, out += size) {
        memcpy(out, in + offset * size, size);
        for (int i = v->tensor.rank - 1; i >= 0; i--) {
            offset += v->tensor.stride[i];
            if (++at[i] < v->tensor.shape[i]) {
                break;
            }
            offset -= at[i] * v->tensor.stride[i];
            at[i] = 0;
        }
    }
}

/* Gives a tensor its data, whose storages are known by now. */
static brace_status resolve(reader *r, core_tensor *t) {
    const nn_value *v = t->data;
    const nn_value *key = v->tensor.storage->storage.key;
    const storage *s = find_storage(r->file, key->text.start, key->text.length);
    const size_t size = core_dtype_size(t->dtype);
    uint64_t count = 1;
    for (int i = 0; i < t->rank; i++) {
        count *= t->shape[i]; /* checked in rebuild_tensor */
    }
    if (s == NULL || s->data == NULL || count > SIZE_MAX / size) {
        return core_fail(r->error, BRACE_ERROR_FORMAT, "%s: the numbers of a tensor are missing", r->name);
    }
    t->size = (size_t)count * size;
    const unsigned char *from = s->data + v->tensor.offset * size;
    t->data = from;
    if (count == 0 || in_one_piece(v)) {
        return BRACE_OK;
    }
    brace_status status = take_budget(r, t->size);
    if (status != BRACE_OK) {
        return status;
    }
    nn_pth *file = r->file;
    void **grown = with_room((void *)file->copies, &file->copy_room, file->copy_count, sizeof *grown);
    file->copies = grown != NULL ? grown : file->copies;
    unsigned char *copy = core_alloc(t->size, 1);
    if (grown == NULL || copy == NULL) {
        core_free(copy);
        return core_fail_memory(r->error, t->size, "tensors");
    }
    file->copies[file->copy_count++] = copy;
    gather(copy, from, v, size, count);
    t->data = copy;
    return BRACE_OK;
}

static int by_name(const void *a, const void *b) {
    return strcmp((*(core_tensor *const *)a)->name, (*(core_tensor *const *)b)->name);
}

static brace_status finish(reader *r) {
    nn_pth *file = r->file;
    if (file->count == 0) {
        return core_fail(r->error, BRACE_ERROR_FORMAT, "%s: there are no tensors in it", r->name);
    }
    file->by_name = core_alloc(file->count, sizeof *file->by_name);
    if (file->by_name == NULL) {
        return core_fail_memory(r->error, file->count * sizeof *file->by_name, "a list of tensors");
    }
    for (size_t i = 0; i < file->count; i++) {
        brace_status status = resolve(r, &file->tensors[i]);
        if (status != BRACE_OK) {
            return status;
        }
        file->by_name[i] = &file->tensors[i];
    }
    qsort((void *)file->by_name, file->count, sizeof *file->by_name, by_name);
    for (size_t i = 1; i < file->count; i++) {
        if (by_name(&file->by_name[i - 1], &file->by_name[i]) == 0) {
            return core_fail(r->error, BRACE_ERROR_FORMAT, "%s: two tensors in it are called '%s'", r->name,
                             file->by_name[i]->name);
        }
    }
    return BRACE_OK;
}

/* ---- zip archives ---- */

static brace_status read_zip(reader *r) {
    nn_pickle *pickle = NULL;
    void *unpacked = NULL;
    size_t used = 0;
    char name[NAME];
    brace_status status = nn_zip_open(&r->zip, r->data, r->size, r->name, r->error);
    if (status != BRACE_OK) {
        return status;
    }
    const nn_zip_entry *e = nn_zip_find_last_part(r->zip, "data.pkl");
    const nn_zip_entry *order = nn_zip_find_last_part(r->zip, "byteorder");
    if (nn_zip_find_last_part(r->zip, "constants.pkl") != NULL) {
        status =
            core_fail(r->error, BRACE_ERROR_UNSUPPORTED,
                      "%s: this is a program (TorchScript) and not only weights; save its state_dict instead", r->name);
    } else if (e == NULL) {
        status = core_fail(r->error, BRACE_ERROR_FORMAT, "%s: an archive, but not of PyTorch tensors", r->name);
    } else if (order != NULL && !(order->size == 6 && !order->deflated && memcmp(order->data, "little", 6) == 0)) {
        status = core_fail(r->error, BRACE_ERROR_UNSUPPORTED, "%s: it was written on a big-endian computer", r->name);
    } else if (e->size > NN_PICKLE_SIZE) {
        status = core_fail(r->error, BRACE_ERROR_UNSUPPORTED, "%s: its list of tensors is too long", r->name);
    } else {
        r->folder = e->name;
        r->folder_length = e->name_length - 8;
        const void *data = e->data;
        if (e->deflated) {
            unpacked = core_alloc(e->size + 1, 1);
            status = unpacked != NULL ? nn_zip_unpack(unpacked, e, r->name, r->error)
                                      : core_fail_memory(r->error, e->size, "a list of tensors");
            data = unpacked;
        }
        if (status == BRACE_OK) {
            status = nn_pickle_read(&pickle, &used, data, e->size, r->name, r->error);
        }
    }
    if (status == BRACE_OK) {
        status = walk(r, nn_pickle_result(pickle), name, 0, 0);
    }
    if (status == BRACE_OK) {
        status = finish(r);
    }
    nn_pickle_destroy(pickle);
    core_free(unpacked);
    nn_zip_close(r->zip);
    return status;
}

/* ---- the old format: magic number, version, system, the object, the keys of its storages; then the storages ---- */

static const unsigned char magic[] = {0x80, 2,    0x8a, 10,   0x6c, 0xfc, 0x9c, 0x46,
                                      0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19, '.'};

/* For each key, 8 bytes with the number of elements, and these. */
static brace_status read_old_storages(reader *r, const nn_value *keys, size_t at) {
    for (const nn_item *item = keys->items.first; item != NULL; item = item->next) {
        const nn_value *key = item->value;
        storage *s = key->kind == NN_TEXT ? find_storage(r->file, key->text.start, key->text.length) : NULL;
        uint64_t count = 0;
        if (s == NULL) {
            return core_fail(r->error, BRACE_ERROR_UNSUPPORTED, "%s: it holds numbers that belong to no tensor",
                             r->name);
        }
        if (r->size - at >= 8) {
            memcpy(&count, r->data + at, 8);
        }
        const size_t size = core_dtype_size(s->dtype);
        if (r->size - at < 8 || count != s->count || count > (r->size - at - 8) / size) {
            return core_fail(r->error, BRACE_ERROR_FORMAT,
                             "%s: damaged, or cut off: the numbers of a tensor are missing", r->name);
        }
        s->data = r->data + at + 8;
        at += 8 + (size_t)count * size;
    }
    return BRACE_OK;
}

static brace_status read_old(reader *r) {
    enum { VERSION, SYSTEM, OBJECT, KEYS, PICKLES };
    nn_pickle *pickle[PICKLES] = {NULL};
    size_t at = sizeof magic;
    char name[NAME];
    brace_status status = BRACE_OK;
    for (int i = 0; i < PICKLES && status == BRACE_OK; i++) {
        size_t used = 0;
        status = nn_pickle_read(&pickle[i], &used, r->data + at, r->size - at, r->name, r->error);
        at += used;
    }
    if (status == BRACE_OK) {
        const nn_value *version = nn_pickle_result(pickle[VERSION]), *system = nn_pickle_result(pickle[SYSTEM]);
        bool little = version->kind == NN_INT && version->integer == 1001 && system->kind == NN_DICT &&
                      nn_pickle_result(pickle[KEYS])->kind == NN_LIST;
        for (const nn_item *item = little ? system->items.first : NULL; item != NULL; item = item->next) {
            little = little && !(nn_text_is(item->key, "little_endian") && item->value->integer == 0);
        }
        if (!little) {
            status = core_fail(r->error, BRACE_ERROR_UNSUPPORTED,
                               "%s: a PyTorch file of an unknown version, or of a big-endian computer", r->name);
        }
    }
    if (status == BRACE_OK) {
        status = walk(r, nn_pickle_result(pickle[OBJECT]), name, 0, 0);
    }
    if (status == BRACE_OK) {
        status = read_old_storages(r, nn_pickle_result(pickle[KEYS]), at);
    }
    if (status == BRACE_OK) {
        status = finish(r);
    }
    for (int i = 0; i < PICKLES; i++) {
        nn_pickle_destroy(pickle[i]);
    }
    return status;
}

/* ---- opening ---- */

brace_status nn_pth_parse(nn_pth **out, const void *data, size_t size, const char *name, brace_error *error) {
    *out = NULL;
    nn_pth *file = core_calloc(1, sizeof *file);
    if (file != NULL) {
        file->arena = core_arena_create((size_t)16 << 10);
    }
    if (file == NULL || file->arena == NULL) {
        nn_pth_close(file);
        return core_fail_memory(error, sizeof *file, "a file");
    }
    /* Views that overlap, and packed files, may take more than the file itself, but not without bounds. */
    file->budget = size > SIZE_MAX / 8 ? SIZE_MAX : 8 * size + 4096;
    reader r = {.file = file, .data = data, .size = size, .name = name, .error = error};
    brace_status status;
    if (nn_zip_is(data, size)) {
        status = read_zip(&r);
    } else if (size > sizeof magic && memcmp(data, magic, sizeof magic) == 0) {
        status = read_old(&r);
    } else {
        status = core_fail(error, BRACE_ERROR_FORMAT, "%s: no file of PyTorch tensors (.pth)", name);
    }
    if (status != BRACE_OK) {
        nn_pth_close(file);
        return status;
    }
    for (size_t i = 0; i < file->storage_count; i++) {
        file->storages[i].key = NULL; /* was in a pickle that may be gone */
    }
    *out = file;
    return BRACE_OK;
}

brace_status nn_pth_open(nn_pth **out, const char *path, brace_error *error) {
    *out = NULL;
    void *map;
    size_t size;
    brace_status status = core_file_map(&map, &size, path, 4, "file of PyTorch tensors (.pth)", error);
    if (status != BRACE_OK) {
        return status;
    }
    status = nn_pth_parse(out, map, size, path, error);
    if (status != BRACE_OK) {
        core_file_unmap(map, size);
        return status;
    }
    (*out)->map = map;
    (*out)->mapped = size;
    return BRACE_OK;
}

size_t nn_pth_count(const nn_pth *file) {
    return file->count;
}

const core_tensor *nn_pth_at(const nn_pth *file, size_t index) {
    return &file->tensors[index];
}

const core_tensor *nn_pth_find(const nn_pth *file, const char *name) {
    core_tensor wanted = {.name = name}, *key = &wanted;
    core_tensor *const *found = bsearch(&key, (void *)file->by_name, file->count, sizeof *file->by_name, by_name);
    return found != NULL ? *found : NULL;
}
