/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_network.c: restoring with networks of random weights: that tiles leave no seams, that any CFA, size, memory and
 * number of threads gives the same picture, that a bracket is shown as in training, that brackets and files which are
 * none are met with a sentence.
 */
// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>
// clang-format on
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "restore/network.h"
#include "scene.h"
#include "train/sample.h"

static char folder[] = "/tmp/brace-network-XXXXXX";

static void ok(brace_status status, const brace_error *error) {
    if (status != BRACE_OK)
        fail_msg("%s", error->message);
}

static const char *in(char path[256], const char *name) {
    snprintf(path, 256, "%s/%s", folder, name);
    return path;
}

/* ---- weights ---- */

static models_shape small_shape(bool mscam) {
    models_shape s;
    assert_true(models_shape_named(&s, mscam ? "brace-s" : "tmrnet-s"));
    s.channels = 8, s.global = 1, s.reconstruct = 1;
    s.strip = mscam ? 8 : 0;
    return s;
}

/* Random weights; `stir`: also those that networks begin with as zeros. */
static nn_weights *random_weights(const models_shape *shape, bool stir) {
    brace_error error = {0};
    nn_weights *weights;
    nn_graph *g;
    ok(nn_weights_create(&weights, 3, &error), &error);
    ok(nn_graph_create(&g, weights, &(nn_graph_params){.job = &(brace_job){.threads = 1}}, &error), &error);
    const models_inputs inputs = models_inputs_create(g, models_views(shape), 64, 64);
    models_build(g, shape, &inputs);
    ok(nn_graph_error(g, &error), &error);
    nn_graph_destroy(g);
    core_random r = core_random_create(4, 0, 0, 0);
    for (size_t i = 0; i < nn_weights_count(weights); i++) {
        nn_parameter *p = nn_weights_at(weights, i);
        bool zero = stir;
        for (size_t k = 0; k < p->count && zero; k++)
            zero = p->value[k] == 0;
        for (size_t k = 0; k < p->count && zero; k++)
            p->value[k] = (float)(0.05 * core_random_normal(&r));
    }
    return weights;
}

/* A file as brace train writes them; NULL texts: the file does not have them. */
static void save(const char *path, const nn_weights *weights, const char *model, const char *network, int crop) {
    brace_error error = {0};
    char training[64];
    snprintf(training, sizeof training, "{\"data\":{\"crop\":%d}}", crop);
    const char *metadata[7] = {"training", training};
    int n = 2;
    if (model != NULL)
        metadata[n++] = "model", metadata[n++] = model;
    if (network != NULL)
        metadata[n++] = "network", metadata[n++] = network;
    ok(nn_weights_save(weights, path, "f32", metadata, &error), &error);
}

static void save_network(const char *name, const models_shape *shape, bool stir, int crop) {
    char path[256];
    json_t *json = models_shape_json(shape);
    char *network = json_dumps(json, JSON_COMPACT);
    nn_weights *weights = random_weights(shape, stir);
    save(in(path, name), weights, shape->mscam ? "brace-s" : "tmrnet-s", network, crop);
    nn_weights_destroy(weights);
    free(network);
    json_decref(json);
}

/* ---- restoring ---- */

static char notes[1024];

static void on_note(void *user, const char *message) {
    (void)user;
    snprintf(notes, sizeof notes, "%s", message);
}

static brace_status try(brace_restored **out, const brace_bracket *bracket, const char *name,
                        const brace_restore_params *more, int threads, brace_error *error) {
    char path[256];
    brace_restore_params params = more != NULL ? *more : (brace_restore_params){0};
    if (name != NULL)
        params.model = in(path, name);
    const brace_job job = {.threads = threads, .note = on_note};
    notes[0] = '\0';
    return brace_restore(out, bracket, &params, &job, error);
}

static brace_restored *restore(const brace_bracket *bracket, const char *name, const brace_restore_params *more,
                               int threads) {
    brace_restored *out;
    brace_error error = {0};
    ok(try(&out, bracket, name, more, threads, &error), &error);
    for (size_t i = 0; i < (size_t)out->frame->width * out->frame->height; i++)
        assert_true(isfinite(out->mosaic[i]));
    return out;
}

