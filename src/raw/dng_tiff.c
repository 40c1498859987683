/* SPDX-License-Identifier: Apache-2.0 */
/*
 * dng_tiff.c: the bytes of a DNG, through libtiff.
 *
 * libtiff lays out directories, strips and the JPEG preview, but takes fractions
 * as floating point and would change their last digits. So every value of eight
 * bits or more goes in twice: as a placeholder of the right type and count, and
 * then, when the file is complete in memory, exactly, over that placeholder. The
 * file is little-endian.
 */
#include <stdio.h>
#include <string.h>
#include <tiffio.h>

#include "raw/raw.h"

/* ---- a growing file in memory ---- */

typedef struct memory_file {
    uint8_t *data;
    size_t size, capacity, at;
    char message[256]; /* libtiff's first complaint */
    bool out_of_memory;
} memory_file;

static tmsize_t memory_read(thandle_t handle, void *buffer, tmsize_t n) {
    memory_file *m = (memory_file *)handle;
    size_t left = m->at < m->size ? m->size - m->at : 0;
    size_t take = n < 0 ? 0 : (size_t)n < left ? (size_t)n : left;
    if (take > 0) {
        memcpy(buffer, m->data + m->at, take);
        m->at += take;
    }
    return (tmsize_t)take;
}

static tmsize_t memory_write(thandle_t handle, void *buffer, tmsize_t n) {
    memory_file *m = (memory_file *)handle;
    if (n <= 0) {
        return 0;
    }
    size_t end = m->at + (size_t)n;
    if (end > UINT32_MAX) {
        return -1; /* a classic TIFF ends at 4 GB */
    }
    if (end > m->capacity) {
        size_t capacity = end + end / 4 + 65536;
        uint8_t *grown = core_alloc(capacity, 1);
        if (grown == NULL) {
            m->out_of_memory = true;
            return -1;
        }
        if (m->size > 0) {
            memcpy(grown, m->data, m->size);
        }
        core_free(m->data);
        m->data = grown;
        m->capacity = capacity;
    }
    if (m->at > m->size) {
        memset(m->data + m->size, 0, m->at - m->size);
    }
    memcpy(m->data + m->at, buffer, (size_t)n);
    m->at = end;
    m->size = end > m->size ? end : m->size;
    return n;
}

static toff_t memory_seek(thandle_t handle, toff_t offset, int whence) {
    memory_file *m = (memory_file *)handle;
    int64_t base = whence == SEEK_CUR ? (int64_t)m->at : whence == SEEK_END ? (int64_t)m->size : 0;
    int64_t to = base + (int64_t)offset;
    if (to < 0 || to > (int64_t)UINT32_MAX) {
        return (toff_t)-1;
    }
    m->at = (size_t)to;
    return (toff_t)to;
}

static int memory_close(thandle_t handle) {
    (void)handle;
    return 0;
}

static toff_t memory_size(thandle_t handle) {
    return ((memory_file *)handle)->size;
}

__attribute__((format(printf, 4, 0))) static int on_error(TIFF *tiff, void *user, const char *module,
                                                          const char *format, va_list args) {
    (void)tiff;
    (void)module;
    memory_file *m = user;
    if (m->message[0] == '\0') {
        vsnprintf(m->message, sizeof m->message, format, args);
    }
    return 1;
}

static int on_warning(TIFF *tiff, void *user, const char *module, const char *format, va_list args) {
    (void)tiff;
    (void)user;
    (void)module;
    (void)format;
    (void)args;
    return 1;
}

/* ---- setting a tag of any type ---- */

/* An array of one's for libtiff to reserve room by; the true values are put in later. */
static void *placeholder(const raw_tag *t, size_t each) {
    if (t->type != RAW_RATIONAL && t->type != RAW_SRATIONAL) {
        return t->bytes;
    }
    void *ones = core_alloc(t->count, each);
    for (uint32_t i = 0; ones != NULL && i < t->count; i++) {
        if (each == sizeof(float)) {
            ((float *)ones)[i] = 1.0f;
        } else {
            ((double *)ones)[i] = 1.0;
        }
    }
    return ones;
}

