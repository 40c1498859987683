/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tags.c: the metadata of a file that BRACE itself has no field for, kept as the
 * typed values that stood in it, so that it goes out as it came in.
 */
#include <math.h>
#include <string.h>

#include "raw/raw.h"

size_t raw_type_size(unsigned type) {
    static const uint8_t sizes[] = {0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4};
    return type < sizeof sizes ? sizes[type] : 0;
}

brace_tags *raw_tags_create(void) {
    return core_calloc(1, sizeof(brace_tags));
}

void raw_tags_destroy(brace_tags *tags) {
    if (tags == NULL) {
        return;
    }
    for (size_t i = 0; i < tags->count; i++) {
        core_free(tags->items[i].bytes);
    }
    core_free(tags->items);
    core_free(tags);
}

brace_tags *raw_tags_clone(const brace_tags *tags) {
    brace_tags *copy = raw_tags_create();
    if (copy == NULL || tags == NULL) {
        return copy;
    }
    for (size_t i = 0; i < tags->count; i++) {
        const raw_tag *t = &tags->items[i];
        if (!raw_tags_put(copy, (raw_ifd)t->ifd, t->tag, t->type, t->count, t->bytes)) {
            raw_tags_destroy(copy);
            return NULL;
        }
    }
    return copy;
}

static raw_tag *find(const brace_tags *tags, raw_ifd ifd, unsigned tag) {
    for (size_t i = 0; tags != NULL && i < tags->count; i++) {
        if (tags->items[i].ifd == (uint8_t)ifd && tags->items[i].tag == tag) {
            return &tags->items[i];
        }
    }
    return NULL;
}

const raw_tag *raw_tags_find(const brace_tags *tags, raw_ifd ifd, unsigned tag) {
    return find(tags, ifd, tag);
}

static bool grow(brace_tags *tags) {
    if (tags->count < tags->capacity) {
        return true;
    }
    size_t capacity = tags->capacity == 0 ? 64 : tags->capacity * 2;
    raw_tag *items = core_alloc(capacity, sizeof *items);
    if (items == NULL) {
        return false;
    }
    if (tags->count > 0) {
        memcpy(items, tags->items, tags->count * sizeof *items);
    }
    core_free(tags->items);
    tags->items = items;
    tags->capacity = capacity;
    return true;
}

bool raw_tags_put(brace_tags *tags, raw_ifd ifd, unsigned tag, unsigned type, uint32_t count, const void *values) {
    size_t each = raw_type_size(type);
    if (each == 0 || count == 0 || tag > 0xffffu || (size_t)count > RAW_TAGS_MAX_BYTES / each) {
        return false;
    }
    raw_tag *old = find(tags, ifd, tag);
    size_t size = (size_t)count * each;
    size_t freed = old != NULL ? (size_t)old->count * raw_type_size(old->type) : 0;
    if (tags->bytes - freed + size > RAW_TAGS_MAX_BYTES || (old == NULL && tags->count >= RAW_TAGS_MAX_COUNT)) {
        return false;
    }
    uint8_t *bytes = core_alloc(size, 1);
    if (bytes == NULL) {
        return false;
    }
    memcpy(bytes, values, size);
    if (old == NULL) {
        if (!grow(tags)) {
            core_free(bytes);
            return false;
        }
        old = &tags->items[tags->count++];
    } else {
        core_free(old->bytes);
    }
    tags->bytes += size - freed;
    *old = (raw_tag){.ifd = (uint8_t)ifd, .tag = (uint16_t)tag, .type = (uint16_t)type, .count = count, .bytes = bytes};
    return true;
}

bool raw_tags_put_text(brace_tags *tags, raw_ifd ifd, unsigned tag, const char *text) {
    return raw_tags_put(tags, ifd, tag, RAW_ASCII, (uint32_t)strlen(text) + 1, text);
}