/* Of the square roots, as displays show it; away from the borders by `border` pixels. */
static double largest_difference(const brace_restored *a, const brace_restored *b, uint32_t border) {
    const uint32_t width = a->frame->width, height = a->frame->height;
    assert_true(width == b->frame->width && height == b->frame->height);
    double most = 0;
    for (uint32_t y = border; y + border < height; y++)
        for (uint32_t x = border; x + border < width; x++) {
            const size_t i = (size_t)y * width + x;
            most = fmax(most, fabs(sqrt(fmax(0, (double)a->mosaic[i])) - sqrt(fmax(0, (double)b->mosaic[i]))));
        }
    return most;
}

static const scene screen = {.width = 304, .height = 240, .level = 0.4, .pulses = 9.3, .duty = 0.6, .reference = 0.7,
                             .shift = 0.8, .seed = 9};

/* ---- tests ---- */

static void test_tiles(void **state) {
    (void)state;
    float share[RESTORE_TILE_MOST];
    for (int side = RESTORE_TILE_LEAST; side <= RESTORE_TILE_MOST; side += 24) {
        for (int length = 1; length < 900; length += 1 + length / 40) {
            const restore_tiles t = restore_tiles_fit(length, 8, side);
            double *sum = calloc((size_t)length, sizeof *sum);
            assert_true(t.across <= side && t.across % RESTORE_TILE_STEP == 0 && t.rows == 1 && t.down == 8);
            for (int k = 0; k < t.columns; k++) {
                const int begin = restore_tile_begin(length, t.across, t.columns, k);
                assert_true(begin >= 0 && begin % RESTORE_TILE_GRID == 0);
                assert_true(t.columns == 1 || begin + t.across < length + RESTORE_TILE_GRID);
                restore_tile_share(share, length, t.across, t.columns, k);
                for (int i = 0; i < t.across && begin + i < length; i++) {
                    assert_true(share[i] >= 0 && share[i] <= 1);
                    sum[begin + i] += (double)share[i];
                    /* What convolutions see beyond the tile's edge is not there. */
                    const bool edge = (i < 8 && k > 0) || (i >= t.across - 8 && k + 1 < t.columns);
                    assert_true(!edge || share[i] == 0);
                }
            }
            for (int x = 0; x < length; x++)
                assert_true(fabs(sum[x] - 1) < 1e-6);
            free(sum);
        }
    }
}

