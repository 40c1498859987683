/* SPDX-License-Identifier: Apache-2.0 */
/*
 * group_mpi.c: processes joined by MPI. MPI_Allreduce may add in any order, so sums are made here: of each chunk, every
 * process receives one part from all, adds it up from rank 0's to the last, and sends the result to all. That also
 * moves the fewest bytes: each number twice.
 */
#include <mpi.h>

#include <string.h>

#include "nn/group.h"

enum { MOST_PROCESSES = 1024 };

static brace_status failed(int code, const char *what, brace_error *error) {
    char text[MPI_MAX_ERROR_STRING] = "";
    int length = 0;
    if (code == MPI_SUCCESS) {
        return BRACE_OK;
    }
    if (MPI_Error_string(code, text, &length) != MPI_SUCCESS) {
        text[0] = '\0';
    }
    return core_fail(error, BRACE_ERROR_IO, "MPI: %s between the processes failed: %s", what, text);
}

/* Part r of n numbers: its beginning. */
static int part(int n, int r, int size) {
    return (int)((int64_t)n * r / size);
}

static brace_status sum_chunk(nn_group *group, float *values, int n, brace_error *error) {
    int counts[MOST_PROCESSES], begins[MOST_PROCESSES], mine[MOST_PROCESSES], places[MOST_PROCESSES];
    const int size = group->size, length = part(n, group->rank + 1, size) - part(n, group->rank, size);
    for (int r = 0; r < size; r++) {
        begins[r] = part(n, r, size);
        counts[r] = part(n, r + 1, size) - begins[r];
        mine[r] = length;
        places[r] = r * length;
    }
    brace_status status = failed(MPI_Alltoallv(values, counts, begins, MPI_FLOAT, group->parts, mine, places,
                                               MPI_FLOAT, MPI_COMM_WORLD),
                                 "adding up", error);
    if (status != BRACE_OK) {
        return status;
    }
    memcpy(group->chunk, group->parts, (size_t)length * sizeof(float));
    for (int r = 1; r < size; r++) {
        const float *p = group->parts + (size_t)r * (size_t)length;
        for (int i = 0; i < length; i++) {
            group->chunk[i] += p[i];
        }
    }
    return failed(MPI_Allgatherv(group->chunk, length, MPI_FLOAT, values, counts, begins, MPI_FLOAT, MPI_COMM_WORLD),
                  "adding up", error);
}

static brace_status mpi_sum(nn_group *group, float *values, size_t count, brace_error *error) {
    brace_status status = BRACE_OK;
    for (size_t at = 0; at < count && status == BRACE_OK; at += NN_GROUP_CHUNK) {
        const size_t n = count - at < NN_GROUP_CHUNK ? count - at : NN_GROUP_CHUNK;
        status = sum_chunk(group, values + at, (int)n, error);
    }
    return status;
}

static brace_status mpi_share(nn_group *group, void *bytes, size_t size, brace_error *error) {
    (void)group;
    const size_t most = (size_t)1 << 30;
    brace_status status = BRACE_OK;
    for (size_t at = 0; at < size && status == BRACE_OK; at += most) {
        const size_t n = size - at < most ? size - at : most;
        status = failed(MPI_Bcast((unsigned char *)bytes + at, (int)n, MPI_BYTE, 0, MPI_COMM_WORLD), "sending", error);
    }
    return status;
}

static brace_status mpi_wait(nn_group *group, brace_error *error) {
    (void)group;
    return failed(MPI_Barrier(MPI_COMM_WORLD), "waiting", error);
}

static void mpi_leave(nn_group *group) {
    (void)group;
    MPI_Finalize();
}

static const nn_group_kind kind_mpi = {mpi_sum, mpi_share, mpi_wait, mpi_leave};

brace_status nn_group_mpi(nn_group **out, brace_error *error) {
    int begun = 0, provided = 0, size = 1, rank = 0;
    *out = NULL;
    if (MPI_Initialized(&begun) != MPI_SUCCESS || begun) {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "MPI was begun before; one process can do that once");
    }
    /* One thread talks, others compute. */
    brace_status status = failed(MPI_Init_thread(NULL, NULL, MPI_THREAD_FUNNELED, &provided), "beginning", error);
    if (status != BRACE_OK) {
        return status;
    }
    MPI_Comm_set_errhandler(MPI_COMM_WORLD, MPI_ERRORS_RETURN);
    MPI_Comm_size(MPI_COMM_WORLD, &size);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    nn_group *group = core_calloc(1, sizeof *group);
    if (group != NULL) {
        const size_t longest = NN_GROUP_CHUNK / (size_t)size + 1;
        *group = (nn_group){.kind = &kind_mpi, .rank = rank, .size = size};
        group->room = core_alloc(NN_GROUP_CHUNK, sizeof *group->room);
        group->chunk = core_alloc(longest, sizeof *group->chunk);
        group->parts = core_alloc(longest * (size_t)size, sizeof *group->parts);
    }
    int good = group != NULL && group->room != NULL && group->chunk != NULL && group->parts != NULL, all = 0;
    /* All or none: where one fails, nobody waits for it later. */
    if (MPI_Allreduce(&good, &all, 1, MPI_INT, MPI_MIN, MPI_COMM_WORLD) != MPI_SUCCESS || !all) {
        status = core_fail_memory(error, 3 * NN_GROUP_CHUNK * sizeof(float), "a group of processes");
    } else if (size > MOST_PROCESSES || provided < MPI_THREAD_FUNNELED) {
        status = core_fail(error, BRACE_ERROR_UNSUPPORTED,
                           "%d processes cannot be joined: at most %d can, by an MPI that allows threads", size,
                           MOST_PROCESSES);
    }
    if (status != BRACE_OK) {
        MPI_Finalize();
        nn_group_give_up(group);
        return status;
    }
    *out = group;
    return BRACE_OK;
}
