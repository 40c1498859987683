#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes vectors.safetensors: what PyTorch computes for the operations of cases.c and for the network of network.c.

For each case: inputs x0, x1, ... (channels last), parameters p.NAME, the result y; and for the loss sum(y r) with
r[i] = ((7919 i + 13) mod 101)/101 - 0.3 the gradients d0, d1, ... and g.NAME. Needs python3-torch, python3-torchvision
and the package safetensors' format only (written here).
"""
import json
import os
import struct

import numpy
import torch
import torch.nn.functional as F
import torchvision

torch.manual_seed(1)
arrays = {}


def nchw(x):
    return x.permute(0, 3, 1, 2)


def nhwc(x):
    return x.permute(0, 2, 3, 1)


def channels_first(f):
    return lambda *x: nhwc(f(*[nchw(v) for v in x]))


def put(name, x):
    arrays[name] = numpy.ascontiguousarray(x.detach().numpy().astype(numpy.float32))


def case(name, shapes, low, high, f, parameters=()):
    """f(inputs..., parameters...) of tensors; computed in double, stored in f32."""
    generator = torch.Generator().manual_seed(sum(name.encode()))
    x = [(torch.rand(s, generator=generator) * (high - low) + low) for s in shapes]
    p = [(n, torch.rand(s, generator=generator) * 2 * k - k) for n, s, k in parameters]
    leaves = [v.double().requires_grad_() for v in x] + [v.double().requires_grad_() for _, v in p]
    y = f(*leaves)
    y = y.reshape([1] * (4 - y.dim()) + list(y.shape))
    i = torch.arange(y.numel(), dtype=torch.int64)
    r = (((7919 * i + 13) % 101).double() / 101 - 0.3).reshape(y.shape)
    (y * r).sum().backward()
    for k, v in enumerate(x):
        put(f"{name}/x{k}", v)
        put(f"{name}/d{k}", leaves[k].grad)
    for k, (n, v) in enumerate(p):
        put(f"{name}/p.{n}", v)
        put(f"{name}/g.{n}", leaves[len(x) + k].grad)
    put(f"{name}/y", y)


X = (2, 3, 4, 5)
case("add", [X, X], -1, 1, torch.add)
case("add_channels", [X, (1, 1, 1, 5)], -1, 1, torch.add)
case("add_space", [X, (1, 3, 4, 1)], -1, 1, torch.add)
case("add_frames", [(1, 3, 4, 5), (2, 1, 1, 1)], -1, 1, torch.add)
case("sub_both_ways", [(1, 3, 1, 5), (2, 1, 4, 1)], -1, 1, torch.sub)
case("mul", [X, X], -1, 1, torch.mul)
case("mul_channels", [X, (2, 1, 1, 5)], -1, 1, torch.mul)
case("mul_number", [(1, 1, 1, 1), X], -1, 1, torch.mul)
case("div", [X, X], 0.5, 2, torch.div)
case("clamp", [X], -1, 1, lambda x: x.clamp(-0.4, 0.7))
case("pow", [X], 0.1, 2, lambda x: x ** (1 / 2.2))
case("sqrt", [X], 0.1, 2, torch.sqrt)
case("log", [X], 0.1, 2, torch.log)
case("exp", [X], -2, 2, torch.exp)
case("abs", [X], -1, 1, torch.abs)
case("relu", [X], -1, 1, F.relu)
case("leaky_relu", [X], -1, 1, lambda x: F.leaky_relu(x, 0.1))
case("sigmoid", [X], -4, 4, torch.sigmoid)
case("tanh", [X], -2, 2, torch.tanh)
case("softmax", [X], -3, 3, lambda x: F.softmax(x, -1))
case("l2_normalize", [X], -1, 1, lambda x: x / (x.pow(2).sum(-1, keepdim=True).sqrt() + 1e-10))
case("concat_c", [(2, 3, 4, 1), X, (2, 3, 4, 3)], -1, 1, lambda *x: torch.cat(x, 3))
case("slice_c", [(2, 3, 2, 7)], -1, 1, lambda x: x[..., 1:6:2])
case("repeat_n", [(1, 3, 4, 2)], -1, 1, lambda x: x.repeat(3, 1, 1, 1))
case("flip_w", [X], -1, 1, lambda x: x.flip(2))
case("roll_h", [X], -1, 1, lambda x: x.roll(2, 1))
case("roll_c", [X], -1, 1, lambda x: x.roll(-1, 3))
case("permute", [X], -1, 1, lambda x: x.permute(3, 0, 2, 1))
case("reshape", [X], -1, 1, lambda x: x.reshape(5, 1, 6, 4))
case("pad_zero", [X], -1, 1, channels_first(lambda x: F.pad(x, (0, 3, 1, 2))))
case("pad_reflect", [(2, 3, 4, 2)], -1, 1, channels_first(lambda x: F.pad(x, (3, 2, 2, 1), mode="reflect")))
case("pad_replicate", [(2, 3, 1, 2)], -1, 1, channels_first(lambda x: F.pad(x, (2, 4, 1, 3), mode="replicate")))
case("pixel_shuffle", [(2, 3, 2, 8)], -1, 1, channels_first(lambda x: F.pixel_shuffle(x, 2)))
case("pixel_unshuffle", [(2, 2, 6, 3)], -1, 1, channels_first(lambda x: F.pixel_unshuffle(x, 2)))
case("average_pool", [(2, 5, 4, 3)], -1, 1, channels_first(lambda x: F.avg_pool2d(x, 2)))
case("average_pool_3_2", [(1, 7, 8, 2)], -1, 1, channels_first(lambda x: F.avg_pool2d(x, 3, 2)))
case("adaptive_average_pool", [(2, 7, 5, 3)], -1, 1, channels_first(lambda x: F.adaptive_avg_pool2d(x, (3, 2))))
case("adaptive_average_pool_up", [(1, 4, 3, 2)], -1, 1, channels_first(lambda x: F.adaptive_avg_pool2d(x, (9, 4))))
case("max_pool_2_2", [(2, 5, 4, 3)], -1, 1, channels_first(lambda x: F.max_pool2d(x, 2, 2)))
case("max_pool_3_2", [(1, 7, 8, 3)], -1, 1, channels_first(lambda x: F.max_pool2d(x, 3, 2)))
case("max_pool_3_2_ceil", [(1, 8, 6, 3)], -1, 1, channels_first(lambda x: F.max_pool2d(x, 3, 2, ceil_mode=True)))


def resize(h, w, aligned):
    return channels_first(lambda x: F.interpolate(x, (h, w), mode="bilinear", align_corners=aligned))


case("resize_up", [(2, 4, 5, 3)], -1, 1, resize(9, 11, False))
case("resize_up_aligned", [(1, 5, 6, 3)], -1, 1, resize(10, 12, True))
case("resize_down", [(2, 7, 5, 2)], -1, 1, resize(3, 2, False))
case("resize_one", [(1, 4, 3, 2)], -1, 1, resize(1, 1, True))


def haar(x):
    a, b, c, d = x[:, ::2, ::2], x[:, ::2, 1::2], x[:, 1::2, ::2], x[:, 1::2, 1::2]
    return torch.cat([a + b + c + d, a + b - c - d, a - b + c - d, a - b - c + d], 3) / 2


case("haar", [(2, 4, 6, 3)], -1, 1, haar)


def warp(x, flow, mode="zeros"):
    _, h, w, _ = x.shape
    y, z = torch.meshgrid(torch.arange(h).double(), torch.arange(w).double(), indexing="ij")
    at = torch.stack([z, y], -1) + flow
    at = at * 2 / torch.tensor([w - 1, h - 1]).double() - 1
    return nhwc(F.grid_sample(nchw(x), at, mode="bilinear", padding_mode=mode, align_corners=True))


W = [(2, 5, 6, 5), (2, 5, 6, 2)]
case("warp_zero", W, -1, 1, lambda x, f: warp(x, 3 * f))
case("warp_edge", W, -1, 1, lambda x, f: warp(x, 3 * f, "border"))


def deform(pad, dilation):
    def f(x, offset, mask, w, b):
        return nhwc(torchvision.ops.deform_conv2d(nchw(x), nchw(2 * offset), w, b, padding=pad, dilation=dilation,
                                                  mask=nchw(mask)))
    return f


def deform_parameters(out, channels):
    return [("dcn.weight", (out, channels, 3, 3), 0.3), ("dcn.bias", (out,), 0.3)]


case("deform_plain", [(1, 4, 5, 2), (1, 4, 5, 18), (1, 4, 5, 9)], -1, 1, deform(1, 1), deform_parameters(3, 2))
case("deform_groups", [(2, 4, 3, 4), (2, 4, 3, 36), (2, 4, 3, 18)], -1, 1, deform(1, 1), deform_parameters(6, 2))
case("deform_offsets", [(1, 4, 4, 8), (1, 4, 4, 72), (1, 4, 4, 36)], -1, 1, deform(2, 2), deform_parameters(5, 8))
case("deform_weights", [(1, 5, 4, 4), (1, 3, 2, 18), (1, 3, 2, 9)], -1, 1, deform(0, 1), deform_parameters(4, 2))
case("sum_c", [X], -1, 1, lambda x: x.sum(3, keepdim=True))
case("mean_hw", [X], -1, 1, lambda x: x.mean((1, 2), keepdim=True))
case("mean_n", [X], -1, 1, lambda x: x.mean(0, keepdim=True))
case("mean_hc", [X], -1, 1, lambda x: x.mean((1, 3), keepdim=True))
case("var_hw", [X], -1, 1, lambda x: x.var((1, 2), unbiased=False, keepdim=True))
case("var_n", [X], -1, 1, lambda x: x.var(0, unbiased=False, keepdim=True))
case("sort_w", [X], -1, 1, lambda x: x.sort(2)[0])
case("sort_c", [(2, 2, 3, 9)], -1, 1, lambda x: x.sort(3)[0])
case("l1", [X, X], -1, 1, F.l1_loss)
case("param", [X], -1, 1, lambda x, p: x * p.reshape(5), [("scale", (5, 1, 1), 1)])


def conv(out, channels, k):
    return [("conv.weight", (out, channels, k, k), 0.3), ("conv.bias", (out,), 0.3)]


case("conv_3", [(2, 4, 5, 3)], -1, 1, lambda x, w, b: F.leaky_relu(nhwc(F.conv2d(nchw(x), w, b, padding=1)), 0.1),
     conv(6, 3, 3))
case("conv_1", [(1, 3, 4, 5)], -1, 1, lambda x, w, b: torch.sigmoid(nhwc(F.conv2d(nchw(x), w, b))), conv(3, 5, 1))
case("conv_7_2", [(1, 7, 6, 2)], -1, 1, lambda x, w, b: nhwc(F.conv2d(nchw(x), w, b, stride=2, padding=3)),
     conv(2, 2, 7))
case("conv_residual", [(1, 4, 3, 2), (1, 4, 3, 4)], -1, 1,
     lambda x, r, w, b: torch.tanh(nhwc(F.conv2d(nchw(x), w, b, padding=1)) + r), conv(4, 2, 3))
case("conv_residual_self", [X], -1, 1, lambda x, w, b: nhwc(F.conv2d(nchw(x), w, b, padding=1)) + x, conv(5, 5, 3))
TAPS = torch.tensor([[1, 2, 1], [2, 4, 2], [1, 2, 1]]).double() / 16
case("filter", [(2, 5, 6, 3)], -1, 1,
     channels_first(lambda x: F.conv2d(x, TAPS.expand(3, 1, 3, 3), stride=2, padding=1, groups=3)))
case("linear", [X], -1, 1, F.linear, [("fc.weight", (3, 5), 0.3), ("fc.bias", (3,), 0.3)])
case("matmul", [X, (2, 3, 5, 2)], -1, 1, lambda a, b: a @ b * 0.5)
case("matmul_turned", [X, (2, 3, 2, 5)], -1, 1, lambda a, b: a @ b.transpose(2, 3) * 2)


def c2(x, w, b, **more):
    return nhwc(F.conv2d(nchw(x), w, b, padding=w.shape[2] // 2, **more))


def network(x, flow, w1, b1, w2, b2, w3, b3, wo, bo, wd, bd, wq, bq, wk, bk, wv, bv, wt, bt):
    """Two frames; the second is aligned to the first by warp and deformable convolution; attention; upsampling."""
    f = F.leaky_relu(c2(x, w1, b1), 0.1)
    f = f + c2(F.relu(c2(f, w2, b2)), w3, b3)
    base, other = f[:1], f[1:]
    moved = warp(other, flow)
    o = c2(torch.cat([base, moved], 3), wo, bo)
    offset = 2 * torch.tanh(o[..., :36]) + flow.flip(3).repeat(1, 1, 1, 18)
    mask = torch.sigmoid(o[..., 36:])
    aligned = nhwc(torchvision.ops.deform_conv2d(nchw(other), nchw(offset), wd, bd, padding=1, mask=nchw(mask)))
    tokens = nhwc(F.avg_pool2d(nchw(torch.cat([base, aligned], 0)), 2)).mean((1, 2)).reshape(1, 1, 2, 8)
    q, k, v = F.linear(tokens, wq, bq), F.linear(tokens, wk, bk), F.linear(tokens, wv, bv)
    a = F.softmax(q @ k.transpose(2, 3) / 8 ** 0.5, -1) @ v
    fused = (torch.cat([base, aligned], 0) * torch.sigmoid(a.reshape(2, 1, 1, 8))).mean(0, keepdim=True)
    up = nhwc(F.pixel_shuffle(nchw(c2(fused, wt, bt)), 2))
    up = up + nhwc(F.interpolate(nchw(x[:1, ..., :2]), (12, 16), mode="bilinear", align_corners=False))
    return torch.log(1 + 50 * up.clamp(0, 2)) / numpy.log(51)


P = [("conv1.weight", (8, 4, 3, 3), 0.2), ("conv1.bias", (8,), 0.2),
     ("block.conv1.weight", (8, 8, 3, 3), 0.15), ("block.conv1.bias", (8,), 0.1),
     ("block.conv2.weight", (8, 8, 3, 3), 0.15), ("block.conv2.bias", (8,), 0.1),
     ("offset.weight", (54, 16, 3, 3), 0.03), ("offset.bias", (54,), 0.3),
     ("dcn.weight", (8, 4, 3, 3), 0.2), ("dcn.bias", (8,), 0.1)]
for name in ["q", "k", "v"]:
    P += [(f"attention.{name}.weight", (8, 8), 0.5), (f"attention.{name}.bias", (8,), 0.1)]
P += [("tail.weight", (8, 8, 3, 3), 0.15), ("tail.bias", (8,), 0.1)]
case("network", [(2, 6, 8, 4), (1, 6, 8, 2)], 0, 1.3, network, P)

header, at = {}, 0
for name, a in arrays.items():
    header[name] = {"dtype": "F32", "shape": list(a.shape), "data_offsets": [at, at + a.nbytes]}
    at += a.nbytes
text = json.dumps(header, separators=(",", ":")).encode()
text += b" " * (-len(text) % 64 + 56)
with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "vectors.safetensors"), "wb") as f:
    f.write(struct.pack("<Q", len(text)) + text)
    for a in arrays.values():
        f.write(a.tobytes())
