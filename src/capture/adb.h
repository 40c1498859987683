/* SPDX-License-Identifier: Apache-2.0 */
/*
 * adb.h: runs Android's adb, if there is one on the PATH. Internal.
 */
#ifndef CAPTURE_ADB_H
#define CAPTURE_ADB_H

#include "core/core.h"

/* `adb forward tcp:PORT localabstract:brace`, or with `remove` the removal of that forward; with `-s SERIAL` if serial
 * is not NULL. BRACE_ERROR_UNSUPPORTED: there is no adb. Other errors hold what adb said. At most ten seconds. */
brace_status capture_adb_forward(unsigned port, const char *serial, bool remove, const brace_job *job,
                                 brace_error *error);

#endif