static int set_single(TIFF *tiff, const raw_tag *t) {
    uint16_t u16;
    uint32_t u32;
    float f32;
    double f64;
    switch (t->type) {
    case RAW_BYTE:
    case RAW_UNDEFINED:
        return TIFFSetField(tiff, t->tag, (int)t->bytes[0]);
    case RAW_SBYTE:
        return TIFFSetField(tiff, t->tag, (int)(int8_t)t->bytes[0]);
    case RAW_SHORT:
    case RAW_SSHORT:
        memcpy(&u16, t->bytes, 2);
        return TIFFSetField(tiff, t->tag, t->type == RAW_SHORT ? (int)u16 : (int)(int16_t)u16);
    case RAW_LONG:
    case RAW_SLONG:
        memcpy(&u32, t->bytes, 4);
        return TIFFSetField(tiff, t->tag, u32);
    case RAW_RATIONAL:
    case RAW_SRATIONAL:
        return TIFFSetField(tiff, t->tag, 1.0);
    case RAW_FLOAT:
        memcpy(&f32, t->bytes, 4);
        return TIFFSetField(tiff, t->tag, (double)f32);
    case RAW_DOUBLE:
        memcpy(&f64, t->bytes, 8);
        return TIFFSetField(tiff, t->tag, f64);
    default:
        return 0;
    }
}

/* What a libtiff that does not know a tag needs to be told: its type, any count. */
static bool declare(TIFF *tiff, const raw_tag *t) {
    static char name[] = "DNG";
    const TIFFFieldInfo info = {t->tag,
                                t->type == RAW_ASCII ? -1 : TIFF_VARIABLE2,
                                t->type == RAW_ASCII ? -1 : TIFF_VARIABLE2,
                                (TIFFDataType)t->type,
                                FIELD_CUSTOM,
                                1,
                                (unsigned char)(t->type == RAW_ASCII ? 0 : 1),
                                name};
    return TIFFMergeFieldInfo(tiff, &info, 1) == 0;
}

/* Integers of another width than libtiff has the tag in. False if that cannot be. */
static bool as_type(raw_tag *t, uint8_t *room, size_t size, TIFFDataType type) {
    size_t each = raw_type_size((unsigned)type);
    bool is_integer = t->type == RAW_BYTE || t->type == RAW_SHORT || t->type == RAW_LONG;
    if ((type == TIFF_UNDEFINED && t->type == RAW_BYTE) ||
        (type == TIFF_BYTE && (t->type == RAW_UNDEFINED || t->type == RAW_ASCII))) {
        t->type = (uint16_t)type;
        return true;
    }
    if (!is_integer || (type != TIFF_SHORT && type != TIFF_LONG) || (size_t)t->count * each > size) {
        return false;
    }
    for (uint32_t i = 0; i < t->count; i++) {
        double v = raw_tag_number(t, i);
        uint16_t u16 = (uint16_t)v;
        uint32_t u32 = (uint32_t)v;
        if (type == TIFF_SHORT && v > 65535.0) {
            return false;
        }
        memcpy(room + i * each, type == TIFF_SHORT ? (const void *)&u16 : (const void *)&u32, each);
    }
    t->bytes = room;
    t->type = (uint16_t)type;
    return true;
}

/* libtiff counts the bytes of some tags, the maker's note among them, in 16 bits: longer ones get so many bytes, and
 * put_exact puts the whole behind the file. */
enum { COUNTED = 65535, STAND_IN = 8 };

/* Gives libtiff a tag. Tags that it will not have (of a type or count against their
 * standard) are left out: they are a stranger's, and false is only for memory. */
