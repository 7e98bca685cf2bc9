# SPDX-License-Identifier: BSD-3-Clause
"""A pilot's measurements of one scheme: bias, variance and seconds as functions of the step, from coupled paths.

    E f - E f(x_l) = sum_{k=l+1}^{L} E d_k + (the bias of the finest level L),    C(n) = a + b n seconds of a path

with d_k as in `coupled.py`. Between two levels the bias is interpolated as a constant plus a multiple of h^a; beyond
the finest level bias.py extrapolates the differences.

On request the pilot also measures antithetic pairs at a level, and scramblings with few and with more Sobol points:
the variance of a unit of N = 2^k points is assumed to fall as N^-s, with

    s = (w s_seen + u s_usual)/(w + u),    w = (log2(N_2/N_1)/1.06)^2,    u = (1/0.3)^2,

the mean of the measured and the usual exponent, weighted by their accuracy.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from ...schemes import Scheme
from ..coupled import NOTHING, Levels, LevelSampler
from .candidates import SHARPEST, fewest_steps, of_phases, weak_order
from .estimators import Antithetic, Drawn, Plain, Quasi, columns, load, quasi_applies, seconds_to_load
from .interval import Tally
from .problem import Problem

LEVELS = 4  #: number of levels of a pilot: three differences determine a power of h and its doubt
MOST_HALVINGS = 10  #: most halvings of the finest step: no extrapolation is trusted beyond a factor of a thousand
UNSTABLE = 4  #: number of coarsest steps that are tried if paths fail, each half of the one before
UNITS = 256  #: number of antithetic pairs to measure: enough to know their variance to a tenth of its value
#: log2 of few and of more points, and number of scramblings: eight times as many points show how the variance falls
SHORT, LONG, SCRAMBLINGS = 5, 8, 8
FIRST = 2**45  #: index of the first path of measurements, far from the paths of levels and of answers
USUAL, OF_JUMPS = 1.5, 1.1  #: exponents s of smooth f (mostly 1.2 to 1.8) and of truth values (0.9 to 1.3)
_USUALLY = 0.3  #: scatter of these exponents
_DOUBT = 1.06  #: standard error of log2 of the ratio of two variances, each of eight units
_FEW = 1.2  #: factor on a standard error from eight units: Student's quantile over the normal one
_TIMED = 1024  #: paths of a timed call: they take many times as long as the call alone
_LONG_ENOUGH = 5e-4  #: if a timed call takes more seconds, a quarter of the paths is enough
_TURNED = 2.0  #: if omega T (omega h)^a is smaller, no phase has an error above a tenth of a radian
_NEARER = 0.75  #: paths approach each other if a halving leaves less than this part of their mean square distance
_NEARLY = 1 - 1e-12  #: factor before a number of steps is rounded up, so that rounding of a power of two adds no step
#: rough seconds of a call, of scrambling a dimension, and of a bridged normal
_CALL, _MATRIX, _NUMBER = 1e-4, 2.2e-5, 2e-8
_SLOWER = 1.5  #: a path of given increments takes about this many times as long as other paths


@dataclass(frozen=True)
class Pairs:
    """Antithetic pairs, measured at a level."""

    level: float
    variance: float  #: variance of a pair
    seconds: float  #: seconds of a pair


@dataclass(frozen=True)
class Even:
    """Scramblings with few and with more Sobol points at a level: means of f, and of its change from the level
    before.
    """

    level: int
    fine: dict[int, Tally]  #: log2 of the number of points -> tally of f
    change: dict[int, Tally]  #: log2 of the number of points -> tally of the change; at level 0 of f itself
    path: float  #: seconds of a point, both paths included
    once: float  #: seconds of matrices and calls, which do not depend on the number of points
    usual: float = USUAL  #: usual fall of the variance of units for an f of this kind

    @property
    def error(self) -> float:
        """Standard error of the mean change, from the units with the most points."""
        return _FEW * self.change[self.most].error

    @property
    def most(self) -> int:
        """log2 of the largest number of points of a unit."""
        return max(self.fine)

    def fall(self, units: dict[int, Tally]) -> float:
        """The exponent s of the module docstring, clipped to 1 .. 3, of `fine` or `change`."""
        short, most = min(units), max(units)
        few, more = (max(units[points].variance, 1e-300) for points in (short, most))
        weight, usual = ((most - short) / _DOUBT) ** 2, _USUALLY**-2
        seen = math.log2(few / more) / (most - short)
        return min(max((weight * seen + usual * self.usual) / (weight + usual), 1.0), 3.0)


class Trial(Levels):
    """A scheme on a ladder of LEVELS steps, each half of the one before."""

    def __init__(self, problem: Problem, scheme: Scheme, coarsest: int, paths: int):
        """Try a ladder that begins with this many steps and has this many paths per level.

        If paths fail, a ladder with steps half as long is tried, up to four in all; `usable` is true if one of them
        worked.
        """
        super().__init__(weak_order(problem, scheme), Tally())
        self.problem, self.scheme = problem, scheme
        self.loading = 0.0  #: seconds of loading packages, spent once in a process
        self.usable = False
        self.doubled = 0  #: number of doublings so far
        self._changed()
        self.pairs: Pairs | None = None
        self.even: dict[int, Even | None] = {}  #: level -> measurement; None if none was possible
        begin = time.process_time()
        for _ in range(UNSTABLE):
            self.sampler, self._first = LevelSampler(problem, scheme, coarsest), 0
            self.draws = [NOTHING] * LEVELS
            for level in range(LEVELS):
                self._draw(level, paths)
            if self._holds():
                self.usable = True
                self._time()
                break
            coarsest *= 2
        self.seconds_spent = time.process_time() - begin

    def _holds(self) -> bool:
        """Whether no path failed, and the changes from level to level do not grow beyond the variation of f."""
        if any(draw.failed for draw in self.draws):
            return False
        spread = [draw.variance for draw in self.draws[1:]]
        return all(map(math.isfinite, spread)) and spread[-1] <= 4 * max(spread[0], self.draws[0].fine.variance)

    def double(self) -> None:
        """Double the paths of every level above 0."""
        self.doubled += 1
        for level in range(1, LEVELS):
            self._draw(level, self.draws[level].difference.n)

    def go_finer(self) -> None:
        """Move the ladder by a halving: drop its coarsest level, and draw one beyond the finest."""
        self._first += 1
        self.draws = [*self.draws[1:], NOTHING]
        self.even, self.pairs = {}, None
        self._draw(LEVELS - 1, self.draws[-2].difference.n)

    @property
    def may_go_finer(self) -> bool:
        """Whether the levels are not settled, but finer steps may settle them.

        Finer steps may settle them if paths approach each other at each halving, or if phases are still wrong. The
        error of a phase is at most (omega h)^a/20 per radian. If this error is small up to the horizon and paths
        nevertheless end far apart, they separate because the motion is unstable.
        """
        fewest = fewest_steps(self.problem)
        turned = fewest * SHARPEST * (SHARPEST * fewest / self.steps(LEVELS - 1)) ** of_phases(self.scheme, self.order)
        nearer = self.square_of(LEVELS - 1) < _NEARER * self.square_of(LEVELS - 2)
        return not self.settled and self._first < MOST_HALVINGS and (turned > _TURNED or nearer)

    def seconds_to_tell(self, error: float) -> float:
        """Estimated seconds until the bias is known to this error, by finer steps or by more paths."""
        seconds = self.seconds_to_double
        noise = self.bias(LEVELS - 1)[1]
        return seconds if self.may_go_finer else seconds * (noise / error) ** 2

    @property
    def seconds_to_double(self) -> float:
        """Seconds that the differences took so far."""
        return sum(draw.seconds for draw in self.draws[1:])

    def _changed(self) -> None:
        """Forget results that follow from the draws so far."""
        self._biases: dict[float, tuple[float, float]] = {}  #: cache: level -> bias and its standard error
        self._is_settled: bool | None = None

    def _draw(self, level: int, paths: int) -> None:
        self._changed()
        self.draws[level] += self.sampler.draw(self._first + level, paths)

    def _time(self) -> None:
        """Fit seconds of a path as a + b n, with n the number of steps; the seconds of a call are left out."""
        few, many = (self.steps(level) for level in (0, LEVELS - 1))
        drawn = self.draws[-1]
        short_enough = _LONG_ENOUGH * drawn.difference.n / max(drawn.seconds, 1e-9) > _TIMED
        paths = _TIMED if short_enough else _TIMED // 4
        long = self._plain(many, paths)  # the longest call is first, since a first call takes longer than later ones
        little, short = self._plain(few, paths // 8), self._plain(few, paths)
        path = max((short - little) / (paths - paths // 8), 0.1 * short / paths)
        call = short - path * paths
        last = max((long - call) / paths, path)
        self._slope = max((last - path) / (many - few), 0.2 * last / many)
        self._once = max(path - self._slope * few, 0.0)

    def _plain(self, steps: int, count: int) -> float:
        """Seconds of a call for this many paths."""
        return Plain(self.problem, self.scheme, steps, 0).draw(count).seconds

    def price_of_pairs(self, level: float) -> float:
        """Estimated seconds to measure antithetic pairs at a level; infinite if they do not apply."""
        applies = columns(self.problem, self.scheme) == 1 and self.problem.options.get("truncation") is None
        return 4 * _CALL + 2 * UNITS * _SLOWER * self.seconds(level) if applies else math.inf

    def look_at_pairs(self, level: float) -> None:
        """Measure antithetic pairs at a level; if few of them differ from the rest, their variance is taken as at least
        that of f."""
        estimator = Antithetic(self.problem, self.scheme, self.steps(level), FIRST)
        few, many = estimator.draw(UNITS // 8), estimator.draw(UNITS)
        seconds = max((many.seconds - few.seconds) / (UNITS - UNITS // 8), self.seconds(level))
        drawn: Drawn = few + many
        variance = drawn.units.variance
        if drawn.units.few or self.known.few_of(drawn.units.n):
            variance = max(variance, self.variance)
        self.pairs = Pairs(level, variance, min(seconds, many.seconds / UNITS))

    def price_of_points(self, level: int, most: int = LONG) -> float:
        """Estimated seconds to measure Sobol points at a level; infinite if they do not apply."""
        steps = self.steps(level)
        if not quasi_applies(self.problem, self.scheme, steps):
            return math.inf
        rows = steps * self.problem.model.nnoise * columns(self.problem, self.scheme)
        paths = SCRAMBLINGS * 2**most * (_SLOWER * self.seconds(level) + rows * _NUMBER)
        return seconds_to_load() + 8 * _CALL + rows * _MATRIX + paths

    def look_at_points(self, level: int, most: int = LONG) -> None:
        """Measure scramblings of 2^5 and of 2^most Sobol points at a level; None is noted if a path fails."""
        begin = time.process_time()
        load()
        self.loading += time.process_time() - begin
        self._changed()
        self.even[level] = self._measured(level, most)

    def _measured(self, level: int, most: int) -> Even | None:
        fine, change, seconds = {}, {}, {}
        begin = time.process_time()
        estimator = Quasi(
            self.problem, self.scheme, self.steps(level), FIRST + level, log2_points=most, differences=level > 0
        )
        once = time.process_time() - begin
        for points in (most, SHORT):  # the smaller sets are the first points of the larger ones
            estimator.log2_points = points
            begin = time.process_time()
            both, ok = estimator.fine_and_difference(estimator.begin, SCRAMBLINGS)
            seconds[points] = time.process_time() - begin
            if not ok.all():
                return None
            fine[points] = _as_if_one_differed(Tally.of(both[0]), points, self.variance)
            change[points] = _as_if_one_differed(Tally.of(both[int(level > 0)]), points, self.variance)
        path = max((seconds[most] - seconds[SHORT]) / (SCRAMBLINGS * (2**most - 2**SHORT)), self.seconds(level))
        once += max(seconds[most] - path * SCRAMBLINGS * 2**most, 0.0)
        return Even(level, fine, change, path, once, OF_JUMPS if self.problem.target.is_truth else USUAL)

    def seconds(self, level: float) -> float:
        """Seconds of a path at a level of the ladder, which may lie between two of its steps."""
        return self._once + self._slope * self.sampler.coarsest * 2.0 ** (self._first + level)

    def steps(self, level: float) -> int:
        """Number of steps to the horizon at a level."""
        return math.ceil(self.sampler.coarsest * 2.0 ** (self._first + level) * _NEARLY)

    @property
    def settled(self) -> bool:
        """Whether powers of h are reliable."""
        if self._is_settled is None:
            self._is_settled = self.are_settled(*self._differences(), self.order)
        return self._is_settled

    def bias(self, level: float) -> tuple[float, float]:
        """E f - E f(x_h) at a level of the ladder, and the standard error of this estimate.

        Between two levels it is interpolated by b_0 + b_1 h^a, where a is the weak order.
        """
        if level not in self._biases:
            self._biases[level] = self._bias(level)
        return self._biases[level]

    def _bias(self, level: float) -> tuple[float, float]:
        """Compute the bias, without the cache."""
        if level != int(level):
            begin = math.floor(level)
            coarse, fine = self.bias(begin), self.bias(begin + 1)
            if not self.settled:
                return coarse
            share = (2 ** (self.order * (begin + 1 - level)) - 1) / (2**self.order - 1)
            return tuple(y + share * (x - y) for x, y in zip(coarse, fine, strict=True))
        means, errors = self._differences()
        halved, finer = max(int(level) - LEVELS + 1, 0), LEVELS - 1 - int(level)
        tail, noise = self.left_by(means, errors, self.order, phases=self.order, settled=self.settled, halved=halved)
        return (tail + sum(means[-finer:]), math.hypot(noise, *errors[-finer:])) if finer > 0 else (tail, noise)

    def _differences(self) -> tuple[list[float], list[float]]:
        """Means of f(x_h) - f(x_2h) at levels above 0, and their errors, each by the method that gives it most
        accurately."""
        means = [draw.difference.mean for draw in self.draws[1:]]
        errors = [self.error_of(level) for level in range(1, LEVELS)]
        for level, x in self.even.items():
            if level > 0 and x and 0 < x.error < errors[level - 1]:
                means[level - 1], errors[level - 1] = x.change[x.most].mean, x.error
        return means, errors

    def spread(self, level: int) -> float:
        """Variance of f(x_h) - f(x_2h) at a level above 0; beyond the finest level it is extrapolated."""
        if level < LEVELS:
            return self.draws[level].variance
        before, last = (draw.variance for draw in self.draws[-2:])
        fall = last / before if before > 0 else 1.0
        return last * min(fall, 1.0) ** (level - LEVELS + 1)


def _as_if_one_differed(units: Tally, points: int, variance: float) -> Tally:
    """The tally of these units of 2^points points. If all units are equal, f may jump where no point was. The tally
    then gets the variance of units in which f differs at one point of all.
    """
    if units.m2 > 0:
        return units
    return Tally(units.n, units.mean, (units.n - 1) * variance / (units.n * 4.0**points))
