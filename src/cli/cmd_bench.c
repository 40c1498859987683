/* SPDX-License-Identifier: Apache-2.0 */
/* cmd_bench.c: brace bench: how fast BRACE is on this computer. Finds the bench, and measures for all of them. */
#include "cli/bench.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

/* ---- measuring ---- */

double bench_seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

double bench_measure(void (*run)(void *arg), void *arg, double seconds, int least) {
    enum { MOST = 1000 };
    double times[MOST], total = 0;
    int n = 0;
    run(arg); /* memory and caches warm up */
    while (n < MOST && (n < least || total < seconds)) {
        double begin = bench_seconds();
        run(arg);
        times[n] = bench_seconds() - begin;
        total += times[n++];
    }
    qsort(times, (size_t)n, sizeof *times, by_value);
    return 0.5 * (times[(n - 1) / 2] + times[n / 2]);
}

const char *bench_processor(char *out, size_t size) {
    snprintf(out, size, "unknown");
    FILE *f = fopen("/proc/cpuinfo", "r");
    char line[256], *value;
    while (f != NULL && fgets(line, sizeof line, f) != NULL) {
        if (strncmp(line, "model name", 10) == 0 && (value = strchr(line, ':')) != NULL) {
            value += 1 + strspn(value + 1, " \t");
            value[strcspn(value, "\n")] = '\0';
            snprintf(out, size, "%s", value);
            break;
        }
    }
    if (f != NULL) {
        fclose(f);
    }
    return out;
}

typedef struct copy_job {
    char *to, *from;
    size_t size;
} copy_job;

static void copy(void *arg) {
    copy_job *job = arg;
    memcpy(job->to, job->from, job->size);
    job->from[job->to[job->size / 2] & 1]++; /* no copy is like the one before, and each is needed */
}

double bench_copy_rate(void) {
    copy_job job = {.size = (size_t)64 << 20}; /* larger than caches */
    job.to = core_calloc(job.size, 1);
    job.from = core_calloc(job.size, 1);
    double rate = 0;
    if (job.to != NULL && job.from != NULL) {
        memset(job.from, 1, job.size);
        rate = (double)job.size / bench_measure(copy, &job, 0.1, 3);
    }
    core_free(job.to);
    core_free(job.from);
    return rate;
}

/* ---- instruction sets ---- */

void bench_sets(bench_set sets[BENCH_SETS]) {
    const core_cpu have = core_cpu_features();
    sets[0] = (bench_set){"plain", "plain C", true, {.sha = false}};
    sets[1] = (bench_set){"avx2", "AVX2", have.avx2, {.avx2 = true, .f16c = have.f16c}};
    sets[2] = (bench_set){"avx512", "AVX-512", have.avx512, have};
}

void bench_use(const bench_set *set) {
    setenv("BRACE_CPU", set->name, 1);
}

/* ---- which ---- */

static const struct {
    const char *name, *summary;
    int (*run)(int argc, char **argv);
} benches[] = {
    {"sim", "the simulator: each display driver with each instruction set", bench_sim},
    {"conv", "convolutions: each way of computing them", bench_conv},
    {"model", "a network: time and memory, forward and training", bench_model},
};
enum { BENCHES = sizeof benches / sizeof benches[0] };

static int print_help(void) {
    printf("Usage: brace bench NAME ...\n\nHow fast BRACE is on this computer.\n\nBenches:\n");
    for (int i = 0; i < BENCHES; i++) {
        printf("  %-8s %s\n", benches[i].name, benches[i].summary);
    }
    printf("\nThe help of a bench: brace bench sim --help\n\nExample:\n  brace bench sim --quick\n");
    return cli_flush("bench") ? CLI_DONE : CLI_FAILED;
}

int cli_bench(int argc, char **argv) {
    const char *names[BENCHES + 1] = {NULL};
    if (argc < 2) {
        return cli_wrong_usage("bench", "which bench? sim, conv or model");
    }
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0) {
        return print_help();
    }
    for (int i = 0; i < BENCHES; i++) {
        names[i] = benches[i].name;
        if (strcmp(argv[1], benches[i].name) == 0) {
            return benches[i].run(argc - 1, argv + 1);
        }
    }
    const char *close = cli_closest(argv[1], names);
    if (close != NULL) {
        return cli_wrong_usage("bench", "there is no bench '%s'; did you mean '%s'?", argv[1], close);
    }
    return cli_wrong_usage("bench", "there is no bench '%s'", argv[1]);
}
