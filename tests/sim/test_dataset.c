/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_dataset.c: sets of samples: folders that are whole or not there, packing
 * that gives every pixel back, verification that notices a single bit, import
 * that takes what the protocol says and nothing else, reduction without aliases.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <ftw.h>
#include <limits.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/safetensors.h"
#include "core/sha256.h"
#include "sim/dataset.h"
#include "sim/dataset_priors.h"
#include "sim/quantities.h"

#define assert_near(a, b, limit) assert_true(fabs((double)(a) - (double)(b)) <= (limit))

static char folder[64];
static brace_error error;
static const brace_job job = {.threads = 1};

static int setup(void **state) {
    (void)state;
    memset(&error, 0, sizeof error);
    strcpy(folder, "/tmp/brace-dataset-XXXXXX");
    return mkdtemp(folder) == NULL ? -1 : 0;
}

static int forget(const char *path, const struct stat *info, int kind, struct FTW *ftw) {
    (void)info;
    (void)kind;
    (void)ftw;
    return remove(path);
}

static int teardown(void **state) {
    (void)state;
    return nftw(folder, forget, 16, FTW_DEPTH | FTW_PHYS);
}

static const char *in(const char *name) {
    static char path[8][256];
    static int turn;
    turn = (turn + 1) % 8;
    snprintf(path[turn], sizeof path[turn], "%s/%s", folder, name);
    return path[turn];
}

static bool there(const char *name) {
    return access(in(name), F_OK) == 0;
}

/* A textured screen under row-wise banding, moved by (dx, dy) pixels. */
static brace_frame *make_frame(uint32_t width, uint32_t height, double time, double iso, double dx, double dy,
                               double banding) {
    brace_frame *f = NULL;
    assert_int_equal(brace_frame_create(&f, width, height, BRACE_CFA_GBRG, NULL), BRACE_OK);
    for (uint32_t y = 0; y < height; y++) {
        for (uint32_t x = 0; x < width; x++) {
            double u = x - dx, v = y - dy;
            double light = 0.5 + 0.2 * sin(u * 0.21 + 3 * sin(v * 0.05)) + 0.2 * cos(v * 0.17 + 2 * sin(u * 0.045));
            light *= 1 + banding * sin(y * 0.4);
            double raw = 64 + 3000 * light * time * iso;
            f->data[(size_t)y * width + x] = (uint16_t)fmin(raw, 4095);
        }
    }
    for (int c = 0; c < 4; c++) {
        f->black[c] = 64;
    }
    f->white = 4095;
    f->exposure_time = time;
    f->iso = iso;
    f->f_number = 1.8;
    f->has_noise = true;
    for (int c = 0; c < 3; c++) {
        f->noise[c][0] = 1e-3;
        f->noise[c][1] = 1e-6;
    }
    snprintf(f->make, sizeof f->make, "Test");
    snprintf(f->model, sizeof f->model, "Camera");
    return f;
}

static void save(const char *name, brace_frame *f) {
    const brace_dng_params params = {.no_preview = true};
    assert_int_equal(brace_frame_write_dng(f, in(name), &params, &job, &error), BRACE_OK);
    brace_frame_destroy(f);
}

static void make_sample(const char *name) {
    char path[200];
    assert_int_equal(dataset_make_folder(in(name), &error), BRACE_OK);
    for (int i = 1; i <= 5; i++) {
        snprintf(path, sizeof path, "%s/frame_%d.dng", name, i);
        save(path, make_frame(64, 48, pow(4, i - 3) / 200, 200, 0, 0, 0.3));
    }
    snprintf(path, sizeof path, "%s/gt.dng", name);
    save(path, make_frame(64, 48, 1.0 / 200, 200, 0, 0, 0));
}

static void add_meta(const char *name) {
    json_t *files = NULL;
    char path[200];
    assert_int_equal(dataset_hashes(&files, in(name), &error), BRACE_OK);
    assert_int_equal(json_object_size(files), 6);
    json_t *meta = json_pack("{s:s, s:s, s:f, s:o}", "display", "panel", "family", "phone", "reference_time", 0.005,
                             "files", files);
    snprintf(path, sizeof path, "%s/meta.json", name);
    assert_int_equal(dataset_json_save(meta, in(path), &error), BRACE_OK);
    json_decref(meta);
}

static char told[4000];

static void tell(void *user, const char *sample, const char *problem) {
    (void)user;
    size_t n = strlen(told);
    snprintf(told + n, sizeof told - n, "%s: %s\n", sample, problem);
}

static dataset_verified verify(const char *name) {
    dataset_verified v;
    told[0] = '\0';
    assert_int_equal(dataset_verify(in(name), tell, NULL, &v, &job, &error), BRACE_OK);
    return v;
}

