/* SPDX-License-Identifier: Apache-2.0 */
/* test_sequence.c: sequence.json: what is written is read again; what a stranger wrote is refused. */
#include "capture_test.h"

static capture_sequence *example(const char *list) {
    brace_error error;
    capture_plan plan;
    capture_sequence *q = calloc(1, sizeof *q);
    assert_non_null(q);
    const capture_limits limits = {.exposure_min = 1e-5, .exposure_max = 1, .iso_min = 100, .iso_max = 6400};
    test_good(capture_plan_create(&plan, &(capture_plan_params){.iso = 400, .list = list}, &limits, NULL, &error),
              &error);
    capture_sequence_init(q, &plan);
    snprintf(q->backend, sizeof q->backend, "sim");
    snprintf(q->make, sizeof q->make, "Make \"%s\"", "x");
    snprintf(q->model, sizeof q->model, "\xc3\xa4");
    q->readout = 0.0145, q->f_number = 1.8;
    for (size_t i = 0; i < q->shot_count; i++) {
        capture_shot *s = &q->shots[i];
        char stem[48];
        s->done = i % 3 != 2;
        s->tries = (int)i + 1;
        snprintf(s->file, sizeof s->file, "%s.nef", capture_shot_stem(stem, q, s));
        s->bytes = 1234567890123;
        memset(s->sha256, 'a' + (int)i % 6, 64);
        s->report = (capture_shot_report){.exposure = 0.01 * (double)(i + 1),
                                          .iso = 400,
                                          .timestamp = 9007199254740993,
                                          .skew = 0.0145,
                                          .noise = {{1e-4, 1e-7}, {2e-4, 2e-7}, {3e-4, 3e-7}},
                                          .has_noise = true,
                                          .orientation = 6};
        s->exif_exposure = 1.0 / 3, s->exif_iso = 400, s->ev = i == 0 ? (double)NAN : 0.125, s->accepted = i == 1;
    }
    snprintf(q->truth_file, sizeof q->truth_file, "gt.dng");
    memset(q->truth_sha256, '0', 64);
    q->counts = (capture_counts){9, 1, 2, 3, 4, 5, 6};
    capture_sequence_event(q, "frame_3 is what it is");
    q->has_motion = true;
    q->motion =
        (brace_motion){.dx = 1.25, .dy = -0.5, .rotation = 0.01, .scale = 1.001, .local = 0.3, .confidence = 0.9};
    return q;
}

static char *dump(const capture_sequence *q) {
    json_t *o = capture_sequence_json(q);
    assert_non_null(o);
    char *text = json_dumps(o, JSON_INDENT(1) | JSON_REAL_PRECISION(17));
    json_decref(o);
    assert_non_null(text);
    return text;
}

static void there_and_back(void **state) {
    (void)state;
    static const char *const lists[] = {NULL, "1,2,4", "9,8,7,6,5,4,3,2,1,gt:16@1/16"};
    for (size_t i = 0; i < 3; i++) {
        brace_error error;
        capture_sequence *q = example(lists[i]), *again = calloc(1, sizeof *again);
        assert_non_null(again);
        char *text = dump(q);
        test_good(capture_sequence_parse(again, text, "test", &error), &error);
        char *back = dump(again);
        assert_string_equal(text, back);
        assert_int_equal(again->shots[0].report.timestamp, 9007199254740993);
        assert_int_equal(again->plan.reference, q->plan.reference);
        free(text);
        free(back);
        capture_sequence_free(q);
        capture_sequence_free(again);
        free(q);
        free(again);
    }
}

static void refused(const char *text, const char *what) {
    brace_error error;
    static capture_sequence q;
    const brace_status status = capture_sequence_parse(&q, text, "test", &error);
    if (status == BRACE_OK)
        fail_msg("taken: %s", what);
    assert_int_equal(status, BRACE_ERROR_FORMAT);
}

static void strangers(void **state) {
    (void)state;
    capture_sequence *q = example(NULL);
    char *text = dump(q);
    static const char *const changes[][2] = {
        {"brace-capture-1", "brace-capture-2"},
        {"\"frame_5.nef\"", "\"../frame_5.nef\""},
        {"\"frame_5.nef\"", "\"/etc/passwd\""},
        {"\"frame_5.nef\"", "\"frame_5.\""},
        {"\"frame_5.nef\"", "\"frame_5.n/f\""},
        {"\"frame_5.nef\"", "\"frame_5.toolongext\""},
        {"\"frame_5.nef\"", "\"frame_4.nef\""},
        {"\"frame_5.nef\"", "\"frame_5\\u0000.nef\""},
        {"\"gt.dng\"", "\"sequence.json\""},
        {"aaaaaaaa", "aaaaaaaA"},
        {"\"shots\": 2", "\"shots\": 3"},
        {"\"shots\": 2", "\"shots\": 1000000000"},
        {"\"shots\": 2", "\"shots\": 0"},
        {"\"shots\": 2", "\"shots\": -1"},
        {"\"exposure\": ", "\"exposure\": -"},
        {"\"iso\": 400", "\"iso\": 1e300"},
        {"\"iso\": 400", "\"iso\": null"},
        {"\"truth\": false", "\"truth\": true"},
        {"\"tries\": 1", "\"tries\": -1"},
        {"\"orientation\": 6", "\"orientation\": 9"},
        {"\"noise\": [", "\"noise\": [1,"},
        {"\"confidence\": 0", "\"confidence\": 7"},
        {"\"events\": [", "\"events\": [1,"},
        {"\"plan\": [", "\"plan\": [{},"},
        {"\"plan\": [", "\"plans\": ["},
        {"\"bytes\": 1", "\"bytes\": -1"},
        {"{", "[{"},
    };
    for (size_t i = 0; i < sizeof changes / sizeof *changes; i++) {
        const char *at = strstr(text, changes[i][0]);
        if (at == NULL)
            fail_msg("there is no %s in %s", changes[i][0], text);
        char *changed;
        assert_true(asprintf(&changed, "%.*s%s%s", (int)(at - text), text, changes[i][1], at + strlen(changes[i][0])) >
                    0);
        refused(changed, changes[i][1]);
        free(changed);
    }
    refused("", "nothing");
    refused("[]", "a list");
    refused("{}", "an empty object");
    refused("{\"format\": \"brace-capture-1\", \"plan\": [], \"shots\": [], \"device\": {}}", "no steps");
    /* Cut anywhere. */
    const size_t n = strlen(text);
    for (size_t i = 0; i + 2 < n; i += 1 + n / 300) {
        char *cut = strndup(text, i);
        assert_non_null(cut);
        refused(cut, "a part");
        free(cut);
    }
    free(text);
    capture_sequence_free(q);
    free(q);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(there_and_back), cmocka_unit_test(strangers)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
