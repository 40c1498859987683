/* SPDX-License-Identifier: Apache-2.0 */
/* cmd_train.c: brace train: a network learned as a configuration says; the loop is in src/train/train.c. */
#include "cli/cli.h"

#include <stdlib.h>
#include <string.h>

#include "train/train.h"

static const char command[] = "train";

/* "configs/brace-s-stage1.json": runs/brace-s-stage1 */
static void folder_for(char *out, size_t size, const char *config) {
    const char *name = strrchr(config, '/');
    name = name != NULL ? name + 1 : config;
    const char *dot = strrchr(name, '.');
    snprintf(out, size, "runs/%.*s", (int)(dot != NULL && dot != name ? dot - name : (ptrdiff_t)strlen(name)), name);
}

/* This process alone, or all that mpirun started. */
static brace_status join(nn_group **out, brace_error *error) {
#ifdef NN_HAVE_MPI
    const char *size = getenv("OMPI_COMM_WORLD_SIZE");
    if (size != NULL && atoi(size) > 1) {
        return nn_group_mpi(out, error);
    }
#endif
    return nn_group_alone(out, error);
}

static int run(const char *path, const char *output, bool resume, bool quiet, bool json, int threads) {
    brace_job job;
    cli_report report;
    brace_error error = {0};
    train_config config;
    train_result result = {0};
    nn_group *group = NULL;
    brace_status status = train_config_load(&config, path, &error);
    if (status == BRACE_OK) {
        status = join(&group, &error);
    }
    const bool first = group == NULL || nn_group_rank(group) == 0;
    if (status == BRACE_OK) {
        const train_run_params params = {.output = output, .resume = resume, .group = group};
        cli_report_begin(&report, &job, command, quiet || !first, threads);
        status = train_run(&config, &params, &result, &job, &error);
        cli_report_flush(&report);
        cli_report_end(&report);
    }
    train_config_free(&config);
    if (status != BRACE_OK) {
        if (json) {
            cli_json_error(&error, command);
        }
        cli_error(command, "%s", error.message);
        if (group != NULL) {
            nn_group_give_up(group);
        }
        return status == BRACE_ERROR_CANCELLED ? cli_signals_exit() : CLI_FAILED;
    }
    nn_group_destroy(group);
    const double rate = result.seconds > 0 ? (double)result.samples / result.seconds : 0;
    if (first && json) {
        return cli_json_print(json_pack("{s:o, s:I, s:I, s:f, s:f, s:f, s:o, s:o}", "output", cli_json_text(output),
                                        "steps", (json_int_t)result.steps, "samples", (json_int_t)result.samples,
                                        "seconds", result.seconds, "waited", result.waited, "samples_per_second", rate,
                                        "loss", cli_json_number(result.loss), "psnr", cli_json_number(result.psnr)),
                              command)
                   ? CLI_DONE
                   : CLI_FAILED;
    }
    if (first && !quiet) {
        fprintf(stderr, "%s/weights.safetensors: %llu steps", output, (unsigned long long)result.steps);
        if (result.psnr == result.psnr) {
            fprintf(stderr, ", %.2f dB", result.psnr);
        }
        if (rate > 0) {
            fprintf(stderr, ", %.1f samples/s", rate);
        }
        fprintf(stderr, "\n");
    }
    return CLI_DONE;
}

int cli_train(int argc, char **argv) {
    bool resume = false, quiet = false, json = false;
    int threads = 0;
    const char *output = NULL;
    cli_list operands = {0};
    const cli_option options[] = {
        {CLI_HEADING, 0, NULL, NULL, "Options", NULL, 0, 0},
        {CLI_TEXT, 'o', "output", "FOLDER", "the run's folder, default: runs/CONFIG's name", &output, 0, 0},
        {CLI_FLAG, 'r', "resume", NULL, "go on with a run that was interrupted, or begin one", &resume, 0, 0},
        {CLI_FLAG, 0, "json", NULL, "print a JSON object on stdout", &json, 0, 0},
        {CLI_FLAG, 'q', "quiet", NULL, "only errors", &quiet, 0, 0},
        {CLI_INT, 't', "threads", "N", "1 to 256, default: one for each CPU", &threads, 1, 256},
        {CLI_HELP, 'h', "help", NULL, "this text", NULL, 0, 0},
        {.kind = CLI_END}};
    const cli_usage usage = {command, "CONFIG.json [options]",
                             "Trains a network. The folder then holds weights.safetensors (what brace restore\n"
                             "--model takes), log.jsonl, plot.png, and sheets/ with pictures of each\n"
                             "validation. A run that is interrupted, by whatever, goes on with --resume and\n"
                             "ends with the same bytes. Under mpirun all processes share each batch.\n"
                             "The paper's two stages are among the configurations that come with BRACE.",
                             options,
                             "Examples:\n"
                             "  brace train brace-s-stage1.json -o runs/mine\n"
                             "  brace train brace-s-stage1.json -o runs/mine --resume\n"
                             "  mpirun -n 4 brace train brace-stage1.json\n"};
    int code = cli_parse(&usage, argc, argv, &operands);
    char folder[4096];
    if (code < 0 && operands.count != 1) {
        code = cli_wrong_usage(command, operands.count == 0 ? "which configuration? CONFIG.json"
                                                            : "one configuration at a time");
    }
    if (code < 0) {
        if (output == NULL) {
            folder_for(folder, sizeof folder, operands.items[0]);
            output = folder;
        }
        code = run(operands.items[0], output, resume, quiet, json, threads);
    }
    cli_list_free(&operands);
    return code;
}
