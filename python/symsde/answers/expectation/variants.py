# SPDX-License-Identifier: BSD-3-Clause
"""Measurements of other methods than plain paths: the variance of a few units, and the seconds that a unit takes."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from . import control, quasi
from .estimators import Antithetic, Estimator
from .quasi import Quasi
from .tally import Tally

if TYPE_CHECKING:
    from .trial import Trial

UNITS = 256  #: that are drawn in a call: their variance is known to a tenth, which is enough to choose by
_MORE = 768  #: where few of these differ
_CHANGES = 256  #: paths that changes from level to level are regressed on, and as many that count
SHORT, LONG, SCRAMBLINGS = 6, 9, 8  #: of quasi-Monte Carlo: log2 of points, randomisations
FIRST = 2**45  #: path that they begin at, far from those of levels and of answers
_CALL = 1e-4  #: seconds of a call, about
_MATRIX = 2.2e-5  #: seconds that SciPy takes for the matrix scrambling of a dimension, about
_NUMBER = 2e-8  #: seconds of a normal of a point, bridged, about
_SLOWER = 1.5  #: paths of given increments, over those that the library draws, about
_DOUBT = 1.06  #: standard error of the log2 of a ratio of two variances of eight units
USUAL, _WEIGHT = 1.5, 11.0  #: of falls: most are between 1.2 and 1.8
_OF_JUMPS = 1.1  #: the same of truth values: of 20, from 2^9 to 2^12 points, most are between 0.9 and 1.3
_FEW = 1.2  #: standard errors of eight units, as many of a normal law


@dataclass(frozen=True)
class Variant:
    """A method, measured at a level of a trial."""

    level: float
    variance: float  #: of a unit
    seconds: float  #: of a unit
    once: float  #: seconds, whatever the units: before the first one, and of a call


@dataclass(frozen=True)
class Even:
    """Scramblings of few and of more Sobol points at a level: means of f, and of its change from the level before."""

    level: int
    fine: dict[int, Tally]  #: by log2 of the points
    change: dict[int, Tally]  #: of f itself at level 0
    path: float  #: seconds of a point, of both paths
    once: float  #: seconds, whatever the points: matrices, calls
    usual: float = USUAL  #: fall of the variance of units, of an f like this one

    @property
    def error(self) -> float:
        """Standard error of the mean change, from the units with the most points."""
        return _FEW * self.change[self.most].error

    @property
    def most(self) -> int:
        """log2 of the largest number of points of a unit."""
        return max(self.fine)


def measure(trial: Trial, kind: type[Estimator], level: float) -> Variant | None:
    """Measure antithetic paths or the control variate at a level; None if half of the units fail."""
    begin = time.process_time()
    estimator = kind(trial.problem, trial.scheme, trial.steps(level), FIRST)
    prepared = time.process_time() - begin
    few, many = estimator.draw(UNITS // 8), estimator.draw(UNITS)
    unit = (many.seconds - few.seconds) / (UNITS - UNITS // 8)
    unit = min(max(unit, trial.seconds(level)), many.seconds / UNITS)
    drawn = few + many
    if drawn.units.few:
        drawn += estimator.draw(_MORE)
    if drawn.units.n < UNITS / 2:
        return None
    variance = drawn.units.variance
    if trial.known.few_of(drawn.units.n):  # of f itself: what its units vary by was hardly seen
        variance = max(variance, trial.variance)
    return Variant(level, variance, unit, prepared + many.seconds - unit * UNITS)


def measure_even(trial: Trial, level: int, most: int = LONG) -> Even | None:
    """Measure scramblings of 2^6 and of 2^most Sobol points at a level; None if a path fails."""
    fine, change, seconds = {}, {}, {}
    begin = time.process_time()
    estimator = Quasi(
        trial.problem, trial.scheme, trial.steps(level), FIRST + level, log2_points=most, differences=level > 0
    )
    once = time.process_time() - begin
    for points in (SHORT, most):
        estimator.log2_points = points
        begin = time.process_time()
        both, ok = estimator.fine_and_difference(estimator.begin, SCRAMBLINGS)
        seconds[points] = time.process_time() - begin
        if not ok.all():
            return None
        fine[points] = _as_if_one_differed(Tally.of(both[0]), points, trial.variance)
        change[points] = _as_if_one_differed(Tally.of(both[int(level > 0)]), points, trial.variance)
    path = max((seconds[most] - seconds[SHORT]) / (SCRAMBLINGS * (2**most - 2**SHORT)), trial.seconds(level))
    once += max(seconds[most] - path * SCRAMBLINGS * 2**most, 0.0)
    return Even(level, fine, change, path, once, _OF_JUMPS if trial.problem.target.is_truth else USUAL)


def _as_if_one_differed(units: Tally, points: int, variance: float) -> Tally:
    """The tally of these units of 2^points points. If all are equal, f may jump where no point came.

    The tally then gets the variance of units in which one point of all differs.
    """
    if units.m2 > 0:
        return units
    return Tally(units.n, units.mean, (units.n - 1) * variance / (units.n * 4.0**points))


def measure_changes(trial: Trial, level: int) -> Tally | None:
    """Changes of f from the level before, minus a regression on linear responses; None if f changes on few paths."""
    steps = trial.steps(level)
    estimator = control.Control(
        trial.problem, trial.scheme, steps, FIRST + level * UNITS, fit=_CHANGES, differences=True
    )
    units = estimator.draw(_CHANGES).units
    return None if units.few or units.n < _CHANGES / 2 else units


def price_of_changes(trial: Trial, levels: Iterable[int]) -> float:
    """Estimated seconds of `measure_changes` at these levels; infinite if the control variate does not apply."""
    noises, total = trial.problem.model.nnoise, 0.0
    for level in levels:
        if not control.applies(trial.problem, trial.steps(level)):
            return math.inf
        paths = 3 * trial.steps(level) * noises + 2 * 1.5 * _CHANGES
        total += 10 * _CALL + paths * _SLOWER * trial.seconds(level)
    return total


def fall(variances: dict[int, Tally], usual: float = USUAL) -> float:
    """-log2 of the factor by which the variance of a unit changes if its points are doubled.

    It is the mean of the fall that is seen and the usual one, weighted by how well each is known. From eight units a
    variance is known to a half, so the fall between units of eight times as many points is known to a third.
    """
    short, most = min(variances), max(variances)
    few, more = (max(variances[points].variance, 1e-300) for points in (short, most))
    weight = ((most - short) / _DOUBT) ** 2
    seen = math.log2(few / more) / (most - short)
    return min(max((weight * seen + _WEIGHT * usual) / (weight + _WEIGHT), 1.0), 3.0)


def price(trial: Trial, method: str, level: float, most: int = LONG) -> float:
    """Estimated seconds to measure a method at a level; infinite if the method does not apply."""
    problem, steps, path = trial.problem, trial.steps(level), trial.seconds(level)
    if method == Quasi.name:
        applies = quasi.applies(problem, trial.scheme, steps)
        rows = steps * problem.model.nnoise * quasi.columns(problem, trial.scheme)
        points = SCRAMBLINGS * 2**most * (_SLOWER * path + rows * _NUMBER)
        once = quasi.seconds_to_load() + 8 * _CALL + rows * _MATRIX
        return once + points if applies else math.inf
    if method == Antithetic.name:
        applies = quasi.columns(problem, trial.scheme) == 1 and problem.options.get("truncation") is None
        return 4 * _CALL + 2 * UNITS * _SLOWER * path if applies else math.inf
    if not control.applies(problem, steps):
        return math.inf
    rows = steps * problem.model.nnoise
    return 6 * _CALL + (2 * rows + (control.FIT + UNITS) * _SLOWER) * path
