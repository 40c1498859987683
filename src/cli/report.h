/* SPDX-License-Identifier: Apache-2.0 */
/*
 * report.h: reports as one HTML file that needs nothing else: no network, no second file, no program but a browser.
 * report_page.c writes the page around the content and makes text from outside harmless; report_picture.c puts pictures
 * in; report_spectrum.c draws spectra; report_restore.c and report_metrics.c are the two reports. Page, style and
 * script are report.html, report.css and report.js.
 */
#ifndef CLI_REPORT_H
#define CLI_REPORT_H

#include "banding/banding.h"
#include "cli/eval.h"
#include "cli/outputs.h"
#include "core/core.h"

/* Longest side of a report's pictures in pixels, by default. */
enum { REPORT_SIDE = 2048 };

typedef struct report_page {
    FILE *f; /* markup of one's own goes here directly; text from outside through report_text */
    core_file *file;
    const brace_job *job;
    uint32_t side;
} report_page;

/* ---- report_page.c ---- */

/* Creates the file and writes all that comes before the content. */
brace_status report_open(report_page *page, const char *path, const char *title, const brace_job *job,
                         brace_error *error);

/* The end of the page; the file gets its name if `status` is BRACE_OK, otherwise nothing is left of it. Returns `status`
 * or what went wrong now. */
brace_status report_close(report_page *page, brace_status status, brace_error *error);

/* Text from outside as text: markup is escaped; bytes that are no UTF-8, control characters and those that turn the
 * direction of writing become U+FFFD. Fit for the content of elements and for attributes in double quotes. */
void report_text(FILE *f, const char *text);

/* The same in an element that keeps names of another direction of writing together. */
void report_name(FILE *f, const char *text);

/* "<dt>...</dt><dd>" and "</dd>" around text from outside. */
void report_fact(FILE *f, const char *what, const char *text);

/* The remarks of a job as a list, if there were any. */
void report_notes(FILE *f, char *const *notes, size_t count);

/* ---- report_picture.c ---- */

typedef enum report_coding { REPORT_PHOTO, REPORT_THUMBNAIL, REPORT_PLOT } report_coding; /* JPEG, JPEG, PNG */

/* <img src="data:..." width height ATTRIBUTES>, no larger than `side`; `attributes` is markup. */
brace_status report_picture(const report_page *page, const brace_image *image, uint32_t side, report_coding coding,
                            const char *attributes, brace_error *error);

/* ---- report_spectrum.c ---- */

typedef struct report_spectra {
    banding_plane plane[2];  /* before and after */
    const char *label[2];
    const char *css[2];      /* class of each curve */
    double pixels;           /* of the picture that are one of the plane: 2 for packed RAW */
    double wave_x, wave_y;   /* across the stripes, unit length */
    double period;           /* of the stripes, pixels of the picture; 0: not known */
    double decibel;          /* out: power at the stripes' frequency, after against before; NAN if not known */
} report_spectra;

/* Power at the stripes' frequency; both spectra stay for report_spectra_write. */
typedef struct report_spectra_result {
    banding_spectrum spectrum[2];
    brace_fabp fabp[2];
} report_spectra_result;

brace_status report_spectra_measure(report_spectra *s, report_spectra_result *r, const brace_job *job,
                                    brace_error *error);
brace_status report_spectra_write(const report_page *page, const report_spectra *s, const report_spectra_result *r,
                                  brace_error *error);
void report_spectra_free(report_spectra *s, report_spectra_result *r);

/* ---- the reports ---- */

typedef struct report_restore_params {
    const char *path;
    const char *truth; /* a picture or RAW file of the true screen, or NULL */
    int side;          /* 0: REPORT_SIDE */
    const brace_bracket *bracket;
    const brace_restored *restored;
    const outputs *out; /* exposure, highlights, names */
    double seconds;     /* that the restoration took */
    char *const *notes;
    size_t note_count;
} report_restore_params;

brace_status report_restore(const report_restore_params *params, const brace_job *job, brace_error *error);

/* `table` has results. `side` 0: REPORT_SIDE, less for many pairs. */
brace_status report_metrics(const metrics_table *table, const char *path, int side, const cli_report *notes,
                            const brace_job *job, brace_error *error);

/* `set` was measured, with pictures of the samples that are shown. */
brace_status report_eval(const eval_set *set, const char *path, const cli_report *notes, const brace_job *job,
                         brace_error *error);

#endif
