#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The network of `brace bench model` in PyTorch, on all cores: what bench/model.sh compares with.

Usage: model_pytorch.py LAYOUT PASS [BLOCKS CHANNELS WIDTH HEIGHT [SECONDS]]
LAYOUT is contiguous or channels_last, PASS forward or training_step. Prints seconds of the fastest run, and megabytes:
what the process came to hold at most beyond what it held before the network was built, and in all.
"""
import os
import sys
import time

import torch
import torch.nn as nn


def status(key):
    with open("/proc/self/status") as f:
        return next(int(line.split()[1]) for line in f if line.startswith(key + ":")) * 1024 * 1e-6


class Block(nn.Module):
    def __init__(self, channels):
        super().__init__()
        self.conv1 = nn.Conv2d(channels, channels, 3, padding=1)
        self.conv2 = nn.Conv2d(channels, channels, 3, padding=1)
        self.relu = nn.ReLU(inplace=True)
        for conv in (self.conv1, self.conv2):
            nn.init.kaiming_normal_(conv.weight)
            conv.weight.data *= 0.1

    def forward(self, x):
        return x + self.conv2(self.relu(self.conv1(x)))


def main():
    layout, which = sys.argv[1:3]
    blocks, channels, width, height = map(int, sys.argv[3:7] or (40, 64, 128, 128))
    limit = float(sys.argv[7]) if len(sys.argv) > 7 else 3
    torch.manual_seed(1)
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    torch.set_flush_denormal(True)
    nn.Conv2d(1, 1, 3)(torch.zeros(1, 1, 8, 8))  # libraries are loaded
    before = status("VmRSS")
    memory_format = torch.channels_last if layout == "channels_last" else torch.contiguous_format
    net = nn.Sequential(*[Block(channels) for _ in range(blocks)]).to(memory_format=memory_format)
    x, target = (torch.rand(1, channels, height, width).to(memory_format=memory_format) for _ in range(2))
    optimizer = torch.optim.AdamW(net.parameters(), lr=1e-4)

    def forward():
        with torch.inference_mode():
            net(x)

    def training_step():
        optimizer.zero_grad(set_to_none=True)
        nn.functional.l1_loss(net(x), target).backward()
        optimizer.step()

    run = forward if which == "forward" else training_step
    run()
    best, total, count = float("inf"), 0.0, 0
    while count < 5 or total < limit:
        begin = time.perf_counter()
        run()
        seconds = time.perf_counter() - begin
        best, total, count = min(best, seconds), total + seconds, count + 1
    peak = status("VmHWM")
    print(f"{best:.6f} {peak - before:.1f} {peak:.1f}")


main()
