# SPDX-License-Identifier: BSD-3-Clause
"""jitcsde (G. Ansmann): adaptive steps, C code from SymEngine, one path at a time; diagonal noise alone.

Its steps follow a tolerance: each of the three numbers of steps is translated into a tolerance. It draws its own paths,
beforehand on a fine grid (pin_noise); its error is the distance from its own run at a hundredth of the tolerance.
"""

from __future__ import annotations

import math
import time
from importlib.metadata import version

import numpy as np
import symengine
from jitcsde import jitcsde, y

from .equations import Problem
from .prepared import Prepared

VERSION = f"jitcsde {version('jitcsde')}"
PATHS = 3
TOLERANCES = (1e-2, 1e-3, 1e-4)


class _Symbols:
    """The functions that `equations` expects of an array package, for symbols."""

    @staticmethod
    def concatenate(parts):
        return np.concatenate(parts)


def adaptive(problem: Problem, steps: int, dw: np.ndarray) -> Prepared | None:
    """The tolerance used for this number of steps."""
    if not problem.additive:
        return None
    dof, tolerance = problem.dof, TOLERANCES[problem.steps.index(steps)]
    state = np.array([y(i) for i in range(2 * dof)])
    still = np.array([symengine.Integer(0)] * problem.noises)
    drift = np.concatenate(problem.slope(_Symbols, state[:dof], state[dof:], symengine.Integer(1), still))
    noise = [0.0] * dof + [problem.strength] * dof
    sde = jitcsde(list(drift), noise, additive=True, verbose=False)
    sde.compile_C()
    fine = 4 * max(problem.steps)

    def end(seed: int, rtol: float) -> np.ndarray:
        sde.purge_past() if hasattr(sde, "purge_past") else None
        sde.set_initial_value(np.array([*problem.q0, *problem.p0]), 0.0)
        sde.set_seed(seed)
        sde.pin_noise(fine, problem.horizon / fine)
        sde.set_integration_parameters(atol=rtol, rtol=rtol, min_step=1e-9, first_step=min(0.1, math.sqrt(rtol)))
        return sde.integrate(problem.horizon)

    apart = [end(seed, tolerance) - end(seed, tolerance / 100) for seed in range(PATHS)]
    error = float(np.sqrt(np.square(apart).sum(axis=1).mean()))
    least = math.inf
    for seed in range(PATHS):
        sde.set_initial_value(np.array([*problem.q0, *problem.p0]), 0.0)
        sde.set_seed(seed)
        begin = time.process_time()
        sde.integrate(problem.horizon)
        least = min(least, time.process_time() - begin)
    return Prepared(lambda: None, PATHS, error=error, seconds=least)


SCHEMES = {"adaptive": adaptive}
