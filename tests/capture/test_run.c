/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_run.c: whole sequences: same bytes for the same seed, every fault survived
 * or named, nothing half-written, interruptions gone on with, and what comes after.
 */
#include <signal.h>
#include <sys/wait.h>

#include "brace/restore.h"
#include "capture_test.h"
#include "core/sha256.h"
#include "sim/dataset.h"

static capture_sequence *sequence;

static int setup(void **state) {
    sequence = calloc(1, sizeof *sequence);
    return sequence == NULL || test_folder_make(state) != 0;
}

static int teardown(void **state) {
    capture_sequence_free(sequence);
    free(sequence);
    return test_folder_remove(state);
}

/* Forgets the sequence before. */
static capture_sequence *fresh(void) {
    capture_sequence_free(sequence);
    return sequence;
}

static void same_file(const char *a, const char *b) {
    char hash[2][65];
    brace_error error;
    uint64_t bytes;
    test_good(core_sha256_file(hash[0], test_path(a), &bytes, &error), &error);
    test_good(core_sha256_file(hash[1], test_path(b), &bytes, &error), &error);
    if (strcmp(hash[0], hash[1]) != 0)
        fail_msg("%s is not %s", a, b);
}

static void the_same_bytes(void **state) {
    (void)state;
    brace_error error;
    char a[64], b[64];
    test_good(test_shoot(fresh(), "a", NULL, "busy:3,same:4", NULL, (capture_run_params){0}, &error), &error);
    test_good(test_shoot(fresh(), "b/", NULL, "busy:3,same:4", NULL, (capture_run_params){0}, &error), &error);
    assert_int_equal(test_count("a"), 7);
    assert_int_equal(test_count("."), 2);
    static const char *const names[] = {"frame_1.dng", "frame_2.dng", "frame_3.dng",  "frame_4.dng",
                                        "frame_5.dng", "gt.dng",      "sequence.json"};
    for (size_t i = 0; i < 7; i++) {
        snprintf(a, sizeof a, "a/%s", names[i]);
        snprintf(b, sizeof b, "b/%s", names[i]);
        same_file(a, b);
    }
    test_good(test_shoot(fresh(), "c", NULL, NULL, "seed=2", (capture_run_params){0}, &error), &error);
    char hash[2][65];
    uint64_t bytes;
    test_good(core_sha256_file(hash[0], test_path("a/frame_3.dng"), &bytes, &error), &error);
    test_good(core_sha256_file(hash[1], test_path("c/frame_3.dng"), &bytes, &error), &error);
    assert_string_not_equal(hash[0], hash[1]);
}

/* What a fault comes to. */
typedef enum outcome { SURVIVED, NAMED, STOPPED } outcome;

typedef struct fault_case {
    const char *fault;
    int injected;
    outcome want;
    const char *says;      /* in an event, or in the error */
    capture_counts counts; /* but `asked` */
} fault_case;

