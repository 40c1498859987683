/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tags_tiff.c: finds the tags of a TIFF-based RAW file, of which every byte may
 * be hostile.
 *
 * libtiff would turn fractions into floats and types into its own; metadata that
 * must come out as it went in is read here instead. The walk is flat (first
 * directory, EXIF, GPS, SubIFDs, one level), so no chain of directories can
 * make it run for ever.
 */
#include <string.h>

#include "raw/raw.h"

enum {
    TAG_NEW_SUBFILE_TYPE = 254,
    TAG_PHOTOMETRIC = 262,
    TAG_SUB_IFDS = 330,
    TAG_EXIF_IFD = 34665,
    TAG_GPS_IFD = 34853,
    TAG_MAKER_NOTE = 37500,
    PHOTOMETRIC_CFA = 32803,
    PHOTOMETRIC_LINEAR_RAW = 34892,
    MOST_SUB_IFDS = 16
};

static uint16_t read16(const raw_tiff *t, size_t at) {
    const uint8_t *p = t->data + at;
    return (uint16_t)(t->big ? p[0] << 8 | p[1] : p[1] << 8 | p[0]);
}

static uint32_t read32(const raw_tiff *t, size_t at) {
    uint32_t a = read16(t, at), b = read16(t, at + 2);
    return t->big ? a << 16 | b : b << 16 | a;
}

bool raw_tiff_open(raw_tiff *tiff, const void *data, size_t size) {
    const uint8_t *p = data;
    if (size < 14 || !((p[0] == 'I' && p[1] == 'I') || (p[0] == 'M' && p[1] == 'M'))) {
        return false;
    }
    *tiff = (raw_tiff){.data = p, .size = size, .big = p[0] == 'M'};
    uint16_t magic = read16(tiff, 2);
    /* 42; Olympus writes "RO" or "RS", Panasonic 85. */
    if (magic != 42 && magic != 0x4f52 && magic != 0x5352 && magic != 85) {
        return false;
    }
    tiff->first = read32(tiff, 4);
    return true;
}

uint32_t raw_tiff_entries(const raw_tiff *tiff, uint32_t ifd) {
    if (ifd < 8 || tiff->size < 2 || ifd > tiff->size - 2) {
        return 0;
    }
    uint32_t count = read16(tiff, ifd);
    size_t room = (tiff->size - 2 - ifd) / 12;
    return count > room ? (uint32_t)room : count;
}

bool raw_tiff_entry(const raw_tiff *tiff, uint32_t ifd, uint32_t index, raw_entry *entry) {
    size_t at = (size_t)ifd + 2 + (size_t)index * 12;
    entry->tag = read16(tiff, at);
    entry->type = read16(tiff, at + 2);
    entry->count = read32(tiff, at + 4);
    size_t each = raw_type_size(entry->type);
    if (each == 0 || entry->count == 0 || entry->count > tiff->size / each) {
        return false;
    }
    entry->size = entry->count * each;
    entry->offset = entry->size <= 4 ? at + 8 : read32(tiff, at + 8);
    return entry->offset <= tiff->size && entry->size <= tiff->size - entry->offset;
}

bool raw_tiff_find(const raw_tiff *tiff, uint32_t ifd, unsigned tag, raw_entry *entry) {
    uint32_t count = raw_tiff_entries(tiff, ifd);
    for (uint32_t i = 0; i < count; i++) {
        if (raw_tiff_entry(tiff, ifd, i, entry) && entry->tag == tag) {
            return true;
        }
    }
    return false;
}

uint32_t raw_tiff_long(const raw_tiff *tiff, const raw_entry *entry, uint32_t index) {
    if (index >= entry->count) {
        return 0;
    }
    switch (entry->type) {
    case RAW_BYTE:
        return tiff->data[entry->offset + index];
    case RAW_SHORT:
        return read16(tiff, entry->offset + (size_t)index * 2);
    case RAW_LONG:
    case RAW_IFD_OFFSET:
        return read32(tiff, entry->offset + (size_t)index * 4);
    default:
        return 0;
    }
}

