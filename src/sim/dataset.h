/* SPDX-License-Identifier: Apache-2.0 */
/*
 * dataset.h: sets of samples on disk.
 *
 * A sample is a folder with frame_1.dng (the shortest exposure) to
 * frame_N.dng, gt.dng and meta.json; gt_exact.dng, too, if gt.dng is a simulated
 * photograph. A set is a folder of samples, or one with
 * train/ and test/ that hold them; dataset.json beside them says what belongs
 * to it. Names that begin with a dot are work in progress and never counted: a
 * sample is made under such a name, synced and renamed.
 * docs/dataset.md has the formats.
 */
#ifndef SIM_DATASET_H
#define SIM_DATASET_H

#include <jansson.h>

#include "brace/bracket.h"
#include "core/core.h"

#define DATASET_FORMAT "brace-dataset-1"
/* What training keeps beside the shards (train/motions.h, train/guides.h). */
#define DATASET_MOTIONS "motions.safetensors"
#define DATASET_GUIDES "guides.safetensors"
#define DATASET_META_LIMIT ((size_t)1 << 20)
#define DATASET_INDEX_LIMIT ((size_t)256 << 20)

/* ---- samples (dataset.c) ---- */

typedef struct dataset_sample {
    char *folder;
    char *name; /* "train/000012_web2", or "led_wall" in a set without splits */
} dataset_sample;

typedef struct dataset_list {
    dataset_sample *items; /* sorted by name */
    size_t count, capacity;
} dataset_list;

/* All samples below a folder, or the folder itself if it is one. None is an error. */
brace_status dataset_list_read(dataset_list *out, const char *folder, brace_error *error);
void dataset_list_free(dataset_list *list);
bool dataset_is_sample(const char *folder);

/* A sample in memory. */
typedef struct dataset_loaded {
    brace_frame *frames[BRACE_BRACKET_MAX];
    size_t count;
    brace_frame *truth;
    brace_frame *exact; /* noiseless, where the truth is a simulated photograph; NULL: there is none */
    json_t *meta; /* NULL: there is no meta.json */
} dataset_loaded;

/* Reads frames, truth and meta.json. Frames that do not belong together are refused. */
brace_status dataset_load(dataset_loaded *out, const char *folder, const brace_job *job, brace_error *error);
void dataset_loaded_free(dataset_loaded *sample);

/* "a/b" -> core_alloc'ed; NULL when memory ends. */
char *dataset_path(const char *folder, const char *name);

/* JSON of a file; *out is NULL, and all is well, if there is no such file. */
brace_status dataset_json_load(json_t **out, const char *path, size_t limit, brace_error *error);
brace_status dataset_json_save(json_t *value, const char *path, brace_error *error);

/* {"frame_1.dng": {"bytes": n, "sha256": "..."}, ...} of the DNG files in a folder: new reference. */
brace_status dataset_hashes(json_t **out, const char *folder, brace_error *error);

/* A folder for a sample that is being made, empty, beside where it will be; on
 * commit it gets its name. Left over from an interruption it is emptied and used again. */
brace_status dataset_begin(char **temporary, const char *final, brace_error *error);
brace_status dataset_finish(const char *temporary, const char *final, brace_error *error);
void dataset_discard(const char *temporary);

/* Makes a folder and those above it. */
brace_status dataset_make_folder(const char *path, brace_error *error);

/* ---- dataset_pack.c ---- */

/* All zeros mean the defaults. */
typedef struct dataset_pack_params {
    uint64_t shard_bytes; /* a shard is closed when it has as many bytes of pixels; 0: 1 GiB */
} dataset_pack_params;

/* Writes NAME-00000.safetensors, ... into `out`, one series for each split, and the same
 * bytes for the same samples. `shards` receives their number; may be NULL. */
brace_status dataset_pack(const char *folder, const char *out, const dataset_pack_params *params, const brace_job *job,
                          size_t *shards, brace_error *error);

/* What a frame's numbers need to be understood, as it stands in a shard: new reference. */
json_t *dataset_frame_json(const brace_frame *frame);

/* ---- dataset_verify.c ---- */

/* Called for everything that is wrong with a sample. */
typedef void dataset_problem_fn(void *user, const char *sample, const char *problem);

