/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_json.c: libFuzzer target for what people write in JSON, and weights files carry: displays, cameras, training
 * configurations, shapes of networks. Whatever is refused is refused with a sentence that names the file.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "models/models.h"
#include "sim/sim.h"
#include "train/train.h"

#include "fuzz.h"

static void said(brace_status status, const brace_error *error) {
    if (status != BRACE_OK && strncmp(error->message, "fuzz", 4) != 0)
        abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    char *text = fuzz_text(data, size);
    if (text == NULL)
        return 0;
    brace_error error = {BRACE_OK, ""};
    sim_display *display = NULL;
    brace_status status = sim_display_parse(&display, text, "fuzz", &error);
    said(status, &error);
    if (status == BRACE_OK)
        sim_display_destroy(display);
    sim_camera camera;
    said(sim_camera_parse(&camera, text, "fuzz", &error), &error);
    models_shape shape = {0};
    said(models_shape_parse(&shape, text, "fuzz", &error), &error);
    train_config config;
    said(train_config_parse(&config, text, "fuzz", &error), &error);
    train_config_free(&config);
    free(text);
    return 0;
}
