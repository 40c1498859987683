/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_model.c: brace bench model: time and memory of a whole network, forward and for a step of training. The network
 * is one of models.h, or what they are made of: blocks x + conv(ReLU(conv(x))).
 *
 * As in bench_conv.c the fastest of several runs counts, of one thread its CPU time. Memory is what the process came to
 * hold at most beyond what it held before the network was built, as the system counts it.
 */
#include "cli/bench.h"

#include <math.h>
#if defined(__GLIBC__)
#include <malloc.h>
#endif
#include <string.h>

#include "models/models.h"
#include "nn/node.h"
#include "nn/optimizer.h"

static const char command[] = "bench model";

enum { TYPES = 2, BLOCKS = 40, CHANNELS = 64, WIDTH = 128, HEIGHT = 128 };

typedef struct model_params {
    int blocks, channels, width, height;
    bool recompute, quick, layers;
    const models_shape *network; /* NULL: residual blocks */
    const char *name;            /* its */
    const brace_job *job;
} model_params;

typedef struct model_result {
    double seconds, flops; /* of one run */
    double peak, plan;     /* bytes; peak is NAN where the system does not tell */
} model_result;

/* ---- memory of this process ---- */

static double status_bytes(const char *key) {
    FILE *f = fopen("/proc/self/status", "r");
    char line[256];
    double bytes = NAN;
    while (f != NULL && fgets(line, sizeof line, f) != NULL) {
        double kib;
        if (strncmp(line, key, strlen(key)) == 0 && sscanf(line + strlen(key), ": %lf kB", &kib) == 1) {
            bytes = kib * 1024;
        }
    }
    if (f != NULL) {
        fclose(f);
    }
    return bytes;
}

/* The peak begins anew (proc(5), clear_refs); returns what is held now, NAN where that is not possible. */
static double begin_peak(void) {
#if defined(__GLIBC__)
    malloc_trim(0); /* what earlier networks left is not to be found there again */
#endif
    FILE *f = fopen("/proc/self/clear_refs", "w");
    bool done = f != NULL && fputs("5", f) >= 0;
    if (f != NULL) {
        done = fclose(f) == 0 && done;
    }
    return done ? status_bytes("VmRSS") : NAN;
}

/* ---- the network ---- */

typedef struct model {
    nn_weights *weights;
    nn_graph *g;
    nn_value x, more[6], y, target, loss;
    nn_optimizer *optimizer;
} model;

static void build_blocks(model *m, const model_params *p, nn_type type) {
    const nn_shape shape = {1, p->height, p->width, p->channels};
    m->x = nn_input(m->g, "x", shape);
    nn_value y = type == NN_F32 ? m->x : nn_cast(m->g, m->x, type);
    for (int i = 0; i < p->blocks; i++) {
        nn_push(m->g, "%d", i);
        if (p->recompute) {
            nn_recompute_begin(m->g);
        }
        nn_conv conv = {.name = "conv1", .out = p->channels, .kernel = 3, .pad = 1, .activation = NN_RELU,
                        .init = NN_INIT_HE_FAN_IN_TENTH};
        nn_value inner = nn_conv2d(m->g, y, &conv);
        conv.name = "conv2";
        conv.activation = NN_LINEAR;
        conv.residual = y;
        y = nn_conv2d(m->g, inner, &conv);
        if (p->recompute) {
            nn_recompute_end(m->g);
        }
        nn_pop(m->g);
    }
    m->y = y;
}

static void build_network(model *m, const model_params *p) {
    const models_inputs in = models_inputs_create(m->g, models_views(p->network), p->height, p->width);
    m->x = in.frames;
    memcpy(m->more, (nn_value[]){in.flow, in.white, in.descriptors, in.rho, in.balance, in.sigma}, sizeof m->more);
    m->y = models_build(m->g, p->network, &in);
}

static brace_status build(model *m, const model_params *p, nn_type type, bool training, brace_error *error) {
    brace_status status = nn_weights_create(&m->weights, 1, error);
    if (status == BRACE_OK) {
        status = nn_graph_create(&m->g, m->weights, &(nn_graph_params){.type = type, .job = p->job}, error);
    }
    if (status != BRACE_OK) {
        return status;
    }
    if (p->network != NULL) {
        build_network(m, p);
    } else {
        build_blocks(m, p, type);
    }
    const nn_value y = nn_type_of(m->g, m->y) == NN_F32 ? m->y : nn_cast(m->g, m->y, NN_F32);
    if (training) {
        m->target = nn_input(m->g, "target", nn_shape_of(m->g, y));
        m->loss = nn_l1(m->g, y, m->target);
    } else {
        nn_output(m->g, "y", y);
    }
    status = nn_graph_plan(m->g, &(nn_plan_params){.loss = m->loss}, error);
    if (status == BRACE_OK && training) {
        const nn_adamw how = nn_adamw_defaults();
        status = nn_optimizer_create(&m->optimizer, m->weights, &how, p->job, error);
    }
    return status;
}

