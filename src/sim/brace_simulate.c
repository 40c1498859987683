/* SPDX-License-Identifier: Apache-2.0 */
/* brace_simulate.c: the public door to the simulator. */
#include "brace/simulate.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "image/image.h"
#include "sim/simulate.h"

void brace_simulated_destroy(brace_simulated *simulated) {
    if (simulated == NULL)
        return;
    for (size_t i = 0; i < simulated->count; i++)
        brace_frame_destroy(simulated->frames[i]);
    brace_frame_destroy(simulated->truth);
    core_free(simulated->meta);
    core_free(simulated);
}

static void set_scene(sim_scene *scene, const brace_simulate_params *p) {
    sim_scene_sample(scene, p->seed, p->sample, p->field);
    scene->width = p->width > 0 ? p->width : 1024;
    scene->height = p->height > 0 ? p->height : 768;
    scene->frames = p->frames != 0 ? p->frames : scene->frames;
    /* Not "> 0": what is wrong shall be refused, not sampled. */
    scene->reference_time = p->reference_time != 0 ? p->reference_time : scene->reference_time;
    scene->iso = p->iso != 0 ? p->iso : scene->iso;
    scene->level = p->level != 0 ? p->level : scene->level;
    if (p->distance != 0)
        scene->pose.translation[2] = p->distance;
    scene->noise = !p->no_noise;
    if (p->no_tremor)
        scene->tremor_position = scene->tremor_angle = 0;
    if (p->no_lens)
        scene->psf = scene->glare = scene->vignetting = scene->defocus = scene->distortion[0] = scene->distortion[1] =
            0;
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
    result->truth = capture->truth;
    capture->count = 0, capture->truth = NULL;
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
    sim_display *display = NULL;
    sim_camera camera;
    sim_scene scene;
    sim_capture capture = {0};
    set_scene(&scene, params);
    brace_status status = image_check(screen, error);
    if (status == BRACE_OK)
        status = sim_scene_check(&scene, error);
    if (status == BRACE_OK)
        status = sim_display_load(&display, params->display != NULL ? params->display : "led_wall_3840_16", error);
    if (status == BRACE_OK)
        status = sim_camera_load(&camera, params->camera != NULL ? params->camera : "phone_median", error);
    if (status == BRACE_OK)
        status = sim_capture_create(&capture, screen, display, &camera, &scene, job, error);
    if (status == BRACE_OK) {
        status = hand_over(out, &capture, error);
        sim_capture_free(&capture);
    }
    sim_display_destroy(display);
    return status;
}