/* A tile is what train_sample_make makes of the same place; frames that moved far are moved back by whole blocks. */
static void test_shown(void **state) {
    (void)state;
    enum { SIDE = 64 };
    const models_shape shape = small_shape(true);
    save_network("shown.safetensors", &shape, true, SIDE);
    for (int run = 0; run < 5; run++) {
        scene s = screen;
        s.cfa = (brace_cfa)(run % 4), s.shift = run == 4 ? 12 : 0.8;
        brace_bracket *b = scene_bracket(&s);
        brace_error error = {0};
        train_bracket t = {.count = 5};
        for (int i = 0; i < 5; i++)
            train_bracket_set(&t, i, b->frames[i]);
        train_bracket_set(&t, -1, b->frames[2]);
        ok(train_bracket_finish(&t, &error), &error);
        ok(train_bracket_align(&t, NULL, &error), &error);
        restore_network *n;
        char path[256];
        ok(restore_network_open(&n, in(path, "shown.safetensors"), &error), &error);
        assert_int_equal(n->side, SIDE);
        const brace_job job = {.threads = 1};
        ok(restore_network_plan(n, SIDE, SIDE, BRACE_PRECISION_F32, &job, &error), &error);
        const size_t pixels = (size_t)t.width * t.height;
        float *merged = calloc(2 * pixels, sizeof *merged), *sigma = merged + pixels;
        uint16_t *guide = calloc(pixels, sizeof *guide);
        uint8_t *codes = calloc(pixels, sizeof *codes);
        brace_restore_report report = {0};
        ok(restore_merge(merged, sigma, &report, b, t.motion, &job, NULL, &error), &error);
        ok(train_bracket_merge(&t, guide, codes, NULL, &error), &error);
        t.guide = guide, t.sigma = codes;
        const restore_tile tile = {.bracket = b, .motion = t.motion, .guide = merged, .sigma = sigma, .x = 41, .y = 33};
        ok(restore_network_show(n, &tile, NULL, &error), &error);
        train_sample want;
        ok(train_sample_create(&want, 6, SIDE, &error), &error);
        const train_window window = {.x0 = (uint32_t)(2 * tile.x + restore_red_column(s.cfa)),
                                     .y0 = (uint32_t)(2 * tile.y + restore_red_row(s.cfa))};
        ok(train_sample_make(&want, &t, &window, &error), &error);
        const float *frames = nn_data(n->graph, n->inputs.frames), *flow = nn_data(n->graph, n->inputs.flow);
        int moved = 0;
        for (int i = 0; i < 6; i++) { /* the last is the guide, which training keeps in 16 bits */
            const float bound = i == 5 ? 1e-3f : 1e-5f;
            const size_t middle = ((size_t)i * SIDE + SIDE / 2) * SIDE + SIDE / 2;
            const int dx = (int)lrintf(want.flow[2 * middle] - flow[2 * middle]),
                      dy = (int)lrintf(want.flow[2 * middle + 1] - flow[2 * middle + 1]);
            moved += dx != 0 || dy != 0;
            assert_true(dx % 4 == 0 && dy % 4 == 0 && fabsf(flow[2 * middle]) < 2.01f);
            for (int y = 12; y < SIDE - 12; y++)
                for (int x = 12; x < SIDE - 12; x++) {
                    const size_t here = ((size_t)i * SIDE + (size_t)y) * SIDE + (size_t)x;
                    const size_t there = ((size_t)i * SIDE + (size_t)(y + dy)) * SIDE + (size_t)(x + dx);
                    for (int c = 0; c < 8; c++)
                        assert_true(fabsf(frames[8 * here + (size_t)c] - want.input[8 * there + (size_t)c]) <=
                                    bound * (1 + fabsf(want.input[8 * there + (size_t)c])));
                    assert_true(fabsf(flow[2 * here] + (float)dx - want.flow[2 * here]) < 1e-3f);
                    assert_true(fabsf(flow[2 * here + 1] + (float)dy - want.flow[2 * here + 1]) < 1e-3f);
                }
            assert_true(fabsf(((float *)nn_data(n->graph, n->inputs.white))[i] / want.white[i] - 1) < 1e-5f);
            assert_true(fabsf(((float *)nn_data(n->graph, n->inputs.rho))[i] - want.rho[i]) < 10 * bound);
            for (int c = 0; c < 8; c++)
                assert_true(fabsf(((float *)nn_data(n->graph, n->inputs.descriptors))[8 * i + c] -
                                  want.descriptor[i][c]) < 100 * bound);
        }
        const float *errors = nn_data(n->graph, n->inputs.sigma);
        for (size_t i = 0; i < (size_t)4 * SIDE * SIDE; i++)
            assert_true(fabsf(errors[i] / want.sigma[i] - 1) < 0.02f); /* which training keeps in 8 bits */
        assert_true(run == 4 ? moved >= 3 : moved == 0);
        train_sample_free(&want);
        restore_network_close(n);
        brace_bracket_destroy(b);
        free(merged);
        free(guide);
        free(codes);
    }
}

/* A network that has learned nothing gives the reference, or with a guide the merged picture; so steady light is not
 * harmed. Light below black, which is noise, becomes black. */
