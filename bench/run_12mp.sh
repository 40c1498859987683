#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Wall time, peak memory and where the time goes, for a 12-megapixel bracket
# tiled from small frames. Prints a Markdown table.
# Usage: bench/run_12mp.sh BUILD [FRAME FOLDER]
set -euo pipefail
build=${1:-build/release}
folder=${2:-data/demo}
size=${SIZE:-4032x3024}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

"$build/bench/make_big_bracket" "$work" "$folder"/frame_*.dng "$size"
field() { sed -n "/\"seconds\"/,/}/s/.*\"$2\": \\([0-9.e-]*\\).*/\\1/p" "$work/$1.json"; }

echo "| $size, $(nproc) CPUs | total s | read | align | light | fuse | develop | write | peak MB |"
echo '|---|---:|---:|---:|---:|---:|---:|---:|---:|'
for method in reference merge; do
    for out in dng 'dng png' 'dng jpg'; do
        outputs=()
        for extension in $out; do outputs+=(-o "$work/out.$extension"); done
        "$build/bench/measure" "$build/src/cli/brace" restore "$work"/frame_*.dng --method $method \
            "${outputs[@]}" --quiet --json >"$work/$method.json" 2>"$work/usage"
        printf '| %s, %s ' "$method" "${out// / + }"
        for key in total read align light fuse develop write; do
            LC_ALL=C printf '| %.2f ' "$(field $method $key)"
        done
        printf '| %.0f |\n' "$(sed -n 's/^peak_mb //p' "$work/usage")"
    done
done
