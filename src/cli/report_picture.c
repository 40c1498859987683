/* SPDX-License-Identifier: Apache-2.0 */
/*
 * report_picture.c: pictures inside the page, as data: URIs (RFC 2397). They are written by the library as any other
 * picture, into a file in memory.
 */
#include "cli/report.h"

#include <errno.h>
#include <math.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

/* RFC 4648, section 4. */
static void base64(FILE *f, const unsigned char *p, size_t n) {
    static const char digit[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    char line[4096];
    size_t used = 0;
    for (size_t i = 0; i < n; i += 3) {
        const uint32_t v = (uint32_t)p[i] << 16 | (i + 1 < n ? (uint32_t)p[i + 1] << 8 : 0) | (i + 2 < n ? p[i + 2] : 0u);
        line[used++] = digit[v >> 18];
        line[used++] = digit[v >> 12 & 63];
        line[used++] = i + 1 < n ? digit[v >> 6 & 63] : '=';
        line[used++] = i + 2 < n ? digit[v & 63] : '=';
        if (used == sizeof line) {
            fwrite(line, 1, used, f);
            used = 0;
        }
    }
    fwrite(line, 1, used, f);
}

/* The picture as the bytes of a file, handed to `f`. */
static brace_status encode(FILE *f, const brace_image *image, const brace_image_write_params *params,
                           const brace_job *job, brace_error *error) {
    const int fd = memfd_create("brace-report", MFD_CLOEXEC);
    if (fd < 0) {
        return core_fail(error, BRACE_ERROR_IO, "the report: cannot make a file in memory: %s", strerror(errno));
    }
    char path[64];
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    brace_status status = brace_image_write(image, path, params, job, error);
    struct stat info;
    if (status == BRACE_OK && fstat(fd, &info) != 0) {
        status = core_fail(error, BRACE_ERROR_IO, "the report: cannot read a file in memory: %s", strerror(errno));
    }
    if (status == BRACE_OK) {
        const size_t size = (size_t)info.st_size;
        void *data = mmap(NULL, size, PROT_READ, MAP_PRIVATE, fd, 0);
        if (data == MAP_FAILED) {
            status = core_fail_memory(error, size, "a picture of the report");
        } else {
            base64(f, data, size);
            munmap(data, size);
        }
    }
    close(fd);
    return status;
}

brace_status report_picture(const report_page *page, const brace_image *image, uint32_t side, report_coding coding,
                            const char *attributes, brace_error *error) {
    static const brace_image_write_params codings[] = {
        [REPORT_PHOTO] = {.format = BRACE_PICTURE_JPEG, .bits = 8, .quality = 90}, /* 4:4:4: stripes have colours */
        [REPORT_THUMBNAIL] = {.format = BRACE_PICTURE_JPEG, .bits = 8, .quality = 80},
        [REPORT_PLOT] = {.format = BRACE_PICTURE_PNG, .bits = 8, .compression = 9},
    };
    const uint32_t longest = image->width > image->height ? image->width : image->height;
    const double scale = longest > side ? (double)side / longest : 1;
    brace_image *small = NULL;
    brace_status status = BRACE_OK;
    if (scale < 1) {
        status = brace_image_resize(&small, image, (uint32_t)fmax(1, round(image->width * scale)),
                                    (uint32_t)fmax(1, round(image->height * scale)), error);
        image = small;
    }
    if (status == BRACE_OK) {
        fprintf(page->f, "<img width=\"%u\" height=\"%u\" %s src=\"data:image/%s;base64,", image->width, image->height,
                attributes, coding == REPORT_PLOT ? "png" : "jpeg");
        status = encode(page->f, image, &codings[coding], page->job, error);
        fputs("\">\n", page->f);
    }
    brace_image_destroy(small);
    return status;
}
