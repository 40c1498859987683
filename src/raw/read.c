/* SPDX-License-Identifier: Apache-2.0 */
/*
 * read.c: RAW files through LibRaw, which decodes the mosaic and no more: no
 * scaling, no colour, no brightness of its own, which would make the frames of
 * a bracket equal.
 *
 * LibRaw has had its share of security bugs, so it gets sizes checked before it
 * allocates, a memory limit, and a file held in memory.
 */
#include <errno.h>
#include <libraw/libraw.h>
#include <math.h>
#include <string.h>
#include <sys/stat.h>

#include "raw/raw.h"

/* A frame of BRACE_MAX_PIXELS uncompressed and a gigabyte of the maker's own data. */
#define FILE_LIMIT ((size_t)BRACE_MAX_PIXELS * 2 + ((size_t)1 << 30))

/* The densest lossless coder needs more than half a bit a pixel. */
enum { PIXELS_PER_BYTE = 16 };

/* LibRaw takes anything smaller for no picture. */
enum { LEAST_SIDE = 22 };

const char *raw_name(const char *path) {
    const char *slash = path != NULL ? strrchr(path, '/') : NULL;
    return slash != NULL && slash[1] != '\0' ? slash + 1 : path != NULL && *path != '\0' ? path : "the frame";
}

/* What a file that is no RAW file is, by its first bytes; NULL if unknown. */
static const char *other_kind(const uint8_t *p, size_t n) {
    static const struct {
        const char *magic;
        size_t length, offset;
        const char *kind;
    } kinds[] = {
        {"\xff\xd8\xff", 3, 0, "a JPEG picture"},
        {"\x89PNG", 4, 0, "a PNG picture"},
        {"WEBP", 4, 8, "a WebP picture"},
        {"GIF8", 4, 0, "a GIF picture"},
        {"BM", 2, 0, "a BMP picture"},
        {"8BPS", 4, 0, "a Photoshop picture"},
        {"%PDF", 4, 0, "a PDF document"},
        {"PK\x03\x04", 4, 0, "a ZIP archive"},
        {"\x1f\x8b", 2, 0, "a gzip archive"},
        {"\x76\x2f\x31\x01", 4, 0, "an OpenEXR picture"},
        {"ftypheic", 8, 4, "a HEIC picture"},
        {"ftypmif1", 8, 4, "a HEIF picture"},
        {"ftypavif", 8, 4, "an AVIF picture"},
        {"ftypmp4", 7, 4, "a video"},
        {"ftypisom", 8, 4, "a video"},
        {"ftypqt", 6, 4, "a video"},
        {"{", 1, 0, "a text file"},
        {"<", 1, 0, "a text file"},
    };
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        if (n >= kinds[i].offset + kinds[i].length &&
            memcmp(p + kinds[i].offset, kinds[i].magic, kinds[i].length) == 0) {
            return kinds[i].kind;
        }
    }
    return NULL;
}

/* Reasons that the directory of the raw image itself shows, before or after LibRaw gave up. */
static brace_status refuse_by_tags(const brace_tags *tags, const char *name, brace_error *error) {
    const raw_tag *raw_kind = NULL;
    static const raw_ifd where[] = {RAW_IFD_RAW, RAW_IFD_MAIN};
    for (size_t i = 0; i < 2 && raw_kind == NULL; i++) {
        raw_kind = raw_tags_find(tags, where[i], 262);
        double photometric = raw_tag_number(raw_kind, 0);
        if (photometric == 34892.0) {
            return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                             "%s is a linear RGB DNG, already demosaiced: BRACE needs the sensor's own Bayer mosaic",
                             name);
        }
        if (photometric != 32803.0) {
            raw_kind = NULL;
            continue;
        }
        if (raw_tag_number(raw_tags_find(tags, where[i], 339), 0) == 3.0) {
            return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                             "%s is a floating-point DNG (an HDR merge): BRACE reads the integer RAW files of a camera",
                             name);
        }
        double compression = raw_tag_number(raw_tags_find(tags, where[i], 259), 0);
        if (compression == 8.0 || compression == 32946.0) {
            return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                             "%s is a deflate-compressed DNG, which cannot be decoded: save it uncompressed or with "
                             "lossless JPEG compression",
                             name);
        }
    }
    return BRACE_OK;
}

