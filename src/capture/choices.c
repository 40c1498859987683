/* SPDX-License-Identifier: Apache-2.0 */
/* choices.c: see choices.h. */
#include "capture/choices.h"

#include <ctype.h>
#include <math.h>
#include <string.h>
#include <strings.h>

static const char *skip_spaces(const char *p) {
    while (*p == ' ' || *p == '\t') {
        p++;
    }
    return p;
}

static bool is_digit(char c) {
    return c >= '0' && c <= '9';
}

/* Digits, and perhaps a point or comma with digits after it. By hand: strtod reads "inf", "0x10" and what the locale
 * says. At most 12 digits on either side. */
static bool number(const char **text, double *value) {
    const char *p = *text;
    double whole = 0, part = 0, unit = 1;
    int digits = 0;
    if (!is_digit(*p)) {
        return false;
    }
    for (; is_digit(*p); p++) {
        whole = whole * 10 + (*p - '0');
        if (++digits > 12) {
            return false;
        }
    }
    if ((*p == '.' || *p == ',') && is_digit(p[1])) {
        digits = 0;
        for (p++; is_digit(*p); p++) {
            part = part * 10 + (*p - '0');
            unit *= 10;
            if (++digits > 12) {
                return false;
            }
        }
    }
    *value = whole + part / unit;
    *text = p;
    return true;
}

/* N, N/N or "N N/N". */
static bool ratio(const char **text, double *value) {
    double a, b, c;
    if (!number(text, &a)) {
        return false;
    }
    const char *p = skip_spaces(*text);
    if (*p == '/') {
        p = skip_spaces(p + 1);
        if (!number(&p, &b) || !(b > 0)) {
            return false;
        }
        *value = a / b;
        *text = p;
        return true;
    }
    *value = a;
    if (p > *text && number(&p, &b)) {
        p = skip_spaces(p);
        if (*p != '/') {
            return false;
        }
        p = skip_spaces(p + 1);
        if (!number(&p, &c) || !(c > 0)) {
            return false;
        }
        *value = a + b / c;
        *text = p;
    }
    return true;
}

bool capture_choice_exposure(const char *text, double *seconds) {
    static const struct {
        const char *name;
        double factor;
    } units[] = {{"", 1},   {"s", 1},  {"sec", 1}, {"second", 1}, {"seconds", 1},
                 {"\"", 1}, {"''", 1}, {"m", 60},  {"min", 60},   {"ms", 1e-3}};
    const char *p = skip_spaces(text);
    double value;
    if (!ratio(&p, &value)) {
        return false;
    }
    p = skip_spaces(p);
    const char *end = p + strlen(p);
    while (end > p && (end[-1] == ' ' || end[-1] == '\t')) {
        end--;
    }
    for (size_t i = 0; i < sizeof units / sizeof units[0]; i++) {
        if (strlen(units[i].name) == (size_t)(end - p) && strncasecmp(p, units[i].name, (size_t)(end - p)) == 0) {
            value *= units[i].factor;
            if (!(value >= 1e-6 && value <= 86400)) {
                return false;
            }
            *seconds = value;
            return true;
        }
    }
    return false;
}

/* A lone number after one of some prefixes. */
static bool prefixed(const char *text, const char *const *prefixes, double low, double high, double *out) {
    const char *p = skip_spaces(text);
    for (; *prefixes != NULL; prefixes++) {
        const size_t n = strlen(*prefixes);
        if (strncasecmp(p, *prefixes, n) == 0) {
            p = skip_spaces(p + n);
            break;
        }
    }
    double value;
    if (!number(&p, &value) || *skip_spaces(p) != '\0' || !(value >= low && value <= high)) {
        return false;
    }
    *out = value;
    return true;
}

bool capture_choice_iso(const char *text, double *iso) {
    return prefixed(text, (const char *const[]){"ISO", NULL}, 1, 1e7, iso);
}

bool capture_choice_aperture(const char *text, double *f_number) {
    return prefixed(text, (const char *const[]){"f/", "f", NULL}, 0.5, 128, f_number);
}

