/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_pictures.c: every format, sample type and number of channels through a
 * file and back; kinds of file that we read but never write; refusals.
 */
#include <png.h>
#include <tiffio.h>
#include <webp/decode.h>

#include "image/tiff_handle.h"
#include "make.h"

static char notes[1000];

static void on_note(void *user, const char *message) {
    (void)user;
    strncat(notes, message, sizeof notes - strlen(notes) - 1);
}

static brace_image *read_back(const char *path) {
    brace_image *image = NULL;
    brace_error error = {BRACE_OK, ""};
    brace_job job = {.note = on_note};
    notes[0] = '\0';
    if (brace_image_read(&image, path, &job, &error) != BRACE_OK) {
        fail_msg("%s", error.message);
    }
    assert_string_equal(notes, ""); /* our own files need no remarks: they are tagged as sRGB */
    return image;
}

static void write_picture(const brace_image *image, const char *path, const brace_image_write_params *params,
                          int threads) {
    brace_error error = {BRACE_OK, ""};
    brace_job job = {.threads = threads};
    if (brace_image_write(image, path, params, &job, &error) != BRACE_OK) {
        fail_msg("%s", error.message);
    }
}

static brace_image *converted(const brace_image *image, uint32_t channels, brace_sample sample,
                              brace_transfer transfer) {
    brace_image *out = NULL;
    assert_int_equal(brace_image_convert(&out, image, channels, sample, transfer, NULL), BRACE_OK);
    return out;
}

static void assert_same_file(const char *a, const char *b) {
    void *p = NULL, *q = NULL;
    size_t n = 0, m = 0;
    assert_int_equal(core_file_load(&p, &n, a, 1u << 30, NULL), BRACE_OK);
    assert_int_equal(core_file_load(&q, &m, b, 1u << 30, NULL), BRACE_OK);
    assert_int_equal(n, m);
    assert_memory_equal(p, q, n);
    core_free(p);
    core_free(q);
}

static void test_lossless(void **state) {
    (void)state;
    static const uint32_t channels[] = {1, 3, 4};
    static const uint32_t sizes[][2] = {{61, 47}, {1, 1}, {3, 200}, {1200, 300}};
    for (int c = 0; c < 3; c++) {
        for (int sample = 0; sample < 3; sample++) {
            for (int transfer = 0; transfer < 2; transfer++) {
                /* Every kind in small, every channel, sample and transfer in large. */
                for (int s = 0; s < ((c + sample + transfer) % 3 == 0 ? 4 : 3); s++) {
                    brace_image *a = make_picture(sizes[s][0], sizes[s][1], channels[c], (brace_sample)sample,
                                                  (brace_transfer)transfer, 9);
                    for (int bits = 8; bits <= 32; bits *= 2) {
                        brace_image_write_params params = {.bits = bits, .compression = 1 + (bits + s) % 9};
                        const char *tiff = in_folder("a.tif"), *png = in_folder("a.png");
                        brace_image *wanted = converted(a, channels[c],
                                                        bits == 8    ? BRACE_SAMPLE_U8
                                                        : bits == 16 ? BRACE_SAMPLE_U16
                                                                     : BRACE_SAMPLE_F32,
                                                        bits == 32 ? BRACE_TRANSFER_LINEAR : BRACE_TRANSFER_SRGB);
                        write_picture(a, tiff, &params, 1 + s);
                        brace_image *b = read_back(tiff);
                        assert_same(wanted, b);
                        brace_image_destroy(b);
                        if (bits <= 16) {
                            write_picture(a, png, &params, 1 + s);
                            b = read_back(png);
                            assert_same(wanted, b);
                            brace_image_destroy(b);
                        }
                        brace_image_destroy(wanted);
                    }
                    brace_image_destroy(a);
                }
            }
        }
    }
}

