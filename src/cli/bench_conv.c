/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_conv.c: brace bench conv: GFLOP/s of convolutions, each way that there is
 * of computing them, beside what the multipliers do when nothing keeps them from it.
 *
 * The fastest of several runs counts: others who use the machine make runs slower,
 * never faster. One thread is measured by its CPU time, several by the clock.
 */
#include "cli/bench.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "nn/kernels/kernels.h"
#include "nn/node.h"

static const char command[] = "bench conv";

enum { PASSES = 3, MAX_COLUMNS = 2 * NN_MAX_METHODS };
static const char *const pass_names[PASSES] = {"forward", "backward_data", "backward_weights"};

/* A column of the tables: a method and what it computes with. */
typedef struct bench_column {
    const nn_method *method;
    nn_type type;
    double peak; /* GFLOP/s; NAN: not known */
} bench_column;

typedef struct bench_case {
    int c, out, w, h;
    double rate[PASSES][MAX_COLUMNS]; /* GFLOP/s; NAN: not measured */
} bench_case;

typedef struct conv_bench {
    const brace_job *job;
    core_pool *pool;
    double seconds; /* to repeat a measurement for */
    int least;
    bench_column columns[MAX_COLUMNS];
    int column_count;
    bench_case *cases;
    int case_count;
} conv_bench;

/* ---- measuring ---- */

typedef struct pass_run {
    const nn_method *method;
    void *state;
    nn_conv_pass pass;
    int which;
} pass_run;

static void run_pass(const pass_run *r) {
    (r->which == 0   ? r->method->forward
     : r->which == 1 ? r->method->backward_data
                     : r->method->backward_weights)(r->state, &r->pass);
}

static double seconds(const conv_bench *b) {
    return core_pool_threads(b->pool) == 1 ? bench_seconds() : core_seconds();
}

static double fastest(const conv_bench *b, const pass_run *r) {
    double best = INFINITY, total = 0;
    run_pass(r); /* memory and caches warm up, weights are packed */
    for (int i = 0; i < b->least || total < b->seconds; i++) {
        double begin = seconds(b);
        run_pass(r);
        double time = seconds(b) - begin;
        best = time < best ? time : best;
        total += time;
    }
    return best;
}

typedef struct peak_run {
    const nn_isa *isa;
    long rounds;
} peak_run;

static void peak_piece(void *arg, size_t begin, size_t end, int worker) {
    (void)worker;
    const peak_run *r = arg;
    for (size_t i = begin; i < end; i++) {
        r->isa->peak(r->rounds);
    }
}

/* All threads at once: processors slow down when all their cores are busy. */
static double peak_of(const conv_bench *b, const nn_isa *isa) {
    peak_run r = {isa, 20000};
    double best = 0, total = 0;
    size_t pieces = (size_t)core_pool_threads(b->pool) * 8;
    while (total < b->seconds) {
        double begin = seconds(b);
        core_parallel(b->pool, pieces, 1, peak_piece, &r);
        double time = seconds(b) - begin, flops = (double)pieces * isa->peak(r.rounds);
        best = fmax(best, flops / time * 1e-9);
        total += time;
    }
    return best;
}

static void fill(void *p, size_t count, nn_type type, core_random *rng) {
    for (size_t i = 0; i < count; i++) {
        float v = (float)core_random_range(rng, -1, 1);
        if (type == NN_BF16) {
            ((uint16_t *)p)[i] = nn_to_bf16(v);
        } else {
            ((float *)p)[i] = v;
        }
    }
}

