/* SPDX-License-Identifier: Apache-2.0 */
/*
 * validate.c: how good a network is, on samples that it never learns from: PSNR,
 * SSIM and SFC of developed crops, and the crops themselves to look at.
 */
#include <math.h>
#include <string.h>

#include "brace/banding.h"
#include "brace/develop.h"
#include "image/label.h"
#include "metrics/metrics.h"
#include "train/train.h"

enum { GAP = 6, ROWS = 8, PARTS = 3 };

/* Packed RAW to a picture. */
static brace_status develop(brace_image **out, const float *packed, size_t stride, const train_sample *s,
                            const brace_job *job, brace_error *error) {
    const size_t side = 2 * (size_t)s->side;
    float *mosaic = core_alloc(side * side, sizeof *mosaic);
    if (mosaic == NULL) {
        return core_fail_memory(error, side * side * sizeof *mosaic, "a picture");
    }
    for (size_t y = 0; y < side; y++) {
        for (size_t x = 0; x < side; x++) {
            const float v = packed[((y / 2 * (size_t)s->side + x / 2) * 4 + (y & 1) * 2 + (x & 1)) * stride];
            mosaic[y * side + x] = isfinite(v) ? fmaxf(-1, fminf(v, 1)) : 0;
        }
    }
    const brace_develop_params params = {
        .sample = BRACE_SAMPLE_F32, .transfer = BRACE_TRANSFER_SRGB, .as_stored = true};
    brace_status status = brace_develop_linear(out, mosaic, s->look, &params, job, error);
    core_free(mosaic);
    return status;
}

static brace_status score(train_scores *sum, const brace_image *picture, const brace_image *truth, double direction,
                          const brace_job *job, brace_error *error) {
    double psnr = 0, ssim = 0;
    brace_sfc sfc = {0};
    brace_status status = metrics_psnr(&psnr, picture, truth, job, error);
    if (status == BRACE_OK) {
        status = metrics_ssim(&ssim, picture, truth, job, error);
    }
    if (status == BRACE_OK) {
        status = brace_sfc_image(&sfc, picture, truth, direction, NULL, job, error);
    }
    if (status == BRACE_OK) {
        sum->psnr += fmin(psnr, 100); /* equal pictures */
        sum->ssim += ssim;
        sum->sfc += sfc.sfc;
    }
    return status;
}

static void divide(train_scores *s, int count) {
    s->psnr /= count, s->ssim /= count, s->sfc /= count, s->loss /= count;
}

brace_status train_validation_create(train_validation *out, const train_config *config, const brace_job *job,
                                     brace_error *error) {
    *out = (train_validation){0};
    if (config->validation_samples == 0) {
        return BRACE_OK;
    }
    train_source_params params = config->data;
    params.test = true, params.mirrored = params.transposed = false, params.crops = 1; /* each of another bracket, upright */
    train_source *source = NULL;
    brace_status status = train_source_create(&source, &params, job, error);
    if (status == BRACE_OK) {
        out->samples = core_calloc((size_t)config->validation_samples, sizeof *out->samples);
        status = out->samples != NULL
                     ? BRACE_OK
                     : core_fail_memory(error, (size_t)config->validation_samples * sizeof *out->samples, "samples");
    }
    for (int i = 0; i < config->validation_samples && status == BRACE_OK; i++) {
        core_progress(job, "preparing the validation", (uint64_t)i, (uint64_t)config->validation_samples);
        train_sample *s = &out->samples[i];
        status = train_sample_create(s, params.frames + params.guide, params.side, error);
        if (status == BRACE_OK) {
            out->count = i + 1;
            status = train_source_get(source, (uint64_t)i, 1, s, job != NULL ? job->cancel : NULL, error);
        }
        brace_image *picture[2] = {NULL, NULL};
        if (status == BRACE_OK) {
            status = develop(&picture[0], s->input, 2, s, job, error);
        }
        if (status == BRACE_OK) {
            status = develop(&picture[1], s->truth, 1, s, job, error);
        }
        if (status == BRACE_OK) {
            status = score(&out->before, picture[0], picture[1], s->direction, job, error);
        }
        brace_image_destroy(picture[0]);
        brace_image_destroy(picture[1]);
    }
    train_source_destroy(source);
    if (status != BRACE_OK) {
        train_validation_free(out);
        return status;
    }
    core_progress(job, "preparing the validation", (uint64_t)out->count, (uint64_t)out->count);
    divide(&out->before, out->count);
    return BRACE_OK;
}

