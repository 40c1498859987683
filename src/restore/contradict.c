/* SPDX-License-Identifier: Apache-2.0 */
/*
 * contradict.c: long frames that are not where they are taken to be.
 *
 * On a white page the longest frame clips nearly everywhere, so that little tells where the hand held it, and what it
 * records at the page's edge, a dark bezel, can come to lie on the page or on the bright wall below. Measuring light
 * (light.c) takes the longest frame as steady and would find that all others flicker there.
 *
 * Light that is steady during three shorter exposures, each at another time, is so during a longer one. Where three agree
 * and the longer one is much darker, it shows another place, and is not to be trusted. The next shorter one may clip: then
 * there was so much light at least. The longer one may be brighter: all three may have fallen between the pulses of the
 * light, but hardly all of them on pulses.
 */
#include <math.h>
#include <string.h>

#include "restore/internal.h"

enum { FRAMES = 4, RUN = 16 }; /* the longer frame first; pixels of a row that are judged together */

/* How far those that agree may differ, and by how much a frame is darker that contradicts them; errors come on top. */
static const double agreement = 0.1, contradiction = 0.4;

typedef struct sums {
    double light[FRAMES], variance[FRAMES];
    int count;
    bool least; /* the next shorter frame clips somewhere: its sum is the least that it can be */
} sums;

typedef struct contradict_job {
    restore_view *view[FRAMES];
} contradict_job;

/* Of the samples of a run that none of the frames clips but the next shorter one. */
static sums sums_of(const contradict_job *job, size_t first) {
    sums out = {0};
    for (size_t i = first; i < first + RUN; i++) {
        for (size_t c = 0; c < 4; c++) {
            const size_t at = 4 * i + c;
            if (job->view[0]->trust[at] < 128 || job->view[2]->trust[at] < 128 || job->view[3]->trust[at] < 128) {
                continue;
            }
            for (int k = 0; k < FRAMES; k++) {
                const restore_view *view = job->view[k];
                const double light = view->light.at[i][c];
                out.light[k] += light;
                out.variance[k] += (double)view->noise_s[c] * fmax(light, 0) + (double)view->noise_o[c];
            }
            out.count++;
            out.least |= job->view[1]->trust[at] < 128;
        }
    }
    return out;
}

static bool contradicted(const sums *s) {
    if (s->count < RUN) {
        return false;
    }
    for (int k = 2; k < FRAMES; k++) {
        const double slack = agreement * s->light[1] + 2 * sqrt(s->variance[1] + s->variance[k]);
        const double more = s->light[k] - s->light[1];
        if (more < -slack || (more > slack && !s->least)) {
            return false;
        }
    }
    /* In the dark anything agrees: what the next shorter one says is known no better than the one that confirms it. */
    const double error = sqrt(s->variance[0] + s->variance[1] + s->variance[2]);
    return s->light[1] - s->light[0] >= contradiction * s->light[1] + 6 * error;
}

static void rows(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const contradict_job *job = arg;
    const size_t width = job->view[0]->light.width;
    if (width < RUN) {
        return;
    }
    for (size_t y = begin; y < end; y++) {
        /* The last run overlaps the one before, of which it must not hear the verdict. */
        const size_t last = y * width + width - RUN;
        const sums at_edge = sums_of(job, last);
        for (size_t x = 0; x + RUN <= width; x += RUN) {
            const sums s = sums_of(job, y * width + x);
            if (contradicted(&s)) {
                memset(job->view[0]->trust + 4 * (y * width + x), 0, (size_t)4 * RUN);
            }
        }
        if (contradicted(&at_edge)) {
            memset(job->view[0]->trust + 4 * last, 0, (size_t)4 * RUN);
        }
    }
}

void restore_contradict(restore_view *views, size_t count, core_pool *pool) {
    for (size_t i = count; i-- > FRAMES - 1;) {
        if (views[i].exposure > 1.5) {
            contradict_job job = {{&views[i], &views[i - 1], &views[i - 2], &views[i - 3]}};
            core_parallel(pool, views[i].light.height, 16, rows, &job);
        }
    }
}