/* A layer of a restoration network: 3x3, bias and ReLU forward; backward into a gradient that is there already. */
static brace_status bench_one(const conv_bench *b, bench_case *k, int column, brace_error *error) {
    const bench_column *col = &b->columns[column];
    nn_conv_shape s = {1, k->h, k->w, k->c, k->h, k->w, k->out, 3, 1, 1};
    int threads = core_pool_threads(b->pool);
    size_t pixels = (size_t)k->w * (size_t)k->h, size = nn_type_size(col->type);
    size_t nx = pixels * (size_t)k->c, ny = pixels * (size_t)k->out, nw = (size_t)k->out * (size_t)k->c * 9;
    core_random rng = core_random_create(1, 2, 3, 4);
    void *state = NULL, *scratch = NULL;
    void *x = core_alloc(nx, size), *y = core_alloc(ny, size), *dz = core_alloc(ny, size), *dx = core_calloc(nx, size);
    float *weight = core_alloc(nw, sizeof *weight), *dw = core_calloc(nw, sizeof *dw);
    float *bias = core_calloc((size_t)k->out, sizeof *bias);
    brace_status status = BRACE_OK;
    if (x == NULL || y == NULL || dz == NULL || dx == NULL || weight == NULL || dw == NULL || bias == NULL) {
        status = core_fail_memory(error, 2 * (nx + ny) * size, "a convolution to be measured");
        goto done;
    }
    fill(x, nx, col->type, &rng);
    fill(dz, ny, col->type, &rng);
    fill(weight, nw, NN_F32, &rng);
    status = col->method->create(&state, col->method, &s,
                                 (nn_conv_types){.in = col->type, .result = col->type, .activation = NN_RELU, .bias = true},
                                 true, threads, error);
    for (int i = 0; i < PASSES && status == BRACE_OK; i++) {
        size_t bytes = col->method->scratch(state, (nn_product)i, threads);
        scratch = core_alloc(bytes, 1);
        if (scratch == NULL) {
            status = core_fail_memory(error, bytes, "a convolution to be measured");
            break;
        }
        pass_run r = {col->method, state, {.x = x, .weight = weight, .bias = bias, .activation = NN_RELU, .y = y,
                                           .dz = dz, .dx = dx, .dw = dw, .scratch = scratch, .pool = b->pool}, i};
        k->rate[i][column] = nn_conv_flops(&s) / fastest(b, &r) * 1e-9;
        core_free(scratch);
        status = core_check_cancel(b->job, error);
    }
done:
    if (state != NULL) {
        col->method->destroy(state);
    }
    core_free(x), core_free(y), core_free(dz), core_free(dx), core_free(weight), core_free(dw), core_free(bias);
    return status;
}

static brace_status bench_all(conv_bench *b, brace_error *error) {
    brace_status status = core_pool_create(&b->pool, b->job, error);
    for (int i = 0; i < b->column_count && status == BRACE_OK; i++) {
        bench_column *col = &b->columns[i];
        col->peak = col->method->isa != NULL ? peak_of(b, col->method->isa) : NAN;
    }
    for (int i = 0; i < b->case_count && status == BRACE_OK; i++) {
        core_progress(b->job, "measuring", (uint64_t)i, (uint64_t)b->case_count);
        for (int j = 0; j < b->column_count && status == BRACE_OK; j++) {
            for (int p = 0; p < PASSES; p++) {
                b->cases[i].rate[p][j] = NAN;
            }
            /* Plain C would take minutes. */
            if (b->columns[j].method != &nn_method_ref || b->cases[i].w * b->cases[i].h <= 64 * 64) {
                status = bench_one(b, &b->cases[i], j, error);
            }
        }
    }
    if (status == BRACE_OK) {
        core_progress(b->job, "measuring", (uint64_t)b->case_count, (uint64_t)b->case_count);
    }
    core_pool_destroy(b->pool);
    return status;
}

/* ---- what comes out ---- */

static const char *type_name(nn_type type) {
    return type == NN_BF16 ? "bf16" : "f32";
}

