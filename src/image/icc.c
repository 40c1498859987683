/* SPDX-License-Identifier: Apache-2.0 */
/*
 * icc.c: what pictures say about themselves: an ICC profile of sRGB made from
 * its definition, and the orientation in an EXIF block.
 */
#include <math.h>
#include <string.h>

#include "image/image.h"

/* ---- ICC profile: ICC.1:2010 (version 4.3) ---- */

static void put16(unsigned char *p, uint32_t v) {
    p[0] = (unsigned char)(v >> 8);
    p[1] = (unsigned char)v;
}

static void put32(unsigned char *p, uint32_t v) {
    put16(p, v >> 16);
    put16(p + 2, v);
}

static void put_fixed(unsigned char *p, double v) { /* s15Fixed16Number, 4.6 */
    put32(p, (uint32_t)(int32_t)lrint(v * 65536.0));
}

static size_t put_text(unsigned char *p, const char *text) { /* multiLocalizedUnicodeType, 10.13 */
    size_t n = strlen(text);
    memcpy(p, "mluc", 4);
    put32(p + 8, 1);
    put32(p + 12, 12);
    memcpy(p + 16, "enUS", 4);
    put32(p + 20, (uint32_t)(2 * n));
    put32(p + 24, 28);
    for (size_t i = 0; i < n; i++) {
        p[28 + 2 * i + 1] = (unsigned char)text[i];
    }
    return 28 + 2 * n;
}

static size_t put_xyz(unsigned char *p, const double xyz[3]) { /* XYZType, 10.27 */
    memcpy(p, "XYZ ", 4);
    for (int i = 0; i < 3; i++) {
        put_fixed(p + 8 + 4 * i, xyz[i]);
    }
    return 20;
}

/* sRGB's primaries and white (IEC 61966-2-1) adapted from D65 to D50 by the
 * Bradford transform, as 9.2.15 asks; the colourants add up to D50. */
static const double white[3] = {0.9642, 1.0, 0.8249};
static const double colorants[3][3] = {
    {0.4360747, 0.2225045, 0.0139322},
    {0.3850649, 0.7168786, 0.0971045},
    {0.1430804, 0.0606169, 0.7141733},
};
static const double bradford[9] = {
    1.0478112, 0.0228866, -0.0501270, 0.0295424, 0.9904844, -0.0170491, -0.0092345, 0.0150436, 0.7521316,
};
/* Y = (aX + b)^g for X >= d, else cX: parametricCurveType 3, in the order g a b c d (10.16) */
static const double curve[5] = {2.4, 1.0 / 1.055, 0.055 / 1.055, 1.0 / 12.92, 0.04045};

void image_icc_srgb(unsigned char out[IMAGE_ICC_SIZE]) {
    static const char *const tags[] = {"desc", "cprt", "wtpt", "chad", "rXYZ", "gXYZ", "bXYZ", "rTRC", "gTRC", "bTRC"};
    enum { TAGS = 10 };
    memset(out, 0, IMAGE_ICC_SIZE);
    size_t at = 128 + 4 + TAGS * 12, shared = 0;
    put32(out + 128, TAGS);
    for (int i = 0; i < TAGS; i++) {
        size_t size = 0;
        unsigned char *p = out + at;
        if (i == 0) {
            size = put_text(p, "sRGB");
        } else if (i == 1) {
            size = put_text(p, "Public domain");
        } else if (i == 2) {
            size = put_xyz(p, white);
        } else if (i == 3) {
            memcpy(p, "sf32", 4);
            for (int k = 0; k < 9; k++) {
                put_fixed(p + 8 + 4 * k, bradford[k]);
            }
            size = 44;
        } else if (i <= 6) {
            size = put_xyz(p, colorants[i - 4]);
        } else if (i == 7) {
            memcpy(p, "para", 4);
            put16(p + 8, 3);
            for (int k = 0; k < 5; k++) {
                put_fixed(p + 12 + 4 * k, curve[k]);
            }
            size = 32;
            shared = at;
        }
        unsigned char *entry = out + 132 + i * 12;
        memcpy(entry, tags[i], 4);
        put32(entry + 4, (uint32_t)(i > 7 ? shared : at)); /* one curve for all three */
        put32(entry + 8, (uint32_t)(i > 7 ? 32 : size));
        at = (at + size + 3) / 4 * 4;
    }
    /* The header, 7.2. The date is fixed: equal pictures are equal files. */
    put32(out, (uint32_t)at);
    put32(out + 8, 0x04300000u);
    memcpy(out + 12, "mntrRGB XYZ ", 12);
    put16(out + 24, 2025);
    put16(out + 26, 1);
    put16(out + 28, 1);
    memcpy(out + 36, "acsp", 4);
    for (int i = 0; i < 3; i++) {
        put_fixed(out + 68 + 4 * i, white[i]);
    }
}

bool image_icc_is_srgb(const unsigned char *profile, size_t size) {
    static const char plain[] = "sRGB", wide[] = "s\0R\0G\0B";
    if (size < 132 || memcmp(profile + 16, "RGB ", 4) != 0) {
        return false;
    }
    /* The description is text in version 2 and UTF-16 in version 4. */
    return memmem(profile + 128, size - 128, plain, 4) != NULL || memmem(profile + 128, size - 128, wide, 7) != NULL;
}

/* ---- EXIF orientation: EXIF 2.3, 4.5 and 4.6.4; the block is a TIFF file without its picture ---- */

int image_exif_orientation(const unsigned char *exif, size_t size) {
    if (size >= 6 && memcmp(exif, "Exif\0\0", 6) == 0) {
        exif += 6;
        size -= 6;
    }
    if (size < 14 || (memcmp(exif, "II*\0", 4) != 0 && memcmp(exif, "MM\0*", 4) != 0)) {
        return 1;
    }
    bool big = exif[0] == 'M';
#define GET16(p) ((uint32_t)(big ? (p)[0] << 8 | (p)[1] : (p)[1] << 8 | (p)[0]))
    const unsigned char *o = exif + 4;
    size_t ifd = big ? (size_t)o[0] << 24 | (size_t)o[1] << 16 | (size_t)o[2] << 8 | o[3]
                     : (size_t)o[3] << 24 | (size_t)o[2] << 16 | (size_t)o[1] << 8 | o[0];
    if (ifd > size - 2) {
        return 1;
    }
    size_t count = GET16(exif + ifd);
    for (size_t i = 0; i < count && ifd + 2 + (i + 1) * 12 <= size; i++) {
        const unsigned char *entry = exif + ifd + 2 + i * 12;
        if (GET16(entry) == 0x0112 && GET16(entry + 2) == 3) {
            uint32_t value = GET16(entry + 8);
            return value >= 1 && value <= 8 ? (int)value : 1;
        }
    }
#undef GET16
    return 1;
}