static void test_list(void **state) {
    (void)state;
    dataset_list list;
    assert_int_equal(dataset_list_read(&list, in("none"), &error), BRACE_ERROR_IO);
    assert_int_equal(dataset_list_read(&list, folder, &error), BRACE_ERROR_FORMAT);
    make_sample("test/000001_web");
    make_sample("train/000000_UI");
    make_sample("train/.part-000002_UI"); /* an interrupted one is not there */
    assert_int_equal(dataset_list_read(&list, folder, &error), BRACE_OK);
    assert_int_equal(list.count, 2);
    assert_string_equal(list.items[0].name, "test/000001_web");
    assert_string_equal(list.items[1].name, "train/000000_UI");
    dataset_list_free(&list);
    assert_int_equal(dataset_list_read(&list, in("train/000000_UI"), &error), BRACE_OK);
    assert_int_equal(list.count, 1);
    assert_string_equal(list.items[0].name, "000000_UI");
    dataset_list_free(&list);
}

static void test_begin_finish(void **state) {
    (void)state;
    char *temporary = NULL;
    assert_int_equal(dataset_begin(&temporary, in("set/a"), &error), BRACE_OK);
    assert_true(there("set/.part-a"));
    save("set/.part-a/frame_1.dng", make_frame(64, 48, 0.1, 100, 0, 0, 0));
    core_free(temporary);
    /* The next run begins anew in the same place. */
    assert_int_equal(dataset_begin(&temporary, in("set/a"), &error), BRACE_OK);
    assert_false(there("set/.part-a/frame_1.dng"));
    assert_false(there("set/a"));
    assert_int_equal(dataset_finish(temporary, in("set/a"), &error), BRACE_OK);
    assert_true(there("set/a"));
    assert_false(there("set/.part-a"));
    core_free(temporary);
    assert_int_equal(dataset_begin(&temporary, in("set/b"), &error), BRACE_OK);
    dataset_discard(temporary);
    assert_false(there("set/.part-b"));
    core_free(temporary);
    assert_int_equal(dataset_begin(&temporary, "/dev/null/x/a", &error), BRACE_ERROR_IO);
    assert_null(temporary);
}

/* The packed truth of a sample is this picture. */
static void check_truth(const core_safetensors *file, const char *sample, const char *picture) {
    char name[200];
    snprintf(name, sizeof name, "%s/gt", sample);
    const core_tensor *truth = core_safetensors_find(file, name);
    assert_non_null(truth);
    snprintf(name, sizeof name, "set/%s/%s", sample, picture);
    brace_frame *f = NULL;
    assert_int_equal(brace_frame_read(&f, in(name), &job, &error), BRACE_OK);
    assert_memory_equal(f->data, truth->data, (size_t)f->width * f->height * 2);
    brace_frame_destroy(f);
}

static void test_pack(void **state) {
    (void)state;
    make_sample("set/test/000001_web");
    make_sample("set/train/000000_UI");
    make_sample("set/train/000002_web");
    add_meta("set/train/000000_UI");
    save("set/train/000002_web/gt_exact.dng", make_frame(64, 48, 1.0 / 200, 200, 0.5, 0, 0));
    size_t shards = 0;
    assert_int_equal(dataset_pack(in("set"), in("packed"), NULL, &job, &shards, &error), BRACE_OK);
    assert_int_equal(shards, 2);
    core_safetensors *file = NULL;
    assert_int_equal(core_safetensors_open(&file, in("packed/train-00000.safetensors"), &error), BRACE_OK);
    assert_int_equal(core_safetensors_count(file), 4);
    const core_tensor *frames = core_safetensors_find(file, "train/000002_web/frames");
    assert_non_null(frames);
    assert_int_equal(frames->rank, 3);
    assert_int_equal(frames->shape[0], 5);
    assert_int_equal(frames->shape[1], 48);
    assert_int_equal(frames->shape[2], 64);
    for (int i = 0; i < 5; i++) {
        char name[64];
        snprintf(name, sizeof name, "set/train/000002_web/frame_%d.dng", i + 1);
        brace_frame *f = NULL;
        assert_int_equal(brace_frame_read(&f, in(name), &job, &error), BRACE_OK);
        assert_memory_equal(f->data, (const uint16_t *)frames->data + i * 64 * 48, 64 * 48 * 2);
        brace_frame_destroy(f);
    }
    check_truth(file, "train/000000_UI", "gt.dng");
    check_truth(file, "train/000002_web", "gt_exact.dng");
    json_t *text = json_loads(core_safetensors_metadata(file, "train/000000_UI"), 0, NULL);
    assert_string_equal(json_string_value(json_object_get(json_object_get(text, "meta"), "family")), "phone");
    assert_string_equal(json_string_value(json_object_get(json_object_get(text, "gt"), "cfa")), "GBRG");
    json_decref(text);
    core_safetensors_close(file);
    dataset_verified v = verify("packed");
    assert_int_equal(v.samples, 3);
    assert_int_equal(v.bad, 0);

    /* Smaller shards, then large ones again: nothing stale stays. */
    const dataset_pack_params small = {.shard_bytes = 1000};
    assert_int_equal(dataset_pack(in("set"), in("packed"), &small, &job, &shards, &error), BRACE_OK);
    assert_int_equal(shards, 3);
    assert_true(there("packed/train-00001.safetensors"));
    fclose(fopen(in("packed/motions.safetensors"), "w"));
    assert_int_equal(dataset_pack(in("set"), in("packed"), NULL, &job, &shards, &error), BRACE_OK);
    assert_false(there("packed/train-00001.safetensors"));
    assert_false(there("packed/motions.safetensors")); /* of other shards */

    /* Samples without a split, before and behind one that has: in one shard. */
    make_sample("set/kitchen");
    make_sample("set/wall");
    assert_int_equal(dataset_pack(in("set"), in("packed3"), NULL, &job, &shards, &error), BRACE_OK);
    assert_int_equal(shards, 3);
    v = verify("packed3");
    assert_int_equal(v.samples, 5);
    assert_int_equal(v.bad, 0);

    /* One bit. */
    FILE *f = fopen(in("packed/test-00000.safetensors"), "r+b");
    fseek(f, -1, SEEK_END);
    int byte = getc(f);
    fseek(f, -1, SEEK_END);
    putc(byte ^ 1, f);
    fclose(f);
    v = verify("packed");
    assert_int_equal(v.bad, 1);
    assert_non_null(strstr(told, "test/000001_web"));
    assert_int_equal(truncate(in("packed/test-00000.safetensors"), 100000), 0);
    v = verify("packed");
    assert_int_equal(v.bad, 1);
    assert_non_null(strstr(told, "test-00000.safetensors"));
    unlink(in("set/train/000002_web/gt.dng"));
    assert_int_equal(dataset_pack(in("set"), in("packed2"), NULL, &job, NULL, &error), BRACE_ERROR_FORMAT);
    assert_non_null(strstr(error.message, "train/000002_web"));
    assert_false(there("packed2/train-00000.safetensors"));
}