static void test_untaught(void **state) {
    (void)state;
    models_shape shape = small_shape(true);
    save_network("guided.safetensors", &shape, false, 128);
    shape.guide = shape.sigma = shape.gate = false;
    save_network("untaught.safetensors", &shape, false, 128);
    for (int run = 0; run < 4; run++) {
        scene s = screen;
        s.width = run == 0 ? 1100 : 90, s.height = run == 0 ? 36 : 75 + (uint32_t)run; /* tiles; odd sizes */
        s.cfa = (brace_cfa)run;
        brace_bracket *b = scene_bracket(&s);
        const brace_frame *reference = b->frames[2];
        brace_restored *out = restore(b, "untaught.safetensors", NULL, 2);
        assert_int_equal(out->report.method, BRACE_METHOD_NETWORK);
        assert_string_equal(out->report.model, "brace-s");
        assert_int_equal(out->report.tiles, run == 0 ? 2 : 1);
        size_t above = 0;
        for (uint32_t y = 0; y < s.height; y++)
            for (uint32_t x = 0; x < s.width; x++) {
                const size_t i = (size_t)y * s.width + x;
                const float black = reference->black[(y & 1) * 2 + (x & 1)];
                const float want = fmaxf(reference->data[i], black);
                above += reference->data[i] > black;
                assert_true(out->frame->data[i] == (uint16_t)want);
            }
        assert_true(above > (size_t)s.width * s.height / 2);
        brace_restored_destroy(out);
        if (run > 1) {
            brace_bracket_destroy(b);
            continue; /* merging takes long, and tells the orders of colours apart elsewhere */
        }

        out = restore(b, "guided.safetensors", NULL, 2);
        assert_int_equal(out->report.method, BRACE_METHOD_NETWORK);
        brace_restored *merged = restore(b, NULL, &(brace_restore_params){.method = BRACE_METHOD_MERGE}, 2);
        for (size_t i = 0; i < (size_t)s.width * s.height; i++)
            assert_true(fabsf(out->mosaic[i] - fmaxf(merged->mosaic[i], 0)) <= 1e-5f * (1 + merged->mosaic[i]));
        assert_true(out->report.banding[0] > 0); /* which merging measured */
        brace_restored_destroy(merged);
        brace_restored_destroy(out);
        brace_bracket_destroy(b);
    }
}

/* Tiles against the whole picture at once. Without MSCAM a pixel is told by what surrounds it: all agree but for what
 * lies further away than half an overlap. With it tiles differ as a whole, but none ends at an edge. */
static void test_seams(void **state) {
    (void)state;
    brace_bracket *b = scene_bracket(&screen);
    for (int kind = 0; kind < 3; kind++) {
        const bool mscam = kind == 1;
        models_shape shape = small_shape(kind > 0);
        shape.mscam = mscam, shape.sigma = shape.gate = kind == 2;
        save_network("seams.safetensors", &shape, true, 64);
        brace_restored *whole = restore(b, "seams.safetensors", NULL, 2);
        assert_int_equal(whole->report.tiles, 1);
        brace_restored *tiled = restore(b, "seams.safetensors", &(brace_restore_params){.memory = 7000000}, 2);
        assert_true(tiled->report.tiles >= 4);
        brace_restored *reference = restore(b, NULL, &(brace_restore_params){.method = BRACE_METHOD_REFERENCE}, 2);
        const double most = largest_difference(whole, tiled, 0), effect = largest_difference(whole, reference, 0);
        double step = 0, own = 0;
        for (uint32_t y = 0; y < screen.height; y++)
            for (uint32_t x = 2; x < screen.width; x++) {
                const size_t i = (size_t)y * screen.width + x;
                const double d = (double)(tiled->mosaic[i] - whole->mosaic[i]);
                step = fmax(step, fabs(d - (double)(tiled->mosaic[i - 2] - whole->mosaic[i - 2])));
                own = fmax(own, fabs((double)(whole->mosaic[i] - whole->mosaic[i - 2])));
            }
        print_message("kind %d: %zu tiles differ by %.5f; the network changes up to %.3f; steps %.5f of %.3f\n", kind,
                      tiled->report.tiles, most, effect, step, own);
        assert_true(effect > 0.05);
        assert_true(most < (mscam ? 0.1 : 0.0005) * effect);
        assert_true(step < (mscam ? 0.02 : 0.0005) * own);
        brace_restored_destroy(reference);
        brace_restored_destroy(whole);
        brace_restored_destroy(tiled);
    }
    brace_bracket_destroy(b);
}

