/* SPDX-License-Identifier: Apache-2.0 */
/* camera.c: camera presets: what a sensor is, as JSON (docs/cameras.md). */
#include <limits.h>
#include <string.h>

#include "brace/frame.h"
#include "sim/data_path.h"
#include "sim/json_check.h"
#include "sim/sim.h"

static void copy(char *to, size_t size, const char *from) {
    snprintf(to, size, "%s", from);
}

static brace_status read_camera(sim_camera *c, json_check *doc, const char *path, brace_error *error) {
    static const char *const keys[] = {
        "name",         "source",      "make",        "model",    "width",    "height",  "readout",
        "bits",         "black",       "white",       "f_number", "iso_base", "noise_s", "noise_o",
        "focal_length", "noise_s_iso", "noise_o_iso", "neutral",  "matrix",   "cfa",     NULL};
    static const char *const orders[] = {"RGGB", "GRBG", "GBRG", "BGGR", NULL};
    json_at root = json_check_root(doc);
    memset(c, 0, sizeof *c);
    json_check_only(&root, keys);
    const char *base = strrchr(path, '/');
    copy(c->name, sizeof c->name, json_check_string(&root, "name", 63, base ? base + 1 : path));
    json_check_string(&root, "source", 1023, "");
    copy(c->make, sizeof c->make, json_check_string(&root, "make", 63, NULL));
    copy(c->model, sizeof c->model, json_check_string(&root, "model", 63, NULL));
    c->width = (uint32_t)json_check_integer(&root, "width", 64, 20000, JSON_CHECK_REQUIRED_INTEGER);
    c->height = (uint32_t)json_check_integer(&root, "height", 64, 20000, JSON_CHECK_REQUIRED_INTEGER);
    c->readout = json_check_number(&root, "readout", 1e-4, 1, JSON_CHECK_REQUIRED);
    c->bits = (int)json_check_integer(&root, "bits", 8, 16, JSON_CHECK_REQUIRED_INTEGER);
    c->white = json_check_number(&root, "white", 100, 65535, JSON_CHECK_REQUIRED);
    json_check_numbers(&root, "black", c->black, 4, 4, 0, 16384, true);
    c->f_number = json_check_number(&root, "f_number", 0.7, 64, JSON_CHECK_REQUIRED);
    c->focal_length = json_check_number(&root, "focal_length", 1, 2000, JSON_CHECK_REQUIRED);
    c->iso_base = json_check_number(&root, "iso_base", 10, 10000, JSON_CHECK_REQUIRED);
    c->noise_s = json_check_number(&root, "noise_s", 1e-7, 0.1, JSON_CHECK_REQUIRED);
    c->noise_o = json_check_number(&root, "noise_o", 0, 0.1, JSON_CHECK_REQUIRED);
    c->noise_s_iso = json_check_number(&root, "noise_s_iso", 0, 3, 1);
    c->noise_o_iso = json_check_number(&root, "noise_o_iso", 0, 4, 2);
    json_check_numbers(&root, "neutral", c->neutral, 3, 3, 0.05, 2, true);
    json_check_numbers(&root, "matrix", c->matrix, 9, 9, -5, 5, true);
    c->cfa = json_check_choice(&root, "cfa", orders, 0);
    for (int i = 0; i < 4; i++)
        if (c->black[i] > 0.5 * c->white)
            json_check_fail(&root, "black", "%g is not below half of white, %g", c->black[i], c->white);
    return json_check_status(doc, error);
}

brace_status sim_camera_load(sim_camera *out, const char *name_or_path, brace_error *error) {
    char path[PATH_MAX];
    json_check *doc;
    brace_status status = sim_data_path(path, "cameras", name_or_path, error);
    if (status == BRACE_OK)
        status = json_check_load(&doc, path, error);
    if (status != BRACE_OK)
        return status;
    status = read_camera(out, doc, path, error);
    json_check_destroy(doc);
    return status;
}

brace_status sim_camera_parse(sim_camera *out, const char *json, const char *name, brace_error *error) {
    json_check *doc;
    brace_status status = json_check_parse(&doc, json, name, error);
    if (status != BRACE_OK)
        return status;
    status = read_camera(out, doc, name, error);
    json_check_destroy(doc);
    return status;
}

json_t *sim_camera_json(const sim_camera *c) {
    json_t *black = json_array(), *neutral = json_array(), *matrix = json_array();
    for (int i = 0; i < 4; i++)
        json_array_append_new(black, json_real(c->black[i]));
    for (int i = 0; i < 3; i++)
        json_array_append_new(neutral, json_real(c->neutral[i]));
    for (int i = 0; i < 9; i++)
        json_array_append_new(matrix, json_real(c->matrix[i]));
    return json_pack("{s:s,s:s,s:s,s:i,s:i,s:f,s:i,s:f,s:o,s:f,s:f,s:f,s:f,s:f,s:f,s:f,s:o,s:o,s:s}", "name", c->name,
                     "make", c->make, "model", c->model, "width", (int)c->width, "height", (int)c->height, "readout",
                     c->readout, "bits", c->bits, "white", c->white, "black", black, "f_number", c->f_number,
                     "focal_length", c->focal_length, "iso_base", c->iso_base, "noise_s", c->noise_s, "noise_o",
                     c->noise_o, "noise_s_iso", c->noise_s_iso, "noise_o_iso", c->noise_o_iso, "neutral", neutral,
                     "matrix", matrix, "cfa", brace_cfa_name((brace_cfa)c->cfa));
}
