/* SPDX-License-Identifier: Apache-2.0 */
/*
 * raw.h: what the parts of the RAW reader and writer share: a file's tags as
 * typed bytes, the walker that finds them, and exact fractions. Internal.
 */
#ifndef RAW_RAW_H
#define RAW_RAW_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "brace/bracket.h"
#include "brace/frame.h"
#include "core/core.h"

/* ---- tags (tags.c) ---- */

/* Which directory of a TIFF a tag stands in. */
typedef enum raw_ifd {
    RAW_IFD_MAIN = 0, /* the first directory */
    RAW_IFD_EXIF = 1,
    RAW_IFD_GPS = 2,
    RAW_IFD_RAW = 3 /* the SubIFD that holds the full-resolution mosaic, if that is not the first */
} raw_ifd;

/* TIFF 6.0 section 2 field types. */
enum {
    RAW_BYTE = 1,
    RAW_ASCII = 2,
    RAW_SHORT = 3,
    RAW_LONG = 4,
    RAW_RATIONAL = 5,
    RAW_SBYTE = 6,
    RAW_UNDEFINED = 7,
    RAW_SSHORT = 8,
    RAW_SLONG = 9,
    RAW_SRATIONAL = 10,
    RAW_FLOAT = 11,
    RAW_DOUBLE = 12,
    RAW_IFD_OFFSET = 13
};

typedef struct raw_tag {
    uint8_t ifd;
    uint16_t tag, type;
    uint32_t count;
    uint8_t *bytes; /* count values in this machine's byte order; rationals as two 32-bit words */
} raw_tag;

struct brace_tags {
    size_t count, capacity;
    raw_tag *items;
    size_t bytes; /* of all values together */
};

/* What a hostile file may make us keep. */
#define RAW_TAGS_MAX_COUNT 4096u
#define RAW_TAGS_MAX_BYTES (32u << 20)

size_t raw_type_size(unsigned type); /* 0 for an unknown type */

brace_tags *raw_tags_create(void); /* NULL when memory ends */
void raw_tags_destroy(brace_tags *tags);
brace_tags *raw_tags_clone(const brace_tags *tags); /* NULL when memory ends */

/* Adds or replaces a tag. False when memory ends or a limit is reached; the tags stay sound. */
bool raw_tags_put(brace_tags *tags, raw_ifd ifd, unsigned tag, unsigned type, uint32_t count, const void *values);
bool raw_tags_put_text(brace_tags *tags, raw_ifd ifd, unsigned tag, const char *text);
bool raw_tags_put_short(brace_tags *tags, raw_ifd ifd, unsigned tag, unsigned value);
bool raw_tags_put_long(brace_tags *tags, raw_ifd ifd, unsigned tag, uint32_t value);
bool raw_tags_put_real(brace_tags *tags, raw_ifd ifd, unsigned tag, unsigned type, uint32_t count,
                       const double *values); /* RAW_RATIONAL, RAW_SRATIONAL or RAW_DOUBLE */
void raw_tags_remove(brace_tags *tags, raw_ifd ifd, unsigned tag);

/* NULL if there is none; `tags` may be NULL. */
const raw_tag *raw_tags_find(const brace_tags *tags, raw_ifd ifd, unsigned tag);

/* Value `index` as a number; NaN if it is none, or a fraction over 0. */
double raw_tag_number(const raw_tag *tag, uint32_t index);

/* Copies an ASCII tag, without trailing blanks and control characters. "" if it is none. */
void raw_tag_text(const raw_tag *tag, char *out, size_t size);

/* ---- the walker (tags_tiff.c) ---- */

/* A TIFF file in memory. */
typedef struct raw_tiff {
    const uint8_t *data;
    size_t size;
    bool big;       /* big-endian */
    uint32_t first; /* offset of the first directory */
} raw_tiff;

typedef struct raw_entry {
    uint16_t tag, type;
    uint32_t count;
    size_t offset, size; /* of the value, checked to lie inside the file */
} raw_entry;