static const fault_case fault_cases[] = {
    {"busy:1", 1, SURVIVED, NULL, {.busy = 1}},
    {"busy:2-5", 4, SURVIVED, NULL, {.busy = 4}},
    {"busy:3+", 13, STOPPED, "it stayed so", {.busy = 13}},
    {"drop:1", 1, SURVIVED, "frame_5: the simulated camera dropped", {.dropped = 1}},
    {"drop:6", 1, SURVIVED, "gt: the simulated camera dropped", {.dropped = 1}},
    {"drop:3+", 4, STOPPED, "4 times in all", {.dropped = 4}},
    {"disconnect:1", 1, SURVIVED, "disconnected", {.reopened = 1}},
    {"disconnect:4,disconnect:6", 2, SURVIVED, "disconnected", {.reopened = 2}},
    {"disconnect:4+", 5, STOPPED, "lost again", {.reopened = 4}},
    {"full:2", 1, STOPPED, "no space left", {0}},
    {"cut:1", 1, SURVIVED, "frame_5", {.unreadable = 1}},
    {"cut:4", 1, SURVIVED, "frame_2", {.unreadable = 1}},
    {"cut:4+", 4, STOPPED, "frame_2", {.unreadable = 4}},
    {"exif:1", 1, SURVIVED, "frame_5 says 1/80 s, 1/20 s was asked for", {.metadata = 1}},
    {"exif:6", 1, SURVIVED, "gt says 1/160 s, 1/40 s was asked for", {.metadata = 1}},
    {"exif:3+", 4, STOPPED, "frame_3 says 1/1280 s", {.metadata = 4}},
    {"iso:2", 1, SURVIVED, "frame_4 says ISO 1600, ISO 400", {.metadata = 1}},
    {"iso:6", 1, SURVIVED, "gt says ISO 200, ISO 50", {.metadata = 1}},
    {"locked:2", 1, SURVIVED, "frame_4 says 1/20 s, 1/80 s", {.metadata = 1}},
    {"locked:2+", 4, STOPPED, "frame_4 says 1/20 s, 1/80 s", {.metadata = 4}},
    {"shutter:1", 1, SURVIVED, "frame_5 is", {.pixels = 2}}, /* the second frame is doubted first */
    {"shutter:2", 1, SURVIVED, "frame_4 is", {.pixels = 1}},
    {"shutter:3", 1, SURVIVED, "frame_3 is", {.pixels = 1}},
    {"shutter:4", 1, SURVIVED, "frame_2 is", {.pixels = 1}},
    {"shutter:5", 1, SURVIVED, "frame_1 is", {.pixels = 1}},
    {"shutter:6", 1, SURVIVED, "gt is", {.pixels = 1}},
    {"shutter:6+", 4, STOPPED, "gt is", {.pixels = 4}},
    {"same:2", 1, SURVIVED, "frame_4 is the same picture as frame_5", {.pixels = 1}},
    {"same:4", 1, SURVIVED, "frame_2 is the same picture as frame_3", {.pixels = 1}},
    {"same:6", 1, SURVIVED, "gt is", {.pixels = 1}},
    {"same:2+", 10, STOPPED, "same picture", {.pixels = 8}},
    {"black:1", 1, SURVIVED, "frame_5 shows hardly any light", {.pixels = 2}},
    {"black:3", 1, SURVIVED, "frame_3 shows hardly any light", {.pixels = 1}},
    {"black:6", 1, SURVIVED, "gt shows hardly any light", {.pixels = 1}},
    {"black:1+", 6, NAMED, "is the lens cap on?", {0}},
    {"bump:6", 1, NAMED, NULL, {0}}, /* in the motion of the truth */
    {"busy:1,drop:2,disconnect:4,cut:5,exif:7,iso:9,same:11,shutter:13",
     8,
     SURVIVED,
     NULL,
     {.busy = 1, .dropped = 1, .reopened = 1, .unreadable = 1, .metadata = 2, .pixels = 2}},
};

static bool said(const capture_sequence *q, const brace_error *error, const char *text) {
    for (size_t i = 0; i < q->event_count; i++)
        if (strstr(q->events[i], text) != NULL)
            return true;
    return strstr(error->message, text) != NULL;
}

static void every_fault(void **state) {
    (void)state;
    int injected = 0, survived = 0, named = 0, stopped = 0;
    print_message("%-64s %8s %s\n", "fault", "injected", "outcome");
    for (size_t i = 0; i < sizeof fault_cases / sizeof *fault_cases; i++) {
        const fault_case *c = &fault_cases[i];
        brace_error error = {BRACE_OK, ""};
        capture_sequence *q = fresh();
        const brace_status status = test_shoot(q, "f", NULL, c->fault, NULL, (capture_run_params){0}, &error);
        print_message("%-64s %8d %s\n", c->fault, c->injected,
                      status == BRACE_OK ? (c->want == NAMED ? "named" : "survived")
                                         : "named, stopped; can be resumed");
        if ((status == BRACE_OK) != (c->want != STOPPED))
            fail_msg("%s: %s", c->fault, status == BRACE_OK ? "was not stopped" : error.message);
        if (c->says != NULL && !said(q, &error, c->says)) {
            for (size_t k = 0; k < q->event_count; k++)
                print_message("  %s\n", q->events[k]);
            fail_msg("%s: nobody says '%s' (%s)", c->fault, c->says, error.message);
        }
        capture_counts counts = q->counts;
        assert_true(counts.asked >= 6 || c->want == STOPPED);
        counts.asked = 0;
        if (c->want != STOPPED && memcmp(&counts, &c->counts, sizeof counts) != 0)
            fail_msg("%s: %d busy, %d dropped, %d reopened, %d unreadable, %d metadata, %d pixels", c->fault,
                     (int)counts.busy, (int)counts.dropped, (int)counts.reopened, (int)counts.unreadable,
                     (int)counts.metadata, (int)counts.pixels);
        if (status == BRACE_OK) {
            capture_checked checked;
            assert_int_equal(test_count("."), 1);
            assert_int_equal(test_count("f"), 7);
            test_good(capture_check(&checked, test_path("f"), NULL, &error), &error);
            if (c->want == SURVIVED && (checked.problem_count > 0 || !checked.restorable || !checked.importable))
                fail_msg("%s: %s", c->fault, checked.problem_count > 0 ? checked.problems[0] : checked.not_importable);
            capture_checked_free(&checked);
        } else {
            /* Only complete files, all of them in the description; without the fault it is finished. */
            int done = 0;
            for (size_t k = 0; k < q->shot_count; k++)
                done += q->shots[k].done;
            assert_false(test_exists("f"));
            assert_true(done > 0 || !test_exists(".capture-f"));
            if (done > 0) {
                assert_int_equal(test_count(".capture-f"), done + 1);
                test_good(test_shoot(fresh(), "f", NULL, NULL, NULL, (capture_run_params){.resume = true}, &error),
                          &error);
                assert_int_equal(test_count("f"), 7);
            }
        }
        injected += c->injected;
        survived += c->want == SURVIVED ? c->injected : 0;
        named += c->want == NAMED ? c->injected : 0;
        stopped += c->want == STOPPED ? c->injected : 0;
        if (strcmp(c->fault, "bump:6") == 0)
            assert_true(q->has_motion && hypot(q->motion.dx, q->motion.dy) > 1.5);
        test_remove(test_path("f"));
        test_remove(test_path(".capture-f"));
    }
    print_message(
        "%d faults injected: %d shot again with success, %d told, %d stopped the sequence and were named\n",
        injected, survived, named, stopped);
}

