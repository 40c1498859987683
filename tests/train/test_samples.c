/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_samples.c: what a network is shown: that crops turn as the world would,
 * that sources give the same for the same number, and refuse what is no set.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "brace/develop.h"
#include "core/safetensors.h"
#include "sim/dataset.h"
#include "sim/simulate.h"
#include "train/feed.h"

static void ok(brace_status status, const brace_error *error) {
    if (status != BRACE_OK) {
        fail_msg("%s", error->message);
    }
}

/* A screen without any symmetry. */
static brace_image *screen(uint32_t width, uint32_t height, bool flip_x, bool flip_y, bool transpose) {
    brace_image *image;
    brace_error error = {0};
    ok(brace_image_create(&image, width, height, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, &error), &error);
    for (uint32_t y = 0; y < height; y++) {
        for (uint32_t x = 0; x < width; x++) {
            uint32_t a = flip_x ? width - 1 - x : x, b = flip_y ? height - 1 - y : y;
            if (transpose) {
                const uint32_t t = a;
                a = b, b = t;
            }
            uint8_t *p = (uint8_t *)image->data + y * image->stride + 3 * x;
            p[0] = (uint8_t)(40 + a * 7 % 200), p[1] = (uint8_t)(30 + (a * 3 + b * 5) % 190);
            p[2] = (uint8_t)(20 + (b * 11 + a / 3) % 210);
        }
    }
    return image;
}

enum { FRAME = 96 };

/* A steady screen, square before a camera of the given CFA. */
static sim_capture capture(const brace_image *image, brace_cfa cfa) {
    brace_error error = {0};
    sim_display *display;
    sim_camera camera;
    sim_capture out;
    sim_scene scene;
    sim_scene_default(&scene);
    scene.width = scene.height = FRAME;
    scene.pose.translation[2] = 0.5, scene.reference_time = 1.0 / 500, scene.level = 0.8, scene.noise = 0;
    ok(sim_camera_load(&camera, "phone_median", &error), &error);
    camera.cfa = (int)cfa;
    ok(sim_display_load(&display, "steady", &error), &error);
    ok(sim_capture_create(&out, image, display, &camera, &scene, NULL, &error), &error);
    sim_display_destroy(display);
    return out;
}

static train_bracket bracket_of(const sim_capture *c) {
    brace_error error = {0};
    train_bracket b = {.count = c->count};
    for (int i = 0; i < c->count; i++) {
        train_bracket_set(&b, i, c->frame[i]);
    }
    train_bracket_set(&b, -1, c->truth);
    ok(train_bracket_finish(&b, &error), &error);
    return b;
}

/* Photographing the turned screen with the camera whose colours are turned with it is turning the photograph: its crop,
 * RGGB, has the numbers of the turned crop of the plain photograph. */
static void test_turned(void **state) {
    (void)state;
    enum { SIDE = 16 };
    static const brace_cfa mirrored[] = {BRACE_CFA_RGGB, BRACE_CFA_GRBG, BRACE_CFA_GBRG, BRACE_CFA_BGGR};
    brace_image *image = screen(FRAME, FRAME, false, false, false);
    sim_capture plain = capture(image, BRACE_CFA_RGGB);
    brace_image_destroy(image);
    const train_bracket from = bracket_of(&plain);
    for (int turn = 0; turn < 8; turn++) {
        const bool flip_x = turn & 1, flip_y = turn & 2, transpose = turn & 4;
        image = screen(FRAME, FRAME, flip_x, flip_y, transpose);
        /* screen: pixel (x, y) of the turned one is (flip x, flip y), exchanged, of the plain one */
        sim_capture turned = capture(image, mirrored[turn & 3]);
        brace_image_destroy(image);
        const train_bracket to = bracket_of(&turned);
        const uint32_t red_x = flip_x, red_y = flip_y; /* where GRBG and GBRG have their first red */
        const train_window there = {.x0 = 20 + red_x, .y0 = 26 + red_y};
        uint32_t x0 = flip_x ? FRAME - 1 - there.x0 : there.x0, y0 = flip_y ? FRAME - 1 - there.y0 : there.y0;
        if (transpose) {
            const uint32_t t = x0;
            x0 = y0, y0 = t;
        }
        const train_window here = {.x0 = x0,
                                   .y0 = y0,
                                   .flip_x = transpose ? flip_y : flip_x,
                                   .flip_y = transpose ? flip_x : flip_y,
                                   .transpose = transpose};
        assert_true(here.x0 % 2 == 0 && here.y0 % 2 == 0); /* red */
        float a[SIDE * SIDE * 4], b[SIDE * SIDE * 4];
        double difference = 0, spread = 0;
        train_crop(a, &to.truth, to.width, &there, SIDE);
        train_crop(b, &from.truth, from.width, &here, SIDE);
        for (int i = 0; i < SIDE * SIDE * 4; i++) {
            assert_true(isfinite(a[i]) && isfinite(b[i]));
            difference = fmax(difference, fabs((double)a[i] - (double)b[i]));
            spread = fmax(spread, fabs((double)a[i] - (double)a[i % 4]));
        }
        if (!(difference < 0.003 && spread > 0.1)) {
            fail_msg("turn %d: %g off", turn, difference);
        }
        sim_capture_free(&turned);
    }
    sim_capture_free(&plain);
}

