/* SPDX-License-Identifier: Apache-2.0 */
/*
 * weights.c: parameters by name. What a parameter begins with depends on the seed
 * and its name alone, so that a network can be built in any order, or in parts.
 */
#include "nn/weights.h"

#include <math.h>
#include <string.h>

#include "nn/graph.h"

brace_status nn_weights_create(nn_weights **out, uint64_t seed, brace_error *error) {
    *out = core_calloc(1, sizeof **out);
    if (*out == NULL) {
        return core_fail_memory(error, sizeof **out, "weights");
    }
    (*out)->seed = seed;
    return BRACE_OK;
}

static void free_parameter(nn_parameter *p) {
    if (p != NULL) {
        core_free(p->name);
        core_free(p->value);
        core_free(p->grad);
        core_free(p->value64);
        core_free(p->grad64);
        core_free(p);
    }
}

static void free_kept(nn_kept *k) {
    if (k != NULL) {
        core_free(k->name);
        core_free(k->value);
        core_free(k);
    }
}

void nn_weights_destroy(nn_weights *weights) {
    if (weights == NULL) {
        return;
    }
    for (size_t i = 0; i < weights->count; i++) {
        free_parameter(weights->items[i]);
    }
    for (nn_kept *k = weights->kept; k != NULL;) {
        nn_kept *next = k->next;
        free_kept(k);
        k = next;
    }
    core_free((void *)weights->items);
    core_free(weights->complete);
    core_free(weights);
}

size_t nn_weights_count(const nn_weights *weights) {
    return weights->count;
}

nn_parameter *nn_weights_at(nn_weights *weights, size_t index) {
    return index < weights->count ? weights->items[index] : NULL;
}

nn_parameter *nn_weights_find(nn_weights *weights, const char *name) {
    for (size_t i = 0; i < weights->count; i++) {
        if (strcmp(weights->items[i]->name, name) == 0) {
            return weights->items[i];
        }
    }
    return NULL;
}

void nn_weights_changed(nn_weights *weights) {
    for (size_t i = 0; i < weights->count; i++) {
        weights->items[i]->version++;
    }
}

void nn_weights_zero_grad(nn_weights *weights) {
    for (size_t i = 0; i < weights->count; i++) {
        nn_parameter *p = weights->items[i];
        if (p->grad != NULL) {
            memset(p->grad, 0, p->count * sizeof *p->grad);
        }
        if (p->grad64 != NULL) {
            memset(p->grad64, 0, p->count * sizeof *p->grad64);
        }
    }
}

bool nn_same_shape(int rank_a, const int *a, int rank_b, const int *b) {
    for (int i = 0; i < rank_a && rank_a == rank_b; i++) {
        if (a[i] != b[i]) {
            return false;
        }
    }
    return rank_a == rank_b;
}

const char *nn_shape_text(char *text, size_t size, int rank, const int *shape) {
    size_t used = 0;
    snprintf(text, size, "a number");
    for (int i = 0; i < rank && used < size; i++) {
        used += (size_t)snprintf(text + used, size - used, "%s%d", i > 0 ? " x " : "", shape[i]);
    }
    return text;
}

/* ---- values given before they are asked for ---- */

brace_status nn_weights_give(nn_weights *weights, const char *name, int rank, const int *shape, const float *values,
                             brace_error *error) {
    char a[64], b[64];
    size_t count = 1;
    for (int i = 0; i < rank && rank <= NN_RANK_MAX; i++) {
        if (shape[i] < 0 || __builtin_mul_overflow(count, (size_t)shape[i], &count)) {
            rank = NN_RANK_MAX + 1;
        }
    }
    if (rank < 0 || rank > NN_RANK_MAX) {
        return core_fail(error, BRACE_ERROR_UNSUPPORTED, "array '%s' has an impossible shape for weights", name);
    }
    nn_parameter *p = nn_weights_find(weights, name);
    if (p != NULL) {
        if (!nn_same_shape(rank, shape, p->rank, p->shape)) {
            return core_fail(error, BRACE_ERROR_MISMATCH, "array '%s' is %s, but the network has %s there", name,
                             nn_shape_text(a, sizeof a, rank, shape), nn_shape_text(b, sizeof b, p->rank, p->shape));
        }
        memcpy(p->value, values, count * sizeof *values);
        for (size_t i = 0; p->value64 != NULL && i < count; i++) {
            p->value64[i] = (double)values[i];
        }
        p->version++;
        return BRACE_OK;
    }
    nn_kept *k = core_calloc(1, sizeof *k);
    if (k != NULL) {
        k->name = core_strdup(name);
        k->value = core_alloc(count, sizeof *k->value);
    }
    if (k == NULL || k->name == NULL || k->value == NULL) {
        free_kept(k);
        return core_fail_memory(error, count * sizeof(float), "weights");
    }
    k->rank = rank;
    for (int i = 0; i < rank; i++) {
        k->shape[i] = shape[i];
    }
    k->count = count;
    memcpy(k->value, values, count * sizeof *values);
    k->next = weights->kept; /* the last one given counts */
    weights->kept = k;
    return BRACE_OK;
}

static nn_kept *take_kept(nn_weights *weights, const char *name) {
    for (nn_kept **at = &weights->kept; *at != NULL; at = &(*at)->next) {
        if (strcmp((*at)->name, name) == 0) {
            nn_kept *k = *at;
            *at = k->next;
            return k;
        }
    }
    return NULL;
}

/* ---- parameters ---- */

/* FNV-1a (Fowler, Noll, Vo), 64 bit. */
static uint64_t hash(const char *text) {
    uint64_t h = 0xcbf29ce484222325u;
    for (const unsigned char *p = (const unsigned char *)text; *p != '\0'; p++) {
        h = (h ^ *p) * 0x100000001b3u;
    }
    return h;
}

