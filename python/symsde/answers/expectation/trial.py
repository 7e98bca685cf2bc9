# SPDX-License-Identifier: BSD-3-Clause
"""What a pilot knows of one scheme: weak error and cost by the step, from coupled paths of few levels.

    E f - E f(x_l) = sum_{k=l+1}^{L} E d_k + (what is left at the finest level L),    C(n) = a + b n seconds of a path

with d_k as in `coupled.py`; between two levels the bias is taken for a multiple of h^a and a number, and a level beyond
the finest one for what bias.py makes of the differences.
"""

from __future__ import annotations

import math
import time

from ...schemes import Scheme
from ..coupled import NOTHING, Levels, LevelSampler
from . import quasi
from .candidates import of_phases, weak_order
from .estimators import Estimator, Plain
from .longest_step import SHARPEST, fewest_steps
from .problem import Problem
from .tally import Tally
from .variants import LONG, Even, Variant, measure, measure_changes, measure_even

LEVELS = 4  #: of a pilot, the first without differences
MOST_HALVINGS = 10  #: of the finest of them
_NEARLY = 1 - 1e-12  #: rounding of powers of two is no step more
_LEAST_TIMED, _TIMED = 256, 1024  #: paths of a call that is timed
_LONG_ENOUGH = 5e-4  #: seconds of such a call, beyond which it is made no longer
_TIMES = 2  #: that short calls are timed, whose difference tells what a path takes
_TURNED = 2.0  #: omega T (omega h)^a, below which no phase is a tenth of a radian off
_NEARER = 0.75  #: times the mean square at one halving, that at the next may be
UNSTABLE = 4  #: coarsest steps that are tried, each half of the one before, where paths fail