static bool set_tag(TIFF *tiff, const raw_tag *original, size_t *taken) {
    raw_tag t = *original;
    uint8_t room[256];
    const TIFFField *field = TIFFFindField(tiff, t.tag, TIFF_ANY);
    if (field == NULL) {
        if (!declare(tiff, &t)) {
            return false;
        }
        field = TIFFFindField(tiff, t.tag, TIFF_ANY);
        if (field == NULL) {
            return false;
        }
    }
    if ((unsigned)TIFFFieldDataType(field) != t.type && !as_type(&t, room, sizeof room, TIFFFieldDataType(field))) {
        return true;
    }
    int wanted = TIFFFieldWriteCount(field);
    if (t.type == RAW_ASCII) {
        char *text = core_alloc((size_t)t.count + 1, 1);
        if (text == NULL) {
            return false;
        }
        memcpy(text, t.bytes, t.count);
        text[t.count] = '\0';
        for (uint32_t i = 0; i + 1 < t.count; i++) { /* EXIF's Copyright is two texts; put_exact restores the end of the first */
            text[i] = text[i] != '\0' ? text[i] : ' ';
        }
        int set = TIFFFieldPassCount(field) ? TIFFSetField(tiff, t.tag, (uint32_t)strlen(text) + 1, text)
                                            : TIFFSetField(tiff, t.tag, text);
        *taken += set == 1 ? 1 : 0;
        core_free(text);
        return true;
    }
    if (wanted > 0 && (uint32_t)wanted != t.count) {
        return true;
    }
    if (!TIFFFieldPassCount(field) && wanted == 1) {
        *taken += set_single(tiff, &t) == 1 ? 1 : 0;
        return true;
    }
    void *values = placeholder(&t, TIFFFieldSetGetSize(field) == 4 ? 4 : 8);
    if (values == NULL) {
        return false;
    }
    int set = 0;
    if (!TIFFFieldPassCount(field)) {
        set = TIFFSetField(tiff, t.tag, values);
    } else if (wanted == TIFF_VARIABLE2 || TIFFFieldSetGetCountSize(field) == 4) {
        set = TIFFSetField(tiff, t.tag, t.count, values);
    } else if (t.count <= COUNTED || raw_type_size(t.type) == 1) {
        set = TIFFSetField(tiff, t.tag, t.count <= COUNTED ? (int)t.count : STAND_IN, values);
    }
    *taken += set == 1 ? 1 : 0;
    if (values != t.bytes) {
        core_free(values);
    }
    return true;
}

static bool set_tags(TIFF *tiff, memory_file *m, const brace_tags *tags, raw_ifd ifd, size_t *taken) {
    for (size_t i = 0; i < tags->count; i++) {
        if (tags->items[i].ifd == (uint8_t)ifd && !set_tag(tiff, &tags->items[i], taken)) {
            m->out_of_memory = true;
            return false;
        }
    }
    m->message[0] = '\0'; /* complaints about a stranger's tags, which were left out */
    return true;
}

/* ---- directories ---- */

static bool write_custom(TIFF *tiff, memory_file *m, const brace_tags *tags, raw_ifd ifd, uint64_t *offset) {
    size_t taken = 0;
    *offset = 0;
    int failed = ifd == RAW_IFD_EXIF ? TIFFCreateEXIFDirectory(tiff) : TIFFCreateGPSDirectory(tiff);
    bool ok = failed == 0 && set_tags(tiff, m, tags, ifd, &taken);
    if (ok && taken > 0) { /* libtiff fails on a directory of nothing */
        ok = TIFFWriteCustomDirectory(tiff, offset) == 1;
    }
    TIFFFreeDirectory(tiff); /* the next one would be begun over its values */
    return ok;
}

