/* SPDX-License-Identifier: Apache-2.0 */
/*
 * json_check.c: JSON with checked types and ranges, and errors that name file,
 * line and key. The parser (jansson) keeps no lines, so the line of a key is
 * found when it is needed: by walking the text, known to be well-formed, along
 * the key's path.
 */
#include <limits.h>
#include <math.h>
#include <string.h>

#include "sim/json_check.h"

struct json_check {
    char *name, *text;
    json_t *root;
    bool failed;
    brace_error error;
};

/* ---- where a value stands in the text ---- */

static const char *skip_space(const char *p) {
    return p + strspn(p, " \t\r\n");
}

/* Past a string whose opening quote is at p. */
static const char *skip_string(const char *p) {
    for (p++; *p != '\0' && *p != '"'; p++)
        if (*p == '\\' && p[1] != '\0')
            p++;
    return *p == '"' ? p + 1 : p;
}

/* Past a value of any kind. */
static const char *skip_value(const char *p) {
    size_t depth = 0;
    p = skip_space(p);
    do {
        if (*p == '"') {
            p = skip_string(p);
        } else if (*p == '{' || *p == '[') {
            depth++;
            p++;
        } else if (*p == '}' || *p == ']') {
            depth--;
            p++;
        } else if (*p == ',' || *p == ':') {
            p++;
        } else {
            p += strcspn(p, " \t\r\n,:{}[]\"");
        }
        if (depth > 0)
            p = skip_space(p);
    } while (depth > 0 && *p != '\0');
    return p;
}

/* True where the string at p (opening quote) spells `key`, escapes considered. */
static bool spells(const char *p, const char *key) {
    const char *end = skip_string(p);
    json_t *s = json_loadb(p, (size_t)(end - p), JSON_DECODE_ANY, NULL);
    bool same = s != NULL && json_is_string(s) && strcmp(json_string_value(s), key) == 0;
    json_decref(s);
    return same;
}

/* From the start of an object to the given key's value; *line_of is the key itself. */
static const char *find_key(const char *p, const char *key, const char **line_of) {
    p = skip_space(p);
    if (*p != '{')
        return NULL;
    for (p = skip_space(p + 1); *p == '"'; p = skip_space(p)) {
        const char *name = p;
        p = skip_space(skip_string(p));
        p += *p == ':';
        if (spells(name, key)) {
            *line_of = name;
            return p;
        }
        p = skip_space(skip_value(p));
        p += *p == ',';
    }
    return NULL;
}

static const char *find_element(const char *p, size_t index, const char **line_of) {
    p = skip_space(p);
    if (*p != '[')
        return NULL;
    p = skip_space(p + 1);
    for (; index > 0 && *p != '\0'; index--) {
        p = skip_space(skip_value(p));
        p += *p == ',';
    }
    p = skip_space(p);
    *line_of = p;
    return p;
}

/* The text of a value; *line_of the place that a message should name. */
static const char *find(const json_at *at, const char **line_of) {
    if (at->parent == NULL) {
        *line_of = skip_space(at->doc->text);
        return *line_of;
    }
    const char *p = find(at->parent, line_of);
    if (p == NULL)
        return NULL;
    return at->key != NULL ? find_key(p, at->key, line_of) : find_element(p, at->index, line_of);
}

static size_t line_number(const char *text, const char *at) {
    size_t line = 1;
    for (const char *p = text; p < at; p++)
        line += *p == '\n';
    return line;
}

static void path_of(const json_at *at, char *out, size_t size) {
    if (at->parent == NULL) {
        out[0] = '\0';
        return;
    }
    path_of(at->parent, out, size);
    size_t n = strlen(out);
    if (at->key != NULL)
        snprintf(out + n, size - n, "%s%s", n > 0 ? "." : "", at->key);
    else
        snprintf(out + n, size - n, "[%zu]", at->index);
}

void json_check_fail(const json_at *at, const char *key, const char *format, ...) {
    json_check *doc = at->doc;
    if (doc->failed)
        return;
    doc->failed = true;
    json_at child = {doc, NULL, at, key, 0};
    const json_at *place = at;
    /* A key that is not there is reported at the object that lacks it. */
    if (key != NULL && json_object_get(at->value, key) != NULL)
        place = &child;
    const char *line_of = doc->text;
    find(place, &line_of);
    char path[256], message[512];
    path_of(key != NULL ? &child : at, path, sizeof path);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    core_fail(&doc->error, BRACE_ERROR_FORMAT, "%s:%zu: %s%s%s", doc->name, line_number(doc->text, line_of), path,
              path[0] != '\0' ? ": " : "", message);
}

/* ---- documents ---- */

void json_check_destroy(json_check *doc) {
    if (doc == NULL)
        return;
    json_decref(doc->root);
    core_free(doc->name);
    core_free(doc->text);
    core_free(doc);
}

