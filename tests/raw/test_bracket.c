/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_bracket.c: sorting, the reference, every refusal with its sentence, and
 * the pixels' own opinion of the exposures.
 */
#include <math.h>

#include "raw_test.h"

enum { SIDE = 96 };

/* Frame i of five shows one scene at 4^(i-2) times its light. */
static brace_frame *scene_frame(double time, double light) {
    brace_frame *f = NULL;
    assert_int_equal(brace_frame_create(&f, SIDE, SIDE, BRACE_CFA_RGGB, NULL), BRACE_OK);
    strcpy(f->make, "Tester");
    strcpy(f->model, "One");
    f->white = 16383.0f;
    f->exposure_time = time;
    f->iso = 100.0;
    f->f_number = 2.0;
    for (int i = 0; i < 4; i++) {
        f->black[i] = 512.0f;
    }
    for (uint32_t y = 0; y < SIDE; y++) {
        for (uint32_t x = 0; x < SIDE; x++) {
            double content = 0.02 + 0.3 * (double)((x / 4 * 7 + y / 4 * 3) % 16) / 16.0;
            double v = 512.0 + 15871.0 * content * light;
            f->data[y * SIDE + x] = (uint16_t)(v > 16383.0 ? 16383.0 : v);
        }
    }
    return f;
}

static void make_scene(brace_frame *frames[5]) {
    static const int step[5] = {3, 0, 4, 1, 2}; /* given out of order */
    for (int i = 0; i < 5; i++) {
        double ratio = pow(4.0, step[i] - 2);
        frames[i] = scene_frame(0.01 * ratio, ratio);
    }
}

static void free_scene(brace_frame *frames[5]) {
    for (int i = 0; i < 5; i++) {
        brace_frame_destroy(frames[i]);
    }
}

static void test_sorts(void **state) {
    (void)state;
    brace_frame *frames[5];
    brace_bracket *b = NULL;
    brace_job job = noting_job();
    make_scene(frames);
    assert_int_equal(brace_bracket_create(&b, frames, 5, NULL, &job, NULL), BRACE_OK);
    assert_string_equal(test_notes, "");
    static const size_t order[5] = {1, 3, 4, 0, 2};
    assert_int_equal(b->count, 5);
    assert_int_equal(b->reference, 2);
    for (size_t i = 0; i < 5; i++) {
        double want = pow(4.0, (double)i - 2.0);
        assert_int_equal(b->order[i], order[i]);
        assert_ptr_equal(b->frames[i], frames[order[i]]);
        assert_true(fabs(b->exposure[i] / want - 1.0) < 1e-12);
        assert_true(isnan(b->measured[i]) || fabs(b->measured[i] / want - 1.0) < 0.05);
    }
    assert_true(b->measured[2] == 1.0);
    assert_true(b->measured[1] > 0.0);
    brace_bracket_destroy(b);
    brace_bracket_destroy(NULL);
}

static void test_reference(void **state) {
    (void)state;
    brace_frame *frames[5];
    brace_bracket *b = NULL;
    make_scene(frames);
    brace_bracket_params params = {.reference = 2}; /* as given: the shortest */
    assert_int_equal(brace_bracket_create(&b, frames, 5, &params, NULL, NULL), BRACE_OK);
    assert_int_equal(b->reference, 0);
    assert_true(b->exposure[0] == 1.0 && fabs(b->exposure[4] - 256.0) < 1e-9);
    brace_bracket_destroy(b);

    make_scene(frames);
    brace_frame_destroy(frames[2]);
    assert_int_equal(
        brace_bracket_create(&b, (brace_frame *[]){frames[0], frames[1], frames[3], frames[4]}, 4, NULL, NULL, NULL),
        BRACE_OK);
    assert_int_equal(b->reference, 1); /* the shorter of the middle two */
    brace_bracket_destroy(b);
}

/* Exposure is time * ISO / f^2: a frame at half the time and twice the ISO is no other exposure. */
static void test_exposure_product(void **state) {
    (void)state;
    brace_frame *frames[5];
    brace_bracket *b = NULL;
    make_scene(frames);
    frames[1]->iso = 400.0;
    frames[2]->f_number = 4.0;
    assert_int_equal(brace_bracket_create(&b, frames, 5, NULL, NULL, NULL), BRACE_OK);
    for (size_t i = 0; i < 5; i++) {
        const brace_frame *f = b->frames[i], *r = b->frames[b->reference];
        double want = f->exposure_time * f->iso / (f->f_number * f->f_number) * (r->f_number * r->f_number) /
                      (r->exposure_time * r->iso);
        assert_true(fabs(b->exposure[i] / want - 1.0) < 1e-12);
    }
    brace_bracket_destroy(b);
}

static void assert_refused(brace_frame **frames, size_t count, const brace_bracket_params *params, brace_status status,
                           const char *words) {
    brace_bracket *b = NULL;
    brace_error e = {0};
    brace_status got = brace_bracket_create(&b, frames, count, params, NULL, &e);
    if (got != status || strstr(e.message, words) == NULL) {
        fail_msg("status %d, \"%s\"; wanted %d and \"%s\"", (int)got, e.message, (int)status, words);
    }
    assert_null(b);
}