/* Turns values of a file's byte order into this machine's. */
static void to_native(const raw_tiff *tiff, const raw_entry *entry, uint8_t *out) {
    size_t each = raw_type_size(entry->type);
    size_t word = entry->type == RAW_RATIONAL || entry->type == RAW_SRATIONAL ? 4 : each;
    const uint8_t *in = tiff->data + entry->offset;
    const uint16_t probe = 1;
    bool native_big = *(const uint8_t *)&probe == 0;
    if (word == 1 || native_big == tiff->big) {
        memcpy(out, in, entry->size);
        return;
    }
    for (size_t i = 0; i < entry->size; i += word) {
        for (size_t k = 0; k < word; k++) {
            out[i + k] = in[i + word - 1 - k];
        }
    }
}

/* Where the pixels and other directories lie: of no use outside their file. */
static bool is_pointer(unsigned tag) {
    switch (tag) {
    case 273: /* StripOffsets */
    case 279: /* StripByteCounts */
    case 324: /* TileOffsets */
    case 325: /* TileByteCounts */
    case 513: /* JPEGInterchangeFormat */
    case 514:
    case TAG_SUB_IFDS:
    case TAG_EXIF_IFD:
    case TAG_GPS_IFD:
    case 40965: /* interoperability */
        return true;
    default:
        return false;
    }
}

/* Puts a directory's tags. False only when memory ends. */
static bool collect(brace_tags *tags, const raw_tiff *tiff, uint32_t offset, raw_ifd ifd) {
    uint32_t count = raw_tiff_entries(tiff, offset);
    for (uint32_t i = 0; i < count; i++) {
        raw_entry e;
        if (!raw_tiff_entry(tiff, offset, i, &e) || is_pointer(e.tag) || raw_tags_find(tags, ifd, e.tag) != NULL) {
            continue;
        }
        if (tags->count >= RAW_TAGS_MAX_COUNT || e.size > RAW_TAGS_MAX_BYTES - tags->bytes) {
            continue;
        }
        uint8_t *values = core_alloc(e.size, 1);
        if (values == NULL) {
            return false;
        }
        to_native(tiff, &e, values);
        bool ok = raw_tags_put(tags, ifd, e.tag, e.type, e.count, values);
        core_free(values);
        if (!ok) {
            return false;
        }
    }
    return true;
}

/* True if a directory holds the full-resolution mosaic (or linear RGB, which is refused later). */
static bool holds_raw(const raw_tiff *tiff, uint32_t offset) {
    raw_entry e;
    uint32_t kind = raw_tiff_find(tiff, offset, TAG_NEW_SUBFILE_TYPE, &e) ? raw_tiff_long(tiff, &e, 0) : 0;
    uint32_t photometric = raw_tiff_find(tiff, offset, TAG_PHOTOMETRIC, &e) ? raw_tiff_long(tiff, &e, 0) : 0;
    return kind == 0 && (photometric == PHOTOMETRIC_CFA || photometric == PHOTOMETRIC_LINEAR_RAW);
}

static bool collect_tiff(brace_tags *tags, const raw_tiff *tiff, raw_ifd first) {
    raw_entry e;
    if (!collect(tags, tiff, tiff->first, first)) {
        return false;
    }
    if (first != RAW_IFD_MAIN) {
        return true;
    }
    if (raw_tiff_find(tiff, tiff->first, TAG_EXIF_IFD, &e) &&
        !collect(tags, tiff, raw_tiff_long(tiff, &e, 0), RAW_IFD_EXIF)) {
        return false;
    }
    if (raw_tiff_find(tiff, tiff->first, TAG_GPS_IFD, &e) &&
        !collect(tags, tiff, raw_tiff_long(tiff, &e, 0), RAW_IFD_GPS)) {
        return false;
    }
    if (!holds_raw(tiff, tiff->first) && raw_tiff_find(tiff, tiff->first, TAG_SUB_IFDS, &e)) {
        for (uint32_t i = 0; i < e.count && i < MOST_SUB_IFDS; i++) {
            uint32_t offset = raw_tiff_long(tiff, &e, i);
            if (holds_raw(tiff, offset)) {
                return collect(tags, tiff, offset, RAW_IFD_RAW);
            }
        }
    }
    return true;
}