static brace_bracket *cut(const brace_bracket *from, uint32_t left, uint32_t top) {
    brace_frame *frames[5];
    brace_error error = {0};
    brace_bracket *out;
    for (int i = 0; i < 5; i++) {
        const brace_frame *f = from->frames[i];
        const brace_cfa cfa = left % 2 == 0 ? (top % 2 == 0 ? BRACE_CFA_RGGB : BRACE_CFA_GBRG)
                                            : (top % 2 == 0 ? BRACE_CFA_GRBG : BRACE_CFA_BGGR);
        ok(brace_frame_create(&frames[i], f->width - left, f->height - top, cfa, &error), &error);
        frames[i]->white = f->white, frames[i]->exposure_time = f->exposure_time, frames[i]->iso = f->iso;
        frames[i]->f_number = f->f_number;
        for (uint32_t y = 0; y < 2; y++)
            for (uint32_t x = 0; x < 2; x++)
                frames[i]->black[2 * y + x] = f->black[2 * ((y + top) & 1) + ((x + left) & 1)];
        for (uint32_t y = 0; y < frames[i]->height; y++)
            memcpy(frames[i]->data + (size_t)y * frames[i]->width, f->data + (size_t)(y + top) * f->width + left,
                   2 * (size_t)frames[i]->width);
    }
    ok(brace_bracket_create(&out, frames, 5, NULL, NULL, &error), &error);
    return out;
}

/* A frame that begins one column or row later has another order of colours, and the same picture. */
static void test_colours(void **state) {
    (void)state;
    models_shape shape = small_shape(false);
    save_network("colours.safetensors", &shape, true, 128);
    const brace_restore_params still = {.no_align = true};
    brace_bracket *b = scene_bracket(&screen);
    brace_restored *whole = restore(b, "colours.safetensors", &still, 2);
    for (uint32_t k = 1; k < 4; k++) {
        const uint32_t left = k & 1, top = k >> 1;
        brace_bracket *part = cut(b, left, top);
        brace_restored *out = restore(part, "colours.safetensors", &still, 2);
        double most = 0;
        for (uint32_t y = 64; y < out->frame->height; y++)
            for (uint32_t x = 64; x < out->frame->width; x++)
                most = fmax(most, fabs((double)out->mosaic[(size_t)y * out->frame->width + x] -
                                       (double)whole->mosaic[(size_t)(y + top) * screen.width + x + left]));
        print_message("%s: %.6f\n", brace_cfa_name(out->frame->cfa), most);
        assert_true(most < 1e-3);
        brace_restored_destroy(out);
        brace_bracket_destroy(part);
    }
    brace_restored_destroy(whole);
    brace_bracket_destroy(b);
}

/* Less memory, smaller tiles; too little is said together with how much would do, and that much does. */
static void test_memory(void **state) {
    (void)state;
    models_shape shape = small_shape(true);
    save_network("memory.safetensors", &shape, true, 128);
    brace_bracket *b = scene_bracket(&screen);
    brace_error error = {0};
    brace_restored *out = NULL;
    assert_int_equal(try(&out, b, "memory.safetensors", &(brace_restore_params){.memory = 1000000, .no_align = true}, 1, &error),
                     BRACE_ERROR_MEMORY);
    const char *needs = strstr(error.message, "needs ");
    assert_non_null(needs);
    assert_non_null(strstr(error.message, "may use 1 MB"));
    const double least = atof(needs + 6);
    assert_true(least >= 2 && least < 100);
    int last = 0;
    for (double megabytes = least; megabytes < 40 * least; megabytes *= 2) {
        out = restore(b, "memory.safetensors", &(brace_restore_params){.memory = (uint64_t)(megabytes * 1e6), .no_align = true}, 1);
        const int area = out->report.tile_width * out->report.tile_height;
        assert_true(area >= last);
        assert_true(megabytes > least || (out->report.tile_width <= 160 && out->report.tile_height <= 160));
        last = area;
        brace_restored_destroy(out);
    }
    assert_int_equal(last, screen.width * screen.height);
    brace_bracket_destroy(b);
}

/* The same bytes with any number of threads, and nearly the same in bf16. */
static void test_threads(void **state) {
    (void)state;
    models_shape shape = small_shape(true);
    save_network("threads.safetensors", &shape, true, 128);
    brace_bracket *b = scene_bracket(&screen);
    const brace_restore_params params = {.memory = 8000000, .precision = BRACE_PRECISION_F32};
    const size_t count = (size_t)screen.width * screen.height;
    brace_restored *one = restore(b, "threads.safetensors", &params, 1);
    assert_int_equal(one->report.precision, BRACE_PRECISION_F32);
    assert_true(one->report.tiles > 1);
    for (int threads = 2; threads < 4; threads++) {
        brace_restored *more = restore(b, "threads.safetensors", &params, threads);
        assert_int_equal(one->report.tiles, more->report.tiles);
        assert_memory_equal(one->mosaic, more->mosaic, count * sizeof(float));
        brace_restored_destroy(more);
    }
    brace_restored *half = restore(b, "threads.safetensors", &(brace_restore_params){.precision = BRACE_PRECISION_BF16}, 2);
    assert_int_equal(half->report.precision, BRACE_PRECISION_BF16);
    assert_true(largest_difference(one, half, 0) < 0.05);
    brace_restored_destroy(half);
    brace_restored_destroy(one);
    brace_bracket_destroy(b);
}

