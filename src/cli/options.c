/* SPDX-License-Identifier: Apache-2.0 */
/*
 * options.c: options from a table: the same entries parse the command line and
 * print the help, so the two can't drift apart. Understands -o X, -oX, --opt X,
 * --opt=X, unambiguous beginnings of long options, and -- .
 */
#include "cli/cli.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

bool cli_list_add(cli_list *list, const char *item) {
    const char **grown = realloc(list->items, (list->count + 1) * sizeof *grown);
    if (grown == NULL) {
        return false;
    }
    list->items = grown;
    list->items[list->count++] = item;
    return true;
}

void cli_list_free(cli_list *list) {
    free(list->items);
    list->items = NULL;
    list->count = 0;
}

int cli_wrong_usage(const char *command, const char *format, ...) {
    va_list args;
    va_start(args, format);
    fprintf(stderr, "brace: %s: ", command);
    vfprintf(stderr, format, args);
    va_end(args);
    fprintf(stderr, "\nTry 'brace %s --help'.\n", command);
    return CLI_USAGE;
}

bool cli_number(const char *text, double *value) {
    char *end = NULL;
    errno = 0;
    double x = strtod(text, &end);
    if (end == text || *end != '\0' || errno == ERANGE || !isfinite(x)) {
        return false;
    }
    *value = x;
    return true;
}

/* Optimal string alignment distance (Levenshtein plus swaps of neighbours),
 * which is what a typing mistake costs. */
static size_t typing_distance(const char *a, const char *b) {
    enum { LONGEST = 32 };
    size_t rows[3][LONGEST + 1];
    size_t na = strlen(a), nb = strlen(b);
    if (na > LONGEST || nb > LONGEST) {
        return LONGEST;
    }
    for (size_t j = 0; j <= nb; j++) {
        rows[0][j] = j;
        rows[2][j] = j;
    }
    for (size_t i = 1; i <= na; i++) {
        size_t *now = rows[i % 3], *last = rows[(i + 2) % 3], *before = rows[(i + 1) % 3];
        now[0] = i;
        for (size_t j = 1; j <= nb; j++) {
            size_t best = last[j - 1] + (a[i - 1] != b[j - 1]);
            if (last[j] + 1 < best) {
                best = last[j] + 1;
            }
            if (now[j - 1] + 1 < best) {
                best = now[j - 1] + 1;
            }
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] && before[j - 2] + 1 < best) {
                best = before[j - 2] + 1;
            }
            now[j] = best;
        }
    }
    return rows[na % 3][nb];
}

const char *cli_closest(const char *word, const char *const *words) {
    const char *best = NULL;
    size_t best_distance = strlen(word) / 3 + 1; /* one mistake in every three letters, rounded up */
    for (; *words != NULL; words++) {
        size_t d = typing_distance(word, *words);
        if (d <= best_distance && d < strlen(word)) {
            best = *words;
            best_distance = d > 0 ? d - 1 : 0;
        }
    }
    return best;
}

/* ---- help ---- */

static void print_help(const cli_usage *usage, FILE *to) {
    enum { COLUMN = 26 };
    fprintf(to, "Usage: brace %s %s\n\n%s\n", usage->command, usage->synopsis, usage->about);
    for (const cli_option *o = usage->options; o->kind != CLI_END; o++) {
        if (o->kind == CLI_HEADING) {
            fprintf(to, "\n%s:\n", o->help);
            continue;
        }
        char left[64];
        int n = snprintf(left, sizeof left, "  %c%c%c --%s%s%s", o->letter ? '-' : ' ', o->letter ? o->letter : ' ',
                         o->letter ? ',' : ' ', o->name, o->argument ? " " : "", o->argument ? o->argument : "");
        fputs(left, to);
        if (n >= COLUMN) {
            fputc('\n', to);
            n = 0;
        }
        for (const char *line = o->help; line != NULL;) {
            const char *end = strchr(line, '\n');
            int length = end ? (int)(end - line) : (int)strlen(line);
            fprintf(to, "%*s%.*s\n", COLUMN - n, "", length, line);
            line = end ? end + 1 : NULL;
            n = 0;
        }
    }
    if (usage->epilogue != NULL) {
        fprintf(to, "\n%s", usage->epilogue);
    }
}

/* ---- parsing ---- */

static int unknown_option(const cli_usage *usage, const char *word) {
    const char *words[64];
    size_t n = 0;
    for (const cli_option *o = usage->options; o->kind != CLI_END && n < 63; o++) {
        if (o->name != NULL) {
            words[n++] = o->name;
        }
    }
    words[n] = NULL;
    const char *close = cli_closest(word, words);
    if (close != NULL) {
        return cli_wrong_usage(usage->command, "there is no option --%s; did you mean --%s?", word, close);
    }
    return cli_wrong_usage(usage->command, "there is no option --%s", word);
}

