#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes vectors.h: PSNR and SSIM of generated pictures as scikit-image computes them, MS-SWD as PyTorch does.

The pictures come from an integer hash that test_metrics.c repeats, so only the
results are stored. Run: python3 make_vectors.py > vectors.h
"""
import numpy as np
import skimage
import torch
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


# ---- MS-SWD, all in double precision, with the projections of BRACE: Philox4x32-10 and Box-Muller ----


def philox(counter, key):
    """counter: uint64 array [n, 4] of 32-bit words."""
    c = [counter[:, i].astype(np.uint64) for i in range(4)]
    k = [np.uint64(key[0]), np.uint64(key[1])]
    low = np.uint64(0xFFFFFFFF)
    for _ in range(10):
        p0, p1 = c[0] * np.uint64(0xD2511F53), c[2] * np.uint64(0xCD9E8D57)
        c = [(p1 >> np.uint64(32)) ^ c[1] ^ k[0], p1 & low, (p0 >> np.uint64(32)) ^ c[3] ^ k[1], p0 & low]
        k = [(k[0] + np.uint64(0x9E3779B9)) & low, (k[1] + np.uint64(0xBB67AE85)) & low]
    return np.stack(c, 1)


def projection(seed, scale, index):
    taps = 363
    counter = np.zeros((taps, 4), np.uint64)  # four words a normal number
    counter[:, 0], counter[:, 1], counter[:, 2] = np.arange(taps), scale, index
    w = philox(counter, (seed & 0xFFFFFFFF, seed >> 32))

    def uniform(high, low):
        return ((high >> np.uint64(5) << np.uint64(26)) | (low >> np.uint64(6))).astype(np.float64) * 2.0 ** -53

    u, v = 1 - uniform(w[:, 0], w[:, 1]), uniform(w[:, 2], w[:, 3])
    r = np.sqrt(-2 * np.log(u)) * np.cos(2 * np.pi * v)
    return r / np.linalg.norm(r)


def mirror(n, border):
    i = np.arange(-border, n + border)
    return np.zeros_like(i) if n == 1 else np.abs((i + n - 1) % (2 * n - 2) - (n - 1))


def pad(x, border):
    return x[:, :, mirror(x.shape[2], border)][:, :, :, mirror(x.shape[3], border)]


def to_lab(x):
    linear = torch.where(x <= 0.04045, x / 12.92, ((x.clamp(min=0) + 0.055) / 1.055) ** 2.4)
    m = torch.tensor([[10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794],
                      [2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897],
                      [1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382]], dtype=torch.float64)
    xyz = torch.einsum("ij,njhw->nihw", m / m.sum(1, keepdim=True), linear)
    f = torch.where(xyz > (6 / 29) ** 3, xyz.clamp(min=1e-9) ** (1 / 3), xyz * (29 / 6) ** 2 / 3 + 4 / 29)
    x, y, z = f[:, 0], f[:, 1], f[:, 2]
    return torch.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], 1)


def ms_swd(a, b, scales, projections, seed):
    kernel = torch.tensor([1, 4, 6, 4, 1], dtype=torch.float64) / 16
    kernel = (kernel[:, None] * kernel[None, :]).expand(3, 1, 5, 5)
    a, b = (torch.from_numpy(p).permute(2, 0, 1)[None].expand(1, 3, -1, -1) for p in (a, b))
    total = 0
    for scale in range(scales):
        if scale > 0:
            a, b = (torch.nn.functional.conv2d(pad(p, 2), kernel, groups=3)[:, :, ::2, ::2] for p in (a, b))
        w = torch.from_numpy(np.stack([projection(seed, scale, i) for i in range(projections)])).view(-1, 3, 11, 11)
        pa, pb = (torch.nn.functional.conv2d(pad(to_lab(p), 5), w).flatten(2).sort(2)[0] for p in (a, b))
        total += (pa - pb).abs().mean().item()
    return total / scales


def main():
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

    SWD_CASES = [(97, 85, 3, 20, 0, 0, 0), (200, 150, 3, 1, 0, 0, 7), (200, 150, 3, 60, 3, 10, 2 ** 40 + 5),
                 (33, 17, 1, 5, 5, 6, 1), (7, 5, 3, 30, 4, 16, 3), (1, 1, 3, 50, 2, 8, 9)]
    print("\nstatic const struct {\n    uint32_t width, height, channels, noise;\n    int scales, projections;\n"
          "    uint64_t seed;\n    double distance;\n} swd_vectors[] = {")
    for width, height, channels, noise, scales, projections, seed in SWD_CASES:
        a = picture(width, height, channels, 1, noise)
        b = picture(width, height, channels, 2, noise)
        print("    {%d, %d, %d, %d, %d, %d, %du, %.12f}," % (width, height, channels, noise, scales, projections, seed,
                                                           ms_swd(a, b, scales or 5, projections or 128, seed)))
    print("};")


if __name__ == "__main__":
    main()
