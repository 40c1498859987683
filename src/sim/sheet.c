/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sheet.c: a capture at a glance. Above: the frames, shortest first, made equally
 * bright, with their exposure times, and the truth last. Below: the light of a
 * white, a grey and a dark subpixel in the middle of the screen, red, green and
 * blue curves of one over the other, for the length of the readout.
 */
#include "sim/sheet.h"

#include <math.h>
#include <string.h>

#include "brace/develop.h"
#include "image/label.h"

enum { TILE = 400, GAP = 6, STRIP = 90 };

static uint8_t *pixel(brace_image *image, uint32_t x, uint32_t y) {
    return (uint8_t *)image->data + y * image->stride + 3 * (size_t)x;
}

static void write_text(brace_image *image, uint32_t x, uint32_t y, const char *text) {
    image_label(image, x, y, text, (const uint8_t[3]){224, 224, 224});
}

static void paste(brace_image *sheet, const brace_image *tile, uint32_t x, uint32_t y) {
    for (uint32_t row = 0; row < tile->height && y + row < sheet->height; row++)
        memcpy(pixel(sheet, x, y + row), (const char *)tile->data + row * tile->stride, 3 * (size_t)tile->width);
}

static brace_status add_frame(brace_image *sheet, const brace_frame *frame, double ev, uint32_t width, uint32_t height,
                              uint32_t x, uint32_t y, const brace_job *job, brace_error *error) {
    brace_image *full = NULL, *small = NULL;
    brace_develop_params params = {.exposure = ev, .sample = BRACE_SAMPLE_U8, .as_stored = true};
    brace_status status = brace_develop(&full, frame, &params, job, error);
    if (status == BRACE_OK)
        status = brace_image_resize(&small, full, width, height, error);
    if (status == BRACE_OK)
        paste(sheet, small, x, y);
    brace_image_destroy(full), brace_image_destroy(small);
    return status;
}

/* One level's waveform: columns from the lowest to the highest light within each column's time. */
static void add_waveform(brace_image *sheet, const sim_panel *panel, uint32_t sx, uint32_t sy, double level,
                         double length, uint32_t top) {
    double highest = 1e-9;
    enum { PART = 16 };
    for (int pass = 0; pass < 2; pass++)
        for (int c = 0; c < 3; c++)
            for (uint32_t x = GAP; x + GAP < sheet->width; x++) {
                double low = INFINITY, high = 0;
                for (int p = 0; p < PART; p++) {
                    double t = length * ((double)(x - GAP) + (p + 0.5) / PART) / (double)(sheet->width - 2 * GAP);
                    double e = sim_panel_emission(panel, sx, sy, c, level, t);
                    e = isfinite(e) ? e : 0;
                    low = fmin(low, e), high = fmax(high, e);
                }
                highest = fmax(highest, high);
                if (pass == 0)
                    continue;
                uint32_t from = top + STRIP - 8 - (uint32_t)((STRIP - 16) * high / highest);
                uint32_t to = top + STRIP - 8 - (uint32_t)((STRIP - 16) * low / highest);
                for (uint32_t y = from; y <= to; y++) {
                    uint8_t *p = pixel(sheet, x, y);
                    p[c] = 255;
                    p[(c + 1) % 3] = p[(c + 1) % 3] > 60 ? p[(c + 1) % 3] : 60;
                }
            }
}

brace_status sim_sheet(brace_image **out, const sim_capture *capture, const sim_panel *panel, const sim_scene *scene,
                       const sim_camera *camera, uint32_t screen_width, uint32_t screen_height, const brace_job *job,
                       brace_error *error) {
    const uint32_t count = (uint32_t)capture->count + 1, columns = (count + 1) / 2;
    const uint32_t high = (uint32_t)fmax(1, (double)TILE * scene->height / scene->width);
    brace_image *sheet = NULL;
    brace_status status = brace_image_create(&sheet, columns * (TILE + GAP) + GAP, 2 * (high + GAP) + GAP + 3 * STRIP,
                                             3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, error);
    if (status != BRACE_OK)
        return status;
    for (uint32_t y = 0; y < sheet->height; y++)
        memset(pixel(sheet, 0, y), 24, 3 * (size_t)sheet->width);
    for (uint32_t i = 0; i < count && status == BRACE_OK; i++) {
        bool truth = i + 1 == count;
        double ev = truth ? 0 : -2.0 * ((double)i - capture->count / 2);
        const brace_frame *frame = truth ? capture->truth : capture->frame[i];
        const uint32_t x = GAP + i % columns * (TILE + GAP), y = GAP + i / columns * (high + GAP);
        status = add_frame(sheet, frame, ev, TILE, high, x, y, job, error);
        char label[32] = "truth";
        if (!truth && frame->exposure_time < 0.3)
            snprintf(label, sizeof label, "1/%.0f s", 1 / frame->exposure_time);
        else if (!truth)
            snprintf(label, sizeof label, "%.2g s", frame->exposure_time);
        if (status == BRACE_OK)
            write_text(sheet, x, y, label);
    }
    static const double levels[3] = {1, 0.2, 0.02};
    for (uint32_t i = 0; i < 3 && status == BRACE_OK; i++) {
        static const char *const names[3] = {"white", "20 %", "2 %"};
        const uint32_t top = 2 * (high + GAP) + GAP + i * STRIP;
        add_waveform(sheet, panel, screen_width / 2, screen_height / 2, levels[i], camera->readout, top);
        write_text(sheet, GAP, top, names[i]);
        char length[32];
        snprintf(length, sizeof length, "%.3g ms", 1000 * camera->readout);
        write_text(sheet, sheet->width - GAP - 12 * (uint32_t)strlen(length) - 6, top, length);
    }
    if (status == BRACE_OK)
        *out = sheet;
    else
        brace_image_destroy(sheet);
    return status;
}
