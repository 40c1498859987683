/* SPDX-License-Identifier: Apache-2.0 */
/*
 * optimizer.c: AdamW. All parameters are cut into stretches once; a step goes over them twice, for the gradient's
 * length and for the weights. Sums are made in double a stretch, and the stretches' in order.
 */
#include <math.h>
#include <string.h>

#include "nn/kernels/adamw.h"
#include "nn/optimizer_state.h"

enum { STRETCH = 16384, LANES = 16 };

nn_adamw nn_adamw_defaults(void) {
    return (nn_adamw){.beta1 = 0.9, .beta2 = 0.999, .epsilon = 1e-8, .weight_decay = 0.01};
}

static bool trained(const nn_parameter *p) {
    return p->grad != NULL && !p->frozen;
}

static brace_status check(const nn_adamw *p, brace_error *error) {
    const bool good = p->beta1 >= 0 && p->beta1 < 1 && p->beta2 >= 0 && p->beta2 < 1 && p->epsilon >= 0 &&
                      isfinite(p->epsilon) && p->weight_decay >= 0 && isfinite(p->weight_decay) && p->clip >= 0 &&
                      p->average >= 0 && p->average < 1;
    return good ? BRACE_OK
                : core_fail(error, BRACE_ERROR_ARGUMENT,
                            "AdamW with betas %g and %g, epsilon %g, decay %g, clipping at %g, averages of %g; betas "
                            "and averages must be 0 or more and less than 1, the others 0 or more",
                            p->beta1, p->beta2, p->epsilon, p->weight_decay, p->clip, p->average);
}

/* Slots and stretches; with NULL arrays only counts them and the numbers to be kept for each. */
static void lay_out(nn_optimizer *o, size_t *numbers) {
    float *at = o->memory;
    o->slot_count = o->stretch_count = *numbers = 0;
    for (size_t i = 0; i < nn_weights_count(o->weights); i++) {
        nn_parameter *p = nn_weights_at(o->weights, i);
        if (!trained(p)) {
            continue;
        }
        const size_t room = (p->count + LANES - 1) / LANES * LANES;
        if (o->slots != NULL) {
            nn_slot *s = &o->slots[o->slot_count];
            *s = (nn_slot){p, at, at + room, NULL, !o->params.spare_vectors || p->rank > 1};
            at += 2 * room;
            if (o->params.average > 0) {
                s->average = at;
                memcpy(at, p->value, p->count * sizeof *at);
                at += room;
            }
        }
        for (size_t begin = 0; begin < p->count; begin += STRETCH) {
            if (o->stretches != NULL) {
                const size_t rest = p->count - begin;
                o->stretches[o->stretch_count] =
                    (nn_stretch){o->slot_count, begin, rest < STRETCH ? rest : STRETCH};
            }
            o->stretch_count++;
        }
        o->slot_count++;
        *numbers += room * (o->params.average > 0 ? 3 : 2);
    }
}

brace_status nn_optimizer_create(nn_optimizer **out, nn_weights *weights, const nn_adamw *params, const brace_job *job,
                                 brace_error *error) {
    *out = NULL;
    brace_status status = check(params, error);
    if (status != BRACE_OK) {
        return status;
    }
    size_t numbers = 0;
    nn_optimizer *o = core_calloc(1, sizeof *o);
    if (o == NULL) {
        return core_fail_memory(error, sizeof *o, "the optimizer");
    }
    o->params = *params;
    o->weights = weights;
    lay_out(o, &numbers);
    if (o->slot_count == 0) {
        nn_optimizer_destroy(o);
        return core_fail(error, BRACE_ERROR_ARGUMENT, "there is nothing to train: no parameter has a gradient");
    }
    o->memory = core_calloc(numbers, sizeof *o->memory);
    o->slots = core_calloc(o->slot_count, sizeof *o->slots);
    o->stretches = core_calloc(o->stretch_count, sizeof *o->stretches);
    o->squares = core_calloc(o->stretch_count, sizeof *o->squares);
    if (o->memory == NULL || o->slots == NULL || o->stretches == NULL || o->squares == NULL) {
        nn_optimizer_destroy(o);
        return core_fail_memory(error, numbers * sizeof *o->memory, "the optimizer");
    }
    lay_out(o, &numbers);
    status = core_pool_create(&o->pool, job, error);
    if (status != BRACE_OK) {
        nn_optimizer_destroy(o);
        return status;
    }
    *out = o;
    return BRACE_OK;
}