/* The suffixes of RAW files; those of them that are also what cameras call the format come first. */
static const char *const raw_names[] = {"raw", "nef", "nrw", "cr2", "cr3", "crw", "dng", "arw",
                                        "raf", "orf", "rw2", "pef", "srw", "rwl", "3fr", "iiq",
                                        "srf", "sr2", "dcr", "kdc", "erf", "mrw", "mos", "mef"};
enum { FORMAT_NAMES = 13 };

bool capture_name_is_raw(const char *name, char extension[8]) {
    const char *dot = strrchr(name, '.');
    extension[0] = '\0';
    if (dot == NULL || strlen(dot + 1) >= 8) {
        return false;
    }
    size_t n = 0;
    for (const char *p = dot + 1; *p != '\0'; p++) {
        if (!isalnum((unsigned char)*p)) {
            extension[0] = '\0';
            return false;
        }
        extension[n++] = (char)tolower((unsigned char)*p);
    }
    extension[n] = '\0';
    for (size_t i = 0; i < sizeof raw_names / sizeof raw_names[0]; i++) {
        if (strcmp(extension, raw_names[i]) == 0) {
            return true;
        }
    }
    return false;
}

int capture_choice_raw(const char *text) {
    static const char *const others[] = {"+",    "jpeg", "jpg",    "heif",  "heic",
                                         "tiff", "fine", "normal", "basic", "large"};
    static const char *const fewer[] = {"small", "medium", "raw 2", "raw2"};
    bool found = false, lossy = false, small = false;
    for (size_t i = 0; i < FORMAT_NAMES; i++) {
        for (const char *at = strcasestr(text, raw_names[i]); at != NULL; at = strcasestr(at + 1, raw_names[i])) {
            const bool first = at == text || !isalpha((unsigned char)at[-1]);
            const bool kind = !first && (at - 1 == text || !isalpha((unsigned char)at[-2]));
            const int letter = kind ? tolower((unsigned char)at[-1]) : '-';
            if (isalpha((unsigned char)at[strlen(raw_names[i])]) || !(first || strchr("cms", letter) != NULL)) {
                continue; /* part of another word */
            }
            found = true;
            lossy = lossy || letter == 'c';
            small = small || letter == 'm' || letter == 's';
        }
    }
    if (!found) {
        return 0;
    }
    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++) {
        if (strcasestr(text, others[i]) != NULL) {
            return 1;
        }
    }
    for (size_t i = 0; i < sizeof fewer / sizeof fewer[0]; i++) {
        small = small || strcasestr(text, fewer[i]) != NULL;
    }
    const char *compressed = strcasestr(text, "compressed");
    lossy = lossy ||
            (compressed != NULL && strcasestr(text, "uncompressed") == NULL && strcasestr(text, "lossless") == NULL);
    return small ? 2 : lossy ? 3 : 4;
}

void capture_stops_add(capture_stops *stops, const char *text, bool (*parse)(const char *text, double *value)) {
    double value;
    if (stops->count == CAPTURE_STOPS_MAX || strlen(text) >= sizeof stops->texts[0] || !parse(text, &value)) {
        return;
    }
    size_t at = 0;
    while (at < stops->count && stops->values[at] < value) {
        at++;
    }
    if (at < stops->count && !(stops->values[at] > value)) {
        return;
    }
    memmove(stops->values + at + 1, stops->values + at, (stops->count - at) * sizeof stops->values[0]);
    memmove(stops->texts + at + 1, stops->texts + at, (stops->count - at) * sizeof stops->texts[0]);
    stops->values[at] = value;
    memcpy(stops->texts[at], text, strlen(text) + 1);
    stops->count++;
}

size_t capture_stops_nearest(const capture_stops *stops, double value) {
    size_t best = 0;
    for (size_t i = 1; i < stops->count; i++) {
        if (fabs(log(stops->values[i] / value)) < fabs(log(stops->values[best] / value))) {
            best = i;
        }
    }
    return best;
}