static void kept_on_demand(void **state) {
    (void)state;
    brace_error error;
    capture_sequence *q = fresh();
    test_good(test_shoot(q, "a", NULL, "shutter:4+", NULL, (capture_run_params){.accept = true, .tries = 2}, &error),
              &error);
    size_t kept = 0;
    for (size_t i = 0; i < q->shot_count; i++)
        kept += q->shots[i].accepted;
    assert_in_range(kept, 1, 3);
    capture_checked checked;
    test_good(capture_check(&checked, test_path("a"), NULL, &error), &error);
    assert_true(checked.has_sequence && checked.problem_count > 0 && !checked.restorable);
    capture_checked_free(&checked);
}

/* ISO/8 is not there: the truth is averaged, and all that follows takes it. */
static void an_averaged_truth(void **state) {
    (void)state;
    brace_error error;
    const capture_run_params params = {.plan = {.iso = 400}};
    test_good(test_shoot(fresh(), "a", "canon_r5", NULL, NULL, params, &error), &error);
    assert_int_equal(test_count("a"), 8); /* the parts have a folder */
    assert_int_equal(test_count("a/parts"), 2);
    assert_int_equal(sequence->shot_count, 7);
    brace_frame *truth, *part;
    test_good(brace_frame_read(&truth, test_path("a/gt.dng"), NULL, &error), &error);
    test_good(brace_frame_read(&part, test_path("a/parts/gt_1.dng"), NULL, &error), &error);
    test_near(truth->exposure_time, 2 * part->exposure_time, 1e-9);
    test_near(truth->iso, 50, 0.5);
    test_near(truth->noise[1][0], part->noise[1][0] / 2, 1e-9);
    test_near(truth->white, 2 * part->white, 0);
    brace_frame_destroy(truth);
    brace_frame_destroy(part);
    capture_checked checked;
    test_good(capture_check(&checked, test_path("a"), NULL, &error), &error);
    assert_true(checked.restorable && checked.importable && checked.files[5].truth);
    capture_checked_free(&checked);
    /* A part that was changed is missed. */
    FILE *f = fopen(test_path("a/parts/gt_2.dng"), "ab");
    assert_non_null(f);
    assert_int_equal(fputc(0, f), 0);
    fclose(f);
    test_good(capture_check(&checked, test_path("a"), NULL, &error), &error);
    assert_int_equal(checked.problem_count, 1);
    assert_non_null(strstr(checked.problems[0], "parts/gt_2.dng was changed"));
    capture_checked_free(&checked);
    /* Interrupted among the parts. */
    assert_int_equal(test_shoot(fresh(), "b", "canon_r5", "full:7", NULL, params, &error), BRACE_ERROR_IO);
    assert_int_equal(test_count(".capture-b/parts"), 1);
    test_good(test_shoot(fresh(), "b", "canon_r5", NULL, NULL, (capture_run_params){.resume = true}, &error), &error);
    assert_int_equal(test_count("b/parts"), 2);
}

