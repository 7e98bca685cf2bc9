# SPDX-License-Identifier: BSD-3-Clause
"""A loop as users write it, compiled by numba: Heun's rule on increments that are given, path after path."""

from __future__ import annotations

import math

import numba
import numpy as np

from .problems import OMEGA, SIGMA1, SIGMA2

VERSION = f"numba {numba.__version__}"
SCHEME = "heun"


@numba.njit
def kubo(q, p, h, w):
    """H = (p^2 + q^2)/2, H_1 = 0.3 (p^2 + q^2)/2."""
    x = h + 0.3 * w[0]
    return x * p, -x * q


@numba.njit
def synchrotron(q, p, h, w):
    """H = p^2/2 - omega^2 cos q, H_1 = sigma1 sin q, H_2 = -sigma2 cos q."""
    return h * p, -(h * OMEGA**2 + SIGMA2 * w[1]) * math.sin(q) - SIGMA1 * w[0] * math.cos(q)


@numba.njit
def additive(q, p, h, w):
    """H = (p^2 + q^2)/2, H_1 = -q."""
    return h * p, -h * q + w[0]


def _made(slope):
    @numba.njit
    def run(q0, p0, h, dw):
        steps, _, paths = dw.shape
        end = np.empty((2, paths))
        w = np.empty(dw.shape[1])
        for i in range(paths):
            q, p = q0, p0
            for n in range(steps):
                w[:] = dw[n, :, i]
                a, b = slope(q, p, h, w)
                c, d = slope(q + a, p + b, h, w)
                q, p = q + (a + c) / 2, p + (b + d) / 2
            end[0, i], end[1, i] = q, p
        return end

    return run


_LOOPS = {f.__name__: _made(f) for f in (kubo, synchrotron, additive)}


def run(problem, h: float, dw: np.ndarray) -> np.ndarray:
    """Final (q, p), (2, path), driven by dw (step, noise, path)."""
    return _LOOPS[problem.name](problem.q0, problem.p0, h, dw)
