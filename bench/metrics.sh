#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Time and memory of each metric on a 12-megapixel pair, beside scikit-image and
# PyTorch on the same files. Prints a Markdown table. PyTorch's MS-SWD is timed on
# an eighth of the projections, and its time multiplied by eight.
# Usage: bench/metrics.sh [BUILD [PRED GT]]     SIZE=WxH for another size of the generated pair
set -euo pipefail
here=$(dirname "$0")
build=${1:-build/release}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python=${PYTHON:-/usr/bin/python3}
if [ $# -ge 3 ]; then
    pred=$2 gt=$3
else
    pred=$work/pred.png gt=$work/gt.png
    "$python" "$here/metrics_python.py" make "$pred" "$gt" "${SIZE:-4000x3000}"
fi

echo "| metric, $(nproc) CPUs | BRACE | s | peak MB | Python | s | peak MB |"
echo '|---|---:|---:|---:|---:|---:|---:|'
for metric in psnr ssim ms-swd; do
    "$build/bench/measure" "$build/src/cli/brace" metrics "$pred" "$gt" -m $metric --json --quiet \
        >"$work/out.json" 2>"$work/usage"
    value=$(sed -n "s/^ *\"$metric\": \\([0-9.e-]*\\),*\$/\\1/p" "$work/out.json" | head -1)
    read -r theirs seconds peak < <(SWD_PROJECTIONS=16 "$python" "$here/metrics_python.py" $metric "$pred" "$gt")
    [ $metric != ms-swd ] || seconds=$(LC_ALL=C awk "BEGIN { print 8 * $seconds }")
    LC_ALL=C printf '| %s | %.5g | %.2f | %.0f | %.5g | %.2f | %.0f |\n' $metric "$value" \
        "$(sed -n 's/^seconds //p' "$work/usage")" "$(sed -n 's/^peak_mb //p' "$work/usage")" "$theirs" "$seconds" "$peak"
done