class Trial(Levels):
    """A scheme on a ladder of LEVELS steps, each half of the one before."""

    def __init__(self, problem: Problem, scheme: Scheme, coarsest: int, paths: int):
        """Try the ladder from so many coarsest steps on, with so many paths of a level.

        If paths fail, a ladder with steps half as long is tried, four in all; `usable` says whether one of them held.
        """
        super().__init__(weak_order(problem, scheme), Tally())
        self.problem, self.scheme = problem, scheme
        self.seconds_spent = 0.0
        self.loading = 0.0  #: seconds of packages, once a process
        self.usable = False
        self.doubled = 0  #: times
        self._biases: dict[float, tuple[float, float]] = {}  #: by level, of the draws so far
        self.measured: dict[str, Variant | None] = {}  #: by method
        self.even: dict[int, Even | None] = {}  #: by level
        self.changes: dict[int, Tally | None] = {}  #: of f from the level before, with a control variate
        for _ in range(UNSTABLE):
            self.sampler, self._first = LevelSampler(problem, scheme, coarsest), 0
            self.draws = [NOTHING] * LEVELS
            self.more(paths)
            if self._holds():
                self.usable = True
                self._time()
                return
            coarsest *= 2

    def _holds(self) -> bool:
        """Whether no path failed, and the changes from level to level do not grow beyond the variation of f."""
        if any(draw.failed for draw in self.draws):
            return False
        spread = [draw.variance for draw in self.draws[1:]]
        return all(map(math.isfinite, spread)) and spread[-1] <= 4 * max(spread[0], self.draws[0].fine.variance)

    def more(self, paths: int) -> None:
        """Draw so many more paths on every level."""
        for level in range(LEVELS):
            self._draw(level, paths)

    def double(self) -> None:
        """Double the paths of every level above 0."""
        self.doubled += 1
        for level in range(1, LEVELS):
            self._draw(level, self.draws[level].difference.n)

    def go_finer(self) -> None:
        """Move the ladder on by a halving: its coarsest level is dropped, and one beyond the finest is drawn."""
        self._first += 1
        self.draws = [*self.draws[1:], NOTHING]
        self.even, self.changes, self.measured = {}, {}, {}
        self._draw(LEVELS - 1, self.draws[-2].difference.n)

    @property
    def may_go_finer(self) -> bool:
        """Whether the levels are not settled, but finer steps may settle them.

        They may if paths come nearer to each other at each halving, or if phases are still wrong. The error of a phase
        is at most (omega h)^a/20 a radian. If that is small up to the horizon, and paths end apart all the same, they
        part because the motion is unstable.
        """
        fewest = fewest_steps(self.problem)
        turned = fewest * SHARPEST * (SHARPEST * fewest / self.steps(LEVELS - 1)) ** of_phases(self.scheme, self.order)
        nearer = self.square_of(LEVELS - 1) < _NEARER * self.square_of(LEVELS - 2)
        return not self.settled and self._first < MOST_HALVINGS and (turned > _TURNED or nearer)

    def seconds_to_tell(self, error: float) -> float:
        """Estimated seconds until the bias is known to this error, by finer steps or by more paths."""
        seconds = sum(draw.seconds for draw in self.draws[1:])
        noise = self.bias(LEVELS - 1)[1]
        return seconds if self.may_go_finer else seconds * (noise / error) ** 2

    def _draw(self, level: int, paths: int) -> None:
        self._biases.clear()
        drawn = self.sampler.draw(self._first + level, paths)
        self.draws[level] += drawn
        self.seconds_spent += drawn.seconds

    def _time(self) -> None:
        """Fit seconds of a path as a + b n, with n the number of steps; the seconds of a call are left out."""
        few, many = (self.steps(level) for level in (0, LEVELS - 1))
        drawn = self.draws[-1]
        enough = _LONG_ENOUGH * drawn.difference.n / max(drawn.seconds, 1e-9)
        paths = _TIMED if enough > _TIMED else _LEAST_TIMED
        long = self._seconds_of(many, paths)  # the first call, which takes longer than later ones, is the longest
        pairs = [(self._seconds_of(few, paths // 8), self._seconds_of(few, paths)) for _ in range(_TIMES)]
        little, short = map(min, zip(*pairs, strict=True))
        path = max((short - little) / (paths - paths // 8), 0.1 * short / paths)
        call = short - path * paths
        last = max((long - call) / paths, path)
        self._slope = max((last - path) / (many - few), 0.2 * last / many)
        self._once = max(path - self._slope * few, 0.0)

    def _seconds_of(self, steps: int, count: int) -> float:
        """Seconds of a call for so many paths."""
        seconds = Plain(self.problem, self.scheme, steps, 0).draw(count).seconds
        self.seconds_spent += seconds
        return seconds

    def look_at(self, kind: type[Estimator], level: float) -> None:
        """Measure a few units of another method at a level."""
        self.measured[kind.name] = measure(self, kind, level)

    def look_evenly(self, level: int, most: int = LONG) -> None:
        """Measure a few scramblings of 2^most Sobol points at a level."""
        begin = time.process_time()
        quasi.load()
        self.loading += time.process_time() - begin
        self._biases.clear()
        self.even[level] = measure_even(self, level, most)

    def look_at_changes(self) -> None:
        """Measure the changes from level to level, minus their linear response to the noise (a control variate).

        For linear models no noise is left.
        """
        self._biases.clear()
        self.changes = {level: measure_changes(self, level) for level in range(1, LEVELS)}

    def seconds(self, level: float) -> float:
        """Seconds of a path at a level of the ladder, which may lie between two of its steps."""
        return self._once + self._slope * self.sampler.coarsest * 2.0 ** (self._first + level)

    def steps(self, level: float) -> int:
        """Number of steps to the horizon at a level."""
        return math.ceil(self.sampler.coarsest * 2.0 ** (self._first + level) * _NEARLY)

    @property
    def settled(self) -> bool:
        """Whether powers of h may be counted on."""
        return self.are_settled(*self._differences(), self.order)

    def bias(self, level: float) -> tuple[float, float]:
        """E f - E f(x_h) at a level of the ladder, and the standard error of this estimate.

        Between two levels it is interpolated by b_0 + b_1 h^a, where a is the weak order.
        """
        if level not in self._biases:
            self._biases[level] = self._bias(level)
        return self._biases[level]

    def _bias(self, level: float) -> tuple[float, float]:
        """The same, computed anew."""
        if level != int(level):
            begin = math.floor(level)
            coarse, fine = self.bias(begin), self.bias(begin + 1)
            if not self.settled:
                return coarse
            share = (2 ** (self.order * (begin + 1 - level)) - 1) / (2**self.order - 1)
            return tuple(y + share * (x - y) for x, y in zip(coarse, fine, strict=True))
        means, errors = self._differences()
        return self._left(means, errors, int(level))

    def rest(self, level: int) -> tuple[float, float]:
        """The same for extrapolation from this level and the one before it. Its order is taken to be a, too."""
        means, errors = self._differences()
        up, whole = 2**self.order, 2**self.order - 1
        pairs = range(1, len(means))
        changes = [(up * means[i] - means[i - 1]) / whole for i in pairs]
        return self._left(changes, [math.hypot(up * errors[i], errors[i - 1]) / whole for i in pairs], level)

    def _differences(self) -> tuple[list[float], list[float]]:
        """Means of f(x_h) - f(x_2h) at levels above 0, and their errors; each is the best known by any method."""
        means = [draw.difference.mean for draw in self.draws[1:]]
        errors = [self.error_of(level) for level in range(1, LEVELS)]
        known = [(level, x.change[x.most].mean, x.error) for level, x in self.even.items() if x and x.error > 0]
        known += [(level, x.mean, x.error) for level, x in self.changes.items() if x is not None]
        for level, mean, error in known:  # the best known
            if level > 0 and error < errors[level - 1]:
                means[level - 1], errors[level - 1] = mean, error
        return means, errors

    def spread(self, level: int) -> float:
        """Variance of f(x_h) - f(x_2h) at a level above 0; beyond the finest level it is extrapolated."""
        known = [draw.variance for draw in self.draws]
        if level < LEVELS:
            return known[level]
        fall = known[-1] / known[-2] if known[-2] > 0 else 1.0
        return known[-1] * min(fall, 1.0) ** (level - LEVELS + 1)

    def _left(self, means: list[float], errors: list[float], level: int) -> tuple[float, float]:
        """What all finer levels together add to the mean of a level, and its error, from the differences known."""
        halved = max(level - LEVELS + 1, 0)
        tail, noise = self.left_by(means, errors, self.order, phases=self.order, settled=self.settled, halved=halved)
        finer = LEVELS - 1 - level
        return (tail + sum(means[-finer:]), math.hypot(noise, *errors[-finer:])) if finer > 0 else (tail, noise)
