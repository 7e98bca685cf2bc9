# SPDX-License-Identifier: BSD-3-Clause
"""Clocks for tests of measured cost: no test depends on the speed or load of a machine."""

import sys
import time

import numpy as np
from symsde.run.moments import Moments
from symsde.run.simulate import Run


class Clock:
    """A clock in seconds that advances by one at each evaluation of f, or by one for each path."""

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
    """A processor clock that every run advances by its counters: a tenth of a millisecond for its set-up,
    then ten nanoseconds for each degree of freedom of an evaluation, a solve or a draw, and one nanosecond for each of
    a step."""

    def __init__(self, monkeypatch):
        """Replace the processor's clock and the wall clock: time passes by counted work alone."""
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
    """How many Python functions run during a call of this function: a measure of work that no machine changes."""
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