static json_t *to_json(const conv_bench *b, int threads) {
    char processor[128];
    json_t *methods = json_array(), *cases = json_array();
    for (int j = 0; j < b->column_count; j++) {
        const bench_column *col = &b->columns[j];
        json_array_append_new(methods, json_pack("{s:s, s:s, s:o}", "method", col->method->name, "type",
                                                 type_name(col->type), "peak",
                                                 isnan(col->peak) ? json_null() : json_real(col->peak)));
    }
    for (int i = 0; i < b->case_count; i++) {
        const bench_case *k = &b->cases[i];
        json_t *row = json_pack("{s:i, s:i, s:i, s:i}", "width", k->w, "height", k->h, "in", k->c, "out", k->out);
        for (int p = 0; p < PASSES; p++) {
            json_t *rates = json_object();
            for (int j = 0; j < b->column_count; j++) {
                if (!isnan(k->rate[p][j])) {
                    char name[64];
                    snprintf(name, sizeof name, "%s %s", b->columns[j].method->name, type_name(b->columns[j].type));
                    json_object_set_new(rates, name, json_real(k->rate[p][j]));
                }
            }
            json_object_set_new(row, pass_names[p], rates);
        }
        json_array_append_new(cases, row);
    }
    return json_pack("{s:s, s:o, s:i, s:s, s:o, s:o}", "bench", "conv", "processor",
                     cli_json_text(bench_processor(processor, sizeof processor)), "threads", threads, "unit",
                     "GFLOP/s; a multiplication and an addition are two", "methods", methods, "convolutions", cases);
}

static void print_cell(double value) {
    if (isnan(value)) {
        printf(" %11s", "-");
    } else {
        printf(" %11.1f", value);
    }
}

static void print_tables(const conv_bench *b, int threads) {
    char processor[128];
    printf("%s, %d thread%s. GFLOP/s of 3x3 convolutions.\n", bench_processor(processor, sizeof processor), threads,
           threads == 1 ? "" : "s");
    for (int p = 0; p < PASSES; p++) {
        printf("\n%-26s", pass_names[p]);
        for (int j = 0; j < b->column_count; j++) {
            printf(" %11s", b->columns[j].method->name);
        }
        printf("\n%-26s", "");
        for (int j = 0; j < b->column_count; j++) {
            printf(" %11s", type_name(b->columns[j].type));
        }
        printf("\n");
        for (int i = 0; i < b->case_count; i++) {
            const bench_case *k = &b->cases[i];
            printf("  %3d -> %-3d  %4d x %-4d   ", k->c, k->out, k->w, k->h);
            for (int j = 0; j < b->column_count; j++) {
                print_cell(k->rate[p][j]);
            }
            printf("\n");
        }
    }
    printf("\n%-26s", "Registers alone");
    for (int j = 0; j < b->column_count; j++) {
        print_cell(b->columns[j].peak);
    }
    printf("\n");
}

typedef struct arguments {
    bool quick, json, quiet;
    int threads, in, out, width, height; /* 0: the usual ones */
} arguments;

static int run(const arguments *a) {
    static const int channels[][2] = {{16, 16}, {32, 32}, {48, 48}, {64, 64}, {128, 128}, {192, 64}};
    static const int sizes[][2] = {{64, 64}, {128, 128}, {512, 384}};
    enum { CHANNELS = sizeof channels / sizeof *channels, SIZES = sizeof sizes / sizeof *sizes };
    bench_case cases[CHANNELS * SIZES];
    conv_bench b = {.seconds = a->quick ? 0.01 : 0.2, .least = a->quick ? 1 : 3, .cases = cases};
    for (int i = 0; i < CHANNELS; i++) {
        for (int j = 0; j < SIZES; j++) {
            bench_case k = {.c = channels[i][0], .out = channels[i][1], .w = sizes[j][0], .h = sizes[j][1]};
            bool quick = j == 0 && (i == 0 || i == 3);
            if (a->in > 0) {
                quick = i == 0;
                k.c = a->in, k.out = a->out;
            }
            if (a->width > 0) {
                quick = quick && j == 0;
                k.w = a->width, k.h = a->height;
            }
            if ((!a->quick || quick) && (a->in == 0 || i == 0) && (a->width == 0 || j == 0)) {
                cases[b.case_count++] = k;
            }
        }
    }
    for (int t = 0; t < 2; t++) {
        const nn_method *methods[NN_MAX_METHODS];
        nn_type type = t == 0 ? NN_F32 : NN_BF16;
        int count = nn_methods(type, methods);
        for (int i = 0; i < count; i++) {
            /* bf16: only what multiplies bf16; the others widen it first. */
            if (type == NN_F32 || (methods[i]->isa != NULL && methods[i]->isa->in == NN_BF16)) {
                b.columns[b.column_count++] = (bench_column){methods[i], type, NAN};
            }
        }
    }
    brace_error error = {BRACE_OK, ""};
    brace_job job;
    cli_report report;
    cli_report_begin(&report, &job, command, a->quiet, a->threads);
    b.job = &job;
    brace_status status = bench_all(&b, &error);
    cli_report_flush(&report);
    cli_report_end(&report);
    int threads = a->threads > 0 ? a->threads : core_cpu_count();
    int code = CLI_FAILED;
    if (status != BRACE_OK) {
        if (a->json) {
            cli_json_error(&error, command);
        }
        cli_error(command, "%s", error.message);
        if (status == BRACE_ERROR_CANCELLED) {
            code = cli_signals_exit();
        }
    } else if (a->json) {
        code = cli_json_print(to_json(&b, threads), command) ? CLI_DONE : CLI_FAILED;
    } else {
        print_tables(&b, threads);
        code = cli_flush(command) ? CLI_DONE : CLI_FAILED;
    }
    return code;
}