/* The option with this long name, or the only one that begins so; NULL with `*code` set. */
static const cli_option *find_long(const cli_usage *usage, const char *name, size_t length, int *code) {
    const cli_option *found = NULL;
    for (const cli_option *o = usage->options; o->kind != CLI_END; o++) {
        if (o->name == NULL || strncmp(o->name, name, length) != 0) {
            continue;
        }
        if (o->name[length] == '\0') {
            return o;
        }
        if (found != NULL) {
            *code = cli_wrong_usage(usage->command, "--%.*s could be --%s or --%s", (int)length, name, found->name,
                                    o->name);
            return NULL;
        }
        found = o;
    }
    if (found == NULL || length == 0) {
        char word[64];
        snprintf(word, sizeof word, "%.*s", (int)length, name);
        *code = unknown_option(usage, word);
        return NULL;
    }
    return found;
}

/* Stores a value; -1, or the exit code of an error. */
static int store(const cli_usage *usage, const cli_option *o, const char *value) {
    double x;
    switch (o->kind) {
    case CLI_TEXT:
        *(const char **)o->target = value;
        return -1;
    case CLI_LIST:
        if (!cli_list_add(o->target, value)) {
            cli_error(usage->command, "out of memory");
            return CLI_FAILED;
        }
        return -1;
    case CLI_INT:
    case CLI_NUMBER:
        if (!cli_number(value, &x) || x < o->low || x > o->high || (o->kind == CLI_INT && x != floor(x))) {
            return cli_wrong_usage(usage->command, "--%s takes a %snumber from %g to %g, not '%s'", o->name,
                                   o->kind == CLI_INT ? "whole " : "", o->low, o->high, value);
        }
        if (o->kind == CLI_INT) {
            *(int *)o->target = (int)x;
        } else {
            *(double *)o->target = x;
        }
        return -1;
    default:
        return -1;
    }
}

static bool takes_value(const cli_option *o) {
    return o->kind != CLI_FLAG && o->kind != CLI_HELP;
}

static int flag(const cli_usage *usage, const cli_option *o) {
    if (o->kind == CLI_HELP) {
        print_help(usage, stdout);
        return cli_flush(usage->command) ? CLI_DONE : CLI_FAILED;
    }
    *(bool *)o->target = true;
    return -1;
}

/* -qo out.png, -oout.png: letters up to one that takes the rest, or the next word, as its value. */
static int parse_letters(const cli_usage *usage, int argc, char **argv, int *i) {
    for (const char *p = argv[*i] + 1; *p != '\0'; p++) {
        const cli_option *o = usage->options;
        while (o->kind != CLI_END && o->letter != *p) {
            o++;
        }
        if (o->kind == CLI_END) {
            return cli_wrong_usage(usage->command,
                                   "there is no option -%c (a file name that begins with a dash goes "
                                   "after --, or as ./%s)",
                                   *p, argv[*i]);
        }
        int code;
        if (!takes_value(o)) {
            code = flag(usage, o);
            if (code >= 0) {
                return code;
            }
            continue;
        }
        const char *value = p[1] != '\0' ? p + 1 : *i + 1 < argc ? argv[++*i] : NULL;
        if (value == NULL) {
            return cli_wrong_usage(usage->command, "-%c needs a value: -%c %s", o->letter, o->letter, o->argument);
        }
        return store(usage, o, value);
    }
    return -1;
}

static int parse_long(const cli_usage *usage, int argc, char **argv, int *i) {
    const char *name = argv[*i] + 2;
    const char *equals = strchr(name, '=');
    size_t length = equals ? (size_t)(equals - name) : strlen(name);
    int code = CLI_USAGE;
    const cli_option *o = find_long(usage, name, length, &code);
    if (o == NULL) {
        return code;
    }
    if (!takes_value(o)) {
        if (equals != NULL) {
            return cli_wrong_usage(usage->command, "--%s takes no value", o->name);
        }
        return flag(usage, o);
    }
    const char *value = equals ? equals + 1 : *i + 1 < argc ? argv[++*i] : NULL;
    if (value == NULL) {
        return cli_wrong_usage(usage->command, "--%s needs a value: --%s %s", o->name, o->name, o->argument);
    }
    return store(usage, o, value);
}

int cli_parse(const cli_usage *usage, int argc, char **argv, cli_list *operands) {
    bool only_operands = false;
    for (int i = 1; i < argc; i++) {
        const char *word = argv[i];
        int code = -1;
        if (only_operands || word[0] != '-' || word[1] == '\0') {
            if (!cli_list_add(operands, word)) {
                cli_error(usage->command, "out of memory");
                return CLI_FAILED;
            }
        } else if (strcmp(word, "--") == 0) {
            only_operands = true;
        } else if (word[1] == '-') {
            code = parse_long(usage, argc, argv, &i);
        } else {
            code = parse_letters(usage, argc, argv, &i);
        }
        if (code >= 0) {
            return code;
        }
    }
    return -1;
}
