/* SPDX-License-Identifier: Apache-2.0 */
/*
 * dataset_reduce.c: a mosaic made smaller without being demosaiced, and how far
 * two mosaics are shifted against each other.
 *
 * Every pixel of the result has the colour that the CFA gives its place, and is
 * a weighted sum of the samples of that colour around where its middle lies in
 * the original. The weights are a sinc that cuts at the Nyquist frequency of
 * the result's own colour planes, under a sinc window (Lanczos, a = 2), so that
 * stripes and pixel grids too fine for it disappear instead of turning into others.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sim/dataset.h"

enum { MOST_TAPS = 64 };

static double sinc(double x) {
    return fabs(x) < 1e-9 ? 1 : sin(3.14159265358979323846 * x) / (3.14159265358979323846 * x);
}

/* What one place of the result is made of, along one axis. */
typedef struct axis {
    int count;
    float weight[MOST_TAPS];
    uint32_t place[MOST_TAPS];
} axis;

/* Mirrored into [0, n) about the outermost samples; n is even, so that the colour stays. */
static uint32_t inside(int64_t i, int64_t n) {
    while (i < 0 || i >= n) {
        i = i < 0 ? -i : 2 * (n - 1) - i;
    }
    return (uint32_t)i;
}

static axis taps(uint32_t at, int factor, uint32_t size) {
    axis out = {.count = 0};
    double middle = ((double)at + 0.5) * factor - 0.5, sum = 0;
    double reach = 4.0 * factor; /* two periods of a colour plane of the result */
    int64_t x = (int64_t)ceil(middle - reach);
    for (x += (x & 1) != (int64_t)(at & 1); (double)x < middle + reach && out.count < MOST_TAPS; x += 2) {
        double d = ((double)x - middle) / (2.0 * factor), w = sinc(d) * sinc(d / 2);
        out.weight[out.count] = (float)w;
        out.place[out.count++] = inside(x, size);
        sum += w;
    }
    for (int i = 0; i < out.count; i++) {
        out.weight[i] = (float)((double)out.weight[i] / sum);
    }
    return out;
}

brace_status dataset_reduce(brace_frame **out, const brace_frame *frame, int factor, brace_error *error) {
    *out = NULL;
    if (factor < 1 || factor > 8) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "a frame can be reduced by 1 to 8, not by %d", factor);
    }
    uint32_t width = frame->width / (uint32_t)factor & ~1u, height = frame->height / (uint32_t)factor & ~1u;
    if (width < 22 || height < 22) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED, "a frame of %ux%u is too small to be reduced by %d",
                         frame->width, frame->height, factor);
    }
    brace_frame *made = NULL;
    brace_status status = brace_frame_create(&made, width, height, frame->cfa, error);
    float *rows = core_alloc((size_t)frame->height * width, sizeof *rows);
    if (status == BRACE_OK && rows == NULL) {
        status = core_fail_memory(error, (size_t)frame->height * width * sizeof *rows, "a smaller frame");
    }
    if (status == BRACE_OK) {
        uint16_t *data = made->data;
        char *path = made->path;
        *made = *frame;
        made->data = data;
        made->path = path;
        made->tags = NULL; /* what they say (sizes, lens corrections) is of the larger frame */
        made->width = width;
        made->height = height;
    }
    double shrunk = 0;
    axis *across = status == BRACE_OK ? core_alloc(width, sizeof *across) : NULL;
    if (status == BRACE_OK && across == NULL) {
        status = core_fail_memory(error, width * sizeof *across, "a smaller frame");
    }
    for (uint32_t x = 0; status == BRACE_OK && x < width; x++) {
        across[x] = taps(x, factor, frame->width & ~1u);
    }
    for (uint32_t y = 0; status == BRACE_OK && y < frame->height; y++) {
        const uint16_t *row = frame->data + (size_t)y * frame->width;
        for (uint32_t x = 0; x < width; x++) {
            const axis *t = &across[x];
            float sum = 0;
            for (int i = 0; i < t->count; i++) {
                sum += t->weight[i] * (float)row[t->place[i]];
            }
            rows[(size_t)y * width + x] = sum;
        }
    }
    for (uint32_t y = 0; status == BRACE_OK && y < height; y++) {
        const axis t = taps(y, factor, frame->height & ~1u);
        if (y == height / 2) {
            for (int i = 0; i < t.count; i++) {
                shrunk += (double)(t.weight[i] * t.weight[i]);
            }
        }
        for (uint32_t x = 0; x < width; x++) {
            float sum = 0;
            for (int i = 0; i < t.count; i++) {
                sum += t.weight[i] * rows[(size_t)t.place[i] * width + x];
            }
            made->data[(size_t)y * width + x] =
                (uint16_t)lrintf(sum < 0 ? 0 : sum > frame->white ? frame->white : sum);
        }
    }
    core_free(across);
    core_free(rows);
    if (status != BRACE_OK) {
        brace_frame_destroy(made);
        return status;
    }
    /* Means of many samples are less noisy, by the sum of the squared weights of both axes. */
    for (int c = 0; c < 3; c++) {
        made->noise[c][0] *= shrunk * shrunk;
        made->noise[c][1] *= shrunk * shrunk;
    }
    *out = made;
    return BRACE_OK;
}

