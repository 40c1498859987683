/* SPDX-License-Identifier: Apache-2.0 */
/*
 * profile.c: banding's light told from one frame alone.
 *
 * A rolling shutter gives all pixels of a row the same light, so banding changes
 * the logarithm of all of them by the same step from row to row; content changes
 * few of them at a time (glyphs begin and end, the paper between stays, and the
 * edges of a screen that stands askew cross a row at one place only). The median
 * of the steps is the step of the light (Weiss, Deriving intrinsic images from
 * image sequences, ICCV 2001, with pixels in the place of frames).
 */
#include <math.h>

#include "banding/profile.h"
#include "raw/isp.h"

enum { FEWEST = 12 }; /* pixels that a median needs */

/* Samples nearer to white than this may be clipped. */
static const float clipped = 0.95f;

brace_status banding_profile_create(banding_profile *out, size_t rows, size_t columns, brace_error *error) {
    *out = (banding_profile){.rows = rows, .columns = columns, .at = core_alloc(rows * BANDING_ZONES, sizeof(float))};
    return out->at ? BRACE_OK : core_fail_memory(error, rows * BANDING_ZONES * sizeof(float), "the rows' light");
}

void banding_profile_free(banding_profile *profile) {
    core_free(profile->at);
    profile->at = NULL;
}

/* The k-th smallest of a, which is reordered (Hoare's selection). */
static float select_kth(float *a, size_t n, size_t k) {
    size_t low = 0, high = n - 1;
    while (low < high) {
        float pivot = a[(low + high) / 2];
        size_t i = low, j = high;
        for (;;) {
            while (a[i] < pivot)
                i++;
            while (a[j] > pivot)
                j--;
            if (i >= j)
                break;
            float t = a[i];
            a[i++] = a[j], a[j--] = t;
        }
        if (a[j] > pivot)
            j--;
        if (k <= j)
            high = j;
        else
            low = j + 1;
    }
    return a[k];
}

void banding_profile_evenness(const banding_profile *profile, double *uneven, double *noise) {
    const size_t rows = profile->rows;
    float *smooth = core_alloc(2 * rows, sizeof *smooth), *rest = smooth + rows;
    double weight = 0;
    *uneven = *noise = 0;
    for (size_t z = 0; z < BANDING_ZONES && smooth; z++) {
        size_t n = 0;
        for (size_t y = 0; y < rows; y++) {
            float window[5];
            size_t k = 0;
            for (size_t j = y < 2 ? 0 : y - 2; j <= y + 2 && j < rows; j++)
                if (!isnan(profile->at[j * BANDING_ZONES + z]))
                    window[k++] = profile->at[j * BANDING_ZONES + z];
            const float here = profile->at[y * BANDING_ZONES + z];
            if (k < 3 || isnan(here))
                continue;
            smooth[n] = select_kth(window, k, k / 2);
            rest[n] = fabsf(here - smooth[n]), n++;
        }
        if (n < rows / 4 + 8)
            continue;
        const double low = select_kth(smooth, n, n / 10), high = select_kth(smooth, n, n - 1 - n / 10);
        *uneven += profile->weight[z] * 0.5 * (high - low);
        *noise += profile->weight[z] * select_kth(rest, n, n / 2);
        weight += profile->weight[z];
    }
    if (weight > 0)
        *uneven /= weight, *noise /= weight;
    core_free(smooth);
}

typedef struct profile_job {
    banding_profile *out;
    const brace_frame *frame;
    float *scratch; /* 3*columns for each worker */
    float dark;     /* below this a sample is mostly noise */
} profile_job;

/* Mean of the packed samples of a row; -1 where one clips. */
static void packed_row(float *row, const brace_frame *f, size_t y, size_t columns) {
    const uint16_t *top = f->data + 2 * y * f->width, *bottom = top + f->width;
    for (size_t x = 0; x < columns; x++) {
        const uint16_t raw[4] = {top[2 * x], top[2 * x + 1], bottom[2 * x], bottom[2 * x + 1]};
        float sum = 0, most = 0;
        for (int c = 0; c < 4; c++) {
            float s = ((float)raw[c] - f->black[c]) / (f->white - f->black[c]);
            sum += s, most = s > most ? s : most;
        }
        row[x] = most < clipped ? 0.25f * sum : -1;
    }
}

static void step_rows(void *arg, size_t begin, size_t end, int worker) {
    const profile_job *job = arg;
    const size_t columns = job->out->columns;
    float *above = job->scratch + (size_t)worker * 3 * columns, *here = above + columns, *samples = here + columns;
    for (size_t y = begin; y < end; y++) {
        packed_row(above, job->frame, y ? y - 1 : 0, columns);
        packed_row(here, job->frame, y, columns);
        for (size_t z = 0; z < BANDING_ZONES; z++) {
            const size_t first = columns * z / BANDING_ZONES, last = columns * (z + 1) / BANDING_ZONES;
            size_t n = 0;
            for (size_t x = first; x < last; x++)
                if (here[x] > job->dark && above[x] > job->dark)
                    samples[n++] = here[x];
            float step = NAN;
            if (n >= FEWEST) {
                /* Ink is not asked: only pixels near the brightest quarter of their row. */
                const float paper = 0.7f * select_kth(samples, n, n * 3 / 4);
                n = 0;
                for (size_t x = first; x < last; x++)
                    if (here[x] > job->dark && above[x] > job->dark && here[x] + above[x] > 2 * paper)
                        samples[n++] = logf(here[x] / above[x]);
                step = n >= FEWEST ? select_kth(samples, n, n / 2) : NAN;
            }
            job->out->at[y * BANDING_ZONES + z] = step;
        }
    }
}

brace_status banding_profile_frame(banding_profile *out, const brace_frame *frame, core_pool *pool,
                                   brace_error *error) {
    out->at = NULL;
    brace_status status = raw_check_frame(frame, error);
    if (status == BRACE_OK)
        status = banding_profile_create(out, frame->height / 2, frame->width / 2, error);
    if (status != BRACE_OK)
        return status;
    profile_job job = {.out = out, .frame = frame};
    job.dark = 2 * (float)sqrt(fmax(0.25 * frame->noise[1][1], 0));
    job.scratch = core_alloc((size_t)core_pool_threads(pool) * 3 * out->columns, sizeof(float));
    if (!job.scratch) {
        banding_profile_free(out);
        return core_fail_memory(error, 3 * out->columns * sizeof(float), "the rows' light");
    }
    core_parallel(pool, out->rows, 16, step_rows, &job);
    size_t told = 0;
    for (size_t z = 0; z < BANDING_ZONES; z++) {
        double sum = 0;
        for (size_t y = 0; y < out->rows; y++) {
            float *p = &out->at[y * BANDING_ZONES + z];
            const bool known = !isnan(*p);
            sum += known ? *p : 0, told += known;
            *p = known ? (float)sum : NAN;
        }
    }
    out->covered = (double)told / (double)(out->rows * BANDING_ZONES);
    out->steps = true;
    for (size_t z = 0; z < BANDING_ZONES; z++)
        out->weight[z] = 1;
    core_free(job.scratch);
    return BRACE_OK;
}
