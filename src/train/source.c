/* SPDX-License-Identifier: Apache-2.0 */
/* source.c: which bracket and which crop of it sample i is; brackets out of the simulator. */
#include "train/source.h"

#include <limits.h>
#include <string.h>

#include "sim/data_path.h"
#include "sim/dataset.h"
#include "sim/dataset_priors.h"
#include "sim/dataset_screens.h"
#include "sim/simulate.h"
#include "train/guides.h"
#include "train/motions.h"

enum { STREAM_WINDOW = 0x54520001, STREAM_ORDER };

/* A packed set. */
typedef struct packed_set {
    char *folder; /* a copy */
    train_packed *packed;
    train_motions *motions; /* NULL where they are not wanted, as guides */
    train_guides *guides;
} packed_set;

struct train_source {
    train_source_params params;
    char *screens_folder, *priors_file; /* copies */
    packed_set set[TRAIN_SETS_MAX];
    int sets;
    size_t count; /* of brackets in all sets */
    dataset_screens screens;
    dataset_priors *priors;
};

static brace_status copy(char **out, const char *text, brace_error *error) {
    *out = text != NULL ? core_strdup(text) : NULL;
    return text == NULL || *out != NULL ? BRACE_OK : core_fail_memory(error, strlen(text), "a name");
}

static brace_status open_simulator(train_source *s, const brace_job *job, brace_error *error) {
    const train_source_params *p = &s->params;
    char shipped[PATH_MAX];
    const char *screens = p->screens;
    brace_status status = dataset_priors_load(&s->priors, p->priors, error);
    if (status == BRACE_OK && screens == NULL) {
        screens = shipped;
        status = sim_data_folder(shipped, "screens", error);
    }
    if (status == BRACE_OK) {
        const uint32_t test = (uint32_t)(p->test_share * 10000 + 0.5);
        status = dataset_screens_read(&s->screens, screens, 10000 - test, test, job, error);
    }
    return status;
}

static brace_status open_set(train_source *s, const char *folder, brace_error *error) {
    const train_source_params *p = &s->params;
    const char *split = p->test ? "test" : "train";
    packed_set *set = &s->set[s->sets++];
    brace_status status = copy(&set->folder, folder, error);
    if (status == BRACE_OK) {
        status = train_packed_open(&set->packed, set->folder, split, p->frames, error);
    }
    if (status == BRACE_OK && p->align) {
        status = train_motions_open(&set->motions, set->packed, set->folder, split, error);
    }
    if (status == BRACE_OK && p->guide) {
        status = train_guides_open(&set->guides, set->folder, error);
    }
    s->count += status == BRACE_OK ? train_packed_count(set->packed) : 0;
    if (status == BRACE_OK && s->count > UINT32_MAX) {
        status = core_fail(error, BRACE_ERROR_ARGUMENT, "%zu samples are too many", s->count);
    }
    return status;
}