/* Pixels that cannot be compressed take more room than they have: by so little, or so much, in strips of any length. */
static void test_noise(void **state) {
    (void)state;
    static const uint32_t sizes[][2] = {{512, 512}, {413, 1266}, {1, 1}, {1000, 37}, {171, 170}};
    static const char *const names[] = {"n.png", "n.tif"};
    for (int s = 0; s < 5; s++) {
        for (uint32_t channels = 1; channels < 4; channels += 2) {
            brace_image *a = NULL;
            assert_int_equal(brace_image_create(&a, sizes[s][0], sizes[s][1], channels, BRACE_SAMPLE_U16,
                                                BRACE_TRANSFER_SRGB, NULL), BRACE_OK);
            core_random r = core_random_create(3, sizes[s][0], channels, 0);
            for (size_t i = 0; i < a->stride * a->height / 2; i++) {
                ((uint16_t *)a->data)[i] = (uint16_t)core_random_u32(&r);
            }
            for (int compression = 0; compression < 9; compression += 4) { /* 0: the default */
                for (int i = 0; i < 2; i++) {
                    write_picture(a, in_folder(names[i]), &(brace_image_write_params){.compression = compression}, 2);
                    brace_image *b = read_back(in_folder(names[i]));
                    assert_same(a, b);
                    brace_image_destroy(b);
                }
            }
            brace_image_destroy(a);
        }
    }
}

/* The same bytes for any number of threads. */
static void test_threads(void **state) {
    (void)state;
    brace_image *a = make_picture(1500, 1100, 3, BRACE_SAMPLE_U16, BRACE_TRANSFER_SRGB, 3);
    static const char *const names[] = {"1.png", "2.png", "1.tif", "2.tif"};
    for (int i = 0; i < 4; i++) {
        write_picture(a, in_folder(names[i]), NULL, i % 2 == 0 ? 1 : 5);
    }
    assert_same_file(in_folder("1.png"), in_folder("2.png"));
    assert_same_file(in_folder("1.tif"), in_folder("2.tif"));
    brace_image_destroy(a);
}

static void test_lossy(void **state) {
    (void)state;
    static const uint32_t channels[] = {1, 3, 4};
    for (int c = 0; c < 3; c++) {
        for (int quality = 50; quality <= 100; quality += 25) {
            brace_image *a = make_picture(161, 97, channels[c], BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, 4);
            brace_image_write_params params = {.quality = quality};
            write_picture(a, in_folder("a.jpg"), &params, 1);
            write_picture(a, in_folder("a.webp"), &params, 1);
            brace_image *b = read_back(in_folder("a.jpg"));
            uint32_t kept = channels[c] == 1 ? 1 : 3;
            assert_int_equal(b->channels, kept);
            brace_image *same = converted(a, kept, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB);
            assert_true(psnr_u8(same, b) > (quality == 50 ? 26 : quality == 75 ? 28 : 40));
            brace_image_destroy(same);
            brace_image_destroy(b);
            b = read_back(in_folder("a.webp"));
            kept = channels[c] == 4 ? 4 : 3;
            assert_int_equal(b->channels, kept);
            same = converted(a, kept, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB);
            if (quality == 100) {
                assert_same(same, b);
            } else {
                assert_true(psnr_u8(same, b) > 26);
            }
            brace_image_destroy(same);
            brace_image_destroy(b);
            brace_image_destroy(a);
        }
    }
}