void train_validation_free(train_validation *v) {
    for (int i = 0; i < v->count; i++) {
        train_sample_free(&v->samples[i]);
    }
    core_free(v->samples);
    *v = (train_validation){0};
}

static brace_status paste(brace_image *sheet, const brace_image *picture, int row, int column, const char *text,
                          brace_error *error) {
    brace_image *small = NULL;
    brace_status status = brace_image_convert(&small, picture, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, error);
    if (status != BRACE_OK) {
        return status;
    }
    const uint32_t x = GAP + (uint32_t)column * (small->width + GAP), y = GAP + (uint32_t)row * (small->height + GAP);
    for (uint32_t i = 0; i < small->height; i++) {
        memcpy((uint8_t *)sheet->data + (y + i) * sheet->stride + 3 * (size_t)x,
               (const uint8_t *)small->data + i * small->stride, 3 * (size_t)small->width);
    }
    image_label(sheet, x, y, text, (const uint8_t[3]){224, 224, 224});
    brace_image_destroy(small);
    return BRACE_OK;
}

static brace_status one(train_scores *sum, const train_sample *s, train_network *network, brace_image *sheet, int row,
                        const brace_job *job, brace_error *error) {
    double parts[TRAIN_PARTS];
    brace_image *picture[PARTS] = {NULL, NULL, NULL};
    brace_status status = train_network_run(network, s, parts, error);
    const float *const from[PARTS] = {s->input, nn_data(network->graph, network->prediction), s->truth};
    for (int k = 0; k < PARTS && status == BRACE_OK; k++) {
        status = develop(&picture[k], from[k], k == 0 ? 2 : 1, s, job, error);
    }
    if (status == BRACE_OK) {
        sum->loss += parts[0];
        status = score(sum, picture[1], picture[2], s->direction, job, error);
    }
    for (int k = 0; k < PARTS && status == BRACE_OK && sheet != NULL && row < ROWS; k++) {
        char text[32] = "truth";
        double psnr = 0;
        if (k < 2) {
            status = metrics_psnr(&psnr, picture[k], picture[2], job, error);
            snprintf(text, sizeof text, k == 0 ? "in %.1f" : "out %.1f", fmin(psnr, 100));
        }
        if (status == BRACE_OK) {
            status = paste(sheet, picture[k], row, k, text, error);
        }
    }
    for (int k = 0; k < PARTS; k++) {
        brace_image_destroy(picture[k]);
    }
    return status;
}

brace_status train_validate(train_scores *out, const train_validation *v, train_network *network, const char *path,
                            const brace_job *job, brace_error *error) {
    *out = (train_scores){0};
    brace_image *sheet = NULL;
    brace_status status = BRACE_OK;
    if (path != NULL) {
        const uint32_t side = 2 * (uint32_t)v->samples[0].side, rows = (uint32_t)(v->count < ROWS ? v->count : ROWS);
        status = brace_image_create(&sheet, GAP + PARTS * (side + GAP), GAP + rows * (side + GAP), 3, BRACE_SAMPLE_U8,
                                    BRACE_TRANSFER_SRGB, error);
    }
    for (int i = 0; i < v->count && status == BRACE_OK; i++) {
        status = one(out, &v->samples[i], network, sheet, i, job, error);
    }
    if (status == BRACE_OK && sheet != NULL) {
        status = brace_image_write(sheet, path, NULL, job, error);
    }
    brace_image_destroy(sheet);
    divide(out, v->count > 0 ? v->count : 1);
    return status;
}
