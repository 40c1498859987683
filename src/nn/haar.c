/* SPDX-License-Identifier: Apache-2.0 */
/*
 * haar.c: one level of the Haar wavelet transform. A block of four pixels
 *     a b
 *     c d
 * becomes (a+b+c+d)/2, (a+b-c-d)/2, (a-b+c-d)/2, (a-b-c+d)/2. The matrix is
 * symmetric and its own inverse, so backward is the same with both sides exchanged.
 */
#include "nn/chunks.h"

static const double matrix[4][4] = {
    {0.5, 0.5, 0.5, 0.5}, {0.5, 0.5, -0.5, -0.5}, {0.5, -0.5, 0.5, -0.5}, {0.5, -0.5, -0.5, 0.5}};

typedef struct haar_job {
    nn_view picture, bands;
    const nn_rows *rows;
    bool backward, add;
} haar_job;

static void haar_rows(void *arg, size_t begin, size_t end, int worker) {
    const haar_job *job = arg;
    const size_t w = (size_t)job->bands.shape.w, c = (size_t)job->picture.shape.c, bytes = c * job->rows->s_size;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        for (size_t x = 0; x < w; x++) {
            /* The rows of a picture's pairs follow one another over all pictures. */
            unsigned char *top = (unsigned char *)job->picture.data + (4 * i * w + 2 * x) * bytes;
            unsigned char *pixel[4] = {top, top + bytes, top + 2 * w * bytes, top + (2 * w + 1) * bytes};
            unsigned char *band = (unsigned char *)job->bands.data + (i * w + x) * 4 * bytes;
            const void *from[4];
            for (size_t k = 0; k < 4; k++) {
                from[k] = job->backward ? band + k * bytes : pixel[k];
            }
            for (size_t k = 0; k < 4; k++) {
                job->rows->blend(from, matrix[k], 4, job->backward ? pixel[k] : band + k * bytes, c, job->add);
            }
        }
    }
}

static void forward(nn_call *call) {
    haar_job job = {call->in[0], call->out, nn_rows_of(call->out.type), false, false};
    core_parallel(call->pool, (size_t)call->out.shape.n * (size_t)call->out.shape.h, 4, haar_rows, &job);
}

static void backward(nn_call *call) {
    if (call->din[0].data != NULL) {
        haar_job job = {call->din[0], call->dout, nn_rows_of(call->dout.type), true, call->add[0]};
        core_parallel(call->pool, (size_t)call->dout.shape.n * (size_t)call->dout.shape.h, 4, haar_rows, &job);
    }
}

static const nn_op haar_op = {.name = "haar", .forward = forward, .backward = backward};

nn_value nn_haar(nn_graph *g, nn_value x) {
    if (!nn_usable(g, x)) {
        return 0;
    }
    const nn_shape s = nn_shape_of(g, x);
    if (s.h % 2 != 0 || s.w % 2 != 0 || s.c > INT32_MAX / 4) {
        return nn_reject(g, "haar: %s has no even sides", nn_text_of(s).text);
    }
    return nn_node_add(g, &(nn_node_params){.op = &haar_op,
                                            .inputs = 1,
                                            .in = &x,
                                            .shape = {s.n, s.h / 2, s.w / 2, 4 * s.c},
                                            .type = nn_type_of(g, x)});
}