static void on_import(void *user, const char *source, const char *sample, const char *problem, double displacement) {
    (void)source, (void)sample, (void)displacement;
    if (problem != NULL)
        snprintf(user, 512, "%s", problem);
}

static void what_comes_after(void **state) {
    (void)state;
    brace_error error;
    test_good(test_shoot(fresh(), "set/a", NULL, NULL, NULL, (capture_run_params){0}, &error), &error);
    test_good(test_shoot(fresh(), "set/b", "canon_r5", NULL, NULL, (capture_run_params){.plan = {.iso = 400}}, &error),
              &error);
    char problem[512] = "";
    const char *folder = test_path("set");
    dataset_imported done;
    test_good(dataset_import(&folder, 1, test_path("imported"), &(dataset_import_params){.reduce = 2, .tolerance = 2},
                             on_import, problem, &done, NULL, &error),
              &error);
    if (done.good != 2)
        fail_msg("not imported: %s", problem);
    dataset_verified verified;
    test_good(dataset_verify(test_path("imported"), NULL, NULL, &verified, NULL, &error), &error);
    assert_int_equal(verified.samples, 2);
    assert_int_equal(verified.bad, 0);
    char paths[5][PATH_MAX];
    const char *frames[5];
    for (int i = 0; i < 5; i++) {
        char name[64];
        snprintf(name, sizeof name, "set/a/frame_%d.dng", i + 1);
        snprintf(paths[i], sizeof paths[i], "%s", test_path(name));
        frames[i] = paths[i];
    }
    brace_bracket *bracket;
    brace_restored *restored;
    test_good(brace_bracket_read(&bracket, frames, 5, NULL, NULL, &error), &error);
    for (size_t i = 0; i < 5; i++)
        assert_int_equal(bracket->order[i], i); /* frame_1 is the shortest */
    test_good(brace_restore(&restored, bracket, NULL, NULL, &error), &error);
    brace_restored_destroy(restored);
    brace_bracket_destroy(bracket);
}

static void killed_and_resumed(void **state) {
    (void)state;
    brace_error error;
    for (int round = 0; round < 8; round++) {
        /* Killed as a sequence: no clean-up runs. Later in every round. */
        const pid_t child = fork();
        assert_true(child >= 0);
        if (child == 0) {
            capture_sequence *q = calloc(1, sizeof *q);
            const bool there = test_exists(".capture-k/sequence.json");
            _exit(q == NULL ||
                  test_shoot(q, "k", NULL, NULL, NULL, (capture_run_params){.resume = there}, &error) != BRACE_OK);
        }
        usleep((useconds_t)(15000 + 12000 * round));
        kill(child, SIGKILL);
        int how;
        assert_int_equal(waitpid(child, &how, 0), child);
        if (test_exists("k"))
            break; /* it was quicker */
        if (test_exists(".capture-k/sequence.json")) {
            capture_sequence *q = fresh();
            test_good(capture_sequence_load(q, test_path(".capture-k/sequence.json"), &error), &error);
            assert_true(q->shot_count > 0);
            for (size_t i = 0; i < q->shot_count; i++)
                assert_true(q->shots[i].done || !q->complete); /* complete before it has its name, and only then */
        }
    }
    if (!test_exists("k")) {
        const bool there = test_exists(".capture-k/sequence.json");
        test_good(test_shoot(fresh(), "k", NULL, NULL, NULL, (capture_run_params){.resume = there}, &error), &error);
    }
    /* The last moment of all: everything is there but the name. */
    assert_int_equal(rename(test_path("k"), test_path(".capture-k")), 0);
    test_good(test_shoot(fresh(), "k", NULL, NULL, NULL, (capture_run_params){.resume = true}, &error), &error);
    assert_int_equal(test_count("k"), 7); /* no temporary of the killed ones */
    assert_int_equal(test_count("."), 1);
    capture_checked checked;
    test_good(capture_check(&checked, test_path("k"), NULL, &error), &error);
    assert_true(checked.restorable && checked.importable && checked.has_sequence);
    capture_checked_free(&checked);
}