static bool write_preview(TIFF *tiff, const brace_image *p) {
    bool ok = TIFFSetField(tiff, TIFFTAG_SUBFILETYPE, FILETYPE_REDUCEDIMAGE) &&
              TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, p->width) && TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, p->height) &&
              TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 8) && TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 3) &&
              TIFFSetField(tiff, TIFFTAG_COMPRESSION, COMPRESSION_JPEG) &&
              TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_YCBCR) &&
              TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG) &&
              TIFFSetField(tiff, TIFFTAG_YCBCRSUBSAMPLING, 2, 2) &&
              TIFFSetField(tiff, TIFFTAG_YCBCRPOSITIONING, YCBCRPOSITION_CENTERED) &&
              TIFFSetField(tiff, TIFFTAG_JPEGQUALITY, 85) &&
              TIFFSetField(tiff, TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB) &&
              /* Readers take the strip as a JPEG file: its tables must be inside. */
              TIFFSetField(tiff, TIFFTAG_JPEGTABLESMODE, 0) && TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, p->height);
    for (uint32_t y = 0; ok && y < p->height; y++) {
        ok = TIFFWriteScanline(tiff, (uint8_t *)p->data + (size_t)y * p->stride, y, 0) == 1;
    }
    return ok;
}

static bool write_mosaic(TIFF *tiff, const brace_frame *f) {
    uint32_t rows = (1u << 20) / (f->width * 2);
    rows = rows < 1 ? 1 : rows > f->height ? f->height : rows;
    bool ok =
        TIFFSetField(tiff, TIFFTAG_SUBFILETYPE, 0) && TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, f->width) &&
        TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, f->height) && TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 16) &&
        TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 1) && TIFFSetField(tiff, TIFFTAG_COMPRESSION, COMPRESSION_NONE) &&
        TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_CFA) &&
        TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG) && TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, rows);
    for (uint32_t y = 0, strip = 0; ok && y < f->height; y += rows, strip++) {
        uint32_t n = f->height - y < rows ? f->height - y : rows;
        tmsize_t bytes = (tmsize_t)((size_t)n * f->width * 2);
        ok = TIFFWriteEncodedStrip(tiff, strip, f->data + (size_t)y * f->width, bytes) == bytes;
    }
    return ok;
}

static bool write_all(TIFF *tiff, memory_file *m, const brace_tags *tags, const brace_frame *frame,
                      const brace_image *preview) {
    uint64_t exif = 0, gps = 0;
    size_t taken = 0;
    if (!write_custom(tiff, m, tags, RAW_IFD_EXIF, &exif) || !write_custom(tiff, m, tags, RAW_IFD_GPS, &gps) ||
        TIFFCreateDirectory(tiff) != 0 || !set_tags(tiff, m, tags, RAW_IFD_MAIN, &taken) ||
        (exif != 0 && !TIFFSetField(tiff, TIFFTAG_EXIFIFD, exif)) ||
        (gps != 0 && !TIFFSetField(tiff, TIFFTAG_GPSIFD, gps))) {
        return false;
    }
    if (preview != NULL) {
        uint64_t none = 0;
        if (!TIFFSetField(tiff, TIFFTAG_SUBIFD, 1, &none) || !write_preview(tiff, preview) ||
            TIFFWriteDirectory(tiff) != 1) {
            return false;
        }
    }
    return set_tags(tiff, m, tags, RAW_IFD_RAW, &taken) && write_mosaic(tiff, frame) && TIFFWriteDirectory(tiff) == 1;
}

/* ---- exact values over the placeholders ---- */

static void put_words(uint8_t *to, const raw_tag *t, size_t size) {
    size_t each = raw_type_size(t->type);
    size_t word = t->type == RAW_RATIONAL || t->type == RAW_SRATIONAL ? 4 : each;
    const uint16_t probe = 1;
    bool native_big = *(const uint8_t *)&probe == 0;
    for (size_t i = 0; i < size; i += word) {
        for (size_t k = 0; k < word; k++) {
            to[i + k] = t->bytes[i + (native_big ? word - 1 - k : k)];
        }
    }
}

/* The value of a directory's entry, behind all that is there; there is room for all tags. */
static void put_behind(memory_file *m, uint8_t *entry, const raw_tag *t) {
    const size_t at = m->size + (m->size & 1);
    if (at + t->count > m->capacity || at + t->count > UINT32_MAX) {
        return;
    }
    if (at > m->size) {
        m->data[m->size] = 0;
    }
    memcpy(m->data + at, t->bytes, t->count);
    m->size = at + t->count;
    for (int k = 0; k < 4; k++) {
        entry[4 + k] = (uint8_t)(t->count >> (8 * k));
        entry[8 + k] = (uint8_t)((uint32_t)at >> (8 * k));
    }
}

