/* SPDX-License-Identifier: Apache-2.0 */
/* data_path.h: where presets and weights lie: $BRACE_DATA, else where they were installed, else the source tree. */
#ifndef SIM_DATA_PATH_H
#define SIM_DATA_PATH_H

#include <jansson.h>

#include "core/core.h"

/* The file that is meant by a preset's name ("led_wall_3840") or by a path to a
 * file of one's own (anything with a slash or a dot), into `path` of PATH_MAX
 * bytes. `kind` is the folder ("displays", "cameras"). An unknown name is
 * refused with the list of what there is. */
brace_status sim_data_path(char *path, const char *kind, const char *name_or_path, brace_error *error);

/* A folder of data ("screens") itself. */
brace_status sim_data_folder(char *path, const char *kind, brace_error *error);

/* The weights of the network NAME, if they are there: NAME.safetensors in $BRACE_MODELS and nowhere else, or in models/ of
 * $BRACE_DATA, of the installed data, of the source tree. Into `path` of PATH_MAX bytes. */
bool sim_data_model(char *path, const char *name);

/* The presets' names in order, without ".json": a new array of strings, perhaps empty; NULL when memory ends. */
json_t *sim_data_names(const char *kind);

#endif
