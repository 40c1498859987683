/* SPDX-License-Identifier: Apache-2.0 */
/*
 * crop.c: crops of mosaics, mirrored and transposed, that stay RGGB.
 *
 * A mirrored mosaic has another order of colours: RGGB becomes GRBG. The packed
 * planes cannot simply be mirrored either: R of a block lies left of its G, and
 * would come to lie right of it, half a packed pixel off. So the crop is chosen in
 * the mosaic: going left from a red pixel, colours come in the same order as going
 * right from one. A transposed RGGB mosaic is RGGB, its two greens exchanged.
 */
#include "train/sample.h"

/* How many positions there are along an axis of n pixels; *first: the lowest. `red`: parity of red pixels. */
static uint32_t positions(uint32_t *first, uint32_t n, uint32_t side, uint32_t red, bool flip) {
    const uint32_t low = flip ? 2 * side - 1 : 0, high = flip ? n - 1 : n - 2 * side;
    *first = low + ((low ^ red) & 1);
    return (high - *first) / 2 + 1;
}

train_window train_window_draw(core_random *random, const train_bracket *bracket, int side, bool mirrored,
                               bool transposed) {
    const brace_cfa cfa = bracket->frame[0].cfa;
    const uint32_t turn = (mirrored ? core_random_below(random, 4) : 0) + (transposed ? 4 * core_random_below(random, 2) : 0);
    train_window out = {.flip_x = turn & 1, .flip_y = turn & 2, .transpose = turn & 4};
    uint32_t first;
    const uint32_t columns =
        positions(&first, bracket->width, (uint32_t)side, cfa == BRACE_CFA_GRBG || cfa == BRACE_CFA_BGGR, out.flip_x);
    out.x0 = first + 2 * core_random_below(random, columns);
    const uint32_t rows =
        positions(&first, bracket->height, (uint32_t)side, cfa == BRACE_CFA_GBRG || cfa == BRACE_CFA_BGGR, out.flip_y);
    out.y0 = first + 2 * core_random_below(random, rows);
    return out;
}

/* Where in the mosaic sample (x, y) of the crop lies. */
typedef struct place {
    size_t x, y;
} place;

static place place_of(const train_window *w, ptrdiff_t x, ptrdiff_t y) {
    const ptrdiff_t right = w->transpose ? y : x, down = w->transpose ? x : y;
    return (place){(size_t)((ptrdiff_t)w->x0 + (w->flip_x ? -right : right)),
                   (size_t)((ptrdiff_t)w->y0 + (w->flip_y ? -down : down))};
}

void train_crop(float *out, const train_view *view, uint32_t width, const train_window *window, int side) {
    float scale[4];
    for (int i = 0; i < 4; i++) {
        scale[i] = view->gain / (view->white - view->black[i]);
    }
    for (ptrdiff_t y = 0; y < 2 * side; y++) {
        for (ptrdiff_t x = 0; x < 2 * side; x++) {
            const place at = place_of(window, x, y);
            const size_t site = (at.y & 1) * 2 + (at.x & 1);
            out[((y / 2) * side + x / 2) * 4 + (y & 1) * 2 + (x & 1)] =
                ((float)view->data[at.y * width + at.x] - view->black[site]) * scale[site];
        }
    }
}

void train_crop_guide(float *light, float *sigma, const train_bracket *b, const train_window *window, int side) {
    for (ptrdiff_t y = 0; y < 2 * side; y++) {
        for (ptrdiff_t x = 0; x < 2 * side; x++) {
            const place at = place_of(window, x, y);
            const size_t from = at.y * b->width + at.x;
            const ptrdiff_t to = ((y / 2) * side + x / 2) * 4 + (y & 1) * 2 + (x & 1);
            light[to] = train_guide_light(b->guide[from]);
            sigma[to] = train_sigma_value(b->sigma[from]);
        }
    }
}
