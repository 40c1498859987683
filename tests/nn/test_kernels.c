/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_kernels.c: every way of computing a convolution that this CPU has, and the
 * emulated AMX one, against the reference in double precision: odd sizes, single
 * pixels, channels that fill no vector, all activations; buffers that end at a
 * page that cannot be touched, so that reading one element too far is a crash.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cmocka.h>

#include "nn/kernels/kernels.h"
#include "nn/node.h"

static const nn_method amx_emulated = {"amx-emulated",       nn_native_create,        nn_native_destroy,
                                       nn_native_scratch,    nn_native_forward,       nn_native_backward_data,
                                       nn_native_backward_weights, &nn_isa_amx_emulated};

static core_pool *pools[4]; /* of 1, 2, 3 threads */

/* ---- buffers between a canary and a forbidden page ---- */

enum { MAX_BUFFERS = 64, CANARY = 64 };
static struct {
    unsigned char *map, *data;
    size_t mapped;
} buffers[MAX_BUFFERS];
static int buffer_count;

static void *buffer(size_t bytes, size_t alignment) {
    size_t page = (size_t)sysconf(_SC_PAGESIZE), room = (bytes + CANARY + page - 1) / page * page;
    unsigned char *map = mmap(NULL, room + page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    assert_true(map != MAP_FAILED);
    assert_int_equal(mprotect(map + room, page, PROT_NONE), 0);
    unsigned char *data = map + room - (bytes + alignment - 1) / alignment * alignment;
    memset(map, 0xa5, room); /* as floats -2.9e-16, as bf16 as well: not zero, so that what is not written shows */
    assert_true(buffer_count < MAX_BUFFERS);
    buffers[buffer_count].map = map;
    buffers[buffer_count].data = data;
    buffers[buffer_count++].mapped = room + page;
    return data;
}

static void free_buffers(void) {
    for (int i = 0; i < buffer_count; i++) {
        for (const unsigned char *p = buffers[i].map; p < buffers[i].data; p++) {
            assert_int_equal(*p, 0xa5);
        }
        munmap(buffers[i].map, buffers[i].mapped);
    }
    buffer_count = 0;
}

/* ---- numbers ---- */

static core_random rng;

static int between(int low, int high) {
    return low + (int)core_random_below(&rng, (uint32_t)(high - low + 1));
}

static double get(const void *p, size_t i, nn_type type) {
    return type == NN_F64    ? ((const double *)p)[i]
           : type == NN_BF16 ? (double)nn_from_bf16(((const uint16_t *)p)[i])
                             : (double)((const float *)p)[i];
}

static void put(void *p, size_t i, nn_type type, double v) {
    if (type == NN_F64) {
        ((double *)p)[i] = v;
    } else if (type == NN_BF16) {
        ((uint16_t *)p)[i] = nn_to_bf16((float)v);
    } else {
        ((float *)p)[i] = (float)v;
    }
}

/* A tensor three times: as the method sees it, in double, and its magnitudes in double. */
typedef struct tensor {
    size_t count;
    nn_type type;
    void *data;
    double *exact, *size;
} tensor;

static tensor make(size_t count, nn_type type, nn_type rounded) {
    tensor t = {count, type, buffer(count * nn_type_size(type), nn_type_size(type)), buffer(count * 8, 8),
                buffer(count * 8, 8)};
    for (size_t i = 0; i < count; i++) {
        put(t.data, i, type, core_random_range(&rng, -1, 1));
        /* What bf16 kernels make of f32 weights. */
        t.exact[i] = rounded == NN_BF16 ? (double)nn_from_bf16(nn_to_bf16((float)get(t.data, i, type)))
                                        : get(t.data, i, type);
        t.size[i] = fabs(t.exact[i]);
    }
    return t;
}

/* `got` within the rounding of sums of magnitude `size`. */
static void compare(const char *what, const nn_method *method, const nn_conv_shape *s, const void *got, nn_type type,
                    const double *want, const double *size, size_t count, double relative) {
    for (size_t i = 0; i < count; i++) {
        double v = get(got, i, type), bound = relative * (size[i] + fabs(want[i])) + (type == NN_BF16 ? fabs(want[i]) / 250 : 0);
        if (!(fabs(v - want[i]) <= bound)) {
            fail_msg("%s of %s: element %zu is %.9g and should be %.9g (n %d, %d x %d x %d, out %d, kernel %d, stride %d, "
                     "pad %d)",
                     what, method->name, i, v, want[i], s->n, s->h, s->w, s->c, s->out, s->kernel, s->stride, s->pad);
        }
    }
}

typedef struct convolution {
    nn_conv_shape s;
    nn_conv_types types;
    bool add;
    int threads;
} convolution;

static void *scratch_of(const nn_method *method, const void *state, nn_product product, int threads) {
    return buffer(method->scratch(state, product, threads), 64);
}

/* What one method makes of the same tensors; `before` is what stood in its results. */
typedef struct tensors {
    tensor x, w, bias, r, y, dz, dx, dw;
} tensors;

static nn_conv_pass pass_of(const convolution *c, const tensors *t, bool exact, bool size) {
#define OF(v) (exact ? (void *)(t->v).exact : size ? (void *)(t->v).size : (t->v).data)
    return (nn_conv_pass){.x = OF(x),
                          .weight = OF(w),
                          .version = 1,
                          .bias = c->types.bias ? OF(bias) : NULL,
                          .residual = c->types.residual ? OF(r) : NULL,
                          .activation = size ? NN_LINEAR : c->types.activation,
                          .y = OF(y),
                          .dz = OF(dz),
                          .dx = OF(dx),
                          .add = c->add,
                          .dw = OF(dw)};
#undef OF
}

static void run_method(const nn_method *method, const convolution *c, const tensors *t) {
    void *state;
    brace_error error;
    assert_int_equal(method->create(&state, method, &c->s, c->types, true, c->threads, &error), BRACE_OK);
    nn_conv_pass pass = pass_of(c, t, false, false);
    pass.pool = pools[c->threads];
    pass.scratch = scratch_of(method, state, NN_PRODUCT_FORWARD, c->threads);
    method->forward(state, &pass);
    pass.scratch = scratch_of(method, state, NN_PRODUCT_DATA, c->threads);
    method->backward_data(state, &pass);
    pass.scratch = scratch_of(method, state, NN_PRODUCT_WEIGHTS, c->threads);
    method->backward_weights(state, &pass);
    method->destroy(state);
}

static void run(const nn_method *const *methods, int count, const convolution *c) {
    const nn_conv_shape *s = &c->s;
    size_t nx = (size_t)s->n * (size_t)s->h * (size_t)s->w * (size_t)s->c;
    size_t ny = (size_t)s->n * (size_t)s->oh * (size_t)s->ow * (size_t)s->out;
    size_t nw = (size_t)s->out * (size_t)s->c * (size_t)s->kernel * (size_t)s->kernel;
    nn_type in = c->types.in, result = c->types.result, parameter = in == NN_F64 ? NN_F64 : NN_F32;
    double relative = in == NN_F64 ? 1e-13 : 3e-6;
    tensors t = {make(nx, in, in),         make(nw, parameter, in), make((size_t)s->out, parameter, parameter),
                 make(ny, result, result), make(ny, result, result), make(ny, in, in),
                 make(nx, in, in),         make(nw, parameter, parameter)};
    const tensor *results[] = {&t.y, &t.dx, &t.dw};
    void *before[3];
    for (int i = 0; i < 3; i++) {
        size_t bytes = results[i]->count * nn_type_size(results[i]->type);
        before[i] = memcpy(buffer(bytes, 8), results[i]->data, bytes);
    }

    /* In double; then magnitudes, whose sums say what rounding may cost. */
    void *exact;
    nn_conv_types f64 = {.in = NN_F64, .result = NN_F64};
    assert_int_equal(nn_method_ref.create(&exact, &nn_method_ref, s, f64, true, 1, NULL), BRACE_OK);
    void *scratch = scratch_of(&nn_method_ref, exact, NN_PRODUCT_FORWARD, 1);
    for (int i = 0; i < 2; i++) {
        nn_conv_pass pass = pass_of(c, &t, i == 0, i == 1);
        pass.scratch = scratch;
        nn_method_ref.forward(exact, &pass);
        nn_method_ref.backward_data(exact, &pass);
        nn_method_ref.backward_weights(exact, &pass);
    }
    nn_method_ref.destroy(exact);

    for (int m = 0; m < count; m++) {
        for (int i = 0; i < 3; i++) {
            memcpy(results[i]->data, before[i], results[i]->count * nn_type_size(results[i]->type));
        }
        run_method(methods[m], c, &t);
        compare("forward", methods[m], s, t.y.data, result, t.y.exact, t.y.size, ny, relative);
        compare("backward_data", methods[m], s, t.dx.data, in, t.dx.exact, t.dx.size, nx, relative);
        compare("backward_weights", methods[m], s, t.dw.data, parameter, t.dw.exact, t.dw.size, nw, relative);
    }
    free_buffers();
}

static nn_conv_shape shape(int n, int h, int w, int c, int out, int kernel, int stride, int pad) {
    return (nn_conv_shape){n,   h,      w,      c,  (h + 2 * pad - kernel) / stride + 1, (w + 2 * pad - kernel) / stride + 1,
                           out, kernel, stride, pad};
}

static void with_each_method(convolution *c, nn_type in) {
    const nn_method *methods[NN_MAX_METHODS + 1];
    int count = nn_methods(in, methods);
    if (in == NN_BF16) {
        methods[count++] = &amx_emulated;
    }
    c->types.in = c->types.result = in;
    run(methods, count, c);
    if (in == NN_BF16) {
        c->types.result = NN_F32;
        run(methods, count, c);
    }
}

static void chosen_shapes(nn_type in) {
    static const int list[][8] = {
        /* n  h   w   c   out k  s  p */
        {1, 1, 1, 1, 1, 1, 1, 0},     {1, 1, 1, 3, 5, 3, 1, 1},    {2, 1, 1, 64, 64, 3, 1, 1},  {1, 5, 1, 33, 4, 3, 1, 1},
        {1, 1, 37, 8, 64, 3, 1, 1},   {1, 13, 17, 64, 64, 3, 1, 1}, {1, 9, 14, 64, 4, 3, 1, 1},  {1, 7, 33, 16, 216, 3, 1, 1},
        {1, 10, 31, 192, 64, 3, 1, 1}, {2, 9, 11, 3, 33, 7, 1, 3},  {1, 8, 15, 33, 8, 7, 1, 3},   {3, 6, 29, 48, 40, 1, 1, 0},
        {1, 1, 5, 64, 64, 1, 1, 0},   {1, 16, 32, 32, 32, 1, 1, 0}, {1, 12, 200, 16, 17, 3, 1, 1}, {1, 14, 14, 5, 6, 7, 2, 2},
        {1, 9, 9, 20, 18, 1, 2, 0},   {1, 11, 13, 12, 10, 3, 2, 0}, {1, 35, 35, 3, 20, 11, 4, 2}, {1, 8, 8, 6, 7, 5, 1, 2},
        {1, 9, 9, 31, 32, 3, 1, 0},   {1, 4, 4, 2, 2, 4, 1, 0},     {1, 70, 40, 9, 16, 3, 1, 1}, {1, 48, 70, 24, 12, 3, 1, 1},
        {1, 9, 20, 300, 40, 1, 1, 0}, {1, 23, 31, 50, 33, 3, 2, 1},
    };
    for (size_t i = 0; i < sizeof list / sizeof *list; i++) {
        const int *v = list[i];
        convolution c = {.s = shape(v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7]),
                         .types = {.activation = (nn_activation)(i % 5), .bias = i % 3 != 0, .residual = i % 2 != 0},
                         .add = i % 4 == 1,
                         .threads = 1 + (int)(i % 3)};
        with_each_method(&c, in);
    }
}

