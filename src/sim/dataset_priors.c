/* SPDX-License-Identifier: Apache-2.0 */
/*
 * dataset_priors.c: reads the priors and draws from them. A sample's numbers
 * depend on seed, sample and the name of the quantity only: a quantity added to
 * the file changes none of the others.
 */
#include "sim/dataset_priors.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "sim/data_path.h"
#include "sim/json_check.h"
#include "sim/quantities.h"

/* Streams of random numbers of one sample. */
enum { STREAM_KIND = 0x44530001, STREAM_DISPLAY, STREAM_CAMERA, STREAM_SCENE, STREAM_VARY };

typedef enum shape { ABSENT, FIXED, UNIFORM, LOG_UNIFORM, NORMAL, CHOICE } shape;
enum { CHOICES = 16 };

typedef struct prior {
    shape shape;
    const char *name;             /* inside the JSON value, or the quantity's */
    const sim_quantity *quantity;
    double a, b;
    double choice[CHOICES];
    size_t choices;
    double probability; /* otherwise 0 */
} prior;

typedef struct weighted {
    const char *name; /* inside the JSON value */
    double sum;       /* of the weights up to here */
} weighted;

struct dataset_priors {
    json_t *json;
    double flicker_free;
    weighted *displays, *steady, *cameras;
    size_t display_count, steady_count, camera_count;
    prior *scene, *vary;
    size_t scene_count, vary_count;
};

/* What a display's numbers are multiplied by. */
static const sim_quantity factor_of_display = {.name = "factor", .type = SIM_REAL, .low = 0.01, .high = 100};

void dataset_priors_destroy(dataset_priors *priors) {
    if (priors != NULL) {
        json_decref(priors->json);
        core_free(priors->displays);
        core_free(priors->steady);
        core_free(priors->cameras);
        core_free(priors->scene);
        core_free(priors->vary);
        core_free(priors);
    }
}

json_t *dataset_priors_json(const dataset_priors *priors) {
    return json_incref(priors->json);
}

/* {"name": weight, ...} */
static brace_status read_weights(weighted **out, size_t *count, const json_at *root, const char *key,
                                 const char *kind, bool required, brace_error *error) {
    json_at object;
    if (!json_check_object(root, key, &object)) {
        if (required) {
            json_check_fail(root, key, "names and their weights are needed here");
        }
        return BRACE_OK;
    }
    *out = core_calloc(json_object_size(object.value) + 1, sizeof **out);
    if (*out == NULL) {
        return core_fail_memory(error, json_object_size(object.value) * sizeof **out, "priors");
    }
    const char *name;
    json_t *value;
    double sum = 0;
    json_object_foreach(object.value, name, value) {
        char path[PATH_MAX];
        brace_error problem = {0};
        if (sim_data_path(path, kind, name, &problem) != BRACE_OK) {
            json_check_fail(&object, name, "%s", problem.message);
        } else if (access(path, R_OK) != 0) {
            json_check_fail(&object, name, "%s cannot be read", path);
        }
        double weight = json_check_number(&object, name, 0, 1e9, JSON_CHECK_REQUIRED);
        if (weight > 0) {
            sum += weight;
            (*out)[(*count)++] = (weighted){name, sum};
        }
    }
    if (*count == 0 && required) {
        json_check_fail(root, key, "no name here has a weight above 0");
    }
    return BRACE_OK;
}