static void what_resuming_refuses(void **state) {
    (void)state;
    brace_error error;
    const capture_run_params resume = {.resume = true};
    assert_int_equal(test_shoot(fresh(), "a", NULL, NULL, NULL, resume, &error), BRACE_ERROR_IO); /* there is none */
    assert_int_equal(test_count("."), 0);
    assert_int_equal(test_shoot(fresh(), "a", NULL, "full:4", NULL, (capture_run_params){0}, &error), BRACE_ERROR_IO);
    assert_int_equal(test_shoot(fresh(), "a", NULL, NULL, NULL, (capture_run_params){0}, &error), BRACE_ERROR_IO);
    assert_non_null(strstr(error.message, "--resume"));
    assert_int_equal(test_shoot(fresh(), "a", "canon_r5", NULL, NULL, resume, &error), BRACE_ERROR_MISMATCH);
    const capture_run_params other = {.resume = true, .own_plan = true, .plan = {.time = 0.01}};
    assert_int_equal(test_shoot(fresh(), "a", NULL, NULL, NULL, other, &error), BRACE_ERROR_ARGUMENT);
    assert_int_equal(test_count(".capture-a"), 4); /* none of this cost a frame */
    /* A frame that was changed meanwhile is shot again, a strange file is removed. */
    FILE *f = fopen(test_path(".capture-a/frame_4.dng"), "r+b");
    assert_non_null(f);
    fseek(f, -1000, SEEK_END);
    fputs("xxxx", f);
    fclose(f);
    f = fopen(test_path(".capture-a/frame_9.dng"), "wb");
    assert_non_null(f);
    fclose(f);
    const capture_run_params same = {.resume = true, .own_plan = true};
    test_good(test_shoot(fresh(), "a", NULL, NULL, NULL, same, &error), &error);
    assert_int_equal(test_count("a"), 7);
    assert_true(said(sequence, &error, "frame_4.dng is damaged or gone"));
    assert_int_equal(test_shoot(fresh(), "a", NULL, NULL, NULL, (capture_run_params){0}, &error), BRACE_ERROR_IO);
    assert_non_null(strstr(error.message, "is there already"));
    /* A damaged description stops a resumption, and a new start replaces it. */
    assert_int_equal(test_shoot(fresh(), "b", NULL, "full:3", NULL, (capture_run_params){0}, &error), BRACE_ERROR_IO);
    assert_int_equal(truncate(test_path(".capture-b/sequence.json"), 100), 0);
    assert_int_equal(test_shoot(fresh(), "b", NULL, NULL, NULL, resume, &error), BRACE_ERROR_FORMAT);
    test_good(test_shoot(fresh(), "b", NULL, NULL, NULL, (capture_run_params){.restart = true}, &error), &error);
    static const char *const names[] = {"", "/", ".", "a/..", ".hidden"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        const capture_address address = {0};
        if (capture_run(fresh(), &capture_backend_sim, &address, names[i], NULL, NULL, &error) == BRACE_OK)
            fail_msg("'%s' was taken for a folder", names[i]);
    }
}

static volatile int cancel_flag;

static void cancel_at(void *user, const capture_event *event) {
    int *left = user;
    if (event->shot != NULL && --*left == 0)
        cancel_flag = 1;
}

static void cancelled(void **state) {
    (void)state;
    brace_error error;
    char screen[PATH_MAX + 8];
    snprintf(screen, sizeof screen, "screen=%s", test_screen);
    const char *const options[] = {"size=192x144", screen};
    const capture_address address = {.options = options, .option_count = 2};
    int left = 3;
    const capture_run_params params = {.event = cancel_at, .user = &left};
    const brace_job job = {.threads = 1, .cancel = &cancel_flag};
    cancel_flag = 0;
    assert_int_equal(capture_run(fresh(), &capture_backend_sim, &address, test_path("c"), &params, &job, &error),
                     BRACE_ERROR_CANCELLED);
    assert_int_equal(test_count(".capture-c"), 4);
    assert_false(test_exists("c"));
    /* Before anything was shot nothing is left. */
    assert_int_equal(capture_run(fresh(), &capture_backend_sim, &address, test_path("d"), NULL, &job, &error),
                     BRACE_ERROR_CANCELLED);
    assert_int_equal(test_count("."), 1);
    cancel_flag = 0;
    /* Memory that ends while the frames which are there are looked at says nothing about them, as an interruption does. */
    int ended = 0;
    for (long n = 1; n < 400; n += n < 60 ? 1 : 37) {
        core_alloc_fail_after(n);
        const brace_status status = capture_run(fresh(), &capture_backend_sim, &address, test_path("c"),
                                                &(capture_run_params){.resume = true}, &(brace_job){.threads = 1}, &error);
        core_alloc_fail_after(0);
        if (status == BRACE_OK)
            break;
        assert_int_equal(status, BRACE_ERROR_MEMORY);
        assert_true(test_count(".capture-c") >= 4);
        ended++;
    }
    assert_true(ended > 20);
    test_remove(test_path("c"));
    test_good(test_shoot(fresh(), "c", NULL, NULL, NULL, (capture_run_params){.resume = true}, &error), &error);
}

