/* SPDX-License-Identifier: Apache-2.0 */
/*
 * zip.c: finds the files in an archive. The directory at its end is believed only
 * as far as it points into the archive.
 */
#include "nn/zip.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include <zlib.h>

struct nn_zip {
    nn_zip_entry *entries; /* sorted by name */
    size_t count;
};

static uint64_t little(const unsigned char *p, int bytes) {
    uint64_t v = 0;
    for (int i = 0; i < bytes; i++) {
        v |= (uint64_t)p[i] << 8 * i;
    }
    return v;
}

static brace_status damaged(const char *name, brace_error *error) {
    return core_fail(error, BRACE_ERROR_FORMAT, "%s: the archive is damaged, or was cut off", name);
}

bool nn_zip_is(const void *data, size_t size) {
    return size >= 4 && memcmp(data, "PK\3\4", 4) == 0;
}

static int compare(const char *a, size_t na, const char *b, size_t nb) {
    int order = memcmp(a, b, na < nb ? na : nb);
    return order != 0 ? order : (na > nb) - (na < nb);
}

static int by_name(const void *a, const void *b) {
    const nn_zip_entry *x = a, *y = b;
    return compare(x->name, x->name_length, y->name, y->name_length);
}

void nn_zip_close(nn_zip *zip) {
    if (zip != NULL) {
        core_free(zip->entries);
        core_free(zip);
    }
}

/* Where the directory begins and how many entries it has. */
static bool find_directory(const unsigned char *data, size_t size, uint64_t *begin, uint64_t *length, uint64_t *count) {
    enum { END = 22, END64 = 56, LOCATOR = 20, COMMENT = 65535 };
    if (size < END) {
        return false;
    }
    for (size_t at = size - END;; at--) {
        if (memcmp(data + at, "PK\5\6", 4) == 0 && little(data + at + 20, 2) == size - END - at) {
            *count = little(data + at + 10, 2);
            *length = little(data + at + 12, 4);
            *begin = little(data + at + 16, 4);
            if (at >= LOCATOR && memcmp(data + at - LOCATOR, "PK\6\7", 4) == 0) {
                uint64_t end64 = little(data + at - LOCATOR + 8, 8);
                if (size < END64 || end64 > size - END64 || memcmp(data + end64, "PK\6\6", 4) != 0) {
                    return false;
                }
                *count = little(data + end64 + 32, 8);
                *length = little(data + end64 + 40, 8);
                *begin = little(data + end64 + 48, 8);
            }
            return *begin <= size && *length <= size - *begin;
        }
        if (at == 0 || size - END - at >= COMMENT) {
            return false;
        }
    }
}

/* Sizes and place that do not fit 32 bits, in the order in which they are missing. */
static bool read_zip64(const unsigned char *extra, size_t length, uint64_t *size, uint64_t *stored, uint64_t *local) {
    uint64_t *const missing[3] = {size, stored, local};
    for (size_t at = 0; length - at >= 4;) {
        size_t id = little(extra + at, 2), n = little(extra + at + 2, 2);
        at += 4;
        if (n > length - at) {
            return false;
        }
        if (id == 1) {
            for (int i = 0; i < 3; i++) {
                if (*missing[i] == UINT32_MAX) {
                    if (n < 8) {
                        return false;
                    }
                    *missing[i] = little(extra + at, 8);
                    at += 8;
                    n -= 8;
                }
            }
            return true;
        }
        at += n;
    }
    return true;
}

static bool read_entry(nn_zip_entry *e, const unsigned char *data, size_t size, const unsigned char *p, uint64_t local,
                       uint64_t stored, uint64_t unpacked) {
    const unsigned method = (unsigned)little(p + 10, 2), flags = (unsigned)little(p + 8, 2);
    enum { LOCAL = 30 };
    if (size < LOCAL || local > size - LOCAL || memcmp(data + local, "PK\3\4", 4) != 0) {
        return false;
    }
    const size_t head = LOCAL + little(data + local + 26, 2) + little(data + local + 28, 2);
    if (head > size - local || stored > size - local - head) {
        return false;
    }
    if ((flags & 1) != 0 || (method != 0 && method != 8) || (method == 0 && stored != unpacked) ||
        unpacked > LONG_MAX) {
        return false;
    }
    e->data = data + local + head;
    e->stored = (size_t)stored;
    e->size = (size_t)unpacked;
    e->deflated = method == 8;
    return true;
}

