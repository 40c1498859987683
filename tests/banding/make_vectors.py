#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes vectors.h: FABP and SFC of small planes, by NumPy in double precision.

    tests/banding/make_vectors.py > tests/banding/vectors.h

Written from the paper's equations and docs/banding.md, with numpy.fft and
whole arrays; it shares no code with the library. The planes are made from
integers and one cosine, here and in test_banding.c.
"""
import numpy as np

SIZES = [(64, 48), (37, 53), (101, 64), (64, 101), (127, 211), (98, 91), (120, 33), (251, 16), (40, 40), (77, 202)]


def plane(width, height, seed, fx, fy, phase, amplitude):
    y, x = np.mgrid[0:height, 0:width].astype(np.uint32)
    base = (x * 5 + y * 3 + x * y // 7) % 256
    h = (y * np.uint32(width) + x + 1) * np.uint32(2654435761) + np.uint32(seed * 40503)
    h = (h ^ h >> 15) * np.uint32(2246822519)
    h = h >> 16 & 255
    texture = ((base * 60 + h * 40) // 100).astype(np.float64) / 255
    xc, yc = x - (width - 1) / 2, y - (height - 1) / 2
    p = 0.4 * texture + 0.3 + amplitude * np.cos(2 * np.pi * (fx * xc + fy * yc) + phase)
    return p.astype(np.float32).astype(np.float64)


def spectrum(p):
    height, width = p.shape
    window = np.outer(np.hanning(height), np.hanning(width))
    return np.fft.fftshift(np.fft.fft2((p - p.mean()) * window)), window


def grid(height, width):
    u = (np.arange(height) - height // 2)[:, None] + np.zeros((1, width))
    v = (np.arange(width) - width // 2)[None, :] + np.zeros((height, 1))
    return u, v


def ring(height, width, r_min, r_max):
    u, v = grid(height, width)
    d = np.sqrt(u * u + v * v)
    return (d >= r_min) & (d <= r_max) & ((u < 0) | ((u == 0) & (v > 0))), d


def defaults(height, width):
    return 3, max(min(height, width) // 4, 3)


def fabp(p):
    height, width = p.shape
    s, window = spectrum(p)
    power = np.abs(s) ** 2
    mask, _ = ring(height, width, *defaults(height, width))
    masked = power * mask
    r, c = np.unravel_index(np.argmax(masked), masked.shape)
    u, v = r - height // 2, c - width // 2
    fx, fy = v / width, u / height

    def top(a, b, c):
        a, b, c = np.log([a, b, c])
        d = np.clip(0.5 * (a - c) / (a - 2 * b + c), -0.5, 0.5) if a - 2 * b + c < 0 else 0
        return d, -0.25 * (a - c) * d

    dx, ax = top(power[r, c - 1], power[r, c], power[r, (c + 1) % width])
    dy, ay = top(power[r - 1, c], power[r, c], power[(r + 1) % height, c])
    gx, gy = (v + dx) / width, (u + dy) / height
    theta = (np.arctan2(gy, gx) + np.pi / 2) % np.pi
    phase = np.angle(s[r, c] * np.exp(1j * np.pi * (fx * (width - 1) + fy * (height - 1))))
    total = masked.sum()
    peak = masked[r, c]
    return [u, v, fx, fy, (np.arctan2(fy, fx) + np.pi / 2) % np.pi, peak / total, peak, total, gx, gy, theta,
            2 * np.sqrt(peak * np.exp(ax + ay)) / window.sum(), phase,
            np.log(1e-12 + peak / window.sum() ** 2), np.log(1e-12 + total / (width * height * (window ** 2).sum()))]


def sfc(pred, gt, direction):
    height, width = gt.shape
    r_min, r_max = defaults(height, width)
    mask, d = ring(height, width, r_min, r_max)
    u, v = grid(height, width)
    angle = np.arctan2(u / height, v / width) - direction
    inside = mask & (np.abs((angle + np.pi / 2) % np.pi - np.pi / 2) <= np.deg2rad(10))
    radius = np.round(d).astype(int)
    rho, profile = [], []
    for p in (pred, gt):
        power = np.abs(spectrum(p)[0]) ** 2
        rho.append(power[inside].sum() / power[mask].sum())
        radii = range(round(r_min), round(r_max) + 1)
        mean = np.mean([power[mask & (radius == k)].mean() for k in radii])
        profile.append(np.array([power[inside & (radius == k)].mean() / mean if (inside & (radius == k)).any() else 0
                                 for k in radii]))
    ratio, distance = abs(rho[0] - rho[1]), np.abs(profile[0] - profile[1]).mean()
    return [100 * (ratio + 5 * max(rho) * distance), 100 * ratio, 100 * distance, 100 * (rho[0] - rho[1]),
            100 * (profile[0] - profile[1]).mean(), rho[0], rho[1]]


def main():
    print("/* SPDX-License-Identifier: Apache-2.0 */\n/* Made by make_vectors.py with NumPy. */")
    print("static const struct {\n    uint32_t width, height;\n    double fx, fy, phase;\n    double fabp[15], sfc[7];")
    print("} vectors[] = {")
    for i, (width, height) in enumerate(SIZES):
        rng = np.random.default_rng(i)
        high = min(width, height) // 4
        fx = round(rng.uniform(-0.15, 0.15), 4)
        fy = round((3.3 + (high - 4) * rng.uniform(0.1, 0.6)) / height, 4)
        phase = round(rng.uniform(-3, 3), 3)
        lq = plane(width, height, 1, fx, fy, phase, 0.25)
        gt = plane(width, height, 2, fx, fy, phase, 0)
        pred = plane(width, height, 3, fx, fy, phase, 0.04)
        f = fabp(lq)
        direction = np.arctan2(f[9], f[8])
        s = sfc(pred, gt, direction)
        print(f"    {{{width}, {height}, {fx}, {fy}, {phase},")
        for name, values in (("fabp", f), ("sfc", s)):
            print("     {" + ", ".join(f"{x:.10g}" for x in values) + ("}}," if name == "sfc" else "},"))
    print("};")


if __name__ == "__main__":
    main()