static void test_verify(void **state) {
    (void)state;
    make_sample("set/train/a");
    make_sample("set/train/b");
    add_meta("set/train/a");
    json_t *index = json_pack("{s:[s,s,s]}", "samples", "train/a", "train/b", "test/c");
    assert_int_equal(dataset_json_save(index, in("set/dataset.json"), &error), BRACE_OK);
    json_decref(index);
    dataset_verified v = verify("set");
    assert_int_equal(v.samples, 2);
    assert_int_equal(v.bad, 0);
    assert_int_equal(v.unhashed, 1);
    assert_int_equal(v.missing, 1);
    assert_string_equal(told, "test/c: it is missing\n");
    save("set/train/a/frame_2.dng", make_frame(64, 48, 0.25 / 200, 200, 1, 0, 0.3));
    v = verify("set");
    assert_int_equal(v.bad, 1);
    assert_non_null(strstr(told, "train/a: frame_2.dng has"));
    save("set/train/b/frame_2.dng", make_frame(66, 48, 0.25 / 200, 200, 0, 0, 0.3));
    save("set/train/a/frame_2.dng", make_frame(64, 48, 0.25 / 200, 200, 0, 0, 0.3));
    v = verify("set");
    assert_int_equal(v.bad, 1);
    assert_non_null(strstr(told, "train/b: frame_2.dng has another size"));
    save("set/train/b/frame_2.dng", make_frame(64, 48, 0.25 / 200, 200, 0, 0, 0.3));
    save("set/train/b/gt.dng", make_frame(64, 48, 1.0 / 50, 200, 0, 0, 0));
    v = verify("set");
    assert_non_null(strstr(told, "train/b: gt.dng has +2.0 stops"));
    unlink(in("set/train/b/frame_3.dng"));
    v = verify("set");
    assert_non_null(strstr(told, "train/b: frame_3.dng is missing"));
    FILE *f = fopen(in("set/train/a/meta.json"), "w");
    fputs("{\"a\": ", f);
    fclose(f);
    v = verify("set");
    assert_non_null(strstr(told, "meta.json:1"));
    assert_int_equal(v.bad, 2);
}

static void test_info(void **state) {
    (void)state;
    make_sample("set/train/000000_web2");
    make_sample("set/train/000007_web2");
    make_sample("set/test/000003_UI");
    add_meta("set/train/000000_web2");
    json_t *info = NULL;
    assert_int_equal(dataset_info(&info, in("set"), &job, &error), BRACE_OK);
    assert_int_equal(json_integer_value(json_object_get(info, "samples")), 3);
    assert_int_equal(json_integer_value(json_object_get(json_object_get(info, "splits"), "train")), 2);
    assert_int_equal(json_integer_value(json_object_get(json_object_get(info, "categories"), "web2")), 2);
    assert_int_equal(json_integer_value(json_object_get(json_object_get(info, "families"), "phone")), 1);
    assert_int_equal(json_integer_value(json_object_get(json_object_get(info, "reference_times"), "1/256 s")), 1);
    json_decref(info);
}

