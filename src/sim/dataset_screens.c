/* SPDX-License-Identifier: Apache-2.0 */
/*
 * dataset_screens.c: the pictures that displays show, and the split of each. No
 * content is in both splits: copies of a file, under whatever name, count once,
 * and pictures that look alike go into one split together. The splits do not
 * depend on names or on the order in which a folder is read.
 */
#include "sim/dataset_screens.h"

#include <ctype.h>
#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "sim/dataset.h"
#include "sim/screen.h"

void dataset_screens_free(dataset_screens *s) {
    for (size_t i = 0; i < s->count; i++) {
        core_free(s->items[i].path);
        core_free(s->items[i].name);
    }
    core_free(s->items);
    *s = (dataset_screens){0};
}

static bool is_picture(const char *name) {
    static const char *const ends[] = {"png", "webp", "jpg", "jpeg", "tif", "tiff"};
    const char *dot = strrchr(name, '.');
    for (size_t i = 0; dot != NULL && name[0] != '.' && i < sizeof ends / sizeof ends[0]; i++) {
        if (strcasecmp(dot + 1, ends[i]) == 0) {
            return true;
        }
    }
    return false;
}

/* What follows the number, in letters and digits; "screen" without one. */
static void category_of(char out[32], const char *name) {
    size_t digits = strspn(name, "0123456789"), n = 0;
    if (digits > 0 && name[digits] == '_') {
        for (const char *p = name + digits + 1; isalnum((unsigned char)*p) && n < 31; p++) {
            out[n++] = *p;
        }
    }
    out[n] = '\0';
    if (n == 0) {
        memcpy(out, "screen", 7);
    }
}

static int by_hash(const void *a, const void *b) {
    const dataset_screen *x = a, *y = b;
    int order = strcmp(x->sha256, y->sha256);
    return order != 0 ? order : strcmp(x->name, y->name);
}

static brace_status add(dataset_screens *s, const char *folder, const char *name, brace_error *error) {
    dataset_screen *screen = &s->items[s->count];
    screen->path = dataset_path(folder, name);
    screen->name = core_strdup(name);
    s->count++;
    if (screen->path == NULL || screen->name == NULL) {
        return core_fail_memory(error, 256, "a name");
    }
    category_of(screen->category, name);
    return BRACE_OK;
}

/* ---- looking at all of them ---- */

typedef struct viewer {
    dataset_screens *screens;
    const brace_job *job;
    pthread_mutex_t lock;
    size_t bad, first; /* how many cannot be read, and the first of them by name; under the lock */
    brace_status status;
    brace_error error;
} viewer;

static void view_some(void *user, size_t begin, size_t end, int worker) {
    viewer *v = user;
    /* Pictures are decoded here only, side by side: one thread each. */
    const brace_job own = {.threads = 1, .cancel = v->job != NULL ? v->job->cancel : NULL};
    for (size_t i = begin; i < end; i++) {
        dataset_screen *screen = &v->screens->items[i];
        brace_image *image = NULL;
        brace_error error = {0};
        brace_status status = core_check_cancel(v->job, &error);
        if (status == BRACE_OK)
            status = sim_screen_read(&image, screen->sha256, screen->path, &own, &error);
        if (status == BRACE_OK)
            status = sim_print_create(&screen->print, image, &error);
        brace_image_destroy(image);
        if (status != BRACE_OK) {
            pthread_mutex_lock(&v->lock);
            if (v->bad++ == 0 || i < v->first) {
                v->first = i;
                v->status = status;
                v->error = error;
            }
            pthread_mutex_unlock(&v->lock);
        }
    }
    if (worker == 0 && end < v->screens->count) {
        core_progress(v->job, "screens", end, v->screens->count);
    }
}

static brace_status view_all(dataset_screens *s, const brace_job *job, brace_error *error) {
    viewer v = {.screens = s, .job = job};
    core_pool *pool = NULL;
    brace_status status = core_pool_create(&pool, job, error);
    if (status != BRACE_OK) {
        return status;
    }
    pthread_mutex_init(&v.lock, NULL);
    core_parallel(pool, s->count, 4, view_some, &v);
    pthread_mutex_destroy(&v.lock);
    core_pool_destroy(pool);
    status = core_check_cancel(job, error);
    if (status != BRACE_OK) {
        return status;
    }
    if (v.bad > 1) {
        return core_fail(error, v.status, "%s (and %zu more screens cannot be used)", v.error.message, v.bad - 1);
    }
    if (v.bad > 0) {
        return core_fail(error, v.status, "%s", v.error.message);
    }
    if (s->count > 0) {
        core_progress(job, "screens", s->count, s->count);
    }
    return BRACE_OK;
}

/* ---- copies and lookalikes ---- */

