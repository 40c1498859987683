/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ref_body.h: the reference convolution, for one type. Included by ref.c, which says what is stored (REF_T), how
 * it is read and written (REF_GET, REF_PUT), what sums are made in (REF_A) and how functions are named.
 */

typedef struct REF(run) {
    const nn_conv_shape *s;
    const nn_conv_pass *pass;
    const REF_A *packed;
    bool f32_result;
} REF(run);

/* [kernel][kernel][c][out], or with c and out swapped: the inner loops run along the last. */
static void REF(pack)(REF_A *packed, const REF_A *weight, const nn_conv_shape *s, bool swapped) {
    size_t taps = (size_t)s->kernel * (size_t)s->kernel, c = (size_t)s->c, out = (size_t)s->out;
    for (size_t o = 0; o < out; o++) {
        for (size_t i = 0; i < c; i++) {
            for (size_t t = 0; t < taps; t++) {
                packed[swapped ? (t * out + o) * c + i : (t * c + i) * out + o] = REF_ROUND(weight[(o * c + i) * taps + t]);
            }
        }
    }
}

static void REF(finish)(const REF(run) *run, REF_A *sum, size_t at) {
    const nn_conv_pass *p = run->pass;
    for (int o = 0; o < run->s->out; o++) {
        size_t i = at + (size_t)o;
        REF_A v = sum[o];
        if (p->residual != NULL) {
            v += run->f32_result ? (REF_A)((const float *)p->residual)[i] : REF_GET(((const REF_T *)p->residual)[i]);
        }
        v = (REF_A)ref_activate((double)v, p->activation);
        if (run->f32_result) {
            ((float *)p->y)[i] = (float)v;
        } else {
            ((REF_T *)p->y)[i] = REF_PUT(v);
        }
    }
}

static void REF(forward_rows)(void *arg, size_t begin, size_t end, int worker) {
    const REF(run) *run = arg;
    const nn_conv_shape *s = run->s;
    const REF_T *x = run->pass->x;
    const REF_A *bias = run->pass->bias;
    REF_A *sum = (REF_A *)run->pass->scratch + (size_t)worker * ref_line(s);
    for (size_t row = begin; row < end; row++) {
        size_t n = row / (size_t)s->oh;
        int oy = (int)(row % (size_t)s->oh);
        for (int ox = 0; ox < s->ow; ox++) {
            for (int o = 0; o < s->out; o++) {
                sum[o] = bias != NULL ? bias[o] : 0;
            }
            for (int i = 0; i < s->kernel; i++) {
                int y = oy * s->stride + i - s->pad;
                for (int j = 0; j < s->kernel && y >= 0 && y < s->h; j++) {
                    int xx = ox * s->stride + j - s->pad;
                    if (xx < 0 || xx >= s->w) {
                        continue;
                    }
                    const REF_T *in = x + ((n * (size_t)s->h + (size_t)y) * (size_t)s->w + (size_t)xx) * (size_t)s->c;
                    const REF_A *w = run->packed + (size_t)(i * s->kernel + j) * (size_t)s->c * (size_t)s->out;
                    for (int c = 0; c < s->c; c++, w += s->out) {
                        REF_A v = REF_GET(in[c]);
                        for (int o = 0; o < s->out; o++) {
                            sum[o] += v * w[o];
                        }
                    }
                }
            }
            REF(finish)(run, sum, (row * (size_t)s->ow + (size_t)ox) * (size_t)s->out);
        }
    }
}

