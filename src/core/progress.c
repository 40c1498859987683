/* SPDX-License-Identifier: Apache-2.0 */
/*
 * progress.c: the progress display. What is shown depends only on the calls,
 * the clock and the kind of output, all of which tests can supply.
 */
#include "core/progress.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "core/core.h"

#define REDRAW_SECONDS 0.1
#define LINE_SECONDS 10.0

struct core_bar {
    core_bar_params params;
    bool terminal;
    bool drawn;  /* an unfinished bar is on the terminal's line */
    bool active; /* between a stage's first and last report */
    char stage[64];
    double started, shown;
    uint64_t from; /* what was done at the start: by an earlier run that this one goes on with */
};

static double now(const core_bar *bar) {
    return bar->params.clock != NULL ? bar->params.clock(bar->params.user) : core_seconds();
}

core_bar *core_bar_create(const core_bar_params *params) {
    core_bar *bar = core_calloc(1, sizeof *bar);
    if (bar == NULL) {
        return NULL;
    }
    bar->params = *params;
    if (bar->params.out == NULL) {
        bar->params.quiet = true;
    } else if (params->kind == CORE_BAR_ASK) {
        const char *term = getenv("TERM");
        bar->terminal = isatty(fileno(params->out)) && term != NULL && strcmp(term, "dumb") != 0;
    } else {
        bar->terminal = params->kind == CORE_BAR_TERMINAL;
    }
    return bar;
}

static int columns(const core_bar *bar) {
    int width = bar->params.width;
    struct winsize size;
    if (width == 0 && ioctl(fileno(bar->params.out), TIOCGWINSZ, &size) == 0) {
        width = size.ws_col; /* asked each time: windows are resized */
    }
    return width <= 0 ? 80 : width < 20 ? 20 : width > 160 ? 160 : width;
}

/* "0:07", "12:34", "3:05:00" */
static void format_time(char *out, size_t size, double seconds) {
    uint64_t s = seconds < 0 ? 0 : seconds > 3.6e8 ? (uint64_t)3.6e8 : (uint64_t)(seconds + 0.5);
    if (s >= 3600) {
        snprintf(out, size, "%" PRIu64 ":%02u:%02u", s / 3600, (unsigned)(s / 60 % 60), (unsigned)(s % 60));
    } else {
        snprintf(out, size, "%u:%02u", (unsigned)(s / 60), (unsigned)(s % 60));
    }
}

static void format_rate(char *out, size_t size, double rate) {
    if (rate >= 1e6) {
        snprintf(out, size, "%.1fM/s", rate / 1e6);
    } else if (rate >= 1e4) {
        snprintf(out, size, "%.1fk/s", rate / 1e3);
    } else {
        snprintf(out, size, rate >= 100 ? "%.0f/s" : rate >= 1 ? "%.1f/s" : "%.2f/s", rate);
    }
}

/* The figures to the right of the bar: "45 %  12.3/s  0:03 left". */
static void format_figures(char *out, size_t size, uint64_t from, uint64_t done, uint64_t total, double elapsed) {
    char rate[32] = "", left[32] = "";
    if (elapsed > 0 && done > from) {
        format_rate(rate, sizeof rate, (double)(done - from) / elapsed);
        if (total > done) {
            format_time(left, sizeof left, elapsed * (double)(total - done) / (double)(done - from));
        }
    }
    char head[32];
    if (total > 0) {
        snprintf(head, sizeof head, "%3d %%", (int)(100.0 * (double)done / (double)total));
    } else {
        snprintf(head, sizeof head, "%" PRIu64, done);
    }
    snprintf(out, size, "%s%s%s%s%s%s", head, *rate ? "  " : "", rate, *left ? "  " : "", left, *left ? " left" : "");
}

static void draw(core_bar *bar, uint64_t done, uint64_t total, double elapsed) {
    char figures[128], line[256];
    format_figures(figures, sizeof figures, bar->from, done, total, elapsed);
    int width = columns(bar) - 1; /* the last column would wrap on some terminals */
    int room = width - (int)strlen(bar->stage) - (int)strlen(figures) - 5;
    if (room > 40) {
        room = 40;
    }
    if (total > 0 && room >= 5) {
        char cells[41];
        int full = (int)((double)room * (double)done / (double)total);
        for (int i = 0; i < room; i++) {
            cells[i] = i < full ? '#' : '.';
        }
        cells[room] = '\0';
        snprintf(line, sizeof line, "%s [%s] %s", bar->stage, cells, figures);
    } else {
        snprintf(line, sizeof line, "%s %s", bar->stage, figures);
    }
    fprintf(bar->params.out, "\r%.*s\033[K", width, line); /* ESC [ K clears to the end of the line (ECMA-48 EL) */
    bar->drawn = true;
}

void core_bar_clear(core_bar *bar) {
    if (bar == NULL || !bar->drawn) {
        return;
    }
    fputs("\r\033[K", bar->params.out);
    fflush(bar->params.out);
    bar->drawn = false;
}

static void finish(core_bar *bar, uint64_t done, double elapsed) {
    core_bar_clear(bar);
    char rate[32] = "";
    if (elapsed > 0 && done > bar->from) {
        format_rate(rate, sizeof rate, (double)(done - bar->from) / elapsed);
    }
    fprintf(bar->params.out, "%s: done, %" PRIu64 " in %.1f s%s%s%s\n", bar->stage, done, elapsed, *rate ? " (" : "",
            rate, *rate ? ")" : "");
    fflush(bar->params.out);
    bar->active = false;
}

void core_bar_update(core_bar *bar, const char *stage, uint64_t done, uint64_t total) {
    if (bar == NULL || bar->params.quiet) {
        return;
    }
    if (total > 0 && done > total) {
        done = total;
    }
    double t = now(bar);
    bool first = !bar->active || strncmp(bar->stage, stage, sizeof bar->stage - 1) != 0;
    if (first) {
        core_bar_clear(bar);
        snprintf(bar->stage, sizeof bar->stage, "%s", stage);
        bar->active = true;
        bar->started = bar->shown = t;
        bar->from = done;
    }
    double elapsed = t - bar->started;
    if (total > 0 && done == total) {
        finish(bar, done, elapsed);
    } else if (bar->terminal) {
        if (first || t - bar->shown >= REDRAW_SECONDS) {
            draw(bar, done, total, elapsed);
            bar->shown = t;
            fflush(bar->params.out);
        }
    } else if (first) {
        fprintf(bar->params.out, "%s: started\n", bar->stage);
        fflush(bar->params.out);
    } else if (t - bar->shown >= LINE_SECONDS) {
        char figures[128];
        format_figures(figures, sizeof figures, bar->from, done, total, elapsed);
        fprintf(bar->params.out, "%s: %s\n", bar->stage, figures + strspn(figures, " "));
        fflush(bar->params.out);
        bar->shown = t;
    }
}

void core_bar_note(core_bar *bar, const char *message) {
    if (bar == NULL || bar->params.out == NULL) {
        return;
    }
    core_bar_clear(bar);
    fprintf(bar->params.out, "%s\n", message);
    fflush(bar->params.out);
}

void core_bar_destroy(core_bar *bar) {
    core_bar_clear(bar);
    core_free(bar);
}
