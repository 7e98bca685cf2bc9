# SPDX-License-Identifier: BSD-3-Clause
"""Cost of one scheme at one step: what a user pays, with increments of its own step."""

from __future__ import annotations

import numpy as np

from .plan import SMALL, Plan

TARGET = 0.02  #: seconds of one repeat, more where one block takes longer
MOST = 16  #: blocks of one repeat
COUNTERS = ("normals", "gradients", "hessians", "iterations", "solves")


def cost(plan: Plan, scheme, steps: int) -> dict:
    """Median seconds of a path with quartiles over warm repeats on one thread, and counters of a path-step."""
    block = 256 if plan.model.ndof <= SMALL else 64
    block = min(block, plan.paths) if np.ndim(plan.q0) == 2 or np.ndim(plan.p0) == 2 else block
    warm = _run(plan, scheme, steps, block)
    paths = block
    if np.ndim(plan.q0) < 2 and np.ndim(plan.p0) < 2:
        paths *= int(np.clip(round(TARGET / max(_seconds(warm), 1e-6)), 1, MOST))
    runs = [_run(plan, scheme, steps, paths) for _ in range(plan.repeats)]
    seconds = np.array([_seconds(run) for run in runs]) / paths
    counters = runs[-1].report.counters
    row = {
        "seconds": float(np.median(seconds)),
        "seconds_low": float(np.quantile(seconds, 0.25)),
        "seconds_high": float(np.quantile(seconds, 0.75)),
        "repeats": plan.repeats,
        "timing_paths": paths,
        "threads": runs[-1].report.threads,
    }
    per = max(counters["path_steps"], 1)
    return row | {name: counters[name] / per for name in COUNTERS}


def _run(plan: Plan, scheme, steps: int, paths: int):
    return plan.run(scheme, steps, shared=False, paths=paths, threads=1)


def _seconds(run) -> float:
    return run.report.timings["run"]
