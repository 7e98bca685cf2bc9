# SPDX-License-Identifier: BSD-3-Clause
"""A loop as users write it, compiled by numba: Heun's rule on given increments, path after path."""

from __future__ import annotations

import numba
import numpy as np

from .equations import Problem
from .models import OF_PROBLEMS
from .prepared import Prepared

VERSION = f"numba {numba.__version__}"


def _loop(scene):
    """A run on increments (path, step, noise); one degree of freedom is an array of length one."""
    n, s = scene.ndof, scene.functions(compiled=numba.njit(inline="always"))
    mass, number = s.mass, s.force

    @numba.njit(inline="always")
    def force(w, q, f):
        if n == 1:
            f[0] = number(w, 0.0, q[0])
        else:
            number(w, 0.0, q, f)

    @numba.njit
    def run(q0, p0, h, dw):
        paths, steps, noises = dw.shape
        end = np.empty((2 * n, paths))
        q, p, x, y, f, g = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
        w = np.empty(noises + 1)
        w[0] = h
        for i in range(paths):
            q[:], p[:] = q0, p0
            for k in range(steps):
                w[1:] = dw[i, k]
                move = mass(w)
                force(w, q, f)
                for j in range(n):
                    x[j], y[j] = q[j] + move * p[j], p[j] + f[j]
                force(w, x, g)
                for j in range(n):
                    q[j] += move * (p[j] + y[j]) / 2
                    p[j] += (f[j] + g[j]) / 2
            end[:n, i], end[n:, i] = q, p
        return end

    return run


def heun(problem: Problem, steps: int, dw: np.ndarray) -> Prepared:
    """Heun's rule for all paths."""
    start = np.array(problem.q0), np.array(problem.p0)
    loop, of_paths = _loop(OF_PROBLEMS[problem.name]), np.ascontiguousarray(dw.transpose(2, 0, 1))
    return Prepared(lambda: loop(*start, problem.horizon / steps, of_paths), dw.shape[2])


SCHEMES = {"Heun": heun}