static void fill(nn_graph *g, nn_value v, uint32_t stream) {
    core_random rng = core_random_create(1, stream, 0, 0);
    float *data = v != 0 ? nn_data(g, v) : NULL;
    for (size_t i = 0; data != NULL && i < nn_count(nn_shape_of(g, v)); i++) {
        data[i] = (float)core_random_uniform(&rng);
    }
}

static brace_status run_once(model *m, brace_error *error) {
    brace_status status = nn_forward(m->g, error);
    if (status == BRACE_OK && m->loss != 0) {
        status = nn_backward(m->g, 1, error);
        nn_optimizer_step(m->optimizer, 1e-4, 1, NULL);
    }
    return status;
}

static double seconds(const model_params *p) {
    return p->job->threads == 1 ? bench_seconds() : core_seconds();
}

static brace_status measure(model_result *r, const model_params *p, nn_type type, bool training, brace_error *error) {
    const double limit = p->quick ? 0 : 3, before = begin_peak();
    const int least = p->quick ? 1 : 5;
    double total = 0;
    model m = {0};
    brace_status status = build(&m, p, type, training, error);
    *r = (model_result){.seconds = INFINITY};
    if (status == BRACE_OK) {
        fill(m.g, m.x, 1);
        fill(m.g, m.target, 2);
        for (uint32_t i = 0; i < sizeof m.more / sizeof *m.more; i++) {
            fill(m.g, m.more[i], 3 + i);
        }
        status = run_once(&m, error); /* memory and caches warm up */
    }
    for (int i = 0; status == BRACE_OK && (i < least || total < limit); i++) {
        const double begin = seconds(p);
        status = run_once(&m, error);
        const double time = seconds(p) - begin;
        r->seconds = time < r->seconds ? time : r->seconds;
        total += time;
    }
    if (status == BRACE_OK) {
        /* Backward computes each convolution twice, but for the data's gradient of the first. */
        const double forward = nn_graph_flops(m.g);
        r->flops = training ? 3 * forward - (p->network != NULL ? 0 : forward / (2 * p->blocks)) : forward;
        r->plan = (double)nn_graph_memory(m.g);
        r->peak = status_bytes("VmHWM") - before;
        if (p->layers) {
            nn_graph_print(m.g, stdout);
        }
    }
    nn_optimizer_destroy(m.optimizer);
    nn_graph_destroy(m.g);
    nn_weights_destroy(m.weights);
    return status;
}

/* ---- what comes out ---- */

static const char *const type_names[TYPES] = {"f32", "bf16"};
static const nn_type types[TYPES] = {NN_F32, NN_BF16};
static const char *const pass_names[2] = {"forward", "training_step"};

static json_t *to_json(const model_params *p, const model_result results[TYPES][2], int threads) {
    char processor[128];
    json_t *rows = json_array();
    for (int i = 0; i < TYPES; i++) {
        json_t *row = json_pack("{s:s}", "type", type_names[i]);
        for (int k = 0; k < 2; k++) {
            const model_result *r = &results[i][k];
            json_object_set_new(row, pass_names[k],
                                json_pack("{s:f, s:f, s:o, s:f}", "seconds", r->seconds, "gflops",
                                          r->flops / r->seconds * 1e-9, "peak_mb",
                                          isnan(r->peak) ? json_null() : json_real(r->peak * 1e-6), "plan_mb",
                                          r->plan * 1e-6));
        }
        json_array_append_new(rows, row);
    }
    return json_pack("{s:s, s:s, s:o, s:i, s:i, s:i, s:i, s:i, s:b, s:o}", "bench", "model", "network",
                     p->network != NULL ? p->name : "blocks", "processor", cli_json_text(bench_processor(processor, sizeof processor)), "threads", threads, "blocks",
                     p->blocks, "channels", p->channels, "width", p->width, "height", p->height, "recompute",
                     p->recompute, "runs", rows);
}

static void print_table(const model_params *p, const model_result results[TYPES][2], int threads) {
    char processor[128];
    printf("%s, %d thread%s. ", bench_processor(processor, sizeof processor), threads, threads == 1 ? "" : "s");
    if (p->network != NULL) {
        printf("%s on %d frames of %dx%d.\n\n", p->name, p->network->frames, p->height, p->width);
    } else {
        printf("%d residual blocks of %d channels on 1x%dx%d%s.\n\n", p->blocks, p->channels, p->height, p->width,
               p->recompute ? ", recomputed" : "");
    }
    printf("%-16s %6s %10s %10s %10s %10s\n", "", "", "ms", "GFLOP/s", "peak MB", "plan MB");
    for (int k = 0; k < 2; k++) {
        for (int i = 0; i < TYPES; i++) {
            const model_result *r = &results[i][k];
            printf("%-16s %6s %10.2f %10.1f ", pass_names[k], type_names[i], r->seconds * 1e3,
                   r->flops / r->seconds * 1e-9);
            if (isnan(r->peak)) {
                printf("%10s", "-");
            } else {
                printf("%10.1f", r->peak * 1e-6);
            }
            printf(" %10.1f\n", r->plan * 1e-6);
        }
    }
}