/* A capture by the protocol, in the order in which it is shot. */
static void make_capture(const char *name, double drift, double gt_time) {
    static const double times[] = {16, 4, 1, 0.25, 0.0625};
    char path[200];
    assert_int_equal(dataset_make_folder(in(name), &error), BRACE_OK);
    for (int i = 0; i < 5; i++) {
        snprintf(path, sizeof path, "%s/IMG_%d.dng", name, 10 + i);
        save(path, make_frame(1200, 900, times[i] / 800, 800, 0, 0, 0.4));
    }
    snprintf(path, sizeof path, "%s/IMG_9.dng", name); /* names tell nothing */
    save(path, make_frame(1200, 900, gt_time / 800, 100, drift, 0, 0));
}

static char taken[2000];

static void on_import(void *user, const char *source, const char *sample, const char *problem, double displacement) {
    (void)user;
    (void)source;
    size_t n = strlen(taken);
    snprintf(taken + n, sizeof taken - n, "%s %.2f %s\n", sample, displacement, problem != NULL ? problem : "taken");
}

static void test_import(void **state) {
    (void)state;
    make_capture("card/good", 0, 8);
    make_capture("card/moved", 14, 8);
    make_capture("card/short", 0, 1);
    assert_int_equal(dataset_make_folder(in("card/few"), &error), BRACE_OK);
    save("card/few/a.dng", make_frame(64, 48, 0.1, 100, 0, 0, 0));
    dataset_imported done;
    const char *card = in("card");
    char out[128];
    snprintf(out, sizeof out, "%s/real", folder);
    taken[0] = '\0';
    assert_int_equal(dataset_import(&card, 1, out, NULL, on_import, NULL, &done, &job, &error), BRACE_OK);
    assert_int_equal(done.good, 1);
    assert_int_equal(done.rejected, 3);
    assert_non_null(strstr(taken, "good 0.0"));
    assert_non_null(strstr(taken, "moved 3."));
    assert_non_null(strstr(taken, "not 8 at 1/8"));
    assert_non_null(strstr(taken, "six make a capture"));
    dataset_loaded s;
    assert_int_equal(dataset_load(&s, in("real/good"), &job, &error), BRACE_OK);
    assert_int_equal(s.count, 5);
    assert_int_equal(s.truth->width, 300);
    assert_int_equal(s.truth->height, 224);
    assert_int_equal(s.truth->cfa, BRACE_CFA_GBRG);
    for (size_t i = 0; i < 5; i++) {
        assert_near(s.frames[i]->exposure_time * 800, pow(4, (double)i - 2), 1e-3);
    }
    assert_string_equal(json_string_value(json_object_get(s.meta, "kind")), "imported");
    assert_string_equal(json_string_value(json_array_get(json_object_get(s.meta, "sources"), 5)), "IMG_9.dng");
    dataset_loaded_free(&s);
    dataset_verified v = verify("real");
    assert_int_equal(v.samples, 1);
    assert_int_equal(v.bad, 0);
    assert_int_equal(dataset_import(&card, 1, out, NULL, NULL, NULL, &done, &job, &error), BRACE_OK);
    assert_int_equal(done.there, 1);
    assert_int_equal(done.good, 0);
    /* Another card with a folder of the same name is another capture, once; and a folder may be called by no name. */
    make_capture("card2/good", 0.5, 8);
    const char *card2 = in("card2");
    taken[0] = '\0';
    for (int i = 0; i < 2; i++) {
        assert_int_equal(dataset_import(&card2, 1, out, NULL, on_import, NULL, &done, &job, &error), BRACE_OK);
        assert_int_equal(done.good, i == 0);
        assert_int_equal(done.there, i == 1);
    }
    assert_non_null(strstr(taken, "good-2 0."));
    assert_true(there("real/good-2/meta.json"));
    char before[PATH_MAX];
    assert_non_null(getcwd(before, sizeof before));
    make_capture("card3/wall", 0, 8);
    assert_int_equal(chdir(in("card3/wall")), 0);
    const char *here = ".";
    const brace_status status = dataset_import(&here, 1, out, NULL, NULL, NULL, &done, &job, &error);
    assert_int_equal(chdir(before), 0);
    assert_int_equal(status, BRACE_OK);
    assert_int_equal(done.good, 1);
    assert_true(there("real/wall/gt.dng"));
}

