/* SPDX-License-Identifier: Apache-2.0 */
/*
 * display.c: displays from JSON, panels made ready for a screen, and the part
 * of the light that all drivers share: a subpixel's light repeats with a period
 * that starts at a time of its own.
 */
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sim/data_path.h"
#include "sim/display.h"

static const sim_driver *const drivers[] = {&sim_driver_dc,       &sim_driver_lcd_pwm, &sim_driver_oled_pwm,
                                            &sim_driver_led_spwm, &sim_driver_bcm,     &sim_driver_raster};
enum { DRIVERS = sizeof drivers / sizeof *drivers };

/* Longer shifts than this lose the pulses' exactness and mean a broken file. */
static const uint32_t longest_side = 1u << 20;

/* ---- JSON ---- */

static void *parameter(sim_display *display, const sim_field *f) {
    return (char *)&display->p + f->offset;
}

static void read_integers(const json_at *root, const sim_field *f, int64_t *out) {
    json_at list, element;
    for (size_t i = 0; i < f->count; i++)
        out[i] = (int64_t)f->fallback;
    if (!json_check_array(root, f->key, &list))
        return;
    if (json_array_size(list.value) != f->count) {
        json_check_fail(root, f->key, "%zu whole numbers are expected, not %zu", f->count, json_array_size(list.value));
        return;
    }
    for (size_t i = 0; i < f->count && json_check_element(&list, i, &element); i++) {
        double x = json_number_value(element.value);
        if (!json_is_integer(element.value) || x < f->low || x > f->high)
            json_check_fail(&element, NULL, "a whole number from %.0f to %.0f is expected", f->low, f->high);
        else
            out[i] = json_integer_value(element.value);
    }
}

static void read_field(const json_at *root, sim_display *display, const sim_field *f) {
    bool required = f->fallback <= JSON_CHECK_REQUIRED;
    switch (f->type) {
    case FIELD_NUMBER:
        *(double *)parameter(display, f) = json_check_number(root, f->key, f->low, f->high, f->fallback);
        break;
    case FIELD_INTEGER:
        *(int64_t *)parameter(display, f) =
            json_check_integer(root, f->key, (int64_t)f->low, (int64_t)f->high,
                               required ? JSON_CHECK_REQUIRED_INTEGER : (int64_t)f->fallback);
        break;
    case FIELD_CHOICE:
        *(int64_t *)parameter(display, f) =
            json_check_choice(root, f->key, f->choices, required ? -1 : (int)f->fallback);
        break;
    case FIELD_NUMBERS: {
        double *out = parameter(display, f);
        for (size_t i = 0; i < f->count; i++)
            out[i] = required ? 0 : f->fallback;
        json_check_numbers(root, f->key, out, f->count, f->count, f->low, f->high, required);
        break;
    }
    case FIELD_INTEGERS:
        read_integers(root, f, parameter(display, f));
        break;
    }
}

static void read_text(const json_at *root, const char *key, char *out, size_t size, const char *fallback) {
    snprintf(out, size, "%s", json_check_string(root, key, size - 1, fallback));
}

/* The file's name without folder and ending. */
static void name_from_file(const char *file, char *out, size_t size) {
    const char *base = strrchr(file, '/');
    snprintf(out, size, "%s", base != NULL ? base + 1 : file);
    char *dot = strrchr(out, '.');
    if (dot != NULL && dot != out)
        *dot = '\0';
}

/* Keys that a driver reads itself are the ones that its json() adds. */
static void check_keys(const json_at *root, sim_display *display) {
    const char *keys[64] = {"name", "family", "driver", "description", "source"};
    size_t n = 5;
    for (size_t i = 0; i < display->driver->field_count; i++)
        keys[n++] = display->driver->fields[i].key;
    if (display->kind == SIM_BCM) {
        keys[n++] = "order";
        keys[n++] = "windows";
    }
    keys[n] = NULL;
    json_check_only(root, keys);
}

static bool is_real(const sim_field *f) {
    return f->type == FIELD_NUMBER || f->type == FIELD_NUMBERS;
}

bool sim_display_varies(const char *key) {
    for (int d = 0; d < DRIVERS; d++)
        for (size_t i = 0; i < drivers[d]->field_count; i++)
            if (is_real(&drivers[d]->fields[i]) && strcmp(drivers[d]->fields[i].key, key) == 0)
                return true;
    return false;
}

static void vary(sim_display *display, sim_display_factor *factor, const void *user) {
    for (size_t i = 0; i < display->driver->field_count; i++) {
        const sim_field *f = &display->driver->fields[i];
        double *value = parameter(display, f);
        for (size_t k = 0; is_real(f) && k < (f->type == FIELD_NUMBERS ? f->count : 1); k++)
            value[k] = sim_clamp(value[k] * factor(user, f->key), f->low, f->high);
    }
}