void nn_optimizer_destroy(nn_optimizer *o) {
    if (o != NULL) {
        core_pool_destroy(o->pool);
        core_free(o->memory);
        core_free(o->slots);
        core_free(o->stretches);
        core_free(o->squares);
        core_free(o);
    }
}

/* ---- a step ---- */

static void sum_squares(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    nn_optimizer *o = arg;
    for (size_t k = begin; k < end; k++) {
        const nn_stretch s = o->stretches[k];
        const float *g = o->slots[s.slot].parameter->grad + s.begin;
        double sums[LANES] = {0}; /* as many as a vector has, in plain sight of the compiler */
        size_t i = 0;
        for (; i + LANES <= s.count; i += LANES) {
            for (size_t j = 0; j < LANES; j++) {
                sums[j] += (double)g[i + j] * (double)g[i + j];
            }
        }
        for (; i < s.count; i++) {
            sums[0] += (double)g[i] * (double)g[i];
        }
        for (size_t j = 1; j < LANES; j++) {
            sums[0] += sums[j];
        }
        o->squares[k] = sums[0];
    }
}

typedef struct update_run {
    nn_optimizer *o;
    nn_adamw_row row; /* without its arrays */
    float keep;       /* where weights decay */
    void (*run)(const nn_adamw_row *row, size_t n);
} update_run;

static void update(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const update_run *u = arg;
    for (size_t k = begin; k < end; k++) {
        const nn_stretch s = u->o->stretches[k];
        const nn_slot *slot = &u->o->slots[s.slot];
        nn_adamw_row row = u->row;
        row.value = slot->parameter->value + s.begin;
        row.grad = slot->parameter->grad + s.begin;
        row.moment1 = slot->moment1 + s.begin;
        row.moment2 = slot->moment2 + s.begin;
        row.average = slot->average != NULL ? slot->average + s.begin : NULL;
        row.keep = slot->decays ? u->keep : 1;
        u->run(&row, s.count);
    }
}

static void forget_gradients(nn_optimizer *o) {
    for (size_t i = 0; i < o->slot_count; i++) {
        memset(o->slots[i].parameter->grad, 0, o->slots[i].parameter->count * sizeof(float));
    }
}

void nn_optimizer_step(nn_optimizer *o, double rate, double scale, nn_step_report *report) {
    const nn_adamw *p = &o->params;
    double squares = 0;
    core_parallel(o->pool, o->stretch_count, 1, sum_squares, o);
    for (size_t k = 0; k < o->stretch_count; k++) {
        squares += o->squares[k];
    }
    const double norm = sqrt(squares) * fabs(scale);
    if (report != NULL) {
        *report = (nn_step_report){norm, !isfinite(norm)};
    }
    if (!isfinite(norm)) {
        o->skipped++;
        forget_gradients(o);
        return;
    }
    if (p->clip > 0 && p->clip < norm + 1e-6) { /* PyTorch's 1e-6 */
        scale *= p->clip / (norm + 1e-6);
    }
    o->steps++;
    const double t = (double)o->steps;
    update_run u = {.o = o,
                    .row = {.scale = (float)scale,
                            .beta1 = (float)p->beta1,
                            .rest1 = (float)(1 - p->beta1),
                            .beta2 = (float)p->beta2,
                            .rest2 = (float)(1 - p->beta2),
                            .root = (float)sqrt(1 - pow(p->beta2, t)),
                            .epsilon = (float)p->epsilon,
                            .pace = (float)(rate / (1 - pow(p->beta1, t))),
                            .stay = (float)p->average,
                            .move = (float)(1 - p->average)},
                    .keep = (float)(1 - rate * p->weight_decay),
                    .run = nn_adamw_plain};
#if defined(__x86_64__)
    const core_cpu cpu = core_cpu_features();
    u.run = cpu.avx512 ? nn_adamw_avx512 : cpu.avx2 ? nn_adamw_avx2 : nn_adamw_plain;
#endif
    core_parallel(o->pool, o->stretch_count, 1, update, &u);
    for (size_t i = 0; i < o->slot_count; i++) {
        o->slots[i].parameter->version++;
    }
}

uint64_t nn_optimizer_steps(const nn_optimizer *o) {
    return o->steps;
}

uint64_t nn_optimizer_skipped(const nn_optimizer *o) {
    return o->skipped;
}

void nn_optimizer_swap(nn_optimizer *o) {
    for (size_t i = 0; i < o->slot_count; i++) {
        nn_parameter *p = o->slots[i].parameter;
        float *average = o->slots[i].average;
        for (size_t k = 0; average != NULL && k < p->count; k++) {
            const float v = p->value[k];
            p->value[k] = average[k];
            average[k] = v;
        }
        p->version++;
    }
}