typedef struct dataset_verified {
    size_t samples, bad, missing, unhashed;
} dataset_verified;

/* Checks every sample of a set, or of a folder of shards. BRACE_OK also when samples are bad:
 * they are counted and told. */
brace_status dataset_verify(const char *folder, dataset_problem_fn *problem, void *user, dataset_verified *out,
                            const brace_job *job, brace_error *error);

/* ---- dataset_info.c ---- */

/* Counts and histograms as JSON: new reference. */
brace_status dataset_info(json_t **out, const char *folder, const brace_job *job, brace_error *error);

/* ---- dataset_import.c ---- */

typedef struct dataset_import_params {
    int reduce;       /* pixels that become one along each axis; 0: 4; 1: as they are */
    double tolerance; /* most displacement between reference and truth, pixels of the result; 0: 1 */
} dataset_import_params;

/* Called for every capture: what became of it. `problem` is NULL for a good one. */
typedef void dataset_import_fn(void *user, const char *source, const char *sample, const char *problem,
                               double displacement);

typedef struct dataset_imported {
    size_t good, rejected, there;
} dataset_imported;

/* Each of `folders` is one capture (six RAW files), or holds folders that are. */
brace_status dataset_import(const char *const *folders, size_t count, const char *out,
                            const dataset_import_params *params, dataset_import_fn *each, void *user,
                            dataset_imported *done, const brace_job *job, brace_error *error);

/* A mosaic reduced by an even factor without aliasing, colour by colour (dataset_reduce.c). */
brace_status dataset_reduce(brace_frame **out, const brace_frame *frame, int factor, brace_error *error);

/* How far the content of `moved` lies from that of `fixed`, pixels, blind to stripes: the
 * median over blocks with enough to see; NaN if there are none. */
double dataset_displacement(const brace_frame *fixed, const brace_frame *moved);

/* ---- dataset_build.c ---- */

#define DATASET_TEST_SAMPLE 0x80000000u /* samples of the test split are numbered from here */

/* One sample to be made. It depends on nothing else. */
typedef struct dataset_task {
    uint64_t seed;
    uint32_t sample;      /* keys all randomness, with the seed */
    const char *screen;   /* path of the picture */
    const char *name;     /* "train/000012_web2" */
    const char *display, *camera; /* presets; NULL camera: the default one */
    bool flicker_free;
    uint32_t width, height;
    bool field;
    const struct dataset_priors *priors;
} dataset_task;

/* Writes frame_1.dng ... and gt.dng into `folder`, and says in *meta how they came about (a
 * new reference). Called from several threads at once. `job` has one thread. */
typedef brace_status dataset_make_fn(void *user, const dataset_task *task, const char *folder, json_t **meta,
                                     const brace_job *job, brace_error *error);
/* The simulator (dataset_render.c). */
dataset_make_fn dataset_render;
/* The same without files: freed with sim_capture_free (simulate.h). */
struct sim_capture;
brace_status dataset_capture(struct sim_capture *out, const dataset_task *task, const brace_job *job,
                             brace_error *error);

typedef enum dataset_split { DATASET_BOTH, DATASET_TRAIN, DATASET_TEST } dataset_split;

typedef struct dataset_build_params {
    const char *screens;      /* folder of pictures; NULL: those that ship with BRACE */
    const char *priors;       /* JSON file; NULL: data/priors/default.json */
    uint64_t seed;
    uint32_t train, test;     /* samples */
    uint32_t width, height;   /* even; 0: 1024x768 */
    dataset_split only;       /* the other split is made elsewhere, or never */
    uint32_t shard, shards;   /* this process makes samples shard, shard + shards, ...; 0, 0: all */
    bool field;               /* the truth is captured too, as the paper does */
    dataset_make_fn *make;    /* NULL: dataset_render */
    void *user;
} dataset_build_params;

typedef struct dataset_built {
    size_t made, there; /* by this call, and before it */
} dataset_built;

/* Makes what is not there yet. A folder that holds a set made otherwise is refused. On an
 * error or when cancelled the samples that are complete stay. */
brace_status dataset_build(const char *out, const dataset_build_params *params, dataset_built *done,
                           const brace_job *job, brace_error *error);

#endif