static uint32_t big32(const uint8_t *p) {
    return (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3];
}

/* Fujifilm RAF: a header with the offset of a JPEG, whose EXIF block is a TIFF. */
static bool collect_raf(brace_tags *tags, const uint8_t *p, size_t size) {
    if (size < 92) {
        return true;
    }
    size_t at = big32(p + 84);
    if (at > size || size - at < 4 || p[at] != 0xff || p[at + 1] != 0xd8) {
        return true;
    }
    at += 2;
    for (int i = 0; i < 16 && size - at >= 4 && p[at] == 0xff; i++) {
        size_t length = (size_t)(p[at + 2] << 8 | p[at + 3]);
        if (length < 2 || length > size - at - 2) {
            return true;
        }
        raw_tiff tiff;
        if (p[at + 1] == 0xe1 && length >= 22 && memcmp(p + at + 4, "Exif\0", 6) == 0 &&
            raw_tiff_open(&tiff, p + at + 10, length - 8)) {
            return collect_tiff(tags, &tiff, RAW_IFD_MAIN);
        }
        at += 2 + length;
    }
    return true;
}

/* Canon CR3: boxes CMT1 (first directory), CMT2 (EXIF), CMT4 (GPS) inside
 * moov/uuid, each a TIFF of one directory. */
static bool collect_cr3(brace_tags *tags, const uint8_t *p, size_t size, int depth) {
    for (size_t at = 0; size - at >= 8;) {
        size_t length = big32(p + at);
        if (length < 8 || length > size - at) {
            return true;
        }
        const uint8_t *kind = p + at + 4;
        raw_tiff tiff;
        raw_ifd ifd = kind[3] == '1' ? RAW_IFD_MAIN : kind[3] == '2' ? RAW_IFD_EXIF : RAW_IFD_GPS;
        if (depth < 2 && memcmp(kind, "moov", 4) == 0) {
            return collect_cr3(tags, p + at + 8, length - 8, depth + 1);
        }
        if (depth == 1 && memcmp(kind, "uuid", 4) == 0 && length > 24) {
            if (!collect_cr3(tags, p + at + 24, length - 24, depth + 1)) {
                return false;
            }
        } else if (depth == 2 && memcmp(kind, "CMT", 3) == 0 && kind[3] != '3' &&
                   raw_tiff_open(&tiff, p + at + 8, length - 8) && !collect(tags, &tiff, tiff.first, ifd)) {
            return false;
        }
        at += length;
    }
    return true;
}

brace_status raw_tags_read(brace_tags **out, const void *data, size_t size, brace_error *error) {
    const uint8_t *p = data;
    raw_tiff tiff;
    *out = NULL;
    bool is_tiff = raw_tiff_open(&tiff, data, size);
    bool is_raf = size >= 92 && memcmp(p, "FUJIFILMCCD-RAW", 15) == 0;
    bool is_cr3 = size >= 12 && memcmp(p + 4, "ftypcrx ", 8) == 0;
    if (!is_tiff && !is_raf && !is_cr3) {
        return BRACE_OK;
    }
    brace_tags *tags = raw_tags_create();
    bool ok = tags != NULL && (is_tiff  ? collect_tiff(tags, &tiff, RAW_IFD_MAIN)
                               : is_raf ? collect_raf(tags, p, size)
                                        : collect_cr3(tags, p, size, 0));
    if (!ok) {
        raw_tags_destroy(tags);
        return core_fail_memory(error, size < RAW_TAGS_MAX_BYTES ? size : RAW_TAGS_MAX_BYTES, "the file's metadata");
    }
    *out = tags;
    return BRACE_OK;
}
