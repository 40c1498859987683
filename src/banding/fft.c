/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fft.c: the discrete Fourier transform of any length, at the cost of a good one.
 *
 * KissFFT is fast for lengths of factors 2, 3 and 5. Of the others,
 *   - a length with a small remaining factor q (7, 11, 13, 49: photographs are
 *     often 4032 wide) is split into q transforms of length M = n/q, joined by
 *         X[k] = sum_j e^(-2 pi i j k/n) X_j[k mod M]         (Cooley-Tukey);
 *   - any other goes by Bluestein's identity jk = (j^2 + k^2 - (k-j)^2)/2, which
 *     turns it into a convolution of a longer, good length.
 * KissFFT's own butterfly for other factors is not used: it allocates, and prints when it cannot.
 */
#include <math.h>
#include <string.h>

#include <kiss_fft.h>

#include "banding/banding.h"

enum { SPLIT_MAX = 32 };

struct banding_fft {
    size_t length;
    size_t factor;         /* 1: KissFFT alone, 2 .. SPLIT_MAX: split, 0: Bluestein */
    size_t inner;          /* length of KissFFT's transforms */
    kiss_fft_cfg forward, inverse; /* of `inner`; inverse for Bluestein only */
    kiss_fft_cpx *twiddle; /* split: e^(-2 pi i m/n); Bluestein: e^(-pi i m^2/n) */
    kiss_fft_cpx *kernel;  /* Bluestein: transform of the conjugate chirp, divided by `inner` */
};

/* What is left of n without its factors 2, 3 and 5. */
static size_t remainder_of(size_t n) {
    static const size_t factors[] = {2, 3, 5};
    for (int i = 0; i < 3; i++)
        while (n % factors[i] == 0)
            n /= factors[i];
    return n;
}

static kiss_fft_cfg kiss_create(size_t n, int inverse) {
    size_t bytes = 0;
    kiss_fft_alloc((int)n, inverse, NULL, &bytes);
    void *memory = core_alloc(bytes, 1);
    return memory ? kiss_fft_alloc((int)n, inverse, memory, &bytes) : NULL;
}

static kiss_fft_cpx unit(double turns) {
    return (kiss_fft_cpx){(float)cos(2 * M_PI * turns), (float)-sin(2 * M_PI * turns)};
}

static inline kiss_fft_cpx times(kiss_fft_cpx a, kiss_fft_cpx b) {
    return (kiss_fft_cpx){a.r * b.r - a.i * b.i, a.r * b.i + a.i * b.r};
}

static bool bluestein_kernel(banding_fft *fft) {
    const size_t n = fft->length, m = fft->inner;
    kiss_fft_cpx *chirp = core_calloc(m, sizeof *chirp);
    if (!chirp)
        return false;
    for (size_t j = 0; j < n; j++) {
        /* j^2 mod 2n keeps the angle exact for any length. */
        size_t square = (size_t)((uint64_t)j * j % (2 * (uint64_t)n));
        fft->twiddle[j] = unit((double)square / (2 * (double)n));
        kiss_fft_cpx c = {fft->twiddle[j].r / (float)m, -fft->twiddle[j].i / (float)m};
        chirp[j] = c;
        if (j > 0)
            chirp[m - j] = c;
    }
    kiss_fft(fft->forward, chirp, fft->kernel);
    core_free(chirp);
    return true;
}