/* Every window that is drawn lies in the frame and begins with red; all turns and the outermost positions come. */
static void test_windows(void **state) {
    (void)state;
    for (int cfa = 0; cfa < 4; cfa++) {
        for (uint32_t odd = 0; odd < 2; odd++) {
            train_bracket b = {.width = 18 + odd, .height = 21};
            b.frame[0].cfa = (brace_cfa)cfa;
            core_random r = core_random_create(1, (uint32_t)cfa, odd, 0);
            unsigned turns = 0;
            uint32_t lowest = 99, highest = 0;
            for (int i = 0; i < 2000; i++) {
                const train_window w = train_window_draw(&r, &b, 8, true, true);
                turns |= 1u << (w.flip_x + 2 * w.flip_y + 4 * w.transpose);
                const uint32_t left = w.flip_x ? w.x0 - 15 : w.x0, top = w.flip_y ? w.y0 - 15 : w.y0;
                assert_true(left + 16 <= b.width && top + 16 <= b.height);
                assert_int_equal(brace_cfa_color(b.frame[0].cfa, w.x0, w.y0), 0);
                lowest = left < lowest ? left : lowest, highest = left > highest ? left : highest;
            }
            assert_int_equal(turns, 255);
            assert_true(lowest <= 1 && highest >= b.width - 17);
        }
    }
}

/* Input, truth and colour of a sample, from the frames' raw numbers. */
static void test_sample(void **state) {
    (void)state;
    enum { SIDE = 24 };
    brace_error error = {0};
    brace_image *image = screen(FRAME, FRAME, false, false, false);
    sim_capture c = capture(image, BRACE_CFA_GBRG);
    brace_image_destroy(image);
    const train_bracket b = bracket_of(&c);
    train_sample s;
    ok(train_sample_create(&s, 5, SIDE, &error), &error);
    const train_window w = {.x0 = 6, .y0 = 9};
    ok(train_sample_make(&s, &b, &w, &error), &error);
    static const int order[5] = {2, 0, 1, 3, 4};
    for (int k = 0; k < 5; k++) {
        const brace_frame *f = c.frame[order[k]];
        for (uint32_t y = 0; y < 2 * SIDE; y++) {
            for (uint32_t x = 0; x < 2 * SIDE; x++) {
                const uint32_t sx = x + 6, sy = y + 9;
                const double black = (double)f->black[(sy & 1) * 2 + (sx & 1)];
                const double v =
                    ((double)f->data[sy * FRAME + sx] - black) / ((double)f->white - black) * pow(4, 2 - order[k]);
                const float *got =
                    s.input + ((((size_t)k * SIDE + y / 2) * SIDE + x / 2) * 4 + (y & 1) * 2 + (x & 1)) * 2;
                assert_true(fabs((double)got[0] - v) < 1e-5 * (1 + fabs(v)));
                assert_true(fabs((double)got[1] - pow(fmax(v, 0), 1 / 2.2)) < 1e-4);
            }
        }
        assert_true(s.rho[k] >= 0 && s.rho[k] <= 1 && s.rho[k] == s.descriptor[k][5]);
    }
    /* Gains and matrix are those with which grey comes out grey. */
    for (int column = 0; column < 3; column++) {
        double sum = 0;
        for (int row = 0; row < 3; row++) {
            sum += (double)s.matrix[3 * row + column];
        }
        assert_true(fabs(sum - 1) < 1e-5);
        assert_true((double)s.gains[column] >= 1 - 1e-6);
    }
    train_sample_free(&s);
    sim_capture_free(&c);
}

/* ---- sources ---- */