static void test_reduce(void **state) {
    (void)state;
    brace_frame *f = NULL, *small = NULL;
    assert_int_equal(brace_frame_create(&f, 640, 480, BRACE_CFA_RGGB, NULL), BRACE_OK);
    f->noise[0][0] = 1;
    /* A plane of each colour: constant, constant, a slow gradient, stripes far too fine for the result. */
    for (uint32_t y = 0; y < 480; y++) {
        for (uint32_t x = 0; x < 640; x++) {
            static const uint16_t flat[2] = {1000, 30000};
            bool blue = (x & 1) && (y & 1), green2 = !(x & 1) && (y & 1);
            f->data[y * 640 + x] = blue     ? (uint16_t)(20000 + 15000 * cos(3.14159265 * 0.45 * x))
                                   : green2 ? (uint16_t)(10000 + 20 * x)
                                            : flat[x & 1];
        }
    }
    assert_int_equal(dataset_reduce(&small, f, 4, &error), BRACE_OK);
    assert_int_equal(small->width, 160);
    assert_int_equal(small->height, 120);
    for (uint32_t y = 20; y < 100; y++) {
        for (uint32_t x = 20; x < 140; x++) {
            double value = small->data[y * 160 + x];
            if (!(y & 1)) {
                assert_near(value, (x & 1 ? 30000 : 1000), 1);
            } else if (!(x & 1)) {
                assert_near(value, 10000 + 20 * (4 * x + 1.5), 25); /* in place, not a phase off */
            } else {
                assert_near(value, 20000, 300); /* 2 % of its contrast is left */
            }
        }
    }
    assert_true(small->noise[0][0] < 1.0 / 8 && small->noise[0][0] > 1.0 / 32);
    brace_frame_destroy(small);
    assert_int_equal(dataset_reduce(&small, f, 9, &error), BRACE_ERROR_ARGUMENT);
    f->width = 60;
    assert_int_equal(dataset_reduce(&small, f, 4, &error), BRACE_ERROR_UNSUPPORTED);
    brace_frame_destroy(f);
}

static void test_displacement(void **state) {
    (void)state;
    brace_frame *a = make_frame(400, 300, 0.01, 100, 0, 0, 0.5);
    static const double shifts[][2] = {{0, 0}, {1, 0}, {0, 2}, {3, -4}, {-0.5, 0}};
    for (size_t i = 0; i < sizeof shifts / sizeof shifts[0]; i++) {
        brace_frame *b = make_frame(400, 300, 0.01, 100, shifts[i][0], shifts[i][1], 0);
        assert_near(dataset_displacement(a, b), hypot(shifts[i][0], shifts[i][1]), 0.35);
        brace_frame_destroy(b);
    }
    for (size_t i = 0; i < 400 * 300; i++) {
        a->data[i] = 500;
    }
    assert_true(isnan(dataset_displacement(a, a)));
    brace_frame_destroy(a);
}

/* ---- building, with a maker that writes what it was asked for ---- */

static int calls, fail_at;

static brace_status make(void *user, const dataset_task *task, const char *where, json_t **meta, const brace_job *inner,
                         brace_error *problem) {
    (void)user;
    assert_int_equal(inner->threads, 1);
    if (++calls == fail_at) {
        return core_fail(problem, BRACE_ERROR_IO, "no space left on the disk");
    }
    char path[300];
    brace_frame *f = NULL;
    assert_int_equal(brace_frame_create(&f, task->width, task->height, BRACE_CFA_RGGB, NULL), BRACE_OK);
    core_random r = core_random_create(task->seed, task->sample, 0, 0);
    for (size_t i = 0; i < (size_t)task->width * task->height; i++) {
        f->data[i] = (uint16_t)core_random_below(&r, 4000);
    }
    sim_scene scene = {0};
    dataset_priors_scene(&scene, task->priors, task->seed, task->sample);
    for (int i = 1; i <= 6; i++) {
        snprintf(path, sizeof path, i < 6 ? "%s/frame_%d.dng" : "%s/gt.dng", where, i);
        f->exposure_time = scene.reference_time * (i < 6 ? pow(4, i - 3) : 1);
        f->iso = 100;
        const brace_dng_params params = {.no_preview = true};
        assert_int_equal(brace_frame_write_dng(f, path, &params, inner, problem), BRACE_OK);
    }
    brace_frame_destroy(f);
    *meta = json_pack("{s:s, s:f, s:f}", "display", task->display, "reference_time", scene.reference_time, "level",
                      scene.level);
    return BRACE_OK;
}

static void put_screen(const char *name, int gray) {
    brace_image *image = NULL;
    assert_int_equal(brace_image_create(&image, 4, 4, 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, &error), BRACE_OK);
    memset(image->data, gray, image->stride * 4);
    assert_int_equal(brace_image_write(image, in(name), NULL, &job, &error), BRACE_OK);
    brace_image_destroy(image);
}

static json_t *meta_of(const char *name) {
    json_t *meta = NULL;
    char path[300];
    snprintf(path, sizeof path, "%s/meta.json", name);
    assert_int_equal(dataset_json_load(&meta, in(path), DATASET_META_LIMIT, &error), BRACE_OK);
    assert_non_null(meta);
    return meta;
}

/* Bytes of all files of all samples. */
static void digest(char hex[65], const char *set) {
    dataset_list list;
    core_sha256 hash;
    core_sha256_begin(&hash);
    assert_int_equal(dataset_list_read(&list, in(set), &error), BRACE_OK);
    static const char *const files[] = {"frame_1.dng", "frame_2.dng", "frame_3.dng", "frame_4.dng",
                                        "frame_5.dng", "gt.dng",      "meta.json"};
    for (size_t i = 0; i < list.count; i++) {
        for (size_t k = 0; k < 7; k++) {
            char *path = dataset_path(list.items[i].folder, files[k]), one[65];
            assert_int_equal(core_sha256_file(one, path, NULL, &error), BRACE_OK);
            core_sha256_add(&hash, one, 64);
            core_free(path);
        }
    }
    dataset_list_free(&list);
    core_sha256_end(&hash, hex);
}