brace_status banding_fft_create(banding_fft **out, size_t length, brace_error *error) {
    if (length < 1 || length > (size_t)1 << 24)
        return core_fail(error, BRACE_ERROR_ARGUMENT, "a transform of length %zu is outside 1 to 2^24", length);
    banding_fft *fft = core_calloc(1, sizeof *fft);
    if (!fft)
        return core_fail_memory(error, sizeof *fft, "a spectrum");
    fft->length = length;
    size_t rest = remainder_of(length);
    fft->factor = rest <= SPLIT_MAX ? rest : 0;
    if (fft->factor > 0)
        fft->inner = length / fft->factor;
    else
        for (fft->inner = 2 * length - 1; remainder_of(fft->inner) != 1; fft->inner++)
            continue;
    fft->forward = kiss_create(fft->inner, 0);
    bool good = fft->forward != NULL;
    if (good && fft->factor != 1) {
        fft->twiddle = core_alloc(length, sizeof *fft->twiddle);
        good = fft->twiddle != NULL;
    }
    if (good && fft->factor > 1)
        for (size_t m = 0; m < length; m++)
            fft->twiddle[m] = unit((double)m / (double)length);
    if (good && fft->factor == 0) {
        fft->inverse = kiss_create(fft->inner, 1);
        fft->kernel = core_alloc(fft->inner, sizeof *fft->kernel);
        good = fft->inverse && fft->kernel && bluestein_kernel(fft);
    }
    if (!good) {
        banding_fft_destroy(fft);
        return core_fail_memory(error, length * 2 * sizeof *fft->twiddle, "a spectrum");
    }
    *out = fft;
    return BRACE_OK;
}

void banding_fft_destroy(banding_fft *fft) {
    if (!fft)
        return;
    core_free(fft->forward), core_free(fft->inverse), core_free(fft->twiddle), core_free(fft->kernel);
    core_free(fft);
}

size_t banding_fft_scratch(const banding_fft *fft) {
    return fft->factor == 1 ? 1 : fft->factor ? fft->length : 2 * fft->inner;
}

static void run_split(const banding_fft *fft, const kiss_fft_cpx *in, kiss_fft_cpx *out, kiss_fft_cpx *part) {
    const size_t q = fft->factor, m = fft->inner;
    for (size_t j = 0; j < q; j++)
        kiss_fft_stride(fft->forward, in + j, part + j * m, (int)q);
    for (size_t k = 0; k < m; k++) {
        kiss_fft_cpx turned[SPLIT_MAX];
        for (size_t j = 0; j < q; j++)
            turned[j] = times(part[j * m + k], fft->twiddle[j * k]);
        for (size_t r = 0; r < q; r++) {
            kiss_fft_cpx sum = turned[0];
            for (size_t j = 1, at = r; j < q; j++, at = at + r < q ? at + r : at + r - q) {
                kiss_fft_cpx t = times(turned[j], fft->twiddle[at * m]);
                sum.r += t.r, sum.i += t.i;
            }
            out[r * m + k] = sum;
        }
    }
}

static void run_bluestein(const banding_fft *fft, const kiss_fft_cpx *in, kiss_fft_cpx *out, kiss_fft_cpx *scratch) {
    const size_t n = fft->length, m = fft->inner;
    kiss_fft_cpx *a = scratch, *b = scratch + m;
    for (size_t j = 0; j < n; j++)
        a[j] = times(in[j], fft->twiddle[j]);
    memset(a + n, 0, (m - n) * sizeof *a);
    kiss_fft(fft->forward, a, b);
    for (size_t k = 0; k < m; k++)
        b[k] = times(b[k], fft->kernel[k]);
    kiss_fft(fft->inverse, b, a);
    for (size_t k = 0; k < n; k++)
        out[k] = times(a[k], fft->twiddle[k]);
}

void banding_fft_run(const banding_fft *fft, const banding_complex *in, banding_complex *out,
                     banding_complex *scratch) {
    _Static_assert(sizeof(banding_complex) == sizeof(kiss_fft_cpx), "both are two floats");
    const kiss_fft_cpx *from = (const kiss_fft_cpx *)(const void *)in;
    kiss_fft_cpx *to = (kiss_fft_cpx *)(void *)out, *work = (kiss_fft_cpx *)(void *)scratch;
    if (fft->factor == 1)
        kiss_fft(fft->forward, from, to);
    else if (fft->factor > 1)
        run_split(fft, from, to, work);
    else
        run_bluestein(fft, from, to, work);
}