static brace_status read_display(sim_display **out, json_check *doc, const char *file, sim_display_factor *factor,
                                 const void *user, brace_error *error) {
    *out = NULL;
    sim_display *display = core_calloc(1, sizeof *display);
    if (display == NULL)
        return core_fail_memory(error, sizeof *display, "a display");
    json_at root = json_check_root(doc);
    const char *names[DRIVERS + 1] = {NULL};
    for (int i = 0; i < DRIVERS; i++)
        names[i] = drivers[i]->name;
    display->kind = (sim_driver_kind)json_check_choice(&root, "driver", names, -1);
    display->driver = drivers[display->kind];
    char name[256];
    name_from_file(file, name, sizeof display->name);
    check_keys(&root, display);
    read_text(&root, "name", display->name, sizeof display->name, name);
    read_text(&root, "family", display->family, sizeof display->family, "other");
    read_text(&root, "description", display->description, sizeof display->description, "");
    read_text(&root, "source", display->source, sizeof display->source, "");
    for (size_t i = 0; i < display->driver->field_count; i++)
        read_field(&root, display, &display->driver->fields[i]);
    if (factor != NULL)
        vary(display, factor, user);
    if (json_check_status(doc, NULL) == BRACE_OK && display->driver->check != NULL)
        display->driver->check(&root, display);
    brace_status status = json_check_status(doc, error);
    if (status != BRACE_OK) {
        core_free(display);
        return status;
    }
    *out = display;
    return BRACE_OK;
}

brace_status sim_display_parse(sim_display **out, const char *json, const char *name, brace_error *error) {
    *out = NULL;
    json_check *doc;
    brace_status status = json_check_parse(&doc, json, name, error);
    if (status == BRACE_OK) {
        status = read_display(out, doc, name, NULL, NULL, error);
        json_check_destroy(doc);
    }
    return status;
}

brace_status sim_display_load(sim_display **out, const char *name_or_path, brace_error *error) {
    return sim_display_load_varied(out, name_or_path, NULL, NULL, error);
}

brace_status sim_display_load_varied(sim_display **out, const char *name_or_path, sim_display_factor *factor,
                                     const void *user, brace_error *error) {
    *out = NULL;
    char path[PATH_MAX];
    brace_status status = sim_data_path(path, "displays", name_or_path, error);
    if (status != BRACE_OK)
        return status;
    json_check *doc;
    status = json_check_load(&doc, path, error);
    if (status == BRACE_OK) {
        status = read_display(out, doc, path, factor, user, error);
        json_check_destroy(doc);
    }
    return status;
}

void sim_display_destroy(sim_display *display) {
    core_free(display);
}

sim_driver_kind sim_display_kind(const sim_display *display) {
    return display->kind;
}

const char *sim_display_name(const sim_display *display) {
    return display->name;
}

const char *sim_display_family(const sim_display *display) {
    return display->family;
}

json_t *sim_display_json(const sim_display *display) {
    json_t *out = json_object();
    if (out == NULL)
        return NULL;
    json_object_set_new(out, "name", json_string(display->name));
    json_object_set_new(out, "family", json_string(display->family));
    json_object_set_new(out, "driver", json_string(display->driver->name));
    if (display->description[0] != '\0')
        json_object_set_new(out, "description", json_string(display->description));
    if (display->source[0] != '\0')
        json_object_set_new(out, "source", json_string(display->source));
    for (size_t i = 0; i < display->driver->field_count; i++) {
        const sim_field *f = &display->driver->fields[i];
        const void *at = (const char *)&display->p + f->offset;
        json_t *value = NULL;
        switch (f->type) {
        case FIELD_NUMBER:
            value = json_real(*(const double *)at);
            break;
        case FIELD_INTEGER:
            value = json_integer(*(const int64_t *)at);
            break;
        case FIELD_CHOICE:
            value = json_string(f->choices[*(const int64_t *)at]);
            break;
        case FIELD_NUMBERS:
        case FIELD_INTEGERS:
            value = json_array();
            for (size_t k = 0; k < f->count; k++)
                json_array_append_new(value, f->type == FIELD_NUMBERS ? json_real(((const double *)at)[k])
                                                                      : json_integer(((const int64_t *)at)[k]));
            break;
        }
        json_object_set_new(out, f->key, value);
    }
    if (display->driver->json != NULL)
        display->driver->json(display, out);
    return out;
}

/* ---- panels ---- */

brace_status sim_panel_tiles(sim_panel *panel, double tile_width, double tile_height, brace_error *error) {
    panel->tile_rate_x = 1 / tile_width;
    panel->tile_rate_y = 1 / tile_height;
    /* A rounded tile size may leave a sliver at the far edge: it belongs to the last tile. */
    panel->tile_columns = (uint32_t)ceil(panel->width / tile_width - 1e-6);
    panel->tile_rows = (uint32_t)ceil(panel->height / tile_height - 1e-6);
    panel->tile_columns = panel->tile_columns > 0 ? panel->tile_columns : 1;
    panel->tile_rows = panel->tile_rows > 0 ? panel->tile_rows : 1;
    panel->tile_count = (size_t)panel->tile_columns * panel->tile_rows;
    panel->tile_start = core_calloc(panel->tile_count, sizeof *panel->tile_start);
    if (panel->tile_start == NULL)
        return core_fail_memory(error, panel->tile_count * sizeof *panel->tile_start, "a display's tiles");
    return BRACE_OK;
}

