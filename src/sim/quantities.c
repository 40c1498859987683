/* SPDX-License-Identifier: Apache-2.0 */
/*
 * quantities.c: what a capture depends on, once: name, range, unit and meaning
 * of every number of a scene. The scene's check, its JSON, the priors of data
 * sets and the command line all read this table.
 */
#include "sim/quantities.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double frame_counts[] = {3, 5, 7, 9, 0}, ray_counts[] = {1, 2, 4, 0};

#define AT(field) offsetof(sim_scene, field)
const sim_quantity sim_quantities[] = {
    {"seed", SIM_SEED, AT(seed), 0, 18446744073709551615.0, NULL, "", NULL, false, "keys all randomness"},
    {"sample", SIM_UNSIGNED, AT(sample), 0, 4294967295.0, NULL, "", NULL, false,
     "number of the sample: another capture with the same seed"},
    {"width", SIM_UNSIGNED, AT(width), 32, 16384, NULL, "pixels", NULL, false, "of the frames"},
    {"height", SIM_UNSIGNED, AT(height), 32, 16384, NULL, "pixels", NULL, false, "of the frames"},
    {"frames", SIM_INTEGER, AT(frames), 3, 9, frame_counts, "", NULL, false,
     "each four times as long as the one before"},
    {"reference_time", SIM_REAL, AT(reference_time), 1e-6, 10, NULL, "s", NULL, true,
     "exposure time of the middle frame"},
    {"iso", SIM_REAL, AT(iso), 10, 1e6, NULL, "", NULL, true, "of all frames"},
    {"level", SIM_REAL, AT(level), 1e-4, 100, NULL, "", NULL, true,
     "raw signal of white in the middle frame; 1 just clips"},
    {"frame_gap", SIM_REAL, AT(frame_gap), 0, 10, NULL, "s", NULL, true, "dead time between frames"},
    {"field", SIM_SWITCH, AT(field), 0, 1, NULL, "", NULL, false,
     "the truth is captured, too: 8 times the exposure at ISO/8"},
    {"distance", SIM_REAL, AT(pose.translation[2]), 0.05, 100, NULL, "screens", NULL, true,
     "of the camera, in widths of the screen"},
    {"translation_x", SIM_REAL, AT(pose.translation[0]), -100, 100, NULL, "screens", "pose", true,
     "how far the screen's middle lies right of the axis"},
    {"translation_y", SIM_REAL, AT(pose.translation[1]), -100, 100, NULL, "screens", "pose", true,
     "how far it lies below it"},
    {"rotation_x", SIM_REAL, AT(pose.rotation[0]), -1.3, 1.3, NULL, "rad", "pose", true, "how far the screen leans"},
    {"rotation_y", SIM_REAL, AT(pose.rotation[1]), -1.3, 1.3, NULL, "rad", "pose", true,
     "how far it is turned to a side"},
    {"rotation_z", SIM_REAL, AT(pose.rotation[2]), -6.3, 6.3, NULL, "rad", "pose", true, "how far it is rolled"},
    {"tremor_position", SIM_REAL, AT(tremor_position), 0, 1, NULL, "screens", "tremor", true,
     "the hand's deviation over a second, in widths of the screen"},
    {"tremor_angle", SIM_REAL, AT(tremor_angle), 0, 1, NULL, "rad", "tremor", true, "likewise in angle"},
    {"subexposures", SIM_INTEGER, AT(subexposures), 1, 256, NULL, "", NULL, true,
     "at most so many poses in one exposure; 1: no motion blur"},
    {"supersample", SIM_INTEGER, AT(supersample), 1, 4, ray_counts, "", NULL, true, "rays along each axis of a pixel"},
    {"distortion_k1", SIM_REAL, AT(distortion[0]), -0.5, 0.5, NULL, "", "distortion", true,
     "Brown-Conrady, lengths in widths of the picture"},
    {"distortion_k2", SIM_REAL, AT(distortion[1]), -0.5, 0.5, NULL, "", "distortion", true, "likewise, fourth order"},
    {"psf", SIM_REAL, AT(psf), 0, 10, NULL, "pixels", "psf", true, "the lens's blur, deviation of a Gaussian"},
    {"defocus", SIM_REAL, AT(defocus), 0, 20, NULL, "pixels", "defocus", true,
     "radius of the disc that a point becomes"},
    {"glare", SIM_REAL, AT(glare), 0, 1, NULL, "", "glare", true,
     "share of the light that the lens spreads over the picture"},
    {"vignetting", SIM_REAL, AT(vignetting), 0, 1, NULL, "", "vignetting", true, "loss in the corners"},
    {"ambient", SIM_REAL, AT(ambient), 0, 10, NULL, "", "ambient", true,
     "room light reflected by the screen, of white"},
    {"ambient_hz", SIM_REAL, AT(ambient_hz), 0, 1000, NULL, "Hz", NULL, true,
     "flicker of the room's light: 100 or 120; 0: steady"},
    {"clutter", SIM_REAL, AT(clutter), 0, 10, NULL, "", "clutter", true,
     "mean brightness of what is around the screen, of white"},
    {"bezel", SIM_REAL, AT(bezel), 0, 0.5, NULL, "screens", NULL, true,
     "width of the screen's dark frame; seen where there is clutter"},
    {"panel_nonuniformity", SIM_REAL, AT(panel_nonuniformity), 0, 0.5, NULL, "", "nonuniformity", true,
     "deviation of the subpixels' light (mura)"},
    {"sensor_nonuniformity", SIM_REAL, AT(sensor_nonuniformity), 0, 0.5, NULL, "", "nonuniformity", true,
     "deviation of the pixels' gain (PRNU)"},
    {"noise", SIM_REAL, AT(noise), 0, 10, NULL, "", "noise", true,
     "shot and read noise, of what the camera's profile says"},
};
#undef AT
const size_t sim_quantity_count = sizeof sim_quantities / sizeof *sim_quantities;

