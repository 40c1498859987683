/* SPDX-License-Identifier: Apache-2.0 */
#ifndef RESTORE_PERIODIC_H
#define RESTORE_PERIODIC_H

#include "restore/internal.h"

/* The gain of a frame's rows, told from the frame itself: `gain` has one number
 * a row and zone (view->zones), 1 where there is nothing to tell. `shorter` is
 * the next shorter frame (it gives the period), or NULL: then all stay 1.
 * *found is how far to believe it, 0 to 1. */
brace_status restore_periodic(float *gain, double *found, const restore_view *view, const restore_view *shorter,
                              core_pool *pool, brace_error *error);

#endif