static void test_format_choice(void **state) {
    (void)state;
    brace_image *a = make_picture(20, 10, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, 4);
    brace_image_write_params params = {.format = BRACE_PICTURE_JPEG};
    write_picture(a, in_folder("really-jpeg.png"), &params, 1); /* read by content, not by name */
    brace_image_destroy(read_back(in_folder("really-jpeg.png")));
    write_picture(a, in_folder("A.TIFF"), NULL, 1);
    write_picture(a, in_folder("a.b.JPeG"), NULL, 1);
    brace_error error;
    assert_int_equal(brace_image_write(a, in_folder("a.gif"), NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, ".png"));
    assert_int_equal(brace_image_write(a, "/tmp.png/a", NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    static const brace_image_write_params bad[] = {{.bits = 12},    {.bits = 32},        {.quality = 101},
                                                   {.quality = -1}, {.compression = 10}, {.compression = -1},
                                                   {.format = 5}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(brace_image_write(a, in_folder("x.png"), &bad[i], NULL, &error), BRACE_ERROR_ARGUMENT);
    }
    assert_int_equal(brace_image_write(NULL, in_folder("x.png"), NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(brace_image_write(a, NULL, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    brace_image_destroy(a);
    assert_int_equal(empty_folder(), 3);
    a = make_picture(17000, 1, 1, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, 4);
    assert_int_equal(brace_image_write(a, in_folder("x.webp"), NULL, NULL, &error), BRACE_ERROR_UNSUPPORTED);
    assert_non_null(strstr(error.message, "17000 x 1"));
    assert_int_equal(empty_folder(), 0);
    brace_image_destroy(a);
}

static void test_unwritable(void **state) {
    (void)state;
    brace_image *a = make_picture(700, 500, 3, BRACE_SAMPLE_U16, BRACE_TRANSFER_SRGB, 4);
    brace_error error;
    for (int format = 1; format <= 4; format++) {
        brace_image_write_params params = {.format = (brace_picture_format)format};
        assert_int_equal(brace_image_write(a, "/dev/full", &params, NULL, &error), BRACE_ERROR_IO);
        assert_non_null(strstr(error.message, "no space left"));
        assert_int_equal(brace_image_write(a, "/nowhere/x", &params, NULL, &error), BRACE_ERROR_IO);
        assert_int_equal(brace_image_write(a, folder, &params, NULL, &error), BRACE_ERROR_IO);
        assert_int_equal(brace_image_write(a, "/dev/null", &params, NULL, &error), BRACE_OK);
        const int cancel = 1;
        brace_job job = {.cancel = &cancel};
        assert_int_equal(brace_image_write(a, in_folder("x"), &params, &job, &error), BRACE_ERROR_CANCELLED);
    }
    assert_int_equal(empty_folder(), 0);
    brace_image_destroy(a);
}

/* The n-th allocation fails, for every n: an error, no leak, no file. */
static void test_allocation_failures(void **state) {
    (void)state;
    static const char *const names[] = {"a.png", "a.tif", "a.jpg", "a.webp"};
    brace_image *a = make_picture(300, 200, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_LINEAR, 4);
    brace_job job = {.threads = 1};
    for (int i = 0; i < 4; i++) {
        brace_status status = BRACE_ERROR_MEMORY;
        for (long n = 1; status != BRACE_OK; n++) {
            assert_true(n < 200);
            core_alloc_fail_after(n);
            status = brace_image_write(a, in_folder(names[i]), NULL, &job, NULL);
            core_alloc_fail_after(0);
            assert_true(status == BRACE_OK || status == BRACE_ERROR_MEMORY);
            if (status != BRACE_OK) {
                assert_int_equal(empty_folder(), 0);
            }
        }
        status = BRACE_ERROR_MEMORY;
        for (long n = 1; status != BRACE_OK; n++) {
            assert_true(n < 200);
            brace_image *b = NULL;
            brace_error error = {BRACE_OK, ""};
            core_alloc_fail_after(n);
            status = brace_image_read(&b, in_folder(names[i]), &job, &error);
            core_alloc_fail_after(0);
            if (status == BRACE_OK) {
                assert_non_null(b);
            } else {
                assert_int_equal(status, BRACE_ERROR_MEMORY);
                assert_null(b);
                assert_true(strlen(error.message) > 0);
            }
            brace_image_destroy(b);
        }
        empty_folder();
    }
    brace_image_destroy(a);
}

/* ---- files that others write ---- */

static void put_png(const char *path, uint32_t width, uint32_t height, int depth, int type, int interlace,
                    const unsigned char *rows, size_t stride, bool transparent, bool late) {
    FILE *f = fopen(path, "wb");
    assert_non_null(f);
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    png_init_io(png, f);
    png_set_IHDR(png, info, width, height, depth, type, interlace, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    if (type == PNG_COLOR_TYPE_PALETTE) {
        static const png_color palette[4] = {{0, 0, 0}, {255, 0, 0}, {0, 200, 0}, {10, 20, 30}};
        static const png_byte alpha[2] = {255, 128};
        png_set_PLTE(png, info, palette, 4);
        if (transparent) {
            png_set_tRNS(png, info, alpha, 2, NULL);
        }
    }
    static png_byte exif[] = "MM\0*\0\0\0\x8\0\x1\x1\x12\0\x3\0\0\0\x1\0\x6\0\0\0\0\0";
    if (interlace && !late) {
        png_set_eXIf_1(png, info, 26, exif);
    }
    png_write_info(png, info);
    if (late) { /* as ImageMagick has it: behind the pixels */
        png_set_eXIf_1(png, info, 26, exif);
    }
    unsigned char *copy = malloc(stride * height);
    assert_non_null(copy);
    memcpy(copy, rows, stride * height);
    unsigned char *pointers[16];
    for (uint32_t y = 0; y < height; y++) {
        pointers[y] = copy + y * stride;
    }
    png_write_image(png, pointers);
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
    free(copy);
    fclose(f);
}

static void test_foreign_png(void **state) {
    (void)state;
    const char *path = in_folder("f.png");
    static const unsigned char bits[2] = {0x1b, 0xe4}; /* 2 bits: 0 1 2 3 / 3 2 1 0 */
    put_png(path, 4, 2, 2, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE, bits, 1, false, false);
    brace_image *a = read_back(path);
    assert_int_equal(a->channels, 1);
    assert_memory_equal(a->data, "\0\x55\xaa\xff\xff\xaa\x55\0", 8);
    brace_image_destroy(a);
    put_png(path, 4, 2, 2, PNG_COLOR_TYPE_PALETTE, PNG_INTERLACE_NONE, bits, 1, false, false);
    a = read_back(path);
    assert_int_equal(a->channels, 3);
    assert_memory_equal(a->data, "\0\0\0\xff\0\0\0\xc8\0\x0a\x14\x1e", 12);
    brace_image_destroy(a);
    put_png(path, 4, 2, 2, PNG_COLOR_TYPE_PALETTE, PNG_INTERLACE_NONE, bits, 1, true, false);
    a = read_back(path);
    assert_int_equal(a->channels, 4);
    assert_memory_equal(a->data, "\0\0\0\xff\xff\0\0\x80\0\xc8\0\xff", 12);
    brace_image_destroy(a);
    static const unsigned char grey_alpha[16] = {0x12, 0x34, 0xff, 0xff, 0xab, 0xcd, 0, 1};
    put_png(path, 2, 2, 16, PNG_COLOR_TYPE_GRAY_ALPHA, PNG_INTERLACE_NONE, grey_alpha, 8, false, false);
    a = read_back(path);
    assert_int_equal(a->channels, 4);
    const uint16_t *p = a->data;
    assert_true(p[0] == 0x1234 && p[1] == 0x1234 && p[2] == 0x1234 && p[3] == 0xffff && p[4] == 0xabcd && p[7] == 1);
    brace_image_destroy(a);
    /* Interlaced, and to be turned by 90 degrees. */
    static const unsigned char six[6] = {0, 1, 2, 3, 4, 5};
    for (int late = 0; late < 2; late++) {
        put_png(path, 3, 2, 8, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_ADAM7, six, 3, false, late);
        a = read_back(path);
        assert_int_equal(a->width, 2);
        assert_memory_equal(a->data, "\3\0\4\1\5\2", 6);
        brace_image_destroy(a);
    }
}

typedef struct tiff_case {
    uint16_t bits, samples, photometric, planar, format, compression, extra;
    bool tiled, big;
    uint32_t channels;
    brace_sample sample;
    uint16_t orientation; /* 0: none is said */
} tiff_case;

static void put_tiff(const char *path, const tiff_case *c, const void *pixels, uint32_t width, uint32_t height) {
    TIFF *t = TIFFOpen(path, c->big ? "wb8" : "wl");
    assert_non_null(t);
    TIFFSetField(t, TIFFTAG_IMAGEWIDTH, width);
    TIFFSetField(t, TIFFTAG_IMAGELENGTH, height);
    TIFFSetField(t, TIFFTAG_BITSPERSAMPLE, c->bits);
    TIFFSetField(t, TIFFTAG_SAMPLESPERPIXEL, c->samples);
    TIFFSetField(t, TIFFTAG_SAMPLEFORMAT, c->format);
    TIFFSetField(t, TIFFTAG_PHOTOMETRIC, c->photometric);
    TIFFSetField(t, TIFFTAG_PLANARCONFIG, c->planar);
    TIFFSetField(t, TIFFTAG_COMPRESSION, c->compression);
    if (c->extra != 0) {
        TIFFSetField(t, TIFFTAG_EXTRASAMPLES, 1, &c->extra);
    }
    if (c->orientation != 0) {
        TIFFSetField(t, TIFFTAG_ORIENTATION, c->orientation);
    }
    if (c->photometric == PHOTOMETRIC_PALETTE) {
        static uint16_t r[16], g[16], b[16];
        for (int i = 0; i < 16; i++) {
            r[i] = (uint16_t)(i * 257);
            g[i] = (uint16_t)(i * 514);
            b[i] = (uint16_t)(i * 4000);
        }
        TIFFSetField(t, TIFFTAG_COLORMAP, r, g, b);
    }
    bool separate = c->planar == PLANARCONFIG_SEPARATE;
    size_t pixel = (size_t)c->bits / 8 * (separate ? 1 : c->samples), all = (size_t)c->bits / 8 * c->samples;
    const unsigned char *in = pixels;
    if (c->tiled) {
        TIFFSetField(t, TIFFTAG_TILEWIDTH, 16);
        TIFFSetField(t, TIFFTAG_TILELENGTH, 16);
        unsigned char *tile = malloc(256 * pixel);
        assert_non_null(tile);
        for (uint16_t plane = 0; plane < (separate ? c->samples : 1); plane++) {
            for (uint32_t y0 = 0; y0 < height; y0 += 16) {
                for (uint32_t x0 = 0; x0 < width; x0 += 16) {
                    memset(tile, 0, 256 * pixel);
                    for (uint32_t y = 0; y < 16 && y0 + y < height; y++) {
                        for (uint32_t x = 0; x < 16 && x0 + x < width; x++) {
                            memcpy(tile + (y * 16 + x) * pixel,
                                   in + ((size_t)(y0 + y) * width + x0 + x) * all + plane * (separate ? pixel : 0),
                                   pixel);
                        }
                    }
                    assert_true(TIFFWriteTile(t, tile, x0, y0, 0, plane) >= 0);
                }
            }
        }
        free(tile);
    } else {
        TIFFSetField(t, TIFFTAG_ROWSPERSTRIP, 5);
        unsigned char *row = malloc(((size_t)width * c->bits * c->samples + 7) / 8);
        assert_non_null(row);
        for (uint16_t plane = 0; plane < (separate ? c->samples : 1); plane++) {
            for (uint32_t y = 0; y < height; y++) {
                if (c->bits < 8) {
                    memcpy(row, in + y * ((width * c->bits + 7) / 8), (width * c->bits + 7) / 8);
                } else {
                    for (uint32_t x = 0; x < width; x++) {
                        memcpy(row + x * pixel, in + ((size_t)y * width + x) * all + plane * (separate ? pixel : 0),
                               pixel);
                    }
                }
                assert_true(TIFFWriteScanline(t, row, y, plane) >= 0);
            }
        }
        free(row);
    }
    TIFFClose(t);
}

static void test_foreign_tiff(void **state) {
    (void)state;
    static const uint16_t photometric[] = {PHOTOMETRIC_MINISBLACK, PHOTOMETRIC_RGB};
    const char *path = in_folder("f.tif");
    for (int color = 0; color < 2; color++) {
        for (int alpha = 0; alpha < 2; alpha++) {
            for (int sample = 0; sample < 3; sample++) {
                for (int kind = 0; kind < 8; kind++) {
                    tiff_case c = {
                        .bits = (uint16_t)(8 << sample),
                        .samples = (uint16_t)((color ? 3 : 1) + alpha),
                        .photometric = photometric[color],
                        .planar = kind & 1 ? PLANARCONFIG_SEPARATE : PLANARCONFIG_CONTIG,
                        .format = sample == 2 ? SAMPLEFORMAT_IEEEFP : SAMPLEFORMAT_UINT,
                        .compression = kind & 4 ? COMPRESSION_LZW : COMPRESSION_NONE,
                        .extra = alpha ? EXTRASAMPLE_UNASSALPHA : 0,
                        .tiled = (kind & 2) != 0,
                        .big = kind == 7,
                    };
                    uint32_t channels = alpha ? 4 : color ? 3 : 1;
                    brace_image *a = make_picture(37, 23, channels, (brace_sample)sample,
                                                  sample == 2 ? BRACE_TRANSFER_LINEAR : BRACE_TRANSFER_SRGB, 8);
                    size_t size = image_sample_size((brace_sample)sample);
                    unsigned char *pixels = malloc(37 * 23 * c.samples * size);
                    assert_non_null(pixels);
                    for (size_t i = 0; i < 37 * 23; i++) {
                        unsigned char *p = (unsigned char *)a->data + i * channels * size;
                        if (!color && alpha) { /* grey: three equal channels */
                            memcpy(p + size, p, size);
                            memcpy(p + 2 * size, p, size);
                        }
                        memcpy(pixels + i * c.samples * size, p, size * (color ? 3 : 1));
                        if (alpha) {
                            memcpy(pixels + (i * c.samples + c.samples - 1u) * size, p + 3 * size, size);
                        }
                    }
                    put_tiff(path, &c, pixels, 37, 23);
                    brace_image *b = read_back(path);
                    assert_same(a, b);
                    free(pixels);
                    brace_image_destroy(a);
                    brace_image_destroy(b);
                }
            }
        }
    }
}

static void test_odd_tiff(void **state) {
    (void)state;
    const char *path = in_folder("f.tif");
    static const unsigned char nibbles[4] = {0x01, 0x23, 0xf0, 0x50};
    tiff_case grey4 = {
        4,     1, PHOTOMETRIC_MINISWHITE, PLANARCONFIG_CONTIG, SAMPLEFORMAT_UINT, COMPRESSION_NONE, 0, false,
        false, 1, BRACE_SAMPLE_U8, 0};
    put_tiff(path, &grey4, nibbles, 4, 2);
    brace_image *a = read_back(path);
    assert_int_equal(a->channels, 1);
    assert_memory_equal(a->data, "\xff\xee\xdd\xcc\0\xff\xaa\xff", 8);
    brace_image_destroy(a);
    tiff_case palette = grey4;
    palette.photometric = PHOTOMETRIC_PALETTE;
    put_tiff(path, &palette, nibbles, 4, 2);
    a = read_back(path);
    assert_int_equal(a->channels, 3);
    assert_int_equal(((uint8_t *)a->data)[3], 1);
    assert_int_equal(((uint8_t *)a->data)[4], 2);
    brace_image_destroy(a);
    /* Turned, as pixels of three bytes are: libtiff itself does half of it. */
    static const unsigned char six[4] = {0x01, 0x20, 0x34, 0x50}, rgb[18] = {0, 0, 0,  1, 1, 1,  2, 2, 2,
                                                                             3, 3, 3,  4, 4, 4,  5, 5, 5};
    for (uint16_t orientation = 1; orientation <= 8; orientation++) {
        palette.orientation = orientation;
        put_tiff(path, &palette, six, 3, 2);
        a = read_back(path);
        tiff_case plain = {.bits = 8, .samples = 3, .photometric = PHOTOMETRIC_RGB, .planar = PLANARCONFIG_CONTIG,
                           .format = SAMPLEFORMAT_UINT, .compression = COMPRESSION_NONE, .orientation = orientation};
        put_tiff(path, &plain, rgb, 3, 2);
        brace_image *b = read_back(path);
        assert_true(a->width == b->width && a->height == b->height);
        for (size_t i = 0; i < 18; i += 3) {
            assert_int_equal(((uint8_t *)a->data)[i], ((uint8_t *)b->data)[i]);
        }
        brace_image_destroy(a);
        brace_image_destroy(b);
    }
    tiff_case white16 = {
        16,    1, PHOTOMETRIC_MINISWHITE, PLANARCONFIG_CONTIG, SAMPLEFORMAT_UINT, COMPRESSION_NONE, 0, false,
        false, 1, BRACE_SAMPLE_U16, 0};
    static const uint16_t two[2] = {0, 60000};
    put_tiff(path, &white16, two, 2, 1);
    a = read_back(path);
    assert_true(((uint16_t *)a->data)[0] == 65535 && ((uint16_t *)a->data)[1] == 5535);
    brace_image_destroy(a);
    tiff_case multiplied = {8,
                            4,
                            PHOTOMETRIC_RGB,
                            PLANARCONFIG_CONTIG,
                            SAMPLEFORMAT_UINT,
                            COMPRESSION_NONE,
                            EXTRASAMPLE_ASSOCALPHA,
                            false,
                            false,
                            4,
                            BRACE_SAMPLE_U8,
                            0};
    static const unsigned char pixels[8] = {50, 100, 20, 100, 9, 0, 0, 0};
    put_tiff(path, &multiplied, pixels, 2, 1);
    a = read_back(path);
    static const unsigned char straight[8] = {128, 255, 51, 100, 0, 0, 0, 0};
    assert_memory_equal(a->data, straight, 8);
    brace_image_destroy(a);
    tiff_case cmyk = {
        8,     4, PHOTOMETRIC_SEPARATED, PLANARCONFIG_CONTIG, SAMPLEFORMAT_UINT, COMPRESSION_NONE, 0, false,
        false, 3, BRACE_SAMPLE_U8, 0};
    static const unsigned char inks[8] = {0, 0, 0, 0, 255, 0, 0, 0};
    put_tiff(path, &cmyk, inks, 2, 1);
    a = read_back(path);
    assert_int_equal(a->channels, 3);
    assert_memory_equal(a->data, "\xff\xff\xff\0\xff\xff", 6);
    brace_image_destroy(a);
    tiff_case wide = {
        64,    1, PHOTOMETRIC_MINISBLACK, PLANARCONFIG_CONTIG, SAMPLEFORMAT_IEEEFP, COMPRESSION_NONE, 0, false,
        false, 1, BRACE_SAMPLE_U8, 0};
    static const double one[1] = {0.5};
    put_tiff(path, &wide, one, 1, 1);
    brace_error error;
    assert_int_equal(brace_image_read(&a, path, NULL, &error), BRACE_ERROR_UNSUPPORTED);
    assert_non_null(strstr(error.message, "64 floating-point bits"));
    tiff_case raw = {16,    1, PHOTOMETRIC_CFA, PLANARCONFIG_CONTIG, SAMPLEFORMAT_UINT, COMPRESSION_NONE, 0, false,
                     false, 1, BRACE_SAMPLE_U16, 0};
    put_tiff(path, &raw, two, 2, 1);
    assert_int_equal(brace_image_read(&a, path, NULL, &error), BRACE_ERROR_UNSUPPORTED);
    assert_non_null(strstr(error.message, "RAW"));
}

static void put_bytes(const char *path, const void *data, size_t size) {
    FILE *f = fopen(path, "wb");
    assert_non_null(f);
    assert_int_equal(fwrite(data, 1, size, f), size);
    fclose(f);
}

static void test_not_pictures(void **state) {
    (void)state;
    brace_image *a = NULL;
    brace_error error;
    const char *path = in_folder("x.png");
    assert_int_equal(brace_image_read(&a, path, NULL, &error), BRACE_ERROR_IO);
    assert_int_equal(brace_image_read(&a, folder, NULL, &error), BRACE_ERROR_IO);
    assert_int_equal(brace_image_read(&a, NULL, NULL, &error), BRACE_ERROR_ARGUMENT);
    put_bytes(path, "", 0);
    assert_int_equal(brace_image_read(&a, path, NULL, &error), BRACE_ERROR_FORMAT);
    assert_non_null(strstr(error.message, "empty"));
    put_bytes(path, "hello, world", 12);
    assert_int_equal(brace_image_read(&a, path, NULL, &error), BRACE_ERROR_FORMAT);
    assert_non_null(strstr(error.message, "not a PNG, TIFF, JPEG or WebP"));
    /* 60000 x 60000: within the side limit, above the pixel limit; nothing is allocated for it. */
    static const unsigned char huge[] = "\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\xea\x60\0\0\xea\x60\x8\x2\0\0\0"
                                        "\xbc\x1d\xe2\xe2\0\0\0\1IDAT\0\0\0\0\0";
    put_bytes(path, huge, sizeof huge - 1);
    assert_int_not_equal(brace_image_read(&a, path, NULL, &error), BRACE_OK);
    assert_null(a);
    const int cancel = 1;
    brace_job job = {.cancel = &cancel};
    assert_int_equal(brace_image_read(&a, path, &job, &error), BRACE_ERROR_CANCELLED);
}

static void test_exif(void **state) {
    (void)state;
    static const unsigned char little[] =
        "Exif\0\0II*\0\x8\0\0\0\2\0\0\1\3\0\1\0\0\0\x9\0\0\0\x12\1\3\0\1\0\0\0\x8\0\0\0";
    static const unsigned char bad[] = "MM\0*\xff\xff\xff\xff\0\1\1\x12\0\3\0\0\0\1\0\6\0\0";
    assert_int_equal(image_exif_orientation(little, sizeof little), 8);
    for (size_t n = 0; n < sizeof little - 4; n++) {
        unsigned char *exact = malloc(n + 1);
        assert_non_null(exact);
        memcpy(exact, little, n);
        int o = image_exif_orientation(exact, n);
        assert_true(o == 1 || o == 8);
        free(exact);
    }
    assert_int_equal(image_exif_orientation(bad, sizeof bad), 1);
    assert_int_equal(image_exif_orientation(NULL, 0), 1);
}

int main(void) {
#define TEST(f) cmocka_unit_test_setup_teardown(f, make_folder, remove_folder)
    const struct CMUnitTest tests[] = {
        TEST(test_lossless),      TEST(test_noise),  TEST(test_threads),      TEST(test_lossy),
        TEST(test_format_choice), TEST(test_unwritable),   TEST(test_allocation_failures),
        TEST(test_foreign_png),   TEST(test_foreign_tiff), TEST(test_odd_tiff),
        TEST(test_not_pictures),  TEST(test_exif),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