/* The distribution that `scene` has at `name`, of what takes the values of `q`. */
static prior read_prior(const json_at *scene, const char *name, const sim_quantity *q) {
    static const char *const keys[] = {"uniform", "log_uniform", "normal", "choice", "probability", NULL};
    static const shape shapes[] = {UNIFORM, LOG_UNIFORM, NORMAL, CHOICE};
    double pair[2] = {0, 0};
    prior out = {.name = name, .quantity = q, .probability = 1};
    json_at object;
    json_t *value = json_object_get(scene->value, name);
    if (value == NULL) {
        return out;
    }
    char range[64];
    sim_quantity_range(range, sizeof range, q);
    if (json_is_number(value)) {
        out.shape = FIXED;
        out.a = json_check_number(scene, name, q->low, q->high, JSON_CHECK_REQUIRED);
        if (!sim_quantity_takes(q, out.a)) {
            json_check_fail(scene, name, "%g is none of the whole numbers %s", out.a, range);
        }
        return out;
    }
    if (!json_check_object(scene, name, &object)) {
        return out;
    }
    json_check_only(&object, keys);
    out.probability = json_check_number(&object, "probability", 0, 1, 1);
    int given = 0;
    for (int k = 0; k < 4; k++) {
        if (json_object_get(object.value, keys[k]) != NULL) {
            given++;
            out.shape = shapes[k];
            if (out.shape == CHOICE) {
                out.choices = json_check_numbers(&object, keys[k], out.choice, 1, CHOICES, q->low, q->high, true);
            } else {
                json_check_numbers(&object, keys[k], pair, 2, 2, k == 1 ? fmax(q->low, 1e-12) : q->low, q->high, true);
            }
        }
    }
    for (size_t i = 0; i < out.choices; i++) {
        if (!sim_quantity_takes(q, out.choice[i])) {
            json_check_fail(scene, name, "%g is none of the whole numbers %s", out.choice[i], range);
        }
    }
    if (given != 1) {
        json_check_fail(scene, name, "one of uniform, log_uniform, normal and choice is needed");
    } else if ((out.shape == UNIFORM || out.shape == LOG_UNIFORM) && pair[0] > pair[1]) {
        json_check_fail(scene, name, "the range ends below where it begins");
    } else if (out.probability < 1 && !sim_quantity_takes(q, 0)) {
        json_check_fail(scene, name, "it cannot be 0, so it can have no probability; its range is %s", range);
    } else if (q->choices != NULL && out.shape != CHOICE) {
        json_check_fail(scene, name, "only %s can be chosen from: \"choice\": [...]", range);
    }
    out.a = pair[0];
    out.b = pair[1];
    return out;
}

/* What the priors say of the numbers of a scene. */
static brace_status read_scene(dataset_priors *p, const json_at *scene, brace_error *error) {
    const char **names = core_calloc(sim_quantity_count + 1, sizeof *names);
    p->scene = core_calloc(sim_quantity_count, sizeof *p->scene);
    if (names == NULL || p->scene == NULL) {
        core_free(names);
        return core_fail_memory(error, sim_quantity_count * sizeof *p->scene, "priors");
    }
    for (size_t i = 0; i < sim_quantity_count; i++) {
        if (sim_quantities[i].drawn) {
            names[p->scene_count++] = sim_quantities[i].name;
        }
    }
    json_check_only(scene, names);
    for (size_t i = 0; i < p->scene_count; i++) {
        p->scene[i] = read_prior(scene, names[i], sim_quantity_find(names[i]));
    }
    core_free(names);
    return BRACE_OK;
}

/* What they say of the numbers of displays. */
static brace_status read_vary(dataset_priors *p, const json_at *vary, brace_error *error) {
    p->vary = core_calloc(json_object_size(vary->value) + 1, sizeof *p->vary);
    if (p->vary == NULL) {
        return core_fail_memory(error, json_object_size(vary->value) * sizeof *p->vary, "priors");
    }
    const char *name;
    json_t *value;
    json_object_foreach(vary->value, name, value) {
        if (!sim_display_varies(name)) {
            json_check_fail(vary, name, "no kind of display has a real number of this name");
        }
        p->vary[p->vary_count++] = read_prior(vary, name, &factor_of_display);
    }
    return BRACE_OK;
}

static brace_status read_all(dataset_priors *p, json_check *doc, brace_error *error) {
    static const char *const keys[] = {"description", "flicker_free", "flicker_free_displays", "displays", "cameras",
                                       "scene", "vary", NULL};
    json_at root = json_check_root(doc), scene, vary;
    json_check_only(&root, keys);
    p->flicker_free = json_check_number(&root, "flicker_free", 0, 1, 0.1);
    brace_status status =
        read_weights(&p->displays, &p->display_count, &root, "displays", "displays", p->flicker_free < 1, error);
    if (status == BRACE_OK) {
        status = read_weights(&p->steady, &p->steady_count, &root, "flicker_free_displays", "displays",
                              p->flicker_free > 0, error);
    }
    if (status == BRACE_OK) {
        status = read_weights(&p->cameras, &p->camera_count, &root, "cameras", "cameras", false, error);
    }
    if (status == BRACE_OK && json_check_object(&root, "scene", &scene)) {
        status = read_scene(p, &scene, error);
    }
    if (status == BRACE_OK && json_check_object(&root, "vary", &vary)) {
        status = read_vary(p, &vary, error);
    }
    return status == BRACE_OK ? json_check_status(doc, error) : status;
}