static void random_shapes(nn_type in) {
    for (int i = 0; i < (in == NN_BF16 ? 20 : 40); i++) { /* what emulates AMX is slow */
        int kernel = between(1, 5), stride = between(0, 3) == 0 ? between(2, 3) : 1, pad = between(0, kernel - 1);
        int low = kernel > 2 * pad ? kernel - 2 * pad : 1;
        convolution c = {.s = shape(between(1, 2), between(low, 14), between(low, 40), between(1, 40), between(1, 40),
                                    kernel, stride, pad),
                         .types = {.activation = (nn_activation)between(0, 4),
                                   .bias = between(0, 1) != 0,
                                   .residual = between(0, 1) != 0},
                         .add = between(0, 1) != 0,
                         .threads = between(1, 3)};
        with_each_method(&c, in);
    }
}

static void test_f32(void **context) {
    (void)context;
    chosen_shapes(NN_F32);
    random_shapes(NN_F32);
}

static void test_bf16(void **context) {
    (void)context;
    chosen_shapes(NN_BF16);
    random_shapes(NN_BF16);
}

static void test_f64(void **context) {
    (void)context;
    chosen_shapes(NN_F64);
}

/* The same bytes for any number of threads; oneDNN promises that only for the same number. */
static void test_threads(void **context) {
    (void)context;
    nn_conv_shape s = shape(2, 61, 30, 24, 40, 3, 1, 1);
    size_t nx = 2 * 61 * 30 * 24, ny = 2 * 61 * 30 * 40, nw = 40 * 24 * 9;
    for (int t = 0; t < 2; t++) {
        nn_type in = t == 0 ? NN_F32 : NN_BF16;
        const nn_method *methods[NN_MAX_METHODS + 1];
        int count = nn_methods(in, methods);
        if (in == NN_BF16) {
            methods[count++] = &amx_emulated;
        }
        for (int m = 0; m < count; m++) {
            if (strcmp(methods[m]->name, "onednn") == 0) {
                continue;
            }
            tensor x = make(nx, in, in), w = make(nw, NN_F32, NN_F32), dz = make(ny, in, in);
            unsigned char *y[4], *dx[4], *dw[4];
            for (int threads = 1; threads <= 3; threads++) {
                void *state;
                assert_int_equal(methods[m]->create(&state, methods[m], &s, (nn_conv_types){.in = in, .result = in}, true, threads, NULL),
                                 BRACE_OK);
                nn_conv_pass pass = {.x = x.data, .weight = w.data, .dz = dz.data, .pool = pools[threads]};
                pass.y = y[threads] = buffer(ny * nn_type_size(in), 4);
                pass.dx = dx[threads] = buffer(nx * nn_type_size(in), 4);
                pass.dw = dw[threads] = buffer(nw * 4, 4);
                memset(pass.dw, 0, nw * 4);
                pass.scratch = scratch_of(methods[m], state, NN_PRODUCT_FORWARD, threads);
                methods[m]->forward(state, &pass);
                pass.scratch = scratch_of(methods[m], state, NN_PRODUCT_DATA, threads);
                methods[m]->backward_data(state, &pass);
                pass.scratch = scratch_of(methods[m], state, NN_PRODUCT_WEIGHTS, threads);
                methods[m]->backward_weights(state, &pass);
                methods[m]->destroy(state);
            }
            for (int threads = 2; threads <= 3; threads++) {
                assert_memory_equal(y[1], y[threads], ny * nn_type_size(in));
                assert_memory_equal(dx[1], dx[threads], nx * nn_type_size(in));
                assert_memory_equal(dw[1], dw[threads], nw * 4);
            }
            free_buffers();
        }
    }
}