static void test_build(void **state) {
    (void)state;
    assert_int_equal(dataset_make_folder(in("screens"), &error), BRACE_OK);
    for (int i = 0; i < 6; i++) {
        char name[64];
        snprintf(name, sizeof name, "screens/%06d_%s.png", i, i % 2 ? "web2" : "UI");
        put_screen(name, i * 20);
    }
    put_screen("screens/copy.png", 20); /* of 000001 */
    char screens[128];
    snprintf(screens, sizeof screens, "%s/screens", folder);
    dataset_build_params params = {.screens = screens, .seed = UINT64_MAX, .train = 14, .test = 6, .width = 64,
                                   .height = 48, .make = make};
    dataset_built done;
    calls = fail_at = 0;
    assert_int_equal(dataset_build(in("whole"), &params, &done, &job, &error), BRACE_OK);
    assert_int_equal(done.made, 20);
    dataset_verified v = verify("whole");
    assert_int_equal(v.samples, 20);
    assert_int_equal(v.bad + v.missing + v.unhashed, 0);

    /* No screen is in both splits; all are used; a tenth is flicker-free; T_ref stays in its range. */
    dataset_list list;
    char used[2][16][65];
    size_t n[2] = {0, 0}, steady = 0;
    assert_int_equal(dataset_list_read(&list, in("whole"), &error), BRACE_OK);
    for (size_t i = 0; i < list.count; i++) {
        char name[300];
        snprintf(name, sizeof name, "whole/%s", list.items[i].name);
        json_t *meta = meta_of(name);
        const char *hash = json_string_value(json_object_get(json_object_get(meta, "screen"), "sha256"));
        int split = strncmp(list.items[i].name, "test/", 5) == 0;
        size_t k = 0;
        while (k < n[split] && strcmp(used[split][k], hash) != 0) {
            k++;
        }
        if (k == n[split]) {
            strcpy(used[split][n[split]++], hash);
        }
        steady += json_is_true(json_object_get(meta, "flicker_free"));
        double time = json_number_value(json_object_get(meta, "reference_time"));
        assert_true(time >= 1.0 / 4000 && time <= 1.0 / 29.9);
        assert_non_null(strstr(list.items[i].name, strstr(name, "UI") != NULL ? "_UI" : "_web2"));
        json_decref(meta);
    }
    dataset_list_free(&list);
    assert_int_equal(n[0] + n[1], 6);
    assert_int_equal(n[1], 2);
    assert_in_range(steady, 1, 3);
    for (size_t i = 0; i < n[0]; i++) {
        for (size_t k = 0; k < n[1]; k++) {
            assert_string_not_equal(used[0][i], used[1][k]);
        }
    }

    /* In three shards and with two threads, into one folder: the same bytes. */
    char whole[65], parts[65];
    digest(whole, "whole");
    params.shards = 3;
    for (params.shard = 0; params.shard < 3; params.shard++) {
        assert_int_equal(dataset_build(in("parts"), &params, &done, &job, &error), BRACE_OK);
        assert_in_range(done.made, 6, 7);
    }
    digest(parts, "parts");
    assert_string_equal(whole, parts);
    params.shard = params.shards = 0;

    /* One split after the other: the same bytes, too. */
    params.only = DATASET_TEST;
    assert_int_equal(dataset_build(in("splits"), &params, &done, &job, &error), BRACE_OK);
    assert_true(done.made == params.test && !there("splits/train"));
    params.only = DATASET_TRAIN;
    assert_int_equal(dataset_build(in("splits"), &params, &done, &job, &error), BRACE_OK);
    assert_true(done.made == params.train && done.there == 0);
    digest(parts, "splits");
    assert_string_equal(whole, parts);
    params.only = DATASET_BOTH;

    /* A full disk at the fifth sample: four are there, the fifth not at all; then the rest. */
    calls = 0;
    fail_at = 5;
    assert_int_equal(dataset_build(in("twice"), &params, &done, &job, &error), BRACE_ERROR_IO);
    assert_non_null(strstr(error.message, "train/000004_"));
    assert_int_equal(done.made, 4);
    v = verify("twice");
    assert_int_equal(v.samples, 4);
    assert_int_equal(v.bad, 0);
    assert_int_equal(v.missing, 16);
    fail_at = 0;
    assert_int_equal(dataset_build(in("twice"), &params, &done, &job, &error), BRACE_OK);
    assert_int_equal(done.there, 4);
    assert_int_equal(done.made, 16);
    digest(parts, "twice");
    assert_string_equal(whole, parts);

    /* Another set does not go into the same folder. */
    params.seed = 2;
    assert_int_equal(dataset_build(in("twice"), &params, &done, &job, &error), BRACE_ERROR_MISMATCH);
    assert_non_null(strstr(error.message, "'seed'"));
    params.width = 63;
    assert_int_equal(dataset_build(in("odd"), &params, &done, &job, &error), BRACE_ERROR_ARGUMENT);
    params.width = 64;
    params.shards = 2;
    params.shard = 2;
    assert_int_equal(dataset_build(in("odd"), &params, &done, &job, &error), BRACE_ERROR_ARGUMENT);
    params.shard = params.shards = 0;
    volatile int stop = 1;
    const brace_job stopped = {.threads = 1, .cancel = &stop};
    assert_int_equal(dataset_build(in("stopped"), &params, &done, &stopped, &error), BRACE_ERROR_CANCELLED);
}