int bench_conv(int argc, char **argv) {
    arguments a = {0};
    const char *channels = NULL, *size = NULL;
    cli_list operands = {0};
    const cli_option options[] = {
        {CLI_HEADING, 0, NULL, NULL, "Options", NULL, 0, 0},
        {CLI_INT, 't', "threads", "N", "1 to 256, default: one for each CPU", &a.threads, 1, 256},
        {CLI_TEXT, 'c', "channels", "IN:OUT", "only from IN to OUT channels", &channels, 0, 0},
        {CLI_TEXT, 0, "size", "WxH", "only of pictures of this size", &size, 0, 0},
        {CLI_FLAG, 0, "quick", NULL, "few convolutions, few repetitions: rough numbers in a second", &a.quick, 0, 0},
        {CLI_FLAG, 0, "json", NULL, "print a JSON object on stdout", &a.json, 0, 0},
        {CLI_FLAG, 'q', "quiet", NULL, "no progress", &a.quiet, 0, 0},
        {CLI_HELP, 'h', "help", NULL, "this text", NULL, 0, 0},
        {.kind = CLI_END},
    };
    const cli_usage usage = {
        command, "[OPTION]...",
        "Measures convolutions, which restoration networks spend most of their time in:\n"
        "GFLOP/s forward and backward, of each way of computing them that this processor\n"
        "has, with 16 to 192 channels on pictures of three sizes. Last, what each\n"
        "instruction set does in registers alone. The fastest of several runs counts,\n"
        "of one thread its CPU time, of several the clock. BRACE_CPU leaves instruction\n"
        "sets out.",
        options,
        "Examples:\n"
        "  brace bench conv\n"
        "  brace bench conv --channels 64:64 --size 128x128 --threads 1\n"};
    int code = cli_parse(&usage, argc, argv, &operands);
    if (code < 0 && operands.count > 0) {
        code = cli_wrong_usage(command, "'%s': no argument is expected", operands.items[0]);
    }
    char rest;
    if (code < 0 && channels != NULL &&
        (sscanf(channels, "%4d:%4d%c", &a.in, &a.out, &rest) != 2 || a.in < 1 || a.out < 1)) {
        code = cli_wrong_usage(command, "--channels takes two numbers, such as 192:64, not '%s'", channels);
    }
    if (code < 0 && size != NULL &&
        (sscanf(size, "%4dx%4d%c", &a.width, &a.height, &rest) != 2 || a.width < 1 || a.height < 1)) {
        code = cli_wrong_usage(command, "--size takes a width and a height, such as 512x384, not '%s'", size);
    }
    if (code < 0) {
        code = run(&a);
    }
    cli_list_free(&operands);
    return code;
}
