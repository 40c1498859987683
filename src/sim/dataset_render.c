/* SPDX-License-Identifier: Apache-2.0 */
/*
 * dataset_render.c: one sample of a set out of the simulator: its screen on its
 * display before its camera, the scene sampled and then bent to the priors.
 */
#include "sim/data_path.h"
#include "sim/dataset.h"
#include "sim/dataset_priors.h"
#include "sim/screen.h"
#include "sim/simulate.h"

enum { STREAM_PRESET = 0x44530010 };

/* The camera that the priors chose, or any of the presets. */
static brace_status load_camera(sim_camera *out, const dataset_task *task, brace_error *error) {
    if (task->camera != NULL) {
        return sim_camera_load(out, task->camera, error);
    }
    json_t *names = sim_data_names("cameras");
    size_t count = json_array_size(names);
    core_random r = core_random_create(task->seed, task->sample, 0, STREAM_PRESET);
    brace_status status =
        count > 0 ? sim_camera_load(out, json_string_value(json_array_get(names, core_random_below(&r, (uint32_t)count))),
                                    error)
                  : core_fail(error, BRACE_ERROR_IO, "no camera presets are there; set BRACE_DATA to the data folder");
    json_decref(names);
    return status;
}

brace_status dataset_capture(sim_capture *out, const dataset_task *task, const brace_job *job, brace_error *error) {
    brace_image *screen = NULL;
    sim_display *display = NULL;
    sim_camera camera;
    *out = (sim_capture){0};
    brace_status status = sim_screen_read(&screen, NULL, task->screen, job, error);
    if (status == BRACE_OK) {
        status = dataset_priors_display(&display, task->priors, task->display, task->seed, task->sample, error);
    }
    if (status == BRACE_OK) {
        status = load_camera(&camera, task, error);
    }
    if (status == BRACE_OK) {
        sim_scene scene;
        sim_scene_sample(&scene, task->seed, task->sample, task->field);
        scene.width = task->width;
        scene.height = task->height;
        dataset_priors_scene(&scene, task->priors, task->seed, task->sample);
        status = sim_capture_create(out, screen, display, &camera, &scene, job, error);
    }
    sim_display_destroy(display);
    brace_image_destroy(screen);
    return status;
}

brace_status dataset_render(void *user, const dataset_task *task, const char *folder, json_t **meta,
                            const brace_job *job, brace_error *error) {
    (void)user;
    *meta = NULL;
    sim_capture capture;
    brace_status status = dataset_capture(&capture, task, job, error);
    if (status == BRACE_OK) {
        status = sim_capture_write(&capture, folder, &(brace_dng_params){.no_preview = true, .no_sync = true}, job, error);
        *meta = json_deep_copy(capture.meta);
        if (status == BRACE_OK && *meta == NULL) {
            status = core_fail_memory(error, 4096, "metadata");
        }
    }
    sim_capture_free(&capture);
    return status;
}