#define PLAIN "{\"displays\": {\"crt_60\": 1}, \"flicker_free\": 0, \"scene\": "

/* Every quantity may have a probability, and every shape stays in its range. */
static void test_priors_reach_every_effect(void **state) {
    (void)state;
    FILE *f = fopen(in("p.json"), "w");
    fputs(PLAIN "{\"supersample\": {\"choice\": [1, 4]}", f);
    size_t effects = 0;
    for (size_t i = 0; i < sim_quantity_count; i++) {
        const sim_quantity *q = &sim_quantities[i];
        if (q->effect != NULL) {
            effects++;
            fprintf(f, ", \"%s\": {\"uniform\": [%g, %g], \"probability\": 0.25}", q->name, q->high / 2, q->high);
        }
    }
    fputs(", \"subexposures\": {\"log_uniform\": [1, 8]}, \"ambient_hz\": {\"choice\": [0, 100, 120]}}}", f);
    fclose(f);
    dataset_priors *priors = NULL;
    if (dataset_priors_load(&priors, in("p.json"), &error) != BRACE_OK) {
        fail_msg("%s", error.message);
    }
    assert_true(effects > 15);
    size_t on = 0, hertz[3] = {0}, four = 0, parts = 0;
    for (uint32_t k = 0; k < 1000; k++) {
        sim_scene s;
        sim_scene_default(&s);
        dataset_priors_scene(&s, priors, 8, k);
        if (sim_scene_check(&s, &error) != BRACE_OK) {
            fail_msg("%s", error.message);
        }
        for (size_t i = 0; i < sim_quantity_count; i++) {
            const double v = sim_quantity_get(&s, &sim_quantities[i]);
            if (sim_quantities[i].effect != NULL) {
                on += v != 0;
                assert_true(v == 0 || v >= sim_quantities[i].high / 2);
            }
        }
        hertz[s.ambient_hz == 0 ? 0 : s.ambient_hz == 100 ? 1 : 2]++;
        four += s.supersample == 4;
        parts += (size_t)s.subexposures;
    }
    assert_near((double)on / (double)(1000 * effects), 0.25, 0.02);
    for (int i = 0; i < 3; i++) {
        assert_near((double)hertz[i], 333, 60);
    }
    assert_near((double)four, 500, 60);
    assert_true(parts > 2500 && parts < 5000);
    dataset_priors_destroy(priors);
}

/* Displays off their presets: what varies is within the factors and the driver's range, the rest stays. */
static void test_varied_displays(void **state) {
    (void)state;
    FILE *f = fopen(in("p.json"), "w");
    fputs(PLAIN "{}, \"vary\": {\"refresh\": {\"log_uniform\": [0.5, 2]}, \"duty\": 3, \"decay\": {\"choice\": [2]}, "
          "\"depth\": 0.5}}",
          f);
    fclose(f);
    dataset_priors *priors = NULL;
    assert_int_equal(dataset_priors_load(&priors, in("p.json"), &error), BRACE_OK);
    double low = 1000, high = 0, again = 0;
    for (uint32_t k = 0; k < 200; k++) {
        sim_display *d = NULL;
        assert_int_equal(dataset_priors_display(&d, priors, "crt_60", 8, k, &error), BRACE_OK);
        json_t *json = sim_display_json(d);
        const double refresh = json_number_value(json_object_get(json, "refresh"));
        low = fmin(low, refresh), high = fmax(high, refresh);
        again = k == 7 ? refresh : again;
        assert_near(json_number_value(json_array_get(json_object_get(json, "decay"), 1)), 120e-6, 1e-12);
        assert_near(json_number_value(json_object_get(json, "active")), 0.92, 0);
        json_decref(json);
        sim_display_destroy(d);
    }
    assert_true(low >= 30 && low < 31 && high <= 120 && high > 116);
    sim_display *d = NULL;
    assert_int_equal(dataset_priors_display(&d, priors, "crt_60", 8, 7, &error), BRACE_OK); /* the same for the same */
    json_t *json = sim_display_json(d);
    assert_near(json_number_value(json_object_get(json, "refresh")), again, 0);
    json_decref(json);
    sim_display_destroy(d);
    assert_int_equal(dataset_priors_display(&d, priors, "laptop_lcd_1000", 8, 7, &error), BRACE_OK);
    json = sim_display_json(d);
    assert_near(json_number_value(json_object_get(json, "duty")), 0.995, 0); /* 3 times 0.5 is more than there is */
    assert_near(json_number_value(json_object_get(json, "frequency")), 1000, 0);
    assert_near(json_number_value(json_object_get(json, "depth")), 0.5, 0); /* the file does not name it: 1 */
    json_decref(json);
    sim_display_destroy(d);
    dataset_priors_destroy(priors);
}

