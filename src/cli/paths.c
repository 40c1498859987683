/* SPDX-License-Identifier: Apache-2.0 */
/*
 * paths.c: from the arguments to a list of RAW files, with every mistake in it
 * found before any work starts: a missing file, one given twice, a folder
 * without RAW files.
 */
#include "cli/cli.h"

#include <dirent.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

/* File name extensions of the RAW formats that LibRaw decodes. */
static const char *const raw_extensions[] = {
    "dng", "3fr", "arw", "bay", "cr2", "cr3", "crw", "dcr", "erf", "fff", "gpr", "iiq", "k25", "kdc", "mef", "mos",
    "mrw", "nef", "nrw", "orf", "pef", "ptx", "raf", "raw", "rw2", "rwl", "rwz", "sr2", "srf", "srw", "x3f", NULL};

const char *cli_basename(const char *path) {
    const char *slash = strrchr(path, '/');
    return slash != NULL ? slash + 1 : path;
}

bool cli_is_raw_name(const char *name) {
    const char *dot = strrchr(name, '.');
    if (dot == NULL || name[0] == '.') { /* ._frame.dng: what macOS leaves on memory cards */
        return false;
    }
    for (const char *const *e = raw_extensions; *e != NULL; e++) {
        if (strcasecmp(dot + 1, *e) == 0) {
            return true;
        }
    }
    return false;
}

char *cli_folder_of(const char *path) {
    size_t n = (size_t)(cli_basename(path) - path);
    return n > 0 ? strndup(path, n) : strdup(".");
}

/* The folder's device and inode, and the name in it: what identifies a file that does not exist yet. */
static bool folder_of(const char *path, struct stat *info) {
    char *folder = cli_folder_of(path);
    bool found = folder != NULL && stat(folder, info) == 0;
    free(folder);
    return found;
}

bool cli_same_file(const char *a, const char *b) {
    struct stat ia, ib;
    bool have_a = stat(a, &ia) == 0, have_b = stat(b, &ib) == 0;
    if (have_a && have_b) {
        return ia.st_dev == ib.st_dev && ia.st_ino == ib.st_ino;
    }
    if (have_a != have_b || strcmp(cli_basename(a), cli_basename(b)) != 0) {
        return false;
    }
    return strcmp(a, b) == 0 ||
           (folder_of(a, &ia) && folder_of(b, &ib) && ia.st_dev == ib.st_dev && ia.st_ino == ib.st_ino);
}

void cli_paths_free(cli_paths *paths) {
    for (size_t i = 0; i < paths->count; i++) {
        free(paths->items[i]);
    }
    free(paths->items);
    paths->items = NULL;
    paths->count = 0;
}

/* Takes `path` over. */
static bool add(cli_paths *out, char *path, const char *command) {
    char **grown = path != NULL ? realloc(out->items, (out->count + 1) * sizeof *grown) : NULL;
    if (grown == NULL) {
        free(path);
        cli_error(command, "out of memory");
        return false;
    }
    out->items = grown;
    out->items[out->count++] = path;
    return true;
}

static int by_name(const void *a, const void *b) {
    /* frame_2 before frame_10, as photographers number their files. */
    return strverscmp(*(char *const *)a, *(char *const *)b);
}

static bool is_in(const char *path, const cli_list *list) {
    for (size_t i = 0; list != NULL && i < list->count; i++) {
        if (cli_same_file(path, list->items[i])) {
            return true;
        }
    }
    return false;
}

static bool expand_folder(cli_paths *out, const char *folder, const cli_list *except, const char *command) {
    DIR *dir = opendir(folder);
    if (dir == NULL) {
        cli_error(command, "%s: can't look into this folder: %s", folder, strerror(errno));
        return false;
    }
    size_t before = out->count, length = strlen(folder);
    bool good = true;
    for (struct dirent *entry; good && (entry = readdir(dir)) != NULL;) {
        struct stat info;
        char *path = NULL;
        if (!cli_is_raw_name(entry->d_name)) {
            continue;
        }
        if (asprintf(&path, "%s%s%s", folder, length > 0 && folder[length - 1] == '/' ? "" : "/", entry->d_name) < 0) {
            path = NULL;
        }
        if (path != NULL && (stat(path, &info) != 0 || !S_ISREG(info.st_mode) || is_in(path, except))) {
            free(path);
            continue;
        }
        good = add(out, path, command);
    }
    closedir(dir);
    if (good && out->count == before) {
        cli_error(command, "%s: there are no RAW files in this folder (.dng, .cr3, .nef, .arw, ...)", folder);
        return false;
    }
    if (good) {
        qsort(out->items + before, out->count - before, sizeof *out->items, by_name);
    }
    return good;
}

bool cli_paths_expand(cli_paths *out, const cli_list *arguments, const cli_list *except, const char *command) {
    for (size_t i = 0; i < arguments->count; i++) {
        const char *path = arguments->items[i];
        struct stat info;
        if (stat(path, &info) != 0) {
            cli_error(command, "%s: %s", path[0] != '\0' ? path : "''", strerror(errno));
            return false;
        }
        if (S_ISDIR(info.st_mode) ? !expand_folder(out, path, except, command) : !add(out, strdup(path), command)) {
            return false;
        }
    }
    for (size_t i = 1; i < out->count; i++) {
        for (size_t j = 0; j < i; j++) {
            if (cli_same_file(out->items[i], out->items[j])) {
                if (strcmp(out->items[i], out->items[j]) == 0) {
                    cli_error(command, "%s is given twice", out->items[i]);
                } else {
                    cli_error(command, "%s and %s are the same file", out->items[j], out->items[i]);
                }
                return false;
            }
        }
    }
    return true;
}

/* What samples and sequences call their truths. */
static bool is_truth(const char *path) {
    const char *base = cli_basename(path);
    return strncmp(base, "gt.", 3) == 0 || strncmp(base, "gt_exact.", 9) == 0;
}

bool cli_paths_leave_truth(cli_paths *paths, size_t least, char *name, size_t size) {
    size_t kept = 0, left = 0;
    for (size_t i = 0; i < paths->count; i++) {
        left += is_truth(paths->items[i]);
    }
    if (left == 0 || paths->count - left < least) {
        return false;
    }
    for (size_t i = 0; i < paths->count; i++) {
        if (is_truth(paths->items[i])) {
            snprintf(name, size, "%s", cli_basename(paths->items[i]));
            free(paths->items[i]);
        } else {
            paths->items[kept++] = paths->items[i];
        }
    }
    paths->count = kept;
    return true;
}
