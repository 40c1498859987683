/* SPDX-License-Identifier: Apache-2.0 */
/* choose.c: which methods this CPU has, found out once, and which of them computes a convolution. */
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#if defined(__x86_64__)
#include <cpuid.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif

#include "nn/kernels/kernels.h"

#define NATIVE(isa)                                                                                                    \
    const nn_method nn_method_##isa = {#isa,                                                                           \
                                       nn_native_create,                                                               \
                                       nn_native_destroy,                                                              \
                                       nn_native_scratch,                                                              \
                                       nn_native_forward,                                                              \
                                       nn_native_backward_data,                                                        \
                                       nn_native_backward_weights,                                                     \
                                       &nn_isa_##isa};
#if defined(__x86_64__)
NATIVE(avx2)
NATIVE(avx512)
NATIVE(avx512bf16)
NATIVE(amx)
#endif

static struct {
    const nn_method *f32, *bf16, *onednn; /* NULL: none */
    const nn_method *all[NN_MAX_METHODS];
    int count;
    const nn_method *forced;
} table;

#if defined(__x86_64__)
/* Linux keeps the tile registers from processes that do not ask for them (Documentation/arch/x86/xstate.rst). */
static bool ask_for_tiles(void) {
    enum { ARCH_REQ_XCOMP_PERM = 0x1023, XFEATURE_XTILEDATA = 18 };
    return syscall(SYS_arch_prctl, ARCH_REQ_XCOMP_PERM, XFEATURE_XTILEDATA) == 0;
}

static void find_bf16(bool *avx512bf16, bool *amx) {
    unsigned a, b, c, d;
    *avx512bf16 = __get_cpuid_count(7, 1, &a, &b, &c, &d) != 0 && (a >> 5 & 1) != 0;
    /* AMX-BF16 is bit 22, AMX-TILE 24. The kernels round with AVX512-BF16, which every CPU with AMX has. */
    *amx = *avx512bf16 && __get_cpuid_count(7, 0, &a, &b, &c, &d) != 0 && (d >> 22 & 5) == 5 && ask_for_tiles();
}
#endif

static void add(const nn_method *method) {
    table.all[table.count++] = method;
}

static void fill(void) {
    add(&nn_method_ref);
#if defined(__x86_64__)
    core_cpu cpu = core_cpu_features();
    bool avx512bf16 = false, amx = false;
    const char *limit = getenv("BRACE_CPU");
    if (cpu.avx512 && (limit == NULL || strcmp(limit, "avx512") != 0)) {
        find_bf16(&avx512bf16, &amx);
    }
    if (cpu.avx2) {
        add(table.f32 = &nn_method_avx2);
    }
    if (cpu.avx512) {
        add(table.f32 = &nn_method_avx512);
    }
    if (avx512bf16) {
        add(table.bf16 = &nn_method_avx512bf16);
    }
    if (amx) {
        add(table.bf16 = &nn_method_amx);
    }
#endif
#ifdef NN_HAVE_ONEDNN
    add(table.onednn = &nn_method_onednn);
#endif
    const char *name = getenv("BRACE_NN");
    for (int i = 0; i < table.count && name != NULL; i++) {
        if (strcmp(name, table.all[i]->name) == 0) {
            table.forced = table.all[i];
        }
    }
}

static void fill_once(void) {
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, fill);
}

/* f32 kernels also do bf16: tiles are widened as they are staged. */
static bool can(const nn_method *method, nn_type in) {
    return method == &nn_method_ref || (in == NN_F32 && method == table.onednn) ||
           (method->isa != NULL && (in == method->isa->in || (in == NN_BF16 && method->isa->in == NN_F32)));
}

int nn_methods(nn_type in, const nn_method *methods[NN_MAX_METHODS]) {
    fill_once();
    int count = 0;
    for (int i = 0; i < table.count; i++) {
        if (can(table.all[i], in)) {
            methods[count++] = table.all[i];
        }
    }
    return count;
}

bool nn_bf16_is_fast(void) {
    fill_once();
    return table.bf16 != NULL && (table.forced == NULL || (table.forced->isa != NULL && table.forced->isa->in == NN_BF16));
}

const nn_method *nn_method_choose(nn_backend backend, nn_conv_types types, const nn_conv_shape *shape) {
    fill_once();
    if (types.in == NN_F64) {
        return &nn_method_ref;
    }
    if (table.forced != NULL && can(table.forced, types.in)) {
        return table.forced;
    }
    const nn_method *native = types.in == NN_BF16 && table.bf16 != NULL ? table.bf16 : table.f32;
    switch (backend) {
    case NN_REF:
        return &nn_method_ref;
    case NN_ONEDNN:
        if (types.in == NN_F32 && table.onednn != NULL) {
            return table.onednn;
        }
        break;
    case NN_AUTO:
        /* Ours are about as fast forward and faster backward, and oneDNN's threads disturb ours. But backward of a
         * stride, which ours do on spread zeros, takes them four times as long; and plain C ten times. */
        if (types.in == NN_F32 && table.onednn != NULL && (native == NULL || shape->stride > 1)) {
            return table.onednn;
        }
        break;
    case NN_NATIVE:
        break;
    }
    return native != NULL ? native : &nn_method_ref;
}

double nn_conv_flops(const nn_conv_shape *s) {
    return 2.0 * s->n * s->oh * s->ow * s->out * s->c * s->kernel * s->kernel;
}
