/* SPDX-License-Identifier: Apache-2.0 */
/*
 * data_path.c: finds the presets and weights that come with the program. Files of the
 * program's data are looked for under $BRACE_DATA, where they were installed,
 * and (for a program that runs from its build folder) in the source tree.
 */
#include <dirent.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "sim/data_folders.h" /* made by meson */
#include "sim/data_path.h"

/* The i-th place to look; NULL after the last. With $BRACE_DATA set, only there. */
static const char *place(int i) {
    const char *set = getenv("BRACE_DATA");
    if (set != NULL && *set != '\0')
        return i == 0 ? set : NULL;
    return i == 0 ? BRACE_INSTALLED_DATA : i == 1 ? BRACE_SOURCE_DATA : NULL;
}

static bool is_kind(const char *path, mode_t kind) {
    struct stat st;
    return stat(path, &st) == 0 && (st.st_mode & S_IFMT) == kind;
}

brace_status sim_data_folder(char *path, const char *kind, brace_error *error) {
    const char *folder;
    for (int i = 0; (folder = place(i)) != NULL; i++) {
        int n = snprintf(path, PATH_MAX, "%s/%s", folder, kind);
        if (n > 0 && n < PATH_MAX && is_kind(path, S_IFDIR))
            return BRACE_OK;
    }
    return core_fail(error, BRACE_ERROR_IO, "%s/%s: the program's data is not there; set BRACE_DATA to its folder",
                     place(0), kind);
}

static bool model_in(char *path, const char *folder, const char *below, const char *name) {
    const int n = snprintf(path, PATH_MAX, "%s%s/%s.safetensors", folder, below, name);
    return n > 0 && n < PATH_MAX && is_kind(path, S_IFREG);
}

bool sim_data_model(char *path, const char *name) {
    const char *set = getenv("BRACE_MODELS"), *data = getenv("BRACE_DATA");
    if (set != NULL && *set != '\0')
        return model_in(path, set, "", name);
    return (data != NULL && *data != '\0' && model_in(path, data, "/models", name)) ||
           model_in(path, BRACE_INSTALLED_DATA, "/models", name) || model_in(path, BRACE_SOURCE_MODELS, "", name);
}

static int by_name(const void *a, const void *b) {
    return strcmp(*(char *const *)a, *(char *const *)b);
}

json_t *sim_data_names(const char *kind) {
    json_t *list = json_array();
    char folder[PATH_MAX];
    DIR *dir = list != NULL && sim_data_folder(folder, kind, NULL) == BRACE_OK ? opendir(folder) : NULL;
    if (dir == NULL)
        return list;
    char *names[512];
    size_t count = 0;
    const struct dirent *entry;
    while (count < sizeof names / sizeof *names && (entry = readdir(dir)) != NULL) {
        size_t n = strlen(entry->d_name);
        if (n <= 5 || entry->d_name[0] == '.' || strcmp(entry->d_name + n - 5, ".json") != 0)
            continue;
        names[count] = core_strdup(entry->d_name);
        if (names[count] == NULL)
            break;
        names[count++][n - 5] = '\0';
    }
    closedir(dir);
    qsort(names, count, sizeof *names, by_name);
    for (size_t i = 0; i < count; i++) {
        json_array_append_new(list, json_string(names[i]));
        core_free(names[i]);
    }
    return list;
}

brace_status sim_data_path(char *path, const char *kind, const char *name_or_path, brace_error *error) {
    if (name_or_path == NULL || *name_or_path == '\0')
        return core_fail(error, BRACE_ERROR_ARGUMENT, "the name of a preset (%s) is empty", kind);
    if (strpbrk(name_or_path, "/.") != NULL) {
        if (snprintf(path, PATH_MAX, "%s", name_or_path) >= PATH_MAX)
            return core_fail(error, BRACE_ERROR_IO, "%.60s...: the name is too long", name_or_path);
        return BRACE_OK;
    }
    char folder[PATH_MAX];
    brace_status status = sim_data_folder(folder, kind, error);
    if (status != BRACE_OK)
        return status;
    int n = snprintf(path, PATH_MAX, "%s/%s.json", folder, name_or_path);
    if (n > 0 && n < PATH_MAX && is_kind(path, S_IFREG))
        return BRACE_OK;
    char text[700];
    size_t used = 0;
    text[0] = '\0';
    json_t *names = sim_data_names(kind);
    for (size_t i = 0; i < json_array_size(names); i++) {
        const char *name = json_string_value(json_array_get(names, i));
        if (used + strlen(name) + 3 < sizeof text)
            used += (size_t)snprintf(text + used, sizeof text - used, "%s%s", used > 0 ? ", " : "", name);
    }
    json_decref(names);
    return core_fail(error, BRACE_ERROR_IO, "%.100s: there is no such preset among the %s; there are %s", name_or_path,
                     kind, text);
}
