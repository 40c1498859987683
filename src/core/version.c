/* SPDX-License-Identifier: Apache-2.0 */
/*
 * version.c: the versions of BRACE and of the libraries it runs on: those that
 * are loaded now, which may be newer than those it was built with.
 */
#include "brace/version.h"

#include <pthread.h>
#include <stdio.h>
#include <string.h>

#include <jansson.h>
#include <jpeglib.h>
#include <libraw/libraw.h>
#include <png.h>
#include <tiffio.h>
#include <webp/encode.h>
#include <zlib.h>

/* jconfig.h gives the turbo version as a bare token (2.1.5). It has no run-time getter. */
#define TEXT_OF(x) #x
#define TEXT(x) TEXT_OF(x)
#ifdef LIBJPEG_TURBO_VERSION
#define JPEG_NAME "libjpeg-turbo " TEXT(LIBJPEG_TURBO_VERSION)
#else
#define JPEG_NAME "libjpeg " TEXT(JPEG_LIB_VERSION)
#endif

static char dependencies[512];
static pthread_once_t once = PTHREAD_ONCE_INIT;

const char *brace_version(void) {
    return BRACE_VERSION_STRING;
}

static void fill(void) {
    /* "LIBTIFF, Version 4.5.0\nCopyright ..." and "0.20.2-Release" */
    const char *tiff = TIFFGetVersion();
    const char *version = strstr(tiff, "Version ");
    tiff = version != NULL ? version + strlen("Version ") : tiff;
    const char *raw = libraw_version();
    int webp = WebPGetEncoderVersion();
    snprintf(dependencies, sizeof dependencies,
             "LibRaw %.*s, libtiff %.*s, libpng %s, " JPEG_NAME ", libwebp %d.%d.%d, zlib %s, jansson %s",
             (int)strcspn(raw, "-"), raw, (int)strcspn(tiff, "\n"), tiff, png_get_libpng_ver(NULL), webp >> 16 & 255,
             webp >> 8 & 255, webp & 255, zlibVersion(), jansson_version_str());
}

const char *brace_dependencies(void) {
    pthread_once(&once, fill);
    return dependencies;
}