/* What networks have not learned is merged, and a note says why. */
static void test_other_brackets(void **state) {
    (void)state;
    models_shape shape = small_shape(true);
    save_network("other.safetensors", &shape, true, 128);
    scene s = screen;
    s.width = 160, s.height = 128;
    brace_bracket *b = scene_bracket(&s);

    b->exposure[4] = 40;
    brace_restored *out = restore(b, "other.safetensors", NULL, 1);
    assert_int_equal(out->report.method, BRACE_METHOD_MERGE);
    assert_non_null(strstr(notes, "merged instead: brace-s takes brackets in which each exposure is about four times"));
    assert_non_null(strstr(notes, "10 times"));
    brace_restored_destroy(out);
    b->exposure[4] = 16;

    b->reference = 1;
    for (int i = 0; i < 5; i++)
        b->exposure[i] *= 4;
    out = restore(b, "other.safetensors", NULL, 1);
    assert_int_equal(out->report.method, BRACE_METHOD_MERGE);
    assert_non_null(strstr(notes, "middle exposure"));
    brace_restored_destroy(out);
    b->reference = 2;
    for (int i = 0; i < 5; i++)
        b->exposure[i] /= 4;

    b->count = 3, b->reference = 1; /* three frames of five */
    for (int i = 0; i < 3; i++)
        b->exposure[i] *= 4;
    out = restore(b, "other.safetensors", &(brace_restore_params){.method = BRACE_METHOD_NETWORK}, 1);
    assert_int_equal(out->report.method, BRACE_METHOD_MERGE);
    assert_non_null(strstr(notes, "takes brackets of 5 frames, and this one has 3"));
    brace_restored_destroy(out);
    b->count = 5, b->reference = 2;
    for (int i = 0; i < 3; i++)
        b->exposure[i] /= 4;

    /* No weights: merged, in silence unless the network was asked for. One that was named must be there. */
    assert_int_equal(setenv("BRACE_MODELS", folder, 1), 0);
    out = restore(b, NULL, NULL, 1);
    assert_int_equal(out->report.method, BRACE_METHOD_MERGE);
    assert_string_equal(notes, "");
    brace_restored_destroy(out);
    out = restore(b, NULL, &(brace_restore_params){.method = BRACE_METHOD_NETWORK}, 1);
    assert_int_equal(out->report.method, BRACE_METHOD_MERGE);
    assert_non_null(strstr(notes, "no network's weights are installed"));
    brace_restored_destroy(out);
    brace_error error = {0};
    const brace_job job = {.threads = 1};
    brace_restore_params params = {.model = "brace-s"};
    assert_int_equal(brace_restore(&out, b, &params, &job, &error), BRACE_ERROR_IO);
    assert_non_null(strstr(error.message, "brace-s.safetensors"));

    /* Once they are there, they are the default. */
    save_network("brace-s.safetensors", &shape, true, 128);
    out = restore(b, NULL, NULL, 1);
    assert_int_equal(out->report.method, BRACE_METHOD_NETWORK);
    assert_non_null(strstr(out->report.weights, "/brace-s.safetensors"));
    assert_true(isnan(out->report.weight[0]) && out->report.seconds_network > 0);
    brace_restored_destroy(out);
    assert_int_equal(unsetenv("BRACE_MODELS"), 0);
    brace_bracket_destroy(b);
}

/* Light that the reference cannot hold stays, up to what the shortest frame can; a weight file that makes infinite
 * numbers leaves the reference. */