static void test_refusals(void **state) {
    (void)state;
    brace_frame *f[5], *many[10];
    make_scene(f);
    for (int i = 0; i < 10; i++) {
        many[i] = f[i % 5];
    }
    assert_refused(f, 2, NULL, BRACE_ERROR_ARGUMENT, "2 frames were given: a bracket needs 3 to 9");
    assert_refused(f, 1, NULL, BRACE_ERROR_ARGUMENT, "1 frame was given");
    assert_refused(many, 10, NULL, BRACE_ERROR_ARGUMENT, "10 frames were given: a bracket has at most 9");
    assert_refused(many, 6, NULL, BRACE_ERROR_MISMATCH, "frame 1 is given twice");
    assert_refused(f, 5, &(brace_bracket_params){.reference = 6}, BRACE_ERROR_ARGUMENT, "frame 6 cannot be the");

    strcpy(f[3]->model, "Two");
    assert_refused(f, 5, NULL, BRACE_ERROR_MISMATCH,
                   "frame 4 was taken with another camera (Tester Two) than frame 1 (Tester One)");
    strcpy(f[3]->model, "One");

    f[0]->width = 48; /* the first may be the odd one, too */
    assert_refused(f, 5, NULL, BRACE_ERROR_MISMATCH, "frame 1 has 48 x 96 pixels, but frame 2 has 96 x 96");
    for (int i = 1; i < 5; i++) {
        f[i]->height = 48;
    }
    assert_refused(f, 5, NULL, BRACE_ERROR_MISMATCH, "one of them was turned");
    for (int i = 0; i < 5; i++) {
        f[i]->width = f[i]->height = SIDE;
    }

    f[4]->cfa = BRACE_CFA_BGGR;
    assert_refused(f, 5, NULL, BRACE_ERROR_MISMATCH, "frame 5 has the colour filter order BGGR, but frame 1 has RGGB");
    f[4]->cfa = BRACE_CFA_RGGB;

    double time = f[2]->exposure_time;
    f[2]->exposure_time = 0.0;
    assert_refused(f, 5, NULL, BRACE_ERROR_MISMATCH, "frame 3 does not say its exposure time");
    assert_refused(f, 5, NULL, BRACE_ERROR_MISMATCH, "--exposures");
    f[2]->exposure_time = time;

    double times[5];
    for (int i = 0; i < 5; i++) {
        times[i] = f[i]->exposure_time;
        f[i]->exposure_time = i == 0 ? 0.0101 : 0.01;
    }
    assert_refused(f, 5, NULL, BRACE_ERROR_MISMATCH, "all 5 frames, from ");
    for (int i = 0; i < 5; i++) {
        f[i]->exposure_time = times[i];
    }

    double given[5] = {1, 2, 3, -4, 5};
    assert_refused(f, 5, &(brace_bracket_params){.exposures = given}, BRACE_ERROR_ARGUMENT,
                   "the exposure -4 given for frame 4 is not above 0");
    volatile int cancel = 1;
    brace_job job = {.cancel = &cancel};
    brace_bracket *b = NULL;
    assert_int_equal(brace_bracket_create(&b, f, 5, NULL, &job, NULL), BRACE_ERROR_CANCELLED);
    f[1]->path[0] = '\0';
    brace_frame *hole[3] = {f[0], NULL, f[2]};
    assert_refused(hole, 3, NULL, BRACE_ERROR_ARGUMENT, "frame 2 of the bracket is missing");
    free_scene(f);
}

static void test_given_exposures(void **state) {
    (void)state;
    brace_frame *f[5];
    brace_bracket *b = NULL;
    make_scene(f);
    for (int i = 0; i < 5; i++) {
        f[i]->exposure_time = 0.0;
    }
    double given[5] = {4, 0.0625, 16, 0.25, 1};
    brace_job job = noting_job();
    assert_int_equal(brace_bracket_create(&b, f, 5, &(brace_bracket_params){.exposures = given}, &job, NULL), BRACE_OK);
    assert_string_equal(test_notes, "");
    assert_int_equal(b->order[0], 1);
    assert_true(b->exposure[4] == 16.0);
    brace_bracket_destroy(b);
}

static void test_missing_aperture(void **state) {
    (void)state;
    brace_frame *f[5];
    brace_bracket *b = NULL;
    make_scene(f);
    f[3]->f_number = 0.0;
    f[0]->f_number = 4.0;
    brace_job job = noting_job();
    assert_int_equal(brace_bracket_create(&b, f, 5, NULL, &job, NULL), BRACE_OK);
    assert_non_null(strstr(test_notes, "frame 4 does not say its aperture"));
    for (size_t i = 0; i < 5; i++) {
        assert_true(fabs(b->exposure[i] / pow(4.0, (double)i - 2.0) - 1.0) < 1e-12);
    }
    brace_bracket_destroy(b);
}

