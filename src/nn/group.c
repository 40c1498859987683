/* SPDX-License-Identifier: Apache-2.0 */
/* group.c: a group of one, and what all kinds of groups share: parameters, gathered into chunks. */
#include "nn/group.h"

#include <string.h>

/* ---- alone ---- */

static brace_status alone_sum(nn_group *group, float *values, size_t count, brace_error *error) {
    (void)group, (void)values, (void)count, (void)error;
    return BRACE_OK;
}

static brace_status alone_share(nn_group *group, void *bytes, size_t size, brace_error *error) {
    (void)group, (void)bytes, (void)size, (void)error;
    return BRACE_OK;
}

static brace_status alone_wait(nn_group *group, brace_error *error) {
    (void)group, (void)error;
    return BRACE_OK;
}

static void alone_leave(nn_group *group) {
    (void)group;
}

static const nn_group_kind kind_alone = {alone_sum, alone_share, alone_wait, alone_leave};

brace_status nn_group_alone(nn_group **out, brace_error *error) {
    *out = core_calloc(1, sizeof **out);
    if (*out == NULL) {
        return core_fail_memory(error, sizeof **out, "a group of processes");
    }
    (*out)->kind = &kind_alone;
    (*out)->size = 1;
    return BRACE_OK;
}

void nn_group_give_up(nn_group *group) {
    if (group != NULL) {
        core_free(group->room);
        core_free(group->chunk);
        core_free(group->parts);
        core_free(group);
    }
}

void nn_group_destroy(nn_group *group) {
    if (group != NULL) {
        group->kind->leave(group);
        nn_group_give_up(group);
    }
}

int nn_group_rank(const nn_group *group) {
    return group->rank;
}

int nn_group_size(const nn_group *group) {
    return group->size;
}

brace_status nn_group_sum(nn_group *group, float *values, size_t count, brace_error *error) {
    return group->kind->sum(group, values, count, error);
}

brace_status nn_group_share(nn_group *group, void *bytes, size_t size, brace_error *error) {
    return group->kind->share(group, bytes, size, error);
}

brace_status nn_group_wait(nn_group *group, brace_error *error) {
    return group->kind->wait(group, error);
}

/* ---- parameters ---- */

static uint64_t hash(uint64_t h, const void *bytes, size_t size) { /* FNV-1a */
    for (size_t i = 0; i < size; i++) {
        h = (h ^ ((const unsigned char *)bytes)[i]) * 0x100000001b3u;
    }
    return h;
}

static bool takes_part(const nn_parameter *p, bool gradients) {
    return !gradients || (p->grad != NULL && !p->frozen);
}

/* Sums or shares of different things would be nonsense without a sound, or hang. */
static brace_status check_same(nn_group *group, nn_weights *weights, bool gradients, brace_error *error) {
    uint64_t mine = 0xcbf29ce484222325u, first;
    for (size_t i = 0; i < nn_weights_count(weights); i++) {
        const nn_parameter *p = nn_weights_at(weights, i);
        if (takes_part(p, gradients)) {
            mine = hash(mine, p->name, strlen(p->name));
            mine = hash(mine, &p->count, sizeof p->count);
        }
    }
    first = mine;
    brace_status status = nn_group_share(group, &first, sizeof first, error);
    float different = first != mine ? 1.0f : 0.0f; /* all must know, so that none goes on */
    if (status == BRACE_OK) {
        status = nn_group_sum(group, &different, 1, error);
    }
    if (status == BRACE_OK && different > 0) {
        status = core_fail(error, BRACE_ERROR_MISMATCH,
                           "%g of %d processes have other parameters than the first; all must train the same network",
                           (double)different, group->size);
    }
    return status;
}

brace_status nn_group_sum_gradients(nn_group *group, nn_weights *weights, brace_error *error) {
    if (group->size == 1) {
        return BRACE_OK;
    }
    brace_status status = check_same(group, weights, true, error);
    /* Small parameters travel together: messages cost the same, however short they are. */
    float *room = group->room;
    size_t count = nn_weights_count(weights), item = 0, at = 0; /* the next number to be sent */
    while (status == BRACE_OK && item < count) {
        const size_t first_item = item, first_at = at;
        size_t filled = 0;
        for (int back = 0; back < 2 && status == BRACE_OK; back++) {
            item = first_item, at = first_at, filled = 0;
            while (item < count && filled < NN_GROUP_CHUNK) {
                nn_parameter *p = nn_weights_at(weights, item);
                size_t n = takes_part(p, true) ? p->count - at : 0;
                n = n < NN_GROUP_CHUNK - filled ? n : NN_GROUP_CHUNK - filled;
                if (n > 0) {
                    memcpy(back ? p->grad + at : room + filled, back ? room + filled : p->grad + at, n * sizeof *room);
                }
                filled += n;
                at += n;
                if (!takes_part(p, true) || at == p->count) {
                    item++;
                    at = 0;
                }
            }
            if (back == 0 && filled > 0) {
                status = nn_group_sum(group, room, filled, error);
            }
        }
    }
    return status;
}

brace_status nn_group_share_weights(nn_group *group, nn_weights *weights, brace_error *error) {
    if (group->size == 1) {
        return BRACE_OK;
    }
    brace_status status = check_same(group, weights, false, error);
    for (size_t i = 0; i < nn_weights_count(weights) && status == BRACE_OK; i++) {
        nn_parameter *p = nn_weights_at(weights, i);
        status = nn_group_share(group, p->value, p->count * sizeof *p->value, error);
    }
    nn_weights_changed(weights);
    return status;
}
