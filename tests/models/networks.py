# SPDX-License-Identifier: Apache-2.0
"""SPyNet, TMRNet and BRACE in PyTorch, for comparison only: make_parity.py and bench/tmrnet_pytorch.py compute with it.

Written from docs/model.md, not from the C code; names of parameters are those of the published checkpoints. Tensors are
N x C x H x W as usual in PyTorch.
"""
import math

import torch
import torch.nn as nn
import torch.nn.functional as F
import torchvision

GAMMA = 2.2


def warp(x, flow, padding_mode="zeros"):
    """x read at each pixel plus flow (dx, dy)."""
    h, w = x.shape[2:]
    rows, columns = torch.meshgrid(torch.arange(h, dtype=x.dtype), torch.arange(w, dtype=x.dtype), indexing="ij")
    gx = (columns + flow[:, 0]) * (2 / max(w - 1, 1)) - 1
    gy = (rows + flow[:, 1]) * (2 / max(h - 1, 1)) - 1
    return F.grid_sample(x, torch.stack([gx, gy], 3), mode="bilinear", padding_mode=padding_mode, align_corners=True)


def resize(x, h, w, align_corners=False):
    return F.interpolate(x, (h, w), mode="bilinear", align_corners=align_corners)


class Spynet(nn.Module):
    class Level(nn.Module):
        def __init__(self):
            super().__init__()
            layers = []
            for before, after in ((8, 32), (32, 64), (64, 32), (32, 16), (16, 2)):
                layers += [nn.Conv2d(before, after, 7, padding=3), nn.ReLU()]
            self.basic_module = nn.Sequential(*layers[:-1])

    def __init__(self):
        super().__init__()
        self.basic_module = nn.ModuleList(Spynet.Level() for _ in range(6))
        self.register_buffer("mean", torch.tensor([0.485, 0.456, 0.406]).reshape(1, 3, 1, 1))
        self.register_buffer("std", torch.tensor([0.229, 0.224, 0.225]).reshape(1, 3, 1, 1))

    def forward(self, reference, other):
        h, w = reference.shape[2:]
        up = [-(-n // 32) * 32 for n in (h, w)]
        pyramid = [[(resize(x, *up) - self.mean) / self.std for x in (reference, other)]]
        for _ in range(5):
            pyramid.append([F.avg_pool2d(x, 2) for x in pyramid[-1]])
        flow = reference.new_zeros(reference.shape[0], 2, up[0] // 32, up[1] // 32)
        for level in range(6):
            a, b = pyramid[5 - level]
            if level > 0:
                flow = 2 * resize(flow, a.shape[2], a.shape[3], True)
            rest = self.basic_module[level].basic_module(torch.cat([a, warp(b, flow, "border"), flow], 1))
            flow = flow + rest
        return resize(flow, h, w) * torch.tensor([w / up[1], h / up[0]], dtype=flow.dtype).reshape(1, 2, 1, 1)


class Block(nn.Module):
    def __init__(self, c):
        super().__init__()
        self.conv1 = nn.Conv2d(c, c, 3, padding=1)
        self.conv2 = nn.Conv2d(c, c, 3, padding=1)

    def forward(self, x):
        return x + self.conv2(F.relu(self.conv1(x)))


class Blocks(nn.Module):
    def __init__(self, before, c, count):
        super().__init__()
        self.main = nn.Sequential(nn.Conv2d(before, c, 3, padding=1), nn.LeakyReLU(0.1),
                                  nn.Sequential(*[Block(c) for _ in range(count)]))

    def forward(self, x):
        return self.main(x)


class Alignment(nn.Module):
    def __init__(self, c, groups, convolutions):
        super().__init__()
        layers, before = [], 2 * c + 2
        for _ in range(convolutions):
            layers += [nn.Conv2d(before, c, 3, padding=1), nn.LeakyReLU(0.1)]
            before = c
        self.conv_offset = nn.Sequential(*layers, nn.Conv2d(before, 27 * groups, 3, padding=1))
        self.deform_conv = torchvision.ops.DeformConv2d(c, c, 3, padding=1, groups=groups)
        self.groups = groups

    def forward(self, x, reference, flow):
        out = self.conv_offset(torch.cat([warp(x, flow), reference, flow], 1))
        taps = 9 * self.groups
        offset = 10 * torch.tanh(out[:, :2 * taps]) + flow[:, [1, 0]].repeat(1, taps, 1, 1)
        return self.deform_conv(x, offset, torch.sigmoid(out[:, 2 * taps:]))


def perceptron(before, hidden, after):
    return nn.Sequential(nn.Linear(before, hidden), nn.ReLU(), nn.Linear(hidden, after))


def attend(query, frames):
    """query: cells x d, frames: frames x cells x d."""
    share = torch.softmax((frames * query).sum(2) / math.sqrt(query.shape[1]), 0)
    return (share[..., None] * frames).sum(0)


class Strip(nn.Module):
    def __init__(self, c, d, prior, width):
        super().__init__()
        self.compare = nn.Conv2d(2 * c, c, 1)
        self.feature = nn.Linear(c, d)
        if prior:
            setattr(self, "global", nn.Linear(d, d, bias=False))
        self.film = perceptron(2 * d, d, 2 * c)
        self.width = width

    def forward(self, f, z):
        n, _, h, w = f.shape
        cells = max(1, (w + self.width // 2) // self.width)
        x = F.relu(self.compare(torch.cat([f[:1].expand(n, -1, -1, -1), f], 1)))
        t = self.feature(F.adaptive_avg_pool2d(x, (h, cells)).permute(0, 2, 3, 1))
        if z is not None:
            t = t + getattr(self, "global")(z)
        t = t.reshape(n, h * cells, -1)
        both = torch.cat([attend(t[0], t), t[0]], 1)
        film = self.film(both).reshape(1, h, cells, -1).permute(0, 3, 1, 2)
        return resize(film, h, w).chunk(2, 1)


class Mscam(nn.Module):
    def __init__(self, c, prior, strip, d=64):
        super().__init__()
        if prior:
            self.prior = perceptron(16, d, d)
            setattr(self, "global", nn.Linear(d, d, bias=False))
        self.feature = nn.Linear(c, d)
        self.film = perceptron(d, d, 2 * c)
        if strip > 0:
            self.strip = Strip(c, d, prior, strip)

    def forward(self, f, descriptors, rho):
        z = None
        if hasattr(self, "prior"):
            s = descriptors * descriptors.new_tensor([1, 1, 1, 0.1, 0.1, 1, 1, 1])
            share = (rho / (rho.sum() + 1e-6))[:, None]
            mu = (share * s).sum(0)
            sigma = ((share * (s - mu) ** 2).sum(0) + 1e-6).sqrt()
            z = self.prior(torch.cat([mu, sigma]))
        context = 0
        for scale in (1, 2, 4):
            t = self.feature(F.adaptive_avg_pool2d(f, scale).flatten(2).permute(0, 2, 1))
            if z is not None:
                t = t + getattr(self, "global")(z)
            context = context + attend(t[0], t).mean(0) / 3
        gamma, beta = self.film(context).chunk(2)
        out = f * (1 + 0.1 * torch.tanh(gamma)[:, None, None]) + 0.1 * beta[:, None, None]
        if hasattr(self, "strip"):  # which is shown the features as they came
            gamma, beta = self.strip(f, z)
            out = out * (1 + gamma) + beta
        return out


def views(shape):
    return shape["frames"] + (1 if shape["guide"] else 0)


class Network(nn.Module):
    """The family: `shape` is what a weights file says of its network."""

    def __init__(self, shape):
        super().__init__()
        self.shape = shape
        self.cautious = False  # as a restoration is: half of the small steps, openings from 0.4 on
        c, by, frames = shape["channels"], shape["unshuffle"], views(shape)
        if shape["spynet"]:
            self.spynet = Spynet()
        self.feat_extract = Blocks((16 if shape["sigma"] else 8) * by * by, c, shape["extract"])
        if shape["groups"] > 0:
            self.dcn_alignment = Alignment(c, shape["groups"], shape["offset"])
        if shape["mscam"]:
            self.mscam = Mscam(c, shape["prior"], shape["strip"])
        self.backbone = nn.ModuleDict({"backward": Blocks(3 * c, c, shape["global"])})
        for i in range(frames):
            self.backbone[f"backward_rec_{i + 1}"] = Blocks(3 * c, c, shape["frame"])
        self.learn_para = nn.Parameter(torch.zeros(1, frames, c, 1, 1))
        self.reconstruction = Blocks(2 * c, c, shape["reconstruct"])
        self.skipup1 = nn.Module()
        self.skipup1.upsample_conv = nn.Conv2d(4 * by * by, c, 3, padding=1)
        self.conv_hr = nn.Conv2d(c, c, 3, padding=1)
        maps = 4 * frames + 4
        if shape["sigma"]:
            maps = 8 * frames if shape["gate"] else 8 * frames - 8
        if not shape["blend"]:
            maps = 4
        self.conv_last = nn.Conv2d(c, maps * by * by, 3, padding=1)

    def forward(self, frames, flow=None, white=None, descriptors=None, rho=None, balance=None, sigma=None):
        """frames: n x 8 x h x w, flow: n x 2 x h x w, white and rho: n, descriptors: n x 8, balance: 8,
        sigma: 1 x 4 x h x w."""
        shape, n = self.shape, views(self.shape)
        by, curved = shape["unshuffle"], frames[:, 1::2]
        balance = (balance if shape["balance"] else torch.ones_like(frames[0, :, 0, 0])).reshape(8, 1, 1)
        seen = frames * balance
        if shape["spynet"]:
            linear = seen[:, 0::2]
            look = torch.stack([linear[:, 0], (linear[:, 1] + linear[:, 2]) / 2, linear[:, 3]], 1)
            look = look.clamp(0, 1) ** (1 / GAMMA)
            flow = self.spynet(look[:1].repeat(n - 1, 1, 1, 1), look[1:])
        else:
            flow = flow[1:]

        def moved(x):
            return torch.cat([x[:1], warp(x[1:], flow, "border")])

        deform = shape["groups"] > 0
        shown = seen if deform else moved(seen)
        if shape["sigma"]:
            v = moved(curved)
            d = v - v[n - 1:]
            inside = torch.ones_like(v[:, :1])
            d = d * torch.cat([inside[:1], warp(inside[1:], flow)])
            u = d / (64 * sigma ** 2 + d ** 2 + 1e-10).sqrt()
            shown = torch.cat([shown, ((sigma * balance[1::2]) ** 0.25).repeat(n, 1, 1, 1), u], 1)
        f = self.feat_extract(F.pixel_unshuffle(shown, by))
        if deform:
            coarse = F.avg_pool2d(flow, by) / by
            f = torch.cat([f[:1], self.dcn_alignment(f[1:], f[:1].repeat(n - 1, 1, 1, 1), coarse)])
        if shape["mscam"]:
            f = self.mscam(f, descriptors, rho)
        h = torch.zeros_like(f[:1])
        for i in range(n):
            h = h + self.backbone["backward"](torch.cat([f[:1], f[i:i + 1], h], 1))
            rest = self.backbone[f"backward_rec_{i + 1}"](torch.cat([f[:1], f[i:i + 1], h], 1))
            h = h + rest * self.learn_para[:, i]
        h = self.reconstruction(torch.cat([f[:1], h], 1))
        h = h + self.skipup1.upsample_conv(F.pixel_unshuffle(seen[:1, 1 if shape["blend"] else 0::2], by))
        h = self.conv_last(F.leaky_relu(self.conv_hr(h), 0.1))
        h = F.pixel_shuffle(h, by)
        if not shape["blend"]:
            return h / balance[0::2]
        v = moved(curved)
        maps = h.reshape(-1, 4, *h.shape[2:])
        level = white.reshape(-1, 1, 1, 1) ** (1 / GAMMA)
        trust = ((0.95 - v / level) / 0.15).clamp(0, 1)

        def mixed(maps, count, guide):
            begin = maps[:count].clone()
            if guide:
                begin[count - 1] = begin[count - 1] + 1
            more = (trust[:count] * begin * (v[:count] - v[0]))[1:].sum(0)
            return v[0] * (1 + maps[0]) + more + maps[count] / balance[1::2]

        if shape["sigma"]:
            small = maps[:n - 1]
            y = v[n - 1] + 8 * sigma[0] * (small[0] + ((trust * u)[1:n - 1] * small[1:]).sum(0))
            if shape["gate"]:
                t = maps[2 * n - 1]
                if self.cautious:
                    y = (v[n - 1] + y) / 2
                    t = ((t - 0.4) / 0.6).clamp(0, 1)
                y = y + t * (mixed(maps[n - 1:2 * n - 1], n - 1, False) - y)
            else:
                large = maps[n - 1:]
                y = y + large[0] / balance[1::2] + ((trust * d)[1:n - 1] * large[1:]).sum(0)
        else:
            y = mixed(maps, n, shape["guide"])
        return (torch.sign(y) * y.abs() ** GAMMA)[None]
