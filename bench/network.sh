#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Wall time, processor time and peak memory of restoring a bracket with networks and by merging: prints a Markdown table.
# Usage: bench/network.sh [BUILD [FRAME FOLDER]]      from the environment:
#   SIZES    "1024x768 4032x3024"; the bracket is tiled from small frames
#   METHODS  "merge brace-s": merge, names of installed weights, files of weights, or random-NAME: an untrained network,
#            whose speed is that of a trained one (random-brace takes a quarter of an hour for 12 megapixels)
#   PRECISION  f32 or bf16; default: as brace restore chooses
set -euo pipefail
build=$(realpath "${1:-build/release}")
folder=$(realpath "${2:-data/demo}")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

random() {
    cat >"$work/$1.json" <<END
{ "model": "$1", "batch": 1, "epochs": 1, "epoch_samples": 1, "data": {"width": 96, "height": 96, "crop": 32, "crops": 1},
  "validation": {"samples": 1} }
END
    "$build/src/cli/brace" train "$work/$1.json" -o "$work/$1" --resume -q >&2
    echo "$work/$1/weights.safetensors"
}

echo "| $(nproc) CPUs | size | wall s | processor s | tiles | peak MB |"
echo '|---|---|---:|---:|---:|---:|'
for size in ${SIZES:-1024x768 4032x3024}; do
    "$build/bench/make_big_bracket" "$work" "$folder"/frame_*.dng "$size"
    for method in ${METHODS:-merge brace-s}; do
        case $method in
        merge) options=(--method merge) ;;
        random-*) options=(--model "$(random "${method#random-}")") ;;
        *) options=(--model "$method") ;;
        esac
        [ "$method" = merge ] || [ -z "${PRECISION:-}" ] || options+=(--precision "$PRECISION")
        "$build/bench/measure" "$build/src/cli/brace" restore "$work"/frame_*.dng "${options[@]}" -o "$work/out.dng" \
            --quiet --json >"$work/out.json" 2>"$work/usage"
        LC_ALL=C printf '| %s | %s | %.2f | %.2f | %s | %.0f |\n' "$(basename "$method" .safetensors)" "$size" \
            "$(sed -n 's/^seconds //p' "$work/usage")" "$(sed -n 's/^cpu_s //p' "$work/usage")" \
            "$(sed -n 's/.*"tiles": *\([0-9]*\).*/\1/p' "$work/out.json")" "$(sed -n 's/^peak_mb //p' "$work/usage")"
    done
done