static uint64_t digest(const train_sample *s) {
    uint64_t h = 1469598103934665603u;
    const size_t pixels = (size_t)s->side * (size_t)s->side;
    const struct {
        const void *data;
        size_t size;
    } parts[] = {{s->input, (size_t)s->frames * pixels * 32},
                 {s->truth, pixels * 16},
                 {s->descriptor, sizeof s->descriptor},
                 {s->rho, sizeof s->rho},
                 {s->gains, sizeof s->gains},
                 {s->matrix, sizeof s->matrix}};
    for (size_t k = 0; k < sizeof parts / sizeof *parts; k++) {
        for (size_t i = 0; i < parts[k].size; i++) {
            h = (h ^ ((const uint8_t *)parts[k].data)[i]) * 1099511628211u;
        }
    }
    return h;
}

enum { SEEN = 10 };

static void take(uint64_t *out, const train_source *source, const train_feed_params *params, int count) {
    brace_error error = {0};
    train_feed *feed;
    ok(train_feed_create(&feed, source, params, &error), &error);
    for (int i = 0; i < count; i++) {
        const train_sample *s;
        ok(train_feed_next(feed, &s, &error), &error);
        out[i] = digest(s);
    }
    train_feed_destroy(feed);
}

static void check_source(const train_source_params *params) {
    brace_error error = {0};
    train_source *source;
    ok(train_source_create(&source, params, NULL, &error), &error);
    uint64_t all[SEEN], again[SEEN];
    take(all, source, &(train_feed_params){.batch = 5, .threads = 1}, SEEN);
    take(again, source, &(train_feed_params){.batch = 5, .threads = 3}, SEEN);
    assert_memory_equal(all, again, sizeof all); /* any number of threads */
    for (int i = 0; i < SEEN; i++) {
        for (int k = 0; k < i; k++) {
            assert_true(all[i] != all[k]); /* all differ */
        }
    }
    take(again, source, &(train_feed_params){.batch = 5, .step = 1}, 5);
    assert_memory_equal(all + 5, again, 5 * sizeof *all); /* begun later */
    uint64_t part[2][4];                                  /* two processes: 3 and 2 of every batch */
    take(part[0], source, &(train_feed_params){.batch = 5, .first = 0, .count = 3}, 4);
    take(part[1], source, &(train_feed_params){.batch = 5, .first = 3, .count = 2}, 4);
    assert_memory_equal(part[0], all, 3 * sizeof *all);
    assert_true(part[0][3] == all[5]);
    assert_memory_equal(part[1], all + 3, 2 * sizeof *all);
    assert_memory_equal(part[1] + 2, all + 8, 2 * sizeof *all);
    train_source_destroy(source);
    train_source_params other = *params; /* another seed, other samples */
    other.seed++;
    ok(train_source_create(&source, &other, NULL, &error), &error);
    take(again, source, &(train_feed_params){.batch = 5}, 1);
    assert_true(again[0] != all[0]);
    train_source_destroy(source);
}

static const train_source_params rendered = {
    .width = 96, .height = 96, .side = 16, .crops = 2, .mirrored = true, .transposed = true, .seed = 3, .test_share = 0.3};

static void test_rendered(void **state) {
    (void)state;
    check_source(&rendered);
    brace_error error = {0};
    train_source *source;
    train_source_params small = rendered;
    small.side = 48;
    assert_int_equal(train_source_create(&source, &small, NULL, &error), BRACE_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "crops of 48"));
    small = rendered;
    small.screens = "/nowhere";
    assert_int_equal(train_source_create(&source, &small, NULL, &error), BRACE_ERROR_IO);
}

static void remove_folder(const char *folder) {
    char command[300];
    snprintf(command, sizeof command, "rm -rf '%s'", folder);
    assert_int_equal(system(command), 0);
}

/* A packed bracket is merged as its files are, to the byte: all that aligning and merging use was packed. */
static void check_merged(const char *set, const char *shards) {
    brace_error error = {0};
    train_packed *packed;
    ok(train_packed_open(&packed, shards, "train", 0, &error), &error);
    for (size_t k = 0; k < train_packed_count(packed); k++) {
        train_bracket from[2] = {*train_packed_at(packed, k), {.count = 5}};
        brace_frame *frames[5];
        for (int i = 0; i < 5; i++) {
            char path[256];
            snprintf(path, sizeof path, "%s/%s/frame_%d.dng", set, train_packed_name(packed, k), i + 1);
            ok(brace_frame_read(&frames[i], path, NULL, &error), &error);
            train_bracket_set(&from[1], i, frames[i]);
        }
        from[1].truth = from[0].truth;
        ok(train_bracket_finish(&from[1], &error), &error);
        const size_t pixels = (size_t)from[0].width * from[0].height;
        uint16_t *guide = calloc(2 * pixels, sizeof *guide);
        uint8_t *sigma = calloc(2 * pixels, 1);
        for (int i = 0; i < 2; i++) {
            ok(train_bracket_align(&from[i], NULL, &error), &error);
            ok(train_bracket_merge(&from[i], guide + (size_t)i * pixels, sigma + (size_t)i * pixels, NULL, &error), &error);
        }
        assert_true(from[0].seen[0].noise[1][0] > 0);
        assert_memory_equal(guide, guide + pixels, 2 * pixels);
        assert_memory_equal(sigma, sigma + pixels, pixels);
        for (int i = 0; i < 5; i++) {
            brace_frame_destroy(frames[i]);
        }
        free(guide);
        free(sigma);
    }
    train_packed_close(packed);
}