static void test_numbers(void **state) {
    (void)state;
    models_shape shape = small_shape(false);
    nn_weights *weights = random_weights(&shape, false);
    nn_parameter *bias = nn_weights_find(weights, "conv_last.bias");
    json_t *json = models_shape_json(&shape);
    char *network = json_dumps(json, JSON_COMPACT), path[256];
    scene s = screen;
    s.width = 128, s.height = 96;
    brace_bracket *b = scene_bracket(&s);
    const size_t count = (size_t)s.width * s.height;
    assert_non_null(bias);

    for (size_t i = bias->count - 16; i < bias->count; i++)
        bias->value[i] = 100; /* y = 100 and more: beyond the shortest frame's white */
    save(in(path, "bright.safetensors"), weights, "tmrnet-s", network, 128);
    brace_restored *out = restore(b, "bright.safetensors", NULL, 2);
    for (size_t i = 0; i < count; i++)
        assert_true(out->mosaic[i] > 15.99f && out->mosaic[i] < 16.01f && out->frame->data[i] == out->frame->white);
    assert_true(out->report.clipped == 1);
    brace_restored_destroy(out);

    for (size_t i = bias->count - 16; i < bias->count; i++)
        bias->value[i] = 1e30f; /* to the 2.2nd power: infinite */
    save(in(path, "infinite.safetensors"), weights, "tmrnet-s", network, 128);
    out = restore(b, "infinite.safetensors", NULL, 2);
    assert_non_null(strstr(notes, "gave no number for 12288 pixels"));
    for (size_t i = 0; i < count; i++)
        assert_int_equal(out->frame->data[i], b->frames[2]->data[i]);
    brace_restored_destroy(out);
    nn_weights_destroy(weights);
    free(network);
    json_decref(json);
    brace_bracket_destroy(b);
}

/* ---- files that are none ---- */

static void refused(const brace_bracket *b, const char *name, const char *says) {
    brace_error error = {0};
    brace_restored *out = NULL;
    const brace_status status = try(&out, b, name, NULL, 1, &error);
    if (status == BRACE_OK)
        fail_msg("%s was taken", name);
    if (strstr(error.message, says) == NULL || strstr(error.message, name) == NULL)
        fail_msg("%s: \"%s\" does not say \"%s\"", name, error.message, says);
    assert_null(out);
}

static void copy_part(const char *from, const char *to, double share) {
    char path[2][256];
    void *data;
    size_t size;
    brace_error error = {0};
    ok(core_file_load(&data, &size, in(path[0], from), (size_t)1 << 28, &error), &error);
    FILE *f = fopen(in(path[1], to), "w");
    assert_true(f != NULL && fwrite(data, 1, (size_t)(share * (double)size), f) > 0 && fclose(f) == 0);
    core_free(data);
}

static void test_hostile(void **state) {
    (void)state;
    models_shape shape = small_shape(true);
    scene s = screen;
    s.width = 96, s.height = 96;
    brace_bracket *b = scene_bracket(&s);
    char path[256];
    nn_weights *weights = random_weights(&shape, true);
    json_t *json = models_shape_json(&shape);
    char *network = json_dumps(json, JSON_COMPACT);

    save_network("good.safetensors", &shape, true, 128);
    brace_restored_destroy(restore(b, "good.safetensors", NULL, 1));
    refused(b, "missing.safetensors", "");
    for (int i = 0; i < 8; i++) {
        copy_part("good.safetensors", "cut.safetensors", i == 0 ? 0.0001 : i / 8.0);
        refused(b, "cut.safetensors", "");
    }
    save(in(path, "nameless.safetensors"), weights, NULL, NULL, 128);
    refused(b, "nameless.safetensors", "does not say what network");
    save(in(path, "stranger.safetensors"), weights, "resnet", "{}", 128);
    refused(b, "stranger.safetensors", "does not say what network");
    save(in(path, "larger.safetensors"), weights, "brace-s", NULL, 128);
    refused(b, "larger.safetensors", "feat_extract.main: 0.weight is 8 x 64 x 3 x 3 in the file, and 32 x 64 x 3 x 3");
    save(in(path, "other.safetensors"), weights, "brace", NULL, 128);
    refused(b, "other.safetensors", "is not in");
    static const char *const networks[][2] = {
        {"{\"channels\":1024,\"global\":1000,\"frame\":1000,\"extract\":1000}", "feat_extract.main: 0.weight"},
        {"{\"channels\":100000}", "out of range"},
        {"{\"channels\":-3}", "out of range"},
        {"{\"chanels\":16}", "chanels"},
        {"{\"frames\":\"five\"}", "frames"},
        {"{\"unshuffle\":3}", "none of 1, 2 and 4"},
        {"[1, 2]", "its network"},
        {"{", "its network"},
    };
    for (size_t i = 0; i < sizeof networks / sizeof *networks; i++) {
        save(in(path, "shape.safetensors"), weights, "brace-s", networks[i][0], 128);
        refused(b, "shape.safetensors", networks[i][1]);
    }
    nn_parameter *p = nn_weights_find(weights, "conv_hr.weight");
    assert_non_null(p);
    p->value[7] = NAN;
    save(in(path, "nan.safetensors"), weights, "brace-s", network, 128);
    refused(b, "nan.safetensors", "'conv_hr.weight' have a number that is none");
    p->value[7] = -INFINITY;
    save(in(path, "inf.safetensors"), weights, "brace-s", network, 128);
    refused(b, "inf.safetensors", "'conv_hr.weight' have a number that is none");

    /* A crop of training that is none is not believed. */
    p->value[7] = 0;
    save(in(path, "crop.safetensors"), weights, "brace-s", network, 2000000000);
    brace_restored_destroy(restore(b, "crop.safetensors", NULL, 1));
    free(network);
    json_decref(json);
    nn_weights_destroy(weights);
    brace_bracket_destroy(b);
}