const sim_quantity *sim_quantity_find(const char *name) {
    for (size_t i = 0; i < sim_quantity_count; i++)
        if (strcmp(sim_quantities[i].name, name) == 0)
            return &sim_quantities[i];
    return NULL;
}

double sim_quantity_get(const sim_scene *scene, const sim_quantity *q) {
    const void *at = (const char *)scene + q->offset;
    switch (q->type) {
    case SIM_SEED:
        return (double)*(const uint64_t *)at;
    case SIM_UNSIGNED:
        return *(const uint32_t *)at;
    case SIM_INTEGER:
        return *(const int *)at;
    case SIM_SWITCH:
        return *(const bool *)at;
    case SIM_REAL:
        break;
    }
    return *(const double *)at;
}

void sim_quantity_put(sim_scene *scene, const sim_quantity *q, double value) {
    void *at = (char *)scene + q->offset;
    switch (q->type) {
    case SIM_SEED: /* has more digits than a double: sim_scene_set */
        *(uint64_t *)at = (uint64_t)value;
        break;
    case SIM_UNSIGNED:
        *(uint32_t *)at = (uint32_t)value;
        break;
    case SIM_INTEGER:
        *(int *)at = (int)value;
        break;
    case SIM_SWITCH:
        *(bool *)at = value != 0;
        break;
    case SIM_REAL:
        *(double *)at = value;
        break;
    }
}

void sim_quantity_range(char *out, size_t size, const sim_quantity *q) {
    size_t used = 0;
    if (q->choices == NULL)
        snprintf(out, size, q->type == SIM_SEED ? "%.0f to 2^64-1" : "%.10g to %.10g", q->low, q->high);
    for (const double *c = q->choices; c != NULL && *c > 0 && used < size; c++)
        used += (size_t)snprintf(out + used, size - used, "%s%g", c == q->choices ? "" : c[1] > 0 ? ", " : " or ", *c);
}

bool sim_quantity_takes(const sim_quantity *q, double value) {
    if (!(value >= q->low && value <= q->high) || (q->type != SIM_REAL && value != floor(value)))
        return false;
    const double *c = q->choices;
    while (c != NULL && *c > 0 && *c != value)
        c++;
    return c == NULL || *c > 0;
}