/* A set twice is two sets: each bracket comes twice before one comes a third time. */
static void check_two_sets(const train_source_params *params) {
    brace_error error = {0};
    train_source_params p = *params;
    train_source *source;
    train_sample s;
    p.packed[1] = p.packed[0], p.crops = 1, p.mirrored = p.transposed = false;
    ok(train_sample_create(&s, 5, p.side, &error), &error);
    ok(train_source_create(&source, &p, NULL, &error), &error);
    assert_int_equal(train_source_size(source), 6);
    float brackets[6]; /* by their white balance, which differs from scene to scene */
    int same = 0;
    for (uint64_t i = 0; i < 6; i++) {
        ok(train_source_get(source, i, 1, &s, NULL, &error), &error);
        brackets[i] = s.gains[0];
        for (uint64_t k = 0; k < i; k++) {
            same += brackets[k] == brackets[i];
        }
    }
    assert_int_equal(same, 3);
    train_source_destroy(source);
    train_sample_free(&s);
}

/* So many brackets, and a sample of each can be had. */
static void check_samples(const train_source *source, size_t count) {
    brace_error error = {0};
    train_sample s;
    ok(train_sample_create(&s, 5, train_source_params_of(source)->side, &error), &error);
    assert_int_equal(train_source_size(source), count);
    for (uint64_t i = 0; i < count; i++) {
        const uint64_t first = i * (uint64_t)train_source_params_of(source)->crops;
        ok(train_source_get(source, first, 1, &s, NULL, &error), &error);
    }
    train_sample_free(&s);
}

static void test_packed(void **state) {
    (void)state;
    brace_error error = {0};
    char folder[] = "/tmp/brace-train-XXXXXX", set[64], shards[64], none[64];
    assert_non_null(mkdtemp(folder));
    snprintf(set, sizeof set, "%s/set", folder);
    snprintf(shards, sizeof shards, "%s/shards", folder);
    snprintf(none, sizeof none, "%s/set/train", folder);
    dataset_built done;
    const dataset_build_params build = {.seed = 4, .train = 3, .test = 2, .width = 80, .height = 64};
    ok(dataset_build(set, &build, &done, NULL, &error), &error);
    size_t count;
    ok(dataset_pack(set, shards, &(dataset_pack_params){.shard_bytes = 100000}, NULL, &count, &error), &error);
    assert_true(count > 2); /* several shards a split */
    train_source_params p = {.packed = {shards}, .side = 16, .crops = 2, .mirrored = true, .transposed = true, .seed = 3};
    check_source(&p);
    check_merged(set, shards);
    train_source *source;
    ok(train_source_create(&source, &p, NULL, &error), &error);
    assert_int_equal(train_source_size(source), 3);
    train_source_destroy(source);
    check_two_sets(&p);
    p.test = true;
    ok(train_source_create(&source, &p, NULL, &error), &error);
    assert_int_equal(train_source_size(source), 2);
    train_source_destroy(source);
    for (int i = 0; i < 2; i++) { /* of two folders one without shards: fit for testing, not for training */
        p.packed[i] = none, p.packed[1 - i] = shards;
        ok(train_source_create(&source, &p, NULL, &error), &error);
        check_samples(source, 2);
        train_source_destroy(source);
        p.test = false;
        assert_int_equal(train_source_create(&source, &p, NULL, &error), BRACE_ERROR_ARGUMENT);
        assert_non_null(strstr(error.message, none));
        p.test = true;
    }
    p.packed[0] = p.packed[1] = none;
    assert_int_equal(train_source_create(&source, &p, NULL, &error), BRACE_ERROR_ARGUMENT);
    p.packed[0] = shards, p.packed[1] = NULL, p.side = 32; /* 66 rows would be needed */
    ok(train_source_create(&source, &p, NULL, &error), &error);
    train_sample s;
    ok(train_sample_create(&s, 5, 32, &error), &error);
    assert_int_equal(train_source_get(source, 0, 1, &s, NULL, &error), BRACE_ERROR_MISMATCH);
    assert_non_null(strstr(error.message, "test/000000"));
    train_feed *feed; /* a feed hands on the error */
    const train_sample *next;
    ok(train_feed_create(&feed, source, &(train_feed_params){.batch = 2}, &error), &error);
    assert_int_equal(train_feed_next(feed, &next, &error), BRACE_ERROR_MISMATCH);
    train_feed_destroy(feed);
    train_sample_free(&s);
    train_source_destroy(source);
    p.frames = 7;
    assert_int_equal(train_source_create(&source, &p, NULL, &error), BRACE_ERROR_MISMATCH);
    remove_folder(folder);
}

