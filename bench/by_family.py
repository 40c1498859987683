#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Sums up a table of bench_restore by the family of display that meta.json names.

Usage: bench/by_family.py TABLE FOLDER   (FOLDER holds the samples that the table lists)
"""
import collections
import json
import os
import sys

rows = collections.defaultdict(list)
for line in open(sys.argv[1]):
    cells = [c.strip() for c in line.strip().strip("|").split("|")]
    meta = os.path.join(sys.argv[2], cells[0], "meta.json")
    if not os.path.exists(meta):
        continue
    display = json.load(open(meta))["display"]
    rows[display["family"]].append([float(c) for c in cells[1:5]])
    rows["**all**"].append([float(c) for c in cells[1:5]])
print("| display family | samples | reference PSNR | SSIM | merge PSNR | SSIM | gain dB | worst gain dB |")
print("|---|---:|---:|---:|---:|---:|---:|---:|")
for family in sorted(rows, key=lambda f: (f == "**all**", f)):
    r = rows[family]
    a, b, c, d = (sum(x[i] for x in r) / len(r) for i in range(4))
    worst = min(x[2] - x[0] for x in r)
    print(f"| {family} | {len(r)} | {a:.2f} | {b:.4f} | {c:.2f} | {d:.4f} | {c - a:+.2f} | {worst:+.2f} |")
