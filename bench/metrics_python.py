#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What bench/metrics.sh compares with: a metric by scikit-image, NumPy and PyTorch.

Usage: metrics_python.py make PRED GT [WxH]       a pair of pictures: texture, and the same with stripes and noise
       metrics_python.py METRIC PRED GT           psnr, ssim, ms-swd: prints value, seconds and peak megabytes
MS-SWD takes SWD_PROJECTIONS (default 128) projections a scale, four at a time: all 128 at once need more than 40 GB.
"""
import os
import resource
import sys
import time

import numpy as np
from PIL import Image


def make(pred, gt, size):
    width, height = map(int, size.split("x"))
    rng = np.random.default_rng(1)
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    truth = 0.45 + 0.25 * np.sin(x * 0.003 + y * 0.01) + 0.15 * (((x // 200 + y // 90) % 3) - 1)
    truth = np.stack([truth, truth * 0.9 + 0.05, truth * 0.7 + 0.1], 2)
    banded = truth * (1 + 0.05 * np.sin(y * 0.05))[..., None] + rng.normal(0, 0.01, truth.shape).astype(np.float32)
    for picture, path in (banded, pred), (truth, gt):
        Image.fromarray(np.round(picture.clip(0, 1) * 255).astype(np.uint8)).save(path, compress_level=1)


def read(path):
    return np.asarray(Image.open(path).convert("RGB"))


def ssim(a, b):
    from skimage.metrics import structural_similarity
    return structural_similarity(a / 255.0, b / 255.0, data_range=1, channel_axis=2, gaussian_weights=True, sigma=1.5,
                                 use_sample_covariance=False)


def psnr(a, b):
    from skimage.metrics import peak_signal_noise_ratio
    return peak_signal_noise_ratio(a / 255.0, b / 255.0, data_range=1)


def ms_swd(a, b):
    import torch
    import torch.nn.functional as F
    torch.manual_seed(0)
    m = torch.tensor([[0.43390, 0.37627, 0.18991], [0.21264, 0.71518, 0.07219], [0.01775, 0.10947, 0.87278]])
    kernel = torch.tensor([1.0, 4.0, 6.0, 4.0, 1.0]) / 16
    kernel = (kernel[:, None] * kernel[None, :]).expand(3, 1, 5, 5)

    def lab(x):
        linear = torch.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)
        t = torch.einsum("ij,njhw->nihw", m, linear)
        f = torch.where(t > (6 / 29) ** 3, t.clamp(min=1e-6) ** (1 / 3), t * (29 / 6) ** 2 / 3 + 4 / 29)
        return torch.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], 1)

    a, b = (torch.from_numpy(p.astype(np.float32) / 255).permute(2, 0, 1)[None].contiguous() for p in (a, b))
    count = int(os.environ.get("SWD_PROJECTIONS", "128"))
    total = 0
    with torch.no_grad():
        for scale in range(5):
            if scale > 0:
                a, b = (F.conv2d(F.pad(p, (2, 2, 2, 2), mode="reflect"), kernel, groups=3)[:, :, ::2, ::2] for p in (a, b))
            la, lb = (F.pad(lab(p), (5, 5, 5, 5), mode="reflect") for p in (a, b))
            for _ in range(0, count, 4):
                w = torch.randn(4, 3, 11, 11)
                w = w / w.flatten(1).norm(dim=1).view(4, 1, 1, 1)
                pa, pb = (F.conv2d(p, w).flatten(2).sort(2)[0] for p in (la, lb))
                total += (pa - pb).abs().mean().item() * 4 / count / 5
    return total


if sys.argv[1] == "make":
    make(sys.argv[2], sys.argv[3], sys.argv[4] if len(sys.argv) > 4 else "4000x3000")
else:
    start = time.time()
    value = {"psnr": psnr, "ssim": ssim, "ms-swd": ms_swd}[sys.argv[1]](read(sys.argv[2]), read(sys.argv[3]))
    print("%.6g %.2f %.0f" % (value, time.time() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024))