static brace_status parse(json_check **out, const char *text, size_t length, const char *name, brace_error *error) {
    *out = NULL;
    if (length >= 3 && memcmp(text, "\xef\xbb\xbf", 3) == 0) /* editors mark UTF-8 so; RFC 8259 lets readers skip it */
        text += 3, length -= 3;
    json_check *doc = core_calloc(1, sizeof *doc);
    if (doc == NULL)
        return core_fail_memory(error, sizeof *doc, name);
    doc->name = core_strdup(name);
    doc->text = core_alloc(length + 1, 1);
    if (doc->name == NULL || doc->text == NULL) {
        json_check_destroy(doc);
        return core_fail_memory(error, length, name);
    }
    memcpy(doc->text, text, length);
    doc->text[length] = '\0';
    json_error_t e;
    doc->root = json_loadb(doc->text, length, JSON_REJECT_DUPLICATES, &e);
    if (doc->root == NULL) {
        json_check_destroy(doc);
        return core_fail(error, BRACE_ERROR_FORMAT, "%s:%d: not valid JSON: %s", name, e.line > 0 ? e.line : 1, e.text);
    }
    if (!json_is_object(doc->root)) {
        json_check_destroy(doc);
        return core_fail(error, BRACE_ERROR_FORMAT, "%s:1: an object { ... } is expected", name);
    }
    *out = doc;
    return BRACE_OK;
}

brace_status json_check_parse(json_check **out, const char *text, const char *name, brace_error *error) {
    return parse(out, text, strlen(text), name, error);
}

brace_status json_check_load(json_check **out, const char *path, brace_error *error) {
    *out = NULL;
    void *data;
    size_t size;
    brace_status status = core_file_load(&data, &size, path, JSON_CHECK_LIMIT, error);
    if (status != BRACE_OK)
        return status;
    if (size > 0 && memchr(data, '\0', size) != NULL)
        status = core_fail(error, BRACE_ERROR_FORMAT, "%s:1: not valid JSON: it contains zero bytes", path);
    else
        status = parse(out, data, size, path, error);
    core_free(data);
    return status;
}

json_at json_check_root(json_check *doc) {
    return (json_at){doc, doc->root, NULL, NULL, 0};
}

brace_status json_check_status(const json_check *doc, brace_error *error) {
    if (!doc->failed)
        return BRACE_OK;
    return core_fail(error, doc->error.status, "%s", doc->error.message);
}

/* ---- values ---- */

static const char *type_name(const json_t *v) {
    switch (json_typeof(v)) {
    case JSON_OBJECT:
        return "an object";
    case JSON_ARRAY:
        return "a list";
    case JSON_STRING:
        return "a string";
    case JSON_INTEGER:
    case JSON_REAL:
        return "a number";
    case JSON_TRUE:
    case JSON_FALSE:
        return "true or false";
    default:
        return "null";
    }
}

static json_t *get(const json_at *object, const char *key, bool required) {
    if (object->doc->failed)
        return NULL;
    json_t *v = json_object_get(object->value, key);
    if (v == NULL && required)
        json_check_fail(object, key, "is missing");
    return v;
}

void json_check_only(const json_at *object, const char *const *keys) {
    if (object->doc->failed)
        return;
    const char *key;
    json_t *value;
    json_object_foreach(object->value, key, value) {
        bool known = false;
        for (const char *const *k = keys; *k != NULL && !known; k++)
            known = strcmp(*k, key) == 0;
        if (known)
            continue;
        char list[400];
        size_t n = 0;
        list[0] = '\0';
        for (const char *const *k = keys; *k != NULL && n + strlen(*k) + 3 < sizeof list; k++)
            n += (size_t)snprintf(list + n, sizeof list - n, "%s%s", n > 0 ? ", " : "", *k);
        json_check_fail(object, key, "is not known here; known are %s", list);
        return;
    }
}

/* A finite number in range, or an error. */
static bool check_number(const json_at *object, const char *key, const json_t *v, double low, double high,
                         double *out) {
    if (!json_is_number(v)) {
        json_check_fail(object, key, "a number is expected, not %s", type_name(v));
        return false;
    }
    double x = json_number_value(v);
    if (!(x >= low && x <= high)) {
        json_check_fail(object, key, "%.10g is out of range %.10g to %.10g", x, low, high);
        return false;
    }
    *out = x;
    return true;
}

double json_check_number(const json_at *object, const char *key, double low, double high, double fallback) {
    const json_t *v = get(object, key, fallback <= JSON_CHECK_REQUIRED);
    double x;
    if (v != NULL && check_number(object, key, v, low, high, &x))
        return x;
    return fallback <= JSON_CHECK_REQUIRED ? low : fallback;
}

