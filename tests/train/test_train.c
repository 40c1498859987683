/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_train.c: whole runs of a network of two convolutions: that they learn, and
 * that stops, kills, threads and processes don't change what.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "brace/image.h"
#include "core/safetensors.h"
#include "train/train.h"

static void ok(brace_status status, const brace_error *error) {
    if (status != BRACE_OK) {
        fail_msg("%s", error->message);
    }
}

/* The reference and a correction out of all frames and of how much they band. */
static nn_value small_network(const void *user, nn_graph *g, const models_inputs *in) {
    (void)user;
    nn_value parts[6];
    const nn_shape s = nn_shape_of(g, in->frames);
    for (int i = 0; i < s.n; i++) {
        parts[i] = nn_slice(g, in->frames, NN_AXIS_N, i, i + 1, 1);
    }
    const nn_value all = nn_concat(g, NN_AXIS_C, s.n, parts);
    nn_value x =
        nn_conv2d(g, all, &(nn_conv){.name = "first", .out = 16, .kernel = 3, .pad = 1, .activation = NN_RELU});
    const nn_value rho = nn_mean(g, in->rho, true, false, false, false);
    x = nn_mul(g, x, nn_affine(g, rho, 1, 1));
    x = nn_conv2d(g, x, &(nn_conv){.name = "last", .out = 4, .kernel = 3, .pad = 1, .init = NN_INIT_HE_FAN_IN_TENTH});
    const nn_value reference = nn_slice(g, parts[0], NN_AXIS_C, 0, 8, 2);
    return nn_add(g, x, reference);
}
static const train_model model = {NULL, small_network};

static const char text[] = "{\"model\":\"small\",\"seed\":5,\"batch\":3,\"epochs\":2,\"epoch_samples\":9,"
                           "\"data\":{\"width\":96,\"height\":96,\"crop\":32,\"crops\":2,\"test_share\":0.3%s},"
                           "\"loss\":{\"color\":0.01,\"color_scales\":2,\"color_projections\":4},"
                           "\"optimizer\":{\"rate\":0.002,\"average\":0.5},\"validation\":{\"samples\":2},"
                           "\"checkpoint_steps\":%s}";

static train_config config_of(const char *data, const char *checkpoint_steps) {
    char json[1024];
    brace_error error = {0};
    train_config c;
    snprintf(json, sizeof json, text, data, checkpoint_steps);
    ok(train_config_parse(&c, json, "test.json", &error), &error);
    return c;
}

static char folder[] = "/tmp/brace-train-XXXXXX";

static int make_folder(void **state) {
    (void)state;
    return mkdtemp(folder) != NULL ? 0 : -1;
}

static int remove_folder(void **state) {
    (void)state;
    char command[64];
    snprintf(command, sizeof command, "rm -rf '%s'", folder);
    return system(command);
}

static const char *in(char out[256], const char *run, const char *file) {
    snprintf(out, 256, "%s/%s%s%s", folder, run, file[0] != '\0' ? "/" : "", file);
    return out;
}

/* Both files have the same arrays and the same bytes in them, within `tolerance` of the largest. */
static void same(const char *a, const char *b, const char *file, double tolerance) {
    brace_error error = {0};
    core_safetensors *f[2];
    char path[2][256];
    ok(core_safetensors_open(&f[0], in(path[0], a, file), &error), &error);
    ok(core_safetensors_open(&f[1], in(path[1], b, file), &error), &error);
    assert_int_equal(core_safetensors_count(f[0]), core_safetensors_count(f[1]));
    assert_true(core_safetensors_count(f[0]) >= 4);
    for (size_t i = 0; i < core_safetensors_count(f[0]); i++) {
        const core_tensor *x = core_safetensors_at(f[0], i), *y = core_safetensors_find(f[1], x->name);
        assert_non_null(y);
        assert_int_equal(x->size, y->size);
        if (tolerance == 0) {
            if (memcmp(x->data, y->data, x->size) != 0) {
                fail_msg("%s and %s differ in %s", path[0], path[1], x->name);
            }
            continue;
        }
        double largest = 0, off = 0;
        for (size_t k = 0; k < x->size / 4; k++) {
            float u, v;
            memcpy(&u, (const char *)x->data + 4 * k, 4);
            memcpy(&v, (const char *)y->data + 4 * k, 4);
            largest = fmax(largest, fabs((double)u));
            if (!isfinite(u) || !isfinite(v)) {
                fail_msg("%s is not finite", x->name);
            }
            off = fmax(off, fabs((double)u - (double)v));
        }
        if (!(off <= tolerance * largest)) {
            fail_msg("%s: %g off of %g", x->name, off, largest);
        }
    }
    core_safetensors_close(f[0]);
    core_safetensors_close(f[1]);
}

