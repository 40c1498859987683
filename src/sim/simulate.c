/* SPDX-License-Identifier: Apache-2.0 */
/* simulate.c: one capture: a bracket of RAW frames of a screen, and the truth. */
#include "sim/simulate.h"

#include <math.h>
#include <string.h>

#include "brace/develop.h"

static brace_status make_frame(brace_frame **out, const sim_camera *camera, const sim_scene *scene, double exposure,
                               double iso, double start, brace_error *error) {
    brace_frame *f;
    brace_status status = brace_frame_create(&f, scene->width, scene->height, (brace_cfa)camera->cfa, error);
    if (status != BRACE_OK)
        return status;
    for (int i = 0; i < 4; i++)
        f->black[i] = (float)camera->black[i];
    f->white = (float)camera->white;
    f->exposure_time = exposure, f->iso = iso;
    f->f_number = camera->f_number, f->focal_length = camera->focal_length;
    memcpy(f->as_shot_neutral, camera->neutral, sizeof camera->neutral);
    memcpy(f->color_matrix[0], camera->matrix, sizeof camera->matrix);
    f->illuminant[0] = 21;
    for (int c = 0; c < 3; c++) {
        f->noise[c][0] = camera->noise_s * pow(iso / camera->iso_base, camera->noise_s_iso);
        f->noise[c][1] = camera->noise_o * pow(iso / camera->iso_base, camera->noise_o_iso);
    }
    f->has_noise = true;
    snprintf(f->make, sizeof f->make, "%s", camera->make);
    snprintf(f->model, sizeof f->model, "%s", camera->model);
    snprintf(f->unique_model, sizeof f->unique_model, "%s (simulated)", camera->model);
    /* Simulated time begins with the century. */
    unsigned second = (unsigned)fmin(start, 86399);
    snprintf(f->datetime, sizeof f->datetime, "2000:01:01 %02u:%02u:%02u", second / 3600, second / 60 % 60,
             second % 60);
    snprintf(f->subsec, sizeof f->subsec, "%03u", (unsigned)((start - floor(start)) * 1000));
    *out = f;
    return BRACE_OK;
}

static brace_status capture_frame(brace_frame *f, const sim_scene *scene, const sim_camera *camera,
                                  const sim_texture *texture, const sim_panel *panel, int frame,
                                  const double to_camera[9], sim_light *light, core_pool *pool, brace_error *error) {
    brace_status status = sim_render(light, scene, camera, texture, panel, frame, to_camera, pool, error);
    if (status == BRACE_OK)
        status = sim_degrade(light, scene, pool, error);
    if (status == BRACE_OK) /* a truth from the field has noise of its own, keyed after the frames' */
        sim_expose(f, light, scene, frame < 0 && scene->field ? scene->frames : frame, pool);
    return status;
}

void sim_capture_free(sim_capture *capture) {
    for (int i = 0; i < capture->count; i++)
        brace_frame_destroy(capture->frame[i]);
    brace_frame_destroy(capture->truth);
    json_decref(capture->meta);
    *capture = (sim_capture){0};
}

brace_status sim_capture_create(sim_capture *out, const brace_image *screen, const sim_display *display,
                                const sim_camera *camera, const sim_scene *scene, const brace_job *job,
                                brace_error *error) {
    *out = (sim_capture){0};
    sim_texture texture = {0};
    sim_panel *panel = NULL;
    sim_light light = {0};
    core_pool *pool = NULL;
    brace_status status = sim_scene_check(scene, error);
    if (status == BRACE_OK)
        status = core_pool_create(&pool, job, error);
    if (status == BRACE_OK)
        status = sim_texture_create(&texture, screen, error);
    if (status == BRACE_OK)
        status = sim_panel_create(&panel, display, texture.level[0].rgb, texture.width, texture.height, error);
    if (status == BRACE_OK)
        status = sim_light_create(&light, scene->width, scene->height, error);
    const int middle = scene->frames / 2;
    double to_camera[9] = {0};
    for (int i = 0; i < scene->frames && status == BRACE_OK; i++) {
        if ((status = core_check_cancel(job, error)) != BRACE_OK)
            break;
        status = make_frame(&out->frame[i], camera, scene, ldexp(scene->reference_time, 2 * (i - middle)), scene->iso,
                            sim_frame_start(scene, camera->readout, i), error);
        if (status != BRACE_OK)
            break;
        out->count = i + 1;
        if (i == 0) {
            brace_color color;
            if ((status = brace_color_init(&color, out->frame[0], error)) != BRACE_OK)
                break;
            for (int k = 0; k < 9; k++)
                to_camera[k] = color.srgb_to_camera[k] / color.wb[k / 3];
        }
        status = capture_frame(out->frame[i], scene, camera, &texture, panel, i, to_camera, &light, pool, error);
    }
    if (status == BRACE_OK)
        status =
            make_frame(&out->truth, camera, scene, scene->field ? 8 * scene->reference_time : scene->reference_time,
                       scene->field ? scene->iso / 8 : scene->iso,
                       sim_frame_start(scene, camera->readout, scene->field ? -1 : middle), error);
    if (status == BRACE_OK) {
        if (!scene->field) /* as good as noiseless, and readers that want a profile have one */
            for (int c = 0; c < 3; c++)
                out->truth->noise[c][0] = out->truth->noise[c][1] = 1e-9;
        status = capture_frame(out->truth, scene, camera, &texture, panel, -1, to_camera, &light, pool, error);
    }
    if (status == BRACE_OK) {
        out->meta =
            json_pack("{s:o,s:o,s:o,s:[i,i]}", "scene", sim_scene_json(scene), "display", sim_display_json(display),
                      "camera", sim_camera_json(camera), "screen_size", (int)screen->width, (int)screen->height);
        if (!out->meta)
            status = core_fail_memory(error, 4096, "the sample's description");
    }
    sim_light_free(&light);
    sim_panel_destroy(panel);
    sim_texture_free(&texture);
    core_pool_destroy(pool);
    if (status != BRACE_OK)
        sim_capture_free(out);
    return status;
}
