#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# How well banding is told from content, how exact its frequency is, and the time of the banding prior.
# Usage: bench/analyze.sh BUILD SCREENS [CAPTURES]   (SCREENS: a folder of pictures, as scripts/screens.sh collects them)
set -euo pipefail
build=$1
captures=${3:-300}
mapfile -t screens < <(find "$2" -name '*.webp' -o -name '*.png' | sort | awk 'NR % 7 == 1' | head -400)
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
"$build/bench/analyze" "$captures" "${screens[@]}" >"$out/captures.tsv" &
BACKLIGHTS=1 "$build/bench/analyze" "$captures" "${screens[@]}" >"$out/backlights.tsv"
wait
"$(dirname "$0")/analyze.py" "$out/captures.tsv" "$out/backlights.tsv"
echo
"$build/bench/fabp_12mp" 1
"$build/bench/fabp_12mp" 2
python3 -c 'import numpy' 2>/dev/null && "$(dirname "$0")/fabp_12mp.py"