/* Packed weights are made anew when the version changes, and only then. */
static void test_version(void **context) {
    (void)context;
    nn_conv_shape s = shape(1, 3, 4, 5, 6, 3, 1, 1);
    for (int t = 0; t < 2; t++) {
        nn_type in = t == 0 ? NN_F32 : NN_BF16;
        const nn_method *method = nn_method_choose(NN_AUTO, (nn_conv_types){.in = in, .result = NN_F32}, &s);
        tensor x = make(60, in, in), w = make(270, NN_F32, NN_F32), y = make(72, NN_F32, NN_F32);
        void *state;
        assert_int_equal(method->create(&state, method, &s, (nn_conv_types){.in = in, .result = NN_F32}, false, 1, NULL), BRACE_OK);
        nn_conv_pass pass = {.x = x.data, .weight = w.data, .version = 4, .y = y.data, .pool = pools[1]};
        pass.scratch = scratch_of(method, state, NN_PRODUCT_FORWARD, 1);
        method->forward(state, &pass);
        float first = ((float *)y.data)[40];
        for (int i = 0; i < 270; i++) {
            ((float *)w.data)[i] *= 2;
        }
        pass.version = 5;
        method->forward(state, &pass);
        assert_true(first != 0 && fabsf(((float *)y.data)[40] - 2 * first) <= 1e-6f * fabsf(first));
        method->destroy(state);
        free_buffers();
    }
}

