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

/* Streams of random numbers of one sample. */
enum { STREAM_KIND = 0x44530001, STREAM_DISPLAY, STREAM_CAMERA, STREAM_SCENE };

/* What a prior may speak of. */
static const struct {
    const char *name;
    size_t offset;
    double low, high;
} quantities[] = {
#define QUANTITY(name, low, high) {#name, offsetof(sim_scene, name), low, high}
    QUANTITY(reference_time, 1e-6, 10),
    QUANTITY(iso, 10, 1e6),
    QUANTITY(level, 1e-4, 100),
    QUANTITY(tremor_position, 0, 1),
    QUANTITY(tremor_angle, 0, 1),
    QUANTITY(frame_gap, 0, 10),
    QUANTITY(psf, 0, 10),
    QUANTITY(glare, 0, 1),
    QUANTITY(vignetting, 0, 1),
    QUANTITY(ambient, 0, 10),
    QUANTITY(ambient_hz, 0, 1000),
    QUANTITY(nonuniformity, 0, 0.5),
    QUANTITY(defocus, 0, 20),
    QUANTITY(clutter, 0, 10),
#undef QUANTITY
};
enum { QUANTITIES = sizeof quantities / sizeof quantities[0] };

typedef enum shape { ABSENT, FIXED, UNIFORM, LOG_UNIFORM, NORMAL } shape;

typedef struct prior {
    shape shape;
    double a, b;
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
    prior scene[QUANTITIES];
};

void dataset_priors_destroy(dataset_priors *priors) {
    if (priors != NULL) {
        json_decref(priors->json);
        core_free(priors->displays);
        core_free(priors->steady);
        core_free(priors->cameras);
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

static prior read_prior(const json_at *scene, size_t i) {
    static const char *const keys[] = {"uniform", "log_uniform", "normal", "probability", NULL};
    const char *name = quantities[i].name;
    double low = quantities[i].low, high = quantities[i].high, pair[2] = {0, 0};
    prior out = {.probability = 1};
    json_at object;
    json_t *value = json_object_get(scene->value, name);
    if (value == NULL) {
        return out;
    }
    if (json_is_number(value)) {
        out.shape = FIXED;
        out.a = json_check_number(scene, name, low, high, JSON_CHECK_REQUIRED);
        return out;
    }
    if (!json_check_object(scene, name, &object)) {
        return out;
    }
    json_check_only(&object, keys);
    out.probability = json_check_number(&object, "probability", 0, 1, 1);
    int given = 0;
    for (int k = 0; k < 3; k++) {
        if (json_object_get(object.value, keys[k]) != NULL) {
            given++;
            out.shape = k == 0 ? UNIFORM : k == 1 ? LOG_UNIFORM : NORMAL;
            json_check_numbers(&object, keys[k], pair, 2, 2, k == 1 ? fmax(low, 1e-12) : low, high, true);
        }
    }
    if (given != 1) {
        json_check_fail(scene, name, "one of uniform, log_uniform and normal is needed");
    } else if (out.shape != NORMAL && pair[0] > pair[1]) {
        json_check_fail(scene, name, "the range ends below where it begins");
    }
    out.a = pair[0];
    out.b = pair[1];
    return out;
}

static brace_status read_all(dataset_priors *p, json_check *doc, brace_error *error) {
    static const char *const keys[] = {"description", "flicker_free", "flicker_free_displays", "displays", "cameras",
                                       "scene", NULL};
    json_at root = json_check_root(doc), scene;
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
        const char *names[QUANTITIES + 1] = {NULL};
        for (size_t i = 0; i < QUANTITIES; i++) {
            names[i] = quantities[i].name;
        }
        json_check_only(&scene, names);
        for (size_t i = 0; i < QUANTITIES; i++) {
            p->scene[i] = read_prior(&scene, i);
        }
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

void dataset_priors_scene(sim_scene *scene, const dataset_priors *p, uint64_t seed, uint32_t sample) {
    for (size_t i = 0; i < QUANTITIES; i++) {
        const prior *q = &p->scene[i];
        if (q->shape == ABSENT) {
            continue;
        }
        core_random r = core_random_create(seed, sample, (uint32_t)i, STREAM_SCENE);
        double x = q->a, u = core_random_uniform(&r);
        switch (q->shape) {
        case UNIFORM:
            x = q->a + (q->b - q->a) * u;
            break;
        case LOG_UNIFORM:
            x = q->a * pow(q->b / q->a, u);
            break;
        case NORMAL:
            x = q->a + q->b * core_random_normal(&r);
            break;
        default:
            break;
        }
        if (q->probability < 1 && core_random_uniform(&r) >= q->probability) {
            x = 0;
        }
        x = fmin(fmax(x, q->probability < 1 ? 0 : quantities[i].low), quantities[i].high);
        memcpy((char *)scene + quantities[i].offset, &x, sizeof x);
    }
}
