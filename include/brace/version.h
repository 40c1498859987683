/* SPDX-License-Identifier: Apache-2.0 */
/*
 * version.h: the version of BRACE. Within one major version a newer shared
 * library runs programs built against an older one (soname libbrace.so.MAJOR).
 */
#ifndef BRACE_VERSION_H
#define BRACE_VERSION_H

#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define BRACE_VERSION_MAJOR 0
#define BRACE_VERSION_MINOR 1
#define BRACE_VERSION_PATCH 0
#define BRACE_VERSION_STRING "0.1.0"

/* The version of the library that is loaded, "MAJOR.MINOR.PATCH". Any thread. */
BRACE_API const char *brace_version(void);

/* The libraries that BRACE runs on and their versions, one line,
 * "LibRaw 0.20.2, libtiff 4.5.0, ...". Any thread. */
BRACE_API const char *brace_dependencies(void);

#ifdef __cplusplus
}
#endif
#endif
