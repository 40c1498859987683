/* SPDX-License-Identifier: Apache-2.0 */
/*
 * weights.c: finds the published weights of LPIPS and DISTS in a folder, or says what to download.
 */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "metrics/perceptual.h"
#include "nn/pth.h"

typedef struct published {
    const char *names[3]; /* the same weights under newer and older names; ends with NULL */
    const char *url;      /* of the first */
} published;

#define TORCHVISION "https://download.pytorch.org/models/"
#define LPIPS "https://raw.githubusercontent.com/richzhang/PerceptualSimilarity/master/lpips/weights/v0.1/"

static const published vgg16 = {{"vgg16-397923af.pth", NULL, NULL}, TORCHVISION "vgg16-397923af.pth"};
static const published alexnet = {{"alexnet-owt-7be5be79.pth", "alexnet-owt-4df8aa71.pth", NULL},
                                  TORCHVISION "alexnet-owt-7be5be79.pth"};
static const published squeezenet = {{"squeezenet1_1-b8a52dc0.pth", "squeezenet1_1-f364aa15.pth", NULL},
                                     TORCHVISION "squeezenet1_1-b8a52dc0.pth"};
static const published alex_head = {{"alex.pth", NULL, NULL}, LPIPS "alex.pth"};
static const published vgg_head = {{"vgg.pth", NULL, NULL}, LPIPS "vgg.pth"};
static const published squeeze_head = {{"squeeze.pth", NULL, NULL}, LPIPS "squeeze.pth"};
static const published dists_head = {
    {"weights.pt", "dists_weights.pt", NULL},
    "https://raw.githubusercontent.com/dingkeyan93/DISTS/master/DISTS_pytorch/weights.pt"};

/* The network's file, and the metric's own. */
static const published *const files[][2] = {
    [BRACE_LPIPS_ALEX] = {&alexnet, &alex_head},
    [BRACE_LPIPS_VGG] = {&vgg16, &vgg_head},
    [BRACE_LPIPS_SQUEEZE] = {&squeezenet, &squeeze_head},
    [BRACE_DISTS] = {&vgg16, &dists_head},
};
enum { KINDS = sizeof files / sizeof files[0] };

typedef struct source {
    nn_pth *file[2];
    char path[2][4096];
    int at; /* the file of the last tensor, which an error is about */
} source;

static brace_status tensor(void *arg, float *values, const char *name, const size_t shape[4], brace_error *error) {
    source *s = arg;
    for (int f = 0; f < 2; f++) {
        const core_tensor *t = nn_pth_find(s->file[f], name);
        if (t == NULL) {
            continue;
        }
        s->at = f;
        /* A vector may come with sides of 1 around it, or without. */
        size_t count = 1, have = 1;
        bool same = t->dtype == CORE_F32;
        for (int i = 0; i < 4; i++) {
            count *= shape[i] > 0 ? shape[i] : 1;
        }
        for (int i = 0; i < t->rank; i++) {
            have *= (size_t)t->shape[i];
            same = same && (shape[1] == 0 || shape[0] == 1 || (t->rank == 4 && t->shape[i] == shape[i]));
        }
        if (!same || have != count) {
            return core_fail(error, BRACE_ERROR_FORMAT,
                             "the weights '%s' do not fit; is this file another network than its name says?", name);
        }
        memcpy(values, t->data, count * sizeof *values);
        return BRACE_OK;
    }
    s->at = 0;
    return core_fail(error, BRACE_ERROR_FORMAT, "the weights '%s' are not in it, nor in %s", name, s->path[1]);
}

static bool find(char path[4096], const char *folder, const published *file) {
    for (int i = 0; file->names[i] != NULL; i++) {
        int n = snprintf(path, 4096, "%s/%s", folder, file->names[i]);
        if (n > 0 && n < 4096 && access(path, F_OK) == 0) {
            return true;
        }
    }
    return false;
}

brace_status brace_perceptual_load(brace_perceptual **out, brace_perceptual_kind kind, const char *folder,
                                   brace_error *error) {
    *out = NULL;
    if ((unsigned)kind >= KINDS) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "there is no perceptual metric number %d", (int)kind);
    }
    if (folder == NULL) {
        folder = getenv("BRACE_WEIGHTS");
    }
    const bool given = folder != NULL && folder[0] != '\0';
    source *s = core_calloc(1, sizeof *s);
    if (s == NULL) {
        return core_fail_memory(error, sizeof *s, "a metric");
    }
    brace_status status = BRACE_OK;
    bool missing[2];
    for (int f = 0; f < 2; f++) {
        missing[f] = !given || !find(s->path[f], folder, files[kind][f]);
    }
    if (missing[0] || missing[1]) {
        const bool both = missing[0] && missing[1];
        status = core_fail(error, BRACE_ERROR_IO, "%s needs %s: download %s%s%s into %s%.500s",
                           brace_perceptual_name(kind), both ? "two files" : "a file",
                           files[kind][missing[0] ? 0 : 1]->url, both ? " and " : "", both ? files[kind][1]->url : "",
                           given ? "the folder " : "a folder, and name that with --weights or BRACE_WEIGHTS",
                           given ? folder : "");
    }
    for (int f = 0; f < 2 && status == BRACE_OK; f++) {
        status = nn_pth_open(&s->file[f], s->path[f], error);
    }
    if (status == BRACE_OK) {
        status = metrics_perceptual_create(out, kind, tensor, s, error);
        if (status == BRACE_ERROR_FORMAT) {
            core_error_prefix(error, s->path[s->at]);
        }
    }
    nn_pth_close(s->file[0]);
    nn_pth_close(s->file[1]);
    core_free(s);
    return status;
}
