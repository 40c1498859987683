/* SPDX-License-Identifier: Apache-2.0 */
/* rows_taps.h: the sampling of deformable convolution for one pixel and one offset group, and its gradients; included
 * by rows_typed.h for each type. Eight channels are one vector; what is left over is done one by one. */

/* A tap's four corners; those outside the picture have weight 0 and lie somewhere inside. */
typedef struct NAME(tap) {
    size_t pixel[4];
    T weight[4], dy[4], dx[4];
} NAME(tap);

/* False: all four are outside. */
static inline bool NAME(find_tap)(const nn_taps *p, const T *offset, int tap, T y, T x, NAME(tap) * k) {
    y += (T)(tap / 3 * p->dilation) + offset[2 * tap];
    x += (T)(tap % 3 * p->dilation) + offset[2 * tap + 1];
    if (!(y > -1 && y < (T)p->h && x > -1 && x < (T)p->w)) { /* NaN too */
        return false;
    }
    const int y0 = (int)(y + 1) - 1, x0 = (int)(x + 1) - 1;
    const T fy = y - (T)y0, fx = x - (T)x0;
    /* A row or column outside counts as 0. */
    const T top = y0 >= 0 ? 1 : 0, bottom = y0 + 1 < p->h ? 1 : 0, left = x0 >= 0 ? 1 : 0,
            right = x0 + 1 < p->w ? 1 : 0;
    const size_t ya = (size_t)(y0 >= 0 ? y0 : 0) * (size_t)p->w,
                 yb = (size_t)(y0 + 1 < p->h ? y0 + 1 : y0) * (size_t)p->w, xa = (size_t)(x0 >= 0 ? x0 : 0),
                 xb = (size_t)(x0 + 1 < p->w ? x0 + 1 : x0);
    k->pixel[0] = ya + xa, k->pixel[1] = ya + xb, k->pixel[2] = yb + xa, k->pixel[3] = yb + xb;
    const T wy0 = (1 - fy) * top, wy1 = fy * bottom, wx0 = (1 - fx) * left, wx1 = fx * right;
    k->weight[0] = wy0 * wx0, k->weight[1] = wy0 * wx1, k->weight[2] = wy1 * wx0, k->weight[3] = wy1 * wx1;
    k->dy[0] = -top * wx0, k->dy[1] = -top * wx1, k->dy[2] = bottom * wx0, k->dy[3] = bottom * wx1;
    k->dx[0] = -left * wy0, k->dx[1] = right * wy0, k->dx[2] = -left * wy1, k->dx[3] = right * wy1;
    return true;
}

typedef T NAME(eight) __attribute__((vector_size(8 * sizeof(T))));

static inline void NAME(load_eight)(NAME(eight) * v, const S *p) {
    T t[8];
    for (int i = 0; i < 8; i++) {
        t[i] = LOAD(p[i]);
    }
    memcpy(v, t, sizeof t);
}

static inline T NAME(sum_eight)(const NAME(eight) * p) {
    T v[8];
    memcpy(v, p, sizeof v);
    return ((v[0] + v[4]) + (v[2] + v[6])) + ((v[1] + v[5]) + (v[3] + v[7]));
}

static void NAME(taps_sample)(const nn_taps *p, const void *picture, const void *offsets, const void *masks, double py,
                              double px, void *columns) {
    const S *x = picture;
    const T *offset = offsets, *mask = masks;
    for (int tap = 0; tap < 9; tap++) {
        NAME(tap) k;
        const bool inside = NAME(find_tap)(p, offset, tap, (T)py, (T)px, &k);
        for (size_t q = 0; q < p->parts; q++) {
            T *to = (T *)columns + nn_taps_column(p, q, tap);
            if (!inside) {
                memset(to, 0, p->c * sizeof *to);
                continue;
            }
            const S *at = x + (p->first + q) * p->c, *a = at + k.pixel[0] * p->channels,
                    *b = at + k.pixel[1] * p->channels, *c = at + k.pixel[2] * p->channels,
                    *d = at + k.pixel[3] * p->channels;
            const T wa = k.weight[0] * mask[tap], wb = k.weight[1] * mask[tap], wc = k.weight[2] * mask[tap],
                    wd = k.weight[3] * mask[tap];
            size_t i = 0;
            for (; i + 8 <= p->c; i += 8) {
                NAME(eight) va, vb, vc, vd;
                NAME(load_eight)(&va, a + i);
                NAME(load_eight)(&vb, b + i);
                NAME(load_eight)(&vc, c + i);
                NAME(load_eight)(&vd, d + i);
                const NAME(eight) v = (wa * va + wb * vb) + (wc * vc + wd * vd);
                memcpy(to + i, &v, sizeof v);
            }
            for (; i < p->c; i++) {
                to[i] = (wa * LOAD(a[i]) + wb * LOAD(b[i])) + (wc * LOAD(c[i]) + wd * LOAD(d[i]));
            }
        }
    }
}

/* columns: their gradient. sums: d loss/d picture, NULL: not wanted. */
static void NAME(taps_back)(const nn_taps *p, const void *picture, const void *offsets, const void *masks, double py,
                            double px, const void *columns, void *sums, void *d_offsets, void *d_masks) {
    const S *x = picture;
    const T *offset = offsets, *mask = masks;
    T *d_offset = d_offsets, *d_mask = d_masks;
    for (int tap = 0; tap < 9; tap++) {
        NAME(tap) k;
        T value = 0, slope_y = 0, slope_x = 0;
        if (NAME(find_tap)(p, offset, tap, (T)py, (T)px, &k)) {
            T dot[4] = {0, 0, 0, 0};
            NAME(eight) dots[4] = {{0}, {0}, {0}, {0}};
            for (size_t q = 0; q < p->parts; q++) {
                const T *g = (const T *)columns + nn_taps_column(p, q, tap);
                for (int j = 0; j < 4; j++) {
                    const size_t start = k.pixel[j] * p->channels + (p->first + q) * p->c;
                    const S *at = x + start;
                    const T w = k.weight[j] * mask[tap];
                    T *to = sums != NULL ? (T *)sums + start : NULL;
                    size_t i = 0;
                    for (; i + 8 <= p->c; i += 8) {
                        NAME(eight) gi, xi, sum;
                        memcpy(&gi, g + i, sizeof gi);
                        NAME(load_eight)(&xi, at + i);
                        dots[j] += gi * xi;
                        if (to != NULL) {
                            memcpy(&sum, to + i, sizeof sum);
                            sum += w * gi;
                            memcpy(to + i, &sum, sizeof sum);
                        }
                    }
                    for (; i < p->c; i++) {
                        dot[j] += g[i] * LOAD(at[i]);
                        if (to != NULL) {
                            to[i] += w * g[i];
                        }
                    }
                }
            }
            for (int j = 0; j < 4; j++) {
                dot[j] += NAME(sum_eight)(&dots[j]);
                value += k.weight[j] * dot[j];
                slope_y += k.dy[j] * dot[j];
                slope_x += k.dx[j] * dot[j];
            }
        }
        d_mask[tap] = value;
        d_offset[2 * tap] = slope_y * mask[tap];
        d_offset[2 * tap + 1] = slope_x * mask[tap];
    }
}
