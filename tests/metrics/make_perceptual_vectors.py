#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes perceptual_vectors.h: LPIPS and DISTS of generated pictures, computed by PyTorch in double precision.

The weights come from an integer hash of a tensor's name and an element's number, which test_perceptual.c repeats, so
that only the results are stored. Run: python3 make_perceptual_vectors.py > perceptual_vectors.h
"""
import numpy as np
import torch
import torch.nn.functional as F
import torchvision

from make_vectors import picture

torch.set_default_dtype(torch.float64)
MASK = np.uint64(0xFFFFFFFF)


def hashed(name, count):
    """Numbers in [0, 1), with 16 bits."""
    tag = 2166136261
    for letter in name.encode():
        tag = ((tag ^ letter) * 16777619) & 0xFFFFFFFF
    h = np.arange(count, dtype=np.uint64) * np.uint64(2654435761) + np.uint64(tag) & MASK
    h = (h ^ h >> np.uint64(15)) * np.uint64(2246822519) & MASK
    h = (h ^ h >> np.uint64(13)) * np.uint64(3266489917) & MASK
    return (h >> np.uint64(16)).astype(np.float64) / 65536


def weights(name, shape):
    u = hashed(name, int(np.prod(shape)))
    if name.endswith(".bias"):
        u = (2 * u - 1) * 0.125
    elif name.startswith("features."):
        u = ((2 * u - 1) * np.float32(np.sqrt(6 / (shape[1] * shape[2] * shape[3])))).astype(np.float32).astype(np.float64)
    return torch.from_numpy(u.reshape(shape))


def trunk(model):
    net = model(weights=None).features
    net.load_state_dict({k: weights("features." + k, tuple(v.shape)) for k, v in net.state_dict().items()})
    return net.double().eval()


def lpips(kind, a, b):
    model, taps = {"alex": (torchvision.models.alexnet, [1, 4, 7, 9, 11]),
                   "vgg": (torchvision.models.vgg16, [3, 8, 15, 22, 29]),
                   "squeeze": (torchvision.models.squeezenet1_1, [1, 4, 7, 9, 10, 11, 12])}[kind]
    net = trunk(model)
    shift = torch.tensor([-0.030, -0.088, -0.188]).view(1, 3, 1, 1)
    scale = torch.tensor([0.458, 0.448, 0.450]).view(1, 3, 1, 1)
    x = (torch.cat([a, b]) * 2 - 1 - shift) / scale
    total = 0
    for i, layer in enumerate(net):
        x = layer(x)
        if i in taps:
            w = weights("lin%d.model.1.weight" % taps.index(i), (1, x.shape[1], 1, 1))
            n = x / (x.pow(2).sum(1, keepdim=True).sqrt() + 1e-10)
            total += ((n[:1] - n[1:]) ** 2 * w).sum(1).mean().item()
        if i == taps[-1]:
            return total


def dists(a, b):
    net = trunk(torchvision.models.vgg16)
    g = torch.tensor([1.0, 2.0, 1.0])
    g = g[:, None] * g[None, :] / 16
    x = torch.cat([a, b])
    stages = [x]
    x = (x - torch.tensor([0.485, 0.456, 0.406]).view(1, 3, 1, 1)) / torch.tensor([0.229, 0.224, 0.225]).view(1, 3, 1, 1)
    for i, layer in enumerate(net):
        if isinstance(layer, torch.nn.MaxPool2d):
            if i == len(net) - 1:
                break
            c = x.shape[1]
            x = (F.conv2d(x ** 2, g.expand(c, 1, 3, 3), stride=2, padding=1, groups=c) + 1e-12).sqrt()
        else:
            x = layer(x)
        if i in (3, 8, 15, 22, 29):
            stages.append(x)
    count = sum(s.shape[1] for s in stages)
    alpha, beta = weights("alpha", (count,)), weights("beta", (count,))
    total, at = 0, 0
    for s in stages:
        p, q = s[0].flatten(1), s[1].flatten(1)
        mp, mq = p.mean(1), q.mean(1)
        vp, vq = ((p - mp[:, None]) ** 2).mean(1), ((q - mq[:, None]) ** 2).mean(1)
        cov = ((p - mp[:, None]) * (q - mq[:, None])).mean(1)
        s1 = (2 * mp * mq + 1e-6) / (mp ** 2 + mq ** 2 + 1e-6)
        s2 = (2 * cov + 1e-6) / (vp + vq + 1e-6)
        n = len(mp)
        total += (alpha[at:at + n] * s1 + beta[at:at + n] * s2).sum().item()
        at += n
    return 1 - total / (alpha.sum() + beta.sum()).item()


print("/* SPDX-License-Identifier: Apache-2.0 */")
print("/* Made by make_perceptual_vectors.py with PyTorch %s; not to be edited. */" % torch.__version__)
print("static const struct {\n    brace_perceptual_kind kind;\n    uint32_t width, height, noise;\n    double distance;\n"
      "} vectors[] = {")
with torch.no_grad():
    for width, height, noise in [(64, 48, 20), (83, 61, 3), (32, 32, 60)]:
        a, b = (torch.from_numpy(picture(width, height, 3, seed, noise)).permute(2, 0, 1)[None] for seed in (1, 2))
        for kind in "alex", "vgg", "squeeze":
            print("    {BRACE_LPIPS_%s, %d, %d, %d, %.12g}," % (kind.upper(), width, height, noise, lpips(kind, a, b)))
        print("    {BRACE_DISTS, %d, %d, %d, %.12g}," % (width, height, noise, dists(a, b)))
print("};")