static void memory_ends(void **state) {
    (void)state;
    brace_error error;
    const capture_run_params params = {.plan = {.frames = 3}};
    bool through = false;
    int failed = 0;
    for (long n = 1; n < 20000 && !through; n += n < 24 ? 1 : 41 + n / 16) {
        core_alloc_fail_after(n);
        const brace_status status = test_shoot(fresh(), "m", NULL, NULL, "off=all", params, &error);
        through = status == BRACE_OK;
        core_alloc_fail_after(0);
        if (status != BRACE_OK) {
            assert_int_equal(status, BRACE_ERROR_MEMORY);
            assert_false(test_exists("m"));
            test_remove(test_path(".capture-m"));
            failed++;
        }
    }
    assert_true(through && failed > 20 && test_exists("m"));
}

static void folders_of_others(void **state) {
    (void)state;
    brace_error error;
    capture_checked checked;
    test_good(test_shoot(fresh(), "a", NULL, NULL, NULL, (capture_run_params){0}, &error), &error);
    /* As an app would have named them: the truth is known by its ISO. */
    static const char *const names[][2] = {{"a/frame_1.dng", "a/IMG_5.dng"}, {"a/frame_2.dng", "a/IMG_4.dng"},
                                           {"a/frame_3.dng", "a/IMG_3.dng"}, {"a/frame_4.dng", "a/IMG_2.dng"},
                                           {"a/frame_5.dng", "a/IMG_1.dng"}, {"a/gt.dng", "a/IMG_6.dng"}};
    for (size_t i = 0; i < 6; i++)
        assert_int_equal(rename(test_path(names[i][0]), test_path(names[i][1])), 0);
    assert_int_equal(remove(test_path("a/sequence.json")), 0);
    test_good(capture_check(&checked, test_path("a"), NULL, &error), &error);
    assert_int_equal(checked.count, 6);
    assert_string_equal(checked.files[0].name, "IMG_5.dng");
    assert_string_equal(checked.files[5].name, "IMG_6.dng");
    assert_true(checked.files[5].truth && checked.reference == 2);
    assert_true(checked.restorable && checked.importable && !checked.has_sequence && checked.has_motion);
    capture_checked_free(&checked);
    /* Without it, a bracket that is no sample; a copy under another name; a file that is none. */
    assert_int_equal(rename(test_path("a/IMG_6.dng"), test_path("gt")), 0);
    test_good(capture_check(&checked, test_path("a"), NULL, &error), &error);
    assert_true(checked.restorable && !checked.importable && checked.problem_count == 0);
    assert_non_null(strstr(checked.not_importable, "no truth"));
    capture_checked_free(&checked);
    assert_int_equal(link(test_path("a/IMG_3.dng"), test_path("a/IMG_7.dng")), 0);
    FILE *f = fopen(test_path("a/IMG_8.dng"), "wb");
    assert_non_null(f);
    fputs("no RAW file", f);
    fclose(f);
    test_good(capture_check(&checked, test_path("a"), NULL, &error), &error);
    assert_int_equal(checked.problem_count, 2);
    assert_false(checked.files[checked.count - 1].readable);
    assert_non_null(strstr(checked.problems[1], "sample for sample"));
    capture_checked_free(&checked);
    assert_int_equal(capture_check(&checked, test_path("none"), NULL, &error), BRACE_ERROR_IO);
    capture_checked_free(&checked);
}

int main(void) {
#define T(test) cmocka_unit_test_setup_teardown(test, setup, teardown)
    const struct CMUnitTest tests[] = {
        T(the_same_bytes),     T(every_fault),           T(kept_on_demand), T(an_averaged_truth), T(what_comes_after),
        T(killed_and_resumed), T(what_resuming_refuses), T(cancelled),      T(memory_ends),       T(folders_of_others)};
    return cmocka_run_group_tests(tests, test_screen_make, test_screen_remove);
}
