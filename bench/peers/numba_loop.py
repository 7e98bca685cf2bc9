# SPDX-License-Identifier: BSD-3-Clause
"""A loop as users write it, compiled by numba: Heun's rule on increments that are given, path after path."""

from __future__ import annotations

import math

import numba
import numpy as np

from .equations import MASSES, NOISE, OMEGA, SIGMA, SIGMA1, SIGMA2, SMALL, Problem
from .prepared import Prepared

VERSION = f"numba {numba.__version__}"


@numba.njit
def kubo(q, p, h, w, a, b):  # noqa: PLR0917
    """Slopes into a, b; one degree of freedom as the others, in arrays of one."""
    x = h + SIGMA * w[0]
    a[0], b[0] = x * p[0], -x * q[0]


@numba.njit
def synchrotron(q, p, h, w, a, b):  # noqa: PLR0917
    """See `equations`."""
    a[0] = h * p[0]
    b[0] = -(h * OMEGA**2 + SIGMA2 * w[1]) * math.sin(q[0]) - SIGMA1 * w[0] * math.cos(q[0])


@numba.njit
def additive(q, p, h, w, a, b):  # noqa: PLR0917
    """See `equations`."""
    a[0], b[0] = h * p[0], -h * q[0] + w[0]


@numba.njit
def henon_heiles(q, p, h, w, a, b):  # noqa: PLR0917
    """See `equations`."""
    x, y = q[0], q[1]
    a[0], a[1] = h * p[0], h * p[1]
    b[0] = -h * (x + 2 * x * y) - SMALL * w[0]
    b[1] = -h * (y + x * x - y * y) - SMALL * w[1]


@numba.njit
def fpu64(q, p, h, w, a, b):  # noqa: PLR0917
    """See `equations`."""
    before = q[0] + q[0] ** 3
    for i in range(MASSES):
        r = (q[i + 1] if i + 1 < MASSES else 0.0) - q[i]
        after = r + r * r * r
        a[i] = h * p[i]
        b[i] = h * (after - before) + NOISE * w[i]
        before = after


def _made(slope):
    @numba.njit
    def run(q0, p0, h, dw):
        paths, steps, noises = dw.shape
        dof = len(q0)
        end = np.empty((2 * dof, paths))
        q, p, x, y = np.empty(dof), np.empty(dof), np.empty(dof), np.empty(dof)
        a, b, c, d = np.empty(dof), np.empty(dof), np.empty(dof), np.empty(dof)
        w = np.empty(noises)
        for i in range(paths):
            q[:], p[:] = q0, p0
            for n in range(steps):
                w[:] = dw[i, n]
                slope(q, p, h, w, a, b)
                for j in range(dof):
                    x[j], y[j] = q[j] + a[j], p[j] + b[j]
                slope(x, y, h, w, c, d)
                for j in range(dof):
                    q[j] += (a[j] + c[j]) / 2
                    p[j] += (b[j] + d[j]) / 2
            end[:dof, i], end[dof:, i] = q, p
        return end

    return run


_LOOPS = {f.__name__: _made(f) for f in (kubo, synchrotron, additive, henon_heiles, fpu64)}


def heun(problem: Problem, steps: int, dw: np.ndarray) -> Prepared:
    """All paths."""
    start = np.array(problem.q0), np.array(problem.p0)
    loop, of_paths = _LOOPS[problem.name], np.ascontiguousarray(dw.transpose(2, 0, 1))
    return Prepared(lambda: loop(*start, problem.horizon / steps, of_paths), dw.shape[2])


SCHEMES = {"Heun": heun}
