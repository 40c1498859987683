/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_sequence.c: libFuzzer target for the reader of a capture's sequence.json
 * (what is taken is written and taken again), of lists of shots, and of faults.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "capture/capture.h"
#include "capture/sim_fault.h"

#include "fuzz.h"

static capture_sequence first, second;

static void sequence(const char *text) {
    if (capture_sequence_parse(&first, text, "fuzz", NULL) != BRACE_OK)
        return;
    for (size_t i = 0; i < first.shot_count; i++)
        if (first.shots[i].done && (first.shots[i].file[0] == '/' || strstr(first.shots[i].file, "..") != NULL))
            abort(); /* leads out of the folder */
    json_t *json = capture_sequence_json(&first);
    char *again = json != NULL ? json_dumps(json, JSON_REAL_PRECISION(17)) : NULL;
    json_decref(json);
    if (again != NULL && capture_sequence_parse(&second, again, "again", NULL) != BRACE_OK)
        abort();
    capture_sequence_free(&second);
    capture_sequence_free(&first);
    free(again);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    char *text = fuzz_text(data, size);
    if (text == NULL)
        return 0;
    sequence(text);
    const capture_limits limits = {.exposure_min = 1e-5, .exposure_max = 1, .iso_min = 100, .iso_max = 6400};
    capture_plan plan;
    if (capture_plan_create(&plan, &(capture_plan_params){.list = text}, &limits, NULL, NULL) == BRACE_OK)
        for (size_t i = 0; i < plan.count; i++)
            if (!(plan.steps[i].exposure >= 1e-5 && plan.steps[i].exposure <= 1) || plan.steps[i].shots < 1)
                abort();
    capture_faults faults;
    if (capture_faults_parse(&faults, text, NULL) == BRACE_OK && faults.count == 0)
        abort();
    free(text);
    return 0;
}
