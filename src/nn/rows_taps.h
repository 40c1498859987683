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
    int y0 = (int)y, x0 = (int)x; /* rounded towards 0; y + 1 may round up to the row behind the last */
    y0 -= (T)y0 > y, x0 -= (T)x0 > x;
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
            NAME(eight) values = {0}, slopes_y = {0}, slopes_x = {0};
            for (size_t q = 0; q < p->parts; q++) {
                const T *g = (const T *)columns + nn_taps_column(p, q, tap);
                size_t start[4], i = 0;
                T w[4];
                for (int j = 0; j < 4; j++) {
                    start[j] = k.pixel[j] * p->channels + (p->first + q) * p->c;
                    w[j] = k.weight[j] * mask[tap];
                }
                for (; i + 8 <= p->c; i += 8) {
                    NAME(eight) gi, v = {0}, vy = {0}, vx = {0};
                    memcpy(&gi, g + i, sizeof gi);
                    for (int j = 0; j < 4; j++) {
                        NAME(eight) xi;
                        NAME(load_eight)(&xi, x + start[j] + i);
                        v += k.weight[j] * xi;
                        vy += k.dy[j] * xi;
                        vx += k.dx[j] * xi;
                    }
                    values += gi * v;
                    slopes_y += gi * vy;
                    slopes_x += gi * vx;
                    for (int j = 0; j < 4 && sums != NULL; j++) { /* corners may be the same pixel: one by one */
                        T *to = (T *)sums + start[j] + i;
                        NAME(eight) sum;
                        memcpy(&sum, to, sizeof sum);
                        sum += w[j] * gi;
                        memcpy(to, &sum, sizeof sum);
                    }
                }
                for (; i < p->c; i++) {
                    for (int j = 0; j < 4; j++) {
                        const T product = g[i] * LOAD(x[start[j] + i]);
                        value += k.weight[j] * product;
                        slope_y += k.dy[j] * product;
                        slope_x += k.dx[j] * product;
                        if (sums != NULL) {
                            ((T *)sums)[start[j] + i] += w[j] * g[i];
                        }
                    }
                }
            }
            value += NAME(sum_eight)(&values);
            slope_y += NAME(sum_eight)(&slopes_y);
            slope_x += NAME(sum_eight)(&slopes_x);
        }
        d_mask[tap] = value;
        d_offset[2 * tap] = slope_y * mask[tap];
        d_offset[2 * tap + 1] = slope_x * mask[tap];
    }
}
