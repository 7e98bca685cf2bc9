# SPDX-License-Identifier: BSD-3-Clause
"""Cost of one scheme at one step for a user: with increments of its own step."""

from __future__ import annotations

import time

import numpy as np

from ...answers.error_plan import SMALL, Plan
from ...run.states.law import States

TARGET = 0.02  #: least seconds of one repeat; a repeat of one long block takes more
MOST = 1024  #: most blocks of one repeat
COUNTERS = ("normals", "gradients", "hessians", "iterations", "solves")


def cost(plan: Plan, scheme, steps: int) -> dict:
    """Median seconds of a path with quartiles over warm repeats on one thread, and counters of a path-step.

    Seconds are processor time: equal to elapsed time on an idle machine, and without the time of other users on a busy
    one. The seconds of a run without steps, the same for any number of paths, are subtracted.
    """
    block = 256 if plan.model.ndof <= SMALL else 64
    paths = plan.paths  # if each path has its own initial state, all paths are needed
    if not has_columns(plan.q0, plan.p0):
        paths = block
        first = _seconds(plan, scheme, steps, block)[1] - _set_up(plan, scheme, steps, block)
        paths *= int(np.clip(round(TARGET / max(first, 1e-6)), 1, MOST))
    _seconds(plan, scheme, steps, paths)  # warm up
    set_up = _set_up(plan, scheme, steps, paths)
    seconds, elapsed = np.empty(plan.repeats), np.empty(plan.repeats)
    for i in range(plan.repeats):
        begin = time.perf_counter()
        report, seconds[i] = _seconds(plan, scheme, steps, paths)
        elapsed[i] = time.perf_counter() - begin
    seconds, elapsed = np.maximum(seconds - set_up, 1e-9) / paths, elapsed / paths
    counters = report.counters
    row = {
        "seconds": float(np.median(seconds)),
        "seconds_low": float(np.quantile(seconds, 0.25)),
        "seconds_high": float(np.quantile(seconds, 0.75)),
        "elapsed": float(np.median(elapsed)),
        "repeats": plan.repeats,
        "timing_paths": paths,
        "threads": report.threads,
    }
    per = max(counters["path_steps"], 1)
    return row | {name: counters[name] / per for name in COUNTERS}


def has_columns(*states) -> bool:
    """Whether some state has one column for each path."""
    return any(isinstance(x, States) or (np.ndim(x) == 2 and np.shape(x)[1] > 1) for x in states)


def _seconds(plan: Plan, scheme, steps: int, paths: int):
    """Report of a run and the processor's seconds that it took."""
    begin = time.process_time()
    report = plan.run(scheme, steps, shared=False, paths=paths, threads=1).report
    return report, time.process_time() - begin


def _set_up(plan: Plan, scheme, steps: int, paths: int) -> float:
    """The processor's seconds of a run without steps, the least of three."""
    least = np.inf
    for _ in range(3):
        begin = time.process_time()
        plan.set_up(scheme, steps, paths)
        least = min(least, time.process_time() - begin)
    return least
