/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ptpip_main.c: the test camera as a program, in front of a simulated display:
 *
 *   ptpip-camera READY [maker] [fault=NAME@FROMxTIMES] [NAME=VALUE of the simulated camera] ...
 *
 * listens on 127.0.0.1, on a port that it writes to the file READY, until its
 * standard input ends; then it prints what happened, as JSON.
 */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "capture/camera.h"
#include "ptpip_camera.h"

enum { OPTIONS_MAX = 32 };

typedef struct studio {
    capture_camera *camera;
    char stem[64];
} studio;

/* The file of a simulated shot, as bytes. */
static brace_status expose(void *user, double seconds, double iso, void **data, size_t *size, brace_error *error) {
    studio *s = user;
    capture_shot_report report = {.timestamp = -1};
    brace_job job = {.threads = 1};
    char path[80];
    brace_status status = capture_backend_sim.shoot(s->camera, seconds, iso, s->stem, &report, &job, error);
    snprintf(path, sizeof path, "%s.dng", s->stem);
    if (status == BRACE_OK) {
        status = core_file_load(data, size, path, (size_t)1 << 28, error);
    }
    unlink(path);
    if (status != BRACE_OK) {
        fprintf(stderr, "ptpip-camera: %s\n", error->message);
    }
    return status;
}

static bool write_port(const char *path, unsigned port) {
    core_file *file;
    if (core_file_create(&file, path, NULL) != BRACE_OK) {
        return false;
    }
    fprintf(core_file_stream(file), "%u\n", port);
    return core_file_commit(file, NULL) == BRACE_OK;
}

int main(int argc, char **argv) {
    brace_error error = {.message = "usage: ptpip-camera READY [maker] [fault=...] [NAME=VALUE] ..."};
    ptpip_fault faults[PTPIP_FAULTS_MAX];
    const char *options[OPTIONS_MAX];
    studio s = {.camera = NULL};
    ptpip_params params = {.faults = faults, .expose = expose, .user = &s};
    capture_address address = {.options = options};
    ptpip_camera *camera = NULL;
    bool good = argc >= 2;
    for (int i = 2; i < argc && good; i++) {
        if (strcmp(argv[i], "maker") == 0) {
            params.maker = true;
        } else if (strncmp(argv[i], "fault=", 6) == 0) {
            good =
                params.fault_count < PTPIP_FAULTS_MAX && ptpip_fault_parse(&faults[params.fault_count++], argv[i] + 6);
        } else {
            good = address.option_count < OPTIONS_MAX;
            options[good ? address.option_count++ : 0] = argv[i];
        }
    }
    snprintf(s.stem, sizeof s.stem, "/tmp/brace-ptpip-%ld", (long)getpid());
    if (!good || capture_backend_sim.open(&s.camera, &address, NULL, &error) != BRACE_OK ||
        ptpip_camera_start(&camera, &params, &error) != BRACE_OK || !write_port(argv[1], ptpip_camera_port(camera))) {
        fprintf(stderr, "ptpip-camera: %s\n", error.message);
        return 1;
    }
    char buffer[64];
    while (read(STDIN_FILENO, buffer, sizeof buffer) > 0) {
    }
    const ptpip_tally t = ptpip_camera_tally(camera);
    printf("{\"connections\": %u, \"sets\": %u, \"releases\": %u, \"exposures\": %u, \"downloads\": %u, "
           "\"deleted\": %u, \"faults\": %u, \"rejected\": %u, \"restored\": %s}\n",
           t.connections, t.sets, t.releases, t.exposures, t.downloads, t.deleted, t.faults, t.rejected,
           t.restored ? "true" : "false");
    ptpip_camera_stop(camera);
    capture_backend_sim.close(s.camera, NULL);
    return 0;
}
