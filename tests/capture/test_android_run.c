/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_android_run.c: whole sequences with a phone that goes wrong in every way
 * it knows, over a cable that is pulled: each mishap is counted and named, and what lands
 * in the folder is a bracket that `brace restore` takes.
 *
 *   test_android_run PHONE CABLE BRACE    the three programs
 */
#include "capture_test.h"
#include "child.h"

static const char *phone_program, *cable_program, *brace_program;

static char sentences[16384];

static void on_event(void *user, const capture_event *event) {
    (void)user;
    if (event->message != NULL) {
        const size_t used = strlen(sentences);
        snprintf(sentences + used, sizeof sentences - used, "%s\n", event->message);
    }
}

/* `option` may be NULL. */
static brace_status run(capture_sequence *q, unsigned port, const char *option, const char *name,
                        const capture_run_params *extra, brace_error *error) {
    char text[16], path[128];
    snprintf(text, sizeof text, "%u", port);
    snprintf(path, sizeof path, "%s/%s", test_folder, name);
    const capture_address address = {.port = text, .options = &option, .option_count = option != NULL};
    capture_run_params params = extra != NULL ? *extra : (capture_run_params){0};
    params.plan = (capture_plan_params){.time = 1.0 / 240, .iso = 400};
    params.backoff = 0.01;
    params.event = on_event;
    sentences[0] = '\0';
    *error = (brace_error){.message = ""};
    return capture_run(q, &capture_backend_android, &address, path, &params, NULL, error);
}

static unsigned files_in(const char *name) {
    char path[128];
    unsigned n = 0;
    snprintf(path, sizeof path, "%s/%s", test_folder, name);
    DIR *d = opendir(path);
    for (struct dirent *e; d != NULL && (e = readdir(d)) != NULL;) {
        n += strcmp(e->d_name, ".") != 0 && strcmp(e->d_name, "..") != 0;
    }
    if (d != NULL) {
        closedir(d);
    }
    return n;
}

/* Runs the program; its exit code. */
static int run_brace(const char *const *arguments) {
    const pid_t pid = fork();
    assert_true(pid >= 0);
    if (pid == 0) {
        execv(brace_program, (char *const *)(uintptr_t)arguments);
        _exit(127);
    }
    int code = 0;
    waitpid(pid, &code, 0);
    return WIFEXITED(code) ? WEXITSTATUS(code) : -1;
}

/* `brace restore` makes a picture of the folder. */
static void check_restores(const char *name) {
    char path[128], out[128];
    snprintf(path, sizeof path, "%s/%s", test_folder, name);
    snprintf(out, sizeof out, "%s/restored.png", test_folder);
    const char *arguments[] = {"brace", "restore", path, "-o", out, "--quiet", NULL};
    assert_int_equal(run_brace(arguments), 0);
    assert_int_equal(access(out, R_OK), 0);
    unlink(out);
}

static void check_sequence(const capture_sequence *q, const char *name) {
    char path[128];
    capture_checked checked;
    brace_error error = {.message = ""};
    assert_true(q->complete);
    assert_string_equal(q->backend, "android");
    assert_string_equal(q->model, "Phone 1");
    assert_int_equal(files_in(name), 7); /* five frames, the truth, sequence.json */
    for (size_t i = 0; i < q->shot_count; i++) {
        assert_true(q->shots[i].report.timestamp >= 0);
        assert_int_equal(q->shots[i].report.orientation, 6);
    }
    snprintf(path, sizeof path, "%s/%s", test_folder, name);
    assert_int_equal(capture_check(&checked, path, NULL, &error), BRACE_OK);
    assert_int_equal(checked.problem_count, 0);
    assert_true(checked.restorable && checked.importable);
    capture_checked_free(&checked);
    check_restores(name);
}

static void test_sound(void **state) {
    (void)state;
    capture_sequence q;
    brace_error error;
    const child phone = child_phone(phone_program, NULL);
    if (run(&q, phone.port, NULL, "sound", NULL, &error) != BRACE_OK) {
        fail_msg("%s", error.message);
    }
    assert_int_equal(q.counts.asked, 6);
    assert_string_equal(sentences, "");
    check_sequence(&q, "sound");
    capture_sequence_free(&q);
    assert_int_equal(child_end(phone, true), 0);
}

