/* SPDX-License-Identifier: Apache-2.0 */
/* brace_simulate.c: the public door to the simulator. */
#include "brace/simulate.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "image/image.h"
#include "sim/quantities.h"
#include "sim/simulate.h"

void brace_simulated_destroy(brace_simulated *simulated) {
    if (simulated == NULL)
        return;
    for (size_t i = 0; i < simulated->count; i++)
        brace_frame_destroy(simulated->frames[i]);
    brace_frame_destroy(simulated->truth);
    brace_frame_destroy(simulated->exact);
    core_free(simulated->meta);
    core_free(simulated);
}

/* What one parameter asks for; a file given as `scene` brings its display and camera. */
static brace_status make_scene(sim_scene_file *out, const brace_simulate_params *p, brace_error *error) {
    brace_status status = BRACE_OK;
    if (p->scene != NULL) {
        status = sim_scene_load(out, p->scene, p->seed, p->field, error);
    } else {
        memset(out, 0, sizeof *out);
        sim_scene_sample(&out->scene, p->seed, p->sample, p->field);
    }
    sim_scene *s = &out->scene;
    s->field = s->field || p->field;
    s->width = p->width > 0 ? p->width : s->width;
    s->height = p->height > 0 ? p->height : s->height;
    s->frames = p->frames != 0 ? p->frames : s->frames;
    s->reference_time = p->reference_time != 0 ? p->reference_time : s->reference_time;
    s->iso = p->iso != 0 ? p->iso : s->iso;
    s->level = p->level != 0 ? p->level : s->level;
    s->pose.translation[2] = p->distance != 0 ? p->distance : s->pose.translation[2];
    for (size_t i = 0; i < p->set_count && status == BRACE_OK; i++)
        status = sim_scene_set(s, p->set[i], error);
    if (status == BRACE_OK && p->off != NULL)
        status = sim_scene_off(s, p->off, error);
    return status == BRACE_OK ? sim_scene_check(s, error) : status;
}

/* Takes the capture's frames over. */
static brace_status hand_over(brace_simulated **out, sim_capture *capture, brace_error *error) {
    brace_simulated *result = core_calloc(1, sizeof *result);
    char *text = json_dumps(capture->meta, JSON_INDENT(1));
    if (result != NULL && text != NULL)
        result->meta = core_strdup(text);
    free(text);
    if (result == NULL || result->meta == NULL) {
        brace_simulated_destroy(result);
        return core_fail_memory(error, sizeof *result, "a simulated capture");
    }
    result->count = (size_t)capture->count;
    memcpy(result->frames, capture->frame, result->count * sizeof *result->frames);
    result->truth = capture->truth, result->exact = capture->exact;
    capture->count = 0, capture->truth = capture->exact = NULL;
    *out = result;
    return BRACE_OK;
}

brace_status brace_simulate(brace_simulated **out, const brace_image *screen, const brace_simulate_params *params,
                            const brace_job *job, brace_error *error) {
    static const brace_simulate_params defaults;
    if (out == NULL || screen == NULL)
        return core_fail(error, BRACE_ERROR_ARGUMENT, "brace_simulate: a screen and a place for the result are needed");
    *out = NULL;
    if (params == NULL)
        params = &defaults;
    sim_scene_file file = {0};
    sim_capture capture = {0};
    brace_status status = image_check(screen, error);
    if (status == BRACE_OK)
        status = make_scene(&file, params, error);
    if (status == BRACE_OK && (params->display != NULL || file.display == NULL)) {
        sim_display_destroy(file.display);
        file.display = NULL;
        status = sim_display_load(&file.display, params->display != NULL ? params->display : "led_wall_3840_16", error);
    }
    if (status == BRACE_OK && (params->camera != NULL || !file.has_camera))
        status = sim_camera_load(&file.camera, params->camera != NULL ? params->camera : "phone_median", error);
    if (status == BRACE_OK)
        status = sim_capture_create(&capture, screen, file.display, &file.camera, &file.scene, job, error);
    if (status == BRACE_OK) {
        status = hand_over(out, &capture, error);
        sim_capture_free(&capture);
    }
    sim_scene_file_free(&file);
    return status;
}
