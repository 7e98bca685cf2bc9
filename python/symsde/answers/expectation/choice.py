# SPDX-License-Identifier: BSD-3-Clause
"""The estimated cost of every way to the interval.

The error e that the tolerance allows is shared, e^2 = Var/N + bias^2 with bias^2 <= s e^2, s = BIAS_SHARE. The step is
the longest whose bias keeps that; then with V = Var f, V_l, C_l as in `coupled.py` and a the weak order

    plain          N = V/((1 - s) e^2),                                    N C(h)
    extrapolated   N = (V^(1/2) + V_l^(1/2)/(2^a - 1))^2/((1 - s) e^2),    N (C_l + C_{l-1})
    multilevel     (sum_l (V_l (C_l + C_{l-1}))^(1/2))^2/((1 - s) e^2)     over levels from the best coarsest one

Antithetic paths and control variates cost as plain ones do, with the variance of their units; of quasi-Monte Carlo the
variance of a unit falls as a power of its points, as few and more of them show.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from ...schemes import Scheme
from . import control, quasi, variants
from .estimators import Antithetic, Estimator, Extrapolated, Plain
from .problem import Problem
from .quasi import Quasi
from .tally import Tally
from .tolerance import BIAS_SHARE
from .trial import LEVELS, MOST_HALVINGS, Trial

EVEN_LEVELS = "multilevel quasi-Monte Carlo"
_BEGUN_WITH = 256  #: paths of every level, before anything is known of it
_A_LEVEL = 1.5e-3  #: seconds that a level takes beside its paths, about: calls, tallies, allocation
_NEAR = 1.5  #: levels below a step, at which the variance of its units is not known from theirs
_BISECTIONS = 10  #: of a halving of the step
_BEYOND = 0.5  #: log2 of the points that doubling takes over those that are needed, as often more as less
_FEWEST = 5  #: log2 of the points of a level


@dataclass(eq=False)
class Plan:
    """A way to the interval: a method, a scheme, a step, and its estimated cost."""

    method: str
    trial: Trial
    level: float  #: of the ladder; of multilevel the finest, a whole number as of extrapolation
    seconds: float  #: of the processor, predicted
    note: str = ""
    coarsest: int = 0  #: level of the ladder that multilevel begins with
    variance: float = 0.0  #: of a unit, as far as the pilot knows it
    options: dict = field(default_factory=dict)
    parts: list[tuple[float, float]] = field(default_factory=list)  #: of each level: units, and seconds of one
    is_rehearsed: bool = False  #: its seconds are those of a part of the work itself

    @property
    def steps(self) -> int:
        """Number of steps to the horizon."""
        return self.trial.steps(self.level)

    @property
    def bias(self) -> tuple[float, float]:
        """Estimate of E f - E f(x_h), the bias of the step, and the standard error of this estimate."""
        return (self.trial.rest if self.method == Extrapolated.name else self.trial.bias)(self.level)

    @property
    def scheme(self) -> Scheme:
        """The scheme of the trial."""
        return self.trial.scheme

    @property
    def coarsest_steps(self) -> int:
        """Number of steps to the horizon of the coarsest level of multilevel."""
        return self.trial.steps(self.coarsest)

    def estimator(self, first: int, problem: Problem) -> Estimator:
        """The estimator of this plan, whose first path has the index `first`."""
        return estimator_of(self.method, problem, self.scheme, self.steps, first=first, options=self.options)

    def even_level(self, index: int, first: int, problem: Problem) -> Quasi:
        """The estimator of a level of multilevel quasi-Monte Carlo; index 0 is the coarsest level."""
        return even_level_of(problem, self.scheme, self.coarsest_steps, index, first=first, options=self.options)


def estimator_of(
    method: str, problem: Problem, scheme: Scheme, steps: int, *, first: int, options: dict
) -> Estimator:  # fmt: skip
    """The estimator of a method at this scheme and number of steps, whose first path has the index `first`."""
    kinds = {kind.name: kind for kind in (Plain, Antithetic, Extrapolated, control.Control, Quasi)}
    return kinds[method](problem, scheme, steps, first, **options)


def even_level_of(
    problem: Problem, scheme: Scheme, coarsest: int, index: int, *, first: int, options: dict
) -> Quasi:  # fmt: skip
    """The estimator of a level of multilevel quasi-Monte Carlo; index 0 is the coarsest level."""
    points = options["log2_points"][index]
    return Quasi(problem, scheme, coarsest << index, first, log2_points=points, differences=index > 0)


def _allowed(error: float) -> float:
    """Variance (1 - s) e^2 that noise may give the value, if its error may be e."""
    return max((1 - BIAS_SHARE) * error**2, 1e-300)


def coarse_enough(left: Callable[[int], tuple[float, float]], error: float, first: int = 0) -> int | None:
    """The first level of the ladder whose bias `left(level)` is small beside this error; None if there is none."""
    for level in range(first, LEVELS + MOST_HALVINGS):
        if _small(left(level), error):
            return level
    return None


def longest(left: Callable[[float], tuple[float, float]], error: float) -> float | None:
    """The longest such step, also between the steps of the ladder: a real level, to a thousandth of a halving."""
    level = coarse_enough(left, error)
    if not level:
        return level
    low, high = float(level - 1), float(level)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        low, high = (low, middle) if _small(left(middle), error) else (middle, high)
    return high


def _small(left: tuple[float, float], error: float) -> bool:
    """Whether a bias and its standard error together stay below the share s^(1/2) of this error."""
    return math.hypot(*left) <= math.sqrt(BIAS_SHARE) * error


def plain(trial: Trial, error: float) -> Plan | None:
    """The plan of independent paths at one step; None if no step has a small bias."""
    level = longest(trial.bias, error)
    if level is None:
        return None
    least = Plain.least_units if trial.variance > 0 else 2
    units, unit = max(float(least), trial.variance / _allowed(error)), trial.seconds(level)
    return Plan(Plain.name, trial, level, units * unit, variance=trial.variance, parts=[(units, unit)])


def extrapolated(trial: Trial, error: float) -> Plan | None:
    """The plan of extrapolation from two steps on the same paths; None if f does not vary or no step is fine enough."""
    level = coarse_enough(trial.rest, error, first=1)
    if level is None or trial.variance <= 0:
        return None
    spread = (math.sqrt(trial.variance) + math.sqrt(trial.spread(level)) / (2**trial.order - 1)) ** 2
    units = max(float(Extrapolated.least_units), spread / _allowed(error))
    unit = trial.seconds(level) + trial.seconds(level - 1)
    plan = Plan(Extrapolated.name, trial, level, units * unit, variance=spread, parts=[(units, unit)])
    plan.options = {"order": trial.order}
    return plan


def multilevel(trial: Trial, error: float) -> Plan | None:
    """The plan of multilevel from the best coarsest level to the first with a small bias; None if there is none."""
    finest = coarse_enough(trial.bias, error)
    if finest is None or trial.variance <= 0:
        return None
    finest = max(finest, 1)
    best = None
    for coarsest in range(finest):
        levels = [(trial.variance, trial.seconds(coarsest))]
        for level in range(coarsest + 1, finest + 1):
            levels.append((trial.spread(level), trial.seconds(level) + trial.seconds(level - 1)))
        total = sum(math.sqrt(variance * unit) for variance, unit in levels)
        begun = sum(_BEGUN_WITH * unit + _A_LEVEL for _, unit in levels[1:])
        seconds = total**2 / _allowed(error) + begun
        if best is None or seconds < best.seconds:
            best = Plan("multilevel", trial, finest, seconds, coarsest=coarsest)
            best.parts = [(math.sqrt(variance / unit) * total / _allowed(error), unit) for variance, unit in levels]
    return best


def of_variant(trial: Trial, method: str, error: float) -> Plan | None:
    """The plan of a method whose units were measured, at the longest step; None if they were not."""
    variant, level = trial.measured.get(method), longest(trial.bias, error)
    if variant is None or level is None or math.isinf(variants.price(trial, method, level)):
        return None
    seconds, units = _seconds_of(trial, variant, level, error, method), _units(variant, error)
    plan = Plan(method, trial, level, seconds, variance=variant.variance, parts=[(units, seconds / units)])
    if method == control.Control.name:
        plan.options = {"fit": control.fit_for(_units(variant, error))}
    return plan


def _seconds_of(trial: Trial, variant: variants.Variant, level: float, error: float, method: str) -> float:
    """Seconds of this method at a level for this error, from the seconds measured at the level of the variant."""
    unit = variant.seconds * trial.seconds(level) / trial.seconds(variant.level)
    longer = variants.price(trial, method, level) / variants.price(trial, method, variant.level)
    units = _units(variant, error)
    if method == control.Control.name:
        return variant.once * longer + (units + control.fit_for(units) - control.FIT) * unit
    return variant.once * longer + units * unit


def _units(variant: variants.Variant, error: float) -> float:
    """Number of units that this error needs."""
    return max(float(Estimator.least_units), variant.variance / _allowed(error))


def without_bias(trial: Trial, error: float) -> float:
    """Seconds of the cheapest measured method at the finest step of the ladder, if its bias were small."""
    known = ((method, x) for method, x in trial.measured.items() if x is not None)
    return min((_seconds_of(trial, x, LEVELS - 1, error, method) for method, x in known), default=math.inf)


def even(trial: Trial, error: float) -> Plan | None:
    """The plan of quasi-Monte Carlo; None if it does not apply or was not measured.

    A unit gets so many points that the fewest units are enough, if the variance falls as it did in the pilot.
    """
    level = longest(trial.bias, error)
    near_enough = -1 if level is None else min(level, LEVELS - 1) - _NEAR
    known = [x for x in trial.even.values() if x is not None and x.level > near_enough]
    if level is None or not known or not quasi.applies(trial.problem, trial.scheme, trial.steps(level)):
        return None
    near = min(known, key=lambda x: abs(x.level - level))
    exact = _points(near.fine, _allowed(error) * Quasi.least_units, near.usual)
    if exact > quasi.MOST_POINTS:
        return None
    points = max(*near.fine, math.ceil(exact))
    longer = trial.steps(level) / trial.steps(near.level)
    unit = longer * (near.once / Quasi.least_units + near.path * 2.0 ** (exact + _BEYOND))
    plan = Plan(Quasi.name, trial, level, Quasi.least_units * unit, parts=[(Quasi.least_units, unit)])
    plan.options, plan.variance = {"log2_points": points}, trial.variance / 2.0**points
    return plan


def _points(units: dict[int, Tally], needed: float, usual: float = variants.USUAL) -> float:
    """log2 of the points with which a unit has the variance `needed`, extrapolated from the units that were tried.

    The work begins with a quarter of the next power of two, and doubles the points or adds units as their variance
    shows.
    """
    known = max(units)
    more = math.log2(max(units[known].variance, 1e-300) / needed) / variants.fall(units, usual)
    return known + max(more, -2.0)


def even_levels(trial: Trial, error: float) -> Plan | None:
    """The plan of multilevel quasi-Monte Carlo from the best coarsest level; None if no level was measured."""
    finest = coarse_enough(trial.bias, error)
    if not finest or not quasi.applies(trial.problem, trial.scheme, trial.steps(finest)):
        return None
    best = None
    for coarsest in (level for level in range(finest) if trial.even.get(level)):
        plan = _even_levels(trial, coarsest, finest, _allowed(error) * Quasi.least_units)
        if plan is not None and (best is None or plan.seconds < best.seconds):
            best = plan
    return best


def _even_levels(trial: Trial, coarsest: int, finest: int, needed: float) -> Plan | None:
    """The same from a given coarsest level.

    The points of the level with the largest variance of a unit per second are doubled, until the sum of the variances
    is at most `needed`.
    """
    variance, slope, path, once = [], [], [], []
    for level in range(coarsest, finest + 1):
        near = max((x for x in trial.even.values() if x and x.level <= level), key=lambda x: x.level)
        if level > coarsest and near.level == 0:  # nothing is known of changes
            return None
        units = near.fine if level == coarsest else near.change
        smaller = (
            trial.spread(level) / trial.spread(near.level) if level > near.level and trial.spread(near.level) else 1.0
        )
        slope.append(2.0 ** -variants.fall(units, near.usual))
        known = max(units[near.most].variance * smaller, 1e-300)
        variance.append(known * slope[-1] ** (_FEWEST - near.most))
        longer = trial.steps(level) / trial.steps(near.level)
        path.append(near.path * longer)
        once.append(near.once * longer / Quasi.least_units)
    points = [_FEWEST] * len(path)
    while sum(variance) > needed:
        i = max(range(len(path)), key=lambda j: variance[j] / (path[j] * 2.0 ** points[j]))
        points[i] += 1
        variance[i] *= slope[i]
        if points[i] > quasi.MOST_POINTS:
            return None
    parts = [(Quasi.least_units, x + y * 2.0**n) for x, y, n in zip(once, path, points, strict=True)]
    plan = Plan(EVEN_LEVELS, trial, finest, sum(n * unit for n, unit in parts), coarsest=coarsest, parts=parts)
    plan.variance, plan.options = trial.variance, {"log2_points": points}
    return plan