static void REF(data_rows)(void *arg, size_t begin, size_t end, int worker) {
    const REF(run) *run = arg;
    const nn_conv_shape *s = run->s;
    const REF_T *dz = run->pass->dz;
    REF_T *dx = run->pass->dx;
    REF_A *sum = (REF_A *)run->pass->scratch + (size_t)worker * ref_line(s);
    for (size_t row = begin; row < end; row++) {
        size_t n = row / (size_t)s->h;
        int y = (int)(row % (size_t)s->h);
        for (int x = 0; x < s->w; x++) {
            memset(sum, 0, (size_t)s->c * sizeof *sum);
            for (int i = 0; i < s->kernel; i++) {
                int oy = y + s->pad - i;
                if (oy < 0 || oy % s->stride != 0 || oy / s->stride >= s->oh) {
                    continue;
                }
                for (int j = 0; j < s->kernel; j++) {
                    int ox = x + s->pad - j;
                    if (ox < 0 || ox % s->stride != 0 || ox / s->stride >= s->ow) {
                        continue;
                    }
                    size_t p = (n * (size_t)s->oh + (size_t)(oy / s->stride)) * (size_t)s->ow + (size_t)(ox / s->stride);
                    const REF_T *g = dz + p * (size_t)s->out;
                    const REF_A *w = run->packed + (size_t)(i * s->kernel + j) * (size_t)s->c * (size_t)s->out;
                    for (int o = 0; o < s->out; o++, w += s->c) {
                        REF_A v = REF_GET(g[o]);
                        for (int c = 0; c < s->c; c++) {
                            sum[c] += v * w[c];
                        }
                    }
                }
            }
            REF_T *to = dx + (row * (size_t)s->w + (size_t)x) * (size_t)s->c;
            for (int c = 0; c < s->c; c++) {
                to[c] = REF_PUT(run->pass->add ? sum[c] + REF_GET(to[c]) : sum[c]);
            }
        }
    }
}

/* A piece is one tap and input channel: it goes over all pixels by itself, so nothing has to be put together. */
static void REF(weights_of)(void *arg, size_t begin, size_t end, int worker) {
    const REF(run) *run = arg;
    const nn_conv_shape *s = run->s;
    const REF_T *x = run->pass->x, *dz = run->pass->dz;
    REF_A *dw = run->pass->dw;
    double *sum = (double *)run->pass->scratch + (size_t)worker * ref_line(s);
    size_t taps = (size_t)s->kernel * (size_t)s->kernel;
    for (size_t piece = begin; piece < end; piece++) {
        size_t c = piece / taps, t = piece % taps;
        int i = (int)t / s->kernel, j = (int)t % s->kernel;
        memset(sum, 0, (size_t)s->out * sizeof *sum);
        for (size_t row = 0; row < (size_t)s->n * (size_t)s->oh; row++) {
            int y = (int)(row % (size_t)s->oh) * s->stride + i - s->pad;
            if (y < 0 || y >= s->h) {
                continue;
            }
            const REF_T *in = x + (row / (size_t)s->oh * (size_t)s->h + (size_t)y) * (size_t)s->w * (size_t)s->c + c;
            for (int ox = 0; ox < s->ow; ox++) {
                int xx = ox * s->stride + j - s->pad;
                if (xx < 0 || xx >= s->w) {
                    continue;
                }
                double v = (double)REF_GET(in[(size_t)xx * (size_t)s->c]);
                const REF_T *g = dz + (row * (size_t)s->ow + (size_t)ox) * (size_t)s->out;
                for (int o = 0; o < s->out; o++) {
                    sum[o] += v * (double)REF_GET(g[o]);
                }
            }
        }
        for (int o = 0; o < s->out; o++) {
            dw[((size_t)o * (size_t)s->c + c) * taps + t] += (REF_A)sum[o];
        }
    }
}

static void REF(pass)(ref_state *state, const nn_conv_pass *pass, nn_product which) {
    const nn_conv_shape *s = &state->shape;
    REF(run) run = {s, pass, state->packed, state->types.result != state->types.in};
    switch (which) {
    case NN_PRODUCT_FORWARD:
        REF(pack)(state->packed, pass->weight, s, false);
        core_parallel(pass->pool, (size_t)s->n * (size_t)s->oh, 1, REF(forward_rows), &run);
        break;
    case NN_PRODUCT_DATA:
        REF(pack)(state->packed, pass->weight, s, true);
        core_parallel(pass->pool, (size_t)s->n * (size_t)s->h, 1, REF(data_rows), &run);
        break;
    case NN_PRODUCT_WEIGHTS:
        core_parallel(pass->pool, (size_t)s->c * (size_t)s->kernel * (size_t)s->kernel, 1, REF(weights_of), &run);
        break;
    }
}

#undef REF
#undef REF_T
#undef REF_A
#undef REF_GET
#undef REF_PUT
#undef REF_ROUND
