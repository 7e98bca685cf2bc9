# SPDX-License-Identifier: BSD-3-Clause
"""Clocks for tests of measured cost: no test depends on the speed or load of a machine."""

import sys
import time

import numpy as np
from symsde.run.moments import Moments
from symsde.run.simulate import Run


class Clock:
    """Seconds, of which each look at f takes one, or each path of a look."""

    def __init__(self, *, by_paths: bool = False):
        self.now = 0.0
        self.by_paths = by_paths

    def __call__(self) -> float:
        return self.now

    def f(self, q: np.ndarray, p: np.ndarray) -> np.ndarray:
        """q_1 squared."""
        self.now += q.shape[-1] if self.by_paths else 1.0
        return q[..., 0, :] ** 2


class WorkClock:
    """Seconds of a processor that every run moves on by what it has counted: a tenth of a millisecond for its set-up,
    then ten nanoseconds for each degree of freedom of an evaluation, a solve or a draw, and one for a step."""

    def __init__(self, monkeypatch):
        """From now on, instead of the processor's and of the clock: nobody else is at work."""
        self.now = 0.0
        for name in ("process_time", "monotonic"):
            monkeypatch.setattr(time, name, lambda: self.now)
        for kind in (Run, Moments):
            monkeypatch.setattr(kind, "fill", self._counting(kind.fill))

    def _counting(self, fill):
        def counted(result, *given, **more):
            fill(result, *given, **more)
            n, ndof = result.report.counters, result.setup.model.ndof
            work = sum(n[name] for name in ("gradients", "hessians", "hessian_vectors", "solves", "iterations"))
            self.now += 1e-4 + 1e-8 * (ndof * (work + n["path_steps"]) + n["normals"])

        return counted


def calls_of(function) -> int:
    """How many functions of Python a call of this one calls: its work, on whatever machine."""
    count = 0

    def seen(_frame, event, _given):
        nonlocal count
        count += event == "call"

    before = sys.getprofile()
    sys.setprofile(seen)
    try:
        function()
    finally:
        sys.setprofile(before)
    return count
