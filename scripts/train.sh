#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Trains the networks that ship, from nothing: collects the screens, simulates the sets, trains all stages.
# What is there already is kept, and interrupted runs go on: run it again until it says that it is done.
#
# Usage: scripts/train.sh BRACE FOLDER [MODEL ...]
#   BRACE    the program; FOLDER takes some 60 GB; MODEL: brace-s and tmrnet-s by default
# PROCESSES (default: one for each CPU) share each batch, each with one thread.
set -euo pipefail
[ $# -ge 2 ] || { sed -n '3,9s/^# \{0,1\}//p' "$0"; exit 2; }
brace=$(realpath "$1") here=$(cd "$(dirname "$0")" && pwd)
configs=$here/../data/configs
mkdir -p "$2"
cd "$2"
shift 2
models=("$@")
[ ${#models[@]} -gt 0 ] || models=(brace-s tmrnet-s)

if [ ! -d screens ]; then # all of them, or none
    "$here/screens.sh" screens.part --work screens.work --limit 100 # of each category: 1,236 in all
    mv screens.part screens
fi
# What networks are judged by: the presets' own displays, and screens that are for testing in all sets, of which each
# has the same share for that. What they learn from has other displays.
"$brace" dataset build -o sets/plain/set --screens screens --train 1000 --test 100 --seed 1 --only test
for kind in varied more field; do # docs/model.md, "Displays off their presets", has why there are so many
    [ -d sets/$kind/packed ] && continue
    case $kind in
    varied) options=(--train 1000 --test 100 --seed 3) ;;
    more) options=(--train 1000 --test 100 --seed 4 --only train) ;;
    field) options=(--train 300 --test 30 --seed 2 --field) ;;
    esac
    "$brace" dataset build -o sets/$kind/set --screens screens --priors "$here/../data/priors/varied.json" "${options[@]}"
    "$brace" dataset pack sets/$kind/set -o sets/$kind/packed.part
    mv sets/$kind/packed.part sets/$kind/packed
done

for model in "${models[@]}"; do
    for stage in stage1 stage2; do
        "$here/train_run.sh" "$brace" "$configs/$model-$stage.json" "runs/$model-$stage"
    done
done
echo "done: runs/*-stage2/weights.safetensors"