static void initialize(const nn_weights *weights, nn_parameter *p, nn_init init, int fan_in) {
    const uint64_t h = hash(p->name);
    core_random r = core_random_create(weights->seed, (uint32_t)h, (uint32_t)(h >> 32), 0x70617261u);
    const double inverse = 1 / (double)(fan_in > 0 ? fan_in : 1), bound = sqrt(inverse);
    const double deviation = sqrt(2 * inverse) * (init == NN_INIT_HE_FAN_IN_TENTH ? 0.1 : 1);
    for (size_t i = 0; i < p->count; i++) {
        switch (init) {
        case NN_INIT_ZERO:
            p->value[i] = 0;
            break;
        case NN_INIT_ONE:
            p->value[i] = 1;
            break;
        case NN_INIT_UNIFORM_FAN_IN:
            p->value[i] = (float)core_random_range(&r, -bound, bound);
            break;
        case NN_INIT_HE_FAN_IN:
        case NN_INIT_HE_FAN_IN_TENTH:
            p->value[i] = (float)(deviation * core_random_normal(&r));
            break;
        }
    }
}

static nn_parameter *add_parameter(nn_weights *weights, const char *name, int rank, const int *shape, size_t count) {
    if (weights->count == weights->room) {
        size_t room = weights->room > 0 ? 2 * weights->room : 64;
        nn_parameter **items = core_calloc(room, sizeof *items);
        if (items == NULL) {
            return NULL;
        }
        if (weights->items != NULL) {
            memcpy((void *)items, (void *)weights->items, weights->count * sizeof *items);
        }
        core_free((void *)weights->items);
        weights->items = items;
        weights->room = room;
    }
    nn_parameter *p = core_calloc(1, sizeof *p);
    if (p == NULL) {
        return NULL;
    }
    p->name = core_strdup(name);
    p->value = core_alloc(count, sizeof *p->value);
    if (p->name == NULL || p->value == NULL) {
        free_parameter(p);
        return NULL;
    }
    p->rank = rank;
    for (int i = 0; i < rank; i++) {
        p->shape[i] = shape[i];
    }
    p->count = count;
    p->version = 1;
    weights->items[weights->count++] = p;
    return p;
}

nn_parameter *nn_parameter_get(nn_graph *g, const char *name, int rank, const int *shape, nn_init init, int fan_in) {
    char full[NN_SCOPE_LENGTH + 64], a[64], b[64];
    size_t count = 1;
    bool possible = rank >= 0 && rank <= NN_RANK_MAX;
    for (int i = 0; possible && i < rank; i++) {
        possible = shape[i] > 0 && !__builtin_mul_overflow(count, (size_t)shape[i], &count);
    }
    if (g->error.status != BRACE_OK) {
        return NULL;
    }
    if (!possible || count > (size_t)1 << 40) {
        nn_reject(g, "%s: a parameter of an impossible shape", name);
        return NULL;
    }
    const int n = snprintf(full, sizeof full, "%s%s%s", g->scope, g->scope[0] != '\0' ? "." : "", name);
    if (n < 0 || (size_t)n >= sizeof full) {
        nn_reject(g, "the name of a parameter is too long");
        return NULL;
    }
    nn_parameter *p = nn_weights_find(g->weights, full);
    if (p != NULL) {
        if (!nn_same_shape(rank, shape, p->rank, p->shape)) {
            nn_reject(g, "%s is %s already, and %s here", name, nn_shape_text(a, sizeof a, p->rank, p->shape),
                      nn_shape_text(b, sizeof b, rank, shape));
            return NULL;
        }
        return p;
    }
    nn_kept *kept = take_kept(g->weights, full);
    if (kept != NULL && !nn_same_shape(rank, shape, kept->rank, kept->shape)) {
        nn_fail(g, BRACE_ERROR_MISMATCH, "%s is %s in the file, and %s in the network", name,
                nn_shape_text(a, sizeof a, kept->rank, kept->shape), nn_shape_text(b, sizeof b, rank, shape));
    } else if (kept == NULL && g->weights->complete != NULL) {
        nn_fail(g, BRACE_ERROR_MISMATCH, "%s is not in %s", name, g->weights->complete);
    } else {
        p = add_parameter(g->weights, full, rank, shape, count);
        if (p == NULL) {
            nn_fail(g, BRACE_ERROR_MEMORY, "out of memory for the parameter %s", name);
        } else if (kept != NULL) {
            memcpy(p->value, kept->value, count * sizeof *p->value);
        } else {
            initialize(g->weights, p, init, fan_in);
        }
    }
    free_kept(kept);
    return p;
}

brace_status nn_parameter_prepare(nn_parameter *p, nn_type type, bool training, brace_error *error) {
    if (type == NN_F64) {
        if (p->value64 == NULL && (p->value64 = core_alloc(p->count, sizeof *p->value64)) == NULL) {
            return core_fail_memory(error, p->count * sizeof *p->value64, "weights");
        }
        for (size_t i = 0; i < p->count; i++) {
            p->value64[i] = (double)p->value[i];
        }
        if (training && p->grad64 == NULL && (p->grad64 = core_calloc(p->count, sizeof *p->grad64)) == NULL) {
            return core_fail_memory(error, p->count * sizeof *p->grad64, "gradients");
        }
    } else if (training && p->grad == NULL && (p->grad = core_calloc(p->count, sizeof *p->grad)) == NULL) {
        return core_fail_memory(error, p->count * sizeof *p->grad, "gradients");
    }
    return BRACE_OK;
}