brace_status train_source_create(train_source **out, const train_source_params *params, const brace_job *job,
                                 brace_error *error) {
    train_source *s = core_calloc(1, sizeof *s);
    if (s == NULL) {
        return core_fail_memory(error, sizeof *s, "a source of samples");
    }
    train_source_params *p = &s->params;
    *p = *params;
    p->width = p->width > 0 ? p->width : 1024;
    p->height = p->height > 0 ? p->height : 768;
    p->frames = p->frames > 0 ? p->frames : 5;
    p->side = p->side > 0 ? p->side : 128;
    p->crops = p->crops > 0 ? p->crops : 4;
    p->test_share = p->test_share > 0 ? p->test_share : 0.1;
    brace_status status = copy(&s->screens_folder, params->screens, error);
    if (status == BRACE_OK) {
        status = copy(&s->priors_file, params->priors, error);
    }
    p->screens = s->screens_folder, p->priors = s->priors_file;
    const uint32_t least = 2 * (uint32_t)p->side + 2;
    if (status == BRACE_OK && p->packed[0] == NULL &&
        (p->width % 2 || p->height % 2 || p->width < least || p->height < least || p->width > 16384 ||
         p->height > 16384)) {
        status = core_fail(error, BRACE_ERROR_ARGUMENT,
                           "frames of %ux%u: an even number of pixels from %u to 16384 is needed for crops of %d",
                           p->width, p->height, least, p->side);
    }
    for (int i = 0; i < TRAIN_SETS_MAX && p->packed[i] != NULL && status == BRACE_OK; i++) {
        const bool last = i + 1 == TRAIN_SETS_MAX || p->packed[i + 1] == NULL;
        status = open_set(s, p->packed[i], error);
        p->packed[i] = s->set[i].folder;
        if (status == BRACE_ERROR_ARGUMENT && p->test && s->set[i].packed == NULL && (s->count > 0 || !last)) {
            status = BRACE_OK; /* made with --only train: the other sets are for testing */
        }
    }
    if (status == BRACE_OK && s->sets == 0) {
        status = open_simulator(s, job, error);
    }
    if (status != BRACE_OK) {
        train_source_destroy(s);
        return status;
    }
    *out = s;
    return BRACE_OK;
}

void train_source_destroy(train_source *s) {
    if (s != NULL) {
        for (int i = 0; i < s->sets; i++) {
            train_packed_close(s->set[i].packed);
            train_motions_close(s->set[i].motions);
            train_guides_close(s->set[i].guides);
            core_free(s->set[i].folder);
        }
        dataset_screens_free(&s->screens);
        dataset_priors_destroy(s->priors);
        core_free(s->screens_folder);
        core_free(s->priors_file);
        core_free(s);
    }
}

const train_source_params *train_source_params_of(const train_source *source) {
    return &source->params;
}

size_t train_source_size(const train_source *source) {
    return source->count; /* rendered: 0 */
}

/* All brackets of all sets once in random order, then again in another; those for tests as they come. */
static brace_status pick(size_t *out, const train_source *s, uint64_t n, brace_error *error) {
    const size_t count = s->count;
    *out = (size_t)(n % count);
    if (s->params.test) {
        return BRACE_OK;
    }
    uint32_t *order = core_alloc(count, sizeof *order);
    if (order == NULL) {
        return core_fail_memory(error, count * sizeof *order, "the order of samples");
    }
    core_random r =
        core_random_create(s->params.seed, (uint32_t)(n / count), (uint32_t)(n / count >> 32), STREAM_ORDER);
    for (uint32_t i = 0; i < count; i++) {
        order[i] = i;
    }
    for (uint32_t i = (uint32_t)count - 1; i > 0; i--) {
        const uint32_t j = core_random_below(&r, i + 1), t = order[i];
        order[i] = order[j];
        order[j] = t;
    }
    *out = order[*out];
    core_free(order);
    return BRACE_OK;
}

static brace_status crops_of(const train_source *s, train_bracket *bracket, uint64_t first, int count,
                             train_sample *out, const volatile int *cancel, brace_error *error) {
    brace_status status = BRACE_OK;
    uint16_t *guide = NULL;
    if (s->params.guide && bracket->guide == NULL) {
        const size_t pixels = (size_t)bracket->width * bracket->height;
        guide = core_alloc(pixels, sizeof *guide + 1);
        uint8_t *sigma = (uint8_t *)(guide + pixels);
        status = guide != NULL ? train_bracket_merge(bracket, guide, sigma, cancel, error)
                               : core_fail_memory(error, pixels * (sizeof *guide + 1), "a merged picture");
        bracket->guide = guide, bracket->sigma = sigma;
    }
    for (int k = 0; k < count && status == BRACE_OK; k++) {
        const uint64_t i = first + (uint64_t)k;
        core_random r = core_random_create(s->params.seed, (uint32_t)i, (uint32_t)(i >> 32),
                                           s->params.test ? ~(uint32_t)STREAM_WINDOW : STREAM_WINDOW);
        const int side = s->params.side;
        const uint32_t least = 2 * (uint32_t)side + 2;
        if (bracket->width < least || bracket->height < least) {
            status = core_fail(error, BRACE_ERROR_MISMATCH,
                               "frames of %ux%u pixels are too small for crops of %d pixels", bracket->width,
                               bracket->height, 2 * side);
            break;
        }
        const train_window window = train_window_draw(&r, bracket, side, s->params.mirrored, s->params.transposed);
        out[k].index = i;
        status = train_sample_make(&out[k], bracket, &window, error);
    }
    core_free(guide);
    return status;
}

