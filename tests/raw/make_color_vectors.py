#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes color_vectors.h: colour transforms computed a second way, for test_isp.c.

Differences from src/raw/color.c that make it a check: published literal values of
the sRGB matrix adapted to D50 (Lindbloom), a root finder on the white point instead of
a fixed-point iteration, a dense search for the colour temperature, numpy's solver.
"""
import pathlib

import numpy as np
from scipy.optimize import root

XYZ_D50_TO_SRGB = np.array([[3.1338561, -1.6168667, -0.4906146],
                            [-0.9787684, 1.9161415, 0.0334540],
                            [0.0719453, -0.2289914, 1.4052427]])
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
D50 = np.array([0.96422, 1.0, 0.82521])

MIREDS = np.linspace(1e6 / 15000, 600, 400001)
T = 1e6 / MIREDS
LOCUS_U = (0.860117757 + 1.54118254e-4 * T + 1.28641212e-7 * T**2) / (1 + 8.42420235e-4 * T + 7.08145163e-7 * T**2)
LOCUS_V = (0.317398726 + 4.22806245e-5 * T + 4.20481691e-8 * T**2) / (1 - 2.89741816e-5 * T + 1.61456053e-7 * T**2)


def mired(x, y):
    d = -2 * x + 12 * y + 3
    return MIREDS[np.argmin((4 * x / d - LOCUS_U) ** 2 + (6 * y / d - LOCUS_V) ** 2)]


def color_matrix(matrices, temperatures, x, y):
    if len(matrices) == 1:
        return matrices[0]
    m0, m1 = (1e6 / t for t in temperatures)
    w = np.clip((mired(x, y) - m1) / (m0 - m1), 0, 1)
    return w * matrices[0] + (1 - w) * matrices[1]


def camera_to_srgb(matrices, temperatures, neutral):
    def white(x, y):
        xyz = np.linalg.solve(color_matrix(matrices, temperatures, x, y), neutral)
        return xyz / xyz.sum()

    xy = root(lambda p: white(*p)[:2] - p, [0.34, 0.35], tol=1e-10).x
    w = white(*xy)
    w = w / w[1]
    adapt = np.linalg.inv(BRADFORD) @ np.diag((BRADFORD @ D50) / (BRADFORD @ w)) @ BRADFORD
    m = XYZ_D50_TO_SRGB @ adapt @ np.linalg.inv(color_matrix(matrices, temperatures, *xy)) @ np.diag(neutral)
    return m / m.sum(axis=1, keepdims=True)


# Plausible cameras: two with a daylight matrix only, two with tungsten and daylight.
A1 = [[0.866441824, -0.2886881335, -0.1083037529], [-0.2489553136, 1.1252066, 0.1023190319],
      [0.04067551885, 0.06844417815, 0.4000428158]]
A2 = [[1.117763861, -0.3583006469, -0.1385942606], [-0.2710728386, 1.135767139, 0.1119261654],
      [0.05408415946, 0.1363962069, 0.4420132132]]
B1 = [[0.7034, -0.0804, -0.1014], [-0.4420, 1.2564, 0.2058], [-0.0851, 0.1994, 0.5758]]
B2 = [[0.6461, -0.0907, -0.0882], [-0.4300, 1.2184, 0.2378], [-0.0819, 0.1944, 0.5931]]
C1 = [[1.0424, -0.4526, -0.0418], [-0.3391, 1.1270, 0.2430], [-0.0262, 0.1010, 0.5560]]
C2 = [[0.9020, -0.2890, -0.0715], [-0.4535, 1.2436, 0.2348], [-0.0934, 0.1919, 0.7086]]
CASES = [
    ([A1], [21], [0.4227247165, 1, 0.5657324513]),
    ([A2], [21], [0.5519494779, 1, 0.7007060216]),
    ([A1], [21], [0.65, 1, 0.40]),
    ([B1, B2], [17, 21], [0.50, 1, 0.62]),
    ([B1, B2], [17, 21], [0.72, 1, 0.42]),
    ([C1, C2], [17, 21], [0.80, 1, 0.45]),
    ([C1, C2], [17, 23], [0.60, 1, 0.60]),
]
KELVIN = {17: 2856.0, 21: 6504.0, 23: 5003.0}


def row(values):
    return "{" + ", ".join(f"{v:.7g}" for v in np.ravel(values)) + "}"


def main():
    out = ["/* SPDX-License-Identifier: Apache-2.0 */", "/* Written by make_color_vectors.py. */",
           "static const struct {", "    double matrix[2][9];", "    uint16_t illuminant[2];",
           "    double neutral[3], expected[9];", "} color_vectors[] = {"]
    for matrices, lights, neutral in CASES:
        m = camera_to_srgb([np.array(x) for x in matrices], [KELVIN[i] for i in lights], np.array(neutral))
        second = matrices[1] if len(matrices) == 2 else np.zeros(9)
        lights = (lights + [0])[:2]
        out += [f"    {{{{{row(matrices[0])},", f"      {row(second)}}},", f"     {{{lights[0]}, {lights[1]}}},",
                f"     {row(neutral)},", f"     {row(m)}}},"]
    out.append("};")
    pathlib.Path(__file__).with_name("color_vectors.h").write_text("\n".join(out) + "\n")


main()
