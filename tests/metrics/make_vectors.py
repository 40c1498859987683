#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes vectors.h: PSNR and SSIM of generated pictures as scikit-image computes them.

The pictures come from an integer hash that test_metrics.c repeats, so only the
results are stored. Run: python3 make_vectors.py > vectors.h
"""
import numpy as np
import skimage
from skimage.metrics import peak_signal_noise_ratio, structural_similarity


def picture(width, height, channels, seed, noise):
    """8-bit codes / 255: a smooth pattern, `noise` percent of it hashed."""
    y, x, c = np.meshgrid(np.arange(height), np.arange(width), np.arange(channels), indexing="ij")
    base = (x * 5 + y * 3 + c * 40 + (x * y) // 7) % 256
    h = ((y * width + x) * channels + c + 1).astype(np.uint64) * np.uint64(2654435761) + np.uint64(seed * 40503)
    h = h & np.uint64(0xFFFFFFFF)
    h = ((h ^ (h >> np.uint64(15))) * np.uint64(2246822519)) & np.uint64(0xFFFFFFFF)
    h = (h >> np.uint64(16)) & np.uint64(255)
    code = (base * (100 - noise) + h.astype(np.int64) * noise) // 100
    return code.astype(np.float64) / 255.0


CASES = [(64, 48, 3, 20), (11, 11, 3, 50), (33, 17, 1, 5), (40, 100, 3, 90), (200, 150, 3, 1)]

print("/* SPDX-License-Identifier: Apache-2.0 */")
print("/* Made by make_vectors.py with scikit-image %s; not to be edited. */" % skimage.__version__)
print("static const struct {\n    uint32_t width, height, channels, noise;\n    double psnr, ssim;\n} vectors[] = {")
for width, height, channels, noise in CASES:
    a = picture(width, height, channels, 1, noise)
    b = picture(width, height, channels, 2, noise)
    psnr = peak_signal_noise_ratio(a, b, data_range=1)
    ssim = np.mean([structural_similarity(a[..., c], b[..., c], data_range=1, gaussian_weights=True, sigma=1.5,
                                          use_sample_covariance=False) for c in range(channels)])
    print("    {%d, %d, %d, %d, %.12f, %.12f}," % (width, height, channels, noise, psnr, ssim))
print("};")
