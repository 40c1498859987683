#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes adamw_vectors.h: what torch.optim.AdamW does to 22 numbers in eight steps, with CosineAnnealingLR,
clip_grad_norm_, no decay of the bias, and averages. Values and gradients are those of number() in test_optimizer.c.
Needs python3-torch."""
import os

import torch

STEPS, WEIGHTS, BIASES = 8, 15, 7


def number(step, i):
    return ((7919 * (i + 31 * step) + 13) % 101) / 128 - 0.375


weight = torch.tensor([number(0, i) for i in range(WEIGHTS)]).reshape(3, 5).requires_grad_()
bias = torch.tensor([number(0, i) for i in range(WEIGHTS, WEIGHTS + BIASES)]).requires_grad_()
optimizer = torch.optim.AdamW([{"params": [weight], "weight_decay": 0.1}, {"params": [bias], "weight_decay": 0}],
                              lr=0.01, betas=(0.9, 0.99), eps=1e-6)
schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, T_max=10, eta_min=1e-3)
average = torch.cat([weight.detach().flatten(), bias.detach()])
rates, norms, values = [], [], []
for step in range(STEPS):
    scale = 4 if step % 2 else 0.25
    weight.grad = torch.tensor([scale * number(step + 1, i) for i in range(WEIGHTS)]).reshape(3, 5)
    bias.grad = torch.tensor([scale * number(step + 1, i) for i in range(WEIGHTS, WEIGHTS + BIASES)])
    norms.append(float(torch.nn.utils.clip_grad_norm_([weight, bias], 1.0)))
    rates.append(optimizer.param_groups[0]["lr"])
    optimizer.step()
    schedule.step()
    now = torch.cat([weight.detach().flatten(), bias.detach()])
    average = 0.75 * average + 0.25 * now
    values.append(now)

with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "adamw_vectors.h"), "w") as f:
    f.write("/* SPDX-License-Identifier: Apache-2.0 */\n/* Written by make_adamw.py with PyTorch %s. */\n" %
            torch.__version__.split("+")[0])

    def array(name, rows, dims):
        f.write(f"static const double {name}{dims} = {{\n")
        for row in rows:
            row = [row] if isinstance(row, float) else [float(v) for v in row]
            text = ", ".join("%.9g" % v for v in row)
            f.write("    {" + text + "},\n" if len(row) > 1 else "    " + text + ",\n")
        f.write("};\n")

    f.write(f"enum {{ STEPS = {STEPS}, WEIGHTS = {WEIGHTS}, BIASES = {BIASES} }};\n")
    array("torch_rates", rates, "[STEPS]")
    array("torch_norms", norms, "[STEPS]")
    array("torch_values", values, "[STEPS][WEIGHTS + BIASES]")
    array("torch_average", [average], "[1][WEIGHTS + BIASES]")
