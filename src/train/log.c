/* SPDX-License-Identifier: Apache-2.0 */
/* log.c: how a run went, as lines of JSON and as a picture. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "image/label.h"
#include "train/train.h"

#define LOG_LIMIT ((size_t)1 << 30)

/* ---- lines ---- */

static brace_status remember(train_log *log, const json_t *line, brace_error *error) {
    const json_t *epoch = json_object_get(line, "epoch"), *psnr = json_object_get(line, "psnr"), *loss = json_object_get(line, "loss");
    if (json_object_get(line, "kind") == NULL) {
        return BRACE_OK; /* a step */
    }
    if (log->epochs > 0 && log->epoch[log->epochs - 1].epoch == (uint64_t)json_integer_value(epoch)) {
        log->epochs--; /* an epoch's end that was cut off, and done again */
    }
    if (log->epochs == log->room) {
        const size_t room = log->room > 0 ? 2 * log->room : 64;
        struct train_epoch *more = core_calloc(room, sizeof *more);
        if (more == NULL) {
            return core_fail_memory(error, room * sizeof *more, "the log");
        }
        if (log->epoch != NULL) {
            memcpy(more, log->epoch, log->epochs * sizeof *more);
        }
        core_free(log->epoch);
        log->epoch = more;
        log->room = room;
    }
    log->epoch[log->epochs++] =
        (struct train_epoch){(uint64_t)json_integer_value(epoch),
                             json_is_number(loss) ? json_number_value(loss) : (double)NAN,
                             json_is_number(psnr) ? json_number_value(psnr) : (double)NAN};
    return BRACE_OK;
}

/* Copies the lines up to a step. */
static brace_status keep(train_log *log, const char *text, size_t size, uint64_t step, bool pending, FILE *to,
                         brace_error *error) {
    brace_status status = BRACE_OK;
    for (const char *at = text, *end;
         status == BRACE_OK && (end = memchr(at, '\n', size - (size_t)(at - text))) != NULL; at = end + 1) {
        json_t *line = json_loadb(at, (size_t)(end - at), 0, NULL);
        const json_t *number = json_object_get(line, "step");
        const bool of_epoch = json_object_get(line, "kind") != NULL;
        if (json_is_integer(number) && json_integer_value(number) >= 0 &&
            (uint64_t)json_integer_value(number) <= step - (pending && of_epoch)) {
            fwrite(at, 1, (size_t)(end - at) + 1, to);
            status = remember(log, line, error);
        }
        json_decref(line);
    }
    return status;
}

brace_status train_log_open(train_log *out, const char *path, uint64_t step, bool pending, brace_error *error) {
    *out = (train_log){.path = core_strdup(path)};
    if (out->path == NULL) {
        return core_fail_memory(error, strlen(path), "a name");
    }
    void *text = NULL;
    size_t size = 0;
    core_file *file = NULL;
    brace_status status =
        step > 0 && access(path, F_OK) == 0 ? core_file_load(&text, &size, path, LOG_LIMIT, error) : BRACE_OK;
    if (status == BRACE_OK) {
        status = core_file_create(&file, path, error);
    }
    if (status == BRACE_OK && text != NULL) {
        status = keep(out, text, size, step, pending, core_file_stream(file), error);
    }
    core_free(text);
    if (status == BRACE_OK) {
        status = core_file_commit(file, error);
    } else {
        core_file_abort(file);
    }
    if (status == BRACE_OK && (out->file = fopen(path, "ae")) == NULL) {
        status = core_fail(error, BRACE_ERROR_IO, "%s: cannot be written: %m", path);
    }
    if (status != BRACE_OK) {
        train_log_close(out);
    }
    return status;
}

void train_log_close(train_log *log) {
    if (log->file != NULL) {
        fclose(log->file);
    }
    core_free(log->path);
    core_free(log->epoch);
    *log = (train_log){0};
}

brace_status train_log_add(train_log *log, json_t *line, brace_error *error) {
    char *text = line != NULL ? json_dumps(line, JSON_COMPACT | JSON_REAL_PRECISION(8)) : NULL;
    brace_status status = text != NULL ? remember(log, line, error) : core_fail_memory(error, 1024, "the log");
    if (status == BRACE_OK && (fprintf(log->file, "%s\n", text) < 0 || fflush(log->file) != 0)) {
        status = core_fail(error, BRACE_ERROR_IO, "%s: cannot be written: %m", log->path);
    }
    free(text);
    json_decref(line);
    return status;
}