/* Not a number and infinity come out where they went in; ReLU keeps NaN, as PyTorch's. */
static void test_not_finite(void **context) {
    (void)context;
    nn_conv_shape s = shape(1, 5, 40, 16, 20, 3, 1, 1);
    for (int t = 0; t < 2; t++) {
        nn_type in = t == 0 ? NN_F32 : NN_BF16;
        const nn_method *methods[NN_MAX_METHODS + 1];
        int count = nn_methods(in, methods);
        for (int m = 0; m < count; m++) {
            tensor x = make(5 * 40 * 16, in, in), w = make(20 * 16 * 9, NN_F32, NN_F32), y = make(5 * 40 * 20, in, in);
            put(x.data, (2 * 40 + 17) * 16 + 3, in, NAN);
            void *state;
            assert_int_equal(methods[m]->create(&state, methods[m], &s,
                                                (nn_conv_types){.in = in, .result = in, .activation = NN_RELU}, false, 1, NULL), BRACE_OK);
            nn_conv_pass pass = {.x = x.data, .weight = w.data, .y = y.data, .activation = NN_RELU, .pool = pools[1]};
            pass.scratch = scratch_of(methods[m], state, NN_PRODUCT_FORWARD, 1);
            methods[m]->forward(state, &pass);
            for (size_t i = 0; i < 5 * 40 * 20; i++) {
                int py = (int)(i / 20 / 40), px = (int)(i / 20 % 40);
                bool near = abs(py - 2) <= 1 && abs(px - 17) <= 1;
                if (strcmp(methods[m]->name, "onednn") != 0 || !near) { /* oneDNN's ReLU makes NaN 0 */
                    assert_int_equal(isnan(get(y.data, i, in)) != 0, near);
                }
            }
            methods[m]->destroy(state);
            free_buffers();
        }
    }
}

