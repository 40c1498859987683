#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# A network of residual blocks forward and trained, in BRACE and in PyTorch, in one run: prints a Markdown table. Both
# take turns, so that what else runs disturbs both alike; the faster of PyTorch's two memory layouts is what ratios are to.
# Usage: bench/model.sh [BUILD]      BLOCKS, CHANNELS, SIZE=WxH, PYTHON from the environment
set -euo pipefail
here=$(dirname "$0")
build=${1:-build/release}
python=${PYTHON:-/usr/bin/python3}
blocks=${BLOCKS:-40} channels=${CHANNELS:-64} size=${SIZE:-128x128}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

brace()
{
    "$build/src/cli/brace" bench model --json -q --blocks "$blocks" --channels "$channels" --size "$size" "$@"
}

for pass in forward training_step; do
    for layout in contiguous channels_last; do
        "$python" "$here/model_pytorch.py" $layout $pass "$blocks" "$channels" "${size%x*}" "${size#*x}" \
            >"$work/$pass.$layout"
    done
done
brace >"$work/plain"
brace --recompute >"$work/recompute"

"$python" - "$work" "$(nproc)" "$blocks residual blocks of $channels channels on 1x$size" <<'END'
import json
import sys

work, cpus, what = sys.argv[1:]
plain, less = (json.load(open(f"{work}/{name}")) for name in ("plain", "recompute"))
print(f"{what}, {plain['processor']}, {cpus} CPUs\n")
print("| | ms | GFLOP/s | times PyTorch | peak MB | of PyTorch's |\n|---|---:|---:|---:|---:|---:|")
for name in ("forward", "training_step"):
    flops = plain["runs"][0][name]["gflops"] * plain["runs"][0][name]["seconds"]
    rows = []
    for layout in ("contiguous", "channels_last"):
        seconds, peak, _ = map(float, open(f"{work}/{name}.{layout}").read().split())
        rows.append((f"PyTorch f32, {layout}", seconds, peak))
    theirs, memory = min(row[1] for row in rows), min(row[2] for row in rows)
    for run in plain["runs"]:
        rows.append((f"BRACE {run['type']}", run[name]["seconds"], run[name]["peak_mb"]))
    for run in less["runs"] if name == "training_step" else ():
        rows.append((f"BRACE {run['type']}, recomputed", run[name]["seconds"], run[name]["peak_mb"]))
    for row, seconds, peak in rows:
        peak = float("nan") if peak is None else peak
        print(f"| {name.replace('_', ' ')}, {row} | {seconds * 1e3:.1f} | {flops / seconds:.0f} | {theirs / seconds:.2f} | "
              f"{peak:.0f} | {peak / memory:.2f} |")
END
