/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_PLOT_H
#define CLI_PLOT_H

#include "brace/brace.h"

/* The picture of an analysis (plot.c): frames in the order given. The caller destroys it. */
brace_status cli_plot(brace_image **out, const brace_banding *banding, const brace_frame *const *frames,
                      const brace_job *job, brace_error *error);

#endif