static brace_status read_directory(nn_zip *zip, const unsigned char *data, size_t size, const char *name,
                                   brace_error *error) {
    enum { CENTRAL = 46 };
    uint64_t begin, length, count;
    if (!find_directory(data, size, &begin, &length, &count) || count > length / CENTRAL) {
        return damaged(name, error);
    }
    zip->entries = core_calloc((size_t)count + 1, sizeof *zip->entries);
    if (zip->entries == NULL) {
        return core_fail_memory(error, (size_t)count * sizeof *zip->entries, "the directory of an archive");
    }
    const unsigned char *p = data + begin, *end = p + length;
    for (uint64_t i = 0; i < count; i++) {
        if ((size_t)(end - p) < CENTRAL || memcmp(p, "PK\1\2", 4) != 0) {
            return damaged(name, error);
        }
        const size_t n = little(p + 28, 2), extra = little(p + 30, 2), comment = little(p + 32, 2);
        if (n + extra + comment > (size_t)(end - p) - CENTRAL) {
            return damaged(name, error);
        }
        nn_zip_entry *e = &zip->entries[zip->count++];
        uint64_t stored = little(p + 20, 4), unpacked = little(p + 24, 4), local = little(p + 42, 4);
        e->name = (const char *)p + CENTRAL;
        e->name_length = n;
        if (!read_zip64(p + CENTRAL + n, extra, &unpacked, &stored, &local) ||
            !read_entry(e, data, size, p, local, stored, unpacked)) {
            return damaged(name, error);
        }
        p += CENTRAL + n + extra + comment;
    }
    if (zip->count > 1) {
        qsort(zip->entries, zip->count, sizeof *zip->entries, by_name);
    }
    for (size_t i = 1; i < zip->count; i++) {
        if (by_name(&zip->entries[i - 1], &zip->entries[i]) == 0) {
            return damaged(name, error);
        }
    }
    return BRACE_OK;
}

brace_status nn_zip_open(nn_zip **out, const void *data, size_t size, const char *name, brace_error *error) {
    *out = NULL;
    nn_zip *zip = core_calloc(1, sizeof *zip);
    if (zip == NULL) {
        return core_fail_memory(error, sizeof *zip, "an archive");
    }
    brace_status status = read_directory(zip, data, size, name, error);
    if (status != BRACE_OK) {
        nn_zip_close(zip);
        return status;
    }
    *out = zip;
    return BRACE_OK;
}

const nn_zip_entry *nn_zip_find(const nn_zip *zip, const char *name, size_t length) {
    const nn_zip_entry wanted = {.name = name, .name_length = length};
    return zip->count > 0 ? bsearch(&wanted, zip->entries, zip->count, sizeof *zip->entries, by_name) : NULL;
}

const nn_zip_entry *nn_zip_find_last_part(const nn_zip *zip, const char *name) {
    const nn_zip_entry *found = NULL;
    const size_t n = strlen(name);
    for (size_t i = 0; i < zip->count; i++) {
        const nn_zip_entry *e = &zip->entries[i];
        if (e->name_length >= n && memcmp(e->name + e->name_length - n, name, n) == 0 &&
            (e->name_length == n || e->name[e->name_length - n - 1] == '/')) {
            if (found != NULL) {
                return NULL;
            }
            found = e;
        }
    }
    return found;
}

brace_status nn_zip_unpack(void *out, const nn_zip_entry *entry, const char *name, brace_error *error) {
    if (!entry->deflated) {
        memcpy(out, entry->data, entry->size);
        return BRACE_OK;
    }
    z_stream stream;
    memset(&stream, 0, sizeof stream);
    if (inflateInit2(&stream, -15) != Z_OK) {
        return core_fail_memory(error, 65536, "unpacking");
    }
    size_t in = 0, done = 0;
    int code = Z_OK;
    while (code == Z_OK) { /* zlib counts in unsigned int */
        if (stream.avail_in == 0) {
            size_t n = entry->stored - in < INT_MAX ? entry->stored - in : INT_MAX;
            stream.next_in = (unsigned char *)(uintptr_t)(entry->data + in);
            stream.avail_in = (unsigned)n;
            in += n;
        }
        size_t room = entry->size - done < INT_MAX ? entry->size - done : INT_MAX;
        stream.next_out = (unsigned char *)out + done;
        stream.avail_out = (unsigned)room;
        code = inflate(&stream, Z_NO_FLUSH);
        done += room - stream.avail_out;
    }
    inflateEnd(&stream);
    return code == Z_STREAM_END && done == entry->size ? BRACE_OK : damaged(name, error);
}