static void test_faults(void **state) {
    (void)state;
    capture_sequence q;
    brace_error error;
    /* Nine of the phone. Of the cable three: cut in the second frame, then a bit flipped, then silence. */
    const child phone = child_phone(
        phone_program, "busy@1,busy@2,dropped@4,short@5,metadata@10,nonsense@11,gone@12,pixels@15,stall@16");
    const char *const faults[] = {"cut=200000", "flip=100000", "stall=90000", NULL};
    const child cable = child_cable(cable_program, phone, faults);
    if (run(&q, cable.port, "timeout=2", "faults", NULL, &error) != BRACE_OK) {
        fail_msg("%s\n%s", error.message, sentences);
    }
    assert_int_equal(q.counts.asked, 17); /* for six frames that are kept */
    assert_int_equal(q.counts.busy, 2);
    assert_int_equal(q.counts.dropped, 2);
    assert_int_equal(q.counts.reopened, 5);
    assert_int_equal(q.counts.metadata, 1);
    assert_int_equal(q.counts.pixels, 1);
    assert_int_equal(q.counts.unreadable, 0);
    static const char *const named[] = {"frame_4: the phone: the camera dropped the frame",
                                        "frame_4: the phone: the frame is not of the size",
                                        "frame_4: the phone, while DATA was waited for",
                                        "damaged on its way",
                                        "nothing came within the time",
                                        "frame_3 says 1/480 s, 1/240 s was asked for",
                                        "frame_2: the phone: another app took the camera",
                                        "gt is 1.0 EV darker",
                                        "gt: the phone, while FRAME was waited for: nothing"};
    for (size_t i = 0; i < sizeof named / sizeof named[0]; i++) {
        if (strstr(sentences, named[i]) == NULL) {
            fail_msg("nothing says '%s':\n%s", named[i], sentences);
        }
    }
    check_sequence(&q, "faults");
    capture_sequence_free(&q);
    child_end(cable, false);
    assert_int_equal(child_end(phone, true), 0);
}

/* The phone's program dies; the sequence is gone on with when it runs again. */
static void test_resume(void **state) {
    (void)state;
    capture_sequence q;
    brace_error error;
    child phone = child_phone(phone_program, "exit@4");
    assert_int_not_equal(run(&q, phone.port, NULL, "resumed", NULL, &error), BRACE_OK);
    assert_int_equal(child_end(phone, false), 3);
    assert_non_null(strstr(error.message, "could not be opened again: no phone on port"));
    capture_sequence_free(&q);
    assert_int_equal(files_in("resumed"), 0);
    phone = child_phone(phone_program, NULL);
    const capture_run_params params = {.resume = true};
    if (run(&q, phone.port, NULL, "resumed", &params, &error) != BRACE_OK) {
        fail_msg("%s", error.message);
    }
    check_sequence(&q, "resumed");
    capture_sequence_free(&q);
    assert_int_equal(child_end(phone, true), 0);
}

/* The same by the command line. */
static void test_program(void **state) {
    (void)state;
    char camera[64], path[128];
    const child phone = child_phone(phone_program, "busy@2,dropped@3");
    snprintf(camera, sizeof camera, "android:%u/0", phone.port);
    snprintf(path, sizeof path, "%s/program", test_folder);
    const char *list[] = {"brace", "capture", "list", "--camera", camera, "--quiet", NULL};
    const char *shoot[] = {"brace", "capture", "run", "--camera", camera, "--option", "focus=2.5", "--time",
                           "1/240", "--iso",   "400", "-o",       path,   "--quiet",  NULL};
    const char *check[] = {"brace", "capture", "check", path, "--quiet", NULL};
    assert_int_equal(run_brace(list), 0);
    assert_int_equal(run_brace(shoot), 0);
    assert_int_equal(run_brace(check), 0);
    check_restores("program");
    assert_int_equal(child_end(phone, true), 0);
}

static int remove_folder(void **state) {
    (void)state;
    static const char *const folders[] = {"sound", "faults", "resumed", "program"};
    static const char *const files[] = {"frame_1.dng", "frame_2.dng", "frame_3.dng",  "frame_4.dng",
                                        "frame_5.dng", "gt.dng",      "sequence.json"};
    char path[160];
    for (size_t i = 0; i < sizeof folders / sizeof folders[0]; i++) {
        for (size_t k = 0; k < sizeof files / sizeof files[0]; k++) {
            snprintf(path, sizeof path, "%s/%s/%s", test_folder, folders[i], files[k]);
            unlink(path);
        }
        snprintf(path, sizeof path, "%s/%s", test_folder, folders[i]);
        rmdir(path);
    }
    return rmdir(test_folder); /* fails if anything else was left behind */
}

int main(int argc, char **argv) {
    if (argc != 4) {
        fprintf(stderr, "usage: test_android_run PHONE CABLE BRACE\n");
        return 2;
    }
    phone_program = argv[1];
    cable_program = argv[2];
    brace_program = argv[3];
    setenv("PATH", "/nonexistent", 1); /* no adb of this computer is run */
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sound),
        cmocka_unit_test(test_faults),
        cmocka_unit_test(test_resume),
        cmocka_unit_test(test_program),
    };
    return cmocka_run_group_tests(tests, test_folder_make, remove_folder);
}