int64_t json_check_integer(const json_at *object, const char *key, int64_t low, int64_t high, int64_t fallback) {
    const json_t *v = get(object, key, fallback == JSON_CHECK_REQUIRED_INTEGER);
    int64_t otherwise = fallback == JSON_CHECK_REQUIRED_INTEGER ? low : fallback;
    if (v == NULL)
        return otherwise;
    if (!json_is_integer(v)) {
        json_check_fail(object, key, "a whole number is expected%s%s", json_is_number(v) ? "" : ", not ",
                        json_is_number(v) ? "" : type_name(v));
        return otherwise;
    }
    int64_t x = json_integer_value(v);
    if (x < low || x > high) {
        json_check_fail(object, key, "%lld is out of range %lld to %lld", (long long)x, (long long)low,
                        (long long)high);
        return otherwise;
    }
    return x;
}

bool json_check_bool(const json_at *object, const char *key, bool fallback) {
    const json_t *v = get(object, key, false);
    if (v == NULL)
        return fallback;
    if (!json_is_boolean(v)) {
        json_check_fail(object, key, "true or false is expected, not %s", type_name(v));
        return fallback;
    }
    return json_is_true(v);
}

const char *json_check_string(const json_at *object, const char *key, size_t longest, const char *fallback) {
    const json_t *v = get(object, key, fallback == NULL);
    const char *otherwise = fallback != NULL ? fallback : "";
    if (v == NULL)
        return otherwise;
    if (!json_is_string(v)) {
        json_check_fail(object, key, "a string is expected, not %s", type_name(v));
        return otherwise;
    }
    if (json_string_length(v) > longest || strlen(json_string_value(v)) != json_string_length(v)) {
        json_check_fail(object, key, "the string is too long: %zu bytes, at most %zu", json_string_length(v), longest);
        return otherwise;
    }
    return json_string_value(v);
}

int json_check_choice(const json_at *object, const char *key, const char *const *choices, int fallback) {
    const json_t *v = get(object, key, fallback < 0);
    int otherwise = fallback < 0 ? 0 : fallback;
    if (v == NULL)
        return otherwise;
    char list[300];
    size_t n = 0;
    list[0] = '\0';
    for (int i = 0; choices[i] != NULL; i++) {
        if (json_is_string(v) && strcmp(choices[i], json_string_value(v)) == 0)
            return i;
        if (n + strlen(choices[i]) + 3 < sizeof list)
            n += (size_t)snprintf(list + n, sizeof list - n, "%s%s", n > 0 ? ", " : "", choices[i]);
    }
    if (json_is_string(v))
        json_check_fail(object, key, "\"%.40s\" is not one of %s", json_string_value(v), list);
    else
        json_check_fail(object, key, "one of %s is expected, not %s", list, type_name(v));
    return otherwise;
}

size_t json_check_numbers(const json_at *object, const char *key, double *out, size_t least, size_t most, double low,
                          double high, bool required) {
    json_at list = {object->doc, get(object, key, required), object, key, 0};
    if (list.value == NULL)
        return 0;
    if (!json_is_array(list.value)) {
        json_check_fail(object, key, "a list of numbers is expected, not %s", type_name(list.value));
        return 0;
    }
    size_t count = json_array_size(list.value);
    if (count < least || count > most) {
        if (least == most)
            json_check_fail(object, key, "%zu numbers are expected, not %zu", least, count);
        else
            json_check_fail(object, key, "%zu to %zu numbers are expected, not %zu", least, most, count);
        return 0;
    }
    for (size_t i = 0; i < count; i++) {
        json_at element = {object->doc, json_array_get(list.value, i), &list, NULL, i};
        double x;
        if (!check_number(&element, NULL, element.value, low, high, &x))
            return 0;
        out[i] = x;
    }
    return count;
}

bool json_check_value(const json_at *object, const char *key, json_at *out) {
    *out = (json_at){object->doc, get(object, key, false), object, key, 0};
    return out->value != NULL;
}

bool json_check_object(const json_at *object, const char *key, json_at *out) {
    if (!json_check_value(object, key, out))
        return false;
    if (json_is_object(out->value))
        return true;
    json_check_fail(object, key, "an object { ... } is expected, not %s", type_name(out->value));
    return false;
}

bool json_check_array(const json_at *object, const char *key, json_at *out) {
    if (!json_check_value(object, key, out))
        return false;
    if (json_is_array(out->value))
        return true;
    json_check_fail(object, key, "a list [ ... ] is expected, not %s", type_name(out->value));
    return false;
}

bool json_check_element(const json_at *array, size_t index, json_at *out) {
    *out = (json_at){array->doc, array->doc->failed ? NULL : json_array_get(array->value, index), array, NULL, index};
    return out->value != NULL;
}
