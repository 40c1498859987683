/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tiff.c: reading TIFF files (TIFF 6.0 and its technical notes) through libtiff,
 * from memory. Grey and RGB of 8, 16 and 32 bits keep every bit; all other kinds
 * (palettes, 1 to 4 bits, YCbCr, CMYK, CIE L*a*b*) go through libtiff's own
 * conversion to 8-bit RGB.
 */
#include <math.h>
#include <string.h>

#include <tiffio.h>

#include "image/image.h"
#include "image/tiff_handle.h"

typedef struct tiff_kind {
    uint32_t width, height;
    uint16_t bits, samples, format, photometric, planar, orientation, compression;
    int alpha; /* 0: none, 1: straight, 2: already multiplied into the colour */
} tiff_kind;

static brace_status fail_read(image_tiff *handle, brace_error *error) {
    return core_fail(error, BRACE_ERROR_FORMAT, "%s: cannot read the TIFF picture: %s", handle->name,
                     handle->message[0] != '\0' ? handle->message : "it is damaged");
}

static uint16_t get16(TIFF *tiff, uint32_t tag, uint16_t otherwise) {
    uint16_t v = otherwise;
    return TIFFGetFieldDefaulted(tiff, tag, &v) ? v : otherwise;
}

static void read_kind(TIFF *tiff, tiff_kind *k) {
    memset(k, 0, sizeof *k);
    TIFFGetField(tiff, TIFFTAG_IMAGEWIDTH, &k->width);
    TIFFGetField(tiff, TIFFTAG_IMAGELENGTH, &k->height);
    k->bits = get16(tiff, TIFFTAG_BITSPERSAMPLE, 1);
    k->samples = get16(tiff, TIFFTAG_SAMPLESPERPIXEL, 1);
    k->format = get16(tiff, TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_UINT);
    k->planar = get16(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    k->orientation = get16(tiff, TIFFTAG_ORIENTATION, 1);
    k->compression = get16(tiff, TIFFTAG_COMPRESSION, COMPRESSION_NONE);
    k->photometric = k->samples >= 3 ? PHOTOMETRIC_RGB : PHOTOMETRIC_MINISBLACK;
    TIFFGetField(tiff, TIFFTAG_PHOTOMETRIC, &k->photometric);
    uint16_t extra = 0, *kinds = NULL;
    if (TIFFGetField(tiff, TIFFTAG_EXTRASAMPLES, &extra, &kinds) && extra > 0 && kinds != NULL) {
        k->alpha = kinds[0] == EXTRASAMPLE_UNASSALPHA ? 1 : kinds[0] == EXTRASAMPLE_ASSOCALPHA ? 2 : 0;
    }
}

/* ---- samples that are taken as they are ---- */

typedef struct block {
    uint32_t x, y, width, height; /* of the part inside the picture */
    uint32_t stride;              /* pixels from one row of the buffer to the next */
    uint16_t plane, planes;       /* separate planes: which; otherwise 0 of 1 */
} block;

/* Copies one sample of every pixel of the block: from channel `from` of the buffer to `to` of the image. */
static void copy_channel(brace_image *image, const tiff_kind *k, const block *b, const unsigned char *buffer,
                         uint32_t from, uint32_t to) {
    size_t size = image_sample_size(image->sample);
    size_t in_step = (b->planes > 1 ? 1u : k->samples) * size, out_step = image->channels * size;
    for (uint32_t y = 0; y < b->height; y++) {
        const unsigned char *in = buffer + (size_t)y * b->stride * in_step + from * size;
        unsigned char *out = image_row(image, b->y + y) + (size_t)b->x * out_step + to * size;
        for (uint32_t x = 0; x < b->width; x++, in += in_step, out += out_step) {
            if (size == 1) {
                *out = *in;
            } else if (size == 2) {
                memcpy(out, in, 2);
            } else {
                memcpy(out, in, 4);
            }
        }
    }
}

static void copy_block(brace_image *image, const tiff_kind *k, const block *b, const unsigned char *buffer) {
    uint32_t colors = k->photometric == PHOTOMETRIC_RGB ? 3 : 1;
    for (uint32_t c = 0; c < colors + (k->alpha != 0 ? 1u : 0u); c++) {
        if (b->planes > 1 && c != b->plane) {
            continue;
        }
        uint32_t from = b->planes > 1 ? 0 : c;
        if (c == colors) {
            copy_channel(image, k, b, buffer, from, 3);
        } else {
            copy_channel(image, k, b, buffer, from, c);
            if (colors == 1 && image->channels == 4) { /* grey and alpha */
                copy_channel(image, k, b, buffer, from, 1);
                copy_channel(image, k, b, buffer, from, 2);
            }
        }
    }
}

static brace_status read_blocks(image_tiff *handle, const tiff_kind *k, brace_image *image, const brace_job *job,
                                brace_error *error) {
    TIFF *tiff = handle->tiff;
    bool tiled = TIFFIsTiled(tiff) != 0;
    uint32_t block_width = k->width, block_height = k->height;
    if (tiled) {
        block_width = block_height = 0;
        TIFFGetField(tiff, TIFFTAG_TILEWIDTH, &block_width);
        TIFFGetField(tiff, TIFFTAG_TILELENGTH, &block_height);
        if (block_width < 1 || block_height < 1 || block_width > BRACE_MAX_SIDE || block_height > BRACE_MAX_SIDE) {
            return core_fail(error, BRACE_ERROR_FORMAT, "%s: the TIFF picture's tiles are %u x %u pixels", handle->name,
                             block_width, block_height);
        }
    } else {
        uint32_t rows = k->height;
        if (TIFFGetFieldDefaulted(tiff, TIFFTAG_ROWSPERSTRIP, &rows) && rows >= 1 && rows < k->height) {
            block_height = rows;
        }
    }
    bool separate = k->planar == PLANARCONFIG_SEPARATE && k->samples > 1;
    size_t want = (size_t)block_width * block_height * (separate ? 1 : k->samples) * (k->bits / 8u);
    tmsize_t has = tiled ? TIFFTileSize(tiff) : TIFFVStripSize(tiff, block_height);
    /* More than the picture itself holds is no honest tile, but for small ones that reach over its edge. */
    if (has < 0 || (size_t)has != want || want > (size_t)image->stride * image->height * 4 + ((size_t)64 << 20)) {
        return core_fail(error, BRACE_ERROR_FORMAT, "%s: the TIFF picture's strips or tiles have a wrong size",
                         handle->name);
    }
    unsigned char *buffer = core_calloc(want, 1); /* some of libtiff's codecs leave the end of a damaged block as it was */
    if (buffer == NULL) {
        return core_fail_memory(error, want, handle->name);
    }
    brace_status status = BRACE_OK;
    block b = {.planes = separate ? k->samples : 1, .stride = block_width};
    uint16_t used = (uint16_t)((k->photometric == PHOTOMETRIC_RGB ? 3 : 1) + (k->alpha != 0 ? 1 : 0));
    for (b.plane = 0; b.plane < b.planes && b.plane < used; b.plane++) {
        for (b.y = 0; b.y < k->height; b.y += block_height) {
            b.height = k->height - b.y < block_height ? k->height - b.y : block_height;
            for (b.x = 0; b.x < k->width; b.x += block_width) {
                b.width = k->width - b.x < block_width ? k->width - b.x : block_width;
                size_t need = want;
                if (!tiled) {
                    need = want / block_height * b.height;
                }
                tmsize_t got =
                    tiled
                        ? TIFFReadEncodedTile(tiff, TIFFComputeTile(tiff, b.x, b.y, 0, b.plane), buffer, (tmsize_t)need)
                        : TIFFReadEncodedStrip(tiff, TIFFComputeStrip(tiff, b.y, b.plane), buffer, (tmsize_t)need);
                if (got < 0 || (size_t)got < need) {
                    status = fail_read(handle, error);
                    goto done;
                }
                copy_block(image, k, &b, buffer);
            }
            status = core_check_cancel(job, error);
            if (status != BRACE_OK) {
                goto done;
            }
        }
    }
done:
    core_free(buffer);
    return status;
}

/* Undoes what cannot be used: 0 for white, alpha in the colour, NaN. */
static void normalise(brace_image *image, const tiff_kind *k) {
    bool inverted = k->photometric == PHOTOMETRIC_MINISWHITE;
    if (!inverted && k->alpha != 2 && image->sample != BRACE_SAMPLE_F32) {
        return;
    }
    size_t n = (size_t)image->width * image->channels;
    float top = image->sample == BRACE_SAMPLE_U8 ? 255.0f : image->sample == BRACE_SAMPLE_U16 ? 65535.0f : 1.0f;
    for (uint32_t y = 0; y < image->height; y++) {
        uint8_t *p8 = (uint8_t *)image_row(image, y);
        uint16_t *p16 = (uint16_t *)image_row(image, y);
        float *pf = (float *)image_row(image, y);
        float alpha = top;
        for (size_t i = n; i-- > 0;) { /* backwards: a pixel's alpha comes first */
            bool is_alpha = image->channels == 4 && i % 4 == 3;
            float v = top == 1.0f ? pf[i] : top == 255.0f ? (float)p8[i] : (float)p16[i];
            if (!isfinite(v)) {
                v = 0;
            }
            if (is_alpha) {
                alpha = v;
            } else {
                if (k->alpha == 2) {
                    v = alpha > 0 ? v * top / alpha : 0;
                    if (top > 1.0f && v > top) {
                        v = top;
                    }
                }
                if (inverted) {
                    v = top - v;
                }
            }
            if (top == 1.0f) {
                pf[i] = isfinite(v) ? v : 0;
            } else if (top == 255.0f) {
                p8[i] = (uint8_t)(v + 0.5f);
            } else {
                p16[i] = (uint16_t)(v + 0.5f);
            }
        }
    }
}

/* ---- everything else ---- */

static brace_status read_converted(image_tiff *handle, const tiff_kind *k, brace_image **out, brace_error *error) {
    char why[1024] = "";
    if (!TIFFRGBAImageOK(handle->tiff, why)) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED, "%s: a TIFF picture of a kind that is not handled: %s",
                         handle->name, why);
    }
    size_t pixels = (size_t)k->width * k->height;
    uint32_t *raster = core_alloc(pixels, sizeof *raster);
    if (raster == NULL) {
        return core_fail_memory(error, pixels * sizeof *raster, handle->name);
    }
    /* As it is stored: libtiff flips, but does not transpose. The last argument: stop at the first error. */
    const int stored = k->orientation >= 1 && k->orientation <= 8 ? k->orientation : ORIENTATION_TOPLEFT;
    if (!TIFFReadRGBAImageOriented(handle->tiff, k->width, k->height, raster, stored, 1)) {
        core_free(raster);
        return fail_read(handle, error);
    }
    bool grey =
        k->samples == 1 && (k->photometric == PHOTOMETRIC_MINISBLACK || k->photometric == PHOTOMETRIC_MINISWHITE);
    uint32_t channels = grey ? 1 : k->alpha != 0 ? 4 : 3;
    brace_status status =
        image_create_raw(out, k->width, k->height, channels, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, error);
    for (uint32_t y = 0; status == BRACE_OK && y < k->height; y++) {
        const uint32_t *in = raster + (size_t)y * k->width;
        unsigned char *row = image_row(*out, y);
        for (uint32_t x = 0; x < k->width; x++, row += channels) {
            uint32_t a = TIFFGetA(in[x]);
            uint32_t rgb[3] = {TIFFGetR(in[x]), TIFFGetG(in[x]), TIFFGetB(in[x])};
            for (uint32_t c = 0; c < channels && c < 3; c++) {
                /* libtiff gives alpha multiplied into the colour. */
                uint32_t v = channels == 4 ? (a > 0 ? (rgb[c] * 255 + a / 2) / a : 0) : rgb[c];
                row[c] = (unsigned char)(v > 255 ? 255 : v);
            }
            if (channels == 4) {
                row[3] = (unsigned char)a;
            }
        }
    }
    core_free(raster);
    return status;
}

