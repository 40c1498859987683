/* SPDX-License-Identifier: Apache-2.0 */
/* simulate.c: one capture: a bracket of RAW frames of a screen, and the truth. */
#include "sim/simulate.h"

#include <limits.h>
#include <math.h>
#include <string.h>

#include "brace/develop.h"

brace_status sim_frame_create(brace_frame **out, const sim_camera *camera, const sim_scene *scene, double exposure,
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
    /* The profile is a variance. A sensor that is told to be noiseless keeps that of its kind. */
    const double variance = scene->noise > 0 ? scene->noise * scene->noise : 1;
    for (int c = 0; c < 3; c++) {
        f->noise[c][0] = variance * camera->noise_s * pow(iso / camera->iso_base, camera->noise_s_iso);
        f->noise[c][1] = variance * camera->noise_o * pow(iso / camera->iso_base, camera->noise_o_iso);
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

static brace_status capture_frame(brace_frame *f, const sim_stage *stage, int frame, sim_light *light, core_pool *pool,
                                  brace_error *error) {
    brace_status status = sim_render(light, stage, frame, pool, error);
    if (status == BRACE_OK) /* a truth from the field has noise of its own, keyed after the frames' */
        status =
            sim_expose(f, light, stage->scene, frame == SIM_FIELD_TRUTH ? stage->scene->frames : frame, pool, error);
    return status;
}

static brace_status capture_truth(brace_frame **out, const sim_stage *stage, int kind, sim_light *light, core_pool *pool,
                                  brace_error *error) {
    const sim_scene *s = stage->scene;
    const bool field = kind == SIM_FIELD_TRUTH;
    brace_status status = sim_frame_create(out, stage->camera, s, field ? 8 * s->reference_time : s->reference_time,
                                     field ? s->iso / 8 : s->iso,
                                     sim_frame_start(s, stage->camera->readout, field ? -1 : s->frames / 2), error);
    for (int c = 0; c < 3 && status == BRACE_OK && !field; c++) /* as good as noiseless: readers expect a profile */
        (*out)->noise[c][0] = (*out)->noise[c][1] = 1e-9;
    return status == BRACE_OK ? capture_frame(*out, stage, kind, light, pool, error) : status;
}

void sim_capture_free(sim_capture *capture) {
    for (int i = 0; i < capture->count; i++)
        brace_frame_destroy(capture->frame[i]);
    brace_frame_destroy(capture->truth);
    brace_frame_destroy(capture->exact);
    json_decref(capture->meta);
    *capture = (sim_capture){0};
}

brace_status sim_studio_create(sim_studio *out, const brace_image *screen, const sim_display *display,
                               const sim_camera *camera, const sim_scene *scene, core_pool *pool, brace_error *error) {
    *out = (sim_studio){0};
    brace_frame *sample = NULL;
    brace_color color;
    brace_status status = sim_scene_check(scene, error);
    if (status == BRACE_OK)
        status = sim_texture_create(&out->texture, screen, error);
    if (status == BRACE_OK && scene->panel_nonuniformity > 0)
        sim_texture_uneven(&out->texture, scene, pool);
    if (status == BRACE_OK)
        status = sim_panel_create(&out->panel, display, out->texture.level[0].rgb, out->texture.width,
                                  out->texture.height, error);
    if (status == BRACE_OK && scene->clutter > 0)
        status = sim_background_create(&out->background, scene, error);
    if (status == BRACE_OK)
        status = sim_frame_create(&sample, camera, scene, scene->reference_time, scene->iso, 0, error);
    if (status == BRACE_OK)
        status = brace_color_init(&color, sample, error);
    brace_frame_destroy(sample);
    if (status != BRACE_OK) {
        sim_studio_free(out);
        return status;
    }
    out->stage = (sim_stage){.scene = scene,
                             .camera = camera,
                             .texture = &out->texture,
                             .background = out->background.levels > 0 ? &out->background : NULL,
                             .panel = out->panel};
    for (int k = 0; k < 9; k++)
        out->stage.to_camera[k] = color.srgb_to_camera[k] / color.wb[k / 3];
    return BRACE_OK;
}

void sim_studio_free(sim_studio *studio) {
    sim_panel_destroy(studio->panel);
    sim_texture_free(&studio->background);
    sim_texture_free(&studio->texture);
    *studio = (sim_studio){0};
}

brace_status sim_capture_create(sim_capture *out, const brace_image *screen, const sim_display *display,
                                const sim_camera *camera, const sim_scene *scene, const brace_job *job,
                                brace_error *error) {
    *out = (sim_capture){0};
    sim_studio studio = {0};
    sim_light light = {0};
    core_pool *pool = NULL;
    brace_status status = core_pool_create(&pool, job, error);
    if (status == BRACE_OK)
        status = sim_studio_create(&studio, screen, display, camera, scene, pool, error);
    if (status == BRACE_OK)
        status = sim_light_create(&light, scene->width, scene->height, error);
    for (int i = 0; status == BRACE_OK && i < scene->frames; i++) {
        if ((status = core_check_cancel(job, error)) != BRACE_OK)
            break;
        status =
            sim_frame_create(&out->frame[i], camera, scene, ldexp(scene->reference_time, 2 * (i - scene->frames / 2)),
                             scene->iso, sim_frame_start(scene, camera->readout, i), error);
        if (status != BRACE_OK)
            break;
        out->count = i + 1;
        status = capture_frame(out->frame[i], &studio.stage, i, &light, pool, error);
    }
    if (status == BRACE_OK)
        status = capture_truth(&out->truth, &studio.stage, scene->field ? SIM_FIELD_TRUTH : SIM_EXACT_TRUTH, &light,
                               pool, error);
    if (status == BRACE_OK && scene->field)
        status = capture_truth(&out->exact, &studio.stage, SIM_EXACT_TRUTH, &light, pool, error);
    if (status == BRACE_OK) {
        out->meta =
            json_pack("{s:o,s:o,s:o,s:[i,i]}", "scene", sim_scene_json(scene), "display", sim_display_json(display),
                      "camera", sim_camera_json(camera), "screen_size", (int)screen->width, (int)screen->height);
        if (!out->meta)
            status = core_fail_memory(error, 4096, "the sample's description");
    }
    sim_light_free(&light);
    sim_studio_free(&studio);
    core_pool_destroy(pool);
    if (status != BRACE_OK)
        sim_capture_free(out);
    return status;
}

brace_status sim_capture_write(const sim_capture *capture, const char *folder, const brace_dng_params *params,
                               const brace_job *job, brace_error *error) {
    brace_status status = BRACE_OK;
    for (int i = 0; i < capture->count + 2 && status == BRACE_OK; i++) {
        const int truth = i - capture->count; /* 0, 1: the truths */
        const brace_frame *frame = truth < 0 ? capture->frame[i] : truth == 0 ? capture->truth : capture->exact;
        char path[PATH_MAX];
        int n = truth < 0    ? snprintf(path, sizeof path, "%s/frame_%d.dng", folder, i + 1)
                : truth == 0 ? snprintf(path, sizeof path, "%s/gt.dng", folder)
                             : snprintf(path, sizeof path, "%s/gt_exact.dng", folder);
        if (n >= (int)sizeof path)
            status = core_fail(error, BRACE_ERROR_ARGUMENT, "%.200s...: the name is too long", folder);
        else if (frame != NULL)
            status = brace_frame_write_dng(frame, path, params, job, error);
    }
    return status;
}