/* A frame that says it is a stop longer than it is gets named; its neighbours do not. */
static void test_names_the_liar(void **state) {
    (void)state;
    static const struct {
        int frame;
        double factor;
        const char *words;
    } cases[] = {{0, 2.0, "frame 4 is 1.0 EV darker"}, {3, 0.5, "frame 2 is 1.0 EV brighter"}, {1, 2.0, "frame 1 is"}};
    for (size_t k = 0; k < 3; k++) {
        brace_frame *f[5];
        brace_bracket *b = NULL;
        make_scene(f);
        f[cases[k].frame]->exposure_time *= cases[k].factor;
        brace_job job = noting_job();
        assert_int_equal(brace_bracket_create(&b, f, 5, NULL, &job, NULL), BRACE_OK);
        if (strstr(test_notes, cases[k].words) == NULL || strchr(test_notes, '\n') != strrchr(test_notes, '\n')) {
            fail_msg("notes: %s; wanted only \"%s\"", test_notes, cases[k].words);
        }
        brace_bracket_destroy(b);
    }
}

/* Deep bands take light by chance; that is no lie of the camera's. */
static void test_bands_are_no_lie(void **state) {
    (void)state;
    for (uint32_t period = 6; period <= 60; period += 9) {
        brace_frame *f[5];
        brace_bracket *b = NULL;
        make_scene(f);
        for (int i = 0; i < 5; i++) {
            if (f[i]->exposure_time < 0.009) {
                for (uint32_t y = 0; y < SIDE; y++) {
                    bool lit = (y + 7 * (uint32_t)i) % period < period / 2;
                    for (uint32_t x = 0; x < SIDE; x++) {
                        uint16_t *p = &f[i]->data[y * SIDE + x];
                        *p = lit ? (uint16_t)(512 + 2 * (*p - 512)) : 512;
                    }
                }
            }
        }
        brace_job job = noting_job();
        assert_int_equal(brace_bracket_create(&b, f, 5, NULL, &job, NULL), BRACE_OK);
        assert_string_equal(test_notes, "");
        brace_bracket_destroy(b);
    }
}

static void count_progress(void *user, const char *stage, uint64_t done, uint64_t total) {
    (void)user;
    assert_string_equal(stage, "reading");
    assert_int_equal(total, 3);
    gather_note(NULL, done == total ? "end" : "step");
}

static void test_reads_files(void **state) {
    (void)state;
    static const char *const names[3] = {"long.dng", "short.dng", "middle.dng"};
    static const double times[3] = {0.04, 0.0025, 0.01};
    const char *paths[3];
    for (int i = 0; i < 3; i++) {
        test_dng d = {.width = 40, .height = 32, .exposure_time = times[i]};
        paths[i] = in_folder(names[i]);
        write_test_dng(paths[i], &d);
    }
    brace_job job = noting_job();
    job.progress = count_progress;
    brace_bracket *b = NULL;
    brace_error e = {0};
    assert_int_equal(brace_bracket_read(&b, paths, 3, NULL, &job, &e), BRACE_OK);
    assert_non_null(strstr(test_notes, "end"));
    assert_string_equal(b->frames[0]->path, paths[1]);
    assert_string_equal(b->frames[1]->path, paths[2]);
    brace_bracket_destroy(b);

    test_dng bare = {.width = 40, .height = 32, .no_exposure = true};
    write_test_dng(paths[1], &bare);
    assert_int_equal(brace_bracket_read(&b, paths, 3, NULL, NULL, &e), BRACE_ERROR_MISMATCH);
    assert_non_null(strstr(e.message, "short.dng does not say its exposure time"));

    write_bytes(paths[1], "\xff\xd8\xff\xe0 jpeg", 9);
    assert_int_equal(brace_bracket_read(&b, paths, 3, NULL, NULL, &e), BRACE_ERROR_FORMAT);
    assert_non_null(strstr(e.message, "short.dng is a JPEG picture"));
    assert_null(b);
    paths[2] = paths[0];
    write_test_dng(paths[1], &(test_dng){.width = 40, .height = 32});
    assert_int_equal(brace_bracket_read(&b, paths, 3, NULL, NULL, &e), BRACE_ERROR_MISMATCH);
    assert_non_null(strstr(e.message, "long.dng is given twice"));
    assert_int_equal(brace_bracket_read(&b, paths, 2, NULL, NULL, &e), BRACE_ERROR_ARGUMENT);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sorts),
        cmocka_unit_test(test_reference),
        cmocka_unit_test(test_exposure_product),
        cmocka_unit_test(test_refusals),
        cmocka_unit_test(test_given_exposures),
        cmocka_unit_test(test_missing_aperture),
        cmocka_unit_test(test_names_the_liar),
        cmocka_unit_test(test_bands_are_no_lie),
        cmocka_unit_test(test_reads_files),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
