#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tables of what bench/analyze measured: analyze.py CAPTURES.tsv BACKLIGHTS.tsv TRUTHS... (plain Python).

TRUTHS: the truth.tsv of the captures, for the contrast of single frames."""
import os
import re
import sys
from collections import Counter, defaultdict

ABOUT, FRAME = 6, 9  # columns before, and of each frame
DISPLAY, SCREEN, ROOM, KIND, WHICH, CONTRAST, CONFIDENCE, HZ, BASE, SURE, SOURCE, ALIASED, FIRST = 0, 2, 5, 6, 7, 8, 10, 11, 12, 13, 14, 15, 16
BOUNDS = (0, 0.02, 0.05, 0.1, 0.3)


def read(path):
    with open(path, encoding="utf-8") as file:
        return [line.rstrip("\n").split("\t") for line in file]


def area(positive, negative):
    """Area under the ROC curve: how often a capture of flicker scores above one of steady light."""
    wins = sum((p > n) + 0.5 * (p == n) for p in positive for n in negative)
    return wins / (len(positive) * len(negative)) if positive and negative else float("nan")


def row(name, least, flicker, steady):
    if flicker and steady:
        print(f"| {name} | {100 * least:.0f} % | {len(flicker)} | {len(steady)} | {area(flicker, steady):.3f} "
              f"| {100 * sum(s >= 0.5 for s in steady) / len(steady):.1f} % "
              f"| {100 * sum(f < 0.5 for f in flicker) / len(flicker):.1f} % |")


def roc(rows, truth):
    print("| frames | captures with a contrast of at least | flickering | steady | ROC area | steady taken for banding "
          "| banding missed |\n|---|---|---:|---:|---:|---:|---:|")
    steady = [float(r[CONFIDENCE]) for r in rows if r[KIND] == "steady"]
    for least in BOUNDS:
        row("five", least, [float(r[CONFIDENCE]) for r in rows if r[KIND] == "flicker" and float(r[CONTRAST]) >= least],
            steady)
    for frame in range(5):
        alone = FIRST + FRAME * frame + 1
        steady = [float(r[alone]) for r in rows if r[KIND] == "steady"]
        for least in BOUNDS if frame == 0 else (0, 0.1, 0.3):
            row(("shortest" if frame == 0 else f"number {frame + 1}") + " alone", least,
                [float(r[alone]) for r in rows if r[KIND] == "flicker" and truth[r[DISPLAY], r[SCREEN]][frame] >= least],
                steady)


def kinds(rows, truth):
    print("\n| display | captures with a contrast of 10 % | missed | area, five | area, shortest alone |\n|---|---:|---:|---:|---:|")
    steady = [float(r[CONFIDENCE]) for r in rows if r[KIND] == "steady"]
    alone = [float(r[FIRST + 1]) for r in rows if r[KIND] == "steady"]
    by_display = defaultdict(list)
    for r in rows:
        if r[KIND] == "flicker" and float(r[CONTRAST]) >= 0.1:
            by_display[r[DISPLAY]].append(r)
    for name in sorted(by_display):
        of = by_display[name]
        first = [float(r[FIRST + 1]) for r in of if truth[r[DISPLAY], r[SCREEN]][0] >= 0.1]
        print(f"| {name} | {len(of)} | {sum(float(r[CONFIDENCE]) < 0.5 for r in of)} "
              f"| {area([float(r[CONFIDENCE]) for r in of], steady):.3f} | {area(first, alone):.3f} |")


def periods(rows, truth):
    """The shortest frame alone, by how many pulses fall into its readout: the largest number in a preset's name is
    its pulses a second."""
    print("\n| pulses in the frame | flickering, contrast at least 10 % | ROC area |\n|---|---:|---:|")
    alone = [float(r[FIRST + 1]) for r in rows if r[KIND] == "steady"]
    for low, high in ((0, 2), (2, 4), (4, 10), (10, 30), (30, 1e9)):
        of = [float(r[FIRST + 1]) for r in rows if r[KIND] == "flicker" and truth[r[DISPLAY], r[SCREEN]][0] >= 0.1
              and low <= float(r[3]) * max(map(int, re.findall(r"\d+", r[DISPLAY])), default=0) < high]
        if of:
            print(f"| {low} to {high:.0f} | {len(of)} | {area(of, alone):.3f} |" if high < 1e9 else
                  f"| {low} and more | {len(of)} | {area(of, alone):.3f} |")


def sources(rows):
    seen = defaultdict(Counter)
    for r in rows:
        if r[KIND] == "steady":
            seen["(steady, in steady light)"][r[SOURCE]] += 1
        elif float(r[CONTRAST]) >= 0.1:
            seen[r[DISPLAY]][r[SOURCE]] += 1
    names = ("steady", "unknown", "backlight", "scanned", "led_wall", "mains")
    print("\n| display | " + " | ".join(names) + " |\n|---|" + "---:|" * len(names))
    for display in sorted(seen):
        print(f"| {display} | " + " | ".join(str(seen[display][n] or "") for n in names) + " |")


def hertz(rows):
    rows = [r for r in rows if r[KIND] == "flicker"]
    print("\n| confidence of the frequency | captures | within 1 % | median error | largest error | beyond 5 %, but an alias listed |\n"
          "|---|---:|---:|---:|---:|---:|")
    for low, high in ((0.9, 1.01), (0.8, 0.9), (0.5, 0.8), (0.1, 0.5), (0, 0.1)):
        of = [(abs(float(r[HZ]) / float(r[4]) - 1), r[ALIASED] == "1") for r in rows if low <= float(r[SURE]) < high]
        if of:
            errors = sorted(e for e, _ in of)
            print(f"| {low} to {min(high, 1)} | {len(of)} | {sum(e <= 0.01 for e in errors)} "
                  f"| {100 * errors[len(errors) // 2]:.2f} % | {100 * errors[-1]:.2f} % | {sum(e > 0.05 and a for e, a in of)} |")


def main():
    rows = [r for r in read(sys.argv[1]) if r[WHICH] == "0" and len(r) == FIRST + 5 * FRAME]
    truth = {}
    for path in sys.argv[3:]:
        if os.path.exists(path):
            t = read(path)[0]
            truth[t[DISPLAY], t[SCREEN]] = [float(v) for v in t[7:12]]
    roc(rows, truth)
    periods(rows, truth)
    kinds(rows, truth)
    sources(rows)
    hertz(r for r in read(sys.argv[2]) if r[WHICH] == "0" and len(r) == FIRST + 5 * FRAME)


if __name__ == "__main__":
    main()
