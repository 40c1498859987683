/* SPDX-License-Identifier: Apache-2.0 */
/*
 * network.c: a bracket restored by a network, tile by tile, in as much memory as it may have. docs/restoring.md has the
 * measurements behind the sizes of tiles and their overlap.
 */
#include "restore/network.h"

#include <math.h>
#include <string.h>
#include <unistd.h>

/* Networks learn from exposures four times one another; these still look alike to them. */
static const double least_step = 2.8, most_step = 5.7;

bool restore_network_fits(const restore_network *n, const brace_bracket *b, char *why, size_t size) {
    if (b->count != (size_t)n->shape.frames) {
        snprintf(why, size, "%s takes brackets of %d frames, and this one has %zu", n->name, n->shape.frames, b->count);
        return false;
    }
    if (b->reference != (b->count - 1) / 2) {
        snprintf(why, size, "%s restores the frame of middle exposure, and another one is the reference", n->name);
        return false;
    }
    for (size_t i = 1; i < b->count; i++) {
        const double step = b->exposure[i] / b->exposure[i - 1];
        if (!(step >= least_step && step <= most_step)) {
            snprintf(why, size,
                     "%s takes brackets in which each exposure is about four times the one before (%.1f to %.1f "
                     "times), and here one is %.3g times",
                     n->name, least_step, most_step, step);
            return false;
        }
    }
    return true;
}

brace_status brace_model_check(const char *model, brace_error *error) {
    restore_network *n;
    brace_status status = restore_network_open(&n, model, error);
    if (status == BRACE_OK && n == NULL) {
        status = core_fail(error, BRACE_ERROR_IO, "no network's weights are installed (brace-s.safetensors)");
    }
    if (status == BRACE_OK) {
        status = restore_network_plan(n, RESTORE_TILE_LEAST, RESTORE_TILE_LEAST, BRACE_PRECISION_F32,
                                      &(brace_job){.threads = 1}, error);
    }
    restore_network_close(n);
    return status;
}

/* ---- memory ---- */

/* Bytes that the machine could give without others going short. */
static uint64_t free_memory(void) {
    FILE *f = fopen("/proc/meminfo", "r");
    char line[128];
    unsigned long long kib = 0;
    while (f != NULL && kib == 0 && fgets(line, sizeof line, f) != NULL) {
        sscanf(line, "MemAvailable: %llu kB", &kib);
    }
    if (f != NULL) {
        fclose(f);
    }
    if (kib == 0) {
        const long pages = sysconf(_SC_PHYS_PAGES), size = sysconf(_SC_PAGESIZE);
        return pages > 0 && size > 0 ? (uint64_t)pages / 2 * (uint64_t)size : (uint64_t)1 << 30;
    }
    return (uint64_t)kib << 10;
}

static uint64_t budget_of(const brace_restore_params *params) {
    if (params != NULL && params->memory > 0) {
        return params->memory;
    }
    const uint64_t half = free_memory() / 2, most = (uint64_t)1 << 30;
    return half < most ? half : most;
}

/* Weights as they are and as kernels have them, and the graph's buffers. */
static uint64_t needed(const restore_network *n) {
    uint64_t numbers = 0;
    for (size_t i = 0; i < nn_weights_count(n->weights); i++) {
        numbers += nn_weights_at(n->weights, i)->count;
    }
    return 2 * sizeof(float) * numbers + nn_graph_memory(n->graph);
}

/* The largest tiles that fit. */
static brace_status choose(restore_tiles *tiles, restore_network *n, int width, int height,
                           const brace_restore_params *params, const brace_job *job, brace_error *error) {
    const uint64_t budget = budget_of(params);
    const brace_precision precision = params != NULL ? params->precision : BRACE_PRECISION_DEFAULT;
    for (int side = RESTORE_TILE_MOST;;) {
        *tiles = restore_tiles_fit(width, height, side);
        brace_status status = restore_network_plan(n, tiles->across, tiles->down, precision, job, error);
        if (status != BRACE_OK && (status != BRACE_ERROR_MEMORY || side == RESTORE_TILE_LEAST)) {
            return status;
        }
        const uint64_t need = status == BRACE_OK ? needed(n) : 2 * budget;
        if (need <= budget) {
            return BRACE_OK;
        }
        if (side == RESTORE_TILE_LEAST) {
            return core_fail(error, BRACE_ERROR_MEMORY,
                             "%s needs %.0f MB for its smallest tiles, and may use %.0f MB; allow it more (--memory), "
                             "or merge",
                             n->name, ceil((double)need / 1e6), floor((double)budget / 1e6));
        }
        int smaller = (int)(side * sqrt((double)budget / (double)need));
        smaller = smaller < side - RESTORE_TILE_STEP ? smaller : side - RESTORE_TILE_STEP;
        smaller -= smaller % RESTORE_TILE_STEP;
        side = smaller > RESTORE_TILE_LEAST ? smaller : RESTORE_TILE_LEAST;
    }
}

/* ---- joining ---- */

typedef struct joined {
    float *mosaic;
    const brace_frame *frame; /* the reference */
    const float *result, *shown; /* {h, w, 4}; {h, w, 8}: the reference as the network saw it */
    int x, y, width, height;     /* the tile */
    const float *across, *down;  /* its share */
    float most;                  /* light that the shortest frame can hold */
    uint32_t *bad;               /* a count for each worker: no numbers */
} joined;

