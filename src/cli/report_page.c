/* SPDX-License-Identifier: Apache-2.0 */
/*
 * report_page.c: the page around a report's content, and text from outside made harmless. Names of files and cameras
 * are anything that someone wrote into them; none of it may become markup.
 */
#include "cli/report.h"

#include <string.h>

#include "report_files.h" /* report_html, report_css, report_js: made by embed.c */

/* One character of UTF-8 (RFC 3629: shortest form, no surrogates, at most U+10FFFF) and its length; 0 if it is none. */
static size_t decode(uint32_t *out, const unsigned char *s) {
    static const uint32_t least[5] = {0, 0, 0x80, 0x800, 0x10000};
    const size_t n = s[0] < 0x80 ? 1 : (s[0] & 0xe0) == 0xc0 ? 2 : (s[0] & 0xf0) == 0xe0 ? 3 : (s[0] & 0xf8) == 0xf0 ? 4 : 0;
    if (n < 2) {
        *out = s[0];
        return n;
    }
    uint32_t c = s[0] & (0xffu >> (n + 1));
    for (size_t i = 1; i < n; i++) {
        if ((s[i] & 0xc0) != 0x80) { /* the end of the string, too */
            return 0;
        }
        c = c << 6 | (s[i] & 0x3f);
    }
    *out = c;
    return c < least[n] || c > 0x10ffff || (c >= 0xd800 && c <= 0xdfff) ? 0 : n;
}

/* Controls of the terminal's kind, and those of Unicode that reorder what is read (UAX 9). */
static bool is_control(uint32_t c) {
    return c < 0x20 || (c >= 0x7f && c < 0xa0) || c == 0x61c || c == 0x200e || c == 0x200f ||
           (c >= 0x2028 && c <= 0x202e) || (c >= 0x2066 && c <= 0x2069) || c == 0xfeff || (c & 0xfffe) == 0xfffe;
}

void report_text(FILE *f, const char *text) {
    const unsigned char *s = (const unsigned char *)text;
    while (*s != '\0') {
        uint32_t c = 0;
        const size_t n = decode(&c, s);
        if (n == 0 || is_control(c)) {
            fputs("\xef\xbf\xbd", f);
        } else if (c == '&') {
            fputs("&amp;", f);
        } else if (c == '<') {
            fputs("&lt;", f);
        } else if (c == '>') {
            fputs("&gt;", f);
        } else if (c == '"') {
            fputs("&quot;", f);
        } else if (c == '\'') {
            fputs("&#39;", f);
        } else {
            fwrite(s, 1, n, f);
        }
        s += n > 0 ? n : 1;
    }
}

void report_name(FILE *f, const char *text) {
    fputs("<bdi>", f);
    report_text(f, text);
    fputs("</bdi>", f);
}

void report_fact(FILE *f, const char *what, const char *text) {
    fprintf(f, "<dt>%s</dt><dd>", what);
    report_name(f, text);
    fputs("</dd>\n", f);
}

void report_notes(FILE *f, char *const *notes, size_t count) {
    if (count == 0) {
        return;
    }
    fputs("<h2>Remarks</h2>\n<ul class=\"notes\">\n", f);
    for (size_t i = 0; i < count; i++) {
        fputs("<li>", f);
        report_name(f, notes[i]);
        fputs("</li>\n", f);
    }
    fputs("</ul>\n", f);
}

/* The page from `from` up to the mark; returns what comes after it. */
static const char *until(FILE *f, const char *from, const char *mark) {
    const char *at = strstr(from, mark);
    if (at == NULL) {
        return from;
    }
    fwrite(from, 1, (size_t)(at - from), f);
    return at + strlen(mark);
}

brace_status report_open(report_page *page, const char *path, const char *title, const brace_job *job,
                         brace_error *error) {
    brace_status status = core_file_create(&page->file, path, error);
    if (status != BRACE_OK) {
        return status;
    }
    page->f = core_file_stream(page->file);
    page->job = job;
    const char *rest = until(page->f, report_html, "{{title}}");
    report_text(page->f, title);
    rest = until(page->f, rest, "{{style}}");
    fputs(report_css, page->f);
    until(page->f, rest, "{{body}}");
    return BRACE_OK;
}

brace_status report_close(report_page *page, brace_status status, brace_error *error) {
    if (page->file == NULL) {
        return status;
    }
    if (status != BRACE_OK) {
        core_file_abort(page->file);
        page->file = NULL;
        return status;
    }
    fprintf(page->f, "<footer>Made by BRACE %s. Everything is in this one file; it loads nothing.</footer>\n",
            brace_version());
    const char *rest = strstr(report_html, "{{body}}");
    rest = until(page->f, rest != NULL ? rest + strlen("{{body}}") : "", "{{script}}");
    fputs(report_js, page->f);
    fputs(rest, page->f);
    status = core_file_commit(page->file, error);
    page->file = NULL;
    return status;
}
