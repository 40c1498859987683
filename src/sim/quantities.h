/* SPDX-License-Identifier: Apache-2.0 */
/* quantities.h: the numbers of a scene by name: for JSON, priors and the command line. */
#ifndef SIM_QUANTITIES_H
#define SIM_QUANTITIES_H

#include "sim/json_check.h"
#include "sim/simulate.h"

typedef enum sim_quantity_type { SIM_REAL, SIM_INTEGER, SIM_UNSIGNED, SIM_SEED, SIM_SWITCH } sim_quantity_type;

typedef struct sim_quantity {
    const char *name;
    sim_quantity_type type;
    size_t offset; /* in sim_scene */
    double low, high;
    const double *choices; /* the only values, ends with 0; NULL: all of the range */
    const char *unit;      /* "": none, or relative */
    const char *effect;    /* whose strength it is: 0 switches that off; NULL: of none */
    bool drawn;            /* data sets' priors may speak of it */
    const char *meaning;
} sim_quantity;

extern const sim_quantity sim_quantities[];
extern const size_t sim_quantity_count;

const sim_quantity *sim_quantity_find(const char *name); /* NULL: there is none */
double sim_quantity_get(const sim_scene *scene, const sim_quantity *q);
void sim_quantity_put(sim_scene *scene, const sim_quantity *q, double value);
bool sim_quantity_takes(const sim_quantity *q, double value);
void sim_quantity_range(char *out, size_t size, const sim_quantity *q); /* "0 to 1", "1, 2 or 4" */

/* "psf=1.2", "reference_time=1/320". Refused with the range, or with the names that there are. */
brace_status sim_scene_set(sim_scene *scene, const char *setting, brace_error *error);

/* "noise,tremor": strength 0 of effects, or of quantities that are a strength; "all" of them. */
brace_status sim_scene_off(sim_scene *scene, const char *effects, brace_error *error);

/* Takes what an object holds over, and leaves the rest as it is. Mistakes are the document's. */
void sim_scene_read(sim_scene *scene, const json_at *object);

/* A capture's meta.json, or a scene alone. What the scene does not say is sampled from its seed, or `seed`. */
typedef struct sim_scene_file {
    sim_scene scene;
    sim_display *display; /* NULL: it holds none */
    sim_camera camera;
    bool has_camera;
} sim_scene_file;
brace_status sim_scene_load(sim_scene_file *out, const char *path, uint64_t seed, bool field, brace_error *error);
void sim_scene_file_free(sim_scene_file *file);

#endif