static brace_status read_picture(image_tiff *handle, const image_source *source, brace_image **image,
                                 brace_error *error) {
    TIFF *tiff = handle->tiff;
    tiff_kind k;
    read_kind(tiff, &k);
    unsigned char *dng = NULL;
    if (TIFFGetField(tiff, TIFFTAG_DNGVERSION, &dng) || k.photometric == PHOTOMETRIC_CFA) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                         "%s: this is a RAW file (DNG), not a picture: it has to be developed first", source->name);
    }
    brace_status status = image_check_size(source->name, k.width, k.height, source->max_pixels, error);
    if (status != BRACE_OK) {
        return status;
    }
    if (k.samples < 1 || k.samples > 32) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED, "%s: a TIFF picture of %u channels; 1 to 4 are handled",
                         source->name, k.samples);
    }
    uint32_t size = 0;
    void *profile = NULL;
    if (TIFFGetField(tiff, TIFFTAG_ICCPROFILE, &size, &profile) && profile != NULL &&
        !image_icc_is_srgb(profile, size)) {
        core_note(source->job, "%s: its colour profile is not applied, %s assumed", source->name,
                  k.format == SAMPLEFORMAT_IEEEFP ? "linear sRGB" : "sRGB");
    }
    bool grey = k.photometric == PHOTOMETRIC_MINISBLACK || k.photometric == PHOTOMETRIC_MINISWHITE;
    uint16_t colors = grey ? 1 : 3;
    bool whole = (k.format == SAMPLEFORMAT_UINT || k.format == SAMPLEFORMAT_VOID) && (k.bits == 8 || k.bits == 16);
    bool real = k.format == SAMPLEFORMAT_IEEEFP && k.bits == 32;
    if (k.samples <= colors) {
        k.alpha = 0;
    }
    if ((grey || k.photometric == PHOTOMETRIC_RGB) && (whole || real) && k.samples >= colors) {
        uint32_t channels = k.alpha != 0 ? 4 : colors;
        status = image_create_raw(image, k.width, k.height, channels,
                                  real           ? BRACE_SAMPLE_F32
                                  : k.bits == 16 ? BRACE_SAMPLE_U16
                                                 : BRACE_SAMPLE_U8,
                                  real ? BRACE_TRANSFER_LINEAR : BRACE_TRANSFER_SRGB, error);
        if (status == BRACE_OK) {
            status = read_blocks(handle, &k, *image, source->job, error);
        }
        if (status == BRACE_OK) {
            normalise(*image, &k);
            status = image_turn(image, k.orientation, error);
        }
        return status;
    }
    if (k.bits > 16 || k.format == SAMPLEFORMAT_IEEEFP) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                         "%s: a TIFF picture of %u%s bits a sample; 8 and 16 bits and 32-bit float are handled",
                         source->name, k.bits, k.format == SAMPLEFORMAT_IEEEFP ? " floating-point" : "");
    }
    status = read_converted(handle, &k, image, error);
    return status == BRACE_OK ? image_turn(image, k.orientation, error) : status;
}

brace_status image_read_tiff(brace_image **out, const image_source *source, brace_error *error) {
    *out = NULL;
    image_tiff handle = {.name = source->name, .data = source->data, .size = source->size};
    brace_status status = image_tiff_open_memory(&handle, error);
    if (status != BRACE_OK) {
        return status;
    }
    brace_image *image = NULL;
    status = read_picture(&handle, source, &image, error);
    TIFFClose(handle.tiff);
    if (status != BRACE_OK) {
        brace_image_destroy(image);
        return status;
    }
    *out = image;
    return BRACE_OK;
}