/* ---- the plot ---- */

enum { WIDE = 800, HIGH = 260, MARGIN = 12, PLOTS = 2 };
static const uint8_t grey[3] = {70, 70, 70}, light[3] = {224, 224, 224};
static const uint8_t colors[PLOTS][3] = {{240, 140, 60}, {90, 170, 240}};

static void line(brace_image *image, double x0, double y0, double x1, double y1, int thick, const uint8_t color[3]) {
    const int steps = (int)fmax(fabs(x1 - x0), fabs(y1 - y0)) + 1;
    for (int i = 0; i <= steps; i++) {
        for (int k = 0; k < thick * thick; k++) {
            const double x = x0 + (x1 - x0) * i / steps + k % thick, y = y0 + (y1 - y0) * i / steps + k / thick;
            if (x >= 0 && y >= 0 && x < image->width && y < image->height) {
                memcpy((uint8_t *)image->data + (size_t)y * image->stride + 3 * (size_t)x, color, 3);
            }
        }
    }
}

/* Loss is drawn by its logarithm. */
static double value(const struct train_epoch *e, int plot) {
    return plot == 0 ? log10(fmax(e->loss, 1e-9)) : e->psnr;
}

static void draw(brace_image *image, const train_log *log, int plot) {
    const double top = plot * HIGH + IMAGE_LABEL_HEIGHT + MARGIN, bottom = (plot + 1) * HIGH - MARGIN;
    double low = INFINITY, high = -INFINITY, last = NAN;
    for (size_t i = 0; i < log->epochs; i++) {
        const double v = value(&log->epoch[i], plot);
        if (isfinite(v)) {
            low = fmin(low, v), high = fmax(high, v), last = v;
        }
    }
    char text[80];
    if (!isfinite(low)) {
        snprintf(text, sizeof text, plot == 0 ? "loss: none" : "psnr: none");
        image_label(image, MARGIN, (uint32_t)(plot * HIGH), text, light);
        return;
    }
    const double first = (double)log->epoch[0].epoch, span = fmax(1, (double)log->epoch[log->epochs - 1].epoch - first);
    const double scale = (bottom - top) / fmax(high - low, 1e-9);
    if (plot == 0) {
        snprintf(text, sizeof text, "loss %.4g to %.4g, now %.4g", pow(10, high), pow(10, low), pow(10, last));
    } else {
        snprintf(text, sizeof text, "psnr %.2f to %.2f db, now %.2f", low, high, last);
    }
    image_label(image, MARGIN, (uint32_t)(plot * HIGH), text, colors[plot]);
    line(image, MARGIN, top, MARGIN, bottom, 1, grey);
    line(image, MARGIN, bottom, WIDE - MARGIN, bottom, 1, grey);
    double px = NAN, py = NAN;
    for (size_t i = 0; i < log->epochs; i++) {
        const double v = value(&log->epoch[i], plot);
        if (isfinite(v)) {
            const double x = MARGIN + ((double)log->epoch[i].epoch - first) / span * (WIDE - 2 * MARGIN);
            const double y = bottom - (v - low) * scale;
            line(image, isfinite(px) ? px : x, isfinite(py) ? py : y, x, y, 2, colors[plot]);
            px = x, py = y;
        }
    }
    snprintf(text, sizeof text, "epoch %.0f", first + (log->epochs > 1 ? span : 0));
    image_label(image, WIDE - MARGIN - image_label_width(text), (uint32_t)(plot * HIGH), text, light);
}

brace_status train_log_plot(const train_log *log, const char *path, const brace_job *job, brace_error *error) {
    brace_image *image = NULL;
    brace_status status =
        brace_image_create(&image, WIDE, PLOTS * HIGH, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, error);
    if (status != BRACE_OK) {
        return status;
    }
    memset(image->data, 24, image->stride * image->height);
    for (int plot = 0; plot < PLOTS; plot++) {
        draw(image, log, plot);
    }
    status = brace_image_write(image, path, NULL, job, error);
    brace_image_destroy(image);
    return status;
}
