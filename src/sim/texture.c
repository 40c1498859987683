/* SPDX-License-Identifier: Apache-2.0 */
/* texture.c: screen content in linear light, as its panel shows it, and its mip pyramid (2x2 means), so that a far
 * screen is averaged, not sampled. */
#include <string.h>

#include "image/color.h"
#include "sim/rows.h"

void sim_texture_free(sim_texture *t) {
    for (int i = 0; i < t->levels; i++)
        core_free(t->level[i].rgb);
    t->levels = 0;
}

/* Memory for a level; one float more than its texels have, as they are read four at a time. */
static brace_status add_level(sim_texture *t, uint32_t width, uint32_t height, brace_error *error) {
    const size_t floats = (size_t)width * height * 3;
    float *rgb = core_alloc(floats + 1, sizeof *rgb);
    if (!rgb)
        return core_fail_memory(error, floats * sizeof *rgb, "the screen");
    rgb[floats] = 0;
    t->level[t->levels].rgb = rgb, t->level[t->levels].width = width, t->level[t->levels].height = height;
    t->levels++;
    return BRACE_OK;
}

void sim_texture_finish(sim_texture *t) {
    for (int l = 1; l < t->levels; l++) {
        const float *in = t->level[l - 1].rgb;
        float *rgb = t->level[l].rgb;
        const uint32_t w = t->level[l - 1].width, h = t->level[l - 1].height;
        const uint32_t width = t->level[l].width, height = t->level[l].height;
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
}

brace_status sim_texture_begin(sim_texture *out, uint32_t width, uint32_t height, brace_error *error) {
    *out = (sim_texture){.width = width, .height = height};
    brace_status status = BRACE_OK;
    while (out->levels < 16 && (status = add_level(out, width, height, error)) == BRACE_OK) {
        if (width == 1 && height == 1)
            break;
        width = width > 1 ? width / 2 : 1, height = height > 1 ? height / 2 : 1;
    }
    if (status != BRACE_OK)
        sim_texture_free(out);
    return status;
}

brace_status sim_texture_create(sim_texture *out, const brace_image *image, brace_error *error) {
    *out = (sim_texture){0};
    if ((uint64_t)image->width * image->height > SIM_SCREEN_PIXELS)
        return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                         "the screen has %ux%u pixels; displays of up to %d megapixels can be simulated", image->width,
                         image->height, SIM_SCREEN_PIXELS / 1000000);
    brace_image *linear;
    brace_status status = brace_image_convert(&linear, image, 3, BRACE_SAMPLE_F32, BRACE_TRANSFER_LINEAR, error);
    if (status != BRACE_OK)
        return status;
    status = sim_texture_begin(out, image->width, image->height, error);
    if (status == BRACE_OK) {
        float *rgb = out->level[0].rgb;
        for (uint32_t y = 0; y < image->height; y++) {
            const float *in = (const float *)((const char *)linear->data + y * linear->stride);
            for (size_t i = 0; i < 3 * (size_t)image->width; i++) { /* panels emit 0 to 1; NaN is black */
                float v = in[i] > 0 ? in[i] : 0;
                rgb[3 * (size_t)y * image->width + i] = v < 1 ? v : 1;
            }
        }
        sim_texture_finish(out);
    }
    brace_image_destroy(linear);
    return status;
}

/* A panel is never even: a smooth field (the backlight, the deposition of its layers) and every subpixel's own
 * deviation. A panel is driven so that its strongest subpixels just reach white: no gain is above 1. */
void sim_texture_uneven(sim_texture *texture, const sim_scene *scene, core_pool *pool) {
    sim_panel_job job = {
        .texture = texture, .scene = scene, .key = {(uint32_t)scene->seed, (uint32_t)(scene->seed >> 32)}};
    core_random r = core_random_create(scene->seed, scene->sample, PANEL_FIELD, 0);
    for (int i = 0; i < FIELD_ROWS * FIELD_COLUMNS; i++) {
        const float light = (float)core_random_range(&r, -1.7320508, 1.7320508); /* deviation 1 */
        for (int c = 0; c < 3; c++)
            job.field[i][c] = light + 0.3f * (float)core_random_range(&r, -1.7320508, 1.7320508);
    }
    core_parallel(pool, texture->height, 16, sim_rows_for(core_cpu_features())->panel_rows, &job);
    sim_texture_finish(texture);
}
