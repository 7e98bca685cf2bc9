# SPDX-License-Identifier: BSD-3-Clause
"""What every way to the interval would cost, and the cheapest."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from ..mlmc.sampler import driven_by_more
from ..schemes import Scheme
from . import control, quasi
from .estimators import Antithetic, Estimator, Extrapolated, Plain
from .problem import Problem
from .quasi import Quasi
from .tolerance import BIAS_SHARE
from .trial import LEVELS, MOST_HALVINGS, Trial

_BEGUN_WITH = 256  #: paths of every level, before anything is known of it


@dataclass(eq=False)
class Plan:
    """A way to the interval: a method, a scheme, a step, and what it is reckoned to cost."""

    method: str
    trial: Trial
    level: float  #: of the ladder; of multilevel the finest, a whole number as of extrapolation
    seconds: float  #: of the processor, predicted
    note: str = ""
    coarsest: int = 0  #: level of the ladder that multilevel begins with
    variance: float = 0.0  #: of a unit, as far as the pilot knows it
    options: dict = field(default_factory=dict)

    @property
    def steps(self) -> int:
        """To the horizon."""
        return self.trial.steps(self.level)

    @property
    def bias(self) -> tuple[float, float]:
        """What the step leaves of E f, and the standard error of this estimate."""
        return (self.trial.rest if self.method == Extrapolated.name else self.trial.bias)(self.level)

    @property
    def scheme(self) -> Scheme:
        """Its scheme."""
        return self.trial.scheme

    @property
    def coarsest_steps(self) -> int:
        """To the horizon, of the first level of multilevel."""
        return self.trial.steps(self.coarsest)

    def estimator(self, first: int, problem: Problem) -> Estimator:
        """What draws it, from a path on."""
        return estimator_of(self.method, problem, self.scheme, self.steps, first=first, options=self.options)


def estimator_of(
    method: str, problem: Problem, scheme: Scheme, steps: int, *, first: int, options: dict
) -> Estimator:  # fmt: skip
    """The estimator of a method, from a path on."""
    kinds = {kind.name: kind for kind in (Plain, Antithetic, Extrapolated, control.Control, Quasi)}
    return kinds[method](problem, scheme, steps, first, **options)


def coarse_enough(left: Callable[[int], tuple[float, float]], error: float, first: int = 0) -> int | None:
    """The longest step of the ladder that leaves little beside this error; None where none does."""
    for level in range(first, LEVELS + MOST_HALVINGS):
        if math.hypot(*left(level)) <= math.sqrt(BIAS_SHARE) * error:
            return level
    return None


def longest(left: Callable[[float], tuple[float, float]], error: float) -> float | None:
    """The same between the steps of the ladder, where what is left falls as a power from one to the next."""
    level = coarse_enough(left, error)
    if not level:
        return level
    above, below = (math.hypot(*left(x)) for x in (level - 1, level))
    return level - 1 + math.log(above / (math.sqrt(BIAS_SHARE) * error)) / math.log(above / max(below, 1e-300))


def plain(trial: Trial, error: float) -> Plan | None:
    """Independent paths of one step."""
    level = longest(trial.bias, error)
    if level is None:
        return None
    units = max(2.0, trial.variance / ((1 - BIAS_SHARE) * error**2)) if trial.variance > 0 else 2.0
    return Plan(Plain.name, trial, level, units * trial.seconds(level), variance=trial.variance)


def extrapolated(trial: Trial, error: float) -> Plan | None:
    """Two steps on the same paths."""
    level = coarse_enough(trial.rest, error, first=1)
    if level is None or trial.variance <= 0:
        return None
    spread = (math.sqrt(trial.variance) + math.sqrt(trial.spread(level)) / (2**trial.order - 1)) ** 2
    seconds = spread / ((1 - BIAS_SHARE) * error**2) * (trial.seconds(level) + trial.seconds(level - 1))
    return Plan(Extrapolated.name, trial, level, seconds, variance=trial.variance, options={"order": trial.order})


def multilevel(trial: Trial, error: float) -> Plan | None:
    """Levels from the best coarsest one to the one whose bias is small."""
    finest = coarse_enough(trial.bias, error)
    if finest is None or trial.variance <= 0:
        return None
    finest = max(finest, 1)
    best = None
    for coarsest in range(finest):
        total, begun = math.sqrt(trial.variance * trial.seconds(coarsest)), 0.0
        for level in range(coarsest + 1, finest + 1):
            pair = trial.seconds(level) + trial.seconds(level - 1)
            total += math.sqrt(trial.spread(level) * pair)
            begun += _BEGUN_WITH * pair
        seconds = total**2 / ((1 - BIAS_SHARE) * error**2) + begun
        if best is None or seconds < best.seconds:
            best = Plan("multilevel", trial, finest, seconds, coarsest=coarsest)
    return best


def variants(trial: Trial, level: float, error: float, budget: float) -> list[Plan]:
    """Antithetic, control variate and quasi-Monte Carlo at a step, by what a pilot of each shows."""
    problem, steps = trial.problem, trial.steps(level)
    found = []
    allowed = max((1 - BIAS_SHARE) * error**2, 1e-300)
    if control.applies(problem, steps):
        found.append(_measured(Plan(control.Control.name, trial, level, math.inf), allowed, budget))
    if not driven_by_more(trial.scheme) and problem.model.nnoise:
        if problem.options.get("truncation") is None:
            found.append(_measured(Plan(Antithetic.name, trial, level, math.inf), allowed, budget))
        if quasi.applies(problem, steps):
            found.append(_quasi(trial, level, allowed, budget))
    return [plan for plan in found if plan is not None]


_PILOT = 1024  #: units of a variant
_FIRST = 2**45  #: path that the pilots of variants begin at, far from those of levels and of answers


def _measured(plan: Plan, allowed: float, budget: float) -> Plan | None:
    """With the seconds that variance and cost of few units tell; none where half of these fail."""
    paths = control.FIT + _PILOT if plan.method == control.Control.name else _PILOT
    if paths * plan.trial.seconds(plan.level) * 3 > budget:
        return None
    begin = time.process_time()
    estimator = plan.estimator(_FIRST, plan.trial.problem)
    prepared = time.process_time() - begin
    drawn = estimator.draw(_PILOT)
    if drawn.units.n < _PILOT / 2:
        return None
    plan.variance = drawn.units.variance
    plan.seconds = prepared + max(2.0, plan.variance / allowed) * drawn.seconds / drawn.units.n
    return plan


_SHORT, _LONG, _SCRAMBLINGS = 6, 9, 8  #: of the pilot: log2 of points, randomisations
_SCRAMBLE = 1e-2  #: seconds that SciPy takes for a scrambling


def _quasi(trial: Trial, level: float, allowed: float, budget: float) -> Plan | None:
    """Points a unit such that the fewest units are enough, by how the variance fell from few to more points."""
    if _SCRAMBLINGS * (2 * _SCRAMBLE + 2**_LONG * trial.seconds(level) * 4) > budget:
        return None
    variance, seconds = {}, {}
    for points in (_SHORT, _LONG):
        plan = Plan(Quasi.name, trial, level, math.inf, options={"log2_points": points})
        drawn = plan.estimator(_FIRST, plan.trial.problem).draw(_SCRAMBLINGS)
        if drawn.units.n < _SCRAMBLINGS:
            return None
        variance[points], seconds[points] = drawn.units.variance, drawn.seconds / drawn.units.n
    fall = math.log2(max(variance[_SHORT], 1e-300) / max(variance[_LONG], 1e-300)) / (_LONG - _SHORT)
    fall = min(max(fall - 0.3, 1.0), 3.0)  # of eight units the variance is known to a half
    needed = allowed * Quasi.least_units
    points = _LONG
    while variance[_LONG] * 2.0 ** (-fall * (points - _LONG)) > needed:
        points += 1
        if points > quasi.MOST_POINTS:
            return None
    plan.options, plan.variance = {"log2_points": points}, trial.variance / 2.0**points
    plan.seconds = Quasi.least_units * _of_scrambling(seconds, points, trial.seconds(level))
    return plan


def _of_scrambling(seconds: dict[int, float], points: int, path: float) -> float:
    """Seconds of a scrambling of 2^points from those of few and of more points, a + b 2^points, b not below a path."""
    few, more = 2.0**_SHORT, 2.0**_LONG
    slope = max((seconds[_LONG] - seconds[_SHORT]) / (more - few), path)
    return max(seconds[_LONG] - slope * more, 0.0) + slope * 2.0**points