static brace_status fail_libraw(int code, const brace_tags *tags, const uint8_t *head, size_t size, const char *name,
                                brace_error *error) {
    brace_status status = refuse_by_tags(tags, name, error);
    if (status != BRACE_OK) {
        return status;
    }
    for (int i = 0; i < 2; i++) {
        raw_ifd where = i == 0 ? RAW_IFD_RAW : RAW_IFD_MAIN;
        double photometric = raw_tag_number(raw_tags_find(tags, where, 262), 0);
        double width = raw_tag_number(raw_tags_find(tags, where, 256), 0);
        double height = raw_tag_number(raw_tags_find(tags, where, 257), 0);
        if (photometric == 32803.0 && (width < LEAST_SIDE || height < LEAST_SIDE)) {
            return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                             "%s has only %.0f x %.0f pixels: LibRaw reads RAW files of at least %d x %d", name, width,
                             height, LEAST_SIDE, LEAST_SIDE);
        }
    }
    if (code == LIBRAW_IO_ERROR && tags == NULL && size < 1024) {
        code = LIBRAW_FILE_UNSUPPORTED; /* LibRaw looks for headers past the end of anything short */
    }
    switch (code) {
    case LIBRAW_UNSUFFICIENT_MEMORY:
        return core_fail(error, BRACE_ERROR_MEMORY, "out of memory: %s could not be decoded", name);
    case LIBRAW_TOO_BIG:
        return core_fail(error, BRACE_ERROR_UNSUPPORTED, "%s needs more memory than BRACE allows a RAW file to take",
                         name);
    case LIBRAW_IO_ERROR:
        return core_fail(error, BRACE_ERROR_FORMAT, "%s is damaged: it ends before its pixels do", name);
    case LIBRAW_DATA_ERROR:
    case LIBRAW_BAD_CROP:
    case LIBRAW_MEMPOOL_OVERFLOW:
        return core_fail(error, BRACE_ERROR_FORMAT, "%s is damaged: its pixels could not be decoded", name);
    default:
        break;
    }
    if (size >= 4 && (memcmp(head, "II*\0", 4) == 0 || memcmp(head, "MM\0*", 4) == 0)) {
        return core_fail(error, BRACE_ERROR_FORMAT,
                         "%s is a TIFF file without RAW pixels that could be read: a picture, a damaged file, or a "
                         "camera newer than LibRaw %s",
                         name, libraw_version());
    }
    return core_fail(error, BRACE_ERROR_FORMAT, "%s is not a RAW file that LibRaw %s knows", name, libraw_version());
}

/* Sensors that are no Bayer mosaic of three colours. */
static brace_status check_kind(libraw_data_t *raw, const brace_tags *tags, const char *name, brace_error *error) {
    const libraw_iparams_t *id = &raw->idata;
    const char *kind = NULL;
    if (id->is_foveon) {
        kind = "comes from a Foveon sensor, which has no colour filter mosaic";
    } else if (id->filters == 9) {
        kind = "comes from an X-Trans sensor, whose 6 x 6 colour filter is not supported";
    } else if (raw->sizes.pixel_aspect > 1.01 || raw->sizes.pixel_aspect < 0.99) {
        kind = "has pixels that are not square";
    } else if (id->filters == 0 && id->colors == 1) {
        kind = "comes from a monochrome sensor";
    } else if (id->filters == 0) {
        brace_status status = refuse_by_tags(tags, name, error);
        if (status != BRACE_OK) {
            return status;
        }
        kind = "holds linear RGB, already demosaiced, and no Bayer mosaic";
    } else if (id->filters < 1000) {
        kind = "has a colour filter that is no 2 x 2 Bayer pattern";
    } else if (id->colors != 3 || strncmp(id->cdesc, "RGBG", 4) != 0) {
        kind = "has a colour filter of other colours than red, green and blue";
    }
    return kind == NULL ? BRACE_OK
                        : core_fail(error, BRACE_ERROR_UNSUPPORTED, "%s %s: BRACE needs a Bayer RAW file", name, kind);
}

int raw_color_at(const void *raw, const raw_area *area, int x, int y) {
    /* LibRaw's filters refer to its own origin; 2 more keeps the sign and the pattern. */
    return libraw_COLOR((libraw_data_t *)(uintptr_t)raw, y - area->moved_y + 2, x - area->moved_x + 2);
}

/* LibRaw's area, or that of the DNG's ActiveArea (top, left, bottom, right) where LibRaw moved it. */
static raw_area find_area(const libraw_data_t *raw, const brace_tags *tags) {
    const libraw_image_sizes_t *s = &raw->sizes;
    raw_area area = {.left = s->left_margin, .top = s->top_margin, .width = s->width, .height = s->height};
    const raw_tag *tag = raw_tags_find(tags, RAW_IFD_RAW, 50829);
    tag = tag != NULL ? tag : raw_tags_find(tags, RAW_IFD_MAIN, 50829);
    double edge[4];
    for (uint32_t i = 0; i < 4; i++) {
        edge[i] = raw_tag_number(tag, i); /* NaN, for which all below is false, if there is none */
    }
    bool inside = edge[0] < edge[2] && edge[1] < edge[3] && edge[2] <= s->raw_height && edge[3] <= s->raw_width;
    if (raw->idata.dng_version == 0 || !inside) {
        return area;
    }
    double right = (double)s->left_margin + s->width, bottom = (double)s->top_margin + s->height;
    if (edge[1] + 1.0 == s->left_margin && edge[3] == right) {
        area.left--;
        area.width++;
        area.moved_x = 1;
    }
    if (edge[0] + 1.0 == s->top_margin && edge[2] == bottom) {
        area.top--;
        area.height++;
        area.moved_y = 1;
    }
    return area;
}

