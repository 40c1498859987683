/* SPDX-License-Identifier: Apache-2.0 */
/*
 * dataset_build.c: a set from a seed. Which screen, display and camera a sample
 * has depends on its number only, so any part of a set can be made anywhere:
 * after an interruption, in shards, in any order, with any number of threads.
 * Samples are made side by side, each by one thread.
 */
#include <limits.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "sim/data_path.h"
#include "sim/dataset.h"
#include "sim/dataset_priors.h"
#include "sim/dataset_screens.h"

typedef struct plan {
    char *name;
    const dataset_screen *screen;
    uint32_t sample;
} plan;

typedef struct builder {
    const char *out;
    const dataset_build_params *params;
    dataset_make_fn *make;
    uint32_t width, height;
    dataset_priors *priors;
    dataset_screens screens;
    plan *plans;
    size_t count;     /* of the whole set */
    uint32_t *scratch;
    const brace_job *job;
    size_t first, mine; /* where those to be made begin, and how many of them this process makes */
    atomic_size_t made, there;
    atomic_int failed;
    pthread_mutex_t lock;
    brace_status status; /* the first failure, and its error: under the lock */
    brace_error error;
} builder;

/* ---- the plan ---- */

static brace_status plan_all(builder *b, brace_error *error) {
    const dataset_build_params *p = b->params;
    b->plans = core_calloc(b->count, sizeof *b->plans);
    b->scratch = core_alloc(b->screens.count, sizeof *b->scratch);
    if (b->plans == NULL || b->scratch == NULL) {
        return core_fail_memory(error, b->count * sizeof *b->plans, "the plan of a set");
    }
    for (size_t i = 0; i < b->count; i++) {
        bool test = i >= p->train;
        uint32_t n = (uint32_t)(test ? i - p->train : i);
        plan *s = &b->plans[i];
        s->screen = dataset_screens_pick(&b->screens, test, p->seed, n, b->scratch);
        s->sample = test ? DATASET_TEST_SAMPLE + n : n;
        char name[64];
        snprintf(name, sizeof name, "%s/%06u_%s", test ? "test" : "train", n, s->screen->category);
        s->name = core_strdup(name);
        if (s->name == NULL) {
            return core_fail_memory(error, sizeof name, "a name");
        }
    }
    return BRACE_OK;
}

/* Everything that decides what the set is: the same for every shard. */
static json_t *index_json(const builder *b) {
    json_t *names = json_array();
    for (size_t i = 0; i < b->count; i++) {
        json_array_append_new(names, json_string(b->plans[i].name));
    }
    /* Seeds use all 64 bits; JSON's integers are signed. */
    char seed[32];
    snprintf(seed, sizeof seed, "%llu", (unsigned long long)b->params->seed);
    return json_pack("{s:s, s:s, s:I, s:I, s:i, s:i, s:b, s:o, s:o, s:o}", "format", DATASET_FORMAT, "seed", seed,
                     "train", (json_int_t)b->params->train, "test", (json_int_t)b->params->test, "width",
                     (int)b->width, "height", (int)b->height, "field", (int)b->params->field, "priors",
                     dataset_priors_json(b->priors), "screens", dataset_screens_json(&b->screens), "samples", names);
}

/* Writes dataset.json, or makes sure that the one that is there says the same. */
static brace_status settle_index(const builder *b, brace_error *error) {
    json_t *index = index_json(b), *old = NULL;
    char *path = dataset_path(b->out, "dataset.json");
    brace_status status = index != NULL && path != NULL
                              ? dataset_json_load(&old, path, DATASET_INDEX_LIMIT, error)
                              : core_fail_memory(error, 4096, "dataset.json");
    if (status == BRACE_OK && old == NULL) {
        status = dataset_json_save(index, path, error);
    } else if (status == BRACE_OK) {
        const char *key;
        json_t *value;
        json_object_foreach(index, key, value) {
            /* Numbers lose their last bits in text: compared as they are written. */
            char *a = json_dumps(value, JSON_ENCODE_ANY | JSON_REAL_PRECISION(14) | JSON_SORT_KEYS);
            char *c = json_dumps(json_object_get(old, key), JSON_ENCODE_ANY | JSON_REAL_PRECISION(14) | JSON_SORT_KEYS);
            bool same = a != NULL && c != NULL && strcmp(a, c) == 0;
            free(a);
            free(c);
            if (!same && status == BRACE_OK) {
                status = core_fail(error, BRACE_ERROR_MISMATCH,
                                   "%s: this folder holds a set made with other settings ('%s' differs); go on with "
                                   "the same ones, or choose another folder",
                                   b->out, key);
            }
        }
    }
    core_free(path);
    json_decref(old);
    json_decref(index);
    return status;
}

/* ---- making ---- */