/* ---- displacement ---- */

enum { BLOCK = 64, SEARCH = 8, BLOCKS = 8 };

/* Logarithm of the green light of each 2x2 block, each row less its running mean. What
 * multiplies a whole row, as banding does, is gone. */
static void features(float *out, const brace_frame *f) {
    uint32_t w = f->width / 2, h = f->height / 2;
    for (uint32_t y = 0; y < h; y++) {
        float *row = out + (size_t)y * w;
        for (uint32_t x = 0; x < w; x++) {
            double sum = 0;
            for (unsigned k = 0; k < 4; k++) {
                uint32_t px = 2 * x + (k & 1), py = 2 * y + (k >> 1);
                if (brace_cfa_color(f->cfa, px, py) == 1) {
                    sum += (double)(f->data[(size_t)py * f->width + px]) - (double)f->black[k];
                }
            }
            double range = 2.0 * ((double)f->white - (double)f->black[0]);
            row[x] = (float)log(fmax(sum / range, 0) + 0.02);
        }
        float mean = row[0];
        for (uint32_t x = 0; x < w; x++) { /* two passes of a recursive mean, there and back */
            mean += (row[x] - mean) * 0.1f;
            row[x] -= mean;
        }
        mean = row[w - 1];
        for (uint32_t x = w; x-- > 0;) {
            mean += (row[x] - mean) * 0.1f;
            row[x] -= mean;
        }
    }
}

/* Correlation of a block of `a` at (x, y) with `b` moved by (dx, dy). */
static double likeness(const float *a, const float *b, size_t w, size_t x, size_t y, int dx, int dy) {
    double ab = 0, aa = 0, bb = 0;
    for (size_t j = 0; j < BLOCK; j++) {
        const float *p = a + (y + j) * w + x, *q = b + (size_t)((int64_t)(y + j) + dy) * w + (size_t)((int64_t)x + dx);
        float sab = 0, saa = 0, sbb = 0;
        for (size_t i = 0; i < BLOCK; i++) {
            sab += p[i] * q[i];
            saa += p[i] * p[i];
            sbb += q[i] * q[i];
        }
        ab += (double)sab;
        aa += (double)saa;
        bb += (double)sbb;
    }
    return aa < BLOCK * BLOCK * 1e-4 || bb < BLOCK * BLOCK * 1e-4 ? 0 : ab / sqrt(aa * bb);
}

static double peak(double left, double middle, double right) {
    double bend = left - 2 * middle + right;
    return bend < -1e-12 ? 0.5 * (left - right) / bend : 0;
}

static double block_shift(const float *a, const float *b, size_t w, size_t x, size_t y) {
    double best = 0.4; /* less than this is no match */
    int bx = 0, by = 0;
    for (int dy = -SEARCH; dy <= SEARCH; dy++) {
        for (int dx = -SEARCH; dx <= SEARCH; dx++) {
            double l = likeness(a, b, w, x, y, dx, dy);
            if (l > best) {
                best = l;
                bx = dx;
                by = dy;
            }
        }
    }
    if (best <= 0.4) {
        return NAN;
    }
    if (abs(bx) == SEARCH || abs(by) == SEARCH) {
        return 2 * hypot(bx, by);
    }
    double fx = peak(likeness(a, b, w, x, y, bx - 1, by), best, likeness(a, b, w, x, y, bx + 1, by));
    double fy = peak(likeness(a, b, w, x, y, bx, by - 1), best, likeness(a, b, w, x, y, bx, by + 1));
    return 2 * hypot(bx + fx, by + fy);
}

static int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

double dataset_displacement(const brace_frame *fixed, const brace_frame *moved) {
    size_t w = fixed->width / 2, h = fixed->height / 2;
    if (moved->width != fixed->width || moved->height != fixed->height || w < BLOCK + 2 * SEARCH + 2 ||
        h < BLOCK + 2 * SEARCH + 2) {
        return NAN;
    }
    float *a = core_alloc(w * h, sizeof *a), *b = core_alloc(w * h, sizeof *b);
    double shifts[BLOCKS * BLOCKS];
    size_t n = 0;
    if (a != NULL && b != NULL) {
        features(a, fixed);
        features(b, moved);
        size_t nx = (w - 2 * SEARCH - 2) / BLOCK, ny = (h - 2 * SEARCH - 2) / BLOCK;
        nx = nx > BLOCKS ? BLOCKS : nx;
        ny = ny > BLOCKS ? BLOCKS : ny;
        for (size_t j = 0; j < ny; j++) {
            for (size_t i = 0; i < nx; i++) {
                size_t x = SEARCH + 1 + (nx > 1 ? i * (w - BLOCK - 2 * SEARCH - 2) / (nx - 1) : 0);
                size_t y = SEARCH + 1 + (ny > 1 ? j * (h - BLOCK - 2 * SEARCH - 2) / (ny - 1) : 0);
                double shift = block_shift(a, b, w, x, y);
                if (isfinite(shift)) {
                    shifts[n++] = shift;
                }
            }
        }
    }
    core_free(a);
    core_free(b);
    if (n == 0) {
        return NAN;
    }
    qsort(shifts, n, sizeof *shifts, by_value);
    return shifts[n / 2];
}
