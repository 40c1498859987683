/* SPDX-License-Identifier: Apache-2.0 */
/* bench.h: what the benches of `brace bench` share. A bench is a file bench_NAME.c and a line in cmd_bench.c. */
#ifndef CLI_BENCH_H
#define CLI_BENCH_H

#include "cli/cli.h"
#include "core/core.h"

/* The benches: argv[0] is the bench's name. They return an exit code. */
int bench_sim(int argc, char **argv);
int bench_conv(int argc, char **argv);
int bench_model(int argc, char **argv);

/* ---- measuring (cmd_bench.c) ---- */

/* CPU time of the calling thread in seconds: time that other programs take does not count. */
double bench_seconds(void);

/* The median time of a call: it is repeated, after one call that does not count, until `seconds` have gone,
 * but at least `least` times (1 to 1000). */
double bench_measure(void (*run)(void *arg), void *arg, double seconds, int least);

/* The processor's name as the system has it, "unknown" if it does not say. */
const char *bench_processor(char *out, size_t size);

/* Bytes a second that memcpy moves from one large block to another; 0 when there is no memory. */
double bench_copy_rate(void);

/* ---- instruction sets ---- */

enum { BENCH_SETS = 3 };
typedef struct bench_set {
    const char *name;  /* as BRACE_CPU takes it */
    const char *title; /* for tables */
    bool there;        /* this processor has it, and BRACE_CPU allows it */
    core_cpu cpu;
} bench_set;
void bench_sets(bench_set sets[BENCH_SETS]);

/* Everything runs with this set from now on: it puts its name into BRACE_CPU. Only while there is one thread. */
void bench_use(const bench_set *set);

#endif
