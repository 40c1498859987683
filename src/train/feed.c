/* SPDX-License-Identifier: Apache-2.0 */
/*
 * feed.c: a ring of brackets. Threads claim the next bracket in turn and fill its
 * place in the ring with the crops that are wanted of it; the reader empties the
 * places in the same order.
 */
#include "train/feed.h"

#include <pthread.h>
#include <signal.h>

typedef struct feed_place {
    enum { EMPTY, CLAIMED, READY } state;
    uint64_t first;
    int count;
    train_sample *samples;
    brace_status status;
    brace_error error;
} feed_place;

struct train_feed {
    const train_source *source;
    train_feed_params params;
    pthread_mutex_t lock;
    pthread_cond_t changed;
    bool stop;
    volatile int cancel; /* of renderings, when the feed is destroyed */
    feed_place *places;
    int ahead;
    uint64_t claimed, taken; /* brackets */
    uint64_t step;           /* of the next bracket to be claimed */
    int at;                  /* its first sample, in this process's part of the batch */
    int used;                /* samples of the bracket that is being read */
    double waited;
    pthread_t *threads;
    int thread_count;
};

/* The next run of samples that are crops of one bracket. Under the lock. */
static void claim(train_feed *f, feed_place *place) {
    const uint64_t crops = (uint64_t)train_source_params_of(f->source)->crops;
    place->first = f->step * (uint64_t)f->params.batch + (uint64_t)(f->params.first + f->at);
    const uint64_t rest = crops - place->first % crops, left = (uint64_t)(f->params.count - f->at);
    place->count = (int)(rest < left ? rest : left);
    place->state = CLAIMED;
    f->claimed++;
    f->at += place->count;
    if (f->at == f->params.count) {
        f->at = 0;
        f->step++;
    }
}

static void *prepare(void *arg) {
    train_feed *f = arg;
    pthread_mutex_lock(&f->lock);
    while (!f->stop) {
        feed_place *place = &f->places[f->claimed % (uint64_t)f->ahead];
        if (place->state != EMPTY) {
            pthread_cond_wait(&f->changed, &f->lock);
            continue;
        }
        claim(f, place);
        pthread_mutex_unlock(&f->lock);
        brace_error error = {0};
        brace_status status =
            train_source_get(f->source, place->first, place->count, place->samples, &f->cancel, &error);
        pthread_mutex_lock(&f->lock);
        place->status = status;
        place->error = error;
        place->state = READY;
        pthread_cond_broadcast(&f->changed);
    }
    pthread_mutex_unlock(&f->lock);
    return NULL;
}

static brace_status make_places(train_feed *f, brace_error *error) {
    const train_source_params *p = train_source_params_of(f->source);
    f->places = core_calloc((size_t)f->ahead, sizeof *f->places);
    f->threads = core_calloc((size_t)f->params.threads, sizeof *f->threads);
    if (f->places == NULL || f->threads == NULL) {
        return core_fail_memory(error, (size_t)f->ahead * sizeof *f->places, "samples");
    }
    brace_status status = BRACE_OK;
    for (int i = 0; i < f->ahead && status == BRACE_OK; i++) {
        f->places[i].samples = core_calloc((size_t)p->crops, sizeof(train_sample));
        if (f->places[i].samples == NULL) {
            return core_fail_memory(error, (size_t)p->crops * sizeof(train_sample), "samples");
        }
        for (int k = 0; k < p->crops && status == BRACE_OK; k++) {
            status = train_sample_create(&f->places[i].samples[k], p->frames + p->guide, p->side, error);
        }
    }
    return status;
}

brace_status train_feed_create(train_feed **out, const train_source *source, const train_feed_params *params,
                               brace_error *error) {
    train_feed *f = core_calloc(1, sizeof *f);
    if (f == NULL) {
        return core_fail_memory(error, sizeof *f, "samples");
    }
    f->source = source;
    f->params = *params;
    f->params.threads = params->threads > 0 ? params->threads : 1;
    f->params.count = params->count > 0 ? params->count : params->batch;
    f->ahead = params->ahead > 0 ? params->ahead : 2 * f->params.threads;
    f->step = params->step;
    pthread_mutex_init(&f->lock, NULL);
    pthread_cond_init(&f->changed, NULL);
    brace_status status = make_places(f, error);
    /* Signals belong to the program's own threads. */
    sigset_t all, old;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &old);
    while (status == BRACE_OK && f->thread_count < f->params.threads &&
           pthread_create(&f->threads[f->thread_count], NULL, prepare, f) == 0) {
        f->thread_count++;
    }
    pthread_sigmask(SIG_SETMASK, &old, NULL);
    if (status == BRACE_OK && f->thread_count == 0) {
        status = core_fail(error, BRACE_ERROR_MEMORY, "the system gives no thread to prepare samples with");
    }
    if (status != BRACE_OK) {
        train_feed_destroy(f);
        return status;
    }
    *out = f;
    return BRACE_OK;
}

void train_feed_destroy(train_feed *f) {
    if (f == NULL) {
        return;
    }
    pthread_mutex_lock(&f->lock);
    f->stop = true;
    __atomic_store_n(&f->cancel, 1, __ATOMIC_RELAXED);
    pthread_cond_broadcast(&f->changed);
    pthread_mutex_unlock(&f->lock);
    for (int i = 0; i < f->thread_count; i++) {
        pthread_join(f->threads[i], NULL);
    }
    for (int i = 0; f->places != NULL && i < f->ahead; i++) {
        for (int k = 0; f->places[i].samples != NULL && k < train_source_params_of(f->source)->crops; k++) {
            train_sample_free(&f->places[i].samples[k]);
        }
        core_free(f->places[i].samples);
    }
    pthread_cond_destroy(&f->changed);
    pthread_mutex_destroy(&f->lock);
    core_free(f->places);
    core_free(f->threads);
    core_free(f);
}

brace_status train_feed_next(train_feed *f, const train_sample **out, brace_error *error) {
    const double start = core_seconds();
    pthread_mutex_lock(&f->lock);
    feed_place *place = &f->places[f->taken % (uint64_t)f->ahead];
    if (place->state == READY && f->used == place->count) {
        place->state = EMPTY;
        f->used = 0;
        f->taken++;
        pthread_cond_broadcast(&f->changed);
        place = &f->places[f->taken % (uint64_t)f->ahead];
    }
    while (place->state != READY) {
        pthread_cond_wait(&f->changed, &f->lock);
    }
    f->waited += core_seconds() - start;
    const brace_status status = place->status;
    if (status == BRACE_OK) {
        *out = &place->samples[f->used++];
    } else if (error != NULL) {
        *error = place->error;
    }
    pthread_mutex_unlock(&f->lock);
    return status;
}

double train_feed_waited(const train_feed *f) {
    return f->waited;
}
