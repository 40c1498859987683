#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes parity.safetensors and tmrnet.pth.gz: what networks.py computes for small networks, forward and backward.

All numbers that go in come from a formula that test_parity.c has too, so that only results are stored. For each
network: its shape as JSON in the metadata, the result "NAME/y", and for the loss sum(y r) of each parameter's gradient
g, as "NAME/g.PARAMETER": |g|, sum(g r), and eight numbers of it. Computed in double. tmrnet.pth.gz is the state dict of the
network "tmrnet" as its authors save it, packed: its numbers repeat themselves.
Needs python3-torch and python3-torchvision. Run in this folder.
"""
import gzip
import io
import json
import struct

import numpy
import torch

import networks

torch.set_num_threads(1)
PERIOD, SAMPLES = 251, 8


def numbers(name, count):
    """In [-1, 1): they depend on the name and on the index modulo PERIOD."""
    h = 2166136261
    for byte in name.encode():
        h = (h ^ byte) * 16777619 & 0xffffffff
    x = (numpy.arange(min(count, PERIOD), dtype=numpy.uint64) * 2654435769 + h) & 0xffffffff
    for multiplier, shift in ((0x7feb352d, 16), (0x846ca68b, 15)):
        x = (x ^ x >> numpy.uint64(shift)) * multiplier & 0xffffffff
    x = x ^ x >> numpy.uint64(16)
    x = (x >> numpy.uint64(8)).astype(numpy.float64) / (1 << 23) - 1
    return numpy.resize(x, count)


def tensor(name, shape, low, high):
    x = numbers(name, int(numpy.prod(shape))) * (0.5 * (high - low)) + 0.5 * (high + low)
    return torch.from_numpy(x.astype(numpy.float32).reshape(shape))


def fill(network):
    """Weights as large as PyTorch's, biases up to 0.1, gates up to 0.5."""
    for name, p in network.named_parameters():
        bound = 0.1 if p.dim() == 1 else 0.5 if p.dim() == 5 else (p[0].numel()) ** -0.5
        p.data = tensor(name, p.shape, -bound, bound).to(p.dtype)


def planes(name, n, h, w, c, low, high):
    """The numbers are in BRACE's order, channels last."""
    return tensor(name, (n, h, w, c), low, high).permute(0, 3, 1, 2).double()


arrays, metadata = {}, {}


def put(name, x):
    arrays[name] = numpy.ascontiguousarray(x.detach().numpy().astype(numpy.float32))


def run(name, network, inputs, keep):
    """Runs in double; `keep`: the file that its state dict is saved in, or None."""
    fill(network)
    state = {k: v.detach().clone() for k, v in network.state_dict().items()}
    network.double()
    y = network(*inputs).permute(0, 2, 3, 1)
    r = torch.from_numpy(numbers("r", y.numel())).reshape(y.shape)
    (y * r).sum().backward()
    put(f"{name}/y", y)
    for parameter, p in network.named_parameters():
        g = p.grad.flatten()
        assert g.abs().max() > 0, parameter
        some = [g[(k * len(g)) // SAMPLES] for k in range(SAMPLES)]
        put(f"{name}/g.{parameter}",
            torch.stack([g.norm(), (g * torch.from_numpy(numbers("r", len(g)))).sum(), *some]))
    if name == "gate":
        network.cautious = True
        put("gate/cautious", network(*inputs).permute(0, 2, 3, 1))
    print(f"{name}: result up to {y.abs().max():.3g}, {len(list(network.parameters()))} parameters")
    if keep:
        stored = io.BytesIO()
        torch.save({"state_dict": state}, stored)
        with open(keep, "wb") as f, gzip.GzipFile("", "wb", 9, f, mtime=0) as packed:
            packed.write(stored.getvalue())


def small(name, h, w, keep=None, **changes):
    shape = dict(frames=5, channels=16, unshuffle=1, extract=1, frame=1, reconstruct=1, offset=1, groups=2, spynet=False,
                 blend=False, mscam=False, prior=False, strip=0, balance=False, guide=False, sigma=False, gate=False)
    shape["global"] = 2
    assert set(changes) <= set(shape)
    shape.update(changes)
    n = networks.views(shape)
    metadata[name] = json.dumps({"h": h, "w": w, "shape": shape}, sort_keys=True)
    white = tensor("white", (n,), 0.9, 1.5).double()
    run(name, networks.Network(shape),
        [planes("frames", n, h, w, 8, -0.1, 1.1), planes("flow", n, h, w, 2, -3, 3), white,
         tensor("descriptors", (n, 8), -1, 1).double(), tensor("rho", (n,), 0, 1).double(),
         tensor("balance", (8,), 0.7, 2).double(), planes("sigma", 1, h, w, 4, 0.01, 0.3)], keep)


class Flow(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.spynet = networks.Spynet()

    def forward(self, reference, other):
        return self.spynet(reference, other)


run("spynet", Flow(), [planes("reference", 2, 24, 20, 3, 0, 1), planes("other", 2, 24, 20, 3, 0, 1)], None)
small("tmrnet", 24, 20, "tmrnet.pth.gz", spynet=True)
small("brace", 13, 17, frames=3, mscam=True, prior=True, balance=True)
small("cells", 10, 18, frames=3, mscam=True, prior=True, strip=4, extract=0, groups=4, offset=2)
small("blend", 12, 24, mscam=True, prior=True, strip=4, unshuffle=2, groups=0, blend=True, balance=True)
small("guide", 12, 8, frames=2, unshuffle=2, groups=0, blend=True, guide=True)
small("sigma", 12, 16, frames=3, mscam=True, strip=4, unshuffle=2, groups=0, blend=True, balance=True, guide=True,
      sigma=True)
small("gate", 12, 16, frames=3, mscam=True, strip=4, unshuffle=2, groups=0, blend=True, balance=True, guide=True,
      sigma=True, gate=True)
small("coarse", 16, 12, frames=2, mscam=True, strip=64, unshuffle=2, blend=True)
small("quarter", 16, 24, frames=4, unshuffle=4, groups=0, blend=True, reconstruct=0, frame=0, **{"global": 0})

header, at = {"__metadata__": metadata}, 0
for name, a in arrays.items():
    header[name] = {"dtype": "F32", "shape": list(a.shape), "data_offsets": [at, at + a.nbytes]}
    at += a.nbytes
text = json.dumps(header, separators=(",", ":")).encode()
text += b" " * (-len(text) % 64 + 56)
with open("parity.safetensors", "wb") as f:
    f.write(struct.pack("<Q", len(text)) + text)
    for a in arrays.values():
        f.write(a.tobytes())
