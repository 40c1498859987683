/* SPDX-License-Identifier: Apache-2.0 */
/* eval_sheet.c: a picture of pictures: a row for each sample that is shown, as shot, by each method, and the truth. */
#include "cli/eval.h"

#include <ctype.h>
#include <math.h>
#include <string.h>

#include "image/label.h"

enum { GAP = 6 };

/* The font has digits and small letters. */
static void write_text(brace_image *sheet, uint32_t x, uint32_t y, const char *text) {
    char small[64];
    size_t n = 0;
    for (; text[n] != '\0' && n + 1 < sizeof small; n++) {
        small[n] = (char)tolower((unsigned char)text[n]);
    }
    small[n] = '\0';
    image_label(sheet, x, y, small, (const uint8_t[3]){224, 224, 224});
}

/* As wide as `width`, no higher than `height`. */
static brace_status paste(brace_image *sheet, const brace_image *picture, uint32_t x, uint32_t y, uint32_t width,
                          uint32_t height, brace_error *error) {
    const double scale = fmin((double)width / picture->width, (double)height / picture->height);
    const uint32_t w = (uint32_t)fmax(1, floor(picture->width * scale)), h = (uint32_t)fmax(1, floor(picture->height * scale));
    brace_image *small = NULL;
    brace_status status = brace_image_resize(&small, picture, w, h, error);
    for (uint32_t row = 0; row < h && status == BRACE_OK; row++) {
        memcpy((uint8_t *)sheet->data + (y + row) * sheet->stride + 3 * (size_t)x,
               (const uint8_t *)small->data + row * small->stride, 3 * (size_t)w);
    }
    brace_image_destroy(small);
    return status;
}

/* Of a sample's pictures on the sheet; upright ones are cut down to twice their width. */
static uint32_t height_of(const eval_sample *s, uint32_t side) {
    const double h = ceil((double)side * s->picture[0]->height / s->picture[0]->width);
    return (uint32_t)fmax(IMAGE_LABEL_HEIGHT, fmin(h, 2.0 * side));
}

brace_status eval_sheet(const eval_set *set, const char *path, uint32_t side, const brace_job *job, brace_error *error) {
    uint32_t columns = 0, height = GAP, shown[EVAL_METHODS + 2];
    for (uint32_t k = 0; k < set->methods + 2; k++) {
        if (eval_has_picture(set, k)) {
            shown[columns++] = k;
        }
    }
    for (size_t i = 0; i < set->count; i++) {
        const eval_sample *s = &set->items[i];
        if (s->shown && s->picture[0] != NULL) {
            height += height_of(s, side) + GAP;
        }
    }
    if (height == GAP) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%s: no sample was measured that it could show", path);
    }
    brace_image *sheet = NULL;
    brace_status status = brace_image_create(&sheet, GAP + columns * (side + GAP), height, 3, BRACE_SAMPLE_U8,
                                             BRACE_TRANSFER_SRGB, error);
    for (uint32_t y = 0; status == BRACE_OK && y < sheet->height; y++) {
        memset((uint8_t *)sheet->data + y * sheet->stride, 24, 3 * (size_t)sheet->width);
    }
    uint32_t y = GAP;
    for (size_t i = 0; i < set->count && status == BRACE_OK; i++) {
        const eval_sample *s = &set->items[i];
        if (!s->shown || s->picture[0] == NULL) {
            continue;
        }
        const uint32_t tall = height_of(s, side);
        for (uint32_t column = 0; column < columns && status == BRACE_OK; column++) {
            const uint32_t x = GAP + column * (side + GAP), k = shown[column];
            if (s->picture[k] == NULL) {
                continue;
            }
            status = paste(sheet, s->picture[k], x, y, side, tall, error);
            char text[96];
            if (k == 0) {
                snprintf(text, sizeof text, "input %.1f", fmin(s->reference_psnr, 100));
            } else if (column + 1 == columns) {
                snprintf(text, sizeof text, "truth");
            } else {
                snprintf(text, sizeof text, "%.24s %.1f", set->method[k - 1].label,
                         fmin(s->result[k - 1].measured.value[PSNR], 100));
            }
            write_text(sheet, x, y, text);
            if (k == 0) {
                write_text(sheet, x, y + tall - IMAGE_LABEL_HEIGHT, s->steady ? "flicker-free" : s->family);
            }
        }
        y += tall + GAP;
    }
    if (status == BRACE_OK) {
        status = brace_image_write(sheet, path, NULL, job, error);
    }
    brace_image_destroy(sheet);
    return status;
}
