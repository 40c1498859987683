/* SPDX-License-Identifier: Apache-2.0 */
/* texture.c: screen content in linear light and its mip pyramid (2x2 means), so that a far screen is averaged, not
 * sampled. */
#include <string.h>

#include "image/color.h"
#include "sim/simulate.h"

void sim_texture_free(sim_texture *t) {
    for (int i = 0; i < t->levels; i++)
        core_free(t->level[i].rgb);
    t->levels = 0;
}

brace_status sim_texture_create(sim_texture *out, const brace_image *image, brace_error *error) {
    *out = (sim_texture){.width = image->width, .height = image->height};
    if ((uint64_t)image->width * image->height > SIM_SCREEN_PIXELS)
        return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                         "the screen has %ux%u pixels; displays of up to %d megapixels can be simulated", image->width,
                         image->height, SIM_SCREEN_PIXELS / 1000000);
    brace_image *linear;
    brace_status status = brace_image_convert(&linear, image, 3, BRACE_SAMPLE_F32, BRACE_TRANSFER_LINEAR, error);
    if (status != BRACE_OK)
        return status;
    uint32_t width = image->width, height = image->height;
    for (int l = 0; l < 16; l++) {
        float *rgb = core_alloc((size_t)width * height * 3 + 1, sizeof(float)); /* one more: read four at a time */
        if (!rgb) {
            status = core_fail_memory(error, (size_t)width * height * 12, "the screen");
            break;
        }
        out->level[l].rgb = rgb, out->level[l].width = width, out->level[l].height = height;
        out->levels = l + 1;
        rgb[(size_t)width * height * 3] = 0;
        if (l == 0) {
            for (uint32_t y = 0; y < height; y++) {
                const float *in = (const float *)((const char *)linear->data + y * linear->stride);
                for (size_t i = 0; i < 3 * (size_t)width; i++) { /* panels emit 0 to 1; NaN is black */
                    float v = in[i] > 0 ? in[i] : 0;
                    rgb[3 * (size_t)y * width + i] = v < 1 ? v : 1;
                }
            }
        } else {
            const float *in = out->level[l - 1].rgb;
            const uint32_t w = out->level[l - 1].width, h = out->level[l - 1].height;
            for (uint32_t y = 0; y < height; y++)
                for (uint32_t x = 0; x < width; x++)
                    for (size_t c = 0; c < 3; c++) {
                        uint32_t x1 = 2 * x + 1 < w ? 2 * x + 1 : w - 1, y1 = 2 * y + 1 < h ? 2 * y + 1 : h - 1;
                        size_t a = (size_t)(2 * y < h ? 2 * y : h - 1) * w, b = (size_t)y1 * w,
                               x0 = 2 * x < w ? 2 * x : w - 1;
                        rgb[3 * ((size_t)y * width + x) + c] = 0.25f * (in[3 * (a + x0) + c] + in[3 * (a + x1) + c] +
                                                                        in[3 * (b + x0) + c] + in[3 * (b + x1) + c]);
                    }
        }
        if (width == 1 && height == 1)
            break;
        width = width > 1 ? width / 2 : 1, height = height > 1 ? height / 2 : 1;
    }
    brace_image_destroy(linear);
    if (status != BRACE_OK)
        sim_texture_free(out);
    return status;
}
