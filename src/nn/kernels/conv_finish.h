/* SPDX-License-Identifier: Apache-2.0 */
/*
 * conv_finish.h: from sums to results: bias, residual, activation, rounding, with
 * the vectors of conv_vector.h and
 *
 *     vf_load_part(p, n), vf_store_part(p, v, n)    the first n lanes, 0 elsewhere
 *     vf_load_bf16(p, n), vf_store_bf16(p, v, n)    the same from and to bf16
 *     vf_add, vf_mul, vf_set, vf_max(a, b)          b where one is NaN
 */

ALWAYS_INLINE void finish_with(const nn_finish *f, const bool residual, const bool bf16, const nn_activation activation) {
    for (int o = 0; o < f->cols; o += LANES) {
        int n = f->cols - o < LANES ? f->cols - o : LANES;
        vf bias = f->bias != NULL ? vf_load_part(f->bias + o, n) : vf_zero();
        for (int i = 0; i < f->rows; i++) {
            ptrdiff_t at = i * f->y_row + o;
            vf v = vf_add(vf_load(f->c + i * 32 + o), bias);
            if (residual) {
                v = vf_add(v, bf16 ? vf_load_bf16((const uint16_t *)f->residual + at, n)
                                   : vf_load_part((const float *)f->residual + at, n));
            }
            if (activation == NN_RELU) {
                v = vf_max(vf_zero(), v);
            } else if (activation == NN_LEAKY_RELU) {
                v = vf_max(vf_mul(v, vf_set(0.1f)), v);
            }
            if (bf16) {
                vf_store_bf16((uint16_t *)f->y + at, v, n);
            } else {
                vf_store_part((float *)f->y + at, v, n);
            }
        }
    }
}

ALWAYS_INLINE void finish_activated(const nn_finish *f, const bool residual, const bool bf16) {
    switch (f->activation) {
    case NN_RELU:
        finish_with(f, residual, bf16, NN_RELU);
        break;
    case NN_LEAKY_RELU:
        finish_with(f, residual, bf16, NN_LEAKY_RELU);
        break;
    case NN_LINEAR:
        finish_with(f, residual, bf16, NN_LINEAR);
        break;
    default:
        nn_finish_plain(f);
        break;
    }
}

static void finish(const nn_finish *f) {
    if (f->result == NN_BF16) {
        if (f->residual != NULL) {
            finish_activated(f, true, true);
        } else {
            finish_activated(f, false, true);
        }
    } else if (f->residual != NULL) {
        finish_activated(f, true, false);
    } else {
        finish_activated(f, false, false);
    }
}
