/* SPDX-License-Identifier: Apache-2.0 */
/* schedule.c: learning rates: pure functions of the step, so that nothing of them needs to be saved. */
#include <math.h>

#include "nn/optimizer.h"

double nn_schedule_rate(const nn_schedule *s, uint64_t step) {
    const double pi = 3.14159265358979323846;
    if (step < s->warmup) {
        return s->rate * (double)(step + 1) / (double)s->warmup;
    }
    const uint64_t t = step - s->warmup;
    switch (s->kind) {
    case NN_RATE_COSINE: {
        const uint64_t length = s->steps > s->warmup ? s->steps - s->warmup : 0;
        return t >= length ? s->floor
                           : s->floor + 0.5 * (s->rate - s->floor) * (1 + cos(pi * (double)t / (double)length));
    }
    case NN_RATE_STEPS:
        return s->period > 0 ? s->rate * pow(s->factor, (double)(t / s->period)) : s->rate;
    case NN_RATE_CONSTANT:
        break;
    }
    return s->rate;
}