typedef struct arguments {
    bool quick, json, quiet, recompute, layers;
    const char *network;
    int threads, blocks, channels, width, height;
} arguments;

static int run(const arguments *a) {
    model_result results[TYPES][2];
    brace_error error = {BRACE_OK, ""};
    brace_status status = BRACE_OK;
    brace_job job;
    cli_report report;
    cli_report_begin(&report, &job, command, a->quiet, a->threads);
    models_shape shape;
    const model_params p = {.blocks = a->blocks, .channels = a->channels, .width = a->width, .height = a->height,
                            .recompute = a->recompute, .quick = a->quick, .layers = a->layers, .job = &job,
                            .network = a->network != NULL && models_shape_named(&shape, a->network) ? &shape : NULL,
                            .name = a->network};
    for (int i = 0; i < TYPES * 2 && status == BRACE_OK; i++) {
        core_progress(&job, "measuring", (uint64_t)i, TYPES * 2);
        status = measure(&results[i / 2][i % 2], &p, types[i / 2], i % 2 == 1, &error);
    }
    if (status == BRACE_OK) {
        core_progress(&job, "measuring", TYPES * 2, TYPES * 2);
    }
    cli_report_flush(&report);
    cli_report_end(&report);
    const int threads = a->threads > 0 ? a->threads : core_cpu_count();
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
        code = cli_json_print(to_json(&p, results, threads), command) ? CLI_DONE : CLI_FAILED;
    } else {
        print_table(&p, results, threads);
        code = cli_flush(command) ? CLI_DONE : CLI_FAILED;
    }
    return code;
}

int bench_model(int argc, char **argv) {
    arguments a = {.blocks = BLOCKS, .channels = CHANNELS, .width = WIDTH, .height = HEIGHT};
    const char *size = NULL;
    cli_list operands = {0};
    const cli_option options[] = {
        {CLI_HEADING, 0, NULL, NULL, "Options", NULL, 0, 0},
        {CLI_INT, 't', "threads", "N", "1 to 256, default: one for each CPU", &a.threads, 1, 256},
        {CLI_TEXT, 0, "network", "NAME", "brace, brace-s, tmrnet or tmrnet-s in place of residual blocks", &a.network, 0, 0},
        {CLI_INT, 0, "blocks", "N", "residual blocks, 40", &a.blocks, 1, 1000},
        {CLI_INT, 'c', "channels", "N", "of each layer, 64", &a.channels, 1, 1024},
        {CLI_TEXT, 0, "size", "WxH", "of the picture, 128x128", &size, 0, 0},
        {CLI_FLAG, 0, "recompute", NULL, "train with less memory: half of the forward pass is computed twice",
         &a.recompute, 0, 0},
        {CLI_FLAG, 0, "layers", NULL, "print each layer's time, too", &a.layers, 0, 0},
        {CLI_FLAG, 0, "quick", NULL, "each once: rough numbers", &a.quick, 0, 0},
        {CLI_FLAG, 0, "json", NULL, "print a JSON object on stdout", &a.json, 0, 0},
        {CLI_FLAG, 'q', "quiet", NULL, "no progress", &a.quiet, 0, 0},
        {CLI_HELP, 'h', "help", NULL, "this text", NULL, 0, 0},
        {.kind = CLI_END},
    };
    const cli_usage usage = {
        command, "[OPTION]...",
        "Measures a network of residual blocks, x + conv(ReLU(conv(x))), on one picture:\n"
        "time and memory of a forward pass, and of a step of training (forward, L1 loss,\n"
        "backward, AdamW), in f32 and bf16. The fastest of several runs counts. Memory is\n"
        "what the process came to hold for it at most, and the plan's part of that.",
        options,
        "Examples:\n"
        "  brace bench model\n"
        "  brace bench model --network tmrnet --layers\n"
        "  brace bench model --blocks 10 --size 256x256 --threads 1\n"};
    int code = cli_parse(&usage, argc, argv, &operands);
    if (code < 0 && operands.count > 0) {
        code = cli_wrong_usage(command, "'%s': no argument is expected", operands.items[0]);
    }
    char rest;
    models_shape shape;
    if (code < 0 && a.network != NULL && !models_shape_named(&shape, a.network)) {
        code = cli_wrong_usage(command, "--network takes %s, not '%s'", models_names, a.network);
    }
    if (code < 0 && size != NULL &&
        (sscanf(size, "%4dx%4d%c", &a.width, &a.height, &rest) != 2 || a.width < 1 || a.height < 1)) {
        code = cli_wrong_usage(command, "--size takes a width and a height, such as 128x128, not '%s'", size);
    }
    if (code < 0) {
        code = run(&a);
    }
    cli_list_free(&operands);
    return code;
}