static void put_exact(memory_file *m, const brace_tags *tags, raw_ifd ifd, uint32_t offset) {
    raw_tiff tiff;
    if (!raw_tiff_open(&tiff, m->data, m->size)) {
        return;
    }
    uint32_t n = raw_tiff_entries(&tiff, offset);
    for (uint32_t i = 0; i < n; i++) {
        raw_entry e;
        const raw_tag *t = NULL;
        if (raw_tiff_entry(&tiff, offset, i, &e)) {
            if (e.tag == TIFFTAG_SUBIFD && e.type == RAW_IFD_OFFSET) {
                /* DNG 1.4 allows LONG and IFD; validators know LONG only. */
                m->data[offset + 2 + (size_t)i * 12 + 2] = RAW_LONG;
            }
            t = raw_tags_find(tags, ifd, e.tag);
        }
        if (t == NULL || t->type != e.type) {
            continue;
        }
        if (t->count == e.count && (raw_type_size(t->type) == 8 || t->type == RAW_ASCII)) {
            put_words(m->data + e.offset, t, e.size);
        } else if (t->count > COUNTED && e.count == STAND_IN && raw_type_size(t->type) == 1) {
            put_behind(m, m->data + offset + 2 + (size_t)i * 12, t);
        }
    }
}

static uint32_t pointer(const memory_file *m, uint32_t ifd, unsigned tag) {
    raw_tiff tiff;
    raw_entry e;
    return raw_tiff_open(&tiff, m->data, m->size) && raw_tiff_find(&tiff, ifd, tag, &e) ? raw_tiff_long(&tiff, &e, 0)
                                                                                        : 0;
}

brace_status raw_dng_assemble(void **data, size_t *size, const brace_tags *tags, const brace_frame *frame,
                              const brace_image *preview, const char *name, brace_error *error) {
    memory_file m = {0};
    m.capacity = (size_t)frame->width * frame->height * 2 + tags->bytes + (1u << 20);
    m.data = core_alloc(m.capacity, 1);
    if (m.data == NULL) {
        return core_fail_memory(error, m.capacity, "the DNG");
    }
    TIFFOpenOptions *options = TIFFOpenOptionsAlloc();
    TIFF *tiff = NULL;
    if (options != NULL) {
        TIFFOpenOptionsSetErrorHandlerExtR(options, on_error, &m);
        TIFFOpenOptionsSetWarningHandlerExtR(options, on_warning, &m);
        tiff = TIFFClientOpenExt(name, "wl", (thandle_t)&m, memory_read, memory_write, memory_seek, memory_close,
                                 memory_size, NULL, NULL, options);
        TIFFOpenOptionsFree(options);
    }
    bool ok = tiff != NULL && write_all(tiff, &m, tags, frame, preview);
    if (tiff != NULL) {
        TIFFClose(tiff);
    }
    raw_tiff check;
    if (!ok || !raw_tiff_open(&check, m.data, m.size)) {
        core_free(m.data);
        if (m.message[0] == '\0' || m.out_of_memory) {
            return core_fail_memory(error, m.capacity, "the DNG");
        }
        return core_fail(error, BRACE_ERROR_FORMAT, "%s cannot be written as DNG: %s", name, m.message);
    }
    put_exact(&m, tags, RAW_IFD_MAIN, check.first);
    put_exact(&m, tags, RAW_IFD_EXIF, pointer(&m, check.first, TIFFTAG_EXIFIFD));
    put_exact(&m, tags, RAW_IFD_GPS, pointer(&m, check.first, TIFFTAG_GPSIFD));
    put_exact(&m, tags, RAW_IFD_RAW, preview != NULL ? pointer(&m, check.first, TIFFTAG_SUBIFD) : check.first);
    *data = m.data;
    *size = m.size;
    return BRACE_OK;
}
