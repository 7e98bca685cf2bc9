# SPDX-License-Identifier: BSD-3-Clause
"""How long a step may be: the fastest frequency of the Hessian along the way that a path takes without noise."""

from __future__ import annotations

import math

import numpy as np

from ..errors import SymsdeError
from .problem import Problem

SHARPEST = 1.6  #: omega h of the longest step that is tried: explicit schemes end at 2
_POINTS = 9  #: of the way


def frequency(problem: Problem) -> float:
    """The largest frequency of the linearised equations, on a few points of the way; at least 1/horizon."""
    model = problem.model
    declared = model.traits.max_frequency
    known = [declared] if declared > 0 else []
    for t, q, p in _way(problem):
        qq, qp, pp = (block[:, :, 0] for block in model.hessian(q, p, t=t))
        flow = np.block([[qp, pp], [-qq, -qp.T]])
        if np.isfinite(flow).all():
            known.append(float(np.abs(np.linalg.eigvals(flow)).max()))
    return max([*known, 1 / problem.horizon])


def fewest_steps(problem: Problem) -> int:
    """Steps to the horizon, the fewest that every scheme may be tried with."""
    return max(1, math.ceil(problem.horizon * frequency(problem) / SHARPEST))


def _way(problem: Problem):
    """Times and states without noise, by 64 steps of the midpoint rule; the initial one where it fails."""
    yield problem.options.get("t0", 0.0), problem.q0, problem.p0
    rows = 8 * (_POINTS - 1)
    try:
        increments = np.zeros((rows, problem.model.nnoise))
        run = problem.run("midpoint", rows, increments=increments, paths=1, save_every=8, areas="path", area_time=None)
    except SymsdeError:
        return
    for t, q, p in zip(run.t[1:], run.q[1:], run.p[1:], strict=True):
        if np.isfinite(q).all() and np.isfinite(p).all():
            yield t, q, p
