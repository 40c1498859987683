#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# TMRNet at paper size on 5 frames of SIZE packed pixels, forward and a step of training, in BRACE and in PyTorch, in
# one run: prints a Markdown table. That both compute the same is for tests/models.
# Usage: bench/tmrnet.sh [BUILD [OPTION...]]      OPTION of brace bench model; from the environment SIZE=WxH, PYTHON,
# and THREADS: of one CPU time counts, which other programs disturb less.
set -euo pipefail
here=$(dirname "$0")
build=${1:-build/release}
shift || true
python=${PYTHON:-/usr/bin/python3}
size=${SIZE:-128x128} threads=${THREADS:-$(nproc)}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

"$python" "$here/tmrnet_pytorch.py" forward "$threads" "${size%x*}" "${size#*x}" >"$work/forward"
"$build/src/cli/brace" bench model --network tmrnet --json -q --threads "$threads" --size "$size" "$@" >"$work/brace"
"$python" "$here/tmrnet_pytorch.py" training_step "$threads" "${size%x*}" "${size#*x}" >"$work/training_step"

"$python" - "$work" "$threads" "$size" <<'END'
import json
import sys

work, threads, size = sys.argv[1:]
ours = json.load(open(f"{work}/brace"))
print(f"TMRNet, 64 channels, on 5x4x{size}, {ours['processor']}, {threads} threads\n")
print("| | ms | GFLOP/s | times PyTorch | peak MB | of PyTorch's |\n|---|---:|---:|---:|---:|---:|")
for name in ("forward", "training_step"):
    seconds, memory = map(float, open(f"{work}/{name}").read().split())
    flops = ours["runs"][0][name]["gflops"] * ours["runs"][0][name]["seconds"]
    rows = [("PyTorch f32", seconds, memory)]
    rows += [(f"BRACE {run['type']}", run[name]["seconds"], run[name]["peak_mb"]) for run in ours["runs"]]
    for row, time, peak in rows:
        peak = float("nan") if peak is None else peak
        print(f"| {name.replace('_', ' ')}, {row} | {time * 1e3:.0f} | {flops / time:.0f} | {seconds / time:.2f} | "
              f"{peak:.0f} | {peak / memory:.2f} |")
END
