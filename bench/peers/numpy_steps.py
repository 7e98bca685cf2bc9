# SPDX-License-Identifier: BSD-3-Clause
"""All paths at once in NumPy: Heun's rule, and the classical Runge-Kutta rule with the noise held over a step.

XMDS2's algorithm RK4 is this Runge-Kutta rule, whose error on given increments is used for XMDS2.
"""

from __future__ import annotations

import numpy as np

from .equations import Problem
from .prepared import Prepared

VERSION = f"NumPy {np.__version__}"


def _start(problem: Problem, paths: int) -> np.ndarray:
    return np.repeat(np.array([*problem.q0, *problem.p0])[:, np.newaxis], paths, axis=1)


def integrated(problem: Problem, steps: int, dw: np.ndarray, rule) -> np.ndarray:
    """Final states (2 dof, path)."""
    z, h, dof = _start(problem, dw.shape[2]), problem.horizon / steps, problem.dof
    for w in dw:
        z = rule(lambda x, w=w: np.concatenate(problem.slope(np, x[:dof], x[dof:], h, w)), z)
    return z


def heun_step(slope, z: np.ndarray) -> np.ndarray:
    """One step of Heun's rule."""
    a = slope(z)
    return z + (a + slope(z + a)) / 2


def rk4_step(slope, z: np.ndarray) -> np.ndarray:
    """One step of the classical Runge-Kutta rule."""
    a = slope(z)
    b = slope(z + a / 2)
    c = slope(z + b / 2)
    return z + (a + 2 * b + 2 * c + slope(z + c)) / 6


def heun(problem: Problem, steps: int, dw: np.ndarray) -> Prepared:
    """Heun's rule for all paths."""
    return Prepared(lambda: integrated(problem, steps, dw, heun_step), dw.shape[2])


SCHEMES = {"Heun": heun}
