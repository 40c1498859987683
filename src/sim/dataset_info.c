/* SPDX-License-Identifier: Apache-2.0 */
/*
 * dataset_info.c: what a set holds, from its samples' meta.json: how many, of
 * which displays, screens, exposures. No pixel is read.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sim/dataset.h"

static void count_text(json_t *all, const char *group, const char *key) {
    json_t *object = json_object_get(all, group);
    if (object == NULL) {
        object = json_object();
        json_object_set_new(all, group, object);
    }
    json_int_t n = json_integer_value(json_object_get(object, key));
    json_object_set_new(object, key, json_integer(n + 1));
}

/* The category of a screen is what follows the number in the sample's name: 000012_web2. */
static const char *category(const char *name) {
    const char *slash = strrchr(name, '/'), *base = slash != NULL ? slash + 1 : name;
    const char *line = strchr(base, '_');
    return line != NULL && strspn(base, "0123456789") == (size_t)(line - base) ? line + 1 : "other";
}

static void split_of(char *out, size_t size, const char *name) {
    const char *slash = strchr(name, '/');
    snprintf(out, size, "%.*s", slash != NULL ? (int)(slash - name) : 7, slash != NULL ? name : "samples");
}

/* A number at "a.b" of an object; NAN if there is none. */
static double number_at(json_t *object, const char *path) {
    char copy[64];
    snprintf(copy, sizeof copy, "%s", path);
    char *rest = copy;
    for (char *key; (key = strsep(&rest, ".")) != NULL;) {
        object = json_object_get(object, key);
    }
    return json_is_number(object) ? json_number_value(object) : (double)NAN;
}

static double first_number(json_t *meta, const char *const *paths) {
    double value = NAN;
    for (; *paths != NULL && !isfinite(value); paths++) {
        value = number_at(meta, *paths);
    }
    return value;
}

static const char *first_text(json_t *meta, const char *const *keys) {
    for (; *keys != NULL; keys++) {
        json_t *value = json_object_get(meta, *keys);
        if (json_is_object(value)) {
            value = json_object_get(value, "name");
        }
        if (json_is_string(value)) {
            return json_string_value(value);
        }
    }
    return NULL;
}

static void count_sample(json_t *all, const char *name, json_t *meta) {
    char text[64];
    split_of(text, sizeof text, name);
    count_text(all, "splits", text);
    count_text(all, "categories", category(name));
    if (meta == NULL) {
        count_text(all, "meta", "missing");
        return;
    }
    count_text(all, "meta", "present");
    const char *family = first_text(meta, (const char *const[]){"family", "display_family", NULL});
    const char *display = first_text(meta, (const char *const[]){"display", NULL});
    const char *camera = first_text(meta, (const char *const[]){"camera", NULL});
    json_t *nested = json_object_get(json_object_get(meta, "display"), "family");
    if (family == NULL && json_is_string(nested)) {
        family = json_string_value(nested);
    }
    count_text(all, "families", family != NULL ? family : "unknown");
    count_text(all, "displays", display != NULL ? display : "unknown");
    count_text(all, "cameras", camera != NULL ? camera : "unknown");
    double time = first_number(meta, (const char *const[]){"reference_time", "scene.reference_time",
                                                           "reference.exposure_time", NULL});
    if (time > 0) {
        /* In stops, so that the histogram has the rows that photographers expect. */
        snprintf(text, sizeof text, "1/%.0f s", exp2(round(log2(1 / time))));
        count_text(all, "reference_times", text);
    }
    double iso = first_number(meta, (const char *const[]){"iso", "scene.iso", "reference.iso", NULL});
    if (iso > 0) {
        snprintf(text, sizeof text, "%.0f", 100 * exp2(round(log2(iso / 100))));
        count_text(all, "iso", text);
    }
}

brace_status dataset_info(json_t **out, const char *folder, const brace_job *job, brace_error *error) {
    *out = NULL;
    dataset_list list;
    brace_status status = dataset_list_read(&list, folder, error);
    if (status != BRACE_OK) {
        return status;
    }
    json_t *all = json_pack("{s:I}", "samples", (json_int_t)list.count);
    for (size_t i = 0; i < list.count && status == BRACE_OK; i++) {
        char *path = dataset_path(list.items[i].folder, "meta.json");
        json_t *meta = NULL;
        status = core_check_cancel(job, error);
        if (status == BRACE_OK) {
            status = path != NULL ? dataset_json_load(&meta, path, DATASET_META_LIMIT, error)
                                  : core_fail_memory(error, 256, "a name");
        }
        if (status == BRACE_OK) {
            count_sample(all, list.items[i].name, meta);
        }
        json_decref(meta);
        core_free(path);
    }
    dataset_list_free(&list);
    if (status != BRACE_OK) {
        json_decref(all);
        return status;
    }
    *out = all;
    return BRACE_OK;
}
