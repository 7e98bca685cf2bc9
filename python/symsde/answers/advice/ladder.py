# SPDX-License-Identifier: BSD-3-Clause
"""One scheme on steps that are halved: its error by the step, and the longest step that keeps a tolerance.

A rung is a measurement with n, 2 n and 4 n steps, which costs about 7 runs with n steps. The next rung takes twice the
processor time of the last one; the first rung is foretold from four steps of 64 paths, of fewer where there are many
degrees of freedom.

With x_h, x_{h/2}, x_{h/4} on one path the order is a = log2(|x_h - x_{h/2}|/|x_{h/2} - x_{h/4}|). Between the last rung
that misses the tolerance and the next, with n and 2 n steps, the error is taken as a power of the step; beyond the last
rung as h^a:

    steps = n (error_n/tolerance)^(1/b),    b = log2(error_n/error_2n)
"""

from __future__ import annotations

import math
import time
from itertools import pairwise

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
_TIMINGS = 3.5  #: cost of the timed runs of `seconds` in runs with all paths: three of all paths and three of eight
_DEARER = 8.0  #: a scheme is given up if a rung, with its set-up, costs this many times the best cost known
_FIRST = 4  #: number of steps from which the cost of the first rung is foretold
_FULL = 64  #: number of paths from which on a path-step costs the same
_STATES = 2**12  #: paths times degrees of freedom from which on it does, too


class Ladder:
    """Errors of a scheme with a number of steps, twice as many and so on, and the seconds of a path.

    climbing: whether a further rung may help. rungs: how many were measured. needed: the number of steps that keeps the
    tolerance, not rounded, or None.
    """

    def __init__(self, problem: Problem, scheme: Scheme, want, *, fewest: int, tolerance: float):
        """Start without measurements."""
        self.problem, self.scheme, self.want, self.tolerance = problem, scheme, want, tolerance
        self.steps: list[int] = []
        self.seen: list[Seen] = []
        self.needed: float | None = None
        self.climbing, self.rungs = True, 0
        self._next = fewest
        self._of_step = math.inf  #: seconds of one step of one path, at most: measured with parts of the set-up

    def __str__(self) -> str:
        """The next rung in words."""
        return f"{self.scheme.name}, {self._next} steps"

    @property
    def ahead(self) -> float:
        """Seconds of processor time that the next rung will take."""
        return _RUNS * self.want.count * self._next * self._of_step

    def prepare(self) -> None:
        """Measure one step of one path, from runs of no step and of a few; a scheme whose steps are refused is left
        out.
        """
        times, paths = [time.process_time()], max(8, min(_FULL, _STATES // self.problem.model.ndof))
        try:
            for taken in (0, _FIRST):
                self.problem.start(self.scheme, self._next, taken, paths=paths)
                times.append(time.process_time())
        except SymsdeError:
            self.climbing = False
            return
        without, together = (b - a for a, b in pairwise(times))
        self._of_step = max(together - without, together / 10) / (_FIRST * paths)

    def climb(self, best: float) -> None:
        """Measure one rung. best: seconds of a path of the best scheme so far; a scheme that costs much more is given
        up.
        """
        steps, begin = self._next, time.process_time()
        self.rungs += 1
        try:
            seen = self.want.see(self.scheme, steps)
        except SymsdeError:
            self.climbing = False
            return
        of_step = (time.process_time() - begin) / (_RUNS * self.want.count * steps)
        self._of_step = min(of_step, self._of_step)
        self._next = 2 * steps
        if not math.isfinite(seen.both):
            self.steps.clear(), self.seen.clear()
        else:
            self.steps.append(steps)
            self.seen.append(seen)
            kept = self.error(-1) <= self.tolerance
            if kept and (len(self.seen) > 1 or self.error(0) <= self.tolerance / _CLEARLY):
                self.climbing, self.needed = False, self._between()
                return
        if steps * self._of_step > _DEARER * best:
            self.climbing = False
        elif self.rungs > MOST_HALVINGS or (
            len(self.seen) > 1 and self._next * self.want.count * self.problem.model.ndof > _WORK
        ):
            self.climbing = False
            self.foretell(_AHEAD)

    def foretell(self, halvings: float) -> None:
        """Foretell the steps that the tolerance needs, at most this many halvings ahead: by the measured order, and
        beyond _AHEAD halvings by the claimed one, if that is lower.
        """
        if len(self.seen) < 2:
            return
        excess = math.log2(self.error(-1) / self.tolerance)
        ahead = excess / self.order
        if ahead > _AHEAD:
            ahead = excess / min(self.order, self.want.claimed(self.scheme))
        self.needed = self.steps[-1] * 2.0**ahead if ahead <= halvings else None

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

    def _between(self) -> float:
        """Number of steps between the last rung that misses the tolerance and the next, by a power law."""
        missed = [i for i in range(len(self.seen)) if self.error(i) > self.tolerance]
        if not missed:
            return float(self.steps[0])
        i = missed[-1]
        slope = math.log2(self.error(i) / self.error(i + 1))
        return self.steps[i] * (self.error(i) / self.tolerance) ** (1 / slope)

    def seconds(self, steps: int, most: float = math.inf) -> float:
        """Seconds of a path with this many steps, without the set-up: the smallest of three measurements, or the
        seconds of the last rung if the measurements would take more than `most`.
        """
        size = steps * self.problem.model.ndof
        paths = max(_FULL, _TIMED // size // _FULL * _FULL)
        if most < math.inf and _TIMINGS * paths * steps * self._of_step > most:
            return steps * self._of_step
        least = min(self._timed(steps, paths) for _ in range(3))
        return max(least - min(self._timed(steps, 8) for _ in range(3)), least / 4) / (paths - 8)

    def _timed(self, steps: int, paths: int) -> float:
        begin = time.process_time()
        self.problem.run(self.scheme, steps, paths=paths, threads=1)
        return time.process_time() - begin