/* The CFA order at the active area's origin. */
static brace_status find_cfa(brace_cfa *cfa, libraw_data_t *raw, const raw_area *area, const char *name,
                             brace_error *error) {
    int pattern[4];
    bool periodic = true;
    for (int y = 0; y < 8; y++) {
        for (int x = 0; x < 8; x++) {
            int c = raw_color_at(raw, area, x, y);
            c = c == 3 ? 1 : c;
            if (y < 2 && x < 2) {
                pattern[y * 2 + x] = c;
            }
            periodic = periodic && c == pattern[(y & 1) * 2 + (x & 1)];
        }
    }
    for (int k = BRACE_CFA_RGGB; periodic && k <= BRACE_CFA_BGGR; k++) {
        bool same = true;
        for (uint32_t i = 0; i < 4; i++) {
            same = same && pattern[i] == brace_cfa_color((brace_cfa)k, i & 1, i >> 1);
        }
        if (same) {
            *cfa = (brace_cfa)k;
            return BRACE_OK;
        }
    }
    return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                     "%s has a colour filter that is no 2 x 2 Bayer pattern: BRACE needs a Bayer RAW file", name);
}

static brace_status check_sizes(const libraw_data_t *raw, size_t size, const char *name, brace_error *error) {
    const libraw_image_sizes_t *s = &raw->sizes;
    uint64_t pixels = (uint64_t)s->raw_width * s->raw_height;
    if (s->width < 4 || s->height < 4 || s->left_margin + s->width > s->raw_width ||
        s->top_margin + s->height > s->raw_height) {
        return core_fail(error, BRACE_ERROR_FORMAT,
                         "%s is damaged: its active area of %u x %u pixels does not lie in its sensor of %u x %u", name,
                         s->width, s->height, s->raw_width, s->raw_height);
    }
    if (pixels > BRACE_MAX_PIXELS) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                         "%s says it has %u x %u pixels: more than %u million are not read", name, s->raw_width,
                         s->raw_height, BRACE_MAX_PIXELS / 1000000u);
    }
    if (pixels / PIXELS_PER_BYTE > size) {
        return core_fail(error, BRACE_ERROR_FORMAT,
                         "%s is damaged: %zu bytes cannot hold the %u x %u pixels that it says it has", name, size,
                         s->raw_width, s->raw_height);
    }
    return BRACE_OK;
}

static void on_data_error(void *user, const char *file, int offset) {
    (void)file;
    (void)offset;
    *(int *)user += 1;
}

static void on_memory_error(void *user, const char *file, const char *where) {
    (void)user;
    (void)file;
    (void)where;
}

static int on_progress(void *user, enum LibRaw_progress stage, int iteration, int expected) {
    (void)stage;
    (void)iteration;
    (void)expected;
    return core_cancelled(user) ? 1 : 0;
}

/* Copies the active area. LibRaw's raw image goes as soon as that is done. */
static brace_status take_pixels(brace_frame **out, libraw_data_t *raw, const raw_area *area, brace_cfa cfa,
                                const char *name, brace_error *error) {
    const libraw_image_sizes_t *s = &raw->sizes;
    const uint16_t *from = raw->rawdata.raw_image;
    size_t pitch = s->raw_pitch / sizeof *from;
    if (from == NULL || pitch < s->raw_width) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                         "%s holds no Bayer mosaic of integers after decoding: BRACE needs a Bayer RAW file", name);
    }
    brace_status status = brace_frame_create(out, area->width, area->height, cfa, error);
    if (status != BRACE_OK) {
        return status;
    }
    for (uint32_t y = 0; y < area->height; y++) {
        memcpy((*out)->data + (size_t)y * area->width, from + (area->top + y) * pitch + area->left,
               area->width * sizeof *from);
    }
    return BRACE_OK;
}

