/* SPDX-License-Identifier: Apache-2.0 */
/*
 * json_check.h: JSON files read with types and ranges checked.
 *
 * The first thing that is wrong is remembered with file, line and path of the
 * key ("oled.json:7: pulses: 0 is out of range 1 to 32"); from then on every
 * reader returns its fallback. So a whole file is read without a test after
 * each value, and json_check_status tells at the end.
 */
#ifndef SIM_JSON_CHECK_H
#define SIM_JSON_CHECK_H

#include <jansson.h>

#include "core/core.h"

typedef struct json_check json_check;

/* A value inside the file. Parents must outlive it (they lie on the readers' stack). */
typedef struct json_at {
    json_check *doc;
    json_t *value;                /* borrowed; NULL: not there */
    const struct json_at *parent; /* NULL: the file's outermost value */
    const char *key;              /* in an object */
    size_t index;                 /* in an array, when key is NULL */
} json_at;

#define JSON_CHECK_LIMIT ((size_t)4 << 20) /* bytes of a file */

/* Reads text that must hold one JSON object. The document must be destroyed. */
brace_status json_check_load(json_check **out, const char *path, brace_error *error);
brace_status json_check_parse(json_check **out, const char *text, const char *name, brace_error *error);
void json_check_destroy(json_check *doc); /* NULL is allowed */
json_at json_check_root(json_check *doc);

/* BRACE_OK, or the first thing that was wrong. */
brace_status json_check_status(const json_check *doc, brace_error *error);

/* Remembers an error at `key` of an object (NULL: at the value itself). */
void json_check_fail(const json_at *at, const char *key, const char *format, ...) __attribute__((format(printf, 3, 4)));

/* Refuses keys that are not among `keys` (which ends with NULL). */
void json_check_only(const json_at *object, const char *const *keys);

/* The reader of a required value takes JSON_CHECK_REQUIRED as fallback. */
#define JSON_CHECK_REQUIRED (-1.7e308)
double json_check_number(const json_at *object, const char *key, double low, double high, double fallback);
#define JSON_CHECK_REQUIRED_INTEGER INT64_MIN
int64_t json_check_integer(const json_at *object, const char *key, int64_t low, int64_t high, int64_t fallback);
bool json_check_bool(const json_at *object, const char *key, bool fallback);
/* Borrowed; with fallback NULL the key is required and "" is returned where it is wrong. */
const char *json_check_string(const json_at *object, const char *key, size_t longest, const char *fallback);
/* Index into `choices` (which ends with NULL); fallback -1: required. */
int json_check_choice(const json_at *object, const char *key, const char *const *choices, int fallback);
/* Numbers of a list into out[]; the list may be absent if `required` is false: then 0 is
 * returned and out[] stays as it was. */
size_t json_check_numbers(const json_at *object, const char *key, double *out, size_t least, size_t most, double low,
                          double high, bool required);
/* A value of any type, an object or a list at `key`; false when it is absent or wrong. */
bool json_check_value(const json_at *object, const char *key, json_at *out);
bool json_check_object(const json_at *object, const char *key, json_at *out);
bool json_check_array(const json_at *object, const char *key, json_at *out);
/* An element of a list. */
bool json_check_element(const json_at *array, size_t index, json_at *out);

#endif