static void test_gradient(void **context) {
    (void)context;
    nn_type types[][2] = {{NN_F32, NN_F32}, {NN_BF16, NN_BF16}, {NN_BF16, NN_F32}, {NN_F64, NN_F64}};
    for (int t = 0; t < 4; t++) {
        for (int activation = 0; activation < 5; activation++) {
            nn_type in = types[t][0], result = types[t][1], parameter = in == NN_F64 ? NN_F64 : NN_F32;
            const size_t pixels = 700, channels = 70, count = pixels * channels;
            tensor dy = make(count, result, result), y = make(count, result, result), dz = make(count, in, in);
            tensor r = make(count, result, result), dbias = make(channels, parameter, parameter);
            put(y.data, 5, result, 0);
            nn_gradient g = {.pixels = pixels,
                             .channels = (int)channels,
                             .types = {.in = in, .result = result},
                             .activation = (nn_activation)activation,
                             .dy = dy.data,
                             .y = y.data,
                             .dz = dz.data,
                             .residual = r.data,
                             .add_residual = true,
                             .dbias = dbias.data,
                             .pool = pools[3]};
            g.scratch = buffer(nn_gradient_scratch(pixels, (int)channels), 64);
            nn_gradient_run(&g);
            for (size_t i = 0; i < count; i++) {
                double v = get(y.data, i, result), d = get(dy.data, i, result);
                d *= activation == NN_RELU         ? v > 0
                     : activation == NN_LEAKY_RELU ? (v > 0 ? 1 : 0.1)
                     : activation == NN_SIGMOID    ? v * (1 - v)
                     : activation == NN_TANH       ? 1 - v * v
                                                   : 1;
                dbias.exact[i % channels] += d;
                assert_true(fabs(get(dz.data, i, in) - d) <= (in == NN_BF16 ? fabs(d) / 250 : 1e-6));
                assert_true(fabs(get(r.data, i, result) - r.exact[i] - d) <= (result == NN_BF16 ? 0.01 : 1e-6));
            }
            for (size_t c = 0; c < channels; c++) {
                assert_true(fabs(get(dbias.data, c, parameter) - dbias.exact[c]) <= 1e-4);
            }
            free_buffers();
        }
    }
}