/* False if the bytes do not begin as a TIFF (or an ORF or RW2, which are TIFFs with another magic). */
bool raw_tiff_open(raw_tiff *tiff, const void *data, size_t size);
uint32_t raw_tiff_entries(const raw_tiff *tiff, uint32_t ifd); /* 0 for a directory outside the file */
bool raw_tiff_entry(const raw_tiff *tiff, uint32_t ifd, uint32_t index, raw_entry *entry); /* false: damaged */
bool raw_tiff_find(const raw_tiff *tiff, uint32_t ifd, unsigned tag, raw_entry *entry);
uint32_t raw_tiff_long(const raw_tiff *tiff, const raw_entry *entry, uint32_t index); /* BYTE, SHORT, LONG or IFD */

/* All tags of a TIFF-based file: first directory, EXIF, GPS, raw SubIFD; also of
 * the EXIF blocks inside CR3 and RAF files. *out is NULL for other files; damaged
 * entries are left out. Fails only when memory ends. */
brace_status raw_tags_read(brace_tags **out, const void *data, size_t size, brace_error *error);

/* (tags_keep.c) Leaves only what a DNG of the cropped, uncompressed mosaic may carry on: no
 * structure, no previews, nothing that depends on how the pixels were stored. */
void raw_tags_keep_portable(brace_tags *tags, bool dng);

/* ---- fractions (tags_rational.c) ---- */

/* The simplest fraction that gives exactly `value` as a double when divided, if
 * there is one whose terms are at most `limit`; else the nearest that was found.
 * Simplest is smallest in both terms, so every quotient of two numbers up to
 * `limit` survives. value >= 0 and finite. True if exact. */
bool raw_rational(double value, uint32_t limit, uint32_t *numerator, uint32_t *denominator);

/* The number nearest to what a camera wrote as a decimal or fraction and a library
 * handed on as a float: 0.0015625f becomes 1/640. */
double raw_from_float(float value);

/* The nearest double that a DNG's (signed) fraction holds exactly. */
double raw_representable(double value);

/* ---- reading (read.c, read_meta.c) ---- */

/* The active area, in pixels of the whole sensor. LibRaw moves odd origins of DNGs to
 * the next even ones, and its colour pattern with them; `moved` is how far (0 or 1). */
typedef struct raw_area {
    uint32_t left, top, width, height;
    int moved_x, moved_y;
} raw_area;

/* What LibRaw's struct and the tags say about a file, put into frame's fields.
 * `raw` is a libraw_data_t; frame has its pixels already. */
brace_status raw_read_metadata(brace_frame *frame, const void *raw, const raw_area *area, const brace_tags *tags,
                               const char *name, const brace_job *job, brace_error *error);

/* libraw_COLOR at (x, y) of the area: 0 red, 1 green, 2 blue, 3 the other green. */
int raw_color_at(const void *raw, const raw_area *area, int x, int y);

/* As brace_frame_read, of a file in memory. The bytes may be changed while it runs. */
brace_status raw_frame_read_memory(brace_frame **out, void *data, size_t size, const char *name, const brace_job *job,
                                   brace_error *error);

/* Noise that a sensor of common size has at an ISO: see read_meta.c. */
void raw_noise_from_iso(double noise[3][2], double iso);

/* The part of a path after its last slash. */
const char *raw_name(const char *path);

/* ---- writing (dng.c, dng_tiff.c, dng_preview.c) ---- */

/* The DNG as a file in memory; *data is freed with core_free. */
brace_status raw_dng_encode(void **data, size_t *size, const brace_frame *frame, const brace_dng_params *params,
                            const brace_job *job, const char *name, brace_error *error);

/* Directories, mosaic and preview to TIFF bytes. `tags` has the entries of all directories. */
brace_status raw_dng_assemble(void **data, size_t *size, const brace_tags *tags, const brace_frame *frame,
                              const brace_image *preview, const char *name, brace_error *error);

/* An 8-bit sRGB picture, as stored, of at most 1024 pixels a side. */
brace_status raw_dng_preview(brace_image **out, const brace_frame *frame, const brace_image *given,
                             const brace_job *job, brace_error *error);

/* ---- brackets (bracket.c, bracket_measure.c) ---- */

/* What pixels say of the exposure of two frames: the ratio dark/bright, and the
 * smallest and largest that any stripe of the picture shows. NaN if too few tell. */
typedef struct raw_ratio {
    double ratio, low, high;
} raw_ratio;
raw_ratio raw_measure_ratio(const brace_frame *dark, const brace_frame *bright);

#endif
