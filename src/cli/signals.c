/* SPDX-License-Identifier: Apache-2.0 */
/*
 * signals.c: Ctrl-C. The first signal asks the running call to stop, which
 * removes what it had begun to write; the second doesn't wait.
 */
#include "cli/cli.h"

#include <signal.h>
#include <string.h>
#include <unistd.h>

#include "core/core.h"

static volatile int cancel;
static volatile sig_atomic_t caught;

static void on_signal(int number) {
    if (cancel) {
        core_files_abort_all();
        _exit(128 + number);
    }
    caught = number;
    cancel = 1;
}

const volatile int *cli_signals_install(void) {
    static const int numbers[] = {SIGINT, SIGTERM, SIGHUP};
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        struct sigaction old, action;
        memset(&action, 0, sizeof action);
        action.sa_handler = on_signal;
        action.sa_flags = SA_RESTART;
        sigemptyset(&action.sa_mask);
        /* nohup and background shells start us with a signal ignored: leave it so. */
        if (sigaction(numbers[i], NULL, &old) == 0 && old.sa_handler != SIG_IGN) {
            sigaction(numbers[i], &action, NULL);
        }
    }
    return &cancel;
}

int cli_signals_exit(void) {
    if (caught == 0) {
        return CLI_FAILED;
    }
    fflush(stdout);
    signal(caught, SIG_DFL);
    raise(caught);
    return 128 + caught;
}
