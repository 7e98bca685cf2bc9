# SPDX-License-Identifier: BSD-3-Clause
"""The estimated cost of every method and scheme for an interval.

The error e that the tolerance allows is shared, e^2 = Var/N + bias^2 with bias^2 <= s e^2, s = BIAS_SHARE. The step is
the longest whose bias, including the noise of its estimate, keeps this bound. The rest, A = (1 - s) e^2, is for noise.
Each method is a sum over levels l of N_l independent units, whose variances V_l and seconds C_l a pilot measures; its
cost is least for

    N_l = (V_l/C_l)^(1/2) sum_k (V_k C_k)^(1/2)/A,    sum_l N_l C_l = (sum_l (V_l C_l)^(1/2))^2/A    (Giles 2008)

    plain, antithetic             one level: f on a path, or on a pair of paths driven by dW and -dW
    multilevel                    from the best coarsest level to the finest, f and its changes d_l on paths
    multilevel quasi-Monte Carlo  f and d_l on scramblings of 2^k_l points: N_l = 16, and V_l falls as 2^(-s_l k_l)

The points of the level with the largest V_l over its seconds are doubled until sum_l V_l/16 <= A (Giles, Waterhouse
2009). On levels finer than the measured ones V_l is assumed to fall from level to level like the variance of paths, and
s_l - 1, the gain of points over paths, to halve with every level, since ever more dimensions contribute to a change.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field

from ...schemes import Scheme
from .estimators import MOST_POINTS, Antithetic, Estimator, Plain, Quasi, quasi_applies
from .interval import BIAS_SHARE
from .problem import Problem
from .trial import LEVELS, MOST_HALVINGS, Trial

PLAIN, ANTITHETIC, MULTILEVEL, EVEN_LEVELS = METHODS = (
    "plain",
    "antithetic",
    "multilevel",
    "multilevel quasi-Monte Carlo",
)
FIRST_PATHS = 256  #: paths of a new level of multilevel: enough to know a variance to a tenth of its value
_A_LEVEL = 1.5e-3  #: rough seconds of a level of multilevel besides its paths: calls, tallies, allocation
_BISECTIONS = 6  #: bisections of a halving of the step: enough to find the number of steps to a percent
_FEWEST = 5  #: log2 of the fewest points of a level: a call alone takes as long as 2^5 paths


@dataclass
class Plan:
    """A plan for the interval: a method, a scheme, steps, and the estimated cost."""

    method: str
    scheme: Scheme
    steps: int  #: number of steps to the horizon; of multilevel methods on the finest level
    coarsest_steps: int  #: number of steps on the coarsest level
    seconds: float  #: predicted seconds of processor time
    variance: float  #: variance of a unit of paths; for Sobol points the variance of f itself
    bias: tuple[float, float]  #: E f - E f(x_h), and the standard error of this estimate
    #: log2 of the number of points on each level of multilevel quasi-Monte Carlo
    points: list[int] = field(default_factory=list)
    level: float = 0.0  #: level of the ladder with this number of steps
    trial: Trial | None = field(default=None, compare=False, repr=False)

    def estimators(self, first: int, problem: Problem) -> list[Estimator]:
        """Estimators of the levels, from the path of index `first` on; multilevel has its own sampler."""
        if self.method == EVEN_LEVELS:
            return [
                Quasi(problem, self.scheme, self.coarsest_steps << i, first + i, log2_points=points, differences=i > 0)
                for i, points in enumerate(self.points)
            ]
        kind = Antithetic if self.method == ANTITHETIC else Plain
        return [kind(problem, self.scheme, self.steps, first)]


def plans(trial: Trial, error: float) -> list[Plan]:
    """The plans of this trial that keep the root mean square error `error`, by all measurements so far."""
    finest, level = coarse_enough(trial.bias, error), longest(trial.bias, error)
    if finest is None:
        return []
    found = (
        plain(trial, error, level),
        antithetic(trial, error, level),
        multilevel(trial, error, finest),
        even_levels(trial, error, finest),
    )
    return [plan for plan in found if plan is not None]


def _plan(method: str, trial: Trial, level: float, seconds: float, variance: float, *, coarsest: int = 0) -> Plan:
    steps, coarsest_steps = trial.steps(level), trial.steps(coarsest)
    return Plan(method, trial.scheme, steps, coarsest_steps, seconds, variance, trial.bias(level), [], level, trial)


def allowed(error: float) -> float:
    """Variance (1 - s) e^2 that noise may add to the value, if the total error may be e."""
    return max((1 - BIAS_SHARE) * error**2, 1e-300)


def coarse_enough(left: Callable[[int], tuple[float, float]], error: float) -> int | None:
    """The first level of the ladder whose bias `left(level)` is small compared with this error; None if there is
    none.
    """
    return next((level for level in range(LEVELS + MOST_HALVINGS) if _small(left(level), error)), None)


def longest(left: Callable[[float], tuple[float, float]], error: float) -> float | None:
    """The real level of the longest step with a small bias, also between steps of the ladder, to a sixty-fourth of a
    halving.
    """
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


def plain(trial: Trial, error: float, level: float) -> Plan:
    """The plan of independent paths at the step of this level, the longest with a small bias."""
    least = Plain.least_units if trial.variance > 0 else 2
    units = max(float(least), trial.variance / allowed(error))
    return _plan(PLAIN, trial, level, units * trial.seconds(level), trial.variance)


def antithetic(trial: Trial, error: float, level: float) -> Plan | None:
    """The plan of antithetic pairs at the step of this level; None if they were not measured."""
    pairs = trial.pairs
    if pairs is None:
        return None
    units = max(float(Antithetic.least_units), pairs.variance / allowed(error))
    unit = pairs.seconds * trial.seconds(level) / trial.seconds(pairs.level)
    return _plan(ANTITHETIC, trial, level, units * unit, pairs.variance)


def multilevel(trial: Trial, error: float, finest: int) -> Plan | None:
    """The plan of multilevel from the best coarsest level to the finest, the first with a small bias.

    None if f does not vary.
    """
    if trial.variance <= 0:
        return None
    finest = max(finest, 1)
    units = [trial.seconds(level) for level in range(finest + 1)]
    units[1:] = [fine + coarse for coarse, fine in itertools.pairwise(units)]
    best, work, begun = None, 0.0, 0.0
    for level in range(finest, 0, -1):  # moving the coarsest level down adds a level of changes
        work += math.sqrt(trial.spread(level) * units[level])
        begun += FIRST_PATHS * units[level] + _A_LEVEL
        whole = work + math.sqrt(trial.variance * trial.seconds(level - 1))
        seconds = whole**2 / allowed(error) + begun
        if best is None or seconds <= best[0]:
            best = seconds, level - 1
    return _plan(MULTILEVEL, trial, finest, best[0], trial.variance, coarsest=best[1])


def even_levels(trial: Trial, error: float, finest: int) -> Plan | None:
    """The plan of multilevel quasi-Monte Carlo from the best coarsest level; None if no level was measured."""
    if not trial.even or not quasi_applies(trial.problem, trial.scheme, trial.steps(finest)):
        return None
    found = (_points(trial, level, finest, error) for level in range(min(finest, LEVELS - 1) + 1))
    best = min(filter(None, found), default=None)
    if best is None:
        return None
    seconds, coarsest, points = best
    plan = _plan(EVEN_LEVELS, trial, finest, seconds, trial.variance, coarsest=coarsest)
    plan.points = points
    return plan


def _points(trial: Trial, coarsest: int, finest: int, error: float) -> tuple[float, int, list[int]] | None:
    """Seconds, coarsest level, and log2 of the points of each level from there on; None if too little is known."""
    if not trial.even.get(coarsest):
        return None
    variance, slope, path, once = [], [], [], 0.0
    for level in range(coarsest, finest + 1):
        near = max((x for x in trial.even.values() if x and x.level <= level), key=lambda x: x.level)
        if level > coarsest and near.level == 0:  # changes were not measured
            return None
        units, smaller = near.fine if level == coarsest else near.change, 1.0
        if level > near.level and trial.spread(near.level) > 0:  # extrapolate by the fall of the variance of paths
            smaller = trial.spread(level) / trial.spread(near.level)
        fall, begin = near.fall(units), near.most
        if level > near.level and level > coarsest:
            fall, begin = 1 + (fall - 1) * 0.5 ** (level - near.level), min(units)
        slope.append(2.0**-fall)
        variance.append(max(units[begin].variance * smaller, 1e-300) * slope[-1] ** (_FEWEST - begin))
        longer = trial.steps(level) / trial.steps(near.level)
        path.append(near.path * longer)
        once += near.once * longer
    points, needed = [_FEWEST] * len(path), allowed(error) * Quasi.least_units
    while sum(variance) > needed:
        i = max(range(len(path)), key=lambda j: variance[j] / (path[j] * 2.0 ** points[j]))
        points[i] += 1
        variance[i] *= slope[i]
        if points[i] > MOST_POINTS:
            return None
    seconds = once + Quasi.least_units * sum(x * 2.0**n for x, n in zip(path, points, strict=True))
    return seconds, coarsest, points
