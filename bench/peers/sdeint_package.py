# SPDX-License-Identifier: BSD-3-Clause
"""sdeint (M. J. Aburn): loops in Python over steps, one path at a time; few paths here."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np
import sdeint

from .equations import Problem
from .prepared import Prepared

VERSION = f"sdeint {version('sdeint')}"
MOST_PATHS = 2


def heun(problem: Problem, steps: int, dw: np.ndarray) -> Prepared:
    """sdeint's stratHeun on the first paths."""
    dof, m = problem.dof, problem.noises
    times = np.linspace(0, problem.horizon, steps + 1)
    start, still, paths = np.array([*problem.q0, *problem.p0]), np.zeros(m), min(MOST_PATHS, dw.shape[2])

    def drift(z, t):
        return np.concatenate(problem.slope(np, z[:dof], z[dof:], 1.0, still))

    one = np.eye(m)

    def noise(z, t):
        return np.array([np.concatenate(_grown(problem, z, one[k])) for k in range(m)]).T

    def run():
        ends = [sdeint.stratHeun(drift, noise, start, times, dW=dw[:, :, i].copy())[-1] for i in range(paths)]
        return np.array(ends).T

    return Prepared(run, paths)


def _grown(problem: Problem, z: np.ndarray, w: np.ndarray):
    """The noise matrix at a state, with a column for each noise."""
    dof = problem.dof
    a, b = problem.slope(np, z[:dof], z[dof:], 0.0, w)
    return np.broadcast_to(a, dof), np.broadcast_to(b, dof)


SCHEMES = {"stratHeun": heun}