typedef struct stopper {
    uint64_t at; /* samples: not before training has come so far */
    bool hard;
    volatile int cancel;
    const char *note; /* with which it stops */
} stopper;

static void on_note(void *user, const char *message) {
    stopper *s = user;
    s->cancel = s->cancel || (s->note != NULL && strncmp(message, s->note, strlen(s->note)) == 0);
}

static void on_progress(void *user, const char *stage, uint64_t done, uint64_t total) {
    stopper *s = user;
    (void)total;
    if (strcmp(stage, "training") == 0 && done >= s->at) {
        if (s->hard) {
            kill(getpid(), SIGKILL);
        }
        s->cancel = 1;
    }
}

static brace_status run(const train_config *c, const char *name, bool resume, stopper *stop, train_result *result,
                        brace_error *error) {
    char path[256];
    const brace_job job = {.threads = 2,
                           .progress = stop != NULL ? on_progress : NULL,
                           .note = stop != NULL ? on_note : NULL,
                           .user = stop,
                           .cancel = stop != NULL ? &stop->cancel : NULL};
    const train_run_params params = {.model = &model, .output = in(path, name, ""), .resume = resume};
    return train_run(c, &params, result, &job, error);
}

static size_t lines(const char *name, const char *with) {
    char path[256], line[2048];
    FILE *f = fopen(in(path, name, "log.jsonl"), "r");
    assert_non_null(f);
    size_t n = 0;
    while (fgets(line, sizeof line, f) != NULL) {
        json_t *json = json_loads(line, 0, NULL);
        assert_non_null(json);
        json_decref(json);
        n += strstr(line, with) != NULL;
    }
    fclose(f);
    return n;
}

