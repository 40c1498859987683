/* SPDX-License-Identifier: Apache-2.0 */
/*
 * gradient_body.h: dz = dy act'(y) for pixels of f32 and bf16, with its sums.
 * Included by conv_gradient.c and gradient_*.c, each compiled for its instruction
 * set; GRADIENT is the function's name.
 */
#include <string.h>

enum { LINE = 64 /* channels at a time */, PART = 64 /* pixels whose sum is f32 before it is added to a double */ };

static inline void load(float *to, const void *from, size_t at, size_t count, nn_type type) {
    if (type == NN_BF16) {
        const uint16_t *v = (const uint16_t *)from + at;
        for (size_t i = 0; i < count; i++) {
            to[i] = nn_from_bf16(v[i]);
        }
    } else {
        memcpy(to, (const float *)from + at, count * sizeof *to);
    }
}

static inline void store(void *to, size_t at, const float *from, size_t count, nn_type type, bool add) {
    float sum[LINE];
    if (add) {
        load(sum, to, at, count, type);
        for (size_t i = 0; i < count; i++) {
            sum[i] += from[i];
        }
        from = sum;
    }
    if (type == NN_BF16) {
        uint16_t *v = (uint16_t *)to + at;
        for (size_t i = 0; i < count; i++) {
            v[i] = nn_to_bf16(from[i]);
        }
    } else {
        memcpy((float *)to + at, from, count * sizeof *from);
    }
}

static inline void times_derivative(float *dz, const float *y, size_t count, nn_activation activation) {
    switch (activation) {
    case NN_LINEAR:
        break;
    case NN_RELU:
        for (size_t i = 0; i < count; i++) {
            dz[i] = y[i] > 0 ? dz[i] : 0;
        }
        break;
    case NN_LEAKY_RELU:
        for (size_t i = 0; i < count; i++) {
            dz[i] = y[i] > 0 ? dz[i] : 0.1f * dz[i];
        }
        break;
    case NN_SIGMOID:
        for (size_t i = 0; i < count; i++) {
            dz[i] *= y[i] * (1 - y[i]);
        }
        break;
    case NN_TANH:
        for (size_t i = 0; i < count; i++) {
            dz[i] *= 1 - y[i] * y[i];
        }
        break;
    }
}

void GRADIENT(const nn_gradient *g, size_t begin, size_t end, double *sums) {
    size_t channels = (size_t)g->channels;
    for (size_t first = begin; first < end; first += PART) {
        size_t last = end - first < PART ? end : first + PART;
        for (size_t c = 0; c < channels; c += LINE) {
            size_t count = channels - c < LINE ? channels - c : LINE;
            float part[LINE] = {0}, dz[LINE], y[LINE];
            for (size_t p = first; p < last; p++) {
                size_t at = p * channels + c;
                load(dz, g->dy, at, count, g->types.result);
                if (g->activation != NN_LINEAR) {
                    load(y, g->y, at, count, g->types.result);
                    times_derivative(dz, y, count, g->activation);
                }
                if (g->dz != NULL) {
                    store(g->dz, at, dz, count, g->types.in, false);
                }
                if (g->residual != NULL) {
                    store(g->residual, at, dz, count, g->types.result, g->add_residual);
                }
                for (size_t i = 0; i < count; i++) {
                    part[i] += dz[i];
                }
            }
            for (size_t i = 0; i < count; i++) {
                sums[c + i] += (double)part[i];
            }
        }
    }
}
