#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Quality on every bracket under a folder that has a ground truth (frame_*.dng
# and gt.dng), then time and memory at 12 megapixels. Both as Markdown.
# Usage: bench/run.sh BUILD SAMPLES
set -euo pipefail
build=$1
samples=$2

folders=()
while IFS= read -r truth; do
    folders+=("$(dirname "$truth")")
done < <(find "$samples" -name gt.dng | sort)
if [ ${#folders[@]} -gt 0 ]; then
    "$build/bench/bench_restore" "${folders[@]}"
else
    echo "bench: no folder under $samples holds a gt.dng; quality is not measured (make bench SAMPLES=DIR)" >&2
fi
echo
first=data/demo
[ ${#folders[@]} -eq 0 ] || first=${folders[0]}
"$(dirname "$0")/run_12mp.sh" "$build" "$first"