static void test_memory(void **context) {
    (void)context;
    nn_conv_shape s = shape(1, 8, 8, 16, 16, 3, 1, 1);
    for (int t = 0; t < 2; t++) {
        const nn_method *methods[NN_MAX_METHODS];
        int count = nn_methods(t == 0 ? NN_F32 : NN_BF16, methods);
        for (int m = 0; m < count; m++) {
            nn_type in = t == 0 ? NN_F32 : NN_BF16;
            for (long n = 1;; n++) {
                void *state = NULL;
                brace_error error;
                core_alloc_fail_after(n);
                brace_status status = methods[m]->create(&state, methods[m], &s, (nn_conv_types){.in = in, .result = in}, true, 2, &error);
                core_alloc_fail_after(0);
                if (status == BRACE_OK) {
                    assert_true(n > 1 && n < 20);
                    methods[m]->destroy(state);
                    break;
                }
                assert_int_equal(status, BRACE_ERROR_MEMORY);
            }
        }
    }
}

static int setup(void **context) {
    (void)context;
    rng = core_random_create(5, 1, 2, 3);
    for (int i = 1; i <= 3; i++) {
        brace_job job = {.threads = i};
        if (core_pool_create(&pools[i], &job, NULL) != BRACE_OK) {
            return -1;
        }
    }
    return 0;
}

static int teardown(void **context) {
    (void)context;
    for (int i = 1; i <= 3; i++) {
        core_pool_destroy(pools[i]);
    }
    return 0;
}

/* test-nn-kernels F32 BF16: what is chosen under BRACE_CPU and BRACE_NN, which are read once. */
static int check_choice(char **names) {
    int wrong = 0;
    nn_conv_shape s = shape(1, 8, 8, 4, 4, 3, 1, 1);
    for (int t = 0; t < 2; t++) {
        nn_type in = t == 0 ? NN_F32 : NN_BF16;
        const nn_method *method = nn_method_choose(NN_AUTO, (nn_conv_types){.in = in, .result = in}, &s);
#ifndef NN_HAVE_ONEDNN
        if (strcmp(names[t], "onednn") == 0) {
            continue;
        }
#endif
        if (strcmp(method->name, names[t]) != 0) {
            fprintf(stderr, "%s is chosen for %s, not %s\n", method->name, t == 0 ? "f32" : "bf16", names[t]);
            wrong = 1;
        }
    }
    return wrong;
}

int main(int argc, char **argv) {
    if (argc == 3) {
        return check_choice(&argv[1]);
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_f32),     cmocka_unit_test(test_bf16),       cmocka_unit_test(test_f64),
        cmocka_unit_test(test_threads), cmocka_unit_test(test_version),    cmocka_unit_test(test_not_finite),
        cmocka_unit_test(test_gradient), cmocka_unit_test(test_memory),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
