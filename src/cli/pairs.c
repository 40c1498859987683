/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pairs.c: matches the files of two folders by name.
 */
#include "cli/pairs.h"

#include <dirent.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

static bool no_memory(const char *command) {
    cli_error(command, "out of memory");
    return false;
}

static bool is_picture(const char *name) {
    static const char *const extensions[] = {"png", "tif", "tiff", "jpg", "jpeg", "webp", NULL};
    const char *dot = strrchr(name, '.');
    if (dot == NULL || name[0] == '.') {
        return false;
    }
    for (const char *const *e = extensions; *e != NULL; e++) {
        if (strcasecmp(dot + 1, *e) == 0) {
            return true;
        }
    }
    return cli_is_raw_name(name);
}

/* Length of a file's name without its extension. */
static size_t stem(const char *name) {
    const char *dot = strrchr(name, '.');
    return dot != NULL && dot != name ? (size_t)(dot - name) : strlen(name);
}

static int by_stem(const void *a, const void *b) {
    const char *x = *(char *const *)a, *y = *(char *const *)b;
    size_t n = stem(x), m = stem(y);
    int order = strncmp(x, y, n < m ? n : m);
    return order != 0 ? order : (n > m) - (n < m);
}

static bool append(cli_paths *list, char *item) {
    char **grown = item != NULL ? realloc(list->items, (list->count + 1) * sizeof *grown) : NULL;
    if (grown == NULL) {
        free(item);
        return false;
    }
    list->items = grown;
    list->items[list->count++] = item;
    return true;
}

static char *join(const char *folder, const char *name) {
    char *path = NULL;
    size_t n = strlen(folder);
    return asprintf(&path, "%s%s%s", folder, n > 0 && folder[n - 1] == '/' ? "" : "/", name) < 0 ? NULL : path;
}

/* Names of the pictures in a folder, sorted; no two of the same stem. */
static bool list_folder(cli_paths *out, const char *folder, const char *command) {
    DIR *dir = opendir(folder);
    if (dir == NULL) {
        cli_error(command, "%s: can't look into this folder: %s", folder, strerror(errno));
        return false;
    }
    bool good = true;
    for (struct dirent *entry; good && (entry = readdir(dir)) != NULL;) {
        if (is_picture(entry->d_name)) {
            good = append(out, strdup(entry->d_name)) || no_memory(command);
        }
    }
    closedir(dir);
    if (good && out->count > 1) {
        qsort(out->items, out->count, sizeof *out->items, by_stem);
    }
    for (size_t i = 1; good && i < out->count; i++) {
        if (by_stem(&out->items[i - 1], &out->items[i]) == 0) {
            cli_error(command, "%s: which one is it, %s or %s?", folder, out->items[i - 1], out->items[i]);
            good = false;
        }
    }
    return good;
}

static bool add_pair(cli_pairs *out, const char *name, char *pred, char *gt) {
    cli_pair *grown = realloc(out->items, (out->count + 1) * sizeof *grown);
    if (grown != NULL) {
        out->items = grown;
    }
    char *copy = strndup(name, stem(name));
    if (grown == NULL || copy == NULL || pred == NULL || gt == NULL) {
        free(copy);
        free(pred);
        free(gt);
        return false;
    }
    out->items[out->count++] = (cli_pair){copy, pred, gt};
    return true;
}

static bool match_folders(cli_pairs *out, const char *pred, const char *gt, const char *command) {
    cli_paths a = {0}, b = {0};
    bool good = list_folder(&a, pred, command) && list_folder(&b, gt, command);
    bool memory = true;
    for (size_t i = 0, j = 0; good && memory && (i < a.count || j < b.count);) {
        int order = i == a.count ? 1 : j == b.count ? -1 : by_stem(&a.items[i], &b.items[j]);
        if (order == 0) {
            memory = add_pair(out, a.items[i], join(pred, a.items[i]), join(gt, b.items[j]));
        } else {
            memory = append(&out->unmatched, order < 0 ? join(pred, a.items[i]) : join(gt, b.items[j]));
        }
        i += order <= 0;
        j += order >= 0;
    }
    cli_paths_free(&a);
    cli_paths_free(&b);
    if (!memory) {
        return no_memory(command);
    }
    if (good && out->count == 0) {
        cli_error(command, "no picture in %s has the name of one in %s", pred, gt);
        return false;
    }
    return good;
}

bool cli_pairs_find(cli_pairs *out, const char *pred, const char *gt, const char *command) {
    struct stat a, b;
    if (stat(pred, &a) != 0 || stat(gt, &b) != 0) {
        const char *missing = stat(pred, &a) != 0 ? pred : gt;
        cli_error(command, "%s: %s", missing[0] != '\0' ? missing : "''", strerror(errno));
        return false;
    }
    if (S_ISDIR(a.st_mode) != S_ISDIR(b.st_mode)) {
        cli_error(command, "%s is a folder, %s is not: two files are compared, or the files of two folders",
                  S_ISDIR(a.st_mode) ? pred : gt, S_ISDIR(a.st_mode) ? gt : pred);
        return false;
    }
    if (S_ISDIR(a.st_mode)) {
        return match_folders(out, pred, gt, command);
    }
    return add_pair(out, cli_basename(pred), strdup(pred), strdup(gt)) || no_memory(command);
}

void cli_pairs_free(cli_pairs *pairs) {
    for (size_t i = 0; i < pairs->count; i++) {
        free(pairs->items[i].name);
        free(pairs->items[i].pred);
        free(pairs->items[i].gt);
    }
    free(pairs->items);
    cli_paths_free(&pairs->unmatched);
    pairs->items = NULL;
    pairs->count = 0;
}

char *cli_pairs_find_in(const char *folder, const char *name, const char *command) {
    struct stat info;
    char *path = join(folder, name);
    if (path != NULL && stat(path, &info) == 0 && S_ISDIR(info.st_mode)) {
        return path;
    }
    free(path);
    path = NULL;
    cli_paths files = {0};
    bool good = list_folder(&files, folder, command), found = false;
    for (size_t i = 0; good && i < files.count; i++) {
        if (stem(files.items[i]) == strlen(name) && strncmp(files.items[i], name, strlen(name)) == 0) {
            path = join(folder, files.items[i]);
            found = true;
        }
    }
    cli_paths_free(&files);
    if (good && !found) {
        cli_error(command, "%s: there is no folder '%s' of frames in it, nor a RAW file of this name", folder, name);
    } else if (good && path == NULL) {
        no_memory(command);
    }
    return path;
}
