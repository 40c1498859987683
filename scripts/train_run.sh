#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Trains with one process a CPU, or as many as PROCESSES says; with one where there is no mpirun. Goes on where it stopped.
#
# Usage: scripts/train_run.sh BRACE CONFIG.json FOLDER
set -euo pipefail
[ $# -eq 3 ] || { sed -n '3,5s/^# \{0,1\}//p' "$0"; exit 2; }
brace=$1
set -- train "$2" -o "$3" --resume
processes=${PROCESSES:-$(nproc)}
# From here on nothing reads what a loop around this reads; mpirun would.
exec < /dev/null
if [ "$processes" -gt 1 ] && command -v mpirun > /dev/null; then
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
    exec mpirun --oversubscribe --bind-to none --mca btl_vader_single_copy_mechanism none -n "$processes" \
        "$brace" "$@" --threads 1
fi
exec "$brace" "$@"
