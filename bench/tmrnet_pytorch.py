#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""TMRNet at paper size in PyTorch: what bench/tmrnet.sh compares with.

Usage: tmrnet_pytorch.py PASS THREADS WIDTH HEIGHT [SECONDS]
PASS is forward or training_step (forward, L1 loss, backward, AdamW). Prints seconds of the fastest run, of one thread
its CPU time, and megabytes: what the process came to hold at most beyond what it held before the network was built.
"""
import os
import sys
import time

import torch

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "tests", "models"))
import networks  # noqa: E402

SHAPE = {"frames": 5, "channels": 64, "unshuffle": 1, "extract": 5, "global": 16, "frame": 24, "reconstruct": 5,
         "offset": 3, "groups": 8, "spynet": True, "blend": False, "mscam": False, "prior": False, "strip": 0,
         "balance": False, "guide": False, "sigma": False, "gate": False}


def status(key):
    with open("/proc/self/status") as f:
        return next(int(line.split()[1]) for line in f if line.startswith(key + ":")) * 1024 * 1e-6


def main():
    which, threads, width, height = sys.argv[1], *map(int, sys.argv[2:5])
    limit = float(sys.argv[5]) if len(sys.argv) > 5 else 3
    clock = time.process_time if threads == 1 else time.perf_counter
    torch.manual_seed(1)
    torch.set_num_threads(threads)
    torch.set_flush_denormal(True)
    torch.nn.Conv2d(1, 1, 3)(torch.zeros(1, 1, 8, 8))  # libraries are loaded
    before = status("VmRSS")
    net = networks.Network(SHAPE)
    for name, p in net.named_parameters():  # as TMRNet begins
        if ".conv1.weight" in name or ".conv2.weight" in name:
            torch.nn.init.kaiming_normal_(p)
            p.data *= 0.1
        if "conv_offset.6.weight" in name:
            torch.nn.init.zeros_(p)
    frames, target = torch.rand(5, 8, height, width), torch.rand(1, 4, height, width)
    optimizer = torch.optim.AdamW(net.parameters(), lr=1e-4)

    def forward():
        with torch.inference_mode():
            net(frames)

    def training_step():
        optimizer.zero_grad(set_to_none=True)
        torch.nn.functional.l1_loss(net(frames), target).backward()
        optimizer.step()

    run = forward if which == "forward" else training_step
    run()
    best, total, count = float("inf"), 0.0, 0
    while count < 1 or total < limit:
        begin = clock()
        run()
        seconds = clock() - begin
        best, total, count = min(best, seconds), total + seconds, count + 1
    print(f"{best:.6f} {status('VmHWM') - before:.1f}")


main()
