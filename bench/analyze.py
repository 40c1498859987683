#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tables of what bench/analyze measured: analyze.py CAPTURES.tsv BACKLIGHTS.tsv (plain Python)."""
import sys

# Columns: display camera screen sample alone time truth confidence hz base_hz spread readout source error hz_confidence


def read(path):
    with open(path, encoding="utf-8") as file:
        return [line.rstrip("\n").split("\t") for line in file]


def area(positive, negative):
    """Area under the ROC curve: how often a capture of flicker scores above one of steady light."""
    wins = sum((p > n) + 0.5 * (p == n) for p in positive for n in negative)
    return wins / (len(positive) * len(negative)) if positive and negative else float("nan")


def main():
    rows = read(sys.argv[1])
    print("| frames | captures with a contrast of at least | flickering | steady | ROC area | steady taken for banding "
          "| banding missed |\n|---|---|---:|---:|---:|---:|---:|")
    for alone, name in (("0", "five"), ("1", "the shortest alone")):
        steady = [float(r[7]) for r in rows if r[4] == alone and r[0] == "steady"]
        for least in (0, 0.02, 0.05, 0.1, 0.3):
            flicker = [float(r[7]) for r in rows if r[4] == alone and r[0] != "steady" and float(r[6]) >= least]
            if steady and flicker:
                print(f"| {name} | {100 * least:.0f} % | {len(flicker)} | {len(steady)} | {area(flicker, steady):.3f} "
                      f"| {100 * sum(s >= 0.5 for s in steady) / len(steady):.1f} % "
                      f"| {100 * sum(f < 0.5 for f in flicker) / len(flicker):.1f} % |")
    if len(sys.argv) < 3:
        return
    rows = [r for r in read(sys.argv[2]) if r[0].startswith("/")]
    print("\n| confidence of the frequency | captures | within 1 % | median error | largest error |\n"
          "|---|---:|---:|---:|---:|")
    for low, high in ((0.9, 1.01), (0.8, 0.9), (0.5, 0.8), (0.1, 0.5), (0, 0.1)):
        errors = sorted(abs(float(r[8]) / float(r[0].split("_")[1]) - 1) for r in rows if low <= float(r[14]) < high)
        if errors:
            print(f"| {low} to {min(high, 1)} | {len(errors)} | {sum(e <= 0.01 for e in errors)} "
                  f"| {100 * errors[len(errors) // 2]:.2f} % | {100 * errors[-1]:.2f} % |")


if __name__ == "__main__":
    main()
