/* SPDX-License-Identifier: Apache-2.0 */
/*
 * embed.c: runs while BRACE is built: turns files into a C header of byte arrays, so that the report's page, style and
 * script are kept as what they are and compiled into the program.
 *   embed OUT.h FILE...      FILE a/report.css becomes `static const char report_css[]`
 */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int embed(FILE *out, const char *path) {
    FILE *in = fopen(path, "rb");
    if (in == NULL) {
        perror(path);
        return 1;
    }
    const char *slash = strrchr(path, '/');
    fputs("static const char ", out);
    for (const char *c = slash != NULL ? slash + 1 : path; *c != '\0'; c++) {
        fputc(isalnum((unsigned char)*c) ? *c : '_', out);
    }
    fputs("[] = {", out);
    int c, n = 0;
    while ((c = fgetc(in)) != EOF) {
        fprintf(out, "%s%d,", n++ % 24 == 0 ? "\n    " : "", c < 128 ? c : c - 256);
    }
    fputs("\n    0};\n", out);
    int failed = ferror(in);
    fclose(in);
    return failed != 0;
}

int main(int argc, char **argv) {
    if (argc < 3) {
        fputs("usage: embed OUT.h FILE...\n", stderr);
        return 2;
    }
    FILE *out = fopen(argv[1], "wb");
    if (out == NULL) {
        perror(argv[1]);
        return 1;
    }
    fputs("/* Made by embed.c; edit the files that it was made from. */\n", out);
    int failed = 0;
    for (int i = 2; i < argc; i++) {
        failed |= embed(out, argv[i]);
    }
    failed |= ferror(out) != 0;
    failed |= fclose(out) != 0;
    return failed;
}
