/* SPDX-License-Identifier: Apache-2.0 */
/*
 * optimizer.h: from gradients to better weights. Internal.
 *
 *     nn_graph_plan(g, &(nn_plan_params){.loss = loss}, error);
 *     nn_adamw how = nn_adamw_defaults();
 *     nn_optimizer_create(&o, weights, &how, job, error);     // after the plan, which makes the gradients
 *     for (each batch) {
 *         nn_forward(g, error), nn_backward(g, 1, error);     // several times, to add gradients up
 *         nn_optimizer_step(o, nn_schedule_rate(&schedule, nn_optimizer_steps(o)), 1, NULL);
 *     }
 *
 * AdamW (Loshchilov, Hutter: Decoupled Weight Decay Regularization; ICLR 2019) as
 * torch.optim.AdamW has it. With t the step from 1, r the learning rate, w the decay:
 *
 *     p <- (1 - r w) p
 *     m <- b1 m + (1 - b1) g            v <- b2 v + (1 - b2) g^2
 *     p <- p - r/(1 - b1^t) m / (sqrt(v)/sqrt(1 - b2^t) + epsilon)
 *
 * Parameters, moments and averages are f32 whatever the graph computes in: these are
 * the master weights of bf16. Gradients are f32 sums of bf16 values, which have f32's
 * range, so they neither vanish nor overflow as f16's do, and the loss needs no
 * scaling. A step whose gradient is not finite all the same is left out and counted.
 *
 * Every instruction set and any number of threads give the same bytes.
 */
#ifndef NN_OPTIMIZER_H
#define NN_OPTIMIZER_H

#include "nn/nn.h"

/* ---- AdamW (optimizer.c) ---- */

typedef struct nn_adamw {
    double beta1, beta2, epsilon, weight_decay;
    bool spare_vectors; /* no decay of parameters with one dimension or none: biases, scales */
    double clip;        /* the longest gradient of all parameters together, as clip_grad_norm_; 0: any */
    double average;     /* averages <- average averages + (1 - average) p, after each step; 0: none are kept */
} nn_adamw;

nn_adamw nn_adamw_defaults(void); /* PyTorch's: 0.9, 0.999, 1e-8, 0.01; no clipping, no averages */

typedef struct nn_optimizer nn_optimizer;

/* For the parameters that have gradients and are not frozen now. Averages begin as the weights. `weights` must outlive
 * it and keep its arrays. */
brace_status nn_optimizer_create(nn_optimizer **out, nn_weights *weights, const nn_adamw *params, const brace_job *job,
                                 brace_error *error);
void nn_optimizer_destroy(nn_optimizer *o); /* NULL is allowed */

typedef struct nn_step_report {
    double norm;  /* of the gradient, scaled, before it was clipped */
    bool skipped; /* it was not finite; nothing changed */
} nn_step_report;

/* One step, with the gradients times `scale` (1/n after n backward passes); they are zero afterwards. `report` may be
 * NULL. */
void nn_optimizer_step(nn_optimizer *o, double rate, double scale, nn_step_report *report);
uint64_t nn_optimizer_steps(const nn_optimizer *o);   /* those that were not skipped */
uint64_t nn_optimizer_skipped(const nn_optimizer *o);

/* Exchanges weights and averages: to validate or save the averages, and again to go on. Does nothing without them. */
void nn_optimizer_swap(nn_optimizer *o);

/* ---- its state as a file (optimizer_file.c) ---- */

/* safetensors, written atomically: "weights.NAME", "moment1.NAME", "moment2.NAME", "average.NAME" in f32 and the
 * number of steps. A run that goes on from it makes the same bytes as one that was never stopped. `metadata`: key,
 * text, ..., NULL; may be NULL. Not while swapped. */
brace_status nn_optimizer_save(const nn_optimizer *o, const char *path, const char *const *metadata,
                               brace_error *error);
/* The weights too. Nothing is changed on an error. */
brace_status nn_optimizer_load(nn_optimizer *o, const char *path, brace_error *error);

/* ---- learning rates as functions of the step from 0 (schedule.c) ---- */

typedef enum nn_schedule_kind {
    NN_RATE_CONSTANT,
    NN_RATE_COSINE, /* falls to `floor` at `steps`: torch.optim.lr_scheduler.CosineAnnealingLR after the warm-up */
    NN_RATE_STEPS   /* times `factor` every `period` steps after the warm-up: StepLR */
} nn_schedule_kind;

typedef struct nn_schedule {
    nn_schedule_kind kind;
    double rate, floor, factor;
    uint64_t warmup; /* steps in which the rate rises in a straight line: rate/warmup, 2 rate/warmup, ..., rate */
    uint64_t steps, period;
} nn_schedule;

double nn_schedule_rate(const nn_schedule *schedule, uint64_t step);

#endif