static brace_status refuse(const sim_quantity *q, const char *value, brace_error *error) {
    char range[64];
    sim_quantity_range(range, sizeof range, q);
    return core_fail(error, BRACE_ERROR_ARGUMENT, "%s: %.40s is out of range %s%s%s%s", q->name, value, range,
                     q->unit[0] != '\0' ? " " : "", q->unit, q->type == SIM_REAL ? "" : " (whole numbers)");
}

brace_status sim_scene_check(const sim_scene *s, brace_error *error) {
    for (size_t i = 0; i < sim_quantity_count; i++) {
        const sim_quantity *q = &sim_quantities[i];
        const double v = sim_quantity_get(s, q);
        char text[32];
        snprintf(text, sizeof text, "%g", v);
        if (q->type != SIM_SEED && !sim_quantity_takes(q, v))
            return refuse(q, text, error);
    }
    return BRACE_OK;
}

json_t *sim_scene_json(const sim_scene *s) {
    json_t *out = json_object();
    for (size_t i = 0; i < sim_quantity_count; i++) {
        const sim_quantity *q = &sim_quantities[i];
        const double v = sim_quantity_get(s, q);
        char seed[24]; /* JSON's integers end at 2^63 */
        snprintf(seed, sizeof seed, "%llu", (unsigned long long)s->seed);
        json_object_set_new(out, q->name,
                            q->type == SIM_SEED
                                ? s->seed <= INT64_MAX ? json_integer((json_int_t)s->seed) : json_string(seed)
                            : q->type == SIM_SWITCH ? json_boolean(v != 0)
                            : q->type == SIM_REAL   ? json_real(v)
                                                    : json_integer((json_int_t)v));
    }
    return out;
}

/* ---- from text ---- */

/* A number, or a fraction such as 1/320. */
static bool parse_number(const char *text, double *out) {
    char *end;
    if (*text == '\0' || strspn(text, "0123456789.eE+-/") != strlen(text))
        return false;
    *out = strtod(text, &end);
    if (*end == '/' && end > text) {
        const char *below = end + 1;
        *out /= strtod(below, &end);
        return end > below && *end == '\0' && isfinite(*out);
    }
    return end > text && *end == '\0' && isfinite(*out);
}

static bool parse_seed(const char *text, uint64_t *out) {
    char *end;
    errno = 0;
    *out = strtoull(text, &end, 10);
    return *text != '\0' && strspn(text, "0123456789") == strlen(text) && *end == '\0' && errno == 0;
}

/* "iso, level, ...": of all quantities, or of all effects. */
static void names(char *out, size_t size, bool effects) {
    size_t used = 0;
    for (size_t i = 0; i < sim_quantity_count && used < size; i++) {
        const char *name = effects ? sim_quantities[i].effect : sim_quantities[i].name;
        if (name != NULL && !(effects && i > 0 && sim_quantities[i - 1].effect == name))
            used += (size_t)snprintf(out + used, size - used, "%s%s", used > 0 ? ", " : "", name);
    }
}

brace_status sim_scene_set(sim_scene *scene, const char *setting, brace_error *error) {
    const char *equals = strchr(setting, '=');
    char name[40], list[800];
    if (equals == NULL || equals == setting)
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%.60s is no NAME=VALUE, such as psf=1.2", setting);
    snprintf(name, sizeof name, "%.*s", (int)fmin((double)(equals - setting), sizeof name - 1), setting);
    const sim_quantity *q = sim_quantity_find(name);
    double value;
    if (q == NULL) {
        names(list, sizeof list, false);
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%s is no quantity of a scene; there are %s", name, list);
    }
    if (q->type == SIM_SEED)
        return parse_seed(equals + 1, &scene->seed) ? BRACE_OK : refuse(q, equals + 1, error);
    if (!parse_number(equals + 1, &value))
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%s: \"%.40s\" is no number", name, equals + 1);
    if (!sim_quantity_takes(q, value))
        return refuse(q, equals + 1, error);
    sim_quantity_put(scene, q, value);
    return BRACE_OK;
}

