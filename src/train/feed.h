/* SPDX-License-Identifier: Apache-2.0 */
/*
 * feed.h: samples prepared in the background, so that rendering goes on while a network learns. Internal.
 *
 * Step s of training takes samples s*batch + first ... + count - 1 of a source: with several processes each takes its
 * part of every batch. They come in that order, the same ones for any number of threads.
 */
#ifndef TRAIN_FEED_H
#define TRAIN_FEED_H

#include "train/source.h"

typedef struct train_feed_params {
    uint64_t step;           /* of the first sample */
    int batch, first, count; /* count 0: the whole batch */
    int threads;             /* that prepare; 0: 1 */
    int ahead;               /* brackets that may wait; 0: two for each thread */
} train_feed_params;

typedef struct train_feed train_feed;

brace_status train_feed_create(train_feed **out, const train_source *source, const train_feed_params *params,
                               brace_error *error);
void train_feed_destroy(train_feed *feed); /* stops what is being prepared; NULL is allowed */

/* The next sample, the feed's until the next call. One thread asks. After an error the feed ends. */
brace_status train_feed_next(train_feed *feed, const train_sample **out, brace_error *error);
double train_feed_waited(const train_feed *feed); /* seconds that train_feed_next has waited: rendering is too slow */

#endif