static void join_rows(void *arg, size_t begin, size_t end, int worker) {
    const joined *j = arg;
    const int64_t width = j->frame->width, height = j->frame->height;
    const int64_t left = 2 * (int64_t)j->x + restore_red_column(j->frame->cfa);
    const int64_t top = 2 * (int64_t)j->y + restore_red_row(j->frame->cfa);
    for (int64_t my = 2 * (int64_t)begin; my < 2 * (int64_t)end; my++) {
        const int64_t y = top + my;
        if (y < 0 || y >= height) {
            continue;
        }
        for (int64_t mx = left < 0 ? 1 : 0; mx < 2 * (int64_t)j->width && left + mx < width; mx++) {
            const float share = j->down[my / 2] * j->across[mx / 2];
            if (!(share > 0)) {
                continue;
            }
            const size_t at = 4 * (size_t)(my / 2 * j->width + mx / 2) + (size_t)(2 * (my & 1) + (mx & 1));
            float v = j->result[at];
            if (!isfinite(v)) {
                v = j->shown[2 * at];
                j->bad[worker]++;
            }
            j->mosaic[y * width + left + mx] += share * (v < -1 ? -1 : v > j->most ? j->most : v);
        }
    }
}

typedef struct work {
    const restore_motion *motion;
    float *guide; /* and its errors behind it, if the network is shown them */
    const float *sigma;
    restore_tiles tiles;
    float share[2][RESTORE_TILE_MOST]; /* along x and y */
    uint32_t bad[256];
} work;

static brace_status one_tile(work *w, restore_network *n, const brace_bracket *b, brace_restored *out, int column,
                             int row, core_pool *pool, brace_error *error) {
    const restore_tiles *t = &w->tiles;
    const restore_tile tile = {.bracket = b, .motion = w->motion, .guide = w->guide, .sigma = w->sigma,
                               .x = restore_tile_begin(t->width, t->across, t->columns, column),
                               .y = restore_tile_begin(t->height, t->down, t->rows, row)};
    brace_status status = restore_network_show(n, &tile, pool, error);
    if (status == BRACE_OK) {
        status = nn_forward(n->graph, error);
    }
    if (status == BRACE_OK) {
        restore_tile_share(w->share[0], t->width, t->across, t->columns, column);
        restore_tile_share(w->share[1], t->height, t->down, t->rows, row);
        joined j = {.mosaic = out->mosaic, .frame = b->frames[b->reference], .x = tile.x, .y = tile.y,
                    .result = nn_data(n->graph, n->output), .shown = nn_data(n->graph, n->inputs.frames),
                    .width = t->across, .height = t->down, .across = w->share[0], .down = w->share[1],
                    .most = (float)(1 / b->exposure[0]), .bad = w->bad};
        core_parallel(pool, (size_t)t->down, 8, join_rows, &j);
    }
    return status;
}

brace_status restore_network_run(brace_restored *out, restore_network *n, const brace_bracket *b,
                                 const restore_motion *motion, const brace_restore_params *params, const brace_job *job, core_pool *pool,
                                 brace_error *error) {
    const brace_frame *reference = b->frames[b->reference];
    const int width = ((int)reference->width - restore_red_column(reference->cfa) + 1) / 2;
    const int height = ((int)reference->height - restore_red_row(reference->cfa) + 1) / 2;
    brace_restore_report *report = &out->report;
    work *w = core_calloc(1, sizeof *w);
    if (w == NULL) {
        return core_fail_memory(error, sizeof *w, "tiles");
    }
    w->motion = motion;
    brace_status status = BRACE_OK;
    if (n->shape.guide) {
        const size_t count = (size_t)reference->width * reference->height;
        w->guide = core_alloc(n->shape.sigma ? 2 * count : count, sizeof *w->guide);
        float *sigma = w->guide != NULL && n->shape.sigma ? w->guide + count : NULL;
        w->sigma = sigma;
        status = w->guide != NULL ? restore_merge(w->guide, sigma, report, b, motion, job, pool, error)
                                  : core_fail_memory(error, count * sizeof *w->guide, "the merged picture");
    }
    const double start = core_seconds();
    if (status == BRACE_OK) {
        status = choose(&w->tiles, n, width, height, params, job, error);
    }
    const uint64_t count = (uint64_t)w->tiles.columns * (uint64_t)w->tiles.rows;
    memset(out->mosaic, 0, (size_t)reference->width * reference->height * sizeof *out->mosaic);
    for (uint64_t i = 0; i < count && status == BRACE_OK; i++) {
        core_progress(job, "restoring", i, count);
        status = core_check_cancel(job, error);
        if (status == BRACE_OK) {
            status = one_tile(w, n, b, out, (int)(i % (uint64_t)w->tiles.columns), (int)(i / (uint64_t)w->tiles.columns),
                              pool, error);
        }
    }
    if (status == BRACE_OK) {
        core_progress(job, "restoring", count, count);
        uint64_t bad = 0;
        for (size_t i = 0; i < sizeof w->bad / sizeof *w->bad; i++) {
            bad += w->bad[i];
        }
        if (bad > 0) {
            core_note(job, "%s gave no number for %llu pixels; they are those of the reference", n->name,
                      (unsigned long long)bad);
        }
        report->seconds_network = core_seconds() - start;
        report->tiles = (size_t)count;
        report->tile_width = 2 * w->tiles.across;
        report->tile_height = 2 * w->tiles.down;
        report->precision = n->type == NN_BF16 ? BRACE_PRECISION_BF16 : BRACE_PRECISION_F32;
        snprintf(report->model, sizeof report->model, "%s", n->name);
        snprintf(report->weights, sizeof report->weights, "%s", n->path);
        for (size_t i = 0; i < b->count; i++) {
            report->weight[i] = NAN; /* networks don't tell */
            report->banding[i] = n->shape.guide ? report->banding[i] : NAN;
        }
    }
    core_free(w->guide);
    core_free(w);
    return status;
}