/* Killed first, while this program has no thread yet. */
static void test_killed(void **state) {
    (void)state;
    brace_error error = {0};
    train_config c = config_of("", "2");
    static const uint64_t at[] = {3, 9, 12}; /* before the first checkpoint, at an epoch's end, after the second */
    for (size_t i = 0; i < 3; i++) {
        char name[16];
        snprintf(name, sizeof name, "killed%zu", i);
        const pid_t child = fork();
        if (child == 0) {
            stopper stop = {.at = at[i], .hard = true};
            run(&c, name, false, &stop, NULL, NULL);
            _exit(3);
        }
        int status = 0;
        assert_true(child > 0 && waitpid(child, &status, 0) == child);
        assert_true(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
    }
    train_result result;
    ok(run(&c, "whole", false, NULL, &result, &error), &error);
    assert_int_equal(result.steps, 6);
    assert_int_equal(result.samples, 18);
    for (size_t i = 0; i < 3; i++) {
        char name[16];
        snprintf(name, sizeof name, "killed%zu", i);
        char torn[256];
        FILE *f = fopen(in(torn, name, ".brace-0123456789abcdef.tmp"), "w"); /* of a checkpoint that it was writing */
        assert_non_null(f);
        fclose(f);
        ok(run(&c, name, true, NULL, &result, &error), &error);
        assert_int_equal(access(torn, F_OK), -1);
        same("whole", name, "checkpoint.safetensors", 0);
        same("whole", name, "weights.safetensors", 0);
        assert_int_equal(lines(name, "\"kind\":\"epoch\""), 2);
        assert_int_equal(lines(name, "\"rate\""), 6);
    }
    /* Nothing is left to do, and nothing is changed. */
    ok(run(&c, "whole", true, NULL, &result, &error), &error);
    assert_int_equal(result.samples, 0);
    assert_true(isfinite(result.psnr));
    same("whole", "killed0", "checkpoint.safetensors", 0);
    train_config_free(&c);
}

static void test_files(void **state) {
    (void)state;
    brace_error error = {0};
    char path[256];
    static const char *const pictures[] = {"plot.png", "sheets/epoch_0001.png", "sheets/epoch_0002.png"};
    for (size_t i = 0; i < 3; i++) {
        brace_image *image;
        ok(brace_image_read(&image, in(path, "whole", pictures[i]), NULL, &error), &error);
        assert_true(i == 0 || (image->width == 6 + 3 * 70 && image->height == 6 + 2 * 70));
        brace_image_destroy(image);
    }
    /* The weights are the network's alone, and say where they come from. */
    core_safetensors *file;
    ok(core_safetensors_open(&file, in(path, "whole", "weights.safetensors"), &error), &error);
    assert_int_equal(core_safetensors_count(file), 4);
    assert_non_null(core_safetensors_find(file, "first.weight"));
    assert_string_equal(core_safetensors_metadata(file, "model"), "small");
    assert_string_equal(core_safetensors_metadata(file, "steps"), "6");
    assert_non_null(strstr(core_safetensors_metadata(file, "training"), "\"seed\":5"));
    core_safetensors_close(file);
    train_config c;
    ok(train_config_load(&c, in(path, "whole", "config.json"), &error), &error);
    assert_int_equal(c.batch, 3);
    train_config_free(&c);
}

/* Ctrl-C saves; and neither threads that prepare samples nor how often is saved change anything. */
static void test_cancelled(void **state) {
    (void)state;
    brace_error error = {0};
    train_config c = config_of(",\"threads\":2", "100");
    stopper stop = {.at = 6};
    train_result result;
    assert_int_equal(run(&c, "stopped", false, &stop, &result, &error), BRACE_ERROR_CANCELLED);
    assert_int_equal(result.steps, 2);
    assert_int_equal(run(&c, "stopped", false, NULL, NULL, &error), BRACE_ERROR_ARGUMENT); /* not over it */
    assert_non_null(strstr(error.message, "--resume"));
    train_config other = config_of(",\"augment\":false", "100");
    assert_int_equal(run(&other, "stopped", true, NULL, NULL, &error), BRACE_ERROR_MISMATCH);
    assert_non_null(strstr(error.message, "'data' differs"));
    train_config_free(&other);
    ok(run(&c, "stopped", true, NULL, &result, &error), &error);
    assert_int_equal(result.samples, 12);
    same("whole", "stopped", "checkpoint.safetensors", 0);
    /* Within the last epoch's end: going on ends it, and with that it has ended. */
    stop = (stopper){.at = UINT64_MAX, .note = "epoch 2 "};
    assert_int_equal(run(&c, "late", false, &stop, &result, &error), BRACE_ERROR_CANCELLED);
    assert_int_equal(result.steps, 6);
    for (int i = 0; i < 2; i++) {
        ok(run(&c, "late", true, NULL, &result, &error), &error);
        assert_int_equal(result.samples, 0);
        assert_true(isfinite(result.psnr));
        same("whole", "late", "checkpoint.safetensors", 0);
        same("whole", "late", "weights.safetensors", 0);
        assert_int_equal(lines("late", "\"kind\":\"epoch\""), 2);
        assert_int_equal(lines("late", "\"validation_loss\""), 2);
    }
    train_config_free(&c);
}

/* ---- two processes, as threads that meet ---- */

typedef struct meeting {
    pthread_barrier_t barrier;
    void *bytes[2];
} meeting;

static meeting met;

static brace_status meet_sum(nn_group *group, float *values, size_t count, brace_error *error) {
    (void)error;
    float *sum = malloc(count * sizeof *sum + 1);
    met.bytes[group->rank] = values;
    pthread_barrier_wait(&met.barrier);
    for (size_t i = 0; i < count; i++) {
        sum[i] = ((float *)met.bytes[0])[i] + ((float *)met.bytes[1])[i];
    }
    pthread_barrier_wait(&met.barrier);
    memcpy(values, sum, count * sizeof *sum);
    free(sum);
    return BRACE_OK;
}

static brace_status meet_share(nn_group *group, void *bytes, size_t size, brace_error *error) {
    (void)error;
    met.bytes[group->rank] = bytes;
    pthread_barrier_wait(&met.barrier);
    if (group->rank == 1) {
        memcpy(bytes, met.bytes[0], size);
    }
    pthread_barrier_wait(&met.barrier);
    return BRACE_OK;
}

static brace_status meet_wait(nn_group *group, brace_error *error) {
    (void)group, (void)error;
    pthread_barrier_wait(&met.barrier);
    return BRACE_OK;
}

static const nn_group_kind meeting_kind = {.sum = meet_sum, .share = meet_share, .wait = meet_wait};

typedef struct process {
    nn_group group;
    const train_config *config;
    const char *output;
    brace_status status;
    brace_error error;
} process;

static void *process_main(void *arg) {
    process *p = arg;
    const train_run_params params = {.model = &model, .output = p->output, .group = &p->group};
    p->status = train_run(p->config, &params, NULL, &(brace_job){.threads = 1}, &p->error);
    return NULL;
}

static void test_processes(void **state) {
    (void)state;
    char path[256];
    train_config c = config_of("", "100");
    assert_int_equal(pthread_barrier_init(&met.barrier, NULL, 2), 0);
    process p[2];
    pthread_t thread[2];
    for (int i = 0; i < 2; i++) {
        float *room = core_alloc(NN_GROUP_CHUNK, sizeof *room);
        assert_non_null(room);
        p[i] = (process){.group = {.kind = &meeting_kind, .rank = i, .size = 2, .room = room},
                         .config = &c,
                         .output = in(path, "two", "")};
        assert_int_equal(pthread_create(&thread[i], NULL, process_main, &p[i]), 0);
    }
    for (int i = 0; i < 2; i++) {
        pthread_join(thread[i], NULL);
        core_free(p[i].group.room);
    }
    ok(p[0].status, &p[0].error);
    ok(p[1].status, &p[1].error);
    pthread_barrier_destroy(&met.barrier);
    same("whole", "two", "weights.safetensors", 1e-3);
    assert_int_equal(lines("two", "\"rate\""), 6);
    train_config_free(&c);
}

/* The loss falls, from weights of another run, in bf16. */
static void test_learns(void **state) {
    (void)state;
    brace_error error = {0};
    char path[256], json[1024];
    snprintf(
        json, sizeof json,
        "{\"model\":\"small\",\"initial\":\"%s\",\"precision\":\"bf16\",\"batch\":4,\"epochs\":6,\"epoch_samples\":16,"
        "\"data\":{\"width\":96,\"height\":96,\"crop\":32,\"crops\":8},\"optimizer\":{\"rate\":0.003,"
        "\"warmup_epochs\":1},\"validation\":{\"samples\":0}}",
        in(path, "whole", "weights.safetensors"));
    train_config c;
    ok(train_config_parse(&c, json, "test.json", &error), &error);
    ok(run(&c, "learns", false, NULL, NULL, &error), &error);
    train_log log;
    ok(train_log_open(&log, in(path, "learns", "log.jsonl"), 1000, false, &error), &error);
    assert_int_equal(log.epochs, 6);
    if (!(log.epoch[5].loss < 0.85 * log.epoch[0].loss)) {
        fail_msg("loss %g, then %g", log.epoch[0].loss, log.epoch[5].loss);
    }
    train_log_close(&log);
    train_config_free(&c);
    /* A file of other arrays is no beginning; MS-SWD's own are in none, and are not missed. */
    c = config_of("", "9");
    char other[256];
    c.initial = in(other, "whole", "checkpoint.safetensors");
    assert_int_equal(run(&c, "wrong", false, NULL, NULL, &error), BRACE_ERROR_MISMATCH);
    assert_non_null(strstr(error.message, "first.weight"));
    c.initial = in(other, "whole", "weights.safetensors");
    stopper stop = {.at = 0};
    assert_int_equal(run(&c, "right", false, &stop, NULL, &error), BRACE_ERROR_CANCELLED);
    train_config_free(&c);
}

static void test_config(void **state) {
    (void)state;
    static const struct {
        const char *json, *says;
    } bad[] = {
        {"{}", "model"},
        {"{\"model\":\"a\",\"bach\":3}", "bach"},
        {"{\"model\":\"a\",\n\"batch\":0}", "test.json:2"},
        {"{\"model\":\"a\",\"data\":{\"crop\":100}}", "no multiple of 16"},
        {"{\"model\":\"a\",\"data\":{\"packed\":\"x\",\"width\":640}}", "\"packed\" is given"},
        {"{\"model\":\"a\",\"epochs\":2,\"optimizer\":{\"warmup_epochs\":2}}", "only 2 epochs"},
        {"{\"model\":\"a\",\"precision\":\"f16\"}", "bf16"},
        {"{\"model\":\"a\",\"loss\":{\"wavelet_weights\":[1,2]}}", "wavelet_weights"},
        {"{\"model\":\"a\",\"data\":{\"packed\":[\"x\",\"y\"],\"width\":640}}", "\"packed\" is given"},
        {"{\"model\":\"a\",\"data\":{\"packed\":[]}}", "1 to 8 folders"},
        {"{\"model\":\"a\",\"data\":{\"packed\":[\"x\",2]}}", "folder 2"},
        {"{\"model\":\"a\",\"data\":{\"packed\":2}}", "packed"},
        {"{\"model\":\"tmrnet-s\",\"loss\":{\"alone\":0.5}}", "one answer"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        brace_error error = {0};
        train_config c;
        const brace_status status = train_config_parse(&c, bad[i].json, "test.json", &error);
        if (status == BRACE_OK || strstr(error.message, bad[i].says) == NULL) {
            fail_msg("%s: '%s'", bad[i].json, error.message);
        }
        train_config_free(&c);
    }
    brace_error error = {0};
    train_config c;
    ok(train_config_parse(&c, "{\"model\":\"a\"}", "test.json", &error), &error); /* stage one of the paper */
    assert_int_equal(c.batch, 16);
    assert_true(c.loss.alone == 0);
    assert_int_equal(c.steps, 50 * 63);
    assert_int_equal(c.data.side, 128);
    assert_true(c.schedule.rate == 1e-4 && c.loss.wavelet == 0.5 && c.loss.color == 0);
    train_config_free(&c);
    ok(train_config_parse(&c, "{\"model\":\"brace-s\",\"data\":{\"packed\":[\"x\",\"y\"]}}", "test.json", &error), &error);
    assert_true(c.loss.alone == 0.5); /* two answers are both told the truth */
    assert_string_equal(c.data.packed[0], "x");
    assert_string_equal(c.data.packed[1], "y");
    assert_null(c.data.packed[2]);
    train_config_free(&c);
    static const char *const shipped[] = {"brace-stage1",     "brace-stage2",     "brace-s-stage1",  "brace-s-stage2",
                                          "tmrnet-stage1",    "tmrnet-stage2",    "tmrnet-s-stage1", "tmrnet-s-stage2"};
    for (size_t i = 0; i < sizeof shipped / sizeof *shipped; i++) {
        char path[4096];
        snprintf(path, sizeof path, "%s/configs/%s.json", getenv("BRACE_DATA"), shipped[i]);
        ok(train_config_load(&c, path, &error), &error);
        /* What the paper says; the small ones learn at other rates, and mind colours less. */
        const bool second = strstr(shipped[i], "stage2") != NULL, small = strstr(shipped[i], "-s-") != NULL;
        assert_true(c.known && c.shape.mscam == (shipped[i][0] == 'b'));
        assert_int_equal(c.batch, small ? 8 : 16);
        assert_int_equal(c.epochs, second ? (small ? 24 : 20) : small ? 44 : 50);
        assert_true((small || c.schedule.rate == (second ? 1e-5 : 1e-4)) && c.loss.wavelet == 0.5);
        assert_true(c.loss.color == (!second ? 0 : small ? 0.01 : 0.05) && (c.initial != NULL) == second);
        assert_true((c.loss.relative > 0) == small);
        train_config_free(&c);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_killed),    cmocka_unit_test(test_files),  cmocka_unit_test(test_cancelled),
        cmocka_unit_test(test_processes), cmocka_unit_test(test_learns), cmocka_unit_test(test_config),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
