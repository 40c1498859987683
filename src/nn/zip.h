/* SPDX-License-Identifier: Apache-2.0 */
/*
 * zip.h: the directory of a zip archive in memory (APPNOTE.TXT 6.3, with Zip64).
 *
 * Thread safety: an open archive may be read from several threads.
 */
#ifndef NN_ZIP_H
#define NN_ZIP_H

#include "core/core.h"

typedef struct nn_zip_entry {
    const char *name; /* not terminated */
    size_t name_length;
    const unsigned char *data; /* as stored */
    size_t stored, size;       /* bytes in the archive and unpacked */
    bool deflated;
} nn_zip_entry;

typedef struct nn_zip nn_zip;

bool nn_zip_is(const void *data, size_t size); /* begins like one */
/* Reads and checks the directory; `name` begins error sentences. `data` must stay. Checksums are not verified. */
brace_status nn_zip_open(nn_zip **out, const void *data, size_t size, const char *name, brace_error *error);
void nn_zip_close(nn_zip *zip);                                                      /* NULL is allowed */
const nn_zip_entry *nn_zip_find(const nn_zip *zip, const char *name, size_t length); /* NULL: none */
/* The one entry whose last part is `name`; NULL: none, or several. */
const nn_zip_entry *nn_zip_find_last_part(const nn_zip *zip, const char *name);

/* An entry's bytes into out[entry->size]. */
brace_status nn_zip_unpack(void *out, const nn_zip_entry *entry, const char *name, brace_error *error);

#endif
