/* SPDX-License-Identifier: Apache-2.0 */
/*
 * text.c: exposure times the way cameras show them, and JSON on stdout.
 */
#include "cli/cli.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const char *cli_exposure_text(char *buffer, size_t size, double seconds) {
    if (!(seconds > 0)) {
        snprintf(buffer, size, "?");
    } else if (seconds < 0.3) {
        double inverse = 1 / seconds;
        /* 1/12.5 needs its decimal; 1/639.9 is a rounding of 1/640. */
        bool whole = fabs(inverse - round(inverse)) < 0.005 * inverse || inverse > 100;
        snprintf(buffer, size, whole ? "1/%.0f s" : "1/%.1f s", inverse);
    } else {
        snprintf(buffer, size, "%.3g s", seconds);
    }
    return buffer;
}

bool cli_exposure_parse(const char *text, double *seconds) {
    char copy[64];
    size_t n = strlen(text);
    if (n == 0 || n >= sizeof copy) {
        return false;
    }
    memcpy(copy, text, n + 1);
    if (copy[n - 1] == 's' || copy[n - 1] == '"') {
        copy[n - 1] = '\0';
    }
    double over = 1, under = 1;
    char *slash = strchr(copy, '/');
    if (slash != NULL) {
        *slash = '\0';
        if (!cli_number(slash + 1, &under) || !(under > 0)) {
            return false;
        }
    }
    if (!cli_number(copy, &over) || !(over > 0)) {
        return false;
    }
    double value = over / under;
    if (!(value >= 1e-9 && value <= 1e6)) {
        return false;
    }
    *seconds = value;
    return true;
}

json_t *cli_json_number(double value) {
    return isfinite(value) ? json_real(value) : json_null();
}

json_t *cli_json_text(const char *text) {
    json_t *value = json_string(text);
    if (value != NULL) {
        return value;
    }
    /* A file name in an old encoding: JSON can't hold it, but should not fail for it. */
    char *copy = strdup(text);
    if (copy == NULL) {
        return NULL;
    }
    for (char *p = copy; *p != '\0'; p++) {
        if ((unsigned char)*p >= 0x80) {
            *p = '?';
        }
    }
    value = json_string(copy);
    free(copy);
    return value;
}

bool cli_json_print(json_t *object, const char *command) {
    if (object == NULL) {
        cli_error(command, "out of memory");
        return false;
    }
    errno = 0;
    int failed = json_dumpf(object, stdout, JSON_INDENT(2) | JSON_REAL_PRECISION(9));
    json_decref(object);
    if (failed) {
        cli_error(command, "could not print the JSON object: %s",
                  errno != 0 ? strerror(errno) : "a text in it is not UTF-8");
        return false;
    }
    putchar('\n');
    return cli_flush(command);
}

void cli_json_error(const brace_error *error, const char *command) {
    cli_json_print(json_pack("{s:{s:s,s:o}}", "error", "status", brace_status_name(error->status), "message",
                             cli_json_text(error->message)),
                   command);
}
