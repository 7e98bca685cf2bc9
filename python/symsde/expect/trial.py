# SPDX-License-Identifier: BSD-3-Clause
"""What a pilot knows of one scheme: weak error and cost by the step, from coupled paths of few levels."""

from __future__ import annotations

import math
import time

from ..mlmc.sampler import NOTHING, Draw, LevelSampler
from ..schemes import Scheme
from . import bias as weak
from . import quasi
from .candidates import weak_order
from .estimators import Estimator, Plain
from .problem import Problem
from .tally import Tally
from .variants import LONG, Even, Variant, measure, measure_changes, measure_even

LEVELS = 4  #: of a pilot, the first without differences
MOST_HALVINGS = 10  #: of the finest of them
_NEARLY = 1 - 1e-12  #: rounding of powers of two is no step more
_LEAST_TIMED, _TIMED = 256, 1024  #: paths of a call that is timed
_LONG_ENOUGH = 5e-4  #: seconds of such a call, beyond which it is made no longer
_TIMES = 2  #: that short calls are timed, whose difference tells what a path takes
UNSTABLE = 4  #: coarsest steps that are tried, each half of the one before, where paths fail


class Trial:
    """A scheme on a ladder of steps, each half of the one before."""

    def __init__(self, problem: Problem, scheme: Scheme, coarsest: int, paths: int):
        """Try the ladder with few paths; `usable` tells whether any of it holds."""
        self.problem, self.scheme = problem, scheme
        self.order = weak_order(problem, scheme)
        self.seconds_spent = 0.0
        self.known_variance = 0.0
        self.loading = 0.0  #: seconds of packages, once a process
        self.usable = False
        self.doubled = 0  #: times
        self._biases: dict[float, tuple[float, float]] = {}  #: by level, of the draws so far
        self.measured: dict[str, Variant | None] = {}  #: by method
        self.even: dict[int, Even | None] = {}  #: by level
        self.changes: dict[int, Tally | None] = {}  #: of f from the level before, with a control variate
        for _ in range(UNSTABLE):
            self.sampler = LevelSampler(problem, scheme, coarsest)
            self.draws: list[Draw] = [NOTHING] * LEVELS
            self.more(paths)
            if self._holds():
                self.usable = True
                self._time()
                return
            coarsest *= 2

    def _holds(self) -> bool:
        """No path failed, and the levels do not move apart by more than f varies."""
        if any(draw.failed for draw in self.draws):
            return False
        spread = [draw.variance for draw in self.draws[1:]]
        return all(map(math.isfinite, spread)) and spread[-1] <= 4 * max(spread[0], self.draws[0].fine.variance)

    def more(self, paths: int) -> None:
        """More paths on every level."""
        for level in range(LEVELS):
            self._draw(level, paths)

    def double(self) -> None:
        """Twice the paths of the levels with differences."""
        self.doubled += 1
        for level in range(1, LEVELS):
            self._draw(level, self.draws[level].difference.n)

    def _draw(self, level: int, paths: int) -> None:
        self._biases.clear()
        drawn = self.sampler.draw(level, paths)
        self.draws[level] += drawn
        self.seconds_spent += drawn.seconds

    def _time(self) -> None:
        """Seconds of a path as a + b steps, those of a call apart."""
        few, many = (self.sampler.steps(level) for level in (0, LEVELS - 1))
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
        """Of a call for so many paths."""
        seconds = Plain(self.problem, self.scheme, steps, 0).draw(count).seconds
        self.seconds_spent += seconds
        return seconds

    def look_at(self, kind: type[Estimator], level: float) -> None:
        """What few units of another method show."""
        self.measured[kind.name] = measure(self, kind, level)

    def look_evenly(self, level: int, most: int = LONG) -> None:
        """What few scramblings of 2^most Sobol points show at a level."""
        begin = time.process_time()
        quasi.load()
        self.loading += time.process_time() - begin
        self._biases.clear()
        self.even[level] = measure_even(self, level, most)

    def look_at_changes(self) -> None:
        """What levels change, without what a linear response to the noise changes: of linear models without noise."""
        self._biases.clear()
        self.changes = {level: measure_changes(self, level) for level in range(1, LEVELS)}

    def seconds(self, level: float) -> float:
        """Of a path at a level of the ladder."""
        return self._once + self._slope * self.sampler.coarsest * 2.0**level

    def steps(self, level: float) -> int:
        """Steps to the horizon at a level."""
        return math.ceil(self.sampler.coarsest * 2.0**level * _NEARLY)

    @property
    def variance(self) -> float:
        """Of f; at least that of the values looked at, where few of the trial's own differ."""
        own = self.draws[-1].fine
        return max(own.variance, self.known_variance) if own.few else own.variance

    def bias(self, level: float) -> tuple[float, float]:
        """E f - E f(x_h) at a level of the ladder, and the standard error of this estimate.

        Between two levels it falls as a power, with the sign and the relative error of the finer one.
        """
        if level not in self._biases:
            self._biases[level] = self._bias(level)
        return self._biases[level]

    def _bias(self, level: float) -> tuple[float, float]:
        if level != int(level):
            begin = math.floor(level)
            coarse, fine = self.bias(begin), self.bias(begin + 1)
            ends = [max(math.hypot(*x), 1e-300) for x in (coarse, fine)]
            larger = (ends[0] / ends[1]) ** (begin + 1 - level)
            return fine[0] * larger, fine[1] * larger
        level = int(level)
        means, errors = self._differences()
        return _left(means, errors, self.order, level)

    def rest(self, level: int) -> tuple[float, float]:
        """The same of what extrapolation from this level and the one before leaves; its order is taken as no higher."""
        means, errors = self._differences()
        up, whole = 2**self.order, 2**self.order - 1
        pairs = range(1, len(means))
        changes = [(up * means[i] - means[i - 1]) / whole for i in pairs]
        return _left(changes, [math.hypot(up * errors[i], errors[i - 1]) / whole for i in pairs], self.order, level)

    def _differences(self) -> tuple[list[float], list[float]]:
        """Means of f(x_h) - f(x_2h) at levels above 0, and their errors."""
        means = [draw.difference.mean for draw in self.draws[1:]]
        errors = [draw.error for draw in self.draws[1:]]
        known = [(level, x.change[x.most].mean, x.error) for level, x in self.even.items() if x and x.error > 0]
        known += [(level, x.mean, x.error) for level, x in self.changes.items() if x is not None]
        for level, mean, error in known:  # the best known
            if level > 0 and error < errors[level - 1]:
                means[level - 1], errors[level - 1] = mean, error
        return means, errors

    def spread(self, level: int) -> float:
        """Variance of f(x_h) - f(x_2h) at a level above 0; beyond those tried, it falls as there."""
        known = [draw.variance for draw in self.draws]
        if level < LEVELS:
            return known[level]
        fall = known[-1] / known[-2] if known[-2] > 0 else 1.0
        return known[-1] * min(fall, 1.0) ** (level - LEVELS + 1)


def _left(means: list[float], errors: list[float], order: float, level: int) -> tuple[float, float]:
    """What all finer levels add to a level, and its error, from differences up to the last level that was tried."""
    if level >= LEVELS - 1:
        return weak.left(means, errors, order, level - LEVELS + 1)
    tail, noise = weak.left(means, errors, order)
    finer = len(means) - (LEVELS - 1 - level)
    return tail + sum(means[finer:]), math.hypot(noise, *errors[finer:])
