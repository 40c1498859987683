#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# How well banding is told from content, how exact its frequency is, how the banding prior degrades, and its time.
# Usage: bench/analyze.sh BUILD SCREENS [FOLDER]   (SCREENS: a folder of pictures, as scripts/screens.sh collects them)
# Captures stay in FOLDER (about 6 GB), and are not made again.
set -euo pipefail
build=$1
out=${3:-bench-out/analyze}
mkdir -p "$out"
mapfile -t screens < <(find "$2" -name '*.webp' -o -name '*.png' | sort -t_ -k2 -s | awk 'NR % 7 == 1' | shuf --random-source=<(yes) | head -401)
jobs=$(nproc)
# in_parts PROGRAM... : each processor takes its share.
in_parts()
{
    local k pids=()
    for ((k = 0; k < jobs; k++)); do
        SHARE=$k/$jobs "$@" >"$out/part$k" &
        pids+=($!)
    done
    for k in "${pids[@]}"; do wait "$k"; done
}
in_parts "$build/bench/captures" "$out/presets" 202 310 presets "${screens[@]}"
in_parts "$build/bench/captures" "$out/backlights" 303 220 backlights "${screens[@]}"
for set in presets backlights; do
    ONLY=1 in_parts "$build/bench/analyze" "$out/$set"
    cat "$out"/part* >"$out/$set.tsv"
    rm "$out"/part*
done
"$(dirname "$0")/analyze.py" "$out/presets.tsv" "$out/backlights.tsv" "$out"/presets/*/truth.tsv
echo
"$build/bench/fabp_error"
echo
"$build/bench/fabp_12mp" 1
"$build/bench/fabp_12mp" 2
python3 -c 'import numpy' 2>/dev/null && "$(dirname "$0")/fabp_12mp.py"
