/* SPDX-License-Identifier: Apache-2.0 */
/* capture_print.h: plans, sequences and checked folders as tables and as JSON. */
#ifndef CLI_CAPTURE_PRINT_H
#define CLI_CAPTURE_PRINT_H

#include "capture/capture.h"
#include "cli/cli.h"

/* `flicker`: frequencies whose periods are counted, Hz. */
void capture_print_plan(const capture_plan *plan, const capture_limits *limits, const double *flicker, size_t count);
json_t *capture_plan_json(const capture_plan *plan, const capture_limits *limits, const double *flicker, size_t count);

void capture_print_limits(const capture_limits *limits);
json_t *capture_limits_json(const capture_limits *limits);

/* What was shot, and what it took. */
void capture_print_summary(const capture_sequence *sequence, const char *folder);
/* "2 busy, 1 dropped" of what went wrong; "" if nothing did. */
const char *capture_counts_text(char *out, size_t size, const capture_counts *counts);

void capture_print_checked(const capture_checked *checked, const char *folder);
json_t *capture_checked_json(const capture_checked *checked, const char *folder);

#endif
