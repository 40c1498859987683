/* SPDX-License-Identifier: Apache-2.0 */
/* simulate.h: one capture, from a picture on a display to RAW frames. */
#ifndef SIM_SIMULATE_H
#define SIM_SIMULATE_H

#include "brace/frame.h"
#include "sim/sim.h"

/* Linear-light screen content with its mip pyramid: level 0 has the picture's size, each next half of it. */
typedef struct sim_texture {
    uint32_t width, height;
    int levels;
    struct {
        uint32_t width, height;
        float *rgb;
    } level[16];
} sim_texture;

/* No display has more: 8K has 33 million. */
#define SIM_SCREEN_PIXELS 64000000

/* From any picture of 1x1 up to BRACE_MAX_PIXELS. */
brace_status sim_texture_create(sim_texture *out, const brace_image *image, brace_error *error);
void sim_texture_free(sim_texture *texture);
/* Memory for a texture of any content; level 0 is filled by the caller, the others by sim_texture_finish. */
brace_status sim_texture_begin(sim_texture *out, uint32_t width, uint32_t height, brace_error *error);
void sim_texture_finish(sim_texture *texture);
/* The content as a panel of this non-uniformity shows it. */
void sim_texture_uneven(sim_texture *texture, const sim_scene *scene, core_pool *pool);
/* background.c: what stands around the screen, of mean 1, three screens wide and high. */
brace_status sim_background_create(sim_texture *out, const sim_scene *scene, brace_error *error);

/* Light of the camera's three colours for every pixel of a frame, white at the reference exposure is `level`. */
typedef struct sim_light {
    uint32_t width, height;
    float *plane[3];
} sim_light;
brace_status sim_light_create(sim_light *out, uint32_t width, uint32_t height, brace_error *error);
void sim_light_free(sim_light *light);

/* scene.c */
void sim_scene_default(sim_scene *scene);                                            /* steady hand, no effects */
void sim_scene_sample(sim_scene *scene, uint64_t seed, uint32_t sample, bool field); /* a plausible capture */
double sim_frame_start(const sim_scene *scene, double readout, int frame);           /* seconds */
/* The map from pixels to the screen at time t (row-major 3x3, screen in units of its width, origin in its centre). */
void sim_scene_map(double map[9], const sim_scene *scene, double t, double reference_time);

/* quantities.c */
brace_status sim_scene_check(const sim_scene *scene, brace_error *error); /* names the value out of range */
json_t *sim_scene_json(const sim_scene *scene);                           /* new reference */

/* What all frames of a capture have in common. */
typedef struct sim_stage {
    const sim_scene *scene;
    const sim_camera *camera;
    const sim_texture *texture, *background; /* background NULL: black */
    const sim_panel *panel;
    double to_camera[9]; /* linear sRGB to the camera's colours, grey to grey */
} sim_stage;

/* render.c: frame number `frame` (0 the shortest), or one of the truths: mean light where the reference stood, row by
 * row; or, as in the field, one more photograph. */
enum { SIM_EXACT_TRUTH = -1, SIM_FIELD_TRUTH = -2 };
brace_status sim_render(sim_light *out, const sim_stage *stage, int frame, core_pool *pool, brace_error *error);

/* A frame of any exposure at any time, for cameras that are told what to shoot. */
typedef struct sim_shot {
    double start, exposure; /* seconds, of the first row */
    double scale;           /* signal of white under steady light, 1 just clips */
    bool steady;            /* the time mean of the display's light; no motion while the shutter is open */
} sim_shot;
brace_status sim_render_shot(sim_light *out, const sim_stage *stage, const sim_shot *shot, core_pool *pool,
                             brace_error *error);

/* sensor.c: light to raw numbers. `frame` keys the noise; < 0: none. Noise is that of frame->noise. */
brace_status sim_expose(brace_frame *out, const sim_light *light, const sim_scene *scene, int frame, core_pool *pool,
                        brace_error *error);

/* simulate.c */

/* A frame without pixels that has the metadata which this camera would record. */
brace_status sim_frame_create(brace_frame **out, const sim_camera *camera, const sim_scene *scene, double exposure,
                              double iso, double start, brace_error *error);

/* A screen that is switched on in front of a camera: all that frames are rendered from. `stage` borrows scene, display
 * and camera, which must stay where they are until it is freed. */
typedef struct sim_studio {
    sim_stage stage;
    sim_texture texture, background;
    sim_panel *panel;
} sim_studio;
brace_status sim_studio_create(sim_studio *out, const brace_image *screen, const sim_display *display,
                               const sim_camera *camera, const sim_scene *scene, core_pool *pool, brace_error *error);
void sim_studio_free(sim_studio *studio);

typedef struct sim_capture {
    int count;
    brace_frame *frame[9];
    brace_frame *truth;
    brace_frame *exact; /* the exact truth where `truth` is a photograph, otherwise NULL */
    json_t *meta;       /* everything that was set or sampled */
} sim_capture;
brace_status sim_capture_create(sim_capture *out, const brace_image *screen, const sim_display *display,
                                const sim_camera *camera, const sim_scene *scene, const brace_job *job,
                                brace_error *error);
void sim_capture_free(sim_capture *capture);
/* frame_1.dng, ..., gt.dng and, if there is one, gt_exact.dng into a folder that is there. `params` may be NULL. */
brace_status sim_capture_write(const sim_capture *capture, const char *folder, const brace_dng_params *params,
                               const brace_job *job, brace_error *error);

#endif