bool raw_tags_put_short(brace_tags *tags, raw_ifd ifd, unsigned tag, unsigned value) {
    uint16_t v = (uint16_t)value;
    return raw_tags_put(tags, ifd, tag, RAW_SHORT, 1, &v);
}

bool raw_tags_put_long(brace_tags *tags, raw_ifd ifd, unsigned tag, uint32_t value) {
    return raw_tags_put(tags, ifd, tag, RAW_LONG, 1, &value);
}

bool raw_tags_put_real(brace_tags *tags, raw_ifd ifd, unsigned tag, unsigned type, uint32_t count,
                       const double *values) {
    enum { MOST = 16 };
    uint32_t words[2 * MOST];
    if (count == 0 || count > MOST) {
        return false;
    }
    if (type == RAW_DOUBLE) {
        return raw_tags_put(tags, ifd, tag, type, count, values);
    }
    for (uint32_t i = 0; i < count; i++) {
        bool negative = values[i] < 0.0;
        uint32_t limit = type == RAW_SRATIONAL ? INT32_MAX : UINT32_MAX;
        if (negative && type != RAW_SRATIONAL) {
            return false;
        }
        raw_rational(negative ? -values[i] : values[i], limit, &words[2 * i], &words[2 * i + 1]);
        if (negative) {
            words[2 * i] = (uint32_t)(-(int64_t)words[2 * i]);
        }
    }
    return raw_tags_put(tags, ifd, tag, type, count, words);
}

void raw_tags_remove(brace_tags *tags, raw_ifd ifd, unsigned tag) {
    raw_tag *old = find(tags, ifd, tag);
    if (old != NULL) {
        tags->bytes -= (size_t)old->count * raw_type_size(old->type);
        core_free(old->bytes);
        *old = tags->items[--tags->count];
    }
}

double raw_tag_number(const raw_tag *tag, uint32_t index) {
    if (tag == NULL || index >= tag->count) {
        return NAN;
    }
    const uint8_t *at = tag->bytes + (size_t)index * raw_type_size(tag->type);
    uint16_t u16;
    uint32_t u32[2];
    float f32;
    double f64;
    switch (tag->type) {
    case RAW_BYTE:
    case RAW_UNDEFINED:
        return *at;
    case RAW_SBYTE:
        return (int8_t)*at;
    case RAW_SHORT:
        memcpy(&u16, at, sizeof u16);
        return u16;
    case RAW_SSHORT:
        memcpy(&u16, at, sizeof u16);
        return (int16_t)u16;
    case RAW_LONG:
    case RAW_IFD_OFFSET:
        memcpy(u32, at, 4);
        return u32[0];
    case RAW_SLONG:
        memcpy(u32, at, 4);
        return (int32_t)u32[0];
    case RAW_RATIONAL:
        memcpy(u32, at, 8);
        return u32[1] == 0 ? (double)NAN : (double)u32[0] / (double)u32[1];
    case RAW_SRATIONAL:
        memcpy(u32, at, 8);
        return u32[1] == 0 ? (double)NAN : (double)(int32_t)u32[0] / (double)(int32_t)u32[1];
    case RAW_FLOAT:
        memcpy(&f32, at, 4);
        return f32;
    case RAW_DOUBLE:
        memcpy(&f64, at, 8);
        return f64;
    default:
        return NAN;
    }
}

void raw_tag_text(const raw_tag *tag, char *out, size_t size) {
    size_t n = 0;
    out[0] = '\0';
    if (tag == NULL || (tag->type != RAW_ASCII && tag->type != RAW_BYTE && tag->type != RAW_UNDEFINED)) {
        return;
    }
    for (uint32_t i = 0; i < tag->count && n + 1 < size && tag->bytes[i] != 0; i++) {
        uint8_t c = tag->bytes[i];
        out[n++] = c < 32 || c == 127 ? ' ' : (char)c;
    }
    while (n > 0 && out[n - 1] == ' ') {
        n--;
    }
    out[n] = '\0';
}
