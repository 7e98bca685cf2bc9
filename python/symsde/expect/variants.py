# SPDX-License-Identifier: BSD-3-Clause
"""What few units of a method beside plain paths show: their variance, and what a unit takes."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from . import control, quasi
from .estimators import Antithetic, Estimator
from .quasi import Quasi
from .tally import Tally

if TYPE_CHECKING:
    from .trial import Trial

UNITS = 1024  #: that are drawn
SHORT, LONG, SCRAMBLINGS = 6, 9, 8  #: of quasi-Monte Carlo: log2 of points, randomisations
FIRST = 2**45  #: path that they begin at, far from those of levels and of answers
_CALL = 1e-4  #: seconds of a call, about
_MATRIX = 2.2e-5  #: seconds that SciPy takes for the matrix scrambling of a dimension, about
_NUMBER = 2e-8  #: seconds of a normal of a point, bridged, about
_SLOWER = 1.5  #: paths of given increments, over those that the library draws, about
_FEW = 1.2  #: standard errors of eight units, as many of a normal law


@dataclass(frozen=True)
class Variant:
    """A method at a level of a trial."""

    level: float
    variance: float  #: of a unit
    seconds: float  #: of a unit
    once: float  #: seconds, before the first unit


@dataclass(frozen=True)
class Even:
    """Scramblings of few and of more Sobol points at a level: means of f, and of its change from the level before."""

    level: int
    fine: dict[int, Tally]  #: by log2 of the points
    change: dict[int, Tally]  #: of f itself at level 0
    path: float  #: seconds of a point, of both paths
    once: float  #: seconds, whatever the points: matrices, calls

    @property
    def error(self) -> float:
        """Standard error of the mean change, by more points."""
        return _FEW * self.change[LONG].error


def measure(trial: Trial, kind: type[Estimator], level: float) -> Variant | None:
    """Antithetic, or the control variate; None where half of the units fail."""
    begin = time.process_time()
    estimator = kind(trial.problem, trial.scheme, trial.steps(level), FIRST)
    prepared = time.process_time() - begin
    drawn = estimator.draw(UNITS)
    if drawn.units.n < UNITS / 2:
        return None
    return Variant(level, drawn.units.variance, drawn.seconds / drawn.units.n, prepared)


def measure_even(trial: Trial, level: int) -> Even | None:
    """Quasi-Monte Carlo; None where a path fails."""
    fine, change, seconds = {}, {}, {}
    begin = time.process_time()
    estimator = Quasi(
        trial.problem, trial.scheme, trial.steps(level), FIRST + level, log2_points=LONG, differences=level > 0
    )
    once = time.process_time() - begin
    for points in (SHORT, LONG):
        estimator.log2_points = points
        begin = time.process_time()
        both, ok = estimator.fine_and_difference(estimator.begin, SCRAMBLINGS)
        seconds[points] = time.process_time() - begin
        if not ok.all():
            return None
        fine[points], change[points] = Tally.of(both[0]), Tally.of(both[int(level > 0)])
    path = max((seconds[LONG] - seconds[SHORT]) / (SCRAMBLINGS * (2**LONG - 2**SHORT)), trial.seconds(level))
    return Even(level, fine, change, path, once + max(seconds[LONG] - path * SCRAMBLINGS * 2**LONG, 0.0))


def fall(variances: dict[int, Tally]) -> float:
    """-log2 of the variance for a doubling of the points; a bit less than it was, of eight units known to a half."""
    few, more = (max(variances[points].variance, 1e-300) for points in (SHORT, LONG))
    return min(max(math.log2(few / more) / (LONG - SHORT) - 0.3, 1.0), 3.0)


def price(trial: Trial, method: str, level: float) -> float:
    """Seconds that it takes to measure it, about; infinite where the method does not apply."""
    problem, steps, path = trial.problem, trial.steps(level), trial.seconds(level)
    if method == Quasi.name:
        applies = quasi.applies(problem, trial.scheme, steps)
        rows = steps * problem.model.nnoise * quasi.columns(problem, trial.scheme)
        points = SCRAMBLINGS * 2**LONG * (_SLOWER * path + rows * _NUMBER)
        return 8 * _CALL + rows * _MATRIX + points if applies else math.inf
    if method == Antithetic.name:
        applies = quasi.columns(problem, trial.scheme) == 1 and problem.options.get("truncation") is None
        return 4 * _CALL + 2 * UNITS * _SLOWER * path if applies else math.inf
    if not control.applies(problem, steps):
        return math.inf
    rows = steps * problem.model.nnoise
    return 6 * _CALL + (2 * rows + (control.FIT + UNITS) * _SLOWER) * path