brace_status sim_panel_create(sim_panel **out, const sim_display *display, const float *rgb, uint32_t width,
                              uint32_t height, brace_error *error) {
    *out = NULL;
    if (width == 0 || height == 0 || width > longest_side || height > longest_side)
        return core_fail(error, BRACE_ERROR_ARGUMENT, "a screen of %u x %u pixels: 1 to %u on each side are possible",
                         width, height, longest_side);
    sim_panel *panel = core_calloc(1, sizeof *panel);
    if (panel == NULL)
        return core_fail_memory(error, sizeof *panel, "a display");
    panel->display = display;
    panel->driver = display->driver;
    panel->width = width;
    panel->height = height;
    panel->scan = panel->scan_rate = 1;
    brace_status status = panel->driver->prepare(panel, rgb, error);
    if (status != BRACE_OK) {
        sim_panel_destroy(panel);
        return status;
    }
    panel->rate = 1 / panel->period;
    *out = panel;
    return BRACE_OK;
}

void sim_panel_destroy(sim_panel *panel) {
    if (panel == NULL)
        return;
    if (panel->driver->release != NULL)
        panel->driver->release(panel);
    core_free(panel->tile_start);
    core_free(panel);
}

static uint32_t tile_index(uint32_t at, double rate, uint32_t count) {
    uint32_t i = (uint32_t)(((double)at + 0.5) * rate);
    return i < count ? i : count - 1;
}

size_t sim_panel_tile(const sim_panel *panel, uint32_t x, uint32_t y) {
    if (panel->tile_start == NULL)
        return 0;
    return (size_t)tile_index(y, panel->tile_rate_y, panel->tile_rows) * panel->tile_columns +
           tile_index(x, panel->tile_rate_x, panel->tile_columns);
}

double sim_panel_start(const sim_panel *panel, uint32_t x, uint32_t y, int channel) {
    double start = panel->start_channel[channel] + x * panel->start_x + y * panel->start_y;
    if (panel->scan > 1)
        start += (y % (uint32_t)panel->scan) * panel->start_scan;
    if (panel->tile_start != NULL)
        start += panel->tile_start[sim_panel_tile(panel, x, y)];
    return start;
}

double sim_panel_period(const sim_panel *panel) {
    return panel->period;
}

/* Whole periods in t, and the rest in [0, period]. */
static double split(const sim_panel *panel, double t, double *phase) {
    double whole = floor(t * panel->rate);
    *phase = sim_clamp(t - whole * panel->period, 0, panel->period);
    return whole;
}

/* Light from a to b, of the subpixel whose period starts at 0. */
static double light_between(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double a,
                            double b) {
    double phase_a, phase_b;
    double whole = -split(panel, a, &phase_a);
    whole += split(panel, b, &phase_b);
    return whole * level * panel->period + panel->driver->light(panel, x, y, channel, level, phase_b) -
           panel->driver->light(panel, x, y, channel, level, phase_a);
}

double sim_panel_cumulative(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double t) {
    double start = sim_panel_start(panel, x, y, channel);
    return light_between(panel, x, y, channel, level, -start, t - start);
}

double sim_panel_emission(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double t) {
    double phase;
    split(panel, t - sim_panel_start(panel, x, y, channel), &phase);
    return panel->driver->emission(panel, x, y, channel, level, phase);
}

static int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

size_t sim_panel_edges(const sim_panel *panel, uint32_t x, uint32_t y, int channel, double level, double *out,
                       size_t size) {
    size_t n = panel->driver->edges(panel, x, y, channel, level, out, size);
    double start = sim_panel_start(panel, x, y, channel);
    for (size_t i = 0; i < n; i++)
        split(panel, out[i] + start, &out[i]);
    qsort(out, n, sizeof *out, by_value);
    return n;
}

/* ---- the plain kernel: the truth, sample by sample ---- */

static uint32_t inside(int32_t at, uint32_t size) {
    return at <= 0 ? 0 : (uint32_t)at < size ? (uint32_t)at : size - 1;
}

void sim_light_plain(const sim_panel *panel, size_t n, const int32_t *x, const int32_t *y, const float *level,
                     int channel, const double *start, double exposure, float *out) {
    double rate = 1 / exposure;
    for (size_t i = 0; i < n; i++) {
        uint32_t px = inside(x[i], panel->width), py = inside(y[i], panel->height);
        double a = start[i] - sim_panel_start(panel, px, py, channel);
        out[i] = (float)(light_between(panel, px, py, channel, (double)level[i], a, a + exposure) * rate);
    }
}
