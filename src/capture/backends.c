/* SPDX-License-Identifier: Apache-2.0 */
/* backends.c: which cameras there are, and what every back end needs. */
#include <math.h>
#include <string.h>
#include <time.h>

#include "capture/camera.h"

const capture_backend *const capture_backends[] = {
    &capture_backend_sim,
#ifdef CAPTURE_HAVE_GPHOTO2
    &capture_backend_gphoto2,
#endif
    &capture_backend_android,
    NULL,
};

brace_status capture_backend_find(const capture_backend **out, const char **port, const char *camera,
                                  brace_error *error) {
    const char *colon = strchr(camera, ':');
    const size_t n = colon != NULL ? (size_t)(colon - camera) : strlen(camera);
    char names[256] = "";
    for (size_t i = 0; capture_backends[i] != NULL; i++) {
        const char *name = capture_backends[i]->name;
        if (strlen(name) == n && strncmp(name, camera, n) == 0) {
            *out = capture_backends[i];
            *port = colon != NULL && colon[1] != '\0' ? colon + 1 : NULL;
            return BRACE_OK;
        }
        const size_t used = strlen(names);
        snprintf(names + used, sizeof names - used, "%s%s", i > 0 ? ", " : "", name);
    }
#ifndef CAPTURE_HAVE_GPHOTO2
    if (n == strlen("gphoto2") && strncmp(camera, "gphoto2", n) == 0) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED,
                         "tethered cameras are not in this build of BRACE, which was made without libgphoto2 (Debian: "
                         "install libgphoto2-dev and build again)");
    }
#endif
    return core_fail(error, BRACE_ERROR_ARGUMENT, "there is no kind of camera '%.*s'; there are: %s", (int)n, camera,
                     names);
}

/* True if `option` is "NAME=...". */
static bool is_option(const char *option, const char *name) {
    const size_t n = strlen(name);
    return strncmp(option, name, n) == 0 && option[n] == '=';
}

const char *capture_option(const capture_address *address, const char *name) {
    for (size_t i = address->option_count; i-- > 0;) {
        if (is_option(address->options[i], name)) {
            return address->options[i] + strlen(name) + 1;
        }
    }
    return NULL;
}

brace_status capture_option_unknown(const capture_address *address, const char *backend, const char *const *known,
                                    brace_error *error) {
    for (size_t i = 0; i < address->option_count; i++) {
        bool found = false;
        char names[512] = "";
        for (size_t k = 0; known[k] != NULL; k++) {
            const size_t used = strlen(names);
            found = found || is_option(address->options[i], known[k]);
            snprintf(names + used, sizeof names - used, "%s%s", k > 0 ? ", " : "", known[k]);
        }
        if (!found) {
            return core_fail(error, BRACE_ERROR_ARGUMENT, "the %s camera has no option '%s'; NAME=VALUE of: %s",
                             backend, address->options[i], names[0] != '\0' ? names : "none");
        }
    }
    return BRACE_OK;
}

brace_status capture_wait(double seconds, const brace_job *job, brace_error *error) {
    const double end = core_seconds() + seconds;
    for (;;) {
        const double left = end - core_seconds();
        brace_status status = core_check_cancel(job, error);
        if (status != BRACE_OK || !(left > 0)) {
            return status;
        }
        const double nap = fmin(left, 0.05);
        nanosleep(&(struct timespec){0, (long)(nap * 1e9)}, NULL);
    }
}