static brace_status from_simulator(const train_source *s, uint64_t scene, uint64_t first, int count, train_sample *out,
                                   const volatile int *cancel, brace_error *error) {
    const train_source_params *p = &s->params;
    uint32_t *scratch = core_alloc(s->screens.count, sizeof *scratch);
    if (scratch == NULL) {
        return core_fail_memory(error, s->screens.count * sizeof *scratch, "the order of screens");
    }
    const uint32_t number = (uint32_t)(scene % DATASET_TEST_SAMPLE);
    const dataset_screen *screen = dataset_screens_pick(&s->screens, p->test, p->seed, number, scratch);
    core_free(scratch);
    dataset_task task = {.seed = p->seed,
                         .sample = p->test ? DATASET_TEST_SAMPLE + number : number,
                         .screen = screen->path,
                         .width = p->width,
                         .height = p->height,
                         .field = p->field,
                         .priors = s->priors};
    dataset_draw draw;
    dataset_priors_draw(&draw, s->priors, task.seed, task.sample);
    task.display = draw.display, task.camera = draw.camera, task.flicker_free = draw.flicker_free;
    sim_capture capture;
    brace_status status = dataset_capture(&capture, &task, &(brace_job){.threads = 1, .cancel = cancel}, error);
    if (status != BRACE_OK) {
        if (status != BRACE_ERROR_CANCELLED) {
            core_error_prefix(error, screen->path);
        }
        return status;
    }
    train_bracket bracket = {.count = capture.count};
    for (int i = 0; i < capture.count; i++) {
        train_bracket_set(&bracket, i, capture.frame[i]);
    }
    train_bracket_set(&bracket, -1, capture.exact != NULL ? capture.exact : capture.truth);
    status = train_bracket_finish(&bracket, error);
    if (status == BRACE_OK && p->align) {
        status = train_bracket_align(&bracket, cancel, error);
    }
    if (status == BRACE_OK) {
        status = crops_of(s, &bracket, first, count, out, cancel, error);
    }
    sim_capture_free(&capture);
    return status;
}

brace_status train_source_get(const train_source *s, uint64_t first, int count, train_sample *out,
                              const volatile int *cancel, brace_error *error) {
    const uint64_t crops = (uint64_t)s->params.crops, scene = first / crops;
    if (count < 1 || (first + (uint64_t)count - 1) / crops != scene) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "samples of several brackets at once");
    }
    const train_source_params *p = &s->params;
    if (s->sets == 0) {
        return from_simulator(s, scene, first, count, out, cancel, error);
    }
    size_t index;
    brace_status status = pick(&index, s, scene, error);
    if (status == BRACE_OK) {
        const packed_set *set = s->set;
        for (; index >= train_packed_count(set->packed); set++) {
            index -= train_packed_count(set->packed);
        }
        const char *name = train_packed_name(set->packed, index);
        train_bracket bracket = *train_packed_at(set->packed, index);
        status = p->align ? train_motions_get(set->motions, &bracket, index, cancel, error) : BRACE_OK;
        if (set->guides != NULL) {
            train_guides_get(set->guides, &bracket, p->test ? "test" : "train", name);
        }
        if (status == BRACE_OK) {
            status = crops_of(s, &bracket, first, count, out, cancel, error);
        }
        if (status != BRACE_OK) {
            core_error_prefix(error, name);
        }
    }
    return status;
}