static void test_priors(void **state) {
    (void)state;
    static const struct {
        const char *text, *says;
    } bad[] = {
        {"{\"displays\": {\"no_such_panel\": 1}}", "no_such_panel"},
        {"{\"displays\": {\"crt_60\": -1}}", "crt_60"},
        {"{\"displays\": {\"crt_60\": 0}, \"flicker_free\": 0}", "displays"},
        {"{\"displays\": {\"crt_60\": 1}, \"flicker_free\": 2}", "flicker_free"},
        {"{\"displays\": {\"crt_60\": 1}}", "flicker_free_displays"},
        {"{\"displays\": {\"crt_60\": 1}, \"flicker_free\": 0, \"scene\": {\"isoo\": 1}}", "isoo"},
        {"{\"displays\": {\"crt_60\": 1}, \"flicker_free\": 0,\n\"scene\": {\"iso\": {\"uniform\": [5, 2]}}}", ":2"},
        {"{\"displays\": {\"crt_60\": 1}, \"flicker_free\": 0, \"scene\": {\"iso\": {}}}", "iso"},
        {PLAIN "{\"psf\": 11}}", "psf: 11 is out of range"},
        {PLAIN "{\"frames\": 3}}", "frames"},
        {PLAIN "{\"nonuniformity\": 0.1}}", "nonuniformity"},
        {PLAIN "{\"iso\": {\"uniform\": [100, 200], \"probability\": 0.5}}}", "cannot be 0"},
        {PLAIN "{\"supersample\": {\"uniform\": [1, 4]}}}", "1, 2 or 4"},
        {PLAIN "{\"supersample\": {\"choice\": [1, 3]}}}", "3 is none of"},
        {PLAIN "{\"supersample\": 3}}", "3 is none of"},
        {PLAIN "{\"ambient_hz\": {\"choice\": []}}}", "ambient_hz"},
        {PLAIN "{\"psf\": {\"choice\": [1], \"uniform\": [1, 2]}}}", "one of"},
        {PLAIN "{}, \"vary\": {\"dutty\": 2}}", "dutty: no kind of display"},
        {PLAIN "{}, \"vary\": {\"pulses\": 2}}", "pulses: no kind of display"}, /* whole numbers stay */
        {PLAIN "{}, \"vary\": {\"duty\": 0}}", "duty: 0 is out of range"},
        {PLAIN "{}, \"vary\": {\"duty\": {\"uniform\": [1, 2], \"probability\": 0.5}}}", "cannot be 0"},
        {"{\"displays\": ", "json"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        FILE *f = fopen(in("p.json"), "w");
        fputs(bad[i].text, f);
        fclose(f);
        dataset_priors *priors = NULL;
        assert_int_not_equal(dataset_priors_load(&priors, in("p.json"), &error), BRACE_OK);
        assert_null(priors);
        if (strstr(error.message, bad[i].says) == NULL) {
            fail_msg("\"%s\" does not say \"%s\"", error.message, bad[i].says);
        }
    }
    dataset_priors *priors = NULL;
    assert_int_equal(dataset_priors_load(&priors, NULL, &error), BRACE_OK);
    int steady = 0;
    double low = 1, high = 0;
    for (uint32_t i = 0; i < 1000; i++) {
        dataset_draw draw;
        sim_scene scene = {.supersample = 4};
        dataset_priors_draw(&draw, priors, 5, i);
        dataset_priors_scene(&scene, priors, 5, i);
        steady += draw.flicker_free;
        assert_int_equal(draw.flicker_free, strcmp(draw.display, "steady") == 0);
        low = fmin(low, scene.reference_time);
        high = fmax(high, scene.reference_time);
        assert_near(scene.supersample, 4, 0); /* not spoken of */
    }
    assert_int_equal(steady, 100);
    assert_true(low >= 1.0 / 4000 && low < 1.0 / 3800 && high <= 0.0333334 && high > 1.0 / 33);
    dataset_priors_destroy(priors);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_list, setup, teardown),
        cmocka_unit_test_setup_teardown(test_begin_finish, setup, teardown),
        cmocka_unit_test_setup_teardown(test_pack, setup, teardown),
        cmocka_unit_test_setup_teardown(test_verify, setup, teardown),
        cmocka_unit_test_setup_teardown(test_info, setup, teardown),
        cmocka_unit_test_setup_teardown(test_import, setup, teardown),
        cmocka_unit_test_setup_teardown(test_build, setup, teardown),
        cmocka_unit_test_setup_teardown(test_priors, setup, teardown),
        cmocka_unit_test_setup_teardown(test_varied_displays, setup, teardown),
        cmocka_unit_test_setup_teardown(test_priors_reach_every_effect, setup, teardown),
        cmocka_unit_test(test_reduce),
        cmocka_unit_test(test_displacement),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
