# SPDX-License-Identifier: BSD-3-Clause
"""How long a step may be: the fastest frequency of the Hessian along the way that a path takes without noise.

With `paths`, along the ways of so many paths with noise, too: these may come to where the motion is faster.
"""

from __future__ import annotations

import math

import numpy as np

from ..errors import SymsdeError
from .problem import Problem

SHARPEST = 1.6  #: omega h of the longest step that is tried: explicit schemes end at 2
_POINTS = 9  #: of the way


def frequency(problem: Problem, paths: int = 0) -> float:
    """The largest frequency of the linearised equations, on a few points of the way; at least 1/horizon."""
    model = problem.model
    declared = model.traits.max_frequency
    known = [declared] if declared > 0 else []
    ways = [*_way(problem), *(_ways(problem, paths) if paths and model.nnoise else ())]
    blocks = zip(*(model.hessian(q, p, t=t) for t, q, p in ways), strict=True)
    qq, qp, pp = (np.moveaxis(np.concatenate(block, axis=2), 2, 0) for block in blocks)
    flow = np.block([[qp, pp], [-qq, -qp.transpose(0, 2, 1)]])
    flow = flow[np.isfinite(flow).all(axis=(1, 2))]
    known += np.abs(np.linalg.eigvals(flow)).ravel().tolist()
    return max([*known, 1 / problem.horizon])


def fewest_steps(problem: Problem) -> int:
    """Steps to the horizon, the fewest that every scheme may be tried with."""
    if "fewest steps" not in problem.known:
        problem.known["fewest steps"] = max(1, math.ceil(problem.horizon * frequency(problem) / SHARPEST))
    return problem.known["fewest steps"]


def _ways(problem: Problem, paths: int):
    """The same of paths with noise, without the first states; nothing where they fail."""
    rows = max(8 * (_POINTS - 1), fewest_steps(problem))
    rows += -rows % (_POINTS - 1)
    try:
        run = problem.run("midpoint", rows, paths=paths, save_every=rows // (_POINTS - 1), areas="path", area_time=None)
    except SymsdeError:
        return
    kept = run.status == 0
    for t, q, p in zip(run.t[1:], run.q[1:], run.p[1:], strict=True):
        if kept.any():
            yield t, q[:, kept], p[:, kept]


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