/* Wherever memory ends there is a sentence, and nothing is lost. */
static void test_memory_ends(void **state) {
    (void)state;
    models_shape shape = small_shape(true);
    save_network("ends.safetensors", &shape, true, 32);
    scene s = screen;
    s.width = 64, s.height = 64;
    brace_bracket *b = scene_bracket(&s);
    brace_status status = BRACE_ERROR_MEMORY;
    long n = 1;
    for (; status != BRACE_OK && n < 100000; n += 1 + n / 12) {
        brace_error error = {0};
        brace_restored *out = NULL;
        core_alloc_fail_after(n);
        status = try(&out, b, "ends.safetensors", NULL, 1, &error);
        core_alloc_fail_after(0);
        assert_true(status == BRACE_OK || (error.message[0] != '\0' && out == NULL));
        brace_restored_destroy(out);
    }
    assert_true(status == BRACE_OK && n > 100);
    brace_bracket_destroy(b);
}

static void stop_at_tile(void *user, const char *stage, uint64_t done, uint64_t total) {
    (void)total;
    if (strcmp(stage, "restoring") == 0 && done == 1)
        *(volatile int *)user = 1;
}

static void test_cancelled(void **state) {
    (void)state;
    models_shape shape = small_shape(true);
    save_network("cancel.safetensors", &shape, true, 128);
    brace_bracket *b = scene_bracket(&screen);
    volatile int cancel = 0;
    char path[256];
    brace_error error = {0};
    brace_restored *out = NULL;
    const brace_job job = {.threads = 2, .progress = stop_at_tile, .user = (void *)&cancel, .cancel = &cancel};
    const brace_restore_params params = {.model = in(path, "cancel.safetensors"), .memory = 8000000, .no_align = true};
    assert_int_equal(brace_restore(&out, b, &params, &job, &error), BRACE_ERROR_CANCELLED);
    assert_null(out);
    brace_bracket_destroy(b);
}

static int make_folder(void **state) {
    (void)state;
    return mkdtemp(folder) != NULL && setenv("BRACE_MODELS", folder, 1) == 0 ? 0 : -1;
}

static int remove_folder(void **state) {
    (void)state;
    char command[64];
    snprintf(command, sizeof command, "rm -rf '%s'", folder);
    return system(command);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_tiles),    cmocka_unit_test(test_shown),          cmocka_unit_test(test_untaught),
        cmocka_unit_test(test_seams),    cmocka_unit_test(test_colours),        cmocka_unit_test(test_memory),
        cmocka_unit_test(test_threads),  cmocka_unit_test(test_other_brackets), cmocka_unit_test(test_numbers),
        cmocka_unit_test(test_hostile),  cmocka_unit_test(test_memory_ends),    cmocka_unit_test(test_cancelled),
    };
    return cmocka_run_group_tests_name("network", tests, make_folder, remove_folder);
}
