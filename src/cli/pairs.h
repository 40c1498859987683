/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pairs.h: which picture is compared with which: two files, or the files of two
 * folders that have the same name but for the extension.
 */
#ifndef CLI_PAIRS_H
#define CLI_PAIRS_H

#include "cli/cli.h"

typedef struct cli_pair {
    char *name;      /* without folder and extension, of `pred` */
    char *pred, *gt; /* paths */
} cli_pair;

typedef struct cli_pairs {
    cli_pair *items;
    size_t count;
    cli_paths unmatched; /* files of either folder that have no partner */
} cli_pairs;

/* False after an error, which was said. */
bool cli_pairs_find(cli_pairs *out, const char *pred, const char *gt, const char *command);
void cli_pairs_free(cli_pairs *pairs);

/* What belongs to `name` in a folder: a subfolder of this name, or a file of this name but for the extension; NULL with
 * the error said. Freed with free. */
char *cli_pairs_find_in(const char *folder, const char *name, const char *command);

#endif