static brace_status make_sample(builder *b, const plan *s, brace_error *error) {
    char *final = dataset_path(b->out, s->name), *folder = NULL;
    if (final == NULL) {
        return core_fail_memory(error, 256, "a name");
    }
    if (access(final, F_OK) == 0) {
        atomic_fetch_add(&b->there, 1);
        core_free(final);
        return BRACE_OK;
    }
    dataset_draw draw;
    dataset_priors_draw(&draw, b->priors, b->params->seed, s->sample);
    const dataset_task task = {.seed = b->params->seed,
                               .sample = s->sample,
                               .screen = s->screen->path,
                               .name = s->name,
                               .display = draw.display,
                               .camera = draw.camera,
                               .flicker_free = draw.flicker_free,
                               .width = b->width,
                               .height = b->height,
                               .field = b->params->field,
                               .priors = b->priors};
    const brace_job job = {.threads = 1, .cancel = b->job != NULL ? b->job->cancel : NULL};
    json_t *meta = NULL, *files = NULL;
    brace_status status = dataset_begin(&folder, final, error);
    if (status == BRACE_OK) {
        status = b->make(b->params->user, &task, folder, &meta, &job, error);
    }
    if (status == BRACE_OK) {
        status = dataset_hashes(&files, folder, error);
    }
    if (status == BRACE_OK) {
        json_t *name = json_string(s->screen->name);
        json_object_set_new(meta, "screen", json_pack("{s:o, s:s}", "file", name != NULL ? name : json_string("?"),
                                                      "sha256", s->screen->sha256));
        json_object_set_new(meta, "flicker_free", json_boolean(draw.flicker_free));
        json_object_set(meta, "files", files);
        char *path = dataset_path(folder, "meta.json");
        status = path != NULL ? dataset_json_save(meta, path, error) : core_fail_memory(error, 256, "a name");
        core_free(path);
    }
    json_decref(files);
    json_decref(meta);
    if (status == BRACE_OK) {
        status = dataset_finish(folder, final, error);
    } else if (folder != NULL) {
        dataset_discard(folder);
    }
    atomic_fetch_add(&b->made, status == BRACE_OK);
    core_free(folder);
    core_free(final);
    return status;
}

static void make_some(void *user, size_t begin, size_t end, int worker) {
    builder *b = user;
    uint32_t shards = b->params->shards > 0 ? b->params->shards : 1;
    for (size_t i = begin; i < end && !atomic_load(&b->failed); i++) {
        const plan *s = &b->plans[b->first + i * shards + b->params->shard];
        brace_error error = {0};
        brace_status status = core_check_cancel(b->job, &error);
        if (status == BRACE_OK) {
            status = make_sample(b, s, &error);
            if (status != BRACE_OK && status != BRACE_ERROR_CANCELLED) {
                core_error_prefix(&error, s->name);
            }
        }
        if (status != BRACE_OK) {
            pthread_mutex_lock(&b->lock);
            if (b->status == BRACE_OK) {
                b->status = status;
                b->error = error;
            }
            pthread_mutex_unlock(&b->lock);
            atomic_store(&b->failed, 1);
        }
        if (worker == 0 && i + 1 < b->mine) { /* the caller's own thread: where callbacks may run */
            core_progress(b->job, "building", atomic_load(&b->made) + atomic_load(&b->there), b->mine);
        }
    }
}

static brace_status check(const dataset_build_params *p, builder *b, brace_error *error) {
    b->width = p->width > 0 ? p->width : 1024;
    b->height = p->height > 0 ? p->height : 768;
    if (p->train >= DATASET_TEST_SAMPLE || p->test >= DATASET_TEST_SAMPLE || p->train + (uint64_t)p->test == 0 ||
        p->train + (uint64_t)p->test > 10000000) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "a set has 1 to 10000000 samples");
    }
    if (b->width < 32 || b->height < 32 || b->width > 16384 || b->height > 16384 || b->width % 2 || b->height % 2) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%ux%u: frames have 32 to 16384 pixels a side, an even number",
                         b->width, b->height);
    }
    if (p->shards > 0 ? p->shard >= p->shards : p->shard > 0) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "there is no shard %u of %u", p->shard, p->shards);
    }
    b->count = (size_t)p->train + p->test;
    return BRACE_OK;
}

static brace_status prepare(builder *b, brace_error *error) {
    const dataset_build_params *p = b->params;
    char shipped[PATH_MAX];
    const char *screens = p->screens;
    brace_status status = dataset_priors_load(&b->priors, p->priors, error);
    if (status == BRACE_OK && screens == NULL) {
        screens = shipped;
        status = sim_data_folder(shipped, "screens", error);
    }
    if (status == BRACE_OK) {
        status = dataset_screens_read(&b->screens, screens, p->train, p->test, b->job, error);
    }
    if (status == BRACE_OK) {
        status = plan_all(b, error);
    }
    if (status == BRACE_OK) {
        status = dataset_make_folder(b->out, error);
    }
    return status == BRACE_OK ? settle_index(b, error) : status;
}

brace_status dataset_build(const char *out, const dataset_build_params *params, dataset_built *done,
                           const brace_job *job, brace_error *error) {
    *done = (dataset_built){0};
    builder b = {.out = out, .params = params, .job = job, .make = params->make};
    brace_status status = check(params, &b, error);
    if (status != BRACE_OK) {
        return status;
    }
    if (b.make == NULL) {
        b.make = dataset_render;
    }
    core_pool *pool = NULL;
    pthread_mutex_init(&b.lock, NULL);
    status = prepare(&b, error);
    if (status == BRACE_OK) {
        status = core_pool_create(&pool, job, error);
    }
    if (status == BRACE_OK) {
        uint32_t shards = params->shards > 0 ? params->shards : 1;
        const size_t end = params->only == DATASET_TRAIN ? params->train : b.count;
        b.first = params->only == DATASET_TEST ? params->train : 0;
        b.mine = (end - b.first + shards - 1 - params->shard) / shards;
        core_parallel(pool, b.mine, 1, make_some, &b);
        status = b.status;
        if (status != BRACE_OK && error != NULL) {
            *error = b.error;
        }
        if (status == BRACE_OK) {
            core_progress(job, "building", b.mine, b.mine);
        }
    }
    *done = (dataset_built){atomic_load(&b.made), atomic_load(&b.there)};
    core_pool_destroy(pool);
    pthread_mutex_destroy(&b.lock);
    for (size_t i = 0; b.plans != NULL && i < b.count; i++) {
        core_free(b.plans[i].name);
    }
    core_free(b.plans);
    core_free(b.scratch);
    dataset_screens_free(&b.screens);
    dataset_priors_destroy(b.priors);
    return status;
}
