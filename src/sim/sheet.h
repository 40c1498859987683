/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SIM_SHEET_H
#define SIM_SHEET_H

#include "sim/simulate.h"

/* A picture of a capture and of its display's light (sheet.c). The caller destroys it. */
brace_status sim_sheet(brace_image **out, const sim_capture *capture, const sim_panel *panel, const sim_scene *scene,
                       const sim_camera *camera, uint32_t screen_width, uint32_t screen_height, const brace_job *job,
                       brace_error *error);

#endif
