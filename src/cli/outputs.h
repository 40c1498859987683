/* SPDX-License-Identifier: Apache-2.0 */
/*
 * outputs.h: the files that `brace restore` writes: which format each has,
 * whether they can be written at all, and the writing.
 */
#ifndef CLI_OUTPUTS_H
#define CLI_OUTPUTS_H

#include "cli/cli.h"

#define CLI_OUTPUTS_MAX 8

typedef enum output_format {
    OUTPUT_NONE = 0,
    OUTPUT_DNG,
    OUTPUT_PNG,
    OUTPUT_TIFF,
    OUTPUT_JPEG,
    OUTPUT_WEBP
} output_format;

typedef struct output {
    const char *path;
    output_format format;
    bool written;
} output;

typedef struct outputs {
    output items[CLI_OUTPUTS_MAX + 1]; /* one more for the report, where outputs are checked */
    size_t count;
    int bits, quality; /* 0: the default of each format */
    double exposure;   /* EV added to the pictures, not to DNGs */
    double highlights; /* up to which value the restored mosaic holds light; see brace_develop_params */
    double seconds_develop, seconds_write;
} outputs;

/* Finds the format of each path (`format`, which may be NULL, for those whose
 * name doesn't tell) and checks bits and quality against them. -1 to go on, or the exit code. */
int outputs_init(outputs *out, const cli_list *paths, const char *format, const char *command);

/* Refuses outputs that are inputs, are given twice, or whose folder isn't there. -1 to go on. */
int outputs_check(const outputs *out, const cli_paths *inputs, const char *command);

/* Whether one of them is standard output under another name. */
bool outputs_use_stdout(const outputs *out);

/* Writes all. */
brace_status outputs_write(outputs *out, const brace_restored *restored, const brace_job *job, brace_error *error);

/* Whether a DNG is one that outputs_write has written. */
bool outputs_is_result(const char *path);

const char *output_format_name(output_format format);

#endif