/* Copies leave; the first by name stays. */
static void drop_copies(dataset_screens *s) {
    size_t kept = 0;
    for (size_t i = 0; i < s->count; i++) {
        if (kept > 0 && strcmp(s->items[kept - 1].sha256, s->items[i].sha256) == 0) {
            core_free(s->items[i].path);
            core_free(s->items[i].name);
        } else {
            s->items[kept++] = s->items[i];
        }
    }
    s->count = kept;
}

static size_t leader_of(const dataset_screens *s, size_t i) {
    while (s->items[i].group != i) {
        i = s->items[i].group;
    }
    return i;
}

static int by_group(const void *a, const void *b) {
    const dataset_screen *x = a, *y = b;
    return x->group != y->group ? (x->group > y->group) - (x->group < y->group) : strcmp(x->sha256, y->sha256);
}

/* Pictures that look alike, also by way of others, get one group: its first by hash. Then sorts by group. */
static void group_alike(dataset_screens *s) {
    for (size_t i = 0; i < s->count; i++) {
        s->items[i].group = i;
        for (size_t k = 0; k < i; k++) {
            size_t a = leader_of(s, i), b = leader_of(s, k);
            if (a != b && sim_prints_alike(&s->items[i].print, &s->items[k].print)) {
                s->items[a > b ? a : b].group = a > b ? b : a;
            }
        }
    }
    for (size_t i = 0; i < s->count; i++) {
        s->items[i].group = leader_of(s, i);
    }
    qsort(s->items, s->count, sizeof *s->items, by_group);
}

/* How many of the first screens are for testing: as near to the share wanted as whole groups allow. 0: there is one
 * group only. */
static size_t split_at(const dataset_screens *s, double share) {
    size_t best = 0;
    for (size_t i = 1; i < s->count; i++) {
        if (s->items[i].group != s->items[i - 1].group &&
            (best == 0 || fabs((double)i - share * (double)s->count) < fabs((double)best - share * (double)s->count))) {
            best = i;
        }
    }
    return best;
}

brace_status dataset_screens_read(dataset_screens *out, const char *folder, uint32_t train, uint32_t test,
                                  const brace_job *job, brace_error *error) {
    *out = (dataset_screens){0};
    struct dirent **names = NULL;
    int n = scandir(folder, &names, NULL, alphasort);
    if (n < 0) {
        return core_fail(error, BRACE_ERROR_IO, "%s: cannot look into this folder: %s", folder, strerror(errno));
    }
    brace_status status = BRACE_OK;
    out->items = core_calloc((size_t)n + 1, sizeof *out->items);
    if (out->items == NULL) {
        status = core_fail_memory(error, (size_t)n * sizeof *out->items, "a list of screens");
    }
    for (int i = 0; i < n; i++) {
        if (status == BRACE_OK && is_picture(names[i]->d_name)) {
            status = add(out, folder, names[i]->d_name, error);
        }
        free(names[i]);
    }
    free(names);
    if (status == BRACE_OK) {
        status = view_all(out, job, error);
    }
    if (status == BRACE_OK && out->count == 0) {
        status = core_fail(error, BRACE_ERROR_ARGUMENT,
                           "%s: there are no pictures in this folder (.png, .webp, .jpg, .tif)", folder);
    }
    if (status == BRACE_OK) {
        qsort(out->items, out->count, sizeof *out->items, by_hash);
        drop_copies(out);
        group_alike(out);
        out->test = train == 0 ? out->count : test == 0 ? 0 : split_at(out, test / ((double)train + test));
        if (train > 0 && test > 0 && out->test == 0) {
            status = core_fail(error, BRACE_ERROR_ARGUMENT,
                               out->count == 1
                                   ? "%s: train and test share no screen, and there is only one here"
                                   : "%s: train and test share no screen, and all that are here look alike",
                               folder);
        }
    }
    if (status != BRACE_OK) {
        dataset_screens_free(out);
        return status;
    }
    return BRACE_OK;
}

json_t *dataset_screens_json(const dataset_screens *s) {
    json_t *list = json_array();
    for (size_t i = 0; i < s->count; i++) {
        json_t *name = json_string(s->items[i].name);
        json_array_append_new(list, json_pack("{s:o, s:s, s:s}", "file", name != NULL ? name : json_string("?"),
                                              "sha256", s->items[i].sha256, "split", i < s->test ? "test" : "train"));
    }
    return list;
}

const dataset_screen *dataset_screens_pick(const dataset_screens *s, bool test, uint64_t seed, uint32_t n,
                                           uint32_t *scratch) {
    uint32_t count = (uint32_t)(test ? s->test : s->count - s->test);
    core_random r = core_random_create(seed, n / count, test, 0x5C4EE115);
    for (uint32_t i = 0; i < count; i++) {
        scratch[i] = i;
    }
    for (uint32_t i = count - 1; i > 0; i--) {
        uint32_t j = core_random_below(&r, i + 1), t = scratch[i];
        scratch[i] = scratch[j];
        scratch[j] = t;
    }
    return &s->items[(test ? 0 : s->test) + scratch[n % count]];
}
