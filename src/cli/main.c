/* SPDX-License-Identifier: Apache-2.0 */
/*
 * main.c: the `brace` program: finds the command and hands over.
 */
#include "cli/cli.h"

#include <errno.h>
#include <signal.h>
#include <stdarg.h>
#include <string.h>

static const cli_command commands[] = {
    {"restore", "several RAW exposures of a display in, one picture with less banding or none out", cli_restore},
    {"info", "what the RAW files of a bracket say about themselves", cli_info},
    {"analyze", "how strongly photographs of a display band, at what frequency, and which shutter avoids it", cli_analyze},
    {"metrics", "how far pictures are from the truth: PSNR, SSIM, MS-SWD, LPIPS, DISTS, SFC", cli_metrics},
    {"simulate", "photographs of a display: a screenshot in, a bracket of RAW frames out", cli_simulate},
    {"capture", "cameras: plan a bracket, shoot it, verify it", cli_capture},
    {"dataset", "training sets: build, pack, verify, info, import", cli_dataset},
    {"bench", "how fast BRACE is on this computer", cli_bench},
};
enum { COMMANDS = sizeof commands / sizeof commands[0] };

void cli_error(const char *command, const char *format, ...) {
    va_list args;
    va_start(args, format);
    fprintf(stderr, "brace: %s: ", command);
    vfprintf(stderr, format, args);
    fputc('\n', stderr);
    va_end(args);
}

bool cli_flush(const char *command) {
    errno = 0;
    if (fflush(stdout) == 0 && !ferror(stdout)) {
        return true;
    }
    cli_error(command, "standard output: %s", errno != 0 ? strerror(errno) : "write failed");
    return false;
}

static int help(void) {
    printf("Usage: brace COMMAND ...\n\n"
           "Removes flicker-banding, the stripes and colour shifts in photographs of displays,\n"
           "from a bracket of RAW exposures of the same screen.\n\n"
           "Commands:\n");
    for (int i = 0; i < COMMANDS; i++) {
        printf("  %-10s %s\n", commands[i].name, commands[i].summary);
    }
    printf("  %-10s the help of a command: brace help restore\n\n"
           "  brace --version   the version of BRACE and of the libraries it runs on\n\n"
           "Example:\n"
           "  brace restore frame_*.dng -o restored.dng -o restored.jpg\n\n"
           "Exit codes: 0 done, 1 failed, 2 wrong usage.\n",
           "help");
    return cli_flush("help") ? CLI_DONE : CLI_FAILED;
}

static int version(void) {
    printf("brace %s\n%s\n", brace_version(), brace_dependencies());
    return cli_flush("version") ? CLI_DONE : CLI_FAILED;
}

static const cli_command *find(const char *name) {
    for (int i = 0; i < COMMANDS; i++) {
        if (strcmp(commands[i].name, name) == 0) {
            return &commands[i];
        }
    }
    return NULL;
}

static int unknown(const char *name) {
    const char *names[COMMANDS + 2];
    for (int i = 0; i < COMMANDS; i++) {
        names[i] = commands[i].name;
    }
    names[COMMANDS] = "help";
    names[COMMANDS + 1] = NULL;
    const char *close = cli_closest(name, names);
    fprintf(stderr, "brace: there is no command '%s'", name);
    if (close != NULL) {
        fprintf(stderr, "; did you mean 'brace %s'?\n", close);
    } else {
        fprintf(stderr, "\nTry 'brace --help'.\n");
    }
    return CLI_USAGE;
}

int main(int argc, char **argv) {
    /* A reader that went away is an error of write(), reported like any other. */
    signal(SIGPIPE, SIG_IGN);

    if (argc < 2) {
        fprintf(stderr, "brace: which command? brace restore, or brace info\nTry 'brace --help'.\n");
        return CLI_USAGE;
    }
    const char *name = argv[1];
    if (strcmp(name, "--help") == 0 || strcmp(name, "-h") == 0) {
        return help();
    }
    if (strcmp(name, "--version") == 0 || strcmp(name, "-V") == 0) {
        return version();
    }
    if (strcmp(name, "help") == 0) {
        if (argc < 3) {
            return help();
        }
        const cli_command *command = find(argv[2]);
        char option[] = "--help";
        char *words[] = {argv[2], option, NULL};
        return command != NULL ? command->run(2, words) : unknown(argv[2]);
    }
    if (name[0] == '-') {
        fprintf(stderr,
                "brace: there is no option %s here; the command comes first: brace restore ...\n"
                "Try 'brace --help'.\n",
                name);
        return CLI_USAGE;
    }
    const cli_command *command = find(name);
    return command != NULL ? command->run(argc - 1, argv + 1) : unknown(name);
}