/* Leaves the decoded sensor in raw->rawdata. */
static brace_status decode(brace_cfa *cfa, raw_area *area, libraw_data_t *raw, void *data, size_t size,
                           const brace_tags *tags, const char *name, const brace_job *job, brace_error *error) {
    int damaged = 0;
    uint8_t head[16] = {0};
    memcpy(head, data, size < sizeof head ? size : sizeof head);
    libraw_set_dataerror_handler(raw, on_data_error, &damaged);
    libraw_set_memerror_handler(raw, on_memory_error, NULL);
    libraw_set_progress_handler(raw, on_progress, (void *)(uintptr_t)job);
    raw->params.max_raw_memory_mb = 2 * (BRACE_MAX_PIXELS / 1000000u) + 256;

    int code = libraw_open_buffer(raw, data, size);
    if (code != LIBRAW_SUCCESS) {
        brace_status status = core_check_cancel(job, error);
        return status != BRACE_OK ? status : fail_libraw(code, tags, head, size, name, error);
    }
    brace_status status = check_kind(raw, tags, name, error);
    if (status == BRACE_OK) {
        status = check_sizes(raw, size, name, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    code = libraw_unpack(raw);
    if (code != LIBRAW_SUCCESS || damaged > 0) {
        status = core_check_cancel(job, error);
        return status != BRACE_OK
                   ? status
                   : fail_libraw(code != LIBRAW_SUCCESS ? code : LIBRAW_DATA_ERROR, tags, head, size, name, error);
    }
    if (raw->rawdata.ioparams.fuji_width != 0) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                         "%s comes from a Fujifilm sensor whose grid is turned by 45 degrees: BRACE needs a Bayer RAW "
                         "file",
                         name);
    }
    /* Unpacking may refine sizes and pattern. */
    status = check_sizes(raw, size, name, error);
    *area = find_area(raw, tags);
    return status == BRACE_OK ? find_cfa(cfa, raw, area, name, error) : status;
}

/* As raw_frame_read_memory, but frees `data` (with core_free) as soon as it can when `owned`. */
static brace_status read_bytes(brace_frame **out, void *data, size_t size, bool owned, const char *name,
                               const brace_job *job, brace_error *error) {
    *out = NULL;
    brace_tags *tags = NULL;
    brace_frame *frame = NULL;
    libraw_data_t *raw = NULL;
    brace_cfa cfa = BRACE_CFA_RGGB;
    raw_area area = {0};
    const char *kind = other_kind(data, size);
    brace_status status = BRACE_OK;
    if (size == 0) {
        status = core_fail(error, BRACE_ERROR_FORMAT, "%s is empty", name);
    } else if (kind != NULL) {
        status = core_fail(error, BRACE_ERROR_FORMAT, "%s is %s, not a RAW file", name, kind);
    } else {
        status = raw_tags_read(&tags, data, size, error);
    }
    if (status == BRACE_OK && (raw = libraw_init(0)) == NULL) {
        status = core_fail_memory(error, sizeof *raw, "the RAW decoder");
    }
    if (status == BRACE_OK) {
        status = decode(&cfa, &area, raw, data, size, tags, name, job, error);
    }
    if (owned) {
        /* LibRaw reads no more of it from here on. */
        if (raw != NULL) {
            libraw_recycle_datastream(raw);
        }
        core_free(data);
    }
    if (status == BRACE_OK) {
        status = take_pixels(&frame, raw, &area, cfa, name, error);
    }
    if (status == BRACE_OK) {
        status = raw_read_metadata(frame, raw, &area, tags, name, job, error);
    }
    bool dng = raw != NULL && raw->idata.dng_version != 0;
    if (raw != NULL) {
        libraw_close(raw);
    }
    if (status != BRACE_OK) {
        raw_tags_destroy(tags);
        brace_frame_destroy(frame);
        return status;
    }
    raw_tags_keep_portable(tags, dng);
    if (frame->tags == NULL) {
        frame->tags = tags;
    } else {
        raw_tags_destroy(tags);
    }
    *out = frame;
    return BRACE_OK;
}

brace_status raw_frame_read_memory(brace_frame **out, void *data, size_t size, const char *name, const brace_job *job,
                                   brace_error *error) {
    return read_bytes(out, data, size, false, name, job, error);
}

brace_status brace_frame_read(brace_frame **out, const char *path, const brace_job *job, brace_error *error) {
    if (out == NULL || path == NULL) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "a file name and a place to put the frame are needed");
    }
    *out = NULL;
    void *data = NULL;
    size_t size = 0;
    brace_status status = core_check_cancel(job, error);
    if (status == BRACE_OK) {
        status = core_file_load(&data, &size, path, FILE_LIMIT, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    brace_frame *frame = NULL;
    status = read_bytes(&frame, data, size, true, path, job, error);
    if (status != BRACE_OK) {
        return status;
    }
    char *copy = core_strdup(path);
    if (copy == NULL) {
        brace_frame_destroy(frame);
        return core_fail_memory(error, strlen(path) + 1, "a file name");
    }
    core_free(frame->path);
    frame->path = copy;
    *out = frame;
    return BRACE_OK;
}
