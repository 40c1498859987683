/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tags_keep.c: which tags of a file may go into a DNG whose pixels are new.
 *
 * From the first directory only tags known to stay true are taken, as makers
 * put private offsets there (Sony's 50740 is one). The EXIF and GPS directories
 * hold only values, so all that their standards define is kept, MakerNote
 * included. Structure, previews, crops, opcodes, linearisation, digests and the
 * original's name are left behind: they describe pixels that are gone.
 */
#include <string.h>

#include "raw/raw.h"

typedef struct tag_range {
    uint16_t first, last;
} tag_range;

static bool in_ranges(const tag_range *ranges, size_t count, unsigned tag) {
    for (size_t i = 0; i < count; i++) {
        if (tag >= ranges[i].first && tag <= ranges[i].last) {
            return true;
        }
    }
    return false;
}
#define IN(ranges, tag) in_ranges(ranges, sizeof(ranges) / sizeof((ranges)[0]), tag)

/* TIFF 6.0, XMP, IPTC, Photoshop and Windows' descriptive tags. */
static const tag_range descriptive[] = {
    {269, 272},     /* DocumentName, ImageDescription, Make, Model */
    {274, 274},     /* Orientation */
    {285, 285},     /* PageName */
    {305, 306},     /* Software, DateTime */
    {315, 316},     /* Artist, HostComputer */
    {700, 700},     /* XMP */
    {18246, 18246}, /* Rating */
    {18249, 18249}, /* RatingPercent */
    {33432, 33432}, /* Copyright */
    {33723, 33723}, /* IPTC */
    {40091, 40095}, /* XPTitle to XPSubject */
};

/* DNG 1.4 chapter 4 and 6: of the first directory, valid for any pixels of that camera. */
static const tag_range dng_main[] = {
    {50708, 50709}, /* UniqueCameraModel, LocalizedCameraModel */
    {50721, 50722}, /* ColorMatrix1, 2; CameraCalibration and AnalogBalance are multiplied in by read_meta.c */
    {50728, 50728}, /* AsShotNeutral */
    {50730, 50732}, /* BaselineExposure, -Noise, -Sharpness */
    {50734, 50736}, /* LinearResponseLimit, CameraSerialNumber, LensInfo */
    {50739, 50741}, /* ShadowScale, DNGPrivateData, MakerNoteSafety */
    {50778, 50779}, /* CalibrationIlluminant1, 2 */
    {50931, 50932}, /* CameraCalibrationSignature, ProfileCalibrationSignature */
    {50934, 50934}, /* AsShotProfileName */
    {50936, 50942}, /* ProfileName to ProfileCopyright: hue and saturation maps, tone curve, embed policy */
    {50964, 50965}, /* ForwardMatrix1, 2 */
    {50981, 50982}, /* ProfileLookTable */
    {51107, 51110}, /* map and look encodings, BaselineExposureOffset, DefaultBlackRender */
};

static const tag_range dng_raw[] = {
    {50733, 50733}, /* BayerGreenSplit */
    {50738, 50738}, /* AntiAliasStrength */
    {51041, 51041}, /* NoiseProfile */
};

/* EXIF 2.32 tables 6 to 9, without pixel sizes and the interoperability pointer. */
static const tag_range exif[] = {
    {33434, 33437}, /* ExposureTime, FNumber */
    {34850, 34869}, /* ExposureProgram to sensitivities */
    {36864, 36882}, /* ExifVersion, dates, time zones */
    {37121, 37122}, /* ComponentsConfiguration, CompressedBitsPerPixel */
    {37377, 37396}, /* ShutterSpeedValue to SubjectArea */
    {37500, 37522}, /* MakerNote, UserComment, SubSecTime */
    {37888, 37893}, /* temperature, humidity, pressure, ... */
    {40960, 40961}, /* FlashpixVersion, ColorSpace */
    {40964, 40964}, /* RelatedSoundFile */
    {41483, 41495}, /* FlashEnergy to SensingMethod */
    {41728, 41729}, /* FileSource, SceneType */
    {41985, 41996}, /* CustomRendered to SubjectDistanceRange */
    {42016, 42016}, /* ImageUniqueID */
    {42032, 42037}, /* CameraOwnerName, serial numbers, lens */
    {42240, 42240}, /* Gamma */
};

/* Phones write EXIF tags into the first directory of their DNGs, as TIFF/EP has it. */
static void move_to_exif(brace_tags *tags) {
    for (size_t i = 0; i < tags->count; i++) {
        raw_tag t = tags->items[i];
        if (t.ifd == RAW_IFD_MAIN && IN(exif, t.tag) && raw_tags_find(tags, RAW_IFD_EXIF, t.tag) == NULL) {
            tags->items[i].ifd = RAW_IFD_EXIF;
        }
    }
}

void raw_tags_keep_portable(brace_tags *tags, bool dng) {
    if (tags == NULL) {
        return;
    }
    move_to_exif(tags);
    size_t kept = 0;
    for (size_t i = 0; i < tags->count; i++) {
        raw_tag t = tags->items[i];
        bool keep = false;
        switch (t.ifd) {
        case RAW_IFD_MAIN:
            keep = IN(descriptive, t.tag) || (dng && (IN(dng_main, t.tag) || IN(dng_raw, t.tag)));
            break;
        case RAW_IFD_EXIF:
            keep = IN(exif, t.tag);
            break;
        case RAW_IFD_GPS:
            keep = t.tag <= 31;
            break;
        default:
            keep = dng && IN(dng_raw, t.tag);
            break;
        }
        if (keep) {
            if (t.ifd == RAW_IFD_MAIN && IN(dng_raw, t.tag)) {
                t.ifd = RAW_IFD_RAW;
            }
            tags->items[kept++] = t;
        } else {
            tags->bytes -= (size_t)t.count * raw_type_size(t.type);
            core_free(t.bytes);
        }
    }
    tags->count = kept;
}