brace_status dataset_priors_load(dataset_priors **out, const char *path, brace_error *error) {
    *out = NULL;
    char found[PATH_MAX];
    if (path == NULL) {
        brace_status status = sim_data_path(found, "priors", "default", error);
        if (status != BRACE_OK) {
            return status;
        }
        path = found;
    }
    json_check *doc = NULL;
    brace_status status = json_check_load(&doc, path, error);
    if (status != BRACE_OK) {
        return status;
    }
    dataset_priors *p = core_calloc(1, sizeof *p);
    if (p == NULL) {
        json_check_destroy(doc);
        return core_fail_memory(error, sizeof *p, "priors");
    }
    p->json = json_incref(json_check_root(doc).value);
    status = read_all(p, doc, error);
    json_check_destroy(doc);
    if (status != BRACE_OK) {
        dataset_priors_destroy(p);
        return status;
    }
    *out = p;
    return BRACE_OK;
}

/* ---- drawing ---- */

static const char *pick(const weighted *list, size_t count, core_random *r) {
    double at = count > 0 ? core_random_uniform(r) * list[count - 1].sum : 0;
    for (size_t i = 0; i < count; i++) {
        if (at < list[i].sum) {
            return list[i].name;
        }
    }
    return count > 0 ? list[count - 1].name : NULL;
}

void dataset_priors_draw(dataset_draw *out, const dataset_priors *p, uint64_t seed, uint32_t sample) {
    /* Exactly the wanted share, evenly spread: sample n is one when n times the share passes
     * a whole number. The seed shifts where that happens. */
    core_random phase = core_random_create(seed, 0, 0, STREAM_KIND);
    double shift = core_random_uniform(&phase), n = sample & 0x7fffffffu; /* of its split */
    out->flicker_free = floor((n + 1) * p->flicker_free + shift) > floor(n * p->flicker_free + shift);
    core_random r = core_random_create(seed, sample, 0, STREAM_DISPLAY);
    out->display = out->flicker_free ? pick(p->steady, p->steady_count, &r) : pick(p->displays, p->display_count, &r);
    r = core_random_create(seed, sample, 0, STREAM_CAMERA);
    out->camera = pick(p->cameras, p->camera_count, &r);
}

/* Where a quantity's random numbers begin (FNV-1a of its name). */
static uint32_t stream_of(const char *name) {
    uint32_t hash = 2166136261u;
    for (; *name != '\0'; name++) {
        hash = (hash ^ (unsigned char)*name) * 16777619u;
    }
    return hash;
}

/* The number that one sample has. */
static double draw(const prior *d, uint64_t seed, uint32_t sample, uint32_t stream) {
    const sim_quantity *q = d->quantity;
    core_random r = core_random_create(seed, sample, stream_of(d->name), stream);
    double x = d->a, u = core_random_uniform(&r);
    switch (d->shape) {
    case UNIFORM:
        x = d->a + (d->b - d->a) * u;
        break;
    case LOG_UNIFORM:
        x = d->a * pow(d->b / d->a, u);
        break;
    case NORMAL:
        x = d->a + d->b * core_random_normal(&r);
        break;
    case CHOICE:
        x = d->choice[(size_t)(u * (double)d->choices)];
        break;
    default:
        break;
    }
    if (d->probability < 1 && core_random_uniform(&r) >= d->probability) {
        x = 0;
    }
    return fmin(fmax(x, q->low), q->high);
}

void dataset_priors_scene(sim_scene *scene, const dataset_priors *p, uint64_t seed, uint32_t sample) {
    for (size_t i = 0; i < p->scene_count; i++) {
        const prior *d = &p->scene[i];
        if (d->shape != ABSENT) {
            double x = draw(d, seed, sample, STREAM_SCENE);
            sim_quantity_put(scene, d->quantity, d->quantity->type == SIM_REAL ? x : round(x));
        }
    }
}

typedef struct variation {
    const dataset_priors *priors;
    uint64_t seed;
    uint32_t sample;
} variation;

static double factor_for(const void *user, const char *key) {
    const variation *v = user;
    for (size_t i = 0; i < v->priors->vary_count; i++) {
        if (strcmp(v->priors->vary[i].name, key) == 0) {
            return draw(&v->priors->vary[i], v->seed, v->sample, STREAM_VARY);
        }
    }
    return 1;
}

brace_status dataset_priors_display(sim_display **out, const dataset_priors *priors, const char *display,
                                    uint64_t seed, uint32_t sample, brace_error *error) {
    return sim_display_load_varied(out, display, factor_for, &(variation){priors, seed, sample}, error);
}
