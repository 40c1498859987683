/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_choices.c: libFuzzer target for the texts of a camera's settings: lines of
 * choices, sorted into stops that must be finite, in order, and parse to themselves.
 */
#include <stdlib.h>
#include <string.h>

#include "capture/choices.h"

#include "fuzz.h"

typedef bool parser(const char *text, double *value);

static void take(capture_stops *stops, const char *line, parser *parse, double low, double high) {
    double value;
    if (parse(line, &value) && !(value >= low && value <= high)) {
        abort();
    }
    capture_stops_add(stops, line, parse);
}

static void check(const capture_stops *stops, parser *parse) {
    double again;
    for (size_t i = 0; i < stops->count; i++) {
        if ((i > 0 && !(stops->values[i] > stops->values[i - 1])) || !parse(stops->texts[i], &again) ||
            again < stops->values[i] || again > stops->values[i]) {
            abort();
        }
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static capture_stops exposures, isos, apertures;
    char extension[8];
    exposures.count = isos.count = apertures.count = 0;
    while (size > 0) {
        const uint8_t *end = memchr(data, '\n', size);
        const size_t n = end != NULL ? (size_t)(end - data) : size;
        char *line = fuzz_text(data, n);
        if (line == NULL) {
            return 0;
        }
        take(&exposures, line, capture_choice_exposure, 1e-6, 86400);
        take(&isos, line, capture_choice_iso, 1, 1e7);
        take(&apertures, line, capture_choice_aperture, 0.5, 128);
        const int rank = capture_choice_raw(line);
        if (rank < 0 || rank > 4 || (capture_name_is_raw(line, extension) && extension[0] == '\0')) {
            abort();
        }
        free(line);
        data += n + (end != NULL);
        size -= n + (end != NULL);
    }
    check(&exposures, capture_choice_exposure);
    check(&isos, capture_choice_iso);
    check(&apertures, capture_choice_aperture);
    return 0;
}
