/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tiff_handle.c: libtiff on memory and streams, with messages kept by handle
 * (libtiff's global handlers would be shared with the program around us).
 */
#include "image/tiff_handle.h"

#include <stdarg.h>
#include <string.h>

#include "core/core.h"

static int on_error(TIFF *tiff, void *user, const char *module, const char *format, va_list args)
    __attribute__((format(printf, 4, 0)));

static int on_error(TIFF *tiff, void *user, const char *module, const char *format, va_list args) {
    (void)tiff;
    (void)module;
    image_tiff *handle = user;
    if (handle->message[0] == '\0') {
        char *text = handle->message;
        vsnprintf(text, sizeof handle->message, format, args);
        size_t n = strlen(text);
        if (n > 0 && text[n - 1] == '.') {
            text[n - 1] = '\0';
        }
    }
    return 1; /* handled: the global handler is not called */
}

static int on_warning(TIFF *tiff, void *user, const char *module, const char *format, va_list args) {
    (void)tiff;
    (void)user;
    (void)module;
    (void)format;
    (void)args;
    return 1;
}

static tmsize_t memory_read(thandle_t user, void *out, tmsize_t size) {
    image_tiff *handle = user;
    size_t n = handle->at < handle->size ? handle->size - handle->at : 0;
    n = (size_t)size < n ? (size_t)size : n;
    memcpy(out, handle->data + handle->at, n);
    handle->at += n;
    return (tmsize_t)n;
}

static tmsize_t memory_write(thandle_t user, void *data, tmsize_t size) {
    (void)user;
    (void)data;
    (void)size;
    return -1;
}

static toff_t memory_seek(thandle_t user, toff_t offset, int whence) {
    image_tiff *handle = user;
    toff_t base = whence == SEEK_CUR ? handle->at : whence == SEEK_END ? handle->size : 0;
    toff_t to = base + offset; /* libtiff hands negative offsets as wrapped ones */
    handle->at = to > handle->size ? handle->size : (size_t)to;
    return to > handle->size ? (toff_t)-1 : to;
}

static int keep_open(thandle_t user) {
    (void)user;
    return 0;
}

static toff_t memory_size(thandle_t user) {
    return ((image_tiff *)user)->size;
}

static int memory_map(thandle_t user, void **base, toff_t *size) {
    image_tiff *handle = user;
    /* libtiff only reads a mapping of a file opened with "r". */
    memcpy(base, &handle->data, sizeof *base);
    *size = handle->size;
    return 1;
}

static void memory_unmap(thandle_t user, void *base, toff_t size) {
    (void)user;
    (void)base;
    (void)size;
}

static tmsize_t stream_read(thandle_t user, void *out, tmsize_t size) {
    image_tiff *handle = user;
    return (tmsize_t)fread(out, 1, (size_t)size, handle->stream);
}

static tmsize_t stream_write(thandle_t user, void *data, tmsize_t size) {
    image_tiff *handle = user;
    return (tmsize_t)fwrite(data, 1, (size_t)size, handle->stream);
}

static toff_t stream_seek(thandle_t user, toff_t offset, int whence) {
    image_tiff *handle = user;
    return fseeko(handle->stream, (off_t)offset, whence) == 0 ? (toff_t)ftello(handle->stream) : (toff_t)-1;
}

static toff_t stream_size(thandle_t user) {
    image_tiff *handle = user;
    off_t at = ftello(handle->stream);
    if (at < 0 || fseeko(handle->stream, 0, SEEK_END) != 0) {
        return 0;
    }
    off_t size = ftello(handle->stream);
    fseeko(handle->stream, at, SEEK_SET);
    return size < 0 ? 0 : (toff_t)size;
}

static brace_status open_handle(image_tiff *handle, const char *mode, TIFFReadWriteProc read, TIFFReadWriteProc write,
                                TIFFSeekProc seek, TIFFSizeProc size, TIFFMapFileProc map, TIFFUnmapFileProc unmap,
                                brace_error *error) {
    handle->message[0] = '\0';
    TIFFOpenOptions *options = TIFFOpenOptionsAlloc();
    if (options == NULL) {
        return core_fail_memory(error, 64, "a TIFF file");
    }
    TIFFOpenOptionsSetErrorHandlerExtR(options, on_error, handle);
    TIFFOpenOptionsSetWarningHandlerExtR(options, on_warning, handle);
    TIFFOpenOptionsSetMaxSingleMemAlloc(options, (tmsize_t)1 << 31);
    handle->tiff =
        TIFFClientOpenExt(handle->name, mode, handle, read, write, seek, keep_open, size, map, unmap, options);
    TIFFOpenOptionsFree(options);
    if (handle->tiff == NULL) {
        return core_fail(error, mode[0] == 'r' ? BRACE_ERROR_FORMAT : BRACE_ERROR_IO, "%s: cannot %s TIFF: %s",
                         handle->name, mode[0] == 'r' ? "read the" : "write a",
                         handle->message[0] != '\0' ? handle->message : "libtiff gave no reason");
    }
    return BRACE_OK;
}

brace_status image_tiff_open_memory(image_tiff *handle, brace_error *error) {
    handle->at = 0;
    return open_handle(handle, "r", memory_read, memory_write, memory_seek, memory_size, memory_map, memory_unmap,
                       error);
}

brace_status image_tiff_open_stream(image_tiff *handle, int big, brace_error *error) {
    return open_handle(handle, big ? "w8" : "w", stream_read, stream_write, stream_seek, stream_size, NULL, NULL,
                       error);
}