/* Shards whose texts say what cannot be. */
static void test_damaged(void **state) {
    (void)state;
    static const char good[] =
        "{\"cfa\":\"RGGB\",\"black\":[64,64,64,64],\"white\":1023,\"exposure_time\":%s,\"iso\":100,"
        "\"as_shot_neutral\":[0.5,1,0.6],\"color_matrix_1\":[1,0,0,0,1,0,0,0,1],"
        "\"illuminant_1\":21,\"color_matrix_2\":[0,0,0,0,0,0,0,0,0],\"illuminant_2\":0,\"noise\":[1,0,1,0,1,0]}";
    static const struct {
        const char *was, *is;
        uint64_t frames;
        const char *says;
    } cases[] = {{"", "", 3, NULL},
                 {"RGGB", "RGBG", 3, "incomplete"},
                 {"\"white\":1023", "\"white\":12", 3, "no levels"},
                 {"\"iso\":100", "\"iso\":-100", 3, "exposure of frame"},
                 {"[0.5,1,0.6]", "[0.5,1]", 3, "incomplete"},
                 {"[1,0,1,0,1,0]", "[1,0,1,0,1]", 3, "incomplete"},
                 {"\"white\":1023", "\"white\":\"x\"", 3, "no levels"},
                 {"", "", 2, "not those of a bracket"}};
    char folder[] = "/tmp/brace-train-XXXXXX", path[64];
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/train-00000.safetensors", folder);
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        brace_error error = {0};
        char text[4096] = "{\"frames\":[", one[1024];
        static const char *const times[] = {"0.001", "0.004", "0.016", "0.004"};
        for (int i = 0; i < 4; i++) {
            snprintf(one, sizeof one, good, times[i]);
            strcat(text, i == 3 ? "],\"gt\":" : i > 0 ? "," : "");
            strcat(text, one);
        }
        strcat(text, "}");
        char *at = cases[k].was[0] != '\0' ? strstr(text, cases[k].was) : NULL;
        if (at != NULL) {
            char rest[4096];
            strcpy(rest, at + strlen(cases[k].was));
            strcpy(at, cases[k].is);
            strcat(text, rest);
        }
        static const uint16_t pixels[3 * 40 * 40];
        core_safetensors_writer *writer;
        ok(core_safetensors_create(&writer, path, 0, &error), &error);
        ok(core_safetensors_add_metadata(writer, "format", DATASET_FORMAT, &error), &error);
        ok(core_safetensors_add_metadata(writer, "a", text, &error), &error);
        core_tensor t = {
            .name = "a/frames", .dtype = CORE_U16, .rank = 3, .shape = {cases[k].frames, 40, 40}, .data = pixels};
        ok(core_safetensors_add(writer, &t, &error), &error);
        t = (core_tensor){.name = "a/gt", .dtype = CORE_U16, .rank = 2, .shape = {40, 40}, .data = pixels};
        ok(core_safetensors_add(writer, &t, &error), &error);
        ok(core_safetensors_commit(writer, &error), &error);
        train_source *source = NULL;
        const train_source_params p = {.packed = {folder}, .side = 16, .frames = 3};
        const brace_status status = train_source_create(&source, &p, NULL, &error);
        if (cases[k].says == NULL) {
            ok(status, &error);
        } else if (status == BRACE_OK || strstr(error.message, cases[k].says) == NULL) {
            fail_msg("case %zu: '%s'", k, status == BRACE_OK ? "taken" : error.message);
        }
        train_source_destroy(source);
    }
    remove_folder(folder);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_turned),   cmocka_unit_test(test_windows), cmocka_unit_test(test_sample),
        cmocka_unit_test(test_rendered), cmocka_unit_test(test_packed),  cmocka_unit_test(test_damaged),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
