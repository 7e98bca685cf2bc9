# SPDX-License-Identifier: BSD-3-Clause
"""One scheme on steps that are halved: its error by the step, and the longest step that keeps a tolerance.

With x_h, x_{h/2}, x_{h/4} on one path the order is a = log2(|x_h - x_{h/2}|/|x_{h/2} - x_{h/4}|). Between the last rung
that misses the tolerance and the next, with n and 2 n steps, the error is taken as a power of the step; beyond the last
rung as h^a:

    steps = n (error_n/tolerance)^(1/b),    b = log2(error_n/error_2n)
"""

from __future__ import annotations

import math
import time

from ...errors import SymsdeError
from ...schemes import Scheme
from ..expectation.problem import Problem
from .wants import Seen

MOST_HALVINGS = 10
_WORK = 2**23  #: path-steps times degrees of freedom of one measurement; beyond it the order predicts the error
_AHEAD = 3  #: largest number of halvings over which the order predicts the error
_CLEARLY = 4.0  #: the first rung decides alone if its error is smaller than the tolerance by this factor
_RUNS = 7.0  #: cost of a rung in runs of its step: the runs take 1, 2 and 4 times as many steps
_SLOWEST, _FASTEST = 0.45, 6.5  #: bounds of orders computed from differences
_TIMED = 2**17  #: path-steps times degrees of freedom of a timed run
_DEARER = 4.0  #: a scheme is given up if it costs this many times the best cost known


class Ladder:
    """Errors of a scheme with a number of steps, twice as many and so on, and the seconds of a path."""

    def __init__(self, problem: Problem, scheme: Scheme, want, *, fewest: int):
        """Start without measurements."""
        self.problem, self.scheme, self.want = problem, scheme, want
        self.steps: list[int] = []
        self.seen: list[Seen] = []
        self._fewest = fewest

    def climb(self, tolerance: float, best: float) -> float | None:
        """Number of steps that keeps the tolerance, not rounded; None if no affordable number does.

        best: seconds of a path of the best scheme so far; a scheme that costs much more is given up.
        """
        steps = self._fewest
        for _ in range(MOST_HALVINGS + 1):
            if len(self.seen) > 1 and steps * self.want.count * self.problem.model.ndof > _WORK:
                break
            begin = time.process_time()
            try:
                seen = self.want.see(self.scheme, steps)
            except SymsdeError:
                return None
            if not math.isfinite(seen.both):
                self.steps.clear(), self.seen.clear()
            else:
                self.steps.append(steps)
                self.seen.append(seen)
                if self.error(-1) <= tolerance and (len(self.seen) > 1 or self.error(0) <= tolerance / _CLEARLY):
                    return self._between(tolerance)
            if (time.process_time() - begin) / (_RUNS * self.want.count) > _DEARER * best:
                return None
            steps *= 2
        return self._beyond(tolerance) if len(self.seen) > 1 else None

    @property
    def order(self) -> float:
        """The order that the finest differences show."""
        one, other = self.seen[-1].first, self.seen[-1].second
        if not other:
            one, other = (x.both for x in self.seen[-2:]) if len(self.seen) > 1 else (2.0, 1.0)
        return min(max(math.log2(max(one, 1e-300) / max(other, 1e-300)), _SLOWEST), _FASTEST)

    def error(self, i: int) -> float:
        """Error of the scheme at the step of a rung."""
        return self.seen[i].error(self.order)

    def _between(self, tolerance: float) -> float:
        """Number of steps between the last rung that misses the tolerance and the next, by a power law."""
        missed = [i for i in range(len(self.seen)) if self.error(i) > tolerance]
        if not missed:
            return float(self.steps[0])
        i = missed[-1]
        slope = math.log2(self.error(i) / self.error(i + 1))
        return self.steps[i] * (self.error(i) / tolerance) ** (1 / slope)

    def _beyond(self, tolerance: float) -> float | None:
        """Number of steps beyond the last rung, by the measured order."""
        factor = (self.error(-1) / tolerance) ** (1 / self.order)
        return self.steps[-1] * factor if factor <= 2.0**_AHEAD else None

    def seconds(self, steps: int) -> float:
        """Seconds of a path with this many steps, without the set-up: the smallest of three measurements."""
        size = steps * self.problem.model.ndof
        paths = max(64, _TIMED // size // 64 * 64)
        least = min(self._timed(steps, paths) for _ in range(3))
        return max(least - min(self._timed(steps, 8) for _ in range(3)), least / 4) / (paths - 8)

    def _timed(self, steps: int, paths: int) -> float:
        begin = time.process_time()
        self.problem.run(self.scheme, steps, paths=paths, threads=1)
        return time.process_time() - begin