brace_status sim_scene_off(sim_scene *scene, const char *effects, brace_error *error) {
    for (const char *at = effects; at != NULL; at = strchr(at, ',') != NULL ? strchr(at, ',') + 1 : NULL) {
        const size_t n = strcspn(at, ",");
        bool found = false;
        for (size_t i = 0; i < sim_quantity_count; i++) {
            const sim_quantity *q = &sim_quantities[i];
            if (q->effect != NULL &&
                ((strlen(q->effect) == n && strncmp(q->effect, at, n) == 0) ||
                 (strlen(q->name) == n && strncmp(q->name, at, n) == 0) || (n == 3 && strncmp("all", at, n) == 0)))
                sim_quantity_put(scene, q, 0), found = true;
        }
        if (!found) {
            char list[400];
            names(list, sizeof list, true);
            return core_fail(error, BRACE_ERROR_ARGUMENT, "\"%.*s\" is no effect; there are %s, and all",
                             (int)fmin((double)n, 40), at, list);
        }
    }
    return BRACE_OK;
}

/* ---- from JSON ---- */

void sim_scene_read(sim_scene *scene, const json_at *object) {
    const char *known[sizeof sim_quantities / sizeof *sim_quantities + 1] = {NULL};
    for (size_t i = 0; i < sim_quantity_count; i++)
        known[i] = sim_quantities[i].name;
    json_check_only(object, known);
    for (size_t i = 0; i < sim_quantity_count; i++) {
        const sim_quantity *q = &sim_quantities[i];
        const json_t *value = json_object_get(object->value, q->name);
        if (value == NULL)
            continue;
        if (q->type == SIM_SWITCH) {
            *(bool *)((char *)scene + q->offset) = json_check_bool(object, q->name, false);
        } else if (q->type == SIM_SEED && json_is_string(value)) {
            if (!parse_seed(json_string_value(value), &scene->seed))
                json_check_fail(object, q->name, "a whole number from 0 to 2^64-1 is expected");
        } else if (q->type == SIM_SEED) {
            scene->seed = (uint64_t)json_check_integer(object, q->name, 0, INT64_MAX, 0);
        } else {
            const double v = json_check_number(object, q->name, q->low, q->high, q->low);
            char range[64];
            sim_quantity_range(range, sizeof range, q);
            if (sim_quantity_takes(q, v))
                sim_quantity_put(scene, q, v);
            else
                json_check_fail(object, q->name, "%g is none of the whole numbers %s", v, range);
        }
    }
}

/* An object of a file as text; empty when memory ends. */
static char *object_text(const json_at *root, const char *key) {
    json_t *value = json_object_get(root->value, key);
    return json_is_object(value) ? json_dumps(value, 0) : NULL;
}

brace_status sim_scene_load(sim_scene_file *out, const char *path, uint64_t seed, bool field, brace_error *error) {
    json_check *doc;
    memset(out, 0, sizeof *out);
    brace_status status = json_check_load(&doc, path, error);
    if (status != BRACE_OK)
        return status;
    json_at root = json_check_root(doc), scene = root;
    const bool whole = json_object_get(root.value, "scene") != NULL;
    if (whole && !json_check_object(&root, "scene", &scene)) {
        status = json_check_status(doc, error);
        json_check_destroy(doc);
        return status;
    }
    /* What the file leaves open is sampled from its own seed, so that is read first. */
    sim_scene key = {.seed = seed, .field = field};
    sim_scene_read(&key, &scene);
    status = json_check_status(doc, error);
    if (status == BRACE_OK) {
        sim_scene_sample(&out->scene, key.seed, key.sample, key.field);
        sim_scene_read(&out->scene, &scene);
        char name[300];
        char *display = whole ? object_text(&root, "display") : NULL;
        char *camera = whole ? object_text(&root, "camera") : NULL;
        if (display != NULL) {
            snprintf(name, sizeof name, "display in %.250s", path);
            status = sim_display_parse(&out->display, display, name, error);
        }
        if (camera != NULL && status == BRACE_OK) {
            snprintf(name, sizeof name, "camera in %.250s", path);
            status = sim_camera_parse(&out->camera, camera, name, error);
            out->has_camera = status == BRACE_OK;
        }
        free(display);
        free(camera);
    }
    json_check_destroy(doc);
    if (status != BRACE_OK)
        sim_scene_file_free(out);
    return status;
}

void sim_scene_file_free(sim_scene_file *file) {
    sim_display_destroy(file->display);
    memset(file, 0, sizeof *file);
}
